"""Hub, nacelle, drivetrain and pitch system of a windIO file, and estimates of what it leaves to be computed.

Rigid bodies of windIO: ``inertia`` is the tensor (xx, yy, zz, xy, xz, yz) about the body's own center of mass and
``location`` that center (in the file of the IEA 15-MW turbine the inertia about the tower top, ``inertia_tt``, differs
from ``inertia`` by just the parallel-axis terms). Tools write 0 where they leave a number to be computed. What a file
leaves out is estimated and said in a note.

Masses follow the regressions of the NREL cost and scaling model in its revision of 2015, as WISDEM documents them
(Fingersh, Hand and Laxson, NREL/TP-500-40566, for the method; wisdem.readthedocs.io, NREL CSM, for the coefficients).
Inertias and the torsion of the shaft follow WISDEM's DrivetrainSE (Guo, Parsons, King, Dykes and Veers,
NREL/TP-5000-63008), except where a function says otherwise. Such numbers are good to some 20 %; what turns on them
most, the frequency of the tower, goes with the square root of the mass.
"""

from dataclasses import dataclass

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import Array
from wt_gym.turbines.blade import Blade
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, PitchSystem
from wt_gym.turbines.variants import rotor_inertia_without_generator
from wt_gym.turbines.windio_file import Node, within

rpm = np.pi / 30.0
"""One revolution per minute [rad/s]."""
_DEGREE = np.pi / 180.0
_YAW_FREQUENCY, _YAW_DAMPING = 3.0, 0.02
"""Yaw actuator where a file has none: natural frequency [Hz] and damping ratio of the NREL 5-MW turbine's."""
_TORQUE_MARGIN = 1.1
"""Largest over rated generator torque, in the NREL 5-MW report and in ROSCO, whose numbers windIO files carry."""
_RULE = "estimated by the NREL cost and scaling model of 2015"
_MISSING_LENGTH = {"distance_hub_mb": 1.912, "distance_mb_mb": 0.368}
"""Lengths of the two parts of a low-speed shaft where a file has none [m]; the defaults of windIO's schema."""
_DEFAULT_TORSION_DAMPING = 0.005  # Fraction of critical, the default of DrivetrainSE
_STEEL_SHEAR_MODULUS = 79.3e9


def read_machine(root: Node, rated_power: float, rotor_diameter: float, n_blades: int, blade_mass: float) -> "Machine":
    """Collect the arguments of the regressions for missing masses."""
    node = root.part("components.drivetrain.gearbox")
    kind = str(root.at("assembly").data.get("drivetrain", "")).lower()
    if "gear_ratio" not in node and "geared" in kind:
        raise TurbineDefinitionError(f"{node.where('gear_ratio')}: missing, and assembly.drivetrain is {kind!r}")
    return Machine(
        rated_power=rated_power,
        rated_speed=root.at("control").number("rated_rotor_speed", 1e-3, 1000.0, rpm),
        gear_ratio=node.number_or("gear_ratio", 1.0, 1000.0, 1.0, "a direct drive (1) is assumed"),
        rotor_diameter=rotor_diameter,
        hub_diameter=root.at("components.hub").number("diameter", 0.0, 30.0),
        n_blades=n_blades,
        blade_mass=blade_mass,
    )


def _generator_mass(root: Node, machine: "Machine") -> float:
    node = root.part("components.drivetrain.generator")
    return node.number("mass", 0.0, 1e9) if node.gives("mass") else machine.generator_mass()


def _estimated_masses(root: Node, machine: "Machine") -> tuple[float, float, float, str]:
    """Return hub, nacelle and yaw mass [kg] for a file that lacks them, and the words that say whence they come.

    A file that gives the mass of rotor and nacelle together (``components.RNA``, as WISDEM wrote it) has what the
    blades leave of it shared out in the proportions of the regressions.
    """
    weight = _generator_mass(root, machine)
    masses, words = np.array([machine.hub_mass(), machine.nacelle_mass(weight), machine.yaw_mass()]), _RULE
    together = root.part("components.RNA.elastic_properties_mb")
    if together.gives("mass"):
        blades = machine.n_blades * machine.blade_mass
        rest = together.number("mass", 0.0, 1e10) - blades
        if rest <= 0.0:
            raise fail(together.where("mass"), together.data["mass"], f"more than the {blades:g} kg of the blades")
        masses = masses * rest / masses.sum()
        words = f"a share of {together.where('mass')} in the proportions of the NREL CSM of 2015"
    hub, nacelle, yaw = masses.tolist()
    return hub, nacelle, yaw, words


def read_hub(root: Node, machine: "Machine") -> Hub:
    """Build the hub from ``components.hub``; mass, inertia and center of mass are estimated where missing."""
    node = root.at("components.hub")
    body = root.part("components.hub.elastic_properties")
    if body.gives("mass"):
        mass = body.number("mass", 0.0, 1e9)
    else:
        mass, _, _, words = _estimated_masses(root, machine)
        body.missing("mass", f"{mass:.4g} kg, {words}")
    if body.gives("inertia"):
        inertia = body.array("inertia")
        axial = transverse = float(inertia[0])
        if inertia.size >= 3:
            transverse = float(0.5 * (inertia[1] + inertia[2]))
        else:
            body.note("inertia", "only the axial inertia is given, the same is used across the shaft")
    else:
        axial = transverse = machine.hub_inertia(mass)
        body.missing("inertia", f"{axial:.4g} kg m^2, that of a spherical shell")
    center = 0.0
    if "location" in body:
        center = float(body.array("location")[0])
    else:
        body.missing("location", "the hub's center of mass is at the apex")
    with within(node.path):
        return Hub(
            radius=node.number("diameter", 0.0, 30.0, 0.5),
            cone=node.number("cone_angle", 0.0, 50.0, _DEGREE),
            mass=mass,
            inertia_axial=axial,
            inertia_transverse=transverse,
            cm_offset_along_shaft=center,
        )


def read_nacelle(root: Node, blade: Blade, hub: Hub, machine: "Machine") -> Nacelle:
    """Build the nacelle from ``components.drivetrain`` and ``components.yaw``.

    windIO gives the horizontal overhang and the height of the apex above the tower top; along the shaft the overhang is
    longer by 1/cos(tilt), and the shaft crosses the yaw axis lower by overhang * tan(tilt). A file without a yaw
    actuator gets one with 3 Hz and 2 % damping, with the inertia of nacelle and rotor about the yaw axis.
    """
    node = root.at("components.drivetrain")
    shape = node.at("outer_shape")
    tilt = shape.number("uptilt", 0.0, 20.0, _DEGREE)
    horizontal = shape.number("overhang", 0.0, 20.0)
    mass, cm, inertia = _nacelle_body(root, machine, horizontal, shape.number("distance_tt_hub", 0.0, 20.0))
    yaw = root.part("components.yaw.elastic_properties")
    if "spring_constant" in yaw:
        spring, damper = yaw.number("spring_constant", 1.0, 1e15), yaw.number("damping_coefficient", 0.0, 1e15)
    else:
        yaw.missing("spring_constant", "a yaw actuator with 3 Hz and 2 % damping is assumed")
        about_axis = inertia[2, 2] + mass * (cm[0] ** 2 + cm[1] ** 2)
        spring, damper = yaw_actuator(blade, hub, machine.n_blades, horizontal, about_axis)
    bearing = _yaw_mass(root, machine)
    rate = root.at("control").number_or("yaw_rate", 0.0, 10.0, 0.3 * np.pi / 180.0, "0.3 deg/s assumed", _DEGREE)
    with within(node.path):
        return Nacelle(
            mass=mass,
            cm=cm,
            inertia=inertia,
            tilt=tilt,
            overhang=horizontal / np.cos(tilt),
            tower_top_to_shaft=shape.number("distance_tt_hub", 0.0, 20.0) - horizontal * np.tan(tilt),
            yaw_bearing_mass=bearing,
            yaw_spring=spring,
            yaw_damper=damper,
            max_yaw_rate=rate,
        )


def yaw_actuator(blade: Blade, hub: Hub, n_blades: int, overhang: float, nacelle_inertia: float) -> tuple[float, float]:
    """Return spring [N m/rad] and damper [N m s/rad] of a yaw actuator with 3 Hz and 2 % damping.

    The rotor counts as straight and untilted; ``nacelle_inertia`` is that about the yaw axis [kg m^2].
    """
    blades = rotor_inertia_without_generator(blade, hub, n_blades) - hub.inertia_axial
    mass = n_blades * blade.structure.mass_moment(0) + hub.mass
    inertia = nacelle_inertia + (0.5 * blades + hub.inertia_transverse + mass * overhang**2)
    omega = 2.0 * np.pi * _YAW_FREQUENCY
    return inertia * omega**2, 2.0 * _YAW_DAMPING * inertia * omega


def _nacelle_body(root: Node, machine: "Machine", overhang: float, shaft_height: float) -> tuple[float, Array, Array]:
    """Return mass, center of mass from the tower top (3,) and inertia about it (3, 3), estimated where missing."""
    body = root.part("components.drivetrain.elastic_properties")
    if body.gives("mass"):
        mass = body.number("mass", 0.0, 1e9)
    else:
        _, mass, _, words = _estimated_masses(root, machine)
        body.missing("mass", f"{mass:.4g} kg for the nacelle, {words}")
    if "location" in body:
        center = body.array("location", 3)
    else:
        center = machine.nacelle_center(overhang, shaft_height)
        body.missing(
            "location", f"x = {center[0]:.2f} m and z = {center[2]:.2f} m from the tower top, in proportion to the "
            "overhang and the height of the hub",
        )  # fmt: skip
    if body.gives("inertia") and any(body.array("inertia")[:3]):
        return mass, center, _tensor(body)
    inertia = machine.nacelle_inertia(mass)
    reason = "not in the file" if "inertia" not in body else "no inertia about x, y and z in the file"
    body.note("inertia", f"{reason}, {inertia[2, 2]:.4g} kg m^2 about the vertical by rotor diameter")
    return mass, center, inertia


def _yaw_mass(root: Node, machine: "Machine") -> float:
    """Return the mass at the yaw bearing [kg]; estimated only beside an estimated nacelle."""
    body = root.part("components.yaw.elastic_properties")
    if "mass" in body:
        return body.number("mass", 0.0, 1e9)
    if root.part("components.drivetrain.elastic_properties").gives("mass"):
        root.missing(body.path, "no mass at the yaw bearing")
        return 0.0
    _, _, mass, words = _estimated_masses(root, machine)
    body.missing("mass", f"{mass:.4g} kg, {words}")
    return mass


def _tensor(body: Node) -> Array:
    values = body.array("inertia")
    if values.size not in (3, 6):
        raise fail(body.where("inertia"), values.tolist(), "xx, yy, zz and optionally xy, xz, yz [kg m^2]")
    tensor = np.diag(values[:3])
    if values.size == 6:
        for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), values[3:], strict=True):
            tensor[i, j] = tensor[j, i] = value
    return tensor


def read_drivetrain(root: Node, blade: Blade, hub: Hub, machine: "Machine") -> Drivetrain:
    """Build the drivetrain from ``components.drivetrain`` and ``control``.

    The torsion spring and damper, both seen from the low-speed shaft, come from ``gearbox.elastic_properties`` or, as
    in the IEA turbines, from ``elastic_properties.spring_constant`` and ``damping_coefficient``, or from the dimensions
    of the low-speed shaft. Where the generator's efficiency is not in the file it follows from the largest torque,
    taken as 110 % of the rated one.
    """
    node = root.at("components.drivetrain")
    control = root.at("control", "a mapping with rated_rotor_speed, max_gen_torque and the limits of the actuators")
    speed, ratio = machine.rated_speed, machine.gear_ratio
    gear_efficiency = root.part("components.drivetrain.gearbox").number_or("efficiency", 0.0, 1.0, 1.0, "1 is assumed")
    spring, damper = _torsion(root, rotor_inertia_without_generator(blade, hub, machine.n_blades), machine)
    shaft_torque = machine.rated_power / (speed * ratio * gear_efficiency)
    efficiency = _generator_efficiency(node, control, speed * ratio, shaft_torque)
    torque = shaft_torque / efficiency
    slowest = _min_rotor_speed(root, machine)
    most = control.number_or("max_gen_torque", 1.0, 1e12, _TORQUE_MARGIN * torque, "110 % of the rated torque assumed")
    words = "a third of the rated torque per second assumed"
    rate = control.number_or("max_torque_rate", 1.0, 1e12, torque / 3.0, words)
    with within(node.path):
        return Drivetrain(
            gear_ratio=ratio,
            gearbox_efficiency=gear_efficiency,
            generator_efficiency=efficiency,
            generator_inertia=_generator_inertia(root, machine),
            spring=spring,
            damper=damper,
            rated_power=machine.rated_power,
            rated_rotor_speed=speed,
            min_rotor_speed=slowest,
            max_generator_torque=most,
            max_torque_rate=rate,
        )


def _min_rotor_speed(root: Node, machine: "Machine") -> float:
    """Return the lowest rotor speed of operation [rad/s], where a file has none that of the optimal ratio at cut-in."""
    control, assembly = root.at("control"), root.at("assembly")
    if control.gives("min_rotor_speed"):
        return control.number("min_rotor_speed", 0.0, 1000.0, rpm)
    if "optimal_tsr" not in control:
        control.missing("min_rotor_speed", "0 rpm assumed")
        return 0.0
    cut_in = assembly.number("cut_in_wind_speed", 0.0, 30.0) if "cut_in_wind_speed" in assembly else 3.0
    speed = control.number("optimal_tsr", 0.1, 50.0) * cut_in / (0.5 * machine.rotor_diameter)
    speed = min(speed, 0.5 * machine.rated_speed)
    words = "of control.optimal_tsr at the cut-in wind speed, at most half the rated one"
    control.missing("min_rotor_speed", f"{speed / rpm:.3g} rpm, {words}")
    return speed


def _generator_inertia(root: Node, machine: "Machine") -> float:
    """Return the inertia of the generator about the high-speed shaft [kg m^2], estimated where it is missing."""
    node = root.part("components.drivetrain.generator")
    body = root.part("components.drivetrain.generator.elastic_properties")
    if body.gives("inertia"):
        return float(body.array("inertia")[0])
    radius = node.number("radius", 0.0, 20.0) if node.gives("radius") else None
    inertia = machine.generator_inertia(_generator_mass(root, machine), radius)
    words = "half its mass as a disk" if machine.direct_drive else "0.75 s of rated power at rated speed"
    body.missing("inertia", f"{inertia:.4g} kg m^2 at the generator's shaft, {words}")
    return inertia


def _torsion(root: Node, rotor_inertia: float, machine: "Machine") -> tuple[float, float]:
    """Return the torsional spring [N m/rad] and damper [N m s/rad] of the drivetrain at the low-speed shaft."""
    gearbox, body = (root.part(f"components.drivetrain.{part}") for part in ("gearbox", "elastic_properties"))
    geared = gearbox.part("elastic_properties")
    if "torsional_stiffness" in geared or "torsional_damping" in geared:
        return geared.number("torsional_stiffness", 1.0, 1e15), geared.number("torsional_damping", 0.0, 1e15)
    if body.gives("spring_constant"):
        spring = body.number("spring_constant", 1.0, 1e15)
        if "damping_coefficient" in body:
            return spring, body.number("damping_coefficient", 0.0, 1e15)
    else:
        spring = _shaft_spring(root, body)
    ratio = _DEFAULT_TORSION_DAMPING
    if "damping_ratio" in gearbox:
        ratio = gearbox.number("damping_ratio", 0.0, 1.0)
    body.missing("damping_coefficient", f"{100 * ratio:g} % of critical for the rotor")
    return spring, machine.shaft_damping(spring, ratio, rotor_inertia)


def _shaft_spring(root: Node, body: Node) -> float:
    """Return the torsional stiffness of the low-speed shaft from its dimensions [N m/rad]."""
    node, shaft = root.at("components.drivetrain"), root.part("components.drivetrain.lss")
    if not (shaft.gives("diameter") and shaft.gives("wall_thickness")):
        raise TurbineDefinitionError(
            f"{body.where('spring_constant')}: missing, expected is a number (or, instead, "
            f"{node.where('gearbox.elastic_properties')} with the torsion of the drivetrain, or {shaft.path} with "
            "diameter and wall_thickness of the low-speed shaft)"
        )
    diameter, thickness = (float(shaft.array(key).mean()) for key in ("diameter", "wall_thickness"))
    shape = node.at("outer_shape")
    if shaft.gives("length"):
        length = shaft.number("length", 0.0, 100.0)
    else:
        length = sum(
            shape.number(key, 0.0, 100.0) if shape.gives(key) else default for key, default in _MISSING_LENGTH.items()
        )
    modulus = _shear_modulus(root, shaft)
    value = shaft_stiffness(diameter, thickness, length, modulus)
    body.missing(
        "spring_constant", f"{value:.4g} N m/rad from the low-speed shaft ({length:.3g} m long, {diameter:.3g} m wide, "
        f"shear modulus {modulus:.3g} Pa)",
    )  # fmt: skip
    return value


def _shear_modulus(root: Node, shaft: Node) -> float:
    """Return the shear modulus [Pa] of the shaft's material, that of steel where the file does not give it."""
    name = shaft.data.get("material")
    for node in root.items("materials") if "materials" in root else []:
        if node.data.get("name") == name and node.data.get("orth") == 0:
            if "G" in node:
                return node.number("G", 1e6, 1e13)
            if "E" in node and "nu" in node:
                return node.number("E", 1e6, 1e13) / (2.0 * (1.0 + node.number("nu", -1.0, 0.5)))
    return _STEEL_SHEAR_MODULUS


def _generator_efficiency(node: Node, control: Node, speed: float, ideal_torque: float) -> float:
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
            words = "follows from control.max_gen_torque, taken as 110 % of the rated torque"
            node.missing(key, f"{efficiency:.4f} {words}")
            return efficiency
    node.missing(key, "0.95 is assumed")
    return 0.95


def read_pitch(root: Node) -> PitchSystem:
    """Build the limits of the pitch system from ``control``."""
    control = root.at("control")
    with within("control"):
        return PitchSystem(
            min_pitch=control.number_or("min_pitch_limit", -90.0, 90.0, 0.0, "0 deg assumed", _DEGREE),
            max_pitch=control.number_or("max_pitch_limit", -90.0, 90.0, 0.5 * np.pi, "90 deg assumed", _DEGREE),
            max_rate=control.number("max_pitch_rate", 1e-3, 570.0, _DEGREE),
        )


# ---- estimates -------------------------------------------------------------------------------------------------------

_SHELL = 2.0 / 3.0  # Inertia of a thin spherical shell about a diameter over mass times radius squared

GENERATOR_TIME_CONSTANT = 0.75
"""Kinetic energy of a geared generator at rated speed over rated power [s]."""


@dataclass(frozen=True)
class Machine:
    """Arguments of the regressions."""

    rated_power: float
    """[W]."""
    rated_speed: float
    """Of the rotor [rad/s]."""
    gear_ratio: float
    """1 for a direct drive."""
    rotor_diameter: float
    """[m]."""
    hub_diameter: float
    """[m]."""
    n_blades: int
    blade_mass: float
    """Of one blade [kg]."""

    @property
    def direct_drive(self) -> bool:
        """Whether there is no gearbox."""
        return self.gear_ratio <= 1.0

    @property
    def rotor_torque(self) -> float:
        """Rated torque of the rotor without losses [N m]."""
        return self.rated_power / self.rated_speed

    def hub_mass(self) -> float:
        """Return the mass of hub shell, pitch system and spinner [kg]."""
        shell = 2.3 * self.blade_mass + 1320.0
        bearings = 0.1295 * self.n_blades * self.blade_mass + 491.31
        pitch_system = bearings * (1.0 + 0.3280) + 555.0
        spinner = max(15.5 * self.rotor_diameter - 980.0, 0.0)  # below a rotor of 63 m the regression is negative
        return shell + pitch_system + spinner

    def hub_inertia(self, mass: float) -> float:
        """Return the inertia of a hub about any axis through its center, as a spherical shell [kg m^2]."""
        return _SHELL * mass * (0.5 * self.hub_diameter) ** 2

    def generator_mass(self) -> float:
        """Return the mass of the generator [kg].

        That of a direct drive is 18.5 kg per kN m of rated torque, in between those of the IEA 15-MW (19.6; 371.6 t)
        and the IEA 22-MW turbine (17.3; 508 t): the regression of the cost model, 37.7, is of machines of 2005.
        """
        if self.direct_drive:
            return 18.5e-3 * self.rotor_torque
        return 2.3e-3 * self.rated_power + 3400.0

    def generator_inertia(self, mass: float, radius: float | None) -> float:
        """Return the inertia of the generator's rotor about the high-speed shaft [kg m^2].

        That of a direct drive is a disk of half the generator's mass (DrivetrainSE). That of a geared machine stores
        0.75 s of rated power at rated speed, in between the NREL 5-MW (0.81 s: 534.1 kg m^2 at 1173.7 rpm,
        NREL/TP-500-38060) and the WindPACT 1.5-MW turbine (0.63 s: 53.04 kg m^2 at 1800 rpm, NREL/SR-500-32495); the
        disk of DrivetrainSE stores several times as much.

        Without the radius [m] of the generator of a direct drive it is 0.75 % of the rotor diameter, as in
        DrivetrainSE. ``mass`` is that of the generator [kg].
        """
        if self.direct_drive:
            radius = 0.0075 * self.rotor_diameter if radius is None else radius
            return 0.25 * mass * radius**2
        return 2.0 * GENERATOR_TIME_CONSTANT * self.rated_power / (self.rated_speed * self.gear_ratio) ** 2

    def nacelle_mass(self, generator_mass: float) -> float:
        """Return the mass of all that stands on the yaw bearing but the rotor, without the yaw system [kg].

        A direct drive has no shaft, gearbox or fast shaft of its own: its hub turns on the bearings of its generator.
        """
        kilowatt, diameter = 1e-3 * self.rated_power, self.rotor_diameter
        shaft = 0.0 if self.direct_drive else 13.0 * (self.blade_mass * kilowatt * 1e-3) ** 0.65 + 775.0
        bearings = 2.0 * 0.0001 * diameter**3.5
        gearbox = 0.0 if self.direct_drive else self.rotor_torque / 200.0
        fast_shaft = 0.0 if self.direct_drive else 0.19894 * kilowatt
        brake = 0.00122 * self.rotor_torque
        bedplate = diameter**2.2
        cooling = 0.08 * kilowatt
        cover = 1.2817 * kilowatt + 428.19
        platforms = 0.125 * bedplate
        transformer = 1.9150 * kilowatt + 1910.0
        parts = (shaft, bearings, gearbox, fast_shaft, brake, generator_mass, bedplate, cooling, cover, platforms)
        return float(sum(parts)) + transformer

    def yaw_mass(self) -> float:
        """Return the mass of the yaw system [kg]."""
        return float(1.5 * 0.0009 * self.rotor_diameter**3.314)

    def nacelle_center(self, overhang: float, shaft_height: float) -> Array:
        """Return the center of mass of a nacelle from the tower top (3,) [m].

        No published rule gives it. A geared machine has it a fifth of the overhang behind the yaw axis, in between the
        NREL 5-MW (0.38) and the NREL 2.8-127 (0.0) turbines; a direct drive, whose generator hangs before the tower,
        0.45 of the overhang before it, in between the IEA 15-MW (0.43) and IEA 22-MW (0.47). Its height is three
        quarters of the hub's, in between 0.5 and 0.81 of these four.
        """
        x = -0.45 * overhang if self.direct_drive else 0.2 * overhang
        return np.array([x, 0.0, 0.75 * shaft_height])

    def nacelle_inertia(self, mass: float) -> Array:
        """Return the inertia of a nacelle about its center of mass (3, 3) [kg m^2].

        Radii of gyration of 0.017 rotor diameters in pitch and yaw and 0.012 in roll: the means of the NREL 5-MW, NREL
        2.8-127, IEA 15-MW and IEA 22-MW turbines (0.010 to 0.021). The rotor has some twenty times as much.
        """
        return mass * self.rotor_diameter**2 * np.diag([0.012**2, 0.017**2, 0.017**2])

    def shaft_damping(self, stiffness: float, damping_ratio: float, rotor_inertia: float) -> float:
        """Return the damping of the shaft's torsion [N m s/rad], from a fraction of critical as in DrivetrainSE.

        Critical is 2 sqrt(k I) with the stiffness k seen from the low-speed shaft [N m/rad] and the inertia I of blades
        and hub about the shaft [kg m^2].
        """
        return 2.0 * damping_ratio * float(np.sqrt(stiffness * rotor_inertia))


def shaft_stiffness(diameter: float, thickness: float, length: float, shear_modulus: float) -> float:
    """Return the torsional stiffness G J / L of a hollow shaft [N m/rad]: outer diameter, wall, length [m], G [Pa]."""
    inner = max(diameter - 2.0 * thickness, 0.0)
    return shear_modulus * np.pi / 32.0 * (diameter**4 - inner**4) / length
