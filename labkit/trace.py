"""Python functions of a model turned into SymPy expressions by calling them: every branch, every
helper, no second copy.

    tracer = Tracer()
    tracer.trace(flow, t, s, p)    # t, s.x, p.k are Quantity(sympy.Symbol("t")), …

The function that is called is a copy whose globals are rebound: math, numpy and what was imported
from them become SymPy's, helper functions become copies in turn. Numbers are Quantity objects, so
SymPy itself is left alone. A comparison that is asked for its truth (if, and, or, while) follows a
recorded path; all paths are walked and joined in a Piecewise.
"""

from __future__ import annotations

import builtins
import contextvars
import functools
import inspect
import math
import operator
import types
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from numbers import Number, Real
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.core.parameters import distribute

from .model import ModelError
from .rebind import names_in, rebound

__all__ = ["Definition", "Quantity", "Tracer", "Untraceable", "expression"]

MAX_PATHS = 64  # a function with more branches than this is better read as code
MAX_QUESTIONS = 2000  # comparisons on one path: a `while` that never ends must not hang


class Untraceable(ModelError):
    """A function cannot be written as a formula.

    The message says why. `equations` then shows its source instead.
    """


def expression(value: object) -> sp.Expr:
    """expression(0.5) -> SymPy number, exact where that is certain.

    Whole numbers, simple multiples of pi. TypeError for non-numbers.
    """
    if isinstance(value, Quantity):
        return value.e
    if isinstance(value, sp.Expr):
        return value
    if not isinstance(value, Real | np.bool_ | np.ndarray) or np.ndim(value):
        raise TypeError(f"{type(value).__name__} is not a number")
    number = float(value)
    if number.is_integer() and abs(number) < 1e6:
        return sp.Integer(int(number))
    turns = Fraction(number / math.pi).limit_denominator(12) if abs(number) < 100 else Fraction(0)
    if turns and number in (float(turns) * math.pi, turns.numerator * math.pi / turns.denominator):
        return sp.Rational(turns.numerator, turns.denominator) * sp.pi
    return sp.Float(number)


class _Path:
    """One way through a function: the answers to give first, then True.

    `taken` is what was asked and answered.
    """

    def __init__(self, prefix: list[tuple[Any, bool]]):
        self.prefix = prefix
        self.taken: list[tuple[Any, bool]] = []
        self.known: dict[Any, bool] = {}
        self.asked = 0

    def decide(self, condition: Any) -> bool:
        self.asked += 1
        if self.asked > MAX_QUESTIONS:
            why = "it makes too many comparisons: perhaps a loop that ends only for numbers"
            raise Untraceable(why)
        if condition in self.known:
            return self.known[condition]
        answer = self.prefix[len(self.taken)][1] if len(self.taken) < len(self.prefix) else True
        self.taken.append((condition, answer))
        self.known |= {condition: answer, sp.Not(condition): not answer}
        return answer


_PATH: contextvars.ContextVar[_Path] = contextvars.ContextVar("path")


class Quantity:
    """Quantity(expression): stands for a number in a traced function; arithmetic, no value."""

    __array_ufunc__ = None  # so that np.float64(2.0) * quantity is left to us
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, e: sp.Expr):
        self.e = e

    def __bool__(self) -> bool:
        return bool(Condition(sp.Ne(self.e, 0)))

    def __neg__(self) -> Quantity:
        return Quantity(-self.e)

    def __pos__(self) -> Quantity:
        return Quantity(self.e)

    def __abs__(self) -> Quantity:
        return Quantity(sp.Abs(self.e))

    def __float__(self) -> float:
        raise Untraceable("it hands a symbol to a function that takes only numbers")

    def __round__(self, digits: object = None) -> float:
        raise Untraceable("`round` takes halves to even numbers; floor(x + 0.5) is a formula")

    def __repr__(self) -> str:
        return str(self.e)


class Condition(Quantity):
    """A comparison.

    True and False as 1 and 0 in arithmetic, a fork of the path where its truth is asked.
    """

    def __init__(self, condition: Any):
        self.condition = sp.sympify(condition)

    @property
    def e(self) -> sp.Expr:  # type: ignore[override]
        return sp.Piecewise((1, self.condition), (0, True))

    def __bool__(self) -> bool:
        if self.condition in (sp.true, sp.false):
            return bool(self.condition)
        return _PATH.get().decide(self.condition)

    def __and__(self, other: object) -> Condition:
        return Condition(sp.And(self.condition, _condition(other)))

    def __or__(self, other: object) -> Condition:
        return Condition(sp.Or(self.condition, _condition(other)))

    def __invert__(self) -> Condition:
        return Condition(sp.Not(self.condition))

    __rand__, __ror__ = __and__, __or__


def _condition(value: object) -> Any:
    return value.condition if isinstance(value, Condition) else sp.Ne(expression(value), 0)


def _operator(function: Callable, kind: type = Quantity, swapped: bool = False) -> Callable:
    def call(self: Quantity, other: object) -> Any:
        try:
            there = expression(other)
        except TypeError:
            return NotImplemented
        return kind(function(there, self.e) if swapped else function(self.e, there))

    return call


_ARITHMETIC = {
    **{name: getattr(operator, name) for name in ("add", "sub", "mul", "truediv", "pow")},
    "mod": lambda a, b: sp.Mod(a, b),
    "floordiv": lambda a, b: sp.floor(a / b),
}
for _name, _function in _ARITHMETIC.items():
    setattr(Quantity, f"__{_name}__", _operator(_function))
    setattr(Quantity, f"__r{_name}__", _operator(_function, swapped=True))
for _name in ("Lt", "Le", "Gt", "Ge", "Eq", "Ne"):
    setattr(Quantity, f"__{_name.lower()}__", _operator(getattr(sp, _name), Condition))


def _numbers(values: tuple) -> Iterator[sp.Expr]:
    """max(a, b) and max([a, b]) alike."""
    alone = len(values) == 1 and isinstance(values[0], Iterable)
    return map(expression, values[0] if alone else values)


def _copysign(x: sp.Expr, y: sp.Expr) -> sp.Expr:
    return sp.Piecewise((sp.Abs(x), y >= 0), (-sp.Abs(x), True))


def _trunc(x: sp.Expr) -> sp.Expr:
    return sp.sign(x) * sp.floor(sp.Abs(x))


def _interp(x: sp.Expr, xs: Any, ys: Any) -> sp.Expr:
    """numpy.interp: straight lines between break points, constant beyond the outer ones."""
    xs, ys = [expression(v) for v in xs], [expression(v) for v in ys]
    lines = [
        (ys[i] + (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]) * (x - xs[i]), x <= xs[i + 1])
        for i in range(len(xs) - 1)
    ]
    return sp.Piecewise((ys[0], x <= xs[0]), *lines, (ys[-1], True))


# What becomes what, by name in builtins, math and numpy. Functions of plain numbers stay what they
# are: see _lift.
_ANGLES = ("sin", "cos", "tan", "sinh", "cosh", "tanh")
_ELEMENTARY: dict[str, Callable] = {
    **{
        name: getattr(sp, name)
        for name in (*_ANGLES, "sqrt", "exp", "floor", "erf", "gamma", "sign")
    },
    **{f"{a}{name}": getattr(sp, f"a{name}") for a in ("a", "arc") for name in _ANGLES},
    **dict.fromkeys(("atan2", "arctan2"), sp.atan2),
    **dict.fromkeys(("abs", "fabs", "absolute"), sp.Abs),
    **dict.fromkeys(("pow", "power", "float_power"), lambda a, b: a**b),
    # NumPy's; math.remainder is another function and stays untraceable
    **dict.fromkeys(("mod", "remainder"), sp.Mod),
    "fmod": lambda a, b: a - b * _trunc(a / b),
    **dict.fromkeys(("trunc", "fix", "int"), _trunc),
    **dict.fromkeys(("float", "float64"), lambda x: x),
    **dict.fromkeys(("maximum", "fmax"), sp.Max),
    **dict.fromkeys(("minimum", "fmin"), sp.Min),
    "log": lambda x, base=sp.E: sp.log(x) if base == sp.E else sp.log(x) / sp.log(base),
    "log2": lambda x: sp.log(x) / sp.log(2),
    "log10": lambda x: sp.log(x) / sp.log(10),
    "log1p": lambda x: sp.log(1 + x),
    "expm1": lambda x: sp.exp(x) - 1,
    "exp2": lambda x: 2**x,
    "ceil": sp.ceiling,
    "cbrt": lambda x: sp.sign(x) * sp.Abs(x) ** sp.Rational(1, 3),
    "square": lambda x: x**2,
    "hypot": lambda *x: sp.sqrt(sum(v**2 for v in x)),
    "copysign": _copysign,
    "heaviside": lambda x, middle: sp.Piecewise((0, x < 0), (middle, sp.Eq(x, 0)), (1, True)),
    **dict.fromkeys(("degrees", "rad2deg"), lambda x: x * 180 / sp.pi),
    **dict.fromkeys(("radians", "deg2rad"), lambda x: x * sp.pi / 180),
    "clip": lambda x, low, high: sp.Min(sp.Max(x, low), high),
}
_SPECIAL: dict[str, Callable] = {
    "max": lambda *x: Quantity(sp.Max(*_numbers(x))),
    "min": lambda *x: Quantity(sp.Min(*_numbers(x))),
    "fsum": sum,
    "bool": lambda x: x if isinstance(x, Condition) else x != 0,
    "where": lambda c, a, b: Quantity(
        sp.Piecewise((expression(a), _condition(c)), (expression(b), True))
    ),
    "logical_and": lambda a, b: Condition(sp.And(_condition(a), _condition(b))),
    "logical_or": lambda a, b: Condition(sp.Or(_condition(a), _condition(b))),
    "logical_not": lambda a: Condition(sp.Not(_condition(a))),
    "interp": lambda x, xs, ys: Quantity(_interp(expression(x), xs, ys)),
}


def _symbolic(value: object) -> bool:
    return isinstance(value, Quantity) or (
        isinstance(value, tuple | list) and any(map(_symbolic, value))
    )


def _lift(original: Callable, symbolic: Callable) -> Callable:
    """Plain numbers go to the original: a constant stays the float that the model computes with."""

    @functools.wraps(original, updated=())
    def call(*args: Any, **kwargs: Any) -> Any:
        return symbolic(*args, **kwargs) if any(map(_symbolic, args)) else original(*args, **kwargs)

    return call


def _table() -> dict[Any, Callable]:
    elementary = {
        name: lambda *args, f=function: Quantity(f(*map(expression, args)))
        for name, function in _ELEMENTARY.items()
    }
    return {
        original: _lift(original, symbolic)
        for module in (builtins, math, np)
        for name, symbolic in (elementary | _SPECIAL).items()
        if (original := getattr(module, name, math.remainder)) is not math.remainder
    }


class _Module:
    """A module as seen by a traced function: every attribute is rebound when it is read."""

    def __init__(self, module: types.ModuleType, tracer: Tracer):
        self._module, self._tracer = module, tracer

    def __getattr__(self, name: str) -> Any:
        return self._tracer.rebind(getattr(self._module, name), name)


@dataclass(frozen=True)
class Definition:
    """A helper with cases of its own, shown under its name.

    F(V) = { …. `args` mixes formal symbols and fixed numbers.
    """

    name: str
    function: Any  # the SymPy function that stands for it in an expression
    args: tuple[sp.Expr, ...]
    formals: tuple[sp.Symbol, ...]
    e: sp.Expr


class Tracer:
    """Tracer(states).trace(f, t, s, p): formulas of functions; helpers with cases are collected in
    `definitions`.

    `states` (symbols) are shown as the arguments of a helper that takes s as a whole: F(s, p) that
    reads s.V is F(V).
    """

    def __init__(self, states: Iterable[sp.Symbol] = ()) -> None:
        self.states = tuple(states)
        self.definitions: dict[str, Definition] = {}
        # id -> (the original, kept alive, and its stand-in)
        self._copies: dict[int, tuple[Any, Callable]] = {}
        # Formal arguments by helper and name; what helpers give for them, each walked only once
        self._formals: dict[tuple[Callable, str], sp.Dummy] = {}
        self._values: dict[tuple, Any] = {}
        self._table = _table()

    def trace(self, function: Callable, *args: Any) -> sp.Expr | tuple[sp.Expr, ...]:
        """tracer.trace(flow, t, s, p) -> expression or tuple of expressions.

        Raises Untraceable with the reason.
        """
        try:
            copy = self.rebind(function, inline=True)
            with distribute(False):  # 2*(x - a) stays as it was written
                return _explore(lambda: copy(*args))
        except Untraceable:
            raise
        except RecursionError:
            raise Untraceable("it calls itself without end") from None
        except Exception as error:  # whatever a student's function may raise on a symbol
            raise Untraceable(f"{type(error).__name__}: {error}") from error

    def expand(self, e: sp.Expr) -> sp.Expr:
        """tracer.expand(e) -> e with every named helper replaced by its definition."""
        while nodes := [
            node for node in e.atoms(AppliedUndef) if node.func.__name__ in self.definitions
        ]:
            e = e.xreplace({node: self._body(node) for node in nodes})
        return e

    def _body(self, node: AppliedUndef) -> sp.Expr:
        definition = self.definitions[node.func.__name__]
        put = dict(zip(definition.formals, node.args, strict=True))
        if not isinstance(definition.e, sp.Piecewise):
            return definition.e.xreplace(put)
        cases = []  # but for what these arguments rule out: it may have no value, 0/0
        for value, condition in definition.e.args:
            condition = condition.xreplace(put)
            if condition is not sp.false:
                cases.append((value.xreplace(put), condition))
            if condition is sp.true:
                break
        return sp.Piecewise(*cases)

    def rebind(self, value: Any, name: str = "", inline: bool = False) -> Any:
        """tracer.rebind(value) -> what a traced function sees in its place.

        Constants are themselves.
        """
        value = getattr(value, "py_func", value)  # a helper under @njit
        if isinstance(value, types.ModuleType):
            return _Module(value, self)
        if isinstance(value, functools.partial):
            inner = self.rebind(value.func, name, inline)
            return functools.partial(inner, *value.args, **value.keywords)
        if isinstance(value, types.FunctionType):
            if inline:
                return rebound(value, self.rebind, self._copies)
            return self._helper(value, name)
        try:
            return self._table.get(value, value)
        except TypeError:  # unhashable: a list, an array
            return value

    def _helper(self, function: types.FunctionType, name: str) -> Callable:
        """A helper is traced with formal arguments.

        One with cases becomes a definition, any other is put in place.
        """
        label = (function.__name__ if function.__name__ != "<lambda>" else name) or "f"

        def call(*args: Any, **kwargs: Any) -> Any:
            copy = self.rebind(function, inline=True)
            if any(map(_symbolic, (*args, *kwargs.values()))):
                # else no numbers come out, or it needs to know its caller's path
                with suppress(Untraceable, TypeError, ValueError):
                    return self._define(label, function, copy, args, kwargs)
            return copy(*args, **kwargs)

        return call

    def _define(
        self, label: str, function: types.FunctionType, copy: Callable, args: tuple, kwargs: dict
    ) -> Any:
        bound = inspect.signature(function).bind(*args, **kwargs)
        bound.apply_defaults()
        shown: list[sp.Expr] = []
        actual: dict[sp.Symbol, sp.Expr] = {}
        for key, value in bound.arguments.items():
            if isinstance(value, Quantity) and not isinstance(value, Condition):
                formal = self._formals.setdefault((copy, key), sp.Dummy(key, real=True))
                actual[formal] = value.e
                shown.append(formal)
                bound.arguments[key] = Quantity(formal)
            elif isinstance(value, Real):
                shown.append(expression(value))
        steady = _steady(function, set()) or object()
        called = (label, copy, steady, *map(_identity, bound.arguments.values()))
        if called not in self._values:
            value = _explore(lambda: copy(*bound.args, **bound.kwargs))
            if isinstance(value, sp.Expr) and value.has(sp.Piecewise):
                value = self._named(label, shown, list(actual), value)
            self._values[called] = value
        value = self._values[called]
        if isinstance(value, tuple):
            return tuple(Quantity(e.xreplace(actual)) for e in value)
        return Quantity(value.xreplace(actual))

    def _named(
        self, label: str, shown: list[sp.Expr], formals: list[sp.Symbol], e: sp.Expr
    ) -> sp.Expr:
        """F(V) in the place of its cases, which become a definition unless there is one already."""
        symbols = e.free_symbols
        if not shown:  # F(s, p): show what it depends on
            formals = shown = [x for x in self.states if x in symbols]
        # A formal argument is shown under its own name, unless the body also speaks of the state of
        # that name.
        names = {symbol.name for symbol in symbols if symbol not in formals}
        rename = {
            f: sp.Symbol(f.name, real=True)
            for f in formals
            if isinstance(f, sp.Dummy) and f.name not in names
        }
        args, e = tuple(rename.get(x, x) for x in shown), e.xreplace(rename)
        alike = [d for d in self.definitions.values() if (d.name, d.args) == (label, args)]
        for definition in alike:
            if definition.e == e:
                return definition.function(*formals)
        key = label + "′" * len(alike)
        while key in self.definitions:
            key += "_"
        made = sp.Function(key, real=True)
        own = tuple(rename.get(f, f) for f in formals)
        self.definitions[key] = Definition(label, made, args, own, e)
        return made(*formals)


def _identity(value: Any) -> Any:
    """What a helper's value depends on: equal for arguments of one kind, whatever their objects.

    What may have changed since, an object's attributes or a list's items, is equal to nothing.
    """
    if isinstance(value, Quantity):
        return value.condition if isinstance(value, Condition) else value.e
    if isinstance(value, tuple):
        return type(value), *map(_identity, value)
    known = value is None or isinstance(value, Number | str)
    return (type(value), value) if known else object()


_FIXED = (Number, str, types.NoneType, types.ModuleType, types.BuiltinFunctionType, np.ufunc, type)


def _steady(value: Any, seen: set[int]) -> bool:
    """Whether it is the same whenever it is read; a function: also all that it reads."""
    value = getattr(value, "py_func", value)
    if isinstance(value, tuple):
        return all(_steady(one, seen) for one in value)
    if not isinstance(value, types.FunctionType) or id(value) in seen:
        return id(value) in seen or isinstance(value, _FIXED)
    seen.add(id(value))
    scope = value.__globals__
    read = [scope[name] for name in names_in(value.__code__) if name in scope]
    with suppress(ValueError):  # a variable that has no value yet
        read += [cell.cell_contents for cell in value.__closure__ or ()]
    return all(_steady(one, seen) for one in (*read, *(value.__defaults__ or ())))


def _explore(call: Callable[[], Any]) -> sp.Expr | tuple[sp.Expr, ...]:
    """Call along every path, True before False; a Piecewise (a component) of what came out."""
    leaves: list[tuple[Any, list]] = []
    waiting: list[list[tuple[Any, bool]]] = [[]]
    while waiting:
        path = _Path(waiting.pop())
        token = _PATH.set(path)
        try:
            leaf = _leaf(call())
        finally:
            _PATH.reset(token)
        leaves.append((leaf, [condition for condition, answer in path.taken if answer]))
        # From the first to the last new question: the last one's other answer is next
        new = range(len(path.prefix), len(path.taken))
        waiting += [[*path.taken[:k], (path.taken[k][0], False)] for k in new]
        if len(leaves) + len(waiting) > MAX_PATHS:
            raise Untraceable(f"it has more than {MAX_PATHS} branches")
    # The first match counts, so what was answered with False needs no mention: those cases have
    # come before.
    cases = [(leaf, sp.And(*true)) for leaf, true in leaves]
    if not any(isinstance(leaf, tuple) for leaf, _ in cases):
        return _piecewise(cases)
    if len({len(leaf) if isinstance(leaf, tuple) else -1 for leaf, _ in cases}) > 1:
        raise Untraceable("its branches return different numbers of values")
    return tuple(_piecewise([(leaf[k], c) for leaf, c in cases]) for k in range(len(cases[0][0])))


def _leaf(value: Any) -> sp.Expr | tuple[sp.Expr, ...]:
    if isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.ndim):
        return tuple(expression(v) for v in value)
    if value is None:
        raise Untraceable("it returns nothing (is a `return` missing?)")
    if isinstance(value, bool | Condition):
        raise Untraceable("it returns true or false, not a number")
    return expression(value)


def _piecewise(cases: list[tuple[sp.Expr, Any]]) -> sp.Expr:
    """First match counts: a case that repeats the next joins it, the last has no condition."""
    joined: list[tuple[sp.Expr, Any]] = []
    for e, condition in cases:
        if joined and joined[-1][0] == e:
            condition = sp.Or(joined.pop()[1], condition)
        joined.append((e, condition))
    return joined[0][0] if len(joined) == 1 else sp.Piecewise(*joined[:-1], (joined[-1][0], True))
