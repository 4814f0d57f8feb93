"""Turbines from models of OpenFAST: the primary file (``.fst``) and the files that it names.

ElastoDyn counts along its shaft axis, which points downwind: an upwind rotor has a negative OverHang, its usual tilt
and cone are negative. Here all three are positive.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.turbines.blade import Blade
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.model import ControlData, Drivetrain, Hub, Nacelle, PitchSystem, Turbine
from wt_gym.turbines.openfast_blade import STRUCTURES, read_openfast_blade, read_openfast_tower
from wt_gym.turbines.openfast_control import ASIDE, Rating, read_openfast_control, read_rating
from wt_gym.turbines.openfast_platform import MOTIONS, floats, read_openfast_platform
from wt_gym.turbines.openfast_text import Model, TextFile, as_number
from wt_gym.turbines.windio_machine import yaw_actuator

CUT_IN, CUT_OUT = 3.0, 25.0
"""Where a model has none [m/s]: OpenFAST models do not say it."""

_BETZ = 16.0 / 27.0
_NOMINAL = 0.009  # Part by which the nominal radius TipRad may exceed that of the coned rotor
_DEGREE = np.pi / 180.0
_YAW_RATE, _PITCH_RATE = 0.3 * _DEGREE, 8.0 * _DEGREE
"""Of the NREL 5-MW [rad/s], where a model has none."""
_TORQUE_MARGIN, _TORQUE_TIME = 1.1, 3.0
"""Largest over rated torque [-] and time in which the torque runs through the rated one [s], where no file has them:
about those of the NREL 5-MW."""
_RIGID_SHAFT = 1e15
"""Stiffness [N m/rad] with which the shaft of any turbine is stiffer than what a simulation lets twist."""


def read_openfast(
    path: str | Path, rated_power: float | None = None, rated_rotor_speed: float | None = None, blade: str | None = None
) -> Turbine:
    """Build a turbine from an OpenFAST model of any release from 2 to 5.

    Parameters
    ----------
    path : str or Path
        Primary file of the model (``.fst``).
    rated_power : float, optional
        Electrical [W], for a model that does not say it: its torque is neither by ROSCO (VSContrl 5 with a DISCON.IN)
        nor by ServoDyn's own law (VSContrl 1).
    rated_rotor_speed : float, optional
        [rad/s], likewise.
    blade : str, optional
        "elastodyn" or "beamdyn", the module whose files give the structure of the blade; by default that of CompElast.

    Returns
    -------
    Turbine
        ``notes`` lists what was assumed, and what the model has and the turbine does not hold.

    Raises
    ------
    TurbineDefinitionError
        Naming file and keyword of what is missing, inconsistent, out of range, or would make another turbine here: a
        downwind rotor, blades that differ, teeter, furling, tip masses, water turbines.

    Examples
    --------
    >>> read_openfast("NREL-5MW.fst")  # doctest: +SKIP
    """
    if rated_power is not None:
        rated_power = check_number("rated_power", rated_power, 1.0, 1e9)
    if rated_rotor_speed is not None:
        rated_rotor_speed = check_number("rated_rotor_speed", rated_rotor_speed, 1e-3, 1000.0)
    if blade not in (None, *STRUCTURES):
        raise fail("blade", blade, f"one of {', '.join(map(repr, STRUCTURES))} or None")
    model = Model(Path(path))
    elastodyn = model.elastodyn
    gearbox = elastodyn.number("GBoxEff") / 100.0
    rating = read_rating(model, rated_power, rated_rotor_speed)
    hub = _hub(model)
    length = elastodyn.number("TipRad") - hub.radius
    body = read_openfast_blade(model, blade, length, hub.radius, rating.rotor_speed)
    tower = read_openfast_tower(model)
    floater = read_openfast_platform(model)
    nacelle = _nacelle(model, body, hub)
    # before OpenFAST 3 the density of the air stood in AeroDyn's file only
    file = model.primary if model.aerodyn.is_default("AirDens") else model.aerodyn
    density = check_number(f"{file.path.name}: AirDens", file.number("AirDens"), 0.1, 10.0)
    tip = hub.radius + length
    radius = tip * float(np.cos(hub.cone))
    drivetrain = _drivetrain(model, gearbox, rating)
    pitch = _pitch(model)
    control = read_openfast_control(model, rating, radius, density)
    _note_the_rest(model)
    rotation = "clockwise"  # the blade files describe this one in any case
    if model.primary.flag("MirrorRotor"):
        rotation = "counter-clockwise"
        model.note(
            "MirrorRotor: True, the rotor turns counter-clockwise; OpenFAST 5.0 reads this flag without using it"
        )
    model.note(f"OpenFAST models have no cut-in and cut-out wind, {CUT_IN:g} and {CUT_OUT:g} m/s assumed")
    model.note("OpenFAST models have no wind class, IEC class I and turbulence class B assumed")
    rated_wind = _rated_wind(model, rating, gearbox, control, radius, density)
    return Turbine(
        name=model.primary.path.stem,
        n_blades=model.n_blades,
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (tip if tip - radius < _NOMINAL * radius else radius),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt)),
        rated_wind_speed=rated_wind,
        cut_in=CUT_IN,
        cut_out=CUT_OUT,
        air_density=density,
        blade=body,
        tower=tower,
        hub=hub,
        nacelle=nacelle,
        drivetrain=drivetrain,
        pitch=pitch,
        iec_class="I",
        turbulence_class="B",
        notes=tuple(model.notes),
        control=control,
        rotation=rotation,
        floater=floater,
    )


def _rated_wind(
    model: Model, rating: Rating, gearbox: float, control: ControlData | None, radius: float, density: float
) -> float:
    """Return the wind at which the rotor has rated power at its largest power coefficient [m/s].

    The rotor gives what the generator takes and what the gearbox of efficiency ``gearbox`` loses.
    """
    cp = None if control is None else control.peak_power_coefficient
    if cp is None:
        cp = 0.8 * _BETZ
        how = f"with a power coefficient of {cp:.3f} (0.8 of Betz's), which the model does not say"
    else:
        how = f"with the power coefficient {cp:.3f} of the controller's data"
    wind = (rating.mechanical_power / gearbox / (0.5 * density * np.pi * radius**2 * cp)) ** (1.0 / 3.0)
    model.note(f"rated wind speed: {wind:.2f} m/s is where the rotor reaches rated power {how}")
    return float(wind)


def _hub(model: Model) -> Hub:
    file = model.elastodyn
    cones = [file.number(f"PreCone({i + 1})") for i in range(model.n_blades)]
    if max(cones) - min(cones) > 1e-6:
        raise file.fail("PreCone", cones, "the same cone for all blades")
    axial = transverse = file.number("HubIner")
    if model.n_blades == 2:
        model.note("HubIner is that about the teeter axis, the same is used about the shaft", file)
    elif not (transverse := file.number("HubIner_Teeter", 0.0)):
        transverse = axial
        model.note("HubIner is that about the shaft, the same is used across it", file)
    return Hub(
        radius=file.number("HubRad"),
        cone=-_DEGREE * cones[0] or 0.0,
        mass=file.number("HubMass"),
        inertia_axial=axial,
        inertia_transverse=transverse,
        cm_offset_along_shaft=file.number("HubCM"),
    )


def _nacelle(model: Model, blade: Blade, hub: Hub) -> Nacelle:
    """Build the nacelle.

    ElastoDyn's nacelle has an inertia about the yaw axis only. The others are those of a homogeneous box with this
    inertia whose cross-section is a square that stands on the tower top.
    """
    file, servodyn = model.elastodyn, model.servodyn
    overhang = file.number("OverHang")
    if overhang >= 0.0:
        raise file.fail("OverHang", overhang, "a negative number: an upwind rotor (others are not modeled)")
    mass, yaw_inertia = file.number("NacMass"), file.number("NacYIner")
    cm = np.array([file.number(key) for key in ("NacCMxn", "NacCMyn", "NacCMzn")])
    of_center = mass * float(cm[0] ** 2 + cm[1] ** 2)
    vertical = yaw_inertia - of_center
    if vertical < -1e-6 * max(yaw_inertia, 1.0):
        allowed = f"at least NacMass (NacCMxn^2 + NacCMyn^2) = {of_center:g}"
        raise file.fail("NacYIner", yaw_inertia, allowed)
    vertical = max(vertical, 0.0)
    roll = min(mass * (2.0 * float(cm[2])) ** 2 / 6.0, vertical)
    model.note(
        f"NacYIner is about the yaw axis; roll {roll:.4g} and pitch {vertical:.4g} kg m^2 of the nacelle are those of "
        "a box on the tower top with this yaw inertia", file,
    )  # fmt: skip
    if servodyn is not None and servodyn.number("YawManRat", 0.0) > 0.0:
        rate = min(_DEGREE * servodyn.number("YawManRat"), 1.0)
    else:
        rate = model.number(None, "YawManRat", _YAW_RATE, "0.3 deg/s")
    if servodyn is not None and servodyn.number("YawSpr", 0.0) > 0.0:
        spring, damper = servodyn.number("YawSpr"), servodyn.number("YawDamp", 0.0)
    else:
        model.note("YawSpr: not in the model, a yaw actuator with 3 Hz and 2 % damping is assumed")
        spring, damper = yaw_actuator(blade, hub, model.n_blades, -overhang, vertical + of_center)
    return Nacelle(
        mass=mass,
        cm=cm,
        inertia=np.diag([roll, vertical, vertical]),
        tilt=-_DEGREE * file.number("ShftTilt") or 0.0,
        overhang=-overhang,
        tower_top_to_shaft=file.number("Twr2Shft"),
        yaw_bearing_mass=file.number("YawBrMass"),
        yaw_spring=spring,
        yaw_damper=damper,
        max_yaw_rate=rate,
    )


def _drivetrain(model: Model, gearbox: float, rating: Rating) -> Drivetrain:
    """Build the drivetrain; limits of the torque come from a DISCON.IN of ROSCO that controls it."""
    file, discon, ratio = model.elastodyn, model.torque, rating.gear_ratio
    rated = rating.mechanical_power / (rating.rotor_speed * ratio)
    spring = file.number("DTTorSpr")
    if spring < 0.0:
        raise file.fail("DTTorSpr", spring, "a number of at least 0")
    if not file.flag("DrTrDOF", True):
        words = "twists by DTTorSpr" if spring > 0.0 else "is rigid (DTTorSpr 0)"
        model.note(f"DrTrDOF is False; the shaft {words} here", file)
        spring = spring or _RIGID_SHAFT
    elif spring == 0.0:
        allowed = "a number above 0 with DrTrDOF True: rotor and generator are not connected"
        raise file.fail("DTTorSpr", spring, allowed)
    most = model.number(discon, "VS_MaxTq", _TORQUE_MARGIN * rated, "110 % of the rated torque")
    rate = model.number(discon, "VS_MaxRat", rated / _TORQUE_TIME, "a third of the rated torque per second")
    slowest = model.number(discon, "VS_MinOMSpd", 0.0, "a least rotor speed of 0") / ratio
    return Drivetrain(
        gear_ratio=ratio,
        gearbox_efficiency=gearbox,
        generator_efficiency=rating.generator_efficiency,
        generator_inertia=file.number("GenIner"),
        spring=spring,
        damper=file.number("DTTorDmp"),
        rated_power=rating.power,
        rated_rotor_speed=rating.rotor_speed,
        min_rotor_speed=min(slowest, rating.rotor_speed),
        max_generator_torque=most,
        max_torque_rate=rate,
    )


def _pitch(model: Model) -> PitchSystem:
    """Build the limits of the pitch system, from the DISCON.IN that controls it or the Bladed interface of ServoDyn."""
    discon, servodyn = model.pitch, model.servodyn
    if discon is not None and all(key in discon for key in ("PC_MinPit", "PC_MaxPit", "PC_MaxRat")):
        frequency, damping = None, 1.0
        if discon.integer("PA_Mode", 0) > 0:
            frequency = discon.number("PA_CornerFreq")
            if discon.integer("PA_Mode") == 2:
                damping = discon.number("PA_Damping")
            else:
                model.note("the pitch drive is critically damped here, with PA_CornerFreq", discon)
        low, high, rate = (discon.number(key) for key in ("PC_MinPit", "PC_MaxPit", "PC_MaxRat"))
        return PitchSystem(low, high, rate, frequency, damping)
    if servodyn is not None and servodyn.number("Ptch_Max", 0.0) > servodyn.number("Ptch_Min", 0.0):
        low, high, rate = (_DEGREE * servodyn.number(key) for key in ("Ptch_Min", "Ptch_Max", "PtchRate_Max"))
        if rate > 0.0:
            model.note("limits of the pitch from Ptch_Min, Ptch_Max and PtchRate_Max", servodyn)
            return PitchSystem(low, high, rate)
    model.note("limits of the pitch: not in the model, 0 to 90 deg at up to 8 deg/s assumed")
    return PitchSystem(0.0, 0.5 * np.pi, _PITCH_RATE)


# ---- what the model has and the turbine does not hold ----------------------------------------------------------------

_GRAVITY = 9.80665
_SAME_GRAVITY = 0.01  # Difference in which models differ by rounding or by their site [m/s^2]
_LONGEST = 9000.0
"""Times of events [s] and cut-off frequencies [Hz] from which on they stand for never (9999.9 in most models)."""

_GROUPS: tuple[tuple[str, str, Mapping[str, float | bool]], ...] = tuple(
    (group["file"], group["words"], dict.fromkeys(group["names"], group["neutral"])) for group in ASIDE["keywords"]
)
"""File, what its keywords are, and they with the value that changes nothing."""


def _note_the_rest(model: Model) -> None:
    """Note the keywords that change what the model does and that the turbine does not hold."""
    primary, elastodyn, servodyn, aerodyn = model.primary, model.elastodyn, model.servodyn, model.aerodyn
    is_afloat = floats(model)
    modeled = ("CompSeaSt", "CompHydro", "CompMooring") if is_afloat else ()
    left = [
        f"{what} ({key})"
        for key, what in ASIDE["support"].items()
        if key not in modeled and primary.integer(key, 0) != 0
    ]
    if not is_afloat and any(elastodyn.flag(key) for key in MOTIONS):
        left.append("the motion of the platform")
    if left and is_afloat:
        model.note(f"left aside: {', '.join(left)}")
    elif left:
        base = elastodyn.number("TowerBsHt")
        model.note(f"left aside: {', '.join(left)}; the tower is clamped at its base, {base:g} m up")
    files = {"elastodyn": elastodyn, "servodyn": servodyn, "aerodyn": aerodyn}
    groups = [*_GROUPS]
    if primary.integer("CompElast") == 1:  # BeamDyn's blade has no such modes
        modes = "modes that the model fixes and that are free here"
        groups.append(("elastodyn", modes, dict.fromkeys(ASIDE["blade_modes"], True)))
    for name, words, neutral in groups:
        file = files[name]
        if file is not None and (active := [key for key, value in neutral.items() if _differs(file, key, value)]):
            given = ", ".join(f"{key} {file.text(key)}" for key in active)
            model.note(f"left aside: {words} ({given})", file)
    gravity = primary if "Gravity" in primary else elastodyn  # up to OpenFAST 2
    if abs(gravity.number("Gravity", _GRAVITY) - _GRAVITY) > _SAME_GRAVITY:
        model.note(f"left aside: Gravity {gravity.number('Gravity'):g} m/s^2; here it is {_GRAVITY} m/s^2")
    models = ", ".join(f"{key} {aerodyn.text(key)}" for key in ASIDE["aerodynamics"] if key in aerodyn)
    if models:
        model.note(f"left aside: AeroDyn's models; those of this package act here ({models})", aerodyn)
    if servodyn is not None:
        _note_control(model, servodyn)


def _differs(file: TextFile, key: str, value: float | bool) -> bool:
    return key in file and (file.flag(key) if isinstance(value, bool) else file.number(key)) != value


def _note_control(model: Model, servodyn: TextFile) -> None:
    """Note control modes that are not those of a turbine here, and events of the simulation."""
    for key, words in ASIDE["no_control"].items():
        mode = servodyn.integer(key, 5)
        if mode == 0:
            model.note(f"{key} 0: {words}", servodyn)
        elif mode in (3, 4):
            model.note(f"{key} {mode}: control by a routine of the user is left aside", servodyn)
    events = [key for key in ASIDE["events"] if key in servodyn and servodyn.number(key) < _LONGEST]
    events += [key for key in ASIDE["delays"] if key in servodyn and servodyn.number(key) > 0.0]
    if events:
        given = ", ".join(f"{key} {servodyn.text(key)} s" for key in events)
        model.note(f"left aside: events of the simulation ({given})", servodyn)
    if servodyn.number("BPCutoff", _LONGEST) < _LONGEST:
        model.note("left aside: a filter of the demanded pitch (BPCutoff)", servodyn)


# ---- a second reading, by the package openfast_io --------------------------------------------------------------------

_REFUSALS = (ValueError, IndexError, KeyError, TypeError, AttributeError, OSError)
"""What its reader raises where a line is not what it expects."""
_SHOWN = 3
_ROUNDING = 1e-9


def compare_with_openfast_io(path: str | Path) -> list[str]:
    """Read the primary files of a model with ``openfast_io``, and compare each number with that beside its keyword.

    ``openfast_io`` reads lines by their number, in the format of its own release. A file of another release it refuses
    at the first word where it expects a number, or reads with the numbers of lines beside.

    Parameters
    ----------
    path : str or Path
        Primary file (``.fst``).

    Returns
    -------
    list of str
        One line for each module: how many numbers agree, which do not, or where the package stops.

    Raises
    ------
    ModuleNotFoundError
        If the package is not installed (extra ``openfast``).
    """
    import openfast_io  # noqa: F401 - fails by the name of the package where it is missing
    from openfast_io.FAST_reader import InputReader_OpenFAST

    primary = TextFile(Path(path))
    reader = InputReader_OpenFAST()
    reader.FAST_InputFile, reader.FAST_directory = primary.path.name, str(primary.path.parent)
    elastodyn = primary.file("EDFile")
    tower = elastodyn.file("TwrFile")
    lines = [
        _comparison("Fst", reader, reader.read_MainInput, primary),
        _comparison("ElastoDyn", reader, lambda: reader.read_ElastoDyn(str(elastodyn.path)), elastodyn),
        _comparison("ElastoDynTower", reader, lambda: reader.read_ElastoDynTower(str(tower.path)), tower),
    ]
    for module, key, read in (
        ("AeroDyn", "AeroFile", reader.read_AeroDyn),
        ("ServoDyn", "ServoFile", reader.read_ServoDyn),
    ):
        # the reader lacks the path of a file where it stopped before in the primary file
        reader.fst_vt["Fst"].setdefault(key, primary.text(key))
        reader.fst_vt["Fst"].setdefault(f"{key}_path", str(Path(primary.text(key)).parent))
        lines.append(_comparison(module, reader, read, primary.file(key)))
    return lines


def _comparison(module: str, reader: Any, read: Callable[[], None], file: TextFile) -> str:
    stop = ""
    try:
        read()
    except _REFUSALS as error:
        stop = f"; it stops with {type(error).__name__}: {str(error)[:80]}"
    same, other = 0, []
    for key, value in reader.fst_vt[module].items():
        if not isinstance(value, (bool, int, float)) or key not in file:
            continue
        word = file.text(key)
        flags = {"true": 1.0, "t": 1.0, "false": 0.0, "f": 0.0}
        if (expected := flags.get(word.lower(), as_number(word))) is None:
            continue
        if abs(float(value) - expected) <= _ROUNDING * max(abs(expected), 1.0):
            same += 1
        else:
            other.append(f"{key} {value:g} instead of {expected:g}")
    shown = [*other[:_SHOWN], *(["..."] if len(other) > _SHOWN else [])]
    differ = f"; {len(other)} differ: {', '.join(shown)}" if other else ""
    return f"openfast_io, {module} ({file.path.name}): {same} numbers agree{differ}{stop}"
