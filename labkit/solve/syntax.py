"""The syntax tree of a function, certain to be what runs: tree(f) -> a Node, or None."""

from __future__ import annotations
import __future__

import ast
import inspect
import linecache
import types
from collections.abc import Iterator
from functools import lru_cache

Node = ast.FunctionDef | ast.Lambda
_FUTURE = sum({getattr(__future__, name).compiler_flag for name in __future__.all_feature_names})


def tree(function: types.FunctionType) -> Node | None:
    """tree(f) -> its syntax tree; None when its source cannot be had or has changed since."""
    code = function.__code__
    try:
        linecache.checkcache(code.co_filename)
        lines, _ = inspect.findsource(function)
        nodes, codes = _parsed("".join(lines), code.co_flags & _FUTURE)
    except (OSError, SyntaxError, TypeError, IndexError, ValueError):
        return None
    if code not in codes:
        return None
    name, line = code.co_name, code.co_firstlineno
    here = [n for n in nodes if _line(n) == line and getattr(n, "name", "<lambda>") == name]
    if len(here) > 1:  # several lambdas in one line: the innermost in whose columns all of it lies
        places = _places(code)
        if places:
            here = [node for node in here if all(_within(place, node) for place in places)]
            here.sort(key=lambda node: node.end_col_offset - node.col_offset)
        else:  # Python 3.12 has no columns for a lambda that gives a constant
            here = [node for node in here if _reckons_as(node, code)]
    return here[0] if here else None


@lru_cache(maxsize=64)
def _parsed(text: str, flags: int) -> tuple[list[Node], set[types.CodeType]]:
    """The functions in a file or cell, and their code: as a whole, and by statements (IPython)."""
    module = ast.parse(text)
    codes = set(_inside(compile(module, "<same>", "exec", flags, True)))
    for statement in module.body:
        piece = ast.Module([statement], [])
        codes.update(_inside(compile(piece, "<same>", "exec", flags, True)))
    return [node for node in ast.walk(module) if isinstance(node, Node)], codes


def _inside(code: types.CodeType) -> Iterator[types.CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield constant
            yield from _inside(constant)


def _line(node: Node) -> int:
    decorators = node.decorator_list if isinstance(node, ast.FunctionDef) else []
    return decorators[0].lineno if decorators else node.lineno


def _places(code: types.CodeType) -> list[tuple[int, int]]:
    return [(line, column) for line, _, column, _ in code.co_positions() if line and column]


def _reckons_as(node: Node, code: types.CodeType) -> bool:
    """Whether a lambda, compiled alone, is that code; one that reads a closure never is."""
    alone = next(_inside(compile(ast.Expression(node), "<same>", "eval", 0, True)))
    parts = ("co_code", "co_consts", "co_names", "co_varnames")
    return all(repr(getattr(alone, part)) == repr(getattr(code, part)) for part in parts)


def _within(place: tuple[int, int], node: Node) -> bool:
    return (node.lineno, node.col_offset) <= place <= (node.end_lineno, node.end_col_offset)
