"""What an evaluation has to say of how its agents were trained, before anybody reads their figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wt_gym.analysis.results import Wind
    from wt_gym.envs.episode import Agent

__all__ = ["training_notes"]

_MOST_NAMED = 6


def training_notes(agents: Mapping[str, Agent], winds: Iterable[Wind]) -> dict[str, str]:
    """Sentences on trained models that have met winds of an evaluation, or of whose training nothing is known.

    Parameters
    ----------
    agents : mapping
        Name to agent; those with a ``record``, as of `wt_gym.experiment.trained_agent.TrainedAgent`, are trained.
    winds : iterable of Wind

    Returns
    -------
    dict
        By the name of the agent; nothing for agents without a note.
    """
    seeds = list(dict.fromkeys(wind.seed for wind in winds if wind.seed is not None))
    notes = {}
    for name, agent in agents.items():
        if not isinstance(record := getattr(agent, "record", False), Mapping | None):
            continue  # not a trained model
        if note := _met(name, record, seeds) if record else _unknown(name):
            notes[name] = note
    return notes


def _unknown(name: str) -> str:
    return (
        f"Nothing is known of the training of {name}: there is no training.json beside its model. It runs on the "
        "environment's own controller and observation, and may have met these winds."
    )


def _met(name: str, record: Mapping[str, Any], seeds: Iterable[int]) -> str:
    """Which seeds a training had; empty for none."""
    of_training = set(record.get("wind_seeds") or ())
    met = [str(seed) for seed in seeds if seed in of_training]
    if not met:
        return ""
    more = f" and {len(met) - _MOST_NAMED} more" if len(met) > _MOST_NAMED else ""
    return (
        f"{name} was trained on wind seed{'s' if len(met) > 1 else ''} {', '.join(met[:_MOST_NAMED])}{more} of this "
        "evaluation: its figures there do not test unseen winds."
    )
