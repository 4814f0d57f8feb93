"""The comparison with PteraSoftware: its reference, its command line, and its wing in wt_gym."""

import argparse
import math
import subprocess
import sys

import compare_pterasoftware as bench
import numpy as np
import pytest


def test_reference_tends_to_the_lifting_surface_value():
    coarse, fine = (bench.linear_lift_slope(n, 40.0)[1][-1] for n in (4, 8))
    assert math.radians(bench.ANGLE_DEG) * (2.0 * fine - coarse) == pytest.approx(bench.STEADY_LIFT, rel=2e-3)


def test_reference_of_a_long_wing_is_wagners_function(monkeypatch):
    """Strips of 500 chords each do not feel each other."""
    monkeypatch.setattr(bench, "ASPECT", 2000.0)
    monkeypatch.setattr(bench, "half_span_panels", lambda n: 2)
    (coarse_way, coarse), (way, fine) = (bench.linear_lift_slope(n, 5.0) for n in (8, 16))
    values = (2.0 * np.interp(coarse_way, way, fine) - coarse) / (2.0 * np.pi)
    for semi_chords, exact in ((2, 0.66929), (4, 0.75797), (10, 0.87504)):
        assert np.interp(0.5 * semi_chords, coarse_way, values) == pytest.approx(exact, rel=3e-3)


def test_wing_in_wt_gym_follows_linear_theory():
    way, reference = bench.reference_lift(5.0)
    for inset, tolerance in ((False, 0.035), (True, 0.01)):  # a lattice up to the tips is a quarter panel too long
        run = bench.run_wt_gym(4, 16, 21, inset)
        assert run["lift"][-1] == pytest.approx(np.interp(5.0, way, reference), rel=tolerance)
        assert run["wall_s"] > 0.0


@pytest.mark.parametrize("text", ["4x16", "4x16xmany", "0x16x40", "8x32x9"])
def test_refuses_cases_without_sense(text):
    with pytest.raises(argparse.ArgumentTypeError, match=text):
        bench.parse_case(text)


def test_tells_how_to_get_the_environment(tmp_path):
    command = [sys.executable, bench.__file__, "--environment", tmp_path / "none"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "--set-up" in done.stderr
    assert not (tmp_path / "none").exists()
