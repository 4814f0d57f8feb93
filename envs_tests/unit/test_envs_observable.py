"""Channels of an observation and their readers, one by one."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from wt_gym.control import ActionMap, AgentSetpoint, Demand, Lidar
from wt_gym.control.controllers import STATES, YawByDeadBand, make_controller
from wt_gym.control.controllers.linear_optimal import LinearOptimalPitch
from wt_gym.control.design import rotor_inertia
from wt_gym.envs.channels import OBSERVATION_GROUPS, Observable
from wt_gym.envs.dial import DIAL_NAMES, DialCourse, DialOptions, DialTerm
from wt_gym.envs.lidar import LidarTerm
from wt_gym.envs.observations import ObservationOptions, Observer
from wt_gym.envs.power_reference import AHEAD, GridOptions, PowerReference, PowerReferenceTerm
from wt_gym.simulation.channels import Signals, channel_table
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")
ACTION = ActionMap(TURBINE, 0.2, "residual", "fixed-frame", None, None, (8.0, 16.0), 0.0)
LIDAR = Lidar.for_rotor(TURBINE.rotor_diameter)
SINGLES = (
    "pitch_rate", "pitch_demand", "pitch_2", "pitch_rate_3", "pitch_demand_1", "tip_in_plane_tilt",
    "root_edge_moment_yaw", "tower_base_side_side_moment",
)  # fmt: skip
AFLOAT = "platform", "platform_position", "wave"
CHOICE = (*(group for group in OBSERVATION_GROUPS if group not in AFLOAT), *SINGLES)
LINEAR = LinearOptimalPitch.of_turbine(TURBINE)
CONTROLLER = make_controller("discon+linear_pitch+yaw+supervisor", TURBINE)
SUPERVISOR = SimpleNamespace(state_index=2, mean_wind=9.5, set_point=0.9, load=0.4)
DEMANDED = (4e6, 3.9e6, 3.7e6, 3.2e6)


def signals(step=0):
    """Every signal another number; angles within a turn."""
    values = np.random.default_rng(step).uniform(0.5, 1.0, len(channel_table(3)))
    return Signals(values, 3)


def turning():
    """A yaw drive that has just started to the right, by an error of -0.2 rad behind the slow filter."""
    drive = YawByDeadBand(TURBINE, slow=0.0)
    drive.start({"yaw_error": -0.2})
    drive.step({"yaw_error": -0.2}, 0.1, Demand(np.zeros(3), 0.0, 0.0))
    return drive


class Scene:
    """Operation of a turbine whose readings are given; it has all that a controller can have."""

    demand, base = Demand(np.array([0.1, 0.2, 0.3]), 0.0, 3e4), Demand(np.full(3, 0.15), 0.0, 2e4)
    setpoint = AgentSetpoint([0.01, 0.02, 0.03], 0.0, 4e3)
    supervisor, yaw_drive, residual = SUPERVISOR, None, None
    reference = PowerReference("series", (0.0, 2.0, 5.0, 10.0), DEMANDED)
    demanded_power = DEMANDED[0]

    def __init__(self, controller=None):
        self.controller, self.instruments, self.now = controller, None, signals()
        self.yaw_drive, self.signals = turning(), {"time": 0.0}
        self.dial = DialTerm(DialOptions(weights="simplex"), ["power"], self)
        self.dial.course = DialCourse((0.0,), ((0.5, 2.0, 0.5),))

    def readings(self):
        return self.now

    def seen(self):
        return np.array([9.0, 10.0, 11.0])

    def known_disturbances(self):
        return np.arange(6.0 * len(LINEAR.bins) + 27.0)

    def features(self):
        terms = self.dial, PowerReferenceTerm(TURBINE, GridOptions(reference="steps")), LidarTerm(0.0, LIDAR)
        return {name: channels for term in terms for name, channels in term.groups().items()}


def made(choice, controller=None, features=None, **options):
    """Observer of a scene."""
    scene = Scene(controller)
    return Observer(TURBINE, ACTION, scene, ObservationOptions(**options), choice, features=features or {}), scene


@pytest.fixture(scope="module")
def observer():
    return made(CHOICE, CONTROLLER, Scene().features())[0]


def observed(observer):
    """Physical values by name after a start and a step of 0.2 s."""
    scene, action = observer._operation, np.linspace(-1.0, 1.0, ACTION.size)
    scene.now = signals(0)
    observer.reset(action)
    scene.now = signals(1)
    observer.advance(0.2)
    values, kept = {}, observer.layout.normalize
    try:
        observer.layout.normalize = lambda found: (values.update(zip(observer.layout.names, found, strict=True)), ())
        observer.observe(action, np.random.default_rng(0))
    finally:
        observer.layout.normalize = kept
    return values


def test_each_channel_is_read_from_what_it_names(observer):
    before, now, case, values = signals(0), signals(1), Scene(), observed(observer)
    for name in ("rotor_speed", "generator_power", "tip_out_of_plane_2", "tower_top_side_side", "pitch_2",
                 "nacelle_acceleration_fore_aft", "tower_base_side_side_moment"):  # fmt: skip
        assert values[name] == now[name]
    assert values["pitch_rate_3"] == pytest.approx((now["pitch_3"] - before["pitch_3"]) / 0.2, rel=1e-14)
    assert values["pitch_rate"] == pytest.approx((now.pitch.mean() - before.pitch.mean()) / 0.2, rel=1e-12)
    assert [values["pitch_demand"], values["pitch_demand_1"]] == pytest.approx([0.2, 0.1])
    assert [values["controller_pitch"], values["controller_torque"]] == pytest.approx([0.15, 2e4])
    assert values["generator_torque_demand"] == 3e4
    assert [values[f"pitch_offset_{k}"] for k in (1, 2, 3)] == case.setpoint.pitch
    assert values["torque_offset"] == 4e3
    assert [values[f"lidar_{k}"] for k in (1, 2, 3)] == [9.0, 10.0, 11.0]
    n = len(LINEAR.bins)
    assert [values[f"disturbance_{name}_2"] for name in ("flap_mean", "flap_tilt", "rotor_speed")] == [
        1,
        n + 1,
        5 * n + 1,
    ]
    names = ("linear_pitch_mean", "linear_pitch_yaw", "linear_pitch_share", "linear_pitch_schedule")
    assert [values[name] for name in names] == [6 * n, 6 * n + 2, 6 * n + 3, 6 * n + 4]
    names = ("model_gain_flap_mean", "model_lag_rotor_speed", "response_flap_mean", "response_rotor_speed",
             "tower_velocity_fore_aft", "tower_velocity_side_side", "tower_displacement_side_side")  # fmt: skip
    assert [values[name] for name in names] == [6 * n + k for k in (5, 16, 17, 22, 23, 24, 26)]
    assert [values[f"previous_{name}"] for name in ACTION.names] == np.linspace(-1.0, 1.0, ACTION.size).tolist()
    assert values["azimuth_sin"] == math.sin(now["azimuth"])
    assert values["azimuth_cos"] == math.cos(now["azimuth"])
    assert [values["dead_band_error"], values["dead_band_turning"]] == [-0.2, -1.0]
    assert [values[f"dial_{name}"] for name in DIAL_NAMES] == [-1.0, 1.0, -1.0]
    assert [values[f"state_{name}"] for name in STATES] == [float(k == 2) for k in range(len(STATES))]
    assert [values["mean_wind"], values["set_point"], values["load_share"]] == [9.5, 0.9, 0.4]
    assert [values["demanded_power"], *(values[f"demanded_power_in_{ahead:g}_s"] for ahead in AHEAD)] == list(DEMANDED)
    assert values["power_error"] == now["generator_power"] - 4e6
    inertia = rotor_inertia(TURBINE)
    assert values["rotor_energy"] == pytest.approx(0.5 * inertia * now["rotor_speed"] ** 2)
    psi = now["azimuth"] + 2.0 * math.pi / 3.0 * np.arange(3)
    assert values["root_edge_moment_yaw"] == pytest.approx(2.0 / 3.0 * np.dot(np.sin(psi), now.root_edge_moment))
    assert values["root_flap_moment_mean"] == pytest.approx(now.root_flap_moment.mean())
    assert values["tip_in_plane_tilt"] == pytest.approx(2.0 / 3.0 * np.dot(np.cos(psi), now.tip_in_plane))


def test_every_channel_has_a_reader_and_another_name():
    _, channels = Observable(TURBINE, ACTION, Scene().features(), CONTROLLER).choose(CHOICE)
    assert len({one.channel.name for one in channels}) == len(channels) > 40
    for one in channels:
        assert bool(one.signal) != (one.function is not None)
        if one.signal and one.part is None:
            assert one.signal == one.channel.name
    assert [one.channel.name for one in channels if one.circular] == ["yaw_error", "dead_band_error"]
    estimating = [one.channel.name for one in channels if one.estimates]
    assert estimating == ["rotor_wind", "power_headroom"]


def test_parities_of_signals_are_those_of_the_simulator():
    parities = {channel.name: channel.parity for channel in channel_table(3)}
    _, channels = Observable(TURBINE, ACTION, Scene().features(), CONTROLLER).choose(CHOICE)
    found = {one.channel.name: one.channel.parity for one in channels}
    assert {name: parities[name] for name in found if name in parities} == {
        name: parity for name, parity in found.items() if name in parities
    }
    assert [name for name, parity in found.items() if parity < 0 and name not in parities] == [
        "previous_yaw_rate", "dead_band_error", "dead_band_turning",
    ]  # fmt: skip


def test_the_measurable_group_has_no_channel_that_a_turbine_does_not_measure():
    """On top of a controller moments are in the fixed frame; for actions of each blade and without it of each blade."""
    common = {"rotor_speed", "generator_speed", "generator_power", "generator_torque", "generator_torque_demand",
              "wind_speed", "yaw_error", "azimuth_sin", "azimuth_cos", "nacelle_acceleration_fore_aft",
              "nacelle_acceleration_side_side"}  # fmt: skip
    for mode, pitch, parts, own in (
        ("residual", "fixed-frame", ("mean", "tilt", "yaw"), 6),
        ("residual", "individual", ("1", "2", "3"), 6),
        ("rate", "individual", ("1", "2", "3"), 0),
    ):
        action = ActionMap(TURBINE, 0.2, mode, pitch, None, None, (8.0, 16.0), 0.0)
        groups, channels = Observable(TURBINE, action).choose(("measurable",))
        names = [one.channel.name for one in channels]
        blades = {f"{name}_{b}" for name in ("pitch", "pitch_rate", "pitch_demand") for b in (1, 2, 3)}
        moments = {f"root_{kind}_moment_{part}" for kind in ("flap", "edge") for part in parts}
        remembered = {name for name in names if name.startswith(("controller_", "pitch_offset_", "torque_offset"))}
        assert groups == ("measurable",)
        assert len(set(names)) == len(names)
        assert set(names) == common | blades | moments | remembered
        assert len(remembered) == own


def test_groups_that_overlap_give_each_channel_once():
    _, channels = Observable(TURBINE, ACTION).choose(("measurable", "fixed_frame", "rotor", "pitch_2"))
    names = [one.channel.name for one in channels]
    assert len(set(names)) == len(names)


# ---- washout ----

LOADS = ("root_flap_moment_1", "root_flap_moment_tilt", "root_edge_moment_mean", "tower_base_fore_aft_moment",
         "nacelle_acceleration_side_side")  # fmt: skip


def washed(steps, tau=20.0, trail=None, dt=0.1, offsets=None):
    """Physical values of `LOADS` and of the rotor speed behind a washout, one row an instant."""
    observer, scene = made((*LOADS, "rotor_speed"), washout=tau)
    scene.instruments = None if offsets is None else SimpleNamespace(offset=offsets)
    layout, rows, action = observer.layout, [], np.zeros(ACTION.size)
    for k, now in enumerate(steps):
        scene.now = now
        if k == 0:
            observer.reset(action, trail)
        else:
            observer.advance(dt)
        found, _ = observer.observe(action, np.random.default_rng(0))
        rows.append([layout.value(found.astype(float), name) for name in layout.names])
    return np.array(rows)


def loaded(offset, azimuth=0.3, swing=0.0):
    """Signals whose loads are an offset and a swing, in the size of real ones."""
    now = signals(0)
    for b in range(3):
        now.set(f"root_flap_moment_{b + 1}", 4e6 + offset * 1e6 + swing * math.cos(azimuth + 2.0 * math.pi * b / 3.0))
        now.set(f"root_edge_moment_{b + 1}", offset * 1e5)
    now.set("tower_base_fore_aft_moment", 3e7 + offset * 1e7)
    now.set("nacelle_acceleration_side_side", 0.1 * swing / 1e6)
    now.set("azimuth", azimuth)
    return now


def test_a_washout_sees_no_static_offset_and_leaves_the_rest_alone():
    """Two codes whose loads differ by a constant look the same; a step passes and decays with the time constant."""
    first, second = washed([loaded(0.0)] * 50), washed([loaded(0.7)] * 50)
    np.testing.assert_allclose(first[:, :-1], 0.0, atol=2.0)
    np.testing.assert_allclose(second[:, :-1], 0.0, atol=2.0)
    np.testing.assert_allclose(first[:, -1], loaded(0.0)["rotor_speed"], rtol=1e-6)
    step = washed([loaded(0.0)] + [loaded(0.5)] * 200, tau=10.0)
    expected = 0.5 * np.exp(-0.1 * np.arange(1, 201) / 10.0)
    np.testing.assert_allclose(step[1:, 2] / 1e5, expected, rtol=1e-4)
    np.testing.assert_allclose(step[1:, 3] / 1e7, expected, rtol=1e-4)


def test_a_blade_starts_from_the_mean_of_the_blades_and_an_acceleration_from_zero():
    (found,) = washed([loaded(0.0, swing=1e6)])
    assert found[0] == pytest.approx(1e6 * math.cos(0.3), rel=1e-5)
    assert found[4] == pytest.approx(0.1, rel=1e-5)


def test_offsets_of_sensors_do_not_pass_a_washout_at_a_running_start():
    """The signals before a start are true ones, those since are what the sensors read."""
    offsets = np.zeros(len(channel_table(3)))
    index = {channel.name: k for k, channel in enumerate(channel_table(3))}
    offsets[index["tower_base_fore_aft_moment"]] = 4e6
    offsets[index["nacelle_acceleration_side_side"]] = 0.05
    trail, read = loaded(0.0).values, loaded(0.0)
    read.values[:] += offsets
    (found,) = washed([read], trail=trail, offsets=offsets)
    assert found[3] == pytest.approx(0.0, abs=10.0)
    assert found[4] == pytest.approx(0.0, abs=1e-6)
    (passed,) = washed([read], trail=trail)
    assert passed[3] == pytest.approx(4e6, rel=1e-4)


def test_a_washout_starts_from_the_means_of_what_was_recorded_before():
    """What is not recorded starts from the present value."""
    trail = loaded(0.0, swing=1e6).values
    index = [channel.name for channel in channel_table(3)].index("root_edge_moment_1")
    trail[index : index + 3] = np.nan
    assert channel_table(3)[index + 2].name == "root_edge_moment_3"
    (found,) = washed([loaded(0.5, swing=1e6)], trail=trail)
    assert found[0] == pytest.approx(5e5 + 1e6 * math.cos(0.3), rel=1e-5)
    assert found[2] == pytest.approx(0.0, abs=1.0)
    assert found[3] == pytest.approx(5e6, rel=1e-5)


def test_a_washed_channel_says_so_and_has_no_offset():
    _, channels = Observable(TURBINE, ACTION, washout=15.0).choose(("measurable", "fixed_frame", "tower"))
    for one in channels:
        name = one.channel.name
        is_cyclic = name in {
            f"{stem}_{axis}" for stem in ("root_flap_moment", "tip_out_of_plane") for axis in ("tilt", "yaw")
        }
        is_load = name.startswith(("root_", "tip_", "tower_", "nacelle_"))
        assert one.washed == (is_load and not is_cyclic) == ("high-pass filter of 15 s" in one.channel.description)
        assert not one.washed or one.channel.offset == 0.0


def test_cyclic_moments_keep_their_mean_which_offsets_of_strain_gauges_do_not_change():
    """Shear is seen however long it lasts; a gauge that reads too much turns with the rotor, so its mean is zero."""
    azimuths = np.linspace(0.0, 2.0 * math.pi, 60, endpoint=False)
    (sheared,) = {round(row[1], 2) for row in washed([loaded(0.0, azimuth, swing=1e6) for azimuth in azimuths])}
    assert sheared == pytest.approx(1e6, rel=1e-5)
    biased = [loaded(0.0, azimuth) for azimuth in azimuths]
    for now in biased:
        now.set("root_flap_moment_2", now["root_flap_moment_2"] + 5e5)
    tilt = washed(biased)[:, 1]
    assert tilt.mean() == pytest.approx(0.0, abs=1.0)
    assert np.ptp(tilt) > 5e5
