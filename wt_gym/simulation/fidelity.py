"""Fidelities: how finely air and structure are resolved, and at what price.

Twist of a blade's tip under the steady loads of rated wind, and the fidelity that follows from it.

A blade twists where the air acts beside the shear centers of its sections, and where its sections or its curved axis
couple bending and torsion. By the principle of virtual forces (Przemieniecki, Theory of Matrix Structural Analysis,
1968, ch. 5) the rotation of the tip about its tangent is

    theta = integral of s1(z)^T C(z) s(z) dz,

with C the inverse of the section stiffness, s the forces and moments at a section of all loads farther out, and s1
those of a unit moment about the tangent of the tip. A cantilever is statically determinate, so both follow from
equilibrium alone, about the undeformed axis. Where the axis is straight and runs through the shear centers, this is the
integral of T / GJ with T = integral of (L e + M) dz, L the lift, e the distance of the quarter chord from the shear
center and M the moment of the profile about the quarter chord.

The loads are those of blade elements (`wt_gym.turbines.blade_element`) at rated speed in rated wind, at the least pitch
of the turbine's own controller or beyond, where the rotor has no more than rated power. Neither the loads nor their
lever arms follow the deformation.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.aerodynamics.options import ENGINEERING, REFERENCE, TRAINING, AeroOptions
from wt_gym.base.errors import SimulationError, did_you_mean, warn_once
from wt_gym.base.files import read_toml
from wt_gym.base.options import Options, option, option_record, shown
from wt_gym.base.quantities import Array
from wt_gym.multibody.integrators.advance_kernels import MOST_UNCORRECTED
from wt_gym.multibody.integrators.schemes import DEFAULT, INTEGRATORS, STARTERS, IntegratorEntry, SchemeSettings
from wt_gym.multibody.integrators.stability import GROWTH, predicted_growth
from wt_gym.multibody.observer_frame.observer_frame_body import DISPLACEMENTS, REFERENCE_CONDITIONS
from wt_gym.structure.beam import skew
from wt_gym.structure.modes import COORDINATES
from wt_gym.turbines import Blade, Turbine
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements

RESERVE = 0.75
"""Largest ω h of the structural integration, in limits of an undamped mode: modes stiffen with rotation."""


ELASTODYN_NREL_5MW_TOWER = (
    ((0.7004, 2.1963, -5.6202, 6.2275, -2.504), (-70.5319, -63.7623, 289.737, -176.513, 22.0706)),
    ((1.385, -1.7684, 3.0871, -2.2395, 0.5357), (-121.21, 184.415, -224.904, 298.536, -135.838)),
)
"""Tower shapes of the ElastoDyn input file of the NREL 5-MW turbine, for ``Fidelity.tower_shapes`` with
``tower_modes=(2, 2, 0)``: what OpenFAST assumes, not what this tower vibrates in."""


STEP_BASE = 0.2
"""Interval that the automatic time step divides [s]; control intervals are multiples of it."""


_OF_OBSERVERS = {"reference_condition": "clamped", "frame_update": "step", "frame_displacement": "second_order"}
"""Defaults of what belongs to observer frames only."""


def _modes(counts: tuple[int, ...]) -> tuple[int, ...]:
    if sum(counts) < 1:
        raise ValueError(f"must have at least one mode, got {counts}")
    return counts


def _shapes(planes: Any) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Tuples of nested sequences, as JSON has them: a fidelity is a key of caches."""
    try:
        fore_aft, side_side = planes
        return tuple(tuple(tuple(map(float, shape)) for shape in plane) for plane in (fore_aft, side_side))
    except (TypeError, ValueError) as error:
        raise ValueError(f"must be two tuples with tuples of numbers, got {shown(planes)}") from error


def _integrator(name: str) -> str:
    if name not in INTEGRATORS:
        raise ValueError(f"must be one of {', '.join(INTEGRATORS)}, got {name!r}{did_you_mean(name, INTEGRATORS)}")
    return name


@option_record
class Fidelity(Options):
    """Resolution of a simulation."""

    title = "fidelity"
    prefix = "Fidelity."
    error = SimulationError

    name: str = option("of the fidelity", default="custom")
    aero: AeroOptions = option(
        "lattice and wake. The strides of thinned rows belong to ``aero.azimuth_step_deg``; where the step turns the "
        "rotor at rated speed by another angle they follow it, rounded down, see :meth:`aero_for`",
        default=TRAINING,
        kinds=(AeroOptions,),
    )
    time_step: float | None = option(
        "aerodynamic; by default of `step_for`", default=None, unit="s", low=0, high=10, above=True, below=True
    )
    max_substep: float = option(
        "longest structural; shorter for the highest modes", default=0.034, unit="s", low=0, high=0.5, above=True
    )
    stiffest_shaft: float = option(
        "a drivetrain with a higher torsional frequency is taken as rigid", default=8.0, unit="Hz", low=0
    )
    corrections: int = option("corrector passes of the Hamming scheme in each sub-step", default=3, low=1)
    starter: str = option(
        'first steps of Hamming\'s scheme; "runge-kutta" has a smaller error', default="adams", choices=STARTERS
    )
    coupling_iterations: int = option(
        "most passes of structure and loads through one aerodynamic step; more, up to 20, only where the loads of the "
        "blades still change by more than a tenth",
        default=2,
        low=1,
    )
    coupling_tolerance: float = option(
        "the passes end when the loads change by less than this fraction of their size", default=1e-3
    )
    tower_modes: tuple[int, int, int] = option(
        "fore-aft, side-side and torsion modes", default=(2, 2, 1), low=0, check=_modes
    )
    blade_modes: tuple[int, int, int] = option(
        "flap, edge and torsion modes of each blade", default=(2, 1, 0), low=0, check=_modes
    )
    tower_elements: int = option("finite elements of the tower from which the modes come", default=12, low=4)
    blade_elements: int = option("finite elements of a blade", default=24, low=4)
    tower_coordinates: str = option(
        '"modal": the modes counted above; "nodal": displacements and rotations of the finite-element nodes in the '
        "directions of which at least one mode is counted (fore-aft or flap, side-side or edge, torsion; along a "
        'curved blade too), which needs few elements and short steps; "rigid": no deformation',
        default="modal",
        choices=COORDINATES,
    )
    blade_coordinates: str = option("likewise", default="modal", choices=COORDINATES)
    tower_shapes: tuple[tuple[tuple[float, ...], ...], ...] | None = option(
        "prescribed bending shapes of the tower instead of its modes: two tuples (fore-aft, side-side) with the "
        "coefficients of (z/H)², (z/H)³, … of each shape, as many as ``tower_modes`` counts, for example "
        ":data:`ELASTODYN_NREL_5MW_TOWER`",
        default=None,
        check=_shapes,
    )
    yaw_drive: str = option(
        '"spring": through the yaw spring and damper of the turbine', default="stiff", choices=("stiff", "spring")
    )
    blade_bodies: int = option(
        "floating-frame bodies of a blade, one behind the other: with several a blade may bend far, and its bending "
        "twists it. Modal bodies have the static shapes of their tips as coordinates, in the directions of which "
        "``blade_modes`` counts at least one; nodal ones the displacements of their nodes. They need an implicit "
        "``integrator``",
        default=1,
        low=1,
    )
    integrator: str = option(
        'a name of `wt_gym.multibody.integrators.schemes.INTEGRATORS`. Explicit ("hamming"): the structural steps are '
        'as short as the highest frequency requires. Implicit ("newmark", with ¼ and ½, and "generalized_alpha", '
        "Chung & Hulbert 1993): steps of ``max_substep`` whatever the frequencies, for nodal coordinates, torsion and "
        "blades of several bodies",
        default=DEFAULT,
        check=_integrator,
    )
    tower_shadow: bool = option(
        "potential flow round a cylinder acts on the blades near the tower: the cheap form of a tower in the flow",
        default=True,
    )
    tower_body: tuple[int, int] | None = option(
        "panels around and along of the tower as a closed body in the lattice, which replaces the cheap form: blades, "
        "wake and tower then answer each other, and the wake does not cut the tower",
        default=None,
        low=3,
    )
    nacelle_body: tuple[int, int] | None = option(
        "panels around and along of hub and nacelle as one closed body of revolution about the shaft in the lattice; "
        "alone (the cheap form of the tower then stays) or with ``tower_body``, which ends a gap below it. Its size is "
        "an estimate, see :func:`wt_gym.simulation.models.nacelle_surface`. It turns with the nacelle, in steps of "
        '0.25°, about the axis of the undeformed tower, unless bodies move with the tower. In "training" (8, 8) takes '
        "half as much time again for a step, as much as a tower of (8, 8); the influence of all panels on each other, "
        "about a millisecond for 100 of them, is inverted at each step of the yaw",
        default=None,
        low=5,
    )
    formulation: str = option(
        '"embedded": blades on joints, velocities of the joints only; "constrained": free blades held to the hub by '
        "constraint equations with Lagrange multipliers (Gebhardt et al. 2012). Both describe the same turbine; the "
        'embedded form is several times faster. "observer": all bodies in local observer frames, held together by '
        "constraint equations (Holm-Jørgensen, Nielsen & Rubak), in implicit steps of at most ``max_substep`` by the "
        "rule of ``integrator`` (`IntegratorEntry.rule`): of an explicit one, Newmark's",
        default="embedded",
        choices=("embedded", "constrained", "observer"),
    )
    spectral_radius: float | None = option(
        "of the generalized-α scheme, 1 keeps all frequencies, see `scheme_radius`", default=None, low=0, high=1
    )
    stabilization: float = option(
        "Baumgarte's α = β of constraints, φ̈ + 2 α φ̇ + α² φ = 0", default=10.0, unit="1/s", low=0
    )
    projection: bool = option(
        "put the state back onto the constraint equations after each structural step; without it the stabilization "
        "alone holds what steps drift by",
        default=True,
    )
    moving_bodies: bool = option(
        "the closed bodies follow the deflected tower, and that of the tower bears the force of the air on it "
        "(`wt_gym.simulation.step.coupling`); otherwise they stand about the undeformed tower and feel nothing",
        default=False,
    )
    blade_basis: str = option(
        '"fixed": the modes of the clamped blade at rest; "deformed": those of the blade as it turns, bent and loaded, '
        "recomputed at each aerodynamic step (`wt_gym.simulation.deformed_basis`)",
        default="fixed",
        choices=("fixed", "deformed"),
    )
    reference_condition: str = option(
        "of bodies in observer frames (`observer_frame_body`)", default="clamped", choices=REFERENCE_CONDITIONS
    )
    frame_update: str | float = option(
        'every "step", or beyond this displacement', default="step", unit="m", low=0, above=True, choices=("step",)
    )
    frame_displacement: str = option(
        'from the observer frames: "second_order", N q + ½ qᵀ H q with the geometric stiffness of axial forces, as in '
        'the other forms; or "linear", N q as published, without it: a turning blade then bends farther, a tower feels '
        "no P-Δ",
        default="second_order",
        choices=DISPLACEMENTS,
    )

    def check(self) -> None:
        """Refuse choices that do not go together."""
        if self.blade_bodies > 1 and (self.blade_coordinates == "rigid" or self._explicit):
            implicit = _integrators(lambda entry: not entry.explicit)
            raise SimulationError(
                f"Fidelity.blade_bodies is {self.blade_bodies} with blade_coordinates = {self.blade_coordinates!r} and "
                f"integrator = {self.integrator!r}; several bodies must have 'modal' or 'nodal' coordinates, and an "
                f"implicit integrator ({implicit}) for their high frequencies"
            )
        if self.moving_bodies and self.tower_body is None and self.nacelle_body is None:
            raise SimulationError("Fidelity.moving_bodies needs a tower_body or a nacelle_body to move")
        self._check_shapes()
        if self.blade_basis == "deformed":
            self._require("blade_basis 'deformed'", blade_coordinates="modal", blade_bodies=1)
            if not INTEGRATORS[self.integrator].keeps_states:
                raise SimulationError(
                    "Fidelity.blade_basis 'deformed' needs an integrator whose history passes to other modes "
                    f"({_integrators(lambda entry: entry.keeps_states)}), not {self.integrator!r}"
                )
        if self.formulation == "observer":
            self._require("formulation 'observer'", blade_bodies=1, blade_basis="fixed", moving_bodies=False)
            return
        for name, default in _OF_OBSERVERS.items():
            if getattr(self, name) != default:
                raise SimulationError(
                    f"Fidelity.{name} is {getattr(self, name)!r}, but the formulation is {self.formulation!r}; it "
                    "belongs to 'observer'"
                )

    def _require(self, choice: str, **needed: object) -> None:
        """Refuse other values of fields beside a choice than those that it needs."""
        for name, value in needed.items():
            if getattr(self, name) != value:
                raise SimulationError(f"Fidelity: {choice} needs {name} {value!r}, not {getattr(self, name)!r}")

    @property
    def _explicit(self) -> bool:
        return INTEGRATORS[self.integrator].explicit

    def _check_shapes(self) -> None:
        """Prescribed shapes of the tower, if any, fit the counted modes."""
        if self.tower_shapes is None:
            return
        if self.tower_coordinates != "modal":
            raise SimulationError(f"Fidelity.tower_shapes needs modal coordinates, not {self.tower_coordinates!r}")
        counts = tuple(len(plane) for plane in self.tower_shapes)
        if counts != tuple(self.tower_modes[:2]) or not all(len(c) for plane in self.tower_shapes for c in plane):
            raise SimulationError(
                f"Fidelity.tower_shapes holds {counts} shapes; fore-aft and side-side shapes for tower_modes = "
                f"{self.tower_modes} are needed, each a sequence of coefficients"
            )

    @property
    def scheme_radius(self) -> float:
        """Spectral radius of the generalized-α scheme: the one given, or that of blades that twist or only bend.

        A radius of 0.3 takes out of the twist what the aerodynamic step, as long as its period, cannot couple: with 0.8
        blades of the NREL 5-MW begin to shake in gusts. Against 0.8 with structural steps of 8 ms and a coupling
        converged to 1e-5, on the IEA 15-MW in turbulence at 9 m/s: power and tip deflection within 0.1 %,
        damage-equivalent loads of blades 0.3 %, of the tower 0.6 % fore-aft and 3 % side-side.
        """
        if self.spectral_radius is not None:
            return self.spectral_radius
        return 0.3 if self.blade_modes[2] > 0 else 0.8

    @property
    def scheme_settings(self) -> SchemeSettings:
        """What the integrator of the structure takes from here (`SchemeSettings`)."""
        return SchemeSettings(corrections=self.corrections, starter=self.starter, spectral_radius=self.scheme_radius)

    @property
    def takes_motion(self) -> bool:
        """Whether `Simulator.reset` can begin amid a motion: modal coordinates, embedded form, explicit integrator."""
        modal = (self.blade_coordinates, self.tower_coordinates) == ("modal", "modal") and self.blade_bodies == 1
        return modal and self.formulation == "embedded" and self._explicit

    def step_for(self, rated_speed: float) -> float:
        """Aerodynamic time step [s] for a rotor with this rated speed [rad/s].

        By default it is the largest that divides `STEP_BASE` and turns the rotor by at most ``aero.azimuth_step_deg``.
        """
        if self.time_step is not None:
            return self.time_step
        longest = math.radians(self.aero.azimuth_step_deg) / rated_speed
        return STEP_BASE / math.ceil(STEP_BASE / longest - 1e-9)

    def aero_for(self, rated_speed: float) -> AeroOptions:
        """Lattice and wake for a rotor with this rated speed [rad/s], see :meth:`AeroOptions.for_step`."""
        return self.aero.for_step(math.degrees(self.step_for(rated_speed) * rated_speed))

    def substeps_for(self, time_step: float, highest: float | None) -> int:
        """Number of structural steps in an aerodynamic step, for a highest structural mode [rad/s]; None: no limit.

        A quarter of what the integrator is stable for without damping is kept in reserve. Where the coupling of
        structure and air begins with an uncorrected prediction, the number is one with which that is stable too
        (`wt_gym.multibody.integrators.stability.predicted_growth`).
        """
        if highest is None:
            return math.ceil(time_step / self.max_substep - 1e-9)
        phase: float = RESERVE * INTEGRATORS[self.integrator].phase_limit(self.scheme_settings)
        count = math.ceil(time_step * max(1.0 / self.max_substep, highest / phase) - 1e-9)
        while (
            self._explicit
            and self.coupling_iterations > 1
            and count <= MOST_UNCORRECTED
            and predicted_growth(highest * time_step / count, count, self.corrections, self.coupling_iterations)
            > GROWTH
        ):
            count += 1
        return count


def _integrators(having: Callable[[IntegratorEntry], bool]) -> str:
    """Names of the integrators with a property, for messages."""
    return " or ".join(repr(name) for name, entry in INTEGRATORS.items() if having(entry))


_PRESETS = {"TRAINING": TRAINING, "ENGINEERING": ENGINEERING, "REFERENCE": REFERENCE}


def _read_fidelities() -> dict[str, Fidelity]:
    """Fidelities of the file."""
    found: dict[str, Fidelity] = {}
    for name, fields in read_toml(Path(__file__).with_name("fidelities.toml")).items():
        like, aero = fields.pop("like", None), fields.get("aero")
        fields |= {"name": name} | ({"aero": _PRESETS[aero]} if isinstance(aero, str) else {})
        found[name] = Fidelity(**fields) if like is None else replace(found[like], **fields)
    return found


FIDELITIES = _read_fidelities()


def fidelity(choice: str | Fidelity) -> Fidelity:
    """Fidelity from a name or a :class:`Fidelity`.

    Raises
    ------
    SimulationError
        For an unknown name.
    """
    if isinstance(choice, Fidelity):
        return choice
    if not isinstance(choice, str) or choice not in FIDELITIES:
        near = did_you_mean(choice, FIDELITIES)
        raise SimulationError(f"fidelity must be one of {', '.join(FIDELITIES)} or a Fidelity, got {choice!r}{near}")
    return FIDELITIES[choice]


NOTABLE_TWIST = math.radians(0.5)
"""Twist of the tip at rated thrust from which on blades are simulated with torsion [rad]."""
LARGEST_TWIST = math.radians(10.0)
"""Twist of the tip at rated thrust beyond which the torsional stiffness is taken for a fault of the file [rad]; blades
of the IEA 22-MW, the softest of known data, twist by 6 deg."""
_SECTIONS = 60
"""Along the blade; the twist changes by less than 2 % with twice as many."""
_PITCH_STEP = math.radians(0.5)
_PITCH_RANGE = math.radians(12.0)
"""Range of the pitch angles among which that of rated power is looked for [rad]."""
_LEAST_PITCH = math.radians(-5.0)
"""Where the turbine's data have none."""
_TORSION = "-torsion"


def suited_fidelity(turbine: Turbine) -> str:
    """Return "training-torsion" where the tip twists by more than `NOTABLE_TWIST` at rated thrust, else "training".

    Raises
    ------
    SimulationError
        If it twists by more than `LARGEST_TWIST`.
    """
    twist = abs(rated_tip_twist(turbine))
    if twist > LARGEST_TWIST:
        stiffness = turbine.blade.structure.stiffness
        midspan = stiffness[len(stiffness) // 2, 5, 5]
        raise SimulationError(
            f"the blades of {turbine.name!r} must twist by at most {math.degrees(LARGEST_TWIST):g} deg at rated "
            f"thrust, got {math.degrees(twist):.0f} deg from a torsional stiffness GJ of {midspan:.2g} "
            'N m^2 at midspan: correct it in the file, or name a fidelity, "training" for blades without torsion'
        )
    return f"training{_TORSION}" if twist > NOTABLE_TWIST else "training"


def choose_fidelity(turbine: Turbine, choice: str | Fidelity | None) -> str | Fidelity:
    """Return the fidelity of a simulation.

    Without a choice it is the one that suits the turbine. A name with torsion for blades that hardly twist, or without
    for others, brings a warning with the twist, once in a process; a `Fidelity` is taken as it is.

    Parameters
    ----------
    choice : str, Fidelity or None

    Raises
    ------
    SimulationError
        For an unknown name; as `suited_fidelity`.
    """
    if isinstance(choice, Fidelity):
        return choice
    if choice is None:
        return suited_fidelity(turbine)
    chosen = fidelity(choice)
    twists, other = chosen.blade_modes[2] > 0, choice.removesuffix(_TORSION)
    other = f"{choice}{_TORSION}" if choice == other else other
    if other in FIDELITIES:
        twist = rated_tip_twist(turbine)
        if twists != (abs(twist) > NOTABLE_TWIST):
            warn_once(
                f"the blades of {turbine.name!r} twist by {abs(math.degrees(twist)):.2f} deg at rated thrust, "
                f"{'less' if twists else 'more'} than {math.degrees(NOTABLE_TWIST):g} deg: fidelity {other!r} suits "
                f"them, got {choice!r}",
                stacklevel=3,
            )
    return choice


@lru_cache(maxsize=32)
def rated_tip_twist(turbine: Turbine) -> float:
    """Twist of the tip at rated thrust, see the module [rad]; positive turns the nose to the suction side.

    Blades of OpenFAST's ElastoDyn have no torsional stiffness of their own; with the estimate of their reader they
    hardly twist.
    """
    elements = BladeElements(BladeElementRotor.of_turbine(turbine), _SECTIONS)
    force, moment = _rated_loads(turbine, elements)
    return tip_twist(turbine.blade, elements.span - turbine.blade.root_radius, force, moment)


def _rated_loads(turbine: Turbine, elements: BladeElements) -> tuple[Array, Array]:
    """Force (n, 3) in the axes of the pitched blade [N] and moment about the quarter chord (n,) [N m] of sections."""
    drivetrain = turbine.drivetrain
    power = drivetrain.rated_power / drivetrain.generator_efficiency / drivetrain.gearbox_efficiency
    pitch = _least_pitch(turbine) + np.arange(0.0, _PITCH_RANGE, _PITCH_STEP)
    solved = elements.solve(turbine.rated_wind_speed, drivetrain.rated_rotor_speed, pitch)
    k = int(np.argmax(solved["power"]))  # beyond it the blade feathers
    k += int(np.argmax(solved["power"][k:] <= power))
    normal, driving, alpha, speed = (solved[name][k] for name in ("normal", "driving", "alpha", "speed"))
    cm = np.array([p.coefficients(a)[2] for p, a in zip(elements.polars, alpha.tolist(), strict=True)])
    c, s, width = math.cos(pitch[k]), math.sin(pitch[k]), elements.width
    force = width * np.column_stack([normal * c + driving * s, normal * s - driving * c, np.zeros(_SECTIONS)])
    return force, 0.5 * turbine.air_density * speed**2 * elements.chord**2 * cm * width


def _least_pitch(turbine: Turbine) -> float:
    """Least pitch of the turbine's own controller in rated wind [rad]."""
    own, lowest = turbine.control, turbine.pitch.min_pitch
    if own is not None and own.min_pitch_wind is not None and own.min_pitch is not None:
        return max(float(np.interp(turbine.rated_wind_speed, own.min_pitch_wind, own.min_pitch)), lowest)
    return max(_LEAST_PITCH if own is None or own.fine_pitch is None else own.fine_pitch, lowest)


def tip_twist(blade: Blade, z: Array, force: Array, moment: Array) -> float:
    """Rotation of the tip under forces (n, 3) at the quarter chords and moments about z (n,) of equal sections [rad].

    Parameters
    ----------
    z : ndarray, shape (n,)
        Middles of the sections from the root [m].
    """
    half = 0.5 * (z[1] - z[0])
    axis, ends = blade.axis_at(z), blade.axis_at(np.clip(np.append(z - half, z[-1] + half), 0.0, blade.length))
    step = np.diff(ends, axis=0)
    length = np.linalg.norm(step, axis=1)
    tangent = step / length[:, None]
    twist = blade.twist_at(z)
    aft = (0.25 - blade.le_offset_at(z)) * blade.chord_at(z)
    couple = np.cross(axis + aft[:, None] * np.column_stack([np.sin(twist), np.cos(twist), 0.0 * twist]), force)
    couple[:, 2] += moment
    # of all that acts farther out, and half of the section itself
    outer_force = np.cumsum(force[::-1], axis=0)[::-1] - 0.5 * force
    outer_moment = np.cumsum(couple[::-1], axis=0)[::-1] - 0.5 * couple - np.cross(axis, outer_force)
    turn = skew(np.cross([0.0, 0.0, 1.0], tangent))  # z of the section matrices is the tangent, by the shortest way
    to_local = np.swapaxes(np.eye(3) + turn + turn @ turn / (1.0 + tangent[:, 2, None, None]), 1, 2)
    loads = np.einsum("sij,skj->ski", to_local, np.stack([outer_force, outer_moment], axis=1)).reshape(-1, 6)
    unit = np.hstack([np.zeros_like(axis), to_local @ tangent[-1]])
    stiffness = blade.structure.stiffness_at(blade.station_at(z))
    first = 2 if blade.structure.shear_rigid else 0  # what is rigid has no compliance
    strain = np.linalg.solve(stiffness[:, first:, first:], loads[:, first:, None])[..., 0]
    return float(np.sum(np.sum(unit[:, first:] * strain, axis=1) * length))
