"""What simulates the turbine of an environment: this package, OpenFAST, or what a function makes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from wt_gym import simulation
from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import shown

if TYPE_CHECKING:
    from wt_gym.simulation import Fidelity
    from wt_gym.simulation.contract import SimulatorMaker, TurbineSimulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["OWN", "SIMULATORS", "simulator_maker"]

OWN = "wt_gym"
"""Name of the simulator of this package."""
SIMULATORS = (OWN, "openfast")
"""Names of simulators."""


def simulator_maker(
    choice: Any, turbine: Any, pictured: bool, longest: Callable[[], float | None] = lambda: None
) -> SimulatorMaker:
    """What makes a simulator of turbine, inflow and fidelity.

    Parameters
    ----------
    choice : str, mapping or callable
        A name of `SIMULATORS`; a mapping with it as ``"name"`` and further arguments of
        `wt_gym.bridges.openfast.OpenFASTSimulator`; or a function (turbine, inflow, fidelity) that gives a
        `wt_gym.simulation.contract.TurbineSimulator`.
    turbine : Any
        As it was given by the user: the path of an OpenFAST model (``.fst``) is simulated as it is.
    pictured : bool
        Whether pictures are required.
    longest : callable
        Gives the time that an inflow must last [s], None if that is open; asked when a simulator is made.

    Raises
    ------
    ValueError
        If there is no such simulator, it takes no such argument, or it gives no pictures.
    wt_gym.base.errors.SimulationError
        If OpenFAST's library is not there.
    """
    if callable(choice):
        return cast("SimulatorMaker", choice)
    options = dict(choice) if isinstance(choice, Mapping) else {"name": choice}
    name = options.pop("name", None)
    if name not in SIMULATORS:
        guess = did_you_mean(name, SIMULATORS) if isinstance(name, str) else ""
        raise ValueError(
            f"simulator must be one of {', '.join(map(repr, SIMULATORS))}, a mapping with one of them as 'name', or a "
            f"function that makes a simulator; got {shown(choice)}{guess}"
        )
    if name == OWN:
        if options:
            raise ValueError(f"the simulator of this package takes no further arguments, got {sorted(options)}")
        return _own
    if pictured:
        raise ValueError("OpenFAST gives no shapes for pictures: render_mode must be None with it")
    from wt_gym.bridges.openfast import find_library  # not needed without it
    from wt_gym.bridges.openfast.simulator import OPTIONS

    if unknown := sorted(set(options) - set(OPTIONS)):
        raise ValueError(f"OpenFAST takes {', '.join(OPTIONS)}; got {', '.join(unknown)}")
    options["openfast_library"] = find_library(options.get("openfast_library"))
    if isinstance(turbine, str) and turbine.lower().endswith(".fst"):
        options.setdefault("model", turbine)
    return partial(_openfast, options, longest)


def _own(turbine: Turbine, inflow: Inflow, fidelity: str | Fidelity) -> TurbineSimulator:
    """The simulator of this package."""
    return cast("TurbineSimulator", simulation.Simulator(turbine, inflow=inflow, fidelity=fidelity))


def _openfast(
    options: dict[str, Any],
    longest: Callable[[], float | None],
    turbine: Turbine,
    inflow: Inflow,
    fidelity: str | Fidelity,
) -> TurbineSimulator:
    """OpenFAST for a turbine; its wind lasts as long as episodes do."""
    from wt_gym.bridges.openfast import OpenFASTSimulator

    duration = longest()
    lasting = {} if duration is None else {"duration": duration}
    return OpenFASTSimulator(turbine, inflow, fidelity, **lasting | options)
