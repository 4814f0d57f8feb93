"""What simulates the turbine of an environment: this package, OpenFAST, or what a function makes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from wt_gym import simulation
from wt_gym.envs.arguments import did_you_mean, shown

if TYPE_CHECKING:
    from wt_gym.simulation import Fidelity, Simulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["SIMULATORS", "Maker", "simulator_maker"]

SIMULATORS = ("wt_gym", "openfast")
"""Names of simulators."""

Maker = Callable[["Turbine", "Inflow", "str | Fidelity", "float | None"], "Simulator"]
"""Makes a simulator of turbine, inflow, fidelity and the time that the inflow must last [s], None if that is open."""


def simulator_maker(choice: Any, turbine: Any, pictured: bool) -> Maker:
    """What makes the simulator of an environment.

    Parameters
    ----------
    choice : str, mapping or callable
        A name of `SIMULATORS`; a mapping with it as ``"name"`` and further arguments of
        `wt_gym.bridges.openfast.OpenFASTSimulator`; or a function (turbine, inflow, fidelity) that gives an object with
        the methods of `wt_gym.simulation.Simulator`.
    turbine : Any
        As it was given to the environment: the path of an OpenFAST model (``.fst``) is simulated as it is.
    pictured : bool
        Whether pictures are wanted.

    Raises
    ------
    ValueError
        If there is no such simulator, it takes no such argument, or it gives no pictures.
    wt_gym.errors.SimulationError
        If OpenFAST's library is not there.
    """
    if callable(choice):
        return lambda turbine, inflow, fidelity, duration: choice(turbine, inflow, fidelity)
    options = dict(choice) if isinstance(choice, Mapping) else {"name": choice}
    name = options.pop("name", None)
    if name not in SIMULATORS:
        guess = did_you_mean(name, SIMULATORS) if isinstance(name, str) else "."
        raise ValueError(
            f"simulator must be one of {', '.join(map(repr, SIMULATORS))}, a mapping with one of them as 'name', or a "
            f"function that makes a simulator; got {shown(choice)}{guess}"
        )
    if name == "wt_gym":
        if options:
            raise ValueError(f"the simulator of this package takes no further arguments, got {sorted(options)}")
        return _own
    if pictured:
        raise ValueError("OpenFAST gives no shapes for pictures: render_mode must be None with it")
    from wt_gym.bridges.openfast import OpenFASTSimulator, find_library  # not needed without it
    from wt_gym.bridges.openfast.simulator import OPTIONS

    if unknown := sorted(set(options) - set(OPTIONS)):
        raise ValueError(f"OpenFAST takes {', '.join(OPTIONS)}; got {', '.join(unknown)}")
    options["openfast_library"] = find_library(options.get("openfast_library"))
    if isinstance(turbine, str) and turbine.lower().endswith(".fst"):
        options.setdefault("model", turbine)
    return partial(_openfast, OpenFASTSimulator, options)


def _own(turbine, inflow, fidelity, duration):
    """The simulator of this package, to which it is all one how long the wind lasts."""
    return simulation.Simulator(turbine, inflow=inflow, fidelity=fidelity)


def _openfast(kind, options, turbine, inflow, fidelity, duration):
    """OpenFAST for a turbine; its wind lasts as long as episodes do."""
    lasting = {} if duration is None else {"duration": duration}
    return cast("Simulator", kind(turbine, inflow, fidelity, **lasting | options))
