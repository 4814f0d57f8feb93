"""OpenFAST files of a turbine, for the tests of the reader: written from the numbers of the catalog's NREL 5-MW."""

from dataclasses import replace

import numpy as np

from wt_gym.turbines.airfoil import Polar
from wt_gym.turbines.blade import rotation_about_z

DEGREE, RPM = np.pi / 180, np.pi / 30
RULE = "---------------------- SECTION -------------------------------------------"
FIRST = 6  # node of the aerodynamic table with the first airfoil of several tables


def lines(title, entries):
    """File of ``value KEY - description`` lines; an entry without a key is a line of its own."""
    body = [f"{entry[1]!s:>16}   {entry[0]:14} - description" if len(entry) == 2 else entry[0] for entry in entries]
    return "\n".join([f"------- {title} INPUT FILE -------", "TITLE  HubRad - of the model", *body]) + "\n"


def rows(*columns):
    return [(" ".join(f"{value:.12e}" for value in row),) for row in zip(*columns, strict=True)]


def quoted(text):
    return f'"{text}"'


def with_few_points(turbine):
    """Turbine with short tables of its airfoils, of which files are read and written in little time."""
    airfoils = []
    for airfoil in turbine.blade.airfoils:
        polar = airfoil.polar
        at = np.unique(np.linspace(0, polar.alpha.size - 1, 12).astype(int))
        few = Polar(*(getattr(polar, name)[at] for name in ("alpha", "cl", "cd", "cm")))
        airfoils.append(replace(airfoil, polar=few, contour=airfoil.contour[::10]))
    return replace(turbine, blade=replace(turbine.blade, airfoils=tuple(airfoils)))


class Model:
    """Contents of the files by their names; change them and ``write``."""

    def __init__(self, turbine, beamdyn=False, release=5):
        self.turbine, self.release = turbine, release
        n = turbine.n_blades
        blade, hub, nacelle, train, tower = (
            turbine.blade, turbine.hub, turbine.nacelle, turbine.drivetrain, turbine.tower
        )  # fmt: skip
        self.primary = {
            "CompElast": 2 if beamdyn else 1, "CompAero": 2, "CompServo": 1, "CompHydro": 0, "CompSub": 0,
            "CompMooring": 0, "CompIce": 0, "EDFile": quoted("ed.dat"), "AeroFile": quoted("aero/ad.dat"),
            "ServoFile": quoted("servo/sd.dat"),
        } | {f"BDBldFile({i + 1})": quoted("bd.dat") for i in range(n)}  # fmt: skip
        if release >= 3:
            self.primary["AirDens"] = turbine.air_density
        if release >= 5:
            self.primary = {"NRotors": 1, "MHK": 0, "MirrorRotor": "F", "CompSoil": 0, **self.primary}
        yaw_inertia = nacelle.inertia[2, 2] + nacelle.mass * (nacelle.cm[0] ** 2 + nacelle.cm[1] ** 2)
        self.elastodyn = {
            "TeetDOF": "False", "DrTrDOF": "True", "PtfmSgDOF": "False", "RotSpeed": 12.1, "NumBl": n,
            "TipRad": hub.radius + blade.length, "HubRad": hub.radius,
            **{f"PreCone({i + 1})": -hub.cone / DEGREE for i in range(n)},
            "HubCM": hub.cm_offset_along_shaft, "UndSling": 0, "OverHang": -nacelle.overhang,
            "ShftTilt": -nacelle.tilt / DEGREE, "NacCMxn": nacelle.cm[0], "NacCMyn": nacelle.cm[1],
            "NacCMzn": nacelle.cm[2], "Twr2Shft": nacelle.tower_top_to_shaft, "TowerHt": tower.height,
            "TowerBsHt": tower.base_height, **{f"TipMass({i + 1})": 0 for i in range(n)}, "HubMass": hub.mass,
            "HubIner": hub.inertia_axial, "GenIner": train.generator_inertia, "NacMass": nacelle.mass,
            "NacYIner": yaw_inertia, "YawBrMass": nacelle.yaw_bearing_mass,
            **{f"BldFile{i + 1}" if release > 3 else f"BldFile({i + 1})": quoted("blade.dat") for i in range(n)},
            "GBoxEff": 100 * train.gearbox_efficiency, "GBRatio": train.gear_ratio, "DTTorSpr": train.spring,
            "DTTorDmp": train.damper, "Furling": "False", "TwrFile": quoted("tower.dat"),
        }  # fmt: skip
        self.servodyn = {
            "PCMode": 5, "VSContrl": 5, "GenEff": 100 * train.generator_efficiency, "VS_RtGnSp": 9999.9,
            "VS_RtTq": 9999.9, "VS_Rgn2K": 9999.9, "VS_SlPc": 9999.9, "YawSpr": nacelle.yaw_spring,
            "YawDamp": nacelle.yaw_damper, "YawManRat": nacelle.max_yaw_rate / DEGREE, "NumBStC": 0,
            "DLL_InFile": quoted("../DISCON.IN"), "Ptch_Min": 0, "Ptch_Max": 90, "PtchRate_Max": 8,
        }  # fmt: skip
        speed = train.rated_rotor_speed * train.gear_ratio
        self.discon = {
            "F_LPFType": 2, "PS_Mode": 1, "PA_Mode": 0, "VS_ConstPower": 1, "F_LPFCornerFreq": 1.570796,
            "F_LPFDamping": 0.7, "PC_GS_n": 3, "PC_GS_angles": "0.05 0.2 0.3", "PC_GS_KP": "-0.02 -0.01 -0.004",
            "PC_GS_KI": "-0.008 -0.004 -0.002", "PC_GS_KD": "0.0 0.0 0.0", "PC_MaxPit": 90 * DEGREE, "PC_MinPit": 0.0,
            "PC_MaxRat": turbine.pitch.max_rate, "PC_RefSpd": speed, "PC_FinePit": 0.01, "PC_Switch": 0.02,
            "VS_GenEff": 100 * train.generator_efficiency, "VS_MaxRat": train.max_torque_rate,
            "VS_MaxTq": train.max_generator_torque, "VS_MinOMSpd": train.min_rotor_speed * train.gear_ratio,
            "VS_Rgn2K": 2.332287, "VS_RtPwr": train.rated_power, "VS_RefSpd": 0.99 * speed, "VS_KP": -800.0,
            "VS_KI": -120.0, "VS_TSRopt": 7.5, "PS_WindSpeeds": "3.0 9.0 12.0", "PS_BldPitchMin": "0.01 0.02 0.06",
            "PA_CornerFreq": 3.14, "PA_Damping": 0.707, "IPC_ControlMode": 0,
        }  # fmt: skip
        self.factors = {"AdjBlMs": 1, "AdjFlSt": 1, "AdjEdSt": 1, "FlStTunr(1)": 1, "FlStTunr(2)": 1}
        self.tower_factors = {"AdjTwMa": 1, "AdjFASt": 1, "AdjSSSt": 1}
        self.bend = np.zeros(blade.aero_station.size)
        self.density = turbine.air_density if release < 3 else quoted("default")
        self.coordinates = True
        self.aerodyn = {
            "TwrAero": "True", "AirDens": self.density, **({"TFinAero": "False"} if release >= 3 else {}),
            "AFTabMod": 1, "InCol_Alfa": 1, "InCol_Cl": 2, "InCol_Cd": 3, "InCol_Cm": 4, "InCol_Cpmin": 0,
        }  # fmt: skip
        self.tables = {}

    def write(self, folder):
        """Write the files; return the path of the primary file."""
        for part in ("aero", "servo"):
            (folder / part).mkdir(exist_ok=True)
        files = {
            "model.fst": lines("OpenFAST", [(RULE,), *self.primary.items()]),
            "ed.dat": lines("ELASTODYN", [(RULE,), *self.elastodyn.items()]),
            "servo/sd.dat": lines("SERVODYN", [(RULE,), *self.servodyn.items()]),
            "DISCON.IN": "! title\n\n" + "".join(f"{v}   ! {k}  - description\n" for k, v in self.discon.items()),
            "blade.dat": self._elastodyn_blade(), "tower.dat": self._tower(), "bd.dat": self._beamdyn(),
            "bd_sections.dat": self._sections(), "aero/ad.dat": self._aerodyn(), "aero/blade.dat": self._aero_blade(),
        }  # fmt: skip
        for i, airfoil in enumerate(self.turbine.blade.airfoils):
            files[f"aero/af{i}.dat"] = self._airfoil(i, airfoil)
            files[f"aero/af{i}_coords.txt"] = self._contour(airfoil)
        for name, text in files.items():
            (folder / name).write_text(text)
        return folder / "model.fst"

    def _elastodyn_blade(self):
        s = self.turbine.blade.structure
        twist, flap, edge = principal(s.stiffness)
        table = rows(s.station / s.length, twist / DEGREE, s.inertia[:, 0, 0], flap, edge)
        damping = 100 * self.turbine.blade.damping_ratio
        return lines("ELASTODYN BLADE", [
            ("NBlInpSt", s.station.size), ("BldFlDmp(1)", damping), ("BldFlDmp(2)", damping), ("BldEdDmp(1)", damping),
            *self.factors.items(), (RULE,), ("BlFract StrcTwst BMassDen FlpStff EdgStff",), ("(-) (deg) (kg/m)",),
            *table, (RULE,), ("BldFl1Sh(2)", 0.0622),
        ])  # fmt: skip

    def _tower(self):
        tower = self.turbine.tower
        s, damping = tower.structure, 100 * tower.damping_ratio
        table = rows(s.station / s.length, s.inertia[:, 0, 0], s.stiffness[:, 4, 4], s.stiffness[:, 3, 3])
        keys = ("TwrFADmp(1)", "TwrFADmp(2)", "TwrSSDmp(1)", "TwrSSDmp(2)")
        return lines("ELASTODYN TOWER", [
            ("NTwInpSt", s.station.size), *((key, damping) for key in keys), *self.tower_factors.items(), (RULE,),
            ("HtFract TMassDen TwFAStif TwSSStif",), ("(-) (kg/m) (Nm^2) (Nm^2)",), *table,
        ])  # fmt: skip

    def _beamdyn(self):
        blade = self.turbine.blade
        z = blade.aero_station
        table = rows(self.bend, 0 * z, z, blade.twist / DEGREE)
        return lines("BEAMDYN", [
            (RULE,), ("member_total", 1), ("kp_total", z.size), (f"1 {z.size} - Member number; number of key points",),
            ("kp_xr kp_yr kp_zr initial_twist",), ("(m) (m) (m) (deg)",), *table, (RULE,), ("order_elem", 5), (RULE,),
            ("BldFile", quoted("bd_sections.dat")),
        ])  # fmt: skip

    def _sections(self):
        blade = self.turbine.blade
        s = blade.structure
        turn = rotation_about_z(blade.twist_at(np.minimum(s.station, blade.length)))
        back = np.swapaxes(turn, -1, -2)
        stiffness = turn @ np.where(np.isinf(s.stiffness), 1e13 * np.eye(6), s.stiffness) @ back
        inertia = turn @ s.inertia @ back
        blocks = []
        for eta, k, m in zip(s.station / s.length, stiffness, inertia, strict=True):
            blocks += [(f"{eta:.12e}",), *rows(*k.T), ("",), *rows(*m.T), ("",)]
        return lines("BEAMDYN BLADE", [
            (RULE,), ("station_total", s.station.size), ("damp_type", 1), (RULE,), ("mu1 mu2 mu3 mu4 mu5 mu6",),
            ("(-) (-) (-) (-) (-) (-)",), ("0.0018 0.0019 0.002 0.0018 0.0019 0.002",),
            ("---------------------- DISTRIBUTED PROPERTIES---------------------------------",), *blocks,
        ])  # fmt: skip

    def _aerodyn(self):
        tower, n = self.turbine.tower, len(self.turbine.blade.airfoils)
        drag = np.full(tower.diameter.size, tower.drag_coefficient)
        names = [(f'"af{i}.dat"' + (" AFNames - Airfoil file names" if i == 0 else ""),) for i in range(n)]
        return lines("AERODYN", [
            (RULE,), *self.aerodyn.items(), ("NumAFfiles", n), *names,
            *((f"ADBlFile({i + 1})", quoted("blade.dat")) for i in range(self.turbine.n_blades)),
            ("NumTwrNds", tower.diameter.size), ("TwrElev TwrDiam TwrCd",), ("(m) (m) (-)",),
            *rows(tower.base_height + tower.diameter_station, tower.diameter, drag),
        ])  # fmt: skip

    def _aero_blade(self):
        blade = self.turbine.blade
        z, chord, twist = blade.aero_station, blade.chord, blade.twist
        along = (0.25 - blade.le_offset) * chord
        place = np.searchsorted(blade.airfoil_station, z, side="right") - 1
        index = blade.airfoil_index[np.maximum(place, 0)] + 1
        table = rows(z, along * np.sin(twist) + self.bend, along * np.cos(twist), 0 * z, twist / DEGREE, chord, index)
        return lines("AERODYN BLADE", [
            (RULE,), ("NumBlNds", z.size), ("BlSpn BlCrvAC BlSwpAC BlCrvAng BlTwist BlChord BlAFID",),
            ("(m) (m) (m) (deg) (deg) (m) (-)",), *table,
        ])  # fmt: skip

    def _airfoil(self, i, airfoil):
        tables = self.tables.get(i, [(1.0, 0, airfoil.polar)])
        text = ["! AirfoilInfo", "1 InterpOrd ! order"]
        text.append(f'@"af{i}_coords.txt" NumCoords ! file' if self.coordinates else "0 NumCoords ! none")
        text.append(f"{len(tables)} NumTabs ! number")
        for reynolds, setting, polar in tables:
            text += [f"{reynolds} Re ! in millions", f"{setting} Ctrl ! setting", "True InclUAdata ! flag"]
            text += ["-3.2 alpha0 ! angle", f"{polar.alpha.size} NumAlf ! rows", "! Alpha Cl Cd Cm"]
            text += [row[0] for row in rows(np.degrees(polar.alpha), polar.cl, polar.cd, polar.cm)]
        return "\n".join(text) + "\n"

    @staticmethod
    def _contour(airfoil):
        points = [row[0] for row in rows(*airfoil.contour.T)]
        return "\n".join([f"{len(points) + 1} NumCoords ! points", "! reference", "0.25 0", "! shape", *points]) + "\n"


def principal(stiffness):
    """Structural twist [rad], flapwise and edgewise stiffness of sections (n, 6, 6) in the blade frame."""
    xx, xy, yy = stiffness[:, 3, 3], stiffness[:, 3, 4], stiffness[:, 4, 4]
    twist = 0.5 * np.arctan2(-2 * xy, xx - yy)
    radius = np.hypot(0.5 * (xx - yy), xy)
    return twist, 0.5 * (xx + yy) - radius, 0.5 * (xx + yy) + radius
