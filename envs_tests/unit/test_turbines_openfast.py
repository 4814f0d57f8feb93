"""Reading OpenFAST models: signs and frames, both blade structures, releases of the files, and what is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from openfast_model import DEGREE, Model, principal

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import read_toml
from wt_gym.commands import run as run_command
from wt_gym.control.controllers import make_controller
from wt_gym.experiment.steady_check import SteadyRun, steady_winds, verdict
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import ControlData, Polar, load_turbine
from wt_gym.turbines.openfast import compare_with_openfast_io, read_openfast
from wt_gym.turbines.openfast_control import find_steady_table, read_steady_table
from wt_gym.turbines.openfast_text import TextFile
from wt_gym.turbines.windio_writer import require_same, windio_content, write_windio


@pytest.fixture(scope="module")
def nrel_5mw():
    return load_turbine("nrel_5mw")


@pytest.fixture
def model(nrel_5mw):
    return Model(nrel_5mw)


def notes_with(turbine, text):
    return [note for note in turbine.notes if text in note]


class TestTheSameTurbine:
    """Files written from the numbers of the catalog's turbine give that turbine back."""

    @pytest.mark.parametrize("release", [2, 3, 5])
    def test_geometry_masses_and_limits(self, nrel_5mw, release, tmp_path):
        read = load_turbine(Model(nrel_5mw, release=release).write(tmp_path))
        assert read.name == "model"
        for name in ("n_blades", "rotor_diameter", "hub_height", "air_density"):
            assert getattr(read, name) == pytest.approx(getattr(nrel_5mw, name), rel=1e-6)
        require_same(nrel_5mw.hub, read.hub)
        require_same(nrel_5mw.drivetrain, read.drivetrain)
        require_same(nrel_5mw.pitch, read.pitch)
        found, wanted = read.nacelle, nrel_5mw.nacelle
        require_same(replace(wanted, inertia=found.inertia), found)
        np.testing.assert_allclose(found.inertia, wanted.inertia, rtol=1e-3, atol=1.0)

    @pytest.mark.parametrize(("mode", "servo"), [(0, (None, 1.0)), (1, (3.14, 1.0)), (2, (3.14, 0.707))])
    def test_pitch_drive(self, model, mode, servo, tmp_path):
        model.discon["PA_Mode"] = mode
        pitch = load_turbine(model.write(tmp_path)).pitch
        assert (pitch.servo_frequency, pitch.servo_damping) == servo

    def test_blade_of_elastodyn(self, nrel_5mw, model, tmp_path):
        read, wanted = load_turbine(model.write(tmp_path)).blade, nrel_5mw.blade
        for name in ("aero_station", "chord", "twist", "le_offset", "normal_offset"):
            np.testing.assert_allclose(getattr(read, name), getattr(wanted, name), rtol=1e-9, atol=1e-9)
        assert not np.any(read.axis[:, :2])
        bending = slice(3, 5)
        np.testing.assert_allclose(
            read.structure.stiffness[:, bending, bending], wanted.structure.stiffness[:, bending, bending],
            rtol=1e-9, atol=1.0,
        )  # fmt: skip
        np.testing.assert_allclose(read.structure.inertia[:, 0, 0], wanted.structure.inertia[:, 0, 0], rtol=1e-9)
        assert read.damping_ratio == pytest.approx(wanted.damping_ratio, rel=1e-9)
        assert read.structure.shear_rigid

    def test_polars_hold_half_way_to_the_next_node(self, nrel_5mw, model, tmp_path):
        turbine = load_turbine(model.write(tmp_path))
        z = nrel_5mw.blade.aero_station
        for position in (z[3] + 0.1, z[9], z[9] + 0.4 * (z[10] - z[9]), z[-1]):
            read, wanted = turbine.blade.polar_at(position), nrel_5mw.blade.polar_at(position)
            alpha = np.linspace(-3.0, 3.0, 61)
            np.testing.assert_allclose(read.coefficients(alpha), wanted.coefficients(alpha), atol=1e-9)
        assert notes_with(turbine, "each holds half way")

    def test_blade_of_beamdyn_is_the_same_in_all_36_entries(self, nrel_5mw, tmp_path):
        read = load_turbine(Model(nrel_5mw, beamdyn=True).write(tmp_path)).blade.structure
        wanted = nrel_5mw.blade.structure
        np.testing.assert_allclose(read.station, wanted.station, atol=1e-8)
        np.testing.assert_allclose(read.inertia, wanted.inertia, rtol=1e-6, atol=1e-6)
        finite = np.where(np.isinf(wanted.stiffness), 1e13, wanted.stiffness)
        scale = np.sqrt(np.abs(np.diagonal(finite, axis1=1, axis2=2)))
        np.testing.assert_allclose(
            read.stiffness / (scale[:, :, None] * scale[:, None]), finite / (scale[:, :, None] * scale[:, None]),
            atol=1e-8,
        )  # fmt: skip

    def test_tower(self, nrel_5mw, model, tmp_path):
        read, wanted = load_turbine(model.write(tmp_path)).tower, nrel_5mw.tower
        found, given = read.structure, wanted.structure
        np.testing.assert_allclose(found.inertia[:, 0, 0], given.inertia[:, 0, 0], rtol=1e-9)
        for k in (3, 4):
            np.testing.assert_allclose(found.stiffness[:, k, k], given.stiffness[:, k, k], rtol=1e-9)
        # what ElastoDyn leaves out: the published EA, GJ and section inertia of this tower, a tube of thin walls
        for k in (2, 5):
            np.testing.assert_allclose(found.stiffness[:, k, k], given.stiffness[:, k, k], rtol=0.02)
        np.testing.assert_allclose(found.inertia[:, 3, 3], given.inertia[:, 3, 3], rtol=0.02)
        np.testing.assert_allclose(read.diameter, wanted.diameter, rtol=1e-9)
        assert (read.base_height, read.height) == (wanted.base_height, wanted.height)

    def test_the_controller_on_the_generator_side(self, model, tmp_path):
        control = load_turbine(model.write(tmp_path)).control
        for name, value in {
            "region_2_gain": 2.332287, "torque_proportional_gain": 800.0, "torque_integral_gain": 120.0,
            "gain_pitch": [0.05, 0.2, 0.3], "pitch_proportional_gain": [0.02, 0.01, 0.004],
            "pitch_integral_gain": [0.008, 0.004, 0.002], "min_pitch_wind": [3.0, 9.0, 12.0],
            "min_pitch": [0.01, 0.02, 0.06], "reference_generator_speed": 12.1 * np.pi / 30 * 97,
            "speed_filter_frequency": 1.570796, "speed_filter_damping": 0.7, "fine_pitch": 0.01,
            "region_3_min_pitch": 0.03, "constant_power": True, "rated_mechanical_power": 5.0e6 / 0.944,
        }.items():  # fmt: skip
            np.testing.assert_allclose(getattr(control, name), value, rtol=1e-6, err_msg=name)
        assert (control.pitch_actuator_frequency, control.speed_shift_per_pitch) == (None, None)
        # published for this gain: the largest power coefficient 0.482 at 7.55
        assert control.peak_power_coefficient == pytest.approx(0.482 * (7.5 / 7.55) ** 3, rel=0.01)

    @pytest.mark.filterwarnings("ignore:the speed loop of model")
    @pytest.mark.parametrize(
        ("mode", "shifts"), [(1, (0.8 / 0.524, 0.001, 0.6283)), (0, (0.0, 0.0, None))], ids=("on", "off")
    )
    def test_the_set_point_smoother_and_a_constant_torque(self, model, tmp_path, mode, shifts):
        """ROSCO shifts by rated speed over 0.524 rad of pitch, and its constant torque lets the power pass rated."""
        model.discon |= {"VS_ConstPower": 0, "SS_Mode": mode, "SS_VSGain": 0.8, "SS_PCGain": 0.001}
        model.discon["F_SSCornerFreq"] = 0.6283
        turbine = load_turbine(model.write(tmp_path))
        own = turbine.control
        assert (own.speed_shift_per_pitch, own.speed_shift_per_power, own.speed_shift_frequency) == shifts
        assert own.constant_power is False
        assert "SS_Mode" not in " ".join(turbine.notes)
        made = make_controller("discon", turbine).parameters
        assert made.pitch_to_speed / (made.baseline.max_pitch - made.baseline.min_pitch) == pytest.approx(shifts[0])
        assert made.torque_to_speed == shifts[1]
        assert made.baseline.constant_power is False
        assert made.smoothing_time_constant == pytest.approx(1.0 / shifts[2] if shifts[2] else 5.0)


class TestWhatTheFilesSay:
    """Factors, prebend, tables, coordinates, switches."""

    def test_adjustment_factors(self, nrel_5mw, model, tmp_path):
        model.factors |= {"AdjBlMs": 1.1, "AdjFlSt": 1.2, "AdjEdSt": 1.3}
        model.tower_factors |= {"AdjTwMa": 1.4, "AdjFASt": 1.5, "AdjSSSt": 1.6}
        read = load_turbine(model.write(tmp_path))
        blade, tower = read.blade.structure, read.tower.structure
        assert blade.mass_moment(0) == pytest.approx(1.1 * nrel_5mw.blade.structure.mass_moment(0))
        trace = blade.stiffness[:, 3, 3] + blade.stiffness[:, 4, 4]
        _, flap, edge = principal(nrel_5mw.blade.structure.stiffness)
        np.testing.assert_allclose(trace, 1.2 * flap + 1.3 * edge, rtol=1e-9)
        wanted = nrel_5mw.tower.structure
        assert tower.mass_moment(0) == pytest.approx(1.4 * wanted.mass_moment(0))
        np.testing.assert_allclose(tower.stiffness[:, 4, 4], 1.5 * wanted.stiffness[:, 4, 4], rtol=1e-9)
        np.testing.assert_allclose(tower.stiffness[:, 3, 3], 1.6 * wanted.stiffness[:, 3, 3], rtol=1e-9)

    def test_prebend_is_the_axis_and_leaves_mass_and_planform(self, nrel_5mw, model, tmp_path):
        z = nrel_5mw.blade.aero_station
        model.bend = -3.0 * (z / z[-1]) ** 2
        read = load_turbine(model.write(tmp_path))
        np.testing.assert_allclose(read.blade.axis[:, 0], model.bend, atol=1e-3)
        np.testing.assert_allclose(read.blade.le_offset, nrel_5mw.blade.le_offset, atol=1e-9)
        np.testing.assert_allclose(read.blade.normal_offset, 0.0, atol=1e-2)
        assert read.blade.structure.mass_moment(0) == pytest.approx(nrel_5mw.blade.structure.mass_moment(0), rel=1e-4)
        assert notes_with(read, "prebend")

    @pytest.mark.parametrize(
        ("mode", "kind", "note"),
        [(1, "Re", "the first is used"), (2, "Re", "Reynolds number of rated"), (3, "UserProp", "UserProp 0")],
    )
    def test_several_tables_as_airfoilinfo_uses_them(self, model, nrel_5mw, mode, kind, note, tmp_path):
        """AFI_ComputeAirfoilCoefs: the first table, or linear over log(Re) or UserProp, which is 0."""
        blade, polar = nrel_5mw.blade, nrel_5mw.blade.airfoils[-1].polar
        place = np.searchsorted(blade.airfoil_station, blade.aero_station, side="right") - 1
        nodes = np.flatnonzero(blade.airfoil_index[np.maximum(place, 0)] == 7)
        node = nodes[nodes.size // 2]
        radius = nrel_5mw.hub.radius + blade.aero_station[node]
        reynolds = nrel_5mw.drivetrain.rated_rotor_speed * radius * blade.chord[node] / 1.46e-5 / 1e6
        tables = {"Re": [(0.5 * reynolds, 0), (2.0 * reynolds, 0)], "UserProp": [(1.0, -1), (1.0, 3)]}[kind]
        model.tables[7] = [
            (*at, Polar(polar.alpha, factor * polar.cl, polar.cd, polar.cm))
            for at, factor in zip(tables, (0.5, 0.8), strict=True)
        ]
        model.aerodyn["AFTabMod"] = mode
        read = load_turbine(model.write(tmp_path))
        factor = {1: 0.5, 2: 0.65, 3: 0.5 + 0.3 / 4}[mode]
        assert np.max(read.blade.airfoils[-1].polar.cl) == pytest.approx(factor * np.max(polar.cl), rel=1e-6)
        assert notes_with(read, f"af7.dat: 2 tables, {'' if mode == 1 else 'the coefficients '}")
        assert notes_with(read, note)

    def test_tables_in_the_wrong_order(self, model, nrel_5mw, tmp_path):
        polar = nrel_5mw.blade.airfoils[-1].polar
        model.tables[7], model.aerodyn["AFTabMod"] = [(9.0, 0, polar), (1.0, 0, polar)], 2
        with pytest.raises(TurbineDefinitionError, match=r"af7\.dat: Re must be .* ascend from table to table"):
            load_turbine(model.write(tmp_path))

    def test_a_section_without_coordinates_has_the_camber_of_its_polar(self, model, tmp_path):
        model.coordinates = False
        read = load_turbine(model.write(tmp_path))
        airfoil = read.blade.airfoils[-1]
        polar, zero = airfoil.polar, np.radians(np.linspace(-8.0, 0.0, 8001))
        alpha = zero[np.argmin(np.abs(polar.coefficients(zero)[0]))]
        # thin-airfoil theory: alpha_0 = 1/pi int_0^pi dy/dx (1 - cos t) dt, with x = (1 - cos t)/2
        t = (np.arange(2000) + 0.5) * np.pi / 2000
        slope = airfoil.camber_at(0.5 * (1 - np.cos(t)))[1]
        assert np.mean(slope * (1 - np.cos(t))) == pytest.approx(alpha, rel=0.01)
        assert read.blade.airfoils[0].relative_thickness == pytest.approx(1.0, rel=0.01)  # a cylinder
        assert len(notes_with(read, "no coordinates")) == 8

    def test_a_tower_without_diameters_is_a_thin_steel_tube(self, model, tmp_path):
        path = model.write(tmp_path)
        file = tmp_path / "aero" / "ad.dat"
        text = file.read_text()
        file.write_text(text[: text.index("NumTwrNds")].rsplit("\n", 1)[0] + "\n0 NumTwrNds - number\n")
        read = load_turbine(path).tower
        np.testing.assert_allclose(read.diameter_at(read.structure.station)[[0, -1]], [6.0, 3.87], rtol=0.02)

    def test_the_schedule_ends_where_a_gain_changes_its_sign(self, model, tmp_path):
        model.discon["PC_GS_KP"] = "-0.02 -0.01 0.004"
        read = load_turbine(model.write(tmp_path))
        np.testing.assert_array_equal(read.control.gain_pitch, [0.05, 0.2])
        assert notes_with(read, "changes its sign at 17.2 deg")

    def test_the_table_of_the_power_coefficient(self, model, tmp_path):
        model.discon["PerfFileName"] = '"perf.txt"'
        (tmp_path / "perf.txt").write_text(
            "# Pitch angle vector (deg)\n0 1\n# TSR vector\n7 8\n# Wind speed vector\n10\n# Power coefficient\n"
            "0.40 0.30\n0.50 0.40\n# Thrust coefficient\n0.7 0.6\n0.8 0.7\n"
        )
        model.discon["PC_FinePit"] = 0.5 * DEGREE
        assert load_turbine(model.write(tmp_path)).control.peak_power_coefficient == pytest.approx(0.40)

    def test_servodyns_own_torque_law(self, model, tmp_path):
        model.servodyn |= {"PCMode": 0, "VSContrl": 1, "VS_RtGnSp": 1173.7, "VS_RtTq": 43093.55, "VS_Rgn2K": 0.0255764}
        read = load_turbine(model.write(tmp_path))
        assert read.drivetrain.rated_power == pytest.approx(5.0e6, rel=1e-3)
        assert read.control.region_2_gain == pytest.approx(2.332287, rel=1e-5)

    def test_a_rating_from_outside(self, model, tmp_path):
        model.servodyn |= {"PCMode": 0, "VSContrl": 4}
        path = model.write(tmp_path)
        with pytest.raises(TurbineDefinitionError, match="rated power: the model has neither"):
            load_turbine(path)
        read = read_openfast(path, rated_power=4.0e6, rated_rotor_speed=1.2)
        assert (read.drivetrain.rated_power, read.drivetrain.rated_rotor_speed, read.control) == (4.0e6, 1.2, None)
        assert notes_with(read, "limits of the pitch from Ptch_Min")

    def test_the_rating_of_a_law_that_is_not_in_force_is_not_read(self, model, tmp_path):
        """ServoDyn's numbers say nothing where a library of another kind gives the torque."""
        model.servodyn |= {"VS_RtGnSp": 1161.963, "VS_RtTq": 43093.55, "VS_Rgn2K": 0.0255764, "VS_SlPc": 10.0}
        path = model.write(tmp_path)
        (tmp_path / "DISCON.IN").write_text("! parameters of another library\n1.0 ! gain\n")
        with pytest.raises(TurbineDefinitionError, match=r"VSContrl is 5.*not a DISCON\.IN of ROSCO.*--rated-power"):
            load_turbine(path)
        read = read_openfast(path, rated_power=5.0e6)
        assert (read.drivetrain.rated_power, read.control) == (5.0e6, None)
        assert notes_with(read, "the initial 12.1 rpm (RotSpeed) is taken")

    def test_a_torque_law_without_rating(self, model, tmp_path):
        """Models for linearization: constant torque, at a rated speed of nothing."""
        for speed in (0.001, 9999.9):
            model.servodyn |= {"PCMode": 0, "VSContrl": 1, "VS_RtGnSp": speed, "VS_RtTq": 43093.55}
            with pytest.raises(TurbineDefinitionError, match=rf"VS_RtGnSp {speed:g} rpm is not a rated.*--rated-power"):
                load_turbine(model.write(tmp_path))

    def test_a_controller_of_the_pitch_alone(self, model, tmp_path):
        """PCMode 5 with VSContrl 1: constant torque at the speed that ROSCO's pitch holds."""
        model.servodyn |= {"VSContrl": 1, "VS_RtGnSp": 1161.963, "VS_RtTq": 43093.55, "VS_Rgn2K": 0.0255764}
        read = load_turbine(model.write(tmp_path))
        speed = model.discon["PC_RefSpd"]
        assert read.drivetrain.rated_power == pytest.approx(43093.55 * speed * 0.944)
        control = read.control
        assert control.region_2_gain == pytest.approx(2.332287, rel=1e-5)
        assert (control.torque_proportional_gain, control.reference_generator_speed) == (None, pytest.approx(speed))
        assert notes_with(read, "left aside: control of the torque")

    def test_the_gearbox_takes_its_part_of_rated_power(self, model, tmp_path):
        without = load_turbine(model.write(tmp_path)).rated_wind_speed
        model.elastodyn["GBoxEff"] = 90.0
        assert load_turbine(model.write(tmp_path)).rated_wind_speed == pytest.approx(
            without * 0.9 ** (-1 / 3), rel=1e-9
        )

    def test_a_rigid_shaft(self, model, tmp_path):
        model.elastodyn |= {"DrTrDOF": "False", "DTTorSpr": 0.0}
        drive = load_turbine(model.write(tmp_path)).drivetrain
        stiffest = 2.0 * np.pi * 100.0  # of all that a simulation lets twist [rad/s]
        assert drive.spring > stiffest**2 * drive.generator_inertia * drive.gear_ratio**2

    @pytest.mark.parametrize(("angle", "size"), [(-175.0, -0.0035), (-175.0, -0.5), (3.0, -0.0035)])
    def test_negative_drag(self, model, nrel_5mw, angle, size, tmp_path):
        """Small values in flow from behind come from measurements and run in OpenFAST; others would drive the rotor."""
        polar = nrel_5mw.blade.airfoils[-1].polar
        row = int(np.argmin(np.abs(polar.alpha - angle * DEGREE)))
        path = model.write(tmp_path)
        file = tmp_path / "aero" / "af7.dat"
        lines = file.read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if "NumAlf" in line) + 2 + row
        words = lines[at].split()
        lines[at] = " ".join([*words[:2], str(size), *words[3:]])
        file.write_text("\n".join(lines))
        if size < -0.05 or angle > -90.0:
            with pytest.raises(
                TurbineDefinitionError, match=rf"af7\.dat: table 1: Polar\.cd.* at .* deg must .* got {size}"
            ):
                load_turbine(path)
            return
        read = load_turbine(path)
        assert read.blade.airfoils[-1].polar.cd.min() == size
        assert notes_with(read, "af7.dat: table 1: the drag coefficient is -0.0035 at -175 deg")
        require_same(read, load_turbine(write_windio(read, tmp_path / "turbine.yaml")[0]))

    def test_the_blade_that_is_asked_for(self, model, tmp_path):
        path = model.write(tmp_path)
        assert read_openfast(path, blade="beamdyn").blade.structure.shear_rigid is False
        assert notes_with(read_openfast(path), "BeamDyn's, which the model has too, are left aside")
        with pytest.raises(TurbineDefinitionError, match="blade must be"):
            read_openfast(path, blade="fast")

    def test_a_mirrored_rotor_turns_counter_clockwise(self, model, tmp_path):
        """Files of blade and nacelle describe the same turbine whichever way its rotor turns."""
        clockwise = load_turbine(model.write(tmp_path))
        model.primary["MirrorRotor"] = "T"
        other = load_turbine(model.write(tmp_path))
        assert (clockwise.rotation, other.rotation) == ("clockwise", "counter-clockwise")
        assert notes_with(other, "MirrorRotor: True")
        same = replace(other, rotation="clockwise", notes=clockwise.notes)
        assert fingerprint(same) == fingerprint(clockwise)


CHANGES = read_toml(Path(__file__).with_name("data") / "openfast_changes.toml")
ASSUMED = ("clamped at its base", "DrTrDOF is False", "roll", "cut-in", "IEC class", "bends only")


def test_what_has_no_effect_here_is_named(model, tmp_path):
    before = load_turbine(model.write(tmp_path)).notes
    model.elastodyn |= {"DrTrDOF": "False"}
    for part, key, value, _ in CHANGES["left_aside"]:
        getattr(model, part)[key] = value
    after = [note for note in load_turbine(model.write(tmp_path)).notes if note not in before]
    for _, key, _, words in CHANGES["left_aside"]:
        assert any(key in note and re.search(words, note) for note in after), key
    for words in ASSUMED:
        assert any(words in note for note in (*before, *after)), words


@pytest.mark.parametrize(("part", "key", "value", "message"), CHANGES["refused"])
def test_what_would_be_another_turbine_is_refused(model, part, key, value, message, tmp_path):
    getattr(model, part)[key] = value
    path = model.write(tmp_path)
    with pytest.raises(TurbineDefinitionError, match=message) as refusal:
        load_turbine(path)
    assert str(refusal.value).startswith(f"{path}: ")
    with pytest.raises(TurbineDefinitionError, match="water_depth"):
        load_turbine(path, water_depth=20.0)


@pytest.mark.parametrize(("file", "pattern", "new", "message"), CHANGES["damaged"])
def test_damaged_tables_are_refused(model, file, pattern, new, message, tmp_path):
    path = model.write(tmp_path)
    changed, count = re.subn(pattern, new, (tmp_path / file).read_text(), count=1)
    assert count == 1
    (tmp_path / file).write_text(changed)
    with pytest.raises(TurbineDefinitionError, match=message):
        read_openfast(path, blade="beamdyn")


def test_words_of_text_files(tmp_path):
    file = tmp_path / "file.dat"
    file.write_text(
        "title\nHubRad 9 - of the title\n-- NumBl - of a rule --\n 1.5D+01  HubRad  - text with MHK in it\n"
        '"a b/c.dat"  BldFile(1)   - name\n.true. Flag - f\n0.0, 1.0, 2.0  NacCenB - list\nDEFAULT  DT - s\n'
    )
    read = TextFile(file)
    assert (read.number("HubRad"), read.text("BldFile1"), read.flag("flag")) == (15.0, "a b/c.dat", True)
    np.testing.assert_array_equal(read.array("NacCenB"), [0.0, 1.0, 2.0])
    assert read.is_default("DT")
    assert "MHK" not in read
    assert "NumBl" not in read


ODD = {
    "elastodyn": {
        "ShftTilt": -7.3, "HubCM": 1.3, "NacCMyn": -0.7, "NacCMzn": 2.2, "Twr2Shft": 3.1, "GBoxEff": 91.0,
        "DTTorSpr": 1.7e9, "DTTorDmp": 3.3e6, "YawBrMass": 4.1e4, **{f"PreCone({i})": -3.7 for i in (1, 2, 3)},
    },
    "servodyn": {"YawSpr": 0.0, "YawManRat": 31.0},
    "discon": {
        "PC_MinPit": -0.13, "PC_MaxPit": 1.6, "PC_FinePit": -0.07, "VS_MinOMSpd": 71.0, "VS_ConstPower": 0,
        "VS_KI": -77.0, "F_LPFType": 1, "PS_Mode": 0, "PA_Mode": 1,
    },
    "primary": {"AirDens": 1.03},
}  # fmt: skip
"""Numbers that no other model has."""


class TestWindIO:
    """A windIO file of the turbine is that turbine."""

    @pytest.mark.parametrize("beamdyn", [False, True])
    def test_round_trip(self, nrel_5mw, beamdyn, tmp_path):
        model = Model(nrel_5mw, beamdyn=beamdyn)
        z = nrel_5mw.blade.aero_station
        model.bend = -3.0 * (z / z[-1]) ** 2
        for part, values in ODD.items() if beamdyn else ():
            getattr(model, part).update(values)
        turbine = load_turbine(model.write(tmp_path))
        written = write_windio(turbine, tmp_path / "turbine.yaml")
        require_same(turbine, load_turbine(written[0]))
        content = json.loads(written[1].read_text())
        require_same(turbine.control, ControlData(**{key: content[key] for key in content if key != "turbine"}))
        written[1].unlink()  # without it the windIO file alone says less of the controller
        with pytest.raises(TurbineDefinitionError, match=r"Turbine\.(control\.)?\w+ must be"):
            require_same(turbine, load_turbine(written[0]))

    def test_what_windio_has_no_key_for_stands_beside_it(self, model, nrel_5mw, tmp_path):
        model.servodyn["VSContrl"] = 4
        model.discon |= {"PA_Mode": 2, "PC_MaxPit": 1.6}
        model.primary |= {"AirDens": 1.1, "MirrorRotor": "T"}
        turbine = read_openfast(model.write(tmp_path), rated_power=5e6)
        written = write_windio(turbine, tmp_path / "turbine.yaml")
        require_same(turbine, load_turbine(written[0]))
        assert json.loads(written[1].read_text())["turbine"] == {
            "air_density": 1.1, "rotation": "counter-clockwise", "pitch.max_pitch": 1.6,
            "pitch.servo_frequency": 3.14, "pitch.servo_damping": 0.707, "drivetrain.min_rotor_speed": 0.0,
        }  # fmt: skip
        written[1].write_text(json.dumps({"turbine": {"hub.mass": 1.0}}))
        with pytest.raises(
            TurbineDefinitionError, match=r"turbine must be an object with keys among .* got .*hub\.mass"
        ):
            load_turbine(written[0])
        write_windio(replace(nrel_5mw, control=None), tmp_path / "turbine.yaml")
        assert json.loads(written[1].read_text()) == {}  # what stood there belongs to another turbine

    def test_a_difference_is_found(self, nrel_5mw):
        require_same(nrel_5mw, nrel_5mw)
        with pytest.raises(TurbineDefinitionError, match=r"Turbine\.hub\.mass must be .* got 1\.0"):
            require_same(nrel_5mw, replace(nrel_5mw, hub=replace(nrel_5mw.hub, mass=1.0)))
        with pytest.raises(TurbineDefinitionError, match=r"Turbine\.control\.fine_pitch must be .* got 0\.1"):
            require_same(nrel_5mw, replace(nrel_5mw, control=replace(nrel_5mw.control, fine_pitch=0.1)))

    @pytest.mark.parametrize("name", ["nrel_5mw_monopile", "gebhardt_45m", "nada_small"])
    def test_what_no_windio_file_holds_is_refused(self, name):
        with pytest.raises(TurbineDefinitionError, match="Turbine"):
            windio_content(load_turbine(name))


def test_openfast_io_stops_at_lines_of_another_release(model, tmp_path):
    pytest.importorskip("openfast_io")
    text = "\n".join(compare_with_openfast_io(model.write(tmp_path)))
    assert "it stops with" in text


class TestCommand:
    def test_it_shows_and_writes(self, model, tmp_path, capsys):
        out = tmp_path / "turbine.yaml"
        run_command("import", [str(model.write(tmp_path)), "--out", str(out), "--json", "--no-check"])
        text = capsys.readouterr().out
        assert "assumed and left aside" in text
        found = json.loads(text.splitlines()[-1])
        numbers = {entry["name"]: entry["value"] for entry in found["summary"]}
        # NREL/TP-500-38060, tables 2-2, 4-1 and 6-1
        assert numbers["blade mass"] == pytest.approx(17740, rel=1e-3)
        assert numbers["blade, second moment about the root"] == pytest.approx(11.776e6, rel=2e-3)
        assert numbers["tower mass"] == pytest.approx(347460, rel=1e-3)
        assert found["written"] == [str(out), str(tmp_path / "turbine.control.json")]
        assert load_turbine(out).rotor_diameter == 126.0

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["model.yaml"], "must be the primary file of an OpenFAST model"),
            (["model.fst", "--out", "turbine.json"], "must be a file that ends in .yaml"),
            (["model.fst", "--rated-power", "-1"], "must be a positive number"),
        ],
    )
    def test_wrong_words(self, words, message, capsys):
        with pytest.raises(SystemExit) as end:
            run_command("import", words)
        assert end.value.code == 2
        assert message in capsys.readouterr().err

    def test_without_the_other_reader_it_says_how_to_install_it(self, model, tmp_path, monkeypatch):
        monkeypatch.setitem(__import__("sys").modules, "openfast_io", None)
        with pytest.raises(SystemExit, match=r"openfast_io is not installed; .*\[openfast\]"):
            run_command("import", [str(model.write(tmp_path)), "--check", "openfast_io"])


class TestCheckInSteadyWinds:
    """`wt-gym import` runs a model in nine winds and compares with the table that comes with it."""

    @pytest.fixture
    def checked(self, nrel_5mw, tmp_path, monkeypatch):
        """Model in a folder with a table above it, and a function that replaces the simulated points."""
        (tmp_path / "OpenFAST").mkdir()
        path = Model(nrel_5mw).write(tmp_path / "OpenFAST")
        (tmp_path / "notes.csv").write_text("name,value\nx,1\n", encoding="utf-8")
        (tmp_path / "steady.csv").write_text(
            "wind speed [m/s],generator power [kW],rotor thrust [kN],rotor speed [RPM],blade pitch [deg],Cp [-]\n"
            "3,40,100,6.9,0,0.2\n11.5,5000,700,12.1,0.5,0.4\n25,5000,300,12.1,23,0.04\n",
            encoding="utf-8",
        )

        def give(**wrong):
            def points(turbine, on_point=None):
                table, made = find_steady_table(path, 5e6), []
                for wind in steady_winds(turbine):
                    values = {name: table.at(wind, name) for name in ("rotor_speed", "pitch", "power", "thrust")}
                    made.append(SteadyRun(wind, **values, deviation=0.001))
                made[4] = replace(made[4], **wrong)
                return made

            monkeypatch.setattr("wt_gym.experiment.steady_check.steady_check", points)
            return path

        return give

    @pytest.mark.filterwarnings("ignore:the speed loop of model")
    def test_a_right_one_passes_and_the_baseline_is_named(self, checked, capsys):
        run_command("import", [str(checked())])
        out = capsys.readouterr().out
        assert "discon: tracks the tip-speed ratio" in out
        assert "published: gains of the pitch, filter of the speed, torque gains, least pitch over the wind" in out
        assert "ROSCO's library runs with these numbers as the controller rosco" in out
        assert "beside steady.csv" in out
        assert "check passed" in out
        assert re.search(
            r"25\.00 +12\.10 / +12\.10 +23\.00 / +23\.00 +5000\.0 / +5000\.0 +300\.0 / +300\.0 +right", out
        )

    @pytest.mark.filterwarnings("ignore:the speed loop of model")
    def test_a_wrong_one_is_said_and_ends_with_status_3(self, checked, capsys):
        with pytest.raises(SystemExit) as end:
            run_command("import", [str(checked(power=4.4e6)), "--json"])
        out = capsys.readouterr().out
        assert end.value.code == 3
        assert "88% of the table's power; 88.0% of rated power" in out
        assert "CHECK FAILED at 14 m/s" in out
        rows = json.loads(out.splitlines()[-1])["check"]
        assert [row["verdict"] for row in rows].count("right") == 8

    def test_a_point_without_a_table_is_compared_with_blade_elements(self, nrel_5mw):
        point = SteadyRun(8.0, 0.9, 0.0, 1.7e6, 4e5, 0.0)
        assert verdict(nrel_5mw, point) == ""
        assert verdict(nrel_5mw, replace(point, power=0.0)) == "0% of blade elements' power"
        assert verdict(nrel_5mw, replace(point, deviation=0.03)) == "the rotor speed moves by 3.0 % of rated"
        assert verdict(nrel_5mw, replace(point, failure="simulation failed")) == "simulation failed"
        assert verdict(nrel_5mw, replace(point, wind=18.0, rotor_speed=1.267, power=4.9e6)) == "98.0% of rated power"
        fast = SteadyRun(18.0, 1.03 * nrel_5mw.drivetrain.rated_rotor_speed, 0.25, 5e6, 4e5, 0.0)
        assert verdict(nrel_5mw, fast) == "103.0% of the operating point's rotor speed"


def test_tables_of_steady_states(tmp_path, caplog):
    path = tmp_path / "performance.dat"
    path.write_text(
        "# Wind speed (m/s) \t Rotor rotational speed (rpm) \t Pitch angle (deg) \t Rotor electrical power (W) \t Rotor"
        " thrust (N) \t Rotor thrust coefficient (-) \n"
        "4.0\t6.0\t4.0\t1e5\t2e5\t0.7\n8.0\t8.0\t0.0\t8e5\t4e5\t0.8\n",
        encoding="utf-8",
    )
    table = read_steady_table(path)
    # power over the cube of the wind is constant: 100 kW (6/4)^3
    assert table.at(6.0, "power") == pytest.approx(337.5e3)
    assert table.at(6.0, "rotor_speed") == pytest.approx(7.0 * np.pi / 30)
    assert (table.at(6.0, "pitch"), table.at(6.0, "thrust")) == (pytest.approx(np.radians(2.0)), pytest.approx(3e5))
    assert table.at(9.0, "power") is None
    (tmp_path / "model").mkdir()
    assert find_steady_table(tmp_path / "model" / "model.fst", 0.79e6).path == path
    assert find_steady_table(tmp_path / "model" / "model.fst", 1.0e6) is None
    series = tmp_path / "model" / "openfast.csv"
    series.write_text("Time [s],Wind speed [m/s],gen power [kW]\n0,8,100\n1,8,100\n", encoding="utf-8")
    assert find_steady_table(tmp_path / "model" / "model.fst", 0.79e6).path == path
    assert f"not taken as the table of steady states: {series}" in caplog.text
    plain = tmp_path / "plain.csv"
    plain.write_text(
        "V,Cp,gen power [kW],rotor RPM,blade pitch [deg]\n4,0.4,100,6,4\n8,0.4,800,8,0\n", encoding="utf-8"
    )
    assert read_steady_table(plain).power.tolist() == [1e5, 8e5]
    assert read_steady_table(plain).thrust is None
    plain.write_text("V,gen power [kW]\n8,100\n4,x\n", encoding="utf-8")
    with pytest.raises(TurbineDefinitionError, match="rows of numbers"):
        read_steady_table(plain)
    plain.write_text("V,gen power [kW]\n8,100\n4,20\n", encoding="utf-8")
    with pytest.raises(TurbineDefinitionError, match="two winds that rise"):
        read_steady_table(plain)
