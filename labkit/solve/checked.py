"""The functions of `math`, powers and whole numbers made of floats, compiled so that they fail
where Python's do.

In the common source they are called do_sqrt(x), do_power(x, y) …; `intrinsics(names)` makes them
for Numba. A failure leaves the compiled function as an exception does; the caller's answer is then
NaN. An overflow of exp is infinity.
"""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable
from functools import reduce

# When the result r of the arguments x (and y) is a failure
NEVER, STRICT, LOOSE, POWER, POLE, WHOLE = range(6)

_ANGLES = ["sin", "cos", "tan", "asin", "acos", "atan", "asinh", "acosh", "atanh", "tanh"]
_ONE = ["sqrt", "log", "log2", "log10", "log1p", "erf", "erfc", "fabs", "degrees", "radians"]
#: name in the source -> (the function, number of arguments, when it fails)
CHECKED: dict[str, tuple[object, int, int]] = {
    **{f"do_{name}": (getattr(math, name), 1, STRICT) for name in _ONE + _ANGLES},
    **{f"do_{name}": (getattr(math, name), 1, LOOSE) for name in ["exp", "expm1", "sinh", "cosh"]},
    **{f"do_{name}": (getattr(math, name), 2, NEVER) for name in ["atan2", "copysign"]},
    "do_hypot": (math.hypot, 2, LOOSE),
    "do_fmod": (math.fmod, 2, STRICT),
    "do_pow": (math.pow, 2, POLE),
    "do_power": (operator.pow, 2, POWER),
    "do_square": ("square", 1, POWER),
    "do_division": (operator.truediv, 2, NEVER),  # NumPy's; Python's own is checked by Numba
    "do_numpy_power": (operator.pow, 2, NEVER),
    **{f"do_{name}": (f"llvm.{name}", 1, WHOLE) for name in ["trunc", "floor", "ceil", "rint"]},
}
#: function of `math` -> that name
OF_MATH = {
    what: name
    for name, (what, _, _) in CHECKED.items()
    if getattr(what, "__module__", "") == "math"
}


def intrinsics(names: set[str]) -> dict[str, object]:
    """intrinsics({"do_sqrt"}) -> what goes under these names when Numba compiles the source."""
    return {name: _make(*CHECKED[name]) for name in names if name in CHECKED}


def _make(what: object, count: int, fails: int) -> object:
    from numba import types as nb
    from numba.extending import intrinsic

    signature = nb.float64(*[nb.float64] * count)

    def codegen(context, builder, signature, arguments):
        result = _value(what, context, builder, signature, arguments)
        if fails != NEVER:
            with builder.if_then(_failed(builder, fails, result, arguments), likely=False):
                context.call_conv.return_user_exc(builder, ValueError, ("not a number",))
        return result

    def prepare(typing):
        if callable(what) and what not in (operator.truediv, operator.pow, math.pow, math.fmod):
            typing.resolve_function_type(what, signature.args, {})
        return signature, codegen

    one, two = lambda typing, x: prepare(typing), lambda typing, x, y: prepare(typing)
    return intrinsic(one if count == 1 else two)


def _value(what: object, context, builder, signature, arguments):
    if what == "square":
        return _square(builder, *arguments)
    if what is operator.truediv:
        return builder.fdiv(*arguments)
    if what is math.fmod:
        return builder.frem(*arguments)
    if what in (operator.pow, math.pow):
        return builder.call(_library_pow(builder.module), arguments)
    if callable(what):
        return context.get_function(what, signature)(builder, arguments)
    x = arguments[0]
    return builder.call(builder.module.declare_intrinsic(what, [x.type]), [x])


def _square(builder, x):
    """pow(x, 2.0), by one multiplication for ten of eleven x.

    pow is off by 0.54 units in the last place at most (glibc), so where the exact square lies
    further than 0.045 from the middle between two numbers, pow gives what x*x does. Of the pow of
    other systems no such bound is known here.
    """
    from llvmlite import ir

    def number(value: float):
        return ir.Constant(x.type, value)

    def asked():
        return builder.call(_library_pow(builder.module), [x, number(2.0)])

    if sys.platform != "linux":
        return asked()
    product = builder.fmul(x, x)
    rest = builder.fma(x, x, builder.fneg(product))  # exactly what rounding has taken from it
    moved = builder.fadd(product, builder.fmul(rest, number(1.1)))
    clear = builder.fcmp_ordered("==", moved, product)
    sure = builder.and_(clear, builder.fcmp_ordered(">", product, number(1e-280)))
    before = builder.block
    with builder.if_then(builder.not_(sure), likely=False):
        other, then = asked(), builder.block
    result = builder.phi(x.type)
    result.add_incoming(product, before)
    result.add_incoming(other, then)
    return result


def _library_pow(module):
    """The C library's pow, as Python calls it: LLVM may not put x*x for x**2, which may differ."""
    from llvmlite import ir

    if "pow" not in module.globals:
        double = ir.DoubleType()
        declared = ir.Function(module, ir.FunctionType(double, [double, double]), "pow")
        declared.attributes.add("nobuiltin")
    return module.globals["pow"]


def _failed(builder, fails: int, result, arguments):
    from llvmlite import ir

    zero = ir.Constant(ir.DoubleType(), 0.0)

    def is_number(value):
        return builder.fcmp_ordered("ord", value, value)

    def is_finite(value):
        return builder.fcmp_ordered("==", builder.fsub(value, value), zero)

    def only(test: Callable):
        """Not so the result, but so all arguments."""
        return reduce(builder.and_, map(test, arguments), builder.not_(test(result)))

    if fails == WHOLE:
        return builder.not_(is_finite(result))
    if fails == POWER:
        return only(is_finite)
    invalid = only(is_number)
    if fails == LOOSE:
        return invalid
    endless = only(is_finite)
    if fails == POLE:  # math.pow(0, -1)
        endless = builder.and_(endless, builder.fcmp_ordered("==", arguments[0], zero))
    return builder.or_(invalid, endless)
