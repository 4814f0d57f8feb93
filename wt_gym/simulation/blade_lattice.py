"""The blade of a turbine as an aerodynamic lattice."""

import numpy as np

from wt_gym.aerodynamics import build_planform, span_distribution

__all__ = ["blade_planform"]

N_ALPHA = 720
"""Angles of attack in the polar tables: one each half degree, as fine as published polars near stall."""


def blade_planform(turbine, options):
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
    edges = span_distribution(0.0, blade.length, options.n_span)
    strip = 0.5 * (edges[1:] + edges[:-1])
    alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
    polars = np.array([np.column_stack(blade.polar_at(z).coefficients(alpha)) for z in strip])
    return build_planform(
        edges,
        blade.axis_at(edges),
        blade.chord_at(edges),
        blade.twist_at(edges),
        blade.le_offset_at(edges),
        polars,
        options.n_chord,
        blade.camber_at,
        blade.chord_at(strip),
    )
