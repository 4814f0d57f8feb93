"""The decorator of every compiled kernel: common options, a cache that notices changes, and two ways to compile.

The *linked* way (`wt_gym.base.kernel_linking`) compiles a large kernel once and lets its callers call it through a
symbol. It needs parts of numba that are not public. The *plain* way is ``numba.njit`` alone, in which numba compiles
every kernel again within each of its callers. Both give the same numbers to rounding and run equally fast (the page on
performance has the figures). The linked way takes half the time to compile, and its last bits do not depend on what ran
before in the same process: numba leaves it to the linker which of several compiled versions of a function serves all.

The linked way is taken where a self-test of two small kernels passes; elsewhere, with one warning, the plain way. The
environment variable ``WT_GYM_COMPILE`` chooses: ``plain``, or ``linked``, which raises an error where the test fails.

numba checks a cached kernel only against the file in which it stands; a kernel compiled into the kernel of another
file would stay there in its old form. All kernels of the package therefore share one stamp: a hash of what stands in
all kernel files.

An index into an array must not be negative in a kernel: the linked way takes it for an unsigned number.
"""

import hashlib
import inspect
import io
import logging
import os
import pickle
import warnings
from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba

__all__ = [
    "COMPILE", "FASTMATH", "NoCacheError", "argument_types", "compiled_for", "is_compiled", "kernel", "was_compiled",
    "way_to_compile",
]  # fmt: skip

COMPILE = "WT_GYM_COMPILE"
"""Environment variable that chooses the way to compile."""
FASTMATH = {"contract", "arcp", "nsz", "reassoc"}
"""Never nnan or ninf: the checks for states that are not finite must keep their meaning."""
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": FASTMATH, "_nrt": False, "no_cfunc_wrapper": True}
"""Of ``numba.njit``, common to all kernels. No kernel is called through a pointer in C."""
_WAYS = ("linked", "plain")
_log = logging.getLogger(__name__)
_damaged: set[Path] = set()
_PACKAGE = Path(__file__).parents[1]


class NoCacheError(RuntimeError):
    """There is no place to keep compiled kernels."""


def kernel(
    function: Callable[..., Any] | None = None, separate: bool = False, distinct: bool = False, **options: Any
) -> Any:
    """Compile a function on plain arrays that stands at the top level of its module.

    Reference counting is off (arrays live in the caller), which trebles the speed of functions that pass many arrays;
    a kernel can therefore not allocate.

    Parameters
    ----------
    function : callable
    separate : bool
        In the linked way, compile it once for all its callers, which then call it: some nanoseconds and as many for
        each array among the arguments. For big kernels outside of inner loops. Others become part of each caller.
    distinct : bool
        Of a separate kernel: what it writes into one of the arrays among its arguments can be seen in no other. In the
        linked way the compiler then need not read everything again that has gone past a write. With arrays that do
        overlap the result is wrong without notice.
    **options
        Further options of ``numba.njit``. ``inline="always"`` suits a kernel with a single caller: it is then compiled
        once, not on its own and again within its caller.

    Raises
    ------
    ValueError
        If a kernel is defined within a function or class, is a generator or takes any number of arguments, or is to be
        distinct and not separate; if ``WT_GYM_COMPILE`` names no way.
    RuntimeError
        If compiled kernels cannot be kept or used, or the linked way was chosen and does not work.
    """
    if function is None:
        return lambda f: kernel(f, separate, distinct, **options)
    if distinct and not separate:
        raise ValueError(f"{function.__name__}: arrays are told apart in separate kernels only")
    _check(function)
    if way_to_compile() == "plain":
        return plain_kernel(function, options)
    from wt_gym.base.kernel_linking import linked_kernel

    return linked_kernel(function, separate, distinct, options)


def _check(function: Callable[..., Any]) -> None:
    """Whether a function can be a kernel."""
    name = function.__qualname__
    if name != function.__name__:
        raise ValueError(f"{name}: a kernel stands at the top level of its module")
    if inspect.isgeneratorfunction(function):
        raise ValueError(f"{name}: a kernel must be a function, got a generator")
    several = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.POSITIONAL_OR_KEYWORD]
    if several:
        raise ValueError(f"{name}: a kernel has no parameter such as {several[0]}")
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # set from its environment when it is imported
        raise RuntimeError("NUMBA_DISABLE_JIT is set, and the simulator does not run without compiled kernels")


@cache
def way_to_compile() -> str:
    """How the kernels of this process are compiled: ``"linked"`` or ``"plain"``.

    Raises
    ------
    ValueError
        If ``WT_GYM_COMPILE`` names no way.
    RuntimeError
        If it names the linked way and that does not work with this version of numba.
    """
    chosen = os.environ.get(COMPILE, "")
    if chosen not in ("", *_WAYS):
        raise ValueError(f"{COMPILE} must be one of {', '.join(_WAYS)}, got {chosen!r}")
    if chosen == "plain":
        return "plain"
    fault = _fault_of_linking()
    if fault is None:
        return "linked"
    told = f"numba {numba.__version__} does not link kernels as this package knows it ({fault})"
    if chosen:
        raise RuntimeError(f"{told}; {COMPILE}=plain compiles without")
    warnings.warn(
        f"{told}; they are compiled by plain njit, which takes about twice as long, once on this machine",
        RuntimeWarning, stacklevel=2,
    )  # fmt: skip
    return "plain"


def _fault_of_linking() -> str | None:
    """What goes wrong when two small kernels are compiled in the linked way, kept and run; None if nothing does."""
    try:
        from wt_gym.base.kernel_self_test import self_test

        return self_test()
    except NoCacheError:
        raise
    except Exception as error:  # whatever numba raises where its inside has moved; the warning or the error names it
        return f"{type(error).__name__}: {error}"


def plain_kernel(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compile a kernel by ``numba.njit`` alone."""
    compiled = numba.njit(**(OPTIONS | options))(function)
    try:
        compiled.enable_caching()
    except RuntimeError as error:
        raise no_cache_error(function) from error
    if not set_stamp(compiled, "plain"):
        return numba.njit(**(OPTIONS | options))(function)  # better compiled in every process than of old sources
    return compiled


def no_cache_error(function: Callable[..., Any]) -> NoCacheError:
    """There is no place for the machine code of this kernel."""
    return NoCacheError(
        f"there is no place to keep compiled kernels: neither the folder of {inspect.getfile(function)} nor a "
        "cache of the user can be written; set NUMBA_CACHE_DIR to a folder that can"
    )


def set_stamp(dispatcher: Any, way: str) -> bool:
    """Have the cache of a kernel notice any change of any kernel file; False where numba keeps its cache otherwise.

    The stamp takes the place of numba's version, because numba reads an old file no further: it may name types that
    have moved since. The contents of the kernel's own file take the place of its time and size.
    """
    file: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    needed = ("_version", "_source_stamp", "_load_index", "_load_data", "_dump", "_index_path", "_data_path")
    if not all(hasattr(file, name) for name in needed):
        _warn_of_cache()
        return False
    file._load_index = partial(_readable_index, file, file._load_index)
    file._load_data = partial(_readable_data, file)
    file._dump = partial(_with_checksum, file._dump)
    file._version = f"{numba.__version__} {llvmlite.__version__} {way} {_stamp()}"
    source = Path(inspect.getfile(dispatcher.py_func))
    if source.is_file():  # and is not typed into an interpreter
        file._source_stamp = _digest(source)
    return True


def _readable_index(file: Any, load: Callable[[], dict[Any, str]]) -> dict[Any, str]:
    """Compiled forms of a kernel on disk, by types of arguments; none where it is damaged or has unknown types.

    Types are kept by their names. A program may call a kernel with types of its own, which no other can read.
    """
    path = Path(file._index_path)
    try:
        content = io.BytesIO(path.read_bytes())
    except FileNotFoundError:
        return {}
    try:
        version = pickle.load(content)
    except (pickle.UnpicklingError, ArithmeticError, AttributeError, EOFError, ImportError, LookupError, TypeError,
            ValueError):  # fmt: skip
        version = None  # those that its documentation names of damaged content
    if type(version) is not str or (version == file._version and _checked(content.read()) is None):
        _tell_of_damage(path)
        return {}
    try:
        return load()
    except (AttributeError, ImportError):
        return {}


def _readable_data(file: Any, name: str) -> Any:
    """Machine code from a file; None, which has it compiled again, where it is damaged or has types that have moved."""
    path = Path(file._data_path(name))
    content = _checked(path.read_bytes())
    if content is None:
        _tell_of_damage(path)
        return None
    try:
        return pickle.loads(content)
    except (AttributeError, ImportError):
        return None


def _with_checksum(dump: Callable[[Any], bytes], value: Any) -> bytes:
    """Content of a file with its digest behind it: a loss of power leaves files short, or zeros in them."""
    content = dump(value)
    return content + hashlib.sha256(content).digest()


def _checked(content: bytes) -> bytes | None:
    """Content of a file without its digest; None where that is another one."""
    size = hashlib.sha256().digest_size
    return content[:-size] if hashlib.sha256(content[:-size]).digest() == content[-size:] else None


def _tell_of_damage(path: Path) -> None:
    """Once for each folder."""
    if path.parent not in _damaged:
        _damaged.add(path.parent)
        _log.warning("%s is damaged: such kernels are compiled again", path)


@cache
def _warn_of_cache() -> None:
    """Once."""
    warnings.warn(
        f"numba {numba.__version__} keeps compiled kernels as this package does not know it; every process compiles "
        "its own, which takes some minutes",
        RuntimeWarning, stacklevel=2,
    )  # fmt: skip


@cache
def _stamp() -> str:
    """Hash of the contents of all kernel files and of the files that say how kernels are compiled."""
    return digest_of(
        _PACKAGE, [Path(__file__), Path(__file__).with_name("kernel_linking.py"), *_PACKAGE.rglob("*_kernels.py")]
    )


def digest_of(folder: Path, files: list[Path]) -> str:
    """Hash of the contents of files by their places in a folder, whatever their times are."""
    total = hashlib.sha256()
    for file in sorted(set(files)):
        total.update(f"{file.relative_to(folder).as_posix()} {_digest(file)}\n".encode())
    return total.hexdigest()


@cache
def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def compiled_for(function: Any, arguments: Iterable[object]) -> Any:
    """Compiled form of a kernel for the types of these arguments, to be called with arguments of the same types only.

    A call of the kernel itself looks up the type of each array it is given: 25 µs for two hundred of them.
    """
    return _for_python(function).compile(argument_types(arguments))


def is_compiled(function: Any, arguments: Iterable[object]) -> bool:
    """Whether the compiled form of a kernel for the types of these arguments is in this process or in the cache."""
    function, types = _for_python(function), argument_types(arguments)
    if types in function.overloads:
        return True
    kept = _kept(function)
    return bool(kept) and function._cache._index_key(types, function.targetctx.codegen()) in kept


def was_compiled(function: Any) -> bool:
    """Whether a kernel is in this process or in the cache for any types of arguments."""
    return bool(function.overloads) or bool(_kept(function))


def _kept(function: Any) -> set[Any]:
    """Keys of the machine code of a kernel that is on disk; none where nothing is kept."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return set() if file is None else set(file._load_index())


def _for_python(function: Any) -> Any:
    """What Python calls: of a linked kernel a function that only passes on the call."""
    return getattr(function, "from_python", function)


def argument_types(arguments: Iterable[object]) -> tuple[Any, ...]:
    """Numba's types of some arguments, as a kernel is compiled for them."""
    return tuple(numba.typeof(argument) for argument in arguments)
