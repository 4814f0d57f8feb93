"""What breaks in an episode: kind, blade, time and size, drawn from the random numbers of the episode.

Each kind has a range of sizes for training and one beyond it that is held back for tests (`SIZE_RANGES`). Signs and
blades are drawn evenly. Kinds:

- ``stuck_blade``: the pitch of one blade seizes;
- ``slow_drive``: the drive of one blade has a share of its greatest rate;
- ``misaligned_blade``: one blade slips on its bearing by an angle that its encoder does not see: an aerodynamic
  imbalance;
- ``iced_blade``: mass, lift and drag of one blade with a level of ice (`wt_gym.turbines.blade`). Masses cannot change
  in a run, so the ice is there from the start, and its levels are few: each blade and level is a model of its own;
- ``biased_rotor_speed``, ``biased_generator_speed``: one of the two speed sensors reads a factor of the truth;
- ``biased_moment``: the gauge of the flapwise root moment of one blade reads an offset, over the reference moment;
- ``biased_pitch``, ``biased_vane``: the reading of the pitch of one blade, or the wind vane, is off by an angle;
- ``dead_…``: the same sensors read zero;
- ``voltage_dip``: the voltage of the grid falls for 150 ms to what is drawn
  (`wt_gym.simulation.drivetrain.faults.VoltageDip`).

Sensors feed the base controller and the agent. Faults of sensors change readings alone: rewards and signals are those
of what is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.control.design import reference_flap_moment
from wt_gym.envs.arguments import check_number, shown
from wt_gym.envs.options.faults import FAULT_KINDS, GRID_KINDS, NO_FAULT
from wt_gym.simulation.drivetrain.faults import PitchMisalignment, SensorBias, SlowPitch, StuckPitch, VoltageDip
from wt_gym.turbines.blade import BladeIce

if TYPE_CHECKING:
    from wt_gym.envs.options.faults import FaultOptions
    from wt_gym.simulation.drivetrain.faults import DriveFault
    from wt_gym.turbines import Turbine

__all__ = ["ICED", "SIZE_RANGES", "DrawnFault", "FaultDraws"]

ICED = "iced_blade"
_DEGREE = math.pi / 180.0
_CHOICE = ("kind", "blade", "time", "size")

SIZE_RANGES: dict[str, dict[str, tuple[float, ...]]] = {
    "slow_drive": {"train": (0.1, 0.3), "held_back": (0.04, 0.1)},
    "misaligned_blade": {"train": (1.0 * _DEGREE, 3.0 * _DEGREE), "held_back": (3.0 * _DEGREE, 4.0 * _DEGREE)},
    ICED: {"train": (0.3, 0.6), "held_back": (1.0,)},
    "biased_rotor_speed": {"train": (0.04, 0.1), "held_back": (0.1, 0.15)},
    "biased_generator_speed": {"train": (0.02, 0.05), "held_back": (0.05, 0.08)},
    "biased_moment": {"train": (0.2, 0.5), "held_back": (0.5, 0.8)},
    "biased_pitch": {"train": (2.0 * _DEGREE, 5.0 * _DEGREE), "held_back": (5.0 * _DEGREE, 8.0 * _DEGREE)},
    "voltage_dip": {"train": (0.2, 0.7), "held_back": (0.0, 0.2)},
    "biased_vane": {"train": (15.0 * _DEGREE, 30.0 * _DEGREE), "held_back": (30.0 * _DEGREE, 40.0 * _DEGREE)},
}
"""Ends of the ranges of sizes, of ice the levels; share of the greatest rate, remaining voltage, rad, or relative."""
_SIGNED = tuple(name for name in SIZE_RANGES if name not in ("slow_drive", "voltage_dip", ICED))
_CHANNELS = {
    "rotor_speed": ("rotor_speed",),
    "generator_speed": ("generator_speed",),
    "moment": ("root_flap_moment_{}",),
    "pitch": ("pitch_{}", "pitch_command_{}", "pitch_rate_{}"),
    "vane": ("yaw_error",),
}
"""What the sensors of the kinds read."""


@dataclass(frozen=True)
class DrawnFault:
    """What breaks in an episode.

    Attributes
    ----------
    kind : str
        Of `wt_gym.envs.options.faults.FAULT_KINDS`.
    blade : int
        From 1 on; means nothing for faults of no blade.
    time : float
        [s].
    size : float
        See `SIZE_RANGES`; 0 where a kind has none.
    faults : tuple
        Of `wt_gym.simulation.drivetrain.faults`.
    """

    kind: str
    blade: int
    time: float
    size: float
    faults: tuple[DriveFault | SensorBias, ...]

    @property
    def ice(self) -> BladeIce | None:
        """Ice on a blade."""
        return BladeIce(self.blade, self.size) if self.kind == ICED else None

    @property
    def told(self) -> dict[str, Any]:
        """What `reset` tells of it in its info."""
        return {name: getattr(self, name) for name in _CHOICE}


class FaultDraws:
    """Draws what breaks in episodes.

    Parameters
    ----------
    turbine : Turbine
    options : FaultOptions
        With kinds.
    """

    def __init__(self, turbine: Turbine, options: FaultOptions):
        self._turbine, self._options = turbine, options

    def draw(self, rng: np.random.Generator, chosen: Any = None) -> DrawnFault:
        """Draw the fault of an episode.

        Parameters
        ----------
        rng : numpy.random.Generator
            One number is drawn of it, whatever breaks.
        chosen : str or mapping, optional
            Kind, or ``kind``, ``blade``, ``time`` and ``size``; what is left out is drawn.

        Raises
        ------
        ValueError
            If what is chosen has no meaning.
        """
        own = np.random.default_rng(int(rng.integers(2**63)))
        kinds, options = self._options.kinds or (NO_FAULT,), self._options
        number, blade = int(own.integers(2**31)), 1 + int(own.integers(self._turbine.n_blades))
        time, share, sign = own.uniform(*options.time), own.uniform(), (-1.0, 1.0)[int(own.integers(2))]  # type: ignore[misc]
        given = self._checked(chosen)
        kind = given.get("kind", kinds[number % len(kinds)])
        size = given.get("size", self._size(kind, share, sign))
        blade, time = given.get("blade", blade), given.get("time", time)
        if kind in (NO_FAULT, ICED):
            time = 0.0
        if kind == ICED and not 0.0 < size <= 2.0:
            raise ValueError(f"the size of an iced_blade must be above 0 and at most 2, got {size!r}")
        if kind == "slow_drive" and not size >= 0.0:
            raise ValueError(f"the size of a slow_drive must be at least 0, got {size!r}")
        return DrawnFault(kind, blade, time, size, self._faults(kind, blade, time, size))

    def _checked(self, chosen: Any) -> dict[str, Any]:
        """What is chosen, by name."""
        given = {"kind": chosen} if isinstance(chosen, str) else {} if chosen is None else chosen
        if not isinstance(given, Mapping):
            raise ValueError(f"fault must be a kind or a mapping of {', '.join(_CHOICE)}, got {shown(chosen)}")
        given = dict(given)
        for name in given:
            if name not in _CHOICE:
                raise ValueError(
                    f"fault must have the keys {', '.join(_CHOICE)}, got {name!r}{did_you_mean(name, _CHOICE)}"
                )
        if "kind" in given and given["kind"] not in (known := (*FAULT_KINDS, *GRID_KINDS)):
            raise ValueError(
                f"the kind of a fault must be among {', '.join(known)}, got {given['kind']!r}"
                f"{did_you_mean(given['kind'], known)}"
            )
        n = self._turbine.n_blades
        if "blade" in given and given["blade"] not in range(1, n + 1):
            raise ValueError(f"the blade of a fault must be 1 to {n}, got {given['blade']!r}")
        given |= {name: check_number(name, given[name]) for name in ("time", "size") if name in given}
        if given.get("time", 0.0) < 0.0:
            raise ValueError(f"the time of a fault must be at least 0 s, got {given['time']!r} s")
        return given

    def _size(self, kind: str, share: float, sign: float) -> float:
        """Size of a kind that a share stands for; 0 where it has none."""
        if kind not in SIZE_RANGES:
            return 0.0
        ends = SIZE_RANGES[kind][self._options.sizes]
        if kind == ICED:
            return ends[min(int(share * len(ends)), len(ends) - 1)]
        size = ends[0] + share * (ends[1] - ends[0])
        return sign * size if kind in _SIGNED else size

    def _faults(self, kind: str, blade: int, time: float, size: float) -> tuple[DriveFault | SensorBias, ...]:
        """What a kind is made of."""
        if kind in (NO_FAULT, ICED):
            return ()
        if kind == "stuck_blade":
            return (StuckPitch(time, blade),)
        if kind == "slow_drive":
            return (SlowPitch(time, blade, size * self._turbine.pitch.max_rate),)
        if kind == "voltage_dip":
            return (VoltageDip(time, size),)
        if kind == "misaligned_blade":
            return (PitchMisalignment(time, blade, size),)
        how, _, sensor = kind.partition("_")
        channels = tuple(name.format(blade) for name in _CHANNELS[sensor])
        if how == "dead":
            return (SensorBias(time, channels, 0.0),)
        if sensor == "moment":
            return (SensorBias(time, channels, 1.0, size * reference_flap_moment(self._turbine)),)
        if sensor in ("rotor_speed", "generator_speed"):
            return (SensorBias(time, channels, 1.0 + size),)
        if sensor == "vane":  # that of the mirror image is turned to the other side
            return (SensorBias(time, channels, 1.0, size if self._turbine.rotation == "clockwise" else -size),)
        return (SensorBias(time, channels[:2], 1.0, size),)
