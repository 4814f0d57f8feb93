"""Train PPO of stable-baselines3 on a wind turbine, and draw its learning curve.

    python agents/train_sb3.py --linear 6000000 --steps 0        # on a linear model of the turbine: five minutes
    python agents/train_sb3.py                                   # in the simulator: 35 minutes on two cores
    python agents/train_sb3.py --linear 6000000 --steps 400000   # one after the other
    python agents/train_sb3.py --linear 6000000 --steps 0 --seeds 0 1 2   # curves of three seeds in one figure

The turbine runs under its base controller; the policy adds three offsets to the pitch of the blades (mean, tilt, yaw).
The reward of the task is relative to zero actions in the same wind: a return above 0 is better than the base controller
alone. Six hyperparameters differ from those of the library. The policy is linear: so is the best law known, and a
network of two layers learns it more slowly. Writes model.zip, model.json (its algorithm) and curve.png;
evaluate_sb3.py tests the model. Several seeds have folders seed-N and one curve each, of the last stage.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from wt_gym.learning.environments import TurbineVecEnv

ENV_ID, LINEAR_ID = "wt_gym/LoadReduction-v3", "wt_gym/LoadReduction-Linear-v0"
ROLLOUT = 16384


class Returns(VecMonitor):
    """Monitor that keeps steps and return of every finished episode."""

    def __init__(self, venv):
        super().__init__(venv)
        self.steps, self.episodes = 0, []

    def step_wait(self):
        observations, rewards, dones, infos = super().step_wait()
        self.steps += self.num_envs
        self.episodes += [(self.steps, info["episode"]["r"]) for info in infos if "episode" in info]
        return observations, rewards, dones, infos


def draw(curves, path, window=64):
    """Learning curves: moving mean of the returns of each seed's episodes."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for seed, episodes in curves.items():
        steps, returns = np.array(episodes).T
        width = min(window, len(returns))
        mean = np.convolve(returns, np.ones(width) / width, "valid")
        axes.plot(steps[-len(mean) :] / 1e6, mean, label=f"seed {seed}")
    axes.axhline(0.0, color="black", linewidth=0.8, label="zero actions")
    axes.set(xlabel="million decisions", ylabel="return of an episode against the base controller")
    axes.legend()
    figure.savefig(path, dpi=120)


def learn(env_id, turbines, steps, seed, policy=None):
    """Train for a number of steps, from the policy of another model where there is one."""
    envs = Returns(TurbineVecEnv(env_id, turbines))
    fine = policy is not None  # smaller steps of a policy that is good already
    model = PPO(
        "MlpPolicy", envs, n_steps=max(min(ROLLOUT, steps) // turbines, 2), batch_size=2048, gamma=0.98, ent_coef=0.005,
        learning_rate=lambda left: (5e-4 if fine else 3e-3) * max(left, 0.0),
        policy_kwargs={"net_arch": {"pi": [], "vf": [64, 64]}, "log_std_init": -1.5}, seed=seed, device="cpu",
        verbose=1,
    )  # fmt: skip
    if fine:
        model.policy.load_state_dict(policy.state_dict())
    model.learn(steps)
    return model, envs.episodes


def main():
    """Train, and write the model and its learning curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=2_100_000, help="in the simulator (default: %(default)s)")
    parser.add_argument("--linear", type=int, default=0, metavar="STEPS", help="before that on the linear model")
    parser.add_argument("--turbines", type=int, default=16, help="side by side (default: %(default)s)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="one training each (default: 0)")
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"), help="folder (default: %(default)s)")
    arguments = parser.parse_args()
    if not arguments.linear + arguments.steps:
        parser.error("there must be steps in the simulator, on the linear model or both")
    torch.set_num_threads(1)  # small networks
    stages = ((LINEAR_ID, 64, arguments.linear), (ENV_ID, arguments.turbines, arguments.steps))
    curves = {}
    for seed in arguments.seeds:
        policy = None
        for env_id, turbines, steps in stages:
            if steps:
                model, curves[seed] = learn(env_id, turbines, steps, seed, policy)
                policy = model.policy
        folder = arguments.out if len(arguments.seeds) == 1 else arguments.out / f"seed-{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "model.zip")
        (folder / "model.json").write_text(json.dumps({"algo": "PPO"}))
    draw({seed: episodes for seed, episodes in curves.items() if episodes}, arguments.out / "curve.png")


if __name__ == "__main__":
    main()
