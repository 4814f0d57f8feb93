"""The blade of a windIO file: reference axis, planform, airfoils with their polars, and section properties.

windIO's blade frame is the one used here: z along the pitch axis to the tip, x to the suction side (prebend upwind is
negative), y to the trailing edge. Its distributed data are tables over a grid from 0 (root) to 1 (tip).

The section matrices of windIO belong to the frame turned by the twist. Its schema describes their x axis as pointing to
the trailing edge, while the files that come with windIO, its converter and BeamDyn, where the matrices come from, have
x to the suction side and y to the trailing edge (K44 edgewise, i_edge in the same place). Both are accepted: a blade is
stiffer edgewise, so the larger of K44 and K55 over the outer blade tells which frame was meant.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.interpolate import PchipInterpolator

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import Array, Integers
from wt_gym.turbines.airfoil import (
    DRAG_ALLOWED,
    Airfoil,
    Polar,
    blend_airfoils,
    blend_polars,
    camber_line,
    driving_drag,
    suction_first,
)
from wt_gym.turbines.blade import BeamStations, Blade, inertia_matrix, turned
from wt_gym.turbines.checks import check_array, check_number, fail
from wt_gym.turbines.windio_file import Node, within

DEFAULT_BLADE_DAMPING = 0.00477465
"""3 % logarithmic decrement, the value of the NREL 5-MW and (rounded) of the IEA 15-MW blades."""

_ROWS = [(i, j) for i in range(6) for j in range(i, 6)]


@dataclass(frozen=True)
class _Axis:
    """Reference axis as functions of windIO's grid."""

    grid: Array
    points: Array
    station: Array

    def z(self, grid: Array) -> Array:
        """Return the distance from the root along z [m]."""
        out: Array = PchipInterpolator(self.grid, self.points[:, 2])(grid)
        return out

    def s(self, grid: Array) -> Array:
        """Return the distance from the root along the axis [m]."""
        out: Array = PchipInterpolator(self.grid, self.station)(grid)
        return out


def read_blade(root: Node, hub_radius: float, rated_rotor_speed: float) -> Blade:
    """Build the blade.

    Parameters
    ----------
    hub_radius : float
        Distance of the blade root from the apex [m].
    rated_rotor_speed : float
        [rad/s]; picks the polars with the nearest Reynolds number where a file has several.
    """
    node = root.at("components.blade")
    axis = _read_axis(node.at("reference_axis"))
    shape = node.at("outer_shape")
    grid, chord, twist, le_offset, normal_offset = _read_planform(shape)
    z = axis.z(grid)
    radius = hub_radius + z
    library = AirfoilLibrary(root)
    airfoils, airfoil_z, airfoil_index = _read_airfoils(
        shape, axis, library, lambda x: float(np.interp(x, grid, radius * chord)) * rated_rotor_speed
    )
    hint = "a table of section properties (they are not computed from composite layers)"
    elastic = node.at("structure.elastic_properties", hint)
    damping = damping_ratio(elastic, DEFAULT_BLADE_DAMPING)
    with within(elastic.path):
        structure = _read_structure(elastic, axis, PchipInterpolator(grid, twist))
    with within(node.path):
        return Blade(
            length=float(axis.points[-1, 2]),
            root_radius=hub_radius,
            axis_station=axis.station,
            axis=axis.points,
            aero_station=z,
            chord=chord,
            twist=twist,
            le_offset=le_offset,
            airfoils=airfoils,
            airfoil_station=airfoil_z,
            airfoil_index=airfoil_index,
            structure=structure,
            damping_ratio=damping,
            normal_offset=normal_offset,
            rotating_polars=library.rotating_polars(shape.items("airfoils")),
        )


def _read_axis(node: Node) -> _Axis:
    tables = [node.distribution(key) for key in ("x", "y", "z")]
    grid = np.unique(np.concatenate([table[0] for table in tables]))
    curves = [PchipInterpolator(*table) for table in tables]
    points = np.column_stack([curve(grid) for curve in curves])
    length = points[-1, 2]
    if abs(points[0, 2]) > 1e-6 * abs(length):
        raise fail(f"{node.path}.z.values[0]", float(points[0, 2]), "0 m (the blade root)")
    points[0, 2] = 0.0
    if np.any(np.diff(points[:, 2]) <= 0.0):
        raise fail(f"{node.path}.z.values", points[:, 2].tolist(), "values that ascend from root to tip")
    return _Axis(grid, points, arc_length(grid, lambda at: np.column_stack([curve(at) for curve in curves])))


def arc_length(at: Array, curve: Callable[[Array], Array]) -> Array:
    """Return the distance (n,) along a curve at places (n,), by chords of 50 parts a segment.

    They leave an error of 1e-6 of the sag.
    """
    fine = np.unique(np.concatenate([np.linspace(a, b, 51) for a, b in pairwise(at)]))
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))))
    return np.interp(at, fine, arc)


def _read_planform(shape: Node) -> tuple[Array, ...]:
    """Return grid, chord [m], twist [rad], leading-edge and normal offset [chords] on the union of their grids."""
    tables = {
        "chord": shape.distribution("chord"),
        "twist": shape.distribution("twist", np.pi / 180.0),
        "section_offset_y": shape.distribution("section_offset_y"),
    }
    if "section_offset_x" in shape:
        tables["section_offset_x"] = shape.distribution("section_offset_x")
    grid = np.unique(np.concatenate([table[0] for table in tables.values()]))
    values = {key: PchipInterpolator(*table)(grid) for key, table in tables.items()}
    chord = values["chord"]
    for extreme in (float(chord.min()), float(chord.max())):
        check_number(shape.where("chord.values"), extreme, 1e-3, 30.0)
    normal = values.get("section_offset_x", np.zeros(grid.size))
    return grid, chord, values["twist"], values["section_offset_y"] / chord, normal / chord


def _read_airfoils(
    shape: Node, axis: _Axis, library: "AirfoilLibrary", speed_chord: Callable[[float], float]
) -> tuple[tuple[Airfoil, ...], Array, Integers]:
    """Return airfoils, their z [m] and index.

    windIO lists pure airfoils along the span and a thickness distribution; where both are there the thickness decides.
    So between two listed airfoils the weight follows the thickness, and a blended section is made at every point of the
    thickness table; where neighbors are equally thick the weight follows the position.
    """
    entries = shape.items("airfoils")
    if not entries:
        raise fail(shape.where("airfoils"), [], "at least one airfoil")
    grid_t, thickness = shape.distribution("rthick")
    named = [library.thickness(entry) for entry in entries]
    position = _positions(shape, entries, np.array(named), grid_t, thickness)
    pure = [library.airfoil(entry, speed_chord(x)) for entry, x in zip(entries, position, strict=True)]
    stations = np.unique(np.concatenate((position, grid_t)))
    airfoils: list[Airfoil] = []
    index = []
    for x in stations:
        j = int(np.searchsorted(position, x, side="right"))
        first, second = pure[max(j - 1, 0)], pure[min(j, len(pure) - 1)]
        lower, upper = position[max(j - 1, 0)], position[min(j, len(pure) - 1)]
        t0, t1 = first.relative_thickness, second.relative_thickness
        if x == lower or upper == lower:
            weight = 0.0
        elif abs(t1 - t0) > 1e-3:
            # A thickness outside the range of both neighbors cannot be met by blending them: the nearer one is used.
            weight = float(np.clip((np.interp(x, grid_t, thickness) - t0) / (t1 - t0), 0.0, 1.0))
        else:
            weight = float((x - lower) / (upper - lower))
        section = blend_airfoils(first, second, weight)
        if section not in airfoils:
            airfoils.append(section)
        index.append(airfoils.index(section))
    return tuple(airfoils), axis.z(stations), np.array(index, dtype=np.int64)


def _positions(shape: Node, entries: list[Node], named: Array, grid: Array, thickness: Array) -> Array:
    """Return the spanwise positions of the listed airfoils, from the file or from where their thickness occurs."""
    if all("spanwise_position" in entry for entry in entries):
        position = np.array([entry.number("spanwise_position", 0.0, 1.0) for entry in entries])
    else:
        # The last place that is at least so thick; the thickness of a blade falls from root to tip.
        fine = np.linspace(0.0, 1.0, 2001)
        local = np.interp(fine, grid, thickness)
        position = np.array([fine[np.flatnonzero(local >= t - 1e-9)[-1]] if local.max() >= t else 0.0 for t in named])
    if np.any(np.diff(position) <= 0.0):
        allowed = "spanwise_position (or, without it, rthick) such that the airfoils ascend from root to tip"
        raise fail(shape.where("airfoils"), position.tolist(), allowed)
    return position


def beam_tables(node: Node, needed: tuple[str, ...]) -> tuple[Array, Array, dict[str, Array]]:
    """Read windIO's elastic properties on the union of both of its grids.

    Parameters
    ----------
    node : Node
        ``elastic_properties`` of a blade or tower.
    needed : tuple of str
        Entries of either table that must be there; stiffnesses among them also positive.

    Returns
    -------
    grid : ndarray (n,)
    stiffness : ndarray (n, 6, 6)
        In the frame of the file; entries the file leaves out are 0.
    inertia : dict of ndarray (n,)
        mass, cm_x, cm_y, i_edge, i_flap, i_plr, i_cp; those the file leaves out are 0.
    """
    k_node, m_node = node.at("stiffness_matrix"), node.at("inertia_matrix")
    if "point_mass" in node and np.any(node.at("point_mass").array("mass") != 0.0):
        raise fail(node.where("point_mass"), "masses", "no point masses (add them to inertia_matrix.mass)")
    k_grid, m_grid = k_node.grid(), m_node.grid()
    grid = np.union1d(k_grid, m_grid)
    stiffness = np.zeros((grid.size, 6, 6))
    for i, j in _ROWS:
        key = f"K{i + 1}{j + 1}"
        if key in needed or key in k_node:
            values = k_node.array(key, k_grid.size)
            if key in needed and np.any(values <= 0.0):
                raise fail(k_node.where(key), float(values.min()), "stiffnesses above 0")
            stiffness[:, i, j] = stiffness[:, j, i] = np.interp(grid, k_grid, values)
    names = ("mass", "cm_x", "cm_y", "i_edge", "i_flap", "i_plr", "i_cp")
    inertia = {
        key: np.interp(grid, m_grid, m_node.array(key, m_grid.size))
        if key == "mass" or key in needed or key in m_node
        else grid * 0.0
        for key in names
    }
    if np.any(inertia["mass"] <= 0.0):
        raise fail(m_node.where("mass"), float(inertia["mass"].min()), "masses per length above 0 kg/m")
    if not np.any(stiffness[:, [0, 1], [0, 1]]):
        stiffness[:, 0, 0] = stiffness[:, 1, 1] = np.inf
    return grid, stiffness, inertia


def _read_structure(node: Node, axis: _Axis, twist: PchipInterpolator) -> BeamStations:
    grid, stiffness, tables = beam_tables(node, ("K33", "K44", "K55", "K66", "i_edge", "i_flap"))
    _mend_flap_inertia(node, tables)
    inertia = _inertia(tables, "cm_x", "cm_y")
    if _chordwise_x(grid, stiffness):
        # a mirror image, under which forces swap and moments swap and change sign
        swap = np.zeros((6, 6))
        swap[[0, 1, 2], [1, 0, 2]] = 1.0
        swap[[3, 4, 5], [4, 3, 5]] = -1.0
        rigid = np.isinf(stiffness)
        stiffness = np.where(rigid, np.inf, swap @ np.where(rigid, 0.0, stiffness) @ swap.T)
        # i_edge and i_flap are named after the bending direction, not after an axis: they stay.
        inertia = _inertia(tables, "cm_y", "cm_x")
        node.notes.append(
            f"{node.path}: K55 > K44 along the outer blade, so the matrices are read with x to the trailing edge and y "
            "to the suction side, as windIO's schema describes them"
        )
    angle = -twist(grid)
    return BeamStations(axis.s(grid), turned(stiffness, angle), turned(inertia, angle))


def _mend_flap_inertia(node: Node, tables: dict[str, Array]) -> None:
    """Fill a flapwise inertia of nothing but zeros from the polar one, in place.

    Public files have, by a slip of the tool that wrote them, the edgewise inertia in the place of the product of
    inertia and nothing in that of the flapwise one. A flat section has i_plr = i_edge + i_flap.
    """
    if np.any(tables["i_flap"]) or np.any(tables["i_plr"] <= tables["i_edge"]):
        return
    tables["i_flap"] = tables["i_plr"] - tables["i_edge"]
    note = "all zero in the file, taken as i_plr - i_edge"
    if np.any(tables["i_cp"] ** 2 > tables["i_edge"] * tables["i_flap"]):
        tables["i_cp"] = np.zeros_like(tables["i_cp"])
        note += "; i_cp is larger than any section with these can have, 0 is used"
    node.note("inertia_matrix.i_flap", note)


def _chordwise_x(grid: Array, stiffness: Array) -> bool:
    """Whether bending about x is the softer one over the outer 70 %, that is, whether x runs along the chord."""
    outer = np.linspace(0.3, 1.0, 71)
    about_x, about_y = (np.interp(outer, grid, stiffness[:, k, k]) for k in (3, 4))
    return bool(np.mean(np.log(about_x / about_y)) < 0.0)


def _inertia(tables: dict[str, Array], x: str, y: str) -> Array:
    """Return the inertia (n, 6, 6) of tables whose centers of mass along x and y have these keys."""
    polar = tables["i_plr"] if np.any(tables["i_plr"]) else None
    mass, cm_x, cm_y, edge, flap, product = (tables[key] for key in ("mass", x, y, "i_edge", "i_flap", "i_cp"))
    return inertia_matrix(mass, cm_x, cm_y, edge, flap, product, polar)


def damping_ratio(node: Node, default: float) -> float:
    """Return ``structural_damping.damping_ratio`` (an addition to the schema) or the default.

    windIO's own ``mu`` is a stiffness-proportional coefficient; its modal damping differs from mode to mode and needs
    the frequencies, so it is not used.
    """
    words = f"{100 * default:g} % of critical assumed"
    return node.part("structural_damping").number_or("damping_ratio", 0.0, 0.5, default, words)


def require_straight(node: Node, points: Array, length: float) -> None:
    """Require a vertical axis, from its x and y (n, 2) [m]."""
    if np.any(np.abs(points) > 1e-6 * length):
        raise TurbineDefinitionError(f"{node.path}: x and y must be 0, only vertical towers can be computed")


KINEMATIC_VISCOSITY = 1.46e-5
"""Of air at 15 degrees Celsius [m^2/s]; only used to choose between tables at several Reynolds numbers."""

_BACKWARDS = 0.01  # parts of the chord that rounded tables may step back
_WITH_ROTATION = re.compile(r"\b(3-?D correction|rotational augmentation|stall delay) included\b", re.IGNORECASE)
_WITHOUT = re.compile(r"\bno (3-?D correction|rotational augmentation|stall delay)\b", re.IGNORECASE)
"""What descriptions of airfoils and polars say about the delay of stall by rotation; windIO has no entry for it."""


class AirfoilLibrary:
    """Airfoils of a file by name; converts each combination of airfoil, configuration and Reynolds number once."""

    def __init__(self, root: Node) -> None:
        self.path = root.where("airfoils")
        self.nodes: dict[str, Node] = {}
        for node in root.items("airfoils"):
            name = node.text("name")
            if name in self.nodes:
                raise fail(node.where("name"), name, "a name that occurs once")
            self.nodes[name] = node
        self._done: dict[tuple[object, ...], Airfoil] = {}

    def _node(self, entry: Node) -> Node:
        name = entry.text("name")
        if name not in self.nodes:
            raise fail(entry.where("name"), name, f"one of the names in {self.path}: {', '.join(sorted(self.nodes))}")
        return self.nodes[name]

    def thickness(self, entry: Node) -> float:
        """Return the relative thickness of the airfoil that an entry of the blade names."""
        return self._node(entry).number("rthick", 1e-3, 1.0)

    def rotating_polars(self, entries: list[Node]) -> bool | None:
        """Return whether the polars hold the delay of stall by rotation, None if no description says so.

        Parameters
        ----------
        entries : list of Node
            ``components.blade.outer_shape.airfoils``. The ``description`` of an airfoil or of a set of its polars tells
            by "rotational augmentation included" or "no rotational augmentation", also "3D correction" or "stall
            delay"; what one of them says holds for those that say nothing.
        """
        texts = []
        for entry in entries:
            node = self._node(entry)
            texts += [str(part.data.get("description", "")) for part in (node, *node.items("polars"))]
        if any(map(_WITH_ROTATION.search, texts)):
            return True
        return False if any(map(_WITHOUT.search, texts)) else None

    def airfoil(self, entry: Node, speed_chord: float) -> Airfoil:
        """Return the airfoil of an entry of the blade.

        Parameters
        ----------
        entry : Node
            ``components.blade.outer_shape.airfoils[i]``: name and, optionally, configurations with weights.
        speed_chord : float
            Speed times chord at this place in rated operation [m^2/s].
        """
        node = self._node(entry)
        sets = self._sets(entry, node, speed_chord / KINEMATIC_VISCOSITY)
        key = (node.path, tuple((chosen.path, weight) for chosen, weight in sets))
        if key not in self._done:
            self._done[key] = _airfoil(node, sets)
        return self._done[key]

    def _sets(self, entry: Node, node: Node, reynolds: float) -> list[tuple[Node, float]]:
        """Return the polar tables of an entry with their weights, at the Reynolds number nearest to ``reynolds``."""
        polars = node.items("polars")
        if not polars:
            raise fail(node.where("polars"), [], "at least one set of polars")
        if "configuration" not in entry:
            return [(_nearest(polars[0], reynolds), 1.0)]
        names = entry.data["configuration"]
        weights = entry.array("weight", len(names)) if "weight" in entry else np.full(len(names), 1.0 / len(names))
        if abs(weights.sum() - 1.0) > 1e-6:
            raise fail(entry.where("weight"), weights.tolist(), "weights with the sum 1")
        known = {polar.data.get("configuration"): polar for polar in polars}
        for name in names:
            if name not in known:
                raise fail(
                    entry.where("configuration"), name, f"one of {sorted(map(str, known))} of {node.path}.polars"
                )
        return [(_nearest(known[name], reynolds), float(w)) for name, w in zip(names, weights, strict=True)]


def _nearest(polar: Node, reynolds: float) -> Node:
    tables = polar.items("re_sets")
    if not tables:
        raise fail(polar.where("re_sets"), [], "at least one table")
    distance = [abs(np.log(max(table.number("re", 0.0, 1e12), 1.0) / max(reynolds, 1.0))) for table in tables]
    return tables[int(np.argmin(distance))]


def _airfoil(node: Node, sets: list[tuple[Node, float]]) -> Airfoil:
    contour = _contour(node.at("coordinates", "a mapping with x and y"))
    x, camber, _ = camber_line(contour)
    center = node.number("aerodynamic_center", 0.0, 1.0) if "aerodynamic_center" in node else 0.25
    total = 0.0
    polar: Polar | None = None
    for table, weight in sets:
        new = _polar(table, center)
        total += weight
        polar = new if polar is None else blend_polars(polar, new, weight / total if total > 0.0 else 0.0)
    with within(node.path):
        return Airfoil(node.text("name"), node.number("rthick", 1e-3, 1.0), contour, x, camber, cast(Polar, polar))


def _contour(node: Node) -> Array:
    """Return the contour (n, 2), suction side first, with x/c running from 0 to 1."""
    x = node.array("x")
    y = node.array("y", x.size)
    if x.size < 5:
        raise fail(node.where("x"), f"{x.size} points", "at least 5 points")
    if x.min() > 0.02 or x.max() < 0.98:
        raise fail(node.where("x"), [float(x.min()), float(x.max())], "x/c from 0 (leading edge) to 1 (trailing edge)")
    nose = int(np.argmin(x))
    if not 0 < nose < x.size - 1:
        raise fail(node.where("x"), "a contour that starts at the leading edge", "a start at the trailing edge")
    steps = np.diff(x) * np.where(np.arange(x.size - 1) < nose, -1.0, 1.0)
    if steps.min() < -_BACKWARDS:
        i = int(np.argmin(steps)) + 1
        allowed = "points in order, from the trailing edge around the leading edge and back"
        raise fail(f"{node.where('x')}[{i}]", float(x[i]), allowed)
    return suction_first(np.column_stack((x, y)))


def _polar(table: Node, center: float) -> Polar:
    """Return one polar on the union of the three angle grids, its moment moved from ``center`` to the quarter chord.

    With the normal force c_n = c_l cos(alpha) + c_d sin(alpha) acting at x/c = ``center``,
    c_m(1/4) = c_m(center) - c_n (center - 1/4).
    """
    curves = {}
    for key in ("cl", "cd", "cm"):
        curve = table.at(key, "a mapping with grid and values")
        angle = curve.array("grid")
        check_array(curve.where("grid"), angle, "n", ascending=2)
        if angle[0] > -180.0 + 1e-6 or angle[-1] < 180.0 - 1e-6:
            allowed = "angles of attack from -180 to 180 deg"
            raise fail(curve.where("grid"), [float(angle[0]), float(angle[-1])], allowed)
        values = curve.array("values", angle.size)
        if key == "cd" and (i := driving_drag(np.radians(angle), values)) is not None:
            raise fail(f"{curve.where('values')}[{i}]", float(values[i]), DRAG_ALLOWED)
        curves[key] = (angle, values)
    degrees = np.unique(np.concatenate([curve[0] for curve in curves.values()]))
    cl, cd, cm = (np.interp(degrees, *curves[key]) for key in ("cl", "cd", "cm"))
    alpha = np.radians(degrees)
    normal = cl * np.cos(alpha) + cd * np.sin(alpha)
    with within(table.path):
        return Polar(alpha, cl, cd, cm - normal * (center - 0.25))
