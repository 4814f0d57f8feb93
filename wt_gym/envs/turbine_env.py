"""The Gymnasium environment."""

from __future__ import annotations

import copy
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from wt_gym.base.errors import ControllerError, SimulationError
from wt_gym.control import ActionMap, Lidar
from wt_gym.control.controllers import AboveRated, lidar_of, make_controller, starting_part
from wt_gym.control.controllers.additions import ResidualPitch, yaw_drive_of
from wt_gym.control.controllers.fault_supervisor import fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import linear_part
from wt_gym.control.controllers.names import ALIASES, BASELINE
from wt_gym.control.controllers.supervisor import supervisor_of
from wt_gym.envs import rewards
from wt_gym.envs.arguments import check_whole_steps, shown
from wt_gym.envs.costs import Costs
from wt_gym.envs.description import describe
from wt_gym.envs.dial import DialCourse, DialDraws, dialed
from wt_gym.envs.ending import EpisodeLength, Limits, registered_limit, standstill_limit, tip_clearance
from wt_gym.envs.episode_start import Beginning, EpisodeStarts
from wt_gym.envs.fault_draws import ICED, FaultDraws
from wt_gym.envs.idling import IdleClock
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.manual import manual
from wt_gym.envs.observable import DEFAULT_GROUPS, RESIDUAL_GROUPS
from wt_gym.envs.observations import Observer
from wt_gym.envs.operation import Operation, make_simulator
from wt_gym.envs.options.dial import DIAL_NAMES
from wt_gym.envs.options.environment import (
    RENDER_MODES,
    EnvOptions,
    named_arguments,
    options_of,
    plain_spec,
    signature,
)
from wt_gym.envs.options.faults import GRID_KINDS
from wt_gym.envs.options.variation import STRUCTURAL
from wt_gym.envs.power_reference import AHEAD, PowerReferenceDraws
from wt_gym.envs.readers import ObservationContext
from wt_gym.envs.running_start import RunningStart
from wt_gym.envs.simulators import OWN, simulator_maker
from wt_gym.envs.snapshot import EnvSnapshot
from wt_gym.envs.twin import Twin
from wt_gym.envs.variation import VariationDraws, check_winds
from wt_gym.envs.wind_sampler import WindSampler
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.simulation.fidelity import choose_fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.turbines.model import with_site
from wt_gym.turbines.variants import LossShares, with_electrical, with_generator

if TYPE_CHECKING:
    from typing import Self

    from gymnasium.envs.registration import EnvSpec

    from wt_gym.control import AgentSetpoint, Demand
    from wt_gym.control.controllers import Controller
    from wt_gym.envs.rendering import Renderer
    from wt_gym.envs.twin import TwinSnapshot
    from wt_gym.envs.variation import DrawnVariation
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.simulation import Signals
    from wt_gym.simulation.contract import SimulatorMaker, TurbineSimulator

__all__ = ["WindTurbineEnv", "turbine_env_of"]

# What an episode remembers beside the turbine in operation, the sensors and the random numbers
_KEPT = ("reward_terms", "_action", "_observation", "_saturated", "_steps", "_running", "_failed", "_dial", "idle")


class WindTurbineEnv(gym.Env[np.ndarray, np.ndarray]):
    __doc__ = manual()
    __signature__ = signature()
    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012 - as its base
    make_simulator: SimulatorMaker = staticmethod(make_simulator)
    """Makes the simulator of an episode's turbine, at the first reset; another one may take its place."""

    observation_space: spaces.Box
    action_space: spaces.Box

    def __init__(self, *positional: Any, **arguments: Any):
        self._make(options_of(named_arguments(positional, arguments)))

    @classmethod
    def of(cls, options: EnvOptions) -> Self:
        """Make an environment of options that are made already."""
        env = cls.__new__(cls)
        env._make(options)
        return env

    def _make(self, options: EnvOptions) -> None:
        self.options = options
        limits, observed = options.limits, options.observations
        turbine = options.turbine if isinstance(options.turbine, Turbine) else load_turbine(options.turbine)
        self.turbine, _ = with_generator(with_site(turbine, options.site), options.generator)
        electrical = options.electrical
        losses = LossShares() if electrical.loss_map else None
        self.turbine = with_electrical(self.turbine, electrical.torque_lag, losses, electrical.shaft_damping)
        self.wind = WindSampler(self.turbine, options.wind)
        standstill = standstill_limit(limits.standstill, self.turbine, self.wind.parks)
        rated = self.turbine.drivetrain.rated_rotor_speed
        self.limits = Limits(rated, limits.overspeed, standstill, options.rewards.termination_penalty)
        self.reward_terms = rewards.compose(options.rewards.terms)
        self.control_dt, self.fidelity = options.control_dt, choose_fidelity(self.turbine, options.fidelity)
        step, count = self._inner_steps()
        self.length = EpisodeLength(limits.episode_length, self.control_dt)
        self.outer_steps: int | None = None  # after which an episode ends from outside, where that is told
        chosen = options.actions
        action = ActionMap(
            self.turbine, self.control_dt, chosen.mode, chosen.pitch, chosen.components, chosen.spans, self.wind.speeds,
            pitch_delay(self.turbine.pitch, step), chosen.residual,
        )  # fmt: skip
        base, controller = options.controller.base, None
        if action.needs_controller or base not in (BASELINE, *ALIASES):  # a copy: no two share its memory
            controller = copy.deepcopy(make_controller(base, self.turbine))
        residual = self._residual_pitch(action)
        lidar = _lidar(observed.lidar, controller)
        self.sensors = observed.sensors or ("all" if options.variation.varies else "agent")
        self._draws = self._variation_draws(action, lidar or Lidar.for_rotor(self.turbine.rotor_diameter), step)
        apart = self._draws is None or not (self._draws.everyone or "sensor_noise" in options.variation.varies)
        groups = observed.channels
        if groups is None:
            groups = RESIDUAL_GROUPS if action.mode == "residual" else DEFAULT_GROUPS
        late = self._late_steps()
        breakages = self._breakages()
        references = None if options.grid.reference is None else PowerReferenceDraws(self.turbine, options.grid)
        self._observer = observer = Observer(
            self.turbine, action, groups, observed.noise if apart else 0.0, late, observed.history, lidar, residual,
            observed.washout, yaw_drive_of(controller), linear_part(controller), supervisor_of(controller),
            references is not None, options.dial.weights is not None,
        )  # fmt: skip
        self.operation = Operation(
            self.turbine, action, controller, residual, observer.lidar, self.fidelity, step, count, self._maker(),
            self._draws,
        )  # fmt: skip
        self._costs = Costs(self.turbine, self.control_dt, limits.overspeed, limits.costs)
        self.idle = IdleClock(self.turbine)
        self.layout = EnvLayout(
            self.turbine, observer.layout, action, self.control_dt, late, observer.lidar, observer.washed
        )
        self.action_space = spaces.Box(-1.0, 1.0, (action.size,), np.float32)
        self.observation_space = spaces.Box(observer.layout.low, observer.layout.high, dtype=np.float32)
        self._vector_reward = options.rewards.vector
        if self._vector_reward:
            self.reward_names = (*(term.name for term in self.reward_terms), "termination")
            self.reward_space = spaces.Box(-np.inf, np.inf, (len(self.reward_names),), np.float32)
        self.render_mode = options.render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_dt))}
        self._observation: np.ndarray | None = None
        self._saturated: tuple[str, ...] = ()
        self._twin = Twin(self._make_twin(), self.wind.turbulence_key) if options.rewards.relative else None
        if supervisor_of(controller) is None and "set_point" in action.components:
            raise ValueError(
                "action_components 'set_point' needs a base controller with a supervisor: 'discon+supervisor'"
            )
        running = self._running_start(references)
        self.dials: DialDraws | None = None  # draws the factors on the weights of the reward
        if options.dial.weights is not None:
            self.dials = DialDraws(options.dial, [term.name for term in self.reward_terms])
        self._dial: DialCourse | None = None
        self._starts = EpisodeStarts(
            self.turbine, self.wind, running, options.starts, starting_part(controller), references, self.dials,
            breakages,
        )  # fmt: skip
        self._renderer = self._make_renderer()
        self._running = self._failed = self._seeded = False
        self._steps = 0

    # ---- parts ----

    def _maker(self) -> SimulatorMaker:
        """What makes the simulator of the options."""
        options = self.options
        if options.simulator == OWN:
            return self.make_simulator
        pictured = options.render_mode is not None
        return simulator_maker(
            options.simulator, options.turbine, pictured, lambda: self.length.longest(self.spec, self.outer_steps)
        )

    def _inner_steps(self) -> tuple[float, int]:
        """Step of the simulator [s] and how many make a control step."""
        step = fidelity_of(self.fidelity).step_for(self.turbine.drivetrain.rated_rotor_speed)
        count = round(self.control_dt / step)
        if count < 1 or abs(count * step - self.control_dt) > 1e-6 * step:
            raise ValueError(
                f"control_dt must be a multiple of the simulator's aerodynamic step of {step:.6g} s, "
                f"got {self.control_dt!r} s"
            )
        return step, count

    def _variation_draws(self, action: ActionMap, lidar: Lidar, step: float) -> VariationDraws | None:
        """What draws the variation of episodes; None where nothing varies and all sensors of controllers are exact."""
        options = self.options
        variation, everyone = options.variation, self.sensors == "all"
        if not (variation.varies or everyone):
            return None
        check_winds(variation, options.wind)
        model = isinstance(options.turbine, str) and options.turbine.lower().endswith(".fst")
        if model and options.simulator != OWN and any(name in STRUCTURAL for name in variation.varies):
            raise ValueError(
                f"variation: {', '.join(STRUCTURAL)} must be left out where OpenFAST simulates a model of its own"
            )
        return VariationDraws(variation, self.turbine, action, lidar, options.observations, everyone, step)

    def _breakages(self) -> FaultDraws | None:
        """What draws the faults of episodes, None where nothing breaks."""
        options = self.options
        kinds = options.faults.kinds
        if kinds is None:
            return None
        if ICED in kinds and options.simulator != OWN:
            raise ValueError(f"fault_kinds must be without {ICED} where another simulator has the blades")
        if set(GRID_KINDS) & set(kinds) and not self.turbine.drivetrain.takes_torque:
            raise ValueError(f"fault_kinds must be without {', '.join(GRID_KINDS)} where the generator is a damper")
        return FaultDraws(self.turbine, options.faults)

    def _late_steps(self) -> int:
        """Control steps by which the agent's readings are late, beside what the instruments are."""
        options = self.options
        if self.sensors == "all" or "sensor_delay" in options.variation.varies:
            return 0
        return check_whole_steps("sensor_delay", options.observations.delay, self.control_dt, least=0)

    def _residual_pitch(self, action: ActionMap) -> ResidualPitch | None:
        """What residual pitch passes on its way to the blades, if there is such a pitch and anything to pass."""
        chosen = self.options.controller
        try:
            above = AboveRated.of_turbine(self.turbine, chosen.residual_fade)
        except ValueError as error:
            raise ValueError(f"residual_{error}") from error
        residual = ResidualPitch(above, chosen.residual_washout, action.n_mean)
        has_pitch = action.mode == "residual" and "pitch" in action.components
        return residual if has_pitch and (residual.fades or residual.washes) else None

    def _running_start(self, references: PowerReferenceDraws | None) -> RunningStart | None:
        """Where episodes get their starts from, None where they are steady."""
        if self.options.start == "steady" or self.wind.parks:
            return None
        level = 1.0 if references is None else references.mean_share(self.turbine.cut_out)
        return RunningStart(self.turbine, self.fidelity, self.limits.overspeed, level)

    def _make_twin(self) -> WindTurbineEnv:
        """Make the turbine under the base controller alone: it gets the winds that are drawn here, and has none itself.

        It is simulated as this one.
        """
        options = self.options
        observed = options.observations
        read = {"sensors": "all", "sensor_noise": observed.noise, "sensor_delay": observed.delay}
        twin = WindTurbineEnv(
            turbine=self.turbine, inflow="steady", wind_speed=(self.turbine.cut_in, self.turbine.cut_out),
            fidelity=self.fidelity, control_dt=self.control_dt, episode_length=None, action_mode="residual",
            action_components=("pitch",), controller=copy.deepcopy(options.controller.base), reward=self.reward_terms,
            termination_penalty=self.limits.penalty, overspeed_limit=self.limits.overspeed,
            standstill_limit=self.limits.standstill, observation=("rotor",), start="steady",
            **(read if self.sensors == "all" else {}),
        )  # fmt: skip
        twin.operation.make_simulator = self.operation.make_simulator
        return twin

    def _make_renderer(self) -> Renderer | None:
        if self.render_mode is None:
            return None
        from wt_gym.envs.rendering import Renderer  # matplotlib takes half a second to import

        return Renderer(self.turbine)

    # ---- what it is made of and what it is in the midst of ----

    def __repr__(self) -> str:
        fidelity = fidelity_of(self.fidelity).name
        return (
            f"<{type(self).__name__}: {self.turbine.name}, {self.wind.label}, {fidelity} fidelity, {self.layout.sizes}>"
        )

    def __str__(self) -> str:
        return describe(self, self.spec)

    def __format__(self, spec: str) -> str:
        """Name and id in one line: wrappers of Gymnasium put what they enclose into an f-string."""
        return format(super().__str__(), spec)

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` made it of, groups of options as mappings: those have a form in JSON."""
        return self.__dict__.get("_spec")

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = plain_spec(spec)

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
        """Every signal of the simulator at the present instant; None before the first reset."""
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
        """What the agent asks for at present."""
        return self.operation.setpoint

    @property
    def termination_penalty(self) -> float:
        """What is taken off the reward when an episode is terminated."""
        return self.limits.penalty

    @property
    def overspeed_limit(self) -> float:
        """Highest rotor speed over rated."""
        return self.limits.overspeed

    @property
    def standstill_limit(self) -> float:
        """Lowest rotor speed over rated."""
        return self.limits.standstill

    @property
    def dial(self) -> dict[str, float] | None:
        """Factors on the weights of the reward that hold for the next step, by name; None without a dial."""
        return None if self._dial is None else dict(zip(DIAL_NAMES, self._factors(self._dial), strict=True))

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
        if self.dials is None:
            raise ValueError("the environment must have dial_weights to turn its dial, got None")
        turned = DialCourse.of(factors)
        if not self._running or self._dial is None:
            raise ResetNeeded("the episode is over, or none was started: call reset() before set_dial()")
        self._dial = self._dial.changed(self.signals["time"] + 0.5 * self.control_dt, turned.factors[0])

    def _factors(self, dial: DialCourse) -> tuple[float, ...]:
        """Factors of the present instant."""
        return dial.at(self.signals["time"])

    @property
    def observation_names(self) -> np.ndarray:
        """Name of every component of an observation."""
        return np.array(self.layout.observation.names)

    @property
    def observation_units(self) -> np.ndarray:
        """Unit of what every component of an observation stands for, "-" for none."""
        return np.array([channel.unit for channel in self.layout.observation.channels])

    @property
    def action_names(self) -> np.ndarray:
        """Name of every component of an action."""
        return np.array(self.layout.action.names)

    @property
    def action_units(self) -> np.ndarray:
        """Unit of what every component of an action stands for."""
        return np.array(self.layout.action.units)

    # ---- an episode ----

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            See "Starting state" in the class documentation.

        Returns
        -------
        observation : numpy.ndarray, float32
        info : dict

        Raises
        ------
        ValueError
            If an option is unknown or no number.
        wt_gym.base.errors.InflowError
            If a wind is asked for that cannot be had.
        wt_gym.base.errors.ActionError
            If an option is out of range, for example more torque than there is at the rotor speed.
        wt_gym.base.errors.SimulationError
            If there is no steady state to start from, for example because the wind bends the blades too far.
        """
        if self._running and self.outer_steps is None and self._steps == registered_limit(self.spec):
            self.length.warn(self.spec, None)  # whether the limit of the id stands is known only now
        self._running = False
        super().reset(seed=seed)
        longest = self.length.longest(self.spec, self.outer_steps)
        beginning = self._starts.draw(self.np_random, options, longest, partial(self._draw, seed))
        drawn = beginning.drawn
        self._begin(beginning)
        if self._twin is not None:
            self._twin.begin(beginning)
        observation, saturated = self._observe()
        if self._renderer is not None:
            self._renderer.reset()
            self._renderer.record(self.signals)
        info = self._info(saturated, tip_clearance(self.signals))
        if drawn is not None:
            info |= {"variation": copy.deepcopy(dict(drawn.values))}
        return observation, info if beginning.fault is None else info | {"fault": beginning.fault.told}

    def _draw(self, seed: int | None, number: int | None) -> DrawnVariation | None:
        """Draw the variation of an episode: a seed begins its stream, as does the first reset, and every number."""
        if self._draws is None:
            return None
        if number is not None:
            self._draws.seed(number, numbered=True)
        elif seed is not None or not self._seeded:
            known = self.np_random_seed if seed is None else seed  # negative for a generator from outside
            self._draws.seed(known if known >= 0 else int(self.np_random.integers(2**31)))
            self._seeded = True
        return self._draws.draw()

    def _begin(self, beginning: Beginning) -> None:
        """Start turbine, sensors and reward."""
        start, operation = beginning.start, self.operation
        operation.begin(beginning)
        self._action = np.zeros(self.layout.action.size)
        self._steps, self._running, self._failed = 0, True, False
        self.idle.start()
        self._dial = beginning.dial if self.dials is not None else None
        instruments = operation.instruments
        self._observer.reset(self._situation(), start.trail, None if instruments is None else instruments.offset)
        self._observation, self._saturated = None, ()
        if operation.reference is None and any(getattr(term, "needs_reference", False) for term in self.reward_terms):
            raise ValueError("the reward term power_tracking needs a power_reference of the environment, got None")
        rewards.reset(self.reward_terms, self.turbine, operation.signals, start.averaged(operation.signals))

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Advance by one control step.

        Parameters
        ----------
        action : array_like, shape (n_act,)

        Returns
        -------
        observation : numpy.ndarray, float32
        reward : float
            With ``vector_reward`` an array, float32, of the terms and "termination", named in ``reward_names``.
        terminated, truncated : bool
        info : dict

        Raises
        ------
        wt_gym.base.errors.ActionError
            If the action is refused; the state is unchanged.
        wt_gym.base.errors.ControllerError
            If the base controller gives a demand without meaning; the episode is over.
        gymnasium.error.ResetNeeded
            If no episode is running.
        """
        if not self._running:
            raise ResetNeeded("the episode is over, or none was started: call reset() before step()")
        operation, meaning, dt = self.operation, self.layout.action, self.control_dt
        values, before = meaning.validate(action), operation.signals
        factors = None if self._dial is None else self._factors(self._dial)
        try:
            after = operation.advance(meaning.decode(values, operation.setpoint))
        except SimulationError as error:
            return self._fail(error)
        except ControllerError:
            self._running = False  # a part of the step may have been simulated
            raise
        self._action = values
        self._steps += 1
        self._observer.advance(operation.readings(), dt)
        if self._renderer is not None:
            self._renderer.record(after)

        inflow, reference = operation.wind.inflow, operation.reference
        demanded = None if reference is None else reference.at(after["time"])
        if not self.wind.parks:
            self.idle.advance(after, dt, inflow, operation.controller, operation.faults, demanded)
        transition = rewards.Transition(
            self.turbine, before, after, dt, inflow=inflow, action=values, demanded_power=demanded
        )
        reward, terms = rewards.total(self.reward_terms, transition)
        clearance = tip_clearance(after)
        ending = self.limits.ending(after, clearance)
        if ending is not None:
            reward, terms = self.limits.punish(reward, terms)
        if self._twin is not None:
            reward, terms = self._compared(self._twin, reward, terms)
        if factors is not None:
            terms = dialed(terms, factors)
            reward = float(sum(terms.values()))
        observation, saturated = self._observe()
        most = self.length.steps
        truncated = ending is None and most is not None and self._steps >= most
        self._running = ending is None and not truncated
        costs = self._costs.of(after)
        info = self._info(saturated, clearance)
        info |= {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        if ending is not None:
            info["termination"] = ending
        return observation, self._returned(reward, terms), ending is not None, truncated, info

    def _fail(self, error: SimulationError) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Result of a step that the simulation did not survive: the last good observation and the penalty."""
        self._running, self._failed = False, True
        observation = cast(np.ndarray, self._observation).copy()
        reward, terms = self.limits.punish(0.0, {term.name: 0.0 for term in self.reward_terms})
        costs = self._costs.of_failure()
        info = self._info(self._saturated, tip_clearance(self.signals))
        info |= {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        info |= {"termination": "failure", "failure": str(error)}
        return observation, self._returned(reward, terms), True, False, info

    def _compared(self, twin: Twin, reward: float, terms: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Reward and terms less those that the controller alone earns in the same wind."""
        other = twin.terms(self._steps - 1)
        return reward - sum(other.values()), {name: value - other.get(name, 0.0) for name, value in terms.items()}

    def _returned(self, reward: float, terms: dict[str, float]) -> float | np.ndarray:
        """What `step` returns as reward."""
        if not self._vector_reward:
            return reward
        return np.array([terms.get(name, 0.0) for name in self.reward_names], dtype=np.float32)

    def _situation(self) -> ObservationContext:
        o = self.operation
        signals = o.readings()
        seen = o.seen() if self._observer.sees_lidar else None
        drive, known = yaw_drive_of(o.controller), None
        if self._observer.sees_disturbances:
            part, watcher = linear_part(o.controller), fault_supervisor_of(o.controller)
            known = None if part is None else part.known(signals if watcher is None else watcher.believed(signals))
        demanded = None
        if o.reference is not None:
            demanded = tuple(o.reference.at(o.signals["time"] + ahead) for ahead in (0.0, *AHEAD))
        return ObservationContext(
            signals, o.demand, o.setpoint, o.base, self._action, seen, o.residual, drive, known,
            supervisor=o.supervisor, demanded_power=demanded,
            dial=None if self._dial is None else self._factors(self._dial),
        )  # fmt: skip

    def _observe(self) -> tuple[np.ndarray, tuple[str, ...]]:
        self._observation, self._saturated = self._observer.observe(self._situation(), self.np_random)
        return self._observation.copy(), self._saturated

    def _info(self, saturated: tuple[str, ...], clearance: float) -> dict[str, Any]:
        signals, wind = self.operation.signals, self.operation.wind
        supervisor = self.operation.supervisor
        info = ({} if supervisor is None else {"state": supervisor.state}) | {
            "time": signals["time"],
            "wind_speed": float(wind.wind_speed),
            "wind_seed": int(wind.wind_seed),
            "generator_power": signals["generator_power"],
            "rotor_speed": signals["rotor_speed"],
            "rotor_speed_max": signals["rotor_speed_max"],
            "tip_clearance_min": clearance,
            "idle_time": self.idle.time,
            "saturated": saturated,
        }
        if (voltage := self.operation.grid_voltage) is not None:
            info["grid_voltage"] = voltage
        if self.operation.reference is not None:
            info["demanded_power"] = self.operation.reference.at(signals["time"])
        if (dial := self.dial) is not None:
            info["dial"] = dial
        return info

    # ---- snapshots and pictures ----

    def snapshot(self) -> EnvSnapshot:
        """All from which the episode continues bit for bit: simulator, controller, filters, reward, random state.

        For planning: take one, try actions, `restore` it. An episode that is over is kept as such: after restoring it
        `step` asks for a reset, and `render` shows its last instant. With a ``render_mode`` the course of the signals
        in the picture is kept too.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode was started.
        """
        simulator = self.operation.simulator
        if simulator is None or cast("Signals | None", self.signals) is None:
            raise ResetNeeded("there is nothing to take a snapshot of: call reset() first")
        operation, kept = copy.deepcopy((self.operation.memory(), {name: self.__dict__[name] for name in _KEPT}))
        return EnvSnapshot(
            None if self._failed else simulator.state(),
            operation,
            kept,
            self._observer.memory(),
            self.episode_wind,
            copy.deepcopy(cast("dict[str, Any]", self.np_random.bit_generator.state)),
            None if self._draws is None else copy.deepcopy(self._draws.state),
            None if self._twin is None else self._twin.snapshot(),
            None if self._renderer is None else self._renderer.memory(),
        )

    def restore(self, snapshot: EnvSnapshot) -> np.ndarray:
        """Continue from a snapshot of this environment or of one made with the same arguments.

        Returns
        -------
        observation : numpy.ndarray, float32
            That of the snapshot; with sensor noise it is drawn again.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the snapshot belongs to another turbine or fidelity.
        """
        operation, kept = copy.deepcopy((snapshot.operation, snapshot.kept))
        self.operation.recall(operation, snapshot.wind, snapshot.simulator)
        self.__dict__.update(kept)
        self._observer.recall(snapshot.sensors)
        self.np_random.bit_generator.state = copy.deepcopy(snapshot.random)
        if self._draws is not None and snapshot.variation is not None:
            self._draws.state = copy.deepcopy(snapshot.variation)
            self._seeded = True
        if self._twin is not None:
            self._twin.restore(cast("TwinSnapshot", snapshot.twin))
        if self._renderer is not None:  # a snapshot of an environment without pictures holds the present signals only
            self._renderer.recall(snapshot.pictured or ())
            if not snapshot.pictured:
                self._renderer.record(self.signals)
        return cast(np.ndarray, None if self._observation is None else self._observation.copy())  # a twin has none

    def render(self) -> np.ndarray | None:
        """Return a picture of the turbine and its wake, uint8 array of shape (height, width, 3), or None.

        Of a simulation that failed it shows what was drawn last.
        """
        if self._renderer is None:
            gym.logger.warn("render() was called without a render_mode; make the environment with 'rgb_array'")
            return None
        if cast("Signals | None", self.signals) is None:
            raise ResetNeeded("render() needs a started episode: call reset() first")
        return self._renderer.draw(None if self._failed else self.simulator.geometry())

    def close(self) -> None:
        """Release the simulator and the renderer."""
        self.operation.close()
        if self._twin is not None:
            self._twin.close()
        self._renderer, self._running = None, False


def _lidar(given: Lidar | None, controller: Controller | None) -> Lidar | None:
    """The lidar of the observation: that of the base controller, if it has one."""
    of_controller = None if controller is None else lidar_of(controller)
    if given is None or of_controller is None:
        return given or of_controller
    if not given.serves(of_controller):
        raise ValueError(
            f"the base controller reads {of_controller}; lidar must be the same, the same with apart=True, or None, "
            f"got {shown(given)}"
        )
    return given


def turbine_env_of(env: gym.Env[Any, Any]) -> WindTurbineEnv:
    """The environment of the turbine behind any wrappers."""
    return cast("WindTurbineEnv", env.unwrapped)
