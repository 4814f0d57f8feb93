"""Airfoil sections: contour, camber line and static polar, their linear blends, and stall delayed by rotation.

Near the axis the boundary layer of a stalled section is thrown outwards; Coriolis forces act on it as a favorable
pressure gradient, and the lift stays closer to that of attached flow than in a wind tunnel:

    cl = cl_2D + g (cl_pot - cl_2D),   cl_pot = cla (alpha - alpha0),

from the angle of zero lift upwards, in full to 30 degrees, from there on fading to nothing at 55 degrees, and inboard
of 80 % of the radius only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.attached_flow import attached_lift
from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.turbines.checks import ArrayRecord, fail

CAMBER_POINTS = 61
"""Chordwise points of the camber line; cosine spacing puts a third of them into the first 15 % of the chord."""

_TURN = np.pi + 1e-6
_LEAST_REVERSED_DRAG = -0.05
DRAG_ALLOWED = f"a drag of at least 0, or {_LEAST_REVERSED_DRAG:g} in flow from behind (beyond 90 deg)"


@option_record
class Polar(ArrayRecord):
    """Static section coefficients over the full circle, tables (n,)."""

    alpha: Array = option(
        "angle of attack from -pi to pi", unit="rad", shape=("alpha",), low=-_TURN, high=_TURN, ascending=2
    )
    cl: Array = option("lift", shape=("alpha",), low=-10, high=10)
    cd: Array = option("drag, not negative (`driving_drag`)", shape=("alpha",), low=-10, high=10)
    cm: Array = option("moment about the quarter chord, nose-up", shape=("alpha",), low=-10, high=10)

    def check(self) -> None:
        """Check what belongs together."""
        alpha, cd = self.alpha, self.cd
        if alpha[0] > -np.pi + 1e-6 or alpha[-1] < np.pi - 1e-6:
            raise fail("Polar.alpha", [float(alpha[0]), float(alpha[-1])], "a grid that reaches from -pi to pi")
        if (i := driving_drag(alpha, cd)) is not None:
            raise fail(f"Polar.cd[{i}] at {np.degrees(alpha[i]):.4g} deg", float(cd[i]), DRAG_ALLOWED)

    def coefficients(self, alpha: ArrayLike) -> tuple[Array, Array, Array]:
        """Return cl, cd and cm at angles of attack of any size.

        Parameters
        ----------
        alpha : array_like
            Angle of attack [rad]; wrapped into [-pi, pi).

        Returns
        -------
        cl, cd, cm : ndarray
            Linear interpolation in the table, shaped like ``alpha``.
        """
        angle = np.asarray(alpha, dtype=np.float64)
        wrapped = np.where(np.abs(angle) <= np.pi, angle, np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)
        return (
            np.interp(wrapped, self.alpha, self.cl),
            np.interp(wrapped, self.alpha, self.cd),
            np.interp(wrapped, self.alpha, self.cm),
        )


@option_record
class Airfoil(ArrayRecord):
    """One airfoil section."""

    name: str = option("of the section")
    relative_thickness: float = option("largest thickness divided by chord", low=0, high=1, above=True)
    contour: Array = option(
        "x/c and y/c from the trailing edge over the suction side to the leading edge and back on the pressure side; "
        "x/c from 0 (leading edge) to 1, y/c positive towards the suction side",
        shape=("contour", 2),
        low=-1,
        high=1,
    )
    camber_x: Array = option(
        "stations x/c of the camber line, from 0 to 1", shape=("camber",), low=0, high=1, ascending=2
    )
    camber: Array = option("height over chord, to the suction side positive", shape=("camber",), low=-0.5, high=0.5)
    polar: Polar = option("static coefficients", kinds=(Polar,))

    def __post_init__(self) -> None:
        """Name the section in messages: a blade has several."""
        try:
            super().__post_init__()
        except TurbineDefinitionError as error:
            raise TurbineDefinitionError(f"airfoil {self.name!r}: {error}") from error

    def camber_at(self, x_c: ArrayLike) -> tuple[Array, Array]:
        """Return height and slope of the camber line.

        Parameters
        ----------
        x_c : array_like
            Chordwise position x/c in [0, 1].

        Returns
        -------
        camber, slope : ndarray
            Height/chord and its derivative by x/c, shaped like ``x_c``: the height is piecewise linear, the slope is
            interpolated between second-order differences at the tabulated points.
        """
        x = np.asarray(x_c, dtype=np.float64)
        if np.any(~((x >= 0.0) & (x <= 1.0))):
            raise fail("x_c", x_c, "chordwise positions in [0, 1]")
        slope = np.gradient(self.camber, self.camber_x)
        return np.interp(x, self.camber_x, self.camber), np.interp(x, self.camber_x, slope)


def driving_drag(alpha: Array, cd: Array) -> int | None:
    """Return the index of the first drag coefficient that would drive the section, None if there is none.

    Tables of airfoils have small negative values in flow from behind, where they continue measured ones; OpenFAST uses
    them as they are.

    Parameters
    ----------
    alpha, cd : ndarray (n,)
        Angle of attack [rad], drag coefficient.
    """
    wrong = cd < np.where(np.abs(alpha) > 0.5 * np.pi, _LEAST_REVERSED_DRAG, 0.0)
    return int(np.argmax(wrong)) if np.any(wrong) else None


def _merged(first: Array, second: Array) -> Array:
    """Return the union of two grids of angles [rad].

    Grids written in degrees differ in the last digits after conversion; such twins must not make steps of zero width.
    """
    alpha = np.union1d(first, second)
    return alpha[np.concatenate(([True], np.diff(alpha) > 1e-9))]


def blend_polars(first: Polar, second: Polar, weight: float) -> Polar:
    """Return ``(1 - weight) * first + weight * second`` on the union of both angle grids (exact at both ends)."""
    if weight == 0.0 or first is second:
        return first
    if weight == 1.0:
        return second
    alpha = _merged(first.alpha, second.alpha)
    a, b = first.coefficients(alpha), second.coefficients(alpha)
    return Polar(alpha, *((1.0 - weight) * p + weight * q for p, q in zip(a, b, strict=True)))


def blend_airfoils(first: Airfoil, second: Airfoil, weight: float) -> Airfoil:
    """Return the section between two airfoils: polar, camber and thickness linear in ``weight`` from 0 to 1.

    The contour is blended surface by surface at common chordwise stations, as a loft between the two would give.
    """
    if weight == 0.0 or first is second:
        return first
    if weight == 1.0:
        return second
    x = cosine_grid(CAMBER_POINTS)
    upper, lower = (
        (1.0 - weight) * a + weight * b
        for a, b in zip(surfaces(first.contour, x), surfaces(second.contour, x), strict=True)
    )
    return Airfoil(
        name=f"{first.name} + {weight:.3f} ({second.name} - {first.name})",
        relative_thickness=(1.0 - weight) * first.relative_thickness + weight * second.relative_thickness,
        contour=contour_of(x, upper, lower),
        camber_x=x,
        camber=(1.0 - weight) * first.camber_at(x)[0] + weight * second.camber_at(x)[0],
        polar=blend_polars(first.polar, second.polar, weight),
    )


def cosine_grid(n: int) -> Array:
    """Return n points from 0 to 1, dense at both ends: x = (1 - cos t) / 2 with t uniform in [0, pi]."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n)))
    x[0], x[-1] = 0.0, 1.0
    return x


def contour_of(x: Array, upper: Array, lower: Array) -> Array:
    """Return the contour (2 m - 1, 2) of two surfaces at chordwise stations (m,) from the nose to the trailing edge."""
    return np.vstack((np.column_stack((x, upper))[::-1], np.column_stack((x, lower))[1:]))


def suction_first(contour: Array) -> Array:
    """Return a contour (n, 2) with x/c from 0 to 1, which begins over the suction side."""
    x, y = contour.T
    # Shoelace formula: counter-clockwise (suction side first) has a positive area.
    x = (x - x.min()) / np.ptp(x)
    contour = np.column_stack((x, y))
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return contour if area > 0.0 else contour[::-1].copy()


def surfaces(contour: Array, x: Array) -> tuple[Array, Array]:
    """Return y/c of the suction and the pressure side (m,) of a contour (n, 2) at chordwise stations (m,).

    Interpolation is linear in the root of x/c: a round nose, y ~ sqrt(x/c), is a straight line in it, and a trailing
    edge stays the wedge it is.
    """
    nose = int(np.argmin(contour[:, 0]))
    root = np.sqrt(x)
    return _height(contour[: nose + 1][::-1], root), _height(contour[nose:], root)


def _height(branch: Array, root: Array) -> Array:
    """Interpolate one surface, given from the nose to the trailing edge, at roots of x/c (m,)."""
    # Contours may have two points at one x (a closed blunt trailing edge) or step back by a rounding error; the running
    # maximum keeps the branch a function of x, and the first point at one x is the edge of the surface itself.
    x = np.maximum.accumulate(branch[:, 0])
    keep = np.insert(np.diff(x) > 0.0, 0, True)
    out: Array = np.interp(root, np.sqrt(x[keep]), branch[keep, 1])
    return out


def camber_line(contour: Array, n: int = CAMBER_POINTS) -> tuple[Array, Array, float]:
    """Return the camber line of a contour: the mean of both surfaces at equal x/c.

    Parameters
    ----------
    contour : ndarray (k, 2)
        Trailing edge, suction side, leading edge, pressure side, trailing edge; chord along x from 0 to 1.
    n : int
        Number of cosine-spaced stations.

    Returns
    -------
    x, camber : ndarray (n,)
    thickness : float
        Largest distance between the surfaces divided by chord.
    """
    x = cosine_grid(n)
    upper, lower = surfaces(contour, x)
    return x, 0.5 * (upper + lower), float(np.max(upper - lower))


FULL, NONE = np.radians(30.0), np.radians(55.0)
"""Angles of attack up to which, and from which on, the lift is corrected in full and not at all [rad]."""
OUTERMOST = 0.8
"""Radius, in rotor radii, beyond which the flow round the tip rules."""
FINE = np.radians(np.arange(-20.0, 60.0, 0.5))
"""Angles at which a corrected polar is tabulated beside its own [rad]."""


def snel(chord_ratio: float, radius_ratio: float, tip_speed_ratio: float, slope: float) -> float:
    """Factor g of Snel, Houwink & Bosschers (ECN-C--93-052, 1993): 3.1 (c/r)^2 (Omega r / V_rel)^2.

    3.1 and the ratio of the section's own speed to that of its flow, here without induction, were added at ECN later.
    """
    local = (tip_speed_ratio * radius_ratio) ** 2
    return 3.1 * chord_ratio**2 * local / (1.0 + local)


def snel_1993(chord_ratio: float, radius_ratio: float, tip_speed_ratio: float, slope: float) -> float:
    """Factor g of Snel, Houwink & Bosschers as first published (ECN-C--93-052, 1993): 3 (c/r)^2."""
    return 3.0 * chord_ratio**2


def du_selig(chord_ratio: float, radius_ratio: float, tip_speed_ratio: float, slope: float) -> float:
    """Factor g of Du & Selig (AIAA-98-0021, 1998) with a = b = d = 1.

    (1/cla) [1.6 (c/r) / 0.1267 (a - (c/r)^E) / (b + (c/r)^E) - 1], E = (d / Lambda) (R / r),
    Lambda = Omega R / sqrt(V^2 + (Omega R)^2); their 2 pi is the slope of the lift here, as in AirfoilPrep.
    """
    exponent = np.sqrt(1.0 + tip_speed_ratio**2) / (tip_speed_ratio * radius_ratio)
    power = chord_ratio**exponent
    return float((1.6 * chord_ratio / 0.1267 * (1.0 - power) / (1.0 + power) - 1.0) / slope)


def eggers_drag(alpha: Array, extra_lift: Array) -> Array:
    """Drag that goes with lift gained by rotation (Eggers, Chaney & Digumarthi, ASME Wind Energy Symposium, 2003)."""
    sine, cosine = np.sin(alpha), np.cos(alpha)
    return extra_lift * (sine - 0.12 * cosine) / (cosine + 0.12 * sine)


MODELS = {"snel": (snel, None), "snel-1993": (snel_1993, None), "du-selig": (du_selig, eggers_drag)}
"""Factor of the lift and drag of the gained lift, by name."""


@option_record
class RotationalAugmentation(ArrayRecord):
    """Correction of the polars of one blade."""

    by_value = True

    model: str = option(
        '"du-selig": lift by Du & Selig, drag by Eggers et al., as AirfoilPrep combines them; "snel": lift by Snel et '
        'al. with the local speed ratio, drag unchanged; "snel-1993": the same as first published, without that ratio',
        choices=tuple(MODELS),
    )
    rotor_radius: float = option("of the rotor", unit="m", low=0, high=500, above=True)
    tip_speed_ratio: float = option("of the operation for which the polars are made", low=0.1, high=30)

    def factor(self, chord: float, radius: float, slope: float) -> float:
        """Share g of the way from the two-dimensional lift to that of attached flow, between 0 and 1.

        Parameters
        ----------
        chord, radius : float
            Of the section [m].
        slope : float
            Lift slope of its attached flow [1/rad].
        """
        if not 0.0 < radius <= OUTERMOST * self.rotor_radius:
            return 0.0
        lift, _ = MODELS[self.model]
        return float(np.clip(lift(chord / radius, radius / self.rotor_radius, self.tip_speed_ratio, slope), 0.0, 1.0))

    def of(self, polar: Polar, chord: float, radius: float) -> Polar:
        """Polar of a section that turns with the rotor.

        Parameters
        ----------
        polar : Polar
            Two-dimensional.
        chord, radius : float
            Of the section [m].

        Returns
        -------
        Polar
            The given one where nothing changes: outboard, and for a section without lift.
        """
        line = attached_lift(polar.alpha, polar.cl)
        if line is None:
            return polar
        alpha0, slope = line
        g = self.factor(chord, radius, slope)
        if g == 0.0:
            return polar
        alpha = _merged(polar.alpha, FINE)
        cl, cd, cm = polar.coefficients(alpha)
        share = np.where(alpha > alpha0, np.clip((NONE - alpha) / (NONE - FULL), 0.0, 1.0), 0.0)
        extra = g * share * (slope * (alpha - alpha0) - cl)
        _, drag = MODELS[self.model]
        if drag is not None:
            cd = np.maximum(cd + drag(alpha, extra), cd.min())
        return Polar(alpha, cl + extra, cd, cm)
