"""An evaluation in words: every sentence follows from the numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from wt_gym.analysis.metrics import COLUMN_HEADS, METRICS, measured_metrics
from wt_gym.analysis.page import NONE, Row, format_estimate, format_value, markdown
from wt_gym.analysis.statistics import (
    LEAST_PER_STRATUM,
    LIFETIME_EXPONENTS,
    Estimate,
    lifetime,
    lifetime_change,
    paired_change,
)

if TYPE_CHECKING:
    from wt_gym.analysis.results import Evaluation, Wind


JUDGED = {
    "corrected_power": "power",
    "blade_flap_del": "blade flapwise",
    "tower_fore_aft_del": "tower fore-aft",
    "tower_side_side_del": "tower side-side",
    "pitch_travel": "pitch travel",
}
"""Metrics that decide whether an agent is better, and their names in a sentence."""
_FATIGUE = {
    "blade_flap_del": "flapwise blade fatigue",
    "tower_fore_aft_del": "fore-aft tower fatigue",
    "tower_side_side_del": "side-side tower fatigue",
}
# More lost power than this does not count as a trade for lower loads.
_TRADED_POWER = 0.05
_MUCH_PITCH = 0.1  # half the duty cycle of `ipc` on the NREL 5-MW at 15 m/s, validation case "controllers"
_MANY_WINDS = 6
# A headline names so many agents at most.
_MOST_NAMED = 3
_SHORT_TRAINING = 300_000
_WORDS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def headline(evaluation: Evaluation) -> str:
    """One line for the top of the page: agents and winds."""
    others = evaluation.others
    winds = _count(len(evaluation.winds), "unseen wind" if evaluation.training and unseen(evaluation) else "wind")
    if not others:
        return f"{evaluation.baseline} in {winds}"
    named = " and ".join(others) if len(others) <= _MOST_NAMED else _count(len(others), "agent")
    return f"{named} against {evaluation.baseline} in {winds}"


def result_sentence(evaluation: Evaluation) -> str:
    """The result in one sentence: what the best agent changes against the baseline, or that none is better.

    The best is better in `JUDGED` with the lowest loads. What is due to its base controller, if compared, stands first.
    """
    others = evaluation.others
    winds = f"in {_count(len(evaluation.winds), 'wind')}"
    if not others:
        mean = evaluation.mean_metrics(evaluation.baseline)
        power = f" and makes {_shown('corrected_power', mean)}" if "corrected_power" in mean else ""
        whole = sum(run.complete for run in evaluation.runs)
        return f"{evaluation.baseline} keeps the turbine running in {whole} of {len(evaluation.runs)} winds{power}."
    verdicts = {agent: verdict(evaluation, agent) for agent in others}
    gaining = [agent for agent in others if verdicts[agent].kind in ("better", "trade")]
    if gaining:
        best = min(gaining, key=lambda agent: _rank(evaluation, agent))
        changes = f"{best} {_changes(evaluation, best, verdicts[best])}"
        base = evaluation.training.get(best, {}).get("environment", {}).get("controller")
        if base in gaining:
            changes = (
                f"{base} alone {_changes(evaluation, base, verdicts[base])}; with learning on top of it, {changes}"
            )
        return f"Against {evaluation.baseline} {winds}, {changes}."
    if len(others) > 1:
        lost = [agent for agent in others if verdicts[agent].kind == "lost"]
        more = f"; runs of {' and '.join(lost)} ended early" if 0 < len(lost) <= _MOST_NAMED else ""
        return f"No agent is better than {evaluation.baseline} {winds}{more}."
    (agent,) = others
    if verdicts[agent].kind == "worse":
        changes = _changes(evaluation, agent, verdicts[agent])
        return f"{agent} is not better than {evaluation.baseline}: it {changes} {winds}."
    return {
        "lost": f"Runs of {agent} or {evaluation.baseline} ended early {winds}: nothing to compare.",
        "equal": f"{agent} and {evaluation.baseline} do equally well {winds}.",
        "open": f"No difference is seen between {agent} and {evaluation.baseline} {winds}.",
    }[verdicts[agent].kind]


def _rank(evaluation: Evaluation, agent: str) -> float:
    """Mean change of the loads less that of power; least is best."""
    changes = {key: change.value for key, change in _compared(evaluation, agent).items() if change.relative}
    loads = [changes[key] for key in _FATIGUE if key in changes]
    return (sum(loads) / len(loads) if loads else 0.0) - changes.get("corrected_power", 0.0)


def _changes(evaluation: Evaluation, agent: str, result: Verdict) -> str:
    """Loads that an agent lowers and raises beyond chance, in words, with power and pitch travel."""
    change = _compared(evaluation, agent)

    def listed(keys: list[str]) -> str:
        return _and([f"{_FATIGUE[key]} by {_size(key, change[key])}" for key in keys])

    lower, higher = ([key for key in _FATIGUE if key in keys] for keys in (result.gains, result.costs))
    power, travel = change["corrected_power"], change["pitch_travel"]
    verbs = [f"lowers {listed(lower)}"] if lower else []
    verbs += [f"raises {listed(higher)}"] if higher else []
    with_ = []
    if (kind := power.kind("corrected_power")) in ("better", "worse"):
        verb = "makes" if kind == "better" else "loses"
        verbs.append(f"{verb} {_size('corrected_power', power)} {'more power' if kind == 'better' else 'of power'}")
    elif verbs:
        with_.append("at the same power" if kind == "equal" else "with no difference seen in power")
    if travel.kind("pitch_travel") in ("better", "worse"):
        if travel.relative and travel.value >= 1.0:
            with_.append(f"with {1.0 + travel.value:.1f} times the pitch travel")
        else:
            with_.append(f"with {_size('pitch_travel', travel)} {'more' if travel.value > 0 else 'less'} pitch travel")
    if not verbs:
        verbs = ["needs " + with_.pop().removeprefix("with ")]
    return " ".join([_and(verbs), *([_and(with_)] if with_ else [])])


def _compared(evaluation: Evaluation, agent: str) -> dict[str, Estimate]:
    """Changes of an agent with a verdict: every metric of `JUDGED` can be compared."""
    return {key: cast("Estimate", paired_change(evaluation, agent, key)) for key in JUDGED}


def _size(key: str, change: Estimate) -> str:
    """Size of a change without its sign."""
    text = format_estimate(key, change).partition(" [")[0].lstrip("+\u2212")
    return text.replace(" ", "\u00a0").replace("\u00d7", "a factor of")


def _and(words: list[str]) -> str:
    """Words as a list in a sentence."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def unseen(evaluation: Evaluation) -> bool:
    """Return True if no agent was trained on a seed of the evaluation; a wind without a seed may have been met."""
    seeds = {wind.seed for wind in evaluation.winds}
    trained = [training.get("wind_seeds") for training in evaluation.training.values()]
    return (
        not evaluation.notes
        and None not in seeds
        and all(known is not None and seeds.isdisjoint(known) for known in trained)
    )


@dataclass(frozen=True)
class Verdict:
    """Judgment of an agent against the baseline; gains and costs are the keys of `JUDGED` that are better and worse.

    The kind is ``"better"``, ``"worse"``, ``"trade"``, ``"equal"`` (every change is shown to be below 1 %), ``"open"``
    (no difference is seen, and none excluded) or ``"lost"`` (a run ended early), in words for people.
    """

    kind: str
    word: str
    gains: tuple[str, ...] = ()
    costs: tuple[str, ...] = ()


def verdict(evaluation: Evaluation, agent: str) -> Verdict:
    """Judge an agent by `JUDGED`: better with gains only, worse with costs only, a trade with both.

    A change counts if it exceeds 1 % and, where there are winds enough for an interval, that excludes zero. More than
    5 % of lost power does not count as a trade.
    """
    if not (evaluation.survived(agent) and evaluation.survived(evaluation.baseline)):
        return Verdict("lost", "Runs ended early")
    changes = {key: paired_change(evaluation, agent, key) for key in JUDGED}
    kinds = {key: change.kind(key) for key, change in changes.items() if change is not None}
    gains, costs = (tuple(key for key in kinds if kinds[key] == kind) for kind in ("better", "worse"))
    power = changes["corrected_power"]
    if costs and (not gains or (power is not None and power.relative and power.value < -_TRADED_POWER)):
        return Verdict("worse", "Not better", gains, costs)
    if gains:
        return Verdict("trade", "A trade", gains, costs) if costs else Verdict("better", "Better", gains, costs)
    if kinds and all(kind == "equal" for kind in kinds.values()):
        return Verdict("equal", "Equal")
    return Verdict("open", "No difference seen")


def summarize(evaluation: Evaluation) -> list[str]:
    """Paragraphs of plain text: what all agents have in common, one an agent, notes, and how far the result carries."""
    paragraphs = [_baseline_paragraph(evaluation)]
    paragraphs += [_agent_paragraph(evaluation, agent) for agent in evaluation.others]
    notes = [*evaluation.notes.values(), *evaluation.idle_sentences.values()]
    return [*paragraphs, *notes, _reach_paragraph(evaluation)]


def _baseline_paragraph(evaluation: Evaluation) -> str:
    agent = evaluation.baseline
    sentences = [_common_survival(evaluation), _survival(evaluation, agent), _common_overspeed(evaluation)]
    mean = evaluation.mean_metrics(agent)
    if evaluation.survived(agent) and "corrected_power" in mean:
        fastest = _shown("rotor_speed_max", evaluation.overall_metrics(agent))
        sentences.append(
            f"{agent} made {_shown('corrected_power', mean)} on average, with a rotor speed of up to {fastest} and a"
            f" pitch duty cycle of {_shown('pitch_duty_cycle', mean)}."
        )
    cycles = [evaluation.mean_metrics(one).get("pitch_duty_cycle", 0.0) for one in evaluation.others]
    if max(cycles, default=0.0) > _MUCH_PITCH:
        sentences.append("A high duty cycle wears pitch bearings; typical individual pitch control has 20 % at 15 m/s.")
    return " ".join(sentence for sentence in sentences if sentence)


def _common_ends(evaluation: Evaluation) -> list[Wind]:
    """Winds that ended every agent's run early; none where there is one agent."""
    if len(evaluation.agents) < 2:
        return []
    return [wind for wind in evaluation.winds if not any(evaluation.run(a, wind).complete for a in evaluation.agents)]


def _common_survival(evaluation: Evaluation) -> str:
    """Sentence on ends that all agents have in common."""
    if len(evaluation.agents) < 2:
        return ""
    every = "both" if len(evaluation.agents) == 2 else f"all {_WORDS.get(n := len(evaluation.agents), n)}"
    if all(run.complete for run in evaluation.runs):
        return f"{every.capitalize()} kept the turbine running in {_every_wind(len(evaluation.winds))}."
    if not (ends := _common_ends(evaluation)):
        return ""
    reasons = []
    for wind in ends:
        runs = [evaluation.run(agent, wind) for agent in evaluation.agents]
        first, last = min(run.duration for run in runs), max(run.duration for run in runs)
        when = f"{first:.0f} s" if f"{first:.0f}" == f"{last:.0f}" else f"{first:.0f} to {last:.0f} s"
        reasons.append(f"{wind.name}: {_and(list(dict.fromkeys(REASONS[run.ending] for run in runs)))} after {when}")
    return f"{every.capitalize()} lost the turbine in {_count(len(ends), 'wind')} ({'; '.join(reasons)})."


def _common_overspeed(evaluation: Evaluation) -> str:
    """Overspeeds that no agent avoids."""
    counts = {agent: evaluation.overall_metrics(agent).get("overspeed_count", 0.0) for agent in evaluation.agents}
    if len(counts) < 2 or not all(counts.values()):
        return ""
    events = ", ".join(f"{agent} {count:.0f}" for agent, count in counts.items())
    return f"All ran into overspeed (above 110 % of rated), in number of events: {events}."


def _agent_paragraph(evaluation: Evaluation, agent: str) -> str:
    sentences = [_training_sentence(evaluation, agent), _survival(evaluation, agent)]
    if not (evaluation.survived(agent) and evaluation.survived(evaluation.baseline)):
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
    minutes = training["wall_seconds"] / 60
    pretrained = " pretrained on an identified model" if training.get("pretraining") else ""
    if pretrained and not training["steps"]:
        return f"{agent} was{pretrained} in {training['pretraining']['seconds'] / 60:.1f} min."
    hours = training["steps"] * training["control_dt"] / 3600
    checkpoint = f" This is its checkpoint after {training['checkpoint']:,} steps." if "checkpoint" in training else ""
    return (
        f"{agent} was{f'{pretrained} and' if pretrained else ''} trained for {minutes:.1f} min on"
        f" {training['steps']:,} control steps ({hours:.1f} h of simulated operation).{checkpoint}"
    ).replace(",", "\u202f")


def _survival(evaluation: Evaluation, agent: str) -> str:
    """Sentence on the ends of an agent's runs, unless the common one says it."""
    runs, common = evaluation.runs_of(agent), _common_ends(evaluation)
    stopped = [run for run in runs if not run.complete and run.wind not in common]
    if not stopped:
        said = common or (len(evaluation.agents) > 1 and all(run.complete for run in evaluation.runs))
        return "" if said else f"{agent} kept the turbine running in {_every_wind(len(runs))}."
    reasons = "; ".join(f"{REASONS[run.ending]} after {run.duration:.0f} s at {run.wind.name}" for run in stopped)
    number = _WORDS.get(len(stopped), len(stopped))
    alone = " alone" if common else ""
    return f"{agent}{alone} lost the turbine in {number} of {_count(len(runs), 'wind')} ({reasons})."


def _every_wind(number: int) -> str:
    return {1: "the wind", 2: "both winds"}.get(number, f"all {_count(number, 'wind')}")


REASONS = {
    "overspeed": "overspeed",
    "standstill": "the rotor stalled",
    "tower_strike": "a blade hit the tower",
    "failure": "the simulation failed",
}


def _comparison(evaluation: Evaluation, agent: str) -> list[str]:
    """Power, loads and actuator use against the baseline, and what they come to."""
    mine, base = evaluation.mean_metrics(agent), evaluation.mean_metrics(evaluation.baseline)
    change = {key: format_estimate(key, estimate) for key, estimate in _compared(evaluation, agent).items()}
    loads = ", ".join(f"{JUDGED[key]} {change[key]}" for key in _FATIGUE)
    sentences = [
        f"{agent} made {_shown('corrected_power', mine)} ({change['corrected_power']} against {evaluation.baseline}).",
        f"Damage-equivalent loads: {loads}.",
        f"Its pitch duty cycle is {_shown('pitch_duty_cycle', mine)} against {_shown('pitch_duty_cycle', base)}.",
    ]
    if mine["overspeed_count"] > base["overspeed_count"]:
        more = " more often" if base["overspeed_count"] else ", the baseline did not"
        sentences.append(f"It ran into overspeed (above 110 % of rated){more}.")
    result = verdict(evaluation, agent)
    gains, costs = (", ".join(JUDGED[key] for key in keys) for keys in (result.gains, result.costs))
    results = {
        "better": f"In these winds {agent} is ahead of {evaluation.baseline}.",
        "worse": f"In these winds {agent} does not reach {evaluation.baseline}.",
        "equal": f"In these winds {agent} and {evaluation.baseline} do equally well.",
        "open": f"No difference between {agent} and {evaluation.baseline} is seen in these winds.",
        "trade": f"That is a trade: better are {gains}; worse are {costs}.",
    }
    return [*sentences, results[result.kind]]


def _reach_paragraph(evaluation: Evaluation) -> str:
    """Limits of the result."""
    duration = max(run.planned_duration for run in evaluation.runs)
    sentences = [f"Each run lasts {duration:.0f} s at most."]
    fewest = min([wind.speed for wind in evaluation.winds].count(speed) for speed in evaluation.speeds)
    if fewest < _MANY_WINDS or duration < 600:
        sentences.append("Standards ask for at least six ten-minute winds at each mean speed.")
    if fewest < LEAST_PER_STRATUM:
        sentences.append("There are too few winds here for intervals: read differences of a few percent as chance.")
    short = [
        agent
        for agent, training in evaluation.training.items()
        if training["steps"] < _SHORT_TRAINING and not training.get("pretraining")
    ]
    if short:
        sentences.append(
            "An agent for a task like this needs some 10\u2075 to 10\u2076 steps: the short training of"
            f" {_and(short)} shows that the way works from end to end, not what such an agent can reach."
        )
    return " ".join(sentences)


def _produced(evaluation: Evaluation, agent: str) -> float | None:
    """Energy of all runs of an agent over that of the baseline [%], early ends included; None if that made none."""

    def energy(name: str) -> float:
        return sum(float(run.data["generator_power"].values.mean()) * run.duration for run in evaluation.runs_of(name))

    reference = energy(evaluation.baseline)
    return 100 * energy(agent) / reference if reference > 0 else None


def _shown(key: str, metrics: dict[str, float]) -> str:
    """Value with its unit."""
    return format_value(key, metrics[key], unit=True)


def _count(number: int, noun: str) -> str:
    """Number with its noun."""
    return f"{_WORDS.get(number, number)} {noun}{'' if number == 1 else 's'}"


def results_table(evaluation: Evaluation) -> list[str]:
    """Markdown: values of the baseline, changes of the others with their intervals, by wind speed, and over a life.

    Greatest speed, smallest clearance and overspeeds are extremes and sums over the winds, not changes.
    """
    measured = measured_metrics(run.metrics for run in evaluation.runs)
    columns = [key for key in COLUMN_HEADS if key in measured and key != "mean_power"]
    parts: list[tuple[str, float | None, bool]] = [(f"{speed:g} m/s", speed, False) for speed in evaluation.speeds]
    if len(parts) > 1:
        parts += [("all", None, False)] + [("lifetime", None, True)] * (evaluation.climate is not None)
    rows = []
    for title, speed, life in parts:
        rows.append(Row(title))
        rows += [Row(a, [_table_cell(evaluation, a, key, speed, life) for key in columns]) for a in evaluation.agents]
    return markdown(["wind", "agent", *(COLUMN_HEADS[key] for key in columns)], rows)


def _table_cell(evaluation: Evaluation, agent: str, key: str, speed: float | None, life: bool = False) -> str:
    """Value of the baseline or of an extreme, else a change; of ``life`` the load over it."""
    if life and key not in LIFETIME_EXPONENTS:
        return ""
    value = lifetime(evaluation, agent, key) if life else evaluation.overall_metrics(agent, speed).get(key)
    if value is None:
        return NONE
    if agent == evaluation.baseline or METRICS[key].over_winds != "mean":
        return format_value(key, value, unit=True)
    change = lifetime_change(evaluation, agent, key) if life else paired_change(evaluation, agent, key, speed)
    return "not compared" if change is None else format_estimate(key, change)
