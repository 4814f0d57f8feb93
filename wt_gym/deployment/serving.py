"""Agents as servers for turbines under ROSCO.

`answers_of` turns a name of the command line into what answers: an agent of residual actions behind ROSCO's interface
(readings in, offsets on the pitch of each blade out), or a class of the user that gives set points, as users of ROSCO
write them for its server. `check_expressible` says which agents the interface has room for.
"""

import logging
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import ActionError, ControllerError
from wt_gym.bridges.rosco import FIRST_CALL, MOST_BLADES, READINGS, SET_POINTS, Answers, Message, SetPoints
from wt_gym.control import AgentSetpoint, Demand
from wt_gym.control.controllers.additions import ResidualPitch
from wt_gym.control.controllers.names import Name, load_class
from wt_gym.control.sensors import harmonic_of_blades, to_blades
from wt_gym.envs.channels import RESIDUAL_GROUPS
from wt_gym.envs.episode import Agent
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.observations import Observer
from wt_gym.envs.options import flat_arguments, registered_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import load_agent, load_model
from wt_gym.experiment.environments import training_arguments
from wt_gym.experiment.names import env_choices_of, read_name
from wt_gym.simulation.channels import Signals, new_values
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.tasks import DEFAULT_ENV

_log = logging.getLogger(__name__)
_NOT_RUN = {
    "controller": "discon", "start": "steady", "sensor_noise": 0.0, "relative_reward": False, "reward_credit": False,
    "episode_length": None,
}  # fmt: skip
"""Of an environment that tells what an agent sees and does, but is not run: ROSCO is its base controller."""

_OF_THE_CONTROLLER = (
    "disturbance_", "linear_pitch_", "model_", "response_", "tower_velocity_", "tower_displacement_", "dead_band_",
)  # fmt: skip
"""Beginnings of the names of channels that a base controller knows and ROSCO does not."""


def answers_of(
    choice: str, env_id: str | None = None, turbine: str | None = None, lead: float | None = None
) -> Answers:
    """What answers turbines under ROSCO.

    Parameters
    ----------
    choice : str
        A trained agent, a class of yours with ``predict`` or with ``update_setpoints``, ``"zero"`` or ``"random"``.
    env_id, turbine : str, optional
        Environment, by default `DEFAULT_ENV`, and turbine of a class or word; those of a trained agent are the ones of
        its training.
    lead : float, optional
        As of `ServedAgent`.

    Raises
    ------
    wt_gym.base.errors.ControllerError, ValueError
        For a controller, or an agent for which ROSCO's interface has no room; if there is no such agent, or an
        environment is given to one that has its own.
    """
    name = read_name(choice)
    if name.kind == "trained":
        if env_id is not None or turbine is not None:
            raise ValueError("environment and turbine are those of the agent's training; they must be left out")
        return _trained(name, lead)
    if name.kind == "class":
        maker = load_class(name.target)
        if callable(getattr(maker, "update_setpoints", None)):
            return OwnSetPoints(lambda: maker(**name.parameters))
        if not callable(getattr(maker, "predict", None)):
            raise ControllerError(
                f"a class that is served must have predict, of an agent, or update_setpoints, got {name.target}"
            )
    elif name.kind == "controller":
        raise ControllerError(
            f"ROSCO's interface takes offsets on ROSCO's own demands; the controller {name.text} gives the demands "
            "themselves. What is served must be an agent of residual actions, or a class with update_setpoints"
        )
    given: dict[str, Any] = {} if turbine is None else {"turbine": turbine}
    if name.kind == "word":  # which looks at nothing
        given |= {
            "observation": ["rotor_speed"], "action_components": ["pitch"], "action_spans": None,
            "residual_fade": False,
        }  # fmt: skip
    env = _environment(registered_arguments(env_id or DEFAULT_ENV, given | env_choices_of(choice)))
    return ServedAgent(lambda: load_agent(choice, env.layout), env, lead)


def _environment(arguments: Mapping[str, Any]) -> WindTurbineEnv:
    flat = flat_arguments(arguments)
    base = flat.get("controller", "discon")
    _log.info("ROSCO is the base controller; in the agent's environment it is %s", base)
    return WindTurbineEnv(**(flat | _NOT_RUN))


def _trained(name: Name, lead: float | None) -> "ServedAgent":
    from wt_gym.experiment.trained_agent import model_card  # torch takes seconds to import

    agent = load_model(name)
    card = model_card(name.target, name.parameters.get("env")).get("env_kwargs", {})
    inside = [seen for seen in (agent.record or {}).get("observation", ()) if str(seen).startswith(_OF_THE_CONTROLLER)]
    if inside:
        raise ControllerError(
            f"the agent must see what ROSCO sends, got {', '.join(inside[:3])} and the like, which its own base "
            "controller knows; export it instead (wt-gym export), with that controller"
        )
    env = _environment(training_arguments(agent.record, card, name.target))
    agent.enter(env.layout)
    return ServedAgent(lambda: agent, env, lead)


_LONGEST_GAP = 10.0
"""Gap between messages, in control steps, after which an agent begins afresh."""


class ServedAgent:
    """Set points of an agent for any number of turbines, each with an agent, filters and offsets of its own.

    The agent acts at its control step, whatever the interval of the messages: at shorter intervals the offsets move
    evenly to what it asks for, as in its environment; at longer ones it acts as many times on one reading as control
    steps have gone by. A reading that the agent needs and that is missing or not finite lets the offsets return to
    zero at their greatest rate; the agent begins afresh when it is back.

    Parameters
    ----------
    make_agent : callable
        Gives an agent for one turbine.
    env : WindTurbineEnv
        That it acts in; it is not run.
    lead : float, optional
        Time by which the azimuth of pitch in the fixed frame leads [s]. By default the delay of the pitch drive at the
        interval of the messages.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If ROSCO's interface has no room for it (`check_expressible`).
    """

    def __init__(self, make_agent: Callable[[], Agent], env: WindTurbineEnv, lead: float | None = None):
        check_expressible(env)
        if lead is not None and not 0.0 <= lead < math.inf:
            raise ValueError(f"lead must be finite and not negative, got {lead!r} s")
        self._make, self._env, self._lead = make_agent, env, lead
        self._turbines: dict[int, _Turbine] = {}

    def answer(self, message: Message) -> SetPoints:
        """Set points for a turbine from its readings."""
        turbine = self._turbines.get(message.turbine_id)
        if turbine is None or message.status == FIRST_CALL or not turbine.continues(message.time):
            turbine = self._turbines[message.turbine_id] = _Turbine(message, self._make(), self._env, self._lead)
        return turbine.answer(message)

    def forget(self, turbine_id: int) -> None:
        """Drop what is remembered of a turbine."""
        self._turbines.pop(turbine_id, None)


_READ = {
    "generator_power": "VS_GenPwr",
    "generator_speed": "GenSpeed",
    "rotor_speed": "RotSpeed",
    "generator_torque": "GenTqMeas",
    "yaw_error": "NacVane",
    "wind_speed": "HorWindV",
    "acceleration_fore_aft": "FA_Acc_TT",
    "azimuth": "Azimuth",
}
"""Readings by their name in `Message`, with that in ROSCO."""
_SIGNAL_OF = {"wind_speed": "wind_x", "acceleration_fore_aft": "nacelle_acceleration_fore_aft"}
"""Signals of the simulator that have another name."""
_MOMENT = "root_out_of_plane_moment_"
_ASKEW = "FA_Acc_TT along the nacelle (NacHeading must be within 30 deg of the tower's x axis)"
_LEAST_SHARE = math.cos(math.radians(30.0))
"""Of a fore-aft acceleration that must go along the x axis of the tower top, for it to be read from that alone."""


def _needed(channels: tuple[str, ...], turns: bool, n_blades: int) -> tuple[str, ...]:
    """ROSCO's names of the readings behind the channels of an observation, and behind pitch that turns."""
    needed = {"Azimuth", "RotSpeed"} if turns else set()
    for channel in channels:
        name = channel.partition("@")[0]
        if name.startswith(_MOMENT):
            part = name.removeprefix(_MOMENT)
            blades = [int(part)] if part.isdigit() else range(1, n_blades + 1)
            needed |= {f"rootMOOP({b})" for b in blades} | ({"Azimuth"} if part in ("tilt", "yaw") else set())
        else:
            name = re.sub("^nacelle_|_(sin|cos)$", "", name)
            needed |= {_READ[name]} if name in _READ else set()
    return tuple(sorted(needed))


def _fore_aft(acceleration: float, yaw: float) -> float:
    """Fore-aft acceleration of a nacelle that heads along a yaw angle [rad], from that along the tower's x axis [m/s²].

    ROSCO passes on OpenFAST's YawBrTAxp, along an axis that does not yaw, and not the YawBrTAyp across it. What moves
    side-side, and goes into the former with the sine of the angle, is small against fore-aft and taken as zero. Not a
    number beyond 30 deg, where that no longer holds.
    """
    share = math.cos(yaw) if math.isfinite(yaw) else math.nan
    return acceleration / share if abs(share) >= _LEAST_SHARE else math.nan


def _finite(value: float) -> float:
    """A reading as filters can take it; where it is missing and needed, the agent does not act."""
    return value if math.isfinite(value) else 0.0


@dataclass
class _Measured:
    """Readings, demand and set points of a served turbine, in place of the operation that an observer reads."""

    signals: Signals
    demand: Demand
    residual: ResidualPitch
    setpoint: AgentSetpoint | None = None
    base: None = None
    controller: None = None
    instruments: None = None

    def readings(self) -> Signals:
        """Readings at the current instant."""
        return self.signals


class _Turbine:
    """One turbine under an agent, from its first message on."""

    def __init__(self, message: Message, agent: Agent, env: WindTurbineEnv, lead: float | None):
        layout, options = env.layout, env.options
        self._number, self._agent, self._action = message.turbine_id, agent, layout.action
        self._control_dt, self._step, self._n_blades = env.control_dt, env.operation.step, env.turbine.n_blades
        self._lead, self._drive = lead, env.turbine.pitch
        self._residual = ResidualPitch(None, options.controller.residual_washout, self._action.n_mean)
        observed = options.observations
        self._needed = _needed(layout.observation.names, self._action.turns_with_rotor, self._n_blades)
        values, _ = new_values(self._n_blades, env.turbine.n_lines)
        # all else is zero, so that flapwise is out of plane, and all wind along x
        self._signals = Signals(values, self._n_blades)
        self._nothing = Demand(np.zeros(self._n_blades), 0.0, 0.0)
        self._measured = _Measured(self._signals, self._nothing, self._residual)
        choice = observed.channels or RESIDUAL_GROUPS
        self._observer = Observer(env.turbine, self._action, self._measured, observed, choice, 0.0, layout.delay)
        self._rng = np.random.default_rng(0)  # of noise, of which there is none
        self._clock = MessageClock(message.time)
        self._azimuth = self._speed = 0.0
        self._present: NDArray[np.float64] = self._action.start(self._nothing).pitch
        self._missing: tuple[str, ...] | None = None  # before the first message
        self._refused = False
        self._residual.start(0.0, 0.0, self._step)

    def continues(self, time: float) -> bool:
        """Whether a message of a time [s] belongs to the same course of time."""
        if self._clock.continues(time, _LONGEST_GAP * self._control_dt):
            return True
        _log.warning(
            "turbine %d: time goes from %g s to %g s, the agent begins afresh", self._number, self._clock.time, time
        )
        return False

    def answer(self, message: Message) -> SetPoints:
        """Set points from readings."""
        if self._clock.tick(message.time):
            self._tell_interval()
        hold = self._step if self._clock.interval is None else self._clock.interval
        missing = self._take(message, hold)
        if missing != self._missing:
            self._tell_missing(missing)
            if not missing:
                self._begin()
        self._missing = missing
        if not missing and not self._refused:
            try:
                self._move(hold)
            except ActionError as error:
                _log.error("turbine %d: ROSCO acts alone from now on: %s", self._number, error)
                self._refused = True
        if missing or self._refused:
            most = self._action.spans["pitch_rate"] * hold
            self._present = self._present - np.clip(self._present, -most, most)
        return self._points(hold)

    # ---- what is measured ----

    def _take(self, message: Message, hold: float) -> tuple[str, ...]:
        """Take over the readings; give ROSCO's names of those that are needed and missing."""
        readings = {name: getattr(message, field) for field, name in _READ.items()}
        given, readings["FA_Acc_TT"] = readings["FA_Acc_TT"], _fore_aft(message.acceleration_fore_aft, message.yaw)
        for field, name in _READ.items():
            self._signals.set(_SIGNAL_OF.get(field, field), _finite(readings[name]))
        for b in range(self._n_blades):
            readings[f"rootMOOP({b + 1})"] = moment = message.out_of_plane_moments[b]
            self._signals.set(f"root_flap_moment_{b + 1}", _finite(moment))
        self._signals.set("time", message.time)
        # without a reading of the azimuth the rotor turns on
        known = math.isfinite(message.azimuth)
        self._azimuth = message.azimuth if known else self._azimuth + self._speed * hold
        self._speed = message.rotor_speed if math.isfinite(message.rotor_speed) else self._speed
        askew = math.isfinite(given) and math.isfinite(message.yaw)
        missing = (name for name in self._needed if not math.isfinite(readings[name]))
        return tuple(_ASKEW if name == "FA_Acc_TT" and askew else name for name in missing)

    def _tell_missing(self, missing: tuple[str, ...]) -> None:
        if missing:
            _log.warning(
                "turbine %d: no %s at %g s, ROSCO acts alone", self._number, ", ".join(missing), self._clock.time
            )
        elif self._missing:
            _log.info("turbine %d: all readings are back at %g s", self._number, self._clock.time)

    def _tell_interval(self) -> None:
        number, interval, own = self._number, self._clock.interval, self._control_dt
        _log.info("turbine %d: messages every %.6g s, the agent acts every %g s", number, interval, own)
        if interval is not None and interval > own * (1.0 + 1e-6):
            _log.warning(
                "turbine %d: the agent was trained to act every %g s, but messages come every %.6g s: it acts several "
                "times on one reading", number, own, interval,
            )  # fmt: skip

    # ---- what the agent does ----

    def _begin(self) -> None:
        """Start agent and filters at the current offsets."""
        self._before = self._setpoint = self._measured.setpoint = AgentSetpoint(self._present, 0.0, 0.0)
        self._last = np.zeros(self._action.size)
        self._state: Any = None
        self._acted_at, self._steps = self._clock.time, 0
        self._observer.reset(self._last)

    def _move(self, hold: float) -> None:
        """Let the agent act as many times as control steps begin, and move the offsets to what it asks for."""
        time = self._clock.time
        while self._acted_at + (self._steps > 0) * self._control_dt <= time + 1e-6 * self._control_dt:
            self._act()
        part = min((time - self._acted_at + hold) / self._control_dt, 1.0)
        self._present = self._before.pitch + part * (self._setpoint.pitch - self._before.pitch)

    def _act(self) -> None:
        """Begin a control step."""
        if self._steps > 0:
            self._acted_at += self._control_dt
            self._observer.advance(self._control_dt)
        observation, _ = self._observer.observe(self._last, self._rng)
        action, self._state = self._agent.predict(
            observation, state=self._state, episode_start=np.array([self._steps == 0]), deterministic=True
        )
        self._last = self._action.validate(action)
        self._before, self._setpoint = self._setpoint, self._action.decode(self._last, self._setpoint)
        self._measured.setpoint = self._setpoint
        self._steps += 1

    def _points(self, hold: float) -> SetPoints:
        """Offsets of the blades over the next interval [s]."""
        wanted = self._residual.acting(self._present, self._nothing.pitch, self._speed, hold)
        lead = pitch_delay(self._drive, hold, min(hold, self._step)) if self._lead is None else self._lead
        azimuth = self._azimuth + self._speed * lead
        offsets = wanted.tolist()
        if self._action.pitch == "fixed-frame":
            offsets = to_blades(offsets, azimuth, self._n_blades)
        elif self._action.pitch == "cyclic":
            offsets = harmonic_of_blades(offsets[0], offsets[1], azimuth, self._n_blades)
        elif self._action.pitch == "collective":
            offsets *= self._n_blades
        first, second, third = [*offsets, 0.0, 0.0][:3]
        return SetPoints(pitch_offset_1=first, pitch_offset_2=second, pitch_offset_3=third)


_DEGREES = tuple(field.name for field in (*READINGS, *SET_POINTS) if field.unit == "deg")


def readings_by_name(message: Message) -> dict[str, float]:
    """Readings by ROSCO's names and in its units."""
    values: list[float] = []
    for value in astuple(message):
        values += value if isinstance(value, tuple) else [value]
    named = {field.name: float(value) for field, value in zip(READINGS, values, strict=True)}
    return named | {name: math.degrees(named[name]) for name in _DEGREES if name in named}


class OwnSetPoints:
    """Set points of a class of the user, as ROSCO's server takes it as a wind-farm controller; one for all turbines.

    Its ``update_setpoints(id, time, measurements)`` gives set points by ROSCO's names and in its units from readings by
    its names; what is left out is neutral. ``make`` makes the object.
    """

    def __init__(self, make: Callable[[], Any]):
        self._own = make()
        if not callable(getattr(self._own, "update_setpoints", None)):
            raise ControllerError(f"{self._own!r} must have update_setpoints(id, time, measurements)")

    def answer(self, message: Message) -> SetPoints:
        """Set points for a turbine from its readings."""
        given = self._own.update_setpoints(message.turbine_id, message.time, readings_by_name(message))
        names = {field.name: own.name for field, own in zip(SET_POINTS, fields(SetPoints), strict=True)}
        if unknown := [name for name in given if name not in names]:
            raise ControllerError(f"set points must be among {', '.join(names)}, got {', '.join(unknown)}")
        if wrong := [f"{name} = {value!r}" for name, value in given.items() if not math.isfinite(value)]:
            raise ControllerError(f"set points must be finite, got {', '.join(wrong)}")
        return SetPoints(**{names[k]: math.radians(v) if k in _DEGREES else float(v) for k, v in given.items()})

    def forget(self, turbine_id: int) -> None:
        """Turbines are remembered by the object alone."""


SENT = (
    "rotor_speed", "generator_speed", "generator_power", "generator_torque", "wind_speed", "yaw_error", "azimuth_sin",
    "azimuth_cos", "nacelle_acceleration_fore_aft",
    *(f"root_out_of_plane_moment_{part}" for part in (1, 2, 3, "mean", "tilt", "yaw")),
)  # fmt: skip
"""Channels that are among the readings, or follow from them."""
_OWN = re.compile(r"pitch_offset_\d|residual_mean|previous_.+")
"""Channels of what the agent itself asked for."""


def missing_channels(layout: EnvLayout) -> list[str]:
    """Channels of an observation that ROSCO does not send, each once, whatever its age."""
    names = dict.fromkeys(name.partition("@")[0] for name in layout.observation.names)
    return [name for name in names if name not in SENT and not _OWN.fullmatch(name)]


def check_expressible(env: WindTurbineEnv) -> None:
    """Refuse agents of an environment that cannot act through ROSCO's interface, with all reasons."""
    layout, action, reasons = env.layout, env.layout.action, []
    if layout.turbine.n_blades > MOST_BLADES:
        reasons.append(f"it has set points for at most {MOST_BLADES} blades, the turbine has {layout.turbine.n_blades}")
    if action.mode != "residual":
        reasons.append(
            f"it takes offsets on its own demands: action_mode must be 'residual', got {action.mode!r} actions, which "
            "are the demands themselves"
        )
    if "yaw" in action.components:
        reasons.append("it takes an offset of the yaw error and no yaw rate: action_components must leave out 'yaw'")
    if "torque" in action.components:
        reasons.append(
            "it takes a torque offset, but version 2.10 does not apply it: action_components must leave out 'torque'"
        )
    if action.mode == "residual" and env.operation.residual is not None and env.operation.residual.fades:
        reasons.append("it does not send the pitch, by which residual_fade fades the offsets: it must be False")
    if missing := missing_channels(layout):
        reasons.append(
            f"of the observation it does not send {', '.join(missing)}; what follows from its {len(READINGS)} readings "
            f"is {', '.join(SENT)}"
        )
    if reasons:
        raise ControllerError(f"ROSCO's interface cannot serve this agent: {'; '.join(reasons)}")


_EVEN = 0.05
"""By which share an interval may differ from the one before and still be the same."""


def rounding(time: float) -> float:
    """Greatest error of a time as ROSCO writes it, half a unit of its seventh digit [s]."""
    return 0.5 * 10.0 ** (math.floor(math.log10(abs(time))) - 6) if time else 0.0


class MessageClock:
    """Time and interval of messages, whose times have seven digits: exact where they come at even intervals.

    ``time`` is that of the last message, at first of the first one [s], and ``interval`` that between messages [s],
    None before the second one.
    """

    def __init__(self, time: float):
        self.time = self._begin = time
        self.interval: float | None = None
        self._count = 0

    def continues(self, time: float, longest: float) -> bool:
        """Whether a time lies behind the last one by at most so much [s], as far as its digits tell."""
        near = 2.0 * rounding(time)
        return -near <= time - self.time <= max(longest, 10.0 * (self.interval or 0.0)) + near

    def tick(self, time: float) -> bool:
        """Take the time of a message; whether the interval is a new one."""
        elapsed = time - self.time
        if self.interval is not None and abs(elapsed - self.interval) <= _EVEN * self.interval + 2.0 * rounding(time):
            self._count += 1
            if abs(self._begin + self._count * self.interval - time) > rounding(time) + rounding(self._begin):
                self.interval = (time - self._begin) / self._count  # which more messages tell more exactly
            self.time = self._begin + self._count * self.interval
            return False
        if elapsed <= 2.0 * rounding(time):  # the same message again
            return False
        self.interval, self._begin, self._count, self.time = elapsed, self.time, 1, time
        return True
