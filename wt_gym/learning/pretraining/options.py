"""Options of a pretraining."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS

__all__ = ["CONDITION_ARGUMENTS", "PretrainingOptions", "pretraining_environment"]

CONDITION_ARGUMENTS = ("variation", "sensors", "faults")
"""Groups and arguments of the environment that a condition of a pretraining may have."""
_CONDITION_NAMES = ("vary_", "sensors", "fault_")

_ENVIRONMENT: dict[str, Any] = {
    "controller": "linear_optimal",
    "observation": ["disturbances"],
    "residual_form": "offset",
    "residual_fade": {"pitch": [math.radians(0.5), math.radians(3.0)], "fine_speed": [0.97, 1.02]},
    "residual_washout": None,
    "sensor_washout": None,
}
_SPAN = 0.5
"""Of the agent's offsets over the limit that a design of the turbine has by default [-]."""


def pretraining_environment(env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment whose policy is pretrained, with what is not given set as pretraining needs it.

    The agent acts by offsets of the pitch alone on the linear optimal controller, which takes the place of the
    turbine's own where the id has additions to that; it sees what no action changes, and fades as the controller does.
    Its offsets are within what the pitch drives of the turbine can do.

    Parameters
    ----------
    env_id : str
    env_kwargs : mapping
        What is given.

    Raises
    ------
    ValueError
        If the actions of the id do not move the pitch, or its base controller is without the turbine's own, which the
        linear optimal controller could replace.
    """
    # the configuration of a training is read without them
    from wt_gym.control.controllers.linear_optimal import default_limits
    from wt_gym.control.controllers.names import BASELINE, parse_name
    from wt_gym.envs.options import argument_default, flat_arguments, registered_arguments
    from wt_gym.turbines import load_turbine

    env_kwargs = flat_arguments(env_kwargs)
    whole = registered_arguments(env_id, env_kwargs)
    own: dict[str, Any] = {}
    components = tuple(whole.get("action_components") or ("pitch",))
    if "pitch" not in components:
        raise ValueError(f"pretraining needs actions that move the pitch, and {env_id} has {', '.join(components)}")
    if len(components) > 1:
        own["action_components"] = ["pitch"]
    if "controller" in whole and "controller" not in env_kwargs:
        name = parse_name(str(whole["controller"]))
        parts = name.target.split("+")
        if BASELINE not in parts:
            raise ValueError(
                f"pretraining needs a base controller with linear_pitch, and {env_id} has {whole['controller']!r}; "
                "give env_kwargs a controller such as 'linear_optimal', or leave pretraining out"
            )
        below = "+".join("linear_optimal" if part == BASELINE else part for part in parts)
        own["controller"] = replace(name, target=below).text
    turbine = whole.get("turbine", argument_default("turbine"))
    limit, rate = default_limits(load_turbine(turbine) if isinstance(turbine, str) else turbine)
    spans = {"pitch": _SPAN * limit, "pitch_mean": _SPAN * limit, "pitch_rate": rate}
    seen = ["disturbances", "dial"] if whole.get("dial_weights") is not None else ["disturbances"]
    return {**_ENVIRONMENT, **own, "observation": seen, "action_spans": spans, **env_kwargs}


@dataclass(frozen=True)
class PretrainingOptions:
    """How to pretrain.

    Attributes
    ----------
    rounds : int
        Recordings under the present policy with an optimization behind each; 0: no pretraining.
    episodes : int
        Of a round.
    held_out : int
        Of these, that take no part in the optimization and choose between its steps.
    duration : float
        Of an episode [s].
    skip : float
        Start of it that does not count [s].
    iterations : int
        Steps of the optimizer in a round, at least 20.
    batch : int
        Episodes of a step.
    learning_rate : float
    weight_decay : float
    noise : float
        Standard deviation of what is added to the observations, in their normalized units [-].
    blade_exponent, tower_exponent : float
        Of the fatigue whose gradient is followed; those of the metrics fit single cycles.
    plant_speeds : int
        Mean winds at which the plant is identified.
    excited : int
        Winds of each that are run with and without drawn offsets.
    memory : float
        Length of the impulse responses [s].
    ridge, decay : float
        Of the identification, see `wt_gym.learning.linear_design.identification.identify`.
    first_wind_seed : int
        Seed of the first episode's turbulence; each episode has its own.
    conditions : sequence of mapping
        What of plant, sensors and drives is other than in the environment: its arguments ``variation``, ``sensors`` and
        ``faults`` (`CONDITION_ARGUMENTS`). Episodes have them in turns, one that is listed twice has twice as many.

    Raises
    ------
    ValueError
        For numbers without meaning, or winds held back for evaluations.
    """

    rounds: int = 2
    episodes: int = 96
    held_out: int = 12
    duration: float = 300.0
    skip: float = 20.0
    iterations: int = 300
    batch: int = 6
    learning_rate: float = 1e-3
    weight_decay: float = 1e-3
    noise: float = 0.1
    blade_exponent: float = 6.0
    tower_exponent: float = 4.0
    plant_speeds: int = 4
    excited: int = 3
    memory: float = 15.0
    ridge: float = 1e-3
    decay: float = 4.0
    first_wind_seed: int = 1
    conditions: tuple[Mapping[str, Any], ...] = ({},)

    def __post_init__(self) -> None:
        least = {
            "rounds": 0,
            "episodes": 2,
            "held_out": 1,
            "iterations": 20,  # the learning rate rises over a tenth of them
            "batch": 1,
            "plant_speeds": 1,
            "excited": 2,
        }
        for name, smallest in least.items():
            if getattr(self, name) < smallest:
                raise ValueError(f"{name} must be at least {smallest}, got {getattr(self, name)!r}")
        object.__setattr__(self, "conditions", tuple(_checked_condition(one, self.skip) for one in self.conditions))
        if not self.conditions:
            raise ValueError("conditions must have at least one, {} for that of the environment; got none")
        for field in fields(self):
            if field.name == "conditions":
                continue
            if not math.isfinite(getattr(self, field.name)) or getattr(self, field.name) < 0:
                raise ValueError(f"{field.name} must be finite and not negative, got {getattr(self, field.name)!r}")
        if self.held_out >= self.episodes:
            raise ValueError(f"held_out must be less than the {self.episodes} episodes, got {self.held_out}")
        if len(self.conditions) > self.held_out:
            raise ValueError(
                f"held_out must be at least the number of conditions, {len(self.conditions)}, so that each has a part "
                f"in the choice; got {self.held_out}"
            )
        if not 0.0 < self.memory <= 0.5 * (self.duration - self.skip):
            raise ValueError(
                f"memory must be positive and at most half of the counted time, {0.5 * (self.duration - self.skip):g} "
                f"s; got {self.memory!r}"
            )
        if taken := sorted(set(self.wind_seeds) & set(EVALUATION_WIND_SEEDS)):
            raise ValueError(
                f"the winds of a pretraining must be none of those held back for evaluations, "
                f"{EVALUATION_WIND_SEEDS[0]} to {EVALUATION_WIND_SEEDS[-1]}; first_wind_seed={self.first_wind_seed} "
                f"makes {taken[0]} one of them"
            )

    @property
    def wind_seeds(self) -> range:
        """Turbulence seeds of all recordings."""
        return range(self.first_wind_seed, self.first_wind_seed + self.episodes + self.plant_speeds * self.excited)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> PretrainingOptions:
        """Options of a mapping; those left out are the default ones.

        Raises
        ------
        ValueError
            If a name is unknown or a value has no meaning.
        """
        kinds = {field.name: int if isinstance(field.default, int) else float for field in fields(cls)}
        del kinds["conditions"]
        given: dict[str, Any] = {}
        for name, value in values.items():
            if name == "conditions":
                if not isinstance(value, list | tuple):
                    raise ValueError(f"conditions must be a list of mappings, got {value!r}")
                given[name] = tuple(value)
                continue
            if name not in kinds:
                known = [*kinds, "conditions"]
                raise ValueError(
                    f"pretraining has no option {name!r}; must be of {', '.join(known)}{did_you_mean(name, known)}"
                )
            whole = isinstance(value, int) and not isinstance(value, bool)
            if not (whole or (kinds[name] is float and isinstance(value, float))):
                raise ValueError(f"{name} must be a {'whole ' if kinds[name] is int else ''}number, got {value!r}")
            given[name] = kinds[name](value)
        return cls(**given)


def _checked_condition(given: Any, skip: float) -> dict[str, Any]:
    """A condition, as arguments by their flat names.

    Raises
    ------
    ValueError
        If it is not a mapping, or has arguments that no condition has.
    """
    # the configuration of a training is read without them
    from wt_gym.envs.options import flat_arguments
    from wt_gym.envs.variation import STRUCTURAL

    if not isinstance(given, Mapping):
        raise ValueError(f"each of conditions must be a mapping of arguments of the environment, got {given!r}")
    flat = flat_arguments(given)
    if foreign := [name for name in flat if not name.startswith(_CONDITION_NAMES)]:
        raise ValueError(
            f"each of conditions must have {', '.join(CONDITION_ARGUMENTS)} alone, got {', '.join(map(str, foreign))}"
        )
    if "fault_kinds" in flat:
        kinds = flat["fault_kinds"]
        single = isinstance(kinds, str) or (isinstance(kinds, list | tuple) and len(kinds) == 1)
        if not single or kinds == "all":
            raise ValueError(f"the faults of a condition must be of one kind, got {kinds!r}")
        # its plant is identified from the whole run
        time = flat.setdefault("fault_time", 0.0)
        if not isinstance(time, int | float) or not 0.0 <= time <= skip:
            raise ValueError(
                f"the fault of a condition must begin at one time within the {skip:g} s that do not count, got {time!r}"
            )
    for name in ("pitch_gain", "sensor_delay", *STRUCTURAL):
        if isinstance(flat.get(f"vary_{name}"), list | tuple):
            raise ValueError(
                f"{name} of a condition must be one number, for its plant is identified; got {flat[f'vary_{name}']!r}"
            )
    return flat
