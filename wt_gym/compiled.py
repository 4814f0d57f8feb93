"""The decorator of every compiled kernel: common options, one version of every kernel, a cache that notices changes.

numba checks a cached kernel only against the file in which it stands; a kernel compiled into the kernel of another
file would stay there in its old form. All kernels of the package therefore share one stamp made from all kernel files.

numba also leaves it to the linker which version of a kernel runs: the code of a kernel brings along the kernels that it
calls as weak symbols, and of several versions, each optimised with its caller and rounding differently, the one that
was loaded first serves all. What a step computes would then depend in the last bits on what ran before it in the same
process. Here every kernel keeps the versions that it was compiled with.

So each kernel would be optimised again within every kernel above it. A kernel marked as ``separate`` is not: its
callers call its one machine code through a symbol, which names the kernel, its argument types and the sources that it
was compiled from. A caller that comes from the cache has its separate kernels loaded, or compiled, first.

Every other kernel is an inner one: its code is simplified, linked into its callers and optimised there. It has no
machine code of its own.

A negative index does not count from the end in a kernel. numba has every index compared with zero, where the compiler
does not know its sign: a tenth of the time of a step of the turbine.

What unpacks hundreds of arrays from Python's objects takes as long to compile as a kernel itself. Kernels therefore
have no such way in of their own; where Python calls one, a function that only passes on the call is compiled.
"""

import hashlib
import inspect
import math
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from weakref import WeakKeyDictionary

import numba
from llvmlite.binding import Linkage, parse_bitcode
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.funcdesc import PythonFunctionDescriptor
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes
from numba.np import arrayobj

__all__ = ["compiled_for", "is_compiled", "kernel", "was_compiled"]

FASTMATH = {"contract", "arcp", "nsz", "reassoc"}
"""Never nnan or ninf: the checks for states that are not finite must keep their meaning."""


class _Changed(Exception):
    """A separate kernel is no longer what its caller was compiled for."""


@dataclass(frozen=True)
class _Separate:
    """A separate kernel for certain argument types; called, it sees to it that the machine code is in the process.

    numba keeps such calls with the machine code of a caller and makes them before it loads it (``reload_init``).
    """

    module: str
    name: str
    arguments: tuple
    symbol: str

    def __call__(self):
        try:
            kernel = _named(self.module, self.name)
        except (AttributeError, ModuleNotFoundError) as error:
            raise _Changed(f"there is no {self.module}.{self.name} any more") from error
        kernel.compile(self.arguments)
        if _separate(kernel.py_func, self.arguments) != self:
            raise _Changed(f"{self.module}.{self.name} has changed since its callers were compiled")


def _named(module, name):
    """The kernel that goes by this name now."""
    return getattr(import_module(module), name)


_SEPARATE = WeakKeyDictionary()
"""The `_Separate` and the name in LLVM's code of each library of a separate kernel."""


def _separate(function, arguments):
    """What stands for a separate kernel in the cache of its callers; numba's own names differ between processes."""
    module, name = function.__module__, function.__name__
    cache_file = _named(module, name)._cache._cache_file
    sources = f"{_stamp()} {cache_file._source_stamp} {arguments}"
    return _Separate(module, name, tuple(arguments), f"{module}.{name}.{hashlib.sha256(sources.encode()).hexdigest()}")


_fix_index = arrayobj.fix_integer_index


def _index(context, builder, index_type, index, size):
    """An index into an array: as it is in a kernel, in other code as numba takes it, negative ones from the end."""
    if getattr(builder.module, "of_kernel", False):
        return context.cast(builder, index, index_type, types.intp)
    return _fix_index(context, builder, index_type, index, size)


arrayobj.fix_integer_index = _index


class _SelfContained(JITCodeLibrary):
    """Machine code whose own versions of the kernels that it calls no other code can replace."""

    _name_and_symbol = None  # of a separate kernel

    def _optimize_functions(self, ll_module):
        """Leave them as they are: numba would simplify here what is simplified again after linking."""
        ll_module.data_layout = self._codegen._data_layout

    def __init__(self, codegen, name):
        super().__init__(codegen, name)
        self._called = {}  # separate kernels: their names in LLVM's code, and symbols
        self._environments = {}  # of inner kernels: what prints, for example, needs Python's objects

    def create_ir_module(self, name):
        """A module for the code of one function, by which `_index` knows it."""
        module = super().create_ir_module(name)
        module.of_kernel = True
        return module

    def add_linking_library(self, library):
        """Link the code of what is called; of a separate kernel only remember what its callers call it."""
        if library in _SEPARATE:
            separate, name = _SEPARATE[library]
            self._called[name] = separate.symbol
            self._reload_init.add(separate)
        else:
            super().add_linking_library(library)
            self._environments |= getattr(library, "_environments", {})

    def finalize(self):
        """Optimise and load the code, in which separate kernels now go by their symbols."""
        for function in list(self._final_module.functions):  # before others with the same symbols are linked
            if function.name in self._called:
                function.name = self._called[function.name]
        super().finalize()

    def _finalize_final_module(self):
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

    def _optimize_final_module(self):
        """Simplify only, which makes less work for each caller; there it is optimised with what surrounds it."""
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False, slp_vectorize=False, opt=1)
        passes.run(self._final_module, builder)

    def _finalize_final_module(self):
        self._finalized = True  # and nothing is loaded
        self._finalize_dynamic_globals()  # code with addresses of this process is not kept

    def get_pointer_to_function(self, name):
        """None, as for a function that is not there; numba asks when the code is complete."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self):
        """What numba asks to give loaded code its environment, which here goes to the callers."""
        return _Environments(self._environments)

    def serialize_using_object_code(self):
        """For the cache: what callers link."""
        return self.name, "inner", self._final_module.as_bitcode()

    @classmethod
    def load(cls, codegen, name, bitcode):
        """From the cache."""
        library = cls(codegen, name)
        library._final_module = parse_bitcode(bitcode)
        library._finalize_final_module()
        return library


@dataclass(frozen=True)
class _Environments:
    """A place for the environments of code that is never loaded."""

    of_code: dict

    def set_env(self, name, environment):
        """Keep it for the callers."""
        self.of_code[name] = environment


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseSelfContained(LoweringPass):
    """Have the machine code written into a `_SelfContained` library; numba would make a plain one."""

    _name = "use_self_contained_library"
    _library = _SelfContained

    def __init__(self):
        LoweringPass.__init__(self)

    def run_pass(self, state):
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

    def run_pass(self, state):
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

    def __hash__(self):
        return hash(frozenset(self._values))

    def __eq__(self, other):
        return isinstance(other, _Flags) and self._values == other._values


class _KernelCompiler(CompilerBase):
    """The stages of numba's compiler with self-contained machine code."""

    _library_pass = _UseSelfContained

    def __init__(self, typing, target, library, arguments, result, flags, types_of_variables):
        super().__init__(typing, target, library, arguments, result, _Flags(flags), types_of_variables)

    def define_pipelines(self):
        """One pipeline, without Python objects."""
        stages = DefaultPassBuilder.define_nopython_pipeline(self.state)
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

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.state.flags.noalias = True


class _KernelCacheImpl(CompileResultCacheImpl):
    """What of a compiled kernel goes to disk and comes back."""

    def rebuild(self, target_context, payload):
        """The result of a compilation, with or without machine code."""
        (name, kind, code), described, environment, signature, object_mode, lifted, types, reload_init, others = payload
        if kind != "inner":
            return super().rebuild(target_context, payload)
        for load in reload_init:
            load()
        library = _Inner.load(target_context.codegen(), name, code)
        for called in others:
            library.codegen.set_env(called.env_name, called)
        return CompileResult(
            target_context=target_context, typing_context=target_context.typing_context, library=library,
            environment=environment, entry_point=target_context.get_executable(library, described, environment),
            fndesc=described, type_annotation=types, signature=signature, objectmode=object_mode, lifted=lifted,
            typing_error=None, call_helper=None, metadata=None, reload_init=reload_init, referenced_envs=others,
        )  # fmt: skip


class _KernelCache(FunctionCache):
    """Machine code on disk, which comes with the separate kernels that it calls."""

    _impl_class = _KernelCacheImpl
    separate = False

    def kept(self):
        """Keys of the code that is there."""
        return set(self._cache_file._load_index())

    def key(self, arguments, target_context):
        """What code for these argument types goes by."""
        return self._index_key(arguments, target_context.codegen())

    def _load_overload(self, sig, target_context):
        try:
            result = super()._load_overload(sig, target_context)
        except _Changed:  # the caller is then compiled anew
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

    @cached_property
    def from_python(self):
        """The kernel with a way in from Python, compiled on demand."""
        function = self.py_func
        name, arguments = f"{function.__name__}_from_python", ", ".join(inspect.signature(function).parameters)
        # numba's cache takes functions that stand in a file under a name, and no closures; it tells them by their lines
        source = "\n" * (function.__code__.co_firstlineno - 1)
        source += f"def {name}({arguments}):\n    return _kernel({arguments})\n"
        namespace = {"_kernel": self, "__name__": function.__module__}
        exec(compile(source, inspect.getfile(function), "exec"), namespace)
        namespace[name].__defaults__ = function.__defaults__
        return _dispatcher(namespace[name], _KernelCompiler, self._given)

    def __reduce__(self):
        return _named, (self.py_func.__module__, self.py_func.__name__)

    def __call__(self, *arguments, **named):
        """Call from Python."""
        return self.from_python(*arguments, **named)


@cache
def _stamp():
    """Version of numba, modification time and size of this file and all kernel files together."""
    files = [Path(__file__), *sorted(Path(__file__).parent.rglob("*_kernels.py"))]
    stats = [path.stat() for path in files]
    return f"{numba.__version__} {math.fsum(s.st_mtime for s in stats)} {sum(s.st_size for s in stats)}"


def kernel(function=None, separate=False, distinct=False, **options):
    """Compile a function on plain arrays that stands at the top level of its module.

    Reference counting is off (arrays live in the caller), which trebles the speed of functions that pass many arrays;
    a kernel can therefore not allocate.

    Parameters
    ----------
    function : callable
    separate : bool
        Compile it once for all its callers, which then call it: some nanoseconds and as many for each array among the
        arguments. For big kernels outside of inner loops. Others become part of each caller.
    distinct : bool
        Of a separate kernel: what it writes into one of the arrays among its arguments can be seen in no other. The
        compiler then need not read everything again that has gone past a write, a quarter of the time of the equations
        of motion. With arrays that do overlap the result is wrong without notice.
    **options
        Further options of ``numba.njit``. ``inline="always"`` suits a kernel with a single caller: it is then compiled
        once, not on its own and again within its caller.

    Raises
    ------
    ValueError
        If a kernel is defined within a function or class, is a generator or takes any number of arguments, or is to be
        distinct and not separate.
    """
    if function is None:
        return lambda f: kernel(f, separate, distinct, **options)
    if distinct and not separate:
        raise ValueError(f"{function.__name__}: arrays are told apart in separate kernels only")
    _check(function)
    compiler = _InnerCompiler
    if separate:
        compiler = _DistinctCompiler if distinct else _SeparateCompiler
    dispatcher = _dispatcher(function, compiler, options | {"no_cpython_wrapper": True})
    dispatcher.__class__ = _KernelDispatcher  # which numba cannot be asked for
    dispatcher._given = options
    dispatcher._cache.separate = separate
    return dispatcher


def _check(function):
    """Whether a function can be a kernel."""
    name = function.__qualname__
    if name != function.__name__:
        raise ValueError(f"{name}: a kernel stands at the top level of its module")
    if inspect.isgeneratorfunction(function):
        raise ValueError(f"{name}: a kernel is no generator")
    several = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.POSITIONAL_OR_KEYWORD]
    if several:
        raise ValueError(f"{name}: a kernel has no parameter such as {several[0]}")
    if numba.config.DISABLE_JIT:
        raise RuntimeError("NUMBA_DISABLE_JIT is set, and the simulator does not run without compiled kernels")


def _dispatcher(function, compiler, options):
    """Numba's, with common options and a cache that notices changes."""
    # no kernel is called through a pointer in C
    defaults = {"error_model": "numpy", "fastmath": FASTMATH, "_nrt": False, "no_cfunc_wrapper": True}
    dispatcher = numba.njit(**(defaults | {"pipeline_class": compiler} | options))(function)
    try:
        dispatcher._cache = _KernelCache(function)
    except RuntimeError as error:
        raise RuntimeError(
            f"there is no place to keep compiled kernels: neither the folder of {inspect.getfile(function)} nor a "
            "cache of the user can be written; set NUMBA_CACHE_DIR to a folder that can"
        ) from error
    # in the place of the version, because numba reads an old file no further: it may name types that have moved since
    dispatcher._cache._cache_file._version = _stamp()
    return dispatcher


def compiled_for(function, arguments):
    """Compiled form of a kernel for the types of these arguments, to be called with arguments of the same types only.

    A call of the kernel itself looks up the type of each array it is given: 25 µs for two hundred of them.
    """
    return _for_python(function).compile(argument_types(arguments))


def is_compiled(function, arguments):
    """Whether the compiled form of a kernel for the types of these arguments is in this process or in the cache."""
    function, types = _for_python(function), argument_types(arguments)
    return types in function.overloads or function._cache.key(types, function.targetctx) in function._cache.kept()


def was_compiled(function):
    """Whether a kernel is in this process or in the cache for any types of arguments."""
    return bool(function.overloads) or bool(function._cache.kept())


def _for_python(function):
    return function.from_python if isinstance(function, _KernelDispatcher) else function


def argument_types(arguments):
    """Numba's types of some arguments, as a kernel is compiled for them."""
    return tuple(numba.typeof(argument) for argument in arguments)
