"""Simulate a turbine under the baseline controller and print its operating points.

    wt-gym simulate --wind-speed 8 15
    wt-gym simulate --turbine iea_15mw --wind-speed 9 --fidelity engineering --out runs/iea.nc
    wt-gym simulate --turbulent --wind-seeds 3 --wind-speed 12 --duration 600 --out runs/turbulent.nc
    wt-gym simulate --wind-speed 12 --loads sections --out runs/steady.nc --format outb
    wt-gym simulate --turbine oc4_nrel_5mw --turbulent --wind-speed 12 --wave-height 3 --wave-period 9
    wt-gym simulate --wind gust.csv site.bts --site air_density=1.1 --duration 120

The means are taken over the last part of each run; for a turbine with a shaft tilt they are means over whole turns only
approximately. A file (.nc, .csv) holds every signal of the run, .outb those that OpenFAST has; one file a wind speed.
Each is written when its run ends, and when it is ended by Ctrl-C or SIGTERM, with what there is.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from wt_gym.base.files import require_writable
from wt_gym.base.options import LONGEST, Options, option, option_record, options_of
from wt_gym.base.options import add_options as add_record
from wt_gym.commands.options import add_shared, turbine_of, with_record
from wt_gym.commands.program import file_ending_in

if TYPE_CHECKING:
    import xarray as xr

    from wt_gym.hydrodynamics.waves import WaveComponents
    from wt_gym.simulation import Recorder
    from wt_gym.simulation.channels import Signals
    from wt_gym.simulation.contract import DrivenSimulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow, SteadyInflow

STOPPED = "what was simulated is written where --out was given"


@option_record
class SimulationOptions(Options):
    """Winds and length of the runs."""

    title = "simulation"

    wind_speed: tuple[float, ...] = option(
        "mean wind speeds at the hub", default=(8.0, 15.0), unit="m/s", low=0.0, high=50.0
    )
    duration: float = option("length of a run", default=300.0, unit="s", low=1.0, high=LONGEST)
    average: float | None = option(
        "last part averaged, at most the duration", default=None, unit="s", low=0.0, above=True,
        otherwise="60, or a shorter duration",
    )  # fmt: skip
    shear: float = option("power-law exponent", default=0.0)
    yaw_misalignment: float = option("of the wind", default=0.0, unit="deg")
    turbulent: bool = option("Kaimal turbulence of the turbine's class", default=False)
    wind_seeds: int = option("turbulence seed", default=1, low=0, high=2**63 - 1)
    scaling: str = option("of the turbulence", default="low_frequency", choices=("low_frequency", "uniform", "none"))
    loads: str = option(
        "loads beside the signals: in joints (tower top, hub, blade roots, tower base), or of nine sections of each "
        "blade and the tower too", default="none", choices=("none", "joints", "sections"),
    )  # fmt: skip

    wave_height: float = option(
        "significant height of JONSWAP waves, for a turbine that floats", default=0.0, unit="m", low=0.0, high=30.0
    )
    wave_period: float = option("their peak period", default=10.0, unit="s", low=1.0, high=60.0)
    wave_direction: float = option(
        "towards which they travel, counter-clockwise from downwind", default=0.0, unit="deg", low=-180.0, high=180.0
    )
    wave_seed: int = option("of their phases", default=1, low=0, high=2**63 - 1)

    def check(self) -> None:
        """Average over short runs as a whole; refuse a longer average."""
        average = min(60.0, self.duration) if self.average is None else self.average
        if average > self.duration:
            raise ValueError(f"average must be at most the duration of {self.duration:g} s, got {average:g}")
        self._set("average", average)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_shared(parser, "turbine", "site", "simulator", "fidelity")
    winds = parser.add_mutually_exclusive_group()
    add_record(winds, SimulationOptions, "wind_speed")
    add_shared(winds, "wind")
    add_record(parser, SimulationOptions, *(one.name for one in options_of(SimulationOptions)[1:]))
    parser.add_argument(
        "--out", type=file_ending_in(".nc", ".outb", ".csv"), metavar="FILE",
        help="signals as NetCDF (.nc), OpenFAST's binary outputs (.outb) or text (.csv); the wind speed is added to "
        "its name for several speeds",
    )  # fmt: skip
    parser.add_argument(
        "--format", nargs="+", default=[], choices=("nc", "outb", "csv"), metavar="FORMAT",
        help="further files beside that of --out: nc, outb, csv",
    )  # fmt: skip
    add_shared(parser, "json")


COLUMNS = (
    ("wind_m_s", "wind", "m/s", 6, 2),
    ("rotor_speed_rpm", "rotor", "rpm", 7, 2),
    ("pitch_deg", "pitch", "deg", 6, 2),
    ("generator_power_kw", "power", "kW", 8, 1),
    ("aero_thrust_kn", "thrust", "kN", 7, 1),
    ("tip_out_of_plane_m", "tip", "m", 6, 2),
    ("tip_in_plane_m", "in plane", "m", 9, 2),
    ("tower_top_fore_aft_m", "tower fa", "m", 9, 3),
    ("tower_top_side_side_m", "tower ss", "m", 9, 3),
    ("root_flap_moment_kn_m", "flap", "kN m", 8, 0),
    ("tower_base_fore_aft_moment_kn_m", "base fa", "kN m", 9, 0),
)


def check_numbers(arguments: argparse.Namespace) -> None:
    """Refuse winds without meaning, and a place that cannot be written to, before anything is simulated."""
    from wt_gym.envs.operation import simulator_maker
    from wt_gym.envs.wind_sampler import SLOWEST_TURBULENCE
    from wt_gym.simulation.fidelity import fidelity

    with_record(arguments, SimulationOptions)
    if arguments.turbulent and min(arguments.wind_speed) < SLOWEST_TURBULENCE:
        slowest = min(arguments.wind_speed)
        raise ValueError(f"--wind-speed must be from {SLOWEST_TURBULENCE:g} m/s with --turbulent, got {slowest:g}")
    if arguments.wind and (arguments.turbulent or arguments.shear or arguments.yaw_misalignment):
        raise ValueError("--wind has its own turbulence, shear and direction: leave those options out")
    if arguments.fidelity is not None:
        fidelity(arguments.fidelity)
    simulator_maker(arguments.simulator, arguments.turbine, pictured=False)
    names = Counter(_label(wind) for wind in _winds(arguments))
    if arguments.out and len(names) < names.total():
        raise ValueError(f"the wind {names.most_common(1)[0][0]} comes twice, and would be written to one file")
    if arguments.format and not arguments.out:
        raise ValueError(f"--format must come with --out FILE, got {' '.join(arguments.format)} without")
    if arguments.out:
        require_writable(arguments.out.parent)


def _winds(arguments: argparse.Namespace) -> list[Any]:
    """Winds of the options: speeds [m/s], or descriptions."""
    out: list[Any] = arguments.wind or arguments.wind_speed
    return out


def _label(wind: float | str | dict[str, Any]) -> str:
    """Short name of a wind, for a file."""
    if isinstance(wind, float):
        return f"{wind:g}"
    if isinstance(wind, str):
        return Path(wind).stem
    named = wind.get("file", wind.get("kind", "wind"))
    return Path(named if isinstance(named, str) else str(named[0])).stem


def files_of(arguments: argparse.Namespace, wind: float | str | dict[str, Any]) -> list[Path]:
    """Where the signals of a wind go, each file in its format."""
    if not (out := arguments.out):
        return []
    out = out.with_stem(f"{out.stem}_{_label(wind)}") if len(_winds(arguments)) > 1 else out
    return list(dict.fromkeys([out, *(out.with_suffix(f".{ending}") for ending in arguments.format)]))


def steady_of(arguments: argparse.Namespace, turbine: Turbine, speed: float) -> SteadyInflow:
    """Mean wind of the options; refuses what has no meaning."""
    from wt_gym.wind import SteadyInflow

    yaw = math.radians(arguments.yaw_misalignment)
    return SteadyInflow(speed, hub_height=turbine.hub_height, shear_exponent=arguments.shear, yaw_misalignment=yaw)


def inflow_of(arguments: argparse.Namespace, turbine: Turbine, speed: float | str | dict[str, Any]) -> Inflow:
    """Wind of the options: of a speed [m/s], or of a description."""
    from wt_gym.wind import TurbulenceBox, TurbulentInflow, wind_from
    from wt_gym.wind.inflow import require_cover

    if not isinstance(speed, float):
        inflow = wind_from(speed, turbine.hub_height, turbine.rotor_diameter)
        require_cover(inflow, turbine.hub_height, turbine.rotor_diameter)
        return inflow
    steady = steady_of(arguments, turbine, speed)
    if not arguments.turbulent:
        return steady
    box = TurbulenceBox.kaimal(
        speed, turbine.hub_height, turbine.rotor_diameter, turbine.turbulence_class, seed=arguments.wind_seeds,
        scaling=arguments.scaling,
    )  # fmt: skip
    return TurbulentInflow(box, steady)


def sea_of(arguments: argparse.Namespace, turbine: Turbine) -> WaveComponents | None:
    """Waves of the options; None where there are none.

    Raises
    ------
    ValueError
        If the turbine does not float, or waves without height have something of their own.
    """
    import numpy as np

    from wt_gym.hydrodynamics.waves import SeaState

    if arguments.wave_height == 0.0:
        for one in options_of(SimulationOptions):
            if one.name.startswith("wave_") and getattr(arguments, one.name) != one.default:
                raise ValueError(f"--{one.name.replace('_', '-')} must have waves: --wave-height above 0 m")
        return None
    if turbine.floater is None:
        raise ValueError(f"--wave-height must be left out: {turbine.name!r} does not float")
    direction = math.radians(arguments.wave_direction)
    sea = SeaState(
        "jonswap", arguments.wave_height, arguments.wave_period, direction=direction,
        duration=max(arguments.duration, 600.0),
    )  # fmt: skip
    return sea.components(np.random.default_rng(arguments.wave_seed), turbine.floater.water_depth)


def means(data: xr.Dataset, n_blades: int, speed: float, average: float) -> dict[str, float]:
    """Row of the table: means over the last part of a run, those of blades over all of them."""
    last = data.sel(time=slice(float(data.time[-1]) - average, None))

    def blades(name: str) -> float:
        return sum(float(last[f"{name}_{i + 1}"].mean()) for i in range(n_blades)) / n_blades

    return {
        "wind_m_s": speed,
        "rotor_speed_rpm": float(last.rotor_speed.mean()) * 30.0 / math.pi,
        "pitch_deg": math.degrees(blades("pitch")),
        "generator_power_kw": float(last.generator_power.mean()) / 1e3,
        "aero_thrust_kn": float(last.aero_thrust.mean()) / 1e3,
        "tip_out_of_plane_m": blades("tip_out_of_plane"),
        "tip_in_plane_m": blades("tip_in_plane"),
        "tower_top_fore_aft_m": float(last.tower_top_fore_aft.mean()),
        "tower_top_side_side_m": float(last.tower_top_side_side.mean()),
        "root_flap_moment_kn_m": blades("root_flap_moment") / 1e3,
        "tower_base_fore_aft_moment_kn_m": float(last.tower_base_fore_aft_moment.mean()) / 1e3,
    }


def simulate(arguments: argparse.Namespace, turbine: Turbine, speed: float | str | dict[str, Any]) -> Recorder:
    """Run one wind; what was simulated is written where a file is given, of a stopped run too."""
    from wt_gym.envs.operation import simulator_maker
    from wt_gym.experiment.execute import ProgressLine
    from wt_gym.experiment.run import run_baseline
    from wt_gym.simulation import Recorder

    make = simulator_maker(arguments.simulator, arguments.turbine, pictured=False, longest=lambda: arguments.duration)
    simulator = make(turbine, inflow_of(arguments, turbine, speed), arguments.fidelity)
    if (sea := sea_of(arguments, turbine)) is not None:
        cast("DrivenSimulator", simulator).sea = sea
    recorder = Recorder(simulator, arguments.loads)

    line = ProgressLine()

    def progress(signals: Signals) -> None:
        line.show(f"{_label(speed)}: {signals.time:5.0f} of {arguments.duration:g} s")

    try:
        return run_baseline(simulator, arguments.duration, on_step=progress, recorder=recorder)
    finally:
        for path in files_of(arguments, speed) if len(recorder) else []:
            recorder.save(path)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulate each wind speed and print the table."""
    check_numbers(arguments)
    from wt_gym.analysis.metrics import idle_sentence, idle_time

    turbine = turbine_of(arguments)
    sea_of(arguments, turbine)  # refused before anything is simulated
    means_of = {}
    for number, wind in enumerate(_winds(arguments)):  # all before the first is simulated
        if isinstance(wind, float):
            steady_of(arguments, turbine, wind)
            means_of[number] = wind
        else:
            means_of[number] = inflow_of(arguments, turbine, wind).mean_speed
    rows = []
    print(f"{turbine.heading}, {arguments.fidelity} fidelity, {arguments.duration:g} s under the baseline controller")
    print("  ".join(f"{title:>{width}}" for _, title, _, width, _ in COLUMNS) + "   x real time")
    print("  ".join(f"{unit:>{width}}" for _, _, unit, width, _ in COLUMNS))
    for number, speed in enumerate(_winds(arguments)):
        start = time.perf_counter()
        recorder = simulate(arguments, turbine, speed)
        wall = time.perf_counter() - start
        data = recorder.to_dataset()
        rows.append(means(data, turbine.n_blades, means_of[number], arguments.average))
        line = "  ".join(f"{rows[-1][key]:{width}.{digits}f}" for key, _, _, width, digits in COLUMNS)
        print(("\r" if sys.stderr.isatty() else "") + line + f"   {arguments.duration / wall:.0f}", flush=True)
        wind = f"{speed:g} m/s" if isinstance(speed, float) else _label(speed)
        if sentence := idle_sentence("The baseline controller", [(wind, idle_time(data))]):
            print(sentence, flush=True)
        for path in files_of(arguments, speed):
            print(f"signals: {path}", flush=True)
    return {"turbine": turbine.heading, "fidelity": arguments.fidelity, "points": rows}
