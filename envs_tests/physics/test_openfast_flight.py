"""Exported agents and controllers in OpenFAST: through ServoDyn, beside Python's behind the environment."""

import json
import subprocess
from pathlib import Path

import pytest
import torch
from openfast_library import openfast_driver, openfast_library

from wt_gym.analysis.metrics import run_metrics
from wt_gym.bridges.openfast import DRIVER_VARIABLE, VARIABLE, find_driver, read_outputs, run_driver
from wt_gym.commands import run as run_command
from wt_gym.deployment.export.openfast_flight import LOADS, export_openfast, fly, scene_of
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning.train import TrainingConfig, train
from wt_gym.turbines.openfast_text import InputFile

LIBRARY, DRIVER = openfast_library(), openfast_driver()
pytestmark = [
    pytest.mark.usefixtures("compiler"),
    pytest.mark.skipif(
        LIBRARY is None or DRIVER is None, reason=f"no library and driver of OpenFAST: {VARIABLE}, {DRIVER_VARIABLE}"
    ),
]
WIND = {"wind_speed": 15.0, "wind_seed": 1001}
BASE = "constrained_ipc+tower_dampers"


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    """Folder of an agent that was trained for a moment on what a turbine measures, and acts strongly."""
    folder = tmp_path_factory.mktemp("agent") / "run"
    config = TrainingConfig(
        env_kwargs={"observation": "measurable", "controller": BASE, "wind_speed": 15.0, "start": "steady",
                    "residual_form": "rate", "control_dt": 0.1, "sensor_washout": 20.0, "reward_credit": False},
        hyperparameters={"n_steps": 64, "batch_size": 64, "linear_policy": False}, total_steps=64, n_envs=1,
        eval_every=0, tensorboard=False,
    )  # fmt: skip
    train(config, folder, progress=False)
    trained = TrainedAgent.load(folder)
    with torch.no_grad():
        trained.model.policy.action_net.weight *= 20.0
    trained.model.save(folder / "model.zip")
    return folder


@pytest.mark.parametrize(("duration", "skip"), [(12.0, 2.0), pytest.param(300.0, 20.0, marks=pytest.mark.slow)])
def test_a_trained_agent_flies_alike_in_python_and_as_a_library(agent, duration, skip, tmp_path):
    scene = scene_of(str(agent), **WIND, duration=duration)
    flight = fly(str(agent), tmp_path, scene, duration=duration, skip=skip, driver=DRIVER, library=LIBRARY)
    assert flight.pitch < 1e-5
    assert flight.torque < 1e-5
    assert len(flight.metrics) == 4
    assert {load: abs(change) < 1e-3 for load, change in flight.changes.items()} == dict.fromkeys(LOADS, True)
    assert flight.agrees
    library, python = flight.metrics["OpenFAST, library"], flight.metrics["OpenFAST, Python"]
    assert library["pitch_travel"] == pytest.approx(python["pitch_travel"], rel=0.02)
    # and it flies: its base controller alone has other loads
    parameters = flight.primary.with_name("run.in")
    text = parameters.read_text(encoding="utf-8")
    assert "agent = 1.0" in text
    parameters.write_text(text.replace("agent = 1.0", "agent = 0.0"), encoding="utf-8")
    alone = run_metrics(read_outputs(run_driver(flight.primary, DRIVER), scene.turbine), scene.turbine, skip)
    assert alone["pitch_travel"] != pytest.approx(library["pitch_travel"], rel=0.1)


@pytest.mark.slow
def test_the_linear_optimum_of_a_floating_turbine_flies_alike_in_its_waves(tmp_path):
    scene = scene_of("linear_optimal", turbine="oc4_nrel_5mw", wind_speed=15.0, wind_seed=1001, duration=20.0)
    assert scene.sea.first_info()["significant_wave_height"] == pytest.approx(4.0, rel=0.05)
    flight = fly("linear_optimal", tmp_path, scene, duration=20.0, skip=2.0, driver=DRIVER, library=LIBRARY)
    assert InputFile(flight.primary.with_name("seastate.dat")).integer("WaveMod") == 7
    assert flight.agrees, flight.changes


def test_a_library_makes_the_power_that_servodyn_demands(tmp_path):
    """It begins with the torque of that power, as Python does."""
    choice, demanded = "discon+derate_kinetic", 4e6
    scene = scene_of(choice, env_kwargs={"power_reference": [[0.0, demanded]]}, **WIND, duration=8.0)
    flight = fly(choice, tmp_path, scene, duration=8.0, skip=1.0, driver=DRIVER, library=LIBRARY)
    assert flight.agrees, flight.changes
    for name in ("OpenFAST, library", "OpenFAST, Python", "wt_gym, library", "wt_gym, Python"):
        assert flight.metrics[name]["mean_power"] == pytest.approx(demanded, rel=2e-3), name


@pytest.mark.slow
def test_a_controller_reads_the_lidar_of_openfast(tmp_path):
    """It follows the wind ahead as Python does with the same points, and it is the lidar that moves it."""
    scene = scene_of("lidar", **WIND, duration=40.0)
    flight = fly("lidar", tmp_path, scene, duration=40.0, skip=20.0, driver=DRIVER, library=LIBRARY)
    assert flight.agrees, flight.changes
    assert flight.limit == 5e-3
    found = flight.metrics["OpenFAST, library"]["pitch_travel"]
    assert found == pytest.approx(flight.metrics["OpenFAST, Python"]["pitch_travel"], rel=0.01)
    file = InputFile(flight.primary.with_name("inflowwind.dat"))
    file.set("SensorType", 0)
    file.write(file.path)
    blind = run_metrics(read_outputs(run_driver(flight.primary, DRIVER), scene.turbine), scene.turbine, 20.0)
    assert blind["pitch_travel"] != pytest.approx(found, rel=0.03)


def test_a_controller_goes_on_from_a_checkpoint_of_openfast(tmp_path):
    scene = scene_of(BASE, **WIND, duration=4.0)
    primary = Path(export_openfast(BASE, tmp_path, scene, duration=4.0)["files"][0])
    file = InputFile(primary)
    file.set("ChkptTime", 2.0)
    file.write(primary)
    outputs = run_driver(primary, DRIVER)
    (found,) = tmp_path.glob("model.*.dll.chkp")
    whole = outputs.read_text(encoding="utf-8").splitlines()
    outputs.unlink()
    command = [str(DRIVER), "-restart", found.name.removesuffix(".dll.chkp")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "terminated normally" in done.stdout
    late = outputs.read_text(encoding="utf-8").splitlines()  # a restart writes rows alone
    assert [float(row.split()[0]) for row in (late[0], late[-1])] == [2.1, 4.0]
    assert late == whole[-20:]
    # without the controller's own part it does not
    found.write_bytes(b"nothing")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "terminated normally" not in done.stdout
    assert "could not be read" in " ".join((done.stdout + done.stderr).split())


def test_commands_fly_and_read(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv(DRIVER_VARIABLE, str(DRIVER))
    monkeypatch.setenv(VARIABLE, str(LIBRARY))
    assert find_driver() == DRIVER.resolve()
    words = ["--wind-speed", "15", "--wind-seeds", "1001", "--duration", "6", "--skip", "1", "--json"]
    run_command("fly", ["discon", "--out", str(tmp_path), *words])
    text = capsys.readouterr().out
    told = json.loads(text.splitlines()[-1])
    assert told["agrees"]
    assert not told["missing"]
    assert "OpenFAST, library against Python: loads within 0.0" in text
    outputs = str(tmp_path / "openfast" / "model.out")
    run_command("loads", [outputs, "--skip", "1", "--json"])
    lines = capsys.readouterr().out.splitlines()
    found = json.loads(lines[-1])[outputs]
    flown = told["metrics"]["OpenFAST, library"]
    assert found["rotor_speed_mean"] == pytest.approx(flown["rotor_speed_mean"], rel=2e-3)
    assert found["pitch_travel"] == pytest.approx(flown["pitch_travel"], rel=0.1)
    assert lines[0].split() == ["openfast"]
