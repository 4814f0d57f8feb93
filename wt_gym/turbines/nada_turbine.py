"""The small turbine of Nada & Al-Shahrani 2019: a rotor of half a meter on a copper rod in front of a wind generator.

The numbers of the paper are not legible in the copies at hand; the rig is a stand-in of the same kind, whose data
``data/nada_small.json`` keeps apart from what is published. The validation case ``mixed-coordinates`` uses the same
file.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.turbines.airfoil import Airfoil, Polar, cosine_grid
from wt_gym.turbines.beam import BeamStations, inertia_matrix, rotation_about_z
from wt_gym.turbines.blade import Blade
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, PitchSystem, Tower, Turbine

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

__all__ = ["nada_data", "nada_speed", "nada_turbine", "plate_polar"]

STATIONS = 9
"""Stations along a blade, between which planform and sections are interpolated."""
MOST_TORQUE, TORQUE_RATE = 1.5, 10.0
"""Greatest torque of the generator and its rate [1/s], over the rated torque."""
HELD = 1e10
"""Stiffness of a shaft and a yaw bearing that do not yield [N m/rad]."""


@cache
def nada_data() -> dict[str, Any]:
    """Contents of ``data/nada_small.json``."""
    text = resources.files(__package__).joinpath("data", "nada_small.json").read_text(encoding="utf-8")
    out: dict[str, Any] = json.loads(text)
    return out


def nada_speed() -> float:
    """Rotor speed of the rig in the test wind [rad/s]: that of the stand-in tip-speed ratio."""
    data = nada_data()
    return float(
        data["stand_in"]["tip_speed_ratio"]
        * data["published"]["test_wind_speed_m_s"]
        / data["stand_in"]["blade"]["tip_radius_m"]
    )


def plate_polar(stall: float, width: float, friction: float, n: int = 361) -> Polar:
    """Polar of a thin plate with sharp edges over the full circle.

    The force is normal to the plate except for friction: attached flow has the circulation of thin-airfoil theory and
    no suction at the leading edge, c_n = 2 π sin α; separated flow c_n = 1/(0.222 + 0.283/sin α) (Hoerner 1965);
    between them the share of attached flow falls as 1/(1 + exp((α − stall)/width)). The force acts at a quarter of the
    chord from the edge that leads, and at half of it across the wind.

    Parameters
    ----------
    stall, width : float
        [rad].
    friction : float
        Coefficient of the force along the plate.

    Returns
    -------
    Polar
    """
    alpha = np.linspace(-np.pi, np.pi, n)
    alpha[n // 2] = 0.0
    sine = np.abs(np.sin(alpha))
    from_edge = np.arcsin(np.minimum(sine, 1.0))
    attached = 1.0 / (1.0 + np.exp((from_edge - stall) / width))
    separated = np.divide(sine, 0.222 * sine + 0.283)
    normal = np.sign(np.sin(alpha)) * (attached * 2.0 * np.pi * sine + (1.0 - attached) * separated)
    normal[[0, n // 2, -1]] = 0.0
    along = friction * np.cos(alpha)
    behind = 0.25 * (1.0 - attached) * from_edge / (0.5 * np.pi)  # of the pressure behind the quarter of the chord
    center = np.where(np.cos(alpha) >= 0.0, behind, 0.5 - behind)
    return Polar(
        alpha=alpha,
        cl=normal * np.cos(alpha) - along * np.sin(alpha),
        cd=normal * np.sin(alpha) + along * np.cos(alpha),
        cm=-normal * center,
    )


@cache
def nada_turbine() -> Turbine:
    """The stand-in rig, with a generator that turns with the rotor and is a damper or takes a torque.

    Returns
    -------
    Turbine
        Its gear ratio is 1. Rated is the test: 8 m/s and the speed of :func:`nada_speed`, at which the damper balances
        the air. The rig's blades do not pitch; a small drive is added for control.
    """
    data, wind = nada_data()["stand_in"], nada_data()["published"]["test_wind_speed_m_s"]
    speed, damping = nada_speed(), data["generator_damper_Nms"]
    torque = damping * speed
    blade, hub, tower = _blade(data), data["hub"], _tower(data["tower"])
    hub_inertia = 0.5 * hub["mass_kg"] * hub["radius_m"] ** 2
    rotor_mass = hub["mass_kg"] + data["blade"]["number"] * _mass(blade.structure)
    low, high = np.radians(data["pitch_range_deg"])
    return Turbine(
        name="Nada & Al-Shahrani 2019, small turbine on a copper rod (stand-in)",
        n_blades=data["blade"]["number"],
        rotor_orientation="upwind",
        rotor_diameter=2.0 * data["blade"]["tip_radius_m"],
        hub_height=tower.height,
        rated_wind_speed=wind,
        cut_in=data["wind_range_m_s"][0],
        cut_out=data["wind_range_m_s"][1],
        air_density=data["air_density_kg_m3"],
        blade=blade,
        tower=tower,
        hub=Hub(
            radius=hub["radius_m"],
            cone=0.0,
            mass=hub["mass_kg"],
            inertia_axial=hub_inertia,
            inertia_transverse=0.5 * hub_inertia,
            cm_offset_along_shaft=0.0,
        ),
        nacelle=_nacelle(data, data["nacelle_rotor_mass_kg"] - rotor_mass),
        drivetrain=Drivetrain(
            gear_ratio=1.0,
            gearbox_efficiency=1.0,
            generator_efficiency=1.0,
            generator_inertia=data["generator_inertia_kgm2"],
            spring=HELD,
            damper=0.0,
            rated_power=torque * speed,
            rated_rotor_speed=speed,
            min_rotor_speed=0.4 * speed,
            max_generator_torque=MOST_TORQUE * torque,
            max_torque_rate=TORQUE_RATE * torque,
            generator_damping=damping,
        ),
        pitch=PitchSystem(min_pitch=low, max_pitch=high, max_rate=np.radians(data["pitch_rate_deg_s"])),
        iec_class="III",
        turbulence_class="C",
        notes=("all dimensions are stand-ins, see data/nada_small.json",),
    )


def _mass(structure: BeamStations) -> float:
    """Mass of a beam whose properties are linear between its stations [kg]."""
    return float(np.trapezoid(structure.inertia[:, 0, 0], structure.station))


def _blade(data: dict[str, Any]) -> Blade:
    """A tapered, twisted strip of plastic, straight along its mid-chord."""
    blade, root = data["blade"], data["hub"]["radius_m"]
    length, t = blade["tip_radius_m"] - root, blade["thickness_m"]
    z = np.linspace(0.0, length, STATIONS)
    chord = np.interp(z, [0.0, length], [blade["chord_root_m"], blade["chord_tip_m"]])
    twist = np.radians(np.interp(z, [0.0, length], [blade["twist_root_deg"], blade["twist_tip_deg"]]))
    section, x = data["section"], cosine_grid(41)
    stall, width = np.radians([section["stall_deg"], section["stall_width_deg"]])
    polar = plate_polar(stall, width, section["friction_coefficient"])
    thickness = t / (0.5 * (chord[0] + chord[-1]))
    height = thickness * np.sqrt(x * (1.0 - x))
    contour = np.vstack((np.column_stack((x, height))[::-1], np.column_stack((x, -height))[1:]))
    plate = Airfoil("thin plate", thickness, contour, np.array([0.0, 0.5, 1.0]), np.zeros(3), polar)
    return Blade(
        length=length,
        root_radius=root,
        axis_station=np.array([0.0, length]),
        axis=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]),
        aero_station=z,
        chord=chord,
        twist=twist,
        le_offset=np.full(STATIONS, 0.5),
        airfoils=(plate,),
        airfoil_station=np.array([0.0]),
        airfoil_index=np.array([0]),
        rotating_polars=False,
        structure=_strip(z, chord, twist, t, blade["youngs_modulus_Pa"], blade["density_kg_m3"]),
        damping_ratio=blade["damping_ratio"],
    )


def _strip(
    z: NDArray[np.float64], chord: NDArray[np.float64], twist: NDArray[np.float64], t: float, e: float, rho: float
) -> BeamStations:
    """Sections of a solid strip: E c t³/12 across its flat side, E t c³/12 along it, torsion G c t³/3."""
    area, flat, edge = chord * t, chord * t**3 / 12.0, t * chord**3 / 12.0
    stiffness, zero = np.zeros((len(z), 6, 6)), np.zeros(len(z))
    for k, value in ((2, e * area), (3, e * edge), (4, e * flat), (5, e / 2.6 * chord * t**3 / 3.0)):
        stiffness[:, k, k] = value
    turn = rotation_about_z(-twist)
    stiffness = turn @ stiffness @ np.swapaxes(turn, 1, 2)
    stiffness[:, 0, 0] = stiffness[:, 1, 1] = np.inf
    inertia = inertia_matrix(rho * area, zero, zero, rho * edge, rho * flat, zero)
    return BeamStations(z, stiffness, turn @ inertia @ np.swapaxes(turn, 1, 2))


def _tower(tower: dict[str, Any]) -> Tower:
    """Solid rod of circular section."""
    height, d, rho = tower["length_m"], tower["diameter_m"], tower["density_kg_m3"]
    area, second = 0.25 * np.pi * d**2, np.pi * d**4 / 64.0
    bending = tower["youngs_modulus_Pa"] * second
    section = np.diag([np.inf, np.inf, tower["youngs_modulus_Pa"] * area, bending, bending,
                       tower["shear_modulus_Pa"] * 2.0 * second])  # fmt: skip
    mass = inertia_matrix(rho * area, 0.0, 0.0, rho * second, rho * second, 0.0)
    ends = np.array([0.0, height])
    return Tower(
        base_height=0.0,
        height=height,
        diameter_station=ends,
        diameter=np.full(2, d),
        structure=BeamStations(ends, np.array([section] * 2), np.array([mass] * 2)),
        damping_ratio=tower["damping_ratio"],
        drag_coefficient=0.0,
    )


def _nacelle(data: dict[str, Any], mass: float) -> Nacelle:
    """Rigid body on the tower top, yaw held."""
    return Nacelle(
        mass=mass,
        cm=np.zeros(3),
        inertia=mass * data["nacelle_radius_of_gyration_m"] ** 2 * np.eye(3),
        tilt=0.0,
        overhang=data["hub"]["overhang_m"],
        tower_top_to_shaft=0.0,
        yaw_bearing_mass=0.0,
        yaw_spring=HELD,
        yaw_damper=0.0,
        max_yaw_rate=0.0,
    )
