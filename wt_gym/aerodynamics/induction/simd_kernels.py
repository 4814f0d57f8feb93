"""Vectors of 16 float32 numbers as values in kernels, for inner loops that must keep their sums in registers.

The compiler's own vectorization of a loop over targets keeps every sum in memory, and re-reads it at each source. With
a vector as one value the loop over sources is the inner one and the sums stay in registers. The vectors are those of
LLVM, so every processor runs them: one register with AVX-512, two with AVX2, four with SSE or NEON.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

__all__ = ["WIDTH", "load", "reciprocal", "reciprocal_root", "spread", "store"]

WIDTH = 16
"""Numbers in one vector."""

# NaN and infinity keep their meaning (no nnan, no ninf), so that a broken state shows.
_FLAGS = ("contract", "afn", "arcp", "reassoc", "nsz")
_LLVM_VECTOR = ir.VectorType(ir.FloatType(), WIDTH)


class _Vector(types.Type):
    """Type of a vector within a kernel."""

    def __init__(self):
        super().__init__(name=f"float32x{WIDTH}")


VECTOR = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, fe_type):
        super().__init__(manager, fe_type, _LLVM_VECTOR)


def _constant(value):
    return ir.Constant(_LLVM_VECTOR, [float(np.float32(value))] * WIDTH)


def _define(operation, instruction):
    """Make ``vector operation vector`` an LLVM instruction."""

    @type_callable(operation)
    def typer(context):
        return lambda a, b: VECTOR if a == VECTOR and b == VECTOR else None

    @lower_builtin(operation, VECTOR, VECTOR)
    def lower(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments, flags=_FLAGS)


for _operation, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _instruction)


def _address(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _LLVM_VECTOR.as_pointer())


def _is_float32(array):
    return isinstance(array, types.Array) and array.dtype == types.float32 and array.layout == "C"


@intrinsic
def load(typing, array, index):
    """Return the 16 numbers of a float32 array in C order that start at a flat index."""
    if not _is_float32(array):
        return None

    def generate(context, builder, signature, arguments):
        pointer = _address(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=4, typ=_LLVM_VECTOR)

    return VECTOR(array, types.intp), generate


@intrinsic
def store(typing, array, index, vector):
    """Write 16 numbers into a float32 array in C order from a flat index on."""
    if not _is_float32(array):
        return None

    def generate(context, builder, signature, arguments):
        array_value, at, value = arguments
        builder.store(value, _address(context, builder, signature.args[0], array_value, at), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, VECTOR), generate


@intrinsic
def spread(typing, number):
    """Return a vector with the same float32 number in all places."""

    def generate(context, builder, signature, arguments):
        one = builder.insert_element(
            ir.Constant(_LLVM_VECTOR, ir.Undefined), arguments[0], ir.Constant(ir.IntType(32), 0)
        )
        return builder.shuffle_vector(
            one, ir.Constant(_LLVM_VECTOR, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        )

    return VECTOR(types.float32), generate


def _allow_estimates(builder):
    """Let the compiler use the processor's estimates with one Newton step, accurate to the last bit or two.

    They run beside multiplications where division and square root block; not inlined, for the permission is the
    function's.
    """
    attributes = builder.function.attributes
    attributes.discard("alwaysinline")
    attributes.add("noinline")
    set.add(attributes, '"reciprocal-estimates"="all:1"')


@intrinsic
def reciprocal_root(typing, vector):
    """Return 1 / sqrt(x) to about 1e-7 relative; x = 0 gives NaN."""

    def generate(context, builder, signature, arguments):
        _allow_estimates(builder)
        root = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_LLVM_VECTOR, [_LLVM_VECTOR]), f"llvm.sqrt.v{WIDTH}f32"
        )
        return builder.fdiv(_constant(1.0), builder.call(root, arguments, fastmath=_FLAGS), flags=_FLAGS)

    return VECTOR(VECTOR), generate


@intrinsic
def reciprocal(typing, vector):
    """Return 1 / x to about 1e-7 relative; x = 0 gives NaN."""

    def generate(context, builder, signature, arguments):
        _allow_estimates(builder)
        # Without ninf the compiler would divide, for the Newton step makes NaN of 1 / infinity and of 1 / 0.
        return builder.fdiv(_constant(1.0), arguments[0], flags=(*_FLAGS, "ninf"))

    return VECTOR(VECTOR), generate
