"""What load cases come to: characteristic and design loads, loads over a life, and who came through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.analysis.statistics import LIFETIME_EXPONENTS, lifetime_load, wind_weights
from wt_gym.experiment.loadcases.cases import CASES, DEFLECTION_FACTOR, EXTRAPOLATION
from wt_gym.experiment.loadcases.run import COMPLETE

if TYPE_CHECKING:
    from wt_gym.analysis.statistics import WindClimate
    from wt_gym.experiment.loadcases.cases import Condition

__all__ = ["CLEARANCE", "PARKED", "SPEED", "CaseRun", "LoadCaseResults", "Value"]

PARKED = "no controller"
"""Name in place of an agent's where nobody controls."""
CLEARANCE, SPEED = "tip_clearance_min", "rotor_speed_max"
_EXTRAPOLATED = ("blade_flap_max", "blade_edge_max", CLEARANCE)


@dataclass(frozen=True)
class CaseRun:
    """A run and what came of it.

    Attributes
    ----------
    agent : str
    condition : Condition
    result : dict
        As `wt_gym.experiment.loadcases.run.run_agent` gives it.
    """

    agent: str
    condition: Condition
    result: dict[str, Any]

    @property
    def complete(self) -> bool:
        """Whether it went as planned."""
        return self.result["ending"] in COMPLETE


@dataclass(frozen=True)
class Value:
    """An extreme of a case.

    Attributes
    ----------
    characteristic, design : float
        Without and with the factors.
    where : str
        The condition that is worst.
    """

    characteristic: float
    design: float
    where: str


@dataclass(frozen=True)
class LoadCaseResults:
    """Runs of several agents in the same cases.

    Attributes
    ----------
    turbine : str
    cases : tuple of str
        Numbers of the cases.
    agents : tuple of str
        In the order given, without `PARKED`.
    runs : dict
        Runs by case and agent; those of a parked turbine under `PARKED`.
    climate : WindClimate or None
        How often each wind blows; None where the turbine has no class.
    settings : dict
        How it was made, JSON values.
    """

    turbine: str
    cases: tuple[str, ...]
    agents: tuple[str, ...]
    runs: dict[tuple[str, str], list[CaseRun]]
    climate: WindClimate | None
    settings: dict[str, Any]

    def rows(self) -> list[tuple[str, str]]:
        """Case and agent of each row of a table."""
        names = (*self.agents, PARKED)
        return [(case, agent) for case in self.cases for agent in names if (case, agent) in self.runs]

    def survived(self, case: str, agent: str) -> tuple[int, int]:
        """How many runs went as planned, and how many there are."""
        runs = self.runs[case, agent]
        return sum(run.complete for run in runs), len(runs)

    def failures(self, case: str, agent: str) -> dict[str, list[CaseRun]]:
        """Runs that did not go as planned, by how they ended."""
        found: dict[str, list[CaseRun]] = {}
        for run in self.runs[case, agent]:
            if not run.complete:
                found.setdefault(run.result["ending"], []).append(run)
        return found

    def value(self, case: str, agent: str, key: str) -> Value | None:
        """Extreme of a case with and without the factors.

        A load is multiplied by γ_f (in DLC 1.1 after its extrapolation), the rotor speed by nothing. Of the clearance
        c the deflection from the unloaded clearance c₀ counts: c₀ − γ_f γ_m (c₀ − c).

        Parameters
        ----------
        case, agent : str
        key : str
            Of `wt_gym.experiment.loadcases.run.EXTREMES`.

        Returns
        -------
        Value or None
            None where fatigue counts, nothing was measured, or the case says nothing about the quantity: loads other
            than those of the blades where they are extrapolated, and the clearance of a parked rotor.
        """
        kind = CASES[case]
        worst = self._worst(case, agent, key)
        if kind.fatigue or worst is None:
            return None
        characteristic, where = worst
        if key == SPEED:
            return Value(characteristic, characteristic, where)
        if (kind.extrapolated and key not in _EXTRAPOLATED) or (key == CLEARANCE and agent == PARKED):
            return None
        factor = cast(float, kind.factor) * (EXTRAPOLATION if kind.extrapolated else 1.0)
        if key != CLEARANCE:
            return Value(characteristic, factor * characteristic, where)
        unloaded = max(run.result["unloaded_clearance"] or -math.inf for run in self.runs[case, agent])
        deflection = unloaded - characteristic
        return Value(characteristic, unloaded - factor * DEFLECTION_FACTOR * deflection, where)

    def _worst(self, case: str, agent: str, key: str) -> tuple[float, str] | None:
        """Characteristic value of a case and where it comes from."""
        sign = -1.0 if key == CLEARANCE else 1.0
        groups: dict[tuple[Any, ...], list[tuple[float, CaseRun]]] = {}
        for run in self.runs[case, agent]:
            if run.result["extremes"] is not None:
                groups.setdefault(run.condition.group, []).append((sign * run.result["extremes"][key], run))
        if not groups:
            return None
        means = {}
        for group, found in groups.items():
            values = np.sort([value for value, _ in found])[::-1]
            means[group] = values[: math.ceil(0.5 * len(values))].mean() if CASES[case].larger_half else values.mean()
        group = max(means, key=means.__getitem__)
        return float(sign * means[group]), groups[group][0][1].condition.name

    def lifetime(self, agent: str, key: str) -> float | None:
        """Damage-equivalent load at 1 Hz over the life of the climate, of the runs of DLC 1.2 [N m].

        At one mean wind speed the damage of all seeds counts: the mean of their L^m. γ_f is 1.

        Parameters
        ----------
        agent : str
        key : str
            Of `wt_gym.analysis.statistics.LIFETIME_EXPONENTS`.

        Returns
        -------
        float or None
            None without DLC 1.2, a climate, or a complete run at each speed.
        """
        runs = self.runs.get(("1.2", agent))
        if not runs or self.climate is None or not all(run.complete for run in runs):
            return None
        exponent, speeds = LIFETIME_EXPONENTS[key], sorted({run.condition.speed for run in runs})
        loads = []
        for speed in speeds:
            values = np.array([run.result["fatigue"][key] for run in runs if run.condition.speed == speed])
            loads.append(lifetime_load(values, np.full(len(values), 1.0 / len(values)), exponent))
        return float(lifetime_load(np.array(loads), wind_weights(self.climate, speeds), exponent))

    def to_json(self) -> dict[str, Any]:
        """Everything but the signals, as JSON values."""
        from wt_gym.experiment.loadcases.run import EXTREMES

        table = []
        for case, agent in self.rows():
            passed, planned = self.survived(case, agent)
            values = {key: self.value(case, agent, key) for key in EXTREMES}
            table.append({
                "case": case, "agent": agent, "runs": planned, "complete": passed,
                "endings": {end: len(runs) for end, runs in self.failures(case, agent).items()},
                "failures": sorted({run.result["failure"] for runs in self.failures(case, agent).values()
                                    for run in runs if run.result["failure"]}),
                "extremes": {key: value and vars(value) for key, value in values.items()},
            })  # fmt: skip
        lifetime = {a: {key: self.lifetime(a, key) for key in LIFETIME_EXPONENTS} for a in self.agents}
        return {"turbine": self.turbine, "settings": self.settings, "cases": table, "lifetime": lifetime}
