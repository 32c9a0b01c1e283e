"""Sixty-four signed bytes as one value of a kernel: a vector register, or what LLVM makes of it.

A set of the 64 places is a word, place 0 its lowest bit.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

__all__ = [
    "PLACES",
    "Bytes",
    "below",
    "choose",
    "each",
    "loaded",
    "minus",
    "plus",
    "splat",
    "store",
]

PLACES = 64
INDEX, BYTE = ir.IntType(32), ir.IntType(8)
VECTOR, SET = (ir.VectorType(kind, PLACES) for kind in (BYTE, ir.IntType(1)))
SPLAT = ir.Constant(ir.VectorType(INDEX, PLACES), [0] * PLACES)

Bytes = Any  # 64 signed bytes, inside a kernel
Operation = Callable[..., Any]

operation = cast(Callable[[Operation], Operation], intrinsic)


class BytesType(types.Type):
    """The type that numba knows them by."""

    def __init__(self) -> None:
        super().__init__(name="Bytes")


BYTES = BytesType()


@register_model(BytesType)
class BytesModel(models.PrimitiveModel):
    """They are an LLVM vector."""

    def __init__(self, manager: Any, of: types.Type) -> None:
        super().__init__(manager, of, VECTOR)  # type: ignore[no-untyped-call]


def _splat(builder: ir.IRBuilder, value: ir.Value, vector: ir.VectorType) -> ir.Value:
    undefined = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(INDEX, 0))
    return builder.shuffle_vector(one, undefined, SPLAT)


def _pointer(context: Any, builder: ir.IRBuilder, array: Any, of: Any, place: Any) -> ir.Value:
    """To 64 elements of a one-dimensional array from `place` on, as a vector."""
    data = context.make_array(array)(context, builder, of).data
    element = context.get_data_type(array.dtype)
    first = builder.gep(data, [place])
    return builder.bitcast(first, ir.VectorType(element, PLACES).as_pointer())


@operation
def splat(_: Any, value: Any) -> Any:
    """A whole number that a byte can hold, 64 times."""

    def code(_: Any, builder: ir.IRBuilder, __: Any, given: Any) -> ir.Value:
        return _splat(builder, builder.trunc(given[0], BYTE), VECTOR)

    return BYTES(value), code


@operation
def plus(_: Any, a: Any, b: Any) -> Any:
    """Byte by byte."""

    def code(_: Any, builder: ir.IRBuilder, __: Any, given: Any) -> ir.Value:
        return builder.add(*given)

    return BYTES(a, b), code


@operation
def minus(_: Any, a: Any, b: Any) -> Any:
    """Byte by byte."""

    def code(_: Any, builder: ir.IRBuilder, __: Any, given: Any) -> ir.Value:
        return builder.sub(*given)

    return BYTES(a, b), code


@operation
def choose(_: Any, places: Any, there: Any, elsewhere: Any) -> Any:
    """The bytes of `there` at `places`, and of `elsewhere` at all others."""

    def code(_: Any, builder: ir.IRBuilder, __: Any, given: Any) -> ir.Value:
        return builder.select(builder.bitcast(given[0], SET), given[1], given[2])

    return BYTES(places, there, elsewhere), code


@operation
def below(_: Any, a: Any, b: Any) -> Any:
    """The places where a < b."""

    def code(_: Any, builder: ir.IRBuilder, __: Any, given: Any) -> ir.Value:
        return builder.bitcast(builder.icmp_signed("<", *given), ir.IntType(PLACES))

    return types.uint64(a, b), code


@operation
def loaded(_: Any, array: Any, place: Any) -> Any:
    """64 numbers of an array from `place` on; what a byte cannot hold is the nearest it can."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, given: Any) -> ir.Value:
        pointer = _pointer(context, builder, signature.args[0], *given)
        values = builder.load(pointer, align=1)
        element = values.type.element
        if element.width > BYTE.width:
            for limit, beyond in ((-128, "<"), (127, ">")):
                limits = ir.Constant(values.type, [limit] * PLACES)
                is_beyond = builder.icmp_signed(beyond, values, limits)
                values = builder.select(is_beyond, limits, values)
            values = builder.trunc(values, VECTOR)
        return values

    return BYTES(array, place), code


@operation
def store(_: Any, array: Any, place: Any, values: Any) -> Any:
    """Put 64 numbers into an array from `place` on."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, given: Any) -> ir.Value:
        pointer = _pointer(context, builder, signature.args[0], *given[:2])
        element = pointer.type.pointee.element
        wide = given[2] if element == BYTE else builder.sext(given[2], pointer.type.pointee)
        builder.store(wide, pointer, align=1)
        return context.get_dummy_value()

    return types.void(array, place, values), code


@operation
def each(_: Any, ranks: Any, value: Any) -> Any:
    """A tuple of `value` as long as the tuple `ranks`."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, given: Any) -> ir.Value:
        return context.make_tuple(builder, signature.return_type, [given[1]] * len(ranks))

    tuple_of = types.UniTuple(value, len(ranks))  # type: ignore[no-untyped-call]
    return tuple_of(ranks, value), code
