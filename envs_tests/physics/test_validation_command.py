"""Checks, the registry of cases, the command line and the report."""

import importlib.util
import json
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from envs_tests.physics import validation as module
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
from wt_gym.structure.beam import Beam
from wt_gym.structure.coordinates import body_from_beam, circular_sections

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


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
        return CaseResult(
            [Check("one <&>", np.float64(1.0), np.float64(1.0), 0.1)],
            {"a line": figure, "pair": ([0, 1], [1, 0])},
            "a note",
        )

    def bad():
        raise ValueError("no solution")

    cases = {"bad": Case("bad", "Bad", "source", bad, slow=True), "good": Case("good", "Good", "source", good)}
    monkeypatch.setattr(module, "_CASES", cases)
    monkeypatch.setattr(validate, "load_cases", lambda: cases)


@pytest.mark.usefixtures("two_cases")
class TestCommand:
    def test_exit_status(self, capsys):
        assert validate.main(["run", "good"]) == 0
        assert validate.main(["run", "all"]) == 1
        assert "no solution" in capsys.readouterr().out
        assert validate.main(["run", "all", "--fast"]) == 0

    @pytest.mark.parametrize("error", [KeyError("no"), RuntimeError("numba"), AssertionError("wrong"), OSError("disk")])
    def test_any_failing_case_leaves_the_others_running(self, capsys, monkeypatch, error):
        def broken():
            raise error

        known = {"bad": Case("bad", "Bad", "source", broken), "good": module.load_cases()["good"]}
        monkeypatch.setattr(validate, "load_cases", lambda: known)
        assert validate.main(["run", "all"]) == 1
        shown = capsys.readouterr().out
        assert "Traceback" in shown
        assert type(error).__name__ in shown
        assert "2 cases, 2 checks, 1 failed: bad" in shown

    def test_nothing_to_run(self, capsys):
        with pytest.raises(SystemExit, match="2"):
            validate.main(["run", "bad", "--fast"])
        assert "no case is left of bad" in capsys.readouterr().err

    def test_unknown_case(self, capsys):
        with pytest.raises(SystemExit, match="2"):
            validate.main(["run", "nothing"])
        assert "unknown case nothing" in capsys.readouterr().err

    def test_json_is_one_object(self, capsys):
        assert validate.main(["run", "all", "--json"]) == 1
        data = json.loads(capsys.readouterr().out)
        assert data["passed"] is False
        assert [c["passed"] for c in data["cases"]] == [False, True]

    def test_the_record_takes_the_commit_that_was_loaded(self, tmp_path, monkeypatch):
        """Asked for before the first case runs: hours later the clone may be elsewhere."""
        commits = iter(["abc1234", "def5678"])
        monkeypatch.setattr(validate, "source_commit", lambda record: next(commits))
        path = tmp_path / "record.json"
        validate.main(["run", "all", "--record", str(path)])
        assert [entry["commit"] for entry in read_record(path).values()] == ["abc1234"] * 2

    def test_list(self, capsys):
        assert validate.main(["list", "--json"]) == 0
        assert [c["name"] for c in json.loads(capsys.readouterr().out)] == ["bad", "good"]

    def test_report_is_one_page(self, tmp_path):
        validate.main(["run", "good", "--report", str(tmp_path)])
        page = (tmp_path / "validation.html").read_text(encoding="utf-8")
        assert page.count("data:image/png;base64,") == 2
        assert "one &lt;&amp;&gt;" in page
        assert 'src="http' not in page


class TestOtherCommands:
    """What the command lines of the measurements and diagrams refuse before they compute anything."""

    @pytest.mark.parametrize(
        ("command", "arguments", "message"),
        [
            ("campbell", ["--out", "a.xyz"], "endings of figures are"),
            ("campbell", ["--wind-speed", "0"], "--wind-speed 0.0: allowed are finite speeds above 0"),
            ("campbell", ["--rotor-speed", "-1"], "--rotor-speed -1.0"),
            ("campbell", ["--wind-speed", "8", "--pitch", "3"], "--pitch goes with --rotor-speed"),
            ("campbell", ["--azimuths", "0"], "at least one"),
            ("campbell", ["--fidelity", "gebhardt"], "linear models need the embedded formulation"),
            ("campbell", ["--fidelity", "nope"], "--fidelity must be one of training"),
        ],
    )
    def test_refusals(self, capsys, command, arguments, message):
        with pytest.raises(SystemExit, match="2"):
            import_module(f"wt_gym.commands.{command}").parse_arguments(arguments)
        assert message in capsys.readouterr().err


class TestCoordinates:
    """One body in nodal, modal and rigid coordinates."""

    @staticmethod
    def beam():
        tube = circular_sections(
            2.0, 0.05, youngs_modulus=7e10, shear_modulus=2.7e10, density=2700.0, inner_diameter=0.04
        )
        return Beam(tube, 4)

    def test_rigid_body_keeps_mass_center_and_inertia(self):
        flexible, rigid = (body_from_beam("tube", self.beam(), kind) for kind in ("nodal", "rigid"))
        assert rigid.n_elastic == 0
        assert rigid.inertia.mass == pytest.approx(flexible.inertia.mass)
        assert rigid.inertia.mass == pytest.approx(2700.0 * 2.0 * np.pi / 4.0 * (0.05**2 - 0.04**2))
        np.testing.assert_allclose(rigid.inertia.c0, flexible.inertia.c0, atol=1e-12)
        np.testing.assert_allclose(rigid.inertia.j0, flexible.inertia.j0, atol=1e-12)
        np.testing.assert_allclose(rigid.markers["tip"].position, [0.0, 0.0, 2.0])

    def test_modal_stiffness_is_diagonal_and_damping_the_ratio(self):
        body = body_from_beam("tube", self.beam(), "modal", n_modes=5, damping_ratio=0.02)
        omega = np.sqrt(np.diag(body.stiffness))
        np.testing.assert_allclose(np.diag(body.damping), 2.0 * 0.02 * omega, rtol=1e-9)
        np.testing.assert_allclose(body.inertia.m0, np.eye(5), atol=1e-9)

    def test_every_mode_of_a_nodal_body_has_the_damping_ratio(self):
        body = body_from_beam("tube", self.beam(), "nodal", damping_ratio=0.02)
        squares, modes = eigh(body.stiffness, body.inertia.m0)
        damping = modes.T @ body.damping @ modes
        expected = np.diag(2.0 * 0.02 * np.sqrt(squares))
        np.testing.assert_allclose(damping, expected, atol=1e-6 * expected.max())

    def test_nodal_coordinates_are_the_nodes(self):
        body = body_from_beam("tube", self.beam(), "nodal", dofs=(0, 4))
        assert body.n_elastic == 8
        assert body.coordinate_names[:2] == ("tube_node_1_x", "tube_node_1_turn_y")
        np.testing.assert_allclose(body.markers["tip"].linear[0], [0, 0, 0, 0, 0, 0, 1, 0], atol=1e-12)

    def test_bad_input_is_refused(self):
        with pytest.raises(ValueError, match="must be one of nodal, modal, rigid"):
            body_from_beam("tube", self.beam(), "exact")
        with pytest.raises(ValueError, match="inner_diameter"):
            circular_sections(1.0, 0.1, youngs_modulus=1.0, shear_modulus=1.0, density=1.0, inner_diameter=0.2)
