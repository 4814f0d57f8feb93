"""Linear optimal pitch: offsets from the disturbances that a model of the turbine leaves in what is measured.

The model is a finite impulse response from offsets of mean, tilt and yaw to what is measured under the base controller.
What it does not explain is the disturbance, which no offset changes: feedback from it cannot make the loop unstable as
long as the model holds, and its coefficients follow from least squares (Youla, Jabr and Bongiorno, IEEE Trans. Autom.
Control 21 (1976) 319; system-level synthesis: Anderson et al., Annu. Rev. Control 47 (2019) 364). The designs come from
``wt-gym design linear_optimal``.

*Readings* are six quantities in the fixed frame that any turbine's bus can carry (`OUTPUTS`), on a floating turbine
rates of the platform too. *Designs* are files of plain arrays with the record of their making, no pickled objects
(`LinearDesign`).

*Fit of the model* (`ModelFit`): a model explains y(t) of what is measured, and the disturbance d is the rest. If the
turbine answers 1 + g times as strongly and tau later, the part of the controller's own effect that is left is

    d = (1 + g) y(t - tau) - y(t) + d0 = g y - (1 + g) tau dy/dt + ...

to first order in tau, so the regressions of the changes of d on those of y and of dy/dt give a gain g and a lag
(1 + g) tau (least squares with an exponential window: Ljung, System Identification, 1999, section 11.2). Feedback makes
y an answer to earlier d0, so both are biased: a model that fits has values of its own, which late readings, slow
drives, weak or strong blades and dead gauges move. Changes, not values, are compared: the slow part of d0 is the
largest. Values need decisions in neighboring intervals; a controller that is asked less often than its design has
intervals shows zeros.
"""

import bisect
import itertools
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from wt_gym.base.errors import ControllerError
from wt_gym.base.files import whole_file
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.additions import AboveRated, FadeParameters
from wt_gym.control.controllers.controller import Controller, Readings, part_of
from wt_gym.control.design import same_rotor, tower_top
from wt_gym.control.sensors import FIXED_FRAME, BandLimitedIntegrator, LowPass, to_blades, to_harmonic, within
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.turbines import Turbine, load_turbine

OUTPUTS = ("flap_mean", "flap_tilt", "flap_yaw", "acceleration_fore_aft", "acceleration_side_side", "rotor_speed")
"""Flapwise root moments [N m], accelerations of the nacelle [m/s^2] and rotor speed [rad/s]."""
FLOATING_OUTPUTS = (*OUTPUTS, "platform_pitch_rate", "platform_roll_rate", "wave_elevation")
"""Those of a floating turbine: rates of the platform about the axes of the nacelle [rad/s], elevation of the sea at the
platform [m]. A design has `OUTPUTS`, all but the last of these, or all."""

_SINGLE = ("azimuth", "nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side", "rotor_speed")


def channels_read(n_blades: int, n_outputs: int = len(OUTPUTS)) -> tuple[str, ...]:
    """Names of the signals from which the first of `FLOATING_OUTPUTS` follow."""
    more = FLOATING_OUTPUTS[len(OUTPUTS) : n_outputs]
    return (*_SINGLE, *_moments(n_blades), *more, *(("yaw",) if more else ()))


@lru_cache
def _moments(n_blades: int) -> tuple[str, ...]:
    return tuple(f"root_flap_moment_{b + 1}" for b in range(n_blades))


def side_sign(turbine: Turbine) -> float:
    """Sign of what points to the side, so that the mirror image of a turbine has the same outputs."""
    return 1.0 if turbine.rotation == "clockwise" else -1.0


def measured_outputs(signals: Readings, n_blades: int, sign: float, out: NDArray[np.float64]) -> None:
    """Put as many of `FLOATING_OUTPUTS` of one instant into an array as it has; the sign is that of `side_sign`."""
    moments = [signals[name] for name in _moments(n_blades)]
    aside = sign * signals["nacelle_acceleration_side_side"]
    out[: len(OUTPUTS)] = (
        sum(moments) / n_blades, *to_harmonic(moments, signals["azimuth"]), signals["nacelle_acceleration_fore_aft"],
        aside, signals["rotor_speed"],
    )  # fmt: skip
    if (n := len(out)) > len(OUTPUTS):
        out[6:8] = in_nacelle_axes(signals, "_rate", sign)
        if n > 8:
            out[8] = signals["wave_elevation"]


def in_nacelle_axes(channels: Mapping[str, Any] | Readings, what: str, sign: float) -> tuple[Any, Any]:
    """Pitch and roll of a platform, or their rates with "_rate", about the axes of the nacelle, signs as of outputs."""
    pitch, roll, yaw = (channels[name] for name in (f"platform_pitch{what}", f"platform_roll{what}", "yaw"))
    return np.cos(yaw) * pitch - np.sin(yaw) * roll, sign * (np.cos(yaw) * roll + np.sin(yaw) * pitch)


def series_in_fixed_frame(values: NDArray[np.float64], azimuth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean, tilt and yaw (3, n) of series of every blade (n_blades, n), blade 1 at the azimuth (n,) [rad]."""
    n_blades = len(values)
    angles = azimuth + 2.0 * math.pi / n_blades * np.arange(n_blades)[:, None]
    return np.stack([values.mean(0), *(2.0 / n_blades * (values * turn(angles)).sum(0) for turn in (np.cos, np.sin))])


def recorded_outputs(
    channels: Mapping[str, NDArray[np.float64]], n_blades: int, sign: float, n_outputs: int = len(OUTPUTS)
) -> NDArray[np.float64]:
    """First of `FLOATING_OUTPUTS` of a record (n_outputs, n), from channels (n,) by name."""
    moments = np.stack([channels[f"root_flap_moment_{b + 1}"] for b in range(n_blades)])
    return np.stack([
        *series_in_fixed_frame(moments, channels["azimuth"]),
        channels["nacelle_acceleration_fore_aft"],
        sign * channels["nacelle_acceleration_side_side"],
        channels["rotor_speed"],
        *(in_nacelle_axes(channels, "_rate", sign) if n_outputs > 6 else ()),
        *((channels["wave_elevation"],) if n_outputs > 8 else ()),
    ])  # fmt: skip


def delay_bins(longest: float, dt: float, fine: int = 6, growth: float = 1.3) -> tuple[tuple[int, int], ...]:
    """Bins [first, last) of delays in steps up to the longest [s]: single steps, then wider and wider ones.

    A step is ``dt`` [s]; ``fine`` is the number of bins of one step, ``growth`` the ratio of the widths of two bins.
    """
    end = max(round(longest / dt), fine)
    edges = list(range(fine + 1))
    width = 1.0
    while edges[-1] < end:
        width *= growth
        edges.append(min(edges[-1] + max(round(width), 1), end))
    return tuple(itertools.pairwise(edges))


def without_lasting(series: NDArray[np.float64], time_constant: float, dt: float) -> NDArray[np.float64]:
    """Series (..., n) minus its first-order low-pass, which starts in steady state; 0: as it is."""
    if time_constant == 0.0:
        return series
    kept = math.exp(-dt / time_constant)
    lasting, _ = lfilter([1.0 - kept], [1.0, -kept], series, axis=-1, zi=kept * series[..., :1])
    out: NDArray[np.float64] = series - lasting
    return out


def bin_means(series: NDArray[np.float64], bins: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """Means over bins of delays (n_bins, n) of a series (n,) that stood at its first value before."""
    longest = max(last for _, last in bins)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([np.full(longest, series[0]), series]))])
    now = np.arange(series.size) + longest + 1
    return np.stack([(sums[now - first] - sums[now - last]) / (last - first) for first, last in bins])


def spread_over_bins(coefficients: NDArray[np.float64], bins: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """Coefficient of each delay (..., n_delays) of coefficients of bin means (..., n_bins)."""
    widths = np.array([last - first for first, last in bins])
    return np.repeat(coefficients / widths, widths, axis=-1)


FORMAT = 3
"""Version of the files; earlier ones have no ``loads``."""

_ARRAYS = ("pitch", "responses", "gains", "scale", "washout", "loads")
_NUMBERS = ("interval", "limit", "rate_limit", "fade")


def offset_fade(fade: float, fine_speed: tuple[float, float] | None) -> FadeParameters:
    """Fade of offsets: in full from a collective pitch above fine pitch on [rad], and at fine pitch by rotor speed."""
    return FadeParameters(pitch=(fade / 6.0, fade), fine_speed=fine_speed)


@dataclass(frozen=True, eq=False)
class LinearDesign:
    """Models and feedbacks at several wind speeds, between which the pitch of the blades chooses.

    With the outputs y over their scale (`outputs`) and the offsets u that reached the drives (mean, tilt,
    yaw), sampled at the interval,

        d_k = y_k - sum_l responses[l] u_(k-1-l),    u_k = sum_l gains[l] f_(k-l),

    f being d without what lasts longer than the washout.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If shapes do not fit, or a number is out of range.
    """

    is_constant: ClassVar[bool] = True
    """Nothing in it is memory of a controller."""
    pitch: NDArray[np.float64]  #: mean pitch of the blades at which each design holds, rising [rad], shape (n,)
    responses: NDArray[np.float64]  #: of outputs over their scale to offsets [1/rad], shape (n, n_out, 3, n_taps)
    gains: NDArray[np.float64]  #: from disturbances to offsets [rad], shape (n, 3, n_out, n_delays)
    scale: NDArray[np.float64]  #: of the outputs, shape (n_out,)
    washout: NDArray[np.float64]  #: time constant of what lasts in each output [s], 0: all counts, shape (n_out,)
    loads: NDArray[
        np.float64
    ]  #: fore-aft and side-side moment of the tower base by offsets [N m/rad], (n, 2, 3, n_taps)
    interval: float  #: between two decisions [s]
    limit: float  #: of the offsets [rad]
    rate_limit: float  #: of the offsets [rad/s]
    fade: float  #: collective pitch above fine pitch from which on all acts in full [rad], see `AboveRated.of_turbine`
    record: dict[str, Any] = field(default_factory=dict)
    """How it was made: turbine, base controller, winds, options, what the models explain; JSON values."""
    fine_speed: tuple[float, float] | None = None
    """Rotor speed over the rated one at which offsets begin and act in full at fine pitch [-]; by default they do
    not act there."""

    def __post_init__(self) -> None:
        n, m = len(self.pitch), len(self.outputs)
        shapes = {"pitch": (n,), "responses": (n, m, 3, -1), "gains": (n, 3, m, -1), "scale": (m,), "washout": (m,)}
        shapes["loads"] = (n, 2, 3, np.shape(self.responses)[-1])
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
            pairs = zip(array.shape, shape, strict=False)
            if array.ndim != len(shape) or not all(own > 0 and wanted in (own, -1) for own, wanted in pairs):
                shown = ", ".join("any" if wanted == -1 else str(wanted) for wanted in shape)
                raise ControllerError(f"{name} of a linear design must have shape ({shown}), got {array.shape}")
        rules = {
            name: ("be finite", np.isfinite(getattr(self, name)).all()) for name in ("responses", "gains", "loads")
        }
        rules["pitch"] = "be finite and rise", np.isfinite(self.pitch).all() and (np.diff(self.pitch) > 0.0).all()
        rules["scale"] = "be finite and positive", ((self.scale > 0.0) & (self.scale < math.inf)).all()
        rules["washout"] = "be finite and not negative", ((self.washout >= 0.0) & (self.washout < math.inf)).all()
        rules |= {name: ("be finite and positive", 0.0 < getattr(self, name) < math.inf) for name in _NUMBERS}
        low, high = self.fine_speed or (0.5, 1.0)
        rules["fine_speed"] = "be two rising positive numbers", 0.0 < low < high < math.inf
        for name, (rule, holds) in rules.items():
            if not holds:
                raise ControllerError(f"{name} of a linear design must {rule}, got {getattr(self, name)!r}")

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of what is read."""
        n = np.size(self.scale)
        return FLOATING_OUTPUTS[:n] if n in (8, 9) else OUTPUTS

    @property
    def fading(self) -> FadeParameters:
        """Range in which offsets fade in."""
        return offset_fade(self.fade, self.fine_speed)

    def __deepcopy__(self, memo: dict[int, Any]) -> "LinearDesign":
        return self  # nothing in it changes


def save_design(design: LinearDesign, path: str | Path) -> None:
    """Write a design, in single precision."""
    head = {"format": FORMAT, **{name: getattr(design, name) for name in _NUMBERS}, "record": design.record}
    head["fine_speed"] = None if design.fine_speed is None else list(design.fine_speed)
    arrays = {name: getattr(design, name).astype(np.float32) for name in _ARRAYS}
    with whole_file(Path(path)) as partial, partial.open("wb") as file:
        np.savez_compressed(file, head=np.array(json.dumps(head, allow_nan=False)), **arrays)


def load_design(path: str | Path) -> LinearDesign:
    """Read a design.

    Raises
    ------
    FileNotFoundError, wt_gym.base.errors.ControllerError
        If there is no such file; if it is none, or of a version that is not known.
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


FIT_TIME = 30.0
"""Time constant of the window [s]."""
LEAST_CHANGE = 1e-4
"""Added to the mean square of the changes of y, over their scale: without an effect of its own there is no fit."""


class ModelFit:
    """Gain and lag of n outputs, one value at every interval [s].

    Attributes
    ----------
    values : numpy.ndarray, shape (2 n,)
        Gains [-] and lags [s].
    """

    def __init__(self, n: int, interval: float) -> None:
        self._interval, self._kept = interval, math.exp(-interval / FIT_TIME)
        self._past = np.zeros((2, 2, n))  # d and y, of the last time and of that before
        self._sums = np.zeros((4, n))
        self._count = 0.0
        self.values = np.zeros(2 * n)

    def start(self) -> None:
        """Forget everything."""
        self._past[:] = self._sums[:] = self.values[:] = 0.0
        self._count = 0.0

    def update(self, disturbance: NDArray[np.float64], explained: NDArray[np.float64], passed: int = 1) -> None:
        """Take a disturbance and its explained counterpart (n,), over their scale, ``passed`` intervals after the last.

        Where that is not one interval, no change is taken from them.
        """
        if passed != 1:
            self._count = 0.0
        if self._count > 1.5:
            change = 0.5 * (disturbance - self._past[0, 1])
            along = 0.5 * (explained - self._past[1, 1])
            rate = (explained - 2.0 * self._past[1, 0] + self._past[1, 1]) / self._interval
            new = np.stack([change * along, along**2, change * rate, rate**2])
            self._sums += (1.0 - self._kept) * (new - self._sums)
            n = len(change)
            self.values[:n] = self._sums[0] / (self._sums[1] + LEAST_CHANGE)
            self.values[n:] = -self._sums[2] / (self._sums[3] + LEAST_CHANGE)
        self._past[:, 1] = self._past[:, 0]
        self._past[0, 0], self._past[1, 0] = disturbance, explained
        self._count += 1.0


OFFSET_ACTIONS = tuple(f"pitch_{name}_offset" for name in FIXED_FRAME)
"""Names of actions that are offsets of mean, tilt and yaw."""
_MOST, _MOST_RATE = math.radians(4.0), math.radians(3.0)
_TURNING, _CHANGING = 0.625, 0.375
"""Shares of the rate of the pitch drive: for cyclic pitch that lasts, and for its change [-]."""


def default_limits(turbine: Turbine) -> tuple[float, float]:
    """Largest offset [rad] and largest rate of offsets [rad/s] that the pitch drives of a turbine can follow.

    Tilt and yaw offsets of amplitude A, which change at the rate r in the fixed frame, move a blade of a rotor at the
    speed Ω at up to A Ω + r. At rated speed that is the rate of the drive; both are at most 4° and 3°/s.
    """
    most = turbine.pitch.max_rate
    limit = _TURNING * most / turbine.drivetrain.rated_rotor_speed
    return min(limit, _MOST), min(_CHANGING * most, _MOST_RATE)


class PitchOffsets:
    """Adds offsets in the fixed frame to a demand and says what of them reaches the drives.

    The mean is limited in size and rate, tilt and yaw in the 2-norm of both. Below rated all fade out, because pitch
    costs power there. No blade is pitched beyond the range of its drive: what is left of the offsets is given back, so
    that a model of the turbine gets the inputs that the turbine gets.

    Parameters
    ----------
    limit, rate_limit : float
        [rad], [rad/s].
    fade : FadeParameters, bool or float
        As of `AboveRated.of_turbine`; False: always in full.

    Attributes
    ----------
    share : float
        Of the fade [-].
    acting : tuple of float
        Mean, tilt and yaw that reached the drives in the last step [rad].

    Raises
    ------
    ValueError
        For a turbine of less than three blades.
    """

    def __init__(
        self, turbine: Turbine, limit: float, rate_limit: float, fade: FadeParameters | bool | float = True
    ) -> None:
        if turbine.n_blades < 3:
            raise ValueError(f"offsets in the fixed frame need at least 3 blades, got {turbine.n_blades}")
        self.limit, self.rate_limit = limit, rate_limit
        self.drive, self.n_blades = turbine.pitch, turbine.n_blades
        self.fade = AboveRated.of_turbine(turbine, fade)
        self.start()

    def start(self) -> None:
        """Forget everything: there are no offsets."""
        self.share = 1.0
        if self.fade is not None:
            self.fade.start()
        self._asked = (0.0, 0.0, 0.0)
        self.acting = (0.0, 0.0, 0.0)

    def update_share(self, demand: Demand, rotor_speed: float, dt: float) -> float:
        """Share in which offsets act on a demand, before `added` is called for the same step."""
        if self.fade is not None:
            self.share = self.fade.update(list(map(float, demand.pitch)), rotor_speed, dt)
        return self.share

    def added(self, wanted: Sequence[float], demand: Demand, azimuth: float, rotor_speed: float, dt: float) -> Demand:
        """Demand with offsets ``wanted``, mean, tilt and yaw [rad], as far as limits and rates let them through.

        At the azimuth of blade 1 [rad] and a rotor speed [rad/s]; ``dt`` is the step [s].
        """
        mean, tilt, yaw = wanted
        mean = min(max(mean, -self.limit), self.limit)
        tilt, yaw = within((tilt, yaw), self.limit)
        last, reach = self._asked, self.rate_limit * dt
        mean = last[0] + min(max(mean - last[0], -reach), reach)
        move = within((tilt - last[1], yaw - last[2]), reach)
        self._asked = (mean, last[1] + move[0], last[2] + move[1])
        ahead = azimuth + rotor_speed * pitch_delay(self.drive, dt)
        low, high = self.drive.min_pitch, self.drive.max_pitch
        pitch, reached = [], []
        for before, offset in zip(map(float, demand.pitch), to_blades(self._asked, ahead, self.n_blades), strict=True):
            angle = min(max(before + offset, min(before, low)), max(before, high))
            pitch.append(angle)
            reached.append(angle - before)
        self.acting = self._in_fixed_frame(reached, ahead)
        return Demand(np.array(pitch), demand.yaw_rate, demand.generator_torque)

    def between(
        self, before: Demand, after: Demand, azimuth: float, rotor_speed: float, dt: float
    ) -> tuple[float, float, float]:
        """Mean, tilt and yaw [rad] by which one demand differs from another, at the azimuth at which it acts."""
        ahead = azimuth + rotor_speed * pitch_delay(self.drive, dt)
        pairs = zip(after.pitch.tolist(), before.pitch.tolist(), strict=True)
        return self._in_fixed_frame([own - base for own, base in pairs], ahead)

    def _in_fixed_frame(self, values: list[float], azimuth: float) -> tuple[float, float, float]:
        """Mean, tilt and yaw."""
        return sum(values) / self.n_blades, *to_harmonic(values, azimuth)


@option_record
class ObserverOptions(Options):
    """Parameters of a `LoadObserver`."""

    title = "observer"

    file: Path | None = option(
        "design for the turbine and the base controller", default=None, unit="-",
        otherwise="the one shipped for the turbine",
    )  # fmt: skip


@option_record
class LinearOptions(ObserverOptions):
    """Parameters of a `LinearOptimalPitch`."""

    title = "linear_pitch"

    gain: float = option("factor on all offsets", default=1.0, unit="-", low=0.0, high=2.0)


SHIPPED = (
    "gebhardt_45m", "iea_15mw", "iea_15mw_monopile", "iea_22mw", "nrel_5mw", "nrel_5mw_monopile", "oc4_nrel_5mw",
    "volturnus_iea_15mw",
)  # fmt: skip
"""Turbines with a design in ``data``."""

SCHEDULE_TIME = 10.0
"""Time constant of the pitch that chooses between designs [s]."""
MOTION_CORNER = 0.2
"""Corner of the integrators that make the motion of the tower top, in its natural frequencies [-]."""


def seen_bins(design: LinearDesign) -> tuple[tuple[int, int], ...]:
    """Bins of delays, first to last without the last, in intervals, over which an agent sees means of disturbances."""
    return delay_bins(design.gains.shape[-1] * design.interval, design.interval, fine=3, growth=1.6)


class LoadObserver:
    """Addition that adds nothing: it knows the disturbances and what offsets of others do, for an agent to observe.

    Attributes
    ----------
    gain : float
        Factor on the offsets that the disturbances ask for.
    offsets : PitchOffsets
    disturbance : numpy.ndarray, shape (n_out,)
        Of the last step, in the units of the outputs.
    fit : ModelFit
        Of the model, over what is measured.
    motion : numpy.ndarray, shape (4,)
        Velocity of the tower top fore-aft and to the side [m/s] and its displacement [m], without what is slower than
        `MOTION_CORNER`, from the accelerations of the nacelle.
    natural : numpy.ndarray, shape (2,)
        Natural frequencies of the tower [rad/s].
    """

    gain: float = 0.0

    def __init__(self, turbine: Turbine, design: LinearDesign) -> None:
        self.design, n_outputs = design, len(design.outputs)
        if n_outputs > len(OUTPUTS) and turbine.floater is None:
            raise ControllerError(
                f"a design with {design.outputs[-1]} must be for a floating turbine, got {turbine.name}"
            )
        self.offsets = PitchOffsets(turbine, design.limit, design.rate_limit, design.fading)
        self.channels = channels_read(turbine.n_blades, n_outputs)
        self._knots = design.pitch.tolist()
        self.sign, self.n_blades = side_sign(turbine), turbine.n_blades
        with np.errstate(divide="ignore"):
            self._kept = np.where(design.washout > 0.0, np.exp(-design.interval / design.washout), 0.0)
        self._washes = design.washout > 0.0
        self._schedule = LowPass(SCHEDULE_TIME)
        self._acted = np.zeros((3, design.responses.shape[-1]))
        self._past = np.zeros((n_outputs, design.gains.shape[-1]))
        self._lasting = np.zeros(n_outputs)
        self.disturbance, self._sum = np.zeros(n_outputs), np.zeros(3)
        self.fit = ModelFit(n_outputs, design.interval)
        top = tower_top(turbine)
        self.natural = np.array([top.fore_aft, top.side_side])
        self._integrals = [[BandLimitedIntegrator(MOTION_CORNER * w) for _ in range(2)] for w in self.natural.tolist()]
        self.motion = np.zeros(4)
        self.bins = seen_bins(design)
        self._first, self._last = np.array(self.bins).T
        self._forget()

    @classmethod
    def of_turbine(cls, turbine: Turbine, **parameters: Any) -> "LoadObserver":
        """Observer of a design, with parameters of `ObserverOptions`.

        Raises
        ------
        ValueError, FileNotFoundError, wt_gym.base.errors.ControllerError
            If no design is shipped for the turbine; if there is no such file; if it is not a design.
        """
        return cls(turbine, _design(turbine, ObserverOptions(**parameters).file))

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        self._forget()
        for (velocity, position), acceleration in zip(self._integrals, self._accelerations(signals), strict=True):
            velocity.reset(acceleration)
            position.reset()

    def _accelerations(self, signals: Readings) -> tuple[float, float]:
        """Accelerations of the nacelle [m/s^2]."""
        return signals["nacelle_acceleration_fore_aft"], self.sign * signals["nacelle_acceleration_side_side"]

    def _forget(self) -> None:
        self.offsets.start()
        self._acted[:] = self._past[:] = 0.0
        self._lasting[:] = self.disturbance[:] = self.motion[:] = 0.0
        self._sum[:] = 0.0
        self.fit.start()
        self._wanted: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._age, self._acted_for, self._fresh = 0.0, 0.0, True

    def see_demand(self, base: Demand, demand: Demand, signals: Readings, dt: float) -> None:
        """Take what an agent added to the demand of the base controller for an offset of this controller's own.

        So the disturbances stay what no offset changes, and this controller does not answer what the agent does.
        """
        self._sum += dt * np.array(self.offsets.between(base, demand, signals["azimuth"], signals["rotor_speed"], dt))

    def known(self, signals: Readings) -> NDArray[np.float64]:
        """Knowledge of the disturbances at an instant, before the controller acts on it.

        Returns
        -------
        numpy.ndarray, shape (n,)
            Disturbances over their scale and without what lasts, output by output: the mean over the first of the
            `bins` of delays, then the change of the mean from each bin to the one before it; mean, tilt and yaw that
            they ask for [rad]; share in which offsets act; slow pitch [rad]; gains [-] and lags [s] of `fit`; own
            response, what is measured less the disturbances, over the scale; `motion`.
        """
        passed = int(self._age + 1e-6)
        past = self._past
        slow = float(np.mean(signals["pitch"])) if self._fresh else self._schedule.value
        found, measured = self._found(signals, self.acted(), slow)
        if self._fresh or passed > 0:
            past, _ = self._moved(found, passed)
        sums = np.cumsum(past, axis=1)
        sums = np.concatenate([np.zeros((len(past), 1)), sums], axis=1)
        means = (sums[:, self._last] - sums[:, self._first]) / (self._last - self._first)
        means[:, 1:] = means[:, :-1] - means[:, 1:]
        wanted = self._answer(past, slow)
        scheduled = [self.offsets.share, slow]
        return np.concatenate([means.reshape(-1), wanted, scheduled, self.fit.values, measured - found, self.motion])

    def acted(self) -> NDArray[np.float64]:
        """Offsets (3, n) [rad] that reached the drives in the intervals of the design up to now, the last first."""
        passed = int(self._age + 1e-6)
        if self._fresh or passed == 0:
            return self._acted
        acted = self._acted.copy()
        _shift(acted, passed)
        acted[:, :passed] = (self._sum / self._acted_for)[:, None]
        return acted

    def place(self) -> list[tuple[int, float]]:
        """Designs that hold at present, by their number, with their shares."""
        return placed(self._knots, self._schedule.value)

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Take what is measured; the demand stays."""
        self.offsets.update_share(demand, signals["rotor_speed"], dt)
        self._follow(signals, sum(map(float, demand.pitch)) / self.n_blades, dt)
        return demand

    def _follow(self, signals: Readings, pitch: float, dt: float) -> None:
        """Take what is measured in a step [s], with the mean pitch that chooses between designs [rad]."""
        if self._fresh:
            self._schedule.reset(pitch)
        slow = self._schedule.update(pitch, dt)
        for k, now in enumerate(self._accelerations(signals)):
            velocity, position = self._integrals[k]
            self.motion[k] = velocity.update(now, dt)
            self.motion[k + 2] = position.update(float(self.motion[k]), dt)
        passed = int(self._age + 1e-6)
        if self._fresh or passed > 0:
            if passed > 0:  # the mean of the offsets since the last decision acted in each of the intervals
                _shift(self._acted, passed)
                self._acted[:, :passed] = (self._sum / self._acted_for)[:, None]
                self._sum[:] = 0.0
                self._acted_for = 0.0
            found, measured = self._found(signals, self._acted, slow)
            self._past, self._lasting = self._moved(found, passed)
            self.disturbance[:] = found * self.design.scale
            self._decide(found, measured, slow, passed)
            self._age -= passed
            self._fresh = False
        self._age += dt / self.design.interval
        self._acted_for += dt

    def _found(
        self, signals: Readings, acted: NDArray[np.float64], pitch: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Disturbances over scales (n_out,), what is measured less what the offsets did, and what is measured."""
        design, found = self.design, np.empty(len(self.disturbance))
        measured_outputs(signals, self.n_blades, self.sign, found)
        found /= design.scale
        measured = found.copy()
        for k, share in placed(self._knots, pitch):
            found -= share * (design.responses[k].reshape(len(found), -1) @ acted.reshape(-1))
        return found, measured

    def _moved(self, found: NDArray[np.float64], passed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Past (n_out, n_delays) and what lasts of it (n_out,), with the disturbances found after so many intervals."""
        if self._fresh:
            lasting = found.copy()
            past = np.repeat(np.where(self._washes, 0.0, found)[:, None], self._past.shape[1], axis=1)
        else:
            past, lasting = self._past.copy(), self._lasting.copy()
            _shift(past, passed)
            past[:, 1:passed] = self._past[:, :1]  # nothing was measured between
        lasting += (1.0 - self._kept**passed) * (found - lasting)
        past[:, 0] = np.where(self._washes, found - lasting, found)
        return past, lasting

    def _decide(
        self, found: NDArray[np.float64], measured: NDArray[np.float64], pitch: float, passed: int
    ) -> None:  # fmt: skip
        """Nothing is decided."""

    def _answer(self, past: NDArray[np.float64], pitch: float) -> NDArray[np.float64]:
        """Offsets (3,) that the past of the disturbances asks for at a slow pitch [rad]."""
        return np.zeros(3)


class LinearOptimalPitch(LoadObserver):
    """Addition that answers disturbances of loads and rotor speed by mean, tilt and yaw pitch."""

    def __init__(self, turbine: Turbine, design: LinearDesign, gain: float = 1.0) -> None:
        super().__init__(turbine, design)
        self.gain = gain

    @classmethod
    def of_turbine(cls, turbine: Turbine, **parameters: Any) -> "LinearOptimalPitch":
        """Controller of a design, with parameters of `LinearOptions`; errors as of a `LoadObserver`."""
        o = LinearOptions(**parameters)
        return cls(turbine, _design(turbine, o.file), o.gain)

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the offsets, which are decided at the interval of the design, or at every step where that is longer."""
        speed, azimuth = signals["rotor_speed"], signals["azimuth"]
        share = self.offsets.update_share(demand, speed, dt)
        self._follow(signals, sum(map(float, demand.pitch)) / self.n_blades + self.offsets.acting[0], dt)
        mean, tilt, yaw = self._wanted
        changed = self.offsets.added((share * mean, share * tilt, share * yaw), demand, azimuth, speed, dt)
        self._sum += dt * np.array(self.offsets.acting)
        return changed

    def _decide(
        self, found: NDArray[np.float64], measured: NDArray[np.float64], pitch: float, passed: int
    ) -> None:  # fmt: skip
        self.fit.update(found, measured - found, passed)
        self._wanted = tuple(self._answer(self._past, pitch).tolist())

    def _answer(self, past: NDArray[np.float64], pitch: float) -> NDArray[np.float64]:
        wanted = np.zeros(3)
        for k, share in placed(self._knots, pitch):
            wanted += share * self.gain * (self.design.gains[k].reshape(3, -1) @ past.reshape(-1))
        return wanted


def _shift(rows: NDArray[np.float64], steps: int) -> None:
    """Move what stands in rows to the right; the first columns stay."""
    if 0 < steps < rows.shape[1]:
        rows[:, steps:] = rows[:, :-steps].copy()


def placed(knots: Sequence[float], value: float) -> list[tuple[int, float]]:
    """Knots on both sides of a value with their shares, as far as these are above zero; beyond the ends one alone."""
    if value <= knots[0] or len(knots) == 1:
        return [(0, 1.0)]
    k = min(bisect.bisect_left(knots, value) - 1, len(knots) - 2)
    weight = min((value - knots[k]) / (knots[k + 1] - knots[k]), 1.0)
    return [(index, share) for index, share in ((k, 1.0 - weight), (k + 1, weight)) if share > 0.0]


def _design(turbine: Turbine, file: Path | None) -> LinearDesign:
    return load_design(_shipped(turbine) if file is None else file)


def _shipped(turbine: Turbine) -> Path:
    """Design that comes with the package: for the rotor and for what it stands on."""
    for name in SHIPPED:
        home = load_turbine(name)
        on_land = home.tower.support is None
        if home.name == turbine.name and on_land == (turbine.tower.support is None) and same_rotor(home, turbine):
            return Path(__file__).with_name("data") / f"linear_optimal_{name}.npz"
    raise ValueError(
        f"linear_optimal must be given a design for {turbine.name}: linear_optimal:file=PATH, made by wt-gym design "
        f"linear_optimal; one is shipped for {', '.join(SHIPPED)}"
    )


def linear_part(controller: Controller | None) -> LoadObserver | None:
    """The observer, or linear optimal pitch, among the parts of a controller, None where it has none."""
    return part_of(controller, LoadObserver)
