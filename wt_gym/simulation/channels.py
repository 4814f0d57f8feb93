"""The signals of the simulator: one flat vector with a documented table of channels.

Fore-aft and side-side are directions of the nacelle: along its heading, the level part of its x axis, which points
downwind, and to the left of it. They turn with the nacelle when it yaws, so that no signal with such a name depends on
where the wind comes from. What is along axes that stay is named after the global axis, x or y. OpenFAST's tower outputs
TTDspFA, TTDspSS, TwrBsMxt and TwrBsMyt are of the second kind: they are along its tower-base axes (suffix t), which are
fixed to the foundation. Both kinds agree where the nacelle heads along x.

A rotor that turns counter-clockwise is the mirror image, y → −y, of one that turns clockwise. Rotor speed, azimuth,
torques and powers are positive in the sense in which the rotor turns, whichever it is, and blade 2 is ahead of blade 1.
What is in the frame of a blade (z to the tip, x to the suction side, y to the trailing edge) is the same in the image,
because that frame is reflected with the blade. All other signals are components along axes that no rotor turns: those
across the plane of reflection, and moments and angles about axes in it, change their sign (`Channel.parity`).

The equations of motion and of the air know no left and right: the mirror image, y → −y, of a motion in a wind is the
motion of the mirror image in the mirrored wind. So a turbine with ``rotation="counter-clockwise"`` is simulated as its
clockwise image (`wt_gym.turbines.variants`) in the mirrored wind (`wt_gym.wind.MirroredInflow`), with yaw angle and yaw
rate of the other sign, and what comes out is reflected back: signals by their parity (`Channel.parity`), points and
forces by S = diag(1, −1, 1), moments by −S. OpenFAST's ``MirrorRotor`` (drafted for its release 5.1) does the same with
the rotor alone. Snapshots hold the state of the image.
"""

from __future__ import annotations

import re
from collections.abc import ItemsView, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import read_rows
from wt_gym.base.quantities import MOTIONS, Array
from wt_gym.turbines.variants import REFLECTION, REFLECTION_6


@dataclass(frozen=True)
class Channel:
    """One signal."""

    name: str
    unit: str
    openfast: str  #: OpenFAST's name of the same quantity (its unit may differ), or ""
    parity: int
    """`EVEN` or `ODD`: sign with which the signal goes into that of the mirror image, in which y is −y and the rotor
    turns the other way."""
    description: str
    group: str  #: Name without the number of the blade


EVEN, ODD = 1, -1
"""Parities of a signal under the reflection y → −y, see `Channel.parity`."""
TOWER_TOP_PARITIES = np.array([1.0, -1.0, 1.0, -1.0])
"""Parities of displacement and velocity of the tower top, fore-aft and side-side, as a start takes them."""
TOWER_TOP_PARITIES.flags.writeable = False


def _read_channels() -> dict[str, list[tuple[str, str, str, int, str]]]:
    """Channels of the file, name to description as in `Channel`, by what has one each."""
    channels: dict[str, list[tuple[str, str, str, int, str]]] = {}
    for row in read_rows(Path(__file__).with_name("channels.csv")):
        channel = row["name"], row["unit"], row["openfast"], int(row["parity"]), row["description"]
        channels.setdefault(row["each"], []).append(channel)
    return channels


_SINGLE, _PER_BLADE, _PLATFORM, _PER_LINE = _read_channels().values()
_PLATFORM_PARITIES = {name: parity for name, _, _, parity, _ in _PLATFORM}


@cache
def channel_table(n_blades: int, n_lines: int | None = None) -> tuple[Channel, ...]:
    """Channels of a turbine, in the order of ``Signals.values``.

    Parameters
    ----------
    n_blades : int
    n_lines : int, optional
        Mooring lines of a floating turbine, whose channels stand last; None: it stands on the ground.
    """
    table = [Channel(*row, row[0]) for row in _SINGLE]
    for name, unit, openfast, parity, text in _PER_BLADE:
        for i in range(1, n_blades + 1):
            fast = f"{openfast}{i}" if openfast else ""
            table.append(Channel(f"{name}_{i}", unit, fast, parity, f"{text}, blade {i}", name))
    if n_lines is not None:
        table += [Channel(*row, row[0]) for row in _PLATFORM]
        for name, unit, openfast, parity, text in _PER_LINE:
            for i in range(1, n_lines + 1):
                table.append(Channel(f"{name}_{i}", unit, f"{openfast}{i}", parity, f"{text}, line {i}", name))
    return tuple(table)


@cache
def parities(n_blades: int, n_lines: int | None = None) -> Array:
    """Parity of each channel, in the order of ``Signals.values``."""
    signs = np.array([float(channel.parity) for channel in channel_table(n_blades, n_lines)])
    signs.flags.writeable = False
    return signs


@cache
def _layout(n_blades: int, n_lines: int | None) -> tuple[dict[str, int], dict[str, slice]]:
    """Index of each channel, and the slice of each group of channels of blades and mooring lines."""
    index = {channel.name: i for i, channel in enumerate(channel_table(n_blades, n_lines))}
    start = len(_SINGLE)
    groups = {row[0]: slice(start + k * n_blades, start + (k + 1) * n_blades) for k, row in enumerate(_PER_BLADE)}
    if n_lines is not None:
        for k, row in enumerate(_PER_LINE):
            first = len(index) - (len(_PER_LINE) - k) * n_lines
            groups[row[0]] = slice(first, first + n_lines)
    return index, groups


@cache
def _places(n_blades: int, n_lines: int | None) -> dict[str, int | slice]:
    """Index of each channel and slice of each group, by name."""
    index, groups = _layout(n_blades, n_lines)
    return {**groups, **index}


@cache
def _lines_of(n_values: int, n_blades: int) -> int | None:
    """Mooring lines of the turbine to which so many values belong."""
    further = n_values - len(_SINGLE) - n_blades * len(_PER_BLADE)
    return None if further == 0 else (further - len(_PLATFORM)) // len(_PER_LINE)


def place_of(n_blades: int, n_lines: int | None, name: str) -> int:
    """Index of a channel in ``Signals.values``."""
    return _layout(n_blades, n_lines)[0][name]


class Signals:
    """Values of all channels at one instant.

    Attributes are the channel names; a per-blade name without its number gives all blades, e.g. ``signals.pitch``.
    Iteration goes over the names of all channels, as of a dict.

    Parameters
    ----------
    values : array (n_channels,)
        In the order of :func:`channel_table`; not copied.
    """

    __slots__ = ("_places", "n_blades", "n_lines", "values")

    if TYPE_CHECKING:  # of all blades (n_blades,); every other channel is a number
        pitch: Array
        pitch_rate: Array
        pitch_command: Array
        tip_out_of_plane: Array
        tip_in_plane: Array
        root_flap_moment: Array
        root_edge_moment: Array
        root_torsion: Array
        tip_clearance: Array
        tip_clearance_min: Array
        tip_out_of_plane_max: Array
        root_flap_moment_max: Array
        pitch_travel: Array

        def __getattr__(self, name: str) -> float: ...

    def __init__(self, values: Array, n_blades: int) -> None:
        self.values, self.n_blades = values, n_blades
        self.n_lines = _lines_of(len(values), n_blades)
        self._places = _places(n_blades, self.n_lines)

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            if name in Signals.__slots__ or name.startswith("__"):  # asked for while a copy is being made
                raise AttributeError(name)
            place = self._places.get(name)
            if place is None:
                raise AttributeError(self._unknown(name))
            return self.values.item(place) if place.__class__ is int else self.values[place]

    def __getitem__(self, name: str) -> Any:
        place = self._places.get(name)
        if place is not None:
            return self.values.item(place) if place.__class__ is int else self.values[place]
        try:
            return getattr(self, name)
        except AttributeError as error:
            raise KeyError(str(error)) from None

    def _unknown(self, name: str) -> str:
        """Message about a signal that is not there."""
        known = _layout(self.n_blades, self.n_lines)[0]
        return f"a signal must be one of {', '.join(known)}; got {name!r}{did_you_mean(name, known)}"

    def set(self, name: str, value: ArrayLike) -> None:
        """Change a signal, or that of all blades at once."""
        if name not in self._places:
            raise KeyError(self._unknown(name))
        self.values[self._places[name]] = value

    def __reduce__(self) -> tuple[type[Signals], tuple[Array, int]]:
        return Signals, (self.values, self.n_blades)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Signals) and np.array_equal(self.values, other.values)

    __hash__: ClassVar[Any] = None

    def __repr__(self) -> str:
        return (
            f"Signals(t={self.time:.2f} s, wind {self.wind_x:.2f} m/s, rotor {self.rotor_speed * 30 / np.pi:.2f} rpm, "
            f"power {self.generator_power / 1e3:.0f} kW)"
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return self.values.size

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def keys(self) -> tuple[str, ...]:
        """Names of all channels, those of blades with their numbers; with it ``dict(signals)`` works."""
        return tuple(_layout(self.n_blades, self.n_lines)[0])

    def items(self) -> ItemsView[str, float]:
        """Names and values of all channels, as of a dict."""
        return self.to_dict().items()

    def to_dict(self) -> dict[str, float]:
        """All channels by name (floats)."""
        return {
            channel.name: float(v)
            for channel, v in zip(channel_table(self.n_blades, self.n_lines), self.values, strict=True)
        }

    as_dict = to_dict


def new_values(n_blades: int, n_lines: int | None = None) -> tuple[Array, dict[str, int | slice]]:
    """An empty vector of channel values, and where in it channels and groups stand, by name."""
    return np.zeros(len(_layout(n_blades, n_lines)[0])), _places(n_blades, n_lines)


_BLADES = re.compile(r"(blade_\d|pitch_|(flap|edge|torsion)_\d+_(collective|cosine|sine))")
_FLOATER = re.compile(rf"(?:platform|radiation)_({'|'.join(MOTIONS)})(?:_\d+)?")
_SHAFT = ("azimuth", "shaft_torsion")
_YAW = ("yaw", "yaw_twist")
_PLANES = {"fore_aft": EVEN, "side_side": ODD, "torsion": ODD}
_DIRECTIONS = {"x": EVEN, "y": ODD, "z": EVEN, "turn_x": ODD, "turn_y": EVEN, "turn_z": ODD}


def reflected_loads(loads: Array) -> Array:
    """Force and moment (6,) in global axes, of the other side of the mirror."""
    return np.asarray(loads * REFLECTION_6)


def reflected_shapes(shapes: Mapping[str, Array]) -> dict[str, Array]:
    """Shapes of `wt_gym.simulation.Simulator.geometry`, of the other side of the mirror.

    Vorticity is a pseudovector: by the right-hand rule the circulation along a reflected filament has the other sign.
    """
    signs = {"tower_radius": 1.0, "platform_radius": 1.0, "wake_circulation": -1.0}
    return {name: values * signs.get(name, REFLECTION) for name, values in shapes.items()}


def state_parity(name: str) -> int:
    """Parity of a state of the multibody system or the water about a floater under the reflection.

    Coordinates of blades and shaft are in frames that are reflected with them; those of the tower are along axes that
    stay.

    Parameters
    ----------
    name : str
        Of `MultibodySystem.state_names`, rates included, or of a linear model of a floater.

    Raises
    ------
    KeyError
        If the name is not one of a turbine's.
    """
    base = name.removesuffix("_rate")
    if _BLADES.match(base) or base in _SHAFT:
        return EVEN
    if base in _YAW:
        return ODD
    if (match := _FLOATER.fullmatch(base)) is not None:
        return _PLATFORM_PARITIES[f"platform_{match[1]}"]
    for pattern, parities in ((r"(\w+)_\d+", _PLANES), (r"(?:tower_)?node_\d+_(\w+)", _DIRECTIONS)):
        match = re.fullmatch(pattern, base)
        if match and match[1] in parities:
            return parities[match[1]]
    raise KeyError(f"no parity of the state {name!r} is known")


def state_parities(names: Iterable[str]) -> Array:
    """Parity of each of the states (n,)."""
    return np.array([float(state_parity(name)) for name in names])
