"""What the pages about versions say is so."""

import re
import tomllib
from importlib import import_module
from pathlib import Path

import gymnasium as gym

import wt_gym
from wt_gym.benchmark import load_task, task_names

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "versions.md").read_text(encoding="utf-8")


def test_there_is_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert f"\nversion: {wt_gym.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {wt_gym.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_ids_and_tasks_carry_versions():
    assert all(re.search(r"-v\d+$", name) for name in gym.registry if name.startswith("wt_gym/"))
    assert all(re.search(r"-v\d+$", load_task(name).id) for name in task_names())


def test_the_public_modules_say_what_is_public():
    names = re.findall(r"`(wt_gym\.[a-z.]+)`", PAGE.split("**Public interface.**")[1].split("in `__all__`")[0])
    assert len(names) == 9
    for name in set(names) - {"wt_gym.agents"}:
        assert import_module(name).__all__, name


def test_links_lead_somewhere():
    for page in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/versions.md"):
        folder = (ROOT / page).parent
        for link in re.findall(r"\]\((?!http|#)([^)#]+)", (ROOT / page).read_text(encoding="utf-8")):
            assert (folder / link).exists(), f"{page}: {link}"
