"""Runs of OpenFAST's own driver: a turbine in a wind under a Bladed library, and what the driver wrote of it.

The turbine stands beside a run as a whole JSON file, so that outputs can be read without the model they are made with.
"""

from __future__ import annotations

import math
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.base.files import write_text_whole
from wt_gym.bridges.openfast.measurement import (
    AERODYN_OUTPUTS,
    INFLOW_OUTPUTS,
    PITCH_COMMAND_OUTPUT,
    TORQUE_OUTPUT,
    Measurement,
    elastodyn_outputs,
    servodyn_outputs,
    water_outputs,
)
from wt_gym.bridges.openfast.model import PRIMARY, steps_of, time_step_of, write_model
from wt_gym.bridges.openfast.run_folder import BentTurbine, RunTimes, ServedController, prepare_run
from wt_gym.control.operating_point import starting_point
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation.channels import channel_table
from wt_gym.turbines import Turbine
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.wind import Inflow

if TYPE_CHECKING:
    import xarray as xr

_LAST_WORDS = 600  # Characters of the driver's output that a message shows
_NORMAL_END = "terminated normally"


def write_driver_run(  # noqa: PLR0913
    turbine: Turbine,
    inflow: Inflow,
    folder: str | Path,
    controller: ServedController,
    *,
    duration: float,
    interval: float,
    azimuth: float = 0.0,
    parked: bool = False,
    model: str | Path | None = None,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
    sea: WaveComponents | None = None,
) -> Path:
    """Write a turbine in a wind under a Bladed library as a folder that OpenFAST's driver runs: ``openfast model.fst``.

    The run begins at the operating point of the wind, as an environment with ``start="steady"`` does. The driver writes
    what `read_outputs` needs into ``model.out``; the turbine that this is of stands in `TURBINE_FILE` beside it.

    Parameters
    ----------
    inflow : Inflow
        Written by `wt_gym.bridges.openfast.wind.write_wind`.
    folder : str or path
        Made if it is not there; files of the same names in it are replaced.
    duration : float
        [s].
    interval : float
        Step of the controller and between rows of the outputs [s]; steps of OpenFAST divide it.
    azimuth : float
        Of blade 1 at the start [rad].
    parked : bool
        Whether the run begins with a rotor at rest and feathered blades instead.
    model : str or path, optional
        Primary file (``.fst``) of a model of the user's instead of one that is written of the turbine.
    changes : mapping, optional
        As of `wt_gym.bridges.openfast.OpenFASTSimulator`.
    sea : WaveComponents, optional
        Waves that a floating turbine meets; by default the water is still.

    Returns
    -------
    Path
        Of the primary file.

    Raises
    ------
    TurbineDefinitionError
        For a rotor that turns counter-clockwise, which OpenFAST 5.0 has not, and as `write_model` does.
    SimulationError
        If a model leaves out a module that is needed, or ``changes`` names none.
    """
    if turbine.rotation != "clockwise":
        raise TurbineDefinitionError(
            f"{turbine.name}: rotation must be 'clockwise' for OpenFAST's driver, got {turbine.rotation!r}"
        )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    own = None if model is None else Path(model)
    longest = time_step_of(turbine) if own is None else InputFile(own).number("DT")
    step = interval / steps_of(interval, longest)
    point = starting_point(turbine, inflow)
    speed, pitch = (0.0, min(turbine.pitch.max_pitch, 0.5 * math.pi)) if parked else (point.rotor_speed, point.pitch)
    start = BentTurbine(turbine).start(inflow, speed, np.full(turbine.n_blades, pitch), azimuth, 0.0)
    written = write_model(turbine, folder) if own is None else own
    primary = prepare_run(
        written, folder, turbine, inflow, start, RunTimes(step, duration, interval), controller, changes or {}, sea
    )  # fmt: skip
    if own is None:
        (folder / PRIMARY).unlink()  # model.fst takes its place
    write_turbine(turbine, folder / TURBINE_FILE)
    return primary


def run_driver(primary: Path, driver: Path) -> Path:
    """Run OpenFAST's driver on a primary file; path of its outputs.

    Raises
    ------
    SimulationError
        With the driver's last words where it does not end normally.
    """
    command = [str(driver), primary.name]
    done = subprocess.run(command, cwd=primary.parent, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    said = " ".join(done.stdout.decode("utf-8", "replace").split())
    if done.returncode or _NORMAL_END not in said:
        raise SimulationError(f"OpenFAST ended with exit status {done.returncode}: {said[-_LAST_WORDS:]}")
    return primary.with_suffix(".out")


def read_outputs(path: str | Path, turbine: Turbine, every: int = 1) -> xr.Dataset:
    """Signals of this package from the text file of outputs of OpenFAST's driver.

    Parameters
    ----------
    path : str or path
        Of a file ``.out``, evenly sampled.
    turbine : Turbine
        That was simulated.
    every : int
        Rows of the file that make a sample, after that of the start: extremes and travel are over them.

    Returns
    -------
    xarray.Dataset
        Channels over ``time``, as `wt_gym.simulation.Recorder` gives them; what `wt_gym.analysis.metrics.run_metrics`
        takes.

    Raises
    ------
    SimulationError
        If it is not such a file, or outputs that are needed are missing.
    """
    import xarray as xr  # heavy, and only needed here

    path = Path(path)
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    head = next((k for k, line in enumerate(lines) if line.split()[:1] == ["Time"]), len(lines))
    rows = [line.split() for line in lines[head + 2 :] if line.strip()]  # below the names stand the units
    if not rows:
        raise SimulationError(f"{path} must be a text file of outputs of OpenFAST (OutFileFmt 1) with rows of numbers")
    names = lines[head].split()
    n = turbine.n_blades
    needed = (*elastodyn_outputs(n, turbine.floater is not None), *AERODYN_OUTPUTS, *INFLOW_OUTPUTS,
              *servodyn_outputs(n), *water_outputs(turbine.n_lines))  # fmt: skip
    there = {name.lower(): k for k, name in enumerate(names)}
    if missing := [name for name in needed if name.lower() not in there]:
        raise SimulationError(f"{path} must have the outputs {', '.join(needed)}; {', '.join(missing)} are missing")
    table = np.array(rows, dtype=np.float64)
    torque = 1e3 * table[:, there[TORQUE_OUTPUT.lower()]]
    commands = np.radians(table[:, [there[f"{PITCH_COMMAND_OUTPUT}{b}".lower()] for b in range(1, n + 1)]])
    pitch = np.radians(table[:, [there[f"bldpitch{b}"] for b in range(1, n + 1)]])
    turned = np.diff(pitch, axis=0, prepend=pitch[:1])
    rates = np.zeros_like(turned) if len(table) < 2 else turned / (table[1, 0] - table[0, 0])
    measurement, signals = Measurement(turbine, names), []
    for last in range(0, len(table), every):
        over, travel = slice(max(last - every + 1, 0), last + 1), abs(turned[max(last - every + 1, 0) : last + 1])
        measurement.take(
            float(table[last, 0]), table[over], float(torque[last]), commands[last], rates[last], travel.sum(axis=0),
            False,
        )  # fmt: skip
        signals.append(measurement.signals())
    values = np.array([one.values for one in signals])
    variables = {
        channel.name: ("time", values[:, k], {"units": channel.unit, "long_name": channel.description})
        for k, channel in enumerate(channel_table(n, turbine.n_lines)[1:], start=1)
    }
    return xr.Dataset(variables, {"time": ("time", values[:, 0], {"units": "s"})}, {"turbine": turbine.name})


TURBINE_FILE = "turbine.json"
"""Name of the file beside a primary file that is written here."""


def write_turbine(turbine: Turbine, path: Path) -> None:
    """Write a turbine; `read_turbine` gives the same one, to the last bit."""
    write_text_whole(path, turbine.to_json() + "\n")


def read_turbine(path: Path) -> Turbine:
    """Read a turbine that `write_turbine` has written."""
    try:
        return Turbine.from_json(path.read_text(encoding="utf-8"))
    except (ValueError, TypeError) as error:
        raise TurbineDefinitionError(f"{path} must be the file of a turbine that was written here: {error}") from error
