"""How much of the front a policy with a dial covers: parts of the lifetime cost, and their hypervolume.

A setting of the dial gives a point (fatigue, power, travel): the parts of the lifetime cost
(`wt_gym.analysis.lifetime_cost`) less those of the base controller in the same winds. The hypervolume of several points
is the volume that they dominate up to a reference point (Zitzler and Thiele, IEEE Trans. Evol. Comp. 3, 1999).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.analysis.lifetime_cost import LIFETIME_COST_WEIGHTS
from wt_gym.envs.dial import DIAL_NAMES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

__all__ = ["PARTS", "SETTINGS", "TURNED", "cost_parts", "covered", "hypervolume", "nadir"]

SETTINGS: dict[str, dict[str, float]] = {
    "equal": {}, "fatigue": {"fatigue": 4.0}, "power": {"power": 4.0}, "travel": {"travel": 4.0},
    "little travel": {"travel": 0.25},
}  # fmt: skip
"""Settings that are compared with a policy each."""
TURNED: dict[str, dict[str, float]] = SETTINGS | {"little fatigue": {"fatigue": 0.25}, "little power": {"power": 0.25}}
"""With these each factor is at a quarter, one and four times the others."""
PARTS: dict[str, tuple[str, ...]] = {
    "fatigue": ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del"),
    "power": ("mean_power",),
    "travel": ("pitch_duty_cycle",),
}
"""Metrics of each part of the cost, in the order of `DIAL_NAMES`."""
_WEIGHTS = LIFETIME_COST_WEIGHTS | {"mean_power": LIFETIME_COST_WEIGHTS["captured_power"]}


def cost_parts(metrics: Mapping[str, float], base: Mapping[str, float]) -> NDArray[np.float64]:
    """Parts of the lifetime cost (3,) less those of the base controller.

    Parameters
    ----------
    metrics, base : mapping
        Of `wt_gym.analysis.metrics.run_metrics`, in the same wind.
    """

    def change(name: str) -> float:
        size = 1.0 if name == "pitch_duty_cycle" else base[name]
        return _WEIGHTS[name] * (metrics[name] - base[name]) / size

    return np.array([sum(change(metric) for metric in PARTS[name]) for name in DIAL_NAMES])


def nadir(points: NDArray[np.float64], margin: float = 0.1) -> NDArray[np.float64]:
    """Reference point (k,): the worst of each part, and a margin of its range.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, k)
        Less is better.
    margin : float
    """
    worst: NDArray[np.float64] = points.max(axis=0)
    best: NDArray[np.float64] = points.min(axis=0)
    found: NDArray[np.float64] = worst + margin * (worst - best)
    return found


def covered(dial: Mapping[str, Sequence[float]], single: Mapping[str, Sequence[float]]) -> float:
    """Hypervolume of a policy with a dial over that of policies for single settings.

    Parameters
    ----------
    dial, single : mapping
        Parts of the cost (k,) by name of `SETTINGS`.
    """
    one, several = (np.array([points[name] for name in SETTINGS]) for points in (dial, single))
    reference = nadir(np.vstack([one, several]))
    return hypervolume(one, reference) / hypervolume(several, reference)


def hypervolume(points: NDArray[np.float64] | Sequence[Sequence[float]], reference: NDArray[np.float64]) -> float:
    """Volume that points dominate up to a reference point, less being better.

    Slices across the last part: between two levels of it the area is that of the points below.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, k)
    reference : numpy.ndarray, shape (k,)
    """
    found = np.asarray(points, dtype=np.float64).reshape(-1, len(reference))
    found = found[(found < reference).all(axis=1)]
    if not len(found):
        return 0.0
    if found.shape[1] == 1:
        return float(reference[0] - found.min())
    found = found[np.argsort(found[:, -1])]
    levels = np.append(found[:, -1], reference[-1])
    return float(
        sum(
            (levels[k + 1] - levels[k]) * hypervolume(found[: k + 1, :-1], reference[:-1])
            for k in range(len(found))
            if levels[k + 1] > levels[k]
        )
    )
