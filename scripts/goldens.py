#!/usr/bin/env python3
"""Digests of what the package computes, to see that a change of the code changes no number.

    scripts/goldens.py write before.json        # before a change
    scripts/goldens.py compare before.json      # after it: names what differs, exit code 1 where anything does

A digest is the SHA-256 of float64 bytes: every id for 40 steps (signals, observations, rewards, infos), every fidelity
for 10 s, every controller on recorded readings, shipped agents on observations, exported C sources and OpenFAST models,
windIO round trips, snapshots, and the help of the commands. On another processor the last bits differ, so a file serves
one machine.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import use_venv  # noqa: F401 - finds packages and interpreter

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.commands import COMMANDS
from wt_gym.control.controllers import CONTROLLERS, make_controller
from wt_gym.control.operating_point import starting_point
from wt_gym.deployment.export.discon import export_discon
from wt_gym.deployment.export.openfast_flight import export_openfast, scene_of
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.tasks import TASKS
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.windio_writer import windio_content, write_windio
from wt_gym.wind import SteadyInflow

STEPS = 40
_ROOT = Path(__file__).resolve().parents[1]
_SHIPPED = _ROOT / "agents" / "trained"


def digest(*values: Any) -> str:
    """SHA-256 of arrays, numbers, strings and nested containers of these."""
    total = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, dict):
            for key in sorted(value, key=str):
                add(str(key))
                add(value[key])
        elif isinstance(value, list | tuple):
            for item in value:
                add(item)
        elif isinstance(value, str | bytes):
            total.update(value.encode() if isinstance(value, str) else value)
        elif value is None or isinstance(value, int | float | np.ndarray | np.generic):
            array = np.asarray(np.nan if value is None else value)
            total.update(
                np.ascontiguousarray(array, np.float64).tobytes()
                if array.dtype.kind in "biuf"
                else repr(array).encode()
            )
        else:
            total.update(repr(value).encode())

    for value in values:
        add(value)
    return total.hexdigest()[:16]


def environments() -> Iterator[tuple[str, Callable[[], str]]]:
    """Every registered id from a steady start, each task from its own too; infos apart, where keys come."""
    ids = sorted(name for name in gym.registry if name.startswith("wt_gym/"))
    episodes = [(f"env/{name}", name, {"start": "steady"}) for name in ids]
    episodes += [(f"start/{task.id}", task.id, {}) for task in TASKS.values()]
    for title, name, arguments in episodes:
        infos: list[Any] = []
        yield title, lambda name=name, arguments=arguments, infos=infos: _episode(name, infos, **arguments)
        yield f"info/{title}", lambda infos=infos: digest(infos)


def _episode(env_id: str, infos: list[Any], **arguments: Any) -> str:
    """Run an episode with a snapshot in between; puts its infos into a list."""
    env = gym.make(env_id, disable_env_checker=True, **arguments)
    observation, info = env.reset(seed=1)
    infos.append(info)
    parts: list[Any] = [observation]
    rng, space, snapshot = np.random.default_rng(2), env.action_space, None
    for step in range(STEPS):
        action = (0.5 * rng.uniform(-1.0, 1.0, space.shape)).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        infos.append(info)
        parts += [observation, reward, terminated, truncated, np.asarray(env.unwrapped.signals.values)]
        if step == STEPS // 2:
            snapshot = env.unwrapped.snapshot()
        if terminated or truncated:
            break
    if snapshot is not None:
        env.unwrapped.restore(snapshot)
        parts.append(env.step(np.zeros(space.shape, np.float32))[0])
    env.close()
    return digest(parts)


def fidelities() -> Iterator[tuple[str, Callable[[], str]]]:
    """Each fidelity for 10 s, slow ones for less; "mixed" and "gebhardt" with the turbines that they are made for."""
    for name in FIDELITIES:
        turbine = "nada_small" if name == "mixed" else "gebhardt_45m" if name.startswith("gebhardt") else "nrel_5mw"
        duration = {"reference": 1.0, "gebhardt": 2.0, "gebhardt-full": 0.5, "mixed": 0.5}.get(name, 10.0)
        yield f"fidelity/{name}", lambda name=name, turbine=turbine, d=duration: _free_run(turbine, name, d)
    for turbine, record in RECORDS.items():
        if turbine != "nada_small":
            choice = str(record.arguments.get("fidelity", "training"))
            yield f"turbine/{turbine}", lambda turbine=turbine, choice=choice: _free_run(turbine, choice, 5.0)


def _free_run(turbine: str, fidelity: str, duration: float) -> str:
    wind = 8.0 if turbine != "nada_small" else 6.0
    sim = Simulator(turbine, inflow=SteadyInflow(wind), fidelity=fidelity)
    point = starting_point(sim.turbine, sim.inflow)
    signals = sim.reset(rotor_speed=point.rotor_speed, pitch=point.pitch, generator_torque=point.generator_torque)
    pitch, parts = [point.pitch] * sim.turbine.n_blades, [np.asarray(signals.values)]
    for _ in range(max(round(duration / sim.time_step / 10), 1)):
        signals = sim.advance(10 * sim.time_step, pitch, 0.0, point.generator_torque)
        parts.append(np.asarray(signals.values))
    return digest(parts)


def controllers() -> Iterator[tuple[str, Callable[[], str]]]:
    """Every name of the catalog for each turbine that it is made for, on readings of a drawn course."""
    for name in CONTROLLERS:
        if name in ("rosco", "bladed"):
            continue
        for turbine in ("nrel_5mw", "iea_15mw", "iea_22mw"):
            yield f"controller/{name}/{turbine}", lambda name=name, turbine=turbine: _controlled(name, turbine)


class _Readings:
    """Readings of a drawn course: smooth, plausible, without a simulator."""

    def __init__(self, rated: float, gear_ratio: float, time: float) -> None:
        self._rated, self._gear, self._time = rated, gear_ratio, time

    def __getitem__(self, name: str) -> float:
        phase = float(int(hashlib.sha256(name.encode()).hexdigest()[:4], 16))
        swing = 0.02 * np.sin(0.7 * self._time + phase) + 0.01 * np.sin(2.9 * self._time + 2 * phase)
        scales = {"generator_speed": self._rated * self._gear, "rotor_speed": self._rated, "wind_speed": 14.0}
        if name == "azimuth":
            return float((self._rated * self._time) % (2 * np.pi))
        if name.startswith("lidar"):
            return float(14.0 * (1.0 + swing))
        if "moment" in name:
            return float(8e6 * (1.0 + swing))
        if name == "generator_torque":
            return 4.0e4 * (1.0 + swing)
        return float(scales.get(name, 0.0) * (1.0 + swing) or swing)


def _controlled(name: str, turbine_name: str) -> str:
    from wt_gym.control import Demand

    turbine = load_turbine(turbine_name)
    try:
        controller = make_controller(name, turbine)
    except ValueError as error:
        return digest("refused", str(error))
    train = turbine.drivetrain

    def readings(step: int) -> Any:
        return _Readings(train.rated_rotor_speed, train.gear_ratio, 0.1 * step)

    torque = train.rated_power / train.rated_rotor_speed / train.gear_ratio
    controller.start(readings(0), Demand(np.full(turbine.n_blades, 0.15), 0.0, torque))
    parts = []
    for step in range(1, 200):
        demand = controller.step(readings(step), 0.1)
        parts += [demand.pitch, demand.yaw_rate, demand.generator_torque]
    return digest(parts)


def agents() -> Iterator[tuple[str, Callable[[], str]]]:
    """Shipped agents on drawn observations, and what export writes of them."""
    for folder in sorted(path for path in _SHIPPED.iterdir() if path.is_dir()):
        yield f"agent/{folder.name}", lambda folder=folder: _acts(folder)
        yield f"export/{folder.name}", lambda folder=folder: _exported(str(folder))
    for name in ("discon", "retuned", "linear_optimal", "constrained_ipc+tower_dampers", "discon+supervisor"):
        yield f"export/{name}", lambda name=name: _exported(name)


def _acts(folder: Path) -> str:
    agent = TrainedAgent.load(folder)
    rng, shape = np.random.default_rng(3), agent.model.observation_space.shape
    return digest([agent.predict(rng.normal(size=shape).astype(np.float32))[0] for _ in range(20)])


def _exported(choice: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        made = export_discon(choice, folder, drive=True, hold_missing=True)
        return digest(_texts(Path(file) for file in made["files"]))


def _texts(files: Iterator[Path]) -> dict[str, str]:
    return {file.name: file.read_text(encoding="utf-8") for file in files if file.suffix in (".c", ".IN", ".h", ".md")}


def files() -> Iterator[tuple[str, Callable[[], str]]]:
    """Written models and turbines."""
    yield "openfast/driver_run", _driver_run
    for turbine in RECORDS:
        yield f"windio/{turbine}", lambda turbine=turbine: _written(turbine)
    yield "windio/round-trip", _round_trip


def _driver_run() -> str:
    with tempfile.TemporaryDirectory() as folder:
        scene = scene_of("linear_optimal", wind_speed=15.0, duration=60.0)
        export_openfast("linear_optimal", folder, scene, duration=60.0)
        kinds = (".fst", ".dat", ".IN", ".c", ".md", ".txt")
        found = sorted(file for file in Path(folder).rglob("*") if file.suffix in kinds)
        return digest({file.relative_to(folder).as_posix(): file.read_text(encoding="utf-8") for file in found})


def _written(turbine: str) -> str:
    try:
        return digest(json.dumps(windio_content(load_turbine(turbine))))
    except TurbineDefinitionError as error:  # of a damper, which windIO has no place for
        return digest("refused", str(error))


def _round_trip() -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "turbine.yaml"
        write_windio(load_turbine("iea_15mw"), path)
        return digest(repr(load_turbine(path).blade.structure.stiffness.tolist()))


def commands() -> Iterator[tuple[str, Callable[[], str]]]:
    """Help of the commands."""
    for name in ("", *COMMANDS):
        yield f"help/{name or 'wt-gym'}", lambda name=name: _help(name)


def _help(name: str) -> str:
    words = [sys.executable, "-m", "wt_gym", *([name] if name else []), "--help"]
    return digest(subprocess.run(words, capture_output=True, text=True, check=True, cwd=_ROOT).stdout)


GROUPS = (environments, fidelities, controllers, agents, files, commands)


def take(only: str) -> dict[str, str]:
    """Digests by name."""
    found: dict[str, str] = {}
    for group in GROUPS:
        for name, make in group():
            if not name.startswith(only):
                continue
            began = time.perf_counter()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found[name] = make()
            print(f"{name}: {found[name]} ({time.perf_counter() - began:.1f} s)", file=sys.stderr, flush=True)
    return found


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("write", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--only", default="", help="beginning of the names")
    arguments = parser.parse_args()
    found = take(arguments.only)
    if arguments.action == "write":
        arguments.file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return
    before = json.loads(arguments.file.read_text(encoding="utf-8"))
    before = {name: value for name, value in before.items() if name.startswith(arguments.only)}
    differ = sorted(name for name in {*before, *found} if before.get(name) != found.get(name))
    for name in differ:
        print(f"{name}: {before.get(name, 'not there before')} -> {found.get(name, 'gone')}")
    print(f"{len(found) - len(differ)} of {len(found)} are equal (wt_gym {wt_gym.__version__})")
    sys.exit(bool(differ))


if __name__ == "__main__":
    main()
