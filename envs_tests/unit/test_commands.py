"""The command line: how it is called, and how it ends where something is refused, missing or stopped."""

import argparse
import json
import os
import select
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
import xarray as xr

from wt_gym.commands import COMMANDS, main, module_of, program
from wt_gym.commands import parse as parse_command
from wt_gym.commands import run as run_command
from wt_gym.commands.program import OneLineParser, json_value, stoppable, user_errors
from wt_gym.commands.simulate import SimulationOptions


def ended(call, *arguments):
    with pytest.raises(SystemExit) as end:
        call(*arguments)
    return end.value.code


OUT_OF_OTHER_KIND = {
    "simulate": ["--out", "run.xlsx"],
    "tune": ["ipc", "--out", "tuned.yaml"],
    "design": ["linear_optimal", "--out", "mine.txt"],
    "import": ["model.fst", "--out", "turbine.json"],
    "campbell": ["--out", "figure.doc"],
    "compare-controllers": ["--report", "page.pdf"],
    "benchmark": ["archive", "runs", "--out", "entry.zip"],
    "describe": ["wt_gym/Yaw-v3", "--out", "report.txt"],
    "evaluate": ["--out", "report.html"],
    "loadcases": ["--out", "report.html"],
    "crosscheck": ["baseline", "--out", "report.html"],
    "robustness": ["zero", "--out", "report.html"],
    "train": ["--out", "model.zip"],
    "search": ["--out", "found.json"],
    "dataset": ["zero", "--out", "data.nc"],
    "export": ["model.zip", "--to", "discon", "--out", "library.zip"],
    "fly": ["zero", "--out", "run.outb"],
}


@pytest.mark.parametrize(("command", "words"), OUT_OF_OTHER_KIND.items())
def test_the_ending_of_a_place_is_checked_before_anything_runs(command, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ended(main, [command, *words]) == 2
    error = capsys.readouterr().err
    assert words[-1] in error
    assert any(text in error for text in ("must be a file that ends in", "must be a folder", "endings of figures"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself_and_imports_nothing_heavy(command, capsys):
    assert ended(main, [command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"usage: wt-gym {command}" in text
    assert "scripts/" not in text
    assert ended(main, ["--help"]) == 0
    assert f"  {command} " in capsys.readouterr().out
    assert not {"np", "torch", "xarray", "numba"} & set(vars(module_of(command)))


@pytest.mark.parametrize("words", [[], ["dance"], ["train", "--color", "red"]])
def test_wrong_words_take_one_line_and_status_2(words, capsys):
    assert ended(main, words) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.skipif(not hasattr(select, "poll"), reason="the system does not say whether a pipe is read")
def test_output_that_nobody_reads_ends_without_a_word():
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "wt_gym", "list", "controllers"]
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")


def test_what_is_not_installed_is_named_with_its_extra(monkeypatch):
    def without(name):
        with user_errors():
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    for in_clone, name, hint in (
        (True, "optuna", ".venv/bin/pip install -e '.[tune]'"),
        (False, "minari", "in a clone of the project: pip install '.[data]'"),
    ):
        monkeypatch.setattr(program, "IN_CLONE", in_clone)
        found = ended(without, name)
        assert found.startswith(f"error: {name} is not installed; ")
        assert hint in found
    with pytest.raises(ModuleNotFoundError):  # a fault of the package, to be shown whole
        without("wt_gym.nowhere")


@pytest.fixture(autouse=True)
def ctrl_c_counts():
    """Processes that a shell put into the background ignore SIGINT."""
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, former)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_end_with_their_status_after_what_is_under_way_is_kept(number, status, capsys):
    kept, former = [], signal.getsignal(signal.SIGTERM)

    def work():
        with stoppable("the same command goes on"):
            try:
                signal.raise_signal(number)
                pytest.fail("the signal did nothing")
            finally:
                kept.append(True)

    assert ended(work) == status
    assert kept
    assert capsys.readouterr().err == "\nstopped; the same command goes on\n"
    assert signal.getsignal(signal.SIGTERM) is former


@pytest.mark.parametrize("text", ["{", "[1,]", "[" * 100_000, "pitch=individual"])
def test_options_that_are_no_json_are_refused_in_one_line(text, capsys):
    parser = OneLineParser()
    parser.add_argument("--env-kwargs", type=json_value)
    assert ended(parser.parse_args, ["--env-kwargs", text]) == 2
    error = capsys.readouterr().err
    assert "is not valid JSON" in error
    assert error.count("\n") == 1
    assert len(error) < 300


@pytest.mark.parametrize("name", ["evaluate", "loadcases"])
def test_fidelity_is_an_argument_of_the_environment_and_counts_before_the_others(name):
    command = module_of(name)
    given = ["--fidelity", "engineering", "--env-kwargs", '{"fidelity": "reference", "overspeed_limit": 1.4}']
    chosen = command.configuration(parse_command(name, given)).env_kwargs
    assert chosen == {"fidelity": "engineering", "overspeed_limit": 1.4}
    assert command.configuration(parse_command(name, [])).env_kwargs == {}
    with pytest.raises(ValueError, match="must be a JSON object"):
        command.configuration(parse_command(name, ["--fidelity", "engineering", "--env-kwargs", "[1]"]))
    with pytest.raises(ValueError, match="site must be a JSON object, got 3"):
        command.configuration(parse_command(name, ["--env-kwargs", '{"site": 3}', "--site", "air_density=1.2"]))


class ScriptedSimulator:
    """What `simulate` needs of a simulator to record its signals."""

    time_step = 0.1

    def __init__(self, turbine, inflow, fidelity):
        self.turbine, self.inflow = turbine, inflow
        self.fidelity = argparse.Namespace(name=fidelity, formulation="embedded")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_simulation_is_written(number, monkeypatch, tmp_path, capsys):
    def run(simulator, duration, on_step, recorder):
        for k in range(5):
            recorder.append(argparse.Namespace(values=np.full(len(recorder.channels), 0.1 * k)))
        if simulator.inflow.mean_speed > 10.0:
            signal.raise_signal(number)
        return recorder

    monkeypatch.setattr("wt_gym.simulation.Simulator", ScriptedSimulator)
    monkeypatch.setattr("wt_gym.experiment.run.run_baseline", run)
    out = tmp_path / "new" / "run.nc"
    words = ["--wind-speed", "8", "12", "15", "--out", str(out), "--format", "outb", "nc"]
    assert ended(run_command, "simulate", words) == 128 + number
    names = ["run_12.nc", "run_12.outb", "run_8.nc", "run_8.outb"]
    assert sorted(file.name for file in out.parent.iterdir()) == names
    with xr.open_dataset(out.with_stem("run_12"), engine="h5netcdf") as data:
        assert data.sizes["time"] == 5
    assert "stopped; what was simulated is written" in capsys.readouterr().err


def test_simulate_looks_for_its_place_before_it_simulates(tmp_path):
    (tmp_path / "file").write_text("")
    assert "File exists" in ended(run_command, "simulate", ["--out", str(tmp_path / "file" / "run.nc")])
    assert "one file" in ended(run_command, "simulate", ["--wind-speed", "8", "8", "--out", str(tmp_path / "run.nc")])
    assert not (tmp_path / "run.nc").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--duration", "1e300"], "duration must be a number from 1 to 1e+06 s, got 1e+300"),
        (["--average", "400"], "average must be at most the duration of 300 s, got 400"),
        (["--wind-speed", "8", "1e9"], "wind_speed must be numbers from 0 to 50 m/s, got (8.0, 1000000000.0)"),
        (["--turbulent", "--wind-speed", "0"], "with --turbulent, got 0"),
        (["--fidelity", "none"], "got 'none'"),
        (["--format", "outb"], "--format must come with --out FILE, got outb without"),
    ],
)
def test_simulate_refuses_numbers_without_meaning_before_it_prints(words, message, capsys):
    assert message in ended(run_command, "simulate", words)
    assert capsys.readouterr().out == ""


def test_simulate_averages_over_short_runs_as_a_whole():
    assert [SimulationOptions(duration=length).average for length in (20.0, 300.0)] == [20.0, 60.0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--rotor-speed", "10", "1e9"], "--rotor-speed 1e+09: NREL 5-MW baseline, land based takes at most 60.5 rpm"),
        (["--wind-speed", "8", "1e9"], "--wind-speed 1e+09: NREL 5-MW baseline, land based takes at most 25 m/s"),
    ],
)
def test_campbell_says_which_speeds_are_allowed_before_it_computes(words, message, monkeypatch):
    monkeypatch.setattr("wt_gym.simulation.Simulator", lambda *_, **__: pytest.fail("a simulator was made"))
    assert message in ended(main, ["campbell", *words])


def broken_off(*_, **__):
    """Work during which Ctrl-C comes."""
    signal.raise_signal(signal.SIGINT)


def stopped_in_one_line(words, capsys):
    """What a command writes to standard output; it ends with 130, and one line on standard error, after Ctrl-C."""
    assert ended(main, words) == 130
    shown = capsys.readouterr()
    *before, last = shown.err.strip().splitlines()
    assert last.startswith("stopped; ")
    assert "Traceback" not in shown.err
    return shown.out, before


def test_a_stopped_comparison_shows_the_winds_in_which_all_have_run_and_each_error_once(monkeypatch, capsys):
    from wt_gym.base.errors import SimulationError
    from wt_gym.experiment import comparison

    done = []

    def run(simulator, controller, duration, control_dt, name):
        if len(done) == 8:
            signal.raise_signal(signal.SIGINT)
        done.append((simulator.inflow.mean_speed, name))
        if name == "tuned":
            raise SimulationError("it is broken")
        return argparse.Namespace(to_dataset=lambda: argparse.Namespace(attrs={}))

    monkeypatch.setattr(comparison, "simulator_maker", lambda *_, **__: ScriptedSimulator)
    monkeypatch.setattr(comparison, "run_controller", run)
    monkeypatch.setattr(comparison, "benchmark_metrics", lambda *_: {key: 1e6 for key, _ in comparison.COLUMNS})
    words = ["compare-controllers", "discon", "ipc", "tuned", "--wind-speed", "8", "12", "15", "--wind-seeds", "--json"]
    out, _ = stopped_in_one_line(words, capsys)
    rows = json.loads(out.splitlines()[-1])
    assert [(row["wind_speed"], row["controller"]) for row in rows] == [
        (8.0, "discon"), (12.0, "discon"), (8.0, "ipc"), (12.0, "ipc"),
    ]  # fmt: skip
    assert "| 8 | ipc |" in out
    assert "| 15 |" not in out
    assert out.count("it is broken") == 1
    assert "tuned at 8 m/s; 12 m/s: it is broken" in out


def test_a_stopped_search_keeps_its_trials(monkeypatch, tmp_path, capsys):
    pytest.importorskip("optuna")
    from wt_gym.experiment import tuning
    from wt_gym.experiment.comparison import COLUMNS, ControllerRuns

    calls = []

    def runs(turbine, controllers, cases, *_):
        calls.append(controllers)
        if len(calls) == 4:  # the reference, two trials, and then
            signal.raise_signal(signal.SIGINT)
        numbers = dict.fromkeys(("captured_power", *(key for key, _ in COLUMNS)), 1.0)
        return [ControllerRuns("x", dict.fromkeys(cases, numbers), {})]

    monkeypatch.setattr(tuning, "run_cases", runs)
    record = tmp_path / "new" / "tuned.json"
    stopped_in_one_line(["tune", "ipc", "--trials", "9", "--wind-speed", "12", "--out", str(record)], capsys)
    assert len(json.loads(record.read_text())["trials"]) == 2
    assert [file.name for file in record.parent.iterdir()] == ["tuned.json"]
    weighs = ["tune", "ipc", "--wind-speed", "12", "--weights", "beauty=1"]
    calls.clear()
    assert ended(main, weighs).endswith(", got beauty")


def test_a_stopped_recording_keeps_its_episodes(monkeypatch, tmp_path, capsys):
    from wt_gym.learning import datasets

    played, written = [], []

    def episode(env, agent, seed):
        if len(played) == 4:  # two at random, two of the agent, and then
            signal.raise_signal(signal.SIGINT)
        played.append(seed)
        return {"rewards": [1.0]}

    monkeypatch.setitem(sys.modules, "minari", type(sys)("minari"))
    monkeypatch.setattr(datasets, "_episode", episode)
    monkeypatch.setattr(datasets, "_write", lambda config, folder, env, done, lowest: written.append(len(done)))
    words = ["dataset", "baseline", "a/b-v0", "--env-kwargs", '{"inflow": "steady"}', "--out", str(tmp_path)]
    out, _ = stopped_in_one_line(words, capsys)
    assert written == [2]
    assert out.count("episode ") == 2


def test_a_stopped_diagram_leaves_no_files(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("wt_gym.simulation.campbell.campbell", broken_off)
    monkeypatch.setattr("wt_gym.simulation.Simulator", ScriptedSimulator)
    stopped_in_one_line(["campbell", "--csv", str(tmp_path / "new" / "table.csv")], capsys)
    assert not list((tmp_path / "new").iterdir())
    (tmp_path / "file").write_text("")
    assert "File exists" in ended(main, ["campbell", "--csv", str(tmp_path / "file" / "table.csv")])


def test_a_full_disk_ends_in_one_line_and_what_was_written_stays(monkeypatch, tmp_path):
    def run(simulator, duration, on_step, recorder):
        for k in range(5 if simulator.inflow.mean_speed < 10.0 else 5000):
            recorder.append(argparse.Namespace(values=np.full(len(recorder.channels), 0.1 * k)))
        return recorder

    monkeypatch.setattr("wt_gym.simulation.Simulator", ScriptedSimulator)
    monkeypatch.setattr("wt_gym.experiment.run.run_baseline", run)
    out = tmp_path / "run.nc"
    with files_of_at_most(400_000):
        error = ended(run_command, "simulate", ["--wind-speed", "8", "12", "--out", str(out)])
    assert error.startswith("error: ")
    assert "\n" not in error
    assert [file.name for file in tmp_path.iterdir()] == ["run_8.nc"]
    with xr.open_dataset(tmp_path / "run_8.nc", engine="h5netcdf") as data:
        assert data.sizes["time"] == 5


@contextmanager
def files_of_at_most(size):
    """A limit on files stands for a disk that is full; Python ignores the signal that comes with it."""
    resource = pytest.importorskip("resource")
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)
