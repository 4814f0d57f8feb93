"""From a turbine and a base controller to a design of linear optimal pitch: recordings, plants, feedbacks, one file.

A feedback from disturbances follows by least squares on a quadratic that stands for the lifetime cost. Under offsets
that are linear in the disturbances, loads are linear in the coefficients. The cost is not quadratic in the loads, so
each pass takes the quadratic that touches it at the loads of the pass before (iteratively reweighted least squares). Of
a damage-equivalent load L, with weights w that rise with the local amplitude of the load x, and of a travel |r|,

    L ~ L_k (1 + Q/Q_k)/2,  Q = sum w x^2,        |r| ~ (r^2/|r_k| + |r_k|)/2.

Power is linear in the offsets, less a part in proportion to their square, which the excited runs give.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

import wt_gym
from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT, damage_equivalent_load
from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.control.controllers import linear_optimal, make_controller
from wt_gym.control.controllers.linear_optimal import FLOATING_OUTPUTS, OUTPUTS, LinearDesign, PitchOffsets, offset_fade
from wt_gym.experiment.execute import Executor, SerialExecutor
from wt_gym.experiment.run import benchmark_fingerprint
from wt_gym.learning import recording
from wt_gym.learning.options import FeedbackOptions, LinearDesignTask, design_task
from wt_gym.learning.recording import FLOATING_LOADS, LOADS, Recording, RecordingStore, respond, to_blades, without_slow
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.turbines import Turbine

_MEAN_READS, _TILT_YAW_READS = (0, 3, 5, 6, 8), (1, 2, 4, 7)
"""Places in `FLOATING_OUTPUTS` of what the mean offset, and tilt and yaw, answer."""
_LASTING = (1, 2, 6, 7, 8)
"""Outputs whose lasting part is answered: static tilt and yaw of the loads cost fatigue, and no integrator undoes these
offsets; rates of a platform and waves have none."""


@dataclass(frozen=True)
class Plant:
    """Model of a turbine under a base controller about one wind speed."""

    responses: NDArray[np.float64]
    """Of outputs and loads of a `Recording` to offsets [unit/rad]. Shape (n_out + n_loads, 3, n_taps)."""
    scale: NDArray[np.float64]
    """Standard deviations of the outputs that are read. Shape (n_out,)."""
    power_curvature: float
    """Share of power that offsets take by the mean of their square [1/rad^2]."""
    lead: float
    """Time from an offset to the pitch [s]."""
    dt: float
    """[s]."""

    @property
    def tower(self) -> slice:
        """Places of the tower in the responses."""
        return slice(len(self.scale), len(self.scale) + 2)

    @property
    def power(self) -> int:
        """Place of the power."""
        return len(self.scale) + LOADS.index("power")

    @property
    def platform(self) -> slice:
        """Place of the pitch of a platform; empty on land."""
        return slice(self.power + 1, None)

    @property
    def reads(self) -> tuple[tuple[int, ...], ...]:
        """Places of the outputs that mean, tilt and yaw answer."""
        mean, turning = (tuple(k for k in of if k < len(self.scale)) for of in (_MEAN_READS, _TILT_YAW_READS))
        return mean, turning, turning

    def pitch_azimuth(self, run: Recording) -> NDArray[np.float64]:
        """Azimuth (n,) at which offsets reach the blades in a recorded run [rad]."""
        return run.azimuth[:-1] + self.lead * run.outputs[OUTPUTS.index("rotor_speed"), :-1]


@dataclass(frozen=True)
class Forecast:
    """What a recorded run would have been under offsets."""

    flap: NDArray[np.float64]
    pitch: NDArray[np.float64]
    """flap, pitch: [N m], [rad]. Shape (n_blades, n + 1)."""
    tower: NDArray[np.float64]
    """Fore-aft and side-side moment at the base [N m]. Shape (2, n + 1)."""
    power: float
    """Mean [W]."""
    platform: Sequence[NDArray[np.float64]] | NDArray[np.float64] = ()
    """Pitch of a platform [rad]. Shape (1, n + 1), on land nothing."""

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
            **({"platform_pitch_std": float(self.platform[0][start:].std())} if len(self.platform) else {}),
        }


def forecast_change(now: Mapping[str, float], before: Mapping[str, float], weights: Mapping[str, float]) -> float:
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
    platform: NDArray[np.float64]


def minimize_quadratic(
    rows: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
    ridge: float = 0.0,
    linear: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Coefficients q (n,) that minimize the sum of ``|q rows + targets|^2`` over pairs, plus ``linear q`` and a ridge.

    Rows (n, m) are the effects of the coefficients, targets (m,) the values without; the ridge is over the diagonal of
    the normal equations.
    """
    gram = np.sum([added @ added.T for added, _ in rows], axis=0)
    right = -np.sum([added @ there for added, there in rows], axis=0)
    if linear is not None:
        right = right - 0.5 * linear
    regular = gram + np.diag(ridge * np.diag(gram) + 1e-12 * np.trace(gram) / len(gram))
    return np.asarray(np.linalg.solve(regular, right))


def _features(run: Recording, plant: Plant, options: FeedbackOptions) -> tuple[NDArray[np.float64], ...]:
    """Features (n_features, n) of mean, tilt and yaw, in the share in which they may act."""
    bins = linear_optimal.delay_bins(options.longest, plant.dt)
    past = [
        row if k in _LASTING else linear_optimal.without_lasting(row, options.washout, plant.dt)
        for k, row in enumerate(run.outputs[: len(plant.scale), :-1] / plant.scale[:, None])
    ]
    mean, turning = (
        run.share * np.concatenate([linear_optimal.bin_means(past[k], bins) for k in reads])
        for reads in plant.reads[:2]
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
        tower=run.loads[:2] + changed[plant.tower],
        power=float((run.loads[2] + changed[plant.power]).mean()) - taken * float(run.loads[2].mean()),
        platform=run.loads[3:] + changed[plant.platform],
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
            without_slow(changed[:, plant.tower], length),
            changed[:, OUTPUTS.index("rotor_speed")],
            rate,
            offsets,
            changed[:, plant.power].mean(-1) / run.loads[2].mean(),
            changed[:, plant.platform],
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
        local = recording.amplitude_weights(moved, 0.0 if first else exponent, window) * counts
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
    swing, swing_there = (
        series[:, 1:] - np.average(series[:, 1:], axis=1, weights=counts)[:, None]
        for series in (run.loads[3:], np.asarray(now.platform))
    )
    before, size = ((counts * series**2).sum(1) for series in (swing, swing_there))
    platform = np.sqrt(0.5 * weights.get("platform_pitch_std", 0.0) / np.sqrt(before * size))[:, None] * counts
    speed = np.sqrt(options.speed_weight * counts / samples) / turbine.drivetrain.rated_rotor_speed
    power = -weights.get("captured_power", 0.0) * options.power_weight * plant.power_curvature
    sizes = np.sqrt((np.array([options.mean_weight] + [options.tilt_yaw_weight] * 2) + power) / run.steps)
    blocks = [
        (columns.flap * flap, flap * flap_there),
        (columns.tower * tower, tower * tower_there),
        (columns.speed * speed, np.zeros(run.steps)),
        (columns.rate * rate, rate * rate_there),
        (columns.offsets * sizes[:, None], np.zeros(3 * run.steps)),
        (columns.platform * platform, platform * swing),
    ]
    added = np.concatenate([block.reshape(len(block), -1) for block, _ in blocks], axis=1)
    return added, np.concatenate([target.ravel() for _, target in blocks])


def fit_feedback(
    runs: Sequence[Recording], plant: Plant, turbine: Turbine, options: FeedbackOptions
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Fit a feedback to runs without offsets.

    Return gains (3, n_out, n_delays) as of `LinearDesign`, and the offsets (3, n) of each run [rad], without limits.
    """
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
    bins = linear_optimal.delay_bins(options.longest, plant.dt)
    gains = np.zeros((3, len(plant.scale), bins[-1][1]))
    for j, (reads, own) in enumerate(zip(plant.reads, np.split(found, parts), strict=True)):
        for k, part in zip(reads, np.split(own, len(reads)), strict=True):
            gains[j, k] = linear_optimal.spread_over_bins(part, bins)
    return gains, offsets


_SPEED_RATIOS = (1.05, 1.32, 1.58)
"""Winds of the designs over the rated one [-]."""
_LEAST_EXPLAINED = 0.3
"""Share of the changes of power in an unseen run that a linear model must explain to be used [-]."""
_DOUBLINGS = 5
"""Most doublings of the cost of power for its limit."""
_EXCITATION_SEED = 100
"""First seed of the drawn offsets; that of the wind is added."""


def default_speeds(turbine: Turbine) -> tuple[float, ...]:
    """Winds of a design: about rated and above, rounded to half a meter a second."""
    found = dict.fromkeys(round(2.0 * ratio * turbine.rated_wind_speed) / 2.0 for ratio in _SPEED_RATIOS)
    return tuple(speed for speed in found if speed <= turbine.cut_out)


def definition(task: LinearDesignTask, turbine: Turbine, run: tuple[float, int, bool]) -> dict[str, Any]:
    """What decides on a recording, as JSON values."""
    speed, seed, excited = run
    return {
        "fingerprint": benchmark_fingerprint(turbine, task.fidelity),
        "base": task.base,
        "wind": {"speed": speed, "seed": seed},
        "duration": task.duration,
        "fade": asdict(offset_fade(task.fade, task.fine_speed)),
        **({} if turbine.floater is None else {"sea": "of the wind", "misalignment": recording.MISALIGNMENT}),
        "excitation": asdict(task.excitation) | {"limit": task.limit, "rate_limit": task.rate_limit}
        if excited
        else None,
    }


def _make(task: LinearDesignTask, turbine: Turbine, run: tuple[float, int, bool]) -> Recording:
    """Do one run."""
    speed, seed, excited = run
    offsets = PitchOffsets(turbine, task.limit, task.rate_limit, offset_fade(task.fade, task.fine_speed))
    drawn = (task.excitation, _EXCITATION_SEED + seed) if excited else None
    return recording.record(turbine, task.base, Wind(speed, seed), task.duration, offsets, drawn, task.fidelity)


def curvature_of_power(
    responses: NDArray[np.float64], row: int, explained: float,
    offsets: Sequence[NDArray[np.float64]], changes: Sequence[NDArray[np.float64]], power: float,
) -> float:  # fmt: skip
    """Share of power that offsets take by the mean of their square [1/rad^2], not negative: the rest of a linear model.

    Parameters
    ----------
    responses : numpy.ndarray, shape (n_out, 3, n_taps)
        That of power, in a row, becomes zero where it explains too little of an unseen run.
    explained : float
        Share of that.
    offsets : sequence of numpy.ndarray, shape (3, n)
        Of each excited run [rad].
    changes : sequence of numpy.ndarray, shape (n_out, n + 1)
        As of `wt_gym.learning.recording.identify`.
    power : float
        Mean without offsets [W].
    """
    if explained < _LEAST_EXPLAINED:
        responses[row] = 0.0
    linear = responses[row : row + 1]
    lost = sum(float((respond(linear, u)[0] - c[row]).mean()) for u, c in zip(offsets, changes, strict=True))
    squares = sum(float((given**2).sum(0).mean()) for given in offsets)
    return max(lost / power / squares, 0.0)


def n_read(task: LinearDesignTask, turbine: Turbine) -> int:
    """Number of the outputs that a design reads."""
    return len(OUTPUTS) if turbine.floater is None else len(FLOATING_OUTPUTS) - (not task.waves)


def identified_plant(
    task: LinearDesignTask, turbine: Turbine, still: Sequence[Recording], excited: Sequence[Recording]
) -> tuple[Plant, NDArray[np.float64]]:
    """Plant of runs of the same winds without and with drawn offsets.

    Returns
    -------
    plant : Plant
        Fitted to all runs.
    explained : numpy.ndarray, shape (n_out + n_loads,)
        Share of the mean square of the changes in the last run that a fit to the others explains: outputs and loads.
        Where it explains less than `_LEAST_EXPLAINED` of power, offsets have no linear effect on it in the plant, and
        all that they take counts by their square, since power is not linear near rated wind.
    """
    dt = still[0].dt
    taps = round(task.memory / dt)
    inputs, n = [run.offsets for run in excited], n_read(task, turbine)
    power = n + LOADS.index("power")
    changes = [
        np.concatenate([run.outputs[:n] - twin.outputs[:n], run.loads - twin.loads])
        for run, twin in zip(excited, still, strict=False)
    ]
    responses, explained = recording.identify_and_judge(inputs, changes, taps, task.ridge, task.decay)
    skip = round(task.feedback.skip / dt)
    mean = float(np.mean([run.loads[LOADS.index("power")].mean() for run in still]))
    curvature = curvature_of_power(responses, power, explained[power], inputs, changes, mean)
    scale = np.mean([run.outputs[:n, skip:].std(1) for run in still], axis=0)
    return Plant(responses, scale, curvature, pitch_delay(turbine.pitch, dt), dt), explained


def design(
    turbine: Turbine,
    task: LinearDesignTask | None = None,
    store: RecordingStore[Recording] | None = None,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> LinearDesign:
    """Make a design, by default at `default_speeds`, within `default_limits`.

    Parameters
    ----------
    store : RecordingStore, optional
        Its recordings are not made again.
    executor : Executor, optional
        Of `wt_gym.experiment.execute`, entered: does the runs.
    progress : callable, optional
        Called with a line after every run and every feedback.

    Raises
    ------
    ValueError
        If a wind speed lies where no offset acts, or pitch does not rise with the wind speed.
    wt_gym.base.errors.SimulationError
        If a run fails.
    """
    if task is None:
        limit, rate_limit = linear_optimal.default_limits(turbine)
        task = design_task(turbine, speeds=default_speeds(turbine), limit=limit, rate_limit=rate_limit)
    executor = SerialExecutor() if executor is None else executor
    make_controller(task.base, turbine)  # refuses a name before anything runs
    say = progress or (lambda _: None)
    store = store or RecordingStore(None, Recording)
    definitions = {run: definition(task, turbine, run) for run in task.runs}
    found = {task.runs[k]: run for k, run in store.find_all(list(definitions.values())).items()}
    left = [run for run in task.runs if run not in found]
    for run, made in executor.results(partial(_make, task, turbine), left):
        found[run] = made
        store.keep(definitions[run], made)
        how = "with drawn offsets" if run[2] else "without offsets"
        say(f"run {len(found)} of {len(task.runs)}: {run[0]:g} m/s, seed {run[1]}, {how}")
    parts = [_at_speed(task, turbine, speed, found, say) for speed in task.speeds]
    pitch = np.array([part["pitch"] for part in parts])
    if (np.diff(pitch) <= 0.0).any():
        shown = ", ".join(f"{s:g} m/s: {math.degrees(p):.2f}°" for s, p in zip(task.speeds, pitch, strict=True))
        raise ValueError(f"the mean pitch must rise with the wind speed, got {shown}; leave out speeds below rated")
    scale = np.mean([part["scale"] for part in parts], axis=0)
    return LinearDesign(
        pitch=pitch,
        responses=np.stack([part["responses"] / scale[:, None, None] for part in parts]),
        loads=np.stack([part["loads"] for part in parts]),
        gains=np.stack([part["gains"] * (scale / part["scale"])[:, None] for part in parts]),
        scale=scale,
        washout=np.array([0.0 if k in _LASTING else task.feedback.washout for k in range(len(scale))]),
        interval=found[task.runs[0]].dt,
        limit=task.limit,
        rate_limit=task.rate_limit,
        fade=task.fade,
        fine_speed=task.fine_speed,
        record={
            "turbine": turbine.name,
            "version": wt_gym.__version__,
            "fingerprint": benchmark_fingerprint(turbine, task.fidelity),
            "task": asdict(task),
            "speeds": [part["record"] for part in parts],
        },
    )


def _at_speed(
    task: LinearDesignTask,
    turbine: Turbine,
    speed: float,
    found: dict[tuple[float, int, bool], Recording],
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Plant and feedback at one wind speed."""
    still = [found[speed, seed, False] for seed in task.seeds]
    excited = [found[speed, seed, True] for seed in task.seeds[: task.excited]]
    if max(float(run.share.mean()) for run in still) < 0.01:
        raise ValueError(
            f"at {speed:g} m/s no offset acts, because the blades stay at fine pitch; speeds must be near rated "
            f"({turbine.rated_wind_speed:g} m/s) or above"
        )
    plant, explained = identified_plant(task, turbine, still, excited)
    skip, full, options = task.feedback.skip, turbine.pitch.max_rate, task.feedback
    before = [forecast(r, plant, np.zeros((3, r.steps))).metrics(r.dt, full, skip) for r in still]
    for doubled in range(_DOUBLINGS + 1):
        options = replace(task.feedback, power_weight=task.feedback.power_weight * 2.0**doubled)
        gains, offsets = fit_feedback(still, plant, turbine, options)
        now = [forecast(r, plant, u).metrics(r.dt, full, skip) for r, u in zip(still, offsets, strict=True)]
        pairs = list(zip(now, before, strict=True))
        changes = {key: float(np.mean([relative_change(a[key], b[key]) for a, b in pairs])) for key in now[0]}
        if changes["captured_power"] >= task.least_power or options.power_weight == 0.0:
            break
    else:
        raise ValueError(
            f"at {speed:g} m/s offsets must keep power above {100.0 * task.least_power:+.2f} % in the forecast, got "
            f"{100.0 * changes['captured_power']:+.2f} % with {2**_DOUBLINGS} times the cost of power; lower "
            "least_power, or let offsets act less at fine pitch (fade, fine_speed)"
        )
    cost = float(np.mean([forecast_change(a, b, task.feedback.weights) for a, b in pairs]))
    names = (*FLOATING_OUTPUTS[: len(plant.scale)], *FLOATING_LOADS)
    shares = dict(zip(names, np.round(explained, 4).tolist(), strict=False))
    say(
        f"{speed:g} m/s: explained {', '.join(f'{name} {share:.2f}' for name, share in shares.items())}; forecast "
        f"cost {100 * cost:+.1f} %, " + ", ".join(f"{name} {100 * value:+.1f} %" for name, value in changes.items())
    )
    start = round(skip / still[0].dt)
    return {
        "pitch": float(np.mean([run.pitch[:, start:].mean() for run in still])),
        "scale": plant.scale,
        "responses": plant.responses[: len(plant.scale)],
        "loads": plant.responses[plant.tower],
        "gains": gains,
        "record": {
            "speed": speed,
            "explained": shares,
            "power_curvature": plant.power_curvature,
            "power_weight": options.power_weight,
            "forecast": {"cost": cost} | changes,
        },
    }
