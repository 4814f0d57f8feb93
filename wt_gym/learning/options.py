"""Options of trainings, pretrainings, data sets and linear designs. Imports nothing heavy: the commands show them."""

import importlib.util
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.analysis.metrics import FLOATING_COST_WEIGHTS, LIFETIME_COST_WEIGHTS
from wt_gym.base.files import json_values
from wt_gym.base.options import Options, not_empty, option, option_record
from wt_gym.learning.hyperparameters import ALGORITHMS, check_hyperparameters, hyperparameters_for, replaced
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import Turbine

__all__ = [
    "CONDITION_ARGUMENTS", "DatasetConfig", "Excitation", "FeedbackOptions", "LinearDesignTask", "PretrainingOptions",
    "TrainingConfig", "design_task", "excitation_of", "pretraining_environment",
]  # fmt: skip

CONDITION_ARGUMENTS = ("variation", "sensors", "faults", "simulator")
"""Groups and arguments of the environment that a condition of a pretraining may have."""
_CONDITION_NAMES = ("vary_", "sensors", "fault_", "simulator")
_ENVIRONMENT: dict[str, Any] = {
    "controller": "linear_optimal",
    "observation": ["disturbances"],
    "residual_form": "offset",
    "residual_fade": {"pitch": [math.radians(0.5), math.radians(3.0)], "fine_speed": [0.97, 1.02]},
    "residual_washout": None,
    "sensor_washout": None,
    "reward_credit": False,
}
_HYPERPARAMETERS: dict[str, Any] = {
    "learning_rate": 4.0e-4, "gamma": 0.995, "gae_lambda": 0.97, "rollout_steps": 2048, "batch_size": 256,
    "n_epochs": 6, "ent_coef": 0.0, "log_std_init": -0.9, "linear_policy": False, "normalize_rewards": True,
}  # fmt: skip
"""Of a policy on top of a linear law, which adds what that cannot, at the step of the simulator."""
_SPAN = 0.5
"""Of the agent's offsets over the limit that a design of the turbine has by default [-]."""
_MOST_STEPS, _MOST_SECONDS = 10**12, 1e9
"""Beyond these, memory or processes end before the training does."""


@option_record
class TrainingConfig(Options):
    """What to train on, for how long, and how.

    With a pretraining, what ``env_kwargs`` leaves out is that of `pretraining_environment`, and the hyperparameters
    that are left out are those of a policy with hidden layers at the step of the simulator; budgets become the
    ``cost_limits`` of the environment. Files of wind get whole paths.
    """

    title = "training"

    algorithm: str = option("algorithm", default="PPO", choices=tuple(ALGORITHMS))
    env_id: str = option("environment id", default=DEFAULT_ENV)
    env_kwargs: dict[str, Any] = option(
        "arguments of the environment", default={}, kinds=(dict,), allowed="a mapping of names to values"
    )
    hyperparameters: dict[str, Any] = option(
        "hyperparameters of the algorithm; those left out come from agents/hyperparameters", default={},
        kinds=(Mapping,), allowed="a mapping of names to values",
    )  # fmt: skip
    total_steps: int = option(
        "environment steps over all copies, in a command 0 with a pretraining; the last rollout of PPO is finished "
        "beyond them", default=200_000, low=0, high=_MOST_STEPS,
    )  # fmt: skip
    linear_steps: int = option(
        "steps before those, on the linear model of the environment (wt_gym.learning.linear_env), over fifty times as "
        "fast; the learning rate is a sixth then. max_seconds does not count them", default=0, low=0, high=_MOST_STEPS,
    )  # fmt: skip
    max_seconds: float | None = option(
        "wall time after which training stops, counted from zero when it is resumed", default=None, unit="s", low=0.0,
        high=_MOST_SECONDS, otherwise="no limit",
    )  # fmt: skip
    n_envs: int = option(
        "environments in parallel: threads step several of this package, processes those of others", default=8, low=1,
        high=256,
    )  # fmt: skip
    seed: int = option("random numbers of policy and environments", default=0, low=0, high=2**31)
    checkpoint_steps: int = option("steps between checkpoints", default=50_000, low=1, high=_MOST_STEPS)
    checkpoint_minutes: float = option(
        "wall time between checkpoints; 0: none", default=10.0, unit="min", low=0.0, high=_MOST_SECONDS
    )
    eval_every: int = option(
        "steps between evaluations against the baseline controller in other winds; 0: none", default=20_000, low=0,
        high=_MOST_STEPS,
    )  # fmt: skip
    eval_winds: int = option("number of these winds", default=2, low=1, high=8)
    eval_seconds: float = option("length of each", default=60.0, unit="s", low=15.0, high=3600.0)
    pretraining: dict[str, Any] | None = option(
        "options of a pretraining, which follows the gradient of the cost on an identified linear model, on top of "
        "linear_optimal: as rounds=3 episodes=192", default=None, kinds=(dict,), otherwise="no pretraining",
        allowed="a mapping of options to values",
    )  # fmt: skip
    budgets: Mapping[str, float] | None = option(
        "limits of costs that PPO is to keep by Lagrangian multipliers: pitch_travel [rad/d], rotor_speed over rated "
        "[-], tip_clearance [m], tower_acceleration [m/s^2]", default=None, check=not_empty, otherwise="none",
    )  # fmt: skip
    tensorboard: bool | None = option("write figures for TensorBoard", default=None, otherwise="if it is installed")

    def check(self) -> None:
        """Put budgets and pretraining into the arguments of the environment; refuse what does not go together."""
        from wt_gym.envs.options import with_whole_paths
        from wt_gym.envs.terminations import PITCH_TRAVEL

        if self.pretraining is None and not self.total_steps:
            raise ValueError("total_steps must be at least 1 without a pretraining, got 0")
        if self.tensorboard and importlib.util.find_spec("tensorboard") is None:
            raise ValueError("tensorboard is not installed; it comes with the extra 'train'")
        for name in ("budgets", "pretraining"):
            if getattr(self, name) is not None and self.algorithm != "PPO":
                raise ValueError(f"{name} must be left out except with the algorithm PPO, got {self.algorithm!r}")
        if self.linear_steps and (self.pretraining is not None or self.budgets is not None or self.algorithm != "PPO"):
            raise ValueError(
                "linear_steps must be left out except with PPO without pretraining and budgets, got "
                f"{self.linear_steps} with {self.algorithm}, pretraining={self.pretraining}, budgets={self.budgets}"
            )
        others = sorted(set(self.budgets or {}) - {PITCH_TRAVEL})  # a pretraining forecasts the travel of its offsets
        if self.pretraining is not None and not self.total_steps and others:
            raise ValueError(
                f"a pretraining alone keeps a budget of {PITCH_TRAVEL}, and PPO after it the others: give steps, or "
                f"leave out {', '.join(others)}"
            )
        if self.budgets is not None:
            limits = self.env_kwargs.get("cost_limits", self.budgets)
            if limits != self.budgets:
                raise ValueError(f"cost_limits must be the budgets or left out, got {limits!r} and {self.budgets!r}")
            self._set("env_kwargs", {**self.env_kwargs, "cost_limits": dict(self.budgets)})
        if self.pretraining is not None:
            self._set("env_kwargs", pretraining_environment(self.env_id, self.env_kwargs))
            self._set("pretraining", asdict(PretrainingOptions.from_dict(self.pretraining)))
        self._set("env_kwargs", with_whole_paths(self.env_kwargs))
        if self.env_kwargs.get("vector_reward"):
            raise ValueError("the reward of a training must be one number, got its terms: leave out vector_reward")
        given = check_hyperparameters(self.algorithm, self.hyperparameters)
        self._set("hyperparameters", given if self.pretraining is None else replaced(_HYPERPARAMETERS, given))
        if self.pretraining is not None and self.resolved["normalize_observations"]:
            raise ValueError("pretraining needs normalize_observations: false")

    @property
    def resolved(self) -> dict[str, Any]:
        """Hyperparameters with those that the package brings along."""
        return hyperparameters_for(self.algorithm, self.env_id, overrides=self.hyperparameters)

    def with_hyperparameters(self) -> "TrainingConfig":
        """Give the configuration with every hyperparameter written out, as a record keeps it."""
        return replace(self, hyperparameters=self.resolved)

    def limited(self, total_steps: int | None, max_seconds: float | None) -> "TrainingConfig":
        """Give the configuration with other limits, where there are any."""
        limits: dict[str, Any] = {"total_steps": total_steps, "max_seconds": max_seconds}
        return replace(self, **{name: value for name, value in limits.items() if value is not None})

    def continues(self, record: Any) -> bool:
        """Return True for the training of a record's configuration, except for seed and limits."""
        free = dict.fromkeys(("seed", "total_steps", "max_seconds"))
        try:
            configs = (self.with_hyperparameters(), TrainingConfig.from_dict(record).with_hyperparameters())
        except (TypeError, ValueError):
            return False
        # through JSON: of a tuple a record has a list
        mine, recorded = (json_values(asdict(config) | free) for config in configs)
        return mine == recorded


@option_record
class PretrainingOptions(Options):
    """How to pretrain."""

    title = "pretraining"

    rounds: int = option(
        "recordings under the current policy with an optimization behind each; 0: no pretraining", default=1, low=0
    )
    episodes: int = option("episodes of a round", default=384, low=2)
    held_out: int = option(
        "episodes that take no part in the optimization and choose between its steps", default=48, low=1
    )
    duration: float = option("length of an episode", default=300.0, unit="s", low=0)
    skip: float = option("start of it that does not count", default=20.0, unit="s", low=0)
    # the learning rate rises over a tenth of them
    iterations: int = option("steps of the optimizer in a round", default=1500, low=20)
    batch: int = option("episodes of a step", default=8, low=1)
    learning_rate: float = option("learning rate of the optimizer", default=1.5e-3, low=0)
    weight_decay: float = option("decay of the weights of the policy", default=1e-3, low=0)
    noise: float = option(
        "standard deviation of the noise on the observations, in their normalized units", default=0.1, low=0
    )
    blade_exponent: float = option(
        "exponent of the blades' fatigue whose gradient is followed; that of the metrics fits single cycles",
        default=6.0, low=0,
    )  # fmt: skip
    tower_exponent: float = option("exponent of the tower's", default=4.0, low=0)
    plant_speeds: int = option("mean winds at which the plant is identified", default=4, low=1)
    excited: int = option("winds of each that are run with and without drawn offsets", default=3, low=2)
    memory: float = option("length of the impulse responses", default=15.0, unit="s", low=0, above=True)
    ridge: float = option("ridge of the identification, see `wt_gym.learning.recording.identify`", default=1e-3, low=0)
    decay: float = option("rise of the ridge over the taps", default=4.0, low=0)
    first_wind_seed: int = option("turbulence seed of the first episode; each has its own", default=1, low=0)
    conditions: tuple[Mapping[str, Any], ...] = option(
        "plant, sensors and drives other than those of the environment: its arguments variation, sensors, faults and "
        "simulator. Episodes have them in turns, one that is listed twice has twice as many", default=({},),
        kinds=(tuple,), check=not_empty, allowed="a list of mappings",
    )  # fmt: skip

    def check(self) -> None:
        """Refuse numbers without meaning together, and winds held back for evaluations."""
        from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS

        self._set("conditions", tuple(_checked_condition(one, self.skip) for one in self.conditions))
        if self.held_out >= self.episodes:
            raise ValueError(f"held_out must be less than the {self.episodes} episodes, got {self.held_out}")
        if len(self.conditions) > self.held_out:
            raise ValueError(
                f"held_out must be at least the number of conditions, {len(self.conditions)}, so that each has a part "
                f"in the choice; got {self.held_out}"
            )
        if not self.memory <= 0.5 * (self.duration - self.skip):
            raise ValueError(
                f"memory must be at most half of the counted time, {0.5 * (self.duration - self.skip):g} s; got "
                f"{self.memory!r}"
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


def _checked_condition(given: Any, skip: float) -> dict[str, Any]:
    """Arguments of a condition by their flat names."""
    from wt_gym.envs.options import flat_arguments
    from wt_gym.envs.variation import STRUCTURAL

    if not isinstance(given, Mapping):
        raise ValueError(f"each of conditions must be a mapping of arguments of the environment, got {given!r}")
    flat = flat_arguments(given)
    if foreign := [name for name in flat if not name.startswith(_CONDITION_NAMES)]:
        raise ValueError(
            f"each of conditions must have {', '.join(CONDITION_ARGUMENTS)} alone, got {', '.join(map(str, foreign))}"
        )
    if callable(flat.get("simulator")):
        raise ValueError("the simulator of a condition must be a name or a mapping, got a function")
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


def without_observer(controller: str) -> str:
    """Name of a base controller without its observer and the damper beside it: linear optimal pitch has both.

    Examples
    --------
    >>> without_observer("discon+side_side_damper+observer+yaw")
    'discon+yaw'
    """
    from wt_gym.control.controllers.names import parse_name

    name = parse_name(controller)
    parts = name.target.split("+")
    if "observer" in parts:
        parts = [part for part in parts if part not in ("observer", "side_side_damper")]
    return replace(name, target="+".join(parts)).text


def pretraining_environment(env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment whose policy is pretrained, with what is not given set as pretraining needs it.

    The agent acts by offsets of the pitch alone on the linear optimal controller, which takes the place of the
    turbine's own where the id has additions to that; it sees what no action changes, and fades as the controller does.
    Its offsets are within the abilities of the pitch drives of the turbine. It acts at every step of the simulator, and
    the reward is the integral over it; what an early end costs stays the same time of operation. A ValueError where the
    actions of the id do not move the pitch, or its base controller is without the turbine's own, which the linear
    optimal one could replace.
    """
    from wt_gym.control.controllers.linear_optimal import default_limits
    from wt_gym.control.controllers.names import BASELINE, parse_name
    from wt_gym.envs.options import argument_default, flat_arguments, registered_arguments
    from wt_gym.simulation.fidelity import choose_fidelity
    from wt_gym.simulation.fidelity import fidelity as fidelity_of
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
        name = parse_name(without_observer(str(whole["controller"])))
        parts = name.target.split("+")
        if BASELINE not in parts:
            raise ValueError(
                f"pretraining needs a base controller with linear_pitch, and {env_id} has {whole['controller']!r}; "
                "give env_kwargs a controller such as 'linear_optimal', or leave pretraining out"
            )
        below = "+".join("linear_optimal" if part == BASELINE else part for part in parts)
        own["controller"] = replace(name, target=below).text
    turbine = whole.get("turbine", argument_default("turbine"))
    turbine = load_turbine(turbine) if isinstance(turbine, str) else turbine
    fidelity = fidelity_of(choose_fidelity(turbine, whole.get("fidelity")))
    own["control_dt"] = fidelity.step_for(turbine.drivetrain.rated_rotor_speed)
    limit, rate = default_limits(turbine)
    spans = {"pitch": _SPAN * limit, "pitch_mean": _SPAN * limit, "pitch_rate": rate}
    seen = ["disturbances", "dial"] if whole.get("dial_weights") is not None else ["disturbances"]
    return {**_ENVIRONMENT, **own, "observation": seen, "action_spans": spans, **env_kwargs}


@option_record
class Excitation(Options):
    """Offsets drawn for an identification: levels that are held, evenly drawn, for times drawn evenly in the logarithm.

    They are small, and a level of the mean is followed by its opposite for as long: so the azimuth stays near that of
    the run without offsets, and blades meet the same eddies.
    """

    title = "excitation"

    mean: float = option("greatest level of the mean", default=math.radians(0.2), unit="rad", low=0)
    tilt_yaw: float = option("greatest level of tilt and of yaw", default=math.radians(0.6), unit="rad", low=0)
    shortest: float = option("shortest time that a level is held", default=0.2, unit="s", low=0, above=True)
    longest: float = option("longest", default=5.0, unit="s", low=0, above=True)

    def check(self) -> None:
        """Refuse times that do not rise."""
        if self.longest < self.shortest:
            raise ValueError(f"longest must be at least shortest, {self.shortest:g} s, got {self.longest:g}")

    def draw(self, steps: int, dt: float, seed: int) -> NDArray[np.float64]:
        """Levels (3, steps) of mean, tilt and yaw [rad]."""
        rng = np.random.default_rng(seed)
        out = np.zeros((3, steps))
        for which, size in enumerate((self.mean, self.tilt_yaw, self.tilt_yaw)):
            row, k = out[which], 0
            while k < steps:
                held = math.exp(rng.uniform(math.log(self.shortest), math.log(self.longest)))
                n, level = max(round(held / dt), 1), size * rng.uniform(-1.0, 1.0)
                row[k : k + n] = level
                k += n
                if which == 0:
                    row[k : k + n] = -level
                    k += n
        return out


@option_record
class FeedbackOptions(Options):
    """How a feedback is fitted."""

    title = "feedback"

    travel_weight: float = option("factor on the cost of pitch travel: a point of a front", default=1.0, low=0)
    power_weight: float = option("factor on the cost of power", default=1.0, low=0)
    speed_weight: float = option(
        "cost of the mean square change of the rotor speed over the rated one", default=30.0, low=0
    )
    mean_weight: float = option("cost of the mean square of the mean offset", default=8.0, unit="1/rad^2", low=0)
    tilt_yaw_weight: float = option("the same of tilt and yaw", default=0.03, unit="1/rad^2", low=0)
    # fatigue less two would be exact, and would fit single cycles
    amplitude_exponent: float = option(
        "exponent of the weights of flapwise loads in the local amplitude", default=4.0, low=0
    )
    tower_exponent: float = option("the same for the tower", default=2.0, low=0)
    ridge: float = option("ridge over the diagonal of the normal equations", default=1e-2, low=0)
    passes: int = option("number of passes", default=4, low=1)
    longest: float = option("delay up to which the past counts", default=15.0, unit="s", low=0, above=True)
    washout: float = option(
        "time constant of what lasts in the mean channel and aside, which no offset answers", default=30.0, unit="s",
        low=0, above=True,
    )  # fmt: skip
    still: float = option(
        "rate below which travel counts as a square", default=math.radians(0.3), unit="rad/s", low=0, above=True
    )
    window: float = option("window of the local amplitude", default=5.0, unit="s", low=0, above=True)
    smooth: float = option("length of the mean that is taken off a load", default=20.0, unit="s", low=0, above=True)
    skip: float = option("start of each run that does not count", default=20.0, unit="s", low=0)
    weights: Mapping[str, float] = option(
        "weights of the cost, see `wt_gym.analysis.metrics`", default=LIFETIME_COST_WEIGHTS,
        choices=(*LIFETIME_COST_WEIGHTS, "platform_pitch_std"),
    )  # fmt: skip


@option_record
class LinearDesignTask(Options):
    """What a design of linear optimal pitch is made from."""

    title = "design"

    speeds: tuple[float, ...] = option(
        "rising mean winds at which plant and feedback are made", default=(), unit="m/s", flat="wind_speed"
    )
    seeds: tuple[int, ...] = option(
        "turbulence seeds of the training winds in which disturbances are recorded", default=(1, 2, 3, 4, 5, 6),
        flat="wind_seeds",
    )  # fmt: skip
    excited: int = option("seeds, the first ones, that are run with drawn offsets too", default=3, low=2)
    duration: float = option("length of a run", default=300.0, unit="s", low=0)
    base: str = option("base controller", default="side_side_damper")
    limit: float = option("largest offset", default=math.radians(4.0), unit="rad", low=0)
    rate_limit: float = option("largest rate of offsets", default=math.radians(3.0), unit="rad/s", low=0, above=True)
    fade: float = option(
        "collective pitch above fine pitch from which on offsets act in full", default=math.radians(3.0), unit="rad"
    )
    fine_speed: tuple[float, float] | None = option(
        "rotor speed over the rated one at which offsets begin and act in full at fine pitch", default=(0.97, 1.02),
        otherwise="they do not act there",
    )  # fmt: skip
    memory: float = option("length of the impulse responses", default=25.0, unit="s", low=0, above=True)
    ridge: float = option("ridge of the identification, see `wt_gym.learning.recording.identify`", default=1e-3, low=0)
    decay: float = option("rise of the ridge over the taps", default=4.0, low=0)
    fidelity: str | None = option("fidelity of the runs", default=None, otherwise="by the turbine")
    excitation: Excitation = option("drawn offsets", default=Excitation(), kinds=(Excitation,))
    feedback: FeedbackOptions = option("options of the feedback", default=FeedbackOptions(), kinds=(FeedbackOptions,))
    least_power: float = option(
        "change of power that the forecast of a feedback must keep at every wind speed: where it does not, the cost of "
        "power is doubled until it does", default=-0.003, low=-1.0, high=0.0,
    )  # fmt: skip

    waves: bool = option("reading of the elevation of the sea at a floating platform", default=False)

    def check(self) -> None:
        """Refuse winds and times without meaning together, and seeds that are not for training."""
        from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS

        if not self.speeds or any(b <= a for a, b in zip(self.speeds, self.speeds[1:], strict=False)):
            raise ValueError(f"speeds must be one or more rising wind speeds, got {self.speeds}")
        if foreign := [seed for seed in self.seeds if seed not in TRAINING_WIND_SEEDS]:
            raise ValueError(
                f"seeds of a design must be of the training winds, {TRAINING_WIND_SEEDS[0]} to "
                f"{TRAINING_WIND_SEEDS[-1]}; got {', '.join(map(str, foreign))}"
            )
        if len(set(self.seeds)) < len(self.seeds) or self.excited > len(self.seeds):
            raise ValueError(
                f"there must be at least 2 different seeds with 2 or more excited; got seeds {self.seeds} and "
                f"{self.excited} excited"
            )
        if self.feedback.skip + 2.0 * self.memory > self.duration:
            raise ValueError(
                f"a run must last at least {self.feedback.skip + 2.0 * self.memory:g} s (start and twice the memory of "
                f"the plant), got {self.duration!r} s"
            )

    @property
    def runs(self) -> list[tuple[float, int, bool]]:
        """Wind speed, seed, and whether offsets are drawn, of every run."""
        return [
            (speed, seed, excited)
            for speed in self.speeds
            for k, seed in enumerate(self.seeds)
            for excited in ((False, True) if k < self.excited else (False,))
        ]


def excitation_of(turbine: Turbine) -> Excitation:
    """Drawn offsets for a turbine: longer levels of the mean move a floating platform."""
    return Excitation() if turbine.floater is None else Excitation(math.radians(0.2), longest=12.0)


def design_task(turbine: Turbine, feedback: Mapping[str, Any] | None = None, **options: Any) -> LinearDesignTask:
    """Task of a design with options of `LinearDesignTask` and `FeedbackOptions`.

    On a floating turbine the defaults hold a period of the platform, and the cost has the motion of the platform.
    """
    own: dict[str, Any] = {}
    of_feedback: dict[str, Any] = {}
    if turbine.floater is not None:
        own = {"memory": 60.0, "duration": 600.0, "excitation": excitation_of(turbine)}
        of_feedback = dict.fromkeys(("longest", "washout", "skip"), 60.0)  # [s], two periods of a platform
        of_feedback |= {"smooth": 120.0, "weights": FLOATING_COST_WEIGHTS}
    return LinearDesignTask(**own | options, feedback=FeedbackOptions(**of_feedback | dict(feedback or {})))


@option_record
class DatasetConfig(Options):
    """What to record: ``namespace/name-vN`` by an agent.

    That is "baseline", "random", a controller with parameters as ``ipc:bandwidth=0.1``, or the path of a trained model.
    """

    title = "dataset"

    agent: str
    dataset_id: str
    env_id: str | None = option(
        "environment id",
        default=None,
        otherwise="wt_gym/NREL5MW-Turbulent-v1, for a trained model that of its training",
    )
    env_kwargs: dict[str, Any] = option(
        "arguments on top of `wt_gym.learning.datasets.ENV_KWARGS`, for a trained model of those of its training",
        default={}, kinds=(dict,), allowed="a mapping of names to values",
    )  # fmt: skip
    episodes: int = option("number of episodes", default=20, low=1)
    noise: float = option(
        "standard deviation of normal noise on the actions, which are kept within their bounds", default=0.0, low=0
    )
    seed: int = option("seed of the first episode, of its winds too; the next ones count on", default=0, low=0)
    random_episodes: int = option("episodes of random actions, for the lower reference score", default=2, low=1)
    allow_other_environment: bool = option(
        "take a trained model into other noise, action spans or another base controller than in its training",
        default=False,
    )  # fmt: skip

    def check(self) -> None:
        """Give files of wind whole paths."""
        from wt_gym.envs.options import with_whole_paths

        self._set("env_kwargs", with_whole_paths(self.env_kwargs))
