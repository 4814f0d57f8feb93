"""The wind of an episode: options, draws, files."""

import copy
import json
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.options import Options, as_pair, not_empty, option, option_record, real_number, shown
from wt_gym.turbines import Turbine
from wt_gym.wind import (
    Inflow,
    PathInflow,
    SeriesInflow,
    SteadyInflow,
    TransientInflow,
    TurbulenceBox,
    TurbulentInflow,
    TurningInflow,
    wind_from,
)
from wt_gym.wind.files import SUFFIXES, files_of, is_wind_path, whole_description
from wt_gym.wind.iec import (
    EXTREME_SHEAR_EXPONENT,
    EXTREME_WIND_INTENSITY,
    REFERENCE_INTENSITY,
    extreme_wind_speed,
    turbulence_sigma,
)
from wt_gym.wind.inflow import require_cover
from wt_gym.wind.turbulent import speed_path

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
"""Draws of the inflow "gusts": extreme turbulence beside the transients."""
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
    """Return True if an argument is a file of wind: a path by its suffix, or a mapping that names one."""
    return is_wind_path(value) or (isinstance(value, Mapping) and "file" in value)


def own_winds(given: Any) -> tuple[Any, ...]:
    """Inflows and descriptions of winds of the user: one, or several."""
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
        etm = self.inflow == "gusts" and "ETM" in self.gusts
        return etm or self.inflow in ("turbulent", "path", "extreme-turbulent")

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


@dataclass(frozen=True)
class WindFile:
    """A file of wind that was found whole."""

    key: str  #: whole description, as JSON
    turbine_size: tuple[float, float]  #: Hub height and rotor diameter of the turbine that it is for [m]
    mean_speed: float  #: mean wind speed at the hub [m/s]
    hub_height: float  #: [m]
    description: str
    duration: float  #: Length of the record [s]
    periodic: bool  #: the end leads smoothly to the beginning
    is_series: bool  #: course of an event, which an episode meets from the beginning

    @classmethod
    def found(
        cls, given: str | os.PathLike[str] | Mapping[str, Any], hub_height: float, rotor_diameter: float
    ) -> "WindFile":
        """Look through a file, unless this process has done so and the file is as it was.

        Raises
        ------
        InflowError
            If it is missing or damaged, or its grid does not reach around the rotor; the message names it.
        """
        try:
            key = json.dumps(whole_description(given), sort_keys=True)
        except TypeError as error:
            raise InflowError(f"the description of a wind must be numbers, texts and lists of them: {error}") from error
        size = float(hub_height), float(rotor_diameter)
        found = _found(key, _state(key), size)
        require_cover(found.inflow(0.0), *size)
        return found

    @property
    def path(self) -> str:
        """Whole path, of several files the first."""
        return files_of(json.loads(self.key))[0]

    def inflow(self, time_offset: float) -> TurbulentInflow | SeriesInflow:
        """The wind from a time in the record [s] on.

        Raises
        ------
        InflowError
            If the file has gone or was damaged since, or the time is not a number.
        """
        wind = _wind(self.key, _state(self.key), self.turbine_size)
        return replace(wind, time_offset=wind.time_offset + time_offset)

    def latest_start(self, length: float | None) -> float:
        """Time in the record before which an episode of a length [s], or an unknown one, can begin [s].

        A periodic record can be entered anywhere. One that is not jumps at its end, which no gust does: episodes begin
        early enough to be over by then at the rotor, and at its beginning where their length is not known. What lies
        far ahead of the rotor or behind it, for a lidar or the wake, meets the jump the time of its way earlier or
        later. A series is met from its beginning.
        """
        if self.is_series:
            return 0.0
        if self.periodic:
            return self.duration
        return 0.0 if length is None else max(0.0, self.duration - length)


def _state(key: str) -> tuple[tuple[int, int] | None, ...]:
    """Times and sizes of the files, which tell of a change; None of one that cannot be read, which reading explains."""
    states: list[tuple[int, int] | None] = []
    for path in files_of(json.loads(key)):
        try:
            found = Path(path).stat()
            states.append((found.st_mtime_ns, found.st_size))
        except OSError:
            states.append(None)
    return tuple(states)


@lru_cache(maxsize=1024)
def _found(key: str, state: tuple[Any, ...], size: tuple[float, float]) -> WindFile:
    wind = _wind(key, state, size)
    of_all = key, size, wind.mean_speed, wind.hub_height, wind.description
    if isinstance(wind, SeriesInflow):
        return WindFile(*of_all, wind.duration, periodic=False, is_series=True)
    return WindFile(*of_all, wind.box.duration, wind.box.periodic, is_series=False)


@lru_cache(maxsize=8)  # a file of ten minutes takes some ten to a hundred megabytes
def _wind(key: str, state: tuple[Any, ...], size: tuple[float, float]) -> TurbulentInflow | SeriesInflow:
    """Read a file; ``state`` has a file that was changed read again."""
    try:
        wind = wind_from(json.loads(key), *size)
    except InflowError as error:
        raise InflowError(" ".join(str(error).split())) from error
    return cast("TurbulentInflow | SeriesInflow", wind)


# As many forms a kind has, as often it is drawn; the order decides which seed has which gust.
_FORMS = {"EOG": ("eog",), "EDC": ("edc",), "ECD": ("ecd",), "EWS": ("vertical", "horizontal"), "ETM": ("turbulence",)}
WANDERING = 1200.0
"""Time over which a wandering direction is drawn [s]; after it the direction stays."""
# Boxes are synthesized at multiples of this speed [m/s], and at its half, quarter, …, and carried along at the speed
# wanted: at half the speed at least, so that their harmonics, up to 2 Hz as synthesized, reach to 1 Hz.
_BOX_SPEED_STEP = 6.0
PATH_BOX = 12.0, 1200.0
"""Speed at which the turbulence of a path is synthesized [m/s], with harmonics up to 2 Hz, and for how long [s]: 14.4
km of air with waves down to 6 m."""
_LONGEST_PATH = 3600.0  # Length of the path of an episode without an end [s]; the mean speed then stays
_PATH_SEED = 50_000_000  # Beside a chosen seed of the turbulence, of the path that goes with it
_SLOWEST_NTM = 2.0  # Mean speed below which the turbulence of a path falls to none in still air [m/s]
# As far may hub heights of a turbulence box and its mean wind differ.
_HUB_HEIGHT_TOLERANCE = 0.01


@dataclass(frozen=True)
class EpisodeWind:
    """The wind of one episode."""

    inflow: Inflow
    wind_speed: float  #: Mean speed at hub height [m/s]; of a path at its start
    wind_seed: int  #: Seed of the turbulence, -1 without
    time_offset: float  #: Time in the turbulence box at which the episode starts [s]


class WindSampler:
    """Draws the wind of an episode.

    Spectra and coherence depend on frequency only through ``f / V``: turbulence is a frozen field in space. So a
    box of unit intensity synthesized at one speed serves another speed V when it is carried along at V and scaled to
    the standard deviation of V. Boxes are made at the next multiple of 6 m/s, or of 6 m/s halved until
    less than twice the speed, for 600 s at that speed. Their samples make up for the straight lines between them
    (`wt_gym.wind.kaimal`), so that the spectrum at the hub is the standard's up to 1 Hz at every speed.

    Raises
    ------
    InflowError
        If a speed cannot be had at the hub of the turbine, a profile has no meaning there, or an own inflow does not
        reach around the rotor.
    """

    def __init__(self, turbine: Turbine, options: WindOptions):
        self._turbine, self._options = turbine, options
        kind: Any = options.inflow
        self._kind: str | Callable[..., Inflow] | tuple[Inflow | WindFile, ...] = (
            kind if options.made_here or callable(kind) else self._own_inflows(kind)
        )
        self._directions = as_pair(options.direction)
        exponent = NORMAL_SHEAR if options.shear_exponent is None else options.shear_exponent
        roughness = options.roughness_length
        self._profile = {"shear_exponent": exponent} if roughness is None else {"roughness_length": roughness}
        self._to_hub = self._share_at_hub(options.reference_height)
        self._class = self._box_class = options.turbulence_class or turbine.turbulence_class
        self._gusts = tuple(form for name in GUSTS if name in options.gusts for form in _FORMS[name])
        self.turbulent = options.turbulent  # some of the winds are turbulence made here
        self._model = "ETM" if isinstance(kind, str) and kind == "gusts" else options.turbulence_model
        self.parks = options.extreme  # the wind is one in which turbines are parked
        self.speeds: tuple[float, float]  # range of the mean speeds at hub height [m/s]
        if self.parks:
            hub, gusty = turbine.hub_height, kind == "extreme-turbulent"
            speed = extreme_wind_speed(hub, hub, turbine.iec_class, options.return_period, gusty)
            self.speeds = (cast(float, speed), cast(float, speed))
            self._profile = {"shear_exponent": EXTREME_SHEAR_EXPONENT}
        elif isinstance(self._kind, str):
            self._steady(0.0)  # refuses a profile without meaning now, not at the first reset
            low, high = as_pair(cast("float | tuple[float, float]", options.speed))
            self.speeds = self._checked_speed(low), self._checked_speed(high)
            if self.turbulent:
                self._sigma(self.speeds[0])  # refuses an unknown class now, not at the first reset
        elif callable(self._kind):
            self.speeds = (turbine.cut_in, turbine.cut_out)
        else:
            means = [inflow.mean_speed for inflow in self._kind]
            self.speeds = (min(means), max(means))
        self.seeds: tuple[int, ...] | None  # that episodes draw from: none in steady wind, unknown with a user's inflow
        self.seeds = (self._options.seeds if self.turbulent else ()) if isinstance(self._kind, str) else None

    @property
    def label(self) -> str:
        """Kind of wind in a word or two."""
        return self._kind if isinstance(self._kind, str) else "own inflow"

    @property
    def options(self) -> tuple[str, ...]:
        """Arguments of `sample` that take the place of a draw."""
        if self._all_files:
            return ("time_offset",)
        speed = ("wind_speed",) if isinstance(self._kind, str) and not self.parks else ()
        return (*speed, "wind_seed", "time_offset") if self.turbulent else speed

    @property
    def asked_speeds(self) -> tuple[float, float]:
        """Range of the mean speeds at the height at which they are asked for [m/s]."""
        return self.speeds[0] / self._to_hub, self.speeds[1] / self._to_hub

    @property
    def draws_more(self) -> bool:
        """Return True if speed and turbulence seed leave open a gust, a direction, which inflow, or a time in it."""
        if isinstance(self._kind, tuple):
            return self._turns or len(self._kind) > 1 or self._all_files
        return self._turns or self._kind in ("gusts", "path") or callable(self._kind)

    @property
    def _turns(self) -> bool:
        """A direction is drawn."""
        return self._options.wander is not None or self._directions[0] != self._directions[1]

    @property
    def _all_files(self) -> bool:
        """Every wind is read from a file."""
        return isinstance(self._kind, tuple) and all(isinstance(own, WindFile) for own in self._kind)

    def windows(self, length: float) -> tuple[tuple[WindFile, float], ...]:
        """Winds of a length [s] without anything in common: a file and a time in it, the beginnings of all files first.

        None unless every wind is read from a file and nothing else of it is drawn. A record that is shorter is one.
        """
        if not self._all_files or self._turns:
            return ()
        files = cast("tuple[WindFile, ...]", self._kind)
        counts = [max(1, int(file.duration / length + 1e-9)) for file in files]
        return tuple(
            (file, k * length) for k in range(max(counts)) for file, n in zip(files, counts, strict=True) if k < n
        )

    def sample(
        self,
        rng: np.random.Generator,
        wind_speed: float | None = None,
        wind_seed: int | None = None,
        time_offset: float | None = None,
        length: float | None = None,
        heading: float = 0.0,
    ) -> EpisodeWind:
        """Draw a wind.

        Parameters
        ----------
        wind_speed, wind_seed, time_offset : optional
            Fixed instead of drawn; the speed at the reference height. With a fixed seed the episode starts at the
            beginning of the box unless an offset is given too.
        length : float, optional
            Of the episode, where it is known [s].
        heading : float
            Yaw angle of the nacelle at the start [rad], against which winds made here have their direction; a user's
            inflow keeps its own direction.

        Raises
        ------
        InflowError
            If a fixed value is not allowed, or belongs to a wind that has none.
        """
        # Always three draws, so that fixing one of them leaves the others as they were.
        drawn_speed, drawn_seed, drawn_phase = rng.uniform(*self.speeds), rng.choice(self._options.seeds), rng.random()
        self._refuse_useless(wind_speed, wind_seed, time_offset)
        if not isinstance(self._kind, str):
            if callable(self._kind):
                (own,) = self._own_inflows(self._kind(rng))
            else:
                own = self._kind[int(rng.integers(len(self._kind)))]
            return self._turned(_own_wind(own, time_offset, float(drawn_phase), length), rng)
        speed = self._checked_speed(wind_speed) if wind_speed is not None else float(drawn_speed)
        gust = self._gust(speed, rng) if self._kind == "gusts" else None
        if gust is not None or not self.turbulent:
            return self._turned(EpisodeWind(gust or self._steady(speed), speed, -1, 0.0), rng, heading)
        seed = int(drawn_seed if wind_seed is None else wind_seed)
        if self._kind == "path":
            if time_offset is None:
                time_offset = 0.0 if wind_seed is not None else float(drawn_phase) * PATH_BOX[1]
            path_rng = rng if wind_seed is None else np.random.default_rng((_PATH_SEED, seed))
            return self._turned(self._path(speed, seed, path_rng, time_offset, length), rng, heading)
        box = self._box(speed, seed)
        if time_offset is None:
            time_offset = 0.0 if wind_seed is not None else float(drawn_phase) * box.duration
        inflow = TurbulentInflow(box, self._steady(speed), time_offset)
        return self._turned(EpisodeWind(inflow, speed, seed, time_offset), rng, heading)

    def turbulence(self, speed: float, seed: int) -> TurbulentInflow:
        """Turbulence from the beginning of a box along x, of a speed at hub height [m/s]."""
        return TurbulentInflow(self._box(speed, seed), self._steady(speed))

    def varied(self, turbulence_class: str | None, shear_exponent: float | None) -> "WindSampler":
        """Sampler of the same winds with another turbulence class or power-law profile; None: as here.

        The class scales turbulence, whose lengths do not depend on it: boxes are those of this sampler.
        """
        if turbulence_class is None and shear_exponent is None:
            return self
        other = copy.copy(self)
        if turbulence_class is not None:
            other._class = turbulence_class
        if shear_exponent is not None:
            other._profile = {"shear_exponent": shear_exponent}
        return other

    @property
    def turbulence_key(self) -> tuple[Any, ...]:
        """Properties of `turbulence` beside turbine, speed and seed."""
        return self._class, self._model, self._options.turbulence, sorted(self._profile.items())

    def given(self, inflow: Any, **options: Any) -> EpisodeWind:
        """Take a wind from outside, a file from its beginning, in place of one of its own.

        Raises
        ------
        InflowError
            If it is not an inflow, or there are options of `sample`, none of which goes with it.
        """
        if options:
            raise InflowError(f"a given inflow has {', '.join(options)} already: leave them out of the options")
        if isinstance(inflow, str) and inflow in KINDS:
            raise InflowError(
                f"inflow of a reset must be a wind of its own, an Inflow, a file or a mapping; {inflow!r} is an option "
                "of the environment"
            )
        (own,) = self._own_inflows([inflow])
        return _own_wind(own, 0.0)

    def _gust(self, speed: float, rng: np.random.Generator) -> TransientInflow | None:
        """Draw a transient of IEC 61400-1; None where extreme turbulence is drawn."""
        turbine, make = self._turbine, self._gusts[int(rng.integers(len(self._gusts)))]
        sign, start = 1 if rng.random() < 0.5 else -1, 5.0 + 10.0 * rng.random()
        if make == "turbulence":
            return None
        where = speed, turbine.hub_height, turbine.rotor_diameter
        if make == "eog":
            gust = TransientInflow.eog(*where, self._class, turbine.iec_class, start_time=start)
        elif make == "edc":
            gust = TransientInflow.edc(*where, self._class, sign=sign, start_time=start)
        elif make == "ecd":
            gust = TransientInflow.ecd(*where, sign=sign, start_time=start)
        else:
            gust = TransientInflow.ews(*where, self._class, axis=make, sign=sign, start_time=start)
        return replace(gust, steady=self._steady(speed))

    def _path(
        self, speed: float, seed: int, rng: np.random.Generator, time_offset: float, length: float | None
    ) -> EpisodeWind:
        """Turbulence along a path from a speed on."""
        steps = _LONGEST_PATH if length is None else length
        times, speeds = speed_path(rng, *self.speeds, self._options.swing, steps, start=speed)
        made_at, duration = PATH_BOX
        box = self._make_box(made_at, seed, duration=duration)
        slow = np.maximum(speeds, _SLOWEST_NTM)
        sigma = np.array([self._sigma(value) for value in slow.tolist()]) * speeds / slow
        scales = sigma / turbulence_sigma(made_at, self._box_class)
        inflow = PathInflow(times, speeds, self._steady(1.0), box, scales, made_at * time_offset)
        return EpisodeWind(inflow, speed, seed, time_offset)

    def _steady(self, speed: float) -> SteadyInflow:
        """Mean wind with its profile, for a speed at hub height [m/s]."""
        return SteadyInflow(speed, self._turbine.hub_height, **self._profile)

    def _share_at_hub(self, reference_height: float | None) -> float:
        """Speed at the hub over that at the reference height [-]."""
        if reference_height is None:
            return 1.0
        hub = np.array([[0.0, 0.0, self._turbine.hub_height]])
        return float(SteadyInflow(1.0, reference_height, **self._profile).velocity(hub, 0.0)[0, 0])

    def _turned(self, wind: EpisodeWind, rng: np.random.Generator, heading: float = 0.0) -> EpisodeWind:
        """Give the wind its direction, against a heading [rad]."""
        if self._directions == (0.0, 0.0) and self._options.wander is None:
            return wind if heading == 0.0 else replace(wind, inflow=TurningInflow.by(wind.inflow, heading))
        start = heading + float(rng.uniform(*self._directions))
        if self._options.wander is None:
            turned = TurningInflow.by(wind.inflow, start)
        else:
            deviation, time_constant = self._options.wander
            turned = TurningInflow.wandering(wind.inflow, start, deviation, time_constant, WANDERING, rng)
        return replace(wind, inflow=turned)

    def _own_inflows(self, kind: Any) -> tuple[Inflow | WindFile, ...]:
        """Inflows of the user; files are looked through."""
        hub = self._turbine.hub_height
        own = tuple(_own_inflow(one, hub, self._turbine.rotor_diameter) for one in own_winds(kind))
        for inflow in own:
            if abs(inflow.hub_height - hub) > _HUB_HEIGHT_TOLERANCE * hub:
                warnings.warn(
                    f"the mean speed of the inflow '{inflow.description}' holds at {inflow.hub_height:g} m, the hub of "
                    f"{self._turbine.name} is at {hub:g} m: wind_speed and the start do not fit the wind at the hub",
                    stacklevel=2,
                )
        return own

    def _sigma(self, speed: float) -> float:
        """Standard deviation of the wind along its direction [m/s]."""
        if self.parks:
            return EXTREME_WIND_INTENSITY * speed
        return turbulence_sigma(speed, self._class, self._model, self._turbine.iec_class)

    def _box(self, speed: float, seed: int) -> TurbulenceBox:
        """Turbulence carried along at a speed."""
        made_at = float(_BOX_SPEED_STEP * np.ceil(speed / _BOX_SPEED_STEP))
        while speed < 0.5 * made_at and made_at <= _BOX_SPEED_STEP:  # no harmonics faster than 1 Hz at half of it
            made_at *= 0.5
        box = self._make_box(made_at, seed)
        sigma = self._sigma(speed)
        intensity = sigma / turbulence_sigma(made_at, self._box_class)
        if made_at == speed and intensity == 1.0:
            return box
        text = f"{box.description}, carried along at {speed:.4g} m/s with sigma_u {sigma:.3g} m/s"
        return box.carried_along(speed, intensity, text)

    def _make_box(self, made_at: float, seed: int, duration: float = 600.0) -> TurbulenceBox:
        """Turbulence as it is synthesized at a speed."""
        turbine, make = (
            self._turbine,
            TurbulenceBox.mann if self._options.turbulence == "mann" else TurbulenceBox.kaimal,
        )
        return make(made_at, turbine.hub_height, turbine.rotor_diameter, self._box_class, seed=seed, duration=duration)

    def _checked_speed(self, speed: Any) -> float:
        moves = (self.turbulent or self._kind == "gusts") and self._kind != "path"
        low = SLOWEST_TURBULENCE if moves else 0.0
        given = real_number(speed)
        if given is None:
            raise InflowError(f"wind_speed must be a number in m/s, got {shown(speed)}")
        value = self._to_hub * given
        if not low <= value <= FASTEST_WIND:
            at_hub = "" if self._to_hub == 1.0 else f", which is {value:.4g} m/s at the hub"
            still = " with turbulence or gusts, which do not pass in still air" if moves else ""
            raise InflowError(
                f"wind_speed must lie between {low:g} and {FASTEST_WIND:g} m/s{still}, got {speed!r}{at_hub}"
            )
        return value

    def _refuse_useless(self, wind_speed: Any, wind_seed: Any, time_offset: Any) -> None:
        """Refuse options that the kind of wind would ignore."""
        without_offset = not (self.turbulent or self._all_files)
        if (wind_seed is not None and not self.turbulent) or (time_offset is not None and without_offset):
            raise InflowError(
                "wind_seed and time_offset belong to turbulent wind, time_offset to files of wind too; this "
                "environment's wind has none"
            )
        is_seed = isinstance(wind_seed, int | np.integer) and not isinstance(wind_seed, bool)
        if wind_seed is not None and not (is_seed and 0 <= wind_seed <= LARGEST_WIND_SEED):
            raise InflowError(f"wind_seed must be an integer from 0 to {LARGEST_WIND_SEED}, got {shown(wind_seed)}")
        if wind_speed is not None and not isinstance(self._kind, str):
            raise InflowError("wind_speed cannot be chosen: this environment was made with an inflow of its own")
        if wind_speed is not None and self.parks:
            raise InflowError("wind_speed cannot be chosen: that of the extreme winds follows from the turbine's class")


def _own_inflow(given: Any, hub_height: float, rotor_diameter: float) -> Inflow | WindFile:
    if is_wind_file(given):
        return WindFile.found(given, hub_height, rotor_diameter)
    try:
        inflow: Inflow = wind_from(given, hub_height, rotor_diameter) if isinstance(given, Mapping) else given
    except InflowError as error:
        raise InflowError(f"inflow: {error}") from error
    require_cover(inflow, hub_height, rotor_diameter)
    return inflow


def _own_wind(
    own: Inflow | WindFile, time_offset: float | None, phase: float = 0.0, length: float | None = None
) -> EpisodeWind:
    """Wind of an inflow of the user, or of a file from a time on that is given or drawn by its ``phase`` (0 to 1)."""
    if not isinstance(own, WindFile):
        return EpisodeWind(own, own.mean_speed, -1, 0.0)
    if time_offset is None:
        if length is not None and not (own.periodic or own.is_series) and own.duration < length:
            warnings.warn(
                f"{own.path} is not periodic and lasts {own.duration:g} s, an episode {length:g} s: the wind jumps "
                "where the record begins again",
                stacklevel=2,
            )
        time_offset = phase * own.latest_start(length)
    inflow = own.inflow(time_offset)
    return EpisodeWind(inflow, inflow.mean_speed, -1, inflow.time_offset)
