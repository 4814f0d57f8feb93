"""Controllers against their formulas: filters, transforms, limits, starts, copies and names."""

import copy
import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from scipy.linalg import eigh

from wt_gym.base.errors import ControllerError
from wt_gym.base.quantities import wrapped
from wt_gym.control import Demand, Notch
from wt_gym.control.bladed.records import channels_read
from wt_gym.control.controllers import COMPILED, CONTROLLERS, additions, from_harmonic, retuned_parameters, to_harmonic
from wt_gym.control.controllers.controller import Combined, checked_demand
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, nrel_5mw_parameters
from wt_gym.control.controllers.names import controller_parameters, make_controller
from wt_gym.control.controllers.own import TUNED, found_factor, gain_of_table, record_of, tuned_parameters
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, WindEstimator, pitch_schedule
from wt_gym.control.design import drive_mode, flap_moment_sensitivity, rotor_inertia
from wt_gym.control.rotor import RotorTable, rotor_table
from wt_gym.control.sensors import BandLimitedIntegrator, harmonic_of_blades, to_blades, to_fixed_frame
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.tuning import Cost, TuningTask, _defaults
from wt_gym.simulation.turbine_structure import tower_beam
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.turbines import catalog, load_turbine

RATED = 12.1 * math.pi / 30


def readings(**changes):
    """Every channel that a controller reads, at a plausible point above rated."""
    values = dict.fromkeys(channels_read(3), 0.0) | dict.fromkeys(("wind_x", "lidar_1", "lidar_2", "lidar_3"), 15.0)
    values |= {"generator_speed": RATED * 97, "rotor_speed": RATED, "azimuth": 0.4}
    values |= {"generator_torque": 43_093.5, "generator_power": 5e6}
    for blade, moment in enumerate((8e6, 6e6, 5e6), start=1):
        values |= {f"root_flap_moment_{blade}": moment, f"pitch_{blade}": 0.2}
    return values | changes


def demand(pitch=0.2, torque=43_093.5):
    return Demand(np.full(3, pitch), 0.0, torque)


def varied(k):
    """Readings of step k of a made-up run."""
    return readings(
        azimuth=0.2 * k % (2 * math.pi),
        generator_speed=97 * (RATED + 0.02 * math.sin(0.3 * k)),
        rotor_speed=RATED + 0.02 * math.sin(0.3 * k),
        yaw_error=0.3 + 0.01 * math.sin(k),
        nacelle_acceleration_fore_aft=0.2 * math.sin(0.4 * k),
        nacelle_acceleration_side_side=0.1 * math.cos(0.4 * k),
        root_flap_moment_1=8e6 + 2e6 * math.sin(0.2 * k),
        lidar_1=15.0 + math.sin(0.3 * k),
        lidar_2=15.0 + math.sin(0.3 * k + 1.0),
    )


# ---- filters and transforms ----


def response(notch, frequency, dt=0.02, seconds=80.0):
    """Amplitude of the notch's answer to a sine after the transient, by its correlation with sine and cosine."""
    notch.reset(0.0)
    time = np.arange(0.0, seconds, dt)
    output = np.array([notch.update(math.sin(frequency * t), dt) for t in time])
    late = time >= seconds / 2
    wave = np.exp(-1j * frequency * time[late])
    return 2.0 * abs((output[late] * wave).mean())


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9, 1.0, 1.3])
def test_notch_is_the_published_filter(ratio):
    """|N| = |1 - x^2| / |1 - x^2 + 2 i zeta x|, x over the frequency axis of the bilinear transform."""
    w, dt, zeta = 8.0 * math.pi, 0.02, 0.5  # whole periods of every tenth of w in the 40 s that count
    x = math.tan(0.5 * ratio * w * dt) / math.tan(0.5 * w * dt)
    expected = abs(1.0 - x**2) / abs(1.0 - x**2 + 2j * zeta * x)
    assert response(Notch(w, zeta), ratio * w, dt) == pytest.approx(expected, abs=2e-3)


def test_a_notch_rests_and_passes_what_samples_cannot_show():
    notch = Notch(10.0)
    assert notch.reset(3.0) == 3.0
    assert [notch.update(3.0, 0.05) for _ in range(5)] == [pytest.approx(3.0, rel=1e-12)] * 5
    assert notch.update(7.0, 0.4) == 7.0  # 4 rad a sample
    assert notch.update(7.0, 0.05) == pytest.approx(7.0, rel=1e-12)
    assert Notch(0.0).update(7.0, 0.05) == 7.0


def test_drive_mode_is_that_of_finite_elements(turbine):
    """Three blades of finite elements, in the plane of the rotor, on a hub with the rest of the rotor's inertia.

    The rule takes one shape, that of the static deflection: a frequency from above (Rayleigh), by less than a tenth.
    """
    blade, inertia = turbine.blade, rotor_inertia(turbine)
    z = blade.structure.station
    axis = np.column_stack([0.0 * z, 0.0 * z, z])
    beam = Beam(BeamSections(z, blade.structure.stiffness, blade.structure.inertia, axis), 24)
    free = np.array([6 * node + dof for node in range(1, 25) for dof in (1, 3)])  # edgewise, without coupling to flap
    mass, stiffness = beam.mass[np.ix_(free, free)], beam.stiffness[np.ix_(free, free)]
    turn = np.ones(48)
    turn[::2] = -math.cos(turbine.hub.cone) * (blade.root_radius + beam.nodes[1:])  # y = -x' turn about x
    whole = np.zeros((49, 49))
    whole[0, 0] = inertia / 3.0
    whole[0, 1:] = whole[1:, 0] = mass @ turn
    whole[1:, 1:] = mass
    spring = np.zeros((49, 49))
    spring[1:, 1:] = stiffness
    frequency = np.sqrt(np.maximum(eigh(spring, whole, eigvals_only=True), 0.0))
    mode = drive_mode(turbine)
    assert frequency[0] < 0.05
    assert 1.0 < mode.frequency / frequency[1] < 1.1
    assert mode.clamped_frequency == pytest.approx(math.sqrt(eigh(stiffness, mass, eigvals_only=True)[0]), rel=0.01)
    assert replace(mode, damping_ratio=0.0).amplification() == math.inf


def test_notches_stand_where_the_pitch_loop_would_feed_the_drive():
    frequency = {name: BaselineParameters.by_rule(load_turbine(name)).notch_frequency for name in
                 ("nrel_5mw", "iea_15mw", "gebhardt_45m")}  # fmt: skip
    assert (frequency["nrel_5mw"], frequency["iea_15mw"]) == (0.0, 0.0)
    # the swing at 4 Hz that it ends
    assert frequency["gebhardt_45m"] / (2 * math.pi) == pytest.approx(4.2, rel=0.03)


def test_band_limited_integrator_is_exact_for_any_step():
    # the answer of s/(s + w)^2 to a step is t exp(-w t)
    for dt in (0.05, 0.1, 0.2, 1.0):
        integrator = BandLimitedIntegrator(0.4)
        for k in range(1, round(6.0 / dt) + 1):
            out = integrator.update(1.0, dt)
            assert out == pytest.approx(k * dt * math.exp(-0.4 * k * dt), rel=1e-9)
    integrator.reset(0.7)
    assert [integrator.update(0.7, 0.1) for _ in range(5)] == pytest.approx([0.0] * 5, abs=1e-12)


@pytest.mark.parametrize("harmonic", [1, 2])
@pytest.mark.parametrize("azimuth", [0.0, 0.9, 4.0])
def test_harmonic_and_back(harmonic, azimuth):
    blades = from_harmonic(2.0, -3.0, azimuth, 3, harmonic)
    assert to_harmonic(blades + 5.0, azimuth, harmonic) == pytest.approx((2.0, -3.0))
    assert blades[0] == pytest.approx(2 * math.cos(harmonic * azimuth) - 3 * math.sin(harmonic * azimuth))
    angle = harmonic * (azimuth + 2 * math.pi / 3)
    assert blades[1] == pytest.approx(2 * math.cos(angle) - 3 * math.sin(angle))


@pytest.mark.parametrize("n_blades", [3, 4])
def test_coordinates_of_the_fixed_frame_and_back(n_blades):
    """Blade 1 up has the mean and the tilt, a blade at a right angle the mean and the yaw."""
    assert to_blades((5.0, 2.0, -3.0), 0.0, n_blades)[0] == pytest.approx(7.0)
    assert to_blades((5.0, 2.0, -3.0), 0.5 * math.pi, n_blades)[0] == pytest.approx(2.0)
    blades = to_blades((5.0, 2.0, -3.0), 0.7, n_blades)
    assert to_fixed_frame([blades, blades], 0.7) == pytest.approx(np.array([[5.0, 2.0, -3.0]] * 2))
    assert harmonic_of_blades(2.0, -3.0, 0.7, n_blades) == pytest.approx([blade - 5.0 for blade in blades])


def test_a_fade_by_its_end(turbine):
    assert additions.AboveRated.of_turbine(turbine, 0.03).parameters == additions.FadeParameters(pitch=(0.005, 0.03))
    assert (
        additions.AboveRated.of_turbine(turbine, math.radians(3.0)).parameters == additions.FadeParameters()
    )  # the default
    assert additions.AboveRated.of_turbine(turbine, False) is None
    with pytest.raises(ValueError, match="fade pitch must be two rising numbers"):
        additions.FadeParameters(pitch=(0.02, 0.02))
    early = make_controller("ipc+tower_dampers", turbine, ipc__fade=0.01, fore_aft_damper__fade=False)
    assert early.additions[0].fade.parameters.pitch[1] == 0.01
    assert early.additions[1].fade is None


# ---- the baseline behind the contract ----


# ---- individual pitch ----


def test_integral_pitch_follows_its_formula():
    p = additions.HarmonicPitchParameters(integral_gain=4e-9, limit=1.0, rate_limit=1.0)
    law = additions.HarmonicPitch(p)
    moments = 1e6 * (8.0 + from_harmonic(2.0, -1.0, 0.7))
    for k in range(1, 6):
        pitch = law.step(moments, 0.7, 0.1, lead=0.2)
        assert law.pitch == pytest.approx(np.array([2e6, -1e6]) * 4e-9 * 0.1 * k)
        assert pitch == pytest.approx(from_harmonic(*law.pitch, 0.7 + 0.2))


def test_proportional_part():
    law = additions.HarmonicPitch(
        additions.HarmonicPitchParameters(integral_gain=4e-9, proportional_gain=1e-9, limit=1.0, rate_limit=10.0)
    )
    moments = 1e6 * from_harmonic(2.0, 0.0, 0.0)
    law.step(moments, 0.0, 0.1)
    law.step(moments, 0.0, 0.1)
    assert law.pitch[0] == pytest.approx(2e6 * (2 * 0.1 * 4e-9 + 1e-9))
    law.step(np.zeros(3), 0.0, 0.1)  # the proportional part goes, the integral stays
    assert law.pitch[0] == pytest.approx(2e6 * 2 * 0.1 * 4e-9)


def test_limits_hold_and_do_not_wind_up():
    law = additions.HarmonicPitch(additions.HarmonicPitchParameters(integral_gain=1e-7, limit=0.05, rate_limit=0.02))
    up = 1e6 * from_harmonic(3.0, 4.0, 0.0)
    before = law.pitch
    for _ in range(200):
        law.step(up, 0.0, 0.1)
        assert np.hypot(*(law.pitch - before)) <= 0.02 * 0.1 + 1e-12
        before = law.pitch
    assert np.hypot(*law.pitch) == pytest.approx(0.05)
    assert law.pitch == pytest.approx([0.03, 0.04])
    law.step(-up, 0.0, 0.1)
    assert np.hypot(*law.pitch) < 0.0499  # turns back at once, however long it stood at the limit


def test_band_is_left_alone_and_its_edge_is_held():
    p = additions.HarmonicPitchParameters(integral_gain=4e-9, level=1e6, leak=0.1, limit=1.0, rate_limit=1.0)
    law = additions.HarmonicPitch(p)
    law.step(1e6 * from_harmonic(0.6, 0.7, 0.0), 0.0, 0.1)
    assert not law.pitch.any()
    law.step(1e6 * from_harmonic(1.2, 1.6, 0.0), 0.0, 0.1)  # norm 2: half of it is beyond the band
    assert law.pitch == pytest.approx(np.array([0.6e6, 0.8e6]) * 4e-9 * 0.1)
    held = law.pitch
    law.step(np.zeros(3), 0.0, 0.5)
    assert law.pitch == pytest.approx(held * math.exp(-0.1 * 0.5))


def test_a_share_holds_for_gains_and_limit():
    """Half of it halves the rate of the integral, the proportional part and the room; at none the pitch returns."""
    parameters = additions.HarmonicPitchParameters(
        integral_gain=4e-9, proportional_gain=1e-9, limit=0.05, rate_limit=0.02
    )
    moments = 1e6 * from_harmonic(3.0, 4.0, 0.0)
    law = additions.HarmonicPitch(replace(parameters, rate_limit=1.0))
    law.step(moments, 0.0, 0.1, share=0.5)
    assert law.pitch == pytest.approx(np.array([3e6, 4e6]) * 0.5 * (0.1 * 4e-9 + 1e-9))
    assert law.moment == pytest.approx([3e6, 4e6])
    law = additions.HarmonicPitch(parameters)
    for _ in range(300):
        law.step(moments, 0.0, 0.1, share=0.5)
    assert law.pitch == pytest.approx([0.015, 0.02])
    sizes = []
    for _ in range(20):
        law.step(moments, 0.0, 0.1, share=0.0)
        sizes.append(np.hypot(*law.pitch))
    assert sizes == pytest.approx([max(0.025 - 0.002 * k, 0.0) for k in range(1, 21)], abs=1e-12)


def test_individual_pitch_feathers_the_loaded_blade_fades_and_keeps_the_lower_limit(turbine):
    addition = additions.IndividualPitch(turbine)
    addition.start(readings())
    assert not addition.step(readings(), 0.1, demand(pitch=0.0)).pitch.any()
    addition.start(readings())
    above = addition.step(readings(), 0.1, demand())
    assert above.pitch.mean() == pytest.approx(0.2)
    assert np.argmax(above.pitch) == 0
    strong = additions.IndividualPitch(turbine, fade=False, bandwidth=50.0)
    strong.start(readings())
    assert min(strong.step(readings(), 0.1, demand(pitch=0.01)).pitch.min() for _ in range(50)) == 0.0
    with pytest.raises(ValueError, match="at least 3 blades"):
        additions.IndividualPitch(replace(turbine, n_blades=2))


@pytest.mark.parametrize(("frequency", "damping"), [(None, 1.0), (10.0, 1.0), (6.0, 0.6)])
def test_individual_pitch_leads_by_the_delay_of_the_drive(turbine, frequency, damping):
    drive = replace(turbine.pitch, servo_frequency=frequency, servo_damping=damping)
    addition = additions.IndividualPitch(replace(turbine, pitch=drive), second_harmonic=0.5, fade=False)
    for dt, delay in ((0.1, 0.15 if frequency is None else 0.3), (0.05, 0.075 if frequency is None else 0.25)):
        addition.start(readings())
        made = addition.step(readings(), dt, demand())
        led = 0.4 + RATED * delay
        first, second = (from_harmonic(*h.pitch, led, harmonic=n) for n, h in enumerate(addition.harmonics, start=1))
        assert made.pitch == pytest.approx(0.2 + first + second)
    own = additions.IndividualPitch(turbine, lead=0.3, fade=False)
    own.start(readings())
    made = own.step(readings(), 0.1, demand())
    assert made.pitch == pytest.approx(0.2 + from_harmonic(*own.harmonics[0].pitch, 0.4 + RATED * 0.3))


def test_parameters_of_individual_pitch_by_rule(turbine):
    """In rated rotor speeds and in 12.35 MN m, the reference flap moment; the second harmonic has half the room."""
    first, second = (
        harmonic.parameters
        for harmonic in additions.IndividualPitch(
            turbine, bandwidth=0.3, proportional_time=2.0, level=0.2, leak_time=8.0, limit=0.06, second_harmonic=0.4
        ).harmonics
    )
    gain = 0.3 * RATED / flap_moment_sensitivity(turbine)
    for harmonic, share, room in ((first, 1.0, 1.0), (second, 0.4, 0.5)):
        assert harmonic.integral_gain == pytest.approx(share * gain, rel=1e-6)
        assert harmonic.proportional_gain == pytest.approx(2.0 * share * gain, rel=1e-6)
        assert harmonic.level == pytest.approx(room * 0.2 * 12.35e6, rel=1e-3)
        assert harmonic.limit == pytest.approx(room * 0.06)
        assert (harmonic.leak, harmonic.rate_limit) == (0.125, math.radians(1.5))
    assert (first.harmonic, second.harmonic) == (1, 2)
    assert len(additions.IndividualPitch(turbine).harmonics) == 1


# ---- tower ----


@pytest.mark.parametrize("kind", ["fore-aft", "clockwise", "counter-clockwise"])
def test_a_damper_adds_the_damping_it_is_asked_for(turbine, kind):
    """The 5-MW turbine's nacelle swings out as a mass on a spring that the damper holds.

    Frequencies 0.324 Hz and 0.312 Hz, rotor and nacelle 350 t, of the tower's 347 t the 33/140 of a uniform cantilever
    (NREL/TP-500-38060, Tables 1-1 and 9-1). Fore-aft: rated at 11.4 m/s, where the power falls by 25.52 MW/rad (section
    7.3), hence the thrust by 25.52/11.4 MN/rad. Side-side: the torque of the generator, 97 times that on the high-speed
    shaft, turns with the rotor's sense; the force of a moment at the top is by finite elements of the tower. The
    band-limited integrator passes s^2/(s + w)^2 of the velocity, at the frequency of the tower with w a fifth of it
    1/(1 - 0.2i)^2, whose real part is (1 - 0.04)/1.04^2 = 0.888. Modal masses of the rule and of these figures agree to
    10 %.
    """
    mass, dt = 350e3 + 33.0 / 140.0 * 347e3, 0.01
    if kind == "fore-aft":
        omega, push, damping, place = 2.0 * math.pi * 0.324, 25.52e6 / 11.4, 0.05, 0.2
        damper = additions.ForeAftDamper(turbine, damping=damping, limit=1.0, fade=False)
    else:
        beam = tower_beam(turbine.tower, 20)
        load = np.zeros((beam.n_dof, 2))
        load[-5, 0], load[-3, 1] = 1.0, 1.0  # a force along y, a moment about x
        by_force, by_moment = np.abs(np.linalg.solve(beam.stiffness[6:, 6:], load[6:])[-5])
        omega, damping, place = 2.0 * math.pi * 0.312, 0.03, 0.05
        push = 97.0 * by_moment / by_force * (1.0 if kind == "clockwise" else -1.0)
        damper = additions.SideSideDamper(replace(turbine, rotation=kind), damping=damping, limit=1.0)
    (channel,) = (name for name in damper.channels if "acceleration" in name)
    damper.start(readings())
    velocity, added, peaks = 0.0, 0.0, []
    for _ in range(4000):
        acceleration = -(omega**2) * place - push * added / mass
        before, velocity = velocity, velocity + dt * acceleration
        place += dt * velocity
        made = damper.step(readings(**{channel: acceleration}), dt, demand(torque=3e4))
        added = made.pitch[0] - 0.2 if kind == "fore-aft" else made.generator_torque - 3e4
        if before > 0.0 >= velocity:
            peaks.append(place)
    ratio = math.log(peaks[2] / peaks[8]) / (6 * 2.0 * math.pi)
    assert ratio == pytest.approx(damping * 0.888, rel=0.1)


def test_fore_aft_damper_keeps_the_range_of_the_pitch(turbine):
    """It takes no blade below fine pitch (0 for the 5-MW turbine); where the controller has put one, it stays."""
    damper = additions.ForeAftDamper(turbine, fade=False)
    top = turbine.pitch.max_pitch
    for acceleration, given, expected in (
        (-9.0, (0.001, -0.01, 0.2), (0.0, -0.01, 0.2 - damper.limit)),
        (9.0, (top - 0.001, -0.01, 0.2), (top, damper.limit - 0.01, 0.2 + damper.limit)),
    ):
        damper.start(readings())
        for _ in range(5):
            made = damper.step(
                readings(nacelle_acceleration_fore_aft=acceleration), 0.1, Demand(np.array(given), 0.1, 4e4)
            )
        assert made.pitch == pytest.approx(np.array(expected))
        assert (made.yaw_rate, made.generator_torque) == (0.1, 4e4)


def test_side_side_damper_keeps_to_its_share_of_the_torque(turbine):
    """A tenth of the rated torque, 43 094 N m (NREL/TP-500-38060); half of what there is; no more than the largest."""
    for acceleration, given, expected in (
        (9.0, 3e4, 3e4 + 4309.4),
        (-9.0, 3e4, 3e4 - 4309.4),
        (-9.0, 5e3, 2.5e3),
        (9.0, 47e3, turbine.drivetrain.max_generator_torque),
        (9.0, 0.0, 0.0),
        (9.0, 48e3, 48e3),  # what a base demands beyond it is its own affair
    ):
        damper = additions.SideSideDamper(turbine)
        damper.start(readings())
        for _ in range(5):
            made = damper.step(readings(nacelle_acceleration_side_side=acceleration), 0.1, demand(torque=given))
        assert made.generator_torque == pytest.approx(expected, rel=1e-3)


# ---- yaw ----


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_yaw_error_that_is_gone_again_turns_nothing(turbine, side):
    """The filter begins no further out than the dead band, whatever the first reading was."""
    drive = additions.YawByDeadBand(turbine)
    drive.start(readings(yaw_error=0.5 * side))
    for _ in range(100):
        assert drive.step(readings(yaw_error=0.05 * side), 0.1, demand()).yaw_rate == 0.0
    drive.start(readings(yaw_error=0.5 * side))
    assert drive.step(readings(yaw_error=0.5 * side), 0.1, demand()).yaw_rate == side * drive.rate


def test_a_yaw_drive_that_stopped_rests_until_the_error_is_large_again(turbine):
    """Its slow filter goes on from what the fast one read: 0.1 rad within a dead band of 0.14 rad never starts it."""
    drive = additions.YawByDeadBand(turbine)
    drive.start(readings(yaw_error=0.5))
    assert drive.step(readings(yaw_error=0.5), 0.1, demand()).yaw_rate > 0.0
    while drive.turning:
        drive.step(readings(yaw_error=0.0), 0.1, demand())
    for _ in range(3000):
        assert drive.step(readings(yaw_error=0.1), 0.1, demand()).yaw_rate == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_yaw_waits_turns_and_stops(turbine, side):
    drive = additions.YawByDeadBand(turbine)
    error, turned, waited = side * math.radians(12.0), 0, 0
    drive.start(readings(yaw_error=0.0))
    for _ in range(3000):
        rate = drive.step(readings(yaw_error=error), 0.1, demand()).yaw_rate
        waited += rate == 0.0 and turned == 0
        turned += rate != 0.0
        assert rate in (0.0, side * turbine.nacelle.max_yaw_rate)
        error -= rate * 0.1
    # a first-order filter reaches 8 of 12 degrees after tau ln 3
    assert waited == pytest.approx(10 * 30.0 * math.log(3.0), abs=2)
    assert abs(error) < math.radians(2.0)
    assert drive.turning == 0


def test_a_wind_from_behind_turns_the_nacelle_one_way(turbine):
    """Its vane flips between the ends of the scale."""
    drive, error, total = additions.YawByDeadBand(turbine), math.radians(179.0), 0.0
    drive.start(readings(yaw_error=error))
    rates = set()
    for k in range(6000):
        seen = wrapped(error + math.radians(5.0) * math.sin(0.8 * k))
        rate = drive.step(readings(yaw_error=seen), 0.1, demand()).yaw_rate
        error, total = error - 0.1 * rate, total + 0.1 * rate
        rates.add(rate)
    assert rates == {0.0, drive.rate}
    assert total == pytest.approx(math.radians(179.0), abs=math.radians(8.0))


# ---- rotor table, estimator, ROSCO-like ----


def made_up_table():
    """Smooth coefficients with the optimum 0.5 at 8."""
    ratio, pitch = np.linspace(2, 14, 49), np.radians(np.linspace(0, 24, 25))
    power = 0.5 - 0.02 * (ratio[:, None] - 8.0) ** 2 - 2.0 * pitch
    return RotorTable("made up", 63.0, 1.225, ratio, pitch, power, 0.8 + 0 * power, "test")


def test_table_interpolates_and_finds_its_optimum(tmp_path):
    table = made_up_table()
    assert table.optimum == pytest.approx((8.0, 0.5))
    assert table.power_coefficient(8.0, 0.1) == pytest.approx(0.3)
    assert table.best_pitch(9.0) == 0.0
    table.save(tmp_path / "table.json")
    assert RotorTable.load(tmp_path / "table.json").power == pytest.approx(table.power, abs=1e-5)
    wind, speed = 10.0, 8.0 * 10.0 / 63.0
    assert table.torque(wind, speed, 0.0) * speed == pytest.approx(0.5 * 1.225 * math.pi * 63.0**2 * 1000.0 * 0.5)


def test_stored_tables(turbine):
    ratio, best = rotor_table(turbine).optimum
    assert 7.5 < ratio < 8.5
    assert 0.48 < best < 0.53  # blade-element momentum theory 0.482, the converged lattice 0.49
    ratio, best = rotor_table(load_turbine("iea_15mw")).optimum
    assert 9.5 < ratio < 10.5
    assert best == pytest.approx(0.507, rel=0.02)  # the lattice with three turns of wake, at 10


@pytest.mark.parametrize("name", catalog())
def test_no_turbine_of_the_catalog_is_measured_first(name, tmp_path, monkeypatch):
    """A measurement takes minutes: controllers with a wind estimate begin at once, with an empty cache too."""
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(import_module("wt_gym.control.rotor"), "_known", {})
    assert rotor_table(load_turbine(name)).optimum[1] > 0.2


def steady_wind(wind, **changes):
    """Table of a rotor, its best speed in a wind, and readings in balance, with fine pitch."""
    table, speed = made_up_table(), 8.0 * wind / 63.0
    fine = dict.fromkeys(("pitch_1", "pitch_2", "pitch_3"), 0.0)
    return table, speed, readings(rotor_speed=speed, generator_torque=table.torque(wind, speed, 0.0), **fine | changes)


def test_estimator_decays_at_its_bandwidth_for_any_step():
    table, _, steady = steady_wind(9.0)
    for dt in (0.1, 0.5):
        estimator = WindEstimator(table, 4e7, bandwidth=0.5)
        assert estimator.start(steady) == pytest.approx(9.0, abs=0.25)
        estimator.wind = 9.05
        for _ in range(round(2.0 / dt)):
            estimator.update(steady, dt)
        assert estimator.wind - 9.0 == pytest.approx(0.05 * math.exp(-0.5 * 2.0), rel=0.05)


def test_the_estimator_counts_what_speeds_the_rotor_up():
    """I dw/dt is what of the moment of the air the generator, 90 % behind a gear of 50, does not take."""
    table, inertia, dt, wind = made_up_table(), 4e7, 0.05, 9.0
    pitch = {"pitch_1": 0.0, "pitch_2": 0.02, "pitch_3": 0.04}
    speed, estimator = 8.0 * wind / 63.0, WindEstimator(table, inertia, 50.0, 0.9)
    torque = 0.9 * table.torque(wind, speed, 0.02) * 0.9 / 50.0  # a tenth is left for the rotor
    estimator.start(readings(rotor_speed=speed, generator_torque=torque, **pitch))
    assert estimator.wind < 8.9
    for _ in range(400):
        speed += dt * (table.torque(wind, speed, 0.02) - torque * 50.0 / 0.9) / inertia
        found = estimator.update(readings(rotor_speed=speed, generator_torque=torque, **pitch), dt)
    assert found == pytest.approx(wind, rel=2e-3)


def test_an_estimate_is_held_while_the_rotor_hardly_turns_and_keeps_its_range():
    table = made_up_table()
    still = readings(rotor_speed=0.05, generator_torque=1e6, pitch_1=0.0, pitch_2=0.0, pitch_3=0.0)
    estimator = WindEstimator(table, 4e7, lowest_speed=0.1)
    assert estimator.start(still) == 2.0
    estimator.wind = 7.0
    assert estimator.update(still, 0.1) == 7.0
    assert estimator.update(still | {"rotor_speed": 1.2}, 0.1) == 7.0  # from a rest no acceleration is told
    for torque, limit in ((1e9, 40.0), (-1e9, 2.0)):
        assert estimator.update(still | {"rotor_speed": 1.2, "generator_torque": torque}, 10.0) == limit


def test_an_estimator_that_reads_the_generator_takes_no_torsion_for_wind():
    """Rotor and generator swing against each other, the momentum of both rests."""
    (table, speed, steady), share, largest = steady_wind(9.0), 0.8, {}
    for reads in (0.0, share):
        estimator, error = WindEstimator(table, 4e7, generator_share=reads), []
        for k in range(400):
            swing = 0.01 * math.sin(6.0 * 0.1 * k)
            now = steady | {"rotor_speed": speed + swing, "generator_speed": speed - swing * (1.0 - share) / share}
            error.append(abs((estimator.start(now) if k == 0 else estimator.update(now, 0.1)) - 9.0))
        largest[reads] = max(error[320:])
    assert largest[share] < 1e-6 < 0.2 < largest[0.0]
    assert "generator_speed" in estimator.channels


class KnownWind:
    """An estimator that is told the wind."""

    channels = ("rotor_speed",)

    def __init__(self, wind):
        self.wind = wind

    def start(self, signals):
        return self.wind

    def update(self, signals, dt):
        return self.wind


@pytest.mark.parametrize(
    ("wind", "speed", "pitch", "torque", "shift", "tracked"),
    [
        (15.0, 1.01, 0.2, 0.9, 0.2 / (0.5 * math.pi) - 0.1 * 0.1, 1.0),  # pitched: the torque's set point is lower
        (15.0, 1.0, 0.05, 0.2, 0.05 / (0.5 * math.pi) - 0.1 * 0.8, 1.0),  # torque is missing: the pitch's is higher
        (8.0, 0.8, 0.0, 0.5, -0.1 * 0.5, None),  # between: the ratio is tracked
        (3.0, 0.5, 0.0, 0.1, -0.1 * 0.9, 6.9 / 12.1),  # no slower than 6.9 rpm
    ],
)
def test_torque_and_pitch_integrate_the_errors_of_their_set_points(turbine, wind, speed, pitch, torque, shift, tracked):
    """From a bumpless start the first step adds K_I e dt, the pitch's gain reduced by 1/(1 + pitch/6.3 deg)."""
    p = make_controller("tsr_tracking", turbine).parameters
    p = replace(p, schedule_pitch=0.0 * p.schedule_pitch)
    rated, dt = 122.9096, 0.02
    at = p.speed_per_wind * wind if tracked is None else tracked * rated
    controller = TsrTrackingController(p, KnownWind(wind))
    now = readings(generator_speed=speed * rated)
    controller.start(now, demand(pitch, torque * p.rated_torque))
    made = controller.step(now, dt)
    torque_error = speed * rated - (at - max(shift, 0.0) * rated)
    pitch_error = speed * rated - (1.0 - min(shift, 0.0)) * rated
    expected = torque * p.rated_torque + p.torque_integral_gain * torque_error * dt
    assert made.generator_torque == pytest.approx(expected, rel=1e-5)
    turned = pitch + 0.008068634 / (1.0 + pitch / 0.1099965) * pitch_error * dt
    assert made.pitch == pytest.approx(np.full(3, max(turned, 0.0)), rel=1e-5)


@pytest.mark.parametrize(("speed", "given", "highest"), [(1.05, 1.0, 1.0 / 1.05), (1.0, 1.2, 1.0), (0.8, 1.3, 1.1)])
def test_torque_stays_below_rated_power_and_a_tenth_above_rated(turbine, speed, given, highest):
    """It comes down at 15 kN m/s, however far it stands above; without a limit of the power rated torque is held."""
    p = make_controller("tsr_tracking", turbine).parameters
    controller, now = TsrTrackingController(p, KnownWind(15.0)), readings(generator_speed=speed * 122.9096)
    controller.start(now, demand(0.3, given * 43_093.5))
    assert controller.step(now, 0.02).generator_torque == pytest.approx(given * 43_093.5 - 300.0, abs=1.0)
    for _ in range(100):
        made = controller.step(now | {"generator_speed": speed * 122.9096}, 0.02)
    assert made.generator_torque <= highest * 43_093.6 + 1.0
    held = TsrTrackingController(replace(p, baseline=replace(p.baseline, constant_power=False)), KnownWind(15.0))
    held.start(now, demand(0.3, 43_093.55))
    if speed >= 1.0:
        assert held.step(now, 0.02).generator_torque == pytest.approx(43_093.55, rel=1e-6)


def test_a_baseline_with_a_notch_does_not_answer_its_frequency():
    """After the transient a swing of the speed at 4 Hz leaves the pitch alone, that at 0.1 Hz does not."""
    quiet = replace(nrel_5mw_parameters(), notch_frequency=8.0 * math.pi)
    swing = {}
    for frequency in (0.1, 4.0):
        controller, pitch = DisconController(quiet), []
        controller.start(readings(generator_speed=122.9096), demand(0.2))
        for k in range(4000):
            speed = 122.9096 + 0.5 * math.sin(2.0 * math.pi * frequency * 0.01 * k)
            pitch.append(controller.step({"generator_speed": speed}, 0.01).pitch[0])
        swing[frequency] = np.ptp(pitch[-1000:])
    assert swing[4.0] < 1e-5 < 1e-3 < swing[0.1]


def test_pitch_schedule(turbine):
    winds, pitch = pitch_schedule(rotor_table(turbine), turbine, 8.0)
    assert not pitch[(winds > 6.0) & (winds < 11.0)].any()
    _, shaved = pitch_schedule(rotor_table(turbine), turbine, 8.0, thrust_limit=0.8)
    assert (shaved >= pitch).all()
    assert np.interp(11.0, winds, shaved) > math.radians(1.0)
    table, speed = rotor_table(turbine), turbine.drivetrain.rated_rotor_speed
    unshaved = table.thrust_force(11.0, speed, float(np.interp(11.0, winds, pitch)))
    assert table.thrust_force(11.0, speed, float(np.interp(11.0, winds, shaved))) < 0.85 * unshaved
    large = load_turbine("iea_15mw")
    winds, pitch = pitch_schedule(rotor_table(large), large, rotor_table(large).optimum[0])
    assert np.interp(4.0, winds, pitch) > math.radians(1.0)  # the rotor may not turn slower than 5 rpm
    assert np.interp(9.0, winds, pitch) == 0.0


def test_a_rotor_has_its_retuned_gain_on_every_tower(turbine):
    """What was found for the NREL 5-MW on land holds on the monopile, and for no other rotor or gearbox."""
    gain = retuned_parameters(turbine).torque.region_2_gain
    assert gain == pytest.approx(0.74 * 2.332287)
    assert retuned_parameters(load_turbine("nrel_5mw_monopile")).torque.region_2_gain == gain
    assert found_factor(replace(turbine, name="mine", tower=load_turbine("nrel_5mw_monopile").tower)) == 0.74
    other = replace(turbine.drivetrain, gear_ratio=90.0)
    for changed in (load_turbine("iea_15mw"), replace(turbine, drivetrain=other)):
        assert found_factor(changed) is None
    assert retuned_parameters(turbine, 0.8).torque.region_2_gain == pytest.approx(0.8 * 2.332287)
    table = rotor_table(turbine)  # torque of its gain at the optimum is what the air gives there
    speed = table.optimum[0] * 8.0 / table.radius
    assert gain_of_table(turbine, table) * (97 * speed) ** 2 * 97 == pytest.approx(
        table.torque(8.0, speed, 0.0), rel=1e-3
    )


# ---- every controller ----

OURS = [name for name in CONTROLLERS if name not in (*COMPILED, "floating")]
EVERY = [*OURS, "tsr_tracking+lidar+ipc+tower_dampers+yaw", "tsr_tracking+supervisor+ipc_2p+fault_supervisor"]
DESIGNED = ("linear_pitch", "linear_optimal")
"""Controllers that need a design, shipped for the NREL 5-MW."""


@pytest.mark.parametrize(
    ("name", "turbine_name"),
    [(n, t) for n in EVERY for t in ("nrel_5mw", "iea_15mw") if t == "nrel_5mw" or n not in DESIGNED],
)
def test_start_is_bumpless(name, turbine_name):
    turbine = load_turbine(turbine_name)
    rated = turbine.drivetrain.rated_rotor_speed
    torque = nrel_5mw_parameters().torque.rated_power / 122.9
    if turbine_name == "iea_15mw":
        torque = 15e6 / rated / turbine.drivetrain.generator_efficiency
    now = readings(
        generator_speed=rated * turbine.drivetrain.gear_ratio, rotor_speed=rated, generator_torque=torque, azimuth=0.0,
        root_flap_moment_1=7e6, root_flap_moment_2=7e6, root_flap_moment_3=7e6,
    )  # fmt: skip
    controller = make_controller(name, turbine)
    controller.start(now, demand(0.2, torque))
    made = controller.step(now, 0.1)
    assert made.pitch == pytest.approx(np.full(3, 0.2), abs=0.2 * turbine.pitch.max_rate * 0.1)
    assert made.generator_torque == pytest.approx(torque, rel=5e-3)
    assert made.yaw_rate == 0.0


@pytest.mark.parametrize("name", EVERY)
def test_all_memory_is_copied_and_forgotten_at_a_start_and_only_named_channels_are_read(name, turbine):
    controller = make_controller(name, turbine)

    def demands(controller, first, last):
        steps = (controller.step({c: varied(k)[c] for c in controller.channels}, 0.1) for k in range(first, last))
        return np.array([(*made.pitch, made.yaw_rate, made.generator_torque) for made in steps])

    def run():
        controller.start({c: varied(0)[c] for c in controller.channels}, demand())
        first = demands(controller, 0, 40)
        other = copy.deepcopy(controller)
        later = demands(controller, 40, 60)
        np.testing.assert_array_equal(demands(other, 40, 60), later)
        return np.concatenate([first, later])

    first = run()
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(run(), first)


# ---- names ----


def test_names_and_parameters(turbine):
    assert isinstance(make_controller("discon", turbine), DisconController)
    controller = make_controller("ipc+yaw", turbine, bandwidth=0.3, dead_band=0.1, ipc__limit=0.02)
    assert isinstance(controller, Combined)
    assert isinstance(controller.base, DisconController)
    assert controller.additions[0].harmonics[0].parameters.limit == 0.02
    assert controller.additions[1].dead_band == 0.1
    assert make_controller(controller, turbine) is controller
    assert isinstance(make_controller(lambda t, gain: DisconController(), turbine, gain=1), DisconController)
    one = make_controller("constrained_ipc+yaw:level=0.2,fade=False,yaw__dead_band=0.05", turbine)
    other = make_controller("constrained_ipc+yaw", turbine, level=0.2, fade=False, yaw__dead_band=0.05)
    assert one.additions[0].harmonics[0].parameters == other.additions[0].harmonics[0].parameters
    assert one.additions[0].fade is other.additions[0].fade is None
    assert one.additions[1].dead_band == other.additions[1].dead_band == 0.05
    table = replace(rotor_table(turbine), power=0.9 * rotor_table(turbine).power)
    tracking = make_controller("tsr_tracking", turbine, table=table)
    assert tracking.estimator.table is tracking.parameters.table is table


@pytest.mark.parametrize("name", TUNED)
def test_a_tuned_controller_has_the_parameters_of_its_record(name, turbine):
    record = record_of(name)
    task, best = record["task"], record["best"]["parameters"]
    assert set(task["seeds"]) <= set(TRAINING_WIND_SEEDS)
    assert Cost(**task["cost"]) == Cost()
    assert record["best"] == min(record["trials"], key=lambda trial: trial["cost"])
    assert record["best"]["cost"] < record["trials"][0]["cost"]  # of the defaults
    assert best.items() <= controller_parameters(name).items()
    assert tuned_parameters(name, load_turbine("nrel_5mw_monopile")) == best  # the same rotor
    assert _defaults(name, TuningTask(name).space) == pytest.approx(best)  # with which a search of it begins
    for choice, level in ((name, {}), (f"{name}+yaw:level=0.2", {"constrained_ipc__level": 0.2})):  # an argument wins
        wanted = make_controller(task["controller"], turbine, **best | level).additions[0]
        assert make_controller(choice, turbine).additions[0].harmonics[0].parameters == wanted.harmonics[0].parameters


def test_on_another_turbine_tuned_times_go_with_its_turn(turbine):
    other = load_turbine("iea_15mw")
    home, away = tuned_parameters("tuned_lidar", turbine), tuned_parameters("tuned_lidar", other)
    slower = turbine.drivetrain.rated_rotor_speed / other.drivetrain.rated_rotor_speed
    assert slower > 1.5
    times = {"constrained_ipc__leak_time", "constrained_ipc__proportional_time", "lidar__delay"}
    assert away == pytest.approx({key: value * (slower if key in times else 1.0) for key, value in home.items()})


@pytest.mark.parametrize("kind", [additions.ForeAftDamper, additions.IndividualPitch])
def test_an_addition_alone_is_no_controller(kind, turbine):
    addition = kind(turbine)
    with pytest.raises(TypeError, match=r"a name \(discon, .* got the addition .*: use Combined"):
        make_controller(addition, turbine)
    with pytest.raises(TypeError, match="gave the addition"):
        make_controller(lambda t: addition, turbine)
    with pytest.raises(TypeError, match="the base must be a Controller"):
        Combined(addition)
    with pytest.raises(TypeError, match=r"an addition needs channels, start\(signals\)"):
        Combined(DisconController(), DisconController())
    assert make_controller(Combined(DisconController(), addition), turbine).additions == (addition,)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        *((name, "discon, retuned, tsr_tracking") for name in ("pid", "ipc+discon", "ipc+ipc", "", "discon+")),
        ("discn", r"must be among discon, .*got 'discn'.*did you mean 'discon'\?"),
        ("yaw:deadband=0.1", r"no parameter 'deadband' .*dead_band.*did you mean 'dead_band'\?"),
        ("discon:natural_freq=0.1", r"did you mean 'natural_frequency'\?"),
        ("ipc+yaw:yaw__limit=0.1", "no parameter 'yaw__limit'"),
        ("tower_dampers:damping=0.1", "fore_aft_damper__damping"),
        ("ipc:level=0.1,level=0.2", "every parameter must be given once, got level twice"),
        ("yaw:dead_band=-0.1", r"dead_band of controller 'yaw' must be .* above 0 and at most 3.14159 rad, got -0.1"),
        ("yaw:dead_band=0.1,stop=0.1", "stop must be at least 0 and below dead_band, got 0.1 and 0.1 rad"),
        ("ipc:fade=0.9", r"fade .* true or false, a number from 0.001 to 0.5 rad or a FadeParameters, got 0.9"),
        ("lidar:lidar=3", r"lidar .* must be a Lidar or None \(three gates by the rotor's size\), got 3"),
        ("lidar:filter_length=0.6", "nearest gate of the lidar, 63 m"),
        ("discon:ki=0", r"ki of controller 'discon' must be a number above 0 or None"),
        (
            "discon:thrust_limit=0.8",
            "thrust_limit must be left out for NREL .* of a controller that estimates the wind",
        ),
        ("discon:region_2_gain=2.0,tip_speed_ratio=8.0", "say the same"),
        ("discon+derate_torque+derate_speed", "the base must be one of them, got a PowerTracking"),
        ("fault_supervisor+fault_supervisor", r"one of .* first, then additions \(.*fault_supervisor\), each once"),
    ],
)
def test_what_is_wrong_is_refused_with_what_is_allowed(choice, message, turbine):
    with pytest.raises(ValueError, match=message):
        make_controller(choice, turbine)


def test_an_option_of_other_turbines_may_have_its_default(turbine):
    assert isinstance(make_controller("discon:thrust_limit=None", turbine), DisconController)


def test_wrong_arguments_are_named(turbine):
    with pytest.raises(ValueError, match="level of controller 'ipc' is given twice"):
        make_controller("ipc:level=0.2", turbine, level=0.1)
    with pytest.raises(TypeError, match="no parameters"):
        make_controller(DisconController(), turbine, gain=1.0)
    with pytest.raises(TypeError, match="a name"):
        make_controller(3, turbine)
    with pytest.raises(TypeError, match="must give a Controller"):
        make_controller(lambda t: 3, turbine)
    with pytest.raises(ControllerError, match=r"made for 3 blades, got pitch of shape \(2,\)"):
        DisconController().start(readings(), Demand(np.zeros(2), 0.0, 4e4))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ((0.1, 0.0, 4e4), r"TsrTrackingController \+ YawByDeadBand gave \(0\.1"),
        (Demand(np.zeros(2), 0.0, 4e4), r"pitch demand .* must have shape \(3,\), one angle a blade; got \(2,\)"),
        (Demand(0.1, 0.0, 4e4), r"pitch demand .* must have shape \(3,\), one angle a blade; got \(\)"),
        (Demand(np.array([0.1, math.nan, 0.1]), 0.0, 4e4), "must be finite, got"),
        (Demand(np.zeros(3), math.nan, 4e4), "must be finite, got"),
        (Demand(np.zeros(3), 0.0, math.inf), "must be finite, got"),
        (Demand(np.zeros(3), 0.0, None), "TsrTrackingController"),
        (Demand(["a", "b", "c"], 0.0, 4e4), "TsrTrackingController"),
    ],
)
def test_demands_without_meaning_name_the_controller(made, message, turbine):
    controller = make_controller("tsr_tracking+yaw", turbine)
    with pytest.raises(ControllerError, match=message):
        checked_demand(made, controller, 3)
    assert checked_demand(demand(), controller, 3).generator_torque == demand().generator_torque
