"""Which wind an episode gets."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.errors import InflowError
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow
from wt_gym.wind.iec import turbulence_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["EVALUATION_WIND_SEEDS", "TRAINING_WIND_SEEDS", "EpisodeWind", "WindSampler"]

TRAINING_WIND_SEEDS = tuple(range(1, 25))
"""Wind seeds from which training episodes draw by default."""

EVALUATION_WIND_SEEDS = tuple(range(1001, 1025))
"""Wind seeds held back for evaluation: no default environment ever trains on them."""

# Boxes are synthesised at multiples of this speed [m/s] and carried along at the speed wanted.
_BOX_SPEED_STEP = 6.0


@dataclass(frozen=True)
class EpisodeWind:
    """The wind of one episode.

    Attributes
    ----------
    inflow : Inflow
    wind_speed : float
        Mean speed at hub height [m/s].
    wind_seed : int
        Seed of the turbulence, -1 without.
    time_offset : float
        Time in the turbulence box at which the episode starts [s].
    """

    inflow: Inflow
    wind_speed: float
    wind_seed: int
    time_offset: float


class WindSampler:
    """Draws the wind of an episode.

    Kaimal spectra and coherence depend on frequency only through ``f / V``: turbulence is a frozen field in space. So a
    box of unit intensity synthesised at one speed serves another speed V when it is carried along at V and scaled to
    the standard deviation of V. Boxes are made at the next multiple of 6 m/s, for 600 s at that speed.

    Parameters
    ----------
    turbine : Turbine
    kind : "steady", "turbulent" or Inflow
        An inflow of one's own is used as it is in every episode.
    wind_speed : float or (float, float)
        Mean speed at hub height [m/s], or a range to draw it from uniformly. Ignored (None) with one's own inflow.
    shear_exponent : float
        Of the power-law profile.
    turbulence_class : str, optional
        ``"A+"``, ``"A"``, ``"B"`` or ``"C"``; default: the turbine's.
    wind_seeds : sequence of int
        Pool of turbulence seeds.

    Attributes
    ----------
    speeds : (float, float)
        Range of the mean speeds [m/s].
    seeds : tuple of int or None
        Turbulence seeds that episodes draw from: none in steady wind, unknown (None) with an inflow of one's own.

    Raises
    ------
    InflowError
        If the kind is unknown, a speed lies outside cut-in to cut-out, or the pool is empty or no list of integers.
    """

    def __init__(
        self,
        turbine: Turbine,
        kind: str | Inflow,
        wind_speed: float | tuple[float, float] | None,
        shear_exponent: float = 0.2,
        turbulence_class: str | None = None,
        wind_seeds: Sequence[int] = TRAINING_WIND_SEEDS,
    ):
        if isinstance(kind, str) and kind not in ("steady", "turbulent"):
            raise InflowError(f"inflow must be 'steady', 'turbulent' or an Inflow, got {kind!r}")
        self._turbine, self._kind = turbine, kind
        self._shear_exponent = shear_exponent
        self._class = turbulence_class or turbine.turbulence_class
        if not isinstance(wind_seeds, Iterable):
            raise InflowError(f"wind_seeds must be a sequence of integers, got {wind_seeds!r}")
        self._pool = tuple(self._checked_seed(seed) for seed in wind_seeds)
        if not self._pool:
            raise InflowError("wind_seeds must name at least one seed")
        if isinstance(kind, str):
            self.speeds = self._range(wind_speed)
            if kind == "turbulent":
                turbulence_sigma(self.speeds[0], self._class)  # refuses an unknown class now, not at the first reset
        else:
            self.speeds = (kind.mean_speed, kind.mean_speed)
        self.seeds = {"turbulent": self._pool, "steady": ()}[kind] if isinstance(kind, str) else None

    def sample(
        self,
        rng: np.random.Generator,
        wind_speed: float | None = None,
        wind_seed: int | None = None,
        time_offset: float | None = None,
    ) -> EpisodeWind:
        """Draw a wind.

        Parameters
        ----------
        rng : numpy.random.Generator
        wind_speed, wind_seed, time_offset : optional
            Fixed instead of drawn. With a fixed seed the episode starts at the beginning of the box unless an offset
            is given too.

        Returns
        -------
        EpisodeWind

        Raises
        ------
        InflowError
            If a fixed value is not allowed, or belongs to a wind that has none.
        """
        # Always three draws, so that fixing one of them leaves the others as they were.
        drawn_speed, drawn_seed, drawn_phase = rng.uniform(*self.speeds), rng.choice(self._pool), rng.random()
        turbulent = self._kind == "turbulent"
        self._refuse_useless(wind_speed, wind_seed, time_offset)
        if not isinstance(self._kind, str):
            return EpisodeWind(self._kind, self._kind.mean_speed, -1, 0.0)
        speed = self._checked_speed(wind_speed) if wind_speed is not None else float(drawn_speed)
        steady = SteadyInflow(speed, self._turbine.hub_height, shear_exponent=self._shear_exponent)
        if not turbulent:
            return EpisodeWind(steady, speed, -1, 0.0)
        seed = self._checked_seed(wind_seed) if wind_seed is not None else int(drawn_seed)
        box = self._box(speed, seed)
        if time_offset is None:
            time_offset = 0.0 if wind_seed is not None else float(drawn_phase) * box.duration
        return EpisodeWind(TurbulentInflow(box, steady, time_offset), speed, seed, time_offset)

    def _box(self, speed: float, seed: int) -> TurbulenceBox:
        """Turbulence carried along at a speed."""
        made_at = _BOX_SPEED_STEP * np.ceil(speed / _BOX_SPEED_STEP)
        turbine = self._turbine
        box = TurbulenceBox.kaimal(made_at, turbine.hub_height, turbine.rotor_diameter, self._class, seed=seed)
        if made_at == speed:
            return box
        sigma = turbulence_sigma(speed, self._class)
        intensity = sigma / turbulence_sigma(made_at, self._class)
        return replace(
            box,
            fluctuation=box.fluctuation * np.float32(intensity),
            time_step=box.time_step * made_at / speed,
            mean_speed=speed,
            description=f"{box.description}, carried along at {speed:.4g} m/s with sigma_u {sigma:.3g} m/s",
        )

    def _range(self, wind_speed) -> tuple[float, float]:
        """Lower and upper wind speed [m/s]."""
        ends = np.atleast_1d(np.asarray(wind_speed, dtype=object))
        if ends.size not in (1, 2):
            raise InflowError(f"wind_speed must be a number or a pair (low, high) in m/s, got {wind_speed!r}")
        low, high = self._checked_speed(ends[0]), self._checked_speed(ends[-1])
        if low > high:
            raise InflowError(f"wind_speed must be a range (low, high) with low <= high, got {wind_speed!r} m/s")
        return low, high

    def _checked_speed(self, speed) -> float:
        low, high = self._turbine.cut_in, self._turbine.cut_out
        try:
            value = float(speed)
        except (TypeError, ValueError) as error:
            raise InflowError(f"wind_speed must be a number in m/s, got {speed!r}") from error
        if not low <= value <= high:
            raise InflowError(
                f"wind_speed must lie between cut-in and cut-out of {self._turbine.name}, {low:g} to {high:g} m/s, "
                f"got {speed!r}"
            )
        return value

    def _refuse_useless(self, wind_speed, wind_seed, time_offset) -> None:
        """Refuse options that the kind of wind would ignore."""
        if self._kind == "turbulent":
            return
        if wind_seed is not None or time_offset is not None:
            raise InflowError("wind_seed and time_offset belong to turbulent wind; this environment's wind has none")
        if wind_speed is not None and self._kind != "steady":
            raise InflowError("wind_speed cannot be chosen: this environment was made with an inflow of its own")

    @staticmethod
    def _checked_seed(seed) -> int:
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise InflowError(f"a wind seed must be an integer of at least 0, got {seed!r}")
        return int(seed)
