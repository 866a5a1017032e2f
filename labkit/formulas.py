"""Formulas as text, "K*x/a": read once, then as numbers, as Python of a model, as SymPy's.

Sums, products, powers and the functions of FUNCTIONS, of x and of names of parameters.
"""

from __future__ import annotations

import ast
import linecache
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from types import CodeType
from typing import Any

import numpy as np

from .model import ModelError, System, listed

__all__ = ["FUNCTIONS", "function", "integral", "integrals", "names_of", "number_of", "parsed"]
__all__ += ["put", "python", "sympy_of", "values_of"]

CALLED = ("atan", "cos", "exp", "sin", "sqrt", "tanh")
FUNCTIONS = (*CALLED, "pi")
_NUMPY = {name: getattr(np, name) for name in FUNCTIONS}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
ALLOWED = (ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant, ast.Load)
ALLOWED += (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.UAdd, ast.USub)


def parsed(text: str) -> ast.expr:
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError:
        raise ModelError(f"{text!r} is no formula in x and names of parameters") from None
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            known = isinstance(node.func, ast.Name) and node.func.id in CALLED
            if not known or len(node.args) != 1 or node.keywords:
                raise ModelError(f"{text!r}: a formula calls {listed(CALLED)} only, of one number")
        wrong = isinstance(node, ast.Constant) and type(node.value) not in (int, float)
        if wrong or not isinstance(node, ALLOWED):
            raise ModelError(
                f"{text!r} is no formula: numbers, names, + − * / ** and functions only"
            )
    return tree


def names_of(text: str) -> list[str]:
    return [node.id for node in ast.walk(parsed(text)) if isinstance(node, ast.Name)]


class _Names(ast.NodeTransformer):
    """Puts for a name what replaced(name) gives, a formula as text, if that is one."""

    def __init__(self, replaced: Callable[[str], str | None]):
        self.replaced = replaced

    def visit_Name(self, node: ast.Name) -> ast.expr:
        new = self.replaced(node.id)
        return node if new is None else ast.parse(new.strip(), mode="eval").body


def put(text: str, names: Mapping[str, object]) -> str:
    """The formula with other formulas in place of names."""
    if not names:
        return text
    names = {key: str(value) for key, value in names.items()}
    made = ast.unparse(_Names(names.get).visit(parsed(text)))
    return made if all(map(str.isidentifier, names.values())) else _short(made)


def _short(text: str) -> str:
    """The formula with what cancels left out, p*L*x/L as p*x; with decimal numbers as it is."""
    import sympy as sp

    value = sympy_of(text, {n: sp.Symbol(n) for n in names_of(text) if n not in FUNCTIONS})
    if value.has(sp.zoo, sp.nan, sp.oo):
        raise ModelError(f"{text!r} has no value: it divides by zero")
    short = str(value)  # SymPy has names of its own, E for exp(1)
    keep = value.atoms(sp.Float) or not set(names_of(short)) <= set(names_of(text))
    return text if keep else short


def python(text: str, places: Mapping[str, str]) -> str:
    """The formula as Python of s and p: names of parameters become p.name."""

    def replaced(name: str) -> str | None:
        return None if name in FUNCTIONS else places.get(name, f"p.{name}")

    return ast.unparse(_Names(replaced).visit(parsed(text)))


def function(text: str, **names: Any) -> Callable:
    """A function from its text; the text stays at hand for tracebacks and for the compiler."""
    place = f"<characteristic: {text}>"
    linecache.cache[place] = (len(text), None, [text + "\n"], place)
    scope = {name: getattr(math, name) for name in FUNCTIONS if name in text}
    return eval(compile(text, place, "eval"), scope | names)


def values_of(p: object) -> Mapping[str, float]:
    """The parameters as a dict, from system.values(), from a System or from a dict."""
    if isinstance(p, System):
        p = p.values()
    if hasattr(p, "_asdict"):
        return p._asdict()
    return dict(p) if isinstance(p, Mapping) else {}


@lru_cache(maxsize=1000)
def _code(text: str) -> tuple[CodeType, tuple[str, ...]]:
    names = tuple(n for n in dict.fromkeys(names_of(text)) if n not in FUNCTIONS and n != "x")
    return compile(ast.Expression(parsed(text)), text, "eval"), names


def number_of(text: str, p: object, x: object = None) -> Any:
    code, names = _code(text)
    values = values_of(p) if names else {}
    if missing := [name for name in names if name not in values]:
        raise ModelError(f"{text!r} needs the parameter {missing[0]!r}; give p = {{…}}")
    try:
        with np.errstate(all="ignore"):
            return eval(code, {**_NUMPY, **{name: values[name] for name in names}, "x": x})
    except (ArithmeticError, TypeError) as error:
        raise ModelError(f"{text!r} has no value for {dict(values)}: {error}") from None


def integral(f: Callable[[np.ndarray], Any], low: float, high: float) -> complex:
    """integral(f, 0.0, 2.0) -> ∫f by Gauss's formula, the worst part halved until all agree."""
    if low == high:
        return 0j
    parts = [_part(f, low, high)]
    for _ in range(100):
        worst = max(parts)
        error, low, high, *_ = worst
        if error <= 1e-15 * sum(part[4] for part in parts):
            break
        parts.remove(worst)
        parts += [_part(f, low, (low + high) / 2), _part(f, (low + high) / 2, high)]
    return sum(part[3] for part in parts)


def integrals(f: Callable[[np.ndarray], Any], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """integrals(f, low, high) -> the real integrals over many parts at once, each as `integral`."""
    error, _, _, found, size = _part(f, low, high)
    for k in np.flatnonzero(error > 1e-15 * size).tolist():
        found[k] = integral(f, float(low[k]), float(high[k]))
    return found.real


def _part(f: Callable[[np.ndarray], Any], low: Any, high: Any) -> tuple:
    """Error, ends, integral and that of |f|: 20 points over the whole against its two halves.

    Of one part, or of arrays of them.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    ends = np.array([low, low, middle]), np.array([high, middle, high])
    places = ((ends[0] + ends[1]) / 2)[..., None] + ((ends[1] - ends[0]) / 2)[..., None] * _NODES
    values = f(places) * np.ones(places.shape)
    whole, left, right = (
        half * w * (v @ _WEIGHTS) for v, w in zip(values, (1.0, 0.5, 0.5), strict=True)
    )
    size = abs(half) * (np.abs(values[0]) @ _WEIGHTS)
    return abs(whole - left - right), low, high, (left + right).astype(complex), size


def sympy_of(text: str, names: Mapping[str, Any]) -> Any:
    import sympy as sp

    scope = {name: getattr(sp, name) for name in FUNCTIONS}
    tree = ast.fix_missing_locations(ast.Expression(_Numbers().visit(parsed(text))))
    return sp.sympify(eval(compile(tree, text, "eval"), {**scope, "Integer": sp.Integer, **names}))


class _Numbers(ast.NodeTransformer):
    """Whole numbers as SymPy's, so that 1/2 stays one half."""

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if not isinstance(node.value, int):
            return node
        call = ast.Call(ast.Name("Integer", ast.Load()), [node], [])
        return ast.copy_location(call, node)
