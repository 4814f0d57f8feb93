"""Designs of linear optimal pitch as files: plain arrays and the record of their making, no pickled objects."""

from __future__ import annotations

import json
import math
import zipfile
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import ControllerError
from wt_gym.base.files import whole_file
from wt_gym.control.controllers.fading import FadeParameters
from wt_gym.control.optimal.measured import OUTPUTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["FORMAT", "LinearDesign", "load_design", "offset_fade", "save_design"]

FORMAT = 2
"""Version of the files; version 1 has no ``fine_speed``."""

_ARRAYS = ("pitch", "responses", "gains", "scale", "washout")
_NUMBERS = ("interval", "limit", "rate_limit", "fade")


def offset_fade(fade: float, fine_speed: tuple[float, float] | None) -> FadeParameters:
    """Fade of offsets: in full from a collective pitch above fine pitch on [rad], and at fine pitch by rotor speed."""
    return FadeParameters(pitch=(fade / 6.0, fade), fine_speed=fine_speed)


@dataclass(frozen=True, eq=False)
class LinearDesign:
    """Models and feedbacks at several wind speeds, between which the pitch of the blades chooses.

    With the outputs y over their scale (`OUTPUTS` of `wt_gym.control.optimal.measured`) and the offsets u that reached
    the drives (mean, tilt, yaw), sampled at the interval,

        d_k = y_k - sum_l responses[l] u_(k-1-l),    u_k = sum_l gains[l] f_(k-l),

    f being d without what lasts longer than the washout.

    Attributes
    ----------
    pitch : numpy.ndarray, shape (n,)
        Mean pitch of the blades at which each design holds, rising [rad].
    responses : numpy.ndarray, shape (n, 6, 3, n_taps)
        Of outputs over their scale to offsets [1/rad].
    gains : numpy.ndarray, shape (n, 3, 6, n_delays)
        From disturbances to offsets [rad].
    scale : numpy.ndarray, shape (6,)
        Of the outputs.
    washout : numpy.ndarray, shape (6,)
        Time constant of what lasts in each output [s]; 0: everything counts.
    interval : float
        Between two decisions [s].
    limit, rate_limit : float
        Of the offsets [rad], [rad/s].
    fade : float
        Collective pitch above fine pitch from which on all acts in full [rad], see `AboveRated.of_turbine`.
    fine_speed : (float, float), optional
        Rotor speed over the rated one at which offsets begin and act in full at fine pitch [-]; by default they do not
        act there.
    record : dict
        How it was made: turbine, base controller, winds, options, what the models explain; JSON values.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If shapes do not fit, or a number is out of range.
    """

    pitch: NDArray[np.float64]
    responses: NDArray[np.float64]
    gains: NDArray[np.float64]
    scale: NDArray[np.float64]
    washout: NDArray[np.float64]
    interval: float
    limit: float
    rate_limit: float
    fade: float
    record: dict[str, Any] = field(default_factory=dict)
    fine_speed: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.isfinite(array).all():
                raise ControllerError(f"{name} of a linear design must be finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        n, m = self.pitch.size, len(OUTPUTS)
        wanted = {"pitch": (n,), "responses": (n, m, 3, -1), "gains": (n, 3, m, -1), "scale": (m,), "washout": (m,)}
        for name, shape in wanted.items():
            given = getattr(self, name).shape
            fits = len(given) == len(shape) and all(w in (g, -1) and g > 0 for g, w in zip(given, shape, strict=True))
            if not fits:
                shown = ", ".join("any" if w == -1 else str(w) for w in shape)
                raise ControllerError(f"{name} of a linear design must have shape ({shown}), got {given}")
        if not (np.diff(self.pitch) > 0.0).all():
            raise ControllerError(f"pitch of a linear design must rise, got {self.pitch.tolist()}")
        if not ((self.scale > 0.0).all() and (self.washout >= 0.0).all()):
            raise ControllerError("scales of a linear design must be positive, washouts not negative")
        for name in _NUMBERS:
            if not 0.0 < getattr(self, name) < math.inf:
                raise ControllerError(
                    f"{name} of a linear design must be finite and positive, got {getattr(self, name)!r}"
                )

        if self.fine_speed is not None:
            low, high = self.fine_speed
            if not 0.0 < low < high < math.inf:
                raise ControllerError(
                    f"fine_speed of a linear design must be two rising positive numbers, got {self.fine_speed!r}"
                )

    @property
    def fading(self) -> FadeParameters:
        """How far offsets act."""
        return offset_fade(self.fade, self.fine_speed)

    def __deepcopy__(self, memo: dict[int, Any]) -> LinearDesign:
        return self  # nothing in it changes

    @property
    def turbine(self) -> str:
        """Name of the turbine that it was made for, "" where the record has none."""
        return str(self.record.get("turbine", ""))


def save_design(design: LinearDesign, path: str | Path) -> None:
    """Write a design, in single precision.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    head = {"format": FORMAT, **{name: getattr(design, name) for name in _NUMBERS}, "record": design.record}
    head["fine_speed"] = None if design.fine_speed is None else list(design.fine_speed)
    arrays = {name: getattr(design, name).astype(np.float32) for name in _ARRAYS}
    with whole_file(Path(path)) as partial, partial.open("wb") as file:
        np.savez_compressed(file, head=np.array(json.dumps(head, allow_nan=False)), **arrays)


def load_design(path: str | Path) -> LinearDesign:
    """Read a design.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    wt_gym.base.errors.ControllerError
        If it is none, or of a version that is not known.
    """
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"there is no design at {file}; wt-gym design linear_optimal makes one")
    status = file.stat()
    return _load(file.resolve(), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _load(file: Path, changed: int, size: int) -> LinearDesign:
    try:
        with np.load(file, allow_pickle=False) as found:
            head = json.loads(str(found["head"][()]))
            parts: dict[str, Any] = {name: found[name] for name in _ARRAYS}
        if head["format"] != FORMAT:
            raise ControllerError(f"{file} must have format {FORMAT}, got {head['format']!r}")
        parts |= {name: float(head[name]) for name in _NUMBERS}
        fine_speed = head["fine_speed"]
        parts["fine_speed"] = None if fine_speed is None else (float(fine_speed[0]), float(fine_speed[1]))
        return LinearDesign(**parts, record=head["record"])
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, ControllerError):
            raise
        raise ControllerError(f"{file} must be a design of wt-gym design linear_optimal: {error}") from error
