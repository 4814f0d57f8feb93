"""The example scripts in agents/ run as they are printed, with small settings."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from wt_gym.control.controllers import make_controller
from wt_gym.experiment.run import run_controller
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

AGENTS = Path(__file__).resolve().parents[2] / "agents"
SHORT = ("--winds", "1", "--duration", "15")


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run a script in an empty folder."""
    threads = torch.get_num_threads()
    monkeypatch.chdir(tmp_path)

    def call(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *words])
        return runpy.run_path(str(AGENTS / name), run_name="__main__")

    yield call
    torch.set_num_threads(threads)


def test_own_controller_holds_the_turbine_at_its_rated_point():
    turbine = load_turbine("nrel_5mw")
    controller = make_controller(f"{AGENTS / 'own_controller.py'}:IndividualPitch", turbine)
    run = run_controller(Simulator("nrel_5mw", inflow=SteadyInflow(16.0, shear_exponent=0.2)), controller, 60.0)
    last = run.to_dataset().isel(time=slice(-100, None))
    assert float(last.generator_power.mean()) == pytest.approx(5e6, rel=0.01)
    assert float(last.rotor_speed.mean()) == pytest.approx(1.267, rel=0.01)
    assert np.ptp(last.pitch_1.values) > np.radians(0.2)  # once a turn, against the shear


@pytest.mark.slow
def test_own_controller_is_compared(run, capsys):
    run("own_controller.py", *SHORT)
    shown = capsys.readouterr().out
    assert "16 m/s, individual Blade root flapwise DEL" in shown


@pytest.mark.slow
def test_a_model_of_stable_baselines3_is_trained_and_tested(run, capsys, tmp_path):
    run("train_sb3.py", "--steps", "640", "--turbines", "1")
    assert {file.name for file in (tmp_path / "runs" / "sb3").iterdir()} == {"model.zip", "model.json", "curve.png"}
    run("evaluate_sb3.py", *SHORT)
    assert "PPO            Mean power" in capsys.readouterr().out
    run("train_sb3.py", "--steps", "640", "--turbines", "1", "--seeds", "3", "4", "--out", str(tmp_path / "two"))
    assert {file.name for file in (tmp_path / "two").iterdir()} == {"seed-3", "seed-4", "curve.png"}


@pytest.mark.slow
def test_the_single_file_trains(run, tmp_path):
    run("train_single_file.py", "--steps", "640", "--turbines", "1")
    policy = torch.load(tmp_path / "runs" / "single_file" / "policy.pt")
    assert all(torch.isfinite(values).all() for values in policy.values())
    assert (tmp_path / "runs" / "single_file" / "curve.png").is_file()
