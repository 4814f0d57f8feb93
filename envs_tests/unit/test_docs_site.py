"""The site builds, warnings being errors, and what is made from the code is on its pages."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from html import unescape
from importlib import import_module
from pathlib import Path

import first_agent
import gymnasium as gym
import pytest
from filelock import FileLock

import wt_gym
from envs_tests.physics.validation import Case, CaseResult, Check, read_record, source_commit, update_record
from wt_gym.commands import COMMANDS
from wt_gym.control.controllers import ADDITIONS, BASES, GUARDS, WRAPPERS, declared_parameters
from wt_gym.simulation import FIDELITIES, channel_table

ROOT = Path(__file__).resolve().parents[2]
MODULES = ("sphinx", "furo", "myst_nb", "ipykernel", "sphinx_design", "sphinx_copybutton")
MISSING = [name for name in MODULES if importlib.util.find_spec(name) is None]
RECORD = ROOT / "docs" / "data" / "validation.json"
_TUTORIALS = (ROOT / "docs" / "tutorials").glob("*.md")
NOTEBOOKS = sorted(path for path in _TUTORIALS if "file_format: mystnb" in path.read_text(encoding="utf-8")[:40])
needs_docs = pytest.mark.skipif(
    bool(MISSING), reason=f"{', '.join(MISSING)} not installed: pip install 'wt_gym[docs]', or run scripts/test"
)


def build(folder, *options):
    """Build the site as scripts/docs does; the folder with its pages."""
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", *options]
    done = subprocess.run(
        [*command, "-d", folder / "doctrees", "docs", folder / "site"],
        cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    return folder / "site"


@pytest.fixture(scope="module")
def site(tmp_path_factory, worker_id):
    """The site without running its notebooks, built once for all test processes."""
    own = tmp_path_factory.getbasetemp()
    folder = (own if worker_id == "master" else own.parent) / "docs"
    with FileLock(f"{folder}.lock"):
        if not (folder / "built").exists():
            build(folder, "-D", "nb_execution_mode=off")
            (folder / "built").touch()
    return folder / "site"


def text_of(page):
    """What a page says, without tags."""
    return re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8"))


@needs_docs
class TestSite:
    def test_pages_are_there(self, site):
        for page in (ROOT / "docs").rglob("*.md"):
            assert (site / page.relative_to(ROOT / "docs").with_suffix(".html")).stat().st_size > 5000, page.name
        assert wt_gym.__version__ in (site / "index.html").read_text(encoding="utf-8")

    def test_the_reference_is_that_of_the_code(self, site):
        channels, ids = text_of(site / "reference" / "channels.html"), text_of(site / "reference" / "ids.html")
        assert all(channel.group in channels for channel in channel_table(3))
        assert all(name in ids for name in gym.registry if name.startswith("wt_gym/"))
        options = text_of(site / "reference" / "options.html")
        parameters = unescape(text_of(site / "baselines.html"))
        for name in (*BASES, *WRAPPERS, *ADDITIONS, *GUARDS):
            assert all(parameter.name in parameters for parameter in declared_parameters(name)), name
        assert all(name in options for name in (*FIDELITIES, "max_substep", "wake_rows", "tower_side_side_fatigue"))
        commands = text_of(site / "reference" / "cli.html")
        assert all(name in commands for name in (*COMMANDS, "--max-seconds", "--record"))
        assert "overspeed_limit" in text_of(site / "reference" / "environment.html")

    def test_public_modules_are_documented_whole(self, site):
        for page in (ROOT / "docs" / "reference" / "api").glob("*.md"):
            html = (site / "reference" / "api" / f"{page.stem}.html").read_text(encoding="utf-8")
            modules = re.findall(r"automodule:: (\S+)", page.read_text(encoding="utf-8"))
            for module in set(modules):
                public = import_module(module)
                made = [name for name, value in vars(public).items() if getattr(value, "__module__", "") == module]
                names = getattr(public, "__all__", [name for name in made if name[0] != "_"])
                constants = re.findall(r'<span class="pre">(\w+)</span>', html)
                assert not [n for n in names if f'id="{module}.{n}"' not in html and n not in constants], module

    def test_record_and_notes_of_every_case_are_on_the_page(self, site):
        text = unescape(text_of(site / "validation_checks.html"))
        said = "".join(text.split())
        cases = read_record(RECORD)
        assert "docs/data/validation.json" in text
        assert "|" in cases["controllers"]["notes"]
        for name, case in cases.items():
            assert name in text
            assert case["date"] in text
            for line in case.get("notes", "").splitlines():
                for cell in line.split("|") if line.startswith("|") else [line]:
                    assert set(cell) <= set("-") or "".join(cell.split()) in said, (name, cell)

    @pytest.mark.skipif(shutil.which("node") is None, reason="no node")
    def test_the_search_has_titles_and_headings_first(self, site):
        answers = {
            "first reset slow": "howto/trouble#the-first-reset-is-slow", "damage equivalent load": "glossary",
            "wave": "howto/floating#waves-and-currents", "yaw": "tasks/yaw", "install": "howto/install",
        }  # fmt: skip
        command = ["node", Path(__file__).with_name("search.js"), site, *answers]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout.split() == [*answers.values()]

    def test_numbers_stay_with_their_units(self, site):
        text = unescape(text_of(site / "evaluation.html"))
        assert "10\N{NO-BREAK SPACE}000 bootstrap" in text
        assert "at 15\N{NO-BREAK SPACE}m/s" in text
        assert "4 at the tower base" in text

    def test_nothing_is_fetched_from_elsewhere(self, site):
        for page in site.rglob("*.html"):
            html = page.read_text(encoding="utf-8")
            fetched = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?://[^"]+)"', html)
            assert not fetched, page


def test_the_ids_are_listed_without_recording_linear_models(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    monkeypatch.setattr("wt_gym.learning.linear_env.cached_model", None)
    assert "LoadReduction-Linear-v0" in import_module("site_parts.environment").ids()


def test_the_results_of_the_first_agent_are_those_of_its_cells():
    """Made again by scripts/studies/first_agent.py where a cell or the version changes."""
    assert json.loads(first_agent.RECORD.read_text(encoding="utf-8")) == first_agent.state()


def test_notebooks_hold_no_outputs():
    assert len(NOTEBOOKS) == 8
    for path in NOTEBOOKS:
        text = path.read_text(encoding="utf-8")
        assert "{code-cell}" in text
        assert "base64" not in text


def test_the_record_of_the_validation_can_be_read():
    found = read_record(RECORD)
    assert len(found) > 30
    for case in found.values():
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\dZ", case["date"])
        assert case["passed"] == all(check["passed"] for check in case["checks"])


def test_a_record_keeps_what_was_not_run_again_and_the_site_shows_its_commits(tmp_path, monkeypatch):
    path = tmp_path / "sub" / "record.json"
    new, old = (Case(name, "a title", "a source", lambda: []) for name in ("new", "old"))
    update_record(
        path, [(old, CaseResult([Check("y", 0.0, 0.0, 0.1)])), (new, CaseResult([Check("x", 1.0, 1.5, 0.1)]))]
    )
    kept = read_record(path)
    update_record(path, [(new, CaseResult([Check("x", 1.0, float("nan"), 0.1)]))], "abc1234+")
    assert list(read_record(path)) == ["new", "old"]
    assert read_record(path)["old"] == kept["old"]
    assert read_record(path)["new"]["checks"][0]["obtained"] == "nan"
    monkeypatch.syspath_prepend(ROOT / "docs")
    site_part = import_module("site_parts.validation_record")
    monkeypatch.setattr(site_part, "RECORD", path)
    for text in (site_part.summary(), site_part.checks()):
        assert text.count("`abc1234+`") == 1
        assert "None" not in text
    path.write_text(json.dumps([1]))
    with pytest.raises(ValueError, match="is not a record"):
        read_record(path)


def git(folder, *arguments):
    """Run git in a folder as somebody."""
    who = ["-c", "user.name=a", "-c", "user.email=a@b.example"]
    return subprocess.run(["git", *who, *arguments], cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_a_record_names_the_commit_of_its_sources(tmp_path, monkeypatch):
    """Changes count, those of the record do not; a folder in somebody's clone is none."""
    record = tmp_path / "record.json"
    git(tmp_path, "init", "-q")
    (tmp_path / "code.py").write_text("a = 1\n")
    git(tmp_path, "add", "code.py")
    git(tmp_path, "commit", "-qm", "first")
    commit = git(tmp_path, "rev-parse", "--short", "HEAD").strip()
    record.write_text("{}")
    assert source_commit(record, tmp_path) == commit
    (tmp_path / "code.py").write_text("a = 2\n")
    assert source_commit(record, tmp_path) == f"{commit}+"
    assert source_commit(tmp_path.parent / "elsewhere.json", tmp_path) == f"{commit}+"
    (tmp_path / "installed").mkdir()
    assert source_commit(record, tmp_path / "installed") is None
    monkeypatch.setenv("PATH", "")
    assert source_commit(record, tmp_path) is None


@pytest.mark.slow
@needs_docs
def test_every_notebook_runs(tmp_path):
    """The whole site as scripts/docs builds it: an exception in a cell is an error of the build."""
    site = build(tmp_path)
    for path in NOTEBOOKS:
        html = (site / "tutorials" / f"{path.stem}.html").read_text(encoding="utf-8")
        assert html.count("cell_output") >= 3, path.stem
        assert "<img" in html, path.stem
