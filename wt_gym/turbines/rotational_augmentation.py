"""Stall delayed by rotation: two-dimensional polars turned into those of the sections of a turning blade.

Near the axis the boundary layer of a stalled section is thrown outwards; Coriolis forces act on it as a favorable
pressure gradient, and the lift stays closer to that of attached flow than in a wind tunnel:

    cl = cl_2D + g (cl_pot - cl_2D),   cl_pot = cla (alpha - alpha0),

from the angle of zero lift upwards, in full to 30 degrees, from there on fading to nothing at 55 degrees, and inboard
of 80 % of the radius only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.attached_flow import attached_lift
from wt_gym.turbines.airfoil import Polar
from wt_gym.turbines.checks import check_number, fail

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["MODELS", "RotationalAugmentation"]

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


def eggers_drag(alpha: NDArray[np.float64], extra_lift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Drag that goes with lift gained by rotation (Eggers, Chaney & Digumarthi, ASME Wind Energy Symposium, 2003)."""
    sine, cosine = np.sin(alpha), np.cos(alpha)
    return extra_lift * (sine - 0.12 * cosine) / (cosine + 0.12 * sine)


MODELS = {"snel": (snel, None), "snel-1993": (snel_1993, None), "du-selig": (du_selig, eggers_drag)}
"""Factor of the lift and drag of the gained lift, by name."""


@dataclass(frozen=True)
class RotationalAugmentation:
    """Correction of the polars of one blade.

    Parameters
    ----------
    model : str
        "du-selig": lift by Du & Selig, drag by Eggers et al., as AirfoilPrep combines them; "snel": lift by Snel et
        al. with the local speed ratio, drag unchanged; "snel-1993": the same as first published, without that ratio.
    rotor_radius : float
        [m].
    tip_speed_ratio : float
        Of the operation for which the polars are made.

    Raises
    ------
    TurbineDefinitionError
        For an unknown model, and a radius or a tip-speed ratio out of range.
    """

    model: str
    rotor_radius: float
    tip_speed_ratio: float

    def __post_init__(self) -> None:
        """Refuse values without meaning."""
        if self.model not in MODELS:
            raise fail("RotationalAugmentation.model", self.model, " or ".join(map(repr, MODELS)))
        check_number("RotationalAugmentation.rotor_radius", self.rotor_radius, 0.0, 500.0, open_low=True)
        check_number("RotationalAugmentation.tip_speed_ratio", self.tip_speed_ratio, 0.1, 30.0)

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
        alpha = np.union1d(polar.alpha, FINE)
        alpha = alpha[np.concatenate(([True], np.diff(alpha) > 1e-9))]
        cl, cd, cm = polar.coefficients(alpha)
        share = np.where(alpha > alpha0, np.clip((NONE - alpha) / (NONE - FULL), 0.0, 1.0), 0.0)
        extra = g * share * (slope * (alpha - alpha0) - cl)
        _, drag = MODELS[self.model]
        if drag is not None:
            cd = np.maximum(cd + drag(alpha, extra), cd.min())
        return Polar(alpha, cl + extra, cd, cm)
