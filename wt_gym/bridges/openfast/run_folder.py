"""The folder of one simulation of OpenFAST: the files of a model with start, wind, controls and outputs of that run.

Blades and tower start bent as by a steady wind. The files that a model names are copied beside a run of the driver, so
that its folder can be moved.
"""

import math
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.bridges.openfast.measurement import AERODYN_OUTPUTS, INFLOW_OUTPUTS, elastodyn_outputs, servodyn_outputs
from wt_gym.bridges.openfast.model import POWERS, blade_sections, tower_sections
from wt_gym.bridges.openfast.water import resting_place, write_sea
from wt_gym.bridges.openfast.wind import PointLidar, write_wind
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.turbines import Turbine
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import start_speed

MODULES = {"ElastoDyn": "EDFile", "AeroDyn": "AeroFile", "ServoDyn": "ServoFile"}
"""Modules whose inputs can be changed, and the keywords of their files in the primary file (``"OpenFAST"``)."""
_STEPS = {"ElastoDyn": "DT", "AeroDyn": "DTAero", "ServoDyn": "DT"}  # Keywords of the steps of modules
_FOREVER = 1e6
_REPLACED = "replaced"
_STATUS = 10.0  # Time between lines in which the driver says how far it is [s]
_RPM = math.pi / 30.0
_SAME = 0.01  # Share by which numbers of a turbine and of its model may differ


@dataclass(frozen=True)
class RunStart:
    """State at time zero, in SI units and radians."""

    rotor_speed: float
    azimuth: float
    yaw: float
    pitch: Array
    """(n_blades,)."""
    tower_top: tuple[float, float]
    """Displacement of the tower top along global x and y [m]."""
    tips: tuple[float, float]
    """Deflection of the tips out of and in the plane [m]."""
    platform: Array = field(default_factory=lambda: np.zeros(6))
    """Displacement and rotation of a floating platform [m], [rad]."""


@dataclass(frozen=True)
class ServedController:
    """Library with the Bladed interface that ServoDyn loads."""

    library: str
    """Path, whole or beside the file of ServoDyn."""
    input_file: str
    """Likewise."""
    lidar: PointLidar | None = None
    """Read by InflowWind for it."""


@dataclass(frozen=True)
class RunTimes:
    """Times of a run."""

    step: float
    """Of OpenFAST [s]."""
    duration: float
    """Time that the wind must last, and OpenFAST's driver runs [s]."""
    interval: float | None = None
    """Between the rows of the driver's outputs [s]; None: the library runs it, which hands over outputs itself."""


def prepare_run(  # noqa: PLR0913
    model: Path,
    folder: Path,
    turbine: Turbine,
    inflow: Inflow,
    start: RunStart,
    times: RunTimes,
    controller: ServedController | None,
    changes: Mapping[str, Mapping[str, Any]],
    sea: WaveComponents | None = None,
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
    controller : ServedController or None
        Gives the demands; None: they are inputs of ServoDyn.
    changes : mapping
        Further values by module and keyword.
    sea : WaveComponents, optional
        Waves that a floating turbine meets.

    Returns
    -------
    Path
        Of the primary file of the run.
    """
    if unknown := set(changes) - {"OpenFAST", *MODULES}:
        raise SimulationError(f"changes must name modules {', '.join(('OpenFAST', *MODULES))}; got {sorted(unknown)}")
    primary = InputFile(model)
    platform = turbine.floater
    afloat = () if platform is None else (("CompSeaSt", 1), ("CompHydro", 1), ("CompMooring", 3))
    for key, supported in (("CompElast", 1), ("CompInflow", 1), ("CompAero", 2), ("CompServo", 1), *afloat):
        if int(primary.number(key)) != supported:
            beam = "; blades of BeamDyn are not flown here" if key == "CompElast" else ""
            raise SimulationError(f"{model.name}: {key} must be {supported}{beam}, got {primary.text(key)}")
    files = {name: primary.file(key) for name, key in MODULES.items()}
    _require_turbine(model, files["ElastoDyn"], turbine)
    waves = () if platform is None else ("SeaStFile",)
    if model.parent.resolve() != folder.resolve():
        if times.interval is None:
            for file in (primary, *files.values()):
                file.resolve_paths()
        else:
            primary.set_all(dict.fromkeys((*MODULES.values(), "InflowFile", *waves), _REPLACED))  # the run has its own
            files["ServoDyn"].set_all(dict.fromkeys(("DLL_FileName", "DLL_InFile"), _REPLACED))
            copy_named_files((primary, *files.values()), folder)
    _set_primary(primary, times)
    if platform is not None:
        primary.set("SeaStFile", write_sea(platform, sea, times.duration, folder).name)
        if sea is not None and times.interval is None:
            # waves are made for the whole run, and outputs are not before its end
            primary.set_all({"TMax": times.duration, "TStart": times.duration - times.step})
    _set_elastodyn(files["ElastoDyn"], turbine, start)
    _set_servodyn(files["ServoDyn"], start, controller)
    files["ServoDyn"].set_outputs(() if times.interval is None else servodyn_outputs(turbine.n_blades))
    for name, key in _STEPS.items():
        file = files[name]
        if not file.is_default(key) and not _divides(file.number(key), times.step):
            file.set(key, None)
    files["AeroDyn"].set_outputs(AERODYN_OUTPUTS)
    inflow_file = InputFile(write_wind(inflow, turbine, folder, times.duration))
    inflow_file.set_outputs(INFLOW_OUTPUTS)
    if controller is not None and controller.lidar is not None:
        hub = _hub(files["ElastoDyn"])
        inflow_file.set_all(controller.lidar.inputs(hub, turbine.hub_height, times.step))
    inflow_file.write(inflow_file.path)
    primary.set("InflowFile", inflow_file.path.name)
    for name, key in MODULES.items():
        primary.set(key, f"{name.lower()}.dat")
    for name, values in changes.items():
        (primary if name == "OpenFAST" else files[name]).set_all(values)
    for name, file in files.items():
        file.write(folder / f"{name.lower()}.dat")
    path = folder / ("run.fst" if times.interval is None else "model.fst")
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


def _set_primary(file: InputFile, run: RunTimes) -> None:
    fixed = {"DT": run.step, "AbortLevel": "FATAL", "OutFileFmt": 1, "ChkptTime": _FOREVER}
    file.set_all(fixed | {"Linearize": False, "WrVTK": 0, "SumPrint": False})
    if run.interval is None:  # outputs come through the library; a file of them is not needed
        file.set_all({"TMax": _FOREVER, "DT_Out": None, "TStart": _FOREVER, "SttsTime": _FOREVER})
    else:
        times = {"TMax": run.duration, "DT_Out": run.interval, "TStart": 0.0, "SttsTime": _STATUS}
        file.set_all({**times, "OutFmt": "ES15.7E2"})


def _hub(elastodyn: InputFile) -> tuple[float, float, float]:
    """Apex of the rotor of a nacelle that heads along x [m]."""
    overhang, tilt = elastodyn.number("OverHang"), math.radians(elastodyn.number("ShftTilt"))
    height = elastodyn.number("TowerHt") + elastodyn.number("Twr2Shft")
    return overhang * math.cos(tilt), 0.0, height + overhang * math.sin(tilt)


def _set_elastodyn(file: InputFile, turbine: Turbine, start: RunStart) -> None:
    n_blades, floats = turbine.n_blades, turbine.floater is not None
    file.set_all({
        "OoPDefl": start.tips[0], "IPDefl": start.tips[1], "TTDspFA": start.tower_top[0], "TTDspSS": start.tower_top[1],
        **{f"BlPitch({blade + 1})": math.degrees(start.pitch[blade]) for blade in range(n_blades)},
        "Azimuth": math.degrees(start.azimuth), "NacYaw": math.degrees(start.yaw),
        "RotSpeed": start.rotor_speed / _RPM, "OutFile": 1,
    })  # fmt: skip
    if floats:
        for k, name in enumerate(("Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw")):
            file.set(f"Ptfm{name}", float(start.platform[k] if k < 3 else math.degrees(start.platform[k])))
    file.set_outputs(elastodyn_outputs(n_blades, floats))


def _set_servodyn(file: InputFile, start: RunStart, controller: ServedController | None) -> None:
    mode = 4 if controller is None else 5
    file.set_all({
        "PCMode": mode, "VSContrl": mode, "YCMode": mode, "HSSBrMode": 0, "GenTiStr": True, "GenTiStp": True,
        **dict.fromkeys(("TPCOn", "TYCOn", "TimGenOn"), 0.0), "YawNeut": math.degrees(start.yaw),
        **dict.fromkeys(("TimGenOf", "TYawManS", *(f"TPitManS({blade})" for blade in (1, 2, 3))), _FOREVER),
    })  # fmt: skip
    if controller is not None:
        # DLL_DT the step of ServoDyn: a longer one holds demands late, another one is fatal;
        # Ptch_Cntrl 1: else the collective pitch alone is read
        file.set_all({
            "DLL_FileName": controller.library, "DLL_InFile": controller.input_file, "DLL_ProcName": "DISCON",
            "DLL_DT": None, "DLL_Ramp": False, "BPCutoff": _FOREVER, "Ptch_Cntrl": 1,
        })  # fmt: skip


_LEAST_SPEED = 1e-4  # ElastoDyn needs a rotor that turns, if only just [rad/s]


@dataclass(frozen=True)
class Deflections:
    """Deflections of the tips out of and in the rotor plane, of the tower top fore-aft and side-side [m]."""

    out_of_plane: float
    in_plane: float
    fore_aft: float
    side_side: float


class BentTurbine:
    """First modes of blade and tower under steady loads."""

    def __init__(self, turbine: Turbine):
        self._turbine = turbine
        self._elements = BladeElements(BladeElementRotor.of_turbine(turbine))
        blade = blade_sections(turbine)
        x = (self._elements.span - turbine.hub.radius) / turbine.blade.length
        self._mass = np.interp(x, blade.fraction, blade.mass)
        self._twist = np.interp(x, blade.fraction, blade.twist)
        flap, edge = (x[:, None] ** POWERS @ shape for shape in (blade.flap_shapes[0], blade.edge_shape))
        bends = x[:, None] ** (POWERS - 2) * POWERS * (POWERS - 1)
        self._curvatures = bends @ blade.flap_shapes[0], bends @ blade.edge_shape
        width = self._elements.width
        omega = 2.0 * np.pi * blade.frequencies
        rated = turbine.drivetrain.rated_rotor_speed
        self._stiffness = (
            omega[0] ** 2 * float(self._mass @ flap**2) * width,
            (omega[2] ** 2 + rated**2) * float(self._mass @ edge**2) * width,
        )
        if turbine.tower.support is not None:  # its compliance is not known here
            self._push = self._lean = self._weight = 0.0
            return
        tower = tower_sections(turbine)
        shape = np.linspace(0.0, 1.0, 200)[:, None] ** POWERS @ tower.fore_aft_shapes[0]
        m0 = turbine.blade.structure.mass_moment()
        top = turbine.n_blades * m0 + turbine.hub.mass + turbine.nacelle.mass + turbine.nacelle.yaw_bearing_mass
        along = np.interp(np.linspace(0.0, 1.0, 200), tower.fraction, tower.mass)
        modal = top + float(np.mean(along * shape**2)) * turbine.tower.length
        self._push = 1.0 / float((2.0 * np.pi * tower.frequencies[0]) ** 2 * modal)
        self._weight = GRAVITY * (top + float(np.mean(along * shape)) * turbine.tower.length)
        slope = float(POWERS @ tower.side_side_shapes[0]) / turbine.tower.length
        self._lean = slope / float((2.0 * np.pi * tower.frequencies[2]) ** 2 * modal)

    def deflections(self, wind: float, rotor_speed: float, pitch: float) -> Deflections:
        """Deflections of a rotor that turns in a steady wind; of one that stands or barely turns none.

        Parameters
        ----------
        wind : float
            [m/s].
        rotor_speed : float
            [rad/s].
        pitch : float
            [rad].
        """
        turbine = self._turbine
        if not self._turns(wind, rotor_speed):
            return Deflections(0.0, 0.0, 0.0, 0.0)
        loads = self._elements.solve(wind, rotor_speed, pitch)
        normal, driving = loads["normal"][0], loads["driving"][0]
        # coned upwind, the centrifugal force bends the blades back
        cone = np.sin(turbine.hub.cone) * np.cos(turbine.hub.cone)
        normal = normal + self._mass * rotor_speed**2 * self._elements.span * cone
        force = np.stack([normal, -driving], axis=1)  # out of the plane, and to the trailing edge in it
        angle = self._twist + pitch
        axes = (np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))
        tip, width = np.zeros(2), self._elements.width
        for curvature, axis, stiffness in zip(self._curvatures, axes, self._stiffness, strict=True):
            slope = np.cumsum(curvature[:, None] * np.stack(axis, axis=1), axis=0)
            move = (np.cumsum(slope, axis=0) - 0.5 * slope) / len(slope) ** 2  # along the blade, of one unit
            tip += float(np.sum(force * move)) * width / stiffness * move[-1]
        moment = float(loads["power"][0]) / rotor_speed  # turns the tower top about x, to the right
        return Deflections(
            float(tip[0]), float(tip[1]), float(loads["thrust"][0]) * self._push, -moment * self._lean
        )  # fmt: skip

    def start(
        self, inflow: Inflow, rotor_speed: float, pitch: Array, azimuth: float, yaw: float,
        tower_top: Array | None = None, sea: WaveComponents | None = None,
    ) -> RunStart:  # fmt: skip
        """Start of a run in a wind and the current of a sea.

        Parameters
        ----------
        rotor_speed, azimuth, yaw : float
            [rad/s], [rad], [rad].
        pitch : array (n_blades,)
            [rad].
        tower_top : array (2,), optional
            Displacement along and across the nacelle [m], instead of that under the steady wind.
        """
        wind, mean_pitch = start_speed(inflow), float(pitch.mean())
        bent = self.deflections(wind, rotor_speed, mean_pitch)
        fore, side = (bent.fore_aft, bent.side_side) if tower_top is None else tower_top.tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        top = cos * fore - sin * side, sin * fore + cos * side
        tips = bent.out_of_plane, bent.in_plane
        speed = max(rotor_speed, _LEAST_SPEED)
        if self._turbine.floater is None:
            return RunStart(speed, azimuth, yaw, pitch, top, tips)
        thrust = torque = 0.0
        if self._turns(wind, rotor_speed):
            loads = self._elements.solve(wind, rotor_speed, mean_pitch)
            thrust, torque = float(loads["thrust"][0]), float(loads["power"][0]) / rotor_speed
        place = resting_place(self._turbine, thrust, torque, yaw, sea)
        if tower_top is None:  # a tower that leans bends under its own weight
            top = top[0] + self._push * self._weight * place[4], top[1] - self._push * self._weight * place[3]
        return RunStart(speed, azimuth, yaw, pitch, top, tips, place)

    def _turns(self, wind: float, rotor_speed: float) -> bool:
        """Whether the rotor turns in a wind, and not just barely."""
        return rotor_speed >= 0.1 * self._turbine.drivetrain.rated_rotor_speed and wind > 0.0


FOLDER = "model"
"""Folder of the copies."""
_NAMED = re.compile(r'"([^"\n]{1,250})"|@([^\s"]{1,250})')
_MOST_BYTES = 20_000_000  # Larger files are data, which name nothing


def copy_named_files(files: Sequence[InputFile], folder: Path) -> None:
    """Copy what input files name, and what that names, into `FOLDER`, and have the input files name the copies.

    The copies stand to each other as the files do, so that relative names in them hold. Files of one stem are copied
    together where the stem is named, as HydroDyn's potential-flow data. Whole paths in copied files stay as they are.

    Parameters
    ----------
    files : sequence of InputFile
        To be written into ``folder``.
    """
    found: dict[Path, None] = {}
    for file in files:
        _collect(file.path.parent.resolve(), "\n".join(file.lines), found)
    if not found:
        return
    root = Path(os.path.commonpath([path.parent for path in found]))
    for path in found:
        copy = folder / FOLDER / path.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    for file in files:
        base = file.path.parent.resolve()
        for name in {match.group(1) for match in _NAMED.finditer("\n".join(file.lines)) if match.group(1)}:
            if any(_files_of(base, name)):
                inside = _place(base, name).relative_to(root)
                file.rename(name, (Path(FOLDER) / inside).as_posix())


def _place(base: Path, name: str) -> Path:
    return Path(os.path.normpath(base / name.replace("\\", "/")))


def _files_of(base: Path, name: str) -> Iterator[Path]:
    """Files that a name in a file of a folder stands for: that file, else those of the stem."""
    place = _place(base, name)
    if place.is_file():
        yield place
    elif place.parent.is_dir():
        for path in sorted(place.parent.iterdir()):
            if path.name.startswith(f"{place.name}.") and path.is_file():
                yield path


def _collect(base: Path, text: str, found: dict[Path, None]) -> None:
    for match in _NAMED.finditer(text):
        for path in _files_of(base, match.group(1) or match.group(2)):
            if path in found:
                continue
            found[path] = None
            if path.stat().st_size <= _MOST_BYTES and b"\0" not in (content := path.read_bytes()):
                _collect(path.parent, content.decode("utf-8", "replace"), found)
