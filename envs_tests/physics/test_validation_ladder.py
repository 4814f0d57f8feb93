"""The ladder of fidelities: records that do not fit are refused; the laws of its runs."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases import fidelities as reference_runs
from envs_tests.physics.cases.fidelities import (
    EXPERIMENTS,
    QUANTITIES,
    StaleRecordError,
    constant_gain,
    recorded,
    stamp,
)
from envs_tests.physics.cases.rotor_convergence import ANGLE, HOLD, RATE, SETTLE, ramps
from wt_gym.control.controllers.discon import BaselineController, nrel_5mw_parameters
from wt_gym.simulation.fidelity import fidelity


def test_a_record_of_other_options_is_refused_and_says_how_to_renew_it(tmp_path, monkeypatch):
    experiment, options = EXPERIMENTS["steady-gain-1.0"], fidelity("reference")
    row = ["steady-gain-1.0", "reference", stamp(experiment, options), *("1.5" for _ in QUANTITIES)]
    table = tmp_path / "reference_runs.csv"
    table.write_text(f"# comment\n{','.join(('experiment', 'fidelity', 'stamp', *QUANTITIES))}\n{','.join(row)}\n")
    monkeypatch.setattr(reference_runs, "TABLE", table)
    assert recorded("steady-gain-1.0") == dict.fromkeys(QUANTITIES, 1.5)
    with pytest.raises(StaleRecordError, match=r"steady-gain-0\.4 .* is missing; renew it: python -m .* steady-gain-0"):
        recorded("steady-gain-0.4")
    finer = replace(options, aero=replace(options.aero, n_span=options.aero.n_span + 1))
    monkeypatch.setitem(reference_runs.RECORDED, "reference", finer)
    with pytest.raises(StaleRecordError, match="another turbine, fidelity, wind or control; renew it"):
        recorded("steady-gain-1.0")


def test_stamps_know_wind_and_control_and_ignore_the_last_bits_of_numbers():
    options = fidelity("reference")
    stamps = {name: stamp(experiment, options) for name, experiment in EXPERIMENTS.items()}
    assert len(set(stamps.values())) == len(EXPERIMENTS)
    aero = options.aero
    nudged = replace(options, aero=replace(aero, squire=np.nextafter(aero.squire, 1.0)))
    assert stamp(EXPERIMENTS["steady-gain-0.4"], nudged) == stamps["steady-gain-0.4"]


@pytest.mark.parametrize("speed", [20.0, 90.0, 130.0, 300.0])
def test_the_law_of_the_gain_sweep_is_the_square_of_the_speed_everywhere(speed):
    controller = BaselineController(constant_gain(nrel_5mw_parameters(), 0.7))
    controller.start(speed, 0.0)
    pitch, torque = controller.step(speed, 0.2)
    assert torque == pytest.approx(min(0.7 * 2.332287 * speed**2, nrel_5mw_parameters().max_torque), rel=1e-9)
    assert np.all(pitch == 0.0)


def test_ramps_go_up_and_down_at_the_rate():
    top, back = SETTLE + ANGLE / RATE, SETTLE + 2.0 * ANGLE / RATE + HOLD
    times = [0.0, SETTLE, SETTLE + 0.5, top, top + HOLD, top + HOLD + 0.5, back, back + 5.0]
    expected = [0.0, 0.0, 0.5 * RATE, ANGLE, ANGLE, ANGLE - 0.5 * RATE, 0.0, 0.0]
    assert [ramps(time) for time in times] == pytest.approx(expected, abs=1e-12)
