"""Floating platforms in files of OpenFAST: what is written is read back, models of others, refusals."""

import lzma
import re
import tarfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from wt_gym.base.errors import InflowError, SimulationError, TurbineDefinitionError
from wt_gym.bridges.openfast import write_model
from wt_gym.bridges.openfast.measurement import (
    AERODYN_OUTPUTS,
    INFLOW_OUTPUTS,
    Measurement,
    elastodyn_outputs,
    water_outputs,
)
from wt_gym.bridges.openfast.water import resting_place, write_sea, write_water
from wt_gym.hydrodynamics import PlatformLoads, SeaState, WaveComponents
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast import read_openfast
from wt_gym.turbines.openfast_platform import read_mooring, read_openfast_platform
from wt_gym.turbines.openfast_text import Model
from wt_gym.turbines.variants import mirrored
from wt_gym.turbines.windio_writer import windio_content

DECKS = Path(__file__).resolve().parents[3] / "shared" / "floating" / "decks"
NUMBERS = (
    "mass", "center", "inertia", "displaced_volume", "hydrostatic", "tower_base", "water_depth", "water_density",
    "center_of_buoyancy", "linear_damping", "quadratic_damping", "additional_stiffness",
)  # fmt: skip


@pytest.fixture(scope="module", params=["oc4_nrel_5mw", "volturnus_iea_15mw"])
def turbine(request):
    return load_turbine(request.param)


@pytest.fixture(scope="module")
def oc4():
    return load_turbine("oc4_nrel_5mw")


@pytest.fixture(scope="module")
def files(oc4, tmp_path_factory):
    """A written model as texts by the names of its files."""
    folder = write_model(oc4, tmp_path_factory.mktemp("model")).parent
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def written(files, folder, *changes):
    """Platform of a model with lines exchanged: file, pattern, text."""
    texts = dict(files)
    for name, pattern, text in changes:
        texts[name], count = re.subn(pattern, text, texts[name], count=1)
        assert count == 1, pattern
    for name, text in texts.items():
        (folder / name).write_text(text)
    return read_openfast_platform(Model(folder / "turbine.fst"))


def keyword(file, key, value):
    return file, rf"(?m)^\S+(\s+{re.escape(key)}\s)", rf"{value}\1"


def in_radians(table):
    rows = (line.split() for line in table[0].splitlines())
    return "".join(f"{a} {np.radians(float(b)):.6f} {' '.join(rest)}\n" for a, b, *rest in rows)


def test_a_written_platform_is_read_back(turbine, tmp_path):
    train = turbine.drivetrain
    path = write_model(turbine, tmp_path)
    read = read_openfast(path, rated_power=train.rated_power, rated_rotor_speed=train.rated_rotor_speed)
    found, wanted = read.floater, turbine.floater
    for name in NUMBERS:
        value = np.asarray(getattr(wanted, name))
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-12, atol=1e-12 * abs(value).max(), err_msg=name)
    assert (found.lines, found.members) == (wanted.lines, wanted.members)
    for one, other in zip(found.plates, wanted.plates, strict=True):
        np.testing.assert_array_equal(one.position, other.position)
        assert abs(one.axis @ other.axis) == pytest.approx(1.0)
        assert (one.area, one.drag_coefficient) == pytest.approx((other.area, other.drag_coefficient))
    frequency = np.linspace(0.06, 1.25, 50)
    for heading in (0.0, 0.4, -2.5):
        force = wanted.excitation.at(frequency, heading)
        np.testing.assert_allclose(found.excitation.at(frequency, heading), force, atol=1e-9 * abs(force).max())
    radiation = wanted.radiation
    at = np.searchsorted(found.radiation.frequency, radiation.frequency - 1e-6)
    for name in ("added_mass", "damping"):
        value = getattr(radiation, name)
        np.testing.assert_allclose(getattr(found.radiation, name)[at], value, atol=1e-8 * abs(value).max())
    np.testing.assert_allclose(found.radiation.added_mass_infinite, radiation.added_mass_infinite, rtol=1e-9, atol=1e-3)
    assert not found.radiation.damping[-1].any() or abs(radiation.damping[-1]).max() < 1e-6 * radiation.damping.max()


def test_windio_holds_no_platform(oc4):
    with pytest.raises(TurbineDefinitionError, match=r"Turbine\.floater must be None: windIO has no added mass"):
        windio_content(oc4)


def test_ballast_is_a_cylinder(files, oc4, tmp_path):
    """Water from z = -20 to -5 in the main column of 6.5 m with walls of 0.065 m, which stands on z = -20."""
    group = "hydrodyn.dat", r"0( +NFillGroups.*\n.*\n.*\n)", r"1\1 1 1 -5.0 default\n"
    platform, empty = written(files, tmp_path, group), oc4.floater
    radius, height = 0.5 * 6.5 - 0.065, 15.0
    mass = 1025.0 * np.pi * radius**2 * height
    assert platform.mass - empty.mass == pytest.approx(mass)
    assert platform.center[2] == pytest.approx((empty.mass * empty.center[2] - 12.5 * mass) / (empty.mass + mass))
    own = mass * (3.0 * radius**2 + height**2) / 12.0
    reduced = empty.mass * mass / (empty.mass + mass)
    assert platform.inertia[0, 0] - empty.inertia[0, 0] == pytest.approx(own + reduced * (empty.center[2] + 12.5) ** 2)
    assert platform.inertia[2, 2] - empty.inertia[2, 2] == pytest.approx(0.5 * mass * radius**2)


def test_members_that_taper_and_preload(files, tmp_path):
    """A cone has the drag of its projected area; an upward force of 1 MN with its moment moves the buoyancy."""
    cone = "hydrodyn.dat", r"(?m)^1 6\.5 0\.065$", "1 6.5 0.065\n99 3.5 0.065"
    count = "hydrodyn.dat", r"10( +NPropSetsCyl)", r"11\1"
    ends = "hydrodyn.dat", r"(?m)^1 1 2 1 1 1", "1 1 2 1 99 1"
    force = "hydrodyn.dat", r"(?m)^0( +AddF0.*)\n0\.0\n0\.0\n0\.0\n0\.0", r"0\1\n0\n1e6\n0\n-2e6"
    platform = written(files, tmp_path, cone, count, ends, force)
    column = [m for m in platform.members if m.start[0] == m.start[1] == 0.0]
    area = sum(m.diameter * np.linalg.norm(m.end - m.start) for m in column)
    assert area == pytest.approx(5.0 * 30.0)
    weight = 1025.0 * 9.80665
    assert platform.displaced_volume == pytest.approx(13917.0 + 1e6 / weight)
    # as much buoyancy 2 m downwind turns the bow down: a pitch moment of -2 MN m
    assert platform.center_of_buoyancy[0] * platform.displaced_volume == pytest.approx(2.0 * 1e6 / weight)


DATA = Path(__file__).with_name("data")
MOORDYN = (DATA / "moordyn.dat").read_text()


def test_lines_of_map_and_moordyn():
    """Both forms describe one line; MAP++ repeats it a quarter of a turn further."""
    first, second = read_mooring(DATA / "map.dat", 150.0, [])
    assert read_mooring(DATA / "moordyn.dat", 150.0, []) == (first,)
    assert (first.length, first.mass_per_length, first.diameter, first.axial_stiffness) == (430.0, 120.0, 0.1, 7e8)
    assert first.seabed_friction == 0.5
    np.testing.assert_allclose(second.anchor, [0.0, 400.0, -150.0], atol=1e-9)
    np.testing.assert_allclose(second.fairlead, [0.0, 20.0, -10.0], atol=1e-9)


@pytest.mark.parametrize(
    ("pattern", "text", "message"),
    [
        ("2 Vessel", "2 Body1", r"end 2 of line 1 must be a point that is Fixed or Vessel, got 'body1'"),
        ("2 Vessel", "2 Fixed", "line from a Fixed to a Vessel point"),
        ("7e8", "curve.dat", "EA must be a finite number, got 'curve.dat'"),
        ("1 chain 430", "1 rope 430", "LineType must be one of chain, got 'rope'"),
        ("---------------------- SOLVER", "---- RODS ----\nID Type\n1 r\n---- SOLVER", "rods must be absent"),
        ("0.001 dtM", "100.0 WtrDpth", "WtrDpth must be that of the model, 150 m"),
        ("0.001 dtM", "-0.5 mu_kA", r"MooringLine\.seabed_friction must be a number from 0 to 10, got -0\.5"),
        ("2 Vessel", "1 Vessel", r"points must be 2 different names, got \['1'\]"),
        ("1 NLines", "2 NLines", "lines must be as many rows as announced, 2, got 1"),
        ("Type X Y", "Type X(m) Y", "points must be rows below the names of their columns, x among them"),
        ("---------------------- SOLVER", "---- EXTERNAL LOADS\nID\n1 Point1\n---- SOLVER", "loads must be absent"),
    ],
)
def test_other_lines_are_refused(tmp_path, pattern, text, message):
    assert pattern in MOORDYN
    (tmp_path / "md.dat").write_text(MOORDYN.replace(pattern, text))
    with pytest.raises(TurbineDefinitionError, match=message) as refusal:
        read_mooring(tmp_path / "md.dat", 150.0, [])
    assert str(refusal.value).startswith("md.dat: ")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([keyword("hydrodyn.dat", "NBody", 2)], "NBody must be 1: one body in potential flow, got 2"),
        ([keyword("hydrodyn.dat", "PotMod", 0)], "PotMod must be 1"),
        ([keyword("hydrodyn.dat", "PtfmRefY", 30)], "PtfmRefY must be 0"),
        ([keyword("hydrodyn.dat", "NMGDepths", 3)], "NMGDepths must be 0"),
        ([("hydrodyn.dat", r"(?m)3 1 True$", "2 1 True")], "MCoefMod of member 1 must be 1 or 3"),
        ([("hydrodyn.dat", r"(?m)3 1 True$", "3 1 False")], "PropPot of member 1 must be True"),
        ([("hydrodyn.dat", r"(?m)^0( +AddF0)", r"5.0\1")], "AddF0 must be 0 in surge, sway and yaw"),
        ([keyword("turbine.fst", "CompSub", 1)], r"turbine\.fst: CompSub must be 0"),
        ([keyword("turbine.fst", "CompMooring", 4)], r"CompMooring must be 0, 1 \(MAP\+\+\) or 3 \(MoorDyn\), got 4"),
        ([keyword("turbine.fst", "CompMooring", 0)], "CompMooring must be 1 or 3 for a platform that AddCLin"),
        ([keyword("elastodyn.dat", "PtfmRefzt", -5)], r"elastodyn\.dat: PtfmRefzt must be 0"),
        ([keyword("seastate.dat", "MSL2SWL", 1)], "MSL2SWL must be 0"),
        ([("platform.1", r"(?m)^ 0\.0.*\n", "") for _ in range(36)], "must have the added mass of infinite frequency"),
        ([("platform.3", r"(?m)^.*\n", "")], r"platform\.3: must have six motions"),
        ([("platform.hst", r"(?m)^5 5.*\n", "")], r"platform\.hst: must have 36 rows"),
        (
            [("platform.3", r"(?m)^( \S+ \S+ 3) (.*) (.*)$", r"\1 \3 \2")],
            r"platform\.3: columns must be period, heading",
        ),
        (
            [keyword("hydrodyn.dat", "WAMITULEN", 10)],
            r"WAMITULEN must be the length of the tables: .* 6\.48739e\+09 kg",
        ),
        ([keyword("elastodyn.dat", "PtfmMass", "13476000,0")], "PtfmMass must be one number, with a decimal point"),
        ([keyword("hydrodyn.dat", "PotFile", '"other"')], r"hydrodyn\.dat: PotFile: .*other\.1.* no such file"),
    ],
)
def test_what_is_not_modeled_is_refused(files, tmp_path, changes, message):
    with pytest.raises(TurbineDefinitionError, match=message):
        written(files, tmp_path, *changes)


def test_a_platform_that_sinks_is_refused(oc4):
    """Mass in tonnes; the message has both sides of the balance."""
    message = (
        r"platform 13476, .* 599718, .* 193065 kg\) must be that of the displaced water, 1\.42649e\+07 kg.* 806259"
    )
    with pytest.raises(TurbineDefinitionError, match=message):
        replace(oc4, floater=replace(oc4.floater, mass=13476.0))


def test_forms_of_mooring_files(tmp_path):
    """Remarks, units in other brackets or none, and letters of any size; what is left aside is noted."""
    notes, text = list[str](), (DATA / "map.dat").read_text().upper().replace("----\n", "----\nREMARK\n")
    (tmp_path / "map.dat").write_text(text.replace("(", "[").replace(")", "]"))
    assert len(read_mooring(tmp_path / "map.dat", 150.0, notes)) == 2
    text = MOORDYN.replace("BA/-zeta", "EI").replace("-0.8", "1e5").replace("-150.0", "-140.0").replace("430", "396")
    (tmp_path / "md.dat").write_text(text.replace("(-) (m)", "- m", 1))
    read_mooring(tmp_path / "md.dat", 150.0, notes)
    hangs = "md.dat: line 1 hangs free, its anchor is at -140 m, above the seabed"
    assert notes == [hangs, "md.dat: left aside: EI 1e5 of chain; lines do not resist bending"]


def test_second_order_is_left_aside_with_a_note(files, oc4, tmp_path):
    changes = [keyword("hydrodyn.dat", key, value) for key, value in (("DiffQTF", 12), ("ExctnMod", 0))]
    changes.append(keyword("elastodyn.dat", "PtfmYDOF", "False"))
    assert written(files, tmp_path, *changes).mass == pytest.approx(oc4.floater.mass)
    read_openfast_platform(model := Model(tmp_path / "turbine.fst"))
    assert "hydrodyn.dat: left aside: DiffQTF 12; wave forces are of first order" in model.notes
    for note in ("hydrodyn.dat: left aside: ExctnMod 0", "elastodyn.dat: left aside: PtfmYDOF False"):
        assert any(note in one for one in model.notes)


def test_fixed_platforms_stand_on_the_ground(files, tmp_path):
    fixed = [keyword("elastodyn.dat", f"Ptfm{name}DOF", "False") for name in ("Sg", "Sw", "Hv", "R", "P", "Y")]
    assert written(files, tmp_path, *fixed, keyword("turbine.fst", "CompMooring", 0)) is None


@pytest.mark.skipif(find_spec("Examples") is None or not DECKS.is_dir(), reason="needs decks and the package rosco")
@pytest.mark.parametrize(
    ("deck", "name"), [("oc4_turb18_detuned", "oc4_nrel_5mw"), ("volturn_turb14_Fl2", "volturnus_iea_15mw")]
)
def test_decks(deck, name, tmp_path):
    """Decks of the reference runs give the platforms of the catalog; OC4's ballast is in HydroDyn's members."""
    with lzma.open(DECKS / f"{deck}.tar.xz") as packed, tarfile.open(fileobj=packed) as archive:
        archive.extractall(tmp_path, filter="data")
    examples = find_spec("Examples").submodule_search_locations[0]
    (tmp_path / deck / "ROSCO_EXAMPLES").symlink_to(Path(examples) / "Test_Cases")
    turbine = read_openfast(tmp_path / deck / "main.fst", rated_power=5e6, rated_rotor_speed=1.267)
    found, wanted = turbine.floater, load_turbine(name).floater
    assert found.mass == pytest.approx(wanted.mass, rel=3e-6)
    assert found.center[2] == pytest.approx(wanted.center[2], abs=1e-3)
    np.testing.assert_allclose(found.inertia, wanted.inertia, rtol=1e-5, atol=1e4)
    np.testing.assert_allclose(found.hydrostatic, wanted.hydrostatic, rtol=1e-4, atol=4e4)
    np.testing.assert_allclose(found.quadratic_damping, wanted.quadratic_damping)
    frequency = np.linspace(0.06, 1.24, 30)
    force = wanted.excitation.at(frequency, np.pi / 6.0)
    scale = abs(force).max(axis=0)
    np.testing.assert_allclose(found.excitation.at(frequency, np.pi / 6.0) / scale, force / scale, atol=1e-3)
    assert sum(plate.area * plate.drag_coefficient for plate in found.plates) == pytest.approx(
        sum(plate.area * plate.drag_coefficient for plate in wanted.plates)
    )
    push = [
        PlatformLoads(replace(one, gravity=9.80665), 0.1).static_force([10.0, 0.0, 0.0], np.eye(3))[0]
        for one in (found, wanted)
    ]
    assert push[0] == pytest.approx(push[1], rel=1e-2)


# ---- waves, signals, start -------------------------------------------------------------------------------------------


def test_waves_are_components_of_seastate(oc4, tmp_path):
    """Frequencies are multiples of 2 pi / WaveTMax, which is no shorter than the run."""
    sea = SeaState("jonswap", 4.0, 10.0, direction=0.5, current=(0.3, -0.4)).components(np.random.default_rng(1), 200.0)
    text = write_sea(oc4.floater, sea, 700.0, tmp_path).read_text()
    keys = ("WaveMod", "WaveTMax", "CurrDIV", "CurrDIDir", "CurrSSDir")  # no default, which still water has not
    number = {key: float(re.search(rf"(?m)^(\S+)\s+{key}\s", text)[1]) for key in keys}
    assert (number["WaveMod"], number["WaveTMax"]) == (7.0, pytest.approx(1200.0))
    assert number["CurrDIV"] == pytest.approx(0.5)
    assert number["CurrDIDir"] == pytest.approx(np.degrees(np.arctan2(-0.4, 0.3)))
    omega, height, direction, phase = np.loadtxt(tmp_path / "waves.dat", comments="!").T
    multiples = omega * 1200.0 / (2.0 * np.pi)
    np.testing.assert_allclose(multiples, np.round(multiples), atol=1e-6)
    time = np.array([0.0, 3.7])
    found = (0.5 * height * np.cos(omega * time[:, None] + np.radians(phase))).sum(axis=1)
    np.testing.assert_allclose(found, sea.elevation(time), atol=1e-9)
    np.testing.assert_allclose(direction, np.degrees(0.5))


def test_waves_without_a_common_period_are_refused(oc4, tmp_path):
    sea = WaveComponents(np.array([0.5, 0.5 * np.sqrt(2.0)]), np.ones(2), np.zeros(2), np.zeros(2))
    with pytest.raises(InflowError, match=r"different multiples of one for SeaState.* got 0\.5, 0\.707107"):
        write_sea(oc4.floater, sea, 100.0, tmp_path)


def test_lines_with_different_friction_are_refused(oc4, tmp_path):
    first, *rest = oc4.floater.lines
    platform = replace(oc4.floater, lines=(replace(first, seabed_friction=0.5), *rest))
    with pytest.raises(SimulationError, match=r"one seabed friction for MoorDyn, got \[0\.0, 0\.5\]"):
        write_water(platform, tmp_path)


def test_platform_signals(oc4):
    """Motions in degrees are radians here; the nacelle heads where platform and yaw drive turn it."""
    names = [*elastodyn_outputs(3, True), *AERODYN_OUTPUTS, *INFLOW_OUTPUTS, *(n.upper() for n in water_outputs(3))]
    row = np.zeros(len(names))
    values = {"PtfmSurge": 7.0, "PtfmPitch": 3.0, "PtfmRVzi": 90.0, "PtfmTAyi": 0.2, "PtfmYaw": 5.0, "YawPzn": 10.0,
              "WAVE1ELEV": 1.5, "FAIRTEN2": 1e6, "ANCHTEN3": 9e5, "WindHubVelX": 8.0}  # fmt: skip
    for name, value in values.items():
        row[names.index(name)] = value
    measurement, still = Measurement(oc4, names), np.zeros(3)
    measurement.take(0.0, row[None], 2e4, still, still, still, False)
    signals = measurement.signals()
    for name, value in (
        ("platform_surge", 7.0), ("platform_pitch", np.radians(3.0)), ("platform_yaw_rate", 0.5 * np.pi),
        ("platform_sway_acceleration", 0.2), ("wave_elevation", 1.5), ("fairlead_tension_2", 1e6),
        ("anchor_tension_3", 9e5), ("yaw_error", -np.radians(15.0)),
    ):  # fmt: skip
        assert signals[name] == pytest.approx(value), name
    with pytest.raises(SimulationError, match=r"must have the outputs Wave1Elev, .* are missing"):
        Measurement(oc4, names[:-3])


def test_resting_place_of_published_numbers():
    """Without wind VolturnUS-S stands at -1.56 degrees, of which the bent tower makes 0.1, and 0.36 m deeper."""
    place = resting_place(load_turbine("volturnus_iea_15mw"), 0.0, 0.0, 0.0)
    assert np.degrees(place[4]) == pytest.approx(-1.46, abs=0.05)
    assert place[2] == pytest.approx(-0.36, abs=0.03)
    np.testing.assert_allclose(place[[1, 3, 5]], 0.0, atol=0.01)


def test_resting_place_turns_with_the_nacelle(oc4):
    """A third of a turn of thrust and current, by which the platform is the same, turns the displacement."""
    third = 2.0 * np.pi / 3.0
    assert resting_place(oc4, 6e5, 0.0, 0.0)[0] == pytest.approx(7.3, abs=0.5)
    seas = [SeaState(current=(np.cos(yaw), np.sin(yaw))).components(None, 200.0) for yaw in (0.0, third)]
    ahead, turned = (resting_place(oc4, 6e5, 0.0, yaw, sea) for yaw, sea in zip((0.0, third), seas, strict=True))
    assert ahead[0] > 9.0
    first, second = (place[[0, 3]] + 1j * place[[1, 4]] for place in (ahead, turned))
    np.testing.assert_allclose(second, first * np.exp(1j * third), rtol=0.01, atol=1e-3)


def test_a_rotor_that_turns_the_other_way_floats_on_the_image(oc4, tmp_path):
    """Anchors and fairleads of the written lines are reflected."""
    platform = replace(oc4.floater, lines=oc4.floater.lines[:2])
    path = write_model(mirrored(replace(oc4, floater=platform)), tmp_path)
    assert read_openfast_platform(Model(path)).lines == platform.lines
