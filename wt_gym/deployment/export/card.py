"""What stands beside an exported agent: what it is made for, what it reads and gives, what it did in its training."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import wt_gym
from wt_gym.analysis.change import relative_change
from wt_gym.control.controllers.names import BASELINE
from wt_gym.experiment.trained_environment import trained_arguments

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from wt_gym.deployment.export.network import Network
    from wt_gym.envs.layout import EnvLayout

__all__ = ["card_of", "card_text"]

_EFFECTS = {
    "mean_power": "mean power",
    "blade_flap_del": "flapwise blade-root DEL",
    "tower_fore_aft_del": "tower-base fore-aft DEL",
    "tower_side_side_del": "tower-base side-side DEL",
}


def card_of(name: str, record: Mapping[str, Any], layout: EnvLayout, network: Network) -> dict[str, Any]:
    """Facts of an agent as JSON values.

    Parameters
    ----------
    name : str
    record : mapping
        Of its training; empty where there is none.
    layout : EnvLayout
    network : Network
    """
    arguments = trained_arguments(record)
    observation = layout.observation
    return {
        "agent": name,
        "wt_gym": wt_gym.__version__,
        "turbine": layout.turbine.name,
        "algorithm": record.get("algorithm"),
        "training_steps": record.get("steps"),
        "training_wind_seeds": record.get("wind_seeds"),
        "training_wind_speed": arguments.get("wind_speed"),
        "control_step_s": layout.control_dt,
        "reading_delay_steps": layout.delay,
        "action_mode": layout.action.mode,
        "base_controller": arguments.get("controller") or (BASELINE if layout.action.needs_controller else None),
        "layers": [list(layer.weight.shape) for layer in network.layers],
        "channels": [
            {"name": c.name, "unit": c.unit, "low": c.low, "high": c.high, "meaning": c.description}
            for c in observation.channels
        ],
        "actions": [
            {"name": action, "low": float(low), "high": float(high)}
            for action, low, high in zip(
                network.action_names, network.action_low, network.action_high, strict=True
            )
        ],
        "effects": _effects(record),
    }  # fmt: skip


def _effects(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Changes against the baseline in the last evaluation of the training, by wind."""
    evaluation = record.get("evaluation") or {}
    winds, before, after = (evaluation.get(key) or [] for key in ("winds", "baseline", "agent"))
    return [
        {"wind": wind, **{k: relative_change(new[k], old[k]) for k in _EFFECTS if old.get(k) and k in new}}
        for wind, old, new in zip(winds, before, after, strict=False)
        if isinstance(old, dict) and isinstance(new, dict)
    ]


def card_text(card: Mapping[str, Any], files: Iterable[str]) -> str:
    """Card as a page in Markdown."""
    steps = card["training_steps"]
    trained = f"{card['algorithm']}, {steps:,} steps" if steps else "no record of a training"
    seeds = card["training_wind_seeds"]
    facts = {
        "turbine": card["turbine"],
        "training": trained,
        "training winds": f"{card['training_wind_speed']} m/s, {len(seeds)} turbulence seeds" if seeds else "unknown",
        "control step": f"{card['control_step_s']:g} s",
        "delay of the readings": f"{card['reading_delay_steps']} control steps",
        "actions": card["action_mode"],
        "base controller": card["base_controller"] or "none",
        "layers": ", ".join("x".join(map(str, shape)) for shape in card["layers"]),
        "made with": f"wt_gym {card['wt_gym']}",
        "files": ", ".join(files),
    }
    lines = [f"# {card['agent']}", "", "| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in facts.items()), ""]
    lines += ["## Inputs", "", "In this order, in SI units. Values beyond the range read as its end.", ""]
    lines += _table(("name", "unit", "low", "high", "meaning"), card["channels"])
    lines += ["", "## Outputs", ""]
    lines += _table(("name", "low", "high"), card["actions"])
    lines += ["", "## Measured effects", ""]
    if card["effects"]:
        lines += ["Against the baseline in the last evaluation of the training.", ""]
        rows = [
            {"wind": _wind(row["wind"])} | {_EFFECTS[k]: f"{100 * row[k]:+.1f} %" for k in _EFFECTS if k in row}
            for row in card["effects"]
        ]
        lines += _table(tuple(rows[0]), rows)
    else:
        lines.append("The record of the training holds none.")
    lines += [
        "", "## Limits", "",
        "The policy holds for the turbine, the winds and the base controller above. It does not check its inputs for "
        "faults: a missing reading is for the caller to handle, by resting the actions.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _wind(wind: Any) -> str:
    return f"{wind['speed']:g} m/s, seed {wind['seed']}" if isinstance(wind, dict) else str(wind)


def _table(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Rows as a table in Markdown."""

    def shown(value: Any) -> str:
        return f"{value:.6g}" if isinstance(value, float) else str(value)

    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    return lines + [f"| {' | '.join(shown(row.get(c, '')) for c in columns)} |" for row in rows]
