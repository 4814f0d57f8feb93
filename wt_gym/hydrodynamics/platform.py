"""Floating platforms: validated facts, and those that come with the package."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.hydrodynamics.drag import DragMember, HeavePlate
from wt_gym.hydrodynamics.mooring import MooringLine
from wt_gym.hydrodynamics.potential import ExcitationTable, MeanDrift, RadiationTable
from wt_gym.hydrodynamics.record import Record, fail

PLATFORMS = ("oc4_semi", "volturnus_s")
"""Names that `load_platform` knows."""
_DATA = Path(__file__).with_name("data")
_BIG = 1e15
_ZEROS = ((0.0,) * 6,) * 6


def _all(kind: type) -> Callable[[Any], Any]:
    """Check of a tuple of records or mappings of their arguments, which may be empty."""

    def check(value: Any) -> Any:
        if isinstance(value, tuple):
            value = tuple(kind(**part) if isinstance(part, Mapping) else part for part in value)
        if not isinstance(value, tuple) or not all(isinstance(part, kind) for part in value):
            raise ValueError(f"must be a tuple of {kind.__name__}, got {value!r:.80}")
        return value

    return check


@option_record
class Platform(Record):
    """Rigid floating platform with its ballast, its loads in water, and its lines.

    The origin is the point at still water on the axis of the tower; axes are x downwind, y left, z up. Motions are
    ordered surge, sway, heave, roll, pitch, yaw.
    """

    name: str = option("name")
    mass: float = option("mass with ballast", unit="kg", low=0, above=True, high=_BIG)
    center: Array = option("center of mass", unit="m", shape=(3,), low=-500, high=500)
    inertia: Array = option("inertia about the center of mass", unit="kg m^2", shape=(3, 3), low=-_BIG, high=_BIG)
    displaced_volume: float = option("volume of water at rest", unit="m^3", low=0, above=True, high=1e7)
    hydrostatic: Array = option("stiffness of water plane and buoyancy, without weight", shape=(6, 6))
    radiation: RadiationTable = option("added mass and damping", kinds=(RadiationTable,))
    excitation: ExcitationTable = option("wave forces", kinds=(ExcitationTable,))
    tower_base: float = option("height of the base of the tower", unit="m", low=-100, high=200)
    water_depth: float = option("depth of the water", default=200.0, unit="m", low=1, high=1e4)
    water_density: float = option("density of the water", default=1025.0, unit="kg/m^3", low=500, high=2000)
    gravity: float = option("acceleration of free fall", default=GRAVITY, unit="m/s^2", low=0, above=True, high=100)
    center_of_buoyancy: Array = option("in x and y", default=(0.0, 0.0), unit="m", shape=(2,), low=-500, high=500)
    members: tuple[DragMember, ...] = option("members with drag, or drawn only", default=(), check=_all(DragMember))
    plates: tuple[HeavePlate, ...] = option("plates with drag", default=(), check=_all(HeavePlate))
    lines: tuple[MooringLine, ...] = option("mooring lines", default=(), check=_all(MooringLine))
    linear_damping: Array = option("F_i = -B_ij v_j in axes turned by the yaw", default=_ZEROS, shape=(6, 6))
    quadratic_damping: Array = option("F_i = -B_ij |v_j| v_j in axes turned by the yaw", default=_ZEROS, shape=(6, 6))
    additional_stiffness: Array = option("F_i = -C_ij q_j in fixed axes", default=_ZEROS, shape=(6, 6))
    drift: MeanDrift | None = option("mean forces, for slow drift", default=None, kinds=(MeanDrift,), otherwise="none")

    def check(self) -> None:
        """Check what belongs together."""
        if not np.allclose(self.inertia, self.inertia.T, atol=1e-9 * np.abs(self.inertia).max()):
            raise fail("Platform.inertia", self.inertia, "symmetric")
        least, middle, largest = np.linalg.eigvalsh(self.inertia)
        if least <= 0.0 or least + middle < largest * (1.0 - 1e-3):
            raise fail("Platform.inertia", [least, middle, largest], "that of a body: no moment above the other two")
        if not np.allclose(self.hydrostatic, self.hydrostatic.T, atol=1e-6 * np.abs(self.hydrostatic).max()):
            raise fail("Platform.hydrostatic", self.hydrostatic, "symmetric")
        horizontal = self.hydrostatic[[0, 1, 5]]
        if np.any(horizontal != 0.0):
            raise fail("Platform.hydrostatic", horizontal, "0 in surge, sway and yaw, which change no water plane")
        if self.hydrostatic[2, 2] <= 0.0:
            raise fail("Platform.hydrostatic[2, 2]", self.hydrostatic[2, 2], "above 0 N/m")
        if self.displaced_mass < self.mass:
            raise fail("Platform.mass", self.mass, f"at most that of the displaced water, {self.displaced_mass:g} kg")
        for k, line in enumerate(self.lines):
            if line.anchor[2] < -self.water_depth - 0.1:
                seabed = f"above the seabed, -{self.water_depth:g} m"
                raise fail(f"Platform.lines[{k}].anchor[2]", line.anchor[2], seabed)
        self.pull()

    @property
    def displaced_mass(self) -> float:
        """Mass of the displaced water [kg]."""
        return self.water_density * self.displaced_volume

    def pull(self) -> float:
        """Return the force down of all lines at the place without displacement [N]; see `MooringLine.pull`."""
        water = self.water_density, self.gravity, self.water_depth
        return sum(line.pull(*water, f"Platform.lines[{k}]") for k, line in enumerate(self.lines))

    @property
    def mass_matrix(self) -> Array:
        """Mass of the body about the origin, without added mass, shape (6, 6)."""
        x, y, z = self.mass * self.center
        first = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        c = self.center
        second = self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return np.block([[self.mass * np.eye(3), first], [first.T, second]])


@cache
def load_platform(name: str) -> Platform:
    """Return a platform of `PLATFORMS`; sources are in ``wt_gym/hydrodynamics/data/README.md``.

    Raises
    ------
    TurbineDefinitionError
        If there is none of this name.
    """
    if name not in PLATFORMS:
        known = ", ".join(PLATFORMS)
        raise TurbineDefinitionError(f"platform must be one of {known}, got {name!r}{did_you_mean(name, PLATFORMS)}")
    values = json.loads((_DATA / f"{name}.json").read_text(encoding="utf-8"))
    values |= {key: _matrix(values[key]) for key in ("hydrostatic", "quadratic_damping") if key in values}
    values["inertia"] = np.diag(values["inertia"])
    mooring = values.pop("mooring")
    ends = zip(mooring.pop("anchors"), mooring.pop("fairleads"), strict=True)
    lines = tuple(MooringLine(anchor, fairlead, **mooring) for anchor, fairlead in ends)
    members = tuple(DragMember(**member) for member in values.pop("members", ()))
    plates = tuple(HeavePlate(axis=np.array([0.0, 0.0, 1.0]), **plate) for plate in values.pop("plates", ()))
    return Platform(
        name, **values, lines=lines, members=members, plates=plates,
        radiation=_radiation(_DATA / f"{name}_radiation.csv"), excitation=_excitation(_DATA / f"{name}_excitation.csv"),
    )  # fmt: skip


def _matrix(elements: dict[str, float]) -> Array:
    """Matrix (6, 6) of elements by indices such as "15", symmetric where only one side is there."""
    matrix = np.zeros((6, 6))
    for key, value in elements.items():
        i, j = int(key[0]) - 1, int(key[1]) - 1
        matrix[i, j] = value
        if f"{key[1]}{key[0]}" not in elements:
            matrix[j, i] = value
    return matrix


def _table(path: Path) -> tuple[list[str], Array]:
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        return names, np.loadtxt(file, delimiter=",", ndmin=2)


def _radiation(path: Path) -> RadiationTable:
    names, rows = _table(path)

    def matrices(letter: str) -> Array:
        named = [(k, name[1:]) for k, name in enumerate(names) if name[0] == letter and len(name) == 3]
        return np.array([_matrix({key: row[k] for k, key in named}) for row in rows])

    added, damping, infinite = matrices("A"), matrices("B"), np.isinf(rows[:, 0])
    return RadiationTable(rows[~infinite, 0], added[~infinite], damping[~infinite], added[infinite][0])


def _excitation(path: Path) -> ExcitationTable:
    _, rows = _table(path)
    frequency, heading = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    force = rows[np.lexsort((rows[:, 1], rows[:, 0])), 2:].reshape(len(frequency), len(heading), 6, 2)
    return ExcitationTable(frequency, np.radians(heading), force[..., 0], force[..., 1], is_mirrored=True)
