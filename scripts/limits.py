#!/usr/bin/env python3
"""Check the size of the project against the limits in pyproject.toml, [tool.wt_gym.limits].

    scripts/limits.py          # prints each figure with its limit; exit code 1 where one is over

The limits only go down: a change that needs more raises one in a line of its own, with the reason.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = """
import sys, gymnasium
import wt_gym
gymnasium.make("wt_gym/LoadReduction-v3", disable_env_checker=True)
print(sum(name.partition(".")[0] == "wt_gym" for name in sys.modules))
"""


def lines(*folders: str) -> tuple[int, int]:
    """Lines and number of the Python files in some folders."""
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    return sum(path.read_text(encoding="utf-8").count("\n") for path in files), len(files)


def figures() -> dict[str, int]:
    """Figures by the name of their limit."""
    from wt_gym.envs.options import env_arguments

    loaded = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True)
    product, files = lines("wt_gym", "agents")
    return {
        "python_lines": lines("wt_gym", "agents", "envs_tests", "scripts", "docs")[0],
        "product_lines": product,
        "product_files": files,
        "test_lines": lines("envs_tests")[0],
        "turbine_env_lines": (ROOT / "wt_gym" / "envs" / "turbine_env.py").read_text(encoding="utf-8").count("\n"),
        "modules_of_gym_make": int(loaded.stdout),
        "names_of_environment_options": len(env_arguments()),
    }


def main() -> None:
    """Check."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        limits = tomllib.load(file)["tool"]["wt_gym"]["limits"]
    values, over = figures(), []
    for name, value in values.items():
        print(f"{name}: {value} (limit {limits[name]})")
        if value > limits[name]:
            over.append(name)
    if over:
        sys.exit(f"error: over the limit: {', '.join(over)}; make room, or raise it in pyproject.toml with the reason")


if __name__ == "__main__":
    main()
