"""Where tests find OpenFAST's library."""

import lzma
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from wt_gym.bridges.openfast import DRIVER_VARIABLE, VARIABLE

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
