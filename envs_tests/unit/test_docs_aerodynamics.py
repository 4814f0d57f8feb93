"""Every file, name, option and case on the page about the aerodynamics exists."""

import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest

from validation.case import load_cases
from wt_gym.aerodynamics import AeroOptions

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "aerodynamics.md").read_text(encoding="utf-8")
SPANS = sorted(set(re.findall(r"`([^`]+)`", PAGE)))
FILES = [
    *sorted((ROOT / "wt_gym" / "aerodynamics").rglob("*.py")),
    ROOT / "wt_gym" / "simulation" / "model" / "blade_lattice.py",
    ROOT / "wt_gym" / "simulation" / "step" / "coupled_step_kernels.py",
    ROOT / "wt_gym" / "simulation" / "step" / "coupling_kernels.py",
    ROOT / "wt_gym" / "simulation" / "fidelity.py",
    ROOT / "wt_gym" / "turbines" / "model.py",
    ROOT / "wt_gym" / "turbines" / "rotational_augmentation.py",
]
DEFAULTS = {field.name: field.default for field in fields(AeroOptions)}


def defined():
    """Names of functions, classes, their members and constants, by the file that defines them."""
    names = {}
    for path in FILES:
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        found = {node.name for node in nodes if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            found |= {target.id for target in targets if isinstance(target, ast.Name)}
        names[path.name] = found
    return names


NAMES = defined()
EVERY = set().union(*NAMES.values())


def exists(span):
    """Whether a code span names a file, a case, an option with its value, or something that is defined."""
    if "/" in span:
        return (ROOT / span.split()[0]).exists() or (ROOT / "wt_gym" / span).exists()
    if span.endswith(".py"):
        return span in NAMES
    if re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", span):
        return span in load_cases()
    if "=" in span:
        name, value = span.split("=")
        return name in DEFAULTS and bool(AeroOptions(**{name: ast.literal_eval(value)}))
    if "." in span:
        owner, member = span.split(".")
        return member in NAMES.get(f"{owner}.py", EVERY if owner in EVERY else ())
    return span in EVERY or span in load_cases()


@pytest.mark.parametrize("span", SPANS)
def test_what_the_page_names_exists(span):
    assert exists(span)


def test_names_stand_in_the_file_before_them():
    """Two code spans side by side, or after a comma, in a cell: the file and what is in it."""
    pairs = re.findall(r"`(\w+\.py)` `(\w+)`", PAGE)
    assert len(pairs) > 10
    assert all(name in NAMES[file] for file, name in pairs)


def test_values_on_the_page_are_the_defaults():
    assert DEFAULTS["shed_fraction"] == 0.25
    assert DEFAULTS["core_strain"]
    assert DEFAULTS["curved_filaments"]
    assert DEFAULTS["load_form"] == "joukowski"


def test_the_page_is_read_at_all():
    assert len(SPANS) > 70
    for nonsense in (
        "nowhere.py",
        "no-such-case",
        "wake_kernels.nowhere",
        'load_forms="joukowski"',
        "nowhere",
        "no/where.py",
    ):
        assert not exists(nonsense)
