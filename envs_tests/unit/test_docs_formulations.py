"""Every file and every name on the page about the formulations exists where the page says."""

import ast
import re
from pathlib import Path

import pytest

from validation.case import load_cases
from wt_gym.multibody.system import WORK_FIELDS
from wt_gym.simulation import FIDELITIES

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "formulations.md").read_text(encoding="utf-8")
SPANS = sorted({" ".join(span.split()) for span in re.findall(r"`([^`]+)`", PAGE)})
ROOMS = [ROOT / "wt_gym", ROOT / "validation"]
SOURCES = {path: path.read_text(encoding="utf-8") for room in ROOMS for path in sorted(room.rglob("*.py"))}
ALL = "\n".join(SOURCES.values())
TREES = {path: ast.parse(text) for path, text in SOURCES.items()}


def names_of(tree):
    """Functions, classes and assigned names at the top of a module or in a class."""
    found = set()
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


MODULES = {path.stem: names_of(tree) for path, tree in TREES.items()}
CLASSES = {node.name: names_of(node) for tree in TREES.values() for node in tree.body if isinstance(node, ast.ClassDef)}
DEFINED = set().union(*MODULES.values(), *CLASSES.values())


def missing(span):
    """Parts of a code span that are nowhere."""
    if span.startswith("scripts/"):
        script, *words = span.split()
        return [] if (ROOT / script).exists() and set(words[1:]) <= set(load_cases()) else [span]
    if re.fullmatch(r"[\w/]+\.(py|json)", span):
        return [] if any(p.as_posix().endswith(f"/{span}") for room in ROOMS for p in room.rglob("*.*")) else [span]
    if re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", span):
        return [] if span in load_cases() or span in FIDELITIES else [span]
    head = re.match(r"(\w+)(?:\.(\w+))?", span)
    if head is None or span.startswith('"'):
        return [] if span.strip('"') in FIDELITIES else [span]
    owner, member = head.groups()
    if member:
        place = CLASSES.get(owner) or MODULES.get(owner) or (WORK_FIELDS.split() if owner == "work" else ())
        out = [] if member in place else [f"{owner}.{member}"]
    else:
        known = owner in DEFINED or re.search(rf"\b{owner}\b", ALL)
        out = [] if known else [owner]
    # the options and their values in brackets
    out += [word for word in re.findall(r"(\w+)=", span) if not re.search(rf"\b{word}\b\s*[:=]", ALL)]
    return out + [word for word in re.findall(r'"([^"]+)"', span) if f'"{word}"' not in ALL]


@pytest.mark.parametrize("span", SPANS)
def test_what_the_page_names_exists(span):
    assert not missing(span)


def test_the_page_is_read_at_all():
    assert len(SPANS) > 50
    assert missing("multibody/nowhere.py")
    assert missing("tree_kernels.nowhere")
    assert missing("no-such-case")
    assert missing('body_from_beam(…, coordinates="nowhere")')
