"""Export of a controller or a trained agent as a folder that OpenFAST's driver runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.bridges.openfast import PointLidar, ServedController, write_driver_run
from wt_gym.control import Lidar
from wt_gym.control.controllers import parse_name
from wt_gym.deployment.export.discon import export_discon
from wt_gym.envs.arguments import shown
from wt_gym.envs.options import flat_arguments
from wt_gym.envs.options.grid import checked_reference
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.experiment.pool import load_model
from wt_gym.experiment.trained_agent import model_card
from wt_gym.experiment.trained_environment import training_arguments
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.wind.protocol import start_speed

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["Scene", "demanded_power", "export_openfast", "scene_of"]


@dataclass(frozen=True)
class Scene:
    """A turbine in a wind.

    Attributes
    ----------
    arguments : dict
        Of the environment, without a limit of time and from a steady start.
    turbine : Turbine
    inflow : Inflow
    step : float
        Of the simulator [s].
    """

    arguments: dict[str, Any]
    turbine: Turbine
    inflow: Inflow
    step: float


def scene_of(
    choice: str,
    *,
    turbine: str | None = None,
    env_kwargs: dict[str, Any] | None = None,
    wind_speed: float | None = None,
    wind_seed: int | None = None,
    duration: float,
) -> Scene:
    """Turbine and wind of a flight.

    Parameters
    ----------
    choice : str
        A trained agent runs in the environment of its training, a controller in `DEFAULT_ENV`.
    turbine : str, optional
        Of a controller.
    env_kwargs : dict, optional
        Other arguments of the environment, those of the wind for example.
    wind_speed, wind_seed : optional
        Of the wind, where the environment draws them.
    duration : float
        [s].

    Raises
    ------
    ValueError
        For arguments that the environment does not take, and a turbine besides a trained agent.
    """
    name = parse_name(choice)
    steady = {"relative_reward": False, "start": "steady", "episode_length": None, "simulator": "wt_gym"}
    steady |= {"sensors": "agent", "sensor_noise": 0.0, "sensor_delay": 0.0}  # as the model is
    if name.kind == "trained":
        if turbine is not None:
            raise ValueError("the turbine is that of the agent's training; it must be left out")
        card = model_card(name.target, name.parameters.get("env"))
        known = training_arguments(load_model(name).record, card.get("env_kwargs", {}), name.target)
        known = {key: value for key, value in known.items() if key != "variation" and not key.startswith("vary_")}
        arguments = flat_arguments(known) | flat_arguments(env_kwargs or {}) | steady
        env = WindTurbineEnv(**arguments)
    else:
        chosen = {} if turbine is None else {"turbine": turbine}
        arguments = chosen | (env_kwargs or {}) | steady
        made = gym.make(DEFAULT_ENV, **arguments)
        env = turbine_env_of(made)
        assert made.spec is not None  # made by its id
        arguments = dict(made.spec.kwargs)
    chosen_wind = {"wind_speed": wind_speed, "wind_seed": wind_seed}
    given = {key: value for key, value in chosen_wind.items() if value is not None}
    try:
        wind = env.wind.sample(np.random.default_rng(0), **given, length=duration)  # type: ignore[arg-type]
        return Scene(arguments, env.turbine, wind.inflow, env.operation.step)
    finally:
        env.close()


def demanded_power(arguments: Mapping[str, Any]) -> float | None:
    """Power that rows of the environment's ``power_reference`` demand throughout [W], None where nothing is demanded.

    Parameters
    ----------
    arguments : mapping
        Of the environment.

    Raises
    ------
    ValueError
        If it changes, is drawn, or stands in a file: ServoDyn hands the same number of its input file to the library at
        every call.
    """
    given = flat_arguments(arguments).get("power_reference")
    if given is None:
        return None
    reference = checked_reference(given)
    powers = set() if isinstance(reference, str) else {row[-1] for row in reference}
    if len(powers) != 1 or isinstance(power := powers.pop(), str):
        raise ValueError(
            "power_reference must be rows of time and one power in OpenFAST, which writes the same demanded power into "
            f"record 13 at every call, got {shown(given)}: give --env-kwargs "
            "'{\"power_reference\": [[0, 4e6]]}' for 4 MW"
        )
    return float(power)


def export_openfast(
    choice: str,
    folder: str | Path,
    scene: Scene,
    *,
    duration: float,
    hold_missing: bool = False,
    model: str | Path | None = None,
) -> dict[str, Any]:
    """Write a controller or a trained agent with turbine and wind for OpenFAST's driver: ``openfast model.fst``.

    Parameters
    ----------
    choice : str
        Name of a controller or a trained agent.
    folder : str or path
        The whole of it can be moved.
    scene : Scene
    duration : float
        [s].
    hold_missing : bool
        As of `wt_gym.deployment.export.discon.export_discon`.
    model : str or path, optional
        Primary file (``.fst``) of a model of the user's for the turbine; it keeps its ``GenPwr_Dem`` where no power is
        demanded.

    Returns
    -------
    dict
        ``files``, the primary file first, ``held``, ``lidar`` and ``parked`` as of
        `wt_gym.deployment.export.discon.export_discon`, and ``lidar_points``: how many points InflowWind reads of the
        lidar.

    Raises
    ------
    ValueError, CompilerError
        As of `wt_gym.deployment.export.discon.export_discon`, and of `demanded_power`.
    TurbineDefinitionError, SimulationError
        As of `wt_gym.bridges.openfast.write_driver_run`.
    """
    power = demanded_power(scene.arguments)
    folder, trained = Path(folder), parse_name(choice).kind == "trained"
    where: dict[str, Any] = {} if trained else {"turbine": scene.turbine, "interval": scene.step}
    dial = flat_arguments(scene.arguments).get("dial_weights")
    where |= {"dial": dial} if isinstance(dial, Mapping) else {}
    where["wind"] = start_speed(scene.inflow)
    made = export_discon(choice, folder, drive=True, hold_missing=hold_missing, **where)
    _, library, parameters, page = (Path(file) for file in made["files"])
    lidar = None if made["lidar"] is None else PointLidar.of(Lidar(**made["lidar"]))
    primary = write_driver_run(
        scene.turbine, scene.inflow, folder, ServedController(library.name, parameters.name, lidar), duration=duration,
        interval=scene.step, model=model, parked=made["parked"],
        changes=None if power is None else {"ServoDyn": {"GenPwr_Dem": power}},
    )  # fmt: skip
    if lidar is not None:
        with page.open("a", encoding="utf-8") as file:
            file.write("\n".join(_lidar_page(lidar)) + "\n")
    read = 0 if lidar is None else len(lidar.points)
    return made | {"files": [str(primary), *made["files"]], "lidar_points": read}


def _lidar_page(lidar: PointLidar) -> list[str]:
    """What InflowWind reads of a lidar."""
    rows = [f"| {x:.4g} | {y:.4g} | {z:.4g} |" for x, y, z in lidar.points.tolist()]
    of = len(lidar.ranges) * lidar.n_beams
    part = "all points" if lidar.whole else f"{len(lidar.points)} of {of} points, as many as it reads"
    return [
        "", "## Lidar of OpenFAST", "", f"`inflowwind.dat` has {part}, from the tower axis at hub height [m]:",
        "", "| x | y | z |", "|---|---|---|", *rows,
        "", "InflowWind gives the magnitude of the wind at points that do not yaw with the nacelle, in turbulence that "
        "does not change on its way to the rotor: preview does more in OpenFAST than where turbulence evolves.",
    ]  # fmt: skip
