"""The folder of one simulation of OpenFAST: the files of a model with start, wind, controls and outputs of that run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.bridges.openfast.input_text import InputFile
from wt_gym.bridges.openfast.measurement import AERODYN_OUTPUTS, INFLOW_OUTPUTS, elastodyn_outputs, servodyn_outputs
from wt_gym.bridges.openfast.model_copy import copy_named_files
from wt_gym.bridges.openfast.wind_file import write_wind

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from wt_gym.bridges.openfast.lidar import PointLidar
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["MODULES", "DriverRun", "RunStart", "ServedController", "prepare_run"]

MODULES = {"ElastoDyn": "EDFile", "AeroDyn": "AeroFile", "ServoDyn": "ServoFile"}
"""Modules whose inputs can be changed, and the keywords of their files in the primary file (``"OpenFAST"``)."""
_STEPS = {"ElastoDyn": "DT", "AeroDyn": "DTAero", "ServoDyn": "DT"}
"""Keywords of the steps of modules."""
_FOREVER = 1e6
_REPLACED = "replaced"
_STATUS = 10.0
"""Time between lines in which the driver says how far it is [s]."""
_RPM = math.pi / 30.0
_SAME = 0.01
"""Share by which numbers of a turbine and of its model may differ."""


@dataclass(frozen=True)
class RunStart:
    """State at time zero, in SI units and radians.

    Attributes
    ----------
    rotor_speed, azimuth, yaw : float
        [rad/s], [rad], [rad].
    pitch : ndarray (n_blades,)
    tower_top : (float, float)
        Displacement of the tower top along global x and y [m].
    tips : (float, float)
        Deflection of the tips out of and in the plane [m].
    """

    rotor_speed: float
    azimuth: float
    yaw: float
    pitch: NDArray[np.float64]
    tower_top: tuple[float, float]
    tips: tuple[float, float]


@dataclass(frozen=True)
class ServedController:
    """Library with the Bladed interface that ServoDyn loads.

    Attributes
    ----------
    library, input_file : str
        Paths, whole or beside the file of ServoDyn.
    lidar : PointLidar or None
        What InflowWind reads for it.
    """

    library: str
    input_file: str
    lidar: PointLidar | None = None


@dataclass(frozen=True)
class DriverRun:
    """What OpenFAST's driver needs beside a model: how long it simulates and how often it writes.

    Attributes
    ----------
    duration : float
        [s].
    interval : float
        Between the rows of its outputs [s].
    """

    duration: float
    interval: float


def prepare_run(
    model: Path,
    folder: Path,
    turbine: Turbine,
    inflow: Inflow,
    start: RunStart,
    step: float,
    duration: float,
    controller: ServedController | None,
    changes: Mapping[str, Mapping[str, Any]],
    driver: DriverRun | None = None,
) -> Path:
    """Write the files of a run beside each other.

    What they name and the run leaves as it is stays where it is, and is copied where OpenFAST's driver runs it. Files
    of a model in the folder itself are replaced, and name each other without it. The folder of a run of the
    driver can be moved.

    Parameters
    ----------
    model : Path
        Primary file of the model.
    folder : Path
        That is there.
    turbine : Turbine
    inflow : Inflow
    start : RunStart
    step : float
        Of OpenFAST [s].
    duration : float
        Time that the wind must last [s].
    controller : ServedController or None
        Gives the demands; None: they are inputs of ServoDyn.
    changes : mapping
        Further values by module and keyword.
    driver : DriverRun, optional
        OpenFAST's driver runs it; by default the library does, which hands over the outputs itself.

    Returns
    -------
    Path
        Of the primary file of the run.

    Raises
    ------
    TurbineDefinitionError
        If a file or a keyword is missing in the model, or it is a model of another turbine.
    SimulationError
        If the model leaves out a module that is needed, or ``changes`` names none.
    """
    if unknown := set(changes) - {"OpenFAST", *MODULES}:
        raise SimulationError(f"changes must name modules {', '.join(('OpenFAST', *MODULES))}; got {sorted(unknown)}")
    primary = InputFile(model)
    for key, supported in (("CompElast", 1), ("CompInflow", 1), ("CompAero", 2), ("CompServo", 1)):
        if int(primary.number(key)) != supported:
            beam = "; blades of BeamDyn are not flown here" if key == "CompElast" else ""
            raise SimulationError(f"{model.name}: {key} must be {supported}{beam}, got {primary.text(key)}")
    files = {name: InputFile(_named(primary, key)) for name, key in MODULES.items()}
    _require_turbine(model, files["ElastoDyn"], turbine)
    if model.parent.resolve() != folder.resolve():
        if driver is None:
            for file in (primary, *files.values()):
                file.resolve_paths()
        else:
            for key in (*MODULES.values(), "InflowFile"):  # which the run has of its own
                primary.set(key, _REPLACED)
            for key in ("DLL_FileName", "DLL_InFile"):
                files["ServoDyn"].set(key, _REPLACED)
            copy_named_files((primary, *files.values()), folder)
    _set_primary(primary, step, driver)
    _set_elastodyn(files["ElastoDyn"], turbine.n_blades, start)
    _set_servodyn(files["ServoDyn"], start, controller)
    files["ServoDyn"].set_outputs(() if driver is None else servodyn_outputs(turbine.n_blades))
    for name, key in _STEPS.items():
        file = files[name]
        if not file.is_default(key) and not _divides(file.number(key), step):
            file.set_default(key)
    files["AeroDyn"].set_outputs(AERODYN_OUTPUTS)
    inflow_file = InputFile(write_wind(inflow, turbine, folder, duration, start.yaw))
    inflow_file.set_outputs(INFLOW_OUTPUTS)
    if controller is not None and controller.lidar is not None:
        hub = _hub(files["ElastoDyn"])
        for key, value in controller.lidar.inputs(hub, turbine.hub_height, step).items():
            inflow_file.set(key, value)
    inflow_file.write(inflow_file.path)
    primary.set("InflowFile", inflow_file.path.name)
    for name, key in MODULES.items():
        primary.set(key, f"{name.lower()}.dat")
    for name, values in changes.items():
        file = primary if name == "OpenFAST" else files[name]
        for key, value in values.items():
            file.set(key, value)
    for name, file in files.items():
        file.write(folder / f"{name.lower()}.dat")
    path = folder / ("run.fst" if driver is None else "model.fst")
    primary.write(path)
    return path


def _require_turbine(model: Path, elastodyn: InputFile, turbine: Turbine) -> None:
    """Refuse a model of another turbine: start, controller and signals would be those of the wrong one."""
    for key, what, wanted in (
        ("NumBl", "blades", float(turbine.n_blades)),
        ("TipRad", "m from the axis to the tips", turbine.hub.radius + turbine.blade.length),
        ("GBRatio", "of the gearbox", turbine.drivetrain.gear_ratio),
    ):
        found = elastodyn.number(key)
        if abs(found - wanted) > _SAME * wanted:
            raise TurbineDefinitionError(
                f"{model.name}: {key} must be that of the turbine {turbine.name}, {wanted:.6g} ({what}) within "
                f"{100.0 * _SAME:g} %, got {found:.6g}"
            )


def _divides(part: float, step: float) -> bool:
    """Whether a step is a whole number of parts."""
    return part > 0.0 and abs(step / part - round(step / part)) < 1e-6 and round(step / part) >= 1


def _named(primary: InputFile, key: str) -> Path:
    path = primary.path.parent / primary.text(key).replace("\\", "/")
    if not path.is_file():
        raise TurbineDefinitionError(f"{primary.path.name}: {key}: there is no file {path}")
    return path


def _set_primary(file: InputFile, step: float, driver: DriverRun | None) -> None:
    file.set("DT", step)
    file.set("AbortLevel", "FATAL")
    file.set("OutFileFmt", 1)
    file.set("ChkptTime", _FOREVER)
    if driver is None:
        file.set("TMax", _FOREVER)
        file.set_default("DT_Out")
        file.set("TStart", _FOREVER)  # outputs come through the library; a file of them is not needed
        file.set("SttsTime", _FOREVER)
    else:
        file.set("TMax", driver.duration)
        file.set("DT_Out", driver.interval)
        file.set("TStart", 0.0)
        file.set("OutFmt", "ES15.7E2")
        file.set("SttsTime", _STATUS)
    file.set("Linearize", False)
    file.set("WrVTK", 0)
    file.set("SumPrint", False)


def _hub(elastodyn: InputFile) -> tuple[float, float, float]:
    """Apex of the rotor of a nacelle that heads along x [m]."""
    overhang, tilt = elastodyn.number("OverHang"), math.radians(elastodyn.number("ShftTilt"))
    height = elastodyn.number("TowerHt") + elastodyn.number("Twr2Shft")
    return overhang * math.cos(tilt), 0.0, height + overhang * math.sin(tilt)


def _set_elastodyn(file: InputFile, n_blades: int, start: RunStart) -> None:
    file.set("OoPDefl", start.tips[0])
    file.set("IPDefl", start.tips[1])
    for blade in range(n_blades):
        file.set(f"BlPitch({blade + 1})", math.degrees(start.pitch[blade]))
    file.set("Azimuth", math.degrees(start.azimuth))
    file.set("RotSpeed", start.rotor_speed / _RPM)
    file.set("NacYaw", math.degrees(start.yaw))
    file.set("TTDspFA", start.tower_top[0])
    file.set("TTDspSS", start.tower_top[1])
    file.set("OutFile", 1)
    file.set_outputs(elastodyn_outputs(n_blades))


def _set_servodyn(file: InputFile, start: RunStart, controller: ServedController | None) -> None:
    mode = 4 if controller is None else 5
    for key, value in (("PCMode", mode), ("VSContrl", mode), ("YCMode", mode), ("HSSBrMode", 0)):
        file.set(key, value)
    for key in ("TPCOn", "TYCOn", "TimGenOn"):
        file.set(key, 0.0)
    for key in ("TimGenOf", "TYawManS", *(f"TPitManS({blade})" for blade in (1, 2, 3))):
        file.set(key, _FOREVER)
    file.set("GenTiStr", True)
    file.set("GenTiStp", True)
    file.set("YawNeut", math.degrees(start.yaw))
    if controller is not None:
        file.set("DLL_FileName", controller.library)
        file.set("DLL_InFile", controller.input_file)
        file.set("DLL_ProcName", "DISCON")
        file.set_default("DLL_DT")  # the step of ServoDyn: a longer one holds demands late, another one is fatal
        file.set("DLL_Ramp", False)
        file.set("BPCutoff", _FOREVER)
        file.set("Ptch_Cntrl", 1)  # else the collective pitch alone is read
