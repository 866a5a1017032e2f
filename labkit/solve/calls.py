"""Calls in a model function: helpers of the model, functions of Python, of math and of NumPy.

underlying(f), bind(f, pieces, named, default)      what is called, and with what
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import sys
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from .checked import OF_MATH
from .expressions import Expressions
from .kinds import FLOAT, MADE, OF_NUMPY, TRUTH, Const, Number, Other, Record, Unfit, number
from .pieces import Piece, literal, short

__all__ = ["Calls", "bind", "underlying"]

_PURE = (abs, bool, divmod, float, int, len, list, max, min, pow, round, sorted, sum, tuple)
_ROUND = {
    int: "do_trunc",
    math.trunc: "do_trunc",
    math.floor: "do_floor",
    math.ceil: "do_ceil",
    round: "do_rint",
}
_TRUTHS = (math.isnan, math.isinf, math.isfinite)
_PLACES = ("argmax", "argmin", "searchsorted", "digitize")  # of NumPy: they give an index
_METHODS = (
    "all",
    "any",
    "argmax",
    "argmin",
    "item",
    "max",
    "mean",
    "min",
    "sum",
)


class Calls(Expressions):
    """The part of a Body (translate.py) that translates calls."""

    def _of_Call(self, node: ast.Call) -> Piece:
        text, kind = self.visit(node.func)
        if isinstance(kind, Other):  # a method of an array made here
            arguments = [self._argument(self.visit(each)) for each in node.args]
            if node.keywords:
                raise self.no(node, f"is not compiled: {short(node)}")
            return f"{text}({', '.join(arguments)})", kind
        if not isinstance(kind, Const):
            raise self.no(node, f"calls what is no function: {short(node)}")
        pieces = self.elements(ast.Tuple(node.args))
        named = {each.arg: self.visit(each.value) for each in node.keywords}
        if None in named:
            raise self.no(node, f"is not compiled: {short(node)}")
        return self._call(node, kind.value, pieces, named)

    def _call(
        self, node: ast.Call, function: Any, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        if not _hashable(function):
            raise self.no(node, f"calls what is no function: {short(node)}")
        of_numpy = _of_numpy(function)
        inner, first, words = underlying(function)
        module = (getattr(inner, "__module__", None) or "").split(".")[0]
        if inner is not None and not of_numpy and module not in sys.stdlib_module_names:
            pieces = [*map(self.known, first), *pieces]
            named = {**{key: self.known(value) for key, value in words.items()}, **named}
            return self.program.helper(self, node, inner, pieces, named)
        pure = function in _PURE or (
            isinstance(getattr(function, "__self__", None), np.ndarray)
            and function.__name__ in _METHODS
        )
        name = OF_MATH.get(function)
        of_math = getattr(function, "__module__", None) == "math"
        if (pure or of_math or of_numpy) and all(
            isinstance(kind, Const) for _, kind in (*pieces, *named.values())
        ):
            return self._folded(node, function, pieces, named)
        if of_numpy:
            return self._numpy(function, pieces, named)
        numbers = [number(kind) for _, kind in pieces]
        if not named and None not in numbers:
            if name is not None:
                self.fails = True
                return f"{name}({', '.join(map(self._float, pieces))})", FLOAT
            if function in _ROUND and len(pieces) == 1:
                return self._whole(function, pieces[0])
            if function in _TRUTHS:
                return f"{self.program.name(function)}({self._float(pieces[0])})", TRUTH
            if function in (float, np.float64) and len(pieces) == 1:
                return self._float(pieces[0]), FLOAT
            if function is bool and len(pieces) == 1:
                return f"({pieces[0][0]} != 0)", TRUTH
            if function is abs and len(pieces) == 1:
                return f"abs({self._float(pieces[0])})", numbers[0].counted()
            if function is pow and len(pieces) == 2:
                return self.binary(node, ast.Pow, *pieces)
        if function in (min, max) and not named:
            return self._extreme(node, function, pieces)
        if function is len and len(pieces) == 1 and (found := self.items(pieces[0])) is not None:
            return self.known(len(found))
        raise self.no(node, f"calls {_called(function)}, which is not compiled")

    def _folded(
        self, node: ast.AST, function: Callable, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        values = [kind.value for _, kind in pieces]
        words = {key: kind.value for key, (_, kind) in named.items()}
        try:
            with np.errstate(all="ignore"):
                return self.known(function(*values, **words))
        except OverflowError:
            return (literal(math.inf), FLOAT) if function in OF_MATH else self.failure()
        except (ArithmeticError, ValueError, LookupError):
            return self.failure()
        except TypeError as error:
            raise self.no(node, f"is not compiled: {short(node)}: {error}") from None

    def _whole(self, function: Callable, piece: Piece) -> Piece:
        kind = number(piece[1])
        if not kind.floating:
            return self._float(piece), Number(False, kind.bound)
        self.fails = True
        return f"{_ROUND[function]}({self._float(piece)})", Number(
            False, max(MADE, kind.bound or 0.0)
        )

    def _extreme(self, node: ast.AST, function: Callable, pieces: list[Piece]) -> Piece:
        if len(pieces) == 1:
            pieces = self.items(pieces[0]) or []
        kinds = [number(kind) for _, kind in pieces]
        if not kinds or None in kinds:
            raise self.no(node, f"calls {function.__name__} of what is not compiled: {short(node)}")
        bounds = [kind.bound for kind in kinds if kind.bound is not None]
        kind = Number(
            any(k.floating for k in kinds), max(bounds, default=None), any(k.numpy for k in kinds)
        )
        text = self._float(pieces[0])
        for piece in pieces[1:]:  # two at a time, as Python compares them
            text = f"{function.__name__}({text}, {self._float(piece)})"
        return text, kind

    def _numpy(self, function: Callable, pieces: list[Piece], named: dict[str, Piece]) -> Piece:
        arguments = [self._argument(piece) for piece in pieces]
        arguments += [f"{key}={self._argument(piece)}" for key, piece in named.items()]
        text = f"{self.program.name(function)}({', '.join(arguments)})"
        numbers = [number(kind) is not None for _, kind in pieces]
        if isinstance(function, np.ufunc) and all(numbers) or function is np.interp and numbers[0]:
            return text, OF_NUMPY
        if function.__name__ in _PLACES:
            return text, Number(False, 2.0**31, True)
        return text, Other()

    def _argument(self, piece: Piece) -> str:
        """The piece as NumPy's functions take it; whole numbers as they are."""
        table = self._table(piece)
        if table is not None:
            return table[0]
        if isinstance(piece[1], Const) and number(piece[1]) is None and piece[1].value is not None:
            raise Unfit(
                f"{self.what} hands a {type(piece[1].value).__name__} to a function of NumPy"
            )
        if isinstance(piece[1], Record):
            return f"({', '.join(piece[1].texts())},)"
        return piece[0]


def underlying(function: Any) -> tuple[types.FunctionType | None, tuple, dict]:
    """underlying(partial(f, 2.0)) -> (f, (2.0,), {}), also of methods and objects that can be
    called; (None, (), {}) of others.
    """
    function = getattr(function, "py_func", function)  # a helper under @njit
    if isinstance(function, types.FunctionType):
        return function, (), {}
    if isinstance(function, functools.partial):
        inner, first, words = underlying(function.func)
        return inner, (*first, *function.args), {**words, **function.keywords}
    if isinstance(function, types.MethodType):
        inner, first, words = underlying(function.__func__)
        return inner, (function.__self__, *first), words
    kinds = [vars(kind) for kind in type(function).__mro__]
    call = next((kind["__call__"] for kind in kinds if "__call__" in kind), None)
    if isinstance(call, types.FunctionType):
        return call, (function,), {}
    return None, (), {}


def bind(
    function: types.FunctionType, pieces: list[Any], named: dict[str, Any], default: Callable
) -> dict[str, Any]:
    """bind(f, pieces, named, default) -> argument -> piece; default(name, value) makes the
    others' pieces.
    """
    signature = inspect.signature(function)
    bound = signature.bind(*pieces, **named)
    for name, parameter in signature.parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise TypeError(f"it takes *{name}")
    return {
        name: bound.arguments[name] if name in bound.arguments else default(name, parameter.default)
        for name, parameter in signature.parameters.items()
    }


def _of_numpy(function: Any) -> bool:
    if isinstance(function, np.ufunc):
        return True
    module = getattr(function, "__module__", None) or ""
    random = module.startswith("numpy.random")
    return (
        callable(function)
        and not isinstance(function, type)
        and module.split(".")[0] == "numpy"
        and not random
    )


def _hashable(value: Any) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True


def _called(function: Any) -> str:
    name = (
        getattr(function, "__qualname__", None)
        or getattr(function, "__name__", None)
        or repr(function)
    )
    module = getattr(function, "__module__", None) or ""
    return name if module in ("builtins", "") else f"{module}.{name}"
