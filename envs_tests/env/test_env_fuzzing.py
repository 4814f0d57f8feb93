"""Fuzzing: the environment keeps its contract in drawn cases, and a broken contract is noticed."""

import json
import math
import subprocess
import sys

import fuzz as command
import numpy as np
import pytest

from fuzzing.cases import POLICY_NAMES, WINDS, draw_case
from fuzzing.contract import Contract, ContractBroken
from fuzzing.energy import EnergyAccount
from fuzzing.memory import MemoryRecord
from fuzzing.run import fuzz, run_case
from wt_gym.control.design import rotor_inertia
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

NREL = ["nrel_5mw"]


@pytest.mark.parametrize("least", [1_000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_thousands_of_steps_find_no_fault(least):
    faults, steps = [], 0
    for result in fuzz(least, NREL):
        faults += [f"{finding.case}: {finding.message}" for finding in result.findings if finding.is_fault]
        steps += max(result.steps, 1)  # a case in which no start succeeds counts one
    assert steps >= least
    assert not faults


def test_cases_follow_from_their_number_and_cover_everything():
    cases = [draw_case(number, command.TURBINES) for number in range(300)]
    assert {case.wind for case in cases} == set(WINDS)
    assert {case.policy for case in cases} == set(POLICY_NAMES)
    assert {case.turbine for case in cases} == set(command.TURBINES)
    modes = {(case.arguments["action_mode"], case.arguments["pitch"]) for case in cases}
    assert len(modes) == 3 * 3 + 1  # collective, individual and fixed frame in all modes, cyclic on top of a controller
    assert draw_case(17, NREL) == draw_case(17, NREL) != draw_case(18, NREL)
    only_yaw = [case.arguments for case in cases if case.arguments["action_components"] == ("yaw",)]
    assert only_yaw
    assert not any("offsets" in arguments["observation"] for arguments in only_yaw)  # which the environment refuses


class Meddled(WindTurbineEnv):
    """An environment that breaks its contract in one way."""

    _way = None

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        match self._way:
            case "observation":
                observation = observation * np.float32(np.nan)
            case "range":
                observation = observation + np.float32(1e6)
            case "reward":
                reward += 1e-3
            case "bound":
                info["reward_terms"]["overspeed"] += 1.0
                reward += 1.0
            case "end":
                terminated = True
            case "clearance":
                info["tip_clearance_min"] = 0.5 * info["tip_clearance_min"]
            case "time":
                info["time"] += 0.1
            case "cost":
                info["cost"] = -1.0
            case "action":
                action[0] = 0.5
            case "energy":
                self.simulator.coupling.exchange.energy.gained[0] = 1e12
        return observation, reward, terminated, truncated, info


@pytest.fixture(scope="module")
def meddled():
    return Meddled(wind_speed=12.0)


@pytest.mark.parametrize(
    ("way", "message"),
    [
        ("observation", "not finite"), ("range", "outside of its space"), ("reward", "sum of its terms"),
        ("bound", "its bounds"), ("end", "termination"), ("clearance", "tip_clearance_min"), ("time", "time is"),
        ("cost", "cost"), ("action", "changed the action"), ("energy", "than the work done on it"),
    ],
)  # fmt: skip
def test_a_broken_contract_is_noticed(meddled, way, message):
    contract = Contract(meddled)
    contract.reset(seed=0)
    meddled._way = way
    with pytest.raises(ContractBroken, match=message):
        contract.step(np.zeros(3, dtype=np.float32))


def test_energy_beyond_what_the_wind_carries_is_noticed():
    turbine, wind = load_turbine("nrel_5mw"), 12.0
    radius, density = 63.0, turbine.air_density
    share = 16.0 / 27.0 * 0.5 * density * np.pi * radius**2 * wind**3
    lent = 0.5 * density * 4.0 / 3.0 * np.pi * radius**3 * wind**2

    def signals(time, power, rotor_speed=1.0):
        return {"time": time, "generator_power": power, "rotor_speed": rotor_speed, "aero_thrust": 0.0}

    def account(power):
        return EnergyAccount(turbine, SteadyInflow(wind, turbine.hub_height), signals(0.0, power))

    fair = account(share)
    for second in range(1, 500):
        fair.take(signals(float(second), share), 1.0)
    assert fair.excess == pytest.approx(0.0, abs=1e-6 * lent)
    fair.take(signals(500.0, share, rotor_speed=1.1), 1.0)
    assert fair.excess == pytest.approx(0.5 * rotor_inertia(turbine) * (1.1**2 - 1.0), rel=1e-6)
    greedy, second = account(3.0 * share), 0
    while not greedy.exceeded:
        second += 1
        greedy.take(signals(float(second), 3.0 * share), 1.0)
    assert second == int(2.0 * lent / (2.0 * share)) + 5  # a debt that lasts
    swinging, faster = account(0.0), math.sqrt(1.0 + 20.0 * lent / rotor_inertia(turbine))
    for second in range(1, 20):  # blades that swing lend to the hub, and take back
        swinging.take(signals(float(second), 0.0, rotor_speed=faster if second % 2 else 1.0), 1.0)
        assert not swinging.exceeded
    for second in range(20, 40):
        swinging.take(signals(float(second), share, rotor_speed=faster), 1.0)
    assert swinging.exceeded


def test_what_a_case_raises_is_a_finding_with_its_command(monkeypatch, capsys, tmp_path):
    def fail(self, action):
        raise ZeroDivisionError("of nothing")

    monkeypatch.setattr(WindTurbineEnv, "step", fail)
    result = run_case(draw_case(3, NREL), 5)
    (finding,) = result.findings
    assert (finding.kind, finding.is_fault) == ("exception", True)
    assert "ZeroDivisionError: of nothing" in finding.message
    out = tmp_path / "new" / "fuzz.txt"
    with pytest.raises(SystemExit) as end:
        command.main(["--case", "3", "--turbine", "nrel_5mw", "--out", str(out), "--json"])
    assert end.value.code == 1
    (line,) = out.read_text().splitlines()
    assert line.endswith("| scripts/fuzz.py --case 3 --turbine nrel_5mw")
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["exception"] == 1


@pytest.mark.slow
def test_memory_stays_flat_over_steps_and_resets():
    """Growth is below 1 KiB per 1000 steps of some 7 kB each of signals and observations, had they been kept.

    In a process of its own: one that has run other tests has holes to fill and rubbish to let go of.
    """
    words = [command.__file__, "--memory", "--steps", "100000", "--json"]
    printed = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True).stdout
    measured = json.loads(printed.splitlines()[-1])
    assert measured["resets"] >= 2000
    assert MemoryRecord(measured["steps"], measured["resident_mib"], measured["resets"]).growth < 1.0
