"""Floating turbines in OpenFAST: the decay of a written platform, and waves and wind beside the simulator."""

from pathlib import Path

import numpy as np
import pytest
from openfast_library import flown, openfast_driver, openfast_library

from envs_tests.physics.cases.floating import peaks
from wt_gym.bridges.openfast import OpenFASTSimulator, run_driver, write_model
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.wind import SteadyInflow

SERIES = Path(__file__).resolve().parents[3] / "shared" / "floating" / "series" / "oc4_decay_pitch.csv"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(openfast_library() is None, reason="no library of OpenFAST")]
PERIOD, DURATION, LAST = 10.0, 100.0, 40.0
OMEGA = 2.0 * np.pi / PERIOD


def turning_points(time, values):
    """Times and values of the extremes (n, 2) of a motion about zero."""
    points = np.hstack([peaks(time, values), np.multiply([[1.0], [-1.0]], peaks(time, -values))])
    return points[:, np.argsort(points[0])].T


@pytest.mark.skipif(openfast_driver() is None or not SERIES.is_file(), reason="needs the driver and reference series")
def test_decay_of_pitch(tmp_path):
    """OC4 released at 8 degrees as the reference run was: on MAP++, tables at other frequencies, parked without air."""
    path = write_model(load_turbine("oc4_nrel_5mw"), tmp_path)
    primary, elastodyn = InputFile(path), InputFile(tmp_path / "elastodyn.dat")
    primary.set_all({"CompAero": 0, "CompInflow": 0, "CompServo": 0, "TMax": 150.0, "DT": 0.05})
    primary.write(path)
    rigid = ("TwFADOF2", "TwSSDOF2", "FlapDOF1", "FlapDOF2", "EdgeDOF", "GenDOF", "DrTrDOF", "YawDOF")
    blades = {f"BlPitch({blade})": 90.0 for blade in (1, 2, 3)}
    elastodyn.set_all({**dict.fromkeys(rigid, False), **blades, "RotSpeed": 0.0, "PtfmPitch": 8.0})
    elastodyn.set_outputs(["PtfmPitch"])
    elastodyn.write(elastodyn.path)
    lines = run_driver(path, openfast_driver()).read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.split()[:1] == ["Time"])
    table = np.array([line.split() for line in lines[head + 2 :]], dtype=float)
    found = turning_points(table[:, 0], table[:, lines[head].split().index("PtfmPitch")])[:9]
    reference = np.genfromtxt(SERIES, delimiter=",", names=True)
    wanted = turning_points(reference["time_s"], reference["pitch_deg"])[:9]
    np.testing.assert_allclose(np.diff(found[::2, 0]).mean(), np.diff(wanted[::2, 0]).mean(), rtol=0.02)
    np.testing.assert_allclose(abs(np.diff(found[:, 1])), abs(np.diff(wanted[:, 1])), rtol=0.05)


def response(signals):
    """Complex amplitudes of surge, heave and pitch at the wave's frequency (3,).

    OpenFAST starts at rest: the wave is fitted beside free heave and pitch of about 19 and 26 s, and slower transients.
    """
    last = signals["time"] > DURATION - LAST
    time = signals["time"][last]
    rest = np.stack([signals[f"platform_{name}"][last] for name in ("surge", "heave", "pitch")], axis=1)
    x = time - time.mean()
    free = [wave(2.0 * np.pi / period * x) for period in (19.0, 26.0) for wave in (np.cos, np.sin)]
    basis = np.column_stack([np.cos(OMEGA * time), np.sin(OMEGA * time), *free, *(x**k for k in range(4))])
    cosine, sine, *_ = np.linalg.lstsq(basis, rest, rcond=None)[0]
    return cosine - 1j * sine


@pytest.mark.parametrize(("name", "speed"), [("oc4_nrel_5mw", 12.0), ("volturnus_iea_15mw", 18.0)])
def test_a_regular_wave_moves_both_alike(name, speed):
    """A wave of 10 s and 1.5 m to the left of the wind: amplitudes within 5 %, phases within 5 degrees."""
    turbine = load_turbine(name)
    sea = WaveComponents(np.array([OMEGA]), np.array([1.5]), np.array([0.4]), np.array([0.3]), depth=200.0)
    wind = SteadyInflow(speed, turbine.hub_height)
    other = OpenFASTSimulator(turbine, wind, openfast_library=openfast_library(), sea=sea, duration=DURATION)
    found = flown(other, DURATION)
    other.close()
    wanted = flown(Simulator(turbine, wind, sea=sea), DURATION)
    np.testing.assert_allclose(found["wave_elevation"], sea.elevation(found["time"]), atol=1e-5)
    ratio = response(found) / response(wanted)
    np.testing.assert_allclose(abs(ratio), 1.0, atol=0.05)
    np.testing.assert_allclose(np.angle(ratio), 0.0, atol=np.radians(5.0))
    last = found["time"] > DURATION - LAST
    assert found["rotor_speed"][last].mean() == pytest.approx(wanted["rotor_speed"][last].mean(), rel=0.03)
    assert found["platform_pitch"][last].mean() == pytest.approx(
        wanted["platform_pitch"][last].mean(), abs=np.radians(0.5)
    )
