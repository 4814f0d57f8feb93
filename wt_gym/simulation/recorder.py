"""Recording of signals into a labeled data set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.simulation.channels import channel_table
from wt_gym.simulation.recording_files import write_recording

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

    Variable = tuple[str | tuple[str, ...], NDArray[np.float64], dict[str, str]]
    """Names of the axes, values and attributes."""

    from os import PathLike

    from numpy.typing import NDArray
    from xarray import Dataset

    from wt_gym.simulation.channels import Signals

__all__ = ["RecordedSimulator", "Recorder"]


class RecordedSimulator(Protocol):
    """What is recorded of a `wt_gym.simulation.Simulator`."""

    @property
    def turbine(self) -> Turbine:
        """The turbine."""

    @property
    def inflow(self) -> Inflow:
        """Its wind."""

    @property
    def fidelity(self) -> Fidelity:
        """Resolution of structure and air."""

    @property
    def time_step(self) -> float:
        """Aerodynamic step [s]."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""


class _ConstrainedSimulator(RecordedSimulator, Protocol):
    """One whose blades constraint equations hold."""

    def root_multipliers(self) -> NDArray[np.float64]:
        """Lagrange multipliers of the constraints that hold the blades (n_blades, 6)."""


class Recorder:
    """Collects signals and turns them into an xarray data set with units.

    Where constraint equations hold the blades (``formulation="constrained"``) their Lagrange multipliers are recorded
    beside the channels.

    Parameters
    ----------
    simulator : Simulator
        Gives the channels, the attributes of the data set, and the multipliers if it has any.
    **attributes
        Further attributes of the data set (numbers and strings).

    Examples
    --------
    >>> recorder = Recorder(sim)                         # doctest: +SKIP
    >>> recorder.append(sim.advance(0.2, **commands))    # doctest: +SKIP
    >>> recorder.to_dataset().to_netcdf("run.nc", engine="h5netcdf")  # doctest: +SKIP
    """

    def __init__(self, simulator: RecordedSimulator, **attributes: float | str) -> None:
        self.channels = channel_table(simulator.turbine.n_blades)
        self.attributes = {
            "turbine": simulator.turbine.name,
            "rotation": simulator.turbine.rotation,
            "inflow": simulator.inflow.description,
            "fidelity": simulator.fidelity.name,
            "aerodynamic_time_step_s": simulator.time_step,
            **attributes,
        }
        self._rows: list[NDArray[np.float64]] = []
        # only a simulator that has multipliers is asked at each instant, and kept alive
        constrained = simulator.fidelity.formulation == "constrained"
        self._held = cast("_ConstrainedSimulator", simulator) if constrained else None
        self._multipliers: list[NDArray[np.float64]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def append(self, signals: Signals) -> None:
        """Store one instant.

        Parameters
        ----------
        signals : Signals
            Multipliers belong to signals of the simulator's present instant; to others not a number is stored.
        """
        self._rows.append(signals.values.copy())
        if self._held is not None:
            self._multipliers.append(_multipliers_at(self._held, signals))

    def clear(self) -> None:
        """Forget everything stored."""
        self._rows.clear()
        self._multipliers.clear()

    def to_dataset(self) -> Dataset:
        """Data set with one variable a channel over ``time``; units, description and OpenFAST name as attributes.

        Returns
        -------
        xarray.Dataset
            With constraint equations also ``root_multiplier_force`` [N] and ``root_multiplier_moment`` [N m] over
            ``time``, ``blade`` (from 1) and ``component`` (x, y, z), see `Simulator.root_multipliers`.
        """
        import xarray as xr  # heavy, and only needed here

        table = np.array(self._rows).reshape(-1, len(self.channels))
        time = table[:, 0]
        variables: dict[str, Variable] = {}
        for k, channel in enumerate(self.channels[1:], start=1):
            attributes = {"units": channel.unit, "long_name": channel.description, "openfast_name": channel.openfast}
            variables[channel.name] = ("time", table[:, k], attributes)
        coordinates: dict[str, object] = {"time": ("time", time, {"units": "s"})}
        if self._held is not None:
            n_blades = self._held.turbine.n_blades
            variables |= _multiplier_variables(np.reshape(self._multipliers, (-1, n_blades, 6)))
            coordinates |= {"blade": np.arange(1, n_blades + 1), "component": list("xyz")}
        return xr.Dataset(variables, coordinates, self.attributes)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the signals; the ending of the file names the format, see `write_recording`.

        Raises
        ------
        ValueError
            If the file ends in none of ``.nc``, ``.outb`` and ``.csv``.
        """
        write_recording(Path(path), self.to_dataset())


def _multipliers_at(simulator: _ConstrainedSimulator, signals: Signals) -> NDArray[np.float64]:
    """Multipliers (n_blades, 6) of the instant of the signals; not a number where the simulator is not there.

    After a failed step the signals at hand are those of the step before, and the state has no meaning.
    """
    if signals.values[0] == simulator.time:
        try:
            return simulator.root_multipliers()
        except SimulationError:
            pass
    return np.full((simulator.turbine.n_blades, 6), np.nan)


def _multiplier_variables(multipliers: NDArray[np.float64]) -> dict[str, Variable]:
    """Variables of a data set from multipliers (n, n_blades, 6)."""
    text = "{} of the hub on the blade at its root (Lagrange multipliers), axes of the pitched root"
    parts = (("force", "N", "Force", multipliers[..., :3]), ("moment", "N m", "Moment", multipliers[..., 3:]))
    return {
        f"root_multiplier_{name}": (
            ("time", "blade", "component"),
            values,
            {"units": unit, "long_name": text.format(what)},
        )
        for name, unit, what, values in parts
    }
