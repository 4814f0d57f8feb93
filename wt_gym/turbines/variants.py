"""Turbines with another generator or the other direction of rotation; clearance of the blades from the tower.

The generator may be a linear damper, M = c Ω, that takes no demand (Gebhardt et al. 2012). Generator and converter may
have a lag, losses and a damping of the shaft, beyond a torque that is there at once and one efficiency:

*Lag.* The converter controls the currents, and with them the torque T, towards the demand T_d by a closed loop whose
lag is of first order: tau dT/dt = T_d - T. The current loops of full converters have bandwidths of tens to hundreds of
rad/s; reference turbines model the whole path from demand to torque by such a lag (DTU Wind Energy Controller: Hansen
and Henriksen, DTU Wind Energy E-0028, 2013). `Drivetrain.max_torque_rate` still limits the rate.

*Losses.* The difference between shaft power and electrical power, with the speed x and the torque t of the generator
over their rated values and the losses L at rated operation, is

    L [c t^2 + i (x + x^2) / 2 + k (1 + 10 t + 5 t^2 + 10 x t + 5 x^2 t^2) / 31],   c + i + k = 1:

copper losses with the square of the current and so of the torque; iron losses of hysteresis and eddy currents, in
proportion to the frequency and to its square; converter losses, a part that is always there, one in proportion to the
current of generator and grid, and one with their squares (Polinder et al., IEEE Transactions on Energy Conversion 21,
2006, 725, sections II.C and II.D, for direct-drive and geared generators with full converters). The current of the grid
side is taken in proportion to the shaft power. L follows from the efficiency of the turbine's generator, which is that
at rated operation; a generator without torque is off and has no losses.

*Damping of the shaft.* The rotor J_r and the geared generator J_g = N^2 J_hss turn against each other on the spring k
of the shaft with omega^2 = k (1/J_r + 1/J_g). A torque c (Omega_g - mean) that the converter adds brakes the
generator's part of this motion (`wt_gym.simulation.drivetrain.drives.DampingTorque`): with the mode (-J_g, J_r)/(J_r +
J_g) of unit twist and its mass mu = J_r J_g/(J_r + J_g) it adds the damping ratio

    zeta = c (J_r/(J_r + J_g))^2 / (2 omega mu),   so that   c = 2 zeta omega J_g (J_r + J_g)/J_r.

Industry's controllers add such a torque at the frequency of the shaft to the demand (Burton, Jenkins, Sharpe and
Bossanyi, Wind Energy Handbook, 2nd ed. 2011, section 8.3.6).

A turbine whose rotor turns counter-clockwise is the mirror image, y to -y, of one that turns clockwise. With
S = diag(1, -1, 1) positions, velocities and forces become S p; angular velocities and moments, which are
pseudovectors, -S m; rotations and inertias S R S. A matrix (6, 6) of stiffness or inertia, which maps three
displacements and three rotations to forces and moments, becomes T M T with T = diag(1, -1, 1, -1, 1, -1).

All of the turbine that is described in the frame of a blade stays as it is: that frame (z to the tip, x to the suction
side, y to the trailing edge) is reflected with the blade and is left-handed where the rotor turns counter-clockwise.
What is described in axes that the direction of rotation does not turn, nacelle and tower, is reflected.
"""

import math
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.platform import Platform
from wt_gym.turbines.blade import BeamStations, Blade
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.model import STRONGEST, Drivetrain, Hub, LossShares, ShaftDamper, Turbine

MOST_TORQUE = 1.1
"""Greatest torque that a damper is to bear, over that at rated power, for the range of sensors."""


def with_damper(turbine: Turbine) -> Turbine:
    """Return the turbine with its generator as a linear damper, which takes no demand.

    Rated rotor speed is then that at which the damper makes the rated power, unless the rotor's own is lower: with
    2.0e6 N m s/rad and 2.3 MW 10.2 rpm instead of 16 rpm. A turbine with a damper is returned as it is.
    """
    drivetrain = turbine.drivetrain
    if not drivetrain.takes_torque:
        return turbine
    if not drivetrain.generator_damping > 0.0:
        raise fail(
            f"generator of {turbine.name!r}", "damper", "'torque': its Drivetrain.generator_damping [N m s/rad] is 0"
        )
    # a damper c makes the electrical power P = η c Ω², with the efficiency η of gearbox and generator
    efficiency = drivetrain.gearbox_efficiency * drivetrain.generator_efficiency
    speed = math.sqrt(drivetrain.rated_power / (efficiency * drivetrain.generator_damping))
    speed = min(speed, drivetrain.rated_rotor_speed)
    torque = drivetrain.generator_damping * speed * drivetrain.gearbox_efficiency / drivetrain.gear_ratio
    damped = replace(
        drivetrain,
        rated_rotor_speed=speed,
        min_rotor_speed=min(drivetrain.min_rotor_speed, 0.6 * speed),
        max_generator_torque=MOST_TORQUE * torque,
        max_torque_rate=0.0,
    )
    return replace(turbine, drivetrain=damped)


GENERATORS = ("torque", "damper")

Law = TypeVar("Law")
"""A custom law, see `wt_gym.simulation.drivetrain.drives`."""


def with_generator(turbine: Turbine, choice: str | Law | None) -> tuple[Turbine, Law | None]:
    """A turbine with the generator that is chosen by name, and what is left of the choice: a custom law, or None.

    Parameters
    ----------
    choice : "torque", "damper", None or object
        None: what the turbine has.
    """
    if not isinstance(choice, str):
        return turbine, choice
    if choice not in GENERATORS:
        raise fail("generator", choice, f"one of {GENERATORS} or a law of wt_gym.simulation.drivetrain.drives")
    if choice == "damper":
        return with_damper(turbine), None
    if not turbine.drivetrain.takes_torque:
        raise fail(f"generator of {turbine.name!r}", choice, "'damper': its generator takes no demand")
    return turbine, None


def electrical_power(drivetrain: Drivetrain, speed: float, torque: float) -> float:
    """Electrical power [W] of a generator with a map of losses.

    Parameters
    ----------
    drivetrain : Drivetrain
        With ``losses``.
    speed : float
        Of the generator, high-speed shaft [rad/s].
    torque : float
        [N m].
    """
    shares, efficiency = drivetrain.losses, drivetrain.generator_efficiency
    if shares is None:
        return speed * torque * efficiency
    if torque == 0.0:
        return 0.0
    shaft = drivetrain.rated_power / efficiency
    rated_speed = drivetrain.rated_rotor_speed * drivetrain.gear_ratio
    x, t = speed / rated_speed, torque * rated_speed / shaft
    p = x * t
    of_converter = (1.0 + 10.0 * t + 5.0 * t**2 + 10.0 * p + 5.0 * p**2) / 31.0
    losses = shares.copper * t**2 + 0.5 * shares.iron * (x + x**2) + shares.converter * of_converter
    return shaft * (p - (1.0 - efficiency) * losses)


def with_electrical(
    turbine: Turbine, torque_lag: float = 0.0, losses: LossShares | None = None, shaft_damping: float = 0.0
) -> Turbine:
    """Return a turbine with a lag of the generator torque, a map of losses, a damper; without any the turbine itself.

    Parameters
    ----------
    torque_lag : float
        tau [s]; 0: as the turbine has it.
    losses : LossShares, optional
        By default as the turbine has them.
    shaft_damping : float
        Damping ratio that the converter adds to the torsion of the shaft; 0: as the turbine has it [-].
    """
    given: dict[str, Any] = {}
    if torque_lag != 0.0:
        given["torque_lag"] = torque_lag
    if losses is not None:
        given["losses"] = losses
    if shaft_damping != 0.0:
        given["shaft_damper"] = shaft_damper_of(turbine, shaft_damping)
    return replace(turbine, drivetrain=replace(turbine.drivetrain, **given)) if given else turbine


def shaft_damper_of(turbine: Turbine, damping_ratio: float) -> ShaftDamper:
    """Damper that adds a damping ratio to the torsion of a turbine's shaft, its blades taken as rigid.

    Parameters
    ----------
    damping_ratio : float
        zeta, at most `STRONGEST` [-].
    """
    check_number("damping_ratio of a ShaftDamper", damping_ratio, 0.0, STRONGEST, open_low=True)
    drivetrain = turbine.drivetrain
    rotor = rotor_inertia_without_generator(turbine.blade, turbine.hub, turbine.n_blades)
    generator = drivetrain.generator_inertia * drivetrain.gear_ratio**2
    frequency = math.sqrt(drivetrain.spring * (1.0 / rotor + 1.0 / generator))
    return ShaftDamper(2.0 * damping_ratio * frequency * generator * (rotor + generator) / rotor, frequency)


def rotor_inertia_without_generator(blade: Blade, hub: Hub, n_blades: int) -> float:
    """Inertia of straight, unconed blades and hub about the shaft [kg m^2]."""
    m0, m1, m2 = (blade.structure.mass_moment(k) for k in range(3))
    return float(n_blades * (m2 + 2.0 * hub.radius * m1 + hub.radius**2 * m0) + hub.inertia_axial)


REFLECTION = np.array([1.0, -1.0, 1.0])
"""Signs of a vector's components after the reflection."""
REFLECTION_6 = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the components of a vector and a pseudovector: displacement and rotation, or force and moment."""
REFLECTION.flags.writeable = REFLECTION_6.flags.writeable = False


def mirrored(turbine: Turbine) -> Turbine:
    """Return the mirror image of a turbine, whose rotor turns the other way.

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> mirrored(load_turbine("nrel_5mw")).rotation
    'counter-clockwise'
    """
    nacelle, tower, support = turbine.nacelle, turbine.tower, turbine.tower.support
    inertia = _signed(nacelle.inertia, np.outer(REFLECTION, REFLECTION))
    if support is not None:
        foundation = None if support.foundation is None else _mirrored_matrix(support.foundation)
        support = replace(support, structure=_mirrored_beam(support.structure), foundation=foundation)
    return replace(
        turbine,
        nacelle=replace(nacelle, cm=_signed(nacelle.cm, REFLECTION), inertia=inertia),
        tower=replace(tower, structure=_mirrored_beam(tower.structure), support=support),
        floater=None if turbine.floater is None else _mirrored_platform(turbine.floater),
        rotation="counter-clockwise" if turbine.rotation == "clockwise" else "clockwise",
    )


def _mirrored_platform(platform: Platform) -> Platform:
    radiation, excitation, flip = platform.radiation, platform.excitation, REFLECTION
    if not excitation.is_mirrored:
        excitation = replace(
            excitation, heading=-excitation.heading[::-1], real=_signed(excitation.real[:, ::-1], REFLECTION_6),
            imaginary=_signed(excitation.imaginary[:, ::-1], REFLECTION_6),
        )  # fmt: skip
    return replace(
        platform,
        center=_signed(platform.center, flip),
        inertia=_signed(platform.inertia, np.outer(flip, flip)),
        center_of_buoyancy=_signed(platform.center_of_buoyancy, flip[:2]),
        radiation=replace(
            radiation, added_mass=_mirrored_matrix(radiation.added_mass), damping=_mirrored_matrix(radiation.damping),
            added_mass_infinite=_mirrored_matrix(radiation.added_mass_infinite),
        ),
        excitation=excitation,
        members=tuple(replace(m, start=_signed(m.start, flip), end=_signed(m.end, flip)) for m in platform.members),
        plates=tuple(
            replace(p, position=_signed(p.position, flip), axis=_signed(p.axis, flip)) for p in platform.plates
        ),
        lines=tuple(
            replace(line, anchor=_signed(line.anchor, flip), fairlead=_signed(line.fairlead, flip))
            for line in platform.lines
        ),
        hydrostatic=_mirrored_matrix(platform.hydrostatic),
        linear_damping=_mirrored_matrix(platform.linear_damping),
        quadratic_damping=_mirrored_matrix(platform.quadratic_damping),
        additional_stiffness=_mirrored_matrix(platform.additional_stiffness),
    )  # fmt: skip


def clockwise_image(turbine: Turbine) -> Turbine:
    """Return the turbine if its rotor turns clockwise, else its mirror image, whose rotor does."""
    return turbine if turbine.rotation == "clockwise" else mirrored(turbine)


def _mirrored_beam(beam: BeamStations) -> BeamStations:
    return replace(beam, stiffness=_mirrored_matrix(beam.stiffness), inertia=_mirrored_matrix(beam.inertia))


def _mirrored_matrix(matrix: Array) -> Array:
    """Reflect matrices (..., 6, 6) of displacements and rotations."""
    return _signed(matrix, np.outer(REFLECTION_6, REFLECTION_6))


def _signed(values: Array, signs: Array) -> Array:
    """Values with signs; zeros stay as they are, so that what is alike on both sides is bit for bit its own image."""
    return np.where(values == 0.0, values, values * signs)


def unloaded_clearance(turbine: Turbine) -> float:
    """Distance of the tip of an undeformed blade from the tower's surface, where it passes it at zero pitch [m].

    The tip, on the blade's axis, lies at the prebend ``p`` (negative upwind), the sweep ``s`` and the distance
    ``R`` from the rotor's apex along the blade. With cone ``c`` it is ``a = p cos c - R sin c`` downwind of the apex
    along the shaft, on a circle of the radius ``q = hypot(s, p sin c + R cos c)``. The apex is the overhang ``h``
    upwind of the tower's axis along a shaft of tilt ``t``, which crosses that axis ``d`` above the tower's top. At the
    lowest point of its circle, in front of the tower's axis, the tip is therefore

        x = (h - a) cos t + q sin t             upwind of the axis,
        z = d + (h - a) sin t - q cos t         above the tower's top

    (rotations about y by tilt and cone; OpenFAST has the same angles, ElastoDyn's ``ShftTilt`` and ``PreCone`` with the
    other sign). The tower stands upright and is cut at the height of the tip: that its wall leans is neglected (for 1°
    an error of 0.02 %). A tip above the tower's top is measured to its rim, one below the tower's base to the base's
    diameter, as the simulator does (`wt_gym.simulation.step.coupling_kernels.signed_clearance`).

    Returns
    -------
    float
        [m]

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> round(unloaded_clearance(load_turbine("nrel_5mw")), 1)
    10.6
    """
    nacelle, tower, blade, cone = turbine.nacelle, turbine.tower, turbine.blade, turbine.hub.cone
    prebend, sweep, length = blade.axis_at(blade.length)
    reach = blade.root_radius + length
    ahead = nacelle.overhang - (prebend * math.cos(cone) - reach * math.sin(cone))
    circle = math.hypot(sweep, prebend * math.sin(cone) + reach * math.cos(cone))
    upwind = ahead * math.cos(nacelle.tilt) + circle * math.sin(nacelle.tilt)
    above = nacelle.tower_top_to_shaft + ahead * math.sin(nacelle.tilt) - circle * math.cos(nacelle.tilt)
    station = min(max(tower.length + above, 0.0), tower.length)
    gap = float(upwind - 0.5 * tower.diameter_at(station))
    return math.hypot(max(gap, 0.0), above) if above > 0.0 else gap
