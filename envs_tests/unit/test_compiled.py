"""Separate kernels: called through a symbol, loaded before their callers, compiled anew when their sources change."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wt_gym.compiled import kernel

LEAF = """
from wt_gym.compiled import kernel

@kernel(separate=True)
def leaf(x, factor):
    total = 0.0
    for i in range(x.shape[0]):
        total += factor * x[i]
    return total
"""
CALLERS = """
from wt_gym.compiled import kernel
from leaf_module import leaf

@kernel
def between(x, factor):
    return leaf(x, factor) + leaf(x, factor + 1.0)

@kernel(separate=True)
def branch(x, factor):
    return between(x, factor) + leaf(x, factor)

@kernel
def root(x, factor):
    return branch(x, factor) - between(x, factor)
"""
RUN = """
import numpy as np, numba
from leaf_module import leaf
from caller_module import between, branch, root
print(root(np.arange(4.0), 3.0), *(len(k.stats.cache_hits) - len(k.stats.cache_misses) for k in (leaf, branch, root)))
"""
"""Prints the result, and for each kernel 1 where it came from the cache, -1 where it was compiled."""


@pytest.fixture
def modules(tmp_path):
    """A folder with kernels."""
    (tmp_path / "leaf_module.py").write_text(LEAF)
    (tmp_path / "caller_module.py").write_text(CALLERS)
    return tmp_path


def run(modules, code=RUN):
    """What the kernels in a folder give in a process of their own."""
    root = Path(__file__).parents[2]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(root), str(modules)))}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_the_cache_brings_separate_kernels_along_and_notices_their_changes(modules):
    assert run(modules) == [18.0, -1, -1, -1]
    assert run(modules) == [18.0, 1, 1, 1]
    for path in (modules / "__pycache__").glob("leaf_module.leaf*.nb*"):
        path.unlink()
    assert run(modules) == [18.0, -1, 1, 1]  # what calls it need not be compiled again
    (modules / "leaf_module.py").write_text(LEAF.replace("+= factor", "+= 2.0 * factor"))
    assert run(modules) == [36.0, -1, -1, -1]


def test_a_plain_function_links_a_separate_kernel_from_the_cache(modules):
    code = RUN + "plain = numba.njit(lambda x: branch(x, 3.0) + leaf(x, 3.0))\nprint(plain(np.arange(4.0)))"
    run(modules)
    assert run(modules, code)[-1] == 6.0 * (3.0 + 4.0 + 3.0 + 3.0)


def test_a_caller_has_no_code_of_its_separate_kernels(modules, monkeypatch):
    monkeypatch.syspath_prepend(modules)
    from caller_module import root
    from leaf_module import leaf

    root(np.arange(4.0), 3.0)
    (signature,) = root.signatures
    code = root.inspect_llvm(signature)
    (symbol,) = set(re.findall(r"leaf_module\.leaf\.[0-9a-f]+", code))
    assert re.search(rf"^declare .*@{re.escape(symbol)}\(", code, re.MULTILINE)
    (definition,) = re.findall(rf"^define (.*)@{re.escape(symbol)}\(", leaf.inspect_llvm(signature), re.MULTILINE)
    assert "internal" not in definition


def test_python_calls_a_separate_kernel_through_a_function_of_its_own(modules):
    (modules / "leaf_module.py").write_text(LEAF.replace("factor):", "factor=3.0):"))
    code = """
import numpy as np
from leaf_module import leaf
x = np.arange(4.0)
print(leaf(x, 3.0), leaf(x=x, factor=3.0), leaf(x))
leaf(x, 3.0)
print(*(len(k.stats.cache_hits) - len(k.stats.cache_misses) for k in (leaf, leaf.from_python)))
"""
    # with and without the number there are two ways in, and one kernel behind them
    assert run(modules, code) == [18.0, 18.0, 18.0, -1, -2]
    assert run(modules, code) == [18.0, 18.0, 18.0, 1, 2]


def test_a_separate_kernel_is_found_by_its_name():
    with pytest.raises(ValueError, match="top level of its module"):

        @kernel(separate=True)
        def hidden(x):
            return x
