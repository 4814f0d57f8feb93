"""The airfoils of a windIO file: contours, camber lines and polars."""

import re
from typing import cast

import numpy as np
from numpy.typing import NDArray

from wt_gym.turbines.airfoil import DRAG_ALLOWED, Airfoil, Polar, blend_polars, camber_line, driving_drag
from wt_gym.turbines.checks import check_ascending, fail
from wt_gym.turbines.source import Node, within

__all__ = ["AirfoilLibrary"]

KINEMATIC_VISCOSITY = 1.46e-5
"""Of air at 15 degrees Celsius [m^2/s]; only used to choose between tables at several Reynolds numbers."""

_BACKWARDS = 0.01  # parts of the chord that rounded tables may step back
_WITH_ROTATION = re.compile(r"\b(3-?D correction|rotational augmentation|stall delay) included\b", re.IGNORECASE)
_WITHOUT = re.compile(r"\bno (3-?D correction|rotational augmentation|stall delay)\b", re.IGNORECASE)
"""What descriptions of airfoils and polars say about the delay of stall by rotation; windIO has no entry for it."""


class AirfoilLibrary:
    """Airfoils of a file by name; converts each combination of airfoil, configuration and Reynolds number once.

    Parameters
    ----------
    root : Node
        Top level of the file.

    Raises
    ------
    TurbineDefinitionError
        If the list is missing, or an airfoil has no name or two have the same.
    """

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

        Raises
        ------
        TurbineDefinitionError
            If the name, a configuration, a polar or the contour is missing or wrong.
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


def _contour(node: Node) -> NDArray[np.float64]:
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
    contour = np.column_stack(((x - x.min()) / (x.max() - x.min()), y))
    # Shoelace formula: counter-clockwise (suction side first) has a positive area.
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return contour if area > 0.0 else contour[::-1].copy()


def _polar(table: Node, center: float) -> Polar:
    """Return one polar on the union of the three angle grids, its moment moved from ``center`` to the quarter chord.

    With the normal force c_n = c_l cos(alpha) + c_d sin(alpha) acting at x/c = ``center``,
    c_m(1/4) = c_m(center) - c_n (center - 1/4).
    """
    curves = {}
    for key in ("cl", "cd", "cm"):
        curve = table.at(key, "a mapping with grid and values")
        angle = curve.array("grid")
        check_ascending(curve.where("grid"), angle)
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
