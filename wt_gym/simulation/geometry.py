"""Shapes of a turbine and its wake, for pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.multibody.tree import point_kernels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.step.coupling import Coupling

__all__ = ["turbine_shapes"]


def turbine_shapes(coupling: Coupling) -> dict[str, NDArray[np.float64]]:
    """Shapes in global coordinates [m]; see `wt_gym.simulation.Simulator.geometry`."""
    s, work = coupling.models.structure, coupling.integrator.work
    y = coupling.integrator.state
    coupling.move_lattice(y)
    tower, velocity = np.zeros_like(s.tower_points.position), np.zeros_like(s.tower_points.position)
    q, rate = s.elastic(s.tower, y)
    frame = work.rot[s.tower], work.r[s.tower], work.v[s.tower], work.omega[s.tower]
    point_kernels.point_motion(*frame, q, rate, s.tower_points, tower, velocity)
    return {
        "blades": coupling.exchange.nodes.copy(),
        "wake": coupling.aero.wake_nodes.copy(),
        "wake_circulation": coupling.aero.wake_circulation.copy(),
        "tower": tower,
        "tower_radius": s.tower_radius.copy(),
        "hub": work.r[s.hub].copy(),
        "nacelle": np.array([work.r[s.hub], work.r[s.generator]]),
    }
