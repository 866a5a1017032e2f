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

from .kinds import Const, Other, Record, Unfit

if TYPE_CHECKING:
    from .source import Program
    from .translate import Piece


class Opaque:
    """Opaque(program, f, what, given, kinds, finish): in the place of a Body, with its lines."""

    def __init__(
        self,
        program: Program,
        function: types.FunctionType,
        what: str,
        given: dict[str, Piece],
        kinds: tuple[type, type],
        finish: Callable[[Opaque, Any], list[str]],
    ):
        self.what, self.fails, code = what, True, function.__code__
        values = {name: program.reads.name(function, name) for name in self._outside(code)}
        values |= {k: kind.value for k, (_, kind) in given.items() if isinstance(kind, Const)}
        constants = [c for c in code.co_consts if c is not None]
        if not all(type(value) is float for value in [*values.values(), *constants]):
            raise self.no(None, "reckons with more than floats")
        records, name = iter(kinds), program.name(function)
        texts = [
            f"{program.name(next(records))}({', '.join(kind.texts())})"
            if isinstance(kind, Record)
            else text
            for text, kind in given.values()
        ]
        fields = [kind._fields for kind in kinds]
        program.told[name] = f"{code.co_code.hex()} {code.co_names} {fields} {constants} {values}"
        self.text = f"{name}({', '.join(texts)})"
        self.lines = finish(self, None)

    def no(self, node: object, why: str) -> Unfit:
        return Unfit(f"{self.what} has no source text at hand and {why}")

    def all_items(self, node: object) -> None:
        return None

    def visit(self, node: object) -> Piece:
        return self.text, Other()

    def _outside(self, code: types.CodeType) -> list[str]:
        """The names that a function reads from outside; Unfit for what may differ from Python."""
        names = [*code.co_freevars]
        for step in dis.get_instructions(code):
            if step.opname.startswith("CALL") or step.argrepr in ("**", "**="):
                raise self.no(None, "has more in it than plain arithmetic")
            if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
                names.append(step.argval)
        return names
