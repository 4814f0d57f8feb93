"""A message about an unknown name asks for the known one that it resembles."""

import doctest

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base import errors
from wt_gym.base.errors import WtGymError, did_you_mean
from wt_gym.commands import main
from wt_gym.commands.program import user_errors
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.names import read_name
from wt_gym.learning.hyperparameters import check_hyperparameters
from wt_gym.simulation.channels import Signals, new_values
from wt_gym.simulation.drivetrain.faults import SensorBias
from wt_gym.turbines import load_turbine
from wt_gym.turbines.checks import fail
from wt_gym.wind import wind_from

STEADY = "wt_gym/NREL5MW-Steady-v1"
SIGNALS = Signals(new_values(3)[0], 3)
REFUSED = {
    "argument": (lambda: gym.make(STEADY, wind_sped=8.0), "wind_speed"),
    "option of a group": (lambda: gym.make(STEADY, wind={"shear_exponen": 0.1}), "shear_exponent"),
    "action mode": (lambda: gym.make(STEADY, action_mode="residul"), "residual"),
    "form of pitch": (lambda: gym.make(STEADY, pitch="fixed_frame"), "fixed-frame"),
    "reward term": (lambda: gym.make(STEADY, reward={"blade-fatigue": 1.0}), "blade_fatigue"),
    "observed channel": (lambda: gym.make(STEADY, observation=["rotr"]), "rotor"),
    "fidelity": (lambda: gym.make(STEADY, fidelity="Training"), "training"),
    "turbine": (lambda: load_turbine("nrel5mw"), "nrel_5mw"),
    "signal": (lambda: SIGNALS["rotorspeed"], "rotor_speed"),
    "signal as an attribute": (lambda: SIGNALS.rotor_sped, "rotor_speed"),
    "channel of a fault": (lambda: SensorBias(1.0, ("rotor_sped",)).places(3), "rotor_speed"),
    "kind of wind": (lambda: wind_from({"kind": "stedy", "speed": 8.0}), "steady"),
    "task": (lambda: load_task("load-reducton-15"), "load-reduction-15"),
    "agent": (lambda: read_name("constrained_icp"), "constrained_ipc"),
    "algorithm": (lambda: check_hyperparameters("POP", {}), "PPO"),
    "hyperparameter": (lambda: check_hyperparameters("PPO", {"gama": 0.9}), "gamma"),
}
"""Calls with a name that is mistyped, and the one that was meant."""


@pytest.mark.parametrize("case", REFUSED)
def test_the_name_that_was_meant_is_asked_for(case):
    call, meant = REFUSED[case]
    with pytest.raises((WtGymError, ValueError, TypeError, KeyError, AttributeError)) as refused:
        call()
    assert f"; did you mean '{meant}'?" in str(refused.value)


def test_messages_have_plain_numbers():
    value = [np.float64(1.5), (np.int64(2), np.True_), {"a": np.str_("b")}, np.float32(-1e-5)]
    assert str(errors.InflowError(f"got {value!r}")) == "got [1.5, (2, True), {'a': 'b'}, -1e-05]"
    with pytest.raises(WtGymError, match=r"must be positive numbers, got \[1\.0, -2\.0\]"):
        raise fail("table", [np.float64(1.0), np.float64(-2.0)], "positive numbers")
    with pytest.raises(SystemExit, match=r"^error: got 2\.5$"), user_errors():
        raise ValueError(f"got {np.float64(2.5)!r}")


def test_a_command_that_was_meant_is_asked_for(capsys):
    with pytest.raises(SystemExit):
        main(["evaluated", "baseline"])
    assert "; did you mean 'evaluate'?" in capsys.readouterr().err


def test_what_resembles_nothing_is_not_asked_for():
    assert did_you_mean("xyzzy", ["power", "pitch"]) == ""
    assert did_you_mean("xyzzy", iter(["power", "pitch"]), ".") == "."
    assert did_you_mean(None, ["power"]) == ""
    assert did_you_mean("PITCH", iter(["power", "Pitch"])) == "; did you mean 'Pitch'?"


def test_the_example_runs():
    assert doctest.testmod(errors).failed == 0
