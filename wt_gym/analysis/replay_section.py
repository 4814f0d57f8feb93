"""The replay as a part of the report: data, controls and the script that draws them."""

from __future__ import annotations

import base64
import json
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.paired import paired_change
from wt_gym.analysis.report_page import Section

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from wt_gym.analysis.replay import Replay
    from wt_gym.analysis.results import Evaluation, Run

__all__ = ["encode", "opening_agent", "replay_script", "replay_section", "shown_agents"]

# Almost a megabyte each: more agents would make the page heavy.
_MOST_AGENTS = 4
_BITS = {"blades": 16, "wake": 16, "strength": 8, "tower": 16, "hub": 16}

_STYLE = """<style>
.replay { display: grid; grid-template-columns: minmax(0, 2.2fr) minmax(240px, 1fr); gap: 12px 20px; }
.replay canvas { display: block; width: 100%; }
.replay .scene { height: 520px; border-radius: 10px; cursor: grab; touch-action: pan-y;
  background: radial-gradient(circle at 35% 35%, #16405c, #071b2a 75%); }
.replay .charts { height: 300px; }
.replay .bar { grid-column: 1 / -1; display: flex; flex-wrap: wrap; align-items: center; gap: 8px 14px; }
.replay button, .replay select { font: inherit; font-size: .9rem; padding: 5px 12px; border-radius: 8px;
  border: 1px solid var(--line); background: var(--paper); color: inherit; cursor: pointer; }
.replay button:hover { background: var(--hover); }
.replay [data-part=play] { min-width: 92px; background: #0b4f79; border-color: #0b4f79; color: #fff; }
.replay [data-part=play]:hover { background: #136a8c; }
.replay [data-part=time] { flex: 1 1 200px; min-width: 120px; accent-color: #0b4f79; }
.replay [data-part=clock] { min-width: 66px; text-align: right; font-variant-numeric: tabular-nums; font-weight: 600; }
.replay label { font-size: .9rem; color: var(--muted); }
.replay dl { margin: 0 0 14px; }
.replay dl div { display: flex; justify-content: space-between; gap: 10px; padding: 5px 0;
  border-bottom: 1px solid var(--faint); }
.replay dt { color: var(--muted); font-size: .9rem; }
.replay dd { margin: 0; font-weight: 600; font-variant-numeric: tabular-nums; white-space: nowrap; }
.replay .blades { display: flex; gap: 14px; font-size: .84rem; color: var(--muted); }
.replay .blades i { display: inline-block; width: 14px; height: 3px; margin-right: 5px; vertical-align: middle; }
@media (max-width: 900px) {
  .replay { grid-template-columns: minmax(0, 1fr); } .replay .scene { height: 400px; }
}
@media print {
  .replay .bar, .replay .charts, .replay .blades { display: none; } .replay .scene { height: 380px; }
}
</style>"""

_CONTROLS = """<div class="replay">
<div class="bar"><label>Agent <select data-part="agent" aria-label="Agent"></select></label>
<button type="button" data-part="play">&#9654; Play</button>
<input type="range" data-part="time" min="0" max="1" step="any" value="0" aria-label="Time">
<span data-part="clock"></span>
<label>Speed <select data-part="speed" aria-label="Speed"><option value="0.25">¼</option><option value="0.5">½</option>
<option value="1" selected>1</option><option value="2">2</option></select></label></div>
<canvas class="scene" data-part="scene" role="img" aria-label="Rotor, tower and wake"></canvas>
<div><dl data-part="numbers"></dl><p class="blades"><span><i style="background:#c98a00"></i>blade 1</span>
<span><i style="background:#0b8f6a"></i>blade 2</span><span><i style="background:#b8487c"></i>blade 3</span></p>
<canvas class="charts" data-part="charts" role="img" aria-label="Tip deflection and pitch over time"></canvas></div>
<div class="bar"><button type="button" data-view="oblique">Oblique</button>
<button type="button" data-view="side">Side</button><button type="button" data-view="front">From the wind</button>
<button type="button" data-view="above">Above</button>
<button type="button" data-zoom="1.25" aria-label="Closer">+</button>
<button type="button" data-zoom="0.8" aria-label="Farther">&#8722;</button></div>
</div>"""


def encode(values: ArrayLike, bits: int = 16) -> dict[str, Any]:
    """Array as integers in base64; NaN is kept.

    Parameters
    ----------
    values : numpy.ndarray
        Finite or NaN.
    bits : {16, 8}
        Of the integers.

    Returns
    -------
    dict
        ``bits``, ``shape``, ``offset``, ``scale`` and ``data``: value = offset + scale · integer / full, where full is
        32767 or 127, and -full - 1 is NaN.
    """
    values = np.asarray(values, dtype=np.float64)
    full = 2 ** (bits - 1) - 1
    low, high = (float(np.nanmin(values)), float(np.nanmax(values))) if np.isfinite(values).any() else (0.0, 0.0)
    offset, scale = 0.5 * (low + high), 0.5 * (high - low) or 1.0
    whole = np.where(np.isnan(values), -full - 1, np.round((values - offset) / scale * full))
    packed = base64.b64encode(whole.astype(f"<i{bits // 8}").tobytes()).decode()
    return {"bits": bits, "shape": list(values.shape), "offset": offset, "scale": scale, "data": packed}


def replay_section(evaluation: Evaluation) -> Section:
    """Section of the page with the replay, empty where no run kept its shapes."""
    runs = [run for agent in evaluation.agents for run in evaluation.runs_of(agent) if run.replay is not None]
    if not runs:
        return Section("replay", "", "")
    opened = opening_agent(evaluation, [run.agent for run in runs])
    kept = shown_agents(evaluation, [run.agent for run in runs], opened)
    runs = [run for run in runs if run.agent in kept]
    replays = [run.replay for run in runs if run.replay is not None]
    blades = replays[0].blades
    data = {
        "dt": _interval(replays),
        "frames": max(replay.time.size for replay in replays),
        "size": float(np.linalg.norm(blades[0, :, 0, -1] - replays[0].hub[0], axis=-1).max()),
        "hub_height": float(replays[0].hub[0, 2]),
        "tower_radius": [round(float(radius), 3) for radius in replays[0].tower_radius],
        "open": [run.agent for run in runs].index(opened),
        "agents": [_agent(run, replay) for run, replay in zip(runs, replays, strict=True)],
    }
    text = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    left_out = len(evaluation.agents) - len(runs)
    caption = (
        f"The last {replays[0].time[-1] - replays[0].time[0]:.0f} s of each run at {runs[0].wind.label}: "
        "lifting surfaces of the blades, which bend and pitch, and trailing filaments of the free wake, brighter where "
        "they are stronger. Drag to turn."
    )
    if left_out:
        caption += f" {len(runs)} of {len(evaluation.agents)} agents can be chosen."
    content = f"{_STYLE}{_CONTROLS}<script type='application/json' id='replay-data'>{text}</script>"
    return Section("replay", "Replay of rotor and wake", content, caption, "Replay")


def opening_agent(evaluation: Evaluation, agents: Sequence[str]) -> str:
    """Agent that the replay opens on: the trained one with the lowest flap DEL, or the last where none is trained.

    Parameters
    ----------
    evaluation : Evaluation
    agents : sequence of str
        Those that have a replay, at least one.
    """
    trained = [agent for agent in agents if agent in evaluation.training]
    loads = {}
    for agent in trained:
        changes = [paired_change(evaluation, agent, "blade_flap_del", speed) for speed in evaluation.speeds]
        known = [change.value for change in changes if change is not None]
        loads[agent] = sum(known) / len(known) if known else 0.0
    return min(trained, key=lambda agent: loads[agent]) if trained else agents[-1]


def shown_agents(evaluation: Evaluation, agents: Sequence[str], opened: str) -> set[str]:
    """Agents that the replay offers: the one it opens on, the baseline, and the first others.

    Parameters
    ----------
    evaluation : Evaluation
    agents : sequence of str
        Those that have a replay.
    opened : str
        See `opening_agent`.
    """
    first = [agent for agent in (opened, evaluation.baseline) if agent in agents]
    return set(list(dict.fromkeys([*first, *agents]))[:_MOST_AGENTS])


def replay_script() -> str:
    """Script that draws the replay, for the end of the page."""
    return resources.files("wt_gym.analysis").joinpath("replay.js").read_text(encoding="utf-8")


def _interval(replays: list[Replay]) -> float:
    """Time between frames [s]."""
    longest = max(replays, key=lambda replay: replay.time.size)
    return float(np.diff(longest.time).mean()) if longest.time.size > 1 else 1.0


def _agent(run: Run, replay: Replay) -> dict[str, Any]:
    """Shapes and signals of a run over its replay."""
    signals = run.data
    places = np.searchsorted(signals["time"].values, replay.time - 1e-6)

    def rounded(name: str, factor: float = 1.0) -> list[float]:
        return [round(factor * float(value), 3) for value in signals[name].values[places]]

    blades = range(1, replay.blades.shape[1] + 1)
    return {
        "name": run.agent,
        "time": [round(float(time), 3) for time in replay.time],
        "shapes": {name: encode(getattr(replay, name), bits) for name, bits in _BITS.items()},
        "signals": {
            "wind": rounded("wind_x"),
            "power": rounded("generator_power", 1e-6),
            "speed": rounded("rotor_speed", 30 / np.pi),
            "pitch": [rounded(f"pitch_{b}", 180 / np.pi) for b in blades],
            "tip": [rounded(f"tip_out_of_plane_{b}") for b in blades],
        },
    }
