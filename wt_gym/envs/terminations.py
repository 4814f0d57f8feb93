"""End of an episode by its limits or its length, costs of a step, and the time without power.

Costs are for constrained learning, a sum and its parts by name as in Safety-Gymnasium. By default they say how far the
turbine went into the margins that protect it. Each is zero outside its margin and rises evenly to one at the end of it.
All are taken from the extremes over the structural steps of the control step: nothing slips between two samples.

With limits of the user (``cost_limits``) they take the place of the margins:

- ``rotor_speed``, ``tip_clearance``, ``tower_acceleration``: 1 in a step beyond the limit, else 0. The mean over an
  episode is the share of its steps, and a single one violates the limit.
- ``pitch_travel``: travel of the step, mean of the blades, over what the limit allows in its time. The mean over an
  episode is the travel over the limit, which is violated above 1.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import cast

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from wt_gym.base.options import Options, check_whole_steps, not_empty, option, option_record
from wt_gym.base.quantities import DAY
from wt_gym.control.controllers import Controller
from wt_gym.control.controllers.controller import starting_part
from wt_gym.envs.operation import Operation
from wt_gym.envs.power import DiscWind
from wt_gym.envs.terms import Beginning, Term, Transition
from wt_gym.simulation import Signals
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, ShutDown, VoltageDip
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import unloaded_clearance

PITCH_TRAVEL = "pitch_travel"
COST_LIMITS = {PITCH_TRAVEL: "rad/d", "rotor_speed": "-", "tip_clearance": "m", "tower_acceleration": "m/s^2"}
"""Names and units of the limits beyond which steps cost."""

LARGEST_TILT = math.radians(15.0)
"""Tilt of a platform at which an episode ends [rad]: its turbine and the linear theory of its loads are not made for
more."""


@option_record
class LimitOptions(Options):
    """When an episode ends, and what costs."""

    title = "limits"

    episode_length: float | None = option(
        "Time after which an episode is truncated, a multiple of ``control_dt``; None: never, for a time limit from "
        "outside. Tasks have such a limit: their episodes are made longer by ``max_episode_steps`` of `gymnasium.make`",
        default=120.0,
        unit="s",
        low=0.0,
        above=True,
    )
    overspeed: float = option(
        "Highest rotor speed over rated rotor speed",
        default=1.25,
        flat="overspeed_limit",
        unit="-",
        low=1.0,
        above=True,
    )
    standstill: float | None = option(
        "Lowest rotor speed over rated rotor speed; 0 allows a stop but no turning backwards, a negative one that too. "
        "Default: 0.2; -1 with a damper, which lets the rotor turn slowly",
        default=None,
        flat="standstill_limit",
        unit="-",
        low=-1.0,
        high=1.0,
        below=True,
    )
    line_tension: float | None = option(
        "Largest tension of a mooring line at its fairlead, of a floating turbine: the breaking load of its lines",
        default=None,
        flat="line_tension_limit",
        unit="N",
        low=0.0,
        above=True,
        otherwise="no limit",
    )
    costs: Mapping[str, float] | None = option(
        'Limits beyond which a step costs, in place of the margins of ``info["costs"]`` (`wt_gym.envs.terminations`): '
        "``pitch_travel``, mean of the blades [rad/d]; ``rotor_speed`` over rated [-]; ``tip_clearance`` [m]; "
        "``tower_acceleration``, of the nacelle in the horizontal plane [m/s^2]. They do not end an episode",
        default=None,
        flat="cost_limits",
        choices=tuple(COST_LIMITS),
        low=0.0,
        above=True,
        check=not_empty,
    )


@dataclass
class Limits:
    """Limits that terminate an episode."""

    rated: float  #: Rotor speed [rad/s]
    overspeed: float  #: Highest rotor speed over rated
    standstill: float  #: Lowest rotor speed over rated
    penalty: float  #: Subtracted from the reward on termination
    floats: bool = False  #: The tilt of the platform is limited
    line_tension: float | None = None  #: Largest tension of a mooring line [N]

    def ending(self, signals: Signals, clearance: float) -> str | None:
        """Why the episode is terminated after a step, if it is; with the `tip_clearance` of the step [m]."""
        if signals["rotor_speed_max"] > self.overspeed * self.rated:
            return "overspeed"
        if signals["rotor_speed"] < self.standstill * self.rated:
            return "standstill"
        if self.floats and math.hypot(signals["platform_roll"], signals["platform_pitch"]) > LARGEST_TILT:
            return "platform_tilt"
        if self.line_tension is not None and max(signals["fairlead_tension"].tolist()) > self.line_tension:
            return "line_tension"
        return "tower_strike" if clearance <= 0.0 else None

    def punish(self, reward: float, terms: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Reward and terms of a terminated episode's last step."""
        return reward - self.penalty, {**terms, "termination": -self.penalty}


def standstill_limit(given: float | None, turbine: Turbine, parks: bool) -> float:
    """Lowest rotor speed over rated rotor speed: what is given, or what suits the generator.

    Raises
    ------
    ValueError
        If parked rotors, which may turn slowly to either side, would end at once.
    """
    limit = given if given is not None else 0.2 if turbine.drivetrain.takes_torque else -1.0
    if parks and limit >= 0.0:
        raise ValueError(
            "standstill_limit must be negative for extreme winds: an episode starts a parked rotor, which may turn "
            f"slowly to either side; got {limit!r}"
        )
    return limit


def tip_clearance(signals: Signals) -> float:
    """Smallest signed distance of a tip from the tower during the last step [m]."""
    return float(min(signals["tip_clearance_min"].tolist()))


def registered_limit(spec: EnvSpec | None) -> int | None:
    """Control steps after which episodes of an id end, if it has such a limit; one given to `make` is not known."""
    registered = None if spec is None else gym.registry.get(spec.id)
    return None if registered is None else registered.max_episode_steps


class EpisodeLength:
    """When an episode is truncated.

    Parameters
    ----------
    time : float or None
        Length of an episode [s]; None: without an end of its own.
    control_dt : float
        [s]

    Raises
    ------
    ValueError
        If the time is not a whole number of control steps, at least one.
    """

    def __init__(self, time: float | None, control_dt: float):
        self.steps = None if time is None else check_whole_steps("episode_length", time, control_dt, least=1)
        self._control_dt, self._told = control_dt, False

    def is_over(self, steps: int) -> bool:
        """Return True after the last of the control steps."""
        return self.steps is not None and steps >= self.steps

    def longest(self, spec: EnvSpec | None, outer_steps: int | None) -> float | None:
        """Longest time that an episode can last [s], None without a limit.

        Parameters
        ----------
        spec : EnvSpec or None
            Definition of the environment. A `gymnasium.wrappers.TimeLimit` does not tell what it encloses; that of
            the id is known.
        outer_steps : int or None
            Control steps after which something outside ends an episode, where that is known.
        """
        steps = self.steps
        if steps is None:
            steps = registered_limit(spec) if outer_steps is None else outer_steps
        return None if steps is None else steps * self._control_dt

    def warn(self, spec: EnvSpec | None, outer_steps: int | None) -> None:
        """Warn, once, where the limit of an id ends episodes before the length that they were given; see `longest`."""
        limit, wanted = registered_limit(spec), self.steps
        if self._told or spec is None or limit is None or wanted is None or wanted <= limit:
            return
        if outer_steps not in (None, limit):
            return
        self._told = True
        gym.logger.warn(
            f"the limit of {spec.id} ends episodes after {limit} steps, {limit * self._control_dt:g} s, before the "
            f"episode_length of {wanted * self._control_dt:g} s: make it with max_episode_steps={wanted} instead"
        )


COST_NAMES = ("overspeed", "clearance", "pitch_rate")
"""Keys of ``info["costs"]`` without limits of the user."""

OVERSPEED_MARGIN = 0.6
"""Part of the way from rated speed to the overspeed limit that is margin: from 110 % on with a limit of 125 %."""

CLEARANCE_MARGIN = 0.3
"""Part of the clearance of the unloaded rotor that is margin, as Germanischer Lloyd's guideline (2010) asks for."""

PITCH_RATE_MARGIN = 0.1
"""Part of the greatest pitch rate that is margin."""


class Costs:
    """Costs of the steps of an environment.

    Parameters
    ----------
    control_dt : float
        [s]
    overspeed_limit : float
        Rotor speed at which an episode ends, over the rated one.
    limits : mapping, optional
        Of the user, by name of `COST_LIMITS`.
    """

    def __init__(
        self, turbine: Turbine, control_dt: float, overspeed_limit: float, limits: Mapping[str, float] | None = None
    ):
        rated = turbine.drivetrain.rated_rotor_speed
        self._speed_margin = OVERSPEED_MARGIN * (overspeed_limit - 1.0) * rated
        self._speed_limit = overspeed_limit * rated - self._speed_margin
        self._clearance = CLEARANCE_MARGIN * unloaded_clearance(turbine)
        self._travel = control_dt * turbine.pitch.max_rate
        self._rated, self._day_share, self._limits = rated, control_dt / DAY, limits

    def of(self, signals: Signals) -> dict[str, float]:
        """Costs by name of the step that led to these signals, each from 0 to 1 but that of the pitch travel."""
        if self._limits is not None:
            return {name: self._beyond(name, limit, signals) for name, limit in self._limits.items()}
        speed = (signals["rotor_speed_max"] - self._speed_limit) / self._speed_margin
        clearance = 1.0 - min(signals["tip_clearance_min"].tolist()) / self._clearance
        rate = 1.0 + (max(signals["pitch_travel"].tolist()) / self._travel - 1.0) / PITCH_RATE_MARGIN
        return {name: min(max(x, 0.0), 1.0) for name, x in zip(COST_NAMES, (speed, clearance, rate), strict=True)}

    def _beyond(self, name: str, limit: float, signals: Signals) -> float:
        """Cost by a limit of the user."""
        if name == PITCH_TRAVEL:
            blades = signals["pitch_travel"].tolist()
            return float(sum(blades) / len(blades) / (limit * self._day_share))
        if name == "rotor_speed":
            return float(signals["rotor_speed_max"] > limit * self._rated)
        if name == "tip_clearance":
            return float(min(signals["tip_clearance_min"].tolist()) < limit)
        fore_aft, side_side = (signals[f"nacelle_acceleration_{axis}"] for axis in ("fore_aft", "side_side"))
        return float(math.hypot(fore_aft, side_side) > limit)

    def of_failure(self) -> dict[str, float]:
        """Costs of a step that the simulation did not survive: the whole of each."""
        return dict.fromkeys(COST_NAMES if self._limits is None else self._limits, 1.0)


def violated(means: Mapping[str, float]) -> tuple[str, ...]:
    """Limits of the user that an episode with these mean costs of its steps violates."""
    return tuple(name for name, mean in means.items() if mean > (1.0 if name == PITCH_TRAVEL else 0.0))


IDLE_POWER = 1e-3
"""Electrical power over rated power below which a turbine makes none [-]."""
LEAST_SPELL = 20.0
"""Time without power that counts in a run [s]: a rotor that a lull has slowed down takes some seconds to recover."""


class IdleClock(Term):
    """Counts the time in which a turbine idles or stands without a reason.

    The turbine makes less than `IDLE_POWER` of its rated power. The mean wind over the rotor disc (`DiscWind`) lies
    between cut-in and cut-out. Nothing has stopped the turbine: no shut-down, loss of the generator or voltage dip has
    begun; the controller is in production (`wt_gym.control.controllers.Supervisor`; stages of ROSCO with ``start_stop``
    are not known); a demanded power is not zero.

    Attributes
    ----------
    time : float
        Length of the current spell, 0 while there is a reason or the turbine makes power [s].
    total : float
        Length of all spells of at least `LEAST_SPELL` [s].
    """

    remembered = ("time", "total")

    def __init__(self, turbine: Turbine, operation: Operation | None = None):
        self._least = IDLE_POWER * turbine.drivetrain.rated_power
        self._cut_in, self._cut_out = turbine.cut_in, turbine.cut_out
        self._disc, self._operation = DiscWind(turbine), operation
        self.time = self.total = 0.0

    def begin(self, _: Beginning) -> None:
        """Begin an episode."""
        self.time = self.total = 0.0

    def follow(self, step: Transition) -> None:
        """Count a step of an environment."""
        operation = cast("Operation", self._operation)
        self.advance(step, operation.controller, operation.faults)

    def advance(self, step: Transition, controller: Controller | None = None, faults: Iterable[object] = ()) -> None:
        """Count a step under a controller with faults; nothing is computed while the turbine makes power."""
        if step.after["generator_power"] >= self._least or self._has_reason(step, controller, faults):
            self.time = 0.0
            return
        before, self.time = self.time, self.time + step.dt
        if self.time >= LEAST_SPELL:
            self.total += step.dt if before >= LEAST_SPELL else self.time

    def _has_reason(self, step: Transition, controller: Controller | None, faults: Iterable[object]) -> bool:
        """Return True where wind, grid, fault or controller explain that there is no power."""
        if step.demanded_power is not None and step.demanded_power < self._least:
            return True
        if not self._cut_in < self._disc.begin(step.inflow, step.after) < self._cut_out:
            return True
        if not getattr(starting_part(controller), "in_production", True):
            return True
        now = step.after["time"]
        return any(
            now < fault.recovered if isinstance(fault, VoltageDip) else isinstance(fault, ShutDown | GeneratorLoss)
            for fault in faults
            if getattr(fault, "time", now) <= now
        )
