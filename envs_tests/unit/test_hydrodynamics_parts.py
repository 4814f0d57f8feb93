"""Parts of the hydrodynamics against closed forms: catenaries, stiffness, spectra, dispersion, records."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from wt_gym.base.errors import InflowError, SimulationError, TurbineDefinitionError
from wt_gym.hydrodynamics.design import Column, Pontoon, panel_flow
from wt_gym.hydrodynamics.design import _hydrostatics as hydrostatics
from wt_gym.hydrodynamics.drag import DragMember, HeavePlate, drag_points, linear_drag, mean_square
from wt_gym.hydrodynamics.loads import PlatformLoads, WaveResponse
from wt_gym.hydrodynamics.loads_kernels import accept_step, platform_force, water_motion
from wt_gym.hydrodynamics.mooring import MooringLine, line_forces, line_shape
from wt_gym.hydrodynamics.platform import PLATFORMS, Platform, load_platform
from wt_gym.hydrodynamics.potential import ExcitationTable, MeanDrift, RadiationTable
from wt_gym.hydrodynamics.waves import SeaState, WaveComponents, wave_number

STILL = (np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))


class TestMooringLine:
    @pytest.mark.parametrize("h", [1e3, 3e4, 9e5])
    @pytest.mark.parametrize("friction", [0.0, 0.8])
    def test_inextensible_line_on_the_seabed(self, h, friction):
        """Catenary z = H/w (cosh(w x/H) - 1) from the touch-down point, L - s on the seabed."""
        weight, z, length = 700.0, 180.0, 2000.0
        hanging = h / weight * np.arccosh(weight * z / h + 1.0)
        arc = h / weight * np.sinh(weight * hanging / h)
        x = length - arc + hanging
        result = line_forces(x, z, length, weight, 1e14, friction=friction)
        assert result[0] == pytest.approx(h, rel=1e-5)
        assert result[1] == pytest.approx(weight * arc, rel=1e-6)
        assert result[2] == pytest.approx(max(h - friction * weight * (length - arc), 0.0), rel=1e-5, abs=0.1)

    @pytest.mark.parametrize("low", [-40.0, 100.0])
    def test_inextensible_line_that_hangs_free(self, low):
        """Catenary between points at a + low and a + low + x of z = a cosh(x / a)."""
        weight, a, x = 500.0, 300.0, 250.0
        z = a * (np.cosh((low + x) / a) - np.cosh(low / a))
        length = a * (np.sinh((low + x) / a) - np.sinh(low / a))
        result = line_forces(x, z, length, weight, 1e14, rests=False)
        assert result[:2] == pytest.approx((weight * a, weight * a * np.sinh((low + x) / a)), rel=1e-5)
        assert result[2] == pytest.approx(weight * a * np.cosh(low / a), rel=1e-5)

    def test_taut_line_is_a_spring(self):
        h, v, end = line_forces(300.0, 400.0, 490.0, 1e-3, 1e8)
        assert np.hypot(h, v) == pytest.approx(1e8 * (500.0 / 490.0 - 1.0), rel=1e-5)
        assert (v / h, end) == pytest.approx((4.0 / 3.0, np.hypot(h, v)), rel=1e-4)

    def test_slack_line_hangs_straight_down(self):
        h, v, end = line_forces(100.0, 50.0, 200.0, 300.0, 1e12)
        assert v == pytest.approx(50.0 * 300.0, rel=1e-5)
        assert h < 0.1
        assert end < 0.1

    @pytest.mark.parametrize(("rests", "x", "z"), [(True, 790.0, 186.0), (True, 848.0, 186.0), (False, 700.0, -60.0)])
    def test_shape_ends_at_the_fairlead(self, rests, x, z):
        length, weight, stiffness = 850.0, 1065.0, 7.5e8
        h, v, _ = line_forces(x, z, length, weight, stiffness, rests=rests)
        points = line_shape(h, v, length, weight, stiffness, rests=rests, count=2001)
        np.testing.assert_allclose(points[[0, -1]], [[0.0, 0.0], [x, z]], atol=1e-6)
        stretched = length + np.linalg.norm(np.diff(points, axis=0), axis=1).sum() - length
        assert length < stretched < length * (1.0 + 2.0 * np.hypot(h, v) / stiffness + 1e-9)

    @pytest.mark.parametrize(("x", "z"), [(5000.0, 180.0), (np.nan, 180.0), (700.0, -1.0)])
    def test_line_out_of_reach_is_an_error(self, x, z):
        with pytest.raises(SimulationError, match=r"fairlead must be above the seabed .* got"):
            line_forces(x, z, 850.0, 1000.0, 7.5e6)

    def test_floating_line_is_refused(self):
        with pytest.raises(TurbineDefinitionError, match=r"mass_per_length must be above that of the water, 8\.0"):
            MooringLine((0, 0, -200), (0, 0, -10), 100.0, 7.0, 0.1, 1e8).weight(1025.0, 9.81)

    @pytest.mark.parametrize(("part", "value", "message"), [
        ("length", 1000.0, r"length must be at most 982\.7\d* m \(796\.732 m on the seabed, 186 m up .*, got 1000"),
        ("length", 300.0, r"within reach of a line of 300 m, got 796\.732 m across .* above its anchor, 818\.155 m"),
        ("anchor", (-837.6, 0.0, -195.0), r"anchor\[2\] must be on the seabed, -200 m: a line of 835\.35 m hangs down"),
    ])  # fmt: skip
    def test_lines_that_hold_nothing_are_refused(self, part, value, message):
        platform = load_platform("oc4_semi")
        line = replace(platform.lines[1], **{part: value})
        with pytest.raises(TurbineDefinitionError, match=r"Platform\.lines\[1\].*" + message):
            replace(platform, lines=(platform.lines[0], line))


@pytest.mark.parametrize("name", PLATFORMS)
def test_radiation_has_the_sign_of_a_loss(name):
    """A motion that gains energy is refused, and so is half a matrix; noise of a table is not."""
    table = load_platform(name).radiation
    at = int(np.argmax(table.damping[:, 2, 2]))
    heave = np.zeros_like(table.damping)
    heave[:, 2, 2] = table.damping[:, 2, 2]
    replace(table, damping=table.damping - 0.02 * heave[at])
    with pytest.raises(TurbineDefinitionError, match=rf"at {table.frequency[at]:g} rad/s must be positive .* got 1\.0"):
        replace(table, damping=table.damping - 2.0 * heave)
    with pytest.raises(TurbineDefinitionError, match="added_mass_infinite must be symmetric"):
        replace(table, added_mass_infinite=np.triu(table.added_mass_infinite))


def box(**options):
    """Platform of a box 20 m long, 10 m wide, 5 m deep, without waves of its own."""
    length, width, draft, rho, g = 20.0, 10.0, 5.0, 1000.0, 10.0
    stiffness = np.zeros((6, 6))
    volume = length * width * draft
    stiffness[2, 2] = rho * g * length * width
    stiffness[3, 3] = rho * g * (length * width**3 / 12.0 - volume * draft / 2.0)
    stiffness[4, 4] = rho * g * (width * length**3 / 12.0 - volume * draft / 2.0)
    frequency, zeros = np.array([0.1, 2.0]), np.zeros((2, 6, 6))
    values = {
        "name": "box", "mass": 9e5, "center": (0.0, 0.0, -3.0), "inertia": np.diag([1e7, 4e7, 4.5e7]),
        "displaced_volume": volume, "hydrostatic": stiffness, "tower_base": 5.0, "water_depth": 50.0,
        "water_density": rho, "gravity": g, "radiation": RadiationTable(frequency, zeros, zeros, np.zeros((6, 6))),
        "excitation": ExcitationTable(frequency, (0.0, np.pi), *np.ones((2, 2, 2, 6)), is_mirrored=True),
    }  # fmt: skip
    return Platform(**values | options)


class TestHydrostatics:
    def test_box_heaved_and_heeled(self):
        """Buoyancy of the immersed prism, and its moment about the displaced origin (small angle)."""
        loads, angle = PlatformLoads(box(), 0.1), 1e-3
        upright = loads.static_force([3.0, -4.0, -0.3], np.eye(3))
        np.testing.assert_allclose(upright, [0, 0, 1000.0 * 10.0 * 200.0 * 5.3, 0, 0, 0], atol=1e-3)
        heeled = loads.static_force(np.zeros(3), Rotation.from_rotvec([angle, 0, 0]).as_matrix())
        y, z = (points := heeled_box(angle))[0], points[1]
        arm = y * np.cos(angle) - z * np.sin(angle)  # of the center of buoyancy, in global axes
        assert heeled[3] == pytest.approx(1e7 * arm, rel=1e-5)
        assert heeled[2] == pytest.approx(1e7, rel=1e-6)

    def test_stiffness_turns_with_yaw(self):
        loads = PlatformLoads(box(), 0.1)
        tilt, yaw = Rotation.from_rotvec([0.0, 0.02, 0.0]), Rotation.from_rotvec([0.0, 0.0, 0.7])
        plain = loads.static_force(np.zeros(3), tilt.as_matrix())
        turned = loads.static_force(np.zeros(3), (yaw * tilt).as_matrix())
        np.testing.assert_allclose(turned[3:], yaw.apply(plain[3:]), rtol=1e-9, atol=1e-3)

    def test_additional_stiffness_and_offset_buoyancy(self):
        extra = np.diag([1.0, 2.0, 0.0, 0.0, 0.0, 5.0])
        loads = PlatformLoads(box(additional_stiffness=extra, center_of_buoyancy=(0.1, -0.2)), 0.1)
        force = loads.static_force([7.0, -3.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix())
        turned = Rotation.from_rotvec([0.0, 0.0, 0.3]).apply([-0.2 * 1e7, -0.1 * 1e7, 0.0])
        np.testing.assert_allclose(force, [-7.0, 6.0, 1e7, *turned[:2], -1.5], rtol=1e-9)

    def test_refusals(self):
        for options, message in (
            ({"mass": 2e6}, r"Platform\.mass must be at most .* 1e\+06 kg, got 2000000"),
            ({"hydrostatic": np.eye(6)}, "hydrostatic must be 0 in surge"), ({"members": (1,)}, "tuple of DragMember"),
            ({"inertia": np.diag([1.0, 1.0, 2.01])}, "inertia must be that of a body"),
        ):  # fmt: skip
            with pytest.raises(TurbineDefinitionError, match=message):
                box(**options)
        assert box(inertia=np.diag([726.9e6, 726.9e6, 1453.9e6]))  # of a flat barge, as published


def heeled_box(angle):
    """Center of buoyancy (y, z) in axes of a box 10 m wide, 5 m deep heeled by a small angle."""
    area, width, draft = 50.0, 10.0, 5.0
    return -(width**3) / 12.0 * np.tan(angle) / area, -draft / 2.0 + width**3 / 24.0 * np.tan(angle) ** 2 / area


class TestDrag:
    def test_morison_force_of_a_column_and_a_plate(self):
        column = DragMember((0.0, 0.0, 6.0), (0.0, 0.0, -20.0), 4.0, 0.7)
        plate = HeavePlate((3.0, 0.0, -20.0), (0.0, 0.0, -2.0), 50.0, 4.8)
        loads = PlatformLoads(box(members=(column,), plates=(plate,)), 0.1)
        out, base = np.zeros(6), np.zeros(6)
        platform_force(loads.arrays, *STILL, base)
        platform_force(loads.arrays, np.zeros(3), np.eye(3), np.array([3.0, -4.0, 0.5]), np.zeros(3), out)
        across = 0.5 * 1000.0 * 0.7 * 4.0 * 20.0 * 5.0
        along = 0.5 * 1000.0 * 4.8 * 50.0 * 0.25
        expected = [-across * 3.0, across * 4.0, -along, 10.0 * across * 4.0, 10.0 * across * 3.0 + 3.0 * along, 0.0]
        np.testing.assert_allclose(out - base, expected, rtol=1e-9, atol=1e-6)

    @pytest.mark.parametrize(("mean", "deviation"), [(0.0, 0.7), (0.3, 0.5), (-2.0, 0.5), (1.5, 0.0), (0.0, 0.0)])
    def test_mean_of_the_square_of_a_gaussian_velocity(self, mean, deviation):
        def average(u):
            if deviation == 0.0:
                return abs(u) * u
            parts = [(-9.0, -u / deviation), (-u / deviation, 9.0)]
            density = lambda x: abs(u + deviation * x) * (u + deviation * x) * np.exp(-0.5 * x * x)  # noqa: E731
            return sum(quad(density, *part)[0] for part in parts) / np.sqrt(2.0 * np.pi)

        even, slope = mean_square(mean, deviation)
        assert slope == pytest.approx((average(mean + 1e-4) - average(mean - 1e-4)) / 2e-4, abs=1e-3)
        assert even == pytest.approx(average(mean) / mean if mean else slope, abs=1e-6)

    def test_linear_drag_is_the_tangent_in_a_current(self):
        """Mean force, and differences of the kernel's force by velocity, of a tilted column and a tilted plate."""
        parts = {"members": (DragMember((1.0, 2.0, 0.0), (4.0, 0.0, -20.0), 4.0, 0.7),),
                 "plates": (HeavePlate((3.0, 0.0, -20.0), (0.3, 0.2, -2.0), 50.0, 4.8),)}  # fmt: skip
        loads, bare = PlatformLoads(box(**parts), 0.1), PlatformLoads(box(), 0.1)
        loads.set_sea(WaveComponents([0.5], [0.0], [0.0], [0.0], current=(0.8, -0.5)))
        points, none = drag_points(parts["members"], parts["plates"], 1000.0), np.zeros(8)

        def force(velocity):
            out, base = np.zeros(6), np.zeros(6)
            for one, result in ((loads, out), (bare, base)):
                platform_force(one.arrays, *STILL[:2], velocity[:3].copy(), velocity[3:].copy(), result)
            return out - base

        drag = linear_drag(points, np.array([0.8, -0.5, 0.0]), none, none)
        step = 1e-5 * np.eye(6)
        damping = np.array([(force(-row) - force(row)) / 2e-5 for row in step]).T
        np.testing.assert_allclose(drag.force, force(np.zeros(6)), rtol=1e-9, atol=1e-3)
        np.testing.assert_allclose(drag.damping, damping, atol=1e-5 * np.abs(damping).max())
        moved = drag.transfer.sum(axis=1)  # all the water moves as the platform does not
        np.testing.assert_allclose(moved, drag.damping[:, :3], rtol=1e-9, atol=1e-3)

    def test_members_are_cut_at_still_water(self):
        points = drag_points((DragMember((0.0, 0.0, 8.0), (0.0, 6.0, 0.0), 1.0, 1.0),), (), 1000.0)
        assert len(points.across) == 0
        points = drag_points((DragMember((0.0, 0.0, 4.0), (0.0, 3.0, -4.0), 2.0, 0.5),), (), 1000.0, spacing=1.0)
        assert points.across.sum() == pytest.approx(500.0 * np.hypot(1.5, 4.0))
        np.testing.assert_allclose(points.position.mean(axis=0), [0.0, 2.25, -2.0])

    def test_members_without_drag_are_drawn_only(self):
        """VolturnUS-S (NREL/TP-5000-76773, section 2): columns, pontoons 12.5 m wide and 7 m high, struts."""
        loads = PlatformLoads(load_platform("volturnus_s"), 0.1)
        (ends, radius), diameters = loads.outline(), [10.0, *[12.5] * 3, *[7.0] * 6, *[0.9] * 3]
        assert len(loads.arrays.point_across) == 0
        np.testing.assert_allclose(2.0 * radius, diameters)
        np.testing.assert_allclose(ends[:4, :, 2], [[-20.0, 15.0]] * 4)  # draft and freeboard
        np.testing.assert_allclose(np.hypot(*ends[:4, 1, :2].T), [0.0, 51.75, 51.75, 51.75], atol=1e-4)
        left, right = ends[4:10:2], ends[5:10:2]
        np.testing.assert_allclose(np.linalg.norm(left - right, axis=2) + 7.0, 12.5, atol=1e-4)
        np.testing.assert_allclose([left[..., 2], right[..., 2]], -20.0 + 3.5)

    def test_linear_and_quadratic_damping_turn_with_yaw(self):
        linear, quadratic = np.zeros((6, 6)), np.zeros((6, 6))
        linear[0, 0], quadratic[1, 1], quadratic[0, 4] = 3.0, 2.0, 7.0
        loads = PlatformLoads(box(linear_damping=linear, quadratic_damping=quadratic), 0.1)
        turn, out = Rotation.from_rotvec([0.0, 0.0, 0.5]), np.zeros(6)
        velocity, omega = turn.apply([2.0, -3.0, 0.0]), turn.apply([0.0, -1.5, 0.0])
        platform_force(loads.arrays, np.zeros(3), turn.as_matrix(), velocity, omega, out)
        np.testing.assert_allclose(turn.inv().apply(out[:3]), [-6.0 + 7.0 * 2.25, 18.0, 1e7], rtol=1e-9)


class TestRecords:
    @pytest.mark.parametrize("name", PLATFORMS)
    def test_platforms_are_equal_to_their_copies(self, name):
        platform = load_platform(name)
        read = pickle.loads(pickle.dumps(platform))
        assert read == platform
        assert hash(read) == hash(platform)
        assert copy.deepcopy(platform) is platform
        assert not read.excitation.real.flags.writeable
        assert replace(platform, mass=platform.mass + 1.0) != platform

    def test_unknown_platform(self):
        with pytest.raises(TurbineDefinitionError, match=r"oc4_semi, volturnus_s, got 'oc4_sem'; did you mean"):
            load_platform("oc4_sem")


def test_a_step_depends_on_the_state_alone():
    """Passes of a step leave no trace, and a restored state resumes bit for bit."""
    loads, out, again = PlatformLoads(load_platform("oc4_semi"), 0.1), np.zeros(6), np.zeros(6)
    sea = SeaState("jonswap", 5.0, 11.0, duration=300.0).components(np.random.default_rng(1), 200.0)
    loads.set_sea(sea)
    motion = (np.array([2.0, 1.0, 0.2]), Rotation.from_rotvec([0.01, 0.05, 0.03]).as_matrix(), np.ones(3),
              np.full(3, 0.01))  # fmt: skip
    loads.restart(*motion)
    stored = {name: array.copy() for name, array in loads.state().items()}

    def steps(passes):
        for k in range(20):
            water_motion(loads.arrays, 0.1 * k)
            for j in range(passes):
                shifted = motion[0] + 0.1 * k + (0.3 if j < passes - 1 else 0.0)
                assert platform_force(loads.arrays, shifted, *motion[1:], out) == 0
            accept_step(loads.arrays)
        return out.copy()

    first = steps(3)
    assert not np.array_equal(stored["radiation_state"], loads.state()["radiation_state"])
    for name, array in loads.state().items():
        array[:] = stored[name]
    again = steps(1)
    np.testing.assert_array_equal(first, again)


class TestWaves:
    def test_dispersion(self):
        omega, depth, g = np.geomspace(0.01, 6.0, 50), 40.0, 9.81
        k = wave_number(omega, depth, g)
        np.testing.assert_allclose(g * k * np.tanh(k * depth), omega**2, rtol=1e-12)
        assert wave_number(0.01, depth, g) == pytest.approx(0.01 / np.sqrt(g * depth), rel=1e-4)  # long waves
        assert wave_number(5.0, depth, g) == pytest.approx(25.0 / g, rel=1e-12)  # deep water
        with pytest.raises(InflowError, match="must be above 0"):
            wave_number(0.0, depth)

    @pytest.mark.parametrize("kind", ["jonswap", "pierson_moskowitz", "white"])
    def test_variance_is_a_sixteenth_of_the_height_squared(self, kind):
        sea = SeaState(kind, 4.0, 10.0, low_cutoff=0.1, high_cutoff=12.0, duration=3000.0)
        amplitude = sea.components(np.random.default_rng(0), 200.0).amplitude
        assert np.sum(0.5 * amplitude**2) == pytest.approx(1.0, rel=0.01)

    def test_peak_factor_of_the_standard(self):
        factors = [SeaState("jonswap", 4.0, period).gamma for period in (7.0, 9.0, 10.5)]
        assert factors == pytest.approx([5.0, np.exp(5.75 - 1.15 * 4.5), 1.0])
        assert SeaState("jonswap", 4.0, 9.0, peak_factor=3.3).gamma == 3.3
        peak, base = SeaState("jonswap", 4.0, 9.0, peak_factor=3.3), SeaState("pierson_moskowitz", 4.0, 9.0)
        ratio = peak.spectrum(2.0 * np.pi / 9.0) / base.spectrum(2.0 * np.pi / 9.0)
        assert ratio == pytest.approx(3.3 * (1.0 - 0.287 * np.log(3.3)))

    def test_nothing_repeats_within_an_episode(self):
        sea = SeaState("jonswap", 4.0, 9.0, duration=250.0).components(np.random.default_rng(3), 100.0)
        np.testing.assert_allclose(np.diff(sea.frequency), 2.0 * np.pi / 250.0)
        t = np.linspace(0.0, 250.0, 600)
        np.testing.assert_allclose(sea.elevation(t), sea.elevation(t + 250.0), atol=1e-9)
        other = SeaState("jonswap", 4.0, 9.0, duration=250.0).components(np.random.default_rng(4), 100.0)
        assert not np.allclose(sea.phase, other.phase)

    @pytest.mark.parametrize("s", [1.0, 6.5])
    def test_spreading(self, s):
        sea = SeaState("jonswap", 4.0, 9.0, direction=0.4, spreading=s, duration=30000.0)
        assert quad(sea.spreading_density, -np.pi / 2, np.pi / 2)[0] == pytest.approx(1.0, rel=1e-8)
        angle = sea.components(np.random.default_rng(5), 100.0).direction - 0.4
        variance = quad(lambda a: a**2 * sea.spreading_density(a), -np.pi / 2, np.pi / 2)[0]
        assert np.var(angle) == pytest.approx(variance, rel=0.06)
        assert abs(np.mean(angle)) < 4.0 * np.sqrt(variance / len(angle))

    def test_elevation_from_a_file(self, tmp_path):
        path, t, w = tmp_path / "waves.csv", 3.0 + 0.5 * np.arange(400), 2.0 * np.pi / 200.0
        z = 1.2 * np.cos(9 * w * t + 0.3) + 0.7 * np.cos(20 * w * t - 1.0) + 5.0 * np.cos(w * t)  # the last is cut off
        for names in ("time,elevation", ""):
            np.savetxt(path, np.column_stack([t, z]), delimiter=",", header=names, comments="")
            sea = SeaState("file", file=path, duration=200.0).components(np.random.default_rng(0), 200.0)
            np.testing.assert_allclose(sea.elevation(t), z - 5.0 * np.cos(w * t), atol=1e-6)
        for option, message in (({"duration": 300.0}, "of 300 s, got 200"), ({"high_cutoff": 0.5}, "5 s and 75%"),
                                ({"high_cutoff": 2.0 * np.pi}, "5 s and 100%")):  # fmt: skip
            with pytest.raises(InflowError, match=message):
                SeaState("file", file=path, **{"duration": 200.0} | option).components(None, 200.0)
        path.write_text("2.5,nan\n" + path.read_text())
        with pytest.raises(InflowError, match="2 columns of finite times and elevations"):
            SeaState("file", file=path, duration=200.0).components(None, 200.0)

    def test_refusals(self):
        with pytest.raises(InflowError, match=r"kind must be one of still, regular, .* got 'jonswop'; did you mean"):
            SeaState("jonswop")
        with pytest.raises(InflowError, match=r"high_cutoff must be at least two components above"):
            SeaState("white", 1.0, low_cutoff=1.25)
        with pytest.raises(InflowError, match=r"must be at most 3\.55 m, where waves of 4 s break; got 25 m"):
            SeaState("regular", 25.0, 4.0)
        with pytest.raises(InflowError, match="significant_height must be 0 for kind 'still', got 3"):
            SeaState("still", 3.0)
        with pytest.raises(InflowError, match=r"frequencies of waves must be from 0\.03 to .* got 3"):
            PlatformLoads(load_platform("oc4_semi"), 0.1).set_sea(WaveComponents([3.0], [1.0], [0.0], [0.0]))

    def test_water_moves_as_a_potential_flow(self):
        """Surface and seabed conditions, no divergence, no rotation, at points given as members with drag."""
        h, e = 30.0, 1e-4
        ends = [((x, y, z - 1e-6), (x, y, z)) for x, y, z in
                [(2, 3, -e), (2, 3, -h + e), (2, 3, -9), (2 + e, 3, -9), (2, 3 + e, -9), (2, 3, -9 + e)]]  # fmt: skip
        members = tuple(DragMember(start, end, 1.0, 1.0) for start, end in ends)
        loads = PlatformLoads(box(members=members, water_depth=h), 0.1)
        loads.set_sea(WaveComponents([0.9, 0.5], [1.0, 2.0], [0.4, 1.9], [0.6, 2.0], current=(0.25, -0.5)))
        water_motion(loads.arrays, 3.3)
        surface, bottom, middle, *beside = loads.arrays.water_velocity
        up = (loads.components.elevation(3.3 + e, 2, 3) - loads.components.elevation(3.3 - e, 2, 3)) / (2 * e)
        assert surface[2] == pytest.approx(up, rel=1e-4)
        assert bottom[2] == pytest.approx(0.0, abs=1e-5)
        slope = (np.array(beside) - middle) / e  # slope[j, i] = dv_i / dx_j
        assert np.trace(slope) == pytest.approx(0.0, abs=1e-5)
        np.testing.assert_allclose(slope, slope.T, atol=1e-5)
        still = WaveComponents([0.9], [0.0], [0.0], [0.0], current=(0.25, -0.5))
        loads.set_sea(still)
        np.testing.assert_allclose(loads.arrays.water_velocity, [[0.25, -0.5, 0.0]] * 6)

    @pytest.mark.parametrize("time", [0.0, 7.3, 5432.1])
    def test_excitation_is_a_direct_sum(self, time):
        """Re X a e^{iωt} of each component; the other side is the mirror image; linear between headings."""
        platform = load_platform("oc4_semi")
        loads, table = PlatformLoads(platform, 0.1), platform.excitation
        i, j = 9, 2
        omega, beta = table.frequency[[i, i + 4]], table.heading[[j, j + 1]]
        sea = WaveComponents(omega, [1.5, 0.7], [0.3, -2.0], [beta[0], -beta[1]])
        loads.set_sea(sea)
        water_motion(loads.arrays, time)
        sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        first = table.force[i, j] * 1.5 * np.exp(1j * (omega[0] * time + 0.3))
        second = sign * table.force[i + 4, j + 1] * 0.7 * np.exp(1j * (omega[1] * time - 2.0))
        np.testing.assert_allclose(loads.arrays.excitation, (first + second).real, rtol=1e-8, atol=1e-2)
        assert loads.arrays.elevation[0] == pytest.approx(sea.elevation(time), abs=1e-9)
        x, y, z = loads.surface(time, 100.0)[20, 5]
        assert z == pytest.approx(loads.components.elevation(time, x, y))
        middle = table.at(omega[:1], beta.mean())[0]
        np.testing.assert_allclose(middle, table.force[i, j : j + 2].mean(axis=0))

    def test_slow_drift(self):
        """Newman's forces of two waves: a mean Σ a² T, and 2 a1 a2 √(T1 T2) cos of the difference of their phases."""
        force = np.zeros((2, 2, 6))
        force[0, :, 0], force[1, :, 0], force[:, :, 1] = 900.0, 400.0, -100.0
        drift = MeanDrift([0.5, 0.6], [0.0, np.pi], force)
        loads, plain = PlatformLoads(box(drift=drift), 0.1), PlatformLoads(box(), 0.1)
        for one in (loads, plain):
            one.set_sea(WaveComponents([0.5, 0.6], [2.0, 3.0], [0.7, -0.4], [0.1, 0.1]))
        for time in (0.0, 11.0, 40.0):
            water_motion(loads.arrays, time)
            water_motion(plain.arrays, time)
            slow = np.cos(0.1 * time - 1.1)
            expected = [4.0 * 900.0 + 9.0 * 400.0 + 2.0 * 6.0 * 600.0 * slow, -100.0 * (13.0 + 12.0 * slow)]
            result = loads.arrays.excitation - plain.arrays.excitation
            np.testing.assert_allclose(result, [*expected, 0, 0, 0, 0], rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(loads.arrays.elevation, plain.arrays.elevation)
        mass, stiffness = np.diag([1e6, 1e6, 1e6, 1e8, 1e8, 1e8]), np.diag([1e4, 1e4, 2e6, 1e8, 1e8, 1e7])
        first, second = (WaveResponse(one).solve(mass, stiffness).displacement for one in (loads, plain))
        np.testing.assert_array_equal(first, second)  # drift is of second order


class TestDesign:
    def test_hydrostatics_of_a_stepped_column_and_a_pontoon(self):
        """Closed forms of a column away from the axis; a pontoon adds what is outside of it."""
        column = Column((10.0, -4.0), (-20.0, -15.0, 0.0), (6.0, 3.0))
        stiffness, volume, center = hydrostatics([column], 1e4)
        wide, narrow = np.pi * 36.0 * 5.0, np.pi * 9.0 * 15.0
        moment, plane = wide * -17.5 + narrow * -7.5, np.pi * 9.0
        assert volume == pytest.approx(wide + narrow, rel=1e-3)
        np.testing.assert_allclose(center, [10.0, -4.0], atol=1e-2)
        own = np.pi * 3.0**4 / 4.0
        diagonal = [0.0, 0.0, plane, own + plane * 16.0 + moment, own + plane * 100.0 + moment, 0.0]
        np.testing.assert_allclose(np.diag(stiffness) / 1e4, diagonal, rtol=3e-3)
        np.testing.assert_allclose(stiffness[2, 3:5] / 1e4, [-4.0 * plane, -10.0 * plane], rtol=3e-3)
        assert stiffness[3, 4] / 1e4 == pytest.approx(40.0 * plane, rel=3e-3)
        beam = Pontoon((10.0, -4.0), (10.0, 26.0), 2.0, -14.0, -11.0)
        assert hydrostatics([column, beam], 1e4)[1] - volume == pytest.approx(3.0 * 2.0 * 27.05, rel=0.03)

    @pytest.mark.parametrize("part", [
        Column((10.0, -4.0), (-20.0, -15.0, 0.0), (6.0, 3.0)), Column((0.0, 0.0), (-20.0, -15.0), (6.0,)),
        Pontoon((1.0, 2.0), (8.0, -3.0), 3.0, -9.0, -5.0),
    ])  # fmt: skip
    def test_panels_face_the_water(self, part):
        """The volume from the divergence theorem in z and across; the ends of a pontoon are open."""
        panels = part.panels(0.5)
        normal = 0.5 * np.cross(panels[:, 2] - panels[:, 0], panels[:, 3] - panels[:, 1])
        middle = panels.mean(axis=1)
        volume = hydrostatics([part], 1.0)[1]
        assert (normal[:, 2] * middle[:, 2]).sum() == pytest.approx(volume, rel=0.02)
        if isinstance(part, Column):
            assert (normal[:, 0] * middle[:, 0]).sum() == pytest.approx(volume, rel=0.02)

    def test_refusals(self):
        with pytest.raises(TurbineDefinitionError, match=r"radius must be one for each of 2 pieces"):
            Column((0.0, 0.0), (-20.0, -15.0, 0.0), (6.0,))
        with pytest.raises(TurbineDefinitionError, match=r"Pontoon must be a box whose top"):
            Pontoon((0.0, 0.0), (5.0, 0.0), 2.0, -10.0, -12.0)

    @pytest.mark.slow
    def test_tables_of_oc4_from_panels(self):
        """Added mass within 5 %, excitation within 4 % and 3° of WAMIT, heave within 10 % for want of pontoons."""
        pytest.importorskip("capytaine")
        centers = [(14.43376, 25.0), (-28.86751, 0.0), (14.43376, -25.0)]
        hull = [Column((0.0, 0.0), (-20.0, 0.0), (3.25,))]
        hull += [Column(center, (-20.0, -14.0, 0.0), (12.0, 6.0)) for center in centers]
        flow, platform = panel_flow(hull, [0.45, 0.55], [0.0], size=3.0), load_platform("oc4_semi")
        assert flow.displaced_volume == pytest.approx(platform.displaced_volume, rel=0.03)
        assert flow.hydrostatic[2, 2] == pytest.approx(platform.hydrostatic[2, 2], rel=0.03)
        np.testing.assert_allclose(
            np.diag(flow.radiation.added_mass_infinite), np.diag(platform.radiation.added_mass_infinite), rtol=0.05
        )
        np.testing.assert_allclose(
            np.diag(flow.radiation.added_mass[0]), np.diag(platform.radiation.added_mass[0]), rtol=0.05
        )
        ratio = flow.excitation.force[:, 0, [0, 2, 4]] / platform.excitation.at([0.45, 0.55], 0.0)[:, [0, 2, 4]]
        np.testing.assert_allclose(np.abs(ratio[:, [0, 2]]), 1.0, atol=0.04)
        np.testing.assert_allclose(np.abs(ratio[:, 1]), 1.0, atol=0.1)  # the pontoons count in heave
        np.testing.assert_allclose(np.degrees(np.angle(ratio)), 0.0, atol=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 1.0])
@pytest.mark.parametrize(("x", "z"), [(760.0, 186.0), (797.0, 186.0), (830.0, 186.0)])
def test_line_against_moorpy(x, z, friction):
    catenary = pytest.importorskip("moorpy.Catenary").catenary
    length, weight, stiffness = 835.35, 1065.0, 7.536e8
    along, up, h, v, _ = catenary(x, z, length, stiffness, weight, CB=friction)
    result = line_forces(x, z, length, weight, stiffness, friction=friction)
    assert result == pytest.approx((-h, -v, np.hypot(along, up)), rel=1e-6, abs=0.1)
