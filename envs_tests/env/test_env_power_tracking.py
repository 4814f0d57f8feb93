"""The environment with a power reference: what it pays, what an optimizer could try, and that nothing is lost."""

import itertools
import math

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.env.scripted_simulator import ScriptedSimulator, scripted_signals, use
from wt_gym.bridges.openfast import DRIVER_VARIABLE, VARIABLE
from wt_gym.control.design import rotor_inertia
from wt_gym.deployment.export.openfast_flight import Scene, export_openfast, fly
from wt_gym.envs import episode_start, record_store, rewards
from wt_gym.envs.power import available_power
from wt_gym.envs.power_reference import AHEAD
from wt_gym.envs.terms import Transition
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.run import play
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")
RATED = TURBINE.drivetrain.rated_rotor_speed
P, DT = TURBINE.drivetrain.rated_power, 0.1
HALF = 0.5 * rotor_inertia(TURBINE) * TURBINE.drivetrain.gearbox_efficiency * TURBINE.drivetrain.generator_efficiency
TRACKED = {
    "inflow": "steady", "wind_speed": 15.0, "action_mode": "residual", "action_components": ("pitch", "torque"),
    "controller": "discon+derate_torque", "control_dt": DT, "reward": {"power": 0.0, "power_tracking": 0.5},
}  # fmt: skip


def paid(powers, demanded, speeds=None):
    """Return of a course of powers [W] and rotor speeds over rated, the starting ones first."""
    speeds = np.full(len(powers), RATED) if speeds is None else RATED * np.asarray(speeds)
    samples = [
        scripted_signals({"time": k * DT, "generator_power": power, "rotor_speed": speed})
        for k, (power, speed) in enumerate(zip(powers, speeds, strict=True))
    ]
    demanded = np.broadcast_to(demanded, len(powers))
    term = rewards.PowerTracking(1.0)
    rewards.reset([term], TURBINE, samples[0], demanded_power=4e6)
    steps = zip(itertools.pairwise(samples), demanded[1:].tolist(), strict=True)
    return DT * sum(
        term(Transition(TURBINE, before, after, DT, demanded_power=asked)) for (before, after), asked in steps
    )


def speed_with(energy):
    """Rotor speed over rated with so much energy [J] more than at rated speed."""
    return math.sqrt(1.0 + energy / (HALF * RATED**2))


# ---- what is paid ----


def test_errors_cost_alike_above_and_below_and_grow_evenly_beyond_the_scale():
    assert paid([P, P], P) == 0.0
    above, below = paid([1.02 * P, 1.02 * P], P), paid([0.98 * P, 0.98 * P], P)
    assert above == pytest.approx(below)
    assert above < 0.0
    rates = [-paid([P - e * P] * 2, P) / DT for e in (0.005, 0.01, 0.4, 0.5)]
    assert rates[1] == pytest.approx(4.0 * rates[0], rel=0.02)
    assert rates[3] - rates[2] == pytest.approx(0.1 / 0.05, rel=0.01)
    term = rewards.PowerTracking(1.0)
    assert -rates[3] > term.worst_rate
    emptied = [1.0, speed_with(-2.0 * P * DT)]  # the rotor pays for twice the rated power
    assert paid([2.0 * P] * 2, 0.2 * P) / DT == pytest.approx(1.0 - math.hypot(1.0, 36.0))
    assert term.worst_rate < paid([2.0 * P] * 2, 0.2 * P, emptied) / DT < -70.0
    assert term.worst_rate == pytest.approx(paid([2.0 * P] * 2, 0.0, emptied) / DT)
    still = scripted_signals({"generator_power": P})
    with pytest.raises(ValueError, match="needs a power_reference"):
        term(Transition(TURBINE, still, still, DT))


# ---- what an optimizer could try ----


def test_holding_low_power_in_a_lull_costs_as_much_as_anywhere():
    """Available is 3.5 MW of 4.5: making 3 MW, to have energy for later, loses more than it then saves."""
    lull = [3.5e6] * 101
    rest = [4.5e6] * 101
    honest = paid(lull + rest, 4.5e6)
    saved = paid([3.0e6] * 101 + rest, 4.5e6)
    later = paid([3.0e6] * 101 + [4.5e6] * 51 + [4.9e6] * 50, 4.5e6)
    assert saved < honest
    assert later < saved  # making it up for the energy costs once more
    deficits = paid([3.3e6, 3.7e6] * 50 + [3.3e6], 4.5e6)
    assert deficits == pytest.approx(paid([3.5e6] * 101, 4.5e6), rel=0.02)  # nothing is won by shifting energy


def test_a_rotor_that_is_run_down_at_the_end_pays_more_than_it_saved():
    """The last 10 s: a deficit of 0.5 MW, or the same energy out of the rotor."""
    drained = [speed_with(-0.5e6 * DT * k) for k in range(101)]
    kept = paid([4.0e6] * 101, 4.5e6)
    assert paid([4.5e6] * 101, 4.5e6, drained) < kept < 0.0
    returned = drained + drained[::-1]
    assert paid([4.5e6] * 202, 4.5e6, returned) == pytest.approx(0.0, abs=1e-9)  # as a store it is free


def test_a_rotor_that_is_run_up_before_the_end_earns_nothing():
    faster = [speed_with(0.3e6 * DT * k) for k in range(101)]
    assert paid([4.5e6] * 101, 4.5e6, faster) == 0.0
    below = [0.9 * speed for speed in faster]  # the store counts up to where the episode began
    assert paid([4.5e6] * 101, 4.5e6, below) == 0.0
    above = [1.05, 1.02, 1.0, 1.0]  # of a controller that holds the rotor above rated speed, as a store
    sold = HALF * RATED**2 * (1.05**2 - 1.0)
    assert sold > 3e6
    assert paid([4.5e6] * 4, 4.5e6, above) == pytest.approx(-1.1 * sold / (0.05 * P))
    up_and_down = [0.9, 1.0, 0.9, 0.8]
    lost = HALF * RATED**2 * (0.9**2 - 0.8**2)
    assert paid([4.5e6] * 4, 4.5e6, up_and_down) == pytest.approx(-1.1 * lost / (0.05 * P))


# ---- the environment ----


def test_the_reference_is_observed_and_told(monkeypatch):
    use(monkeypatch, ScriptedSimulator)
    rows = [[0.0, 4e6], [2.0, 4e6], [2.0, 4.4e6], [12.0, 3.4e6]]
    env = WindTurbineEnv(**TRACKED, power_reference=rows, observation=("power_reference", "power_forecast"))
    names = env.observation_names.tolist()
    assert names == [
        "demanded_power", "power_error", "power_headroom", "rotor_energy",
        *(f"demanded_power_in_{t:g}_s" for t in AHEAD),
    ]  # fmt: skip
    observation, info = env.reset(seed=0)
    value = env.layout.observation.value
    assert info["demanded_power"] == 4e6
    ahead = [value(observation, name) for name in names if name.startswith("demanded_power")]
    np.testing.assert_allclose(ahead, [4e6, 4.4e6, 4.1e6, 3.6e6], rtol=1e-5)
    assert value(observation, "power_error") == pytest.approx(info["generator_power"] - 4e6, abs=1.0)
    assert value(observation, "rotor_energy") == pytest.approx(
        0.5 * rotor_inertia(TURBINE) * info["rotor_speed"] ** 2, rel=1e-5
    )
    for _ in range(25):
        observation, _, _, _, info = env.step([0.0, 0.0])
    assert info["demanded_power"] == pytest.approx(4.4e6 - 0.05e6)
    assert info["generator_power"] == pytest.approx(info["demanded_power"], rel=0.02)  # the controller reads it
    _, info = env.reset(seed=0, options={"power_reference": [[0.0, 3e6]]})
    assert info["demanded_power"] == 3e6


def test_what_needs_a_reference_says_so(monkeypatch):
    use(monkeypatch, ScriptedSimulator)
    plain = TRACKED | {"reward": None}
    with pytest.raises(ValueError, match=r"\['power_reference'\] must be left out: with this action, base controller,"):
        WindTurbineEnv(**plain, observation=("power_reference",))
    with pytest.raises(ValueError, match="power_tracking needs a power_reference"):
        WindTurbineEnv(**TRACKED).reset(seed=0)
    with pytest.raises(ValueError, match="power_reference must be left out of a reset"):
        WindTurbineEnv(**plain).reset(seed=0, options={"power_reference": "steps"})
    env = WindTurbineEnv(**plain)
    env.reset(seed=0)
    assert "demanded_power" not in env.step([0.0, 0.0])[4]


@pytest.mark.parametrize(("level", "nearest"), [((0.8, 0.9), 0.85), (1.0, 1.0), ((0.5, 0.6), 0.85)])
def test_running_starts_are_those_of_the_nearest_demanded_power(level, nearest, monkeypatch):
    monkeypatch.setattr(WindTurbineEnv, "make_simulator", staticmethod(ScriptedSimulator))
    levels = []

    def find(turbine, level, floating):
        levels.append(record_store.find_record(turbine, level, floating)[0].level)

    monkeypatch.setattr(episode_start, "find_record", find)
    monkeypatch.setattr(episode_start, "_report_missing", lambda _: None)
    given = {"inflow": "turbulent", "wind_speed": 14.0, "power_reference_level": level, "power_reference_span": 0.0}
    WindTurbineEnv(**TRACKED | given, power_reference="reserve").reset(seed=0)
    assert levels == [nearest]


def test_runs_have_the_demanded_and_the_available_power():
    env = WindTurbineEnv(**TRACKED, power_reference=[[0.0, 4e6], [1.0, 4.5e6]])

    run = play(env, ConstantAgent(env.layout), seed=0, options={}, duration=2.0).data
    np.testing.assert_allclose(run["demanded_power"].values[[0, 5, 20]], [4e6, 4.25e6, 4.5e6])
    assert (run["available_power"].values == P).all()
    assert run["demanded_power"].attrs["units"] == "W"
    askew = {"inflow": SteadyInflow(10.0, 90.0), "yaw": math.radians(40.0)}  # no yawing makes it less
    run = play(env, ConstantAgent(env.layout), seed=0, options=askew, duration=1.0).data
    np.testing.assert_allclose(run["available_power"].values, available_power(TURBINE, 10.0), rtol=1e-6)


def test_a_power_that_changes_is_refused_in_openfast(tmp_path):
    """ServoDyn tells a library one demanded power."""
    env = WindTurbineEnv(**TRACKED, power_reference="steps")
    for given in (
        {"power_reference": "steps"},
        {"power_reference": "course.csv"},
        {"grid": {"reference": [[0.0, 4e6], [9.0, 3e6]]}},
    ):
        scene = Scene(TRACKED | given, TURBINE, SteadyInflow(15.0, 90.0), env.operation.step)
        for write in (fly, export_openfast):
            with pytest.raises(ValueError, match=r"must be rows of time and one power in OpenFAST.*got .*\[\[0, 4e6"):
                write("discon+derate_torque", tmp_path, scene, duration=1.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize(
    ("choice", "speed"), [("discon+derate_kinetic+supervisor", 35.0), ("discon+derate_torque", 8.0)]
)
def test_a_flight_with_a_demanded_power_begins_parked_or_at_the_operating_point(choice, speed, tmp_path, monkeypatch):
    for name in (VARIABLE, DRIVER_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    arguments = TRACKED | {"power_reference": [[0.0, 0.5e6]], "standstill_limit": -1.0}
    scene = Scene(arguments, TURBINE, SteadyInflow(speed, 90.0), 0.1)
    flight = fly(choice, tmp_path, scene, duration=1.0)
    assert flight.agrees
    assert (flight.metrics["wt_gym, library"]["mean_power"] == 0.0) == (speed > 30.0)


def test_a_constant_power_is_the_demand_of_servodyn(tmp_path, compiler):
    rows = [[0.0, 4e6], [9.0, 4e6]]
    scene = Scene(TRACKED | {"power_reference": rows}, TURBINE, SteadyInflow(15.0, 90.0), 0.1)
    export_openfast("discon+derate_torque", tmp_path, scene, duration=1.0)
    assert InputFile(tmp_path / "servodyn.dat").number("GenPwr_Dem") == 4e6


def test_the_task_asks_for_every_kind():
    env = gym.make(TASKS["PowerTracking"].id, start="steady").unwrapped
    kinds = set()
    for number in range(24):
        kinds.add(env.starts.draw(np.random.default_rng(number), None, 60.0).drawn["power_reference"].kind)
    assert kinds == {"reserve", "steps", "ramps", "regulation"}


@pytest.mark.parametrize("way", ["torque", "speed", "pitch"])
def test_the_real_rosco_follows_a_reference(way, tmp_path, monkeypatch):
    pytest.importorskip("rosco")
    monkeypatch.chdir(tmp_path)  # ROSCO writes a file fort.401 there
    rows = [[0.0, 4.6e6], [20.0, 4.6e6], [20.0, 4.1e6]]
    env = WindTurbineEnv(**TRACKED | {"controller": f"rosco:derate={way}"}, power_reference=rows)
    env.reset(seed=0)
    power = [env.step([0.0, 0.0])[4]["generator_power"] for _ in range(600)]
    assert np.mean(power[150:200]) == pytest.approx(4.6e6, rel=0.03)
    assert np.mean(power[550:600]) == pytest.approx(4.1e6, rel=0.03)
