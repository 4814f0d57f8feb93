"""The turbine of Gebhardt, Preidikman, Jørgensen & Massa 2012: 45 m blades on a 68 m tower.

The paper gives the lengths, the degrees of freedom and two operating points; blade, masses and tower are stand-ins of
the same class. ``data/gebhardt45.json`` keeps published, inferred and stand-in values apart.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.turbines.beam import BeamStations, inertia_matrix, rotation_about_z
from wt_gym.turbines.blade import Blade
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, PitchSystem, Tower, Turbine
from wt_gym.turbines.windio import own_file, read_turbine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from numpy.typing import NDArray

__all__ = ["GENERATOR_DAMPER", "gebhardt_data", "gebhardt_turbine"]

ROOT_CHORD = 0.3
"""Chord of the lattice where the blade carries no lift [m]: the root strips of a lattice may be slender, not absent."""
MOST_TORQUE, TORQUE_RATE = 1.1, 0.348
"""Greatest torque of a generator with torque control and its rate [1/s], over the rated torque: those of the NREL 5-MW
(NREL/TP-500-38060, Table 7-2: 47.40 kN m and 15 kN m/s, rated 43.09 kN m). The paper's generator is a damper."""
ROOT_RAMP = 1.0
"""Half of the length over which the chord of the lattice rises where the lifting surface begins [m]."""


@cache
def gebhardt_data() -> dict[str, Any]:
    """Contents of ``data/gebhardt45.json``."""
    text = resources.files(__package__).joinpath("data", "gebhardt45.json").read_text(encoding="utf-8")
    out: dict[str, Any] = json.loads(text)
    return out


GENERATOR_DAMPER = gebhardt_data()["inferred"]["generator_damper_Nms"]
"""Generator torque on the rotor side divided by the rotor speed [N m s]."""


@cache
def gebhardt_turbine(tower_stiffness: float = 1.0, nacelle_forward: float | None = None) -> Turbine:
    """The stand-in turbine, undamped like the paper's, with a generator that turns with the rotor.

    Parameters
    ----------
    tower_stiffness : float
        Factor on the bending stiffness of the tower.
    nacelle_forward : float, optional
        Distance of the nacelle's center of mass upwind of the tower [m]; by default the inferred one.

    Returns
    -------
    Turbine
        Its gear ratio is 1: generator torque and speed are those of the rotor side, as in the paper.
    """
    data = gebhardt_data()["stand_in"]
    blade, nacelle, tower = _blade(data), _nacelle(data, nacelle_forward), _tower(data, tower_stiffness)
    hub = data["hub"]
    slowest, fastest = (rpm * np.pi / 30.0 for rpm in data["rotor_speed_range_rpm"])
    tilt = np.radians(data["nacelle"]["tilt_deg"])
    return Turbine(
        name="Gebhardt et al. 2012, 45 m blades, 68 m tower (stand-in)",
        n_blades=gebhardt_data()["published"]["n_blades"],
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (hub["radius_m"] + blade.length),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * np.sin(tilt),
        rated_wind_speed=12.0,
        cut_in=3.0,
        cut_out=25.0,
        air_density=data["air_density_kg_m3"],
        blade=blade,
        tower=tower,
        hub=Hub(
            radius=hub["radius_m"],
            cone=np.radians(hub["precone_deg"]),
            mass=hub["mass_kg"],
            inertia_axial=hub["inertia_about_shaft_kgm2"],
            inertia_transverse=hub["inertia_about_shaft_kgm2"],
            cm_offset_along_shaft=0.0,
        ),
        nacelle=nacelle,
        drivetrain=Drivetrain(
            gear_ratio=1.0,
            gearbox_efficiency=1.0,
            generator_efficiency=1.0,
            generator_inertia=1.0,  # nothing beside the rotor's 1.2e7 kg m²; the paper's generator has none
            spring=1e10,
            damper=0.0,
            rated_power=data["rated_power_W"],
            rated_rotor_speed=fastest,
            min_rotor_speed=slowest,
            max_generator_torque=MOST_TORQUE * data["rated_power_W"] / fastest,
            max_torque_rate=TORQUE_RATE * data["rated_power_W"] / fastest,
            generator_damping=GENERATOR_DAMPER,
        ),
        pitch=PitchSystem(min_pitch=np.radians(-20.0), max_pitch=np.radians(90.0), max_rate=np.radians(10.0)),
        iec_class="II",
        turbulence_class="B",
        notes=("blade, masses, tower section and drivetrain are stand-ins, see data/gebhardt45.json",),
    )


def _columns(table: Sequence[Sequence[Any]], names: Sequence[str]) -> dict[str, list[Any]]:
    """Columns of a table of rows by name."""
    return {name: [row[i] for row in table] for i, name in enumerate(names)}


def _blade(data: dict[str, Any]) -> Blade:
    """Planform and sections of the stand-in blade; the round root carries no lift."""
    blade = data["blade"]
    plan = _columns(blade["planform"], blade["planform_columns"])
    beam = {k: np.array(v) for k, v in _columns(blade["structure"], blade["structure_columns"]).items()}
    length = blade["length_m"]
    start, span = blade["lifting_surface_from_m"], np.array(plan["span_m"])
    # lattice: slender root, a ramp centered on the begin of the lifting surface, the published planform outboard
    first, last = start - ROOT_RAMP, start + ROOT_RAMP
    outboard = span > last
    station = np.concatenate(([0.0, first, last], span[outboard]))
    chord = np.interp(station, span, plan["chord_m"])
    chord[:2] = ROOT_CHORD
    donor = read_turbine(own_file("nrel_5mw.yaml")).blade
    known = {a.name: a for a in donor.airfoils}
    lifting = [(z, name) for z, name in zip(span, plan["airfoil"], strict=True) if not name.startswith("Cylinder")]
    # a new section begins where its name first appears; between two such stations the sections are blended
    names = list(dict.fromkeys(name for _, name in lifting))
    begins = [next(z for z, name in lifting if name == own) for own in names]
    return Blade(
        length=length,
        root_radius=data["hub"]["radius_m"],
        axis_station=np.array([0.0, length]),
        axis=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]),
        aero_station=station,
        chord=chord,
        twist=np.radians(np.interp(station, span, plan["twist_deg"])),
        le_offset=np.interp(station, beam["span_m"], beam["pitch_axis_xc"]),
        airfoils=tuple(known[name] for name in names),
        airfoil_station=np.array(begins),
        airfoil_index=np.arange(len(names)),
        rotating_polars=donor.rotating_polars,
        structure=_blade_structure(beam),
        damping_ratio=0.0,
    )


def _blade_structure(beam: Mapping[str, NDArray[np.float64]]) -> BeamStations:
    """Section matrices from principal stiffnesses at the structural twist."""
    n = len(beam["span_m"])
    stiffness, zero = np.zeros((n, 6, 6)), np.zeros(n)
    stiffness[:, 0, 0] = stiffness[:, 1, 1] = np.inf
    turn = rotation_about_z(-np.radians(beam["struct_twist_deg"]))
    principal = np.zeros((n, 6, 6))
    for k, name in ((2, "EA_N"), (3, "EI_edge_Nm2"), (4, "EI_flap_Nm2"), (5, "GJ_Nm2")):
        principal[:, k, k] = beam[name]
    turned = turn @ principal @ np.swapaxes(turn, 1, 2)
    stiffness[:, 2:, 2:] = turned[:, 2:, 2:]
    mass, cg = beam["mass_kg_m"], beam["cg_edge_offset_m"]
    about_axis = beam["i_edge_kgm"] + mass * cg**2
    inertia = inertia_matrix(mass, zero, cg, about_axis, beam["i_flap_kgm"], zero)
    return BeamStations(beam["span_m"], stiffness, turn @ inertia @ np.swapaxes(turn, 1, 2))


def _tower(data: dict[str, Any], stiffness: float) -> Tower:
    """Straight prismatic undamped tube."""
    tower = data["tower"]
    height = gebhardt_data()["published"]["tower_height_m"]
    bending, inertia = stiffness * tower["EI_Nm2"], tower["section_inertia_kgm"]
    section = np.diag([np.inf, np.inf, tower["EA_N"], bending, bending, tower["GJ_Nm2"]])
    mass = inertia_matrix(tower["mass_kg_m"], 0.0, 0.0, inertia, inertia, 0.0)
    return Tower(
        base_height=0.0,
        height=height,
        diameter_station=np.array([0.0, height]),
        diameter=np.full(2, tower["outer_diameter_m"]),
        structure=BeamStations(np.array([0.0, height]), np.array([section] * 2), np.array([mass] * 2)),
        damping_ratio=0.0,
        drag_coefficient=0.0,  # the paper's air acts on the blades alone
    )


def _nacelle(data: dict[str, Any], forward: float | None) -> Nacelle:
    """Rigid nacelle in front of the tower, yaw held."""
    nacelle = data["nacelle"]
    yaw, roll = nacelle["inertia_yaw_kgm2"], nacelle["inertia_roll_kgm2"]
    downwind = gebhardt_data()["inferred"]["nacelle_cm_downwind_of_tower_m"] if forward is None else -forward
    return Nacelle(
        mass=nacelle["mass_kg"],
        cm=np.array([downwind, 0.0, nacelle["cm_above_tower_top_m"]]),
        inertia=np.diag([roll, yaw, yaw]),
        tilt=np.radians(nacelle["tilt_deg"]),
        overhang=nacelle["overhang_m"],
        tower_top_to_shaft=nacelle["shaft_above_tower_top_m"],
        yaw_bearing_mass=0.0,
        yaw_spring=1e10,
        yaw_damper=0.0,
        max_yaw_rate=0.0,
    )
