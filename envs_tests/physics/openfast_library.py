"""Where tests find OpenFAST's library."""

import lzma
import os
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from wt_gym.bridges.openfast import VARIABLE

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "openfast" / "libopenfastlib.so.xz"
"""A packed library beside the checkout."""


@cache
def openfast_library():
    """Path of the library: that of the environment variable, or one beside the checkout; None without either."""
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE])
    if not BESIDE.is_file():
        return None
    path = Path(mkdtemp(prefix="wt_gym_tests_")) / "libopenfastlib.so"
    path.write_bytes(lzma.decompress(BESIDE.read_bytes()))
    return path
