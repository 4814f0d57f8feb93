"""The sea of a floating turbine: waves that grow with the wind, or as an option says, drawn anew for every episode."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import options_of, shown
from wt_gym.control import Channel
from wt_gym.envs.channels import Observed
from wt_gym.envs.operation import Operation
from wt_gym.envs.terms import Request, Term
from wt_gym.hydrodynamics.waves import SeaState, WaveComponents
from wt_gym.simulation.channels import EVEN, ODD
from wt_gym.turbines import Turbine

STILL = "still"
MISALIGNMENT = "misalignment"
"""Key of the range of directions beside the fields of `SeaState`."""
SHORTEST = 600.0
"""Time within which no sea repeats [s]: episodes are shorter, slow drift is not."""
LONGEST = 3600.0
"""Time after which the sea of an episode without end repeats [s]."""


@dataclass(frozen=True)
class SeaChoice:
    """Checked option: a sea state, None for that of the wind; and how far its direction is drawn to either side."""

    state: SeaState | None
    misalignment: float = 0.0  #: [rad]

    @classmethod
    def of(cls, value: Any) -> "SeaChoice":
        """Choice of an option.

        Parameters
        ----------
        value : None, "still", SeaState or mapping
            A mapping has fields of `SeaState` and "misalignment" [rad]; without a significant height the sea is that
            of the wind, in this direction.

        Raises
        ------
        ValueError, wt_gym.base.errors.InflowError
            If it is something else.
        """
        if value is None or isinstance(value, SeaState):
            return cls(value)
        if value == STILL:
            return cls(SeaState())
        names = (*(one.name for one in options_of(SeaState)), MISALIGNMENT)
        if not isinstance(value, Mapping) or (unknown := [name for name in value if name not in names]):
            guess = did_you_mean(unknown[0], names) if isinstance(value, Mapping) else ""
            raise ValueError(
                f"must be None for that of the wind, {STILL!r}, a SeaState or a mapping with {', '.join(names)}; "
                f"got {shown(value)}{guess}"
            )
        fields = dict(value)
        spread = fields.pop(MISALIGNMENT, 0.0)
        if not (isinstance(spread, (int, float, np.number)) and spread is not True and 0.0 <= spread <= math.pi):
            raise ValueError(f"{MISALIGNMENT!r} must be between 0 and pi rad, got {spread!r}")
        fields.setdefault("kind", "jonswap")
        state, own = SeaState(**fields), {"significant_height", "peak_period"} & fields.keys()
        if own and not state.significant_height and state.kind not in (STILL, "file"):
            raise ValueError(f"must have a 'significant_height' above 0 m with a height or period of its own, "
                             f"neither for that of the wind, or be {STILL!r}; got {shown(value)}")  # fmt: skip
        return cls(state, float(spread))


def sea_of_wind(speed: float) -> SeaState:
    """Sea that belongs to a mean wind at hub height [m/s].

    JONSWAP with H_s = V/3 - 1, at least 0.5, and T_p = 5 + V/3 in m and s: 3 m and 9 s at 12 m/s, 5 m and 11 s at
    18 m/s, as in the reference cases of both platforms. Sites differ; a task names its own.
    """
    return SeaState("jonswap", max(speed / 3.0 - 1.0, 0.5), 5.0 + speed / 3.0)


def recorded_sea(turbine: Turbine, speed: float, seed: int) -> WaveComponents | None:
    """Sea of a record in a mean wind [m/s] along the waves; None on the ground."""
    if turbine.floater is None:
        return None
    state = replace(sea_of_wind(speed), duration=LONGEST)
    return state.components(np.random.default_rng(seed), turbine.floater.water_depth)


@dataclass(frozen=True)
class EpisodeSea:
    """Sea of an episode."""

    components: WaveComponents
    state: SeaState

    @property
    def key(self) -> WaveComponents:
        """Tells it from others."""
        return self.components

    def equip(self, operation: Operation) -> None:
        """Let the turbine float in it."""
        operation.meet(self.components)

    def first_info(self) -> dict[str, Any]:
        """Its part of the info of a reset."""
        waves, period, height = self.components, self.state.peak_period, self.components.height
        if self.state.kind in ("file", "still") and height > 0.0:  # a file or components, whose state has no period
            period = 2.0 * math.pi / float(waves.frequency[np.argmax(waves.amplitude)])
        elif self.state.kind not in ("regular", "jonswap", "pierson_moskowitz"):
            period = 0.0  # no peak
        return {"significant_wave_height": height, "peak_wave_period": period}


class SeaTerm(Term):
    """Draws the sea, and makes the motion of the platform observable.

    Parameters
    ----------
    turbine : Turbine
        That floats.
    choice : object
        Option of the environment, see `SeaChoice.of`.
    is_steady : bool
        Whether the wind is, in which the sea of the wind is still.
    """

    option = "sea"

    def __init__(self, turbine: Turbine, choice: Any, is_steady: bool):
        self._turbine, self._is_steady, self._choice = turbine, is_steady, SeaChoice.of(choice)

    def draw(self, request: Request) -> None:
        """Draw the sea of an episode."""
        given = request.options.get(self.option)
        own = np.random.default_rng(int(request.rng.integers(2**63)))
        if isinstance(given, WaveComponents):
            request.drawn["sea"] = EpisodeSea(given, SeaState())
            return
        try:
            choice = self._choice if given is None else SeaChoice.of(given)
        except ValueError as error:
            raise type(error)(f"{self.option} {error}") from error
        request.drawn["sea"] = self.sea(own, float(request.wind.wind_speed), request.length, choice)

    def sea(
        self, rng: np.random.Generator, wind_speed: float, length: float | None, choice: SeaChoice | None = None
    ) -> EpisodeSea:
        """Sea in a mean wind [m/s] over a length [s], of the environment's choice by default."""
        choice = choice or self._choice
        state = self._state(choice, wind_speed)
        turn = rng.uniform(-1.0, 1.0) * choice.misalignment
        endless = 0.0 if state.kind == "file" else LONGEST  # a file repeats after its own duration
        state = replace(state, direction=math.remainder(state.direction + turn, 2.0 * math.pi),
                        duration=max(state.duration, min(length or endless, LONGEST), SHORTEST))  # fmt: skip
        floater = self._turbine.floater
        assert floater is not None  # or the term is off
        return EpisodeSea(state.components(rng, floater.water_depth), state)

    def _state(self, choice: SeaChoice, speed: float) -> SeaState:
        """Sea state in a wind of a mean speed [m/s]."""
        if choice.state is None:
            return SeaState() if self._is_steady else sea_of_wind(speed)
        if choice.state.kind in ("still", "file") or choice.state.significant_height > 0.0:
            return choice.state
        wind = sea_of_wind(speed)
        return replace(choice.state, significant_height=wind.significant_height, peak_period=wind.peak_period)

    def groups(self) -> dict[str, list[Observed]]:
        """Motion of the platform as its sensors read it: tilt and its rates, accelerations; elevation of the sea."""
        rows = [
            ("roll", "rad", 0.0, 0.01, 0.5, 1e-3, ODD),
            ("pitch", "rad", 0.04, 0.02, 0.5, 1e-3, EVEN),
            ("roll rate", "rad/s", 0.0, 0.002, 0.2, 1e-4, ODD),
            ("pitch rate", "rad/s", 0.0, 0.005, 0.2, 1e-4, EVEN),
            ("surge acceleration", "m/s^2", 0.0, 0.2, 5.0, 0.01, EVEN),
            ("sway acceleration", "m/s^2", 0.0, 0.05, 5.0, 0.01, ODD),
            ("surge", "m", 0.0, 5.0, 60.0, 0.1, EVEN),
            ("sway", "m", 0.0, 5.0, 60.0, 0.1, ODD),
        ]
        observed = [
            Observed(
                Channel(name, unit, middle, scale, -limit, limit, noise, f"{text} of the platform", parity=parity), name
            )
            for text, unit, middle, scale, limit, noise, parity in rows
            for name in [f"platform_{text.replace(' ', '_')}"]
        ]
        wave = Channel("wave_elevation", "m", 0.0, 1.0, -30.0, 30.0, 0.05, "elevation of the sea at the origin")
        groups = {"platform": observed[:6], "platform_position": observed[6:]}
        return {**groups, "wave": [Observed(wave, "wave_elevation")]}
