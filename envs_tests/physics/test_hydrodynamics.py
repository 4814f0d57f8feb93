"""Floating platforms: forces and free motion of a rigid model against OpenFAST, passivity, symmetry, energy.

The model has six degrees of freedom. Facts of a platform and lumped masses of its turbine are all that it has; the
tower is rigid. Data of OpenFAST are beside the checkout; without them those tests are skipped.
"""

import io
import lzma
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases.floating import peaks
from wt_gym.base.quantities import MOTIONS
from wt_gym.hydrodynamics import PLATFORMS, PlatformLoads, WaveComponents, load_platform
from wt_gym.hydrodynamics.loads_kernels import accept_step, platform_force, water_motion
from wt_gym.hydrodynamics.mooring_kernels import mooring_force

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "floating"
SHORT = {"oc4_semi": "oc4", "volturnus_s": "volturn"}
needs_data = pytest.mark.skipif(not BESIDE.is_dir(), reason="needs the reference data of floating platforms")


def table(name):
    data = (BESIDE / name).read_bytes()
    text = (lzma.decompress(data) if name.endswith(".xz") else data).decode()
    return np.genfromtxt(io.StringIO(text), delimiter=",", names=True, dtype=None, encoding="utf-8")


# ---- rigid model -----------------------------------------------------------------------------------------------------

TOWERS = {
    "oc4_semi": (10.0, 87.6, np.linspace(0.0, 1.0, 11), [
        4667.0, 4345.28, 4034.76, 3735.44, 3447.32, 3170.40, 2904.69, 2650.18, 2406.88, 2174.77, 1953.87]),
    "volturnus_s": (15.0, 144.386, [
        0.0, 0.111403, 0.222807, 0.334210, 0.445614, 0.557017, 0.668421, 0.779824, 0.891227, 1.0], [
        23006.42, 20389.27, 17746.01, 15062.80, 12342.41, 9633.10, 7026.97, 4645.48, 2596.09, 1715.03]),
}  # fmt: skip
"""Base and top [m], fractions of the height, mass per length [kg/m]."""
TOPS = {
    "oc4_semi": [(240e3, (1.9, 0.0, 89.35), [2e6, 2e6, 2e6]), (110e3, (-5.5, 0.0, 90.0), [3.8e7, 1.9e7, 1.9e7])],
    "volturnus_s": [
        (644857.0, (-5.125, 0.0, 148.701), [2e7, 2e7, 2e7]), (28249.0, (0.0, 0.0, 144.386), [0.0, 0.0, 0.0]),
        (264887.0, (-13.62, 0.0, 150.0), [3.1e8, 1.55e8, 1.55e8])],
}  # fmt: skip
"""Mass, center and inertia of nacelle, yaw bearing, and rotor with parked blades."""


def lump(mass, center, inertia=(0.0, 0.0, 0.0)):
    """Mass matrix about the origin."""
    x, y, z = center
    first = mass * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    r = np.array(center)
    second = np.diag(inertia) + mass * (r @ r * np.eye(3) - np.outer(r, r))
    return np.block([[mass * np.eye(3), first], [first.T, second]])


def turbine_mass(name):
    low, high, share, per_length = TOWERS[name]
    ends = np.linspace(low, high, 201)
    middle, piece = 0.5 * (ends[1:] + ends[:-1]), ends[1] - ends[0]
    mass = np.interp((middle - low) / (high - low), share, per_length) * piece
    parts = [lump(m, (0.0, 0.0, z)) for m, z in zip(mass, middle, strict=True)]
    return sum(parts) + sum(lump(*part) for part in TOPS[name])


class RigidFloater:
    """Newton and Euler for platform and turbine as one body, with the trapezoidal rule."""

    def __init__(self, name, dt=0.1):
        self.platform, self.dt = load_platform(name), dt
        self.loads = PlatformLoads(self.platform, dt)
        self.mass = self.platform.mass_matrix + turbine_mass(name)
        first = self.mass[:3, 3:] / self.mass[0, 0]
        self.center = np.array([first[1, 2], first[2, 0], first[0, 1]])

    def run(self, duration, start=(0.0,) * 6, sea=None):
        """Times and motions (n, 6): position [m] and rotation vector [rad]."""
        self.loads.set_sea(sea)
        p, dt, n = self.loads.arrays, self.dt, round(duration / self.dt)
        x, turn, v, w = np.array(start[:3]), Rotation.from_rotvec(start[3:]), np.zeros(3), np.zeros(3)
        self.loads.restart(x, turn.as_matrix(), v, w)
        water_motion(p, 0.0)
        a = self.acceleration(p, x, turn, v, w)
        motion = np.zeros((n + 1, 6))
        motion[0] = start
        for k in range(1, n + 1):
            water_motion(p, k * dt)
            end = a
            for _ in range(2):
                half = 0.5 * dt * (a + end)
                x1, v1, w1 = x + dt * (v + 0.5 * half[:3]), v + half[:3], w + half[3:]
                turn1 = Rotation.from_rotvec(0.5 * dt * (w + w1)) * turn
                end = self.acceleration(p, x1, turn1, v1, w1)
            accept_step(p)
            x, turn, v, w, a = x1, turn1, v1, w1, end
            motion[k] = *x, *turn.as_rotvec()
        return dt * np.arange(n + 1), motion

    def acceleration(self, p, x, turn, v, w):
        rotation, force = np.ascontiguousarray(turn.as_matrix()), np.zeros(6)
        assert platform_force(p, x, rotation, v, w, force) == 0
        both = block_diag(rotation, rotation)
        m, center = self.mass[0, 0], rotation @ self.center
        inertia = rotation @ self.mass[3:, 3:] @ rotation.T
        weight = np.array([0.0, 0.0, -m * self.platform.gravity])
        force[:3] += weight - m * np.cross(w, np.cross(w, center))
        force[3:] += np.cross(center, weight) - np.cross(w, inertia @ w)
        whole = self.mass + self.platform.radiation.added_mass_infinite
        return np.linalg.solve(both @ whole @ both.T, force)


# ---- against OpenFAST ------------------------------------------------------------------------------------------------


@needs_data
@pytest.mark.parametrize("name", PLATFORMS)
def test_mooring_force_over_offset(name):
    """Within 0.1 % of another catenary; small components within 0.1 % of 1 MN or 10 MN m."""
    p = PlatformLoads(load_platform(name), 0.1).arrays
    for row in table(f"{SHORT[name]}_mooring_offsets.csv"):
        motion, value, *reference = row
        q, out = np.zeros(6), np.zeros(6)
        k = MOTIONS.index(motion.removesuffix("_deg"))
        q[k] = value if k < 3 else np.radians(value)
        rotation = np.ascontiguousarray(Rotation.from_rotvec(q[3:]).as_matrix())
        assert mooring_force(p, q[:3].copy(), rotation, out) == 0
        np.testing.assert_allclose(out[:3], reference[:3], rtol=1e-3, atol=1e3, err_msg=str(row))
        np.testing.assert_allclose(out[3:], reference[3:6], rtol=1e-3, atol=1e4, err_msg=str(row))
        np.testing.assert_allclose(p.line_tension[:, 0], reference[6:], rtol=1e-3)


DECAYS = [("oc4_semi", "heave"), ("volturnus_s", "heave"), *(
    pytest.param(name, motion, marks=pytest.mark.slow) for name in PLATFORMS for motion in ("surge", "pitch", "yaw")
)]  # fmt: skip


@needs_data
@pytest.mark.parametrize(("name", "motion"), DECAYS)
def test_free_decay(name, motion):
    """Period of each cycle within 2 %, damping ratio within 10 %; the whole motion within 4 % of its start.

    The rigid tower makes the pitch of VolturnUS-S 1.6 % faster, so that only its cycles are compared. The pitch shifts
    the maxima of its surge at small amplitude by several seconds, so that only its motion is compared.
    """
    data = table(f"series/{SHORT[name]}_decay_{motion}.csv")
    k = MOTIONS.index(motion)
    scale = 1.0 if k < 3 else np.degrees(1.0)
    t, y = data["time_s"], data[motion + ("_m" if k < 3 else "_deg")]
    start = np.zeros(6)
    start[k] = y[0] / scale
    fine, result = RigidFloater(name).run(t[-1], start)
    result = result[:, k] * scale
    if (name, motion) != ("volturnus_s", "pitch"):
        error = np.interp(t, fine, result) - y
        assert np.sqrt(np.mean(error**2)) < 0.04 * y[0]
    if (name, motion) == ("volturnus_s", "surge"):
        return
    rows = table("decay.csv")
    rows = rows[(rows["platform"] == SHORT[name]) & (rows["motion"] == motion)]
    when, high = peaks(fine, result - rows["equilibrium"][0])
    when_reference, high_reference = peaks(t, y - rows["equilibrium"][0])
    n = len(rows) if len(rows) < 6 else 4  # later cycles of small amplitude depend on the reading of the maxima
    np.testing.assert_allclose(np.diff(when)[:n], np.diff(when_reference)[:n], rtol=0.02)
    ratios = [np.log(h[:-1] / h[1:])[:n] for h in (high, high_reference)]
    np.testing.assert_allclose(*ratios, rtol=0.1)
    damping = np.log(high[:-1] / high[1:])[:n] / (2.0 * np.pi)
    np.testing.assert_allclose(damping, rows["damping_ratio"][:n], rtol=0.1)


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("row", range(6))
def test_regular_waves(row):
    """Amplitude within 4 %, phase within 4° of OpenFAST.

    Pitch at 6 s and 20 s is small and has another reference: at 6 s the flexible tower takes a fifth of it, and at 20 s
    it is the difference of large moments.
    """
    case = table("regular_waves.csv")[row]
    assert case["platform"] == "oc4"
    omega, height = 2.0 * np.pi / case["T_s"], case["wave_amplitude_m"]
    t, motion = RigidFloater("oc4_semi").run(600.0, sea=WaveComponents([omega], [height], [0.0], [0.0]))
    late = t > 200.0
    t, motion = t[late], motion[late]
    columns = [np.ones_like(t), np.cos(omega * t), np.sin(omega * t)]
    for period, ratio in ((112.0, 0.03), (26.0, 0.02), (17.3, 0.02)):  # transients that decay beside
        envelope = np.exp(-ratio * 2.0 * np.pi / period * (t - t[0]))
        columns += [envelope * np.cos(2.0 * np.pi / period * t), envelope * np.sin(2.0 * np.pi / period * t)]
    fit = np.linalg.lstsq(np.column_stack(columns), motion, rcond=None)[0]
    response = (fit[1] - 1j * fit[2]) / height
    for k, name, scale in ((0, "surge_m", 1.0), (2, "heave_m", 1.0), (4, "pitch_deg", np.degrees(1.0))):
        reference = case[f"{name}_per_m"] * np.exp(1j * np.radians(case[f"{name}_phase_deg"]))
        ratio = response[k] * scale / reference
        is_small = k == 4 and case["T_s"] in (6, 20)
        assert abs(abs(ratio) - 1.0) < (0.25 if is_small else 0.04), name
        assert abs(np.degrees(np.angle(ratio))) < 4.0, name


@needs_data
@pytest.mark.slow
def test_irregular_waves():
    """Standard deviations within 3 %, correlation above 0.98 of surge and 0.999 of heave and pitch."""
    data = table("series/oc4_jonswap_H6_T10.csv.xz")
    waves = np.loadtxt(BESIDE / "waves" / "oc4_jonswap_H6_T10.csv", delimiter=",", skiprows=1).T
    sea = WaveComponents(*waves, np.zeros(waves.shape[1]))
    np.testing.assert_allclose(sea.elevation(data["time_s"]), data["wave_m"], atol=2e-3)
    t, motion = RigidFloater("oc4_semi").run(data["time_s"][-1], sea=sea)
    late = data["time_s"] >= 200.0
    for k, name, least in ((0, "surge_m", 0.98), (2, "heave_m", 0.999), (4, "pitch_deg", 0.999)):
        result = np.interp(data["time_s"], t, motion[:, k])[late] * (1.0 if k < 3 else np.degrees(1.0))
        reference = data[name][late]
        assert np.std(result) == pytest.approx(np.std(reference), rel=0.03), name
        assert np.corrcoef(result, reference)[0, 1] > least, name


# ---- radiation -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLATFORMS)
class TestRadiation:
    def test_no_motion_gains_energy(self, name):
        """Least eigenvalue of Re K(jω) at any frequency, also between those of the fit, and stable poles."""
        loads = PlatformLoads(load_platform(name), 0.1)
        response = loads.radiation.response(np.geomspace(0.01, 100.0, 4000))
        size = np.sqrt(np.einsum("kii->ki", np.abs(response)).max(axis=0))
        real = response.real / np.outer(size, size)
        assert np.linalg.eigvalsh(0.5 * (real + np.swapaxes(real, 1, 2)))[:, 0].min() > -1e-12
        assert np.linalg.eigvals(loads.radiation.a).real.max() < 0.0

    def test_fit(self, name):
        """Damping within 5 % of its peak where waves are, 14 % of that of coupling; added mass of slow motion."""
        table = load_platform(name).radiation
        response, kernel = PlatformLoads(load_platform(name), 0.1).radiation.response(table.frequency), table.kernel()
        band = (table.frequency >= 0.25) & (table.frequency <= 1.25)
        for i, j, low in [(k, k, 0.05) for k in range(6)] + [(0, 4, 0.14), (1, 3, 0.14)]:
            error = (response - kernel)[band, i, j].real
            assert np.abs(error).max() < low * np.abs(kernel[:, i, j].real).max(), (i, j)
        slow = np.argmin(np.abs(table.frequency - 0.05))
        added = response[slow].imag / table.frequency[slow] + table.added_mass_infinite
        np.testing.assert_allclose(np.diag(added), np.diag(table.added_mass[slow]), rtol=0.02)

    def test_irregular_frequencies(self, name):
        """A pole of the panels in the added mass, as WAMIT has it of barges, leaves the flow as it is."""
        table = load_platform(name).radiation
        omega, clean = table.frequency, table.kernel().diagonal(axis1=1, axis2=2)
        spurious = table.added_mass_infinite * 0.5 / (2.5301**2 - omega[:, None, None] ** 2)
        found = replace(table, added_mass=table.added_mass + spurious).kernel().diagonal(axis1=1, axis2=2)
        band = (omega >= 0.25) & (omega <= 1.25)
        assert (abs(found - clean)[band].max(axis=0) < 0.03 * abs(clean).max(axis=0)).all()
        assert abs(omega[band] * spurious[band, 2, 2]).max() > 0.3 * abs(clean[:, 2]).max()

    def test_steps_give_the_force_of_a_harmonic_motion(self, name):
        """After the transients, the steps give -Re K(jω) u e^{iωt}, here with small steps; yaw turns the axes."""
        omega, dt, turn = 0.7, 0.02, Rotation.from_rotvec([0.0, 0.0, 0.6])
        loads = PlatformLoads(load_platform(name), dt)
        p, rotation = loads.arrays, turn.as_matrix()
        u = np.array([1.0, 0.5, -0.7, 0.02, 0.01, -0.03])
        states = np.linalg.solve(1j * omega * np.eye(len(loads.radiation.a)) - loads.radiation.a, loads.radiation.b @ u)

        def velocity(t):
            return turn.apply(u[:3]) * np.cos(omega * t), turn.apply(u[3:]) * np.cos(omega * t)

        loads.restart(np.zeros(3), rotation, *velocity(0.0), radiation=states.real)
        for k in range(1, 400):
            platform_force(p, np.zeros(3), rotation, *velocity(k * dt), np.zeros(6))
            accept_step(p)
        expected = (states * np.exp(1j * omega * 399 * dt)).real
        np.testing.assert_allclose(p.radiation_state, expected, atol=2e-4 * np.abs(states).max())


# ---- symmetry and energy ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLATFORMS)
def test_mirrored_world(name):
    """Waves from the other side give the mirror image: surge, heave, pitch the same, sway, roll, yaw the opposite."""
    motions = []
    for side in (1.0, -1.0):
        current = (0.3, side * 0.2) if name == "oc4_semi" else (0.0, 0.0)  # where something has drag
        sea = WaveComponents([0.5, 0.62], [1.5, 1.0], [0.4, 2.0], [side * 0.5, side * 2.1], current=current)
        start = np.array([4.0, side * 3.0, 0.5, side * 0.02, -0.03, side * 0.05])
        motions.append(RigidFloater(name).run(20.0, start, sea)[1])
    sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    np.testing.assert_allclose(motions[0], motions[1] * sign, atol=1e-4 * np.abs(motions[0]).max(axis=0).min())
    assert np.abs(motions[0]).max(axis=0).min() > 1e-3


def test_world_turned_by_a_third():
    """OC4 with three columns moves the same in a world that is turned by 120°, as far as its tables do.

    VolturnUS-S does not: its quadratic damping is one of components, which depends on the axes.
    """
    motions = []
    for turn in (0.0, 120.0):
        turned = Rotation.from_euler("z", turn, degrees=True)
        floater = RigidFloater("oc4_semi")
        floater.mass = floater.platform.mass_matrix + lump(6e5, (0.0, 0.0, 70.0))  # a turbine without overhang
        floater.center = (floater.platform.mass * floater.platform.center + [0.0, 0.0, 6e5 * 70.0]) / floater.mass[0, 0]
        direction = np.radians(30.0 + turn)
        sea = WaveComponents([0.5, 0.62], [1.5, 1.0], [0.4, 2.0], [direction, direction])
        start = np.concatenate([turned.apply([4.0, 3.0, 0.5]), turned.apply([0.02, -0.03, 0.05])])
        motion, back = floater.run(20.0, start, sea)[1], turned.inv()
        motions.append(np.hstack([back.apply(motion[:, :3]), back.apply(motion[:, 3:])]))
    scale = np.abs(motions[0]).max(axis=0)
    assert np.abs((motions[1] - motions[0]) / scale).max() < 2e-3


@pytest.mark.parametrize("name", PLATFORMS)
def test_statics_conserve_energy(name):
    """The work of hydrostatics and lines over a closed path of translation, tilt and yaw is zero."""
    loads, n = PlatformLoads(load_platform(name), 0.1), 400
    phase = 2.0 * np.pi * np.arange(n) / n
    path = np.column_stack([
        8.0 * np.cos(phase), 6.0 * np.sin(phase), np.sin(2 * phase), 0.1 * np.sin(phase), 0.12 * np.cos(2 * phase),
        0.2 * np.sin(phase + 1.0)])  # fmt: skip
    turns = Rotation.from_euler("ZYX", path[:, [5, 4, 3]])
    work, sizes = 0.0, 0.0
    for k in range(n):
        after = (k + 1) % n
        step = np.concatenate([path[after, :3] - path[k, :3], (turns[after] * turns[k].inv()).as_rotvec()])
        half = Rotation.from_rotvec(0.5 * step[3:]) * turns[k]
        part = loads.static_force(0.5 * (path[after, :3] + path[k, :3]), half.as_matrix()) @ step
        work, sizes = work + part, sizes + abs(part)
    assert abs(work) < 1e-4 * sizes
