"""Floating turbines: the coupled simulator against free decays of OpenFAST, waves, symmetry and energy."""

import copy
import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from envs_tests.physics.refusals import refuses
from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.base.quantities import GRAVITY
from wt_gym.hydrodynamics.waves import SeaState, WaveComponents
from wt_gym.simulation import Simulator, channel_table
from wt_gym.simulation.fidelity import fidelity
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import SteadyInflow

SHARED = Path(__file__).resolve().parents[3] / "shared" / "floating"
NAMES = {"oc4": "oc4_nrel_5mw", "volturn": "volturnus_iea_15mw"}
MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
UNITS = np.array([1.0, 1.0, 1.0, *[np.pi / 180.0] * 3])
RATED = {"rotor_speed": 1.267, "pitch": 0.06}
WAVES = WaveComponents([0.5, 0.7], [1.5, 0.5], [0.3, 2.0], [0.4, -0.2])


@cache
def parked(name):
    """A turbine with its rotor at rest and feathered in thin air that does not move."""
    turbine = replace(load_turbine(NAMES[name]), air_density=0.1)
    return Simulator(turbine, SteadyInflow(0.01, hub_height=turbine.hub_height), fidelity("training"))


def platform(signals):
    return np.array([signals[f"platform_{motion}"] for motion in MOTIONS])


def released(simulator, displacement, duration, sea=None):
    """Motion (n, 6) of a parked turbine released at a displacement (6,) [m, rad] from its origin, at each step."""
    simulator.sea = sea
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0, platform=np.concatenate([displacement, np.zeros(6)]))
    rows = [platform(simulator.signals)]
    for _ in range(round(duration / simulator.time_step)):
        rows.append(platform(simulator.advance(simulator.time_step, pitch=0.5 * np.pi)))
    return np.array(rows)


def peaks(time, values):
    """Times and sizes of the maxima above zero, by parabolas through three points."""
    middle = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:]) & (values[1:-1] > 0.0)) + 1
    slope = 0.5 * (values[middle + 1] - values[middle - 1])
    bend = values[middle + 1] - 2.0 * values[middle] + values[middle - 1]
    return time[middle] - slope / bend * (time[1] - time[0]), values[middle] - 0.5 * slope**2 / bend


def damping(sizes):
    decrement = np.log(sizes[:-1] / sizes[1:])
    return decrement / np.hypot(2.0 * np.pi, decrement)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the reference runs of floating platforms")
@pytest.mark.parametrize(
    ("name", "motion"),
    [
        ("oc4", "heave"),
        pytest.param("oc4", "pitch", marks=pytest.mark.slow),
        pytest.param("oc4", "surge", marks=pytest.mark.slow),
        pytest.param("oc4", "yaw", marks=pytest.mark.slow),
        *(pytest.param("volturn", motion, marks=pytest.mark.slow) for motion in ("surge", "heave", "pitch", "yaw")),
    ],
)
def test_free_decays(name, motion):
    """Periods within 2 %, damping ratios within 10 % of those of OpenFAST, cycle by cycle."""
    run = np.genfromtxt(SHARED / "series" / f"{name}_decay_{motion}.csv", delimiter=",", names=True)
    first = np.zeros(6)
    for k, each in enumerate(MOTIONS):
        column = next((one for one in run.dtype.names if one.startswith(f"{each}_")), None)
        first[k] = 0.0 if column is None else run[column][0] * UNITS[k]
    place = MOTIONS.index(motion)
    column = next(one for one in run.dtype.names if one.startswith(f"{motion}_"))
    duration = min(run["time_s"][-1], 100.0) if motion == "heave" else run["time_s"][-1]
    simulator = parked(name)
    rows = released(simulator, first, duration)
    time = simulator.time_step * np.arange(len(rows))
    with (SHARED / "decay.csv").open() as file:
        rest = next(float(row["equilibrium"]) for row in csv.DictReader(file) if row["platform"] == name
                    and row["motion"] == motion)  # fmt: skip
    until = run["time_s"] <= duration
    own, other = (
        peaks(*each)
        for each in ((time, rows[:, place] / UNITS[place] - rest), (run["time_s"][until], run[column][until] - rest))
    )
    # a maximum at the very start is one of OpenFAST's too
    n = min(len(own[0]), len(other[0]))
    assert n >= 2
    np.testing.assert_allclose(np.diff(own[0][:n]), np.diff(other[0][:n]), rtol=0.02)
    np.testing.assert_allclose(damping(own[1][:n]), damping(other[1][:n]), rtol=0.1)


@cache
def running(name="oc4"):
    turbine = load_turbine(NAMES[name])
    return Simulator(turbine, SteadyInflow(12.0, hub_height=turbine.hub_height), fidelity("training"))


def course(simulator, sea=None, steps=40, **start):
    """Signals (n, n_channels) of some seconds at constant demands."""
    simulator.sea = sea
    rows = [simulator.reset(**(RATED | start)).values]
    rows += [simulator.advance(0.2, pitch=0.06, generator_torque=41e3).values for _ in range(steps)]
    return np.array(rows)


def test_the_start_is_a_balance():
    """Without waves nothing moves the platform in the first seconds; thrust times lever is what tilts it."""
    simulator = running()
    signals = simulator.reset(**RATED)
    assert abs(signals.platform_surge_acceleration) < 1e-3
    assert abs(signals.platform_pitch_acceleration) < 1e-5
    assert signals.platform_surge == pytest.approx(7.5, rel=0.1)
    assert np.degrees(signals.platform_pitch) == pytest.approx(2.9, rel=0.1)
    assert (
        signals["fairlead_tension_2"]
        > signals["fairlead_tension_1"]
        == pytest.approx(signals["fairlead_tension_3"], rel=0.01)
    )


def test_signals_have_the_channels_of_the_platform_last():
    values = course(running(), WAVES, steps=1)
    names = [channel.name for channel in channel_table(3, 3)]
    assert values.shape[1] == len(names)
    assert names[-7:] == [
        "wave_elevation",
        *(f"{end}_tension_{k}" for end in ("fairlead", "anchor") for k in (1, 2, 3)),
    ]
    assert values[1, names.index("wave_elevation")] == pytest.approx(WAVES.elevation(0.2), rel=1e-9)


def test_a_start_amid_waves_is_their_steady_motion():
    """In regular waves the first period has the amplitude of the last one, and the phase."""
    simulator, rest = parked("oc4"), np.zeros(6)
    sea = SeaState("regular", 2.0, 10.0).components(np.random.default_rng(0), 200.0)
    simulator.sea = sea
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0)
    rows = np.array([
        platform(simulator.advance(simulator.time_step, pitch=0.5 * np.pi))
        for _ in range(round(60.0 / simulator.time_step))
    ])  # fmt: skip
    n = round(10.0 / simulator.time_step)
    turn = np.exp(-2j * np.pi * np.arange(1, n + 1) / n)
    first, last = (2.0 * (turn[:, None] * part).mean(axis=0) for part in (rows[:n], rows[-n:]))
    for place, size in ((0, 0.4003), (2, 0.2165), (4, np.radians(0.3539))):  # those of OpenFAST
        assert abs(first[place]) == pytest.approx(size, rel=0.12)
        assert abs(first[place] - last[place]) < 0.12 * abs(last[place])
    assert released(simulator, rest, 1.0)[0, 0] == 0.0  # a given slow motion is taken as it is, in still water


def test_a_snapshot_continues_in_its_waves():
    simulator = running()
    course(simulator, WAVES, steps=3)
    state, signals = simulator.state(), []
    for _ in range(2):
        signals.append([simulator.advance(0.2, pitch=0.06, generator_torque=41e3).values for _ in range(5)])
        simulator.restore(state)
    np.testing.assert_array_equal(*signals)
    other = copy.deepcopy(simulator)
    again = [other.advance(0.2, pitch=0.06, generator_torque=41e3).values for _ in range(5)]
    np.testing.assert_array_equal(again, signals[0])


def test_a_mirrored_world():
    turbine = load_turbine(NAMES["oc4"])
    sea = WAVES
    first = course(running(), sea)
    image = Simulator(mirrored(turbine), SteadyInflow(12.0, hub_height=turbine.hub_height), fidelity("training"))
    second = course(image, sea.mirrored())
    signs = np.array([channel.parity for channel in channel_table(3, 3)], dtype=float)
    names = [channel.name for channel in channel_table(3, 3)]
    order = np.arange(len(names))
    for end in ("fairlead", "anchor"):  # line 1 is the image of line 3
        a, b = names.index(f"{end}_tension_1"), names.index(f"{end}_tension_3")
        order[[a, b]] = order[[b, a]]
    scale = np.abs(first).max(axis=0) + 1e-9
    assert np.abs(second[:, names.index("platform_sway")]).max() > 1e-3
    np.testing.assert_allclose(second * signs / scale, first / scale, atol=1e-6)


def test_what_a_sea_and_a_start_must_be():
    simulator, land = running(), load_turbine("nrel_5mw")
    refuses(
        ActionError,
        ("12 finite numbers", lambda: simulator.reset(**RATED, platform=np.zeros(6))),
        ("12 finite numbers", lambda: simulator.reset(**RATED, platform=np.full(12, np.nan))),
    )
    refuses(
        SimulationError,
        ("wave components", lambda: Simulator(load_turbine(NAMES["oc4"]), SteadyInflow(8.0), sea=SeaState())),
        ("does not float", lambda: Simulator(land, SteadyInflow(8.0), sea=WAVES)),
        ("floats", lambda: Simulator(load_turbine(NAMES["oc4"]), SteadyInflow(8.0), "gebhardt-full")),
    )


def test_energy_of_a_floater_without_damping():
    """The sum of kinetic, elastic, gravitational and hydrostatic energy is constant within what thin air takes."""
    turbine = load_turbine(NAMES["oc4"])
    bare = replace(turbine.floater, members=(), plates=(), lines=(),
                   radiation=replace(turbine.floater.radiation, damping=0.0 * turbine.floater.radiation.damping,
                                     added_mass=0.0 * turbine.floater.radiation.added_mass
                                     + turbine.floater.radiation.added_mass_infinite),
                   additional_stiffness=np.diag([7e4, 7e4, 0.0, 0.0, 0.0, 1.2e8]))  # fmt: skip
    tower = replace(turbine.tower, damping_ratio=0.0, drag_coefficient=0.0)
    blade = replace(turbine.blade, damping_ratio=0.0)
    still = replace(turbine, floater=bare, tower=tower, blade=blade, air_density=0.1)
    simulator = Simulator(still, SteadyInflow(0.01, hub_height=still.hub_height), fidelity("training"))
    start = np.array([3.0, 1.0, 0.5, 0.02, 0.05, 0.05])
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0, platform=np.concatenate([start, np.zeros(6)]))
    system, energies, kinetic = simulator.structure.system, [], []
    floater, density = still.floater, still.floater.water_density
    stiffness = floater.hydrostatic + floater.additional_stiffness
    for _ in range(300):
        q = platform(simulator.advance(0.2, pitch=0.5 * np.pi))
        water = 0.5 * q @ stiffness @ q - density * GRAVITY * floater.displaced_volume * q[2]
        parts = system.energy(simulator.coupling.integrator.state)
        kinetic.append(parts[0])
        energies.append(sum(parts) + water)
    assert np.ptp(energies) < 5e-3 * max(kinetic)
