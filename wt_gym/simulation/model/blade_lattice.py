"""The blade of a turbine as an aerodynamic lattice."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.aerodynamics import build_planform, span_distribution
from wt_gym.turbines.blade import iced_polar, spread

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.aerodynamics.lattice.planform import LatticePlanform
    from wt_gym.aerodynamics.options import AeroOptions
    from wt_gym.turbines import Blade, Turbine

__all__ = ["blade_planform", "span_edges", "strip_polar"]

N_ALPHA = 720
"""Angles of attack in the polar tables: one each half degree, as fine as published polars near stall."""
TOWARDS_ENDS, TOWARDS_TIP = 0.3, 0.5
"""Share of cosines, or sines, in the distribution of the strips of a blade."""
SAMPLES = 16
"""Sections over which chord and polar of a strip are averaged."""


def blade_planform(turbine: Turbine, options: AeroOptions) -> LatticePlanform:
    """Lattice of one blade.

    Parameters
    ----------
    turbine : Turbine
    options : AeroOptions
        Panels along chord and span.

    Returns
    -------
    LatticePlanform
    """
    blade = turbine.blade
    edges = span_edges(blade, options.n_span, options.narrow_strips)
    return build_planform(
        edges,
        blade.axis_at(edges),
        blade.chord_at(edges),
        blade.twist_at(edges),
        blade.le_offset_at(edges),
        _polars(turbine, edges),
        options.n_chord,
        blade.camber_at,
        np.array([blade.chord_at(_samples(*ends)).mean() for ends in pairwise(edges)]),
        blade.root_radius,
    )


def _polars(turbine: Turbine, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Polars of the strips of a blade, with ice on one of them of all blades."""
    blade, ice = turbine.blade, turbine.ice
    polars = np.array([strip_polar(blade, *ends) for ends in pairwise(edges)])
    if ice is None:
        return polars
    share = ice.level * spread(blade, 0.5 * (edges[1:] + edges[:-1]))
    iced = np.array([iced_polar(polar, part) for polar, part in zip(polars, share.tolist(), strict=True)])
    return np.concatenate([iced if b + 1 == ice.blade else polars for b in range(turbine.n_blades)])


def span_edges(blade: Blade, n_span: int, narrow: str = "ends") -> NDArray[np.float64]:
    """Span edges (n_span + 1,) of the strips of a blade [m].

    A root without lift gets strips of its own, half as many as an even lattice would have there: no strip is cylinder
    and airfoil at once, and where lift sets in, with the vortex that this sheds, the strips are the finer for it. With
    few strips those that carry lift are better narrow at the tip alone (``narrow``), where it falls steeply: ten of
    them then have the loads of forty within 1 %, else 2 to 3 % less.
    """
    edges, start = _lifting(0.0, blade.length, n_span, narrow), blade.lift_start
    if n_span < 2 or start < 0.5 * edges[1]:
        return edges
    n_root = min(max(round(0.5 * np.searchsorted(edges, start)), 1), n_span - 1)
    root = np.linspace(0.0, start, n_root + 1)
    return np.concatenate((root[:-1], _lifting(start, blade.length, n_span - n_root, narrow)))


def _lifting(root: float, tip: float, n_span: int, narrow: str) -> NDArray[np.float64]:
    """Edges of the strips that carry lift [m]."""
    return span_distribution(root, tip, n_span, TOWARDS_TIP if narrow == "tip" else TOWARDS_ENDS, towards=narrow)


def strip_polar(blade: Blade, low: float, high: float) -> NDArray[np.float64]:
    """Mean polar (N_ALPHA, 3) of a strip: cl, cd, cm from -pi on.

    The mean over the span, weighted with the chord and the square of the radius: at one angle of attack the strip then
    has the forces of its sections in the flow of the rotation.
    """
    alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
    z = _samples(low, high)
    weight = blade.chord_at(z) * (blade.root_radius + z) ** 2
    polars = [np.column_stack(blade.polar_at(section).coefficients(alpha)) for section in z]
    mean: NDArray[np.float64] = np.einsum("s,sac->ac", weight / weight.sum(), np.array(polars))
    return mean


def _samples(low: float, high: float) -> NDArray[np.float64]:
    """Places of `SAMPLES` sections, in the middles of equal parts of a strip [m]."""
    return low + (high - low) * (np.arange(SAMPLES) + 0.5) / SAMPLES
