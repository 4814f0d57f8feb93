"""Design of a turbine's controller: its own data where there are any, else rules for its rotor and tower.

Speed loop
----------
Where nothing is published, the pitch controller places the poles of the rotor speed at a natural frequency omega_n
and a damping ratio of 0.7 (Hansen et al., Control design for a pitch-regulated, variable speed wind turbine,
Riso-R-1500, 2005, section 2, which recommends 0.6 to 0.8). omega_n is the least of four frequencies, the first
two at 1.2 times the rated wind speed with sigma the standard deviation of the normal turbulence model (IEC 61400-1) for
the turbine's class:

- *inertia*: with which a step of the wind by sigma raises the rotor speed by no more than 2 %. Above rated a pole pair
  of damping 1 answers a step dQ of the moment with ``dQ/J t exp(-omega_n t)``, at most ``dQ/(e J omega_n)``, so
  ``omega_n = (dQ/dV) sigma/(e J Omega 0.02)``;
- *pitch rate*: with which that step asks the drives for no more than 0.4 of their rate; the pitch moves through
  ``(dtheta/dV) sigma`` in about ``1/omega_n``, so ``omega_n = 0.4 theta'_max/((dtheta/dV) sigma)``;
- *tower*: 0.3 times the first fore-aft frequency. A pitch loop near that frequency takes the damping of the air from
  the tower (Larsen and Hanson, J. Phys.: Conf. Ser. 75 (2007) 012073; Bossanyi, Wind Energy 6 (2003) 119);
- *filter*: at which the filter on the generator speed lags by no more than that of the NREL 5-MW at its 0.6 rad/s, 21
  deg: 0.38 of the corner of a filter of first order. The poles are placed without the filter, and near rated, where the
  rotor answers to the pitch half as much as the gains assume once the wake has followed, its lag takes the damping that
  is left: the IEA 10-MW with 0.61 rad/s for a corner of 1.12 rad/s swings between fine pitch and 8 deg in a steady
  wind of 11 m/s, with 0.43 rad/s it is steady.

The rule gives 0.6 rad/s for the NREL 5-MW, whose filter it takes, and 0.20 to 0.21 rad/s for the IEA 15-MW and 22-MW
(published: 0.2), and 0.43 rad/s for the IEA 10-MW (0.08 to 0.25).

Sensitivity
-----------
``dP/dtheta`` with the induced velocities held, along the steady operating points above rated, and a straight line
over the pitch through them: its value at zero and the pitch at which it has doubled (NREL/TP-500-38060, section 7.3).
Between 10 and 24 deg the line of the NREL 5-MW lies within 9 % of the published one, -25.52 (1 + theta/6.302 deg)
MW/rad.

Collective edgewise mode
------------------------
All blades against hub and generator, as a speed controller meets it. Where hub and generator are light, the hub swings
far in this mode and the measured speed with it. A pitch loop that answers feeds the mode, since filter, drive and time
step turn its phase by more than half a turn there.

One assumed shape w(s) along the blade, its deflection under the inertial load m(s) r(s) of an accelerating rotor, gives
the clamped frequency by Rayleigh's quotient and, with the speed of the rigid rotor as second coordinate,

``J a + P q" = T``, ``P a + M (q" + 2 zeta w_e q' + w_e^2 q) = kappa T``

with ``M = n int m w^2 ds``, ``P = n int m r w ds`` and ``kappa = int w r^2 ds / int r^3 ds`` for a torque that grows
with r^2 along the blade. Blade and hub then swing with ``w_r = w_e / sqrt(1 - P^2 / (J M))``.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from wt_gym.base.errors import ControllerError
from wt_gym.control.rotor import Rotor, fine_pitch, rotor_of
from wt_gym.turbines import Support, Tower, Turbine
from wt_gym.turbines.model import at_controller_density
from wt_gym.wind.iec import REFERENCE_INTENSITY, turbulence_sigma


def reference_flap_moment(turbine: Turbine) -> float:
    """Root moment of a blade that carries its share of the Betz thrust at rated wind at 2/3 of the radius [N m].

    12.4 MN m for the NREL 5-MW, whose mean flapwise moment at rated is about 10 MN m.
    """
    radius = turbine.rotor_diameter / 2
    dynamic_pressure = 0.5 * turbine.air_density * turbine.rated_wind_speed**2
    thrust = 8 / 9 * dynamic_pressure * math.pi * radius**2
    return thrust / turbine.n_blades * 2 / 3 * radius


def reference_tower_moment(turbine: Turbine) -> float:
    """Tower-base moment of the Betz thrust at rated wind [N m]."""
    thrust = reference_flap_moment(turbine) * turbine.n_blades / (turbine.rotor_diameter / 3)
    return thrust * turbine.hub_height


_REFERENCE_SPEED = 12.1 * (math.pi / 30.0)
"""Rated speed of the rotor for which times and rates of rules were chosen, that of the NREL 5-MW [rad/s]."""


def flap_moment_sensitivity(turbine: Turbine) -> float:
    """Fall of the flapwise root moment with the pitch of a blade at rated speed [N m/rad], positive.

    ``rho/2 2 pi Omega^2 int c r^2 (r - r_root) dr``: thin-airfoil lift in the speed of rotation alone, without the
    change of induction and without the lag of the wake, hence an upper bound, about 1.5 times what a blade shows.
    """
    blade, speed = turbine.blade, turbine.drivetrain.rated_rotor_speed
    along = np.linspace(0.0, blade.length, 101)
    radius = blade.root_radius + along
    lift = math.pi * turbine.air_density * speed**2 * radius**2 * blade.chord_at(along)
    return float(np.trapezoid(lift * along, along))


def slower_than_reference(turbine: Turbine) -> float:
    """Time of a turn at rated speed over that of a rotor of 12.1 rpm: by how much times of rules are longer [-]."""
    return _REFERENCE_SPEED / turbine.drivetrain.rated_rotor_speed


def same_rotor(one: Turbine, other: Turbine) -> bool:
    """Whether two turbines have the same rotor and drive train, whatever tower or monopile these stand on."""
    from wt_gym.simulation.contract import fingerprint

    def rotor(turbine: Turbine) -> str:
        return fingerprint(turbine.n_blades, turbine.rotor_diameter, turbine.blade, turbine.hub, turbine.drivetrain)

    return rotor(one) == rotor(other)


@dataclass(frozen=True)
class TowerTop:
    """A tower as a spring with a mass on it, in its first bending mode."""

    mass: float  #: nacelle, rotor and a share of the tower [kg]
    fore_aft: float  #: natural frequency [rad/s]
    side_side: float  #: natural frequency [rad/s]
    force_per_moment: float
    """Side force at the top that bends the tower as far as a moment about the wind's axis does [1/m]."""


def tower_top(turbine: Turbine) -> TowerTop:
    """First bending modes of a tower, from the deflection under a force at its top.

    The tower's own mass counts with the square of that deflection (Rayleigh's quotient). Rotor and nacelle are a point
    mass at the top. A monopile bends with the tower, turns and shifts on its foundation, and carries water along.
    """
    top = turbine.tower_top_mass
    column = _column(turbine.tower)
    z = np.linspace(0.0, column.station[-1], 201)
    arm, step = z[-1] - z, np.diff(z)[0]
    line = np.interp(z, column.station, column.mass) + column.water(z)

    def frequency(axis: int) -> tuple[float, float, float]:
        """Frequency [rad/s], modal mass [kg] and ratio of deflections under a moment and a force [1/m]."""
        bending = np.interp(z, column.station, column.stiffness[:, axis, axis])
        (shift, turn), (shift_by_moment, turn_by_moment) = column.base(axis)
        slope = _integral(arm / bending, step)
        shape = _integral(slope, step) + shift + turn * z
        by_moment = _integral(_integral(1.0 / bending, step), step)[-1] + shift_by_moment + turn_by_moment * z[-1]
        shares = (shape / shape[-1]) ** 2
        mass = top + float(np.trapezoid(line * shares, z)) + column.lump * float(np.interp(column.lump_at, z, shares))
        return math.sqrt(1.0 / (shape[-1] * mass)), mass, float(by_moment / shape[-1])

    fore_aft, mass, _ = frequency(4)
    side_side, _, ratio = frequency(3)
    return TowerTop(mass, fore_aft, side_side, ratio)


def platform_pitch_frequency(turbine: Turbine) -> float:
    """Undamped natural frequency of the pitch of a floating turbine [rad/s].

    Platform, tower and nacelle are one rigid body that surges and pitches, with the added mass of infinite frequency;
    the lines, which hardly resist pitch, are left out: with M and C about the origin at still water the frequency is
    the root of (M⁻¹ C)₅₅, C₅₅ that of water plane and buoyancy minus the weight times its height.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        For a turbine that does not float, or falls over.
    """
    floater = turbine.floater
    if floater is None:
        raise ControllerError(f"the platform's pitch must be that of a floating turbine, got {turbine.name!r}")
    tower = turbine.tower.structure
    line, height = tower.inertia[:, 0, 0], turbine.tower.base_height + tower.station
    top = turbine.tower_top_mass
    moments = [float(np.trapezoid(line * height**n, tower.station)) + top * turbine.hub_height**n for n in range(3)]
    motions = np.ix_([0, 4], [0, 4])
    mass = (floater.mass_matrix + floater.radiation.added_mass_infinite)[motions]
    mass += np.array([[moments[0], moments[1]], [moments[1], moments[2]]])
    stiffness = float(floater.hydrostatic[4, 4] + floater.additional_stiffness[4, 4])
    stiffness -= floater.gravity * (floater.mass * float(floater.center[2]) + moments[1])
    squared = float(np.linalg.inv(mass)[1, 1]) * stiffness
    if squared <= 0.0:
        raise ControllerError(f"{turbine.name!r} must be upright by itself: its stiffness in pitch is {stiffness:.3g}")
    return math.sqrt(squared)


@dataclass(frozen=True)
class _Column:
    """Tower with the support it may stand on: tables from the foot up, a lump of mass, and the ground."""

    station: NDArray[np.float64]  # (n,) [m]
    stiffness: NDArray[np.float64]  # (n, 6, 6)
    mass: NDArray[np.float64]  # (n,) [kg/m]
    lump: float  # [kg]
    lump_at: float  # [m]
    support: Support | None

    def water(self, z: NDArray[np.float64]) -> NDArray[np.float64] | float:
        """Mass per length of the water that moves along [kg/m], at distances from the foot (n,) [m]."""
        return 0.0 if self.support is None else np.where(z <= self.lump_at, self.support.added_mass_at(z), 0.0)

    def base(self, axis: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Shift [m] and turn [rad] of the foot under a unit force at the top, and under a unit moment."""
        if self.support is None or self.support.foundation is None:
            return (0.0, 0.0), (0.0, 0.0)
        move, sign = (0, 1.0) if axis == 4 else (1, -1.0)  # a push along y turns the foot about -x
        spring = self.support.foundation[np.ix_([move, axis], [move, axis])]
        by_force = np.linalg.solve(spring, [1.0, sign * self.station[-1]])
        by_moment = np.linalg.solve(spring, [0.0, sign])
        return (float(by_force[0]), sign * float(by_force[1])), (float(by_moment[0]), sign * float(by_moment[1]))


def _column(tower: Tower) -> _Column:
    table, support = tower.structure, tower.support
    if support is None:
        return _Column(table.station, table.stiffness, table.inertia[:, 0, 0], 0.0, 0.0, None)
    below = support.structure
    return _Column(
        np.concatenate([below.station, support.length + table.station]),
        np.concatenate([below.stiffness, table.stiffness]),
        np.concatenate([below.inertia[:, 0, 0], table.inertia[:, 0, 0]]),
        support.top_mass,
        support.length,
        support,
    )


def _integral(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Integral from the start by the trapezoidal rule, shape of the values."""
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))))


DAMPING_RATIO = 0.7
LARGEST_EXCURSION = 0.02
"""Of the rotor speed after a step of the wind by one standard deviation, in rated speeds [-]."""
SHARE_OF_PITCH_RATE = 0.4
SHARE_OF_TOWER = 0.3
FILTER_OVER_ROTOR_SPEED = 1.570796 / (12.1 * math.pi / 30)
"""Corner of the speed filter over the rated rotor speed where nothing is published: as of the NREL 5-MW (a quarter of
its first edgewise frequency, which scales with the rotor speed) [-]."""
LARGEST_FILTER_LAG = math.atan(0.6 / 1.570796)
"""Of the speed filter at the natural frequency: that of the NREL 5-MW [rad]."""
DESIGN_WIND = 1.2
"""Wind of the speed loop's design in rated wind speeds [-]."""
_TRIM = np.linspace(1.02, 2.2, 13)
"""Winds of the steady points of the sensitivity, in winds of full power [-]."""


@dataclass(frozen=True)
class DesignPoint:
    """Numbers of a rotor that a controller needs beyond its dimensions."""

    peak_power_coefficient: float  #: largest power coefficient, reached at ``tip_speed_ratio`` and ``fine_pitch`` [-]
    tip_speed_ratio: float  #: optimal tip-speed ratio [-]
    fine_pitch: float  #: pitch of optimal power below rated; the least one of a schedule over the wind [rad]
    pitch_sensitivity: float
    """Change of aerodynamic power with collective pitch at rated speed and zero pitch, divided by the rated
    mechanical power [1/rad]; negative."""
    gain_doubling_pitch: float  #: pitch at which the sensitivity has doubled [rad]
    damping_ratio: float  #: desired, of the closed-loop rotor speed above rated [-]
    natural_frequency: float  #: desired, of the same [rad/s]


@dataclass(frozen=True)
class SpeedLoop:
    """Natural frequencies that the rule of this module allows [rad/s]."""

    by_inertia: float
    by_pitch_rate: float
    by_tower: float
    by_filter: float

    @property
    def natural_frequency(self) -> float:
        """The least of them [rad/s]."""
        return min(self.by_inertia, self.by_pitch_rate, self.by_tower, self.by_filter)


def rated_mechanical_power(turbine: Turbine) -> float:
    """Power on the high-speed shaft at rated electrical power [W]."""
    return turbine.drivetrain.rated_power / turbine.drivetrain.generator_efficiency


def aerodynamic_rated_power(turbine: Turbine) -> float:
    """Power of the air on the rotor at rated electrical power [W]."""
    return rated_mechanical_power(turbine) / turbine.drivetrain.gearbox_efficiency


def rotor_inertia(turbine: Turbine) -> float:
    """Inertia of rotor and generator about the low-speed shaft [kg m^2].

    Blades are rigid and coned: a section at distance r along the blade moves on a circle of radius r cos(cone).
    """
    station = turbine.blade.structure.station
    mass = turbine.blade.structure.inertia[:, 0, 0]
    radius = (turbine.blade.root_radius + station) * math.cos(turbine.hub.cone)
    blades = turbine.n_blades * np.trapezoid(mass * radius**2, station)
    generator = turbine.drivetrain.gear_ratio**2 * turbine.drivetrain.generator_inertia
    return float(blades + turbine.hub.inertia_axial + generator)


@lru_cache(maxsize=32)
def full_power_wind(turbine: Turbine) -> float:
    """Least wind at which the rotor makes rated power at rated speed and fine pitch [m/s], by blade elements."""
    rotor, speed, power = rotor_of(turbine), turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine)
    winds = np.linspace(0.5 * turbine.rated_wind_speed, turbine.cut_out, 61)
    enough = rotor.power(winds, speed, fine_pitch(turbine)) >= power
    if not enough.any():
        return turbine.cut_out
    k = int(np.argmax(enough))
    if k == 0:
        return float(winds[0])
    found = brentq(lambda v: float(rotor.power(v, speed, fine_pitch(turbine))[0]) - power, winds[k - 1], winds[k])
    return float(found)


def trim_pitch(turbine: Turbine, wind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steady pitch at rated speed and power [rad], shape (n,), in winds above rated (n,) [m/s].

    The published one where the turbine's data have it, else by blade elements.
    """
    own = turbine.control
    if own is not None and own.trim_wind is not None and own.trim_pitch is not None:
        # over the ratio to rated wind, where the table begins; in degrees, with whose digits such tables are published
        ratio, degrees = np.asarray(wind) / turbine.rated_wind_speed, np.round(np.degrees(own.trim_pitch), 12)
        return np.radians(np.interp(ratio, own.trim_wind / own.trim_wind[0], degrees))
    speed, power = turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine)
    return rotor_of(turbine).pitch_of_power(wind, speed, power, fine_pitch(turbine))


@lru_cache(maxsize=32)
def speed_loop(turbine: Turbine) -> SpeedLoop:
    """Frequencies of the rule in the docstring of this module."""
    rotor, drivetrain = rotor_of(turbine), turbine.drivetrain
    wind, speed = DESIGN_WIND * full_power_wind(turbine), drivetrain.rated_rotor_speed
    power, least = aerodynamic_rated_power(turbine), fine_pitch(turbine)
    around = rotor.pitch_of_power(np.array([0.98 * wind, wind, 1.02 * wind]), speed, power, least)
    turbulence = turbine.turbulence_class if turbine.turbulence_class in REFERENCE_INTENSITY else "B"
    sigma = turbulence_sigma(wind, turbulence)
    slope = max(float(around[2] - around[0]) / (0.04 * wind), 1e-6)
    gust = max(rotor.slopes(wind, speed, float(around[1])).torque_wind, 0.0) * sigma
    return SpeedLoop(
        by_inertia=gust / (math.e * rotor_inertia(turbine) * speed * LARGEST_EXCURSION),
        by_pitch_rate=SHARE_OF_PITCH_RATE * turbine.pitch.max_rate / (slope * sigma),
        by_tower=SHARE_OF_TOWER * tower_top(turbine).fore_aft,
        by_filter=_frequency_of_lag(*speed_filter(turbine), LARGEST_FILTER_LAG),
    )


def speed_filter(turbine: Turbine) -> tuple[float, float]:
    """Corner [rad/s] and damping ratio of the filter on the generator speed; a damping of 0 is one of first order.

    Published ones, else by rule of first order with a corner in proportion to the rated rotor speed.
    """
    own = turbine.control
    if own is not None and own.speed_filter_frequency is not None:
        return own.speed_filter_frequency, own.speed_filter_damping or 0.0
    return FILTER_OVER_ROTOR_SPEED * turbine.drivetrain.rated_rotor_speed, 0.0


def _frequency_of_lag(corner: float, damping: float, lag: float) -> float:
    """Frequency at which a low-pass filter lags by an angle below a right one [rad/s].

    With x the frequency over the corner, ``tan(lag) = x`` of first order and ``2 damping x/(1 - x^2)`` of second.
    """
    slope = math.tan(lag)
    if damping == 0.0:
        return corner * slope
    return corner * (math.sqrt(damping**2 + slope**2) - damping) / slope


def _sensitivity(turbine: Turbine, rotor: Rotor) -> tuple[float, float]:
    """Change of power with pitch at zero pitch over rated power [1/rad], and its doubling pitch [rad]."""
    speed, power, least = turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine), fine_pitch(turbine)
    winds = _TRIM * full_power_wind(turbine)
    pitch = rotor.pitch_of_power(winds, speed, power, least)
    slope = np.array(
        [rotor.frozen_pitch_slope(v, speed, p) for v, p in zip(winds.tolist(), pitch.tolist(), strict=True)]
    )
    rise, at_zero = np.polyfit(pitch, slope / power, 1)
    if not (at_zero < 0.0 and rise < 0.0):  # no straight line through zero describes such a rotor: hold the mean
        return float(np.mean(slope) / power), 10.0
    return float(at_zero), float(at_zero / rise)


def published(turbine: Turbine, name: str) -> Any:
    """A number that a turbine's data publish of its controller (`wt_gym.turbines.ControlData`), None without."""
    return getattr(turbine.control, name, None)


@lru_cache(maxsize=32)
def design_point(turbine: Turbine) -> DesignPoint:
    """Design point of a turbine: published numbers where its data have them, else by the rules of this module.

    The rules hold for the air for which the turbine's controller is designed.
    """
    turbine = at_controller_density(turbine)
    rotor, fine = rotor_of(turbine), fine_pitch(turbine)

    ratio = published(turbine, "optimal_tip_speed_ratio") or rotor.best_ratio(fine)[0]
    power_per_pitch, doubling = published(turbine, "power_per_pitch"), published(turbine, "gain_doubling_pitch")
    if power_per_pitch is not None and doubling is not None:
        published_power = published(turbine, "rated_mechanical_power") or rated_mechanical_power(turbine)
        sensitivity = power_per_pitch / published_power
    else:
        sensitivity, doubling = _sensitivity(turbine, rotor)
    return DesignPoint(
        peak_power_coefficient=published(turbine, "peak_power_coefficient") or rotor.power_coefficient(ratio, fine),
        tip_speed_ratio=ratio,
        fine_pitch=fine,
        pitch_sensitivity=sensitivity,
        gain_doubling_pitch=doubling,
        damping_ratio=published(turbine, "damping_ratio") or DAMPING_RATIO,
        natural_frequency=published(turbine, "natural_frequency") or speed_loop(turbine).natural_frequency,
    )


@dataclass(frozen=True)
class DriveMode:
    """The mode of a free rotor."""

    frequency: float  #: of all blades against hub and generator [rad/s]
    clamped_frequency: float  #: of a blade on a hub that is held [rad/s]
    response: float
    """Amplitude of the hub's acceleration at ``frequency`` with a unit of damping, over that of a rigid rotor
    [-]."""
    damping_ratio: float  #: of the blade's material [-]

    def amplification(self) -> float:
        """Amplitude of the speed at the mode's frequency over that of a rigid rotor under the same torque [-].

        Damped by the material alone: the air damps edgewise motion little, and feeds it near stall.
        """
        damping = 2.0 * self.damping_ratio * self.clamped_frequency * self.frequency
        return self.response / damping if damping > 0.0 else math.inf


def drive_mode(turbine: Turbine) -> DriveMode:
    """Collective edgewise mode of a turbine at rest, with a stiff shaft."""
    blade, n = turbine.blade, turbine.n_blades
    s, mass = blade.structure.station, blade.structure.inertia[:, 0, 0]
    r = (blade.root_radius + s) * math.cos(turbine.hub.cone)
    load = mass * r
    shape = _deflection(s, load, blade.structure.stiffness[:, 3, 3])
    clamped_squared = np.trapezoid(load * shape, s) / np.trapezoid(mass * shape**2, s)
    modal_mass, shared = n * np.trapezoid(mass * shape**2, s), n * np.trapezoid(load * shape, s)
    squared = clamped_squared / (1.0 - shared**2 / (rotor_inertia(turbine) * modal_mass))
    blade_share = np.trapezoid(shape * r**2, s) / np.trapezoid(r**3, s)
    response = abs(clamped_squared - squared + squared * shared * blade_share / modal_mass)
    return DriveMode(math.sqrt(squared), math.sqrt(clamped_squared), float(response), blade.damping_ratio)


def _deflection(
    s: NDArray[np.float64], load: NDArray[np.float64], bending_stiffness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deflection of a cantilever under a distributed load [N/m]: the load integrated four times."""
    shear = _from_tip(s, load)
    return _from_root(s, _from_root(s, _from_tip(s, shear) / bending_stiffness))


def _from_root(s: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    out: NDArray[np.float64] = cumulative_trapezoid(y, s, initial=0.0)
    return out


def _from_tip(s: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    whole = _from_root(s, y)
    out: NDArray[np.float64] = whole[-1] - whole
    return out
