"""Controllers and agents in OpenFAST: a folder that its driver runs, and a comparison with the original.

`fly` has an exported agent or controller and the original in the same wind, here and in OpenFAST.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wt_gym.analysis.metrics import run_metrics
from wt_gym.analysis.statistics import relative_change
from wt_gym.base.errors import SimulationError
from wt_gym.base.options import shown
from wt_gym.bridges.openfast import (
    PointLidar,
    ServedController,
    find_driver,
    find_library,
    read_outputs,
    run_driver,
    write_driver_run,
)
from wt_gym.control import Lidar
from wt_gym.control.bladed import BladedController
from wt_gym.control.controllers import parse_name
from wt_gym.control.controllers.names import BASELINE
from wt_gym.control.controllers.power_tracking import LEAST_SHARE
from wt_gym.control.operating_point import starting_point
from wt_gym.deployment.export.discon import export_discon
from wt_gym.envs.episode import Agent
from wt_gym.envs.options import flat_arguments
from wt_gym.envs.power_reference import GridOptions
from wt_gym.envs.sea import EpisodeSea, SeaTerm
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.experiment.agents import ConstantAgent, load_model
from wt_gym.experiment.environments import training_arguments
from wt_gym.experiment.run import play
from wt_gym.experiment.trained_agent import model_card
from wt_gym.simulation.contract import TurbineSimulator
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import start_speed

if TYPE_CHECKING:
    import xarray as xr

_NO_AGENT = {
    "controller": BASELINE, "observation": ["rotor"], "action_spans": None, "residual_fade": False,
    "residual_washout": None,
}  # fmt: skip
"""Of an environment in which a controller acts alone, of any turbine."""


@dataclass(frozen=True)
class Scene:
    """A turbine in a wind."""

    arguments: dict[str, Any]  #: of the environment, without a limit of time and from a steady start
    turbine: Turbine
    inflow: Inflow
    step: float  #: of the simulator [s]
    sea: EpisodeSea | None = None  #: of a floating turbine


def scene_of(
    choice: str,
    *,
    turbine: str | None = None,
    env_kwargs: dict[str, Any] | None = None,
    wind_speed: float | None = None,
    wind_seed: int | None = None,
    duration: float,
) -> Scene:
    """Turbine and wind of a flight over a duration [s].

    A trained agent runs in the environment of its training, a controller in `DEFAULT_ENV`; ``turbine`` is that of a
    controller, ``env_kwargs`` are other arguments of the environment, ``wind_speed`` [m/s] and ``wind_seed`` those of
    the wind, where the environment draws them.

    Raises
    ------
    ValueError
        For arguments that the environment does not take, and a turbine besides a trained agent.
    """
    name = parse_name(choice)
    steady = {"relative_reward": False, "reward_credit": False, "start": "steady", "episode_length": None}
    steady |= {"simulator": "wt_gym", "sensors": "agent", "sensor_noise": 0.0, "sensor_delay": 0.0}  # as the model is
    if name.kind == "trained":
        if turbine is not None:
            raise ValueError("the turbine is that of the agent's training; it must be left out")
        card = model_card(name.target, name.parameters.get("env"))
        known = training_arguments(load_model(name).record, card.get("env_kwargs", {}), name.target)
        known = {key: value for key, value in known.items() if key != "variation" and not key.startswith("vary_")}
        arguments = flat_arguments(known) | flat_arguments(env_kwargs or {}) | steady
        env = WindTurbineEnv(**arguments)
    else:
        chosen = _NO_AGENT | ({} if turbine is None else {"turbine": turbine})
        arguments = chosen | (env_kwargs or {}) | steady
        made = gym.make(DEFAULT_ENV, **arguments)
        env = turbine_env_of(made)
        assert made.spec is not None  # made by its id
        arguments = dict(made.spec.kwargs)
    chosen_wind = {"wind_speed": wind_speed, "wind_seed": wind_seed}
    given = {key: value for key, value in chosen_wind.items() if value is not None}
    try:
        rng = np.random.default_rng(0)
        wind, term = env.wind.sample(rng, **given, length=duration), env.terms.get("sea")  # type: ignore[arg-type]
        sea = term.sea(rng, float(wind.wind_speed), duration) if isinstance(term, SeaTerm) else None
        return Scene(arguments, env.turbine, wind.inflow, env.operation.step, sea)
    finally:
        env.close()


def demanded_power(arguments: Mapping[str, Any]) -> float | None:
    """Power that rows of ``power_reference`` demand throughout [W], None where nothing is demanded."""
    given = flat_arguments(arguments).get("power_reference")
    if given is None:
        return None
    reference: Any = GridOptions(reference=given).reference
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

    The whole folder can be moved. The duration is in s, ``hold_missing`` as of
    `wt_gym.deployment.export.discon.export_discon`. ``model`` is the primary file (``.fst``) of a model of the user's
    for the turbine; it keeps its ``GenPwr_Dem`` where no power is demanded.

    Returns
    -------
    dict
        ``files``, the primary file first, ``held``, ``lidar`` and ``parked`` as of `export_discon`, and
        ``lidar_points``: how many points InflowWind reads of the lidar.

    Raises
    ------
    ValueError, CompilerError, TurbineDefinitionError, SimulationError
        As of `export_discon`, `demanded_power` and `wt_gym.bridges.openfast.write_driver_run`.
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
        sea=None if scene.sea is None else scene.sea.components,
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


LARGEST_DIFFERENCE = 1e-5
"""Of the demands of the library from those of Python: pitch [rad], torque over the greatest one [-], yaw [rad/s]."""
LARGEST_CHANGE = 1e-3
"""Of each load in OpenFAST with the library from that with Python [-]."""
LARGEST_CHANGE_WITH_LIDAR = 5e-3
"""The same where a lidar is read: OpenFAST's and Python's look into winds that are interpolated in other ways."""
LARGEST_CHANGE_FROM_STANDSTILL = 1e-2
"""The same from standstill: ServoDyn hands over the wind of the step before, which the pitch of a start follows."""
PYTHON, LIBRARY = "wt_gym, Python", "wt_gym, library"
PYTHON_IN_OPENFAST, LIBRARY_IN_OPENFAST = "OpenFAST, Python", "OpenFAST, library"
"""Names of the runs."""
LOADS = ("blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del")
"""Metrics that are compared in OpenFAST."""


@dataclass(frozen=True)
class Flight:
    """Demands and loads of the runs."""

    pitch: float  #: largest difference of the demands of the library from those of Python in this package [rad]
    torque: float  #: likewise, over the greatest torque [-]
    yaw_rate: float  #: likewise [rad/s]
    metrics: dict[str, dict[str, float]]  #: of each run by its name, see `wt_gym.analysis.metrics.run_metrics`
    missing: dict[str, str]  #: why runs in OpenFAST were left out, by name
    primary: Path  #: primary file of OpenFAST with the library, to be run again
    limit: float = LARGEST_CHANGE  #: of the loads' changes in OpenFAST [-]

    @property
    def changes(self) -> dict[str, float]:
        """Loads of the library in OpenFAST against Python's there [-]; empty where either did not run."""
        if not {LIBRARY_IN_OPENFAST, PYTHON_IN_OPENFAST} <= self.metrics.keys():
            return {}
        library, python = self.metrics[LIBRARY_IN_OPENFAST], self.metrics[PYTHON_IN_OPENFAST]
        return {load: relative_change(library[load], python[load]) for load in LOADS}

    @property
    def agrees(self) -> bool:
        """Whether everything that was run is within `LARGEST_DIFFERENCE` and `limit`."""
        near = max(self.pitch, self.torque, self.yaw_rate) <= LARGEST_DIFFERENCE
        return near and all(abs(change) <= self.limit for change in self.changes.values())


class _Held:
    """An agent that sees some channels at the middle of their scale, where an exported one sees them."""

    def __init__(self, agent: Agent, names: Sequence[str], held: Sequence[str]):
        self._agent, self._held = agent, np.array([name.partition("@")[0] in held for name in names])

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """What the agent does then."""
        seen = np.where(self._held, np.float32(0.0), observation)
        return self._agent.predict(seen, state, episode_start, deterministic)


def fly(
    choice: str,
    folder: str | Path,
    scene: Scene,
    *,
    duration: float,
    skip: float = 0.0,
    hold_missing: bool = False,
    driver: str | Path | None = None,
    library: str | Path | None = None,
) -> Flight:
    """Export, then run in the same wind: Python's and the library's demands, in this package's simulator and OpenFAST.

    Sensors have no noise in any run, whatever that of the training was: the library has none. The folder receives the
    export in ``wt_gym`` and the model of OpenFAST in ``openfast``. Duration and ``skip``, the start left out of the
    metrics, are in s. With ``hold_missing`` what the agent observes in Python is held too. Driver and library are as of
    `wt_gym.bridges.openfast.find_driver` and `find_library`.

    Raises
    ------
    ValueError, CompilerError
        As of `wt_gym.deployment.export.discon.export_discon`; a ValueError where a demanded power or a dial changes.
    SimulationError
        If a run fails.
    """
    power = demanded_power(scene.arguments)  # before anything is written
    dial = flat_arguments(scene.arguments).get("dial_weights")
    if dial is not None and not isinstance(dial, Mapping):
        raise ValueError(
            f"dial_weights must be constant in a flight, as the parameters of a library are, got {shown(dial)}: give "
            '--env-kwargs \'{"dial_weights": {"fatigue": 1.0}}\''
        )
    folder, name = Path(folder), parse_name(choice)
    own = name.kind == "trained"
    where: dict[str, Any] = {"dial": dial} if own else {"turbine": scene.turbine, "interval": scene.step}
    where["wind"] = start_speed(scene.inflow)
    exported = export_discon(choice, folder / "wt_gym", hold_missing=hold_missing, **where)
    in_openfast = export_openfast(choice, folder / "openfast", scene, duration=duration, hold_missing=hold_missing)
    primary, held = Path(in_openfast["files"][0]), exported["held"]
    arguments = flat_arguments(scene.arguments)
    python = arguments if own else arguments | {"controller": choice}
    agent = load_model(name) if own else None
    lidar = None if exported["lidar"] is None else Lidar(**exported["lidar"])
    library_alone = BladedController(scene.turbine, *exported["files"][1:3], lidar=lidar or False)
    alone = _NO_AGENT | {"controller": library_alone}

    feather = min(scene.turbine.pitch.max_pitch, 0.5 * math.pi)
    parked = {"rotor_speed": 0.0, "pitch": feather, "generator_torque": 0.0} if exported["parked"] else {}
    start = {} if power is None or parked else {"generator_torque": _torque_at_the_start(scene, power)}

    metrics: dict[str, dict[str, float]] = {}
    data, expected = _played(python, agent, scene, duration, held, start=start)
    metrics[PYTHON] = run_metrics(data, scene.turbine, skip)
    data, found = _played(arguments | alone, None, scene, duration, start=start | parked)
    metrics[LIBRARY] = run_metrics(data, scene.turbine, skip)
    apart = np.abs(found - expected).max(axis=0)
    missing: dict[str, str] = {}
    if (path := _there(find_driver, driver, LIBRARY_IN_OPENFAST, missing)) is not None:
        every = round(float(data.time[1] - data.time[0]) / scene.step)  # at the instants of the other runs
        outputs = read_outputs(run_driver(primary, path), scene.turbine, every)
        metrics[LIBRARY_IN_OPENFAST] = run_metrics(outputs.isel(time=slice(1, None)), scene.turbine, skip)
    if (path := _there(find_library, library, PYTHON_IN_OPENFAST, missing)) is not None:
        simulator = {"simulator": {"name": "openfast", "openfast_library": str(path), "duration": duration}}
        points = None if lidar is None else PointLidar.of(lidar)
        data, _ = _played(python | simulator, agent, scene, duration, held, points, start)
        metrics[PYTHON_IN_OPENFAST] = run_metrics(data, scene.turbine, skip)
    limit = LARGEST_CHANGE if lidar is None else LARGEST_CHANGE_WITH_LIDAR
    limit = LARGEST_CHANGE_FROM_STANDSTILL if parked else limit
    return Flight(float(apart[:-2].max()), float(apart[-2]), float(apart[-1]), metrics, missing, primary, limit)


def _torque_at_the_start(scene: Scene, power: float) -> float:
    """Torque with which a library in ServoDyn begins where a power is demanded [N m], at the operating point's speed.

    In Python the torque would come down to it from that of full power at the greatest rate.
    """
    point, drive = starting_point(scene.turbine, scene.inflow), scene.turbine.drivetrain
    followed = max(power, LEAST_SHARE * drive.rated_power)
    enough = followed / (drive.generator_efficiency * drive.gear_ratio * point.rotor_speed)
    return min(point.generator_torque, enough)


def _there(
    find: Callable[[str | Path | None], Path], given: str | Path | None, run: str, missing: dict[str, str]
) -> Path | None:
    """Path of what a run needs, or None and why among what is missing."""
    try:
        return find(given)
    except SimulationError as error:
        if given is not None:
            raise
        missing[run] = str(error)
        return None


def _played(
    arguments: dict[str, Any],
    agent: Agent | None,
    scene: Scene,
    duration: float,
    held: Sequence[str] = (),
    lidar: Lidar | None = None,
    start: Mapping[str, float] | None = None,
) -> tuple[xr.Dataset, NDArray[np.float64]]:
    """Signals after the start, and demands at every step of the simulator: pitch, torque over the greatest, yaw.

    In rad, -, rad/s. A lidar takes the place of that which controller and agent read; a start, options of the reset,
    that of the operating point.
    """
    env = WindTurbineEnv(**arguments)
    if lidar is not None:
        env.operation.lidar = lidar
    most = scene.turbine.drivetrain.max_generator_torque
    rows: list[NDArray[np.float64]] = []
    make = env.operation.make_simulator

    def noting(*of_simulator: Any) -> TurbineSimulator:
        """A simulator that notes what it is asked for."""
        simulator = make(*of_simulator)
        advance = simulator.advance

        def noted(time: float, pitch: Any, yaw_rate: float, torque: float, **options: Any) -> Any:
            rows.append(np.append(pitch, (torque / most, yaw_rate)))
            return advance(time, pitch, yaw_rate, torque, **options)

        simulator.advance = noted  # type: ignore[method-assign, assignment]
        return simulator

    env.operation.make_simulator = noting
    actor: Agent = ConstantAgent(env.layout) if agent is None else _Held(agent, env.layout.observation.names, held)
    try:
        afloat = {} if scene.sea is None else {"sea": scene.sea.components}
        options = {"inflow": scene.inflow, "azimuth": 0.0} | afloat | dict(start or {})
        episode = play(env, actor, seed=0, options=options, duration=duration)
    finally:
        env.close()
    if episode.ending != "time":
        raise SimulationError(f"the run ended after {episode.time:g} s: {episode.failure or episode.ending}")
    return episode.after_start, np.array(rows)
