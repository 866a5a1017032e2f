"""Pieces: expressions as source, each with its kind; and what stands in source for a value.

known(2.5), literal(2.5), as_float(piece), counted(piece), tuple_of(pieces)
"""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .kinds import EXACT, Const, Items, Number, Unfit, number

__all__ = ["Piece", "as_float", "counted", "known", "literal", "loosened", "short", "tuple_of"]

Piece = tuple[str, Any]  # source of an expression, and its kind


def known(value: Any) -> Piece:
    """known(2.5) -> its piece; tables and functions get a name when they are used."""
    return literal(value), Const(value)


def literal(value: Any) -> str:
    """literal(2.5) -> "2.5": a number as source; whole ones beyond 2⁵³ as floats."""
    if isinstance(value, bool | np.bool_):
        return str(bool(value))
    if isinstance(value, int | np.int64):
        if abs(int(value)) <= EXACT:
            return str(int(value))
        try:
            value = float(value)
        except OverflowError:
            raise Unfit("a whole number is too large for a float") from None
    if isinstance(value, float):
        text = repr(float(value))
        return text if math.isfinite(value) and text[0] != "-" else f"({text})"
    return "None"


def as_float(piece: Piece) -> str:
    """as_float(("(s[0] > 0)", TRUTH)) -> the piece as a float."""
    text, kind = counted(piece)
    if isinstance(kind, Const):
        return literal(float(kind.value))
    already = piece[1].truth or kind.floating and kind.bound is None
    return text if already else f"float({text})"


def counted(piece: Piece) -> Piece:
    """The piece with a truth made a number."""
    text, kind = piece
    truth = isinstance(kind, Number) and kind.truth
    return (f"(1.0 if {text} else 0.0)", kind.counted()) if truth else piece


def tuple_of(pieces: Sequence[Piece]) -> Piece:
    """tuple_of([piece, …]) -> the tuple of them as a piece."""
    pieces = [counted(piece) for piece in pieces]
    if pieces and all(isinstance(kind, Const) for _, kind in pieces):
        return known(tuple(kind.value for _, kind in pieces))
    texts = [
        as_float((text, kind)) if isinstance(kind, Const) and number(kind) else text
        for text, kind in pieces
    ]
    return f"({', '.join(texts)},)", Items(tuple(kind for _, kind in pieces))


def loosened(piece: Piece) -> Piece:
    """The piece of a known number, or of a tuple of such, as if it were not known."""
    text, kind = piece
    if isinstance(kind, Const) and isinstance(kind.value, tuple) and kind.value:
        parts = [loosened(known(value)) for value in kind.value]
        if all(isinstance(kind, Number | Items) for _, kind in parts):
            kinds = tuple(kind for _, kind in parts)
            return f"({', '.join(text for text, _ in parts)},)", Items(kinds)
    return (as_float(piece), number(kind)) if number(kind) else piece


def short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return f"`{text}`" if len(text) <= 60 else f"`{text[:57]}…`"
