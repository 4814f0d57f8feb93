"""windIO files of other tools: foreign keys, other layouts, version 1, numbers left to be computed, odd texts."""

import copy
import json

import numpy as np
import pytest
from test_turbines_windio import at, save, small_turbine, table, tree

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines import load_turbine
from wt_gym.turbines.windio_machine import Machine, shaft_stiffness

DEGREE = np.pi / 180.0


def note(turbine, *words):
    """Return the one note that has all of these words."""
    (found,) = [text for text in turbine.notes if all(word in text for word in words)]
    return found


def version_1() -> dict:
    """The small turbine in the layout of windIO 1: radians, rad/s, matrices as lists, shape and structure apart."""
    new = small_turbine()
    data = {key: new[key] for key in ("name", "assembly", "materials")}
    (airfoil,) = copy.deepcopy(new["airfoils"])
    airfoil["relative_thickness"] = airfoil.pop("rthick")
    (tables,) = airfoil.pop("polars")[0]["re_sets"]
    polar = {"configuration": "any", "re": tables["re"]}
    for old, key in (("c_l", "cl"), ("c_d", "cd"), ("c_m", "cm")):
        grid = np.array(tables[key]["grid"]) * DEGREE
        polar[old] = {"grid": grid.tolist(), "values": tables[key]["values"]}
    airfoil["polars"] = [polar]
    data["airfoils"] = [airfoil]
    blade, tower = new["components"]["blade"], new["components"]["tower"]
    twist = {"grid": [0.0, 1.0], "values": [30.0 * DEGREE] * 2}
    beam = blade["structure"]["elastic_properties"]
    k, m = beam["stiffness_matrix"], beam["inertia_matrix"]
    stiffness = [0.0] * 21
    for place, key in ((11, "K33"), (15, "K44"), (18, "K55"), (20, "K66")):
        stiffness[place] = k[key][0]
    mass, cm_y, edge, flap = (m[key][0] for key in ("mass", "cm_y", "i_edge", "i_flap"))
    inertia = [0.0] * 21
    inertia[0] = inertia[6] = inertia[11] = mass
    inertia[5], inertia[12] = -mass * cm_y, mass * cm_y
    inertia[15], inertia[18], inertia[20] = edge, flap, edge + flap
    old, six, nacelle = "blade.outer_shape_bem.", "blade.elastic_properties_mb.six_x_six.", "nacelle.drivetrain."
    axis, tower_axis = blade["reference_axis"], tower["reference_axis"]
    data["components"] = tree(
        {
            old + "reference_axis": axis,
            old + "chord": table(2.0, 2.0),
            old + "twist": twist,
            old + "pitch_axis": table(0.3, 0.3),
            old + "airfoil_position": {"grid": [0.0, 1.0], "labels": ["ellipse", "ellipse"]},
            "blade.internal_structure_2d_fem": {"reference_axis": {}, "webs": [], "layers": ["not", "read"]},
            six + "reference_axis": axis,
            six + "twist": twist,
            six + "stiff_matrix": {"grid": [0.0, 1.0], "values": [stiffness] * 2},
            six + "inertia_matrix": {"grid": [0.0, 1.0], "values": [inertia] * 2},
            "hub": {"diameter": 2.0, "cone_angle": 2.0 * DEGREE, "drag_coefficient": 0.5},
            "hub.elastic_properties_mb": {
                "system_mass": 1e4,
                "system_inertia": [1e4] * 3,
                "system_center_mass": [0.0] * 3,
            },
            "nacelle.drivetrain": {"uptilt": 5.0 * DEGREE, "distance_tt_hub": 2.0, "overhang": 4.0},
            nacelle + "gear_ratio": 80.0,
            nacelle + "gearbox_efficiency": 0.97,
            nacelle + "distance_hub_mb": 1.5,
            nacelle + "distance_mb_mb": 0.5,
            nacelle + "lss_diameter": [0.6, 0.6],
            nacelle + "lss_wall_thickness": [0.1, 0.1],
            nacelle + "lss_material": "steel",
            nacelle + "damping_ratio": 0.01,
            nacelle + "generator_rpm_efficiency_user": {"grid": [0.0, 20.0], "values": [0.94, 0.94]},
            nacelle + "elastic_properties_mb": {
                "system_mass": 5e4,
                "yaw_mass": 2e3,
                "system_inertia": [1e5, 2e5, 2e5],
                "system_center_mass": [0.5, 0.0, 1.5],
            },
            "nacelle.generator": {"B_r": 1.2, "rho_Fe": 7700.0},
            "tower.outer_shape_bem.reference_axis": tower_axis,
            "tower.outer_shape_bem.outer_diameter": tower["outer_shape"]["outer_diameter"],
            "tower.outer_shape_bem.drag_coefficient": tower["outer_shape"]["cd"],
            "tower.internal_structure_2d_fem": tower["structure"] | {"reference_axis": tower_axis},
            "foundation.height": 0.0,
        }
    )
    data["control"] = wisdem_control(DEGREE, np.pi / 30.0)
    return data


def wisdem_control(angle: float = 1.0, speed: float = 1.0) -> dict:
    """WISDEM's control section, with what a degree and a revolution per minute are in its units."""
    return {
        "supervisory": {"Vin": 4.0, "Vout": 24.0, "maxTS": 75.0},
        "pitch": {
            "ps_percent": 0.8,
            "min_pitch": -1.0 * angle,
            "max_pitch": 80.0 * angle,
            "max_pitch_rate": 6.0 * angle,
        },
        "torque": {"tsr": 7.5, "VS_minspd": 8.0 * speed, "VS_maxspd": 18.0 * speed, "max_torque_rate": 2e3},
    }


def check_wisdem_limits(turbine):
    assert np.degrees([turbine.pitch.min_pitch, turbine.pitch.max_pitch]) == pytest.approx([-1.0, 80.0])
    assert np.degrees(turbine.pitch.max_rate) == pytest.approx(6.0)
    assert (turbine.cut_in, turbine.cut_out, turbine.drivetrain.max_torque_rate) == (4.0, 24.0, 2e3)
    assert turbine.drivetrain.min_rotor_speed * 30.0 / np.pi == pytest.approx(8.0)
    assert turbine.rated_wind_speed == pytest.approx(
        turbine.drivetrain.rated_rotor_speed
        * (turbine.hub.radius + turbine.blade.length)
        * np.cos(turbine.hub.cone)
        / 7.5
    )


def test_keys_of_other_tools_are_left_aside_and_named(tmp_path):
    whole, data = load_turbine(save(small_turbine(), tmp_path)), small_turbine()
    data["costs"] = {"labor_rate": 60.0}
    data["components"]["foundation"] = {"height": 0.0}
    data["components"]["drivetrain"]["generator"] |= {"B_r": 1.2, "rho_Fe": 7700.0}
    data["components"]["blade"]["structure"]["layers"] = [{"name": "skin", "start_nd_grid": 0.0}, {"end_nd_grid": 1.0}]
    turbine = load_turbine(save(data, tmp_path))
    assert "costs" in note(turbine, "top level")
    assert "foundation" in note(turbine, "components: keys")
    assert "B_r, rho_Fe" in note(turbine, "components.drivetrain.generator: keys")
    assert "start_nd_grid, end_nd_grid" in note(turbine, "components.blade.structure.layers[*]")
    assert set(whole.notes) < set(turbine.notes)
    np.testing.assert_equal(turbine.blade.structure.stiffness, whole.blade.structure.stiffness)
    assert turbine.drivetrain.generator_inertia == whole.drivetrain.generator_inertia


def test_a_typing_error_is_named_beside_what_it_resembles(tmp_path):
    data = small_turbine()
    data["control"]["max_pitch_limits"] = 85.0
    assert "max_pitch_limits resembles max_pitch_limit" in note(load_turbine(save(data, tmp_path)), "control: keys")
    data["control"]["max_pitch_rat"] = data["control"].pop("max_pitch_rate")
    with pytest.raises(TurbineDefinitionError, match=r"control\.max_pitch_rate: missing.*'max_pitch_rat' there"):
        load_turbine(save(data, tmp_path))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("components.mooring", {"lines": "none"}),
        ("components.blade.structure.layers", [{"name": 3, "thickness": "thin"}]),
        ("components.drivetrain.other_components", {"uptower": "perhaps"}),
        ("components.hub.flange_OD2hub_D", "wide"),
    ],
)
def test_flaws_where_nothing_is_read_do_not_cost_the_turbine(path, value, tmp_path):
    data = small_turbine()
    parent, key = at(data, path)
    parent[key] = value
    assert load_turbine(save(data, tmp_path)).name == "small"


def test_limits_in_the_layout_of_wisdem(tmp_path):
    data = small_turbine()
    data["control"] = wisdem_control()
    turbine = load_turbine(save(data, tmp_path))
    check_wisdem_limits(turbine)
    assert turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi == pytest.approx(18.0)
    assert "VS_maxspd" in note(turbine, "control.rated_rotor_speed")
    assert "min_pitch as control.min_pitch_limit" in note(turbine, "control.pitch: layout")
    data["assembly"]["rotor_diameter"] = 82.0
    data["control"]["supervisory"]["maxTS"] = 70.0
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.drivetrain.rated_rotor_speed == pytest.approx(70.0 / 41.0)
    data["control"] |= small_turbine()["control"] | {"max_pitch_rate": 3.0}  # the keys of windIO go before
    turbine = load_turbine(save(data, tmp_path))
    assert np.degrees(turbine.pitch.max_rate) == pytest.approx(3.0)
    assert turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi == pytest.approx(18.0)


def test_wisdem_files_mean_the_diameter_and_height_of_the_assembly(tmp_path):
    data = small_turbine()
    data["control"] = wisdem_control()
    data["assembly"] |= {"rotor_diameter": 90.2, "hub_height": 100.0}
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.blade.length == pytest.approx(40.0 * 90.2 / 82.0)
    assert turbine.tower.height == pytest.approx(98.0)
    assert "44.00 m" in note(turbine, "components.blade.reference_axis.z: stretched")
    assert "98.00 m" in note(turbine, "components.tower.reference_axis.z: top moved")
    data["control"] = small_turbine()["control"]  # not a file of WISDEM: a contradiction
    with pytest.raises(TurbineDefinitionError, match="rotor_diameter"):
        load_turbine(save(data, tmp_path))


def test_torque_limits_in_kilonewton_meters(tmp_path):
    data = small_turbine()
    rated = 1e6 / (18.0 * np.pi / 30.0 * 80.0)
    data["control"] |= {"max_gen_torque": 1.1e-3 * rated / 0.95, "max_torque_rate": 2.0}
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.drivetrain.max_generator_torque == pytest.approx(1.1 * rated / 0.95)
    assert turbine.drivetrain.max_torque_rate == pytest.approx(2e3)
    assert "max_gen_torque, max_torque_rate" in note(turbine, "kN m")


def test_version_1_gives_the_turbine_of_version_2(tmp_path):
    turbine, whole = load_turbine(save(version_1(), tmp_path)), load_turbine(save(small_turbine(), tmp_path))
    note(turbine, "windIO_version", "version 1", "windIO's own converter")
    check_wisdem_limits(turbine)
    assert np.degrees([turbine.hub.cone, turbine.nacelle.tilt]) == pytest.approx([2.0, 5.0])
    for part in ("stiffness", "inertia", "station"):
        expected = getattr(whole.blade.structure, part)
        np.testing.assert_allclose(getattr(turbine.blade.structure, part), expected, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(turbine.blade.twist_at([3.0, 30.0]), np.pi / 6)
    np.testing.assert_allclose(turbine.blade.le_offset_at([3.0, 30.0]), 0.3)
    polars = [one.blade.polar_at(20.0).coefficients(0.3) for one in (turbine, whole)]
    np.testing.assert_allclose(*polars, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(turbine.tower.structure.inertia, whole.tower.structure.inertia)
    # What the converter itself drops:
    nacelle, drive = turbine.nacelle, turbine.drivetrain
    assert (nacelle.mass, nacelle.yaw_bearing_mass, nacelle.inertia[2, 2]) == (5e4, 2e3, 2e5)
    np.testing.assert_allclose(nacelle.cm, [0.5, 0.0, 1.5])
    assert (drive.generator_efficiency, drive.gearbox_efficiency) == (0.94, 0.97)
    assert drive.spring == pytest.approx(shaft_stiffness(0.6, 0.1, 2.0, 2.1e11 / 2.6))
    assert "B_r, rho_Fe" in note(turbine, "components.drivetrain.generator: keys")


def test_version_1_keeps_every_reynolds_number(tmp_path):
    data = version_1()
    polars = data["airfoils"][0]["polars"]
    other = copy.deepcopy(polars[0]) | {"re": 1e7}
    other["c_d"]["values"] = [0.2, 0.2]
    polars.append(other)
    blade = load_turbine(save(data, tmp_path)).blade
    # Speed times chord over viscosity is 1.06e7 at the tip and a fortieth of it at the root.
    drag = [blade.polar_at(z).coefficients(0.1)[1] for z in (0.0, 40.0)]
    assert drag == pytest.approx([0.1, 0.2])


SIX = "components.blade.elastic_properties_mb.six_x_six"


@pytest.mark.parametrize(
    ("path", "change", "named"),
    [
        ("components.nacelle", {}, r"components\.nacelle.*'nacelle' is missing"),
        ("components.blade.outer_shape_bem.pitch_axis", {}, r"components\.blade.*'pitch_axis'"),
        ("components.tower.outer_shape_bem", {}, r"components\.tower.*'outer_shape_bem'"),
        ("airfoils.0.polars.0.c_d", {}, r"airfoils.*'c_d'"),
        ("components.blade.elastic_properties_mb", {}, r"blade\.structure\.elastic_properties.*missing"),
        ("control.pitch.max_pitch_rate", {}, r"control\.max_pitch_rate: missing"),
        (SIX + ".twist", {"twist": table(0.5, 0.1)}, r"six_x_six\.twist must be .* deg"),
    ],
)
def test_what_version_1_lacks_is_named(path, change, named, tmp_path):
    data = version_1()
    parent, key = at(data, path)
    del parent[key]
    parent |= change
    with pytest.raises(TurbineDefinitionError, match=named):
        load_turbine(save(data, tmp_path))


def test_what_is_left_to_be_computed_is_estimated(tmp_path):
    """Masses of NREL's cost model of 2015, by hand for a blade of 8 t on a rotor of 82 m, 1 MW at 18 rpm."""
    data = small_turbine()
    drivetrain = data["components"]["drivetrain"]
    del data["components"]["hub"]["elastic_properties"], drivetrain["elastic_properties"], drivetrain["generator"]
    del drivetrain["gearbox"]["elastic_properties"]
    drivetrain["lss"] = {"diameter": [0.6, 0.6], "wall_thickness": [0.1, 0.1], "length": 2.0, "material": "unknown"}
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.hub.mass == pytest.approx(19720.0 + (3108.0 + 491.31) * 1.328 + 555.0 + 291.0)
    assert turbine.hub.inertia_axial == pytest.approx(2.0 / 3.0 * turbine.hub.mass)
    torque = 1e6 / (0.6 * np.pi)
    parts = [
        13.0 * 8.0e3**0.65 + 775.0, 2e-4 * 82.0**3.5, torque / 200.0, 198.94, 1.22e-3 * torque, 5700.0, 82.0**2.2,
        80.0, 1709.89, 0.125 * 82.0**2.2, 3825.0,
    ]  # fmt: skip
    assert turbine.nacelle.mass == pytest.approx(sum(parts))
    assert turbine.nacelle.yaw_bearing_mass == pytest.approx(1.35e-3 * 82.0**3.314)
    assert turbine.drivetrain.generator_inertia == pytest.approx(1.5e6 / (0.6 * np.pi * 80.0) ** 2)
    assert turbine.drivetrain.spring == pytest.approx(79.3e9 * np.pi / 32.0 * (0.6**4 - 0.4**4) / 2.0)
    for path in ("hub.elastic_properties.mass", "hub.elastic_properties.inertia", "drivetrain.elastic_properties.mass",
                 "drivetrain.elastic_properties.inertia", "yaw.elastic_properties.mass",
                 "generator.elastic_properties.inertia", "drivetrain.elastic_properties.spring_constant"):  # fmt: skip
        assert "not in the file" in note(turbine, f"{path}: not")


def test_estimates_against_published_machines():
    """The IEA 15-MW turbine: hub 190 t, nacelle 632 t (NREL/TP-5000-75698), the NREL 5-MW: hub 56.8 t.

    And of both the generator: 534 kg m^2 at the high-speed shaft (NREL/TP-500-38060), 1.837e6 kg m^2 (windIO).
    """
    small = Machine(5e6, 12.1 * np.pi / 30.0, 97.0, 126.0, 3.0, 3, 17740.0)
    large = Machine(15e6, 7.56 * np.pi / 30.0, 1.0, 241.4, 7.94, 3, 65250.0)
    assert [small.hub_mass(), large.hub_mass()] == pytest.approx([56780.0, 190e3], rel=0.1)
    assert large.nacelle_mass(large.generator_mass()) == pytest.approx(632e3, rel=0.1)
    assert small.generator_inertia(0.0, None) == pytest.approx(534.116, rel=0.1)
    assert large.generator_inertia(371.6e3, 5.08) == pytest.approx(1.837e6, rel=0.35)


def test_the_mass_of_the_whole_top_is_shared_out(tmp_path):
    data = small_turbine()
    del data["components"]["hub"]["elastic_properties"], data["components"]["drivetrain"]["elastic_properties"]
    data["components"]["RNA"] = {"elastic_properties_mb": {"mass": 90e3}}
    turbine = load_turbine(save(data, tmp_path))
    parts = turbine.hub.mass, turbine.nacelle.mass, turbine.nacelle.yaw_bearing_mass
    assert 3 * turbine.blade.structure.mass_moment(0) + sum(parts) == pytest.approx(90e3)
    assert "components.RNA" in note(turbine, "components.hub.elastic_properties.mass")
    data["components"]["RNA"]["elastic_properties_mb"]["mass"] = 20e3
    with pytest.raises(TurbineDefinitionError, match=r"RNA.*blades.*20000"):
        load_turbine(save(data, tmp_path))


def test_the_lowest_speed_is_that_of_the_optimal_ratio_at_cut_in(tmp_path):
    data = small_turbine()
    data["control"]["min_rotor_speed"] = 0.0
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.drivetrain.min_rotor_speed == pytest.approx(7.0 * 3.0 / 41.0)
    assert "4.89 rpm" in note(turbine, "control.min_rotor_speed")


def test_a_geared_machine_without_its_ratio_is_refused(tmp_path):
    data = small_turbine()
    del data["components"]["drivetrain"]["gearbox"]["gear_ratio"]
    data["assembly"]["drivetrain"] = "Geared"
    with pytest.raises(TurbineDefinitionError, match=r"gear_ratio: missing.*geared"):
        load_turbine(save(data, tmp_path))


def test_a_flapwise_inertia_of_zeros_follows_from_the_polar_one(tmp_path):
    whole, data = load_turbine(save(small_turbine(), tmp_path)), small_turbine()
    inertia = data["components"]["blade"]["structure"]["elastic_properties"]["inertia_matrix"]
    inertia |= {"i_flap": [0.0, 0.0], "i_plr": [70.0, 70.0], "i_cp": [-60.0, -60.0]}
    turbine = load_turbine(save(data, tmp_path))
    np.testing.assert_allclose(turbine.blade.structure.inertia, whole.blade.structure.inertia, rtol=1e-12, atol=1e-9)
    assert "i_plr - i_edge" in note(turbine, "i_flap: all zero")


@pytest.mark.parametrize(
    "text",
    [
        lambda data: b"\xef\xbb\xbf" + json.dumps(data).encode(),
        lambda data: json.dumps(data, indent="\t").encode(),
        lambda data: json.dumps(data, indent=1).replace("\n", "\r\n").encode(),
        lambda data: json.dumps(data, indent=1).encode("utf-16"),
        lambda data: b"# a comment first\r\n" + json.dumps(data).encode(),
    ],
    ids=["byte-order mark", "tabs in JSON", "CRLF", "UTF-16", "comment and JSON"],
)
def test_texts_of_other_systems_are_read(text, tmp_path):
    path = tmp_path / "turbine.json"
    path.write_bytes(text(small_turbine()))
    assert load_turbine(path).rotor_diameter == pytest.approx(82.0)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"name: x\nassembly:\n\thub_height: 82\n", "line 3 is indented by a tab"),
        (b"<!DOCTYPE html>\n<html><p>: [</html>", "web page"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:1: 2\n", "Git LFS"),
        (b'{"name": "a", "name": "b"}', "duplicate key"),
        (b"name: caf\xe9\n", "turbine.yaml"),
    ],
)
def test_what_is_likely_wrong_is_said(content, named, tmp_path):
    path = tmp_path / "turbine.yaml"
    path.write_bytes(content)
    with pytest.raises(TurbineDefinitionError, match=named):
        load_turbine(path)


def test_paths_as_people_write_them(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    save(small_turbine(), tmp_path)
    assert load_turbine("~/turbine.yaml").name == "small"
    with pytest.raises(TurbineDefinitionError, match="folder"):
        load_turbine(tmp_path)
    with pytest.raises(TurbineDefinitionError, match="no such file"):
        load_turbine(r"C:\turbines\mine.yaml")


def test_an_anchor_that_is_used_twice_is_no_hindrance(tmp_path):
    path = tmp_path / "turbine.yaml"
    text = (
        json.dumps(small_turbine())
        .replace('"cd": 0.5', '"cd": &a 0.5')
        .replace('"overhang": 4.0', '"overhang": &a 4.0')
    )
    path.write_text(text)
    assert load_turbine(path).nacelle.overhang == pytest.approx(4.0)
