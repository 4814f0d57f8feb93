"""The same agents in the same winds in two simulators: do their effects agree?"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import spearmanr

from wt_gym.analysis.change import relative_change
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.paired import paired_change
from wt_gym.analysis.spectra import power_spectral_density

if TYPE_CHECKING:
    import xarray as xr

    from wt_gym.analysis.paired import Estimate
    from wt_gym.analysis.results import Evaluation, Wind

__all__ = ["COMPARED", "SERIES", "Crosscheck"]

COMPARED = (
    "blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del", "pitch_travel", "mean_power",
)  # fmt: skip
"""Metrics whose changes are compared."""

SERIES = ("wind_x", "rotor_speed", "pitch_1", "root_flap_moment_1", "tower_base_fore_aft_moment", "generator_power")
"""Signals that are laid over each other."""

_LEAST_FOR_RANKS = 3
_SHARED = 0.5
"""Part of a time step by which the instants of two samples that are taken as one may differ."""


def _finite(value: float) -> float | None:
    """A number as JSON has it, which has no NaN."""
    return value if math.isfinite(value) else None


def _plain(change: Estimate | None) -> dict[str, Any] | None:
    """A change as JSON has it."""
    if change is None:
        return None
    return {key: _finite(value) if isinstance(value, float) else value for key, value in asdict(change).items()}


@dataclass(frozen=True)
class Crosscheck:
    """Two evaluations of the same agents in the same winds.

    Attributes
    ----------
    names : (str, str)
        Of the simulators.
    evaluations : (Evaluation, Evaluation)
        The first is the one that the agents were made with.

    Raises
    ------
    ValueError
        If agents, winds or baseline are not the same.
    """

    names: tuple[str, str]
    evaluations: tuple[Evaluation, Evaluation]

    def __post_init__(self) -> None:
        first, second = self.evaluations
        for what in ("agents", "winds", "baseline"):
            ours, theirs = getattr(first, what), getattr(second, what)
            if ours != theirs:
                raise ValueError(f"{what} of both evaluations must be the same, got {ours} and {theirs}")

    @property
    def baseline(self) -> str:
        """Agent that the others are compared with, in each simulator for itself."""
        return self.evaluations[0].baseline

    @property
    def agents(self) -> list[str]:
        """All but the baseline."""
        return [name for name in self.evaluations[0].agents if name != self.baseline]

    @property
    def speeds(self) -> list[float]:
        """Mean wind speeds, ascending [m/s]."""
        return self.evaluations[0].speeds

    def changes(self, agent: str, key: str, speed: float | None = None) -> tuple[Estimate | None, Estimate | None]:
        """Change of a metric against the baseline, in both simulators.

        Parameters
        ----------
        agent, key : str
        speed : float, optional
            Mean wind speed [m/s]; by default all.
        """
        first, second = (paired_change(each, agent, key, speed) for each in self.evaluations)
        return first, second

    def level(self, key: str, speed: float | None = None) -> float:
        """Metric of the baseline in the first simulator over that in the second, minus one."""
        first, second = (each.overall_metrics(self.baseline, speed).get(key, math.nan) for each in self.evaluations)
        return float(relative_change(first, second))

    def rank_correlation(self, key: str, speed: float | None = None) -> float:
        """Spearman's rank correlation of the agents' changes, the baseline's being zero; NaN for fewer than three.

        One says that both simulators put the agents into the same order.
        """
        pairs = [self.changes(agent, key, speed) for agent in self.agents]
        values = [(0.0, 0.0)] + [(a.value, b.value) for a, b in pairs if a is not None and b is not None]
        table = np.array(values)
        if len(table) < _LEAST_FOR_RANKS or not np.ptp(table, axis=0).all():
            return math.nan
        return float(spearmanr(table[:, 0], table[:, 1]).statistic)

    @cached_property
    def skip(self) -> float:
        """Start of the runs that is left out [s]."""
        return float(self.evaluations[0].settings["skip"])

    def common(self, agent: str, wind: Wind) -> tuple[xr.Dataset, xr.Dataset]:
        """Signals of both runs after the skipped start, as long as both lasted."""
        first, second = (each.run(agent, wind).data for each in self.evaluations)
        end = min(float(data.time[-1]) for data in (first, second))
        step = float(first.time[1] - first.time[0])
        span = slice(self.skip - _SHARED * step, end + _SHARED * step)
        return first.sel(time=span), second.sel(time=span)

    def sample_correlation(self, agent: str, name: str) -> float:
        """Mean over the winds of the correlation of a signal in both simulators, sample by sample."""
        found = []
        for wind in self.evaluations[0].winds:
            first, second = (data[name].values for data in self.common(agent, wind))
            if min(first.size, second.size) > 1 and first.std() > 0.0 and second.std() > 0.0:
                found.append(float(np.corrcoef(first, second)[0, 1]))
        return float(np.mean(found)) if found else math.nan

    def spectra(self, agent: str, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequencies [Hz] and the mean power spectral densities of a signal in both simulators."""
        frequency, sums = np.zeros(0), [np.zeros(0), np.zeros(0)]
        for wind in self.evaluations[0].winds:
            for k, data in enumerate(self.common(agent, wind)):
                step = float(data.time[1] - data.time[0])
                frequency, density = power_spectral_density(data[name].values, step)
                sums[k] = sums[k] + density if sums[k].size == density.size else density
        count = len(self.evaluations[0].winds)
        return frequency, sums[0] / count, sums[1] / count

    def to_json(self) -> dict[str, Any]:
        """All numbers of the page: changes with their intervals, levels and correlations."""
        return self._content

    @cached_property
    def _content(self) -> dict[str, Any]:
        rows = []
        for speed in (*self.speeds, None):
            for key in COMPARED:
                row: dict[str, Any] = {"wind_speed": speed, "metric": key, "level": _finite(self.level(key, speed))}
                row["rank_correlation"] = _finite(self.rank_correlation(key, speed))
                row["changes"] = {
                    agent: [_plain(change) for change in self.changes(agent, key, speed)] for agent in self.agents
                }
                rows.append(row)
        samples = {
            agent: {name: _finite(self.sample_correlation(agent, name)) for name in SERIES}
            for agent in (self.baseline, *self.agents)
        }
        return {
            "simulators": list(self.names),
            "baseline": self.baseline,
            "turbine": self.evaluations[0].turbine,
            "settings": [each.settings for each in self.evaluations],
            "winds": [wind.label for wind in self.evaluations[0].winds],
            "metrics": rows,
            "units": {key: METRICS[key].label for key in COMPARED},
            "baseline_metrics": [
                {key: value for key, value in each.overall_metrics(self.baseline).items() if key in COMPARED}
                for each in self.evaluations
            ],
            "sample_correlation": samples,
            "idle": [list(each.idle_sentences.values()) for each in self.evaluations],
        }
