"""Offsets for a wind that is known from start to end: what no controller can do, and a measure of what is left to gain.

The offsets are free series in time. On the model of the plant they minimize the quadratic that stands for the cost (see
`wt_gym.learning.linear_design`) by conjugate gradients, weights and all renewed at the loads that the model
forecasts. They are played, and the next offsets are changes of what was measured under them, so that an error of the
model is not carried on: iterative learning control in the lifted domain (Bristow, Tharayil and Alleyne, IEEE Control
Syst. Mag. 26 (2006) 96). The best offsets that were played within all limits count. They are a lower bound of what can
be reached, and an upper one for what reacts to what it measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import uniform_filter1d
from scipy.sparse.linalg import LinearOperator, cg

from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT, damage_equivalent_load
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.controllers.linear_optimal import OUTPUTS
from wt_gym.learning.linear_design import Plant, forecast, forecast_change
from wt_gym.learning.options import FeedbackOptions
from wt_gym.learning.recording import LOADS, Recording, amplitude_weights, respond, to_blades, without_slow
from wt_gym.turbines import Turbine

_SPEED = OUTPUTS.index("rotor_speed")
_ANSWERING = (0, 1, 2, 6, 7, _SPEED)
"""Outputs and loads of the quadratic: flapwise moments, tower, rotor speed."""
_SHARES = (1.0, 0.5, 0.25)
"""Of the way to the minimum of a quadratic, tried one after the other."""
_LULL = (20.0, 10.0, 10.0)
"""Share of the power that mean, tilt and yaw take by their squares where the blades stay at the pitch of the most power
[1/rad^2]: the curvature of the power coefficient; tilt and yaw are amplitudes, whose mean square is half."""
_LULL_BEGINS, _LULL_RANGE, _SPELL = 0.99, 0.04, 5.0
"""Power over the rated one at which lulls begin, range to where they count in full [-], and time of a mean [s]."""
_HEAVIER = 4.0
"""Factor on the weight of what broke a limit."""


_FEEDBACK = FeedbackOptions(speed_weight=5.0, mean_weight=2.0, tilt_yaw_weight=0.01, skip=30.0)
"""Weights where the wind is known: speed and mean offset need not be held back for what is to come."""


@option_record
class OracleOptions(Options):
    """How offsets are learned."""

    title = "oracle"

    feedback: FeedbackOptions = option(
        "weights and exponents of the quadratic; what belongs to a feedback alone is not used", default=_FEEDBACK,
        kinds=(FeedbackOptions,),
    )  # fmt: skip
    limit: float = option("largest offset", default=math.radians(4.0), unit="rad", low=0, above=True)
    rate_limit: float = option("largest rate of offsets", default=math.radians(3.0), unit="rad/s", low=0, above=True)
    passes: int = option("runs with offsets", default=3, low=1)
    renewals: int = option("renewals of the weights between two runs", default=6, low=1)
    iterations: int = option("iterations of conjugate gradients, at most, after each renewal", default=100, low=1)
    tolerance: float = option("their residual over the right-hand side", default=3e-3, low=0, above=True)


def _offset_weights(base: Recording, turbine: Turbine, options: FeedbackOptions) -> NDArray[np.float64]:
    """Cost of the squares of offsets (3, n) [1/rad^2]: those of the options, and of the power that they take in lulls.

    No mean power of a linear model counts: about rated wind it explains too little of it.
    """
    rated = turbine.drivetrain.rated_power
    slow = uniform_filter1d(base.loads[LOADS.index("power"), :-1], max(round(_SPELL / base.dt), 1), mode="nearest")
    below = np.clip((_LULL_BEGINS - slow / rated) / _LULL_RANGE, 0.0, 1.0)
    power = -options.weights.get("captured_power", 0.0) * options.power_weight
    still = np.array([options.mean_weight, options.tilt_yaw_weight, options.tilt_yaw_weight])
    return still[:, None] + power * np.array(_LULL)[:, None] * below


def limited(wanted: NDArray[np.float64], limit: float, rate_limit: float, dt: float) -> NDArray[np.float64]:
    """Offsets (3, n) as limits and rates let them through, beginning at none (`PitchOffsets` without the drives)."""
    out = np.empty_like(wanted)
    reach = rate_limit * dt
    length = np.hypot(wanted[1], wanted[2])
    turning = (wanted[1:] * np.minimum(1.0, limit / np.maximum(length, limit))).T
    mean, last, now = np.clip(wanted[0], -limit, limit), np.zeros(2), 0.0
    for k in range(wanted.shape[1]):
        now += min(max(mean[k] - now, -reach), reach)
        move = turning[k] - last
        size = float(np.hypot(*move))
        last = last + (move if size <= reach else move * reach / size)
        out[0, k], out[1:, k] = now, last
    return out


class LoadQuadratic:
    """The quadratic that touches the cost of a run at a change of its offsets, as rows ``forward(x) + there``.

    Parameters
    ----------
    run : Recording
        With the offsets that are changed.
    base : Recording
        The same wind without offsets: loads are measured in those here, and the rotor speed is held near that here.
    change : numpy.ndarray, shape (3, n), optional
        About which the weights are taken [rad], by default none.
    even : bool
        Weights do not depend on the local amplitude.

    Attributes
    ----------
    there : numpy.ndarray, shape (m,)
        Rows without a change.
    """

    def __init__(
        self, run: Recording, base: Recording, plant: Plant, turbine: Turbine, options: FeedbackOptions,
        change: NDArray[np.float64] | None = None, even: bool = False,
    ) -> None:  # fmt: skip
        weights, dt, n, n_blades = options.weights, plant.dt, run.steps, len(run.flap)
        change = np.zeros((3, n)) if change is None else change
        self.n, self.n_blades, self.dt = n, n_blades, dt
        self._azimuth, self._ahead = run.azimuth[1:], plant.pitch_azimuth(run)
        self._size = fft.next_fast_len(n + plant.responses.shape[-1] - 1, real=True)
        self._responses = fft.rfft(plant.responses[list(_ANSWERING)], self._size)
        length, window = round(options.smooth / dt), round(options.window / dt)
        kernel = np.hanning(2 * (length // 2) + 3)[1:-1]
        kernel /= kernel.sum()
        self._half = kernel.size // 2
        self._smooth_size = fft.next_fast_len(n + kernel.size - 1, real=True)
        self._smooth = fft.rfft(kernel, self._smooth_size)

        counts = np.ones(n)
        counts[: round(options.skip / dt)] = 0.0
        samples = float(counts.sum())
        start = n + 1 - round(samples)
        now = forecast(run, plant, change)

        def roots(
            without: NDArray[np.float64], at: NDArray[np.float64], shares: list[float], exponent: float, fatigue: float
        ) -> NDArray[np.float64]:
            """Square roots of the weights (k, n) of loads (k, n + 1)."""
            moved = without_slow(at[:, 1:], length)
            loads = [[damage_equivalent_load(row[start:], samples * dt, fatigue) for row in x] for x in (without, at)]
            local = amplitude_weights(moved, 0.0 if even else exponent, window) * counts
            factor = 0.5 * np.array(shares) * np.array(loads[1]) / np.array(loads[0]) / (local * moved**2).sum(1)
            return np.sqrt(factor[:, None] * local)

        flap = [weights.get("blade_flap_del", 0.0) / n_blades] * n_blades
        tower = [weights.get(f"tower_{name}_del", 0.0) for name in ("fore_aft", "side_side")]
        self._flap = roots(base.flap, now.flap, flap, options.amplitude_exponent, BLADE_EXPONENT)
        self._tower = roots(base.loads[:2], now.tower, tower, options.tower_exponent, TOWER_EXPONENT)
        rate_now = np.abs(np.diff(now.pitch, axis=1)) / dt
        travel = options.travel_weight * weights.get("pitch_duty_cycle", 0.0) / turbine.pitch.max_rate
        self._rate = np.sqrt(0.5 * travel * counts / (rate_now + options.still) / (n_blades * samples))
        self._speed = np.sqrt(options.speed_weight * counts / samples) / turbine.drivetrain.rated_rotor_speed
        self._sizes = np.sqrt(_offset_weights(base, turbine, options) / n)
        self.there = np.concatenate([
            (self._flap * without_slow(run.flap[:, 1:], length)).ravel(),
            (self._tower * without_slow(run.loads[:2, 1:], length)).ravel(),
            self._speed * (run.outputs[_SPEED, 1:] - base.outputs[_SPEED, 1:]),
            (self._rate * np.diff(run.pitch, axis=1) / dt).ravel(),
            (self._sizes * run.offsets).ravel(),
        ])  # fmt: skip

    def _without_slow(self, series: NDArray[np.float64]) -> NDArray[np.float64]:
        """Series (..., n) without a smooth mean, still beyond its ends; its own transpose."""
        smooth = fft.irfft(fft.rfft(series, self._smooth_size) * self._smooth, self._smooth_size)
        return series - smooth[..., self._half : self._half + self.n]

    def forward(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """What changes (..., 3, n) of the offsets do to the rows (..., m)."""
        inputs = fft.rfft(change, self._size)
        answer = fft.irfft(np.einsum("ijf,...jf->...if", self._responses, inputs), self._size)[..., : self.n]
        head = change.shape[:-2]
        flap = self._flap * self._without_slow(to_blades(answer[..., :3, :], self._azimuth, self.n_blades))
        tower = self._tower * self._without_slow(answer[..., 3:5, :])
        rate = np.diff(to_blades(change, self._ahead, self.n_blades), axis=-1, prepend=0.0) / self.dt
        parts = (flap, tower, self._speed * answer[..., 5, :], self._rate * rate, self._sizes * change)
        return np.concatenate([part.reshape(*head, -1) for part in parts], axis=-1)

    def transposed(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transpose of `forward`: rows (m,) to offsets (3, n)."""
        n, b = self.n, self.n_blades
        flap, tower, speed, rate, sizes = np.split(rows, np.cumsum([b * n, 2 * n, n, b * n]))
        answer = np.concatenate([
            self._to_fixed(self._without_slow(self._flap * flap.reshape(b, n)), self._azimuth),
            self._without_slow(self._tower * tower.reshape(2, n)),
            (self._speed * speed)[None],
        ])  # fmt: skip
        spread = fft.rfft(answer, self._size)
        out = fft.irfft(np.einsum("ijf,if->jf", self._responses.conj(), spread), self._size)[:, :n]
        turned = self._rate * rate.reshape(b, n) / self.dt
        turned = turned - np.concatenate([turned[:, 1:], np.zeros((b, 1))], axis=1)
        return out + self._to_fixed(turned, self._ahead) + self._sizes * sizes.reshape(3, n)

    def _to_fixed(self, blades: NDArray[np.float64], azimuth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transpose of what turns mean, tilt and yaw into blades: (n_blades, n) to (3, n)."""
        angles = azimuth + 2.0 * np.pi / self.n_blades * np.arange(self.n_blades)[:, None]
        return np.stack([blades.sum(0), (blades * np.cos(angles)).sum(0), (blades * np.sin(angles)).sum(0)])

    def minimum(self, iterations: int, tolerance: float) -> NDArray[np.float64]:
        """Change (3, n) with the least sum of squares, by conjugate gradients."""
        shape = (3, self.n)

        def normal(x: NDArray[np.float64]) -> NDArray[np.float64]:
            return self.transposed(self.forward(x.reshape(shape))).ravel()

        right = -self.transposed(self.there).ravel()
        operator = LinearOperator((right.size, right.size), matvec=normal)
        return cg(operator, right, rtol=tolerance, maxiter=iterations)[0].reshape(shape)


def optimal_change(
    run: Recording, base: Recording, plant: Plant, turbine: Turbine, options: OracleOptions, even: bool = False
) -> NDArray[np.float64]:
    """Change (3, n) of the offsets of a run that the model forecasts to be best, within the limits [rad].

    Parameters
    ----------
    run, base, plant, turbine
        As of `LoadQuadratic`.
    even : bool
        Whether the first weights do not depend on the local amplitude.
    """
    feedback, start = options.feedback, round(options.feedback.skip / run.dt)
    weights, sizes = feedback.weights | {"captured_power": 0.0}, _offset_weights(base, turbine, feedback)

    def metrics(of: Recording, change: NDArray[np.float64]) -> dict[str, float]:
        return forecast(of, plant, change).metrics(of.dt, turbine.pitch.max_rate, feedback.skip)

    before = metrics(base, np.zeros((3, run.steps)))

    def cost(change: NDArray[np.float64]) -> float:
        """Cost as the model forecasts it, over that of the run without offsets; power as in `_LULL`."""
        moved = respond(plant.responses[[_SPEED]], change)[0] + run.outputs[_SPEED]
        speed = ((moved - base.outputs[_SPEED])[start:] / turbine.drivetrain.rated_rotor_speed) ** 2
        held = feedback.speed_weight * speed.mean() + (sizes * (run.offsets + change) ** 2).mean(1).sum()
        return forecast_change(metrics(run, change), before, weights) + float(held)

    change = np.zeros((3, run.steps))
    least = cost(change)
    for number in range(options.renewals):
        quadratic = LoadQuadratic(run, base, plant, turbine, feedback, change, even and number == 0)
        aim = quadratic.minimum(options.iterations, options.tolerance) - change
        for share in _SHARES:
            wanted = run.offsets + change + share * aim
            tried = limited(wanted, options.limit, options.rate_limit, plant.dt) - run.offsets
            if (now := cost(tried)) < least:
                break
        else:
            return change
        change, least = tried, now
    return change


class Played(NamedTuple):
    """A run with offsets."""

    run: Recording | None  #: None if it ended before its time
    value: float | None  #: improvement, None if the run ended before its time
    broken: tuple[str, ...]  #: limits that were not kept, or how it ended


def learn_offsets(
    play: Callable[[NDArray[np.float64]], Played],
    base: Played,
    plant: Plant,
    turbine: Turbine,
    options: OracleOptions | None = None,
) -> list[Played]:
    """Learn offsets for one wind by playing them.

    Each pass changes the offsets of the best run so far. Where a limit is broken, what it is about weighs more; where
    a pass is no better, the next one goes half the way.

    Parameters
    ----------
    play : callable
        Plays offsets (3, n) [rad].
    base : Played
        Without offsets.

    Returns
    -------
    list of Played
        The run without offsets first, then every pass.

    Raises
    ------
    ValueError
        If the run without offsets has ended before its time.
    """
    options = options or OracleOptions()
    if base.run is None:
        raise ValueError(f"the run without offsets must last, it ended with {', '.join(base.broken)}")
    passes, best, share = [base], base, 1.0
    for _ in range(options.passes):
        run = base.run if best.run is None else best.run
        change = optimal_change(run, base.run, plant, turbine, options, even=best is base)
        found = play(run.offsets + share * change)
        passes.append(found)
        if found.broken:
            weights = options.feedback
            if found.broken == ("captured_power",):
                heavier = {"power_weight": _HEAVIER * max(weights.power_weight, 1.0)}
            else:  # of a run that ended, rotor speed and mean offset
                heavier = {
                    "speed_weight": _HEAVIER * weights.speed_weight,
                    "mean_weight": _HEAVIER * max(weights.mean_weight, 1.0),
                }
            options = replace(options, feedback=replace(weights, **heavier))
        if best_of([best, found]) is found:
            best, share = found, 1.0
        elif not found.broken:
            share *= 0.5
    return passes


def best_of(passes: list[Played]) -> Played:
    """The pass with the greatest value of those that broke no limit; the first one where all did."""
    kept = [played for played in passes if not played.broken and played.value is not None]
    return max(kept, key=lambda played: played.value or 0.0) if kept else passes[0]
