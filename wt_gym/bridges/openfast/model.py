"""A turbine as an OpenFAST model of version 5: ElastoDyn, AeroDyn with polars, ServoDyn, InflowWind.

The files are written from templates, into which the values of a turbine are put. The PyPI package ``openfast_io`` does
not serve here: its writer puts out what its reader has read, needs the several hundred entries of a whole model for it,
and makes neither mode shapes nor tables of sections and polars from the numbers of a turbine, which is all the work
there is.

ElastoDyn's blade and tower are beams that bend in two planes and do nothing else. Their mode shapes are polynomials
that vanish with their slope at the clamped end and are one at the free end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.bridges.openfast.water import FILES, write_water
from wt_gym.turbines import Polar, Turbine
from wt_gym.turbines.blade import bending_matrices, principal_bending
from wt_gym.turbines.openfast_text import write_from_template, write_lines
from wt_gym.turbines.variants import clockwise_image, rotor_inertia_without_generator

PRIMARY = "turbine.fst"
"""Name of the primary file of a model that is written here."""

_RPM = math.pi / 30.0
_AERO_NODES = 36
_LONGEST_STEP = 0.0125  # Of the NREL 5-MW, at 4.95 s a turn [s]
_STEPS_A_TURN = 396
_MOST_ADVANCE = 0.8
"""Of the phase of the fastest swing in a step [rad]: ElastoDyn's predictor-corrector is unstable at twice that."""
_STIFFEST_SHAFT = 8.0
"""Torsional frequency of a drivetrain above which it is rigid [Hz], as in `wt_gym.simulation.Fidelity`."""
_POLAR_ROWS = 200  # AeroDyn's tables may be longer; beyond it they are thinned where they are straight
_NO_FILE = "unused"


def time_step_of(turbine: Turbine) -> float:
    """Longest step of OpenFAST for a turbine [s]."""
    step = min(_LONGEST_STEP, 2.0 * math.pi / turbine.drivetrain.rated_rotor_speed / _STEPS_A_TURN)
    if not _yaws(turbine):
        return step
    # the nacelle alone on the spring of the yaw drive: the blades do not follow its fast swings
    return min(step, _MOST_ADVANCE * math.sqrt(_yaw_inertia(turbine) / turbine.nacelle.yaw_spring))


def steps_of(interval: float, longest: float) -> int:
    """How many steps of OpenFAST of no more than a length [s] make an interval [s]."""
    return max(1, math.ceil(interval / longest - 1e-6))


def _yaws(turbine: Turbine) -> bool:
    """Whether the nacelle turns, and then on its spring: without a drive it is fixed to the tower."""
    return turbine.nacelle.max_yaw_rate > 0.0


def _yaw_inertia(turbine: Turbine) -> float:
    """Inertia of the nacelle about the yaw axis [kg m²] (NacYIner)."""
    nacelle = turbine.nacelle
    return float(nacelle.inertia[2, 2] + nacelle.mass * (nacelle.cm[0] ** 2 + nacelle.cm[1] ** 2))


def write_model(turbine: Turbine, folder: str | Path) -> Path:
    """Write a turbine as an OpenFAST model, ready for OpenFAST 5.

    The blade bends flapwise and edgewise and does not twist (ElastoDyn), its sections have the polars of the turbine
    (AeroDyn, blade elements with dynamic inflow, quasi-steady sections), the tower is clamped at its base. A rotor that
    turns counter-clockwise is written as its mirror image, which turns clockwise: OpenFAST 5.0 has no other. A platform
    floats in still water (HydroDyn) on lines of MoorDyn.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there; files of the same names in it are replaced.

    Returns
    -------
    Path
        Of the primary file.

    Raises
    ------
    TurbineDefinitionError
        For what ElastoDyn has no form of: rotors of one blade or more than three, towers on a monopile.
    """
    if turbine.n_blades not in (2, 3):
        raise TurbineDefinitionError(f"{turbine.name}: n_blades must be 2 or 3 for OpenFAST, got {turbine.n_blades}")
    if turbine.ice is not None:
        raise TurbineDefinitionError(f"{turbine.name}: ice must be None for OpenFAST, got {turbine.ice!r}")
    image = clockwise_image(turbine)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _write_primary(image, folder)
    _write_elastodyn(image, folder)
    _write_elastodyn_blade(image, folder)
    _write_elastodyn_tower(image, folder)
    _write_aerodyn(image, folder)
    _write_servodyn(image, folder)
    if image.floater is not None:
        write_water(image.floater, folder)
    write_inflow(folder / "inflowwind.dat", {"HWindSpeed": 10.0, "RefHt": image.hub_height})
    return folder / PRIMARY


def _write_primary(turbine: Turbine, folder: Path) -> None:
    floater = turbine.floater
    # the coupled motion of a heavy platform needs more iterations, each to less
    density, depth, tolerance, iterations, files = 1025.0, 0.0, 1e-4, 6, dict.fromkeys(FILES, _NO_FILE)
    if floater is not None:
        density, depth, tolerance, iterations, files = floater.water_density, floater.water_depth, 1e-3, 40, FILES
    wet = int(floater is not None)
    write_from_template(folder / PRIMARY, f"OpenFAST model of {turbine.name}", {
        "DT": time_step_of(turbine), "ConvTol": tolerance, "MaxConvIter": iterations, "CompSeaSt": wet,
        "CompHydro": wet, "CompMooring": 3 * wet, "Gravity": GRAVITY, "AirDens": turbine.air_density,
        "WtrDens": density, "WtrDpth": depth, **files,
    })  # fmt: skip


def _write_elastodyn(turbine: Turbine, folder: Path) -> None:
    nacelle, hub, train, tower = turbine.nacelle, turbine.hub, turbine.drivetrain, turbine.tower
    floater = turbine.floater
    mass, center, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if floater is not None:
        mass, center, inertia = floater.mass, floater.center, floater.inertia
    moments = inertia[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]].tolist()
    write_from_template(folder / "elastodyn.dat", "ELASTODYN INPUT FILE", {
        "DrTrDOF": _shaft_frequency(turbine) < _STIFFEST_SHAFT, "YawDOF": _yaws(turbine),
        **{f"Ptfm{name}DOF": floater is not None for name in ("Sg", "Sw", "Hv", "R", "P", "Y")},
        "RotSpeed": train.rated_rotor_speed / _RPM,
        "NumBl": turbine.n_blades, "TipRad": hub.radius + turbine.blade.length, "HubRad": hub.radius,
        **{f"PreCone({i})": -math.degrees(hub.cone) for i in (1, 2, 3)}, "HubCM": hub.cm_offset_along_shaft,
        "OverHang": -nacelle.overhang, "ShftTilt": -math.degrees(nacelle.tilt),
        **{f"NacCM{axis}n": float(value) for axis, value in zip("xyz", nacelle.cm, strict=True)},
        "Twr2Shft": nacelle.tower_top_to_shaft, "TowerHt": tower.height, "TowerBsHt": tower.base_height,
        **{f"PtfmCM{axis}t": value for axis, value in zip("xyz", center.tolist(), strict=True)},
        "HubMass": hub.mass, "HubIner": hub.inertia_axial, "HubIner_Teeter": hub.inertia_transverse,
        "GenIner": train.generator_inertia, "NacMass": nacelle.mass, "NacYIner": _yaw_inertia(turbine),
        "YawBrMass": nacelle.yaw_bearing_mass, "PtfmMass": mass,
        **{f"Ptfm{name}Iner": value for name, value in zip(("R", "P", "Y", "XY", "YZ", "XZ"), moments, strict=True)},
        "GBoxEff": 100.0 * train.gearbox_efficiency, "GBRatio": train.gear_ratio, "DTTorSpr": train.spring,
        "DTTorDmp": train.damper,
    })  # fmt: skip


def _write_elastodyn_blade(turbine: Turbine, folder: Path) -> None:
    sections, percent = blade_sections(turbine), 100.0 * turbine.blade.damping_ratio
    table = zip(sections.fraction, np.degrees(sections.twist), sections.mass, sections.flap, sections.edge, strict=True)
    shapes = {"BldFl1Sh": sections.flap_shapes[0], "BldFl2Sh": sections.flap_shapes[1], "BldEdgSh": sections.edge_shape}
    values = dict.fromkeys(("BldFlDmp(1)", "BldFlDmp(2)", "BldEdDmp(1)"), percent)
    write_from_template(
        folder / "elastodyn_blade.dat",
        "ELASTODYN INDIVIDUAL BLADE INPUT FILE",
        {"NBlInpSt": sections.fraction.size, **values},
        {"sections": map(_row, table), "mode shapes": _shapes(shapes)},
    )


def _write_elastodyn_tower(turbine: Turbine, folder: Path) -> None:
    sections, percent = tower_sections(turbine), 100.0 * turbine.tower.damping_ratio
    table = zip(sections.fraction, sections.mass, sections.fore_aft, sections.side_side, strict=True)
    values = {f"Twr{plane}Dmp({k})": percent for plane in ("FA", "SS") for k in (1, 2)}
    write_from_template(
        folder / "elastodyn_tower.dat",
        "ELASTODYN TOWER INPUT FILE",
        {"NTwInpSt": sections.fraction.size, **values},
        {
            "sections": map(_row, table),
            "fore-aft shapes": _shapes(dict(zip(("TwFAM1Sh", "TwFAM2Sh"), sections.fore_aft_shapes, strict=True))),
            "side-side shapes": _shapes(dict(zip(("TwSSM1Sh", "TwSSM2Sh"), sections.side_side_shapes, strict=True))),
        },
    )


def _write_aerodyn(turbine: Turbine, folder: Path) -> None:
    z = _aero_nodes(turbine)
    names = [f"polars/node_{i + 1:02d}.dat" for i in range(z.size)]
    _write_aerodyn_blade(turbine, folder, z)
    (folder / "polars").mkdir(exist_ok=True)
    for name, position in zip(names, z, strict=True):
        _write_polar(folder / name, turbine.blade.polar_at(float(position)))
    tower = turbine.tower
    elevation = np.linspace(0.0, tower.length, 11)
    sections = [
        _row((tower.base_height + e, float(tower.diameter_at(e)), tower.drag_coefficient, 0.1, 0.0, 0.0, 0.0))
        for e in elevation
    ]
    write_from_template(
        folder / "aerodyn.dat",
        "AERODYN INPUT FILE",
        {"NumAFfiles": len(names), "NumTwrNds": elevation.size},
        {"further polars": [f'"{name}"' for name in names[1:]], "tower sections": sections},
    )


def _write_aerodyn_blade(turbine: Turbine, folder: Path, z: np.ndarray) -> None:
    """Places of the aerodynamic centers, a quarter of the chord behind the leading edge on the chord line."""
    blade = turbine.blade
    chord, twist, axis = blade.chord_at(z), blade.twist_at(z), blade.axis_at(z)
    behind = (0.25 - blade.le_offset_at(z)) * chord
    above = np.interp(z, blade.aero_station, np.asarray(blade.normal_offset)) * chord
    curve = axis[:, 0] + above * np.cos(twist) + behind * np.sin(twist)
    sweep = axis[:, 1] - above * np.sin(twist) + behind * np.cos(twist)
    angle = np.degrees(np.arctan(np.gradient(axis[:, 0], z)))
    names = "BlSpn BlCrvAC BlSwpAC BlCrvAng BlTwist BlChord BlAFID t_c BlCb BlCenBn BlCenBt BlCpn BlCpt BlCan BlCat"
    units = "(m) (m) (m) (deg) (deg) (m) (-) (-) (-) (m) (m) (-) (-) (-) (-) (-)"
    rows = [
        f"{_row((z[i], curve[i], sweep[i], angle[i], math.degrees(twist[i]), chord[i]))} {i + 1:4d}"
        f" {_row([0.25] + [0.0] * 8)}"
        for i in range(z.size)
    ]
    write_lines(folder / "aerodyn_blade.dat", "AERODYN BLADE DEFINITION INPUT FILE", [
        "======  Blade Properties", ("NumBlNds", z.size), f"{names} BlCam", units, *rows,
    ])  # fmt: skip


def _write_polar(path: Path, polar: Polar) -> None:
    alpha = _table_angles(polar)
    cl, cd, cm = polar.coefficients(alpha)
    # both ends are one angle
    cl[-1], cd[-1], cm[-1] = cl[0], cd[0], cm[0]
    rows = [_row(values) for values in zip(np.degrees(alpha), cl, cd, cm, strict=True)]
    lines = [
        "! AirfoilInfo, written by wt_gym",
        "1            InterpOrd     ! Interpolation order",
        "1            NonDimArea    ! area/chord^2",
        "0            NumCoords     ! coordinates",
        '"unused"     BL_file       ! boundary layer',
        "1            NumTabs       ! tables",
        "1.0          Re            ! Reynolds number in millions",
        "0            UserProp      ! control setting",
        "False        InclUAdata    ! unsteady parameters",
        f"{len(rows):<12d} NumAlf        ! rows",
        "!    Alpha      Cl      Cd        Cm",
        "!    (deg)      (-)     (-)       (-)",
        *rows,
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_servodyn(turbine: Turbine, folder: Path) -> None:
    nacelle, pitch, train = turbine.nacelle, turbine.pitch, turbine.drivetrain
    least, most, rate = (math.degrees(value) for value in (pitch.min_pitch, pitch.max_pitch, pitch.max_rate))
    write_from_template(folder / "servodyn.dat", "SERVODYN INPUT FILE", {
        **{f"PitManRat({i})": rate for i in (1, 2, 3)}, "GenEff": 100.0 * train.generator_efficiency,
        "YawSpr": nacelle.yaw_spring, "YawDamp": nacelle.yaw_damper,
        "YawManRat": math.degrees(nacelle.max_yaw_rate) or 0.3,
        "Ptch_Min": least, "Ptch_Max": most, "PtchRate_Min": -rate, "PtchRate_Max": rate,
    })  # fmt: skip


def write_inflow(path: Path, values: Mapping[str, object]) -> None:
    """Write an input file of InflowWind with values of keywords in place of the usual ones."""
    write_from_template(path, "InflowWind INPUT FILE", values)


def _aero_nodes(turbine: Turbine) -> np.ndarray:
    """Nodes of AeroDyn [m]: the stations of the planform, where these are not too many."""
    stations = turbine.blade.aero_station
    return stations if stations.size <= _AERO_NODES else np.linspace(0.0, turbine.blade.length, _AERO_NODES)


def _table_angles(polar: Polar) -> np.ndarray:
    """Angles of a polar's table, no more than AeroDyn's usual tables have: all near attached flow, some elsewhere."""
    alpha = np.clip(polar.alpha, -np.pi, np.pi)
    alpha[0], alpha[-1] = -np.pi, np.pi
    if alpha.size <= _POLAR_ROWS:
        return alpha
    near = np.abs(alpha) < math.radians(30.0)
    far = np.flatnonzero(~near)
    kept = far[:: max(1, far.size // (_POLAR_ROWS // 2))]
    chosen = np.unique(np.concatenate([[0, alpha.size - 1], np.flatnonzero(near), kept]))
    table: Array = alpha[chosen]
    return table


def _shaft_frequency(turbine: Turbine) -> float:
    """Frequency at which rotor and generator swing against each other [Hz]."""
    train = turbine.drivetrain
    rotor = rotor_inertia_without_generator(turbine.blade, turbine.hub, turbine.n_blades)
    generator = train.generator_inertia * train.gear_ratio**2
    return math.sqrt(train.spring * (1.0 / rotor + 1.0 / max(generator, 1e-9))) / (2.0 * math.pi)


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{float(value): .9e}" for value in values)


def _shapes(shapes: Mapping[str, np.ndarray]) -> list[tuple[str, object]]:
    """Coefficients of mode shapes by the names of the shapes."""
    return [
        (f"{name}({power})", float(value))
        for name, coefficients in shapes.items()
        for power, value in zip(range(2, 7), coefficients, strict=True)
    ]


_MOST_STATIONS = 60


@dataclass(frozen=True)
class BladeSections:
    """ElastoDyn's blade.

    Attributes
    ----------
    fraction, twist, mass, flap, edge : ndarray (n,)
        Place from 0 to 1 (BlFract), twist of the axes of bending [rad] (StrcTwst), mass [kg/m] and stiffness [N m²].
    flap_shapes, edge_shape : ndarray (2, 5), (5,)
    frequencies : ndarray (3,)
        Flap 1, flap 2, edge 1 of the blade without twist, turning at rated speed [Hz].
    """

    fraction: Array
    twist: Array
    mass: Array
    flap: Array
    edge: Array
    flap_shapes: Array
    edge_shape: Array
    frequencies: Array


@dataclass(frozen=True)
class TowerSections:
    """ElastoDyn's tower.

    Attributes
    ----------
    fraction, mass, fore_aft, side_side : ndarray (n,)
        Place from 0 to 1 (HtFract), mass [kg/m] and stiffness [N m²].
    fore_aft_shapes, side_side_shapes : ndarray (2, 5)
    frequencies : ndarray (4,)
        Fore-aft 1, 2 and side-side 1, 2 under a rigid rotor and nacelle [Hz].
    """

    fraction: Array
    mass: Array
    fore_aft: Array
    side_side: Array
    fore_aft_shapes: Array
    side_side_shapes: Array
    frequencies: Array


def blade_sections(turbine: Turbine) -> BladeSections:
    """Sections and mode shapes of the blade.

    The bending stiffness is that of a section on which neither an axial force nor a torque acts; its principal axes
    give the structural twist. Mass and stiffness of a curved blade are laid out along z: the mass is kept, the twist
    and the offsets of the centers of mass are lost.
    """
    blade = turbine.blade
    z = _thinned(np.interp(blade.structure.station, blade.axis_station, blade.axis[:, 2]), blade.length)
    station = np.interp(z, blade.axis[:, 2], blade.axis_station)
    stretch = np.gradient(station, z)
    mass = blade.structure.inertia_at(station)[:, 0, 0] * stretch
    flap, edge, twist = principal_bending(bending_matrices(blade.structure, station), blade.twist_at(z))
    radius, speed = turbine.hub.radius + z, turbine.drivetrain.rated_rotor_speed
    outboard = _from_the_end(z, mass * radius)
    shapes, flaps = bending_shapes(z, mass, flap, 2, pull=speed**2 * outboard)
    edges, edge_1 = bending_shapes(z, mass, edge, 1, pull=speed**2 * outboard)
    in_plane = np.sqrt(max(edge_1[0] ** 2 - (speed / (2.0 * np.pi)) ** 2, 0.0))  # the centrifugal force softens it
    return BladeSections(z / blade.length, twist, mass, flap, edge, shapes, edges[0], np.array([*flaps, in_plane]))


def tower_sections(turbine: Turbine) -> TowerSections:
    """Sections and mode shapes of the tower, under the weight of what stands on it."""
    tower = turbine.tower
    if tower.support is not None:
        raise TurbineDefinitionError(
            f"{turbine.name}: the tower stands on a monopile; a model is written for towers clamped at their base, "
            "give a model of your own (model='turbine.fst')"
        )
    station = _thinned(tower.structure.station, tower.length)
    mass = tower.structure.inertia_at(station)[:, 0, 0]
    bending = bending_matrices(tower.structure, station)
    fore_aft, side_side = bending[:, 1, 1], bending[:, 0, 0]
    body = _top_body(turbine)
    weight = GRAVITY * (body.mass + _from_the_end(station, mass))
    first, slow = bending_shapes(station, mass, fore_aft, 2, pull=-weight, top=body)
    second, slower = bending_shapes(station, mass, side_side, 2, pull=-weight, top=body)
    frequencies = np.concatenate([slow, slower])
    return TowerSections(station / tower.length, mass, fore_aft, side_side, first, second, frequencies)


def _top_body(turbine: Turbine) -> TopBody:
    """Rotor and nacelle as one rigid body on the tower."""
    nacelle, hub, n = turbine.nacelle, turbine.hub, turbine.n_blades
    m0, m1, m2 = (turbine.blade.structure.mass_moment(k) for k in range(3))
    radius = hub.radius
    rotor = n * m0 + hub.mass
    shaft = nacelle.tower_top_to_shaft + nacelle.overhang * np.sin(nacelle.tilt)
    disc = 0.5 * n * (m2 + 2.0 * radius * m1 + radius**2 * m0) + hub.inertia_transverse
    mass = rotor + nacelle.mass + nacelle.yaw_bearing_mass
    height = (rotor * shaft + nacelle.mass * nacelle.cm[2]) / mass
    about = disc + rotor * (shaft - height) ** 2 + nacelle.inertia[1, 1]
    about += nacelle.mass * (nacelle.cm[2] - height) ** 2 + nacelle.yaw_bearing_mass * height**2
    return TopBody(float(mass), float(height), float(about))


def _from_the_end(x: Array, density: Array) -> Array:
    """Integral of a density from each point to the end, exact for one that is linear between the points."""
    parts = 0.5 * (density[1:] + density[:-1]) * np.diff(x)
    return np.append(np.cumsum(parts[::-1])[::-1], 0.0)


def _thinned(points: Array, length: float) -> Array:
    """Stations of a table, no more than ElastoDyn's tables comfortably hold, from 0 to the length."""
    points = np.unique(np.round(points, 9))
    if points.size > _MOST_STATIONS:
        points = np.linspace(0.0, length, _MOST_STATIONS)
    points[0], points[-1] = 0.0, length
    return points


POWERS = np.arange(2, 7)
"""Powers of the relative height in ElastoDyn's shapes."""
_POINTS = 2000


class TopBody(NamedTuple):
    """Rigid body on the free end of a beam."""

    mass: float  #: [kg].
    height: float  #: Of its center of mass above the end of the beam [m].
    inertia: float  #: About the axis of bending through the center of mass [kg m²].


def bending_shapes(
    station: ArrayLike,
    mass: ArrayLike,
    stiffness: ArrayLike,
    count: int,
    *,
    pull: ArrayLike | None = None,
    top: TopBody | None = None,
) -> tuple[Array, Array]:
    """Lowest modes of a clamped Euler-Bernoulli beam in the space of ElastoDyn's polynomials.

    The modes are those of the Rayleigh-Ritz method with the functions x², …, x⁶, x = s/L: the best that ElastoDyn can
    represent, so that no fit follows. With the axial force N its potential is ½ ∫ (EI w''² + N w'²) ds.

    Parameters
    ----------
    station : array (n,)
        Distance from the clamped end [m], from 0 on; properties are linear between.
    mass : array (n,)
        Per length [kg/m].
    stiffness : array (n,)
        Bending stiffness [N m²].
    count : int
        Modes, at most five.
    pull : array (n,), optional
        Axial force [N], positive in tension.

    Returns
    -------
    shapes : ndarray (count, 5)
        Coefficients of x², …, x⁶, with sum one.
    frequencies : ndarray (count,)
        [Hz].
    """
    station = np.asarray(station, dtype=float)
    length = station[-1]
    edges = np.linspace(0.0, 1.0, _POINTS + 1)
    x, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    density, rigidity = (
        np.interp(x * length, station, np.asarray(values, dtype=float)) for values in (mass, stiffness)
    )
    value = x[:, None] ** POWERS
    slope = POWERS * x[:, None] ** (POWERS - 1) / length
    curvature = POWERS * (POWERS - 1) * x[:, None] ** (POWERS - 2) / length**2
    inertia = _product(value, density * width * length)
    spring = _product(curvature, rigidity * width * length)
    if pull is not None:
        spring += _product(slope, np.interp(x * length, station, np.asarray(pull, dtype=float)) * width * length)
    if top is not None:
        turn = POWERS / length
        move = 1.0 + top.height * turn
        inertia += top.mass * np.outer(move, move) + top.inertia * np.outer(turn, turn)
    squares, vectors = eigh(spring, inertia)
    shapes = vectors[:, :count].T
    return shapes / shapes.sum(axis=1, keepdims=True), np.sqrt(np.maximum(squares[:count], 0.0)) / (2.0 * np.pi)


def _product(functions: Array, weight: Array) -> Array:
    """Integrals of the products of functions (n_points, n) with weights (n_points,)."""
    return functions.T @ (weight[:, None] * functions)
