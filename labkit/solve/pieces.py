"""Pieces: expressions as source, each with its kind; and what stands in source for a value.

literal(2.5), as_float(piece), counted(piece), tuple_of(pieces)
"""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .kinds import MADE, TRUTH, Const, Items, Unfit, number

__all__ = ["Piece", "as_float", "counted", "is_table", "literal", "run_time", "short", "tuple_of"]

Piece = tuple[str, Any]  # source of an expression, and its kind


def literal(value: Any) -> str:
    """literal(2.5) -> "2.5": a number as source; whole ones beyond 2⁵³ as floats."""
    if isinstance(value, bool | np.bool_):
        return str(bool(value))
    if isinstance(value, int | np.int64):
        return str(int(value)) if abs(int(value)) <= MADE else literal(_as_float(int(value)))
    if isinstance(value, float):
        text = repr(float(value))
        return text if math.isfinite(value) and value >= 0 and text[0] != "-" else f"({text})"
    return "None"


def _as_float(value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        raise Unfit("a whole number is too large for a float") from None


def as_float(piece: Piece) -> str:
    """as_float(("(s[0] > 0)", TRUTH)) -> the piece as a float."""
    text, kind = counted(piece)
    if isinstance(kind, Const):
        return literal(float(kind.value))
    already = piece[1] == TRUTH or kind.floating and kind.bound is None
    return text if already else f"float({text})"


def counted(piece: Piece) -> Piece:
    """The piece with a truth made a number."""
    text, kind = piece
    return (f"(1.0 if {text} else 0.0)", kind.counted()) if kind == TRUTH else piece


def tuple_of(pieces: Sequence[Piece]) -> Piece:
    pieces = [counted(piece) for piece in pieces]
    if pieces and all(isinstance(kind, Const) for _, kind in pieces):
        return "None", Const(tuple(kind.value for _, kind in pieces))
    texts = [
        literal(float(kind.value)) if isinstance(kind, Const) and number(kind) else text
        for text, kind in pieces
    ]
    return f"({', '.join(texts)},)", Items(tuple(kind for _, kind in pieces))


def run_time(kind: Any) -> Any:
    return number(kind) or kind


def is_table(kind: Any) -> bool:
    return isinstance(kind, Const) and isinstance(kind.value, np.ndarray | list | tuple)


def short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return f"`{text}`" if len(text) <= 60 else f"`{text[:57]}…`"
