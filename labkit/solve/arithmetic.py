"""Arithmetic of pieces as Python does it: whole numbers that must not wrap, failures, powers.

What is known is computed by Python itself. `Arithmetic` is the part of a `Body` (translate.py) that
knows no syntax but the operators.
"""

from __future__ import annotations

import ast
import math
import operator
import types
from typing import TYPE_CHECKING, Any

import numpy as np

from .kinds import EXACT, FLOAT, LARGE, OF_NUMPY, TRUTH, Const, Number, Other, Table, Unfit, number
from .pieces import Piece, as_float, is_table, literal, short

if TYPE_CHECKING:
    from .source import Program

__all__ = ["Arithmetic", "Folding"]

_BINARY = {
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

    def known(self, value: Any) -> Piece:
        """The piece of a known value; tables and functions get a name when they are used."""
        return literal(value), Const(value)

    def failure(self) -> Piece:
        """What Python cannot compute at all: an index beyond a known table."""
        self.fails = True
        return "do_trunc(nan)", FLOAT

    def _table(self, piece: Piece) -> Piece | None:
        """A table of numbers under a name of its own."""
        text, kind = piece
        if isinstance(kind, Table):
            return piece
        if not isinstance(kind, Const) or not isinstance(kind.value, list | tuple | np.ndarray):
            return None
        return self.program.table(kind.value)

    def _folding(self, node: ast.AST) -> Folding:
        return Folding(self, node)

    def binary(self, node: ast.AST, op: type, left: Piece, right: Piece) -> Piece:
        """left op right: Python's own value where both are known."""
        sign, compute = _BINARY[op]
        (a, one), (b, two) = left, right
        if (
            isinstance(one, Const)
            and isinstance(two, Const)
            and not _huge(op, one.value, two.value)
        ):
            try:
                with np.errstate(all="ignore"):
                    return self.known(compute(one.value, two.value))
            except ArithmeticError:
                return self.failure()
            except (TypeError, ValueError) as error:
                raise self.no(node, f"is not compiled: {short(node)}: {error}") from None
        if any(isinstance(kind, Other | Table) or is_table(kind) for kind in (one, two)):
            a, b = (self._table(piece) or piece for piece in (left, right))
            return f"({a[0]} {sign} {b[0]})", Other()
        x, y = number(one), number(two)
        if x is None or y is None or op in (ast.MatMult, ast.LShift, ast.RShift):
            raise self.no(node, f"is not compiled: {short(node)}")
        if op is ast.Pow:
            return self._power(node, left, right)
        if op in (ast.BitAnd, ast.BitOr, ast.BitXor):
            if not (x.truth and y.truth):
                raise self.no(node, f"is not compiled: {short(node)}")
            return f"({a} {sign} {b})", TRUTH
        numpy = x.numpy or y.numpy
        if op is ast.Div and numpy and not (isinstance(two, Const) and two.value != 0):
            return f"do_division({self._float(left)}, {self._float(right)})", OF_NUMPY
        if op in (ast.Div, ast.FloorDiv, ast.Mod) and not (
            isinstance(two, Const) and two.value != 0
        ):
            self.fails = True
        if x.bound is None or y.bound is None:  # no whole numbers among themselves
            return f"({self._in_float(left)} {sign} {self._in_float(right)})", Number(
                True, numpy=numpy
            )
        if op in (ast.FloorDiv, ast.Mod):
            self._every_digit(x, node)
            self._every_digit(y, node)
            self._own_rules(node, x, y)
        bound = {
            ast.Add: x.bound + y.bound,
            ast.Sub: x.bound + y.bound,
            ast.Mult: x.bound * y.bound,
            ast.Div: None,
            ast.FloorDiv: x.bound,
            ast.Mod: y.bound,
        }[op]
        self._not_larger(bound, node)
        floating = bound is None or x.floating or y.floating
        kind = Number(floating, bound, numpy)
        return f"({self._float(left)} {sign} {self._float(right)})", kind

    def _power(self, node: ast.AST, left: Piece, right: Piece) -> Piece:
        self.fails = True
        x, y = number(left[1]), number(right[1])
        exponent = right[1].value if isinstance(right[1], Const) else None
        bound = None
        if x.bound is not None and y.bound is not None:
            self._own_rules(node, x, y)
            bound = 1.0 if x.bound <= 1 else _grown(x.bound, y.bound)
            self._not_larger(bound, node)
        floating = x.floating or y.floating or exponent is None or exponent < 0
        numpy = x.numpy or y.numpy
        kind = Number(floating or bound is None, bound, numpy)
        if numpy:
            return f"do_numpy_power({self._float(left)}, {self._float(right)})", kind
        if exponent == 2:
            return f"do_square({self._float(left)})", kind
        return f"do_power({self._float(left)}, {self._float(right)})", kind

    def _not_larger(self, bound: float | None, node: ast.AST) -> None:
        if bound is not None and bound > LARGE:
            raise self.no(
                node,
                f"has whole numbers that may grow beyond 2**63, {short(node)}: "
                "make one of them a float",
            )

    def _every_digit(self, kind: Number, node: ast.AST) -> None:
        if kind.bound is not None and kind.bound > EXACT:
            raise self.no(
                node, f"has whole numbers beyond 2**53 of which every digit counts: {short(node)}"
            )

    def _own_rules(self, node: ast.AST, x: Number, y: Number) -> None:
        if x.numpy or y.numpy:
            raise self.no(
                node,
                f"reckons with NumPy's whole numbers, which have rules of their own: {short(node)}",
            )

    def _float(self, piece: Piece) -> str:
        """The piece as a float."""
        return as_float(piece)

    def _in_float(self, piece: Piece) -> str:
        """The piece beside a float, which makes it one where it must."""
        text, kind = piece
        return self._float(piece) if number(kind).bound == 1.0 else text


class Folding:
    """with body._folding(node): errors while known values are computed become Unfit."""

    def __init__(self, body: Arithmetic, node: ast.AST):
        self.body, self.node = body, node

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, TypeError | ValueError | ArithmeticError):
            raise self.body.no(self.node, f"is not compiled: {short(self.node)}: {error}") from None


def _grown(base: float, exponent: float) -> float:
    return base**exponent if exponent * math.log2(base) < 1000 else math.inf


def _huge(op: type, a: Any, b: Any) -> bool:
    """Would Python compute for ever, or fill the memory?"""
    whole = isinstance(a, int) and isinstance(b, int)
    if whole and op is ast.Pow:
        return abs(a) > 1 and b > 0 and a.bit_length() * b > 100_000
    return op is ast.LShift and whole and b > 100_000
