"""Records of the turbines of the catalog, from which episodes in turbulence start: files of the package.

A file holds a turbine under its default controller at wind speeds from cut-in to cut-out. Each column at a wind speed
is stored in 16 bits, between its least and its largest value. ``wt-gym record`` makes the files. The start of an
episode depends on them alone, on every machine. Their ``probe``, the signals of a short run, tells a test that
the program moves the turbine in another way than the one that recorded it. Turbines of the user have such files in
their cache.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.envs.running_record import ControllerForm, Record
from wt_gym.files import write_whole
from wt_gym.user_cache import user_cache

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine

__all__ = ["FOLDER", "StartFile", "dimensions", "find_record", "recorded_speeds", "user_folder"]

FOLDER = Path(__file__).parent / "starts"
"""Folder of the records."""
BIN = 2.0
"""Distance of the recorded wind speeds [m/s]."""
_LAST_CODE = 65_535
_SAME = 1e-3
"""Relative difference of dimensions up to which a turbine is the recorded one: a site changes nothing of them."""


@dataclass(frozen=True)
class StartFile:
    """A record as it is stored.

    Attributes
    ----------
    turbine : str
        Name.
    dimensions : tuple of float
        See `dimensions`.
    fidelity : str
    controller : str
        Name.
    level : float
        Demanded power over the available one [-].
    kind : str
        See `wt_gym.envs.running_record.ControllerForm`.
    n_motion : int
        Numbers of the motion of the structure.
    """

    turbine: str
    dimensions: tuple[float, ...]
    fidelity: str
    controller: str
    level: float
    kind: str
    n_motion: int

    @classmethod
    def of(cls, path: Path) -> StartFile:
        """Head of a file."""
        with np.load(path, allow_pickle=False) as file:
            head = json.loads(str(file["head"]))
        return cls(**head | {"dimensions": tuple(head["dimensions"])})

    def fits(self, turbine: Turbine) -> bool:
        """Whether it is a record of a turbine."""
        return self.turbine == turbine.name and np.allclose(self.dimensions, dimensions(turbine), rtol=_SAME)

    def write(
        self, path: Path, speeds: NDArray[np.float64], rows: NDArray[np.float64], form: ControllerForm,
        probe: NDArray[np.float64],
    ) -> None:  # fmt: skip
        """Write the file of a record; the parameters are those of `Record`."""
        codes, low, unit = _packed(rows)
        arrays: dict[str, Any] = {
            "head": json.dumps(asdict(self)), "speeds": speeds, "codes": codes, "low": low, "unit": unit,
            "values": form.values, "sizes": form.sizes, "changing": form.changing, "probe": probe,
        }  # fmt: skip
        write_whole(path, lambda file: np.savez_compressed(file, **arrays))

    def read(self, path: Path) -> Record:
        """Read the record."""
        with np.load(path, allow_pickle=False) as file:
            form = ControllerForm(self.kind, file["values"], file["sizes"], file["changing"])
            rows = file["low"][:, None] + file["unit"][:, None] * file["codes"].transpose(0, 2, 1)
            return Record(abs(int(self.dimensions[0])), self.n_motion, file["speeds"], rows, form)


def dimensions(turbine: Turbine) -> tuple[float, ...]:
    """Dimensions that tell a turbine from others of its name: blades, diameter and hub height [m], rated power [W].

    The sense of rotation is their sign.
    """
    sense = -1.0 if turbine.rotation == "counter-clockwise" else 1.0
    return (
        sense * turbine.n_blades, turbine.rotor_diameter, turbine.hub_height, turbine.drivetrain.rated_power,
    )  # fmt: skip


def recorded_speeds(turbine: Turbine) -> NDArray[np.float64]:
    """Wind speeds at which a turbine is recorded: cut-in, cut-out, and every `BIN` between them [m/s]."""
    low, high = turbine.cut_in, turbine.cut_out
    between = BIN * np.arange(math.floor(low / BIN) + 1, math.ceil(high / BIN))
    return np.array([low, *between.tolist(), high])


def find_record(turbine: Turbine, level: float) -> tuple[StartFile, Record] | None:
    """Record of a turbine, in the package or of the user; None where there is none.

    Parameters
    ----------
    turbine : Turbine
    level : float
        Demanded power over the available one [-]; the record with the nearest level is taken.
    """
    fitting = [path for path, file in _heads().items() if file.fits(turbine)]
    if not fitting:
        return None
    path = min(fitting, key=lambda one: abs(_heads()[one].level - level))
    return _heads()[path], _read(path)


@lru_cache(maxsize=1)
def _heads() -> dict[Path, StartFile]:
    """Files of the package, and of the user."""
    folders = [FOLDER] + ([] if (own := user_folder()) is None else [own])
    return {path: StartFile.of(path) for folder in folders for path in sorted(folder.glob("*.npz"))}


def user_folder() -> Path | None:
    """Folder of the records of the user; None where there is no cache of the user."""
    cache = user_cache()
    return None if cache is None else cache / "running"


@lru_cache(maxsize=4)
def _read(path: Path) -> Record:
    return _heads()[path].read(path)


def _packed(rows: NDArray[np.float64]) -> tuple[NDArray[np.uint16], NDArray[np.float64], NDArray[np.float64]]:
    """Codes (n_speeds, n_columns, n_instants), and least value and unit of the columns (n_speeds, n_columns)."""
    if not np.isfinite(rows).all():
        raise ValueError("a record must be of finite numbers")
    low, high = rows.min(axis=1), rows.max(axis=1)
    whole = (rows == np.round(rows)).all(axis=1) & (high - low <= _LAST_CODE)
    unit = np.where(whole, 1.0, (high - low) / _LAST_CODE)
    codes = np.round((rows - low[:, None]) / np.where(unit > 0.0, unit, 1.0)[:, None])
    return codes.transpose(0, 2, 1).astype(np.uint16), low, unit
