"""What the words for agents on a command line mean."""

import importlib.util

import pytest

from wt_gym.experiment.names import (
    BASELINE,
    COMPARED,
    GROUPS,
    available,
    fingerprint,
    named_choices,
    own_controller,
    read_name,
    with_model_options,
)


def test_controllers_come_with_parameters():
    name = read_name("controller:constrained_ipc:level=0.1,leak_time=None")
    assert (name.kind, name.target, name.parameters) == (
        "controller", "constrained_ipc", {"level": 0.1, "leak_time": None},
    )  # fmt: skip
    assert read_name("tsr_tracking:thrust_limit=0.95").kind == "controller"
    assert read_name("controller:anything").kind == "controller"  # said to be one: its maker refuses it by name
    with pytest.raises(ValueError, match="key=value, got 'limit'"):
        read_name("ipc:limit")
    with pytest.raises(ValueError, match="'limit' in 'ipc:limit=wide' must be a number"):
        read_name("ipc:limit=wide")


def test_names_follow_from_choices_or_stand_in_front(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    choices = ["baseline", "constrained_ipc:level=0.1", "soft=ipc:limit=0.05", "constant", str(folder)]
    assert named_choices(choices) == {
        BASELINE: "discon",
        "constrained_ipc:level=0.1": "constrained_ipc:level=0.1",
        "soft": "ipc:limit=0.05",
        "zero": "zero",
        "mine": str(folder),
    }
    with pytest.raises(ValueError, match="two agents are called 'ipc'"):
        named_choices(["ipc", "ipc=discon"])
    with pytest.raises(ValueError, match="two agents are called 'discon'"):
        named_choices(["Baseline PI", "controller:discon"])
    with pytest.raises(ValueError, match=r"an agent must be zero, random, planner, a controller .*got 'ipcc'"):
        named_choices(["ipcc"])


def test_a_training_with_several_seeds_is_an_agent_a_seed(tmp_path):
    (tmp_path / "seeds.json").write_text('{"seeds": [10, 2, 3], "config": {}}')
    for seed in (10, 2, 7):
        (tmp_path / f"seed-{seed}").mkdir()
        (tmp_path / f"seed-{seed}" / "model.zip").touch()
        (tmp_path / f"seed-{seed}" / "training.json").write_text('{"algorithm": "SAC"}')
    (tmp_path / "seed-3").mkdir()  # not trained yet; 7 was left there by an earlier training
    found = named_choices([str(tmp_path), f"mine={tmp_path}"])
    assert list(found) == [f"{tmp_path.name} seed 2", f"{tmp_path.name} seed 10", "mine seed 2", "mine seed 10"]
    assert found["mine seed 10"] == str(tmp_path / "seed-10")
    (tmp_path / "seeds.json").write_text('{"seeds": [3], "config": {}}')
    with pytest.raises(FileNotFoundError, match="none of its seeds"):
        named_choices([f"mine={tmp_path}"])
    (tmp_path / "seeds.json").write_text("{}")
    with pytest.raises(ValueError, match=r"seeds\.json is damaged"):
        named_choices([f"mine={tmp_path}"])


def test_models_are_called_by_their_folders(tmp_path, monkeypatch):
    for name in ("first", "second", "third"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "training.json").write_text('{"algorithm": "PPO"}')
        (tmp_path / name / "model.zip").write_bytes(b"")
    one, other, third = (str(tmp_path / name) for name in ("first", "second", "third"))
    assert named_choices(["ipc", one]) == {"ipc": "ipc", "first": one}
    assert named_choices([one, other, f"mine={third}"]) == {"first": one, "second": other, "mine": third}
    with pytest.raises(ValueError, match="two agents are called 'first'; give them names as NAME="):
        named_choices([one, f"{one}/model.zip"])
    (tmp_path / "loose.zip").touch()
    assert [*named_choices([f"{other}/model.zip", str(tmp_path / "loose.zip")])] == ["second", "loose"]
    monkeypatch.chdir(tmp_path / "third")
    assert [*named_choices([".", "../first"])] == ["third", "first"]


def test_a_choice_is_a_word_before_a_controller_before_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("random", "ipc", "mine"):
        (tmp_path / name).mkdir()
    choices = ["random", "ipc:limit=0.1", "mine", "./ipc", "./random"]
    found = [read_name(choice).kind for choice in choices]
    assert found == ["word", "controller", "trained", "trained", "trained"]
    with pytest.raises(ValueError, match="must be among algo, env, trust, got 'gain'"):
        read_name("./mine:gain=1")


def test_the_baseline_is_what_the_environment_runs_beneath():
    assert own_controller("wt_gym/LoadReduction-v3", {}) == "discon+side_side_damper+observer"
    assert own_controller("wt_gym/LoadReduction-v3", {"controller": "baseline+ipc:limit=0.1"}) == "discon+ipc:limit=0.1"
    assert own_controller("wt_gym/NREL5MW-Steady-v1", {"controller": "ipc"}) == "discon"  # nothing runs beneath rates
    assert named_choices(["baseline", "own=Baseline PI"], "discon+yaw") == {
        "discon+yaw": "discon+yaw",
        "own": "discon+yaw",
    }


def test_options_of_a_command_line_go_with_the_models(tmp_path):
    model = tmp_path / "sac.zip"
    model.touch()
    given = ["ipc", f"mine={model}", f"{model}:algo=TQC", "no agent"]
    assert with_model_options(given) == given
    assert with_model_options(given, "SAC", trust=True) == [
        "ipc", f"mine={model}:algo=SAC,trust=True", f"{model}:algo=TQC,trust=True", "no agent",
    ]  # fmt: skip
    assert fingerprint(f"{model}:algo=SAC")["algo"] == "SAC"


def test_a_class_is_known_by_its_file_and_its_parameters(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("class Mine:\n    pass\n")
    first = fingerprint(f"{file}:Mine:gain=1")
    assert (first["class"], first["parameters"]) == ("Mine", {"gain": 1})
    assert fingerprint(f"{file}:Mine:gain=2") != first
    assert named_choices([f"{file}:Mine:gain=1"]) == {"Mine:gain=1": f"{file}:Mine:gain=1"}
    file.write_text("class Mine:\n    gain = 2\n")
    assert fingerprint(f"{file}:Mine:gain=1")["sha256"] != first["sha256"]


def test_a_model_is_known_by_what_its_files_hold(tmp_path):
    model = tmp_path / "model.zip"
    model.write_bytes(b"one")
    first = fingerprint(str(tmp_path))
    assert fingerprint(str(tmp_path)) == first
    assert list(first["sha256"]) == ["model.zip"]
    (tmp_path / "vecnormalize.pkl").write_bytes(b"statistics")
    second = fingerprint(str(tmp_path))
    assert list(second["sha256"]) == ["model.zip", "vecnormalize.pkl"]
    model.write_bytes(b"two")
    assert fingerprint(str(tmp_path))["sha256"]["model.zip"] != second["sha256"]["model.zip"]
    assert fingerprint("ipc:limit=0.05") == {"choice": "ipc:limit=0.05"}


@pytest.mark.parametrize("there", [True, False])
def test_lists_of_controllers_have_rosco_where_it_is_installed(there, monkeypatch, caplog):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object() if there else None)
    for names in (COMPARED, GROUPS["baselines"]):
        caplog.clear()
        assert available(names) == tuple(name for name in names if there or name != "rosco")
        assert caplog.messages == ([] if there else ["rosco is left out: the package rosco is not installed "
                                                     "(pip install --no-deps rosco)"])  # fmt: skip
    assert available(["ipc"]) == ("ipc",)
