"""The tower of a windIO file, from its table of section properties or from its shell of walls.

windIO's tower frame: x parallel to the ground downwind, z up, y to the left. Section matrices use the same axes, so K44
(bending about x) is side-side and K55 fore-aft.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.turbines.beam import BeamStations, inertia_matrix
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.model import Support, Tower
from wt_gym.turbines.source import Node, within
from wt_gym.turbines.windio_blade import beam_tables, damping_ratio, require_straight

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["DEFAULT_TOWER_DAMPING", "read_support", "read_tower", "shell_sections"]

DEFAULT_TOWER_DAMPING = 0.01
"""Modal damping of the NREL 5-MW and IEA 15-MW towers."""

POISSON_RATIO = 0.3
"""Of steel; only used where a table leaves out the torsional stiffness."""


def read_tower(root: Node, notes: list[str]) -> Tower:
    """Build the tower, clamped at the start of its reference axis.

    Parameters
    ----------
    root : Node
        Top level of the file.
    notes : list of str
        Receives a sentence for every assumption.

    Returns
    -------
    Tower

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is missing, inconsistent or out of range.
    """
    node = root.at("components.tower")
    base, height = _heights(node.at("reference_axis"))
    shape = node.at("outer_shape")
    grid, diameter = shape.distribution("outer_diameter")
    cd = shape.distribution("cd")[1]
    if np.any(diameter <= 0.0):
        raise fail(shape.where("outer_diameter.values"), float(diameter.min()), "diameters above 0 m")
    if np.ptp(cd) > 1e-9:
        notes.append(f"{shape.where('cd')}: varies along the tower, its mean {cd.mean():g} is used")
    for support in ("monopile", "jacket", "floating_platform"):
        if support in root.at("components"):
            how = "left out (load_turbine takes a water_depth)" if support == "monopile" else "not modeled"
            notes.append(f"components.{support}: {how}, the tower is clamped at its base, {base:g} m up")
    length = height - base
    structure = node.at("structure", "a mapping with elastic_properties or layers")
    if "elastic_properties" in structure:
        elastic = structure.at("elastic_properties")
        with within(elastic.path):
            sections = _from_table(elastic, length, (grid, diameter), notes)
        damping = damping_ratio(elastic, DEFAULT_TOWER_DAMPING, notes)
    else:
        sections = shell_sections(root, structure, length, (grid, diameter))
        damping = DEFAULT_TOWER_DAMPING
        notes.append(f"{structure.path}: no structural_damping, {100 * damping:g} % of critical assumed")
    with within(node.path):
        return Tower(base, height, grid * length, diameter, sections, damping, float(cd.mean()))


def read_support(
    root: Node, tower: Tower, water_depth: float, foundation: NDArray[np.float64] | None, notes: list[str]
) -> Support:
    """Build the monopile under a tower, from the sea bed up.

    Its sections are those of its walls where the file gives them, else of its table. What lies below the sea bed is
    left out: the ground holds the pile there, rigidly or by a foundation's stiffness.

    Parameters
    ----------
    root : Node
        Top level of the file.
    tower : Tower
    water_depth : float
        [m]; files of turbines do not say where the sea bed lies.
    foundation : ndarray (6, 6) or None
        See `Support`.
    notes : list of str
        Receives a sentence for every assumption.

    Returns
    -------
    Support

    Raises
    ------
    TurbineDefinitionError
        If the file has no monopile, the tower does not stand on it, or the sea bed lies outside of it.
    """
    if "monopile" not in root.at("components"):
        raise fail("water_depth", water_depth, "None for a turbine whose file has no components.monopile")
    node = root.at("components.monopile")
    start, top = _heights(node.at("reference_axis"))
    if abs(top - tower.base_height) > 1e-3:
        allowed = f"a monopile that ends at the base of the tower, {tower.base_height:g} m up"
        raise fail(node.where("reference_axis.z"), top, allowed)
    allowed = f"depths from 0 to the {-start:g} m where the monopile begins"
    if not 0.0 <= check_number("water_depth", water_depth, 0.0, 500.0) <= -start:
        raise fail("water_depth", water_depth, allowed)
    length = top - start
    grid, diameter = node.at("outer_shape").distribution("outer_diameter")
    structure = node.at("structure", "a mapping with layers or elastic_properties")
    if "layers" in structure:
        whole = shell_sections(root, structure, length, (grid, diameter))
    else:
        elastic = structure.at("elastic_properties")
        with within(elastic.path):
            whole = _from_table(elastic, length, (grid, diameter), notes)
    buried = -water_depth - start
    station = np.concatenate([[0.0], whole.station[whole.station > buried + 1e-6] - buried])
    wall = np.concatenate([[0.0], grid[grid * length > buried + 1e-6] * length - buried])
    mass = node.number("transition_piece_mass", 0.0, 1e8) if "transition_piece_mass" in node else 0.0
    notes.append(
        f"components.monopile: stands on the sea bed {water_depth:g} m deep; its {buried:g} m below are left out"
    )
    with within(node.path):
        return Support(
            -water_depth,
            wall,
            np.interp(wall + buried, grid * length, diameter),
            BeamStations(station, whole.stiffness_at(station + buried), whole.inertia_at(station + buried)),
            foundation,
            mass,
        )


def _heights(axis: Node) -> tuple[float, float]:
    grid_z, z = axis.distribution("z")
    length = float(z[-1] - z[0])
    if np.any(np.diff(z) <= 0.0) or np.any(np.abs(z - z[0] - grid_z * length) > 1e-3 * length):
        raise fail(axis.where("z"), z.tolist(), "heights that ascend in proportion to the grid")
    for key in ("x", "y"):
        require_straight(axis, axis.distribution(key)[1], length)
    return float(z[0]), float(z[-1])


def _from_table(
    node: Node, length: float, diameter: tuple[NDArray[np.float64], NDArray[np.float64]], notes: list[str]
) -> BeamStations:
    """Section properties from ``elastic_properties``; gaps are filled with those of a thin tube of that diameter."""
    grid, stiffness, tables = beam_tables(node, ("K44", "K55"))
    d = np.interp(grid, *diameter)
    bending = 0.5 * (stiffness[:, 3, 3] + stiffness[:, 4, 4])
    # A thin tube of diameter D: I = A D^2/8, J = 2 I, so that EA = 8 EI/D^2 and GJ = EI/(1 + nu).
    for key, k, value in (("K33", 2, 8.0 * bending / d**2), ("K66", 5, bending / (1.0 + POISSON_RATIO))):
        if not np.any(stiffness[:, k, k]):
            stiffness[:, k, k] = value
            notes.append(f"{node.path}.stiffness_matrix.{key}: not in the file, taken from K44, K55 as for a thin tube")
    ring = tables["mass"] * d**2 / 8.0
    if not np.any(tables["i_edge"]) or not np.any(tables["i_flap"]):
        tables["i_edge"], tables["i_flap"] = ring, ring
        notes.append(f"{node.path}.inertia_matrix: no section inertias, those of a thin tube are used")
    inertia = inertia_matrix(
        tables["mass"], tables["cm_x"], tables["cm_y"], tables["i_edge"], tables["i_flap"], tables["i_cp"]
    )
    return BeamStations(grid * length, stiffness, inertia)


def shell_sections(
    root: Node, structure: Node, length: float, diameter: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> BeamStations:
    """Return the section properties of a tower given as layers of isotropic walls.

    The first layer lies outside; each further one inside the one before. Euler-Bernoulli sections with area
    A = pi (ro^2 - ri^2), I = pi/4 (ro^4 - ri^4), J = 2 I. The outfitting factor multiplies mass and inertia.

    Parameters
    ----------
    root : Node
        Top level of the file (for its materials).
    structure : Node
        ``components.tower.structure``.
    length : float
        [m].
    diameter : tuple of ndarray
        Grid (n,) and outer diameter (n,) [m].

    Returns
    -------
    BeamStations

    Raises
    ------
    TurbineDefinitionError
        If layers or materials are missing, not isotropic, or thicker than the tower.
    """
    layers = structure.items("layers")
    if not layers:
        raise fail(structure.where("layers"), [], "at least one wall")
    walls = [layer.distribution("thickness") for layer in layers]
    grid = np.unique(np.concatenate([diameter[0], *(wall[0] for wall in walls)]))
    outer = 0.5 * np.interp(grid, *diameter)
    axial, bending, torsion, mass, rotary = (np.zeros(grid.size) for _ in range(5))
    for layer, wall in zip(layers, walls, strict=True):
        inner = outer - np.interp(grid, *wall)
        if np.any(inner < 0.0) or np.any(inner > outer):
            raise fail(layer.where("thickness.values"), wall[1].tolist(), "thicknesses from 0 to the radius inside")
        young, shear, density = _material(root, layer)
        area = np.pi * (outer**2 - inner**2)
        second = 0.25 * np.pi * (outer**4 - inner**4)
        axial += young * area
        bending += young * second
        torsion += shear * 2.0 * second
        mass += density * area
        rotary += density * second
        outer = inner
    if np.any(mass <= 0.0):
        raise fail(structure.where("layers"), "a wall of no thickness", "walls along the whole tower")
    factor = structure.number("outfitting_factor", 1.0, 2.0) if "outfitting_factor" in structure else 1.0
    stiffness = np.zeros((grid.size, 6, 6))
    diagonal: tuple[float | NDArray[np.float64], ...] = (np.inf, np.inf, axial, bending, bending, torsion)
    for k, value in enumerate(diagonal):
        stiffness[:, k, k] = value
    inertia = inertia_matrix(factor * mass, 0.0, 0.0, factor * rotary, factor * rotary, 0.0)
    return BeamStations(grid * length, stiffness, inertia)


def _material(root: Node, layer: Node) -> tuple[float, float, float]:
    """Return Young's modulus, shear modulus [Pa] and density [kg/m^3] of the isotropic material of a layer."""
    name = layer.text("material")
    materials = {node.data.get("name"): node for node in root.items("materials")}
    if name not in materials:
        raise fail(layer.where("material"), name, f"one of the materials: {', '.join(sorted(map(str, materials)))}")
    node = materials[name]
    if node.data.get("orth") != 0:
        raise fail(node.where("orth"), node.data.get("orth"), "0 (isotropic) for the wall of a tower")
    young = node.number("E", 1e6, 1e13)
    shear = node.number("G", 1e6, 1e13) if "G" in node else young / (2.0 * (1.0 + node.number("nu", -1.0, 0.5)))
    return young, shear, node.number("rho", 1.0, 20000.0)
