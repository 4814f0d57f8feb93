"""Runs of a base controller with and without drawn offsets of the pitch, and impulse responses from them."""

import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import fftconvolve

from wt_gym.analysis.results import Wind
from wt_gym.base.canary import differing
from wt_gym.base.files import whole_file
from wt_gym.control.actions import Demand
from wt_gym.control.controllers import make_controller
from wt_gym.control.controllers.controller import Combined, Readings, parts_of
from wt_gym.control.controllers.linear_optimal import (
    FLOATING_OUTPUTS,
    OUTPUTS,
    PitchOffsets,
    in_nacelle_axes,
    recorded_outputs,
    side_sign,
)
from wt_gym.envs.sea import sea_of_wind
from wt_gym.experiment.comparison import inflow_of
from wt_gym.experiment.run import run_controller
from wt_gym.experiment.store import run_digest
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.learning.options import Excitation
from wt_gym.simulation import Simulator
from wt_gym.turbines import Turbine

_R = TypeVar("_R")
MISALIGNMENT, LONGEST_SEA = math.radians(30.0), 1200.0
"""Largest angle between wind and waves of a recording [rad], and time within which its waves do not repeat [s]."""
LOADS = ("tower_fore_aft", "tower_side_side", "power")
"""Loads that a controller does not read [N m], and the power of the generator [W]."""
FLOATING_LOADS = (*LOADS, "platform_pitch")
"""Those of a floating turbine, with the pitch of the platform about the axis across the nacelle [rad]."""


class DrawnOffsets:
    """Addition that plays levels (3, n) of offsets [rad], then none, and stores what reached the drives."""

    channels = ("azimuth", "rotor_speed")

    def __init__(self, offsets: PitchOffsets, levels: NDArray[np.float64]) -> None:
        self.offsets, self.levels = offsets, levels
        self.acting: list[tuple[float, float, float]] = []
        self.share: list[float] = []

    def start(self, signals: Readings) -> None:
        """Begin with the first level."""
        self.offsets.start()
        self.acting, self.share = [], []

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the offsets of this step."""
        k = len(self.acting)
        share = self.offsets.update_share(demand, signals["rotor_speed"], dt)
        level = self.levels[:, k] if k < self.levels.shape[1] else np.zeros(3)
        changed = self.offsets.added((share * level).tolist(), demand, signals["azimuth"], signals["rotor_speed"], dt)
        self.acting.append(self.offsets.acting)
        self.share.append(share)
        return changed


@dataclass(frozen=True)
class Recording:
    """A run, sample k at the instant at which offset k was decided; the last sample has no offset any more."""

    dt: float
    """[s]."""
    outputs: NDArray[np.float64]
    """`OUTPUTS` of `wt_gym.control.controllers.linear_optimal`, or `FLOATING_OUTPUTS`. Shape (n_out, n + 1)."""
    loads: NDArray[np.float64]
    """`LOADS` or `FLOATING_LOADS`. Shape (n_loads, n + 1)."""
    flap: NDArray[np.float64]
    edge: NDArray[np.float64]
    pitch: NDArray[np.float64]
    """flap, edge, pitch: root moments [N m], pitch [rad]. Shape (n_blades, n + 1)."""
    azimuth: NDArray[np.float64]
    """[rad]. Shape (n + 1,)."""
    offsets: NDArray[np.float64]
    """That reached the drives [rad]. Shape (3, n)."""
    share: NDArray[np.float64]
    """In which offsets may act. Shape (n,)."""

    @classmethod
    def of_channels(
        cls,
        channels: Mapping[str, NDArray[np.float64]],
        turbine: Turbine,
        dt: float,
        offsets: NDArray[np.float64],
        share: NDArray[np.float64],
    ) -> "Recording":
        """Recording of signals (n + 1,) by name."""
        sign, floats = side_sign(turbine), turbine.floater is not None
        n_outputs = len(FLOATING_OUTPUTS if floats else OUTPUTS)

        def of_blades(name: str) -> NDArray[np.float64]:
            return np.stack([channels[f"{name}_{b + 1}"] for b in range(turbine.n_blades)])

        return cls(
            dt=dt,
            outputs=recorded_outputs(channels, turbine.n_blades, sign, n_outputs),
            loads=np.stack([
                channels["tower_base_fore_aft_moment"],
                sign * channels["tower_base_side_side_moment"],
                channels["generator_power"],
                *floating_loads(channels, turbine),
            ]),
            flap=of_blades("root_flap_moment"),
            edge=of_blades("root_edge_moment"),
            pitch=of_blades("pitch"),
            azimuth=channels["azimuth"],
            offsets=offsets,
            share=share,
        )  # fmt: skip

    @property
    def steps(self) -> int:
        """N."""
        return int(self.offsets.shape[1])


class RecordingStore(Generic[_R]):
    """Folder of recordings, one file each, named by the digest of its definition.

    Parameters
    ----------
    folder : Path or None
        None: nothing is stored.
    kind : type
        Dataclass of the recordings, of numbers and arrays.
    """

    def __init__(self, folder: Path | None, kind: type[_R]) -> None:
        self._folder, self._kind = folder, kind

    def find_all(self, definitions: Sequence[dict[str, Any]]) -> dict[int, _R]:
        """Return the stored recordings by the place of their definition, as of `find`."""
        results = {k: self.find(definition) for k, definition in enumerate(definitions)}
        return {k: recording for k, recording in results.items() if recording is not None}

    def find(self, definition: dict[str, Any]) -> _R | None:
        """Return a recording; None if there is none, or one of a version of the package with another behavior."""
        if self._folder is None or not (file := self._folder / f"{run_digest(definition)}.npz").exists():
            return None
        try:
            with np.load(file, allow_pickle=False) as found:
                fingerprint = json.loads(str(found["fingerprint"]))
                arrays = {part.name: found[part.name] for part in fields(self._kind)}  # type: ignore[arg-type]
        except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{file} is damaged: {error}; remove it to have the run made again") from error
        if differing(fingerprint, definition["fingerprint"]):
            return None
        return self._kind(**{name: array if array.ndim else array.item() for name, array in arrays.items()})

    def keep(self, definition: dict[str, Any], recording: _R) -> None:
        """Write a recording: there is all of it or nothing."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        names = [part.name for part in fields(self._kind)]  # type: ignore[arg-type]
        arrays: dict[str, Any] = {name: np.asarray(getattr(recording, name)) for name in names}
        with whole_file(self._folder / f"{run_digest(definition)}.npz") as partial, partial.open("wb") as file:
            np.savez(file, fingerprint=json.dumps(definition["fingerprint"]), **arrays)


def record(
    turbine: Turbine,
    base: str,
    wind: Wind,
    duration: float,
    offsets: PitchOffsets,
    drawn: tuple[Excitation, int] | None = None,
    fidelity: str | None = None,
) -> Recording:
    """Run a base controller for a duration [s] in a wind, with offsets or without; a SimulationError where it fails.

    Parameters
    ----------
    base : str
        As `make_controller` takes it.
    wind : Wind
        Mean speed, and seed of the turbulence.
    offsets : PitchOffsets
        Is started.
    drawn : (Excitation, int), optional
        Distribution and seed of drawn offsets; by default there are none.
    """
    simulator = Simulator(turbine, inflow_of(turbine, wind), fidelity)
    simulator.sea = sea_of_training(turbine, wind)
    levels = np.zeros((3, 0))
    if drawn is not None:
        levels = drawn[0].draw(round(duration / simulator.time_step), simulator.time_step, drawn[1])
    played, parts = DrawnOffsets(offsets, levels), parts_of(make_controller(base, turbine))
    combined = Combined(parts[0], *parts[1:], played)  # type: ignore[arg-type]  # the first part is a controller
    data = run_controller(simulator, combined, duration).to_dataset()
    channels = {str(name): data[name].values.astype(float) for name in data.data_vars}
    return Recording.of_channels(
        channels, turbine, simulator.time_step, np.array(played.acting).T, np.array(played.share)
    )


def floating_loads(channels: Any, turbine: Turbine) -> NDArray[np.float64]:
    """Pitch of a platform about the axis across the nacelle [rad], (1, n) of channels (n,) by name; on land (0, n)."""
    if turbine.floater is None:
        return np.zeros((0, len(channels["azimuth"])))
    return np.asarray(in_nacelle_axes(channels, "", side_sign(turbine))[0], dtype=float)[None]


def sea_of_training(turbine: Turbine, wind: Wind) -> WaveComponents | None:
    """Sea that belongs to a wind with a seed, from ahead or up to `MISALIGNMENT` aside; None on land."""
    if turbine.floater is None:
        return None
    rng = np.random.default_rng(wind.seed)
    state = replace(sea_of_wind(wind.speed), direction=rng.uniform(-MISALIGNMENT, MISALIGNMENT), duration=LONGEST_SEA)
    return state.components(rng, turbine.floater.water_depth)


def respond(responses: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outputs (n_out, n + 1) of inputs (n_in, n): output k follows from inputs 0 … k - 1.

    Entry l of the responses (n_out, n_in, n_taps) is the effect of an input of one on the output l + 1 steps later.
    """
    n = inputs.shape[1]
    out = np.zeros((responses.shape[0], n + 1))
    for j, series in enumerate(inputs):
        out[:, 1:] += fftconvolve(responses[:, j], series[None], axes=1)[:, :n]
    return out


def _delayed(inputs: NDArray[np.float64], taps: int) -> NDArray[np.float64]:
    """Regressors (n, n_in * taps) of outputs 1 … n."""
    n = inputs.shape[1]
    padded = np.pad(inputs, ((0, 0), (taps - 1, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, taps, axis=1)[:, :n, ::-1]
    return windows.transpose(1, 0, 2).reshape(n, -1)


def identify(
    inputs: Sequence[NDArray[np.float64]],
    changes: Sequence[NDArray[np.float64]],
    taps: int,
    ridge: float = 0.0,
    decay: float = 0.0,
) -> NDArray[np.float64]:
    """Fit finite impulse responses to the changes of outputs by inputs.

    Without a ridge, responses that end within the taps and outputs without noise are found exactly. The ridge is
    heavier for later taps: a plant forgets (Chen, Ohlsson and Ljung, Automatica 48 (2012) 1525: diagonal kernel).

    Parameters
    ----------
    inputs : sequence of numpy.ndarray, shape (n_in, n)
        Of each run.
    changes : sequence of numpy.ndarray, shape (n_out, n + 1)
        Outputs with the inputs minus those without, in the same wind.
    ridge : float
        Over the mean square of the inputs, summed over the samples.
    decay : float
        Logarithm of the ridge's rise over the taps.

    Returns
    -------
    numpy.ndarray, shape (n_out, n_in, taps)
        As of `respond`.

    Raises
    ------
    ValueError
        If there are fewer samples than unknowns, an input never moves, or a value is not finite.
    """
    n_in, n_out = inputs[0].shape[0], changes[0].shape[0]
    if not all(np.isfinite(series).all() for series in (*inputs, *changes)):
        raise ValueError("inputs and changes must be finite")
    samples = sum(given.shape[1] for given in inputs)
    if taps < 1 or samples < n_in * taps:
        raise ValueError(
            f"{n_in} inputs with {taps} taps need at least {n_in * max(taps, 1)} samples and a tap; got {samples}"
        )
    gram, right = np.zeros((n_in * taps, n_in * taps)), np.zeros((n_in * taps, n_out))
    for given, changed in zip(inputs, changes, strict=True):
        rows = _delayed(given, taps)
        gram += rows.T @ rows
        right += rows.T @ changed[:, 1:].T
    still = [j for j in range(n_in) if gram[j * taps, j * taps] == 0.0]
    if still:
        raise ValueError(f"every input must move in some run; {', '.join(map(str, still))} do not")
    heavier = np.exp(decay * np.arange(taps) / taps)
    gram[np.diag_indices_from(gram)] += ridge * np.repeat(np.diag(gram)[::taps], taps) * np.tile(heavier, n_in)
    solved: NDArray[np.float64] = np.linalg.solve(gram, right)
    return solved.T.reshape(n_out, n_in, taps)


def explained_share(
    responses: NDArray[np.float64], inputs: Sequence[NDArray[np.float64]], changes: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Share of the mean square of changes, as of `identify`, that responses explain (n_out,); 1: a perfect model."""
    left = [c - respond(responses, u) for u, c in zip(inputs, changes, strict=True)]
    whole = sum((c**2).sum(1) for c in changes)
    return np.asarray(1.0 - sum((e**2).sum(1) for e in left) / whole)


def identify_and_judge(
    inputs: Sequence[NDArray[np.float64]], changes: Sequence[NDArray[np.float64]], taps: int, ridge: float, decay: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Responses as of `identify`, fitted to all runs, and shares of the last run that a fit to the others explains."""
    trial = identify(inputs[:-1], changes[:-1], taps, ridge, decay)
    return identify(inputs, changes, taps, ridge, decay), explained_share(trial, inputs[-1:], changes[-1:])


def to_blades(values: NDArray[np.float64], azimuth: NDArray[np.float64], n_blades: int) -> NDArray[np.float64]:
    """Values (..., n_blades, n) of mean, tilt and yaw (..., 3, n), blade 1 at ``azimuth`` (n,) [rad]."""
    angles = azimuth + 2.0 * math.pi / n_blades * np.arange(n_blades)[:, None]
    out: NDArray[np.float64] = (
        values[..., 0:1, :] + values[..., 1:2, :] * np.cos(angles) + values[..., 2:3, :] * np.sin(angles)
    )
    return out


def without_slow(series: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    """Series (..., n) without a smooth mean."""
    window = np.hanning(2 * (length // 2) + 3)[1:-1]
    window /= window.sum()
    half = window.size // 2
    padded = np.pad(series, [(0, 0)] * (series.ndim - 1) + [(half, half)], mode="edge")
    smooth: NDArray[np.float64] = fftconvolve(
        padded, window.reshape((1,) * (series.ndim - 1) + (-1,)), "valid", axes=-1
    )
    return series - smooth


def amplitude_weights(series: NDArray[np.float64], exponent: float, window: int) -> NDArray[np.float64]:
    """Weights (..., n) of the local range over its 90 % quantile, within bounds that keep single cycles from ruling."""
    span = maximum_filter1d(series, window, axis=-1) - minimum_filter1d(series, window, axis=-1)
    common = np.quantile(span, 0.9, axis=-1, keepdims=True)
    return np.asarray(np.clip((span / common) ** exponent, 0.02, 6.0))
