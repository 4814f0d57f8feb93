"""Reading windIO files: frames, both descriptions of a tower, fall-backs and wrong files."""

import copy
import json
import re
import time
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from ruamel.yaml import YAML

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import read_toml
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade import BeamStations, inertia_matrix
from wt_gym.turbines.catalog import turbine_file

LENGTH = 40.0
DATA = Path(__file__).with_name("data")


def table(*values):
    return {"grid": list(np.linspace(0.0, 1.0, len(values))), "values": list(values)}


def beam(**entries):
    stiffness = {key: [value, value] for key, value in entries.items() if key.startswith("K")}
    inertia = {key: [value, value] for key, value in entries.items() if not key.startswith("K")}
    return {
        "stiffness_matrix": {"grid": [0.0, 1.0], **stiffness},
        "inertia_matrix": {"grid": [0.0, 1.0], **inertia},
        "structural_damping": {"mu": [0.0] * 6},
    }


def tree(entries: dict) -> dict:
    """Nested mappings of values by dotted paths."""
    data: dict = {}
    for path, value in entries.items():
        node, (*parents, key) = data, path.split(".")
        for name in parents:
            node = node.setdefault(name, {})
        node[key] = value
    return data


SMALL = YAML(typ="safe").load(DATA / "small_turbine.yaml")


def small_turbine() -> dict:
    """A made-up 40 m blade of constant section on an 80 m tower, in as few numbers as windIO allows."""
    angle = np.linspace(0.0, 2.0 * np.pi, 21)
    data = copy.deepcopy(SMALL)
    data["airfoils"][0]["coordinates"] = {"x": list(np.abs(0.5 + 0.5 * np.cos(angle))), "y": list(0.1 * np.sin(angle))}
    return data


def save(data: dict, tmp_path):
    path = tmp_path / "turbine.yaml"
    # JSON is a subset of YAML, but for the spelling of "not a number".
    path.write_text(json.dumps(data).replace("NaN", ".nan"))
    return path


def at(data: dict, path: str):
    """Return the parent of a dotted path and its last key."""
    keys = [int(key) if key.isdigit() else key for key in path.split(".")]
    for key in keys[:-1]:
        data = data[key]
    return data, keys[-1]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return load_turbine(save(small_turbine(), tmp_path_factory.mktemp("windio")))


def test_twist_turns_stiffness_and_mass_with_the_leading_edge_upwind(small):
    """30 deg of twist: the chord normal points to (cos, -sin), the trailing edge to (sin, cos)."""
    structure = small.blade.structure
    normal, chordwise = np.array([np.sqrt(0.75), -0.5]), np.array([0.5, np.sqrt(0.75)])
    bending = structure.stiffness[0, 3:5, 3:5]
    np.testing.assert_allclose(bending @ normal, 8e8 * normal, rtol=1e-12)
    np.testing.assert_allclose(bending @ chordwise, 2e8 * chordwise, rtol=1e-12)
    mass = structure.inertia[1]
    np.testing.assert_allclose([-mass[2, 4] / mass[0, 0], mass[2, 3] / mass[0, 0]], 0.3 * chordwise, rtol=1e-12)
    assert np.trace(mass[3:, 3:]) == pytest.approx(140.0)
    assert small.blade.twist_at(10.0) == pytest.approx(np.pi / 6)
    assert small.blade.le_offset_at(10.0) == pytest.approx(0.3)


def test_inertia_matrix_is_the_kinetic_energy_of_its_particles():
    rng = np.random.default_rng(1)
    m, x, y = rng.uniform(0.1, 1.0, 50), rng.normal(0.2, 1.0, 50), rng.normal(0.5, 1.0, 50)
    matrix = inertia_matrix(m.sum(), m @ x / m.sum(), m @ y / m.sum(), m @ y**2, m @ x**2, m @ (x * y))
    motion = rng.normal(size=6)
    velocity = motion[:3] + np.cross(motion[3:], np.column_stack((x, y, 0 * x)))
    assert 0.5 * motion @ matrix @ motion == pytest.approx(0.5 * np.sum(m[:, None] * velocity**2), rel=1e-12)


def test_matrices_in_the_frame_of_the_schema_text_give_the_same_blade(tmp_path):
    """A blade whose axial center lies 0.2 m aft and 0.05 m up, once with x to the suction side, once with y."""
    ours, schema = small_turbine(), small_turbine()
    ea, back, up = 1e9, 0.2, 0.05
    same = {"K33": ea, "K45": -1e7, "K66": 1e8, "mass": 200.0, "i_edge": 60.0, "i_flap": 10.0, "i_cp": 4.0}
    for data, (up_, back_), k44, k55 in ((ours, (up, back), 8e8, 2e8), (schema, (back, up), 2e8, 8e8)):
        sections = beam(K34=ea * back_, K35=-ea * up_, K44=k44, K55=k55, cm_x=up_, cm_y=back_, **same)
        data["components"]["blade"]["structure"]["elastic_properties"] = sections
    first, second = load_turbine(save(ours, tmp_path)), load_turbine(save(schema, tmp_path))
    np.testing.assert_allclose(second.blade.structure.stiffness, first.blade.structure.stiffness, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(second.blade.structure.inertia, first.blade.structure.inertia, rtol=1e-12, atol=1e-9)
    assert any("K55 > K44" in note for note in second.notes)
    assert not any("K55 > K44" in note for note in first.notes)


def test_shell_tower_against_the_formulas_of_a_tube(small):
    structure = small.tower.structure
    outer, inner = 2.0, 1.97
    area, second = np.pi * (outer**2 - inner**2), np.pi / 4 * (outer**4 - inner**4)
    np.testing.assert_allclose(
        np.diag(structure.stiffness[0]),
        [np.inf, np.inf, 2.1e11 * area, 2.1e11 * second, 2.1e11 * second, 2.1e11 / 2.6 * 2 * second],
    )
    assert structure.inertia[0, 0, 0] == pytest.approx(1.1 * 7850 * area)
    assert structure.inertia[0, 5, 5] == pytest.approx(1.1 * 7850 * 2 * second)


def test_yaw_actuator_fall_back_meets_the_published_one(tmp_path):
    """Without its yaw spring the NREL 5-MW gets one from 3 Hz and 2 %: published 9.028e9 N m/rad, 19.16e6 N m s/rad."""
    lines = turbine_file("nrel_5mw").read_text().splitlines()
    path = tmp_path / "turbine.yaml"
    path.write_text("\n".join(line for line in lines if "spring_constant:" not in line))
    turbine = load_turbine(path)
    assert turbine.nacelle.yaw_spring == pytest.approx(9028320000, rel=0.05)
    assert turbine.nacelle.yaw_damper == pytest.approx(19160000, rel=0.05)
    assert any("yaw actuator" in note for note in turbine.notes)


def test_moment_is_moved_to_the_quarter_chord(tmp_path):
    """Drag alone at 90 deg acting in mid chord: c_m(1/4) = -c_d / 4."""
    data = small_turbine()
    data["airfoils"][0]["aerodynamic_center"] = 0.5
    data["airfoils"][0]["polars"][0]["re_sets"][0]["cl"] = {"grid": [-180.0, 180.0], "values": [0.0, 0.0]}
    data["airfoils"][0]["polars"][0]["re_sets"][0]["cd"] = {"grid": [-180.0, 90.0, 180.0], "values": [0.0, 2.0, 0.0]}
    polar = load_turbine(save(data, tmp_path)).blade.polar_at(3.0)
    assert polar.coefficients(np.pi / 2)[2] == pytest.approx(-0.5)


def test_polars_are_chosen_by_reynolds_number_and_mixed_by_weight(tmp_path):
    data = small_turbine()
    foil = data["airfoils"][0]
    sets = foil["polars"][0]["re_sets"]
    drag = {"grid": [-180.0, 180.0], "values": [0.2, 0.2]}
    sets.append(copy.deepcopy(sets[0]) | {"re": 1e7, "cd": drag})
    # At the tip 41 m * 1.885 rad/s * 2 m / 1.46e-5 m^2/s = 1.06e7, at the root a fortieth of it.
    shape = data["components"]["blade"]["outer_shape"]
    shape["airfoils"] = [{"name": "ellipse", "spanwise_position": p} for p in (0.0, 1.0)]
    blade = load_turbine(save(data, tmp_path)).blade
    assert blade.polar_at(0.0).coefficients(0.1)[1] == pytest.approx(0.1)
    assert blade.polar_at(LENGTH).coefficients(0.1)[1] == pytest.approx(0.2)
    rough = {"configuration": "rough", "re_sets": [copy.deepcopy(sets[0]) | {"cd": drag}]}
    foil["polars"] = [{"configuration": "clean", "re_sets": [sets[0]]}, rough]
    shape["airfoils"] = [{"name": "ellipse", "configuration": ["clean", "rough"], "weight": [0.3, 0.7]}]
    blade = load_turbine(save(data, tmp_path)).blade
    assert blade.polar_at(5.0).coefficients(0.1)[1] == pytest.approx(0.3 * 0.1 + 0.7 * 0.2)


def test_prebend_sweep_and_normal_offset(tmp_path):
    data = small_turbine()
    blade = data["components"]["blade"]
    blade["reference_axis"]["x"] = table(0.0, -0.3, -1.2)
    blade["outer_shape"]["section_offset_x"] = table(0.1, 0.1)
    turbine = load_turbine(save(data, tmp_path))
    assert turbine.blade.axis_at(LENGTH)[0] == pytest.approx(-1.2)
    # Arc length of a parabola x = -1.2 (z/40)^2: 40 (1 + slope^2/6), to second order.
    assert turbine.blade.structure.length == pytest.approx(LENGTH * (1 + 0.06**2 / 6), rel=1e-5)
    np.testing.assert_allclose(turbine.blade.camber_at(10.0, [0.2, 0.7])[0], 0.05, atol=1e-9)


OPTIONAL = re.compile(
    r"assembly\.(rotor_orientation|number_of_blades|hub_height)|airfoils\.0\.polars\.0\.configuration|"
    r"components\.(blade\.(outer_shape\.airfoils\.0\.spanwise_position|structure\.(anchors|layers)|"
    r"structure\.elastic_properties\.(inertia_matrix\.cm_y|structural_damping(\.mu)?))|hub\.(cd|elastic_properties.*)|"
    r"drivetrain\.(gearbox\.(gear_ratio|efficiency)|(generator|elastic_properties).*)|"
    r"tower\.structure\.(outfitting_factor|layers\.0\.name))"
)
"""Paths that a file may lack."""


def paths(data, above=""):
    """Dotted paths of all keys, of the first entry of a list."""
    for key, value in data.items() if isinstance(data, dict) else [("0", data[0])] if data else []:
        path = f"{above}.{key}" if above else str(key)
        if not isinstance(data, list):
            yield path
        if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield from paths(value, path)


def test_a_missing_key_is_named_or_can_be_done_without(tmp_path):
    """Each key of the file in turn: the error names it and what is expected there, or the notes say what is taken."""
    needed = set()
    for path in paths(small_turbine()):
        data = small_turbine()
        parent, key = at(data, path)
        del parent[key]
        try:
            load_turbine(save(data, tmp_path))
        except TurbineDefinitionError as error:
            message = str(error)
            assert str(key) in message, path
            assert "turbine.yaml" in message
            assert len(message) < 800
            needed.add(path)
    assert needed == {path for path in paths(small_turbine()) if not OPTIONAL.fullmatch(path)}


@pytest.mark.parametrize(("path", "value", "named"), read_toml(DATA / "windio_wrong_values.toml")["wrong"])
def test_wrong_values_are_named(path, value, named, tmp_path):
    data = small_turbine()
    parent, key = at(data, path)
    parent[key] = value
    with pytest.raises(TurbineDefinitionError, match=named):
        load_turbine(save(data, tmp_path))


BOMB = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 8)}]" for i in range(1, 30))]


@pytest.mark.parametrize(
    ("files", "named"),
    [
        ({"turbine.yaml": "\n".join([*BOMB, "airfoils: *a29"])}, "aliases"),
        ({"turbine.yaml": "name: !include turbine.yaml"}, "includes itself"),
        ({"turbine.yaml": "name: " + "[" * 20_000 + "]" * 20_000}, "nested too deep"),
        ({"turbine.yaml": "name: " + "{a: " * 80 + "1" + "}" * 80}, "nested deeper than 50 levels"),
        ({f"a{k}.yaml": f"[{', '.join([f'!include a{k + 1}.yaml'] * 10)}]" for k in range(9)}, "more than 300 files"),
        ({"a0.yaml": "[!include a1.yaml, !include a1.yaml]", "a1.yaml": "[!include a0.yaml]"}, "includes itself"),
        ({f"a{k}.yaml": f"b: !include a{k + 1}.yaml" for k in range(200)}, "nested too deep|nested deeper"),
        ({"a0.yaml": "[" * 20_000 + "]" * 20_000}, "nested too deep"),
        ({"a0.yaml": "\n".join([*BOMB, "airfoils: *a29"])}, "aliases"),
        ({"a0.yaml": "!include nowhere.yaml"}, "no such file"),
        ({"a0.yaml": "!include /dev/zero.yaml"}, "no such file"),
        ({"a0.yaml": "!include /dev/zero"}, "one YAML file"),
        ({"a0.yaml": "!include [a1.yaml]"}, "one YAML file"),
        ({"a0.yaml": "!include folder.yaml", "folder.yaml/x": ""}, "no such file"),
        ({"a0.yaml": "name: [unclosed"}, "not a valid YAML"),
        ({"turbine.yaml": "values: [" + "1.0, " * 1_000_000 + "1.0]\n"}, "components: missing"),
    ],
)
def test_what_would_blow_up_ends_soon_in_one_line(files, named, tmp_path):
    """In the file itself, and in what it includes."""
    path = tmp_path / "turbine.yaml"
    for name, text in {"turbine.yaml": "name: !include a0.yaml", "a9.yaml": "1", **files}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    load_turbine("nrel_5mw")  # loads windIO
    begin = time.process_time()
    with pytest.raises(TurbineDefinitionError, match=named) as refused:
        load_turbine(path)
    assert time.process_time() - begin < 1.0
    assert len(str(refused.value)) < 1000
    assert "\n" not in str(refused.value) or named == "not a valid YAML"


def test_included_files_are_read_from_beside_the_one_that_includes_them(tmp_path):
    data = small_turbine()
    whole = load_turbine(save(data, tmp_path))
    (tmp_path / "parts").mkdir()
    for part in ("airfoils", "materials"):
        (tmp_path / "parts" / f"{part}.yaml").write_text(json.dumps(data[part]))
        data[part] = f"INCLUDE parts/{part}.yaml"
    data["materials"] = "INCLUDE parts\\materials.yaml"  # as Windows writes it
    path = save(data, tmp_path)
    path.write_text(re.sub(r'"INCLUDE (.*?)"', r"!include \1", path.read_text()).replace("\\\\", "\\"))
    np.testing.assert_equal(asdict(load_turbine(path)), asdict(whole))


@pytest.mark.parametrize(
    "text",
    [
        "name: !!int ''", "name: !!float x", "? [a, b]\n: 1", "? {a: 1}\n: 1", "name: !!timestamp 2001-99-99", "a: *b",
        "a: &a [*a]", "%YAML 9.9\n---\na: 1", "name: !!binary '='", "a: !!set {b, c}", "---\na: 1\n---\nb: 1", "<<: 3",
        "a: !!omap 3", "a: !!python/name:os.system x", "a: 0b", "a: 0o9", "a: 1:99:xx", "name: [unclosed", "just text",
        "- a\n- list", "a: 1\na: 2", "x: !!python/object/apply:os.getcwd []", "", "\udcff\udcfe\0\x01\x9c" * 20,
    ],
)  # fmt: skip
def test_odd_yaml_is_refused_without_a_traceback(text, tmp_path):
    path = tmp_path / "turbine.yaml"
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(TurbineDefinitionError, match=r"turbine\.yaml"):
        load_turbine(path)


def test_files_that_cannot_be_read_are_refused(tmp_path, monkeypatch):
    path = save(small_turbine(), tmp_path)
    path.with_name("turbine.control.json").write_bytes(b"\xff")
    with pytest.raises(TurbineDefinitionError, match=r"turbine\.control\.json: must be UTF-8 text"):
        load_turbine(path)
    monkeypatch.setattr(Path, "read_bytes", Mock(side_effect=PermissionError(13, "Permission denied")))
    with pytest.raises(TurbineDefinitionError, match=r"turbine\.yaml: cannot be read: Permission denied"):
        load_turbine(path)


def test_changed_file_is_read_again(tmp_path):
    data = small_turbine()
    first = load_turbine(save(data, tmp_path))
    data["name"] = "renamed"
    second = load_turbine(save(data, tmp_path))
    assert (first.name, second.name) == ("small", "renamed")


def test_beam_stations_interpolate_linearly_and_keep_rigid_shear(small):
    structure = small.tower.structure
    middle = structure.stiffness_at(40.0)
    assert np.isinf(middle[0, 0])
    assert np.isinf(middle[1, 1])
    np.testing.assert_allclose(middle[2:, 2:], structure.stiffness[:, 2:, 2:].mean(axis=0))
    np.testing.assert_array_equal(structure.stiffness_at([0.0, 80.0]), structure.stiffness)
    assert structure.inertia_at(np.zeros((2, 3))).shape == (2, 3, 6, 6)
    with pytest.raises(TurbineDefinitionError, match="80"):
        structure.inertia_at(81.0)


def test_mass_moments_are_exact():
    """Mass per length 1 + s on [0, 2]: moments 4, 14/3, 20/3."""
    unit = np.eye(6)
    beam_stations = BeamStations([0.0, 2.0], [unit, unit], [unit, 3 * unit])
    assert [beam_stations.mass_moment(k) for k in range(3)] == pytest.approx([4.0, 14.0 / 3.0, 20.0 / 3.0])


@pytest.mark.parametrize(
    ("place", "factor", "refused"),
    [(0, 1e9, True), (2, 1e-9, True), (4, 1e9, True), (2, 1e4, True), (0, 1e4, False), (4, 1e4, False)],
)
def test_spikes_of_stiffness_are_refused(place, factor, refused):
    """A step at an end may be meant."""
    stiffness = np.array([np.diag([1e9, 1e9, 1e9, 1e8, 1e8, 1e7]) * 10.0**-k for k in range(5)])
    stiffness[place, 4, 4] *= factor
    with pytest.raises(TurbineDefinitionError, match="neighbors") if refused else nullcontext():
        BeamStations(np.arange(5.0), stiffness, np.array([np.eye(6)] * 5))


def test_floating_platforms_are_refused(tmp_path):
    """A file has neither added mass nor wave forces of its platform."""
    data = small_turbine()
    data["components"]["floating_platform"] = {"joints": [], "members": []}
    with pytest.raises(
        TurbineDefinitionError, match=r"components\.floating_platform must be absent: .* OpenFAST model"
    ):
        load_turbine(save(data, tmp_path))


UNIT = np.array([np.eye(6)] * 2)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"station": [0.0, 0.0]}, "station"),
        ({"station": [1.0, 2.0]}, r"station\[0\]"),
        ({"station": [0.0, 1.0, 2.0]}, "stiffness"),
        ({"stiffness": UNIT + np.eye(6, k=1)}, "symmetric"),
        ({"stiffness": [np.diag([1, 1, 1, 1, np.inf, 1.0])] * 2}, r"stiffness\[0, 4, 4\]"),
        ({"stiffness": [np.diag([np.inf, np.inf, 1, 1, 1, 1.0]), np.eye(6)]}, "inf"),
        ({"inertia": 0.0 * UNIT}, "mass per length"),
        ({"inertia": -UNIT}, "semidefinite"),
    ],
)
def test_wrong_beam_stations_are_refused(change, named):
    with pytest.raises(TurbineDefinitionError, match=named):
        BeamStations(**({"station": [0.0, 1.0], "stiffness": UNIT, "inertia": UNIT} | change))


@pytest.mark.parametrize(
    ("description", "rotating"),
    [
        (None, None),
        ("wind tunnel, clean", None),
        ("Re 1e7, no 3D correction", False),
        ("No rotational augmentation.", False),
        ("stall delay included, Viterna", True),
    ],
)
def test_descriptions_tell_whether_polars_hold_rotation(description, rotating, tmp_path):
    data = small_turbine()
    if description is not None:
        data["airfoils"][0]["polars"][0]["description"] = description
    assert load_turbine(save(data, tmp_path)).blade.rotating_polars is rotating
