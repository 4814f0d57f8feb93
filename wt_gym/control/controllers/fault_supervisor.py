"""A supervisor of faults: it watches drives and sensors, repairs readings, and falls back to collective pitch.

It stands around a whole controller with all additions. What it watches is what a turbine measures:

- *speeds*: rotor speed, generator speed over the gear ratio, and electrical power over efficiency and torque are three
  measurements of one speed. One that is farther than ``speed_tolerance`` of rated speed from the middle one is replaced
  by that. Without torque there are two, and the greater one stands where they disagree;
- *flapwise moments*: a gauge that reads the same number for ``frozen_time`` is dead. The others tell the mean M_0 of
  all blades, which is fast, and tilt and yaw (a, b) in the fixed frame, which are slow: with the errors
  e_i = M_i - M_0 - a cos psi_i - b sin psi_i of the sound blades, whose mean M_0 makes zero, (a, b) grow by
  (sum e_i cos psi_i, sum e_i sin psi_i) in 1.5 s. M_0 + a cos psi + b sin psi stands for the dead one. A jump of more
  than ``moment_jump`` reference moments in one step does not come from the wind; later readings are shifted back by it;
- *pitch*: the reading of each blade is compared with a model of its drive that follows the demands with the greatest
  rate. A reading that jumps faster than a drive turns is a failing encoder, and the model stands for it. A reading that
  is off by ``pitch_tolerance`` for ``pitch_time`` is a failing drive;
- *wind vane*: a reading that stays for ``frozen_time`` while that of the anemometer changes, or that jumps by
  ``vane_jump``, is not believed any more: the nacelle is held.

With a failing drive, or gauges of less than two blades, the individual part of the pitch fades out over ``fade_time``:
all blades get the mean of the demands. Where a failing drive is off by ``stop_deviation`` and a supervisor
(`supervisor`) is among the parts, that stops the turbine. Faults of drives, gauges and vane are latched; while nothing
is wrong the demands are exactly those of the controller. Structures of this kind are the usual answers to the benchmark
of Odgaard, Stoustrup and Kinnaert (IEEE Trans. Control Syst. Technol. 21 (2013) 1168): redundancy, models of drives,
reconfiguration.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Addition, Combined, Controller, Readings, RepairedReadings, part_of
from wt_gym.control.controllers.linear_optimal import linear_part
from wt_gym.control.controllers.supervisor import supervisor_of
from wt_gym.control.design import reference_flap_moment
from wt_gym.control.sensors import LowPass
from wt_gym.turbines import Turbine


@option_record
class FaultSupervisorOptions(Options):
    """Parameters of a `FaultSupervisor` by rule."""

    title = "fault_supervisor"

    speed_tolerance: float = option(
        "difference of a speed from the middle of three from which on it is replaced, over rated", default=0.015,
        unit="-", low=0.0, high=1.0, above=True,
    )  # fmt: skip
    moment_jump: float = option(
        "change of a flapwise moment in one step that is a fault of its gauge, over the reference moment",
        default=0.15, unit="-", low=0.0, above=True,
    )  # fmt: skip
    frozen_time: float = option(
        "time for which a moment or the wind vane reads the same before it is dead", default=0.5, unit="s", low=0.0,
        above=True,
    )  # fmt: skip
    vane_jump: float = option(
        "change of the wind vane in one step that is a fault", default=0.2, unit="rad", low=0.0, high=math.pi,
        above=True,
    )  # fmt: skip
    pitch_tolerance: float = option(
        "difference of a pitch from the model of its drive that is a fault", default=0.02, unit="rad", low=0.0,
        high=math.pi, above=True,
    )  # fmt: skip
    pitch_time: float = option("time for which it must last", default=1.0, unit="s", low=0.0)
    stop_deviation: float = option(
        "difference at which a supervisor among the parts stops the turbine", default=0.07, unit="rad", low=0.0,
        high=math.pi, above=True,
    )  # fmt: skip
    fade_time: float = option(
        "time in which individual pitch fades out", default=2.0, unit="s", low=0.0, above=True
    )  # fmt: skip


_FASTER = 1.5
"""Change of a pitch reading that no drive makes, over that at the greatest rate [-]."""
_CYCLIC = 1.5
"""Time constant of the estimate of tilt and yaw of the flapwise moments [s]."""
_LEAST_GAUGES = 2
"""From which tilt and yaw of the moments follow."""
_ROUNDING = 1e-9


class FaultSupervisor(Combined):
    """A controller with additions under a supervisor of faults.

    Parameters
    ----------
    *additions : Addition
    **parameters
        Of `FaultSupervisorOptions`.

    Attributes
    ----------
    share : float
        Of the individual part of the pitch that acts [-].

    Raises
    ------
    ValueError
        If the turbine has less than three blades, or a damper as generator.
    """

    def __init__(self, turbine: Turbine, base: Controller, *additions: Addition, **parameters: Any):
        super().__init__(base, *additions)
        o, drive, pitch = FaultSupervisorOptions(**parameters), turbine.drivetrain, turbine.pitch
        if turbine.n_blades < 3:
            raise ValueError(f"a fault_supervisor needs at least 3 blades, which it compares, got {turbine.n_blades}")
        if not drive.takes_torque:
            raise ValueError(f"{turbine.name} has a damper as generator: a fault_supervisor needs a measured torque")
        self.speed_tolerance = o.speed_tolerance * drive.rated_rotor_speed  # [rad/s]
        self.moment_jump, self.frozen_time = o.moment_jump * reference_flap_moment(turbine), o.frozen_time  # [N m], [s]
        self.vane_jump, self.pitch_tolerance, self.pitch_time = o.vane_jump, o.pitch_tolerance, o.pitch_time
        self.stop_deviation, self.fade_time = o.stop_deviation, o.fade_time
        self.gear_ratio, self.efficiency = drive.gear_ratio, drive.generator_efficiency
        rated_torque = drive.rated_power / (self.efficiency * drive.rated_rotor_speed * self.gear_ratio)
        self.least_torque = 0.1 * rated_torque  # from which on power over torque is a measurement of the speed
        self.drive, self.n_blades = pitch, turbine.n_blades
        blades = range(1, self.n_blades + 1)
        self._moments = tuple(f"root_flap_moment_{b}" for b in blades)
        self._pitches = tuple(f"pitch_{b}" for b in blades)
        lag = 0.0 if pitch.servo_frequency is None else 2.0 * pitch.servo_damping / pitch.servo_frequency
        self._lags = [LowPass(lag) for _ in blades]  # of drives behind a moving command
        self._forget([0.0] * self.n_blades, [0.0] * self.n_blades, 0.0)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the signals that any part reads, and of those that are watched."""
        watched = ("rotor_speed", "generator_speed", "generator_torque", "generator_power", "yaw_error", "azimuth")
        others = ("wind_x", "wind_y", *self._pitches, *self._moments)
        return tuple(dict.fromkeys((*super().channels, *watched, *others)))

    @property
    def alarms(self) -> tuple[str, ...]:
        """Names of what is found to fail."""
        found = [f"{what}_{b + 1}" for what, flags in self._flags.items() for b, bad in enumerate(flags) if bad]
        return (*found, *(name for name, bad in (("vane", self._vane_bad), *self._speeds_bad.items()) if bad))

    def _forget(self, pitch: list[float], moments: list[float], vane: float) -> None:
        n = self.n_blades
        self.share = 1.0
        self._demand, self._command, self._pitch = list(pitch), list(pitch), list(pitch)
        self._off_for = [0.0] * n
        self._moment, self._same_for, self._shift = list(moments), [0.0] * n, [0.0] * n
        self._tilt = self._yaw = 0.0
        self._flags = {name: [False] * n for name in ("drive", "encoder", "gauge", "gauge_shift")}
        self._vane, self._wind, self._vane_same_for, self._vane_bad = vane, math.nan, 0.0, False
        self._speeds_bad = {"rotor_speed": False, "generator_speed": False}
        for lag, angle in zip(self._lags, pitch, strict=True):
            lag.reset(angle)

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start all parts; nothing fails yet."""
        angles = list(map(float, demand.pitch))
        self._forget(angles, [signals[name] for name in self._moments], signals["yaw_error"])
        self._pitch = [signals[name] for name in self._pitches]
        super().start(signals, demand)

    def take_demand(self, demand: Demand) -> None:
        """Take what the drives are asked for, where that is not the demand of this controller."""
        self._demand = list(map(float, demand.pitch))

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        speeds = self._speed_repairs(signals)
        self._speeds_bad = {name: name in speeds for name in self._speeds_bad}
        self._watch_moments(signals, dt)
        self._watch_pitch(signals, dt)
        self._watch_vane(signals, dt)
        read = self._repaired(signals, speeds, dt)
        if any(self._flags["drive"]) and (supervisor := supervisor_of(self)) is not None:
            off = zip(self._flags["drive"], self._deviation(signals), strict=True)
            supervisor.stopped = supervisor.stopped or any(bad and d > self.stop_deviation for bad, d in off)
        demand = super().step(read, dt)
        rests = any(self._flags["drive"]) or self._flags["gauge"].count(False) < _LEAST_GAUGES
        reach = dt / self.fade_time
        self.share += min(max((0.0 if rests else 1.0) - self.share, -reach), reach)
        if self.share < 1.0 or self._vane_bad:
            fallen = self._fallen_back(demand)
            if self.share < 1.0 and (linear := linear_part(self)) is not None:
                linear.see_demand(demand, fallen, read, dt)
            demand = fallen
        self._demand = list(map(float, demand.pitch))
        return demand

    def believed(self, signals: Readings) -> Readings:
        """Readings of the parts at an instant, by what is known to fail already; nothing is remembered.

        What begins to fail at this instant is found by the next step, and a failing encoder reads what the model of its
        drive had a step before.
        """
        return self._repaired(signals, self._speed_repairs(signals), 0.0)

    def _repaired(self, signals: Readings, speeds: dict[str, float], dt: float) -> Readings:
        """Readings with what stands for those that fail."""
        repaired = speeds | self._moment_repairs(signals, dt)
        for b, name in enumerate(self._pitches):
            if self._flags["encoder"][b]:
                repaired[name] = self._lags[b].value
        if self._vane_bad:
            repaired["yaw_error"] = 0.0
        return RepairedReadings(signals, repaired) if repaired else signals

    def with_agent(self, base: Demand, demand: Demand) -> Demand:
        """A demand of an agent on top of that of this controller, in as far as its individual pitch may act."""
        if self.share == 1.0:
            return demand
        added = np.asarray(demand.pitch) - base.pitch
        mean = added.mean()
        return replace(demand, pitch=base.pitch + mean + self.share * (added - mean))

    def _fallen_back(self, demand: Demand) -> Demand:
        """Demand with a share of the individual part of the pitch, and a nacelle that is held if need be."""
        angles = list(map(float, demand.pitch))
        mean = sum(angles) / len(angles)
        pitch = np.array([mean + self.share * (angle - mean) for angle in angles])
        return Demand(pitch, 0.0 if self._vane_bad else demand.yaw_rate, demand.generator_torque)

    def _speed_repairs(self, signals: Readings) -> dict[str, float]:
        """Speeds in the place of those that fail."""
        rotor, generator, torque = signals["rotor_speed"], signals["generator_speed"], signals["generator_torque"]
        speeds = [rotor, generator / self.gear_ratio]
        if torque > self.least_torque:
            speeds.append(signals["generator_power"] / (self.efficiency * torque * self.gear_ratio))
        best = sorted(speeds)[1]
        found = (("rotor_speed", speeds[0], 1.0), ("generator_speed", speeds[1], self.gear_ratio))
        return {name: factor * best for name, speed, factor in found if abs(speed - best) > self.speed_tolerance}

    def _watch_moments(self, signals: Readings, dt: float) -> None:
        """Find out which gauges fail."""
        dead, shifted = self._flags["gauge"], self._flags["gauge_shift"]
        for b, name in enumerate(self._moments):
            now, before = signals[name], self._moment[b]
            self._same_for[b] = self._same_for[b] + dt if now == before else 0.0
            if abs(now - before) > self.moment_jump:
                self._shift[b] += now - before
                shifted[b] = True
            dead[b] = dead[b] or self._same_for[b] > self.frozen_time - _ROUNDING
            self._moment[b] = now

    def _moment_repairs(self, signals: Readings, dt: float) -> dict[str, float]:
        """Flapwise moments in the place of those that fail; tilt and yaw of the sound ones move over a time."""
        dead, shifted, turns = self._flags["gauge"], self._flags["gauge_shift"], self._directions(signals["azimuth"])
        moments = [signals[name] - self._shift[b] for b, name in enumerate(self._moments)]
        good = [(moments[b], *turns[b]) for b in range(len(moments)) if not dead[b]]
        mean = 0.0
        if good:
            mean = sum(moment - self._tilt * cos - self._yaw * sin for moment, cos, sin in good) / len(good)
            errors = [moment - mean - self._tilt * cos - self._yaw * sin for moment, cos, sin in good]
            self._tilt += dt / _CYCLIC * sum(e * cos for e, (_, cos, _) in zip(errors, good, strict=True))
            self._yaw += dt / _CYCLIC * sum(e * sin for e, (_, _, sin) in zip(errors, good, strict=True))
        return {
            name: mean + self._tilt * turns[b][0] + self._yaw * turns[b][1] if dead[b] else moments[b]
            for b, name in enumerate(self._moments)
            if dead[b] or shifted[b]
        }

    def _directions(self, azimuth: float) -> list[tuple[float, float]]:
        """Cosine and sine of the azimuth of each blade."""
        n = self.n_blades
        angles = [azimuth + 2.0 * math.pi * b / n for b in range(n)]
        return [(math.cos(angle), math.sin(angle)) for angle in angles]

    def _watch_pitch(self, signals: Readings, dt: float) -> None:
        """Compare each pitch with the model of its drive."""
        drives, encoders = self._flags["drive"], self._flags["encoder"]
        reach = self.drive.max_rate * dt
        for b, name in enumerate(self._pitches):
            target = min(max(self._demand[b], self.drive.min_pitch), self.drive.max_pitch)
            self._command[b] += min(max(target - self._command[b], -reach), reach)
            model, now = self._lags[b].update(self._command[b], dt), signals[name]
            jump, self._pitch[b] = abs(now - self._pitch[b]), now
            encoders[b] = encoders[b] or jump > _FASTER * reach + 0.5 * self.pitch_tolerance
            off = abs(now - model) > self.pitch_tolerance and not encoders[b]
            self._off_for[b] = self._off_for[b] + dt if off else 0.0
            drives[b] = drives[b] or (off and self._off_for[b] > self.pitch_time - _ROUNDING)

    def _deviation(self, signals: Readings) -> list[float]:
        """Deviation of the pitch of each blade from the model of its drive [rad]."""
        return [abs(signals[name] - lag.value) for name, lag in zip(self._pitches, self._lags, strict=True)]

    def _watch_vane(self, signals: Readings, dt: float) -> None:
        """Find out whether the wind vane fails."""
        now, wind = signals["yaw_error"], math.hypot(signals["wind_x"], signals["wind_y"])
        if now != self._vane:
            self._vane_same_for = 0.0
        elif wind != self._wind:
            self._vane_same_for += dt
        self._wind = wind
        jump = abs(math.remainder(now - self._vane, 2.0 * math.pi))
        frozen = self._vane_same_for > self.frozen_time - _ROUNDING
        self._vane_bad, self._vane = self._vane_bad or frozen or jump > self.vane_jump, now


def fault_supervisor_of(controller: Controller | None) -> FaultSupervisor | None:
    """The supervisor of faults around a controller, None without one."""
    return part_of(controller, FaultSupervisor)
