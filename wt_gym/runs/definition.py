"""What decides on the numbers of a run."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, fields
from typing import Any

__all__ = ["RunDefinition", "digest"]


def digest(value: Any) -> str:
    """Sixteen hexadecimal digits of the SHA-256 of a JSON value; the order of keys does not matter."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class RunDefinition:
    """Who runs where, in what wind and for how long, and with which code: plain data.

    Runs with the same `to_json` have the same numbers on the same machine. What is None is no part of it.

    Attributes
    ----------
    wind : dict
        Mean speed, seed and what else tells the wind from every other one.
    duration : float
        [s].
    skip : float
        Start left out of the metrics [s].
    fingerprint : dict
        Digests of turbine, fidelity and sources (`wt_gym.benchmark.benchmark_fingerprint`).
    agent : dict, optional
        Tells who acts from everyone else; None where nobody does.
    env_id : str, optional
        None where a simulator runs without an environment.
    env_kwargs : dict, optional
        Arguments besides those of the id.
    interface : dict, optional
        Arguments that the agent chooses.
    faults : list of dict, optional
    azimuth : float, optional
        Of blade 1 at the start [deg].
    seed : int, optional
        Of the environment: what the wind leaves open.
    replay : float, optional
        Length of the end of which shapes are kept [s].
    wind_files : dict, optional
        Digests of the files of wind that the arguments name.
    more : dict
        What a study adds: task and version of the benchmark.
    """

    wind: dict[str, Any]
    duration: float
    skip: float
    fingerprint: dict[str, str]
    agent: dict[str, Any] | None = None
    env_id: str | None = None
    env_kwargs: dict[str, Any] | None = None
    interface: dict[str, Any] | None = None
    faults: list[dict[str, Any]] | None = None
    azimuth: float | None = None
    seed: int | None = None
    replay: float | None = None
    wind_files: dict[str, Any] | None = None
    more: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values, as a file would give it back."""
        parts = {part.name: getattr(self, part.name) for part in fields(self) if part.name != "more"}
        known = {name: value for name, value in parts.items() if value is not None}
        if both := known.keys() & self.more.keys():
            raise ValueError(f"more must not repeat what a run is defined by, got {', '.join(sorted(both))}")
        known |= self.more
        values: dict[str, Any] = json.loads(json.dumps(known, default=str))
        return values

    @property
    def digest(self) -> str:
        """Short name of the run."""
        return digest(self.to_json())
