"""ROSCO, NREL's reference open-source controller, as the PyPI package ``rosco`` brings it.

N. J. Abbas, D. S. Zalkind, L. Pao and A. Wright, A reference open-source controller for fixed and floating offshore
wind turbines, Wind Energ. Sci. 7 (2022) 53. The package brings the library, and input files that were tuned for some
turbines; any other turbine gets an input file by `wt_gym.control.bladed.rosco_input`.
"""

from __future__ import annotations

import importlib.util
import math
import re
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.base.errors import ControllerError
from wt_gym.control.bladed.controller import BladedController
from wt_gym.control.bladed.rosco_input import start_stop_values, value_text, write_rosco_input
from wt_gym.control.controllers.controller import demanded_power_of
from wt_gym.control.controllers.parameters import PATH, Parameter
from wt_gym.control.controllers.rotor_rules import same_rotor
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast_text import TextFile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.control.actions import Demand
    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import Turbine

__all__ = ["PARAMETERS", "RoscoController", "rosco_library", "tuned_input"]

_FACTORS = {
    "speed": ("Ind_R_Speed", "Ind_R_Torque"),
    "torque": ("Ind_R_Torque",),
    "pitch": ("Ind_R_Pitch", "Ind_R_Torque"),
}
"""Columns of the open-loop file by the way of derating.

Where ROSCO holds the power, its factor on rated torque is that on the power. Without it a slower turbine makes up to a
tenth more than R, one with a higher fine pitch all above rated wind.
"""
_COURSE, _STEP, _LONGEST = "demanded_power.dat", 0.01, 1e5
LONGEST_INTERVAL = 0.0125
"""Longest time between calls [s], the step with which ROSCO is used in OpenFAST."""

PARAMETERS = (
    Parameter(
        "input_file", "-", "path of a DISCON.IN", word=PATH,
        otherwise="the one that the package brings for the turbine, else one made from its data",
    ),
    Parameter("interval", "s", "longest time between calls", 0.0, above=True, otherwise="the controller's step"),
    Parameter(
        "derate", "-", "what a demanded power lowers: ROSCO's factor on rated torque, and beside it that on rated "
        "speed or on the power at fine pitch", word="speed, torque or pitch", otherwise="nothing",
    ),
    Parameter(
        "start_stop", "-", "whether it starts a parked turbine and stops it for good where the pitch or the speed is "
        "high (SU_Mode, SD_Mode)", switch=True, only_object=True,
    ),
    Parameter(
        "time_scale", "-", "factor on ROSCO's durations of a start-up, and on the 600 s over which the pitch is "
        "averaged that stops the turbine", 0.0, above=True,
    ),
    Parameter("isolated", "-", "whether it runs in a process of its own", switch=True, only_object=True),
)  # fmt: skip
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""

_TUNED = {
    "nrel_5mw": "NREL-5MW/DISCON.IN",
    "iea_15mw": "IEA-15-240-RWT/IEA-15-240-RWT-Monopile/IEA-15-240-RWT-Monopile_DISCON.IN",
}
"""Input files of the package's test cases for turbines with the rotor of one of the catalogue."""


def _package() -> Path:
    """Folder of the package.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If it is not installed.
    """
    spec = importlib.util.find_spec("rosco")
    if spec is None or not spec.submodule_search_locations:
        raise ControllerError(
            "the controller 'rosco' needs the package rosco: pip install 'wt_gym[rosco]' (without its tuning tools: "
            "pip install --no-deps rosco)"
        )
    return Path(next(iter(spec.submodule_search_locations)))


def rosco_library() -> Path:
    """Path of ROSCO's library.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the package ``rosco`` is not installed, or brings no library for this machine.
    """
    folder = _package() / "lib"
    ending = {"win32": "dll", "darwin": "dylib"}.get(sys.platform, "so")
    library = folder / f"libdiscon.{ending}"
    if not library.is_file():
        raise ControllerError(f"the package rosco must bring {library.name}; there is none in {folder}")
    return library


def tuned_input(turbine: Turbine) -> Path | None:
    """Input file of the package for a turbine; None where it brings none."""
    for name, case in _TUNED.items():
        known = _known(name)
        if known.rotor_diameter == turbine.rotor_diameter and same_rotor(known, turbine):
            path = _package().parent / "Examples" / "Test_Cases" / case
            return path if path.is_file() else None
    return None


_known = cache(load_turbine)


class RoscoController(BladedController):
    """ROSCO's library behind the contract of controllers.

    The library gets a copy of the input file with logging switched off and paths made absolute.

    Parameters
    ----------
    turbine : Turbine
    input_file : str or path, optional
        By default the one that the package brings for the turbine, else one that is made from its data.
    interval : float, optional
        Longest time between calls [s].
    isolated : bool
        See `BladedController`.
    derate : {"speed", "torque", "pitch"}, optional
        By what a demanded power is followed: its whole course, as it is known at a start, goes into an open-loop file
        of ROSCO's power reference control (PRC_Mode 2, PRC_Comm 1).
    start_stop : bool
        Switches ROSCO's shut-down on (SD_Mode), and its start-up (SU_Mode) where the controller starts on a turbine
        that stands with feathered blades: on one that runs a start-up would take the torque away. Their numbers are
        those of `wt_gym.control.bladed.rosco_input.start_stop_values`, in an ``input_file`` that is given its own.
    time_scale : float
        As of `start_stop_values` [-].

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the package ``rosco`` is not installed.
    FileNotFoundError
        If there is no such input file.
    ValueError
        If the way is unknown.
    """

    def __init__(
        self,
        turbine: Turbine,
        input_file: str | Path | None = None,
        *,
        interval: float | None = LONGEST_INTERVAL,
        isolated: bool = False,
        derate: str | None = None,
        start_stop: bool = False,
        time_scale: float = 1.0,
    ):
        if derate is not None and derate not in _FACTORS:
            raise ValueError(f"derate of the controller 'rosco' must be among {', '.join(_FACTORS)}, got {derate!r}")
        library = rosco_library()
        folder = tempfile.TemporaryDirectory(prefix="wt_gym_rosco_")
        target = Path(folder.name) / "DISCON.IN"
        source = tuned_input(turbine) if input_file is None else Path(input_file).expanduser()
        if source is None:
            write_rosco_input(turbine, target)
        elif source.is_file():
            target.write_text(quiet_input(source), encoding="utf-8")
        else:
            raise FileNotFoundError(f"there is no input file {source} of ROSCO")
        super().__init__(turbine, library, target, interval=interval, isolated=isolated)
        self.input_folder = folder
        """Holds the input file as long as this controller or a copy of it lives."""
        self._derate, self._plain_input = derate, target.read_text(encoding="utf-8")
        self._start_stop: dict[str, object] | None = None
        if start_stop:
            self._start_stop = start_stop_values(turbine, time_scale) if input_file is None else {}

    @property
    def holds_set_point(self) -> bool:
        """Whether it holds what a `Supervisor` asks for, by readings of the speeds over their set point.

        The demand of a power and the stages of a start-up are about speeds as they are.
        """
        return self._derate is None and self._start_stop is None

    @property
    def in_production(self) -> bool:
        """True unless it may stop the turbine: with ``start_stop`` the library does not tell its stages."""
        return self._start_stop is None

    def runs_in(self, wind: float) -> bool:
        """Whether a turbine runs in a mean wind [m/s] at a start: with ``start_stop`` from cut-in to cut-out.

        See `wt_gym.control.controllers.controller.starting_part`.
        """
        return self._start_stop is None or self.turbine.cut_in <= wind <= self.turbine.cut_out

    def start(self, signals: Readings, demand: Demand) -> None:
        """Load the library afresh, with what this start alone has in its files.

        That is the course of a demanded power if it is to follow one, and start-up and shut-down.
        """
        if self._derate is not None or self._start_stop is not None:
            self._write_input(signals, demand)
        super().start(signals, demand)

    def _write_input(self, signals: Readings, demand: Demand) -> None:
        """Write the input file of this start into a folder of its own: copies keep theirs."""
        before = Path(self.input_file).parent
        folder = tempfile.TemporaryDirectory(prefix="wt_gym_rosco_")
        made = Path(folder.name)
        for file in before.iterdir():
            (made / file.name).write_bytes(file.read_bytes())
        values: dict[str, object] = {}
        if self._derate is not None:
            values |= self._write_course(signals, made)
        if self._start_stop is not None:
            parked = self._is_parked(signals, demand)
            values |= self._start_stop | {"SU_Mode": int(parked), "SD_Mode": 1}
            if self._start_stop and not parked:
                values["SD_TimeActivate"] = 0.0
        (made / "DISCON.IN").write_text(with_values(self._plain_input, values), encoding="utf-8")
        self.input_file, self.input_folder = str(made / "DISCON.IN"), folder

    def _is_parked(self, signals: Readings, demand: Demand) -> bool:
        """Whether the rotor barely turns and the blades are feathered."""
        feather = min(self.turbine.pitch.max_pitch, 0.5 * math.pi)
        slow = signals["rotor_speed"] < 0.25 * self.turbine.drivetrain.rated_rotor_speed
        return slow and float(sum(demand.pitch)) / len(demand.pitch) > 0.5 * feather

    def _write_course(self, signals: Readings, folder: Path) -> dict[str, object]:
        """Write an open-loop file; values of the input file that have ROSCO follow it."""
        factors = _FACTORS[self._derate or ""]
        course = _course(signals, self.turbine.drivetrain.rated_power, len(factors))
        (folder / _COURSE).write_text(course, encoding="utf-8")
        values = {"PRC_Mode": 2, "PRC_Comm": 1, "OL_Mode": 1, "OL_Filename": f'"{folder / _COURSE}"'}
        columns = {name: column for column, name in enumerate(factors, start=2)}  # each wants one of its own
        return values | {"Ind_Breakpoint": 1} | columns

    @classmethod
    def of_turbine(  # type: ignore[override]  # its library is known
        cls,
        turbine: Turbine,
        input_file: str | Path | None = None,
        interval: float | None = LONGEST_INTERVAL,
        isolated: bool = False,
        derate: str | None = None,
        start_stop: bool = False,
        time_scale: float = 1.0,
    ) -> RoscoController:
        """Make one by name; parameters as of the class."""
        return cls(
            turbine, input_file, interval=interval, isolated=isolated, derate=derate, start_stop=start_stop,
            time_scale=time_scale,
        )  # fmt: skip


def _course(signals: Readings, rated_power: float, columns: int = 1) -> str:
    """Rows of time since the start [s] and, in so many columns, power over rated [-]."""
    reference = getattr(signals, "reference", None)
    if reference is None:
        demanded = demanded_power_of(signals)
        share = 1.0 if demanded is None else demanded / rated_power
        rows = [(0.0, share), (_LONGEST, share)]
    else:
        begin = signals["time"]
        points = zip(reference.times, reference.powers, strict=True)
        later = [(time - begin, power / rated_power) for time, power in points if time > begin]
        rows = [(0.0, reference.at(begin) / rated_power), *later]
        rows.append((max(_LONGEST, rows[-1][0] + 1.0), rows[-1][1]))
    lines, last = ["! time  share", "! s  -"], -math.inf
    for time, share in rows:
        last = max(time, last + _STEP)  # interpolation wants times that rise
        lines.append(f"{last:.4f}" + columns * f" {min(max(share, 0.0), 1.0):.6f}")
    return "\n".join(lines) + "\n"


def with_values(text: str, values: Mapping[str, object]) -> str:
    """Text of an input file with other values of some parameters; those that it does not have are added."""
    left, lines = dict(values), []
    for line in text.rstrip("\n").split("\n"):
        _, mark, comment = line.partition("!")
        found = re.match(r"\s*(\w+)", comment)
        if found is not None and found[1] in left:
            line = f"{value_text(left.pop(found[1]))} {mark}{comment}"
        lines.append(line)
    return "\n".join([*lines, *(f"{value_text(value)} ! {name}" for name, value in left.items())]) + "\n"


def quiet_input(source: Path) -> str:
    """Text of an input file without logging and echo, and with absolute paths of the files that it names."""
    file = TextFile(source, titles=0)
    for key in ("LoggingLevel", "Echo"):
        if key in file:
            file.lines[file.line_of(key)] = f"0 ! {key}"
    for key in ("PerfFileName", "OL_Filename"):
        path = source.parent / file.text(key).replace("\\", "/") if key in file else source.parent
        if path.is_file():
            file.lines[file.line_of(key)] = f'"{path.resolve()}" ! {key}'
    return "\n".join(file.lines) + "\n"
