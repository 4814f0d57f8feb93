"""The wind of a step: asked of the inflow where wake, blades, tower, hub and bodies need it, and handed to them."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.compiled import compiled_for
from wt_gym.base.errors import SimulationError
from wt_gym.simulation.step.wind_kernels import ask_for_wind, felt_wind, receive_wind
from wt_gym.wind.inflow import fill_velocity, read_only

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.aerodynamics import AeroState
    from wt_gym.multibody.arrays import Work
    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.simulation.step.coupling_data import CouplingData
    from wt_gym.wind.inflow import Inflow

__all__ = ["StepWind"]


class StepWind:
    """Wind at the parts of one turbine, whose closed bodies, if there are any, stand where the structure is.

    Parameters
    ----------
    models : TurbineModels
    aero : AeroState
    exchange : CouplingData
    work : Work
        With the kinematics of the structure.
    hub_wind : array (3,)
        Receives the undisturbed wind at the hub [m/s].

    Attributes
    ----------
    blades : array (n_blades, n_chord + 1, n_span + 1, 3)
        Wind at the nodes of the lattice as of the last call [m/s]; overwritten by the next.
    earlier_velocities : array (n_blades, n_chord + 1, n_span + 1, 3)
        Of the nodes at the start of the step before [m/s]; part of the state.
    """

    def __init__(
        self,
        models: TurbineModels,
        aero: AeroState,
        exchange: CouplingData,
        work: Work,
        hub_wind: NDArray[np.float64],
    ) -> None:
        self._models, self._aero, self._exchange, self._work = models, aero, exchange, work
        self._hub_wind, self._dt = hub_wind, models.time_step
        self.blades = np.zeros(models.lattice.nodes_shape)
        self.earlier_velocities = np.zeros(models.lattice.nodes_shape)
        # the nodes of the lattice, the points of the tower, which stay, and the hub
        nodes, tower = exchange.nodes.reshape(-1, 3), exchange.tower.position
        self._points = np.concatenate([nodes, tower, np.zeros((1, 3))])
        self._undisturbed = np.zeros_like(self._points)
        self._asked_points = read_only(self._points)
        row_points = models.lattice.work.row_points
        self._row_points, self._row_size = read_only(row_points.reshape(-1, 3)), row_points[0].size // 3
        self._row_winds = np.zeros(row_points.shape)
        self._row_wind = self._row_winds.reshape(-1, 3)  # a view

    def now(self, inflow: Inflow, time: float) -> NDArray[np.float64]:
        """Wind at the lattice nodes where they are now, and at hub, bodies and tower; see `of_step`."""
        nodes = self._exchange.nodes.reshape(-1, 3)
        self._points[: len(nodes)] = nodes
        self._points[-1] = self._work.r[self._models.structure.hub]
        fill_velocity(inflow, self._asked_points, time, self._undisturbed)
        self._check(felt_wind(*self._felt()), inflow, time)
        return self.blades

    def of_step(self, inflow: Inflow, time: float) -> NDArray[np.float64]:
        """Wind at the wake at the start of a step; at its end at hub, bodies, tower, and at the nodes of the lattice.

        At the nodes with the blocking of the tower. The drag of the tower is that of the undisturbed wind on its
        undeformed axis, as in blade-element codes: what the rotor takes out of the wind before the upper tower is not
        taken off.

        Parameters
        ----------
        inflow : Inflow
        time : float
            At the start of the step [s].

        Returns
        -------
        array (n_blades, n_chord + 1, n_span + 1, 3)
            ``blades`` [m/s].

        Raises
        ------
        SimulationError
            When the wind is not finite.
        """
        ask, asked, receive, felt = self._calls
        count = ask(*asked)
        n, end = count * self._row_size, time + self._dt
        fill_velocity(inflow, self._row_points[:n], time, self._row_wind[:n])
        fill_velocity(inflow, self._asked_points, end, self._undisturbed)
        finite = receive(self._row_winds[:count], *felt)
        if self._models.lattice.bodies or not finite:
            self._check(finite, inflow, end)
        return self.blades

    def compile(self) -> None:
        """Compile what `of_step` calls."""
        _ = self._calls

    @cached_property
    def _calls(self) -> tuple[Callable[..., int], tuple[Any, ...], Callable[..., bool], tuple[Any, ...]]:
        """The compiled parts of `of_step` and their arguments, the same arrays in every step."""
        lattice, structure = self._models.lattice, self._models.structure
        moving = self._exchange.nodes, self._exchange.velocities, self.earlier_velocities
        views = (array.reshape(-1, 3) for array in moving)
        asked = (*lattice.turn_of_rows(self._aero), *views, self._dt, self._work, structure.hub, self._points)
        felt = lattice.work.rows, self._aero.arrays.wind, *self._felt()
        receive = compiled_for(receive_wind, (self._row_winds, *felt))
        return compiled_for(ask_for_wind, asked), asked, receive, felt

    def _felt(self) -> tuple[Any, ...]:
        """Arguments of `wind_kernels.felt_wind`."""
        models, tower = self._models, self._models.tower_flow
        shadow = models.fidelity.tower_shadow and models.fidelity.tower_body is None
        top = self._work.r[models.structure.nacelle]
        return (
            self._undisturbed, self._points, shadow, self._aero.arrays, self._work, models.structure.hub, np.zeros(3),
            tower.base, top, tower.stations, tower.radii, self.blades.reshape(-1, 3), self._exchange.tower.wind,
            self._hub_wind,
        )  # fmt: skip

    def _check(self, finite: bool, inflow: Inflow, time: float) -> None:
        """Wind at the closed bodies, if there are any; refuse a wind that is not finite."""
        lattice = self._models.lattice
        if lattice.bodies:
            lattice.body_wind[:] = inflow.velocity(lattice.bodies.control_points, time)
            finite = finite and math.isfinite(lattice.body_wind.sum())
        if not finite:
            raise SimulationError(f"the inflow is not finite in the step to time {time} s")
