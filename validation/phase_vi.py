"""The NREL Unsteady Aerodynamics Experiment, Phase VI: a stiff two-bladed rotor of 10 m diameter in a wind tunnel.

At 7 m/s the flow is attached over most of the blade, so that lifting-surface theory with the polars of its S809 airfoil
should give the measured torque; from 10 m/s on the rotor stalls and becomes a test of stall models instead.
"""

from __future__ import annotations

import json
from importlib import resources

import numpy as np

from validation.blade_element import BladeElementRotor, blade_element
from validation.case import CaseResult, Check, Curve, Figure, case
from validation.rigid_rotor import RigidRotor
from wt_gym.aerodynamics import AeroOptions, build_planform, span_distribution
from wt_gym.simulation.blade_lattice import N_ALPHA
from wt_gym.turbines.airfoil import Polar, blend_polars

SOURCE = "Hand et al. 2001, NREL/TP-500-29955; sequences H and S, 72 rpm, tip pitch 3 deg"
AIR_DENSITY = 1.225
"""Standard air [kg/m^3]; the tunnel's own was about 2 % higher, and the torque is proportional to it."""
OPTIONS = AeroOptions(
    n_chord=2, n_span=16, azimuth_step_deg=10.0, wake_rows=108, full_rows=108, fresh_rows=36, refresh_stride=6,
    far_wake_rows=54, squire=1e-3,
)  # fmt: skip
"""Three turns of free wake, continued by vortex cylinders; the wake drifts 1.1 radii a turn."""
TURNS = 7.0
SECTIONS = (0.30, 0.47, 0.63, 0.80, 0.95)
"""Radii of the pressure taps, in rotor radii."""
CYLINDER_END, AIRFOIL_START = 0.8835, 1.2575
"""Radii between which the root cylinder turns into the airfoil [m]."""


class PhaseSixBlade:
    """Planform, camber and polars of the blade; positions are distances from its root [m].

    Parameters
    ----------
    polars : str
        "model": with stall delay along the span, from the certification model; "measured": one two-dimensional polar,
        continued beyond its range by the certification model's outermost one.
    """

    def __init__(self, polars: str = "model"):
        text = resources.files(__package__).joinpath("data", "uae_phase_vi.json").read_text(encoding="utf-8")
        self.data = json.loads(text)
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
        """Polar, blended linearly between the stations."""
        radius = z + self.root_radius
        k = int(np.clip(np.searchsorted(self._polar_station, radius), 1, len(self._polars) - 1))
        low, high = self._polar_station[k - 1 : k + 1]
        return blend_polars(self._polars[k - 1], self._polars[k], float(np.clip((radius - low) / (high - low), 0, 1)))

    def camber_at(self, z, x):
        """Height and slope of the mean line at chord fractions x; none on the cylinder."""
        weight = np.clip((z + self.root_radius - CYLINDER_END) / (AIRFOIL_START - CYLINDER_END), 0.0, 1.0)
        stations, height = self._camber
        slope = np.gradient(height, stations)
        return weight * np.interp(x, stations, height), weight * np.interp(x, stations, slope)

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
    """Table ``inner`` with the rows of ``outer`` before and behind it."""
    angle, first, last = np.array(outer["alpha_deg"]), inner["alpha_deg"][0], inner["alpha_deg"][-1]
    before, behind = angle < first, angle > last
    return {name: np.concatenate([np.array(outer[name])[before], inner[name], np.array(outer[name])[behind]])
            for name in inner}  # fmt: skip


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


@case("uae-phase-vi", "UAE Phase VI rotor at 7 m/s: shaft torque", SOURCE)
def uae_phase_vi():
    """Torque within 10 % of the measurement, with stall-corrected and with two-dimensional polars."""
    checks, normal, along, lines = [], [], [], []
    for polars, name in (("model", "polars of the certification model"), ("measured", "two-dimensional polar")):
        run, element, speed, measured = run_blade(polars)
        torque, thrust = run.power[-run.steps_per_turn :].mean() / speed, run.ct * run.reference_thrust
        checks.append(Check(f"shaft torque, {name}", measured, torque, 0.1, "N m", True, SOURCE))
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
    lines.append(f"Air density {AIR_DENSITY} kg/m³. Hub and shaft friction are not modelled.")
    figures = {
        "normal force coefficient": Figure(tuple(normal), "radius [m]", "c_n"),
        "chordwise force coefficient": Figure(tuple(along), "radius [m]", "c_t"),
    }
    return CaseResult(checks, figures, "\n".join(lines))
