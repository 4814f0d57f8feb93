"""Every validation case, as published or coarser; checks, the registry, the command line, the record and the report."""

import importlib.util
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs_tests.physics import validation
from envs_tests.physics.cases import fidelities
from envs_tests.physics.cases.fidelities import (
    EXPERIMENTS,
    QUANTITIES,
    StaleRecordError,
    constant_gain,
    recorded,
    stamp,
)
from envs_tests.physics.validation import (
    Case,
    CaseResult,
    Check,
    Curve,
    Figure,
    absolute,
    case,
    load_cases,
    read_record,
    run_case,
    worst,
)
from wt_gym.control import Demand
from wt_gym.control.controllers.discon import DisconController, nrel_5mw_parameters
from wt_gym.simulation.fidelity import fidelity

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
LONG = {"floating-control", "iea-15mw-blade-dynamic", "iea-15mw-blade-static", "observer-turbine-reduction"}
"""Slow cases that a run of the slow tests takes too."""


def items():
    """Cases of the suite; with ``-m slow`` others as published."""
    for item in load_cases().values():
        suite = not item.slow if item.quick is None else item.quick is not False
        if suite or not item.slow or item.name in LONG:
            yield pytest.param(item, id=item.name, marks=() if suite else pytest.mark.slow)


@pytest.mark.parametrize("item", list(items()))
def test_case(item):
    """Every row is within its tolerance."""
    result = run_case(item, **(item.quick or {}))
    assert result.checks
    failed = [f"{c.quantity}: expected {c.expected}, obtained {c.obtained:.6g}" for c in result.checks if not c.passed]
    assert not failed, "\n".join(failed)


def load_script(name):
    """A command line as a module; scripts are no package."""
    spec = importlib.util.spec_from_file_location(f"{name}_script", SCRIPTS / f"{name}.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


validate = load_script("validate")


class TestCheck:
    def test_relative_and_absolute(self):
        assert Check("a", 2.0, 2.1, 0.051).passed
        assert not Check("a", 2.0, 2.1, 0.049).passed
        assert Check("a", -2.0, -2.1, absolute(0.11)).error == pytest.approx(0.1)
        assert Check("zero", 0.0, 1e-3, 1e-2).passed
        assert not Check("zero", 0.0, 1e-3, 1e-2).is_relative

    @pytest.mark.parametrize(
        ("bound", "good", "bad"), [("<= 1.5", 1.5, 1.6), (">= 2", 3.0, 1.9), ("in [-1, 2]", 0.0, 2.5)]
    )
    def test_bounds(self, bound, good, bad):
        assert Check("b", bound, good, 0.0).passed
        assert not Check("b", bound, bad, 0.0).passed
        assert Check("b", bound, bad, 1.0).passed

    @pytest.mark.parametrize("expected", [1.0, "<= 1"])
    def test_not_a_number_never_passes(self, expected):
        assert not Check("n", expected, math.nan, 1e9).passed

    def test_unreadable_bound(self):
        with pytest.raises(ValueError, match="is not a bound"):
            _ = Check("b", "about 3", 3.0, 0.0).error

    def test_kind_of_a_tolerance(self):
        assert Check("a", 2.0, 2.1, absolute(0.11), "m").as_dict()["relative"] is False
        assert Check("a", 2.0, 2.1, 0.11, "m").as_dict()["relative"] is True
        assert Check("a", 0.0, np.float32(0.0)).as_dict()["tolerance"] == 0.0

    def test_worst_point_of_a_curve(self):
        at, expected = np.array([5.0, 10.0, 20.0]), np.array([1.0, 10.0, 100.0])
        obtained = expected + np.array([0.1, 2.0, 5.0])
        check = worst("thrust", "winds: {:g} m/s", at, expected, obtained, 0.1, "kN", "a source")
        assert check == Check("thrust, worst of 3 winds: 10 m/s", 10.0, 12.0, 0.1, "kN", "a source")
        assert worst("thrust", "winds: {:g}", at, expected, obtained, absolute(0.1)).obtained == 105.0
        chosen = np.array([True, False, False])
        assert worst("thrust", "winds: {:g}", at, expected, obtained, 0.1, chosen=chosen).quantity.endswith(
            "1 winds: 5"
        )


class TestRegistry:
    def test_names_are_unique_and_told(self):
        known = load_cases()
        assert {"bathe-bend", "roll-up", "spin-up", "parked-nrel-5mw", "mixed-coordinates"} <= set(known)
        assert all(c.title and c.source for c in known.values())
        with pytest.raises(ValueError, match="already defined"):

            @case("roll-up", "another", "nowhere")
            def another():
                return []

    def test_a_case_without_checks_fails(self):
        result = run_case(Case("empty", "empty", "none", list))
        assert not result.passed
        assert result.wall_time >= 0.0


@pytest.fixture
def two_cases(monkeypatch):
    """Registry of one passing and one failing, slow case."""
    load_cases()  # a module first imported under this fixture would lose its cases with it

    def good():
        figure = Figure((Curve([0, 1], [0, 1], "line"),), "x", "y")
        return CaseResult([Check("one <&>", np.float64(1.0), np.float64(1.0), 0.1)], {"a line": figure}, "a note")

    def bad():
        raise ValueError("no solution")

    cases = {"bad": Case("bad", "Bad", "source", bad, slow=True), "good": Case("good", "Good", "source", good)}
    monkeypatch.setattr(validation, "_CASES", cases)
    monkeypatch.setattr(validate, "load_cases", lambda: cases)


@pytest.mark.usefixtures("two_cases")
class TestCommand:
    def test_exit_status_and_errors(self, capsys):
        assert validate.main(["run", "good"]) == 0
        assert validate.main(["run", "all"]) == 1
        assert "no solution" in capsys.readouterr().out
        assert validate.main(["run", "all", "--fast"]) == 0
        for names, message in ((["bad", "--fast"], "no case is left of bad"), (["nothing"], "unknown case nothing")):
            with pytest.raises(SystemExit, match="2"):
                validate.main(["run", *names])
            assert message in capsys.readouterr().err

    @pytest.mark.parametrize("error", [KeyError("no"), RuntimeError("numba"), AssertionError("wrong"), OSError("disk")])
    def test_any_failing_case_leaves_the_others_running(self, capsys, monkeypatch, error):
        def broken():
            raise error

        known = {"bad": Case("bad", "Bad", "source", broken), "good": load_cases()["good"]}
        monkeypatch.setattr(validate, "load_cases", lambda: known)
        assert validate.main(["run", "all"]) == 1
        shown = capsys.readouterr().out
        assert all(text in shown for text in ("Traceback", type(error).__name__, "2 cases, 2 checks, 1 failed: bad"))

    def test_json_is_one_object(self, capsys):
        assert validate.main(["run", "all", "--json"]) == 1
        data = json.loads(capsys.readouterr().out)
        assert (data["passed"], [c["passed"] for c in data["cases"]]) == (False, [False, True])
        assert validate.main(["list", "--json"]) == 0
        assert [c["name"] for c in json.loads(capsys.readouterr().out)] == ["bad", "good"]

    def test_the_record_takes_the_commit_that_was_loaded(self, tmp_path, monkeypatch):
        """Asked for before the first case runs: hours later the clone may be elsewhere."""
        commits = iter(["abc1234", "def5678"])
        monkeypatch.setattr(validate, "source_commit", lambda record: next(commits))
        path = tmp_path / "record.json"
        validate.main(["run", "all", "--record", str(path)])
        assert [entry["commit"] for entry in read_record(path).values()] == ["abc1234"] * 2

    def test_report_is_one_page(self, tmp_path):
        validate.main(["run", "good", "--report", str(tmp_path)])
        page = (tmp_path / "validation.html").read_text(encoding="utf-8")
        assert page.count("data:image/png;base64,") == 1
        assert "one &lt;&amp;&gt;" in page
        assert "src='http" not in page


# ---- records of the reference runs ----


def test_a_record_of_other_options_is_refused_and_says_how_to_renew_it(tmp_path, monkeypatch):
    experiment, options = EXPERIMENTS["steady-gain-1.0"], fidelity("reference")
    row = ["steady-gain-1.0", "reference", stamp(experiment, options), *("1.5" for _ in QUANTITIES)]
    table = tmp_path / "reference_runs.csv"
    table.write_text(f"# comment\n{','.join(('experiment', 'fidelity', 'stamp', *QUANTITIES))}\n{','.join(row)}\n")
    monkeypatch.setattr(fidelities, "TABLE", table)
    assert recorded("steady-gain-1.0") == dict.fromkeys(QUANTITIES, 1.5)
    with pytest.raises(StaleRecordError, match=r"steady-gain-0\.4 .* is missing; renew it: python -m .* steady-gain-0"):
        recorded("steady-gain-0.4")
    finer = replace(options, aero=replace(options.aero, n_span=options.aero.n_span + 1))
    monkeypatch.setitem(fidelities.RECORDED, "reference", finer)
    with pytest.raises(StaleRecordError, match="another turbine, fidelity, wind or control; renew it"):
        recorded("steady-gain-1.0")


def test_stamps_know_wind_and_control_and_ignore_the_last_bits_of_numbers():
    options = fidelity("reference")
    stamps = {name: stamp(experiment, options) for name, experiment in EXPERIMENTS.items()}
    assert len(set(stamps.values())) == len(EXPERIMENTS)
    aero = options.aero
    nudged = replace(options, aero=replace(aero, squire=np.nextafter(aero.squire, 1.0)))
    assert stamp(EXPERIMENTS["steady-gain-0.4"], nudged) == stamps["steady-gain-0.4"]


@pytest.mark.parametrize("speed", [20.0, 90.0, 130.0, 300.0])
def test_the_law_of_the_gain_sweep_is_the_square_of_the_speed_everywhere(speed):
    controller = DisconController(constant_gain(nrel_5mw_parameters(), 0.7))
    controller.start({"generator_speed": speed}, Demand(np.zeros(3), 0.0, np.nan))
    demand = controller.step({"generator_speed": speed}, 0.2)
    assert demand.generator_torque == pytest.approx(
        min(0.7 * 2.332287 * speed**2, nrel_5mw_parameters().max_torque), rel=1e-9
    )
    assert np.all(demand.pitch == 0.0)
