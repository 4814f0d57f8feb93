"""Options of the wind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.envs.arguments import check_names, real_number, real_numbers, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group
from wt_gym.wind import Inflow
from wt_gym.wind.files import SUFFIXES, is_wind_path
from wt_gym.wind.iec import reference_intensity

__all__ = [
    "EVALUATION_WIND_SEEDS",
    "EXTREME",
    "FASTEST_SWING",
    "FASTEST_WANDERING",
    "FASTEST_WIND",
    "GUSTS",
    "KINDS",
    "LARGEST_WIND_SEED",
    "NORMAL_SHEAR",
    "SLOWEST_TURBULENCE",
    "TRAINING_WIND_SEEDS",
    "TRANSIENTS",
    "TURBULENCE",
    "TURBULENCE_MODELS",
    "WindOptions",
    "checked_wind_seed",
    "is_wind_file",
    "own_winds",
]

TRAINING_WIND_SEEDS = tuple(range(1, 25))
"""Wind seeds from which training episodes draw by default."""

EVALUATION_WIND_SEEDS = tuple(range(1001, 1025))
"""Wind seeds held out for evaluation: no default environment ever trains on them."""

LARGEST_WIND_SEED = 2**63 - 1
"""Larger ones have no place in the integers of arrays and files."""

EXTREME = ("extreme", "extreme-turbulent")
KINDS = ("steady", "turbulent", "path", "gusts", *EXTREME)
TRANSIENTS = ("EOG", "EDC", "ECD", "EWS")
"""Deterministic transients of IEC 61400-1, which the inflow "gusts" draws by default."""
GUSTS = (*TRANSIENTS, "ETM")
"""What the inflow "gusts" can draw: extreme turbulence beside the transients."""
TURBULENCE_MODELS = ("NTM", "ETM")
TURBULENCE = ("kaimal", "mann")
"""Whose turbulence: `wt_gym.wind.kaimal` or `wt_gym.wind.mann`."""
FASTEST_WANDERING = 1.0
"""Shortest time constant of a wandering direction [s]."""
NORMAL_SHEAR = 0.2
"""Exponent of IEC 61400-1 for normal conditions."""
FASTEST_WIND = 50.0
"""Highest mean wind speed that can be asked for [m/s]: the reference speed of class I."""
FASTEST_SWING = 30.0
"""Shortest time in which the mean wind of a path goes through its range [s]."""
SLOWEST_TURBULENCE = 0.5
"""Lowest mean wind speed of turbulence and gusts [m/s]: what is carried along does not pass in still air."""
_ALLOWED = (
    f"{KINDS}, an Inflow, a file of wind ({', '.join(SUFFIXES)}), a mapping that describes a wind, several of these "
    "or a callable"
)
_MADE = "the inflows 'steady', 'turbulent', 'path' and 'gusts'"


def is_wind_file(value: Any) -> bool:
    """Whether an argument is a file of wind: a path by its suffix, or a mapping that names one."""
    return is_wind_path(value) or (isinstance(value, Mapping) and "file" in value)


def checked_wind_seed(seed: Any) -> int:
    """Seed of turbulence.

    Raises
    ------
    InflowError
        If it is not an integer that arrays and files can hold.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InflowError(f"a wind seed must be an integer of at least 0, got {seed!r}")
    if seed > LARGEST_WIND_SEED:
        raise InflowError(f"a wind seed must be an integer of at most {LARGEST_WIND_SEED}, got {seed!r}")
    return int(seed)


def own_winds(given: Any) -> tuple[Any, ...]:
    """Inflows and descriptions of winds of the user: one, or several.

    Raises
    ------
    InflowError
        If something is none.
    """
    alone = isinstance(given, str | Mapping) or not isinstance(given, Iterable)
    several: tuple[Any, ...] = (given,) if alone else tuple(given)
    wrong = [one for one in several if not (isinstance(one, Inflow | Mapping) or is_wind_file(one))]
    if wrong or not several:
        refused = wrong[0] if len(wrong) == 1 else wrong or given
        raise InflowError(f"inflow must be one of {_ALLOWED}, got {shown(refused)}{did_you_mean(refused, KINDS)}")
    return several


@option_group
class WindOptions(OptionGroup):
    """Which winds episodes have, see `wt_gym.envs.wind_sampler.WindSampler`."""

    title = "wind"

    inflow: str | os.PathLike[str] | Inflow | Mapping[str, Any] | Sequence[Any] | Callable[..., Any] = option(
        '{"steady", "turbulent", "path", "gusts", "extreme", "extreme-turbulent"}, Inflow, path, mapping, sequence, '
        "callable",
        "Steady sheared wind, IEC turbulence, turbulence whose mean speed rises and falls along a path, gusts of "
        "IEC 61400-1 (see ``gusts``), the IEC extreme wind model (EWM) steady or turbulent, for a parked turbine, "
        "or inflows of your own: one, several to draw from, or a function of a random generator. Files of wind are "
        "paths, or mappings with options (``docs/wind.md``): TurbSim's .bts, series in .csv, .wnd and .hh, boxes of "
        "HAWC2 and hipersim. The time in a box at which an episode begins is drawn, in a record that is not "
        "periodic so that the episode is over before the record is; a series is met from its beginning. The mean "
        "speed of an own inflow must hold at the hub: another height, by more than 1 %, is a warning",
        default="steady",
    )
    speed: float | Sequence[float] | None = option(
        "float or (float, float)",
        "Mean wind speed at hub height, or the range from which it is drawn uniformly at each reset; of a path that in "
        "which it rises and falls; extreme winds have that of the turbine's class, own inflows their own",
        default=(6.0, 18.0),
        flat="wind_speed",
        unit="m/s",
        allowed=f"0 to {FASTEST_WIND:g}, of turbulence and gusts from {SLOWEST_TURBULENCE:g} on",
    )
    shear_exponent: float | None = option(
        "float, optional",
        f"Of the power-law profile, before gusts too; default {NORMAL_SHEAR}, and 0.11 in extreme winds",
        default=None,
        unit="-",
    )
    turbulence_class: str | None = option(
        '{"A+", "A", "B", "C"}, optional', "Turbulence class of IEC 61400-1; default: that of the turbine", default=None
    )
    seeds: Sequence[int] = option(
        "sequence of int",
        "Turbulence seeds to draw from; `EVALUATION_WIND_SEEDS` are disjoint from the default ones",
        default=TRAINING_WIND_SEEDS,
        flat="wind_seeds",
        allowed="at least one of 0 to 2^63 - 1",
    )
    direction: float | Sequence[float] = option(
        "float or (float, float)",
        "Direction of the wind at the start against the nacelle, or the range it is drawn from",
        default=0.0,
        flat="wind_direction",
        unit="rad",
        allowed="-pi to pi",
    )
    wander: Sequence[float] | None = option(
        "(float, float), optional",
        "Standard deviation and time constant with which the direction wanders from then on: an Ornstein-Uhlenbeck "
        "process, drawn for 1200 s, after which the direction stays",
        default=None,
        flat="wind_wander",
        unit="rad, s",
        allowed=f"0 to pi, at least {FASTEST_WANDERING:g}",
    )
    swing: Sequence[float] = option(
        "(float, float)",
        "Shortest and longest time in which the mean speed of a path rises or falls through its whole range",
        default=(200.0, 400.0),
        flat="wind_swing",
        unit="s",
        allowed=f"at least {FASTEST_SWING:g}",
    )
    turbulence_model: str = option(
        '{"NTM", "ETM"}', 'Normal or extreme turbulence of IEC 61400-1, for ``inflow="turbulent"``', default="NTM"
    )
    return_period: int = option("{50, 1}", "Of extreme winds, in years", default=50)
    roughness_length: float | None = option(
        "float, optional",
        "Of the ground: the profile is then logarithmic instead of a power law",
        default=None,
        unit="m",
        allowed="positive",
    )
    reference_height: float | None = option(
        "float, optional",
        "Height at which ``speed`` holds instead of hub height, for example the gradient height of a boundary layer; "
        "the speed V = V_ref (z/z_ref)^a, or V_ref ln(z/z0)/ln(z_ref/z0), that the profile has at the hub is that of "
        "operating points, cut-in, cut-out and ``info``",
        default=None,
        unit="m",
    )
    turbulence: str = option(
        '{"kaimal", "mann"}',
        "Spectra of turbulent winds: Kaimal's with an exponential coherence, or Mann's uniform shear model, both with "
        "the parameters of IEC 61400-1 (``docs/wind.md``)",
        default="kaimal",
    )
    gusts: Sequence[str] = option(
        'sequence of {"EOG", "EDC", "ECD", "EWS", "ETM"}',
        'What ``inflow="gusts"`` draws, each once: extreme operating gust, extreme direction change, coherent gust '
        "with direction change, wind shear (vertical or horizontal, together twice as often as each of the others), "
        "and turbulence of the extreme turbulence model, with seed and time as those of turbulent winds",
        default=TRANSIENTS,
    )

    @property
    def made_here(self) -> bool:
        """Whether the winds are made by the environment, none of your own."""
        return isinstance(self.inflow, str) and self.inflow in KINDS

    @property
    def extreme(self) -> bool:
        """Whether they are extreme winds, in which turbines are parked."""
        return isinstance(self.inflow, str) and self.inflow in EXTREME

    @property
    def turbulent(self) -> bool:
        """Whether some of them are turbulence that is made by the environment."""
        if not isinstance(self.inflow, str):
            return False
        return self.inflow in ("turbulent", "path", "extreme-turbulent") or (
            self.inflow == "gusts" and "ETM" in self.gusts
        )

    def check(self) -> None:
        """Refuse what has no meaning, and what the kind of wind would ignore.

        Raises
        ------
        InflowError
        """
        self._check_inflow()
        self._check_direction()
        self._check_profile()
        if self.turbulence_class is not None:
            reference_intensity(self.turbulence_class)  # refuses an unknown class, also where it plays no part
        if not isinstance(self.seeds, Iterable):
            raise InflowError(f"wind_seeds must be a sequence of integers, got {self.seeds!r}")
        self._set("seeds", tuple(checked_wind_seed(seed) for seed in self.seeds))
        if not self.seeds:
            raise InflowError("wind_seeds must name at least one seed")
        self._check_gusts()
        self._check_swing()
        self._check_turbulence()
        if self.made_here and not self.extreme:
            self._check_speed()

    def _check_inflow(self) -> None:
        given = self.inflow
        if not self.made_here and not callable(given):
            winds = own_winds(given)
            if isinstance(given, Iterable) and not isinstance(given, str | Mapping | Inflow):
                self._set("inflow", winds)

    def _check_direction(self) -> None:
        ends = real_numbers(self.direction)
        if len(ends) not in (1, 2) or not all(abs(end) <= np.pi for end in ends) or ends[0] > ends[-1]:
            raise InflowError(
                f"wind_direction must be an angle or a range (low, high) within +-pi rad, got {self.direction!r}"
            )
        if self.wander is None:
            return
        given = real_numbers(self.wander)
        deviation, time_constant = given if len(given) == 2 else (np.nan, np.nan)
        if not (0.0 <= deviation <= np.pi and FASTEST_WANDERING <= time_constant < np.inf):
            raise InflowError(
                f"wind_wander must be a deviation of 0 to pi rad and a time constant of at least {FASTEST_WANDERING:g} "
                f"s, got {self.wander!r}"
            )

    def _check_profile(self) -> None:
        made = self.made_here and not self.extreme
        if self.roughness_length is not None:
            if not made:
                raise InflowError(f"roughness_length belongs to {_MADE}")
            if self.shear_exponent is not None:
                raise InflowError(
                    "shear_exponent (power law) and roughness_length (logarithmic) exclude each other; "
                    f"got {self.shear_exponent!r} and {self.roughness_length!r}"
                )
        if self.reference_height is not None:
            if real_number(self.reference_height) is None:
                raise InflowError(f"reference_height must be a number in m, got {shown(self.reference_height)}")
            if not made:
                raise InflowError(f"reference_height belongs to {_MADE}")

    def _check_gusts(self) -> None:
        names = check_names("gusts", self.gusts)
        if not names or len(set(names)) < len(names) or not set(names) <= set(GUSTS):
            raise InflowError(f"gusts must name some of {GUSTS}, each once, got {shown(names)}")
        if set(names) != set(TRANSIENTS) and self.inflow != "gusts":
            raise InflowError(f"gusts={names} belongs to inflow='gusts'")
        self._set("gusts", names)

    def _check_swing(self) -> None:
        given = real_numbers(self.swing)
        if len(given) != 2 or not FASTEST_SWING <= given[0] <= given[1] < np.inf:
            raise InflowError(
                f"wind_swing must be two times (shortest, longest) of at least {FASTEST_SWING:g} s, got {self.swing!r}"
            )

    def _check_turbulence(self) -> None:
        if self.turbulence_model not in TURBULENCE_MODELS:
            raise InflowError(
                f"turbulence_model must be one of {TURBULENCE_MODELS}, got {self.turbulence_model!r}"
                f"{did_you_mean(self.turbulence_model, TURBULENCE_MODELS)}"
            )
        if self.turbulence_model != "NTM" and self.inflow not in ("turbulent", "path"):
            raise InflowError(
                f"turbulence_model={self.turbulence_model!r} belongs to the inflows 'turbulent' and 'path'"
            )
        if isinstance(self.return_period, bool):
            raise InflowError(f"return_period must be 1 or 50 years, got {self.return_period!r}")
        if self.turbulence not in TURBULENCE:
            raise InflowError(
                f"turbulence must be one of {TURBULENCE}, got {self.turbulence!r}"
                f"{did_you_mean(self.turbulence, TURBULENCE)}"
            )
        if self.turbulence != "kaimal" and not self.turbulent:
            raise InflowError(
                f"turbulence={self.turbulence!r} belongs to the inflows 'turbulent' and 'extreme-turbulent', and to "
                "'gusts' with ETM among them"
            )
        if self.return_period != 50 and not self.extreme:
            raise InflowError(f"return_period belongs to the inflows {EXTREME}")

    def _check_speed(self) -> None:
        """Numbers in order; which of them can be had at the hub is the sampler's to say."""
        ends = tuple(self.speed) if isinstance(self.speed, tuple | np.ndarray) else (self.speed,)
        if len(ends) not in (1, 2):
            raise InflowError(f"wind_speed must be a number or a pair (low, high) in m/s, got {self.speed!r}")
        low, high = real_number(ends[0]), real_number(ends[-1])
        if low is None or high is None:
            raise InflowError(f"wind_speed must be a number in m/s, got {shown(ends[0] if low is None else ends[-1])}")
        if low > high:
            raise InflowError(f"wind_speed must be a range (low, high) with low <= high, got {self.speed!r} m/s")
