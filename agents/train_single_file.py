"""Train a policy by PPO in one file, on PyTorch and gymnasium.make_vec alone.

    python agents/train_single_file.py
    python agents/train_single_file.py --env wt_gym/LoadReduction-Linear-v0 --turbines 64 --steps 4000000   # 5 minutes

The task and its settings are those of train_sb3.py; the second line learns on a linear model of the turbine. This file
is meant to be read and changed: the whole algorithm (Schulman et al., Proximal policy optimization algorithms,
arXiv:1707.06347) is in `main`. Writes policy.pt and curve.png.
"""

import argparse
import time
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import nn

import wt_gym  # noqa: F401 - registers the environments

GAMMA, LAMBDA = 0.98, 0.95  # per control step: the discount looks 10 s ahead
CLIP, RATE, EPOCHS, BATCH, ROLLOUT, ENTROPY = 0.2, 3e-3, 10, 2048, 16384, 0.005


class Agent(nn.Module):
    """Linear Gaussian policy with a deviation that does not depend on the observation, and a critic."""

    def __init__(self, n_observations, n_actions):
        super().__init__()
        self.actor = nn.Linear(n_observations, n_actions)
        self.critic = nn.Sequential(nn.Linear(n_observations, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(),
                                    nn.Linear(64, 1))  # fmt: skip
        self.log_std = nn.Parameter(torch.full((n_actions,), -1.5))
        nn.init.orthogonal_(self.actor.weight, 0.01)  # near zero actions
        nn.init.zeros_(self.actor.bias)

    def distribution(self, observation):
        return torch.distributions.Normal(self.actor(observation), self.log_std.exp())

    def value(self, observation):
        return self.critic(observation).squeeze(-1)


def main():
    """Train, and write the policy and its learning curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="wt_gym/LoadReduction-v3", help="id (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=2_100_000, help="of all turbines (default: %(default)s)")
    parser.add_argument("--turbines", type=int, default=16, help="side by side (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/single_file"), help="folder (default: %(default)s)")
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(1)  # small networks

    envs = gym.make_vec(arguments.env, arguments.turbines, autoreset_mode=AutoresetMode.SAME_STEP)
    n_envs, n_steps = arguments.turbines, max(min(ROLLOUT, arguments.steps) // arguments.turbines, 1)
    low, high = envs.single_action_space.low, envs.single_action_space.high
    agent = Agent(envs.single_observation_space.shape[0], len(low))
    optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)

    observations = torch.zeros(n_steps, n_envs, envs.single_observation_space.shape[0])
    actions = torch.zeros(n_steps, n_envs, len(low))
    log_probs, rewards, dones, values = (torch.zeros(n_steps, n_envs) for _ in range(4))
    observation = torch.as_tensor(envs.reset(seed=arguments.seed)[0])
    returns, episodes, steps, start = np.zeros(n_envs), [], 0, time.monotonic()
    while steps < arguments.steps:
        # one rollout under the current policy
        for k in range(n_steps):
            with torch.no_grad():
                distribution = agent.distribution(observation)
                action = distribution.sample()
                observations[k], actions[k], values[k] = observation, action, agent.value(observation)
                log_probs[k] = distribution.log_prob(action).sum(-1)
            following, reward, terminated, truncated, infos = envs.step(np.clip(action.numpy(), low, high))
            steps += n_envs
            returns += reward
            rewards[k], dones[k] = torch.as_tensor(reward), torch.as_tensor(terminated | truncated)
            for i in np.flatnonzero(terminated | truncated):
                episodes.append((steps, returns[i]))
                returns[i] = 0.0
                if truncated[i] and not terminated[i]:  # the critic says what was still to come
                    with torch.no_grad():
                        rewards[k, i] += GAMMA * agent.value(torch.as_tensor(infos["final_obs"][i]))
            observation = torch.as_tensor(following)

        # generalized advantage estimation, backwards in time
        advantages, advantage = torch.zeros_like(rewards), torch.zeros(n_envs)
        with torch.no_grad():
            following_value = agent.value(observation)
        for k in reversed(range(n_steps)):
            delta = rewards[k] + GAMMA * following_value * (1.0 - dones[k]) - values[k]
            advantages[k] = advantage = delta + GAMMA * LAMBDA * (1.0 - dones[k]) * advantage
            following_value = values[k]
        data = [x.flatten(0, 1) for x in (observations, actions, log_probs, advantages, advantages + values)]

        # several passes over the rollout in small batches, with a falling learning rate
        optimizer.param_groups[0]["lr"] = RATE * max(1.0 - (steps - n_steps * n_envs) / arguments.steps, 0.0)
        for _ in range(EPOCHS):
            for batch in torch.randperm(n_steps * n_envs).split(BATCH):
                seen, acted, old_log_prob, gain, target = (x[batch] for x in data)
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                distribution = agent.distribution(seen)
                ratio = (distribution.log_prob(acted).sum(-1) - old_log_prob).exp()
                actor_loss = -torch.min(ratio * gain, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * gain).mean()
                loss = actor_loss + 0.5 * (agent.value(seen) - target).square().mean()
                loss = loss - ENTROPY * distribution.entropy().sum(-1).mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        last = np.mean([r for _, r in episodes[-40:]]) if episodes else np.nan
        print(f"{steps} steps, {steps / (time.monotonic() - start):.0f}/s, return of the last 40 episodes {last:+.2f}")
    envs.close()

    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.save(agent.state_dict(), arguments.out / "policy.pt")
    if episodes:
        plt.plot(*zip(*episodes, strict=True), ".")
    plt.gca().set(xlabel="steps", ylabel="return of an episode against the base controller")
    plt.savefig(arguments.out / "curve.png")


if __name__ == "__main__":
    main()
