"""Faults of an episode: options, and kind, blade, time and size, drawn from the random numbers of the episode.

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

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, as_pair, as_tuple, check_number, not_empty, option, option_record, shown
from wt_gym.control.design import reference_flap_moment
from wt_gym.envs.operation import OWN
from wt_gym.envs.terms import Request, Term
from wt_gym.simulation.drivetrain.faults import (
    DriveFault,
    PitchMisalignment,
    SensorBias,
    SlowPitch,
    StuckPitch,
    VoltageDip,
)
from wt_gym.turbines import BladeIce, Turbine

NO_FAULT, ALL = "none", "all"
"""Kind of an episode in which nothing breaks, and what stands for all kinds."""
FAULT_KINDS = (
    NO_FAULT, "stuck_blade", "slow_drive", "misaligned_blade", "iced_blade", "biased_rotor_speed", "dead_rotor_speed",
    "biased_generator_speed", "biased_moment", "dead_moment", "biased_pitch", "dead_pitch", "biased_vane", "dead_vane",
)  # fmt: skip
"""Kinds of faults of the turbine."""
GRID_KINDS = ("voltage_dip",)
"""Kinds of faults of the grid; "all" does not stand for it."""
_KNOWN = (*FAULT_KINDS, *GRID_KINDS)

SIZES = ("train", "held_back")
"""Ranges that the sizes of faults are drawn from."""


def _checked_kinds(kinds: str | tuple[str, ...]) -> tuple[str, ...]:
    names = FAULT_KINDS if kinds == ALL else as_tuple(kinds)
    if wrong := [name for name in names if name not in _KNOWN]:
        raise ValueError(f"must be among {', '.join(_KNOWN)}, got {shown(wrong[0])}{did_you_mean(wrong[0], _KNOWN)}")
    return not_empty(names)


@option_record
class FaultOptions(Options):
    """Faults of an episode, see `wt_gym.envs.faults`."""

    title = "faults"
    prefix = "fault_"
    switch = "kinds"

    kinds: str | tuple[str, ...] | None = option(
        f'Kinds of faults; each episode draws one of them: {", ".join(FAULT_KINDS)}; "all" of them; and '
        f"{', '.join(GRID_KINDS)}. None: nothing breaks",
        default=None,
        kind="str or sequence of str, optional",
        check=_checked_kinds,
    )
    sizes: str = option(
        "Range that the size of a fault is drawn from: that for training, or one beyond it for tests",
        default="train",
        choices=SIZES,
    )
    time: float | tuple[float, float] = option(
        "When the fault begins; a range is drawn from. Ice is there from the start of the episode",
        default=(5.0, 20.0),
        unit="s",
        low=0.0,
        check=as_pair,
    )


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
"""Signals that the sensors of the kinds read."""


@dataclass(frozen=True)
class DrawnFault:
    """Fault of an episode."""

    kind: str  #: one of `FAULT_KINDS`
    blade: int  #: From 1 on; means nothing for faults of no blade
    time: float  #: [s]
    size: float  #: in the unit of `SIZE_RANGES`; 0 where a kind has none
    faults: tuple[DriveFault | SensorBias, ...]  #: faults of the simulator and its sensors

    @property
    def ice(self) -> BladeIce | None:
        """Ice on a blade."""
        return BladeIce(self.blade, self.size) if self.kind == ICED else None

    @property
    def key(self) -> Self:
        """Tells it from others."""
        return self

    def first_info(self) -> dict[str, Any]:
        """Kind, blade, time and size."""
        return {"fault": {name: getattr(self, name) for name in _CHOICE}}


class FaultTerm(Term):
    """Faults of an environment, of options with kinds."""

    option = "fault"

    def __init__(self, turbine: Turbine, options: FaultOptions):
        self._turbine, self._options = turbine, options

    def draw(self, request: Request) -> None:
        """Draw the fault of an episode."""
        fault = request.drawn["fault"] = self.drawn(request.rng, request.options.get(self.option))
        request.faults += fault.faults
        if fault.ice is not None:
            request.plant = replace(request.plant, ice=fault.ice)

    def drawn(self, rng: np.random.Generator, choice: Any = None) -> DrawnFault:
        """Fault of an episode; one number of the generator is drawn, whatever breaks.

        Parameters
        ----------
        choice : str or mapping, optional
            Kind, or ``kind``, ``blade``, ``time`` and ``size``; what is left out is drawn.

        Raises
        ------
        ValueError
            If the choice has no meaning.
        """
        own = np.random.default_rng(int(rng.integers(2**63)))
        kinds, options = self._options.kinds or (NO_FAULT,), self._options
        number, blade = int(own.integers(2**31)), 1 + int(own.integers(self._turbine.n_blades))
        time, share, sign = own.uniform(*as_pair(options.time)), own.uniform(), (-1.0, 1.0)[int(own.integers(2))]
        choices = self._checked(choice)
        kind = choices.get("kind", kinds[number % len(kinds)])
        size = choices.get("size", self._size(kind, share, sign))
        blade, time = choices.get("blade", blade), choices.get("time", time)
        if kind in (NO_FAULT, ICED):
            time = 0.0
        if kind == ICED and not 0.0 < size <= 2.0:
            raise ValueError(f"the size of an iced_blade must be above 0 and at most 2, got {size!r}")
        if kind == "slow_drive" and not size >= 0.0:
            raise ValueError(f"the size of a slow_drive must be at least 0, got {size!r}")
        return DrawnFault(kind, blade, time, size, self._faults(kind, blade, time, size))

    def _checked(self, choice: Any) -> dict[str, Any]:
        """Parts of the choice by name."""
        choices = {"kind": choice} if isinstance(choice, str) else {} if choice is None else choice
        if not isinstance(choices, Mapping):
            raise ValueError(f"fault must be a kind or a mapping of {', '.join(_CHOICE)}, got {shown(choice)}")
        choices = dict(choices)
        for what, name, known in (
            *(("fault must have the keys", name, _CHOICE) for name in choices),
            *(("the kind of a fault must be among", kind, _KNOWN) for name, kind in choices.items() if name == "kind"),
        ):
            if name not in known:
                raise ValueError(f"{what} {', '.join(known)}, got {name!r}{did_you_mean(name, known)}")
        n = self._turbine.n_blades
        if "blade" in choices and choices["blade"] not in range(1, n + 1):
            raise ValueError(f"the blade of a fault must be 1 to {n}, got {choices['blade']!r}")
        choices |= {name: check_number(name, choices[name]) for name in ("time", "size") if name in choices}
        if choices.get("time", 0.0) < 0.0:
            raise ValueError(f"the time of a fault must be at least 0 s, got {choices['time']!r} s")
        return choices

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
        """Faults of a kind."""
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


def check_faults(options: FaultOptions, simulator: Any, turbine: Turbine) -> None:
    """Refuse kinds that simulator or turbine cannot have, by a `ValueError`."""
    kinds = options.kinds or ()
    if ICED in kinds and simulator != OWN:
        raise ValueError(f"fault_kinds must be without {ICED} where another simulator has the blades")
    if set(GRID_KINDS) & set(kinds) and not turbine.drivetrain.takes_torque:
        raise ValueError(f"fault_kinds must be without {', '.join(GRID_KINDS)} where the generator is a damper")
