"""Gains of the shipped agent of LoadReduction, here and in OpenFAST: tables of README.md and of two pages.

    python scripts/studies/transfer.py                     # the tables, and docs/data/crosscheck_changes.svg
    python scripts/studies/transfer.py runs/crosscheck_linear   # from a folder of wt-gym crosscheck, with the record

Writes docs/data/transfer.json of runs that lasted until their end. Costs are improvements of the cost of energy over
the published controller in the same wind and simulator; an agent's gain over the linear optimal controller is the
difference of both improvements.
"""

import json
import sys
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.stats import t
from study_pages import DATA, ROOT, markdown, read_json, renew, save_svg, signed, with_runs

from wt_gym.analysis.crosscheck import changes_figure
from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.base.files import write_text_whole
from wt_gym.experiment.run import benchmark_metrics
from wt_gym.experiment.tuning import Cost
from wt_gym.turbines import load_turbine

RECORD = DATA / "transfer.json"
CODES = ("wt_gym", "openfast")
PUBLISHED, LINEAR, AGENT = "discon", "linear_optimal", "load_reduction"
TURBINE, SKIP = "nrel_5mw", 60.0
_METRICS = (*LIFETIME_COST_WEIGHTS, "pitch_travel")
_SHOWN = {"blade_flap_del": "flap", "blade_edge_del": "edge", "tower_fore_aft_del": "fore-aft",
          "tower_side_side_del": "side-side", "pitch_travel": "pitch travel"}  # fmt: skip


def record(folder):
    """Metrics of all runs of a crosscheck."""
    turbine, runs = load_turbine(TURBINE), []
    for code in CODES:
        for file in sorted((folder / code / "runs").glob("*.nc")):
            with xr.open_dataset(file) as data:
                data.load()
            if (ending := json.loads(data.attrs["run"])["ending"]) != "time":
                raise ValueError(f"{file} must have lasted until the end of its time, got {ending!r}")
            metrics = benchmark_metrics(data, turbine, SKIP)
            runs.append({
                "simulator": code, "agent": data.attrs["agent"], "speed": float(data.attrs["wind_speed"]),
                "seed": int(data.attrs["wind_seed"]),
                "metrics": {name: float(f"{metrics[name]:.6g}") for name in _METRICS},
            })  # fmt: skip
    return {"turbine": TURBINE, "skip": SKIP, "runs": runs}


def gains(content):
    """By simulator, speed and agent: improvement of the cost (n_winds,), and changes of the loads by metric (n_winds,).

    Changes of the agent are against the linear optimal controller, those of the latter against the published one.
    """
    turbine, cost = load_turbine(content["turbine"]), Cost(least_power=0.0)
    found, out, drawn = {}, {}, {run["seed"] for run in content["runs"]}
    for run in content["runs"]:
        key = run["simulator"], run["agent"], run["speed"], run["seed"]
        if key in found:
            raise ValueError(f"each wind must have one run, got two of {key}")
        found[key] = run["metrics"]
    for code, agent, speed in sorted({key[:3] for key in found}):
        if agent == PUBLISHED:
            continue
        seeds = sorted(key[3] for key in found if key[:3] == (code, agent, speed))
        if seeds != sorted(drawn):
            raise ValueError(f"{agent} must have the winds {sorted(drawn)} at {speed:g} m/s in {code}, got {seeds}")
        below = LINEAR if agent == AGENT else PUBLISHED
        mine, base, first = ([found[code, name, speed, seed] for seed in seeds] for name in (agent, below, PUBLISHED))
        improved = np.array([-cost.of(one, other, turbine) for one, other in zip(mine, first, strict=True)])
        changes = {
            name: np.array([one[name] / other[name] - 1.0 for one, other in zip(mine, base, strict=True)])
            for name in _SHOWN
        }
        out[code, speed, agent] = improved, changes
    return out


def _interval(values):
    """Mean and 95 % interval [%]."""
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return f"{signed(100 * values.mean(), 1)} ± {signed(100 * half, 1, plus=False)} %"


def table(_):
    """Improvement of the cost over both controllers in both simulators, a row a wind speed."""
    found = gains(read_json(RECORD))
    speeds = sorted({speed for _, speed, _ in found})
    rows = []
    for speed in speeds:
        cells = [f"{speed:g} m/s"]
        for code in CODES:
            own, linear = (found[code, speed, agent][0] for agent in (AGENT, LINEAR))
            cells += [f"{signed(100 * own.mean(), 1)} %", _interval(own - linear)]
        rows.append(cells)
    n = len(found[CODES[0], speeds[0], AGENT][0])
    heads = [f"{code}, over `{name}`" for code in ("wt_gym", "OpenFAST") for name in (PUBLISHED, LINEAR)]
    return (
        f"{markdown(['mean wind', *heads], rows)}\n\n{n} winds a speed. The gains over `{LINEAR}` are differences of "
        f"those over `{PUBLISHED}`, with 95 % intervals of the paired differences."
    )


def loads(_):
    """Changes of loads and travel by the agent over the linear optimal controller, wt_gym / OpenFAST."""
    found = gains(read_json(RECORD))
    rows = []
    for speed in sorted({speed for _, speed, _ in found}):
        both = [found[code, speed, AGENT][1] for code in CODES]
        means = [" / ".join(signed(100 * one[name].mean(), 1) for one in both) + " %" for name in _SHOWN]
        rows.append([f"{speed:g} m/s", *means])
    return markdown(["wind", *(f"{name} DEL" for name in list(_SHOWN.values())[:4]), "pitch travel"], rows)


def changes():
    """Changes by both crosschecks in one figure; of agents those of the later one."""
    first, later = (read_json(DATA / f"{name}.json") for name in ("crosscheck", "crosscheck_linear"))
    found = {(row["wind_speed"], row["metric"]): row["changes"] for row in later["metrics"]}
    for row in first["metrics"]:
        row["changes"] = row["changes"] | {AGENT: (None, None)} | found.get((row["wind_speed"], row["metric"]), {})
    names = [name for name in first["sample_correlation"] if name not in (AGENT, "on_tuned_lidar")]
    return changes_figure(first | {"sample_correlation": [*names, LINEAR, AGENT]})


if __name__ == "__main__":
    save_svg(changes(), DATA / "crosscheck_changes.svg")
    if len(sys.argv) > 1:
        write_text_whole(RECORD, with_runs(record(Path(sys.argv[1]))) + "\n")
    renew(ROOT / "README.md", {"transfer": table})
    renew(ROOT / "docs" / "crosscheck.md", {"transfer": table})
    renew(ROOT / "docs" / "studies" / "openfast.md", {"loads": loads})
