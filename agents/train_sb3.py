"""Train PPO of stable-baselines3 on a wind turbine, and draw its learning curve.

    python agents/train_sb3.py                      # about ten minutes on two cores
    python agents/train_sb3.py --steps 400000

The turbine runs under its base controller; the policy adds three offsets to the pitch of the blades (mean, tilt, yaw).
The reward of the task is relative to zero actions in the same wind: a return above 0 is better than the base controller
alone. Writes model.zip, model.json (arguments of the environment) and curve.png; evaluate_sb3.py tests the model.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from wt_gym.learning.environments import TurbineVecEnv

ENV_ID = "wt_gym/LoadReduction-v3"
ENV_KWARGS = {"wind_speed": [14.0, 18.0], "controller": "discon+side_side_damper", "control_dt": 0.2}


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


def draw(episodes, path, window=24):
    """Learning curve: return of each episode and its moving mean."""
    steps, returns = np.array(episodes).T
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.plot(steps, returns, ".", alpha=0.3, label="episodes")
    window = min(window, len(returns))
    axes.plot(steps[window - 1 :], np.convolve(returns, np.ones(window) / window, "valid"), label=f"mean of {window}")
    axes.axhline(0.0, color="black", linewidth=0.8, label="zero actions")
    axes.set(xlabel="steps", ylabel="return against the base controller")
    axes.legend()
    figure.savefig(path, dpi=120)


def main():
    """Train, and write the model and its learning curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=100_000, help="of all turbines (default: %(default)s)")
    parser.add_argument("--turbines", type=int, default=8, help="side by side (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"), help="folder (default: %(default)s)")
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # small networks
    monitor = Returns(TurbineVecEnv(ENV_ID, arguments.turbines, **ENV_KWARGS))
    envs = VecNormalize(monitor, norm_obs=False, gamma=0.98)  # rewards of scale 1; observations have it already
    model = PPO(
        "MlpPolicy", envs, n_steps=min(2048, arguments.steps) // arguments.turbines, batch_size=256, n_epochs=6,
        learning_rate=4e-4, gamma=0.98, gae_lambda=0.95, policy_kwargs={"log_std_init": -0.9}, seed=arguments.seed,
        device="cpu", verbose=1,
    )  # fmt: skip
    model.learn(arguments.steps)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model.save(arguments.out / "model.zip")
    choices = {"algo": "PPO", "env_kwargs": {"controller": ENV_KWARGS["controller"]}}
    (arguments.out / "model.json").write_text(json.dumps(choices))
    if monitor.episodes:
        draw(monitor.episodes, arguments.out / "curve.png")


if __name__ == "__main__":
    main()
