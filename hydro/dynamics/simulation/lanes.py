"""Registers of `WIDTH` numbers in compiled code, one lane per vehicle, so that one text
of an equation serves one vehicle and many.

A value is a number (float64) or a register (`LANES`); arithmetic takes both and any
mixture. The argument `like` of a function (0.0, or `spread(0.0)`) says which of the two
is meant. LLVM makes a register of whatever the machine has: one of 512 bits, or several
smaller ones. Functions that use these are compiled once into __pycache__ and do not see
a change in this file: after one, delete what lies there.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numba.extending
from numba.core import cgutils as numba_cgutils

from auvid.hydro.dynamics.simulation.plant_constants import WIDTH

# The compiler's own interface has no types.
cgutils: Any = numba_cgutils
extending: Any = numba.extending
types: Any = numba.types
ir: Any = cgutils.ir
F = TypeVar("F", bound=Callable[..., Any])
_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, WIDTH)
_CONTRACT = ("contract",)  # a product and a sum may be one instruction; nothing else is reordered


class _Lanes(numba.types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"float64x{WIDTH}")


LANES = _Lanes()
_KINDS = (types.float64, LANES)


@extending.register_model(_Lanes)
class _LanesModel(numba.extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)  # type: ignore[no-untyped-call]


def intrinsic(function: Callable[..., Any]) -> Any:
    """A function whose arguments are types and whose result writes the instructions."""
    return extending.intrinsic(function)


def _everywhere(builder: Any, value: Any) -> Any:
    """The same number in every lane."""
    if value.type == _VECTOR:
        return value
    first = builder.insert_element(
        ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(
        first,
        ir.Constant(_VECTOR, ir.Undefined),
        ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH),
    )


def _arithmetic(symbol: Any, instruction: str) -> None:
    """`symbol` between registers, or a register and a number."""

    def typer(context: Any) -> Any:
        return lambda a, b: LANES if LANES in (a, b) and a in _KINDS and b in _KINDS else None

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return getattr(builder, instruction)(
            *(_everywhere(builder, item) for item in args), flags=_CONTRACT
        )

    extending.type_callable(symbol)(typer)
    for pair in ((LANES, LANES), (LANES, types.float64), (types.float64, LANES)):
        extending.lower_builtin(symbol, *pair)(lower)


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _arithmetic(_symbol, _instruction)


def _elementwise(name: str) -> Any:
    """An LLVM function of one or two arguments of the same kind."""

    def call(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if signature.return_type == LANES:
            args = [_everywhere(builder, item) for item in args]
        kind = args[0].type
        function = ir.FunctionType(kind, [kind] * len(args))
        suffix = "f64" if kind == _DOUBLE else f"v{WIDTH}f64"
        return builder.call(
            cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.{suffix}"), args
        )

    @intrinsic
    def found(typing: Any, a: Any) -> Any:
        return (a(a), call) if a in _KINDS else None

    @intrinsic
    def found_two(typing: Any, a: Any, b: Any) -> Any:
        return (
            ((LANES if LANES in (a, b) else a)(a, b), call) if a in _KINDS and b in _KINDS else None
        )

    return found_two if name in ("pow", "maxnum") else found


absolute, root, floor, nearest = (_elementwise(name) for name in ("fabs", "sqrt", "floor", "rint"))
power, larger = _elementwise("pow"), _elementwise("maxnum")


@intrinsic
def choose(typing: Any, a: Any, b: Any, less: Any, other: Any) -> Any:
    """`less` where a < b, elsewhere `other`, lane by lane."""
    kind = LANES if LANES in (a, b, less, other) else a

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if kind == LANES:
            args = [_everywhere(builder, item) for item in args]
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return kind(a, b, less, other), code


@intrinsic
def spread(typing: Any, value: Any) -> Any:
    """A register that holds this number in every lane."""
    return LANES(value), lambda context, builder, signature, args: _everywhere(builder, args[0])


@intrinsic
def together(typing: Any, like: Any) -> Any:
    """Vehicles at a time: 1, or the lanes of a register."""
    count = WIDTH if like == LANES else 1
    return types.intp(like), lambda context, builder, signature, args: context.get_constant(
        types.intp, count
    )


@intrinsic
def address(typing: Any, array: Any) -> Any:
    """Where the numbers of an array are: unlike the array, it is not counted each time
    that a tuple gives it out.
    """
    return types.CPointer(array.dtype)(array), lambda context, builder, signature, args: _data(
        context, builder, array, args[0]
    )


def _data(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return (
        value
        if isinstance(kind, types.CPointer)
        else context.make_array(kind)(context, builder, value).data
    )


def _pointer(context: Any, builder: Any, kind: Any, value: Any, index: Any, pointed: Any) -> Any:
    return builder.bitcast(
        builder.gep(_data(context, builder, kind, value), [index], inbounds=True),
        pointed.as_pointer(),
    )


@intrinsic
def get(typing: Any, array: Any, index: Any, like: Any) -> Any:
    """Item `index` of a flat array of numbers or of registers."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind, step = (_VECTOR, WIDTH) if like == LANES else (_DOUBLE, 1)
        index = builder.mul(args[1], ir.Constant(args[1].type, step))
        return builder.load(_pointer(context, builder, array, args[0], index, kind), align=8)

    return like(array, types.intp, like), code


@intrinsic
def put(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write item `index` of a flat array of numbers or of registers."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        index = builder.mul(args[1], ir.Constant(args[1].type, WIDTH if value == LANES else 1))
        builder.store(
            args[2], _pointer(context, builder, array, args[0], index, args[2].type), align=8
        )
        return context.get_dummy_value()

    return types.void(array, types.intp, value), code


@intrinsic
def column(typing: Any, table: Any, index: Any, like: Any) -> Any:
    """What meets `like` in a row of a table: the next `WIDTH` columns for one vehicle,
    one number for a register of vehicles.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = _DOUBLE if like == LANES else _VECTOR
        return builder.load(_pointer(context, builder, table, args[0], args[1], kind), align=8)

    return (types.float64 if like == LANES else LANES)(table, types.intp, like), code


@intrinsic
def total(typing: Any, lanes: Any, like: Any) -> Any:
    """The sum over the columns of a table: over the lanes for one vehicle; nothing is
    left to add for a register of vehicles.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if like == LANES:
            return args[0]
        function = ir.FunctionType(_DOUBLE, [_DOUBLE, _VECTOR])
        found = cgutils.get_or_insert_function(
            builder.module, function, f"llvm.vector.reduce.fadd.v{WIDTH}f64"
        )
        return builder.call(found, [ir.Constant(_DOUBLE, -0.0), args[0]], fastmath=("reassoc",))

    return like(lanes, like), code


def compiled(function: F) -> F:
    """Compiled on first use, into its caller, and kept in __pycache__; division by zero
    gives infinity as in numpy. Holds no lock.
    """
    jit: Any = numba.njit(
        cache=True, error_model="numpy", nogil=True, forceinline=True, fastmath=set(_CONTRACT)
    )
    result: F = jit(function)
    return result


_QUARTER = math.floor(math.ldexp(math.pi / 2.0, 29)) / 2.0**29
_REST = math.pi / 2.0 - _QUARTER
_LAST = 6.123233995736766e-17  # pi/2 less its float64
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))
_COSINE = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(10))


@compiled
def sine_cosine(angle: Any) -> Any:
    """sin and cos from their series, after a turn by multiples of pi/2: to 1e-15 for
    angles up to 1e6 rad.
    """
    turns = nearest(angle * (2.0 / math.pi))
    x = ((angle - turns * _QUARTER) - turns * _REST) - turns * _LAST
    z = x * x
    sine, cosine = z * 0.0 + _SINE[8], z * 0.0 + _COSINE[9]
    for k in range(8):
        sine = sine * z + _SINE[7 - k]
    for k in range(9):
        cosine = cosine * z + _COSINE[8 - k]
    sine = sine * x
    half = floor(turns * 0.5)
    odd = turns - half * 2.0
    sign = 1.0 - 2.0 * (half - 2.0 * floor(half * 0.5))
    return sign * choose(odd, 0.5, sine, cosine), sign * (1.0 - 2.0 * odd) * choose(
        odd, 0.5, cosine, sine
    )
