"""Plants, sensors and winds that differ from episode to episode, so that an agent learns what holds for all of them.

A `Variation` has the limits between which quantities are drawn. The base controller is that of the nominal turbine, and
so are the scales of actions and observations, the rated values of the reward and the limits of an episode. Draws are
uniform, from a random stream of their own that the seed of the reset decides: the wind of an episode keeps its speed,
seed and time without a variation, and every quantity has the same draw without the others. Structural quantities come
from a finite set of turbines, a Latin hypercube over their ranges that is the same in every environment: another
structure is another model, which is made once in an environment and then kept.

Starts of the running turbine are instants of records of the nominal one in its own turbulence; where the structure is
another one, blades follow their loads and the tower swings as it did there.
"""

import copy
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from wt_gym.base.errors import ActionError, InflowError, did_you_mean
from wt_gym.base.files import read_toml
from wt_gym.base.options import Options, as_tuple, check_whole_steps, not_empty, option, option_record, options_of
from wt_gym.control import ActionMap, Lidar
from wt_gym.envs.channels import Observable
from wt_gym.envs.instruments import DRIFTING, Instruments, InstrumentTable, PitchGain
from wt_gym.envs.lidar import lidar_noise
from wt_gym.envs.observations import MOST_READINGS, ObservationOptions
from wt_gym.envs.operation import OWN, Operation
from wt_gym.envs.terms import Plant, Request, Term
from wt_gym.envs.wind_sampler import EpisodeWind, WindOptions
from wt_gym.simulation.drivetrain.faults import SensorBias
from wt_gym.turbines import Turbine
from wt_gym.turbines.model import PitchSystem, Tower, with_site
from wt_gym.wind import TurningInflow
from wt_gym.wind.iec import REFERENCE_INTENSITY

NO_SENSOR = ""
"""Among the sensors that may be dead: none is."""
STRUCTURAL = ("tower_frequency", "tower_damping", "blade_stiffness", "air_density", "drive_lag", "pitch_rate")
"""Quantities that make another turbine: drawn from a finite set."""


def _range(meaning: str, low: float, high: float, unit: str = "-") -> Any:
    return option(meaning, default=None, unit=unit, low=low, high=high)


def _checked_names(names: str | tuple[str, ...]) -> tuple[str, ...]:
    return not_empty(as_tuple(names))


@option_record
class Variation(Options):
    """Quantities of plant, sensors and wind that differ from episode to episode, see `wt_gym.envs.variation`."""

    title = "variation"
    prefix = "vary_"

    pitch_gain: float | tuple[float, float] | None = _range(
        "Factor on the response of the turbine to pitch: blades move by this factor times the deviation of their "
        "demand from the mean of the last 10 s, and the encoders read the demand, see `wt_gym.envs.instruments`",
        0.2, 3.0,
    )  # fmt: skip
    tower_frequency: float | tuple[float, float] | None = _range(
        "Factor on the frequencies of the tower (`varied_turbine`)", 0.5, 2.0
    )
    tower_damping: float | tuple[float, float] | None = _range(
        "Factor on the damping ratio of the tower's modes", 0.0, 10.0
    )
    blade_stiffness: float | tuple[float, float] | None = _range(
        "Factor on the stiffness of the blades' sections", 0.3, 3.0
    )
    air_density: float | tuple[float, float] | None = _range("Factor on the density of the air", 0.5, 2.0)
    drive_lag: float | tuple[float, float] | None = _range("Additional lag of the pitch drives", 0.0, 5.0, "s")
    pitch_rate: float | tuple[float, float] | None = _range("Factor on the greatest pitch rate", 0.1, 10.0)
    sensor_delay: float | tuple[float, float] | None = _range(
        "Time by which readings are late, rounded to steps of the simulator", 0.0, 10.0, "s"
    )
    sensor_offset: float | tuple[float, float] | None = _range(
        "Offset of every load, motion and wind sensor in scales of its channel, drawn for each sensor by itself; the "
        "blades share theirs. Encoders and electrical readings have none (`wt_gym.envs.instruments`)",
        -5.0, 5.0,
    )  # fmt: skip
    sensor_noise: float | tuple[float, float] | None = _range(
        "Level of white measurement noise of every sensor: 1 typical instruments", 0.0, 20.0
    )
    turbulence_class: str | tuple[str, ...] | None = option(
        "Turbulence classes of IEC 61400-1 to draw from", default=None, choices=tuple(REFERENCE_INTENSITY),
        check=_checked_names,
    )  # fmt: skip
    shear_exponent: float | tuple[float, float] | None = _range("Exponent of the power-law profile", -0.5, 1.0)
    yaw_error: float | tuple[float, float] | None = _range(
        "Direction by which the wind is turned against the nacelle, on top of ``wind.direction``",
        -math.pi / 2, math.pi / 2, "rad",
    )  # fmt: skip
    dead_sensor: str | tuple[str, ...] | None = option(
        f'Channels of the simulator: one is drawn and reads zero in the episode; "{NO_SENSOR}": all are sound',
        default=None, check=_checked_names,
    )  # fmt: skip
    plants: int = option(
        "Number of turbines in the set that the structural quantities are drawn from: a Latin hypercube over their "
        "ranges, the same in every environment",
        default=8,
        low=1,
        high=64,
    )

    @property
    def varies(self) -> tuple[str, ...]:
        """Names of the quantities that are given, those of the set of plants first."""
        order = (*STRUCTURAL, *(name for name in (*RANGES, *CHOICES) if name not in STRUCTURAL))
        return tuple(name for name in order if getattr(self, name) is not None)

    def ends(self, name: str) -> tuple[float, float] | None:
        """Lower and upper end of the range of a quantity, None where it is not given."""
        value = getattr(self, name)
        return (value, value) if isinstance(value, float) else value

    @classmethod
    def named(cls, values: Any) -> Mapping[str, Any]:
        """Values by names of fields; the name of one of `PRESETS` stands for its values.

        Raises
        ------
        ValueError
            If there is no such preset or field.
        """
        if not isinstance(values, str):
            return super().named(values)
        if values not in PRESETS:
            raise ValueError(
                f"variation must be a Variation, a mapping or one of {', '.join(PRESETS)}, got {values!r:.100}"
                f"{did_you_mean(values, PRESETS)}"
            )
        return PRESETS[values].given


CHOICES = ("turbulence_class", "dead_sensor")
"""Quantities drawn from a list of names."""
RANGES = {one.name: one for one in options_of(Variation) if one.name not in (*CHOICES, "plants")}
"""Quantities drawn from a range."""

PRESETS = {name: Variation(**ranges) for name, ranges in read_toml(Path(__file__).with_suffix(".toml")).items()}
"""Variations by name."""
TRAIN, HELD_BACK = PRESETS["train"], PRESETS["held_back"]
"""Ranges for training, and those held back for tests."""


def varied_turbine(
    turbine: Turbine,
    *,
    tower_frequency: float = 1.0,
    tower_damping: float = 1.0,
    blade_stiffness: float = 1.0,
    air_density: float = 1.0,
    drive_lag: float = 0.0,
    pitch_rate: float = 1.0,
) -> Turbine:
    """Return a turbine with other structure, air or pitch drives; without a change the turbine itself.

    Parameters
    ----------
    tower_frequency : float
        Factor on the frequencies of the tower [-]: its stiffness, that of a monopile and that of the foundation are
        multiplied by the square. Gravity, which softens a tower by some percent, stays.
    tower_damping : float
        Factor on the damping ratio of the tower [-].
    blade_stiffness : float
        Factor on the stiffness of all sections of the blades [-]. The stiffness that the rotation adds stays.
    air_density : float
        Factor on the density of the air [-]. Density for which controllers are designed stays, and the rated wind speed
        follows (`wt_gym.turbines.model.with_site`).
    drive_lag : float
        Lag of the pitch drives behind a moving demand [s]: they become critically damped servos of frequency 2 / lag,
        or of 2 ζ / (lag + the lag that the turbine's servos have already). Zero: the drives of the turbine.
    pitch_rate : float
        Factor on the greatest pitch rate [-].

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> soft = varied_turbine(load_turbine("nrel_5mw"), tower_frequency=0.9, drive_lag=0.4)
    >>> round(soft.pitch.servo_frequency, 3)
    5.0
    """
    changed = turbine
    if tower_frequency != 1.0 or tower_damping != 1.0:
        changed = replace(changed, tower=_tower(turbine.tower, tower_frequency**2, tower_damping))
    if blade_stiffness != 1.0:
        changed = replace(changed, blade=_stiffened(turbine.blade, blade_stiffness))
    if air_density != 1.0:
        changed = with_site(changed, {"air_density": air_density * turbine.air_density})
    if drive_lag != 0.0 or pitch_rate != 1.0:
        changed = replace(changed, pitch=_drives(turbine.pitch, drive_lag, pitch_rate))
    return changed


def _stiffened(part: Any, factor: float) -> Any:
    """Beam of a blade or a tower with another stiffness."""
    return replace(part, structure=replace(part.structure, stiffness=factor * part.structure.stiffness))


def _tower(tower: Tower, stiffness: float, damping: float) -> Tower:
    support = tower.support
    if stiffness != 1.0:
        tower = _stiffened(tower, stiffness)
        if support is not None:
            ground = None if support.foundation is None else stiffness * support.foundation
            support = replace(_stiffened(support, stiffness), foundation=ground)
    return replace(tower, support=support, damping_ratio=damping * tower.damping_ratio)


def _drives(pitch: PitchSystem, lag: float, rate: float) -> PitchSystem:
    changed = replace(pitch, max_rate=rate * pitch.max_rate)
    if lag == 0.0:
        return changed
    own, damping = 0.0, 1.0
    if pitch.servo_frequency is not None:
        own, damping = 2.0 * pitch.servo_damping / pitch.servo_frequency, pitch.servo_damping
    return replace(changed, servo_frequency=2.0 * damping / (lag + own), servo_damping=damping)


_STREAM = 0x56415259  # Tells the stream of the variations from that of the episodes with the same seed
_HYPERCUBE = 20261125
_DRAWN = tuple(name for name in (*RANGES, *CHOICES) if name not in STRUCTURAL)
_MOST_SEED = 2**63


class Plants:
    """The finite set of turbines of a variation of a nominal turbine.

    Attributes
    ----------
    values : tuple of dict
        Structural quantities of each plant; one empty one where none varies.
    """

    def __init__(self, turbine: Turbine, variation: Variation):
        self._turbine = turbine
        ranges = {name: ends for name in STRUCTURAL if (ends := variation.ends(name)) is not None}
        several = any(low < high for low, high in ranges.values())
        count = variation.plants if several else 1
        columns: dict[str, list[float]] = {}
        for name, (low, high) in ranges.items():  # evenly spaced with both ends, each in an order of its own
            levels = np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
            order = np.random.default_rng([_HYPERCUBE, STRUCTURAL.index(name)]).permutation(count)
            columns[name] = levels[order].tolist()
        self.values = tuple({name: column[k] for name, column in columns.items()} for k in range(count))
        self._made: dict[int, Turbine] = {}

    def __len__(self) -> int:
        return len(self.values)

    def turbine(self, number: int) -> Turbine:
        """Turbine of a plant; made once."""
        if number not in self._made:
            self._made[number] = varied_turbine(self._turbine, **self.values[number])
        return self._made[number]


@dataclass(frozen=True)
class DrawnVariation:
    """Variation of an episode.

    Attributes
    ----------
    values : mapping
        Drawn quantities by name, as values of JSON: the number of the plant as "plant", the offset of each sensor in
        "sensor_offset".
    """

    values: Mapping[str, Any]
    turbine: Turbine  #: simulated turbine
    noise_seed: int  #: seed of the noise of the instruments

    @property
    def faults(self) -> tuple[SensorBias, ...]:
        """The dead sensor, if there is one."""
        name = self.values.get("dead_sensor", NO_SENSOR)
        return () if name == NO_SENSOR else (SensorBias(0.0, (name,), 0.0, 0.0),)

    @property
    def key(self) -> tuple[object, ...]:
        """Tells it from others."""
        return json.dumps(self.values, sort_keys=True), self.turbine, self.noise_seed

    def first_info(self) -> dict[str, Any]:
        """Drawn quantities."""
        return {"variation": copy.deepcopy(dict(self.values))}

    def equip(self, operation: Operation) -> None:
        """Put instruments and response to pitch into the operation of a turbine."""
        gain = self.values.get("pitch_gain", 1.0)
        operation.pitch_gain = None if gain == 1.0 else PitchGain(gain)
        operation.instruments = operation.make_instruments(self)

    def turned(self, wind: EpisodeWind) -> EpisodeWind:
        """The wind from the direction that is drawn."""
        angle = self.values.get("yaw_error", 0.0)
        return wind if angle == 0.0 else replace(wind, inflow=TurningInflow.by(wind.inflow, angle))


class VariationTerm(Term):
    """Variation of an environment: draws it, and makes the instruments of episodes.

    Parameters
    ----------
    lidar : Lidar
        That is read.
    observed : ObservationOptions
        Noise and delay of the sensors where none are drawn.
    everyone : bool
        The base controller reads the instruments too.
    step : float
        Of the simulator [s].

    Raises
    ------
    ValueError
        If a delay is not a whole number of steps, or the turbine has no sensor that may be dead.
    """

    def __init__(
        self,
        variation: Variation,
        turbine: Turbine,
        action: ActionMap,
        lidar: Lidar,
        observed: ObservationOptions,
        everyone: bool,
        step: float,
    ):
        self._variation, self._turbine, self._step, self.everyone = variation, turbine, step, everyone
        self.plants = Plants(turbine, variation)
        self._n_seen = lidar.n_readings
        for name in variation.dead_sensor or ():
            if name != NO_SENSOR:
                try:
                    SensorBias(0.0, (name,)).places(turbine.n_blades)
                except ActionError as error:
                    raise ActionError(f"vary_dead_sensor: {error}") from error
        self._noise = observed.noise if everyone else 0.0
        self._delay = check_whole_steps("sensor_delay", observed.delay, step, least=0) if everyone else 0
        if self._delay > MOST_READINGS:
            raise ValueError(f"sensor_delay must be 0 to {MOST_READINGS} steps of the simulator, got {self._delay}")
        self._reads = everyone or any(name.startswith("sensor_") for name in variation.varies)
        channels = Observable(turbine, action).of_signals() if self._reads else {}
        self._table = InstrumentTable(turbine, channels, lidar_noise(lidar)) if self._reads else None
        self._rng, self._seeded = np.random.default_rng(_STREAM), False

    def seed(self, seed: int, numbered: bool = False) -> None:
        """Begin the stream that belongs to a seed of the environment, or to a numbered beginning."""
        self._rng = np.random.default_rng([_STREAM, seed, 1] if numbered else [_STREAM, seed])

    def memory(self) -> dict[str, Any]:
        """State of the stream."""
        return {"random": copy.deepcopy(self._rng.bit_generator.state)}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with a state of the stream."""
        self._rng.bit_generator.state, self._seeded = copy.deepcopy(memory["random"]), True

    def draw(self, request: Request) -> None:
        """Draw the variation of an episode: a seed begins its stream, as does the first reset, and every number."""
        if request.number is not None:
            self.seed(request.number, numbered=True)
        elif request.seeded or not self._seeded:  # the seed of a generator from outside is negative
            self.seed(request.seed if request.seed >= 0 else int(request.episode_rng.integers(2**31)))
            self._seeded = True
        drawn = request.drawn["variation"] = self.drawn()
        request.winds = request.winds.varied(drawn.values.get("turbulence_class"), drawn.values.get("shear_exponent"))
        request.turns.append(drawn.turned)
        request.faults += drawn.faults
        if "plant" in drawn.values:
            request.plant = Plant(drawn.turbine, drawn.values["plant"])

    def drawn(self) -> DrawnVariation:
        """Quantities of an episode: as many numbers are drawn whatever varies, so that each has its own."""
        rng, variation = self._rng, self._variation
        share = dict(zip(("plant", *_DRAWN), rng.random(1 + len(_DRAWN)).tolist(), strict=True))
        shifts, noise_seed = rng.random(len(DRIFTING)).tolist(), int(rng.integers(_MOST_SEED))
        values: dict[str, Any] = {}
        plant = 0
        if any(self.plants.values):
            plant = _pick(share["plant"], len(self.plants))
            values = {"plant": plant, **self.plants.values[plant]}
        for name in (one for one in _DRAWN if getattr(variation, one) is not None):
            if name in CHOICES:
                names = getattr(variation, name)
                values[name] = names[_pick(share[name], len(names))]
                continue
            low, high = cast("tuple[float, float]", variation.ends(name))
            if name == "sensor_offset":
                values[name] = {sensor: low + u * (high - low) for sensor, u in zip(DRIFTING, shifts, strict=True)}
            else:
                values[name] = low + share[name] * (high - low)
        if "sensor_delay" in values:
            values["sensor_delay"] = self._step * round(values["sensor_delay"] / self._step)
        turbine = self.plants.turbine(plant) if "plant" in values else self._turbine
        return DrawnVariation(values, turbine, noise_seed)

    def instruments(self, drawn: DrawnVariation) -> Instruments | None:
        """Instruments of an episode, None where all readings are exact."""
        if self._table is None:
            return None
        values = drawn.values
        level, shifts = values.get("sensor_noise", self._noise), values.get("sensor_offset", {})
        delay = round(values["sensor_delay"] / self._step) if "sensor_delay" in values else self._delay
        if level == 0.0 and delay == 0 and not any(shifts.values()):
            return None
        return Instruments(self._table, level, delay, shifts, self._n_seen, drawn.noise_seed)


def check_variation(variation: Variation, wind: WindOptions, turbine: Any, simulator: Any) -> None:
    """Refuse a class, profile or structure to be drawn where wind or simulator have their own, by a `ValueError`."""
    names = [name for name in ("turbulence_class", "shear_exponent") if getattr(variation, name) is not None]
    if names and (not wind.made_here or wind.extreme):
        raise InflowError(
            f"vary_{names[0]} must be left out: it belongs to the inflows 'steady', 'turbulent' and 'gusts'"
        )
    for name in ("roughness_length", "reference_height"):
        if variation.shear_exponent is not None and getattr(wind, name) is not None:
            raise InflowError(f"vary_shear_exponent and {name} exclude each other; got both")
    model = isinstance(turbine, str) and turbine.lower().endswith(".fst")
    if model and simulator != OWN and any(name in STRUCTURAL for name in variation.varies):
        raise ValueError(
            f"variation: {', '.join(STRUCTURAL)} must be left out where OpenFAST simulates a model of its own"
        )


def _pick(share: float, count: int) -> int:
    return min(int(share * count), count - 1)
