"""Keywords of an OpenFAST model that change what it does and that a turbine does not hold, for its notes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.turbines.openfast_text import TextFile

__all__ = ["name_the_rest"]

_GRAVITY = 9.80665
_SAME_GRAVITY = 0.01
"""Difference in which models differ by rounding or by their site [m/s^2]."""
_LONGEST = 9000.0
"""Times of events [s] and cut-off frequencies [Hz] from which on they stand for never (9999.9 in most models)."""

_INITIAL = (
    "OoPDefl", "IPDefl", "BlPitch(1)", "BlPitch(2)", "BlPitch(3)", "Azimuth", "RotSpeed", "NacYaw", "TTDspFA",
    "TTDspSS", "PtfmSurge", "PtfmSway", "PtfmHeave", "PtfmRoll", "PtfmPitch", "PtfmYaw",
)  # fmt: skip
_BLADE_MODES = ("FlapDOF1", "FlapDOF2", "EdgeDOF")
_PLATFORM = ("PtfmSgDOF", "PtfmSwDOF", "PtfmHvDOF", "PtfmRDOF", "PtfmPDOF", "PtfmYDOF")
_SUPPORT = {
    "CompSeaSt": "waves",
    "CompHydro": "loads of the water",
    "CompSub": "the substructure",
    "CompMooring": "the mooring",
    "CompIce": "ice",
    "CompSoil": "the soil",
}

# file, what the keywords are, keywords with the value that changes nothing
_GROUPS: tuple[tuple[str, str, Mapping[str, float | bool]], ...] = (
    ("elastodyn", "initial conditions; runs start from a steady state", dict.fromkeys(_INITIAL, 0.0)),
    (
        "elastodyn",
        "motions that the model fixes and that are free here",
        dict.fromkeys(("TwFADOF1", "TwFADOF2", "TwSSDOF1", "TwSSDOF2", "GenDOF", "YawDOF"), True),
    ),
    (
        "elastodyn",
        "places of sensors and reference of the azimuth",
        dict.fromkeys(("NcIMUxn", "NcIMUyn", "NcIMUzn", "ShftGagL", "AzimB1Up"), 0.0),
    ),
    (
        "elastodyn",
        "inertias of pitch bearing and blade about the pitch axis",
        {f"{key}({i})": 0.0 for key in ("PBrIner", "BlPIner") for i in (1, 2, 3)},
    ),
    ("elastodyn", "friction of the yaw bearing", {"YawFrctMod": 0.0}),
    ("elastodyn", "a gearbox that reverses the direction", {"GBRevers": False}),
    ("elastodyn", "pitch bearings that turn on springs; drives turn the blades here", {"PitchDOF": False}),
    ("servodyn", "neutral position of the yaw spring, which is 0 here", {"YawNeut": 0.0}),
    ("servodyn", "neutral positions of the pitch springs", {f"PitNeut({i})": 0.0 for i in (1, 2, 3)}),
    ("servodyn", "reference of the nacelle's yaw angle", {"NacYaw_North": 0.0}),
    ("servodyn", "yaw control", {"YCMode": 0.0}),
    ("servodyn", "start and stop of the generator by its speed and power", {"GenTiStr": True, "GenTiStp": True}),
    ("servodyn", "control of the flow over the airfoils", {"AfCmode": 0.0}),
    ("servodyn", "control of cables", {"CCmode": 0.0}),
    ("servodyn", "structural dampers of the blades", {"NumBStC": 0.0}),
    ("servodyn", "structural dampers of the nacelle", {"NumNStC": 0.0}),
    ("servodyn", "structural dampers of the tower", {"NumTStC": 0.0}),
    ("servodyn", "structural dampers of the substructure", {"NumSStC": 0.0}),
    ("servodyn", "mass dampers of nacelle and tower", {"CompNTMD": False, "CompTTMD": False}),  # up to OpenFAST 2
    ("aerodyn", "the tail fin", {"TFinAero": False}),
    ("aerodyn", "the drag of the nacelle", {"NacelleDrag": False}),
    ("aerodyn", "buoyancy", {"Buoyancy": False}),
)
_DELAYS = ("TPCOn", "TimGenOn")
"""Times at which what runs here from the beginning starts."""
_EVENTS = ("TPitManS(1)", "TPitManS(2)", "TPitManS(3)", "TimGenOf", "THSSBrDp", "TYawManS")
_AERODYNAMICS = (
    "Wake_Mod", "WakeMod", "BEM_Mod", "AFAeroMod", "UA_Mod", "UAMod", "DBEMT_Mod", "Skew_Mod", "SkewMod", "TwrPotent",
    "TwrShadow", "TipLoss", "HubLoss", "TanInd", "AIDrag", "TIDrag", "SectAvg", "AoA34",
)  # fmt: skip
_CONTROL_MODES = {
    "PCMode": {0: "the model holds the pitch (BlPitch); here a controller moves the blades"},
    "VSContrl": {0: "the model's generator has no control of its speed; here a controller gives its torque"},
}
_ROUTINES = "control by a routine of the user is left aside"


def name_the_rest(
    primary: TextFile, elastodyn: TextFile, servodyn: TextFile | None, aerodyn: TextFile, notes: list[str]
) -> None:
    """Note what the model has and the turbine does not hold.

    Parameters
    ----------
    primary, elastodyn, servodyn, aerodyn : TextFile or None
    notes : list of str
        Receives the sentences.
    """
    left = [f"{what} ({key})" for key, what in _SUPPORT.items() if primary.integer(key, 0) != 0]
    if any(elastodyn.flag(key) for key in _PLATFORM):
        left.append("the motion of the platform")
    if left:
        base = elastodyn.number("TowerBsHt")
        notes.append(f"left aside: {', '.join(left)}; the tower is clamped at its base, {base:g} m up")
    files = {"elastodyn": elastodyn, "servodyn": servodyn, "aerodyn": aerodyn}
    for name, words, neutral in _GROUPS:
        _note(files[name], words, neutral, notes)
    if primary.integer("CompElast") == 1:  # BeamDyn's blade has no such modes
        _note(elastodyn, "modes that the model fixes and that are free here", dict.fromkeys(_BLADE_MODES, True), notes)
    gravity = primary if "Gravity" in primary else elastodyn  # up to OpenFAST 2
    if abs(gravity.number("Gravity", _GRAVITY) - _GRAVITY) > _SAME_GRAVITY:
        notes.append(f"left aside: Gravity {gravity.number('Gravity'):g} m/s^2; here it is {_GRAVITY} m/s^2")
    models = ", ".join(f"{key} {aerodyn.text(key)}" for key in _AERODYNAMICS if key in aerodyn)
    if models:
        notes.append(f"{aerodyn.path.name}: left aside: AeroDyn's models; those of this package act here ({models})")
    if servodyn is not None:
        _name_control(servodyn, notes)


def _note(file: TextFile | None, words: str, neutral: Mapping[str, float | bool], notes: list[str]) -> None:
    """Note the keywords of a file that do not have their neutral values."""
    if file is None:
        return
    active = [key for key, value in neutral.items() if key in file and _value(file, key, value) != value]
    if active:
        given = ", ".join(f"{key} {file.text(key)}" for key in active)
        notes.append(f"{file.path.name}: left aside: {words} ({given})")


def _value(file: TextFile, key: str, like: float | bool) -> float | bool:
    return file.flag(key) if isinstance(like, bool) else file.number(key)


def _name_control(servodyn: TextFile, notes: list[str]) -> None:
    """Note control modes that are not those of a turbine here, and events of the simulation."""
    for key, words in _CONTROL_MODES.items():
        mode = servodyn.integer(key, 5)
        if mode in words:
            notes.append(f"{servodyn.path.name}: {key} {mode}: {words[mode]}")
        elif mode in (3, 4):
            notes.append(f"{servodyn.path.name}: {key} {mode}: {_ROUTINES}")
    events = [key for key in _EVENTS if key in servodyn and servodyn.number(key) < _LONGEST]
    events += [key for key in _DELAYS if key in servodyn and servodyn.number(key) > 0.0]
    if events:
        given = ", ".join(f"{key} {servodyn.text(key)} s" for key in events)
        notes.append(f"{servodyn.path.name}: left aside: events of the simulation ({given})")
    if servodyn.number("BPCutoff", _LONGEST) < _LONGEST:
        notes.append(f"{servodyn.path.name}: left aside: a filter of the demanded pitch (BPCutoff)")
