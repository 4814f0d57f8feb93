"""What controllers and agents add to a PI controller of the pitch and a torque curve, from the records of the tasks."""

import fault_study
import numpy as np
from dial_front import covered
from study_pages import DATA, read_json
from task_scores import STORM_CONTROLLER, mean_change

from wt_gym.analysis.page import format_estimate

_SUPERVISED = "discon+supervisor:averaging=60"
_ROSCO_MODES = tuple(f"discon+derate_{mode}" for mode in ("torque", "speed", "pitch"))
_KEPT = 0.8
"""Share of a gain that counts as kept."""


def beyond_pi():
    """Table, Markdown: a need a row, with changes and their 95 % intervals over the winds."""
    scores = read_json(DATA / "task_scores.json")
    agent = "agents/trained/load_reduction"
    mode = min(_ROSCO_MODES, key=lambda name: np.mean(_values(scores["PowerTracking"], name, "tracking_rms")))
    store = "ipc+derate_kinetic"
    gust = _best(scores["Gusts"], "discon", "blade_flap_max")
    storm = scores["FullOperation"]
    hard = next(run["agent"] for run in storm["runs"] if run["agent"].startswith(f"{_SUPERVISED},"))
    rows = [
        ("spare the blades at the same power", "load_reduction", "has one pitch angle for all blades",
         "`load_reduction`, trained",
         f"flap DEL {_change(scores['LoadReduction'], 'discon', agent, 'blade_flap_del')}"),
        ("meet a gust with less load", "gusts", "reacts to the rotor speed alone", f"`{gust}`",
         f"largest flap moment {_change(scores['Gusts'], 'discon', gust, 'blade_flap_max')}"),
        ("make a demanded power, also in lulls", "power_tracking", f"`{mode}`, the best of ROSCO's modes", f"`{store}`",
         f"tracking error {_change(scores['PowerTracking'], mode, store, 'tracking_rms')}, "
         f"flap DEL {_change(scores['PowerTracking'], mode, store, 'blade_flap_del')}"),
        ("produce in a storm", "full_operation", "stops at the cut-out wind", f"`{STORM_CONTROLLER}`",
         f"energy {_change(storm, hard, STORM_CONTROLLER, 'corrected_power')} from standstill to storm, "
         f"flap DEL {_change(storm, hard, STORM_CONTROLLER, 'blade_flap_del')}"),
        ("change what counts in operation", "dial", "has one compromise, fixed by its gains",
         "`dial`, trained", _dial()),
        ("keep its gain with a broken part", "faults", "trusts its readings and drives",
         "`linear_optimal+fault_supervisor`", _faults()),
    ]  # fmt: skip
    lines = ["| need | PI control | remedy | measured |", "|---|---|---|---|"]
    lines += [f"| [{need}]({page}.md) | {why} | {who} | {found} |" for need, page, why, who, found in rows]
    return "\n".join(lines) + "\n"


def _values(study, agent, metric):
    """Metric of an agent's runs by part and wind."""
    runs = sorted((run for run in study["runs"] if run["agent"] == agent), key=lambda run: (run["part"], run["wind"]))
    return np.array([run["metrics"].get(metric, np.nan) for run in runs])


def _best(study, base, metric):
    """The agent with the least of a metric on average over the winds."""
    agents = {run["agent"] for run in study["runs"]} - {base, "random"}
    return min(
        sorted(agents), key=lambda agent: np.nanmean(_values(study, agent, metric) / _values(study, base, metric))
    )


def _change(study, base, agent, metric):
    """Mean relative change over the winds that both came through, with its interval."""
    both = np.array([_values(study, name, metric) for name in (agent, base)])
    return format_estimate(metric, mean_change(*both[:, np.isfinite(both).all(axis=0)]))


def _dial():
    """Hypervolume of the policy with the dial over that of one policy a setting."""
    forecast = read_json(DATA / "dial_front.json")["forecast"]
    share = 100.0 * covered(forecast["dial"], forecast["single"])
    return f"one policy has {share:.0f} % of the hypervolume of five, by the identified model"


def _faults():
    """In how many faults the gain is kept."""
    gain = fault_study.gains(read_json(fault_study.RECORD))
    faults = {condition for condition, _ in gain} - {"nominal"}
    first, second = (
        sum(gain[fault, agent] >= _KEPT * gain["nominal", agent] for fault in faults)
        for agent in ("linear_optimal", "linear_optimal+fault_supervisor")
    )
    return f"at least {_KEPT:.0%} of the gain in {second} of {len(faults)} faults; without the supervisor in {first}"
