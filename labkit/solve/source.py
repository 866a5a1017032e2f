"""A model's functions as the source of one function for Numba: model(what, index, t, s, p, out).

    program = Program(system)
    program.text        the source: all constants stand in it, tables and functions under names
    program.values      what these names are
    program.reads       what was read from outside, to see whether it is still the same
    program.key         text that is another for other code

One function instead of a dozen, because Numba's time goes by functions: a model of four modes takes
0.4 s this way and 2.4 s as separate functions. With FAILED added to `what` it fills out with NaN,
for the caller to use when it has failed.
"""

from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np

from ..model import System, Transition
from .calls import underlying
from .checked import CHECKED
from .kinds import FLOAT, Const, Items, Number, Other, Record, Table, Unfit, join, number
from .opaque import Opaque
from .pieces import Piece, as_float, counted, known, literal
from .plain import orientations
from .reads import Reads
from .syntax import tree
from .translate import Body

FLOW, GUARDS, RESET = range(3)  # the reset that leaves mode m is RESET + m
FAILED = 1_000_000
DEEPEST = 40  # helpers that call helpers


# A whole number that a float may not hold: where it was stands behind the parameters then
_CHECKS = """
def exact(x, p, place):
    if abs(x) < 9007199254740992.0:  # it may have been rounded to that
        return x + 0.0
    p[{place}] = place
    raise ValueError
def exact_if_whole(x, p, place):
    if abs(x) >= 9007199254740992.0:
        p[{place}] = place
        raise ValueError
    return x
"""


class Program:
    """Program(system): see above. Raises Unfit, in words, for what must run in plain Python."""

    def __init__(self, system: System, reads: Reads | None = None):
        self.system, self.modes = system, list(system.modes)
        self.reads = reads or Reads()
        self.values: dict[str, Any] = {"inf": inf, "nan": nan}
        self.told: dict[str, str] = {}  # values in words, where _told does not tell enough
        self._names: dict[Any, str] = {}
        self._places: dict[str, int] = {}  # words -> number, of where whole numbers are looked at
        self._helpers: dict[Any, tuple[str, Any, bool, str]] = {}  # name, kind, fails, source
        self._making: list[Any] = []
        self._branches: list[tuple[str, list[str]]] = []
        parameters = tuple((name, place) for place, name in enumerate(system.parameters))
        self._p, self._guards = Record("p", parameters), orientations(system)
        behind = range(system.width, system.width + len(system.held))
        self._kept = [f"out[{place}] = s[{place}]" for place in behind]
        for m, mode in enumerate(system.modes.values()):
            places = list(range(len(system.states_of(mode.name))))
            what = f"the flow of mode {mode.name!r}"
            body = self._body(mode.flow, what, f"f{m}_", mode.name, _fill(places, []))
            self._branches.append((f"what == {FLOW} and index == {m}", body.lines))
        for m in range(len(self.modes)):
            self._add_guards(m)
        for i, transition in enumerate(system.transitions):
            if transition.reset is not None:
                self._add_reset(i, transition)
        self.text = self._written(behind.stop)
        self.key = self.text + "\n".join(
            f"{name}: {self.told.get(name) or _told(value)}" for name, value in self.values.items()
        )

    def _body(
        self, function: Callable, what: str, prefix: str, mode: str, finish: Callable
    ) -> Body | Opaque:
        """A function of (t, s, p), its first three arguments, whatever they are called."""
        inner, first, words = underlying(function)
        if inner is None:
            kind = type(function).__name__
            raise Unfit(f"{what} is a {kind}, not a function made by def or lambda")
        s = Record("s", tuple(self.system.places(mode).items()))
        pieces = [*map(known, first), ("t", FLOAT), ("None", s), ("None", self._p)]
        given = self._bound(what, inner, pieces, {key: known(v) for key, v in words.items()})
        if tree(inner) is None:
            return Opaque(self, inner, what, given, (self.system.S[mode], self.system.P), finish)
        return Body(self, inner, what, given, prefix, finish)

    def _bound(
        self, what: str, function: Any, pieces: list[Piece], named: dict
    ) -> dict[str, Piece]:
        """Argument -> piece, defaults included."""
        try:
            arguments = inspect.signature(function).parameters
            bound = inspect.signature(function).bind(*pieces, **named).arguments
        except (TypeError, ValueError) as error:
            raise Unfit(f"{what} cannot be called like that: {error}") from None
        for name, argument in arguments.items():
            if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD):
                raise Unfit(f"{what} cannot be called like that: it takes *{name}")
            if name not in bound:
                bound[name] = known(self.reads.default(function, name, argument.default))
        return {name: bound[name] for name in arguments}

    # ------------------------------------------------------------ guards and resets

    def _expression(
        self, function: Callable, what: str, prefix: str, mode: str
    ) -> tuple[str, bool]:
        """A function of one number as an expression (of a helper), and whether it may fail."""
        body = self._body(function, what, prefix, mode, _one)
        if len(body.lines) == 1:
            return f"({body.lines[0].removeprefix('return ')})", body.fails
        name = f"h{len(self._helpers)}"
        source = "\n".join([f"def {name}(t, s, p):", *("    " + line for line in body.lines)])
        self._helpers[name] = name, FLOAT, body.fails, source
        return f"{name}(t, s, p)", body.fails

    def _add_guards(self, m: int) -> None:
        lines, mode, pieces = [], self.modes[m], self._guards[m]
        for k, (function, sign, tolerance) in enumerate(pieces):
            names = [tr.name for tr in self.system.transitions if tr.guard is function]
            what = f"the guard of {names[0]!r}"
            text, fails = self._expression(function, what, f"g{m}_{k}_", mode)
            shift = f" - {tolerance!r}" if tolerance else ""
            line = f"out[{k}] = {'-' if sign < 0 else ''}{text}{shift}"
            if fails and len(pieces) > 1:  # the others have their values all the same
                lines += ["try:", f"    {line}", "except Exception:", f"    out[{k}] = nan"]
            else:
                lines.append(line)
        if lines:
            self._branches.append((f"what == {GUARDS} and index == {m}", [*lines, "return"]))

    def _add_reset(self, i: int, tr: Transition) -> None:
        """A branch for each kind of source mode; modes of the same states share one."""
        states, what = self.system.states_of, f"the reset of {tr.name!r}"
        for m in {states(mode): self.modes.index(mode) for mode in tr.sources}.values():
            name, prefix = self.modes[m], f"r{i}_{m}_"
            alike = [self.modes.index(mode) for mode in tr.sources if states(mode) == states(name)]
            among = ", ".join(map(str, alike))
            lines = ["return"]
            if isinstance(tr.reset, Mapping):
                lines = [*_store(self._parts(tr, name, what, prefix)), "return"]
            elif count := len(states(tr.target)) if tr.target else 0:
                fill = _fill(list(range(count)), self._kept)
                lines = self._body(tr.reset, what, prefix, name, fill).lines
            condition = f"what >= {RESET} and index == {i} and what - {RESET} in ({among},)"
            self._branches.append((condition, lines))

    def _parts(self, tr: Transition, mode: str, what: str, prefix: str) -> dict[int, str]:
        """Place after the event -> expression, of a reset that names what changes."""
        before, texts = self.system.places(mode), {}
        for name, place in self.system.places(tr.target or mode).items():
            value = tr.reset.get(name)
            if callable(value):
                texts[place], _ = self._expression(value, what, f"{prefix}{place}_", mode)
            else:
                texts[place] = f"s[{before[name]}]" if value is None else literal(value)
        return texts

    # ------------------------------------------------------------ what bodies ask for

    def helper(
        self, body: Body, node: Any, function: Any, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        """A call of a helper: it is written once for each combination of kinds and known values."""
        what = f"{body.what} calls {function.__name__!r}: it"
        given = self._bound(what, function, pieces, named)
        key = function, tuple((name, kind) for name, (_, kind) in given.items())
        if key in self._making or len(self._making) > DEEPEST:
            raise body.no(node, f"calls {function.__name__!r}, which calls itself (a recursion)")
        given = {name: counted(piece) for name, piece in given.items()}
        passed = {k: v for k, v in given.items() if not isinstance(v[1], Const | Record)}
        if key not in self._helpers:
            self._making.append(key)
            try:
                self._helpers[key] = self._made(what, function, given, passed)
            finally:
                self._making.pop()
        name, kind, fails, _ = self._helpers[key]
        body.fails |= fails
        arguments = ", ".join(["s", "p", *(text for text, _ in passed.values())])
        return (literal(kind.value) if isinstance(kind, Const) else f"{name}({arguments})"), kind

    def _made(
        self, what: str, function: Any, given: dict, passed: dict
    ) -> tuple[str, Any, bool, str]:
        prefix = f"h{len(self._helpers)}x{len(self._making)}"
        inside = {
            name: (f"{prefix}_{name}" if name in passed else text, kind)
            for name, (text, kind) in given.items()
        }
        body = Body(self, function, what, inside, f"{prefix}_", _returned)
        kind = body.returned
        if body.fails:  # else a call that gives a constant need not be made
            kind = number(kind) or kind
        heads = ", ".join(["s", "p", *(f"{prefix}_{name}" for name in passed)])
        lines = [f"def {prefix}({heads}):", *("    " + line for line in body.lines)]
        return prefix, kind, body.fails, "\n".join(lines)

    def place(self, words: str) -> int:
        """program.place("the flow … (line 2) has …") -> the number that stands for it: 1, …"""
        return self._places.setdefault(words, len(self._places) + 1)

    @property
    def places(self) -> list[str]:
        return [*self._places]

    def name(self, value: Any) -> str:
        """program.name(np.interp) -> the name under which the source calls it."""
        if value not in self._names:
            self._names[value] = f"n{len(self._names)}"
            self.values[self._names[value]] = value
        return self._names[value]

    def table(self, value: Any) -> Piece | None:
        """program.table([1.0, 2.0]) -> the name of an array, and its kind; None of other things."""
        try:
            array = np.ascontiguousarray(value)
        except ValueError:  # rows of different lengths
            return None
        if not array.size or array.dtype not in (np.float64, np.int64, np.bool_):
            return None
        key = array.dtype.str, array.shape, array.tobytes()
        if key not in self._names:
            self._names[key] = f"c{len(self._names)}"
            self.values[self._names[key]] = array.copy()
        item = Number(True, numpy=isinstance(value, np.ndarray))
        if array.dtype != np.float64:
            bound = max(abs(int(array.min())), abs(int(array.max())))
            item = replace(item, floating=False, bound=float(bound))
        return self._names[key], Table(item, array.ndim)

    # ------------------------------------------------------------ all together

    def _written(self, most: int) -> str:
        text = "def model(what, index, t, s, p, out):\n" + self._failure(most)
        for condition, lines in self._branches:
            text += f"    if {condition}:\n" + "".join(f"        {line}\n" for line in lines)
        text += f"    if what >= {RESET}:\n        for i in range({most}):\n"
        text += "            out[i] = s[i]\n"
        parts, wanted = {each[0]: each[3] for each in self._helpers.values()}, [text]
        for part in wanted:  # grows: helpers of helpers; what was only tried is left out
            names = [name for name in re.findall(r"\bh\w+(?=\()", part) if name in parts]
            wanted += [parts.pop(name) for name in dict.fromkeys(names)]
        if self._places:
            wanted.append(_CHECKS.format(place=len(self.system.parameters)))
        self.helpers = re.findall(r"^def (?!model)(\w+)", "\n".join(wanted), re.MULTILINE)
        whole = "\n".join([*reversed(wanted[1:]), text])
        used = set(re.findall(r"\w+", whole))
        self.values = {name: value for name, value in self.values.items() if name in used}
        self.intrinsics = used & CHECKED.keys()
        return whole

    def _failure(self, most: int) -> str:
        """What is filled with NaN when a flow, the guards of a mode or a reset have failed."""
        text = f"    if what >= {FAILED}:\n        count = {most}\n"
        text += f"        if what == {FAILED + FLOW}:\n            count = {self.system.width}\n"
        for m, pieces in enumerate(self._guards):
            text += f"        if what == {FAILED + GUARDS} and index == {m}:\n"
            text += f"            count = {len(pieces)}\n"
        return text + "        for i in range(count):\n            out[i] = nan\n        return\n"


def _fill(places: list[int], keep: list[str]) -> Callable[[Body, Any], list[str]]:
    """_fill([0, 1], []) -> what a `return` becomes: its values go to these places; then `keep`."""

    def finish(body: Body, value: Any) -> list[str]:
        pieces = body.all_items(value)
        if pieces is None:
            text, kind = body.visit(value)
            if not isinstance(kind, Other):
                raise body.no(value, f"returns what is no tuple of {len(places)} numbers")
            lines = [f"result = {text}", *(f"out[{i}] = result[{k}]" for k, i in enumerate(places))]
            return [*lines, *keep, "return"]
        if len(pieces) != len(places):
            raise body.no(value, f"returns {len(pieces)} values, not {len(places)}")
        texts = [_number(body, value, piece) for piece in pieces]
        return [*_store(dict(zip(places, texts, strict=True))), *keep, "return"]

    return finish


def _store(values: dict[int, str]) -> list[str]:
    """Statements that put values into places of out, all worked out before the first is put."""
    if len(values) == 1:
        return [f"out[{i}] = {text}" for i, text in values.items()]
    lines = [f"value_{i} = {text}" for i, text in values.items()]
    return [*lines, *(f"out[{i}] = value_{i}" for i in values)]


def _number(body: Body, node: Any, piece: Piece) -> str:
    """What a function returns as source, if it is a number or whatever Numba makes of it."""
    text, kind = piece
    if isinstance(kind, Other):
        return text
    if number(kind) is None:
        raise body.no(node, "returns what is no number")
    return as_float(piece)


def _one(body: Body, value: Any) -> list[str]:
    return [f"return {_number(body, value, body.visit(value))}"]


def _returned(body: Body, value: Any) -> list[str]:
    text, kind = counted(body.visit(value))
    if isinstance(kind, Const):
        text = as_float((text, kind)) if number(kind) else "None"
    if isinstance(kind, Record):
        kind, text = Items((FLOAT,) * len(kind.places)), f"({', '.join(kind.texts())},)"
    try:
        before = body.returned
        if before is not None:
            kind = join(before, kind)
            kind = number(kind) or kind
        body.returned = kind
    except Unfit:
        raise body.no(value, "returns values of different kinds") from None
    return [f"return {text}"]


def _told(value: Any) -> str:
    """A value in words that are others for another value."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, float):
        return repr(value)
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__name__', value)}"
