"""Formulas as text, "K*x/a": read once, then as numbers, as Python of a model, as SymPy's.

Sums, products, powers and the functions of FUNCTIONS, of x and of names of parameters.
"""

from __future__ import annotations

import ast
import linecache
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .model import ModelError, System, listed

__all__ = [
    "FUNCTIONS",
    "function",
    "names_of",
    "number_of",
    "parsed",
    "put",
    "python",
    "sympy_of",
    "values_of",
]

FUNCTIONS = ("atan", "cos", "exp", "sin", "sqrt", "tanh", "pi")


def parsed(text: str) -> ast.expr:
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError:
        raise ModelError(f"{text!r} is no formula in x and names of parameters") from None
    allowed = (ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant)
    operators = (ast.operator, ast.unaryop, ast.Load)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and not (
            isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS and not node.keywords
        ):
            raise ModelError(f"{text!r}: a formula calls {listed(FUNCTIONS)} only")
        if not isinstance(node, (*allowed, *operators)):
            raise ModelError(f"{text!r} is no formula: sums, products, powers and functions only")
    return tree


def names_of(text: str) -> list[str]:
    return [node.id for node in ast.walk(parsed(text)) if isinstance(node, ast.Name)]


def _split(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(";") if part.strip())


class _Put(ast.NodeTransformer):
    def __init__(self, names: Mapping[str, str]):
        self.names = names

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return parsed(self.names[node.id]) if node.id in self.names else node


def put(text: str, names: Mapping[str, object]) -> str:
    """The formula with other formulas in place of names."""
    if not names:
        return text
    made = ast.unparse(_Put({key: str(value) for key, value in names.items()}).visit(parsed(text)))
    return made if all(str(value).isidentifier() for value in names.values()) else _short(made)


def _short(text: str) -> str:
    """The formula with what cancels left out, p*L*x/L as p*x; with decimal numbers as it is."""
    import sympy as sp

    value = sympy_of(text, {n: sp.Symbol(n) for n in names_of(text) if n not in FUNCTIONS})
    return text if value.atoms(sp.Float) else str(value)


class _Python(ast.NodeTransformer):
    def __init__(self, places: Mapping[str, str]):
        self.places = places

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in FUNCTIONS:
            return node
        return ast.parse(self.places.get(node.id, f"p.{node.id}"), mode="eval").body


def python(text: str, places: Mapping[str, str]) -> str:
    """The formula as Python of s and p: names of parameters become p.name."""
    return ast.unparse(_Python(places).visit(parsed(text)))


def function(text: str, **names: Any) -> Callable:
    """A function from its text; the text stays at hand for tracebacks and for the compiler."""
    place = f"<characteristic: {text}>"
    linecache.cache[place] = (len(text), None, [text + "\n"], place)
    scope = {name: getattr(math, name) for name in FUNCTIONS if name in text}
    return eval(compile(text, place, "eval"), {**scope, **names})


def values_of(p: object) -> Mapping[str, float]:
    """The parameters as a dict, from system.values(), from a System or from a dict."""
    if isinstance(p, System):
        p = p.values()
    if hasattr(p, "_asdict"):
        return p._asdict()
    return dict(p) if isinstance(p, Mapping) else {}


def number_of(text: str, p: object, x: object = None) -> Any:
    values = values_of(p)
    scope = {name: getattr(np, name) for name in FUNCTIONS}
    for name in names_of(text):
        if name not in FUNCTIONS and name != "x":
            if name not in values:
                raise ModelError(f"{text!r} needs the parameter {name!r}; give p = {{…}}")
            scope[name] = values[name]
    with np.errstate(all="ignore"):
        return eval(compile(ast.Expression(parsed(text)), text, "eval"), {**scope, "x": x})


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
