"""Stall: the S809 airfoil that pitches far, and the rotor of the Unsteady Aerodynamics Experiment."""

import json
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from envs_tests.physics.cases.airfoils import UniformStream, WingFlow, exact_lift, two_dimensional_planform
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.cases.tools import blade_element
from envs_tests.physics.validation import DATA, CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.aerodynamics import AeroOptions, build_planform, span_distribution
from wt_gym.aerodynamics.lattice.planform import separation_tables
from wt_gym.simulation.models import N_ALPHA
from wt_gym.turbines import RotationalAugmentation
from wt_gym.turbines.airfoil import Polar, blend_polars
from wt_gym.turbines.blade_element import BladeElementRotor

# ---- NREL UAE Phase VI ----------------------------------------------------------------------------------------------
# At 7 m/s the flow is attached over most of the blade, so that lifting-surface theory with the polars of its S809
# airfoil should give the measured torque; from 10 m/s on the rotor stalls and becomes a test of stall delayed by
# rotation.

UAE_SOURCE = "Hand et al. 2001, NREL/TP-500-29955; sequences H and S, 72 rpm, tip pitch 3 deg"
AIR_DENSITY = 1.225
"""Standard air [kg/m^3]; the tunnel's own was about 2 % higher, and the torque is proportional to it."""
OPTIONS = AeroOptions(
    n_chord=2, n_span=16, azimuth_step_deg=10.0, wake_rows=108, full_rows=108, fresh_rows=36, refresh_stride=6,
    far_wake_rows=54, squire=1e-3,
)  # fmt: skip
"""Three turns of free wake, continued by vortex cylinders; the wake drifts 1.1 radii a turn."""
COARSE = replace(
    OPTIONS, n_chord=1, n_span=10, azimuth_step_deg=15.0, wake_rows=60, full_rows=60, fresh_rows=24, far_wake_rows=36
)
TURNS = 7.0
SECTIONS = (0.30, 0.47, 0.63, 0.80, 0.95)
"""Radii of the pressure taps, in rotor radii."""
CYLINDER_END, AIRFOIL_START = 0.8835, 1.2575
"""Radii between which the root cylinder turns into the airfoil [m]."""
STALL_SOURCE = "UAE Phase VI, sequence H, record means: torque LSSTQCOR, thrust EAEROTH, normal force coefficients"
MEASURED = {
    7.0: (789.9, 1132.0, (0.814, 0.920, 0.867, 0.767, 0.517)),
    10.0: (1291.6, 1632.0, (1.341, 1.401, 1.000, 0.986, 0.748)),
    13.0: (1297.2, 1987.0, (2.032, 1.200, 1.203, 0.839, 0.911)),
    15.0: (1269.7, 2248.0, (2.349, 1.164, 1.306, 0.844, 0.849)),
    20.0: (1240.7, 3152.0, (2.392, 1.486, 1.153, 1.178, 0.828)),
    25.0: (1580.4, 4029.0, (2.248, 1.568, 1.204, 1.277, 0.775)),
}
"""Wind [m/s]: shaft torque [N m], thrust of the pressures [N], normal force coefficients at `SECTIONS`."""
ASPECT_RATIO = 11.0
"""Of the blade, in the continuation of the polar (Viterna & Corrigan 1982), as for the certification model."""


class PhaseSixBlade:
    """Planform, camber and polars of the blade; positions are distances from its root [m].

    ``polars``: "model": with stall delay along the span, from the certification model; "measured": one two-dimensional
    polar, continued by Viterna's method up to 90 degrees and beyond by the certification model's outermost one;
    ``augmentation``: model of the delay of stall by rotation, for two-dimensional polars, at the tip-speed ratio of
    ``wind``; ``wind`` [m/s].
    """

    def __init__(self, polars: str = "model", augmentation: str | None = None, wind: float = 7.0):
        self.data = json.loads((DATA / "uae_phase_vi.json").read_text(encoding="utf-8"))
        blade = {name: np.array(values) for name, values in self.data["blade"].items()}
        self.root_radius, self.tip_radius = float(blade["radius_m"][0]), float(blade["radius_m"][-1])
        self.length = self.tip_radius - self.root_radius
        self._station = blade["radius_m"] - self.root_radius
        self._blade = blade
        camber = self.data["camber"]
        self._camber = np.array(camber["x"]), np.array(camber["height"])
        table = {name: _polar(values) for name, values in self.data["model_polars"].items()}
        if polars == "measured":
            far = self.data["model_polars"]["Mod_S809_Outboard"]
            self._polars = [table["cylinder"]] * 2 + [_polar(_spliced(self.data["measured_polar"], far))] * 2
            self._polar_station = np.array([self.root_radius, CYLINDER_END, AIRFOIL_START, self.tip_radius])
        else:
            at = self.data["model_polar_at"]
            self._polars, self._polar_station = [table[name] for name in at["polar"]], np.array(at["radius_m"])
        self._augmentation = None
        if augmentation is not None:
            ratio = self.rotor_speed * self.tip_radius / wind
            self._augmentation = RotationalAugmentation(augmentation, self.tip_radius, ratio)

    def chord_at(self, z):
        """Chord [m]."""
        return np.interp(z, self._station, self._blade["chord_m"])

    def twist_at(self, z):
        """Twist [rad], zero at 75 % span."""
        return np.radians(np.interp(z, self._station, self._blade["twist_deg"]))

    def axis_at(self, z):
        """Distance from the leading edge to the pitch axis, in chords."""
        return np.interp(z, self._station, self._blade["axis_xc"])

    def polar_at(self, z):
        """Polar, blended linearly between the stations; in rotation, if that is modeled."""
        radius = z + self.root_radius
        k = int(np.clip(np.searchsorted(self._polar_station, radius), 1, len(self._polars) - 1))
        low, high = self._polar_station[k - 1 : k + 1]
        weight = float(np.clip((radius - low) / (high - low), 0.0, 1.0))
        polar = blend_polars(self._polars[k - 1], self._polars[k], weight)
        return polar if self._augmentation is None else self._augmentation.of(polar, float(self.chord_at(z)), radius)

    def camber_at(self, z, x):
        """Height and slope of the mean line at chord fractions x; none on the cylinder."""
        weight = np.clip((z + self.root_radius - CYLINDER_END) / (AIRFOIL_START - CYLINDER_END), 0.0, 1.0)
        stations, height = self._camber
        slope = np.gradient(height, stations)
        return weight * np.interp(x, stations, height), weight * np.interp(x, stations, slope)

    @property
    def rotor_speed(self):
        """[rad/s]."""
        return self.data["operation"]["rotor_speed_rpm"] * np.pi / 30.0

    @property
    def pitch(self):
        """Angle of the section without twist [rad]: the tip is to stand at the tip pitch."""
        operation = self.data["operation"]
        return float(np.radians(operation["tip_pitch_deg"] - operation["tip_twist_deg"]))

    def rotor(self, options: AeroOptions) -> RigidRotor:
        """Two blades on the vortex lattice."""
        edges = span_distribution(0.0, self.length, options.n_span)
        strip = 0.5 * (edges[1:] + edges[:-1])
        alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
        polars = np.array([np.column_stack(self.polar_at(z).coefficients(alpha)) for z in strip])
        axis = np.column_stack([0.0 * edges, 0.0 * edges, edges])
        planform = build_planform(
            edges, axis, self.chord_at(edges), self.twist_at(edges), self.axis_at(edges), polars, options.n_chord,
            self.camber_at, self.chord_at(strip),
        )  # fmt: skip
        return RigidRotor(planform, 2, self.root_radius, self.tip_radius, 0.0, AIR_DENSITY)

    def blade_elements(self) -> BladeElementRotor:
        """Two blades of blade-element theory."""
        return BladeElementRotor(
            2, self.root_radius, self.length, self.tip_radius, 0.0, AIR_DENSITY, self.chord_at, self.twist_at,
            self.polar_at,
        )  # fmt: skip


def _polar(values):
    """Polar over the full circle from a table in degrees; a table may end at -180 and 180 only once."""
    columns = [np.array(values[name], dtype=float) for name in ("alpha_deg", "cl", "cd", "cm")]
    alpha, keep = np.unique(columns[0], return_index=True)
    return Polar(np.radians(alpha), *(column[keep] for column in columns[1:]))


def _spliced(inner, outer):
    """Table ``inner``, Viterna's continuation from its end to 90 degrees, and ``outer`` for all other angles."""
    angle, first, last = np.array(outer["alpha_deg"]), inner["alpha_deg"][0], inner["alpha_deg"][-1]
    deep = np.arange(np.ceil(last) + 1.0, 90.0)
    middle = {"alpha_deg": deep, "cm": np.interp(deep, angle, outer["cm"])}
    middle["cl"], middle["cd"] = _viterna(np.radians(deep), np.radians(last), inner["cl"][-1], inner["cd"][-1])
    before, behind = angle < first, angle >= 90.0
    return {name: np.concatenate([np.array(outer[name])[before], inner[name], middle[name],
                                  np.array(outer[name])[behind]]) for name in inner}  # fmt: skip


def _viterna(alpha, stall, lift, drag):
    """Lift and drag of a stalled blade of finite length at ``alpha`` [rad], with the given ones at the angle ``stall``.

    cl = cd_max/2 sin 2α + A cos²α / sin α, cd = cd_max sin²α + B cos α, cd_max = 1.11 + 0.018 AR (Viterna & Corrigan,
    NASA CP-2230, 1982).
    """
    most = 1.11 + 0.018 * ASPECT_RATIO
    sine, cosine = np.sin(stall), np.cos(stall)
    a, b = (lift - most * sine * cosine) * sine / cosine**2, (drag - most * sine**2) / cosine
    return (0.5 * most * np.sin(2.0 * alpha) + a * np.cos(alpha) ** 2 / np.sin(alpha),
            most * np.sin(alpha) ** 2 + b * np.cos(alpha))  # fmt: skip


def force_coefficients(run):
    """Coefficients (n_span, 2) of the force normal to the chord and along it towards the leading edge."""
    cl, cd, _ = run.coefficients.T
    c, s = np.cos(run.alpha), np.sin(run.alpha)
    return np.column_stack((cl * c + cd * s, cl * s - cd * c))


def run_blade(polars, options=OPTIONS, turns=TURNS):
    """Run the rotor at 7 m/s with one choice of polars; returns the lattice's run and blade-element theory's."""
    blade = PhaseSixBlade(polars)
    operation = blade.data["operation"]
    wind, speed = operation["wind_m_s"], operation["rotor_speed_rpm"] * np.pi / 30.0
    run = blade.rotor(options).run(options, wind, speed, blade.pitch, turns)
    return run, blade_element(blade.blade_elements(), wind, speed, blade.pitch), speed, operation["torque_N_m"]


def stalled_rotor(wind, polars="measured", augmentation=None, options=OPTIONS, turns=TURNS):
    """Torque [N m], thrust [N] and normal force coefficients at `SECTIONS` of the lattice in a wind [m/s]."""
    blade = PhaseSixBlade(polars, augmentation, wind)
    run = blade.rotor(options).run(options, wind, blade.rotor_speed, blade.pitch, turns)
    torque = float(run.power[-run.steps_per_turn :].mean() / blade.rotor_speed)
    at = np.multiply(SECTIONS, blade.tip_radius)
    return torque, run.ct * run.reference_thrust, np.interp(at, run.span, force_coefficients(run)[:, 0])


@case(
    "uae-phase-vi",
    "UAE Phase VI rotor at 7 m/s: shaft torque",
    UAE_SOURCE,
    quick={"kinds": ("model",), "options": COARSE, "turns": 5.0},
)
def uae_phase_vi(kinds=("model", "measured"), options=OPTIONS, turns=TURNS) -> CaseResult:
    """Torque within 10 % of the measurement, with stall-corrected and with two-dimensional polars."""
    checks, normal, along, lines = [], [], [], []
    names = {"model": "polars of the certification model", "measured": "two-dimensional polar"}
    for polars in kinds:
        name = names[polars]
        run, element, speed, measured = run_blade(polars, options, turns)
        torque, thrust = run.power[-run.steps_per_turn :].mean() / speed, run.ct * run.reference_thrust
        checks.append(Check(f"shaft torque, {name}", measured, torque, 0.1, "N m", source=UAE_SOURCE))
        force, radius = force_coefficients(run), PhaseSixBlade().tip_radius
        at = [np.interp(np.multiply(SECTIONS, radius), run.span, column) for column in force.T]
        style = "-" if polars == "model" else "--"
        normal.append(Curve(run.span, force[:, 0], name, style))
        along.append(Curve(run.span, force[:, 1], name, style))
        lines += [
            f"{name}: torque {torque:.0f} N m, thrust {thrust:.0f} N, change of power in the last turn"
            f" {100 * run.drift:+.2f} %; blade-element theory {element.power / speed:.0f} N m, {element.thrust:.0f} N",
            "  r/R      " + "".join(f"{r:8.2f}" for r in SECTIONS),
            "  normal   " + "".join(f"{x:8.3f}" for x in at[0]),
            "  chordwise" + "".join(f"{x:8.3f}" for x in at[1]),
        ]
    lines.append(f"Air density {AIR_DENSITY} kg/m³. Hub and shaft friction are not modeled.")
    taps = np.multiply(SECTIONS, PhaseSixBlade().tip_radius)
    normal.insert(0, Curve(taps, MEASURED[7.0][2], "measured", "ks"))
    figures = {
        "normal force coefficient": Figure(tuple(normal), "radius [m]", "c_n"),
        "chordwise force coefficient": Figure(tuple(along), "radius [m]", "c_t"),
    }
    return CaseResult(checks, figures, "\n".join(lines))


@case("uae-phase-vi-stall", "UAE Phase VI rotor from 7 to 25 m/s: stall delayed by rotation", STALL_SOURCE, slow=True)
def uae_phase_vi_stall() -> CaseResult:
    """Torque within 15 %, normal force at 30 % of the radius within 20 %, with augmented two-dimensional polars."""
    choices = {
        "Du-Selig, Eggers": ("measured", "du-selig"), "Snel": ("measured", "snel"),
        "Snel, 1993": ("measured", "snel-1993"),
        "two-dimensional": ("measured", None), "certification model": ("model", None),
    }  # fmt: skip
    winds = np.array(list(MEASURED))
    results = {name: [stalled_rotor(wind, *choice) for wind in winds] for name, choice in choices.items()}
    checks, lines = [], []
    for name in ("Du-Selig, Eggers", "Snel"):
        for wind, (torque, _, normal) in zip(winds, results[name], strict=True):
            expected, _, coefficients = MEASURED[wind]
            checks.append(
                Check(f"{name}, {wind:g} m/s: shaft torque", expected, torque, 0.15, "N m", source=STALL_SOURCE)
            )
            checks.append(Check(f"{name}, {wind:g} m/s: normal force coefficient at 0.30 R", coefficients[0], normal[0],
                                0.2, source=STALL_SOURCE))  # fmt: skip
    for name, runs in results.items():
        lines.append(f"{name}: torque [N m], thrust [N], difference of the torque, normal force at r/R {SECTIONS}")
        for wind, (torque, thrust, normal) in zip(winds, runs, strict=True):
            change = 100.0 * (torque / MEASURED[wind][0] - 1.0)
            lines.append(f"  {wind:4.0f} m/s {torque:6.0f} {thrust:6.0f} {change:+5.0f} %  " +
                         "".join(f"{x:7.3f}" for x in normal))  # fmt: skip
    lines.append(
        "The measured thrust is that of the pressures alone. Values of the other sequence of the experiment that are "
        "often copied, 1340, 1170, 1110 and 1490 N m at 10, 15, 20 and 25 m/s, lie 4 to 11 % away: so well it repeats."
    )
    torques = [Curve(winds, [run[0] for run in runs], name, "o-") for name, runs in results.items()]
    inboard = [Curve(winds, [run[2][0] for run in runs], name, "o-") for name, runs in results.items()]
    measured = [
        Curve(winds, values, "measured", "ks")
        for values in ([MEASURED[w][0] for w in winds], [MEASURED[w][2][0] for w in winds])
    ]
    figures = {
        "shaft torque": Figure((measured[0], *torques), "wind speed [m/s]", "torque [N m]"),
        "normal force at 30 % of the radius": Figure((measured[1], *inboard), "wind speed [m/s]", "c_n"),
    }
    return CaseResult(checks, figures, "\n".join(lines))


# ---- dynamic stall --------------------------------------------------------------------------------------------------
# Chord and speed are 1, so that the reduced frequency is k = ω / 2. The airfoil pitches about its quarter chord.

OYE_SOURCE = "Øye 1991; Hansen, Gaunaa & Madsen 2004, Risø-R-1354; polar: Ramsay et al. 1995, NREL/TP-442-7817"
INDEPENDENT = "Øye's model with A = 4 on the measured polar, an independent computation"
LAG = 4.0
"""Time constant of the separation point in chords."""
LOOPS = {
    (8.0, 10.0, 0.026): (1.12, 0.96, 0.78),
    (8.0, 10.0, 0.050): (1.24, 0.98, 0.73),
    (8.0, 10.0, 0.077): (1.35, 0.98, 0.70),
    (14.0, 10.0, 0.026): (1.14, 1.13, 0.92),
    (14.0, 10.0, 0.050): (1.27, 1.24, 0.87),
    (14.0, 10.0, 0.077): (1.38, 1.33, 0.83),
    (20.0, 10.0, 0.077): (1.20, 1.05, 0.67),
    (14.0, 5.5, 0.077): (1.19, 1.16, 0.89),
}
"""Mean and amplitude of the angle of attack [deg], k; largest cl, cl at the mean on rising and falling branch."""
JONES = np.array([[0.165, 0.335], [0.0455, 0.300]])
"""Wagner's function 1 - sum A exp(-b s), s in semi-chords (Jones 1938)."""


def s809_polar():
    """Measured two-dimensional polar, shape (720, 3) from -π on."""
    alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
    return np.column_stack(PhaseSixBlade("measured").polar_at(3.0).coefficients(alpha))


@dataclass(frozen=True)
class Pitching:
    """Angle of attack [rad] as a sine of time about a mean."""

    mean: float
    amplitude: float
    k: float

    @property
    def omega(self):
        """[rad per time in which the stream passes a chord]."""
        return 2.0 * self.k

    def angle(self, time):
        """[rad]."""
        return self.mean + self.amplitude * np.sin(self.omega * time)

    def rate(self, time):
        """[rad per time]."""
        return self.amplitude * self.omega * np.cos(self.omega * time)

    def steps(self, longest):
        """Time step not longer than ``longest``, and the number of steps in a period."""
        period = 2.0 * np.pi / self.omega
        n = 4 * int(np.ceil(period / longest / 4.0))
        return period / n, n


class StallingSection:
    """Tables of Øye's model for one polar (n_alpha, 3), between which it interpolates linearly.

    ``monotone`` as in `separation_tables`: the tables of the lattice, or those of the published model.
    """

    def __init__(self, polar, monotone=True):
        step = 2.0 * np.pi / len(polar)
        self._alpha = -np.pi + step * np.arange(len(polar))
        self._attached, self._separated, self._point, _ = separation_tables([polar], monotone)[0].T

    def static_point(self, alpha):
        """Separation point of the static polar [chords]."""
        return np.interp(alpha, self._alpha, self._point)

    def lift(self, alpha, point):
        """Lift coefficient with the flow separated ``point`` chords aft."""
        attached, separated = (np.interp(alpha, self._alpha, x) for x in (self._attached, self._separated))
        return point * attached + (1.0 - point) * separated

    def balance(self, base, share, point):
        """Angle of attack base + share F / 2π and lift coefficient F that belong to each other."""
        share /= 2.0 * np.pi
        lift = brentq(lambda f: self.lift(base + share * f, point) - f, -8.0, 8.0, xtol=1e-10)
        return base + share * lift, lift


def oye_loop(
    section: StallingSection, motion: Pitching, shed_wake=False, periods=3
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lift coefficient over the last period (n + 1,), first and last point at the mean on the rising branch.

    Without a wake this is Øye's model on the angle of attack itself. With one, the flow at three quarters of the chord
    is that of the pitching plate, slowed by the wake that it sheds, and the lift has the plate's apparent mass:

        cl = F(αE, f) + π α̇ c/2V,   αE = α + α̇ c/2V - q + F/2π,   F/2π = q (1 - A1 - A2) + y1 + y2,
        ẏi = bi 2V/c (Ai q - yi).

    q is the angle that a plate without stall would need for this lift, so that the wake is that of the lift as it is;
    without stall F = 2π αE, and this is the state-space form of Hansen, Gaunaa & Madsen.
    """
    dt, n = motion.steps(0.02)
    amplitudes, rates = JONES[0], 2.0 * JONES[1]
    direct = 1.0 - amplitudes.sum()
    point, wake, lift = section.static_point(motion.angle(0.0)), np.zeros(2), []
    if shed_wake:
        wake = amplitudes * section.lift(motion.angle(0.0), point) / (2.0 * np.pi)
    for i in range(periods * n + 1):
        angle, rate = motion.angle(i * dt), motion.rate(i * dt)
        effective, circulatory = angle, section.lift(angle, point)
        if shed_wake:
            effective, circulatory = section.balance(
                angle + 0.5 * rate + wake.sum() / direct, 1.0 - 1.0 / direct, point
            )
            q = (circulatory / (2.0 * np.pi) - wake.sum()) / direct
            wake = amplitudes * q + (wake - amplitudes * q) * np.exp(-rates * dt)
        static = section.static_point(effective)
        point = static + (point - static) * np.exp(-dt / LAG)
        lift.append(circulatory + (0.5 * np.pi * rate if shed_wake else 0.0))
    return np.degrees(motion.angle(dt * np.arange(n + 1))), np.array(lift[-n - 1 :])


def lattice_loop(
    motion: Pitching, polar=None, n_chord=2, periods=2.25, **options
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angle [deg] and lift coefficient of the vortex lattice over the last period, (n + 1,) each.

    ``polar`` (n_alpha, 3) of the section; a flat plate's if not given; ``n_chord``: panels along the chord; a step is
    one panel; ``options``: `AeroOptions`.
    """
    dt, n = motion.steps(1.0 / n_chord)
    start, n_steps = round((periods % 1.0) * n), round(periods * n)
    planform = two_dimensional_planform(n_chord, polar)
    flow = WingFlow(planform, UniformStream.at_incidence(0.0), n_steps, dt, **({"viscous": True} | options))

    def motion_at(time):
        """Nodes and their velocities; the quarter chord lies at x = y = 0."""
        sine, cosine = np.sin(motion.angle(time)), np.cos(motion.angle(time))
        nodes, velocities = flow.nodes.copy(), flow.still.copy()
        x, y = flow.nodes[..., 0], flow.nodes[..., 1]
        nodes[..., 0], nodes[..., 1] = cosine * x - sine * y, sine * x + cosine * y
        velocities[..., 0], velocities[..., 1] = -motion.rate(time) * nodes[..., 1], motion.rate(time) * nodes[..., 0]
        return nodes, velocities

    flow.start_moving(*motion_at(-start * dt))
    times = dt * np.arange(1 - start, n_steps - start + 1)
    lift = np.array([flow.section_lift(flow.step(*motion_at(time))) for time in times])
    return np.degrees(motion.angle(times[-n - 1 :])), lift[-n - 1 :]


def landmarks(lift):
    """Largest lift of a loop, and the lift at the mean angle on the rising and on the falling branch."""
    return float(lift.max()), float(lift[0]), float(lift[len(lift) // 2])


def attached_response(k=0.1, n_chord=4):
    """Ratio of the lattice's lift to Theodorsen's, and C(k) from it: a flat plate pitching by one degree."""
    motion = Pitching(0.0, np.radians(1.0), k)
    lift = lattice_loop(motion, n_chord=n_chord, periods=3.0, dynamic_stall="oye")[1][:-1]
    phase = 2.0 * np.pi * np.arange(lift.size) / lift.size
    base = np.column_stack([np.sin(phase), np.cos(phase), np.ones_like(phase), phase])  # the line: rest of the start
    sine, cosine = np.linalg.lstsq(base, lift, rcond=None)[0][:2] / motion.amplitude
    obtained, rate = complex(sine, cosine), 2j * k
    apparent_mass = 0.5 * np.pi * (rate + 0.25 * rate**2)
    return obtained / exact_lift("pitch", k), (obtained - apparent_mass) / (2.0 * np.pi * (1.0 + 0.5 * rate))


@case(
    "dynamic-stall",
    "Dynamic stall of the S809 airfoil in pitch",
    OYE_SOURCE,
    quick={"loops": ((8.0, 10.0, 0.05), (14.0, 10.0, 0.077))},
)
def dynamic_stall(loops=tuple(LOOPS)) -> CaseResult:
    """Loops of the lift: the model alone, the lattice against the model with its own shed wake, attached flow."""
    polar = s809_polar()
    published, section = StallingSection(polar, monotone=False), StallingSection(polar)
    checks, figures, lines = [], {}, []
    for mean, amplitude, k in loops:
        expected = LOOPS[mean, amplitude, k]
        motion = Pitching(np.radians(mean), np.radians(amplitude), k)
        label = f"{mean:g} ± {amplitude:g}°, k = {k:g}"
        angle, alone = oye_loop(published, motion)
        names = ("largest cl", "cl at the mean, rising", "cl at the mean, falling")
        checks += [
            Check(f"{label}, model alone: {name}", value, obtained, absolute(0.03), source=INDEPENDENT)
            for name, value, obtained in zip(names, expected, landmarks(alone), strict=True)
        ]
        with_wake = oye_loop(section, motion, shed_wake=True)
        lattice = lattice_loop(motion, polar, dynamic_stall="oye")
        checks += [
            Check(f"{label}, lattice: {name}", value, obtained, absolute(0.05), source="ODE with Jones's wake")
            for name, value, obtained in zip(names, landmarks(with_wake[1]), landmarks(lattice[1]), strict=True)
        ]
        static = section.lift(np.radians(angle), section.static_point(np.radians(angle)))
        figures[f"lift, {label}"] = Figure((
            Curve(angle, static, "static polar", "k:"),
            Curve(angle, alone, "Øye's model alone", "--"),
            Curve(*with_wake, "with a shed wake (ODE)"),
            Curve(*lattice, "vortex lattice"),
        ), "angle of attack [deg]", "cl")  # fmt: skip
        quasi_static = landmarks(lattice_loop(motion, polar)[1])
        lines.append(
            f"{label}: largest cl {lattice[1].max():.3f} in the lattice, {quasi_static[0]:.3f} there without the model,"
            f" {landmarks(oye_loop(section, motion)[1])[0]:.3f} of the model alone with the lattice's tables"
        )
    ratio, deficiency = attached_response()
    source = "Theodorsen 1935"
    checks += [
        Check("attached, k = 0.1: |C|", 0.850, abs(deficiency), 0.005, source=source),
        Check("attached, k = 0.1: phase of C", -11.7, np.degrees(np.angle(deficiency)), absolute(0.2), "deg",
              source=source),
        Check("attached, k = 0.1: lift over Theodorsen's", 1.0, abs(ratio), 0.002, source=source),
    ]  # fmt: skip
    lines.append(
        "The lattice's tables do not let the fully separated lift fall between 18 and 20°, which takes 0.02 to 0.04 "
        "from the largest lift. It takes the angle of attack from the circulation, the equations at three quarters of "
        "the chord; both agree to first order in the frequency, and to 0.01 at 8 ± 10°. Loops of a polar compressed to "
        "small angles differ from the equations as much: it is not the large angle."
    )
    lines.append(
        "Measured loops of this airfoil (Ohio State) were reported with largest lift coefficients of 1.4 to 1.8 at "
        "± 10° and the highest frequency: a leading-edge vortex lifts too, which this model does not have."
    )
    return CaseResult(checks, figures, "\n".join(lines))
