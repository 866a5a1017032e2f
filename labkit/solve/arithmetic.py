"""Arithmetic of pieces as Python does it: whole numbers that must not wrap, failures, powers.

What is known is computed by Python itself. `Arithmetic` is the part of a `Body` (translate.py) that
knows no syntax but the operators.
"""

from __future__ import annotations

import ast
import math
import operator
import types
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .kinds import (
    EXACT,
    FLOAT,
    OF_NUMPY,
    Const,
    Number,
    Other,
    Record,
    Table,
    Unfit,
    number,
    of_numpy,
)
from .pieces import Piece, as_float, known, short
from .plain import INFINITE

if TYPE_CHECKING:
    from .source import Program

__all__ = ["BINARY", "Arithmetic"]

BINARY = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.FloorDiv: ("//", operator.floordiv),
    ast.Mod: ("%", operator.mod),
    ast.Pow: ("**", operator.pow),
    ast.MatMult: ("@", operator.matmul),
    ast.BitAnd: ("&", operator.and_),
    ast.BitOr: ("|", operator.or_),
    ast.BitXor: ("^", operator.xor),
    ast.LShift: ("<<", operator.lshift),
    ast.RShift: (">>", operator.rshift),
}


class Arithmetic:
    """What every part of a Body needs, and `binary(node, op, left, right)`."""

    program: Program
    function: types.FunctionType
    what: str
    fails: bool

    def no(self, node: ast.AST, why: str) -> Unfit:
        line = f" (line {node.lineno})" if hasattr(node, "lineno") else ""
        return Unfit(f"{self.what}{line} {why}")

    def failure(self) -> Piece:
        """What Python cannot compute at all: an index beyond a known table."""
        self.fails = True
        return "do_trunc(nan)", FLOAT

    def computed(self, node: ast.AST, function: Callable, *values: Any, **words: Any) -> Piece:
        """What Python makes of known values; where it fails, so does the model's function."""
        builtin = isinstance(function, types.BuiltinFunctionType)
        try:
            with np.errstate(all="ignore"):
                found = (INFINITE.get(function, function) if builtin else function)(
                    *values, **words
                )
            alone = isinstance(found, np.ndarray) and not found.ndim
            return known(found[()] if alone else found)
        except (ArithmeticError, ValueError, LookupError):
            return self.failure()
        except TypeError as error:
            raise self.no(node, f"is not compiled: {short(node)}: {error}") from None

    def _table(self, piece: Piece) -> Piece | None:
        """A table of numbers under a name of its own."""
        _, kind = piece
        if isinstance(kind, Table):
            return piece
        if not isinstance(kind, Const) or not isinstance(kind.value, list | tuple | np.ndarray):
            return None
        return self.program.table(kind.value)

    def _argument(self, node: ast.AST, piece: Piece) -> str:
        """The piece as NumPy takes it; whole numbers as they are."""
        if (table := self._table(piece)) is not None:
            return table[0]
        text, kind = piece
        if isinstance(kind, Const) and number(kind) is None and kind.value is not None:
            raise self.no(node, f"hands a {type(kind.value).__name__} to NumPy")
        return f"({', '.join(kind.texts())},)" if isinstance(kind, Record) else text

    def binary(self, node: ast.AST, op: type, left: Piece, right: Piece) -> Piece:
        """left op right: Python's own value where both are known."""
        sign, compute = BINARY[op]
        one, two = left[1], right[1]
        fixed = isinstance(one, Const) and isinstance(two, Const)
        if fixed and not _huge(op, one.value, two.value):
            return self.computed(node, compute, one.value, two.value)
        if _array(one) or _array(two):
            a, b = (self._argument(node, piece) for piece in (left, right))
            if op is ast.Div:  # by zero it is infinity, also where it is a single number
                return f"{self.program.name(np.divide)}({a}, {b})", Other()
            return f"({a} {sign} {b})", Other()
        x, y = number(one), number(two)
        if x is None or y is None or op in (ast.MatMult, ast.LShift, ast.RShift):
            raise self.no(node, f"is not compiled: {short(node)}")
        if op is ast.Pow:
            return self._power(node, left, right)
        if op in (ast.BitAnd, ast.BitOr, ast.BitXor):
            if not (x.truth and y.truth):
                raise self.no(node, f"is not compiled: {short(node)}")
            return f"({left[0]} {sign} {right[0]})", replace(x, numpy=of_numpy(x, y))
        numpy, safe = of_numpy(x, y), isinstance(two, Const) and two.value != 0
        if op is ast.Div and numpy and not safe:
            return f"do_division({as_float(left)}, {as_float(right)})", OF_NUMPY
        self.fails |= not safe and op in (ast.Div, ast.FloorDiv, ast.Mod)
        whole, digits = None not in (x.bound, y.bound), op in (ast.FloorDiv, ast.Mod)
        truths = whole and not (x.floating or y.floating) and max(x.bound, y.bound) <= 1
        if digits and (whole or not safe) or truths or op is ast.Div and not safe:
            self._own_rules(node, numpy)
        bound = None
        if whole:
            self._whole_as_float(node, left, right)
            bound = {
                ast.Add: x.bound + y.bound,
                ast.Sub: x.bound + y.bound,
                ast.Mult: x.bound * y.bound,
                ast.Div: None,
                ast.FloorDiv: x.bound,
                ast.Mod: y.bound,
            }[op]
        kind = Number(bound is None or x.floating or y.floating, bound, numpy)
        return self.exact(node, f"({as_float(left)} {sign} {as_float(right)})", kind)

    def _power(self, node: ast.AST, left: Piece, right: Piece) -> Piece:
        self.fails = True
        x, y = number(left[1]), number(right[1])
        exponent = right[1].value if isinstance(right[1], Const) else None
        bound = None
        if x.bound is not None and y.bound is not None:
            self._own_rules(node, of_numpy(x, y))
            self._whole_as_float(node, left, right)
            bound = 1.0 if x.bound <= 1 else _grown(x.bound, y.bound)
        floating = x.floating or y.floating or exponent is None or exponent < 0 or bound is None
        kind = Number(floating, bound, of_numpy(x, y))
        if exponent == 2 and not kind.numpy:
            return self.exact(node, f"do_square({as_float(left)})", kind)
        name = "do_numpy_power" if kind.numpy else "do_power"
        return self.exact(node, f"{name}({as_float(left)}, {as_float(right)})", kind)

    def exact(self, node: ast.AST, text: str, kind: Number) -> Piece:
        """A number just made: what is whole, or may be, is looked at if a float may not hold it.

        A whole zero has no sign.
        """
        if kind.bound is None or kind.bound <= EXACT:
            return (text if kind.floating else f"({text} + 0.0)"), kind
        self.fails = True
        why = f"has whole numbers beyond 2**53, {short(node)}: make one of them a float"
        place = self.program.place(str(self.no(node, why)))
        name = "exact_if_whole" if kind.floating else "exact"
        return f"{name}({text}, p, {place})", replace(kind, bound=EXACT)

    def _whole_as_float(self, node: ast.AST, *pieces: Piece) -> None:
        """Whole numbers that are reckoned with are ones which a float holds."""
        for _, kind in pieces:
            large = isinstance(kind, Number) and kind.bound is not None and kind.bound > EXACT
            if large or isinstance(kind, Const) and not _held(kind.value):
                raise self.no(node, f"has whole numbers beyond 2**53, {short(node)}")

    def _own_rules(self, node: ast.AST, numpy: bool | None) -> None:
        if numpy is not False:
            why = "reckons with what may be NumPy's numbers, which have rules of their own"
            raise self.no(node, f"{why}: {short(node)}")


def _array(kind: Any) -> bool:
    """Is it an array? Lists and tuples are not: times a number, they are repeated."""
    if isinstance(kind, Const):
        return isinstance(kind.value, np.ndarray)
    return isinstance(kind, Other) or isinstance(kind, Table) and kind.item.numpy


def _held(value: Any) -> bool:
    """Is the number one that a float holds?"""
    try:
        return not isinstance(value, int | np.int64) or float(value) == int(value)
    except OverflowError:
        return False


def _grown(base: float, exponent: float) -> float:
    return base**exponent if exponent * math.log2(base) < 1000 else math.inf


def _huge(op: type, a: Any, b: Any) -> bool:
    """Would Python compute for ever, or fill the memory?"""
    whole = isinstance(a, int) and isinstance(b, int)
    if whole and op is ast.Pow:
        return abs(a) > 1 and b > 0 and a.bit_length() * b > 100_000
    return op is ast.LShift and whole and b > 100_000
