"""Who knows whom: imports of modules have no circle, and no arrow between rooms runs back."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parents[2]

BASE = frozenset({"base", "tasks", "turbine_records"})
"""Modules beside the rooms, which any room may use and which use none."""

KNOWS = {
    "hydrodynamics": set(),
    "turbines": {"hydrodynamics"},
    "wind": set(),
    "structure": {"turbines"},
    "multibody": {"structure"},
    "aerodynamics": set(),
    "simulation": {"turbines", "hydrodynamics", "wind", "structure", "multibody", "aerodynamics"},
    "control": {"turbines", "wind", "simulation"},
    "bridges": {"turbines", "hydrodynamics", "wind", "simulation", "control"},
    "analysis": {"turbines", "wind", "simulation", "control"},
    "envs": {"turbines", "hydrodynamics", "wind", "simulation", "control", "bridges", "analysis"},
    "experiment": {"turbines", "wind", "simulation", "control", "bridges", "analysis", "envs"},
    "deployment": {
        "turbines", "wind", "simulation", "control", "bridges", "analysis", "envs", "experiment",
    },
    "learning": {
        "turbines", "wind", "simulation", "control", "bridges", "analysis", "envs", "experiment",
        "deployment", "hydrodynamics",
    },
    "commands": {
        "turbines", "hydrodynamics", "wind", "multibody", "simulation", "control", "bridges", "analysis", "envs",
        "experiment", "deployment", "learning",
    },
    "__main__": {"commands"},
}  # fmt: skip
"""Rooms that each room may use, beside `BASE` and the version in ``wt_gym`` itself."""

TWO_WAYS_TO_COMPILE = {"wt_gym.base.compiled", "wt_gym.base.kernel_linking", "wt_gym.base.kernel_self_test"}
"""The one circle that stays: `compiled` chooses between plain numba and linking, which stands on numba's inside and is
imported only after a self-test is wanted; it uses the options and the stamp of `compiled`."""


def modules():
    """Path of every module by its name."""
    found = {}
    for path in sorted((ROOT / "wt_gym").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(source, known):
    """Modules that a source imports: at its top, within functions and for the types alone.

    All three count. An import within a function is one all the same, and one under ``TYPE_CHECKING`` says that a reader
    of this module has to know the other. What does not count is that Python runs the packages above a module first.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports name the whole module"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name:
                yield name, node.lineno


class _WithoutTypes(ast.NodeTransformer):
    """Removes what stands under ``TYPE_CHECKING``."""

    def visit_If(self, node):
        is_for_types = isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        return None if is_for_types else self.generic_visit(node)


@pytest.fixture(scope="module")
def graph():
    """Imports that run: a term and the operation that it equips name each other's types."""
    known = modules()
    sources = {
        name: ast.unparse(_WithoutTypes().visit(ast.parse(path.read_text(encoding="utf-8"))))
        for name, path in known.items()
    }
    return {name: {target for target, _ in imports(source, known)} - {name} for name, source in sources.items()}


def circles(graph):
    """Strongly connected components of more than one node."""
    names = sorted(graph)
    matrix = [[target in graph[name] for target in names] for name in names]
    _, labels = connected_components(csr_array(matrix), connection="strong")
    groups = [{name for name, label in zip(names, labels, strict=True) if label == one} for one in set(labels)]
    return [group for group in groups if len(group) > 1]


def test_circles_imports_and_private_names_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [{"a", "b", "c"}]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
    ours = "import os\nfrom wt_gym.base.files import (\n    _a,\n    b,\n)\nfrom wt_gym import __version__\n"
    assert list(private_names(ours)) == [("_a", 2)]
    source = "import a.b\nfrom a import c\nif TYPE_CHECKING:\n    from a.d import X\ndef f():\n    from a.e import g\n"
    assert [name for name, _ in imports(source, {"a", "a.b", "a.c", "a.d", "a.e"})] == ["a.b", "a.c", "a.d", "a.e"]


FIRST = """
import importlib, sys
for name in sys.argv[1:]:
    for known in [known for known in sys.modules if known.partition(".")[0] == "wt_gym"]:
        del sys.modules[known]
    importlib.import_module(name)
"""


def test_every_package_can_be_imported_first():
    """Users import what they need, in whatever order."""
    rooms = sorted(name for name, path in modules().items() if path.name == "__init__.py")
    assert "wt_gym.control.bladed" in rooms
    done = subprocess.run([sys.executable, "-c", FIRST, *rooms], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_the_package_alone_is_light():
    heavy = ("numba", "scipy", "xarray", "torch", "matplotlib", "plotly")
    code = f"import sys, wt_gym; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"


def test_no_circle(graph):
    assert len(graph) > 150
    assert circles(graph) == [TWO_WAYS_TO_COMPILE]


def private_names(source):
    """Names that begin with one underscore and that a source takes from modules of this package, with their lines."""
    ours = ("wt_gym", "envs_tests")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ours:
            for alias in node.names:
                if alias.name.startswith("_") and not alias.name.startswith("__"):
                    yield alias.name, node.lineno


def test_private_names_stay_in_their_modules():
    """Names with an underscore may change without a look at other modules."""
    paths = [
        *modules().values(),
        *(path for name in ("scripts", "envs_tests/physics/cases") for path in (ROOT / name).rglob("*.py")),
    ]
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in paths
        for name, line in private_names(path.read_text(encoding="utf-8"))
    ]
    assert not wrong, "\n".join(wrong)


def test_no_arrow_between_rooms_runs_back():
    known, wrong = modules(), []
    for name, path in known.items():
        if name == "wt_gym":
            continue
        room = name.split(".")[1]
        allowed = BASE if room in BASE else BASE | KNOWS[room] | {room}
        for target, line in imports(path.read_text(encoding="utf-8"), known):
            if target != "wt_gym" and target.split(".")[1] not in allowed:
                wrong.append(f"{name}:{line} uses {target}")
    assert not wrong, "\n".join(wrong)
    for room, below in KNOWS.items():
        assert all(room not in KNOWS[other] for other in below)
