"""Where tests find OpenFAST's library, and flights on it."""

import lzma
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from wt_gym.bridges.openfast import DRIVER_VARIABLE, VARIABLE
from wt_gym.control import Demand
from wt_gym.control.controllers import make_controller
from wt_gym.control.operating_point import starting_point

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "openfast" / "libopenfastlib.so.xz"
"""A packed library beside the checkout."""


@cache
def openfast_library():
    """Path of the library: that of the environment variable, or one beside the checkout; None without either.

    One beside the checkout that this machine cannot load, for want of what it links to, is none.
    """
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE])
    if not BESIDE.is_file():
        return None
    path = Path(mkdtemp(prefix="wt_gym_tests_")) / "libopenfastlib.so"
    path.write_bytes(lzma.decompress(BESIDE.read_bytes()))
    loading = [sys.executable, "-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", str(path)]
    return path if subprocess.run(loading, capture_output=True, check=False).returncode == 0 else None


@cache
def openfast_driver():
    """Path of the driver: that of the environment variable, or one beside the library; None without either."""
    if os.environ.get(DRIVER_VARIABLE):
        return Path(os.environ[DRIVER_VARIABLE])
    if os.environ.get(VARIABLE):
        path = Path(os.environ[VARIABLE]).with_name("openfast")
        return path if path.is_file() else None
    if openfast_library() is None or not BESIDE.with_name("openfast.xz").is_file():
        return None
    path = Path(mkdtemp(prefix="wt_gym_tests_")) / "openfast"
    path.write_bytes(lzma.decompress(BESIDE.with_name("openfast.xz").read_bytes()))
    path.chmod(0o755)
    return path


def flown(simulator, seconds):
    """Signals by name (n_steps,) under the turbine's own controller, from its operating point."""
    turbine, step = simulator.turbine, simulator.time_step
    point, controller = starting_point(turbine, simulator.inflow), make_controller("discon", turbine)
    signals = simulator.reset(point.rotor_speed, point.pitch, generator_torque=point.generator_torque)
    controller.start(signals, Demand(np.full(3, point.pitch), 0.0, point.generator_torque))
    rows = []
    for _ in range(round(seconds / step)):
        demand = controller.step(signals, step)
        signals = simulator.advance(step, demand.pitch, demand.yaw_rate, demand.generator_torque)
        rows.append(signals.values)
    return dict(zip(signals.keys(), np.transpose(rows), strict=True))
