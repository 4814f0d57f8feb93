"""Identity of code: what counts, found by imports, and what does not."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import wt_gym
from wt_gym.base.sources import code_of, source_files, sources_digest
from wt_gym.benchmark.fingerprint import _EPISODE

ROOT = Path(wt_gym.__file__).parents[1]
FIRST = """
from wt_gym.control import Law
from wt_gym import base
def step():
    import wt_gym.late
if TYPE_CHECKING:
    from wt_gym.control.page import Page
else:
    from wt_gym.other import Page
"""


@pytest.fixture(scope="module")
def episode():
    return source_files(*_EPISODE)


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A small package in which ``wt_gym.envs.first`` is what runs."""
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path / "cache"))
    package = tmp_path / "wt_gym"
    files = {
        "__init__.py": "__version__ = 1\n",
        "envs/__init__.py": "import wt_gym.envs.beside\n",
        "envs/beside.py": "",
        "envs/first.py": FIRST,
        "base.py": 'from pathlib import Path\nFOLDER = Path(__file__).parent / "tables" / "gains.json"\n',
        "tables/gains.json": "1",
        "late.py": "x = 1\n",
        "other.py": "",
        "control/__init__.py": "import importlib\ndef __getattr__(name):\n    return importlib.import_module(name)\n",
        "control/law.py": "",
        "control/page.py": "",
        "commands/__init__.py": "",
    }
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text)
    return package


def digest(package):
    return sources_digest("wt_gym.envs.first", package=package)


def test_imports_are_followed_wherever_they_stand(tree):
    found = source_files("wt_gym.envs.first", package=tree)
    modules = {"base", "late", "other", "control", "control.law", "control.page", "envs.first"}
    assert {name for name in found if "/" not in name} == {f"wt_gym.{name}" for name in modules}
    assert {name for name in found if "/" in name} == {"wt_gym.base/tables/gains.json"}


@pytest.mark.parametrize(
    ("name", "text", "counts"),
    [
        ("late.py", "x = 2\n", True),
        ("late.py", '"""Text."""\n\nx = 1  # why\n', False),
        ("tables/gains.json", "2", True),
        ("control/new.py", "", True),
        ("envs/beside.py", "x = 1\n", False),
        ("__init__.py", "__version__ = 2\n", False),
        ("commands/__init__.py", "x = 1\n", False),
    ],
)
def test_what_changes_the_digest(tree, name, text, counts):
    before = digest(tree)
    assert digest(tree) == before
    (tree / name).write_text(text)
    assert (digest(tree) != before) is counts


def test_line_ends_do_not_count(tree):
    before = digest(tree)
    (tree / "late.py").write_bytes(b"x = 1\r\n")
    assert digest(tree) == before


def test_digests_are_the_same_without_a_cache_and_with_a_damaged_one(tree, monkeypatch, caplog):
    before = digest(tree)
    (stored,) = (tree.parent / "cache").glob("sources-*.json")
    stored.write_text("{")
    assert digest(tree) == before
    assert "unreadable" in caplog.text
    (tree.parent / "file").write_text("")
    monkeypatch.setenv("WT_GYM_CACHE", str(tree.parent / "file"))
    assert digest(tree) == before


def test_an_episode_loads_the_control_loop_and_the_agents(episode):
    names = (
        "envs.operation", "envs.terminations", "envs.faults", "envs.fatigue", "agents.training.policy_arrays",
        "agents.constant", "control.residual", "control.controllers.linear_optimal", "wind.kaimal", "runs.playing",
        "simulation.step.coupled_step_kernels", "analysis.metrics", "tasks", "turbine_records",
    )  # fmt: skip
    assert episode.keys() >= {f"wt_gym.{name}" for name in names}
    data = {path.name for name, path in episode.items() if "/" in name}
    assert data >= {"tuned.json", "linear_optimal_nrel_5mw.npz", "iea_15mw.json", "relay.c"}


def test_an_episode_loads_nothing_that_only_weighs_or_prints(episode):
    others = (
        "wt_gym.commands", "wt_gym.analysis.report", "wt_gym.analysis.statistics", "wt_gym.analysis.lifetime",
        "wt_gym.benchmark.scoring", "wt_gym.benchmark.table", "wt_gym.envs.rendering", "wt_gym.turbines.openfast_blade",
        "wt_gym.runs.executors", "wt_gym.learning.training.budgets", "wt_gym.experiment.comparison",
    )  # fmt: skip
    assert not [name for name in episode if name.startswith(others)]
    assert not [path for path in episode.values() if "benchmark/data" in path.as_posix()]


CHANGES = {
    "wt_gym/envs/operation.py": ("residual.acting(wanted,", "residual.acting(2.0 * wanted,"),
    "wt_gym/envs/terminations.py": ("reward - self.penalty", "reward + self.penalty"),
    "wt_gym/envs/faults.py": ("own.uniform()", "own.uniform(0.5)"),
    "wt_gym/experiment/policy_arrays.py": ("np.tanh", "np.sin"),
}


def test_a_change_of_the_control_loop_is_another_code(tmp_path):
    for folder in ("wt_gym", "agents"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "*.zip"))
    package = tmp_path / "wt_gym"
    digests = [sources_digest(*_EPISODE, package=package)]
    assert digests[0] == sources_digest(*_EPISODE)
    for name, (old, new) in CHANGES.items():
        path = tmp_path / name
        code = path.read_text(encoding="utf-8")
        path.write_text(f"# A comment.\n{code}", encoding="utf-8")
        assert sources_digest(*_EPISODE, package=package) == digests[-1]
        assert old in code
        path.write_text(code.replace(old, new), encoding="utf-8")
        digests.append(sources_digest(*_EPISODE, package=package))
    assert len(set(digests)) == len(digests)


def test_comments_and_docstrings_are_no_code():
    source = '"""Text."""\nimport math  # why\n\n\ndef f(x):\n    """More."""\n    return "kept" + x\n'
    other = '"""Other."""\nimport math\ndef f(x):\n    # new\n    return "kept" + x\n'
    assert code_of(source) == code_of(other)
    assert '"kept"' in code_of(source)
    assert code_of(source) != code_of(source.replace("+ x", "- x"))
    nested = "if a:\n    b = 1\n    c = 2\n"
    assert code_of(nested) != code_of("if a:\n    b = 1\nc = 2\n")


LOADED = """
import sys
import gymnasium, wt_gym
env = gymnasium.make("wt_gym/NREL5MW-Steady-v1", wind_speed=12.0)
env.reset(seed=0)
env.step(env.action_space.sample())
print(*(name for name in sys.modules if name.partition(".")[0] == "wt_gym"))
"""


@pytest.mark.slow
def test_all_that_an_episode_has_loaded_counts():
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, timeout=300, check=True)
    counted = source_files("wt_gym.envs.turbine_env").keys()
    apart = source_files("wt_gym.turbines.catalogue").keys() | {
        f"wt_gym.envs.{name}" for name in ("safety_filter", "vector_env", "vector_reward")
    }  # the turbine counts by its values; the package holds wrappers and vectors beside the environment
    packages = {name for name, path in source_files(*done.stdout.split()).items() if path.name == "__init__.py"}
    assert set(done.stdout.split()) - counted - apart - packages == {"wt_gym.tasks"}


def test_formatted_strings_are_the_same_code_to_every_python():
    """Tokens of Python 3.12 have a single brace for a doubled one, those of earlier versions the whole string."""
    assert code_of('f"{{a}} {b:{c}}"\nx = f"{{a}} {b:{c}}"\n').endswith('x=f"{{a}}{b:{c}}"\n')
