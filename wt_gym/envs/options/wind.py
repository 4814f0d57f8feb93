"""Options of the wind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.options import Options, not_empty, option, option_record, shown
from wt_gym.wind import Inflow
from wt_gym.wind.files import SUFFIXES, is_wind_path
from wt_gym.wind.iec import REFERENCE_INTENSITY

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


def _checked_return_period(years: int) -> int:
    if years not in (1, 50):
        raise InflowError(f"must be 1 or 50 years, got {years!r}")
    return years


def _checked_wander(wander: tuple[float, ...]) -> tuple[float, float]:
    deviation, time_constant = wander if len(wander) == 2 else (np.nan, np.nan)
    if not (0.0 <= deviation <= np.pi and time_constant >= FASTEST_WANDERING):
        raise InflowError(
            f"must be a deviation of 0 to pi rad and a time constant of at least {FASTEST_WANDERING:g} s, got {wander}"
        )
    return deviation, time_constant


@option_record
class WindOptions(Options):
    """Winds of episodes, see `wt_gym.envs.wind_sampler.WindSampler`."""

    title = "wind"
    error = InflowError

    inflow: str | os.PathLike[str] | Inflow | Mapping[str, Any] | tuple[Any, ...] | Callable[..., Any] = option(
        "Steady sheared wind, IEC turbulence, turbulence whose mean speed rises and falls along a path, gusts of "
        "IEC 61400-1 (see ``gusts``), the IEC extreme wind model (EWM) steady or turbulent, for a parked turbine, "
        "or inflows of your own: one, several to draw from, or a function of a random generator. Files of wind are "
        "paths, or mappings with options (``docs/wind.md``): TurbSim's .bts, series in .csv, .wnd and .hh, boxes of "
        "HAWC2 and hipersim. The time in a box at which an episode begins is drawn, in a record that is not "
        "periodic so that the episode is over before the record is; a series is met from its beginning. The mean "
        "speed of an own inflow must hold at the hub: another height, by more than 1 %, is a warning",
        default="steady",
        kind=f"{{{', '.join(map(repr, KINDS))}}}, Inflow, path, mapping, sequence, callable",
    )
    speed: float | tuple[float, float] | None = option(
        "Mean wind speed at hub height, or the range from which it is drawn uniformly at each reset; of a path that in "
        "which it rises and falls; extreme winds have that of the turbine's class, own inflows their own",
        default=(6.0, 18.0),
        flat="wind_speed",
        unit="m/s",
        allowed=f"a number or two in order, 0 to {FASTEST_WIND:g} m/s, of turbulence and gusts from "
        f"{SLOWEST_TURBULENCE:g} on",
    )
    shear_exponent: float | None = option(
        f"Exponent of the power-law profile, before gusts too; default {NORMAL_SHEAR}, and 0.11 in extreme winds",
        default=None,
        unit="-",
    )
    turbulence_class: str | None = option(
        "Turbulence class of IEC 61400-1; default: that of the turbine",
        default=None,
        choices=tuple(REFERENCE_INTENSITY),
    )
    seeds: tuple[int, ...] = option(
        "Turbulence seeds to draw from; `EVALUATION_WIND_SEEDS` are disjoint from the default ones",
        default=TRAINING_WIND_SEEDS,
        flat="wind_seeds",
        low=0,
        high=LARGEST_WIND_SEED,
        check=not_empty,
    )
    direction: float | tuple[float, float] = option(
        "Direction of the wind at the start against the nacelle, or the range it is drawn from",
        default=0.0,
        flat="wind_direction",
        unit="rad",
        low=-np.pi,
        high=np.pi,
    )
    wander: tuple[float, ...] | None = option(
        "Standard deviation and time constant with which the direction wanders from then on: an Ornstein-Uhlenbeck "
        "process, drawn for 1200 s, after which the direction stays",
        default=None,
        flat="wind_wander",
        unit="rad, s",
        kind="(float, float), optional",
        allowed=f"two numbers, 0 to pi and at least {FASTEST_WANDERING:g}",
        check=_checked_wander,
    )
    swing: tuple[float, float] = option(
        "Shortest and longest time in which the mean speed of a path rises or falls through its whole range",
        default=(200.0, 400.0),
        flat="wind_swing",
        unit="s",
        low=FASTEST_SWING,
    )
    turbulence_model: str = option(
        'Normal or extreme turbulence of IEC 61400-1, for ``inflow="turbulent"``',
        default="NTM",
        choices=TURBULENCE_MODELS,
    )
    return_period: int = option(
        "Return period of extreme winds in years, 1 or 50", default=50, low=1, high=50, check=_checked_return_period
    )
    roughness_length: float | None = option(
        "Roughness length of the ground: the profile is then logarithmic instead of a power law",
        default=None,
        unit="m",
        low=0.0,
        above=True,
    )
    reference_height: float | None = option(
        "Height at which ``speed`` holds instead of hub height, for example the gradient height of a boundary layer; "
        "the speed V = V_ref (z/z_ref)^a, or V_ref ln(z/z0)/ln(z_ref/z0), that the profile has at the hub is that of "
        "operating points, cut-in, cut-out and ``info``",
        default=None,
        unit="m",
        low=0.0,
        above=True,
    )
    turbulence: str = option(
        "Spectra of turbulent winds: Kaimal's with an exponential coherence, or Mann's uniform shear model, both with "
        "the parameters of IEC 61400-1 (``docs/wind.md``)",
        default="kaimal",
        choices=TURBULENCE,
    )
    gusts: tuple[str, ...] = option(
        'What ``inflow="gusts"`` draws, each once: extreme operating gust, extreme direction change, coherent gust '
        "with direction change, wind shear (vertical or horizontal, together twice as often as each of the others), "
        "and turbulence of the extreme turbulence model, with seed and time as those of turbulent winds",
        default=TRANSIENTS,
        choices=GUSTS,
        check=not_empty,
    )

    @property
    def made_here(self) -> bool:
        """Winds that the environment makes, none of the user's."""
        return isinstance(self.inflow, str) and self.inflow in KINDS

    @property
    def extreme(self) -> bool:
        """Extreme winds, in which turbines are parked."""
        return isinstance(self.inflow, str) and self.inflow in EXTREME

    @property
    def turbulent(self) -> bool:
        """Some of the winds are turbulence that is made by the environment."""
        if not isinstance(self.inflow, str):
            return False
        return self.inflow in ("turbulent", "path", "extreme-turbulent") or (
            self.inflow == "gusts" and "ETM" in self.gusts
        )

    def check(self) -> None:
        """Refuse what the kind of wind would ignore."""
        made = self.made_here and not self.extreme
        if not self.made_here and not callable(self.inflow):
            winds = own_winds(self.inflow)
            if isinstance(self.inflow, Iterable) and not isinstance(self.inflow, str | Mapping | Inflow):
                self._set("inflow", winds)
        if made and self.speed is None:
            raise InflowError(f"wind_speed must be a number or two in order in m/s for {_MADE}, got None")
        if self.roughness_length is not None and self.shear_exponent is not None:
            raise InflowError(
                "shear_exponent (power law) and roughness_length (logarithmic) exclude each other; "
                f"got {self.shear_exponent!r} and {self.roughness_length!r}"
            )
        of_turbulence = "the inflows 'turbulent' and 'extreme-turbulent', and to 'gusts' with ETM among them"
        for name, alone, belongs, winds_text in (
            ("roughness_length", None, made, _MADE),
            ("reference_height", None, made, _MADE),
            ("gusts", TRANSIENTS, self.inflow == "gusts", "inflow='gusts'"),
            ("turbulence_model", "NTM", self.inflow in ("turbulent", "path"), "the inflows 'turbulent' and 'path'"),
            ("turbulence", "kaimal", self.turbulent, of_turbulence),
            ("return_period", 50, self.extreme, f"the inflows {EXTREME}"),
        ):
            value = getattr(self, name)
            if value != alone and not belongs and not (name == "gusts" and set(value) == set(TRANSIENTS)):
                raise InflowError(f"{name}={value!r} belongs to {winds_text}")
