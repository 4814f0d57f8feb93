#!/usr/bin/env python3
"""The pictures of the tasks on the page docs/tasks/index.md: each turbine in its wind under its base controller.

scripts/task_pictures.py             # docs/data/task_NAME.png, all tasks
scripts/task_pictures.py Yaw Gusts   # those of some
"""

import argparse
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
SECONDS, SEED, WIDTH, COLORS = 20.0, 0, 640, 48


def picture(task):
    """What `render` shows after some seconds of zero actions, as an image of few colors."""
    import gymnasium as gym
    import numpy as np
    from PIL import Image

    import wt_gym

    assert wt_gym.__version__  # its import registers the ids
    env = gym.make(task.id, render_mode="rgb_array", start="steady")
    env.reset(seed=SEED)
    rest = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(round(SECONDS / env.unwrapped.control_dt)):
        env.step(rest)
    image = Image.fromarray(env.render())
    image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    return image.quantize(COLORS)


def main(words=None):
    """Make the pictures."""
    from wt_gym.tasks import TASKS

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"among {', '.join(TASKS)} (default: all)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "data", help="folder (default: %(default)s)")
    arguments = parser.parse_args(words)
    if unknown := set(arguments.tasks) - set(TASKS):
        parser.error(f"tasks must be among {', '.join(TASKS)}, got {', '.join(sorted(unknown))}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.tasks or TASKS:
        path = arguments.out / f"task_{name}.png"
        picture(TASKS[name]).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
