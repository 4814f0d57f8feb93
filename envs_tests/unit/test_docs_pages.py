"""Pages of the documentation: examples run, commands are accepted, names and files that they give exist.

What they say in numbers is that of the code and of the records: one table of statements. The site itself, and figures
that are computed anew, stand in the other files ``test_docs_*``.
"""

import doctest
import json
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import pytest
import transfer
from study_pages import filled

import wt_gym
from envs_tests.physics.validation import load_cases
from wt_gym.aerodynamics import AeroOptions
from wt_gym.analysis.results import METRICS_FILE, RUNS_FOLDER, TABLE_FILE, run_file
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, N_RESAMPLES
from wt_gym.commands import COMMANDS, loadcases, module_of, parse
from wt_gym.commands.train import configuration
from wt_gym.control.controllers import CONTROLLERS, make_controller
from wt_gym.control.controllers import controller as contract
from wt_gym.experiment.benchmark_tasks import load_task, task_names
from wt_gym.experiment.evaluation import CONFIGURATION_FILE, DEFAULT_WIND_SEEDS, REPORT_FILE, EvaluationConfig
from wt_gym.experiment.loadcase_runs import LoadCaseConfig
from wt_gym.experiment.loadcases import CASES, plan_of
from wt_gym.experiment.names import read_name
from wt_gym.experiment.run import run_controller
from wt_gym.experiment.store import SWEEP_FILE, digest
from wt_gym.learning.callbacks import SELECTION_WIND_SEEDS
from wt_gym.learning.hyperparameters import ALGORITHMS, read_hyperparameters
from wt_gym.learning.options import TrainingConfig
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

ROOT = Path(__file__).resolve().parents[2]
# pages in docs/ with their number of examples, at least
EXAMPLES = {"ray": 6, "training": 6, "baselines": 1, "evaluation": 11, "loadcases": 5}


@cache
def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


TRAINING, YAML = re.findall(r"```yaml\n(.*?)```", text_of("docs/training.md"), re.DOTALL)


PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "agents" / "README.md",
    ROOT / "agents" / "trained" / "README.md",
]
PAGES += sorted((ROOT / "docs").rglob("*.md"))
ROOMS_WITH_NAMES = ("wt_gym", "agents", "envs_tests", "docs", "scripts")
READ = {
    *PAGES, ROOT / "pyproject.toml", *(ROOT / ".ci").iterdir(), *(ROOT / "scripts").glob("*"),
    *(path for room in ROOMS_WITH_NAMES for path in (ROOT / room).rglob("*.py")), *(ROOT / "agents").rglob("*.yml"),
}  # fmt: skip
"""What names commands and scripts; what is said of earlier versions may name other ones."""
CALL = re.compile(r"^ *(?:\S*/bin/)?wt-gym ([a-z][a-z-]*)((?: (?:[^#\n\\]|\\\n)*)?)", re.MULTILINE)


def commands():
    """Lines that call a command: name and arguments."""
    docstrings = [module_of(name).__doc__ for name in COMMANDS]
    texts = [page.read_text(encoding="utf-8") for page in PAGES] + docstrings
    found = {(name, " ".join(words.replace("\\\n", " ").split())) for t in texts for name, words in CALL.findall(t)}
    return sorted(found)


CALLS = commands()


def wrong_names(text):
    """Commands and scripts in a text that do not exist."""
    commands = re.findall(r"(?:`|^ *|/bin/)wt-gym ([a-z][a-z-]*)", text, re.MULTILINE)
    scripts = re.findall(r"(?<![\w/])scripts/((?:\w+/)*\w+(?:\.\w+)?)", text)
    return sorted({*commands} - {*COMMANDS}) + [name for name in scripts if not (ROOT / "scripts" / name).exists()]


def test_commands_and_scripts_that_are_named_exist():
    texts = {path: path.read_text(encoding="utf-8") for path in READ if path.is_file()}
    assert sum("wt-gym " in text for text in texts.values()) > 40
    assert sum("scripts/" in text for text in texts.values()) > 40
    assert {path: names for path, text in texts.items() if (names := wrong_names(text))} == {}


@pytest.mark.parametrize("page", EXAMPLES)
def test_examples_run(page):
    path = str(ROOT / "docs" / f"{page}.md")
    result = doctest.testfile(path, module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted >= EXAMPLES[page]
    assert result.failed == 0


def test_examples_of_the_contract_of_controllers_run():
    assert doctest.testmod(contract).failed == 0


@pytest.mark.parametrize(("name", "words"), CALLS)
def test_commands_are_accepted(name, words, tmp_path):
    """With the controllers and the training that they name."""
    file = tmp_path / "training.yml"
    file.write_text(TRAINING)
    words = words.replace("--config mine.yml", f"--config {file}").replace("agents/", f"{ROOT}/agents/")
    arguments = parse(name, shlex.split(words))
    if isinstance(getattr(arguments, "env", None), str):
        assert arguments.env in gym.registry
    if name in ("evaluate", "loadcases"):
        for agent in arguments.agents:
            choice = agent.split("=", 1)[1] if "=" in agent and ":" not in agent.split("=")[0] else agent
            if re.search("^bladed:|file=|/|[.]py:|[.]zip", choice):  # files, of the reader too
                continue
            if (agent := read_name(choice)).kind == "controller":
                make_controller(agent.target, load_turbine("nrel_5mw"), **agent.parameters)
    if name == "loadcases":
        assert loadcases.configuration(arguments).quick == ("--quick" in words)
    if name in ("train", "search") and not getattr(arguments, "resume", None):
        if "hyperparameters" in arguments:
            arguments.hyperparameters = tmp_path / "mine.yml"
            arguments.hyperparameters.write_text(YAML)
        assert configuration(arguments).resolved["learning_rate"]


def test_commands_are_found():
    names = [name for name, _ in CALLS]
    least = {"train": 20, "search": 1, "evaluate": 12, "loadcases": 8, "benchmark": 2}
    assert all(names.count(name) >= least.get(name, 1) for name in COMMANDS), names


def spaced(number):
    return f"{number:,}".replace(",", " ")


SAID = [
    ("README.md", *(f"(docs/{page}.md)" for page in ("ray", "training", "evaluation", "loadcases"))),
    ("docs/baselines.md", *(f"| `{name}` |" for name in CONTROLLERS), "\n<!-- generated: parameters -->\n"),
    (
        "docs/training.md",
        *(f"{name.lower()}.yml`" for name in ALGORITHMS),
        f"`SELECTION_WIND_SEEDS`, {SELECTION_WIND_SEEDS[0]} down to {SELECTION_WIND_SEEDS[-1]}",
        f"`--eval-every` steps ({spaced(TrainingConfig().eval_every)}",
        f"`--checkpoint-steps` ({spaced(TrainingConfig().checkpoint_steps)})",
    ),
    (
        "docs/evaluation.md",
        *(f"| `{name}` |" for name in (CONFIGURATION_FILE, REPORT_FILE, METRICS_FILE, TABLE_FILE, SWEEP_FILE)),
        f"| `{RUNS_FOLDER}/{run_file('HASH', '<agent>').replace('_agent_', '<agent>')}` |",
        f"{spaced(N_RESAMPLES)} bootstrap",
    ),
]


@pytest.mark.parametrize(("page", "words"), [(page, word) for page, *words in SAID for word in words])
def test_the_page_says_what_the_code_does(page, words):
    assert words in text_of(page)


def test_the_file_of_hyperparameters_can_be_read(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text(YAML)
    assert read_hyperparameters(file, "PPO", "wt_gym/FullRange-v3")["n_steps"] == 2048


# ---- what stands on a page and what is so ----------------------------------------------------------------------------

RECORD = json.loads(text_of("docs/data/validation.json"))["cases"]
FAILING = {name for name, case in RECORD.items() if not all(check["passed"] for check in case["checks"])}
STATEMENTS = []


def statement(function):
    """Have a function that returns what stands on a page and what is so checked."""
    STATEMENTS.append(function)
    return function


@pytest.mark.parametrize("function", STATEMENTS, ids=lambda function: function.__name__)
def test_what_stands_on_the_page_is_so(function):
    said, known = function()
    assert known
    assert said == known


def section(page, heading):
    """What stands below a heading, up to the next one."""
    return re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text_of(page), re.MULTILINE | re.DOTALL)[1]


def rows(text):
    """Cells of the rows of the tables in a text, without headings."""
    tables = re.findall(r"^\|[-|]+\|\n((?:\|.*\|\n)+)", text, re.MULTILINE)
    return [[cell.strip() for cell in line[1:-1].split(" | ")] for table in tables for line in table.splitlines()]


def copied(case):
    """Rows of numbers in the notes of a case: what is before the colon, and the numbers after it, as on the pages."""
    notes = RECORD[case]["notes"].replace("generalized", "generalized")  # as cases of before the US spelling wrote it
    lines = [line.rsplit(": ", 1) for line in notes.splitlines()[1:]]
    return [(name, numbers.replace("-", "−").split(", ")) for name, numbers in lines]


@statement
def defaults_of_evaluations():
    return (3, 6, 30.0), (LEAST_PER_STRATUM, len(DEFAULT_WIND_SEEDS), EvaluationConfig().skip)


@statement
def defaults_of_the_lattice():
    options = AeroOptions()
    named = options.shed_fraction, options.core_strain, options.curved_filaments, options.load_form
    return (0.25, True, True, "joukowski"), named


@statement
def load_cases_with_their_factors():
    part = section("docs/loadcases.md", "Cases")
    said = dict(re.findall(r"^\| (\d\.\d) \|(?:[^|]*\|){3} (\d\.\d+) \|", part, re.MULTILINE))
    assert LoadCaseConfig().cases == tuple(CASES)
    return said, {case: f"{kind.factor or 1.0}" for case, kind in CASES.items()}


@statement
def sizes_of_the_sets_of_load_cases():
    turbine, sizes = load_turbine("nrel_5mw"), []
    for quick in (False, True):
        plan = plan_of(turbine, quick)
        conditions = {digest(c.to_json()): c for kind in CASES.values() for c in kind.situations(turbine, plan)}
        minutes = round(sum(condition.duration for condition in conditions.values()) / 60.0)
        sizes += [len(conditions), minutes]
    pattern = r"Full set: (\d+) runs, (\d+) h (\d+) min.*quick set: (\d+) runs, (\d+) min"
    full, hours, minutes, *quick = map(int, re.search(pattern, text_of("docs/loadcases.md"), re.DOTALL).groups())
    return [full, 60 * hours + minutes, *quick], sizes


@statement
def controllers_of_the_record():
    return RECORD["controllers"]["notes"] in text_of("docs/baselines.md"), True


@statement
def winds_that_are_estimated():
    pattern = r"(\d+) m/s: correlation (\S+), rms (\S+) m/s, mean error (\S+) m/s"
    found = re.findall(pattern, RECORD["wind-estimate"]["notes"])
    said = re.findall(r"\| (\d+) m/s \| (0\.\S+) \| (\S+) m/s \| (\S+) m/s \|", text_of("docs/baselines.md"))
    return said, found


@statement
def cases_that_fail_and_why():
    """A case that is not in the record may have failed when the page was written."""
    table = rows(section("docs/aerodynamics_results.md", "Known deviations"))
    named = [name for row in table for name in re.findall(r"`([^`]+)`", row[0])]
    assert len({*named}) == len(named)
    assert all(len(row) == 4 and all(row) for row in table)
    assert {*named} <= {*load_cases()}
    return {name for name in named if name in RECORD}, FAILING


@statement
def coupled_formulations():
    """All but the time of a step, which is another one on each machine."""
    found = [
        row for row in rows(section("docs/formulations.md", "All combinations in the environment")) if len(row) == 7
    ]
    said = [(", ".join(row[:2]), [cell.removesuffix(" %") for cell in row[3:]]) for row in found]
    known = copied("formulations-coupled")  # the name with how it ended, if early
    return said, [(", ".join([n, *x[5:]]), ["–" if y == "nan" else y for y in x[1:5]]) for n, x in known]


@statement
def reduction_study():
    part = text_of("docs/formulations.md").split("(`observer-turbine-reduction`)")[1].split("\n## ")[0]
    return [row[1:6] for row in rows(part)], [numbers[:5] for _, numbers in copied("observer-turbine-reduction")]


@statement
def steady_states_of_the_iea_22mw():
    notes = RECORD["iea22-steady"]["notes"].replace("-", "−").replace("−0.0 %", "0.0 %").replace("+0.0 %", "0.0 %")
    known = rows(notes.replace("−−−", "---"))
    assert len(known) == 10
    return rows(section("docs/validation.md", "Steady states of the IEA 22-MW")), known


@statement
def one_version_everywhere():
    project = tomllib.loads(text_of("pyproject.toml"))
    assert project["project"]["dynamic"] == ["version"]
    said = re.search(r"^version: (\S+)$", text_of("CITATION.cff"), re.MULTILINE)[1]
    return (said, re.search(r"^## ([\d.]+)", text_of("CHANGELOG.md"), re.MULTILINE)[1]), (wt_gym.__version__,) * 2


@statement
def versions_of_ids_and_tasks():
    ids = [name for name in gym.registry if name.startswith("wt_gym/")] + [load_task(name).id for name in task_names()]
    return [name for name in ids if re.search(r"-v\d+$", name)], ids


@statement
def public_modules():
    said = text_of("docs/versions.md").split("**Public interface.**")[1].split("and the modules of")[0]
    names = re.findall(r"`(wt_gym\.[a-z.]+)`", said)
    assert len(names) >= 6
    return {name for name in names if import_module(name).__all__}, {*names}


@statement
def messages_of_refusals():
    sources = "".join(
        p.read_text(encoding="utf-8") for room in ("wt_gym", "agents") for p in (ROOT / room).rglob("*.py")
    )
    messages = re.findall(r"^\| `([^`]+)` \|", text_of("docs/howto/trouble.md"), re.MULTILINE)
    parts = [part.strip() for message in messages for part in message.split("…") if part.strip()]
    return [part for part in parts if part in sources], parts


@statement
def table_of_the_readme():
    text = text_of("README.md")
    return text, filled(text, {"transfer": transfer.table})


@statement
def tables_of_the_crosscheck():
    text = text_of("docs/crosscheck.md")
    return text, filled(text, {"transfer": transfer.table, "loads": transfer.loads})


def test_nothing_imports_ray_that_does_not_ask_for_it():
    program = (
        "import sys, wt_gym.learning.train, wt_gym.experiment.evaluation, wt_gym.experiment.execute, "
        "wt_gym.learning.search, wt_gym.experiment.benchmark; sys.exit('ray' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0


# ---- what can be run at once -----------------------------------------------------------------------------------------

FIRST = ("README.md", "docs/quickstart.md")
BLOCKS = [
    (page, language, block)
    for page in FIRST
    for language, block in re.findall(r"^```(\w*)\n(.*?)^```", text_of(page), re.MULTILINE | re.DOTALL)
]
LINES = dict.fromkeys(
    line.split("#")[0].strip() for _, kind, block in BLOCKS if not kind for line in block.splitlines()
)


@pytest.mark.parametrize("line", LINES)
def test_first_commands_are_accepted(line):
    program, *words = shlex.split(line)
    if program.startswith("scripts/"):
        assert (ROOT / program).stat().st_mode & 0o100
        assert not words
    elif program == "python":
        assert (ROOT / words[0]).is_file()
    elif program == "wt-gym":
        assert words == ["--help"] or parse(words[0], words[1:])
    else:
        assert (program, words[0]) == ("pip", "install")


def test_first_commands_are_found():
    assert {"scripts/demo", "scripts/test", "scripts/docs"} <= set(LINES)


@pytest.mark.parametrize("page", FIRST)
def test_first_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, examples = {}, [block for name, kind, block in BLOCKS if name == page and kind == "python"]
    for example in examples:
        exec(compile(example, page, "exec"), names)
    assert names["observation"].shape == names["env"].observation_space.shape or "controller=" in examples[-2]
    if page == "docs/quickstart.md":
        assert (tmp_path / "run.nc").stat().st_size > 1000


GUIDES = ("signals", "pictures", "electrical", "variation", "budgets")  # in docs/howto, with examples in Python


@pytest.mark.slow
@pytest.mark.parametrize("page", GUIDES)
def test_examples_of_the_guides_run(page, tmp_path, monkeypatch):
    """Those of a page one after the other, as a reader types them."""
    monkeypatch.chdir(tmp_path)
    examples = re.findall(r"^```python\n(.*?)^```", text_of(f"docs/howto/{page}.md"), re.MULTILINE | re.DOTALL)
    assert examples
    names = {}
    for example in examples:
        exec(compile(example, page, "exec"), names)
    names["env"].close()


def test_the_controller_of_the_page_runs(tmp_path):
    """By the name that the commands of the page give it."""
    page = text_of("docs/howto/own_controller.md")
    file = tmp_path / "controller.py"
    file.write_text(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], encoding="utf-8")
    controller = make_controller(f"{file}:Mine:gain=0.05", load_turbine("nrel_5mw"))
    run = run_controller(Simulator("nrel_5mw", inflow=SteadyInflow(15.0)), controller, 0.4)
    assert run.to_dataset().generator_torque.min() > 1e4


def test_the_picture_moves_and_is_small():
    from PIL import Image

    file = ROOT / re.search(r"\((docs/data/\w+\.gif)\)", text_of("README.md"))[1]
    assert file.stat().st_size < 3e6
    with Image.open(file) as picture:
        assert picture.n_frames >= 20
        assert picture.size[0] <= 1000
