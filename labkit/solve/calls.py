"""Calls in a model function: helpers of the model, functions of Python, of math and of NumPy."""

from __future__ import annotations

import ast
import functools
import inspect
import math
import sys
import types
from collections.abc import Callable, Hashable
from math import inf
from typing import Any

import numpy as np

from .checked import CHECKED, OF_MATH
from .expressions import Expressions
from .kinds import (
    FLOAT,
    NUMPYS_TRUTH,
    OF_NUMPY,
    TRUTH,
    Const,
    Number,
    Other,
    number,
)
from .pieces import Piece, as_float, known, short

__all__ = ["Calls", "underlying"]

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
_METHODS = ("all", "any", "argmax", "argmin", "item", "max", "mean", "min", "sum")


class Calls(Expressions):
    """The part of a Body (translate.py) that translates calls."""

    def _of_Call(self, node: ast.Call) -> Piece:
        text, kind = self.visit(node.func)
        if isinstance(kind, Other):  # a method of an array made here
            arguments = [self._argument(each, self.visit(each)) for each in node.args]
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
        if not callable(function):
            raise self.no(node, f"calls what is no function: {short(node)}")
        of_numpy, (inner, first, words) = _of_numpy(function), underlying(function)
        module = (getattr(inner, "__module__", None) or "").split(".")[0]
        if inner is not None and not of_numpy and module not in sys.stdlib_module_names:
            pieces = [*map(known, first), *pieces]
            named = {**{key: known(value) for key, value in words.items()}, **named}
            return self.program.helper(self, node, inner, pieces, named)
        if function is pow and len(pieces) == 2 and not named:
            return self.binary(node, ast.Pow, *pieces)
        method = getattr(function, "__name__", "") in _METHODS
        pure = method and isinstance(getattr(function, "__self__", None), np.ndarray)
        pure |= of_numpy or function in _PURE or getattr(function, "__module__", None) == "math"
        if pure and all(isinstance(kind, Const) for _, kind in (*pieces, *named.values())):
            values = {key: kind.value for key, (_, kind) in named.items()}
            return self.computed(node, function, *(kind.value for _, kind in pieces), **values)
        if of_numpy:
            return self._numpy(node, function, pieces, named)
        if not named and None not in [number(kind) for _, kind in pieces]:
            name, count = OF_MATH.get(function), len(pieces)
            if name is not None and count == CHECKED[name][1]:
                self.fails = True
                texts = [*map(as_float, pieces)]
                if function in (math.atan2, math.copysign):  # a whole zero has no sign
                    whole = [not number(kind).floating for _, kind in pieces]
                    texts = [f"({a} + 0.0)" if w else a for a, w in zip(texts, whole, strict=True)]
                return f"{name}({', '.join(texts)})", FLOAT
            if function is math.log and count == 2:  # as Python computes it
                one, two = (self._call(node, math.log, [piece], {}) for piece in pieces)
                return self.binary(node, ast.Div, one, two)
            if count == 1 and (found := self._of_one(node, function, pieces[0])):
                return found
        if function in (min, max) and not named:
            return self._extreme(node, function, pieces)
        if function is len and len(pieces) == 1 and (found := self.items(pieces[0])) is not None:
            return known(len(found))
        raise self.no(node, f"calls {_called(function)}, which is not compiled")

    def _of_one(self, node: ast.AST, function: Callable, piece: Piece) -> Piece | None:
        """A function of Python's or of math's of one number."""
        kind, text = number(piece[1]), as_float(piece)
        if function in _ROUND:
            if not kind.floating:
                return text, Number(False, kind.bound)
            self.fails = True
            return self.exact(node, f"{_ROUND[function]}({text})", Number(False, inf))
        if function in _TRUTHS:
            return f"{self.program.name(function)}({text})", TRUTH
        if function in (float, np.float64):
            return text, FLOAT if function is float else OF_NUMPY
        if function is bool:
            return f"({piece[0]} != 0)", TRUTH
        return (f"abs({text})", kind.counted()) if function is abs else None

    def _extreme(self, node: ast.AST, function: Callable, pieces: list[Piece]) -> Piece:
        if len(pieces) == 1:
            pieces = self.items(pieces[0]) or []
        kind = self.joined(pieces)
        if kind is None:
            raise self.no(node, f"calls {function.__name__} of what is not compiled: {short(node)}")
        text = as_float(pieces[0])
        for piece in pieces[1:]:  # two at a time, as Python compares them
            text = f"{function.__name__}({text}, {as_float(piece)})"
        return text, kind

    def _numpy(
        self, node: ast.AST, function: Callable, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        if function is np.clip and len(pieces) == 3 and self.joined(pieces):
            inner = self._numpy(node, np.maximum, pieces[:2], {})  # Numba clips arrays only
            return self._numpy(node, np.minimum, [inner, pieces[2]], named)
        arguments = [self._argument(node, piece) for piece in pieces]
        arguments += [f"{key}={self._argument(node, piece)}" for key, piece in named.items()]
        text = f"{self.program.name(function)}({', '.join(arguments)})"
        numbers = [number(kind) is not None for _, kind in (*pieces, *named.values())]
        each = isinstance(function, np.ufunc) or function is np.where
        if each and all(numbers) or function is np.interp and numbers[0]:
            signs = f"{'d' * len(pieces)}->?"  # np.greater, np.isnan: they give a truth
            return text, NUMPYS_TRUTH if signs in getattr(function, "types", ()) else OF_NUMPY
        if function.__name__ in _PLACES:
            return text, Number(False, 2.0**31, True)
        return text, Other()


def underlying(function: Any) -> tuple[types.FunctionType | None, tuple, dict]:
    """underlying(partial(f, 2.0)) -> (f, (2.0,), {}); methods, objects, too; else (None, …)."""
    function = getattr(function, "py_func", function)  # a helper under @njit
    if isinstance(function, types.FunctionType):
        return function, (), {}
    if isinstance(function, functools.partial):
        inner, first, words = underlying(function.func)
        return inner, (*first, *function.args), {**words, **function.keywords}
    if isinstance(function, types.MethodType):
        inner, first, words = underlying(function.__func__)
        return inner, (function.__self__, *first), words
    call = inspect.getattr_static(type(function), "__call__", None)
    if isinstance(call, types.FunctionType):
        return call, (function,), {}
    return None, (), {}


def _of_numpy(function: Any) -> bool:
    module = getattr(function, "__module__", None) or ""
    own = module.split(".")[0] == "numpy" and not module.startswith("numpy.random")
    named = isinstance(function, Hashable) and not isinstance(function, type)  # no np.poly1d
    return isinstance(function, np.ufunc) or own and named


def _called(function: Any) -> str:
    name = getattr(function, "__qualname__", None) or getattr(function, "__name__", repr(function))
    module = getattr(function, "__module__", None) or ""
    return name if module in ("builtins", "") else f"{module}.{name}"
