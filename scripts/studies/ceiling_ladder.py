"""What information is worth: linear laws fitted to recorded disturbances that know more and more of the wind.

A law gives offsets that are linear in what is known when they are decided. On the model of the plant it is the best one
for the quadratic that stands for the cost (`ceiling_oracle`), fitted in some winds; what it
reaches in others is forecast by the same model, so that nothing but the information tells the rungs apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from ceiling_oracle import LoadQuadratic, limited, optimal_change

from wt_gym.control.controllers.linear_optimal import bin_means, delay_bins, without_lasting
from wt_gym.control.sensors import Lidar
from wt_gym.learning.linear_design import forecast, forecast_change, minimize_quadratic
from wt_gym.wind.inflow import velocity_ahead

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ceiling_oracle import OracleOptions
    from numpy.typing import NDArray

    from wt_gym.learning.linear_design import Plant
    from wt_gym.learning.options import FeedbackOptions
    from wt_gym.learning.recording import Recording
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

PREVIEWS = (0.2, 0.4, 0.6, 1.0, 2.0, 5.0)
"""Times by which loads are known ahead [s]."""
LATENCIES = (0.2, 0.4)
"""Times by which what is measured comes late [s]."""
_MEAN_READS, _TILT_YAW_READS, _LASTING = (0, 3, 5), (1, 2, 4), (1, 2)
"""As of the feedback of `linear_optimal`."""
_GATES = (0.25, 0.5, 1.0, 1.5)
"""Of the lidar, in rotor diameters ahead."""
_LONGEST_LOOK = 12.0
"""Age up to which readings of the lidar count [s]."""
_PASSES = 3


@dataclass(frozen=True)
class Rung:
    """Information of a law."""

    name: str
    lidar: str = "none"
    """``"none"``, ``"mean"`` of the beams at each gate, or ``"beams"``: their differences up and down and aside too."""
    preview: float = 0.0
    """Time by which the disturbances are known ahead, negative where they come late [s]."""


def rungs_of(dt: float) -> list[Rung]:
    """All rungs, from the one that knows least; times that are no multiple of the step [s] are left out."""

    def whole(time: float) -> bool:
        return abs(time / dt - round(time / dt)) < 1e-6

    return [
        *(Rung(f"feedback, {time:g} s late", preview=-time) for time in reversed(LATENCIES) if whole(time)),
        Rung("feedback"),
        Rung("feedback and lidar, mean of the beams", "mean"),
        Rung("feedback and lidar, beams apart", "beams"),
        *(Rung(f"loads {time:g} s ahead", preview=time) for time in PREVIEWS if whole(time)),
    ]


@dataclass(frozen=True)
class Seen:
    """A run without offsets and the readings of a lidar meanwhile."""

    run: Recording
    beams: NDArray[np.float64]
    """Up, to the one side, down, to the other, shape (n_gates, 4, n) [m/s]."""


def beam_readings(inflow: Inflow, lidar: Lidar, times: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """What each beam of a lidar on a nacelle that does not yaw sees, shape (n_gates, n_beams, n_times) [m/s].

    The mean over the beams is what `Lidar.read` gives.
    """
    angle = 2.0 * math.pi * np.arange(lidar.n_beams) / lidar.n_beams
    side = math.tan(lidar.half_angle)
    beams = np.stack([-np.ones(lidar.n_beams), -side * np.sin(angle), side * np.cos(angle)], axis=1)
    points = np.multiply.outer(np.asarray(lidar.ranges), beams) + np.array([0.0, 0.0, height])
    seen = [velocity_ahead(inflow, points, time, lidar.ranges).reshape(points.shape) for time in times.tolist()]
    return -np.einsum("tgbx,bx->gbt", np.array(seen), beams)


def see(run: Recording, turbine: Turbine, inflow: Inflow) -> Seen:
    """Look at the wind of a recording that began with it."""
    lidar = Lidar(tuple(ratio * turbine.rotor_diameter for ratio in _GATES))
    times = run.dt * np.arange(run.steps, dtype=np.float64)
    return Seen(run, beam_readings(inflow, lidar, times, turbine.hub_height))


def _bins(rung: Rung, longest: float, dt: float) -> tuple[tuple[int, int], ...]:
    """Bins of delays behind the newest that is known: fine ones up to half a second behind the present, then wider."""
    ahead = max(round(rung.preview / dt), 0)
    if not ahead:
        return delay_bins(longest, dt)
    step = max(1, math.ceil(ahead / 20))
    fine = [(first, first + step) for first in range(0, ahead + 6, step)]
    last = fine[-1][1]
    return (*fine, *((last + a, last + b) for a, b in delay_bins(longest, dt, fine=0)))


def _features(
    seen: Seen, plant: Plant, rung: Rung, options: FeedbackOptions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Features (n_features, n) of the mean, and of tilt and yaw, in the share in which they may act."""
    run, shift = seen.run, round(rung.preview / plant.dt)
    bins = _bins(rung, options.longest, plant.dt)

    def known(row: NDArray[np.float64]) -> NDArray[np.float64]:
        """What is known at each step: ahead of it, or late; beyond the ends as at them."""
        return row[np.clip(np.arange(run.steps) + shift, 0, row.size - 1)]

    rows = [
        known(row if k in _LASTING else without_lasting(row, options.washout, plant.dt))
        for k, row in enumerate(run.outputs / plant.scale[:, None])
    ]
    mean, turning = ([bin_means(rows[k], bins) for k in reads] for reads in (_MEAN_READS, _TILT_YAW_READS))
    looks = delay_bins(_LONGEST_LOOK, plant.dt, fine=6, growth=1.2)
    if rung.lidar != "none":
        middle = without_lasting(seen.beams.mean(1), options.washout, plant.dt)
        mean += [bin_means(gate, looks) for gate in middle]
    if rung.lidar == "beams":
        for gate in (seen.beams[:, :2] - seen.beams[:, 2:]) / 2.0:
            turning += [bin_means(across, looks) for across in gate]
    return run.share * np.concatenate(mean), run.share * np.concatenate(turning)


def _offsets(
    features: tuple[NDArray[np.float64], NDArray[np.float64]], coefficients: list[NDArray[np.float64]],
    options: OracleOptions, dt: float,
) -> NDArray[np.float64]:  # fmt: skip
    """Offsets (3, n) of a law within the limits [rad]."""
    mean, turning = features
    wanted = np.stack([coefficients[0] @ mean, coefficients[1] @ turning, coefficients[2] @ turning])
    return limited(wanted, options.limit, options.rate_limit, dt)


def _worth(
    runs: Sequence[Seen], plant: Plant, turbine: Turbine, options: FeedbackOptions,
    offsets: Sequence[NDArray[np.float64]],
) -> dict[str, float]:  # fmt: skip
    """Mean improvement by offsets, and the mean changes of what it is made of, as the model forecasts them.

    All changes are relative but that of the duty of the drives, which is none in some winds without offsets.
    """
    full, rated = turbine.pitch.max_rate, turbine.drivetrain.rated_power
    found = []
    for seen, given in zip(runs, offsets, strict=True):
        before, now = (forecast(seen.run, plant, x).metrics(plant.dt, full, options.skip) for x in (0.0 * given, given))
        for metrics in (before, now):
            metrics["captured_power"] = min(metrics["captured_power"], rated)
        changes = {
            key: value - before[key] if key == "pitch_duty_cycle" else value / before[key] - 1.0
            for key, value in now.items()
        }
        found.append({"improvement": -forecast_change(now, before, options.weights)} | changes)
    return {key: float(np.mean([row[key] for row in found])) for key in found[0]}


def climb(
    rung: Rung, fitted: Sequence[Seen], tested: Sequence[Seen], plant: Plant, turbine: Turbine, options: OracleOptions
) -> dict[str, float]:
    """Fit the law of a rung in some winds; give what it is forecast to reach in others.

    Parameters
    ----------
    options : OracleOptions
        Limits, and the weights of the quadratic.

    Returns
    -------
    dict
        ``improvement`` over the runs without offsets, and the change of every metric that is forecast: of the duty of
        the drives as it is, of others relative.
    """
    feedback = options.feedback
    known = [_features(seen, plant, rung, feedback) for seen in fitted]
    sizes = np.cumsum([len(known[0][0]), len(known[0][1])])
    offsets = [np.zeros((3, seen.run.steps)) for seen in fitted]
    coefficients: list[NDArray[np.float64]] = []
    for number in range(_PASSES):
        rows = []
        for seen, own, now in zip(fitted, known, offsets, strict=True):
            quadratic = LoadQuadratic(seen.run, seen.run, plant, turbine, feedback, now, even=number == 0)
            channels = np.eye(3)[[0] * len(own[0]) + [1] * len(own[1]) + [2] * len(own[1])]
            changes = channels[:, :, None] * np.concatenate([own[0], own[1], own[1]])[:, None]
            rows.append((np.array([quadratic.forward(change) for change in changes]), quadratic.there))
        coefficients = np.split(minimize_quadratic(rows, feedback.ridge), sizes)
        offsets = [_offsets(own, coefficients, options, plant.dt) for own in known]
    answers = [_offsets(_features(seen, plant, rung, feedback), coefficients, options, plant.dt) for seen in tested]
    return _worth(tested, plant, turbine, feedback, answers)


def known_wind(tested: Sequence[Seen], plant: Plant, turbine: Turbine, options: OracleOptions) -> dict[str, float]:
    """What offsets for a known wind are forecast to reach, as `climb` gives it: the end of the ladder."""
    answers = [optimal_change(seen.run, seen.run, plant, turbine, options, even=True) for seen in tested]
    return _worth(tested, plant, turbine, options.feedback, answers)
