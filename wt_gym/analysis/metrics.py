"""Performance and loads of a run, as a wind engineer reads them.

Damage-equivalent loads follow the linear damage rule (Palmgren-Miner) with rainflow cycles by ASTM E1049; see IEC
61400-1, annex G, and Hayman, MLife Theory Manual, NREL (2012).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rainflow
from numpy.typing import NDArray
from scipy import signal as scipy_signal

from wt_gym.base.files import read_rows
from wt_gym.control.design import rotor_inertia
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    import xarray as xr


BLADE_EXPONENT = 10.0
"""Woehler exponent of the composite blade root."""
TOWER_EXPONENT = 4.0
"""Woehler exponent of the welded steel tower base."""
_ROTOR_TIME = 5.0
"""Time constant with which the available power is smoothed [s]."""
IDLE_ATTRIBUTE = "idle_time_s"
"""Attribute of recorded signals: `wt_gym.envs.terminations.IdleClock.total` [s]."""
TOWER_DIRECTIONS = 12
"""Directions over half a turn in which the bending of the tower base is looked at."""


@dataclass(frozen=True)
class Metric:
    """Name and form of a figure of merit."""

    label: str
    unit: str
    """As shown."""
    factor: float
    """From SI to the shown unit."""
    better: int
    """+1 if more is better, -1 if less is, 0 if neither."""
    digits: int
    """Decimals to show."""
    over_winds: str = "mean"
    """Value over several winds, "mean", "max", "min" or "sum": extremes stay extremes, events are counted."""
    share: bool = True
    """A change may be a share of a reference. Not of counts, and margins with a sign: a clearance from 0.1 to 0.3 m is
    0.2 m more, not 200 %."""


_FACTORS = {
    "MW": 1e-6, "MWh": 1 / 3.6e9, "kW": 1e-3, "rpm": 30 / np.pi, "deg": 180 / np.pi, "MN m": 1e-6, "kN m/s": 1e-3,
    "m": 1.0, "%": 100.0, "-": 1.0,
}  # fmt: skip
"""From SI to the units of the table of metrics."""


METRICS = {
    row["name"]: Metric(
        row["label"], row["unit"], _FACTORS[row["unit"]], int(row["better"]), int(row["digits"]),
        row["over_winds"], row["share"] == "1",
    )
    for row in read_rows(Path(__file__).with_name("metrics.csv"))
}  # fmt: skip
TRACKING_METRICS = tuple(METRICS)[tuple(METRICS).index("tracking_rms") :]
"""Metrics that only runs with a power reference have."""
PLATFORM_METRICS = ("platform_pitch_mean", "platform_pitch_std", "platform_tilt_max")
"""Metrics that only runs of floating turbines have."""
LIMIT_METRICS = ("limits_violated",)
"""Metrics that only runs with limits of costs have."""


COLUMN_HEADS = {row["name"]: row["head"] for row in read_rows(Path(__file__).with_name("column_heads.csv"))}
"""Short names of metrics, heads of the columns of tables."""


def metric_of(key: str | Metric) -> Metric:
    """The metric of a key of `METRICS`, or the metric itself."""
    return METRICS[key] if isinstance(key, str) else key


def measured_metrics(tables: Iterable[Mapping[str, float]]) -> tuple[str, ...]:
    """Keys of `METRICS` without those of tracked power, platforms and limits where no table of a run has them."""
    present, special = (
        {key for table in tables for key in table},
        (*TRACKING_METRICS, *PLATFORM_METRICS, *LIMIT_METRICS),
    )
    return tuple(key for key in METRICS if key not in special or key in present)


def idle_time(run: xr.Dataset) -> float:
    """Time of a recorded run in which the turbine made no power without a reason [s]; 0 where it was not recorded."""
    return float(run.attrs.get(IDLE_ATTRIBUTE, 0.0))


def idle_sentence(agent: str, spells: Iterable[tuple[str, float]]) -> str | None:
    """Sentence on runs without power, None where there are none; of names of winds and the `idle_time` of runs [s]."""
    cases = [f"{time:.0f} s in {wind}" for wind, time in spells if time > 0.0]
    if not cases:
        return None
    more = f" and in {len(cases) - 4} more winds" if len(cases) > 4 else ""
    return (
        f"{agent} made no power for {', '.join(cases[:4])}{more}, although the wind was above cut-in and nothing had "
        "stopped the turbine."
    )


def damage_equivalent_load(signal: NDArray[np.float64], duration: float, exponent: float) -> float:
    """Range of the constant-amplitude load at 1 Hz that does the damage of a signal, in its unit; zero for a constant.

    ``DEL = (sum n_i S_i^m / N_eq)^(1/m)`` over rainflow cycles of range S_i and count n_i (1, or 0.5 for what is left
    open), with N_eq = duration in seconds.

    Parameters
    ----------
    signal : numpy.ndarray, shape (n,)
        Load history, evenly sampled, finite.
    duration : float
        Time it spans [s].
    exponent : float
        Woehler exponent m [-].
    """
    signal = np.asarray(signal, dtype=np.float64)
    if signal.ndim != 1 or not np.isfinite(signal).all():
        raise ValueError(f"a load history must be one-dimensional and finite, got shape {signal.shape}")
    if not (duration > 0 and exponent > 0):
        raise ValueError(f"duration and exponent must be positive, got {duration!r} s and {exponent!r}")
    cycles = np.array([(span, count) for span, _, count, _, _ in rainflow.extract_cycles(signal)]).reshape(-1, 2)
    largest = cycles[:, 0].max(initial=0.0)
    if largest == 0.0:
        return 0.0
    # Relative to the largest range: 1e8 to the tenth power would waste the digits of a float.
    damage = np.sum(cycles[:, 1] * (cycles[:, 0] / largest) ** exponent) / duration
    return float(largest * damage ** (1.0 / exponent))


def _worst_direction(channel: Callable[[str], NDArray[np.float64]], duration: float) -> float:
    """Largest damage-equivalent load of the tower base over `TOWER_DIRECTIONS` that are fixed to the ground [N m].

    A point of the wall stays where it is while the nacelle turns: it feels the bending moment about one fixed axis,
    cos(a) M_x + sin(a) M_y. The first axis is that of the nacelle at the start, so that the result does not depend on
    where the wind comes from; between two neighbors a load in one direction reads 0.9 % low at most.
    """
    x, y, first = channel("tower_base_moment_x"), channel("tower_base_moment_y"), channel("yaw")[0]
    angles = first + np.pi * np.arange(TOWER_DIRECTIONS) / TOWER_DIRECTIONS
    return max(damage_equivalent_load(np.cos(a) * x + np.sin(a) * y, duration, TOWER_EXPONENT) for a in angles)


def _tracking(channel: Callable[[str], NDArray[np.float64]], turbine: Turbine, step: float) -> dict[str, float]:
    """Metrics of a demanded power; the available one is smoothed, as a rotor smooths it.

    Without a time in which the wind allows what is demanded, the error in such times is that of all.
    """
    power, demanded = channel("generator_power"), channel("demanded_power")
    available = _smoothed(channel("available_power"), step)
    error, saturated = power - demanded, available < demanded
    rms = float(np.sqrt(np.mean(error**2)))
    in_wind = error if saturated.all() else error[~saturated]
    return {
        "tracking_rms": rms,
        "tracking_mean": float(np.abs(error).mean()),
        "tracking_rms_share": rms / turbine.drivetrain.rated_power,
        "tracking_rms_in_wind": float(np.sqrt(np.mean(in_wind**2))),
        "saturated_share": float(saturated.mean()),
        "demanded_energy": float(power.sum() / demanded.sum()) if demanded.any() else 1.0,
    }


def _platform(channel: Callable[[str], NDArray[np.float64]]) -> dict[str, float]:
    """Metrics of a floating platform."""
    pitch = channel("platform_pitch")
    return {
        "platform_pitch_mean": float(pitch.mean()),
        "platform_pitch_std": float(pitch.std()),
        "platform_tilt_max": float(np.hypot(pitch, channel("platform_roll")).max()),
    }


def _smoothed(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Values behind a first-order filter of `_ROTOR_TIME`."""
    gain, out, last = -np.expm1(-step / _ROTOR_TIME), np.empty_like(values), float(values[0])
    for k, value in enumerate(values.tolist()):
        last += gain * (value - last)
        out[k] = last
    return out


def run_metrics(run: xr.Dataset, turbine: Turbine, skip: float = 0.0) -> dict[str, float]:
    """Figures of merit of a recorded run.

    Parameters
    ----------
    run : xarray.Dataset
        Channels over the coordinate ``time`` [s], SI units, evenly sampled.
    turbine : Turbine
        For rated values and limits.
    skip : float
        Length of the start to leave out [s], in which the wake still forms.

    Returns
    -------
    dict
        Keys of `METRICS`, SI units. The corrected power is the mean electrical power plus the kinetic energy that rotor
        and generator gained over the time measured, divided by that time. Blade loads are those of the worst blade.
        Largest and smallest values are those of the structural steps, which the channels ``*_max`` and ``*_min`` hold
        since the sample before. Fore-aft and side-side loads of the tower are those in the axes of the nacelle, which
        turn with it: what a controller sees and acts on. "tower_del" is what a point of the tower bears. Those of
        `TRACKING_METRICS` are there where the run has the channels "demanded_power" and "available_power", those of
        `PLATFORM_METRICS` where the turbine floats; those of `LIMIT_METRICS` are not in the signals.

    Raises
    ------
    ValueError
        If less than two samples are left or the sampling is uneven.
    """
    kept = run["time"].values >= run["time"].values[0] + skip - 1e-9
    before = run.isel(time=~kept)
    run = run.isel(time=kept)
    time = run["time"].values
    if time.size < 2:
        raise ValueError(f"metrics need at least two samples after the first {skip} s, got {time.size}")
    step = float(np.diff(time).mean())
    if not np.allclose(np.diff(time), step, rtol=1e-3):
        raise ValueError("metrics need evenly sampled signals")
    # Each sample stands for one step, so that n samples last n steps.
    duration = time.size * step
    blades = range(1, turbine.n_blades + 1)

    def channel(name: str) -> NDArray[np.float64]:
        return run[name].values.astype(np.float64)

    def worst_del(name: str) -> float:
        return max(damage_equivalent_load(channel(f"{name}_{b}"), duration, BLADE_EXPONENT) for b in blades)

    # the state that the first step began with, where the run has it
    start = before.isel(time=-1) if before.sizes["time"] else run.isel(time=0)
    power, speed, fastest = channel("generator_power"), channel("rotor_speed"), channel("rotor_speed_max")
    fore_aft, side_side = channel("tower_base_fore_aft_moment"), channel("tower_base_side_side_moment")
    travel = np.mean([channel(f"pitch_travel_{b}") for b in blades], axis=0).sum()
    stored = 0.5 * rotor_inertia(turbine) * (speed[-1] ** 2 - float(start["rotor_speed"]) ** 2)
    torque_rate = np.diff(channel("generator_torque")) / step
    over = fastest > 1.1 * turbine.drivetrain.rated_rotor_speed
    tracking = _tracking(channel, turbine, step) if "demanded_power" in run else {}
    return {
        "mean_power": float(power.mean()),
        "corrected_power": float(power.mean() + stored / (time[-1] - float(start["time"]))),
        "energy": float(power.mean() * duration),
        "power_std": float(power.std()),
        "rotor_speed_mean": float(speed.mean()),
        "rotor_speed_std": float(speed.std()),
        "rotor_speed_max": float(fastest.max()),
        "overspeed_count": float(over[0] + np.count_nonzero(over[1:] & ~over[:-1])),
        "blade_flap_del": worst_del("root_flap_moment"),
        "blade_edge_del": worst_del("root_edge_moment"),
        "blade_flap_max": max(float(channel(f"root_flap_moment_max_{b}").max()) for b in blades),
        "tip_deflection_max": max(float(channel(f"tip_out_of_plane_max_{b}").max()) for b in blades),
        "tip_clearance_min": min(float(channel(f"tip_clearance_min_{b}").min()) for b in blades),
        "tower_fore_aft_del": damage_equivalent_load(fore_aft, duration, TOWER_EXPONENT),
        "tower_side_side_del": damage_equivalent_load(side_side, duration, TOWER_EXPONENT),
        "tower_del": _worst_direction(channel, duration),
        "tower_base_max": float(channel("tower_base_moment_max").max()),
        "pitch_duty_cycle": float(travel / duration / turbine.pitch.max_rate),
        "pitch_travel": float(travel),
        "yaw_travel": float(np.abs(channel("yaw_rate")).sum() * step),
        "time_without_power": float(np.mean(power < 1e-3 * turbine.drivetrain.rated_power)),
        "time_at_standstill": float(np.mean(speed < 0.1 * turbine.drivetrain.rated_rotor_speed)),
        "torque_rate": float(np.sqrt(np.mean(torque_rate**2))),
        **(_platform(channel) if "platform_pitch" in run else {}),
        **tracking,
    }


def power_spectral_density(
    signal: NDArray[np.float64], time_step: float, segment_duration: float = 60.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One-sided power spectral density by Welch's method.

    Segments with a Hann window overlap by half; the mean of each is removed. Welch, IEEE Trans. Audio Electroacoustics
    15 (1967) 70.

    Parameters
    ----------
    signal : numpy.ndarray, shape (n,)
        Evenly sampled, at least eight.
    time_step, segment_duration : float
        [s]; the length of a segment, cut to that of the signal, is the inverse of the resolution in frequency.

    Returns
    -------
    frequency : numpy.ndarray, shape (m,)
        Without zero [Hz].
    density : numpy.ndarray, shape (m,)
        Unit of the signal squared per Hz; its integral over frequency is the variance.
    """
    signal = np.asarray(signal, dtype=np.float64)
    if signal.ndim != 1 or signal.size < 8 or not time_step > 0:
        raise ValueError(
            f"a spectrum needs at least 8 samples and a positive time step, got {signal.shape}, {time_step!r} s"
        )
    samples = min(signal.size, max(8, round(segment_duration / time_step)))
    frequency, density = scipy_signal.welch(signal, fs=1.0 / time_step, nperseg=samples, detrend="constant")
    return frequency[1:], density[1:]


def mean_spectrum(runs: Iterable[xr.Dataset], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [Hz] and mean power spectral density of a signal, over those runs that last as long as the longest.

    Runs are at least 8 samples of a ``time`` [s].
    """
    spectra = [power_spectral_density(run[name].values, float(np.diff(run["time"].values).mean())) for run in runs]
    frequency = max((frequency for frequency, _ in spectra), key=len)
    return frequency, np.mean([density for _, density in spectra if density.size == frequency.size], axis=0)


LIFETIME_COST_WEIGHTS = {
    "captured_power": -1.0,
    "blade_flap_del": 0.2,
    "blade_edge_del": 0.05,
    "tower_fore_aft_del": 0.15,
    "tower_side_side_del": 0.05,
    "pitch_duty_cycle": 0.1,
    "torque_rate": 0.05,
}
"""Change of the cost of energy by a relative change of each metric of `wt_gym.experiment.run.benchmark_metrics`.

One per cent of energy is worth one per cent of the cost. A load that rises by one per cent asks for about as much more
material where fatigue decides: the weights are about the shares of blades and tower in the cost of a turbine (some 20 %
each: Fingersh, Hand and Laxson, NREL/TP-500-40566). What a drive does counts over its full use, not relative to the
baseline: the full use of the pitch drive, day and night, costs a tenth of the turbine. The tasks of the benchmark are
frozen and hold these numbers in their files.
"""
FLOATING_COST_WEIGHTS = {**LIFETIME_COST_WEIGHTS, "platform_pitch_std": 0.1}
"""The same with the pitch of a floating platform, which wears lines and cable: half as much as the tower."""
