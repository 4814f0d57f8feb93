"""Hub, nacelle, drivetrain and pitch system of a windIO file.

Rigid bodies of windIO: ``inertia`` is the tensor (xx, yy, zz, xy, xz, yz) about the body's own centre of mass and
``location`` that centre (in the file of the IEA 15-MW turbine the inertia about the tower top, ``inertia_tt``, differs
from ``inertia`` by just the parallel-axis terms).
"""

import numpy as np
from numpy.typing import NDArray

from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Blade, Drivetrain, Hub, Nacelle, PitchSystem
from wt_gym.turbines.source import Node, within

__all__ = ["read_drivetrain", "read_hub", "read_nacelle", "read_pitch", "rpm"]

rpm = np.pi / 30.0
"""One revolution per minute [rad/s]."""

YAW_FREQUENCY, YAW_DAMPING = 3.0, 0.02
"""Yaw actuator where a file has none: natural frequency [Hz] and damping ratio of the NREL 5-MW turbine's."""

_TORQUE_MARGIN = 1.1
"""Largest over rated generator torque, in the NREL 5-MW report and in ROSCO, whose numbers windIO files carry."""


def read_hub(root: Node, notes: list[str]) -> Hub:
    """Build the hub from ``components.hub``.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is missing or wrong.
    """
    node = root.at("components.hub")
    body = node.at("elastic_properties", "a mapping with mass, inertia and location of the hub")
    inertia = body.array("inertia")
    if inertia.size >= 3:
        transverse = float(0.5 * (inertia[1] + inertia[2]))
    else:
        transverse = float(inertia[0])
        notes.append(f"{body.where('inertia')}: only the axial inertia is given, the same is used across the shaft")
    with within(node.path):
        return Hub(
            radius=node.number("diameter", 0.0, 30.0, 0.5),
            cone=node.number("cone_angle", 0.0, 50.0, np.pi / 180.0),
            mass=body.number("mass", 0.0, 1e9),
            inertia_axial=float(inertia[0]),
            inertia_transverse=transverse,
            cm_offset_along_shaft=float(body.array("location")[0]),
        )


def read_nacelle(root: Node, blade: Blade, hub: Hub, n_blades: int, notes: list[str]) -> Nacelle:
    """Build the nacelle from ``components.drivetrain`` and ``components.yaw``.

    windIO gives the horizontal overhang and the height of the apex above the tower top; along the shaft the overhang is
    longer by 1/cos(tilt), and the shaft crosses the yaw axis lower by overhang * tan(tilt). A file without a yaw
    actuator gets one with 3 Hz and 2 % damping, with the inertia of nacelle and rotor about the yaw axis.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is missing or wrong.
    """
    node = root.at("components.drivetrain")
    shape = node.at("outer_shape")
    body = node.at("elastic_properties", "a mapping with mass, inertia and location of the nacelle")
    tilt = shape.number("uptilt", 0.0, 20.0, np.pi / 180.0)
    horizontal = shape.number("overhang", 0.0, 20.0)
    mass, cm, inertia = body.number("mass", 0.0, 1e9), body.array("location", 3), _tensor(body)
    yaw_inertia = (
        inertia[2, 2] + mass * (cm[0] ** 2 + cm[1] ** 2) + _rotor_yaw_inertia(blade, hub, n_blades, horizontal)
    )
    spring, damper = _yaw_actuator(root, yaw_inertia, notes)
    bearing = "components.yaw.elastic_properties"
    if bearing not in root:
        notes.append(f"{bearing}: not in the file, no mass at the yaw bearing")
    if "control.yaw_rate" in root:
        rate = root.at("control").number("yaw_rate", 0.0, 10.0, np.pi / 180.0)
    else:
        rate = 0.3 * np.pi / 180.0
        notes.append("control.yaw_rate: not in the file, 0.3 deg/s assumed")
    with within(node.path):
        return Nacelle(
            mass=mass,
            cm=cm,
            inertia=inertia,
            tilt=tilt,
            overhang=horizontal / np.cos(tilt),
            tower_top_to_shaft=shape.number("distance_tt_hub", 0.0, 20.0) - horizontal * np.tan(tilt),
            yaw_bearing_mass=root.at(bearing).number("mass", 0.0, 1e9) if bearing in root else 0.0,
            yaw_spring=spring,
            yaw_damper=damper,
            max_yaw_rate=rate,
        )


def _tensor(body: Node) -> NDArray[np.float64]:
    values = body.array("inertia")
    if values.size not in (3, 6):
        raise fail(body.where("inertia"), values.tolist(), "xx, yy, zz and optionally xy, xz, yz [kg m^2]")
    tensor = np.diag(values[:3])
    if values.size == 6:
        for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), values[3:], strict=True):
            tensor[i, j] = tensor[j, i] = value
    return tensor


def _rotor_yaw_inertia(blade: Blade, hub: Hub, n_blades: int, overhang: float) -> float:
    """Return the inertia of the straight, untilted rotor about the yaw axis, for an actuator's stiffness [kg m^2]."""
    m0, m1, m2 = (blade.structure.mass_moment(k) for k in range(3))
    about_shaft = n_blades * (m2 + 2.0 * hub.radius * m1 + hub.radius**2 * m0)
    return 0.5 * about_shaft + hub.inertia_transverse + (n_blades * m0 + hub.mass) * overhang**2


def _yaw_actuator(root: Node, inertia: float, notes: list[str]) -> tuple[float, float]:
    path = "components.yaw.elastic_properties"
    if f"{path}.spring_constant" in root:
        body = root.at(path)
        return body.number("spring_constant", 1.0, 1e15), body.number("damping_coefficient", 0.0, 1e15)
    omega = 2.0 * np.pi * YAW_FREQUENCY
    notes.append(f"{path}.spring_constant: not in the file, a yaw actuator with 3 Hz and 2 % damping is assumed")
    return inertia * omega**2, 2.0 * YAW_DAMPING * inertia * omega


def read_drivetrain(root: Node, rated_power: float, notes: list[str]) -> Drivetrain:
    """Build the drivetrain from ``components.drivetrain`` and ``control``.

    The torsion spring and damper, both seen from the low-speed shaft, come from ``gearbox.elastic_properties`` or, as
    in the IEA turbines, from ``elastic_properties.spring_constant`` and ``damping_coefficient``. Where the generator's
    efficiency is not in the file it follows from the largest torque, taken as 110 % of the rated one.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is missing or wrong.
    """
    node = root.at("components.drivetrain")
    control = root.at("control", "a mapping with rated_rotor_speed, max_gen_torque and the limits of the actuators")
    speed = control.number("rated_rotor_speed", 1e-3, 1000.0, rpm)
    gearbox = node.at("gearbox") if "gearbox" in node else Node({}, node.where("gearbox"))
    ratio, gear_efficiency = 1.0, 1.0
    if "gear_ratio" in gearbox:
        ratio = gearbox.number("gear_ratio", 1.0, 1000.0)
    else:
        notes.append(f"{gearbox.where('gear_ratio')}: not in the file, a direct drive (1) is assumed")
    if "efficiency" in gearbox:
        gear_efficiency = gearbox.number("efficiency", 0.0, 1.0)
    else:
        notes.append(f"{gearbox.where('efficiency')}: not in the file, 1 is assumed")
    hint = "a mapping with mass, inertia and location of the generator (inertia about the high-speed shaft)"
    generator = node.at("generator.elastic_properties", hint)
    spring, damper = _torsion(node)
    shaft_torque = rated_power / (speed * ratio * gear_efficiency)
    efficiency = _generator_efficiency(node, control, speed * ratio, shaft_torque, notes)
    torque = shaft_torque / efficiency
    slowest = _optional(control, "min_rotor_speed", 0.0, 1000.0, rpm, 0.0, "0 rpm", notes)
    most = _optional(
        control, "max_gen_torque", 1.0, 1e12, 1.0, _TORQUE_MARGIN * torque, "110 % of the rated torque", notes
    )
    rate = _optional(
        control, "max_torque_rate", 1.0, 1e12, 1.0, torque / 3.0, "a third of the rated torque per second", notes
    )
    with within(node.path):
        return Drivetrain(
            gear_ratio=ratio,
            gearbox_efficiency=gear_efficiency,
            generator_efficiency=efficiency,
            generator_inertia=float(generator.array("inertia")[0]),
            spring=spring,
            damper=damper,
            rated_power=rated_power,
            rated_rotor_speed=speed,
            min_rotor_speed=slowest,
            max_generator_torque=most,
            max_torque_rate=rate,
        )


def _torsion(node: Node) -> tuple[float, float]:
    if "gearbox.elastic_properties" in node:
        gearbox = node.at("gearbox.elastic_properties")
        return gearbox.number("torsional_stiffness", 1.0, 1e15), gearbox.number("torsional_damping", 0.0, 1e15)
    body = node.at("elastic_properties")
    hint = f" (or, instead, {node.where('gearbox.elastic_properties')} with the torsion of the drivetrain)"
    return (
        body.number("spring_constant", 1.0, 1e15, hint=hint),
        body.number("damping_coefficient", 0.0, 1e15, hint=hint),
    )


def _generator_efficiency(node: Node, control: Node, speed: float, ideal_torque: float, notes: list[str]) -> float:
    """Return the efficiency at the rated generator speed [rad/s]; ``ideal_torque`` [N m] is the lossless rated one."""
    key = "generator.rpm_efficiency"
    if key in node:
        table = node.at(key)
        grid = table.array("grid")
        values = table.array("values", grid.size)
        if np.any(values > 0.0):
            efficiency = float(np.interp(speed / rpm, grid, values))
            if not 0.0 < efficiency <= 1.0:
                raise fail(table.where("values"), efficiency, "efficiencies in (0, 1]")
            return efficiency
    if "max_gen_torque" in control:
        efficiency = _TORQUE_MARGIN * ideal_torque / control.number("max_gen_torque", 1.0, 1e12)
        if 0.8 <= efficiency <= 1.0:
            notes.append(
                f"{node.where(key)}: not in the file, {efficiency:.4f} follows from control.max_gen_torque, taken as "
                "110 % of the rated torque"
            )
            return efficiency
    notes.append(f"{node.where(key)}: not in the file, 0.95 is assumed")
    return 0.95


def read_pitch(root: Node, notes: list[str]) -> PitchSystem:
    """Build the limits of the pitch system from ``control``.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is missing or wrong.
    """
    control = root.at("control")
    degree = np.pi / 180.0
    with within("control"):
        return PitchSystem(
            min_pitch=_optional(control, "min_pitch_limit", -90.0, 90.0, degree, 0.0, "0 deg", notes),
            max_pitch=_optional(control, "max_pitch_limit", -90.0, 90.0, degree, 0.5 * np.pi, "90 deg", notes),
            max_rate=control.number("max_pitch_rate", 1e-3, 570.0, degree),
        )


def _optional(
    node: Node, key: str, low: float, high: float, scale: float, default: float, words: str, notes: list[str]
) -> float:
    if key in node:
        return node.number(key, low, high, scale)
    notes.append(f"{node.where(key)}: not in the file, {words} assumed")
    return default
