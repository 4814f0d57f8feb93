"""Records of the catalog: a new turbine is one file."""

import json
import shutil

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.control.controllers.own import FOUND
from wt_gym.control.rotor import RotorTable, _stored
from wt_gym.turbine_records import FOLDER, RECORDS, read_records
from wt_gym.turbines import catalog, load_turbine
from wt_gym.turbines.catalog import turbine_file

SOURCE = {"windio_example": "IEA-15-240-RWT.yaml"}


def write(folder, name="new", **content):
    (folder / f"{name}.json").write_text(json.dumps(content))


def test_a_new_turbine_is_one_file(tmp_path, monkeypatch):
    table = RECORDS["iea_15mw"].rotor_table
    write(
        tmp_path, "my_turbine", source={"turbine": "iea_15mw", "water_depth": 25.0}, label="Mine",
        version=3, arguments={"wind_speed": [8.0, 12.0]}, region_2_gain_factor=0.9,
        rotor_table=table | {"turbine": "mine"},
    )  # fmt: skip
    (record,) = read_records(tmp_path).values()
    monkeypatch.setitem(RECORDS, record.name, record)
    assert "my_turbine" in catalog()
    turbine = load_turbine("my_turbine")
    assert turbine is load_turbine("my_turbine")
    assert turbine.tower.support.base_height == -25.0
    expected = {"turbine": "my_turbine", "wind_speed": (8.0, 12.0)}
    assert record.ids == (
        ("wt_gym/Mine-Steady-v3", {**expected, "inflow": "steady"}),
        ("wt_gym/Mine-Turbulent-v3", {**expected, "inflow": "turbulent"}),
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "source"),
        ({"source": {}}, "source must have one of file, windio_example, function and turbine"),
        ({"source": {"file": "a.yaml", "function": "a:b"}}, "source must have one of"),
        ({"source": SOURCE, "color": 1}, "unexpected keyword argument 'color'"),
        ({"source": SOURCE, "label": "New"}, "label and version must both be given"),
        ({"source": SOURCE, "version": 1}, "label and version must both be given"),
    ],
)
def test_records_that_are_none_name_their_file(tmp_path, content, message):
    write(tmp_path, **content)
    with pytest.raises(ValueError, match=rf"new\.json.*{message}"):
        read_records(tmp_path)


def test_every_id_of_a_turbine_stands_in_its_record():
    ids = {name for record in RECORDS.values() for name, _ in record.ids}
    own = [name for name in gym.registry if name.startswith("wt_gym/")]
    assert ids == {name for name in own if "-Steady-" in name or "-Turbulent-" in name}
    assert gym.spec("wt_gym/NadaSmall-Steady-v1").kwargs == {
        "turbine": "nada_small", "inflow": "steady", "wind_speed": (6.0, 10.0), "control_dt": 0.02,
        "episode_length": 4.0, "env_id": "wt_gym/NadaSmall-Steady-v1",
    }  # fmt: skip


def test_gains_and_tables_come_from_the_records():
    assert FOUND == {"nrel_5mw": 0.74}
    for name, record in RECORDS.items():
        stored = _stored(load_turbine(name))
        if record.rotor_table is not None:
            same = record.rotor_table.get("same_as", name)
            assert stored.to_json() == RECORDS[same].rotor_table
    assert _stored(load_turbine("iea_15mw_monopile")) is not None  # its rotor is that of the turbine on land
    assert _stored(load_turbine("iea_22mw")) is None


def test_a_measured_table_goes_into_the_record(tmp_path):
    path = tmp_path / "iea_15mw.json"
    shutil.copy(FOLDER / "iea_15mw.json", path)
    before = path.read_text()
    table = RotorTable.from_json(RECORDS["iea_15mw"].rotor_table)
    table.put_into(path)
    assert path.read_text() == before
    RotorTable(**{**table.__dict__, "power": table.power + 0.01}).put_into(path)
    changed = read_records(tmp_path)["iea_15mw"]
    assert np.allclose(changed.rotor_table["power"], table.power + 0.01, atol=1e-5)
    assert changed.source == SOURCE


def test_a_turbine_without_a_file_says_which_have_one():
    with pytest.raises(ValueError, match="with a file are 'iea_15mw', 'iea_22mw', 'nrel_5mw'"):
        turbine_file("iea_15mw_monopile")
