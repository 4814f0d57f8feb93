"""Floating turbines: the coupled simulator in waves, start, symmetry, energy, linear models; see `cases.floating`."""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases import floating as cases
from envs_tests.physics.cases.floating import platform
from envs_tests.physics.refusals import refuses
from wt_gym.base.errors import ActionError, InflowError, SimulationError
from wt_gym.base.quantities import GRAVITY
from wt_gym.hydrodynamics.loads import PlatformLoads
from wt_gym.hydrodynamics.loads_kernels import platform_force
from wt_gym.hydrodynamics.mooring import line_forces
from wt_gym.hydrodynamics.potential import fit_radiation
from wt_gym.hydrodynamics.waves import SeaState, WaveComponents
from wt_gym.simulation import Simulator, channel_table
from wt_gym.simulation.fidelity import fidelity
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import SteadyInflow

NAMES = {"oc4": cases.OC4, "volturn": cases.VOLTURN}
RATED = {"rotor_speed": 1.267, "pitch": 0.06}
WAVES = WaveComponents([0.5, 0.7], [1.5, 0.5], [0.3, 2.0], [0.4, -0.2])


@cache
def parked(name):
    """A turbine with its rotor at rest and feathered in thin air that does not move."""
    turbine = replace(load_turbine(NAMES[name]), air_density=0.1)
    return Simulator(turbine, SteadyInflow(0.01, hub_height=turbine.hub_height), fidelity("training"))


def released(simulator, displacement, duration, sea=None):
    """Motion (n, 6) of a parked turbine released at a displacement (6,) [m, rad] from its origin, at each step."""
    signals = cases.released(simulator, duration, np.concatenate([displacement, np.zeros(6)]), sea)
    return np.array([platform(at) for at in signals])


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


def test_start_in_a_current_is_a_balance():
    """A start without its drag began 5 m upstream and drifted for minutes."""
    simulator = parked("oc4")
    simulator.sea = WaveComponents([0.6], [0.0], [0.0], [0.0], current=(1.0, 0.5))
    signals = simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0)
    assert np.hypot(signals.platform_surge_acceleration, signals.platform_sway_acceleration) < 1e-6
    assert min(signals.platform_surge, 2.0 * signals.platform_sway) > 3.0
    simulator = parked("volturn")
    simulator.sea = WaveComponents([0.6], [0.0], [0.0], [0.0], current=(1.0, 0.0))
    refuses(InflowError, ("without drag members", lambda: simulator.reset(0.0, pitch=0.5 * np.pi)))
    simulator.sea = None


def test_a_slow_motion_moves_with_the_current():
    """That of still water, a platform at its place there, begins where the current holds it."""
    simulator = running()

    def place(current, **motion):
        simulator.sea = WaveComponents([0.6], [0.0], [0.0], [0.0], current=current)
        signals = simulator.reset(**RATED, **motion)
        return np.array([signals[f"platform_{name}"] for name in ("surge", "sway", "heave", "roll", "pitch", "yaw")])

    still, pushed = place((0.0, 0.0)), place((0.8, 0.3))
    rates = 0.01 * np.ones(6)
    begun = place((0.8, 0.3), platform=np.concatenate([still, rates]))
    simulator.sea = None
    assert pushed[0] - still[0] > 2.0
    assert begun == pytest.approx(pushed, abs=0.02 * (pushed[0] - still[0]))
    assert begun[3:] == pytest.approx(pushed[3:], abs=2e-4)


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


@pytest.mark.parametrize("rotation", ["clockwise", "counter-clockwise"])
def test_the_slow_motion_is_that_without_the_answer_to_the_waves(rotation):
    """A given one comes back, and of the motion that waves alone make nearly nothing is left."""
    simulator = Simulator(load_turbine(NAMES["oc4"]).with_site(rotation=rotation), SteadyInflow(0.01))
    simulator.sea = SeaState("jonswap", 2.0, 10.0, direction=0.5).components(np.random.default_rng(0), 200.0)
    given = np.concatenate([[3.0, 1.0, 0.2, 0.01, 0.03, 0.02], 0.01 * np.ones(6)])
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0, platform=given)
    np.testing.assert_allclose(simulator.slow_platform(), given, atol=1e-9)
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0)
    whole, slow = [], []
    for _ in range(round(60.0 / simulator.time_step)):
        whole.append(platform(simulator.advance(simulator.time_step, pitch=0.5 * np.pi)))
        slow.append(simulator.slow_platform()[:6])
    assert (np.std(slow, axis=0)[:5] < 0.15 * np.std(whole, axis=0)[:5]).all()


def test_a_snapshot_continues_in_its_waves():
    simulator = running()
    course(simulator, WAVES, steps=3)
    state, signals = simulator.state(), []
    for _ in range(2):
        signals.append([simulator.advance(0.2, pitch=0.06, generator_torque=41e3).values for _ in range(5)])
        simulator.restore(state)
    np.testing.assert_array_equal(*signals)
    simulator.sea = None  # from the next start on: a copy before meets the waves, too
    other = copy.deepcopy(simulator)
    assert other.state() == state
    again = [other.advance(0.2, pitch=0.06, generator_torque=41e3).values for _ in range(5)]
    np.testing.assert_array_equal(again, signals[0])
    with pytest.raises(SimulationError, match="another turbine, fidelity or sea"):
        other.restore(state)  # in still water


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
        ("from -1 to 1 rad", lambda: simulator.reset(**RATED, platform=np.full(12, 3.0))),  # degrees
    )
    refuses(
        SimulationError,
        ("wave components", lambda: Simulator(load_turbine(NAMES["oc4"]), SteadyInflow(8.0), sea=SeaState())),
        ("does not float", lambda: Simulator(land, SteadyInflow(8.0), sea=WAVES)),
        ("floats", lambda: Simulator(load_turbine(NAMES["oc4"]), SteadyInflow(8.0), "gebhardt-full")),
    )


@pytest.mark.slow
def test_feedback_damps_the_platform_with_gains_on_land():
    wind, start = SteadyInflow(18.0, 90.0), {"surge": 4.5, "pitch": 4.0, "blade_pitch": 14.9, "rotor_speed": 12.1}
    rows = cases.controlled(NAMES["oc4"], wind, "floating:land_gains=True", 300.0, start)
    assert cases.growth(rows[:, 0], rows[:, 3])[1] > 0.05
    assert np.ptp(rows[rows[:, 0] > 190.0, 3]) < 0.2
    assert rows[-300:, 4] == pytest.approx(12.1, rel=0.005)


@pytest.mark.parametrize("duration", [30, pytest.param(600, marks=pytest.mark.slow)])
def test_energy_of_a_floater_without_damping(duration):
    """The sum of kinetic, elastic, gravitational and hydrostatic energy is constant at small angles.

    Linear hydrostatics have a potential to first order in the angles: at ten times the displacements the sum swings by
    0.3 % of the kinetic energy, with any time step, and does not drift. The step of the training adds 1e-4.
    """
    turbine = load_turbine(NAMES["oc4"])
    bare = replace(turbine.floater, members=(), plates=(), lines=(),
                   radiation=replace(turbine.floater.radiation, damping=0.0 * turbine.floater.radiation.damping,
                                     added_mass=0.0 * turbine.floater.radiation.added_mass
                                     + turbine.floater.radiation.added_mass_infinite),
                   additional_stiffness=np.diag([7e4, 7e4, 0.0, 0.0, 0.0, 1.2e8]))  # fmt: skip
    tower = replace(turbine.tower, damping_ratio=0.0, drag_coefficient=0.0)
    blade = replace(turbine.blade, damping_ratio=0.0)
    still = replace(turbine, floater=bare, tower=tower, blade=blade)
    object.__setattr__(still, "air_density", 1e-7)  # a turbine has at least 0.1
    fine = replace(fidelity("training"), time_step=0.01)
    simulator = Simulator(still, SteadyInflow(0.01, hub_height=still.hub_height), fine)
    start = np.array([0.3, 0.1, 0.05, 0.002, 0.005, 0.005])
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0, platform=np.concatenate([start, np.zeros(6)]))
    system, energies, kinetic = simulator.structure.system, [], []
    floater, density = still.floater, still.floater.water_density
    stiffness = floater.hydrostatic + floater.additional_stiffness
    for _ in range(5 * duration):
        q = platform(simulator.advance(0.2, pitch=0.5 * np.pi))
        water = 0.5 * q @ stiffness @ q - density * GRAVITY * floater.displaced_volume * q[2]
        parts = system.energy(simulator.coupling.integrator.state)
        kinetic.append(parts[0])
        energies.append(sum(parts) + water)
    assert np.ptp(energies) < 1e-4 * max(kinetic)


# ---- linear models ---------------------------------------------------------------------------------------------------

PARKED = {"rotor_speed": 0.0, "pitch": 0.5 * np.pi, "aerodynamics": "none", "generator": "locked"}
PUSHES = tuple(f"wave_force_{motion}" for motion in cases.MOTIONS)


def places(names, *beginnings):
    return [names.index(name) for name in names if name.startswith(beginnings)]


def harmonic(model, omega):
    """Answer of the outputs to the waves of the model, of one frequency."""
    part = model.select(inputs=PUSHES)
    state = np.linalg.solve(1j * omega * np.eye(len(part.A)) - part.A, part.B)
    return (part.C @ state + part.D) @ part.waves.amplitude[0]


@cache
def still(name):
    simulator = parked(name)
    simulator.sea = None
    return simulator.linearize(**PARKED)


def test_linear_tensions_are_those_of_the_catenary():
    """Difference of tensions of displaced fairleads, each line solved by itself."""
    floater, model = load_turbine(NAMES["oc4"]).floater, still("oc4")
    rest, h = platform(model.operating_point.signals), 1e-2

    def tensions(q):
        turn, out = Rotation.from_euler("ZYX", q[[5, 4, 3]]).as_matrix(), []
        for line in floater.lines:
            x, y, z = q[:3] + turn @ line.fairlead - line.anchor
            across, up, low = line_forces(np.hypot(x, y), z, line.length, line.weight(floater.water_density, GRAVITY),
                                          line.axial_stiffness, friction=line.seabed_friction)  # fmt: skip
            out.append((np.hypot(across, up), low))
        return np.array(out).T.ravel()

    wanted = [(tensions(rest + h * row) - tensions(rest - h * row)) / (2.0 * h) for row in np.eye(6)]
    rows = places(model.output_names, "fairlead_tension", "anchor_tension")
    columns = [model.state_names.index(f"platform_{motion}") for motion in cases.MOTIONS]
    np.testing.assert_allclose(model.C[np.ix_(rows, columns)], np.transpose(wanted), rtol=2e-3, atol=30.0)


@pytest.mark.parametrize("name", NAMES)
def test_linear_memory_of_the_water(name):
    """Without the states of the radiation their part of the equations is −M⁻¹ K(iω), K of the radiation."""
    model, floater = still(name), load_turbine(NAMES[name]).floater
    radiation = fit_radiation(floater.radiation)
    own, rates = places(model.state_names, "radiation_"), [f"platform_{motion}_rate" for motion in cases.MOTIONS]
    moved = [model.state_names.index(rate) for rate in rates]
    velocity = model.C[np.ix_([model.output_names.index(rate) for rate in rates], moved)]
    push = model.B[:, places(model.input_names, "wave_force")]
    assert len(own) == len(radiation.a)
    for omega, kernel in zip((0.1, 0.4, 0.9), radiation.response([0.1, 0.4, 0.9]), strict=True):
        states = np.linalg.solve(1j * omega * np.eye(len(own)) - model.A[np.ix_(own, own)], model.A[np.ix_(own, moved)])
        found, wanted = model.A[np.ix_(moved, own)] @ states, -push[moved] @ kernel @ velocity
        size = np.sqrt(np.outer(np.abs(wanted).max(axis=1), np.abs(wanted).max(axis=0)))
        assert np.abs((found - wanted) / size).max() < 1e-5
    assert np.linalg.eigvals(model.A).real.max() < 0.0


@pytest.mark.parametrize("name", NAMES)
def test_linear_periods(name):
    """Those of the smallest cycle of OpenFAST's free decays within 2 %.

    The pitch shifts the maxima of the surge of VolturnUS-S: its last cycle is faster than a small one, see below.
    """
    found = {mode.name.removeprefix("platform_"): 1.0 / mode.frequency for mode in still(name).modes()}
    for run in cases.reference()["decays"]:
        if run["turbine"] == NAMES[name] and (name, run["motion"]) != ("volturn", "surge"):
            assert found[run["motion"]] == pytest.approx(np.diff(run["peak_time"])[-1], rel=0.02), run["motion"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "duration"), [("oc4", 130.0), ("volturn", 150.0)])
def test_linear_period_of_surge(name, duration):
    """That of the simulation released at 0.5 m within 1 %."""
    simulator = parked(name)
    simulator.sea = None
    rest = platform(simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0))
    rows = released(simulator, rest + 0.5 * np.eye(6)[0], duration)[:, 0] - rest[0]
    after = np.flatnonzero(rows[1:] * rows[:-1] < 0.0)
    crossings = simulator.time_step * (after - rows[after] / (rows[after + 1] - rows[after]))
    found = next(mode for mode in still(name).modes() if mode.name == "platform_surge")
    assert 1.0 / found.frequency == pytest.approx(2.0 * (crossings[1] - crossings[0]), rel=0.01)


@pytest.mark.slow
def test_linear_answer_to_waves_is_that_of_openfast():
    """Amplitudes within 5 %, phases within 5°, but of pitch at 20 s, which is the difference of large moments."""
    simulator, motions = parked("oc4"), ("surge", "heave", "pitch")
    for run in (run for run in cases.reference()["waves"] if run["turbine"] == cases.OC4):
        omega, height = 2.0 * np.pi / run["period"], run["amplitude"]
        simulator.sea = WaveComponents([omega], [height], [0.0], [0.0])
        model = simulator.linearize(**PARKED, outputs=[f"platform_{motion}" for motion in motions])
        answer = harmonic(model, omega) / height / cases.UNITS[[0, 2, 4]]
        for k, motion in enumerate(motions):
            size, phase = run[motion]
            ratio = answer[k] / (size * np.exp(1j * np.radians(phase)))
            if (motion, run["period"]) != ("pitch", 20.0):
                assert abs(ratio) == pytest.approx(1.0, abs=0.05), (motion, run["period"])
                assert abs(np.degrees(np.angle(ratio))) < 5.0, (motion, run["period"])


def test_linear_answer_to_waves_is_that_of_the_simulation():
    """Complex amplitude within 3 % of the settled motion in regular waves; the series of the inputs gives it too."""
    simulator, omega = parked("oc4"), 0.2 * np.pi
    simulator.sea = SeaState("regular", 2.0, 10.0).components(np.random.default_rng(0), 200.0)
    model = simulator.linearize(**PARKED, outputs=[f"platform_{motion}" for motion in cases.MOTIONS])
    simulator.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0)
    n = round(10.0 / simulator.time_step)
    for _ in range(5 * n):
        simulator.advance(simulator.time_step, pitch=0.5 * np.pi)
    rows = [platform(simulator.advance(simulator.time_step, pitch=0.5 * np.pi)) for _ in range(n)]
    turn = np.exp(-2j * np.pi * np.arange(1, n + 1) / n)
    settled, answer = 2.0 * (turn[:, None] * np.array(rows)).mean(axis=0), harmonic(model, omega)
    for k in (0, 2, 4):
        assert abs(answer[k] - settled[k]) < 0.03 * abs(settled[k])
    part, time = model.select(inputs=PUSHES), np.linspace(0.0, 20.0, 2001)  # inputs are held: half an interval late
    state = np.linalg.solve(1j * omega * np.eye(len(model.A)) - model.A, part.B @ part.waves.amplitude[0]).real
    course = model.response(time, model.waves.inputs(time), start=state)
    wanted = np.real(answer * np.exp(1j * omega * time)[:, None])
    np.testing.assert_allclose(course[:, 2], wanted[:, 2], atol=0.03 * abs(answer[2]))


@pytest.mark.slow
def test_linear_drag():
    """None in still water; in a current as the floater is pushed; with waves more of it, for small motions too."""
    turbine = load_turbine(NAMES["oc4"])
    bare = replace(turbine, floater=replace(turbine.floater, members=(), plates=()))
    first = Simulator(bare, SteadyInflow(0.01, hub_height=bare.hub_height), fidelity("training")).linearize(**PARKED)
    np.testing.assert_allclose(still("oc4").A, first.A, atol=1e-9 * np.abs(first.A).max())
    simulator, damping = parked("oc4"), []
    for height in (0.0, 2.0):
        simulator.sea = WaveComponents([0.6], [height], [0.0], [0.0], current=(0.8, 0.0))
        model = simulator.linearize(**PARKED)
        rest = platform(model.operating_point.signals)
        loads = PlatformLoads(turbine.floater, 0.1)
        loads.set_sea(WaveComponents([0.6], [0.0], [0.0], [0.0], current=(0.8, 0.0)))
        turn, total = Rotation.from_euler("ZYX", rest[[5, 4, 3]]).as_matrix(), np.zeros(6)
        loads.restart(rest[:3], turn, np.zeros(3), np.zeros(3))
        platform_force(loads.arrays, rest[:3].copy(), turn, np.zeros(3), np.zeros(3), total)
        pushed = total[0] - loads.static_force(rest[:3], turn)[0]
        if height == 0.0:  # lines hold what the current pushes
            assert abs(total[0]) < 1e-4 * pushed
        else:
            assert total[0] < -0.1 * pushed
        assert model.operating_point.residual < 1e-6
        damping.append(next(mode.damping for mode in model.modes() if mode.name == "platform_heave"))
    assert 0.001 < damping[0] < 0.3 * damping[1]


def test_linear_model_in_waves_is_mirrored():
    turbine, models = load_turbine(NAMES["oc4"]), []
    for one, sea in ((turbine, WAVES), (mirrored(turbine), WAVES.mirrored())):
        simulator = Simulator(one, SteadyInflow(0.01, hub_height=turbine.hub_height), fidelity("training"), sea=sea)
        models.append(simulator.linearize(**PARKED, outputs=("platform_sway", "platform_yaw", "platform_heave")))
    time = np.linspace(0.0, 30.0, 301)
    first, second = (model.response(time, model.waves.inputs(time)) for model in models)
    assert np.abs(first).max(axis=0).min() > 1e-4
    np.testing.assert_allclose(second * [-1.0, -1.0, 1.0], first, atol=1e-5 * np.abs(first).max(axis=0).min())


def test_linear_rotor_that_surges_has_the_loads_of_one_in_wind():
    """In multi-blade coordinates: a surge rate has the thrust of the opposite wind, a surge has none.

    The shadow of the tower is one of the wind, not of its relative velocity.
    """
    simulator = running()
    simulator.sea = None
    model = simulator.linearize(**RATED, multiblade=True, n_azimuths=2, outputs=("aero_thrust",))
    names, wind = model.state_names, model.D[0, model.input_names.index("wind_x")]
    assert places(names, "radiation_")
    assert model.C[0, names.index("platform_surge_rate")] == pytest.approx(-wind, rel=0.02)
    assert abs(model.C[0, names.index("platform_surge")]) < 1e-6 * wind
