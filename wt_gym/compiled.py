"""The decorator of every compiled kernel: common options, one version of every kernel, a cache that notices changes.

numba checks a cached kernel only against the file in which it stands; a kernel compiled into the kernel of another
file would stay there in its old form. All kernels of the package therefore share one stamp made from all kernel files.

numba also leaves it to the linker which version of a kernel runs: the code of a kernel brings along the kernels that it
calls as weak symbols, and of several versions, each optimised with its caller and rounding differently, the one that
was loaded first serves all. What a step computes would then depend in the last bits on what ran before it in the same
process. Here every kernel keeps the versions that it was compiled with.
"""

import math
from functools import cache
from pathlib import Path

import numba
from llvmlite.binding import Linkage
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes

__all__ = ["compiled_for", "kernel"]

FASTMATH = {"contract", "arcp", "nsz", "reassoc"}
"""Never nnan or ninf: the checks for states that are not finite must keep their meaning."""


class _SelfContained(JITCodeLibrary):
    """Machine code whose own versions of the kernels that it calls no other code can replace."""

    def _finalize_final_module(self):
        self._finalized = True
        self._get_module_for_linking()  # a copy with weak symbols, from which callers of this kernel are compiled
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = "internal"
        super()._finalize_final_module()


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseSelfContained(LoweringPass):
    """Have the machine code written into a `_SelfContained` library; numba would make a plain one."""

    _name = "use_self_contained_library"

    def __init__(self):
        LoweringPass.__init__(self)

    def run_pass(self, state):
        """Make the library."""
        state.library = _SelfContained(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return True


class _KernelCompiler(CompilerBase):
    """The stages of numba's compiler with self-contained machine code."""

    def define_pipelines(self):
        """One pipeline, without Python objects."""
        stages = DefaultPassBuilder.define_nopython_pipeline(self.state)
        stages.add_pass_after(_UseSelfContained, AnnotateTypes)
        stages.finalize()
        return [stages]


@cache
def _stamp():
    """Version of numba, modification time and size of this file and all kernel files together."""
    files = [Path(__file__), *sorted(Path(__file__).parent.rglob("*_kernels.py"))]
    stats = [path.stat() for path in files]
    return f"{numba.__version__} {math.fsum(s.st_mtime for s in stats)} {sum(s.st_size for s in stats)}"


def kernel(function=None, **options):
    """Compile a function on plain arrays.

    Reference counting is off (arrays live in the caller), which trebles the speed of functions that pass many arrays;
    a kernel can therefore not allocate.

    Parameters
    ----------
    function : callable
    **options
        Further options of ``numba.njit``. ``inline="always"`` suits a kernel with a single caller: it is then compiled
        once, not on its own and again within its caller.
    """
    if function is None:
        return lambda f: kernel(f, **options)
    defaults = {"cache": True, "error_model": "numpy", "fastmath": FASTMATH, "_nrt": False}
    defaults["pipeline_class"] = _KernelCompiler
    dispatcher = numba.njit(**(defaults | options))(function)
    # in the place of the version, because numba reads an old file no further: it may name types that have moved since
    dispatcher._cache._cache_file._version = _stamp()
    return dispatcher


def compiled_for(function, arguments):
    """Compiled form of a kernel for the types of these arguments, to be called with arguments of the same types only.

    A call of the kernel itself looks up the type of each array it is given: 25 µs for two hundred of them.
    """
    return function.compile(tuple(numba.typeof(argument) for argument in arguments))
