"""Supervisory control: when a turbine stands, starts, produces, is held back in a storm, and stops.

The states are those of a turbine's operation: *parked* (blades feathered, the rotor idles without torque), *start-up*
(the wind spins the rotor up to the speed at which the generator cuts in, which is then loaded by degrees),
*production* (the base controller), *soft cut-out* (production at a set point that falls with the mean wind), and
*shut-down* (blades to feather, the torque falls with the square of the speed). Stages and their numbers follow the
start-up and shut-down of ROSCO 2.10 (inputs SU_*, SD_*, PRC_WindSpeeds and PRC_GenSpeeds of the package ``rosco``;
Abbas et al., Wind Energ. Sci. 7 (2022) 53); a set point that falls above the wind of the classical cut-out is that of
storm control (Markou and Larsen, EWEC 2009; Bossanyi and King, EWEA 2012; Petrović and Bottasso, J. Phys. Conf. Ser.
524 (2014) 012052).
"""

import math
from typing import Any

import numpy as np

from wt_gym.base.errors import ControllerError
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import AtSetPoint, Controller, Readings, demanded_power_of, part_of
from wt_gym.control.controllers.discon import BaselineParameters
from wt_gym.control.controllers.lidar_feedforward import LidarFeedforward, ShiftablePitch
from wt_gym.control.controllers.tsr_tracking import SpeedExclusion, TsrTrackingController
from wt_gym.control.operating_point import least_pitch, torque_curve
from wt_gym.control.sensors import LowPass
from wt_gym.turbines import Turbine

STATES = ("parked", "start_up", "production", "soft_cut_out", "shut_down")
"""What a turbine does, in the order of `Supervisor.state_index`."""
_PARKED, _START_UP, _PRODUCTION, _SOFT, _SHUT_DOWN = range(len(STATES))

_BEST_ANGLE = math.radians(10.0)
"""Angle of attack and twist at 70 % of the radius with which a rotor starts [rad]: attached flow near best torque."""
_STANDS = 0.1
"""Rotor speed over rated below which a shut-down has ended [-]."""
_BEYOND_CUT_IN = 1.1
"""End of the ramp of a start-up in cut-in speeds [-]: in a wind that falls the speed lags behind the ramp."""
_PITCHED = math.radians(1.0)
"""Pitch above the least one from which on the pitch holds the speed [rad]."""
_MOST_TORQUE = 1.1
"""Torque that a shut-down may begin with, over rated [-]: that which the baseline controllers end at."""


@option_record
class SupervisorOptions(Options):
    """Parameters of a `Supervisor` by rule."""

    title = "supervisor"

    averaging: float = option(
        "time over which the wind is averaged; its low-pass filter has half of it", default=600.0, unit="s", low=0.0,
        above=True,
    )  # fmt: skip
    cut_out: float | None = option(
        "mean wind at which the turbine stops", default=None, unit="m/s", low=0.0, above=True,
        otherwise="5 m/s above the cut-out wind of the turbine", in_use=lambda turbine: turbine.cut_out + 5.0,
    )  # fmt: skip
    derate_from: float | None = option(
        "mean wind from which on the set point falls", default=None, unit="m/s", low=0.0, above=True,
        otherwise="2 m/s below the cut-out wind of the turbine", in_use=lambda turbine: turbine.cut_out - 2.0,
    )  # fmt: skip
    least_speed: float = option(
        "set point of the rotor speed at cut-out, over rated", default=0.75, unit="-", low=0.3, high=1.0
    )
    least_power: float = option(
        "power at cut-out over rated, at most least_speed", default=0.5, unit="-", low=0.0, high=1.0, above=True
    )
    hysteresis: float = option(
        "by which the mean wind must have fallen below cut-out for a restart", default=3.0, unit="m/s", low=0.0
    )
    restart_delay: float = option("time that the turbine stands at least", default=30.0, unit="s", low=0.0)
    run_up: float = option(
        "time in which a start-up brings the rotor to rated speed; a third of it loads the generator", default=60.0,
        unit="s", low=1.0,
    )  # fmt: skip
    gust: float = option(
        "wind over 3 s above cut-out at which the turbine stops at once", default=10.0, unit="m/s", low=0.0
    )
    overspeed: float = option(
        "rotor speed over rated at which the turbine stops at once", default=1.2, unit="-", low=1.0, above=True
    )
    stop_rate: float | None = option(
        "pitch rate of a shut-down", default=None, unit="rad/s", low=0.0, above=True,
        otherwise="half of the greatest rate of the drives", in_use=lambda turbine: 0.5 * turbine.pitch.max_rate,
    )  # fmt: skip
    resonance: float = option(
        "half width of the band of rotor speeds that is crossed quickly, over the one at which the passing blades "
        "excite the tower; 0: none", default=0.0, unit="-", low=0.0, high=0.3,
    )  # fmt: skip

    def check(self) -> None:
        """Refuse set points under which the torque rises."""
        if self.least_power > self.least_speed:
            raise ValueError(
                f"least_power must be at most least_speed, so that the torque does not rise, got {self.least_power:g} "
                f"and {self.least_speed:g}"
            )


class Supervisor:
    """A base controller under supervisory control.

    - *Parked*: blades feathered, no torque. After ``restart_delay`` the turbine starts when the mean wind lies between
      cut-in and, after a storm too, ``restart`` (``cut_out - hysteresis``). One that is parked from the beginning first
      averages the wind for the time of the filter.
    - *Start-up*: the blades turn from feather to where the flow at 70 % of the radius meets them at ten degrees, at no
      more than a quarter of the greatest rate, so that the flow stays attached while its angle falls. The speed
      follows a ramp that reaches rated speed in ``run_up``: where the wind would spin the rotor up faster, the gains of
      the turbine's pitch law hold it on the ramp. At 5 % above the cut-in speed of the generator production begins; the
      torque rises from none to that of the base controller in a third of ``run_up``.
    - *Production*: the demand of the base controller. While the set point is rated and the load full it is exactly
      that.
    - *Soft cut-out*: above ``derate_from`` the set points of speed and power fall with the mean wind. The base
      controller reads speeds over the set point, and so holds that; its torque is scaled to the set point of the power.
      A power that a grid operator demands is followed up to that.
    - *Shut-down*: above ``cut_out``, below cut-in by 0.5 m/s, in a gust or overspeed the blades go to feather at
      ``stop_rate``; the torque falls with the square of the speed, and ends at the cut-in speed.

    An ``averaging`` of 600 s is the ten minutes of the field; winds that are compressed in time need less. With
    ``cut_out`` at the cut-out wind of the turbine and ``least_speed`` 1 the cut-out is hard.

    Parameters
    ----------
    base : Controller
        Of the package: ``discon``, ``retuned``, ``tsr_tracking``, with or without ``lidar``; or ``rosco``, which begins
        afresh with every production.
    **parameters
        Of `SupervisorOptions`.

    Attributes
    ----------
    state_index : int
        Place of the current state in `STATES`.
    set_point : float
        Present set point of the rotor speed over rated [-].
    load : float
        Share of the base controller's torque that is demanded [-].
    asked : float
        By which an agent moves the set point of the speed [-].
    stopped : bool
        Whether a fault stops the turbine, which then stays parked.

    Raises
    ------
    ValueError, wt_gym.base.errors.ControllerError, TypeError
        For a damper as generator, which takes no torque; winds that do not fit each other; a base whose pitch cannot be
        shifted.
    """

    def __init__(self, turbine: Turbine, base: Controller, **parameters: Any):
        o, drive, pitch = SupervisorOptions(**parameters), turbine.drivetrain, turbine.pitch
        tracking = getattr(base, "base", base)
        if o.resonance > 0.0:
            if not isinstance(tracking, TsrTrackingController):
                raise ValueError(
                    f"resonance must be 0 for {type(tracking).__name__}: only a base that tracks the tip-speed ratio "
                    f"can avoid speeds; got {o.resonance!r}"
                )
            tracking.exclusion = SpeedExclusion.of_turbine(turbine, o.resonance)
        if not drive.takes_torque:
            raise ValueError(f"{turbine.name} has a damper as generator: a supervisor needs one that takes a torque")
        if not (isinstance(base, ShiftablePitch | LidarFeedforward) or getattr(base, "holds_set_point", False)):
            raise TypeError(
                f"a supervisor needs a controller whose pitch can be shifted (shift_pitch), discon, retuned or "
                f"tsr_tracking, or rosco without derate and start_stop; got {base!r}"
            )
        law, curve = BaselineParameters.from_turbine(turbine), torque_curve(turbine)
        self.base, self.pitch_law = base, law.pitch_law
        self.channels = tuple(dict.fromkeys((*base.channels, "rotor_speed", "wind_x", "wind_y")))
        # mean winds at which it starts, starts again after a storm, is held back, and stops; gust that stops it [m/s]
        self.cut_in, self.cut_out = turbine.cut_in, turbine.cut_out + 5.0 if o.cut_out is None else o.cut_out
        self.restart, self.gust = self.cut_out - o.hysteresis, self.cut_out + o.gust
        self.derate_from = min(turbine.cut_out - 2.0, self.cut_out) if o.derate_from is None else o.derate_from
        if not self.cut_in < self.restart:
            raise ControllerError(
                f"a supervisor needs cut-in < restart <= cut-out, got {self.cut_in:g}, {self.restart:g} and "
                f"{self.cut_out:g} m/s: choose a larger cut_out or a smaller hysteresis"
            )
        self.least_speed, self.least_power, self.overspeed = o.least_speed, o.least_power, o.overspeed  # over rated
        self.averaging, self.restart_delay, self.run_up = o.averaging, o.restart_delay, o.run_up  # [s]
        self.stop_rate = 0.5 * pitch.max_rate if o.stop_rate is None else min(o.stop_rate, pitch.max_rate)  # [rad/s]
        self.start_rate, self.feather = 0.25 * pitch.max_rate, min(pitch.max_pitch, 0.5 * math.pi)
        self.fine_pitch, self.rated_speed = least_pitch(turbine, turbine.cut_in), drive.rated_rotor_speed
        slowest = max(curve.cut_in_speed / drive.gear_ratio, drive.min_rotor_speed)
        self.cut_in_speed = 1.05 * slowest / self.rated_speed  # of the rotor over rated, where torque begins
        self.radius, self.rated_torque = 0.35 * turbine.rotor_diameter, law.rated_torque  # 70 % [m], [N m]
        self.to_generator, self.n_blades = self.rated_speed * drive.gear_ratio, turbine.n_blades
        self._mean, self._gust = LowPass(0.5 * o.averaging), LowPass(3.0)
        self._rotor = LowPass(0.5)
        self.state_index, self.set_point, self.load, self.asked = _PRODUCTION, 1.0, 1.0, 0.0
        self.stopped = False
        self._since = self._ramp = 0.0
        self._listened = math.inf
        self._pitch, self._torque, self._first_speed = self.fine_pitch, 0.0, 1.0

    # ---- questions ----

    @property
    def state(self) -> str:
        """State of the turbine, of `STATES`."""
        return STATES[self.state_index]

    @property
    def in_production(self) -> bool:
        """True while the demand is that of the base controller, as it is or held back."""
        return self.state_index in (_PRODUCTION, _SOFT)

    @property
    def mean_wind(self) -> float:
        """Mean wind that decides [m/s]."""
        return self._mean.value

    @property
    def agent_share(self) -> float:
        """Share of an agent's residual pitch and torque that acts [-]: `load` in production, none in other states."""
        return self.load if self.in_production else 0.0

    def set_points(self, wind: float) -> tuple[float, float]:
        """Rotor speed and power over rated in a mean wind [m/s]: falling in straight lines up to ``cut_out``."""
        width = self.cut_out - self.derate_from
        share = 0.0 if width <= 0.0 else min(max((wind - self.derate_from) / width, 0.0), 1.0)
        return 1.0 - share * (1.0 - self.least_speed), 1.0 - share * (1.0 - self.least_power)

    def acting_offset(self, asked: float) -> float:
        """Offset of the set point of the speed [-] within what acts in the current mean wind."""
        target, _ = self.set_points(self._mean.value)
        return min(max(asked, self.cut_in_speed - target), 1.0 - target)

    def runs_in(self, wind: float) -> bool:
        """Whether a turbine runs in a mean wind [m/s] at a start: up to the middle between restart and stop."""
        return self.cut_in <= wind <= 0.5 * (self.restart + self.cut_out)

    # ---- the contract of controllers ----

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start in production, or parked where the rotor barely turns and the blades are feathered.

        The mean wind starts at the current one, but no further than the state of the turbine holds. Parked, it is the
        mean since the start until the filter knows more: one reading in turbulence says little.
        """
        pitch = float(np.mean(demand.pitch))
        wind, speed = self._wind(signals), signals["rotor_speed"] / self.rated_speed
        parked = speed < 0.5 * self.cut_in_speed and pitch > 0.5 * self.feather
        self.state_index, self.asked, self.stopped = (_PARKED if parked else _PRODUCTION), 0.0, False
        self._mean.reset(wind if parked else min(max(wind, self.cut_in), self.cut_out))
        self._listened = 0.0 if parked else math.inf
        self._gust.reset(wind)
        self._rotor.reset(speed)
        self.set_point, self.load = 1.0, 0.0 if parked else 1.0
        self._since, self._ramp = (self.restart_delay if parked else 0.0), speed
        self._pitch, self._torque, self._first_speed = pitch, float(demand.generator_torque), max(speed, _STANDS)
        self.base.start(signals, demand)

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        wind = self._wind(signals)
        mean, gust = self._averaged(wind, dt), self._gust.update(wind, dt)
        speed = signals["rotor_speed"] / self.rated_speed
        self._since += dt
        if self.state_index == _PARKED:
            waited = self._since >= self.restart_delay and self._listened >= self._mean.time_constant
            if waited and not self.stopped and self.cut_in <= mean <= self.restart and gust < self.gust:
                self._enter(_START_UP)
                self._ramp = max(speed, 0.0)
                self._rotor.reset(speed)
        elif self.state_index == _SHUT_DOWN:
            if speed < _STANDS and self._pitch >= self.feather - _PITCHED:
                self._enter(_PARKED)
        elif (
            self.stopped
            or mean > self.cut_out
            or mean < self.cut_in - 0.5
            or gust > self.gust
            or speed > self.overspeed
        ):
            self._torque = min(self._torque, _MOST_TORQUE * self.rated_torque)
            self._first_speed = max(speed, _STANDS)
            self._enter(_SHUT_DOWN)
        elif self.state_index == _START_UP and speed >= self.cut_in_speed:
            self._begin_production(signals, speed)
        if self.state_index in (_PRODUCTION, _SOFT):
            return self._produce(signals, mean, dt)
        if self.state_index == _START_UP:
            self._spin_up(wind, speed, dt)
        elif self.state_index == _SHUT_DOWN:
            self._stop(speed, dt)
        else:
            self._move(self.feather, self.stop_rate * dt)
            self._torque = 0.0
        return Demand(np.full(self.n_blades, self._pitch), 0.0, self._torque)

    def shift_pitch(self, change: float) -> None:
        """Move the pitch of the next demand by so much [rad], in production."""
        if self.state_index in (_PRODUCTION, _SOFT) and isinstance(self.base, ShiftablePitch):
            self.base.shift_pitch(change)

    # ---- states ----

    def _enter(self, state: int) -> None:
        self.state_index, self._since = state, 0.0

    @staticmethod
    def _wind(signals: Readings) -> float:
        """Horizontal wind by the anemometer [m/s]."""
        return math.hypot(signals["wind_x"], signals["wind_y"])

    def _averaged(self, wind: float, dt: float) -> float:
        """Mean wind [m/s]: low-pass filtered; after a parked start the plain mean for the time of the filter."""
        if self._listened >= self._mean.time_constant:
            return self._mean.update(wind, dt)
        self._listened += dt
        return self._mean.reset(self._mean.value + (wind - self._mean.value) * dt / self._listened)

    def _move(self, pitch: float, reach: float) -> None:
        self._pitch += min(max(pitch - self._pitch, -reach), reach)

    def _spin_up(self, wind: float, speed: float, dt: float) -> None:
        """Pitch of a start-up: as near to the best angle of attack as the ramp of the speed lets it."""
        self._ramp = min(self._ramp + dt / self.run_up, _BEYOND_CUT_IN * self.cut_in_speed)
        before = self._rotor.value
        smooth = self._rotor.update(speed, dt)
        proportional, integral = self.pitch_law.gains(self._pitch)
        rise = smooth - before - (dt / self.run_up if self._ramp < _BEYOND_CUT_IN * self.cut_in_speed else 0.0)
        target = self._pitch + self.to_generator * (proportional * rise + integral * (smooth - self._ramp) * dt)
        inflow = math.atan2(max(wind, 0.0), max(speed, 0.0) * self.rated_speed * self.radius)
        least = min(max(inflow - _BEST_ANGLE, self.fine_pitch), self.feather)
        self._move(min(max(target, least), self.feather), self.start_rate * dt)
        self._torque = 0.0

    def _begin_production(self, signals: Readings, speed: float) -> None:
        """Hand over to the base controller, which continues from the current pitch and speed, without torque."""
        self._enter(_PRODUCTION)
        self.set_point, self.load = min(speed, 1.0), 0.0
        self.base.start(
            AtSetPoint(signals, self.set_point, self.set_point), Demand(np.full(self.n_blades, self._pitch), 0.0, 0.0)
        )

    def _produce(self, signals: Readings, mean: float, dt: float) -> Demand:
        target, power = self.set_points(mean)
        self.state_index = _SOFT if target < 1.0 or power < 1.0 else _PRODUCTION
        if self.asked != 0.0:
            moved = min(max(target + self.asked, self.cut_in_speed), 1.0)
            power, target = power * moved / target, moved
        pitched = self._pitch > self.fine_pitch + _PITCHED
        reach = dt / (self.run_up if pitched else 0.1 * self.run_up)
        self.set_point += min(max(target - self.set_point, -reach), reach)
        self.load = min(self.load + 3.0 * dt / self.run_up, 1.0)
        share, cut = self.set_point, min(power / target, 1.0)
        factor, kept = self.load * cut, share * cut
        as_is = share == 1.0 and (kept == 1.0 or demanded_power_of(signals) is None)
        demand = self.base.step(signals if as_is else AtSetPoint(signals, share, kept), dt)
        if factor != 1.0:
            demand = Demand(demand.pitch, demand.yaw_rate, factor * demand.generator_torque)
        self._pitch, self._torque = float(demand.pitch[0]), float(demand.generator_torque)
        return demand

    def _stop(self, speed: float, dt: float) -> None:
        """Pitch and torque of a shut-down."""
        self._move(self.feather, self.stop_rate * dt)
        ratio = max(speed, 0.0) / self._first_speed
        self._first_speed = max(speed, _STANDS)
        self._torque = 0.0 if speed < self.cut_in_speed else self._torque * min(ratio, 1.0) ** 2


def supervisor_of(controller: Controller | None) -> Supervisor | None:
    """Supervisor among the parts of a controller, None without any."""
    return part_of(controller, Supervisor)
