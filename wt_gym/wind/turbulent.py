"""Turbulent wind: a mean profile with a box of frozen turbulence carried along by it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind.carried import CarriedInflow
from wt_gym.wind.inflow_kernels import add_tower_points, turbulent_velocity
from wt_gym.wind.protocol import require_number
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BEYOND_GRID", "TurbulentInflow"]

BEYOND_GRID = ("refuse", "hold")


@dataclass(frozen=True)
class TurbulentInflow(CarriedInflow):
    """Frozen turbulence on a mean profile (Taylor's hypothesis).

    In the frame of the mean wind, u(x, y, z, t) = mean(z) + box(y, z, t + time_offset − x/U), U the hub speed. Between
    the samples the box is interpolated linearly in y, z and time; below its grid it follows the tower points, where it
    has any; else outside its grid it keeps the values of the nearest edge, below the ground too; in time it repeats. A
    rotor that reaches beyond the grid is refused (``beyond_grid``).

    What is seen ahead of the rotor (`velocity_ahead`) is not yet quite what arrives, see `wt_gym.wind.evolution`.

    Yaw misalignment and inclination of the mean wind turn the whole field, about the vertical axis through the
    origin and about the hub; veer turns the mean only, not the fluctuations.

    Parameters
    ----------
    box
        The turbulence.
    steady
        The mean wind; speed and hub height within 1 % of the box's. By default uniform at the box's speed.
    time_offset
        Time in the box [s] that passes the origin at time zero.
    beyond_grid
        What becomes of a rotor that reaches beyond the grid: ``"refuse"``, or ``"hold"`` with a warning.

    Raises
    ------
    InflowError
        The mean wind does not fit the box, or a parameter is not finite.

    Examples
    --------
    >>> box = TurbulenceBox.kaimal(8.0, 90.0, 126.0, "B", seed=1, grid=(3, 3), cache=False)
    >>> wind = TurbulentInflow(box, SteadyInflow(8.0, 90.0, shear_exponent=0.2))
    >>> wind.velocity([[0.0, 0.0, 90.0], [0.0, 20.0, 120.0]], time=12.5).shape
    (2, 3)
    """

    box: TurbulenceBox
    steady: SteadyInflow | None = None
    time_offset: float = 0.0
    beyond_grid: str = "refuse"
    _evolved: dict[tuple[float, ...], tuple[TurbulenceBox, ...]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not isinstance(self.box, TurbulenceBox):
            raise InflowError(f"box must be a TurbulenceBox; got {type(self.box).__name__}")
        if self.steady is None:
            object.__setattr__(self, "steady", SteadyInflow(self.box.mean_speed, self.box.hub_height))
        if not isinstance(self.steady, SteadyInflow):
            raise InflowError(f"steady must be a SteadyInflow; got {type(self.steady).__name__}")
        self.box.require_fitting(self.steady)
        object.__setattr__(self, "time_offset", require_number(self.time_offset, "time_offset", "s"))
        if self.beyond_grid not in BEYOND_GRID:
            raise InflowError(
                f"beyond_grid must be one of {', '.join(map(repr, BEYOND_GRID))}; got {self.beyond_grid!r}"
            )

    @property
    def _steady(self) -> SteadyInflow:
        """``steady``, which is there from the start, of the box where none was given."""
        return cast(SteadyInflow, self.steady)

    @cached_property
    def _mean_wind(self) -> tuple[tuple[float, ...], float, float]:
        """The mean wind as the kernels take it."""
        steady = self._steady
        return steady.kernel_profile, steady.yaw_misalignment, steady.inclination

    @property
    def mean_speed(self) -> float:
        """Mean wind speed at hub height [m/s]."""
        return self._steady.speed

    @property
    def hub_height(self) -> float:
        """Hub height [m]."""
        return self._steady.hub_height

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        offset = f", from {self.time_offset:g} s" if self.time_offset else ""
        steady, box = self._steady.profile_description, self.box
        profile = f"{box.profile_description}, on a {steady}" if box.holds_profile else steady
        held = ", held at the edge of its grid" if self.beyond_grid == "hold" else ""
        return f"{box.description}, {box.duration:g} s{offset}, {profile}{held}"

    def require_cover(self, hub_height: float, rotor_diameter: float) -> None:
        """Refuse a rotor that the grid does not reach around, or warn, as ``beyond_grid`` says.

        Parameters
        ----------
        hub_height, rotor_diameter
            Of the turbine [m].

        Raises
        ------
        InflowError
            See `TurbulenceBox.require_cover`.
        """
        self.box.require_cover(hub_height, rotor_diameter, hold=self.beyond_grid == "hold")

    def _fill_from(self, box: TurbulenceBox, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        place = box.time_step, box.spacing_y, box.spacing_z, box.y_center, box.z_bottom
        seen = time + self.time_offset
        bad = turbulent_velocity(rows, seen, *self._mean_wind, box.fluctuation, box.scale, *place, out)
        tower = cast("NDArray[np.float32]", box.tower)  # a box without one holds an empty array
        if bad < 0 and tower.shape[1] > 0:
            add_tower_points(rows, seen, *self._mean_wind, box.fluctuation, tower, box.scale, *place, out)
        return int(bad)
