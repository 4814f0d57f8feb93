"""An agent of residual actions behind ROSCO's interface: readings in, offsets on the pitch of each blade out."""

from __future__ import annotations

import logging
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import ActionError
from wt_gym.bridges.rosco import Message, SetPoints
from wt_gym.bridges.rosco.messages import FIRST_CALL
from wt_gym.control import AgentSetpoint, Demand
from wt_gym.control.controllers.additions import ResidualPitch
from wt_gym.control.sensors import harmonic_of_blades, to_blades
from wt_gym.deployment.serving.clock import MessageClock
from wt_gym.deployment.serving.expressible import check_expressible
from wt_gym.envs.observations import RESIDUAL_GROUPS, Observer
from wt_gym.envs.readers import ObservationContext
from wt_gym.simulation.channels import Signals, new_values
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.envs.episode import Agent
    from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["ServedAgent"]

_log = logging.getLogger(__name__)
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


class _Turbine:
    """One turbine under an agent.

    Parameters
    ----------
    message : Message
        The first one.
    agent : Agent
    env : WindTurbineEnv
    lead : float, optional
        See `ServedAgent`.
    """

    def __init__(self, message: Message, agent: Agent, env: WindTurbineEnv, lead: float | None):
        layout, options = env.layout, env.options
        self._number, self._agent, self._action = message.turbine_id, agent, layout.action
        self._control_dt, self._step, self._n_blades = env.control_dt, env.operation.step, env.turbine.n_blades
        self._lead, self._drive = lead, env.turbine.pitch
        self._residual = ResidualPitch(None, options.controller.residual_washout, self._action.n_mean)
        observed = options.observations
        self._observer = Observer(
            env.turbine, self._action, observed.channels or RESIDUAL_GROUPS, 0.0, layout.delay, observed.history,
            residual=self._residual, washout=observed.washout,
        )  # fmt: skip
        self._needed = _needed(layout.observation.names, self._action.turns_with_rotor, self._n_blades)
        values, _ = new_values(self._n_blades)
        # all else is zero, so that flapwise is out of plane, and all wind along x
        self._signals = Signals(values, self._n_blades)
        self._nothing = Demand(np.zeros(self._n_blades), 0.0, 0.0)
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
            most = self._action.pitch_rate * hold
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
        """Start agent and filters at the present offsets."""
        self._before = self._setpoint = AgentSetpoint(self._present, 0.0, 0.0)
        self._last = np.zeros(self._action.size)
        self._state: Any = None
        self._acted_at, self._steps = self._clock.time, 0
        self._observer.reset(self._context())

    def _context(self) -> ObservationContext:
        return ObservationContext(
            self._signals, self._nothing, self._setpoint, None, self._last, residual=self._residual
        )

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
            self._observer.advance(self._signals, self._control_dt)
        observation, _ = self._observer.observe(self._context(), self._rng)
        action, self._state = self._agent.predict(
            observation, state=self._state, episode_start=np.array([self._steps == 0]), deterministic=True
        )
        self._last = self._action.validate(action)
        self._before, self._setpoint = self._setpoint, self._action.decode(self._last, self._setpoint)
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
