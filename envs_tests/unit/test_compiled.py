"""Separate kernels: called through a symbol, loaded before their callers, compiled anew when their sources change."""

import ast
import os
import pickle
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from wt_gym.base.compiled import _digest, _readable_data, _stamp, _with_checksum, digest_of, kernel, way_to_compile
from wt_gym.multibody.tree.rotation_kernels import rotation_exp

ROOT = Path(__file__).parents[2]
LEAF = """
from wt_gym.base.compiled import kernel

@kernel(separate=True)
def leaf(x, factor):
    total = 0.0
    for i in range(x.shape[0]):
        total += factor * x[i]
    return total
"""
CALLERS = """
from wt_gym.base.compiled import kernel
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
print(root(np.arange(4.0), 3.0), *(
    len(k.stats.cache_hits) - len(k.stats.cache_misses) for k in (leaf, branch, root.from_python)
))
"""
"""Prints the result, and for each kernel 1 where it came from the cache, -1 where it was compiled."""

linked_only = pytest.mark.skipif(way_to_compile() == "plain", reason="what only the linked way does")


@pytest.fixture
def modules(tmp_path):
    """A folder with kernels."""
    (tmp_path / "leaf_module.py").write_text(LEAF)
    (tmp_path / "caller_module.py").write_text(CALLERS)
    return tmp_path


def run(modules, code=RUN):
    """What the kernels in a folder give in a process of their own."""
    done = process(code, [ROOT, modules])
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def process(code, folders, **more):
    """Run a program that finds its modules in these folders."""
    own = {"PYTHONPATH": os.pathsep.join(map(str, folders)), "NUMBA_CACHE_DIR": ""}  # kept beside the modules
    environment = os.environ | own | more
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, cwd=folders[0])


@linked_only
def test_the_cache_brings_separate_kernels_along_and_notices_their_changes(modules):
    assert run(modules) == [18.0, -1, -1, -1]
    assert run(modules) == [18.0, 1, 1, 1]
    for path in (modules / "__pycache__").glob("leaf_module.leaf*.nb*"):
        path.unlink()
    assert run(modules) == [18.0, -1, 1, 1]  # what calls it need not be compiled again
    changed_at_equal_size(modules / "leaf_module.py", "total += factor", "total -= factor")
    assert run(modules) == [-18.0, -1, -1, -1]


@linked_only
def test_a_caller_has_no_code_of_its_separate_kernels(modules, monkeypatch):
    monkeypatch.syspath_prepend(modules)
    from caller_module import root
    from leaf_module import leaf

    root(np.arange(4.0), 3.0)
    (signature,) = root.from_python.signatures
    code = root.from_python.inspect_llvm(signature)
    (symbol,) = set(re.findall(r"leaf_module\.leaf\.[0-9a-f]+", code))
    assert re.search(rf"^declare .*@{re.escape(symbol)}\(", code, re.MULTILINE)
    (definition,) = re.findall(rf"^define (.*)@{re.escape(symbol)}\(", leaf.inspect_llvm(signature), re.MULTILINE)
    assert "internal" not in definition


@linked_only
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


@linked_only
def test_an_inner_kernel_comes_from_the_cache_as_what_its_callers_link(modules):
    code = RUN + "print(between(np.arange(4.0), 3.0), len(between.stats.cache_hits), between.nopython_signatures)"
    run(modules)
    for path in (modules / "__pycache__").glob("caller_module.root*.nb*"):
        path.unlink()
    done = process(code, [ROOT, modules])
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first.split() == ["18.0", "1", "1", "-1"]  # the caller is compiled anew from what the cache has
    assert second.startswith("42.0 1 ")


def generator(n):
    yield n


def any_number(*values):
    return len(values)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (generator, "generator: a kernel must be a function, got a generator"),
        (any_number, r"has no parameter such as \*values"),
        ((lambda: lambda x: x)(), "a kernel stands at the top level of its module"),
    ],
)
def test_what_is_not_found_by_its_name_or_python_could_not_call_is_no_kernel(function, message):
    with pytest.raises(ValueError, match=message):
        kernel(function)


ODD = {
    "an address of this process": (
        "import ctypes, ctypes.util\ncos = ctypes.CDLL(ctypes.util.find_library('m')).cos\n"
        "cos.argtypes, cos.restype = [ctypes.c_double], ctypes.c_double\n"
        "@kernel\ndef inner(x):\n    return cos(x)\n@kernel\ndef top(x):\n    return inner(x)\n",
        "from leaf_module import top\nprint(top(0.0))", [1.0],
    ),
    "two kernels of one name": (
        "@kernel\ndef same(x):\n    return x + 1\nfirst = same\n@kernel\ndef same(x):\n    return x + 2\n",
        "from leaf_module import first, same\nprint(first(1), same(1))", [2.0, 3.0],
    ),
    "an inner kernel that prints": (
        "@kernel\ndef inner(x):\n    print(x)\n    return x\n@kernel\ndef between(x):\n    return inner(x) + 1.0\n"
        "@kernel\ndef top(x):\n    return between(x)\n",
        "from leaf_module import top\nprint(top(2.0))", [2.0, 3.0],
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", ODD)
def test_odd_kernels_give_the_same_whatever_is_in_the_cache(modules, case):
    source, code, expected = ODD[case]
    (modules / "leaf_module.py").write_text(f"from wt_gym.base.compiled import kernel\n{source}")
    for again in ("top", "between", "none"):
        assert run(modules, code) == expected
        assert "address" not in case or not list((modules / "__pycache__").glob("leaf_module.*.nbc"))
        for path in (modules / "__pycache__").glob(f"leaf_module.{again}*.nb*"):
            path.unlink()


@pytest.mark.slow
def test_the_callers_of_a_renamed_separate_kernel_are_compiled_anew(modules):
    (modules / "leaf_module.py").write_text(LEAF + "current = leaf\n")
    (modules / "caller_module.py").write_text(CALLERS.replace("import leaf", "import current as leaf"))
    code = "import numpy as np\nfrom caller_module import root\nprint(root(np.arange(4.0), 3.0))"
    assert run(modules, code) == [18.0]
    (modules / "leaf_module.py").write_text(LEAF.replace("def leaf", "def renamed") + "current = renamed\n")
    assert run(modules, code) == [18.0]


def test_other_code_is_compiled_as_ever(modules, monkeypatch):
    """In kernels an index is an unsigned number; numba does the same as before for all others in the process."""
    (modules / "index_module.py").write_text(
        "from wt_gym.base.compiled import kernel\n@kernel\ndef at(x, i):\n    return x[i]\n"
    )
    monkeypatch.syspath_prepend(modules)
    from index_module import at

    x = np.arange(4.0)
    assert at(x, 3) == 3.0
    plain = numba.njit(at.py_func)
    assert plain(x[1:], -1) == 3.0
    assert "icmp slt" in plain.inspect_llvm(plain.signatures[0])
    if way_to_compile() == "linked":
        assert "icmp slt" not in at.from_python.inspect_llvm(at.from_python.signatures[0])


def test_no_kernel_names_an_index_below_zero():
    for path in (ROOT / "wt_gym").rglob("*_kernels.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Subscript):
                for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
                    # numba takes the bounds of slices as Python does
                    assert not isinstance(index, ast.UnaryOp), f"{path.name}:{node.lineno}: {ast.unparse(node)}"


def test_a_pickled_kernel_is_that_of_the_other_process():
    assert pickle.loads(pickle.dumps(rotation_exp)) is rotation_exp


@pytest.fixture
def nowhere(tmp_path):
    """Environment of a process whose user has no cache: a file is in its way, which stops root too."""
    (tmp_path / "file").touch()
    taken = str(tmp_path / "file" / "folder")
    return {"HOME": taken, "XDG_CACHE_HOME": taken, "NUMBA_CACHE_DIR": ""}


def no_place(done):
    """File of the kernel for which a process found no place, as its last line names it."""
    said = r"wt_gym.base.compiled.NoCacheError: there is no place .* the folder of (\S+) nor .* NUMBA_CACHE_DIR to a .*"
    assert done.returncode == 1
    return re.fullmatch(said, done.stderr.splitlines()[-1])[1]


def test_kernels_without_a_place_to_be_kept_are_refused_with_the_way_out(modules, nowhere):
    (modules / "__pycache__").touch()
    code = "import numpy as np\nfrom leaf_module import leaf\nprint(leaf(np.ones(3), 2.0))"
    for cache in ("", nowhere["HOME"]):
        done = process(code, [ROOT, modules], **nowhere | {"NUMBA_CACHE_DIR": cache})
        assert no_place(done) == str(modules / "leaf_module.py")
    done = process(code, [ROOT, modules], **nowhere | {"NUMBA_CACHE_DIR": str(modules / "cache")})
    assert (done.stdout, done.stderr) == ("6.0\n", "")
    assert list((modules / "cache").rglob("leaf_module.leaf-*.nbc"))


def test_an_environment_without_a_place_for_its_kernels_says_so(tmp_path, nowhere):
    package = tmp_path / "installed" / "wt_gym"
    shutil.copytree(ROOT / "wt_gym", package, ignore=shutil.ignore_patterns("__pycache__", "agents"))
    for folder in (package, *(path for path in package.rglob("*") if path.is_dir())):
        (folder / "__pycache__").touch()
    code = "import gymnasium, wt_gym\ngymnasium.make('wt_gym/NREL5MW-Steady-v1')"
    done = process(code, [package.parent], **nowhere)
    assert Path(no_place(done)).is_relative_to(package)


def test_numba_has_a_lower_bound_only():
    """The self-test, not a bound, tells whether a newer version will do."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (allowed,) = (one.specifier for one in map(Requirement, project["dependencies"]) if one.name == "numba")
    (tested,) = re.findall(r"^numba==(\S+)$", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE)
    assert Version(tested) in allowed
    assert {one.operator for one in allowed} == {">="}


def changed_at_equal_size(path, old, new):
    """Change a file as an editor or git cannot, and a restored back-up can: its size and time stay."""
    text, stat = path.read_text(), path.stat()
    assert len(old) == len(new)
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


@pytest.mark.parametrize("way", ["linked", "plain"])
def test_a_type_that_another_program_called_a_kernel_with_is_no_obstacle(modules, way):
    """Its kernels are compiled again where its module is missing."""
    pair = "from typing import NamedTuple\nimport numpy as np\nclass Pair(NamedTuple):\n    x: object\n    y: object\n"
    (modules / "pair_module.py").write_text(pair)
    (modules / "sum_module.py").write_text(
        "from wt_gym.base.compiled import kernel\n@kernel\ndef total(pair):\n    return pair[0] + pair[1]\n"
    )
    own = "from pair_module import Pair\nfrom sum_module import total\nprint(total(Pair(1.0, 2.0)))"
    other = "from sum_module import total\nprint(total((1.0, 2.0)))"
    for code in (own, other):
        done = process(code, [ROOT, modules], WT_GYM_COMPILE=way)
        assert done.stdout.split() == ["3.0"], done.stderr
        (modules / "pair_module.py").unlink(missing_ok=True)


def halved(content):
    return content[: len(content) // 2]


def zeroed(content):
    return content[:100] + bytes(len(content) - 200) + content[-100:]


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [
    halved, pytest.param(zeroed, marks=pytest.mark.slow), pytest.param(lambda content: b"", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_damaged_cache_file_is_compiled_again_with_one_line(modules, ending, damage):
    """As a loss of power leaves it."""
    first = run(modules)
    files = [path for path in modules.rglob(f"*.{ending}") if path.name.startswith(("leaf", "caller"))]
    assert len(files) >= 2
    for path in files:
        path.write_bytes(damage(path.read_bytes()))
    done = process(RUN, [ROOT, modules])
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[0]) == first[0]
    assert done.stderr.count("\n") == 1
    assert re.search(rf"\.{ending} is damaged: such kernels are compiled again", done.stderr)
    again = process(RUN, [ROOT, modules])
    assert (float(again.stdout.split()[0]), again.stderr) == (first[0], "")


def test_code_with_types_that_have_moved_is_compiled_again(tmp_path):
    file = SimpleNamespace(_data_path=tmp_path.joinpath)
    (tmp_path / "moved.nbc").write_bytes(_with_checksum(bytes, b"cno_such_module\nArrays\n."))
    assert _readable_data(file, "moved.nbc") is None


def test_every_kernel_notices_a_change_of_any_kernel_file(tmp_path):
    """The code of one is within that of others."""
    files = [tmp_path / "one_kernels.py", tmp_path / "room" / "other_kernels.py"]
    files[1].parent.mkdir()
    for file in files:
        file.write_text("x = 1\n")
    before = digest_of(tmp_path, files)
    _digest.cache_clear()
    assert digest_of(tmp_path, files[::-1]) == before
    changed_at_equal_size(files[1], "1", "2")
    _digest.cache_clear()
    assert digest_of(tmp_path, files) != before


@pytest.mark.parametrize("changed", ["step_kernels.py", "compiled.py", "kernel_linking.py"])
def test_the_stamp_covers_kernels_and_how_they_are_compiled(changed, monkeypatch):
    seen = []
    monkeypatch.setattr("wt_gym.base.compiled.digest_of", lambda folder, files: seen.extend(files))
    _stamp.__wrapped__()
    assert changed in {file.name for file in seen}


WAY = "from wt_gym.base.compiled import way_to_compile\nprint(way_to_compile())"


@pytest.fixture
def plain_way(tmp_path):
    """A cache of its own: the folders of the package keep what the other way has compiled."""
    return {"WT_GYM_COMPILE": "plain", "NUMBA_CACHE_DIR": str(tmp_path / "plain")}


@pytest.mark.slow
def test_the_plain_way_gives_the_same_and_is_kept(modules, plain_way):
    code = (
        "import numpy as np, pickle, numba\n"
        "from leaf_module import leaf\nfrom caller_module import root\n"
        "from wt_gym.base.compiled import compiled_for, is_compiled, was_compiled\n"
        "x = np.arange(4.0)\n"
        "before = was_compiled(root), is_compiled(root, (x, 3.0))\n"
        "print(root(x, 3.0), compiled_for(leaf, (x, 3.0))(x, 3.0), *map(int, before),\n"
        "      int(type(root) is type(numba.njit(lambda: 0))), len(root.stats.cache_hits))"
    )
    results = []
    for _ in range(2):
        done = process(code, [ROOT, modules], **plain_way)
        assert (done.returncode, done.stderr) == (0, "")
        results.append([float(word) for word in done.stdout.split()])
    assert results == [[18.0, 18.0, 0, 0, 1, 0], [18.0, 18.0, 1, 1, 1, 1]]
    changed_at_equal_size(modules / "leaf_module.py", "total += factor", "total -= factor")
    done = process(
        "import numpy as np\nfrom leaf_module import leaf\nprint(leaf(np.arange(4.0), 3.0))",
        [ROOT, modules],
        **plain_way,
    )
    assert float(done.stdout) == -18.0


MOVED = {
    "a name is gone": "import numba.core.codegen as c; del c.JITCodeLibrary",
    "a method takes other arguments": "import numba.core.typed_passes as t; t.AnnotateTypes = lambda: None",
    "a pass is another": "import numba.core.typed_passes as t; t.PreLowerStripPhis = type('Other', (), {})",
    "a result is wrong": "import numpy as n; import wt_gym.base.kernel_self_test as t\n"
    "t.np = type('', (), {'arange': lambda k: n.arange(k) + 1, 'zeros': n.zeros})",
    "nothing is kept": "import numba.core.caching as c; c.IndexDataCacheFile.save = lambda *given: None",
}


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(code, id=name, marks=pytest.mark.slow if name == "a pass is another" else ())
        for name, code in MOVED.items()
    ],
)
def test_where_the_inside_of_numba_has_moved_plain_njit_takes_over(modules, tmp_path, change):
    code = f"{change}\nimport numpy as np\nfrom caller_module import root\n{WAY}\nprint(root(np.arange(4.0), 3.0))"
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "WT_GYM_COMPILE": ""}
    done = process(code, [ROOT, modules], **cache)
    assert done.stdout.split() == ["plain", "18.0"], done.stderr
    assert done.stderr.count("Warning: numba ") == 1
    assert "does not link kernels as this package knows it" in done.stderr


def test_the_linked_way_is_refused_where_the_inside_of_numba_has_moved_and_an_unknown_way_always(modules, tmp_path):
    code = f"{MOVED['a name is gone']}\nimport caller_module"
    for way, message in (
        ("linked", "WT_GYM_COMPILE=plain compiles without"),
        ("fast", "ValueError: WT_GYM_COMPILE must be one of linked, plain, got 'fast'"),
    ):
        done = process(code, [ROOT, modules], NUMBA_CACHE_DIR=str(tmp_path / "cache"), WT_GYM_COMPILE=way)
        assert done.returncode == 1
        assert done.stderr.splitlines()[-1].endswith(message)


def test_a_cache_that_numba_keeps_otherwise_is_not_used(modules, plain_way):
    code = (
        "import numba.core.caching as c\n"
        "class Other(c.IndexDataCacheFile):\n"
        "    def __init__(self, **given):\n        super().__init__(**given); self.__dict__.pop('_version')\n"
        "c.IndexDataCacheFile = Other\n"
        "import numpy as np\nfrom leaf_module import leaf\nfrom wt_gym.base.compiled import was_compiled\n"
        "print(was_compiled(leaf), leaf(np.arange(4.0), 3.0))"
    )
    done = process(code, [ROOT, modules], **plain_way)
    assert done.stdout.split() == ["False", "18.0"], done.stderr
    assert done.stderr.count("every process compiles its own") == 1
