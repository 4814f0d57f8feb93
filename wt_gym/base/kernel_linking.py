"""The linked way to compile kernels: large ones once, called through a symbol; one version of every kernel.

numba leaves it to the linker which version of a function runs: the code of a function brings along the functions that
it calls as weak symbols, and of several versions, each optimized with its caller and rounding differently, the one that
was loaded first serves all. What a step computes would then depend in the last bits on what ran before it in the same
process. Here every kernel keeps the versions that it was compiled with.

So each kernel would be optimized again within every kernel above it. A kernel marked as ``separate`` is not: its
callers call its one machine code through a symbol, which names the kernel, its argument types and the sources that it
was compiled from. A caller that comes from the cache has its separate kernels loaded, or compiled, first.

Every other kernel is an inner one: its code is simplified, linked into its callers and optimized there. It has no
machine code of its own.

An index does not count from the end where it is negative. numba has every index compared with zero, where the compiler
does not know its sign; here the indices that a kernel itself reads and writes by are taken for unsigned.

What unpacks hundreds of arrays from Python's objects takes as long to compile as a kernel itself. Kernels therefore
have no such way in of their own; where Python calls one, a function that only passes on the call is compiled.

All of this stands on parts of numba that are not public. `wt_gym.base.compiled` tests them before it comes here, and
nothing here changes what numba does with the code of others.
"""

import hashlib
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Self, cast
from weakref import WeakKeyDictionary

import numba
from llvmlite.binding import Linkage, parse_bitcode
from numba.core import ir, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import FunctionPass, LoweringPass, register_pass
from numba.core.funcdesc import PythonFunctionDescriptor
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes, PreLowerStripPhis

from wt_gym.base.compiled import OPTIONS, no_cache_error, set_stamp

__all__ = ["linked_kernel"]


class _Changed(Exception):
    """A separate kernel is no longer what its caller was compiled for."""


@dataclass(frozen=True)
class _Separate:
    """A separate kernel for certain argument types; called, it sees to it that the machine code is in the process.

    numba keeps such calls with the machine code of a caller and makes them before it loads it (``reload_init``).
    """

    module: str
    name: str
    arguments: tuple[Any, ...]
    symbol: str

    def __call__(self) -> None:
        try:
            kernel = _named(self.module, self.name)
        except (AttributeError, ModuleNotFoundError) as error:
            raise _Changed(f"there is no {self.module}.{self.name} any more") from error
        kernel.compile(self.arguments)
        if _separate(kernel.py_func, self.arguments) != self:
            raise _Changed(f"{self.module}.{self.name} has changed since its callers were compiled")


def _named(module: str, name: str) -> Any:
    """The kernel that goes by this name now."""
    return getattr(import_module(module), name)


_SEPARATE: WeakKeyDictionary[Any, tuple[_Separate, str]] = WeakKeyDictionary()
"""The `_Separate` and the name in LLVM's code of each library of a separate kernel."""


def _separate(function: Any, arguments: Iterable[Any]) -> _Separate:
    """What stands for a separate kernel in the cache of its callers; numba's own names differ between processes."""
    module, name = function.__module__, function.__name__
    cache_file = _named(module, name)._cache._cache_file
    sources = f"{cache_file._version} {cache_file._source_stamp} {arguments}"
    return _Separate(module, name, tuple(arguments), f"{module}.{name}.{hashlib.sha256(sources.encode()).hexdigest()}")


@register_pass(mutates_CFG=False, analysis_only=False)
class _UnsignedIndices(FunctionPass):
    """Take integer indices into arrays for unsigned ones, which numba does not compare with zero."""

    _name = "unsigned_indices"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Change the types of the calls that read and write elements."""
        changed = False
        for use, signature in list(state.calltypes.items()):
            by_index = isinstance(use, ir.SetItem) or (isinstance(use, ir.Expr) and use.op == "getitem")
            if by_index and isinstance(signature.args[0], types.Array):
                array, index, *value = signature.args
                del state.calltypes[use]
                state.calltypes[use] = signature.replace(args=(array, _unsigned(index), *value))
                changed = True
        return changed


def _unsigned(index: Any) -> Any:
    """The unsigned type for that of an index."""
    if isinstance(index, types.BaseTuple):
        return types.BaseTuple.from_types([_unsigned(one) for one in cast("Iterable[Any]", index)])
    whole: bool = isinstance(index, types.Integer) and not isinstance(index, types.Literal)
    return types.uintp if whole and index.signed else index


class _SelfContained(JITCodeLibrary):
    """Machine code whose own versions of the kernels that it calls no other code can replace."""

    _codegen: Any
    _name_and_symbol: tuple[str, str] | None = None  # of a separate kernel

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave them as they are: numba would simplify here what is simplified again after linking."""
        ll_module.data_layout = self._codegen._data_layout

    def __init__(self, codegen: Any, name: str):
        super().__init__(codegen, name)
        self._called: dict[str, str] = {}  # separate kernels: their names in LLVM's code, and symbols
        self._environments: dict[str, Any] = {}  # of inner kernels: what prints, for example, needs Python's objects

    def add_linking_library(self, library: Any) -> None:
        """Link the code of what is called; of a separate kernel only remember what its callers call it."""
        if library in _SEPARATE:
            separate, name = _SEPARATE[library]
            self._called[name] = separate.symbol
            self._reload_init.add(separate)
        else:
            super().add_linking_library(library)
            self._environments |= getattr(library, "_environments", {})

    def finalize(self) -> None:
        """Optimize and load the code, in which separate kernels now go by their symbols."""
        for function in list(self._final_module.functions):  # before others with the same symbols are linked
            if function.name in self._called:
                function.name = self._called[function.name]
        super().finalize()

    def _finalize_final_module(self) -> None:
        self._finalized = True
        self._get_module_for_linking()  # a copy with weak symbols, from which callers of this kernel are compiled
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = "internal"
        if self._name_and_symbol:
            name, symbol = self._name_and_symbol
            self._final_module.get_function(name).name = symbol
        super()._finalize_final_module()
        loaded = {variable.name for variable in self._final_module.global_variables if not variable.is_declaration}
        for name in loaded & self._environments.keys():
            self._codegen.set_env(name, self._environments[name])


class _Inner(_SelfContained):
    """Code that is only linked into its callers: no machine code is made of it."""

    def _optimize_final_module(self) -> None:
        """Simplify only, which makes less work for each caller; there it is optimized with what surrounds it."""
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False, slp_vectorize=False, opt=1)
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalized = True  # and nothing is loaded
        self._finalize_dynamic_globals()  # code with addresses of this process is not kept

    def get_pointer_to_function(self, name: str) -> int:
        """None, as for a function that is not there; numba asks when the code is complete."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "_Environments":
        """What numba asks to give loaded code its environment, which here goes to the callers."""
        return _Environments(self._environments)

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """For the cache: what callers link."""
        return self.name, "inner", self._final_module.as_bitcode()

    @classmethod
    def load(cls, codegen: Any, name: str, bitcode: bytes) -> Self:
        """From the cache."""
        library = cls(codegen, name)
        library._final_module = parse_bitcode(bitcode)
        library._finalize_final_module()
        return library


@dataclass(frozen=True)
class _Environments:
    """A place for the environments of code that is never loaded."""

    of_code: dict[str, Any]

    def set_env(self, name: str, environment: Any) -> None:
        """Keep it for the callers."""
        self.of_code[name] = environment


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseSelfContained(LoweringPass):
    """Have the machine code written into a `_SelfContained` library; numba would make a plain one."""

    _name = "use_self_contained_library"
    _library: type[_SelfContained] = _SelfContained

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Make the library."""
        state.library = self._library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseInner(_UseSelfContained):
    """The same for kernels that are only linked into others."""

    _name = "use_inner_library"
    _library = _Inner


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseSeparate(_UseSelfContained):
    """The same for a separate kernel."""

    _name = "use_separate_library"

    def run_pass(self, state: Any) -> bool:
        """Make the library, with the name that callers will know."""
        super().run_pass(state)
        function = PythonFunctionDescriptor.from_specialized_function(
            state.func_ir, state.typemap, state.return_type, state.calltypes, mangler=state.targetctx.mangler,
            inline=state.flags.forceinline, noalias=state.flags.noalias, abi_tags=[state.flags.get_mangle_string()],
        )  # fmt: skip
        separate = _separate(state.func_id.func, state.args)
        state.library._name_and_symbol = function.llvm_func_name, separate.symbol
        _SEPARATE[state.library] = separate, function.llvm_func_name
        return True


class _Flags(Flags):
    """Options of a compilation that are told apart by those that were given.

    numba looks up a hundred thousand things by them, and collects those that were not given each time.
    """

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Flags) and self._values == other._values


class _KernelCompiler(CompilerBase):
    """The stages of numba's compiler with self-contained machine code."""

    _library_pass: type[_UseSelfContained] = _UseSelfContained

    def __init__(
        self, typing: Any, target: Any, library: Any, arguments: Any, result: Any, flags: Any, types_of_variables: Any
    ):
        super().__init__(typing, target, library, arguments, result, _Flags(flags), types_of_variables)

    def define_pipelines(self) -> list[Any]:
        """One pipeline, without Python objects."""
        stages = DefaultPassBuilder.define_nopython_pipeline(self.state)
        stages.add_pass_after(_UnsignedIndices, PreLowerStripPhis)  # before the code of others is inlined
        stages.add_pass_after(self._library_pass, AnnotateTypes)
        stages.finalize()
        return [stages]


class _InnerCompiler(_KernelCompiler):
    """The same for kernels that are only linked into others."""

    _library_pass = _UseInner


class _SeparateCompiler(_KernelCompiler):
    """The same for separate kernels."""

    _library_pass = _UseSeparate


class _DistinctCompiler(_SeparateCompiler):
    """The same for those whose arguments share no memory."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self.state.flags.noalias = True


class _KernelCacheImpl(CompileResultCacheImpl):
    """What of a compiled kernel goes to disk and comes back."""

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """The result of a compilation, with or without machine code."""
        (name, kind, code), described, environment, signature, object_mode, lifted, types, reload_init, others = payload
        if kind != "inner":
            return super().rebuild(target_context, payload)
        for load in reload_init:
            load()
        library = _Inner.load(target_context.codegen(), name, code)
        for called in others:
            library.codegen.set_env(called.env_name, called)
        return CompileResult(  # type: ignore[call-arg]  # a named tuple of names that numba computes
            target_context=target_context, typing_context=target_context.typing_context, library=library,
            environment=environment, entry_point=target_context.get_executable(library, described, environment),
            fndesc=described, type_annotation=types, signature=signature, objectmode=object_mode, lifted=lifted,
            typing_error=None, call_helper=None, metadata=None, reload_init=reload_init, referenced_envs=others,
        )  # fmt: skip


class _KernelCache(FunctionCache):
    """Machine code on disk, which comes with the separate kernels that it calls."""

    _impl_class = _KernelCacheImpl
    separate = False

    def kept(self) -> set[Any]:
        """Keys of the code that is there."""
        return set(self._cache_file._load_index())

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            result = super()._load_overload(sig, target_context)
        except _Changed:  # the caller is then compiled again
            return None
        if result is not None:
            result.library._reload_init.update(result.reload_init)  # numba gives them to callers compiled later
            if self.separate:
                _SEPARATE[result.library] = (
                    _separate(self._py_func, result.signature.args),
                    result.fndesc.llvm_func_name,
                )
        return result


class _KernelDispatcher(CPUDispatcher):
    """A kernel, which other kernels call and Python through a function of its own."""

    _given: dict[str, Any]  # options

    @cached_property
    def from_python(self) -> Any:
        """The kernel with a way in from Python, compiled on demand."""
        function = self.py_func
        name, arguments = f"{function.__name__}_from_python", ", ".join(inspect.signature(function).parameters)
        # numba's cache takes functions that stand in a file under a name, and no closures; it tells them by their lines
        source = "\n" * (function.__code__.co_firstlineno - 1)
        source += f"def {name}({arguments}):\n    return _kernel({arguments})\n"
        namespace: dict[str, Any] = {"_kernel": self, "__name__": function.__module__}
        exec(compile(source, inspect.getfile(function), "exec"), namespace)
        namespace[name].__defaults__ = function.__defaults__
        return _dispatcher(namespace[name], _KernelCompiler, self._given)

    def __reduce__(self) -> tuple[Any, ...]:
        return _named, (self.py_func.__module__, self.py_func.__name__)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call from Python."""
        return self.from_python(*arguments, **named)


def linked_kernel(function: Callable[..., Any], separate: bool, distinct: bool, options: dict[str, Any]) -> Any:
    """Compile a kernel in the linked way; the parameters are those of `wt_gym.base.compiled.kernel`."""
    compiler: type[_KernelCompiler] = _InnerCompiler
    if separate:
        compiler = _DistinctCompiler if distinct else _SeparateCompiler
    dispatcher = _dispatcher(function, compiler, options | {"no_cpython_wrapper": True})
    dispatcher.__class__ = _KernelDispatcher  # which numba cannot be asked for
    dispatcher._given = options
    dispatcher._cache.separate = separate
    return dispatcher


def _dispatcher(function: Callable[..., Any], compiler: type[_KernelCompiler], options: dict[str, Any]) -> Any:
    """Numba's, with common options and a cache that notices changes."""
    dispatcher = numba.njit(**(OPTIONS | {"pipeline_class": compiler} | options))(function)
    try:
        dispatcher._cache = _KernelCache(function)
    except RuntimeError as error:
        raise no_cache_error(function) from error
    if not set_stamp(dispatcher, "linked"):
        raise RuntimeError("the cache of a kernel cannot be given a stamp")
    return dispatcher
