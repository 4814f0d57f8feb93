"""Feedback from disturbances by least squares on a quadratic that stands for the lifetime cost.

Under offsets that are linear in the disturbances, loads are linear in the coefficients. The cost is not quadratic in
the loads, so each pass takes the quadratic that touches it at the loads of the pass before (iteratively reweighted
least squares). Of a damage-equivalent load L, with weights w that rise with the local amplitude of the load x, and of
a travel |r|,

    L ~ L_k (1 + Q/Q_k)/2,  Q = sum w x^2,        |r| ~ (r^2/|r_k| + |r_k|)/2.

Power is linear in the offsets, less a part in proportion to their square, which the excited runs give.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import fftconvolve

from wt_gym.analysis.metrics import BLADE_EXPONENT, LIFETIME_COST_WEIGHTS, TOWER_EXPONENT, damage_equivalent_load
from wt_gym.control.controllers.linear_optimal import OUTPUTS, bin_means, delay_bins, spread_over_bins, without_lasting
from wt_gym.learning.linear_design.identification import respond
from wt_gym.learning.linear_design.series import POWER, TOWER, amplitude_weights, to_blades, without_slow
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from wt_gym.learning.linear_design.recording import Recording
    from wt_gym.turbines import Turbine

__all__ = ["FeedbackOptions", "Forecast", "Plant", "fit_feedback", "forecast", "forecast_change", "minimize_quadratic"]

_MEAN_READS, _TILT_YAW_READS = (0, 3, 5), (1, 2, 4)
"""Places in `OUTPUTS` of what the mean offset, and tilt and yaw, answer."""
_LASTING = (1, 2)
"""Outputs whose lasting part is answered: static tilt and yaw of the loads cost fatigue, and no integrator undoes these
offsets."""


@dataclass(frozen=True)
class FeedbackOptions:
    """How a feedback is fitted.

    Attributes
    ----------
    travel_weight : float
        Factor on the cost of the pitch travel: a point of a front [-].
    power_weight : float
        Factor on the cost of power [-].
    speed_weight : float
        Cost of the mean square change of the rotor speed over the rated one [-].
    mean_weight, tilt_yaw_weight : float
        Cost of the mean square of offsets [1/rad^2].
    amplitude_exponent : float
        Of the weights of flapwise loads in the local amplitude [-]. Fatigue less two would be exact, and would fit
        single cycles.
    tower_exponent : float
        The same for the tower [-].
    ridge : float
        Over the diagonal of the normal equations [-].
    passes : int
    longest : float
        Delay up to which the past counts [s].
    washout : float
        Time constant of what lasts in the mean channel and aside, which no offset answers [s].
    still : float
        Rate below which travel counts as a square [rad/s].
    window : float
        Of the local amplitude [s].
    smooth : float
        Length of the mean that is taken off a load [s].
    skip : float
        Start of each run that does not count [s].
    weights : dict
        Of the cost, see `wt_gym.analysis.metrics.LIFETIME_COST_WEIGHTS`.

    Raises
    ------
    ValueError
        For numbers out of range.
    """

    travel_weight: float = 1.0
    power_weight: float = 1.0
    speed_weight: float = 30.0
    mean_weight: float = 8.0
    tilt_yaw_weight: float = 0.03
    amplitude_exponent: float = 4.0
    tower_exponent: float = 2.0
    ridge: float = 1e-2
    passes: int = 4
    longest: float = 15.0
    washout: float = 30.0
    still: float = math.radians(0.3)
    window: float = 5.0
    smooth: float = 20.0
    skip: float = 20.0
    weights: dict[str, float] = field(default_factory=lambda: dict(LIFETIME_COST_WEIGHTS))

    def __post_init__(self) -> None:
        for name in ("travel_weight", "power_weight", "speed_weight", "mean_weight", "tilt_yaw_weight", "ridge",
                     "amplitude_exponent", "tower_exponent", "skip"):  # fmt: skip
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)!r}")
        for name in ("longest", "washout", "still", "window", "smooth"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be finite and positive, got {getattr(self, name)!r}")
        if self.passes < 1:
            raise ValueError(f"passes must be at least 1, got {self.passes!r}")
        if unknown := sorted(set(self.weights) - set(LIFETIME_COST_WEIGHTS)):
            raise ValueError(
                f"weights must be of {', '.join(LIFETIME_COST_WEIGHTS)}; got {', '.join(map(repr, unknown))}"
            )


@dataclass(frozen=True)
class Plant:
    """Model of a turbine under a base controller about one wind speed.

    Attributes
    ----------
    responses : numpy.ndarray, shape (9, 3, n_taps)
        Of `OUTPUTS` and `LOADS` to offsets [unit/rad].
    scale : numpy.ndarray, shape (6,)
        Standard deviations of the outputs.
    power_curvature : float
        Share of power that offsets take by the mean of their square [1/rad^2].
    lead : float
        Time from an offset to the pitch [s].
    dt : float
        [s].
    """

    responses: NDArray[np.float64]
    scale: NDArray[np.float64]
    power_curvature: float
    lead: float
    dt: float

    @staticmethod
    def lead_of(turbine: Turbine, dt: float) -> float:
        """Time from an offset to the pitch of a turbine that is asked every ``dt`` [s]."""
        return pitch_delay(turbine.pitch, dt)

    def pitch_azimuth(self, run: Recording) -> NDArray[np.float64]:
        """Azimuth (n,) at which offsets reach the blades in a recorded run [rad]."""
        return run.azimuth[:-1] + self.lead * run.outputs[OUTPUTS.index("rotor_speed"), :-1]


@dataclass(frozen=True)
class Forecast:
    """What a recorded run would have been under offsets.

    Attributes
    ----------
    flap, pitch : numpy.ndarray, shape (n_blades, n + 1)
        [N m], [rad].
    tower : numpy.ndarray, shape (2, n + 1)
        Fore-aft and side-side moment at the base [N m].
    power : float
        Mean [W].
    """

    flap: NDArray[np.float64]
    pitch: NDArray[np.float64]
    tower: NDArray[np.float64]
    power: float

    def metrics(self, dt: float, full_rate: float, skip: float) -> dict[str, float]:
        """Metrics of the lifetime cost, without what lies in the first ``skip`` [s]; ``full_rate`` [rad/s]."""
        start = round(skip / dt)
        time = (self.flap.shape[1] - start) * dt

        def load(series: NDArray[np.float64], exponent: float) -> float:
            return damage_equivalent_load(series[start:], time, exponent)

        return {
            "captured_power": self.power,
            "blade_flap_del": max(load(blade, BLADE_EXPONENT) for blade in self.flap),
            "tower_fore_aft_del": load(self.tower[0], TOWER_EXPONENT),
            "tower_side_side_del": load(self.tower[1], TOWER_EXPONENT),
            "pitch_duty_cycle": float(np.abs(np.diff(self.pitch[:, start:])).mean() / dt / full_rate),
        }


def forecast_change(now: dict[str, float], before: dict[str, float], weights: dict[str, float]) -> float:
    """Change of the cost, of those of its terms that a forecast has."""
    return sum(
        weights.get(key, 0.0) * (value - before[key]) / (1.0 if key == "pitch_duty_cycle" else before[key])
        for key, value in now.items()
    )


class _Columns(NamedTuple):
    """What coefficients of one do to a run, features first."""

    flap: NDArray[np.float64]
    tower: NDArray[np.float64]
    speed: NDArray[np.float64]
    rate: NDArray[np.float64]
    offsets: NDArray[np.float64]
    power: NDArray[np.float64]


def minimize_quadratic(
    rows: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
    ridge: float = 0.0,
    linear: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Coefficients q that minimize the sum of ``|q rows + targets|^2`` over all pairs, plus ``linear q`` and a ridge.

    Parameters
    ----------
    rows : sequence of (numpy.ndarray, shape (n, m), numpy.ndarray, shape (m,))
        What each coefficient adds, and what is there without.
    ridge : float
        Over the diagonal of the normal equations.
    linear : numpy.ndarray, shape (n,), optional
    """
    gram = np.sum([added @ added.T for added, _ in rows], axis=0)
    right = -np.sum([added @ there for added, there in rows], axis=0)
    if linear is not None:
        right = right - 0.5 * linear
    regular = gram + np.diag(ridge * np.diag(gram) + 1e-12 * np.trace(gram) / len(gram))
    solved: NDArray[np.float64] = np.linalg.solve(regular, right)
    return solved


def _features(run: Recording, plant: Plant, options: FeedbackOptions) -> tuple[NDArray[np.float64], ...]:
    """Features (n_features, n) of mean, tilt and yaw, in the share in which they may act."""
    bins = delay_bins(options.longest, plant.dt)
    past = [
        row if k in _LASTING else without_lasting(row, options.washout, plant.dt)
        for k, row in enumerate(run.outputs[:, :-1] / plant.scale[:, None])
    ]
    mean, turning = (
        run.share * np.concatenate([bin_means(past[k], bins) for k in reads])
        for reads in (_MEAN_READS, _TILT_YAW_READS)
    )
    return mean, turning, turning


def forecast(run: Recording, plant: Plant, offsets: NDArray[np.float64]) -> Forecast:
    """Forecast of a run without offsets under offsets (3, n) [rad]."""
    changed = respond(plant.responses, offsets)
    n_blades = len(run.flap)
    taken = plant.power_curvature * float((offsets**2).sum(0).mean())
    pitch = run.pitch.copy()
    pitch[:, 1:] += to_blades(offsets, plant.pitch_azimuth(run), n_blades)
    return Forecast(
        flap=run.flap + to_blades(changed[:3], run.azimuth, n_blades),
        pitch=pitch,
        tower=run.loads[:2] + changed[list(TOWER)],
        power=float((run.loads[2] + changed[POWER]).mean()) - taken * float(run.loads[2].mean()),
    )


def _columns(run: Recording, plant: Plant, options: FeedbackOptions) -> _Columns:
    """What each feature does to a run."""
    n_blades, length = len(run.flap), round(options.smooth / plant.dt)
    azimuth = plant.pitch_azimuth(run)
    parts = []
    for j, own in enumerate(_features(run, plant, options)):
        changed = np.stack(
            [fftconvolve(own, response[None], axes=1)[:, : run.steps] for response in plant.responses[:, j]], axis=1
        )
        offsets = np.zeros((len(own), 3, run.steps))
        offsets[:, j] = own
        rate = np.diff(to_blades(offsets, azimuth, n_blades), axis=-1, prepend=0.0) / plant.dt
        parts.append(_Columns(
            without_slow(to_blades(changed[:, :3], run.azimuth[1:], n_blades), length),
            without_slow(changed[:, list(TOWER)], length),
            changed[:, OUTPUTS.index("rotor_speed")],
            rate,
            offsets,
            changed[:, POWER].mean(-1) / run.loads[2].mean(),
        ))  # fmt: skip
    return _Columns(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _rows(
    run: Recording,
    columns: _Columns,
    plant: Plant,
    options: FeedbackOptions,
    offsets: NDArray[np.float64],
    turbine: Turbine,
    first: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weighted rows of the quadratic about offsets (3, n), and what they are without any."""
    weights, dt, n_blades = options.weights, plant.dt, len(run.flap)
    length, window = round(options.smooth / dt), round(options.window / dt)
    counts = np.ones(run.steps)
    counts[: round(options.skip / dt)] = 0.0
    samples = counts.sum()
    now = forecast(run, plant, offsets)
    full = turbine.pitch.max_rate

    def load_rows(
        base: NDArray[np.float64], there: NDArray[np.float64], shares: list[float], exponent: float, fatigue: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Square roots of weights (k, n) of loads (k, n + 1) as they are, and loads without offsets."""
        still = without_slow(base[:, 1:], length)
        moved = without_slow(there[:, 1:], length)
        time = float(samples) * dt
        start = run.steps + 1 - int(samples)
        before = np.array([damage_equivalent_load(row[start:], time, fatigue) for row in base])
        after = np.array([damage_equivalent_load(row[start:], time, fatigue) for row in there])
        local = amplitude_weights(moved, 0.0 if first else exponent, window) * counts
        size = (local * moved**2).sum(1)
        factor = 0.5 * np.array(shares) * after / before / size
        return np.sqrt(factor[:, None] * local), still

    flap, flap_there = load_rows(
        run.flap, now.flap, [weights.get("blade_flap_del", 0.0) / n_blades] * n_blades, options.amplitude_exponent,
        BLADE_EXPONENT,
    )  # fmt: skip
    shares = [weights.get(f"tower_{name}_del", 0.0) for name in ("fore_aft", "side_side")]
    tower, tower_there = load_rows(run.loads[:2], now.tower, shares, options.tower_exponent, TOWER_EXPONENT)
    rate_there = np.diff(run.pitch, axis=1) / dt
    rate_now = np.abs(np.diff(now.pitch, axis=1)) / dt
    travel = options.travel_weight * weights.get("pitch_duty_cycle", 0.0) / full / (n_blades * samples)
    rate = np.sqrt(0.5 * travel * counts / (rate_now + options.still))
    speed = np.sqrt(options.speed_weight * counts / samples) / turbine.drivetrain.rated_rotor_speed
    power = -weights.get("captured_power", 0.0) * options.power_weight * plant.power_curvature
    sizes = np.sqrt((np.array([options.mean_weight] + [options.tilt_yaw_weight] * 2) + power) / run.steps)
    size = len(columns.speed)
    added = np.concatenate([
        (columns.flap * flap).reshape(size, -1),
        (columns.tower * tower).reshape(size, -1),
        columns.speed * speed,
        (columns.rate * rate).reshape(size, -1),
        (columns.offsets * sizes[:, None]).reshape(size, -1),
    ], axis=1)  # fmt: skip
    there = np.concatenate([
        (flap * flap_there).ravel(),
        (tower * tower_there).ravel(),
        np.zeros(run.steps),
        (rate * rate_there).ravel(),
        np.zeros(3 * run.steps),
    ])  # fmt: skip
    return added, there


def fit_feedback(
    runs: Sequence[Recording], plant: Plant, turbine: Turbine, options: FeedbackOptions | None = None
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Fit a feedback to runs without offsets.

    Parameters
    ----------
    runs : sequence of Recording
    plant : Plant
    turbine : Turbine
    options : FeedbackOptions, optional

    Returns
    -------
    gains : numpy.ndarray, shape (3, 6, n_delays)
        As of `wt_gym.control.controllers.linear_optimal.LinearDesign`.
    offsets : list of numpy.ndarray, shape (3, n)
        Of each run [rad], without limits.
    """
    options = options or FeedbackOptions()
    features = [_features(run, plant, options) for run in runs]
    columns = [_columns(run, plant, options) for run in runs]
    parts = np.cumsum([len(own) for own in features[0]])[:-1]
    offsets = [np.zeros((3, run.steps)) for run in runs]
    power = -options.weights.get("captured_power", 0.0) * options.power_weight
    found = np.zeros(len(columns[0].speed))
    for number in range(options.passes):
        rows = [
            _rows(run, own, plant, options, now, turbine, first=number == 0)
            for run, own, now in zip(runs, columns, offsets, strict=True)
        ]
        found = minimize_quadratic(rows, options.ridge, -power * np.sum([own.power for own in columns], axis=0))
        of_each = np.split(found, parts)
        offsets = [np.stack([c @ f for c, f in zip(of_each, own, strict=True)]) for own in features]
    bins = delay_bins(options.longest, plant.dt)
    gains = np.zeros((3, len(OUTPUTS), bins[-1][1]))
    for j, (reads, own) in enumerate(
        zip((_MEAN_READS, _TILT_YAW_READS, _TILT_YAW_READS), np.split(found, parts), strict=True)
    ):
        for k, part in zip(reads, np.split(own, len(reads)), strict=True):
            gains[j, k] = spread_over_bins(part, bins)
    return gains, offsets
