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

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.errors import ActionError, InflowError
from wt_gym.envs.arguments import check_whole_steps
from wt_gym.envs.instruments import DRIFTING, Instruments, InstrumentTable
from wt_gym.envs.observable import Observable
from wt_gym.envs.options.observations import MOST_READINGS
from wt_gym.envs.options.variation import CHOICES, HELD_BACK, NO_SENSOR, PRESETS, RANGES, STRUCTURAL, TRAIN, Variation
from wt_gym.envs.pitch_gain import PitchGain
from wt_gym.envs.readers import lidar_noise
from wt_gym.envs.varied_turbine import varied_turbine
from wt_gym.simulation.drivetrain.faults import SensorBias
from wt_gym.wind import TurningInflow

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.control import ActionMap, Lidar
    from wt_gym.envs.options.observations import ObservationOptions
    from wt_gym.envs.options.wind import WindOptions
    from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
    from wt_gym.turbines import Turbine

__all__ = ["HELD_BACK", "PRESETS", "TRAIN", "DrawnVariation", "Plants", "Variation", "VariationDraws", "check_winds"]

_STREAM = 0x56415259
"""Tells the stream of the variations from that of the episodes with the same seed."""
_HYPERCUBE = 20261125
_DRAWN = tuple(name for name in (*RANGES, *CHOICES) if name not in STRUCTURAL)
_MOST_SEED = 2**63


class Plants:
    """The finite set of turbines of a variation.

    Parameters
    ----------
    turbine : Turbine
        Nominal.
    variation : Variation

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
        columns = {name: _levels(name, *ends, count) for name, ends in ranges.items()}
        self.values = tuple({name: column[k] for name, column in columns.items()} for k in range(count))
        self._made: dict[int, Turbine] = {}

    def __len__(self) -> int:
        return len(self.values)

    def turbine(self, number: int) -> Turbine:
        """Turbine of a plant; made once."""
        if number not in self._made:
            self._made[number] = varied_turbine(self._turbine, **self.values[number])
        return self._made[number]


def _levels(name: str, low: float, high: float, count: int) -> list[float]:
    """Values of a quantity in all plants: evenly spaced with both ends, in an order of its own."""
    levels = np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
    order = np.random.default_rng([_HYPERCUBE, STRUCTURAL.index(name)]).permutation(count)
    values: list[float] = levels[order].tolist()
    return values


@dataclass(frozen=True)
class DrawnVariation:
    """What an episode has of a variation.

    Attributes
    ----------
    values : mapping
        Drawn quantities by name, as values of JSON: the number of the plant as "plant", the offset of each sensor in
        "sensor_offset".
    turbine : Turbine
        That is simulated.
    noise_seed : int
        Of the noise of the instruments.
    """

    values: Mapping[str, Any]
    turbine: Turbine
    noise_seed: int

    @property
    def plant(self) -> int:
        """Number in the set of turbines."""
        return int(self.values.get("plant", 0))

    @property
    def structural(self) -> bool:
        """Whether the turbine is another one than the nominal."""
        return "plant" in self.values

    @property
    def faults(self) -> tuple[SensorBias, ...]:
        """The dead sensor, if there is one."""
        name = self.values.get("dead_sensor", NO_SENSOR)
        return () if name == NO_SENSOR else (SensorBias(0.0, (name,), 0.0, 0.0),)

    def pitch_gain(self) -> PitchGain | None:
        """Response to pitch, None where it is that of the model."""
        gain = self.values.get("pitch_gain", 1.0)
        return None if gain == 1.0 else PitchGain(gain)

    def sampler(self, winds: WindSampler) -> WindSampler:
        """Winds of the class and the profile that are drawn."""
        return winds.varied(self.values.get("turbulence_class"), self.values.get("shear_exponent"))

    def turned(self, wind: EpisodeWind) -> EpisodeWind:
        """The wind from the direction that is drawn."""
        angle = self.values.get("yaw_error", 0.0)
        return wind if angle == 0.0 else replace(wind, inflow=TurningInflow.by(wind.inflow, angle))


class VariationDraws:
    """Draws what episodes have of a variation, and makes their instruments.

    Parameters
    ----------
    variation : Variation
    turbine : Turbine
        Nominal.
    action : ActionMap
    lidar : Lidar
        That is read.
    observed : ObservationOptions
        Noise and delay of the sensors where none are drawn.
    everyone : bool
        Whether the base controller reads the instruments too.
    step : float
        Of the simulator [s].

    Attributes
    ----------
    everyone : bool
    plants : Plants

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
        channels = Observable(turbine, action, lidar).of_signals() if self._reads else {}
        self._table = InstrumentTable(turbine, channels, lidar_noise(lidar)) if self._reads else None
        self._rng = np.random.default_rng(_STREAM)

    def seed(self, seed: int, numbered: bool = False) -> None:
        """Begin the stream that belongs to a seed of the environment, or to a numbered beginning."""
        self._rng = np.random.default_rng([_STREAM, seed, 1] if numbered else [_STREAM, seed])

    @property
    def state(self) -> dict[str, Any]:
        """Of the stream, for snapshots."""
        return dict(self._rng.bit_generator.state)

    @state.setter
    def state(self, state: dict[str, Any]) -> None:
        self._rng.bit_generator.state = state

    def draw(self) -> DrawnVariation:
        """Draw for an episode: as many numbers whatever is given, so that each quantity has its own."""
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
                values[name] = {sensor: _between(u, low, high) for sensor, u in zip(DRIFTING, shifts, strict=True)}
            else:
                values[name] = _between(share[name], low, high)
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


def check_winds(variation: Variation, wind: WindOptions) -> None:
    """Refuse a class or profile to be drawn where the wind has its own.

    Raises
    ------
    wt_gym.base.errors.InflowError
    """
    names = [name for name in ("turbulence_class", "shear_exponent") if getattr(variation, name) is not None]
    if names and (not wind.made_here or wind.extreme):
        raise InflowError(
            f"vary_{names[0]} must be left out: it belongs to the inflows 'steady', 'turbulent' and 'gusts'"
        )
    for name in ("roughness_length", "reference_height"):
        if variation.shear_exponent is not None and getattr(wind, name) is not None:
            raise InflowError(f"vary_shear_exponent and {name} exclude each other; got both")


def _pick(share: float, count: int) -> int:
    return min(int(share * count), count - 1)


def _between(share: float, low: float, high: float) -> float:
    return low + share * (high - low)
