"""What an evaluation says, in words: every sentence follows from the numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.analysis.metrics import METRICS

if TYPE_CHECKING:
    from wt_gym.analysis.results import Evaluation

__all__ = ["difference", "difference_class", "format_difference", "format_value", "headline", "summarise", "unseen"]

# Differences below this fraction are called equal: two winds cannot tell them apart.
_NEGLIGIBLE = 0.01
_LOADS = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")
# More lost power than this is no trade for lower loads.
_TRADED_POWER = 0.05
_MANY_WINDS = 6
_SHORT_TRAINING = 300_000
_WORDS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def format_value(key: str, value: float) -> str:
    """Value of a metric in the unit shown, without the unit."""
    metric = METRICS[key]
    return f"{value * metric.factor:.{metric.digits}f}".replace("-", "\u2212")


def difference(key: str, value: float, reference: float) -> tuple[float, bool]:
    """Difference of a metric to its reference.

    Returns
    -------
    difference : float
        Relative to the reference, or in the shown unit where the reference rounds to zero or counts events.
    relative : bool
        Whether it is relative.
    """
    metric = METRICS[key]
    shown = abs(reference * metric.factor)
    if key == "overspeed_count" or shown < 10.0**-metric.digits:
        return (value - reference) * metric.factor, False
    return (value - reference) / abs(reference), True


def format_difference(key: str, value: float, reference: float) -> str:
    """Signed difference of a metric to its reference, in percent where that makes sense."""
    amount, relative = difference(key, value, reference)
    if amount == 0.0:
        return "="
    if relative:
        text = f"{100 * amount:+.1f} %" if abs(amount) < 10 else f"\u00d7 {1 + amount:.0f}"
    else:
        text = f"{amount:+.{METRICS[key].digits}f}"
    return text.replace("-", "\u2212")


def difference_class(key: str, value: float, reference: float) -> str:
    """``"better"``, ``"worse"`` or ``"equal"`` than the reference, or ``"none"`` if neither is good."""
    better = METRICS[key].better
    amount, relative = difference(key, value, reference)
    if better == 0:
        return "none"
    if abs(amount) < (_NEGLIGIBLE if relative else 0.5 * 10.0 ** -METRICS[key].digits):
        return "equal"
    return "better" if amount * better > 0 else "worse"


def headline(evaluation: Evaluation) -> str:
    """One line for the top of the page: agents and winds."""
    others = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    winds = _count(len(evaluation.winds), "unseen wind" if evaluation.training and unseen(evaluation) else "wind")
    if not others:
        return f"{evaluation.baseline} in {winds}"
    return f"{' and '.join(others)} against {evaluation.baseline} in {winds}"


def unseen(evaluation: Evaluation) -> bool:
    """Whether no agent was trained on a turbulence seed of the evaluation; a wind without a seed may have been met."""
    seeds = {wind.seed for wind in evaluation.winds}
    trained = [training.get("wind_seeds") for training in evaluation.training.values()]
    return None not in seeds and all(known is not None and seeds.isdisjoint(known) for known in trained)


def summarise(evaluation: Evaluation) -> list[str]:
    """Describe what was found, one paragraph an agent and one on how far the result carries.

    Returns
    -------
    list of str
        Plain text.
    """
    paragraphs = [_baseline_paragraph(evaluation)]
    paragraphs += [_agent_paragraph(evaluation, a) for a in evaluation.agents if a != evaluation.baseline]
    return [*paragraphs, _reach_paragraph(evaluation)]


def _baseline_paragraph(evaluation: Evaluation) -> str:
    agent = evaluation.baseline
    text = f"{_survival(evaluation, agent)}"
    mean = evaluation.mean_metrics(agent)
    if _all_complete(evaluation, agent) and "mean_power" in mean:
        text += (
            f" It made {_shown('mean_power', mean)} on average, with a rotor speed of up to"
            f" {_shown('rotor_speed_max', mean)} and a pitch duty cycle of {_shown('pitch_duty_cycle', mean)}."
        )
    return text


def _agent_paragraph(evaluation: Evaluation, agent: str) -> str:
    sentences = [_training_sentence(evaluation, agent), _survival(evaluation, agent)]
    if not (_all_complete(evaluation, agent) and _all_complete(evaluation, evaluation.baseline)):
        energy = _produced(evaluation, agent)
        if energy is not None:
            sentences.append(
                f"Up to their ends its runs produced {energy:.0f} % of the energy of {evaluation.baseline}; loads of"
                " runs of unequal length are not comparable and are marked in the table."
            )
        sentences.append(f"So {agent} cannot replace {evaluation.baseline} here.")
    else:
        sentences += _comparison(evaluation, agent)
    return " ".join(sentence for sentence in sentences if sentence)


def _training_sentence(evaluation: Evaluation, agent: str) -> str:
    training = evaluation.training.get(agent)
    if not training:
        return ""
    hours = training["steps"] * training["control_dt"] / 3600
    minutes = training["wall_seconds"] / 60
    checkpoint = f" This is its checkpoint after {training['checkpoint']:,} steps." if "checkpoint" in training else ""
    return (
        f"{agent} was trained for {minutes:.1f} min on {training['steps']:,} control steps ({hours:.1f} h of simulated"
        f" operation).{checkpoint}"
    ).replace(",", "\u202f")


def _survival(evaluation: Evaluation, agent: str) -> str:
    """Say whether the agent kept the turbine running."""
    runs = evaluation.runs_of(agent)
    stopped = [run for run in runs if not run.complete]
    if not stopped:
        every = {1: "the wind", 2: "both winds"}.get(len(runs), f"all {_count(len(runs), 'wind')}")
        return f"{agent} kept the turbine running in {every}."
    reasons = "; ".join(f"{_REASONS[run.ending]} after {run.duration:.0f} s at {run.wind.label}" for run in stopped)
    number = _WORDS.get(len(stopped), len(stopped))
    return f"{agent} lost the turbine in {number} of {_count(len(runs), 'wind')} ({reasons})."


_REASONS = {
    "overspeed": "overspeed",
    "standstill": "the rotor stalled",
    "tower_strike": "a blade hit the tower",
    "failure": "the simulation failed",
}


def _comparison(evaluation: Evaluation, agent: str) -> list[str]:
    """Power, loads and actuator use against the baseline, and what they come to."""
    mine, base = evaluation.mean_metrics(agent), evaluation.mean_metrics(evaluation.baseline)
    change = {key: format_difference(key, mine[key], base[key]) for key in mine}
    verdict = {key: difference_class(key, mine[key], base[key]) for key in mine}
    loads = ", ".join(f"{_LOAD_NAMES[key]} {change[key]}" for key in _LOADS)
    sentences = [
        f"It made {_shown('mean_power', mine)} ({change['mean_power']} against {evaluation.baseline}).",
        f"Damage-equivalent loads: {loads}.",
        f"Its pitch duty cycle is {_shown('pitch_duty_cycle', mine)} against {_shown('pitch_duty_cycle', base)}.",
    ]
    if mine["overspeed_count"] > base["overspeed_count"]:
        sentences.append("It ran into overspeed (above 110 % of rated) more often.")
    worse_loads = [key for key in _LOADS if verdict[key] == "worse"]
    better_loads = [key for key in _LOADS if verdict[key] == "better"]
    power = verdict["mean_power"]
    if power != "worse" and not worse_loads and (better_loads or power == "better"):
        sentences.append(f"In these winds {agent} is ahead of {evaluation.baseline}.")
    elif _lost_power(mine, base) or (power != "better" and not better_loads and (worse_loads or power == "worse")):
        sentences.append(f"In these winds {agent} does not reach {evaluation.baseline}.")
    elif power == "equal" and not worse_loads and not better_loads:
        sentences.append(f"In these winds {agent} and {evaluation.baseline} do equally well.")
    else:
        sentences.append(f"That is a trade, not an improvement on {evaluation.baseline} in everything.")
    return sentences


def _lost_power(mine: dict[str, float], base: dict[str, float]) -> bool:
    """Whether so much power is missing that no saved load makes up for it."""
    return mine["mean_power"] < (1.0 - _TRADED_POWER) * base["mean_power"]


_LOAD_NAMES = {
    "blade_flap_del": "blade flapwise",
    "tower_fore_aft_del": "tower fore-aft",
    "tower_side_side_del": "tower side-side",
}


def _reach_paragraph(evaluation: Evaluation) -> str:
    """How far the result carries."""
    duration = max(run.planned_duration for run in evaluation.runs)
    sentences = [f"Each run lasts {duration:.0f} s at most."]
    if len(evaluation.winds) < _MANY_WINDS or duration < 600:
        sentences.append(
            "Standards ask for at least six ten-minute winds at each mean speed, so read differences of a few percent"
            " as chance."
        )
    if any(training["steps"] < _SHORT_TRAINING for training in evaluation.training.values()):
        sentences.append(
            "An agent for a task like this needs some 10\u2075 to 10\u2076 steps: the short training here shows that"
            " the way works from end to end, not what such an agent can reach."
        )
    return " ".join(sentences)


def _produced(evaluation: Evaluation, agent: str) -> float | None:
    """Energy of all runs of an agent over that of the baseline [%], early ends included; None if that made none."""

    def energy(name: str) -> float:
        return sum(float(run.data["generator_power"].values.mean()) * run.duration for run in evaluation.runs_of(name))

    reference = energy(evaluation.baseline)
    return 100 * energy(agent) / reference if reference > 0 else None


def _all_complete(evaluation: Evaluation, agent: str) -> bool:
    return all(run.complete for run in evaluation.runs_of(agent))


def _shown(key: str, metrics: dict[str, float]) -> str:
    """Value with its unit."""
    return f"{format_value(key, metrics[key])} {METRICS[key].unit}"


def _count(number: int, noun: str) -> str:
    """Number with its noun."""
    return f"{_WORDS.get(number, number)} {noun}{'' if number == 1 else 's'}"
