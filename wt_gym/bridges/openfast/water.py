"""The water about a floating turbine as input files of OpenFAST 5: HydroDyn, tables of WAMIT, SeaState, MoorDyn.

Members have drag only, HydroDyn takes all else from the tables. A heave plate is the end of a short member: HydroDyn's
force there is 1/4 ρ AxCd A |v| v, so that AxCd is twice the drag coefficient. Lines are those of MoorDyn, whose
statics are those of the catenaries here, with little drag of their own: this package gives lines none.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from wt_gym.base.errors import InflowError, SimulationError
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.hydrodynamics import ExcitationTable, Platform, PlatformLoads, RadiationTable, WaveComponents
from wt_gym.turbines import Turbine
from wt_gym.turbines.openfast_text import write_from_template, write_lines

FILES = {"SeaStFile": "seastate.dat", "HydroFile": "hydrodyn.dat", "MooringFile": "moordyn.dat"}
"""Names of the files by the keywords of the primary file."""
WAVE_OUTPUT, TENSION_OUTPUTS = "Wave1Elev", ("FairTen", "AnchTen")
"""Outputs of SeaState and, without the number of the line, of MoorDyn."""
_ROOT, _WAVES = "platform", "waves.dat"
_ELEMENT = 6.0  # Longest element of a member [m]: HydroDyn's time grows with their number
_STUB = 0.06  # Length of the member behind a heave plate [m]
_MEMORY = 60.0  # Time over which HydroDyn convolves the radiation [s]
_WAVE_STEP = 0.2
_SEGMENTS = 20
_NEGLIGIBLE = 1e-6
_PER_TURN = 37  # Headings of a table around the platform


def write_water(platform: Platform, folder: Path) -> None:
    """Write the files of a platform in still water beside each other.

    Raises
    ------
    SimulationError
        For what is not written: forces of second order, lines with different friction.
    """
    if platform.drift is not None:
        raise SimulationError(f"{platform.name}: drift must be None for OpenFAST, got {platform.drift!r:.80}")
    _write_hydrodyn(platform, folder / FILES["HydroFile"])
    _write_moordyn(platform, folder / FILES["MooringFile"])
    write_sea(platform, None, 0.0, folder)
    write_wamit(platform, folder / _ROOT)


# ---- HydroDyn --------------------------------------------------------------------------------------------------------


def _write_hydrodyn(platform: Platform, path: Path) -> None:
    joints, members, axial = _members(platform)
    n, rows = len(members), list(enumerate(members, 1))
    sizes = [_ELEMENT if drag else 1e3 for _, drag in members]  # one element where there is no drag
    write_from_template(
        path,
        f"HydroDyn input of {platform.name}",
        {
            "RdtnTMax": _MEMORY, "PotFile": _ROOT, "PtfmVol0": platform.displaced_volume,
            **{f"PtfmCOB{axis}t": float(x) for axis, x in zip("xy", platform.center_of_buoyancy, strict=True)},
            "NAxCoef": len(axial), "NJoints": len(joints), "NPropSetsCyl": n, "NCoefMembersCyl": n, "NMembers": n,
        },
        {
            "additional stiffness": _matrix("AddCLin", platform.additional_stiffness),
            "linear damping": _matrix("AddBLin", platform.linear_damping),
            "quadratic damping": _matrix("AddBQuad", platform.quadratic_damping),
            "axial coefficients": [f"{k} {drag:.15g} 0.0 0.0 0 0.0 1.0" for k, drag in enumerate(axial, 1)],
            "joints": [f"{k} {_row(place)} {kind} 0" for k, (place, kind) in enumerate(joints, 1)],
            "sections": [f"{k} {d:.15g} {0.01 * d:.15g}" for k, (d, _) in rows],
            "member coefficients": [f"{k} {drag:.15g} {drag:.15g}{' 0.0' * 26}" for k, (_, drag) in rows],
            "members": [f"{k} {2 * k - 1} {2 * k} {k} {k} 1 0.0 {size} 3 1 True" for k, size in enumerate(sizes, 1)],
        },
    )  # fmt: skip


def _members(platform: Platform) -> tuple[list[tuple[Array, int]], list[tuple[float, float]], list[float]]:
    """Places of joints in pairs with the numbers of their axial coefficients; diameters and C_d of members; AxCd."""
    joints: list[tuple[Array, int]] = []
    members, axial = [(member.diameter, member.drag_coefficient) for member in platform.members], [0.0]
    for member in platform.members:
        joints += [(member.start, 1), (member.end, 1)]
    for plate in platform.plates:
        axial.append(2.0 * plate.drag_coefficient)
        inwards = plate.axis / np.linalg.norm(plate.axis)
        if plate.position @ inwards > 0.0:
            inwards = -inwards
        joints += [(plate.position, len(axial)), (plate.position + _STUB * inwards, 1)]
        members.append((math.sqrt(4.0 * plate.area / math.pi), 0.0))
    return joints, members, axial


def _matrix(key: str, values: Array) -> list[str]:
    """Rows of a matrix, the first one with its keyword."""
    first, *rest = (_row(row) for row in values)
    return [f"{first}  {key} -", *rest]


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.15g}" for value in values)


# ---- tables of WAMIT -------------------------------------------------------------------------------------------------


def write_wamit(platform: Platform, path: Path) -> None:
    """Write the tables of a platform without dimensions for a length of 1 m: ``.1``, ``.3`` and ``.hst``.

    HydroDyn takes both tables at the same frequencies and interpolates linearly, the damping down to zero at its
    highest frequency. Where the damping does not vanish at the end of the table, a row without damping follows it.

    Parameters
    ----------
    path : Path
        Without the ending.
    """
    density, radiation, excitation = platform.water_density, platform.radiation, platform.excitation
    weight = density * GRAVITY
    frequency = np.union1d(radiation.frequency, excitation.frequency)
    frequency = frequency[frequency > 0.0]
    if abs(radiation.damping[-1]).max() > _NEGLIGIBLE * abs(radiation.damping).max():
        frequency = np.union1d(frequency, 1.02 * radiation.frequency[-1])
    added, damping = _at(radiation, frequency)
    # rounding must leave no two rows at the place of one
    frequency, index = np.unique(np.round(frequency, 9), return_index=True)
    lines, over_frequency = [], damping[index] / frequency[:, None, None]
    for period, a, b in (
        (-1.0, _at(radiation, np.zeros(1))[0][0], None),
        (0.0, radiation.added_mass_infinite, None),
        *zip((2.0 * math.pi / frequency).tolist(), added[index], over_frequency, strict=True),
    ):
        for i in range(6):
            for j in range(6):
                second = "" if b is None else f" {b[i, j] / density: .12e}"
                lines.append(f"{period: .12e} {i + 1} {j + 1} {a[i, j] / density: .12e}{second}")
    path.with_suffix(".1").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path.with_suffix(".3").write_text("\n".join(_excitation(excitation, frequency, weight)) + "\n", encoding="utf-8")
    stiffness = [f"{i + 1} {j + 1} {platform.hydrostatic[i, j] / weight: .12e}" for i in range(6) for j in range(6)]
    path.with_suffix(".hst").write_text("\n".join(stiffness) + "\n", encoding="utf-8")


def _at(table: RadiationTable, frequency: Array) -> tuple[Array, Array]:
    """Added mass and damping (n, 6, 6), linear between the frequencies of the table; no damping beyond."""
    parts = []
    for values, beyond in ((table.added_mass, None), (table.damping, 0.0)):
        columns = [np.interp(frequency, table.frequency, column, right=beyond) for column in values.reshape(-1, 36).T]
        parts.append(np.array(columns).T.reshape(-1, 6, 6))
    return parts[0], parts[1]


def _excitation(table: ExcitationTable, frequency: Array, weight: float) -> list[str]:
    """Rows of the wave forces; there are none above the frequencies of the table."""
    low, high = table.frequency[0], table.frequency[-1]
    heading = np.linspace(-math.pi, math.pi, _PER_TURN) if table.is_mirrored else table.heading
    if table.is_mirrored:
        heading = np.union1d(np.round(heading, 12), np.round(np.concatenate([table.heading, -table.heading]), 12))
        heading = heading[abs(heading) <= min(table.heading.max(), math.pi) + 1e-9]
    lines = []
    for omega in frequency:
        force = table.at(np.full(len(heading), np.clip(omega, low, high)), heading) / weight
        if omega > high + 1e-6:
            force = np.zeros_like(force)
        for angle, row in zip(np.degrees(heading), force, strict=True):
            for k, x in enumerate(row):
                phase = math.degrees(math.atan2(x.imag, x.real))
                lines.append(
                    f"{2.0 * math.pi / omega: .12e} {angle: .9e} {k + 1} {abs(x): .9e} {phase: .9e} {x.real: .12e} "
                    f"{x.imag: .12e}"
                )
    return lines


# ---- SeaState --------------------------------------------------------------------------------------------------------


def write_sea(platform: Platform, sea: WaveComponents | None, duration: float, folder: Path) -> Path:
    """Write the waves and the current that a platform meets as user-defined components (WaveMod 7) of SeaState.

    Parameters
    ----------
    sea : WaveComponents or None
        Whose frequencies are multiples of one; None: still water.
    duration : float
        Of the simulation [s].

    Returns
    -------
    Path
        Of the input file of SeaState.

    Raises
    ------
    InflowError
        If the frequencies have no such common divisor, or one occurs twice.
    """
    period = max(duration, 1.0)
    has_waves = sea is not None and len(sea.frequency) > 0 and bool(np.any(sea.amplitude > 0.0))
    if sea is not None and has_waves:
        spacing = _spacing(sea)
        period = 2.0 * math.pi / spacing * max(1, math.ceil(duration * spacing / (2.0 * math.pi) - 1e-9))
        columns = sea.frequency, 2.0 * sea.amplitude, np.degrees(sea.direction), np.degrees(sea.phase)
        rows = [_row(row) for row in zip(*columns, strict=True)]
        head = ["! Frequency Height Direction Phase", "! (rad/s) (m) (deg) (deg)"]
        (folder / _WAVES).write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    current = complex(*(0.0, 0.0) if sea is None else sea.current)
    points = [*(member.start for member in platform.members), *(member.end for member in platform.members),
              *(plate.position for plate in platform.plates), np.zeros(3)]  # fmt: skip
    across, down = (float(max(abs(point[k]).max() for point in points)) for k in (slice(0, 2), slice(2, 3)))
    path = folder / FILES["SeaStFile"]
    write_from_template(path, f"SeaState input of {platform.name}", {
        "WtrDens": platform.water_density, "WtrDpth": platform.water_depth,
        "X_HalfWidth": across + 10.0, "Y_HalfWidth": across + 10.0, "Z_Depth": min(down + 10.0, platform.water_depth),
        "WaveMod": 7 if has_waves else 0, "WaveTMax": period, "WaveDT": _WAVE_STEP, "WvKinFile": _WAVES,
        "CurrMod": int(current != 0.0), "CurrDIV": abs(current),
        "CurrDIDir": math.degrees(math.atan2(current.imag, current.real)),
    })  # fmt: skip
    return path


def _spacing(sea: WaveComponents) -> float:
    """Largest frequency of which all are multiples [rad/s]."""
    ascending = np.sort(sea.frequency)
    spacing = float(min(ascending[0], np.diff(ascending).min(initial=math.inf)))
    if spacing > 0.0:
        for divisor in range(1, 100):
            multiples = ascending / spacing * divisor
            if abs(multiples - np.round(multiples)).max() < 1e-4:
                return spacing / divisor
    raise InflowError(
        "frequencies of waves must be different multiples of one for SeaState, as those of a SeaState here are, got "
        f"{', '.join(f'{omega:g}' for omega in ascending[:4])} ... rad/s"
    )


# ---- MoorDyn ---------------------------------------------------------------------------------------------------------


def _write_moordyn(platform: Platform, path: Path) -> None:
    lines = platform.lines
    number = range(1, len(lines) + 1)
    slow = min((line.length / _SEGMENTS / math.sqrt(line.axial_stiffness / line.mass_per_length) for line in lines),
               default=1.0)  # fmt: skip
    frictions = sorted({line.seabed_friction for line in lines})
    if len(frictions) > 1:
        raise SimulationError(f"{platform.name}: lines must have one seabed friction for MoorDyn, got {frictions}")
    write_lines(path, f"MoorDyn input of {platform.name}", [
        ("Echo", False),
        "---------------------- LINE TYPES",
        "Name Diam MassDen EA BA/-zeta EI Cd Ca CdAx CaAx", "(-) (m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)",
        *[
            f"type{k} {_row((line.diameter, line.mass_per_length, line.axial_stiffness))} -0.8 0.0 1.0 1.0 0.0 0.0"
            for k, line in zip(number, lines, strict=True)
        ],
        "---------------------- POINTS",
        "ID Attachment X Y Z M V CdA CA", "(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)",
        *[
            f"{2 * k - 1 + end} {kind} {_row(place)} 0 0 0 0"
            for k, line in zip(number, lines, strict=True)
            for end, kind, place in ((0, "Fixed", line.anchor), (1, "Vessel", line.fairlead))
        ],
        "---------------------- LINES",
        "ID LineType AttachA AttachB UnstrLen NumSegs Outputs", "(-) (-) (-) (-) (m) (-) (-)",
        *[
            f"{k} type{k} {2 * k - 1} {2 * k} {line.length:.15g} {_SEGMENTS} -"
            for k, line in zip(number, lines, strict=True)
        ],
        "---------------------- OPTIONS",
        f"{0.4 * slow:.4g} dtM", "3.0e6 kBot", "3.0e5 cBot", f"{platform.water_depth:.15g} WtrDpth",
        *[f"{friction:.15g} {key}" for friction in frictions if friction > 0.0 for key in ("MU_KT", "MU_KA")],
        "1.0 dtIC", "60.0 TmaxIC", "4.0 CdScaleIC", "0.001 threshIC",
        "---------------------- OUTPUTS",
        *[f"{name}{k}" for name in TENSION_OUTPUTS for k in number], "END",
        "---------------------- need this line",
    ])  # fmt: skip


# ---- start -----------------------------------------------------------------------------------------------------------


def resting_place(
    turbine: Turbine, thrust: float, torque: float, yaw: float, sea: WaveComponents | None = None
) -> Array:
    """Displacement and rotation (6,) of a platform under constant loads of a rigid turbine [m], [rad].

    A tower that bends adds about a tenth of a degree on VolturnUS-S.

    Parameters
    ----------
    thrust, torque : float
        Of the air on the rotor, along and about the shaft [N], [N m].
    yaw : float
        Of the nacelle [rad].
    sea : WaveComponents, optional
        Its current pushes the platform.

    Raises
    ------
    SimulationError
        If there is no balance.
    """
    platform, nacelle, hub, tower = turbine.floater, turbine.nacelle, turbine.hub, turbine.tower
    assert platform is not None
    loads = PlatformLoads(replace(platform, gravity=GRAVITY), 0.1)
    loads.set_sea(sea)
    turn = Rotation.from_euler("z", yaw).as_matrix()
    shaft = turn @ np.array([math.cos(nacelle.tilt), 0.0, -math.sin(nacelle.tilt)])
    top = np.array([0.0, 0.0, tower.height])
    apex = top + np.array([0.0, 0.0, nacelle.tower_top_to_shaft]) - nacelle.overhang * shaft
    m0, m1 = (turbine.n_blades * turbine.blade.structure.mass_moment(k) for k in range(2))
    ahead = math.sin(hub.cone) * (m1 / m0 + hub.radius)
    tower_mass = tower.structure.mass_moment(0)
    middle = tower.base_height + tower.structure.mass_moment(1) / tower_mass
    masses = (
        (platform.mass, platform.center), (tower_mass, np.array([0.0, 0.0, middle])), (nacelle.yaw_bearing_mass, top),
        (nacelle.mass, top + turn @ nacelle.cm), (hub.mass, apex + hub.cm_offset_along_shaft * shaft),
        (m0, apex - ahead * shaft),
    )  # fmt: skip
    weight = GRAVITY * np.array([mass for mass, _ in masses])
    arm = np.sum([part * place for part, (_, place) in zip(weight, masses, strict=True)], axis=0)
    scale = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])

    def residual(unknown: Array) -> Array:
        position = unknown * scale
        rotation = Rotation.from_euler("XYZ", position[3:]).as_matrix()
        force = loads.static_force(position[:3], rotation) + loads.current_force(rotation)
        push = rotation @ shaft * thrust
        force[:3] += push - np.array([0.0, 0.0, weight.sum()])
        force[3:] += np.cross(rotation @ apex, push) + rotation @ shaft * torque
        force[3:] += np.cross(rotation @ arm, [0.0, 0.0, -1.0])
        return np.asarray(force * scale * 1e-5)

    solution = root(residual, np.zeros(6), tol=1e-9)
    if not solution.success:
        raise SimulationError(f"{platform.name}: the platform finds no rest under a thrust of {thrust:g} N")
    return np.asarray(solution.x * scale)
