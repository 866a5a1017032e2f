"""A model function without source text (made by exec): compiled as it is, if it reckons with floats
only.

Numba reads its bytecode. Whole numbers, calls and powers, in which compiled code would differ from
Python, are excluded; then nothing is left to be translated.
"""

from __future__ import annotations

import dis
import types
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .kinds import Other, Record, Unfit

if TYPE_CHECKING:
    from .source import Program
    from .translate import Piece


class Opaque:
    """Opaque(program, f, what, given, finish): in the place of a translate.Body, with its lines."""

    def __init__(
        self,
        program: Program,
        function: types.FunctionType,
        what: str,
        given: dict[str, Piece],
        kinds: tuple[type, type],
        finish: Callable[[Opaque, Any], list[str]],
    ):
        self.what, self.fails = what, True
        reads = {
            name: program.reads.name(function, name) for name in _outside(function.__code__, what)
        }
        constants = [c for c in function.__code__.co_consts if c is not None]
        if not all(type(value) is float for value in [*reads.values(), *constants]):
            raise self.no(None, "reckons with more than floats")
        texts = [text for text, kind in given.values() if not isinstance(kind, Record)]
        records = [kind for _, kind in given.values() if isinstance(kind, Record)]
        for kind, record in zip(kinds, records, strict=True):
            texts.append(f"{program.name(kind)}({', '.join(record.texts())})")
        name = program.name(function)
        program.told[name] = f"{function.__code__.co_code.hex()} {constants} {reads}"
        self.text = f"{name}({', '.join(texts)})"
        self.lines = finish(self, None)

    def no(self, node: object, why: str) -> Unfit:
        return Unfit(f"{self.what} has no source text at hand and {why}")

    def all_items(self, node: object) -> None:
        return None

    def visit(self, node: object) -> Piece:
        return self.text, Other()


def _outside(code: types.CodeType, what: str) -> set[str]:
    """The names that a function reads from outside; Unfit for what may differ from Python."""
    names = set(code.co_freevars)
    for step in dis.get_instructions(code):
        if step.opname.startswith("CALL") or step.argrepr in ("**", "**="):
            raise Unfit(f"{what} has no source text at hand, and more in it than plain arithmetic")
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            names.add(step.argval)
    return names
