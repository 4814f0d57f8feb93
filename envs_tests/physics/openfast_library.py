"""Where tests find OpenFAST's library."""

import lzma
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from wt_gym.bridges.openfast import VARIABLE

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
