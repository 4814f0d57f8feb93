"""Everything besides task and agent on which the numbers of a run depend: turbine, fidelity, code, record of the start.

Results can be compared only where all of them are the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.base.sources import sources_digest
from wt_gym.envs.record_store import user_record_digest
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity

if TYPE_CHECKING:
    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["benchmark_fingerprint", "differing"]

_EPISODE = ("wt_gym.experiment.pool", "wt_gym.benchmark.run", "wt_gym.runs.playing", "wt_gym.tasks")
"""Modules that make the agents, play an episode and measure it; they import the environment and the simulator. The
first is named, not imported: the agents stand above the benchmark."""


def benchmark_fingerprint(turbine: Turbine, fidelity: str | Fidelity | None, *modules: str) -> dict[str, str]:
    """Digests of turbine, fidelity and code.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str or Fidelity or None
        None: that of the blades (`wt_gym.simulation.fidelity.choose_fidelity`).
    *modules : str
        Dotted names of further modules on which the numbers depend.

    Returns
    -------
    dict
        ``turbine``, ``fidelity``, and ``code``: all sources and data that an episode with an agent loads
        (`wt_gym.base.sources.sources_digest`). Where episodes start from a record of the user, ``start`` is its digest;
        the records of the package are part of the code.
    """
    chosen = fidelity_of(suited_fidelity(turbine) if fidelity is None else fidelity)
    record = user_record_digest(turbine)
    return {
        "turbine": fingerprint(turbine)[:16],
        "fidelity": fingerprint(chosen)[:16],
        "code": sources_digest(*_EPISODE, *modules),
    } | ({} if record is None else {"start": record})


def differing(first: dict[str, str], second: dict[str, str]) -> list[str]:
    """Names of the parts in which two fingerprints differ."""
    return sorted(name for name in {*first, *second} if first.get(name) != second.get(name))
