"""What environments, recorders and runs need of a simulator: `wt_gym.simulation.Simulator` or that of another code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from wt_gym.simulation.channels import Signals
    from wt_gym.simulation.drivetrain.faults import DriveFault
    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["SimulatorMaker", "TurbineSimulator"]


class TurbineSimulator(Protocol):
    """A turbine in the wind, moved on under demands.

    Attributes
    ----------
    turbine : Turbine
    inflow : Inflow
        Undisturbed wind; may be exchanged before a reset.
    fidelity : Fidelity
        Its name goes into records; with ``formulation="constrained"`` there is `wt_gym.simulation.Simulator`'s
        ``root_multipliers`` too.
    faults : tuple of DriveFault
        What fails, and when; may be exchanged before a reset.
    time_step : float
        [s]; `advance` takes whole numbers of it.
    time : float
        Simulated time [s].
    """

    if TYPE_CHECKING:  # what only is read may be a property

        @property
        def turbine(self) -> Turbine: ...

        @property
        def fidelity(self) -> Fidelity: ...

        @property
        def time_step(self) -> float: ...

        @property
        def time(self) -> float: ...

        @property
        def inflow(self) -> Inflow: ...

        @inflow.setter
        def inflow(self, inflow: Inflow) -> None: ...

        @property
        def faults(self) -> tuple[DriveFault, ...]: ...

        @faults.setter
        def faults(self, faults: tuple[DriveFault, ...]) -> None: ...

    def reset(
        self,
        rotor_speed: float,
        pitch: ArrayLike = 0.0,
        azimuth: float = 0.0,
        yaw: float = 0.0,
        generator_torque: float | None = None,
        tower_top: ArrayLike | None = None,
        wake_thrust: float | None = None,
        motion: ArrayLike | None = None,
    ) -> Signals:
        """Start at time zero near a steady state; arguments as of `wt_gym.simulation.Simulator.reset`.

        A simulator may leave ``tower_top``, ``wake_thrust`` and ``motion`` aside, which say how the turbine ran
        before.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If there is no such start.
        """
        ...

    def advance(
        self, duration: float, pitch: ArrayLike, yaw_rate: float = 0.0, generator_torque: float = 0.0,
        accumulate: bool = False,
    ) -> Signals:  # fmt: skip
        """Move on with constant demands; arguments as of `wt_gym.simulation.Simulator.advance`.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the simulation fails; it must then be reset.
        """
        ...

    def state(self) -> Any:
        """Snapshot from which the simulation continues."""
        ...

    def restore(self, state: Any) -> None:
        """Continue from a snapshot of a simulator of the same turbine."""
        ...

    def geometry(self) -> Mapping[str, np.ndarray]:
        """Shapes for pictures, as of `wt_gym.simulation.Simulator.geometry`."""
        ...


SimulatorMaker: TypeAlias = "Callable[[Turbine, Inflow, str | Fidelity], TurbineSimulator]"
"""Makes a simulator of a turbine in a wind at a fidelity."""
