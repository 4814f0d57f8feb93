"""Recording of signals into a labeled data set, and files of it: NetCDF, OpenFAST's binary outputs, text."""

from __future__ import annotations

import csv
import io
import math
import struct
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.base.files import write_netcdf_whole, write_text_whole, write_whole
from wt_gym.base.quantities import Array
from wt_gym.simulation.channels import Signals, channel_table
from wt_gym.simulation.contract import TurbineSimulator

if TYPE_CHECKING:
    import xarray as xr
    from xarray import Dataset

    from wt_gym.simulation.component_loads import ComponentLoads

Variable = tuple[str | tuple[str, ...], Array, dict[str, str]]
"""Names of the axes, values and attributes."""


ENDINGS = (".nc", ".outb", ".csv")
"""Endings of file names, each with its format."""
_OPENFAST_UNITS = {
    "s": (1.0, "s"), "m": (1.0, "m"), "m/s": (1.0, "m/s"), "rad": (180.0 / math.pi, "deg"),
    "rad/s": (30.0 / math.pi, "rpm"), "N": (1e-3, "kN"), "N m": (1e-3, "kN-m"), "W": (1e-3, "kW"),
    "m/s^2": (1.0, "m/s^2"), "rad/s^2": (180.0 / math.pi, "deg/s^2"),
}  # fmt: skip
"""Factor and unit of ElastoDyn's and ServoDyn's outputs by the SI unit."""
_OTHER_UNITS = {
    "YawVzn": (180.0 / math.pi, "deg/s"), "RtAeroPwr": (1.0, "W"), "RtAeroMxh": (1.0, "N-m"), "RtAeroFxh": (1.0, "N"),
    **dict.fromkeys(("PtfmRVxi", "PtfmRVyi", "PtfmRVzi"), (180.0 / math.pi, "deg/s")),
    **dict.fromkeys(("FairTen", "AnchTen"), (1.0, "N")),
}  # fmt: skip
"""Factor and unit of outputs in other units, without their number: rates of angles, those of AeroDyn and MoorDyn."""


def openfast_unit(name: str, unit: str) -> tuple[float, str]:
    """Factor from an SI unit to that of an output of OpenFAST, and that unit."""
    return _OTHER_UNITS.get(name.rstrip("0123456789")) or _OPENFAST_UNITS[unit]


_FORMAT, _NAME_LENGTH = 4, 20
"""OpenFAST's ``FileFmtID_ChanLen_In``: 16-bit numbers at even times, with the length of names before all else."""
_COUNTS, _DIGITS = 65_000.0, 2.0**23


def write_recording(path: Path, data: xr.Dataset) -> None:
    """Write signals in the format of the file's ending; the file is there when it is whole.

    ``.nc`` is NetCDF 4 with everything. ``.csv`` has a column a signal in SI units, with name and unit in its first
    line. ``.outb`` has the signals that OpenFAST has, under its names and in its units, as its post-processing reads
    them; the numbers have 16 bits, so that a signal is resolved to 1/65000 of its range.

    Parameters
    ----------
    data : xarray.Dataset
        Of `wt_gym.simulation.Recorder.to_dataset`.

    Raises
    ------
    ValueError
        If there is no such format.
    """
    match path.suffix.lower():
        case ".nc":
            write_netcdf_whole(path, data)
        case ".csv":
            write_text_whole(path, _csv(data))
        case ".outb":
            content = _outb(data)
            write_whole(path, lambda file: file.write(content))
        case _:
            raise ValueError(f"a file of signals must end in {', '.join(ENDINGS)}, got {path.name}")


def _columns(data: xr.Dataset) -> Iterator[tuple[str, str, Array]]:
    """Name, unit and values of each signal; those with further axes have a column for each place on them."""
    yield "time", "s", data["time"].values
    for name, variable in data.data_vars.items():
        if variable.ndim == 1:
            yield str(name), variable.attrs["units"], variable.values
            continue
        for place in np.ndindex(variable.shape[1:]):
            labels = [str(data[axis].values[k]) for axis, k in zip(variable.dims[1:], place, strict=True)]
            yield "_".join([str(name), *labels]), variable.attrs["units"], variable.values[(slice(None), *place)]


def _csv(data: xr.Dataset) -> str:
    columns = list(_columns(data))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{unit}]" for name, unit, _ in columns])
    writer.writerows(np.column_stack([values for *_, values in columns]).tolist())
    return text.getvalue()


def _outb(data: xr.Dataset) -> bytes:
    """Binary outputs as `WrBinFAST` of OpenFAST's `FAST_Subs.f90` writes them.

    Values are packed as integers ``scale x + offset`` with ``scale`` and ``offset`` in single precision. The scale is
    bounded so that the offset of a nearly constant signal is rounded by less than a count.
    """
    names, units, table = ["Time"], ["(s)"], []
    for variable in data.data_vars.values():
        if name := variable.attrs.get("openfast_name"):
            factor, unit = openfast_unit(name, variable.attrs["units"])
            names.append(name)
            units.append(f"({unit})")
            table.append(factor * variable.values)
    values = np.array(table)
    low, high = values.min(axis=1), values.max(axis=1)
    span, size = high - low, np.maximum(np.abs(low), np.abs(high))
    least = np.maximum(span / _COUNTS, size / _DIGITS)
    scale = np.divide(1.0, least, out=np.ones_like(least), where=least > 0.0).astype(np.float32)
    offset = (-scale * 0.5 * (low + high)).astype(np.float32)
    packed = np.rint(scale[:, None].astype(float) * values + offset[:, None].astype(float)).astype(np.int16)
    time = data["time"].values
    step = float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else 0.0
    where = ", ".join(data.attrs[name] for name in ("turbine", "inflow", "sea") if name in data.attrs)
    described = f"wt_gym: {where}".encode("ascii", "replace")
    head = struct.pack("<hhiidd", _FORMAT, _NAME_LENGTH, len(table), time.size, float(time[0]), step)
    texts = "".join(text.ljust(_NAME_LENGTH) for text in (*names, *units)).encode("ascii")
    scales = scale.astype("<f4").tobytes() + offset.astype("<f4").tobytes()
    length = struct.pack("<i", len(described))
    return b"".join([head, scales, length, described, texts, packed.T.astype("<i2").tobytes()])


class Recorder:
    """Collects signals and turns them into an xarray data set with units.

    Where constraint equations hold the blades (``formulation="constrained"``) their Lagrange multipliers are recorded
    beside the channels.

    Parameters
    ----------
    simulator : Simulator
        Gives the channels, the attributes of the data set, and the multipliers if it has any.
    loads : {"none", "joints", "sections"}
        Loads beside the channels, of a `Simulator` alone, see `wt_gym.simulation.component_loads`.
    **attributes
        Further attributes of the data set (numbers and strings).

    Examples
    --------
    >>> recorder = Recorder(sim)                         # doctest: +SKIP
    >>> recorder.append(sim.advance(0.2, **commands))    # doctest: +SKIP
    >>> recorder.to_dataset().to_netcdf("run.nc", engine="h5netcdf")  # doctest: +SKIP
    """

    def __init__(self, simulator: TurbineSimulator, loads: str = "none", **attributes: float | str) -> None:
        self.channels = channel_table(simulator.turbine.n_blades, simulator.turbine.n_lines)
        self._loads: ComponentLoads | None = None
        if loads != "none":
            from wt_gym.simulation.component_loads import ComponentLoads  # only needed here

            self._loads = ComponentLoads(cast(Any, simulator), loads)
            self.channels += self._loads.channels
        self.attributes = {
            "turbine": simulator.turbine.name,
            "rotation": simulator.turbine.rotation,
            "inflow": simulator.inflow.description,
            **({} if (sea := getattr(simulator, "sea", None)) is None else {"sea": sea.description}),
            "fidelity": simulator.fidelity.name,
            "aerodynamic_time_step_s": simulator.time_step,
            **attributes,
        }
        self._rows: list[Array] = []
        # only a simulator that has multipliers is asked at each instant, and kept alive
        constrained = simulator.fidelity.formulation == "constrained"
        self._held = simulator if constrained else None
        self._multipliers: list[Array] = []

    def __len__(self) -> int:
        return len(self._rows)

    def append(self, signals: Signals) -> None:
        """Store one instant.

        Parameters
        ----------
        signals : Signals
            Loads and multipliers belong to signals of the simulator's current instant; to others not a number is
            stored.
        """
        row = signals.values.copy()
        if (loads := self._loads) is not None:
            row = np.append(row, _at_instant(loads.simulator, signals, loads.read, len(loads.channels)))
        self._rows.append(row)
        if (held := self._held) is not None:
            read = cast(Any, held).root_multipliers
            self._multipliers.append(_at_instant(held, signals, read, (held.turbine.n_blades, 6)))

    def to_dataset(self) -> Dataset:
        """Data set with one variable a channel over ``time``; units, description and OpenFAST name as attributes.

        Returns
        -------
        xarray.Dataset
            With constraint equations also ``root_multiplier_force`` [N] and ``root_multiplier_moment`` [N m] over
            ``time``, ``blade`` (from 1) and ``component`` (x, y, z), see `Simulator.root_multipliers`.
        """
        import xarray as xr  # heavy, and only needed here

        table = np.array(self._rows).reshape(-1, len(self.channels))
        time = table[:, 0]
        variables: dict[str, Variable] = {}
        for k, channel in enumerate(self.channels[1:], start=1):
            attributes = {"units": channel.unit, "long_name": channel.description, "openfast_name": channel.openfast}
            variables[channel.name] = ("time", table[:, k], attributes)
        coordinates: dict[str, object] = {"time": ("time", time, {"units": "s"})}
        if self._held is not None:
            n_blades = self._held.turbine.n_blades
            variables |= _multiplier_variables(np.reshape(self._multipliers, (-1, n_blades, 6)))
            coordinates |= {"blade": np.arange(1, n_blades + 1), "component": list("xyz")}
        return xr.Dataset(variables, coordinates, self.attributes)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the signals; the ending of the file names the format, see `write_recording`.

        Raises
        ------
        ValueError
            If the file ends in none of ``.nc``, ``.outb`` and ``.csv``.
        """
        write_recording(Path(path), self.to_dataset())


def _at_instant(
    simulator: TurbineSimulator, signals: Signals, read: Callable[[], Array], shape: int | tuple[int, ...]
) -> Array:
    """Result of ``read``, of the instant of the signals; not a number where the simulator is not there.

    After a failed step the signals at hand are those of the step before, and the state has no meaning.
    """
    if signals.values[0] == simulator.time:
        try:
            return read()
        except SimulationError:
            pass
    return np.full(shape, np.nan)


def _multiplier_variables(multipliers: Array) -> dict[str, Variable]:
    """Variables of a data set from multipliers (n, n_blades, 6)."""
    text = "{} of the hub on the blade at its root (Lagrange multipliers), axes of the pitched root"
    parts = (("force", "N", "Force", multipliers[..., :3]), ("moment", "N m", "Moment", multipliers[..., 3:]))
    return {
        f"root_multiplier_{name}": (
            ("time", "blade", "component"),
            values,
            {"units": unit, "long_name": text.format(what)},
        )
        for name, unit, what, values in parts
    }
