"""From options to the parts of an environment."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from wt_gym.base.options import check_whole_steps
from wt_gym.control import ActionMap, AgentSetpoint, Demand
from wt_gym.control.controllers import AboveRated, Controller
from wt_gym.control.controllers.additions import ResidualPitch
from wt_gym.control.controllers.controller import damps_platform, starting_part
from wt_gym.control.controllers.names import ALIASES, BASELINE, make_controller
from wt_gym.control.controllers.supervisor import supervisor_of
from wt_gym.envs import rewards
from wt_gym.envs.channels import DEFAULT_GROUPS, RESIDUAL_GROUPS
from wt_gym.envs.credit import Credit
from wt_gym.envs.dial import DialCourse, DialTerm, dial_of
from wt_gym.envs.episode_start import EpisodeStarts, RunningStart
from wt_gym.envs.faults import FaultTerm, check_faults
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.lidar import LidarTerm
from wt_gym.envs.observations import Observer
from wt_gym.envs.operation import OWN, Operation, simulator_maker
from wt_gym.envs.power_reference import PowerReferenceTerm
from wt_gym.envs.sea import SeaTerm
from wt_gym.envs.terminations import Costs, EpisodeLength, IdleClock, Limits, standstill_limit
from wt_gym.envs.terms import RewardTerm, Term, hooks
from wt_gym.envs.twin import Twin
from wt_gym.envs.variation import VariationTerm, check_variation
from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
from wt_gym.simulation import Fidelity, Signals
from wt_gym.simulation.contract import SimulatorMaker, TurbineSimulator
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.simulation.fidelity import choose_fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.turbines.model import LossShares, with_site
from wt_gym.turbines.variants import with_electrical, with_generator

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

    from wt_gym.envs.options import EnvOptions
    from wt_gym.envs.turbine_env import WindTurbineEnv


class Parts:
    """Parts of an environment, made by `build`, and views of them."""

    options: EnvOptions
    turbine: Turbine
    wind: WindSampler
    limits: Limits
    length: EpisodeLength
    reward_terms: tuple[RewardTerm, ...]
    control_dt: float
    fidelity: str | Fidelity
    sensors: str  #: "agent" or "all": who reads late, noisy and shifted sensors
    operation: Operation
    observer: Observer
    costs: Costs
    idle: IdleClock
    layout: EnvLayout
    observation_names: np.ndarray
    observation_units: np.ndarray
    action_names: np.ndarray
    action_units: np.ndarray
    starts: EpisodeStarts
    terms: dict[str, Term]  #: features of the environment that are on
    to_reward: Callable[[float, dict[str, float]], float | np.ndarray]  #: of the sum of the terms, and the terms
    reward_names: tuple[str, ...]
    reward_space: spaces.Box
    render_mode: str | None
    outer_steps: int | None
    make_simulator: SimulatorMaker
    made_of: Callable[..., WindTurbineEnv]  #: makes an environment of arguments
    spec: EnvSpec | None
    _running: bool

    def __repr__(self) -> str:
        made_of = f"{self.turbine.name}, {self.wind.label}, {fidelity_of(self.fidelity).name} fidelity"
        return f"<{type(self).__name__}: {made_of}, {self.layout.sizes}>"

    @property
    def simulator(self) -> TurbineSimulator:
        """Simulator of the turbine; None before the first reset and after `close`."""
        return cast("TurbineSimulator", self.operation.simulator)

    @property
    def controller(self) -> Controller | None:
        """Base controller, if one runs."""
        return self.operation.controller

    @property
    def episode_wind(self) -> EpisodeWind:
        """Wind of the episode."""
        return self.operation.wind

    @property
    def signals(self) -> Signals:
        """Every signal of the simulator at the current instant; None before the first reset."""
        return self.operation.signals

    @property
    def demand(self) -> Demand:
        """Present demand on the drives."""
        return self.operation.demand

    @property
    def base(self) -> Demand:
        """Present demand of the base controller."""
        return self.operation.base

    @property
    def setpoint(self) -> AgentSetpoint:
        """Present set points of the agent."""
        return self.operation.setpoint

    @property
    def dial(self) -> dict[str, float] | None:
        """Factors on the weights of the reward that hold for the next step, by name; None without a dial."""
        term = dial_of(self)
        return None if term is None or term.course is None else cast("dict[str, float]", term.info()["dial"])

    def set_dial(self, **factors: float) -> None:
        """Turn the dial: from the next observation on to the end of the episode these factors hold.

        Parameters
        ----------
        **factors : float
            On the weights of ``fatigue``, ``power`` and ``travel``, 1 where left out; their ratios count.

        Raises
        ------
        ValueError
            If the environment has no dial, or a factor has no meaning.
        gymnasium.error.ResetNeeded
            If no episode is running.
        """
        term = dial_of(self)
        if term is None:
            raise ValueError("the environment must have dial_weights to turn its dial, got None")
        turned = DialCourse.of(factors).factors[0]
        if not self._running:
            raise ResetNeeded("the episode is over, or none was started: call reset() before set_dial()")
        term.turn(turned, 0.5 * self.control_dt)


def build(env: Parts, options: EnvOptions) -> None:
    """Make all parts of an environment.

    Raises
    ------
    ValueError
        If options have no meaning together.
    """
    env.options, env.control_dt, env.render_mode = options, options.control_dt, options.render_mode
    turbine = options.turbine if isinstance(options.turbine, Turbine) else load_turbine(options.turbine)
    turbine, _ = with_generator(with_site(turbine, options.site), options.generator)
    electrical, losses = options.electrical, LossShares() if options.electrical.loss_map else None
    turbine = with_electrical(turbine, electrical.torque_lag, losses, electrical.shaft_damping)
    env.turbine = turbine
    check_variation(options.variation, options.wind, options.turbine, options.simulator)
    check_faults(options.faults, options.simulator, turbine)
    env.wind = WindSampler(turbine, options.wind)
    limits, penalty = options.limits, options.rewards.termination_penalty
    standstill = standstill_limit(limits.standstill, turbine, env.wind.parks)
    if limits.line_tension is not None and not turbine.n_lines:
        raise ValueError(f"line_tension_limit must be left out for {turbine.name!r}, which has no mooring lines")
    env.limits = Limits(
        turbine.drivetrain.rated_rotor_speed, limits.overspeed, standstill, penalty, turbine.floater is not None,
        limits.line_tension,
    )  # fmt: skip
    env.reward_terms = rewards.compose(options.rewards.terms)
    env.fidelity = choose_fidelity(turbine, options.fidelity)
    step, count = _inner_steps(env)
    env.length = EpisodeLength(limits.episode_length, env.control_dt)
    env.costs = Costs(turbine, env.control_dt, limits.overspeed, limits.costs)
    chosen = options.actions
    action = ActionMap(
        turbine, env.control_dt, chosen.mode, chosen.pitch, chosen.components, chosen.spans, env.wind.speeds,
        pitch_delay(turbine.pitch, step), chosen.residual,
    )  # fmt: skip
    base = options.controller.base
    runs = action.needs_controller or base not in (BASELINE, *ALIASES)
    controller = copy.deepcopy(make_controller(base, turbine)) if runs else None  # no two environments share its memory
    lidar = LidarTerm(turbine.rotor_diameter, options.observations.lidar, controller)
    residual = _residual_pitch(options, turbine, action)
    env.operation = Operation(
        turbine, action, controller, residual, lidar.lidar, env.fidelity, (step, count), _simulator_maker(env)
    )  # fmt: skip
    env.terms = _terms(env, lidar, step)
    delay = _build_observer(env)
    env.layout = EnvLayout(
        turbine, env.observer.layout, action, env.control_dt, delay, lidar.lidar, env.observer.washed
    )  # fmt: skip
    channels = env.observer.layout.channels
    env.observation_names, env.observation_units = (
        np.array([getattr(c, of) for c in channels]) for of in ("name", "unit")
    )
    env.action_names, env.action_units = np.array(action.names), np.array(action.units)
    spaces_of = cast(Any, env)  # declared by the environment, in whose other base they have a wider type
    spaces_of.action_space = spaces.Box(-1.0, 1.0, (action.size,), np.float32)
    spaces_of.observation_space = spaces.Box(env.observer.layout.low, env.observer.layout.high, dtype=np.float32)
    env.to_reward = _scalar
    if options.rewards.vector:
        credit = ("credit",) if options.rewards.credit else ()
        env.reward_names = (*(term.name for term in env.reward_terms), "termination", *credit)
        env.reward_space = spaces.Box(-np.inf, np.inf, (len(env.reward_names),), np.float32)
        env.to_reward = partial(_vector, env.reward_names)
    if supervisor_of(controller) is None and "set_point" in action.components:
        raise ValueError("action_components 'set_point' needs a base controller with a supervisor: 'discon+supervisor'")
    env.starts = EpisodeStarts(
        turbine, env.wind, env.terms, _running_start(env, controller), options.starts, starting_part(controller)
    )  # fmt: skip


def _inner_steps(env: Parts) -> tuple[float, int]:
    """Step of the simulator [s], and number of such steps in a control step."""
    step = fidelity_of(env.fidelity).step_for(env.turbine.drivetrain.rated_rotor_speed)
    count = round(env.control_dt / step)
    if count < 1 or abs(count * step - env.control_dt) > 1e-6 * step:
        raise ValueError(
            f"control_dt must be a multiple of the simulator's aerodynamic step of {step:.6g} s, "
            f"got {env.control_dt!r} s"
        )
    return step, count


def _residual_pitch(options: EnvOptions, turbine: Turbine, action: ActionMap) -> ResidualPitch | None:
    """Filters of residual pitch, if there is such a pitch and any filter."""
    above = AboveRated.of_turbine(turbine, options.controller.residual_fade)
    residual = ResidualPitch(above, options.controller.residual_washout, action.n_mean)
    has_pitch = action.mode == "residual" and "pitch" in action.components
    return residual if has_pitch and (residual.fades or residual.washes) else None


def _simulator_maker(env: Parts) -> SimulatorMaker:
    options = env.options
    if options.simulator == OWN:
        return env.make_simulator
    return simulator_maker(
        options.simulator, options.turbine, options.render_mode is not None,
        lambda: env.length.longest(env.spec, env.outer_steps),
    )  # fmt: skip


def _terms(env: Parts, lidar: LidarTerm, step: float) -> dict[str, Term]:
    """Terms of the features that are on; the order is that in which they adjust the reward."""
    options, operation, terms = env.options, env.operation, cast("dict[str, Term]", {"lidar": lidar})
    env.idle = IdleClock(env.turbine, operation)
    if not env.wind.parks:
        terms["idle"] = env.idle
    env.sensors = options.observations.sensors or ("all" if options.variation.varies else "agent")
    if options.variation.varies or env.sensors == "all":
        variation = VariationTerm(
            options.variation, env.turbine, operation.action, lidar.lidar, options.observations, env.sensors == "all",
            step,
        )  # fmt: skip
        operation.make_instruments, operation.everyone = variation.instruments, variation.everyone
        terms["variation"] = variation
    if options.faults.kinds is not None:
        terms["fault"] = FaultTerm(env.turbine, options.faults)
    if options.grid.reference is not None:
        terms["power_reference"] = PowerReferenceTerm(env.turbine, options.grid)
    if options.rewards.relative:
        terms["twin"] = twin = Twin(_twin(env), env.wind.turbulence_key)
        if options.rewards.credit:
            dialed = options.dial.weights is not None
            terms["credit"] = Credit(twin, env.reward_terms, env.turbine, operation, env.control_dt, dialed)
    if options.dial.weights is not None:
        terms["dial"] = DialTerm(options.dial, [term.name for term in env.reward_terms], operation)
    if env.turbine.floater is not None:
        terms["sea"] = SeaTerm(env.turbine, options.sea, options.wind.inflow == "steady")
    elif options.sea is not None:
        raise ValueError(f"sea must be left out: {env.turbine.name!r} does not float, got {options.sea!r}")
    if env.render_mode is not None:
        from wt_gym.envs.rendering import Renderer  # matplotlib takes half a second to import

        terms["renderer"] = Renderer(env.turbine, operation, env.render_mode == "human")
    return terms


def _build_observer(env: Parts) -> int:
    """Make the observer; return the control steps by which the agent's readings are late beside the instruments."""
    observed, varies = env.options.observations, env.options.variation.varies
    everyone, action = env.sensors == "all", env.operation.action
    late = 0
    if not (everyone or "sensor_delay" in varies):
        late = check_whole_steps("sensor_delay", observed.delay, env.control_dt, least=0)
    noise = 0.0 if everyone or "sensor_noise" in varies else observed.noise
    usual = RESIDUAL_GROUPS if action.mode == "residual" else DEFAULT_GROUPS
    choice = observed.channels or (usual if env.turbine.floater is None else (*usual, "platform"))
    features = {name: channels for groups in hooks(env.terms.values(), "groups") for name, channels in groups().items()}
    env.observer = Observer(env.turbine, action, env.operation, observed, choice, noise, late, features)
    return late


def _running_start(env: Parts, controller: Controller | None) -> RunningStart | None:
    """Starts of the running turbine, None where episodes start steadily."""
    if env.options.start == "steady" or env.wind.parks:
        return None
    references = env.terms.get("power_reference")
    level = references.mean_share(env.turbine.cut_out) if isinstance(references, PowerReferenceTerm) else 1.0
    return RunningStart(env.turbine, env.fidelity, env.limits.overspeed, level, damps_platform(controller))


def _twin(env: Parts) -> WindTurbineEnv:
    """The turbine under the base controller alone, simulated as this one: it gets the winds that are drawn here."""
    options, turbine, limits = env.options, env.turbine, env.limits
    observed = options.observations
    read = {"sensors": "all", "sensor_noise": observed.noise, "sensor_delay": observed.delay}
    twin = env.made_of(
        turbine=turbine, inflow="steady", wind_speed=(turbine.cut_in, turbine.cut_out), fidelity=env.fidelity,
        control_dt=env.control_dt, episode_length=None, action_mode="residual", action_components=("pitch",),
        controller=copy.deepcopy(options.controller.base), reward=env.reward_terms, termination_penalty=limits.penalty,
        overspeed_limit=limits.overspeed, standstill_limit=limits.standstill, observation=("rotor",), start="steady",
        **(read if env.sensors == "all" else {}),
    )  # fmt: skip
    twin.operation.make_simulator = env.operation.make_simulator
    return twin


def _scalar(reward: float, _: dict[str, float]) -> float:
    """Reward as a number."""
    return reward


def _vector(names: tuple[str, ...], _: float, terms: dict[str, float]) -> np.ndarray:
    """Reward as an array of its terms."""
    return np.array([terms.get(name, 0.0) for name in names], dtype=np.float32)
