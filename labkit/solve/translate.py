"""One model function, or a helper that it calls, as source for Numba, with everything known in
advance put in its place.

    body = Body(program, f, "the flow of mode 'm'", kinds of its arguments, prefix, finish)
    body.lines          statements; names are kept apart by the prefix
    body.fails          whether it may end in a failure (a division by zero, an index beyond its
                        table …)

`s.v` becomes s[1], `p.g` p[0], and a constant its value, be it in a module, an object or a default
argument. What is known is computed by Python itself; the branch that a known condition rules out is
left out. What cannot be compiled, or not so that it is sure to give Python's numbers, raises Unfit:
then the model runs in plain Python.
"""

from __future__ import annotations

import ast
import itertools
import types
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import reduce
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from .arithmetic import BINARY
from .calls import Calls
from .kinds import FLOAT, Const, Items, Number, Other, Record, Table, Unfit, join, number, widest
from .pieces import Piece, counted, known, loosened, short, tuple_of
from .syntax import tree

if TYPE_CHECKING:
    from .source import Program

UNROLLED = 64  # items of a known list that a loop is written out for
TURNS = 16  # rounds of a loop that are followed one by one
FRESH = [Const(function) for function in (np.array, np.zeros, np.ones, np.full)]  # new arrays


class Body(Calls):
    """Body(program, function, what, given, prefix, finish): see the module's docstring."""

    def __init__(
        self,
        program: Program,
        function: types.FunctionType,
        what: str,
        given: dict[str, Piece],
        prefix: str,
        finish: Callable[[Body, ast.expr], list[str]],
    ):
        self.program, self.function, self.what = program, function, what
        self.prefix, self.finish = prefix, finish
        self.lines: list[str] = []
        self.parts, self.fails = itertools.count(), False
        self.returned: Any = None  # the kind of what a helper returns
        self._breaks: list[dict[str, Any]] = []  # the kinds where the loop at hand is left …
        self._continues: list[dict[str, Any]] = []  # … and where its next round begins
        program.reads.text(function)
        node = tree(function)
        if node is None:
            raise Unfit(f"{what} cannot be compiled: its source text is not at hand or has changed")
        self.stored = set(function.__code__.co_varnames)
        body = node.body
        if isinstance(node, ast.Lambda):
            body = [ast.Return(node.body, lineno=node.lineno)]
        changed = _stored_in(*body)
        inside = [n for part in body for n in ast.walk(part)]
        places = [n.target for n in inside if isinstance(n, ast.AugAssign)]
        places += [
            n.value for n in inside if isinstance(n, ast.Subscript) and isinstance(n.ctx, ast.Store)
        ]
        self.altered = {n.id for n in places if isinstance(n, ast.Name)}  # perhaps in place
        self.env: dict[str, Any] = {name: kind for name, (_, kind) in given.items()}
        self.given = {name: text for name, (text, _) in given.items() if name not in changed}
        for name in given:
            if name in changed:
                self._set(name, given[name])
        if self._block(body):
            raise Unfit(f"{what} can end without a `return`")

    def _block(self, body: Sequence[ast.stmt]) -> bool:
        """Statements one after the other; False when what follows them is never reached."""
        for statement in body:
            method = getattr(self, f"_do_{type(statement).__name__}", None)
            if method is None:
                why = f"has a statement that is not compiled: {short(statement)}"
                raise self.no(statement, why)
            if method(statement) is False:
                return False
        return True

    def _inside(self, body: Sequence[ast.stmt]) -> tuple[list[str], bool]:
        """The lines of an indented block, and whether its end is reached."""
        outer, self.lines = self.lines, []
        goes_on = self._block(body)
        inner, self.lines = self.lines or ["pass"], outer
        return ["    " + line for line in inner], goes_on

    def _do_Pass(self, node: ast.Pass) -> None:
        pass

    def _do_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.visit(node.value)
            raise self.no(node, f"computes something for its effect: {short(node)}")

    def _do_Return(self, node: ast.Return) -> bool:
        value = node.value
        if value is None:
            raise self.no(node, "returns None")
        if isinstance(value, ast.IfExp):  # two returns, so that tuples need not be of one type
            one, two = (
                [ast.copy_location(ast.Return(part), node)] for part in (value.body, value.orelse)
            )
            self._do_If(ast.copy_location(ast.If(value.test, one, two), node))
        else:
            self.lines += self.finish(self, value)
        return False

    def _do_Assign(self, node: ast.Assign) -> None:
        if len(node.targets) > 1:
            raise self.no(node, f"assigns to two targets at once: {short(node)}")
        self._assign(node.targets[0], node.value, node)

    def _do_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assign(node.target, node.value, node)

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            old = ast.copy_location(ast.Name(node.target.id, ast.Load()), node)
            text, kind = self.visit(old)
            if isinstance(kind, Other):  # an array, whose other names see it, too
                value = self._argument(node, self.visit(node.value))
                self.lines.append(f"{text} {BINARY[type(node.op)][0]}= {value}")
                return
            if number(kind):
                new = ast.copy_location(ast.BinOp(old, node.op, node.value), node)
                self._set(node.target.id, self.visit(new))
                return
        raise self.no(node, f"changes something in place: {short(node)}")

    def _assign(self, target: ast.expr, value: ast.expr, node: ast.AST) -> None:
        if isinstance(target, ast.Tuple | ast.List):
            self._take_apart(target, self.all_items(value), node)
        elif isinstance(target, ast.Name):
            text, kind = self.visit(value)
            new = isinstance(value, ast.Call) and self.visit(value.func)[1] in FRESH
            if new and target.id in self.altered and (table := self._table((text, kind))):
                text, kind = f"{table[0]}.copy()", Other()
            self._set(target.id, (text, kind))
        elif isinstance(target, ast.Subscript) and isinstance(self.visit(target.value)[1], Other):
            text = self._argument(node, self.visit(value))
            self.lines.append(f"{self.visit(target)[0]} = {text}")
        else:
            raise self.no(node, f"changes something in place: {short(node)}")

    def _take_apart(
        self, target: ast.Tuple | ast.List, pieces: list[Piece] | None, node: ast.AST
    ) -> None:
        """(a, b) = pieces, all of them worked out before the first is put into its place."""
        names = [each.id for each in target.elts if isinstance(each, ast.Name)]
        if pieces is None or not len(pieces) == len(names) == len(target.elts):
            count = len(target.elts)
            raise self.no(node, f"takes apart what is no tuple of {count}: {short(node)}")
        for name, piece in zip(names, [self.held(piece) for piece in pieces], strict=True):
            self._set(name, piece)

    def _set(self, name: str, piece: Piece) -> None:
        text, kind = counted(piece)
        self.env[name] = kind
        if not isinstance(kind, Record) and (not isinstance(kind, Const) or number(kind)):
            self.lines.append(f"{self.named(name)} = {text}")  # else there is nothing to compute

    def _do_If(self, node: ast.If) -> bool:
        test, kind = self.truth(node.test)
        if isinstance(kind, Const):
            return self._block(node.body if kind.value else node.orelse)
        before = self.env.copy()
        lines, on = self._inside(node.body)
        one, self.env = self.env, before
        others, other_on = self._inside(node.orelse) if node.orelse else ([], True)
        self.lines += [f"if {test}:", *lines, *(["else:", *others] if others else [])]
        if on:
            self.env = _joined([one, self.env]) if other_on else one
        return on or other_on

    def _do_While(self, node: ast.While) -> bool:
        ever = isinstance(node.test, ast.Constant) and bool(node.test.value)
        return self._loop(node, lambda: f"while {self.truth(node.test)[0]}:", inf if ever else None)

    def _do_For(self, node: ast.For) -> bool:
        if not isinstance(node.target, ast.Name):
            return self._unroll(node)
        if isinstance(node.iter, ast.Call) and self._is(node.iter.func, range):
            pieces = [self.visit(each) for each in node.iter.args]
            kinds = [number(kind) for _, kind in pieces]
            if node.iter.keywords or not all(k and not k.floating for k in kinds):
                raise self.no(node, f"counts over what are no whole numbers: {short(node.iter)}")
            count = None
            if all(isinstance(kind, Const) for _, kind in pieces):
                count = len(range(*(int(kind.value) for _, kind in pieces)))
            texts = [text if isinstance(k, Const) else f"int({text})" for text, k in pieces]
            over = f"range({', '.join(texts)})"
            item = Number(False, max(k.bound for k in kinds))
        else:
            text, kind = self.visit(node.iter)
            over, table = self._table((text, kind)) or (text, kind)
            if isinstance(kind, Other):
                table = Table(FLOAT, 1)
            if not isinstance(table, Table) or table.ndim != 1:
                return self._unroll(node)
            item, count = table.item, len(kind.value) if isinstance(kind, Const) else None
        name = node.target.id

        def head() -> str:
            self.env[name] = item
            return f"for {self.named(name)} in {over}:"

        return self._loop(node, head, count)

    def _loop(
        self, node: ast.For | ast.While, head: Callable[[], str], count: float | None
    ) -> bool:
        """A loop: its body is gone through until the kinds of its variables change no more, then
        written. count: of its rounds, as far as that is known.
        """
        if node.orelse:
            raise self.no(node, "has a loop with `else`, which is not compiled")
        around = self._breaks, self._continues
        for name in _stored_in(node) & self.env.keys():
            text, kind = loosened(known(getattr(self.env[name], "value", None)))
            if isinstance(kind, Items):  # a known tuple, which no line has set
                self.lines.append(f"{self.named(name)} = {text}")
                self.env[name] = kind
        heads = [self.env]  # the kinds where its rounds begin
        followed = min(count, TURNS) if count and count < inf else 3
        while True:
            self._breaks, self._continues = [], []
            self.env = heads[-1].copy()
            for name in _stored_in(node) & self.env.keys():  # in a loop they are no constants
                self.env[name] = number(self.env[name]) or self.env[name]
            first = head()
            lines, on = self._inside(node.body)
            ends = [*self._continues, *([self.env] if on else [])]
            after = _joined([heads[-1], *ends])
            if after == heads[-1] or len(heads) == count:
                break
            if len(heads) >= followed:
                for name, kind in after.items():
                    if kind != heads[-1].get(name):
                        after[name] = widest(kind)
            heads.append(after)
        self.lines += [first, *lines]
        left = ends if count and count < inf else [] if count else heads[-1:]
        ways = [*left, *self._breaks]  # in which what follows it is reached
        self._breaks, self._continues = around
        self.env = _joined(ways) if ways else self.env
        return bool(ways)

    def _unroll(self, node: ast.For) -> bool:
        """A loop over a few known items, or the items of a tuple, is written out."""
        pieces = self._iterated(node.iter)
        if pieces is None or len(pieces) > UNROLLED or node.orelse:
            raise self.no(node, f"loops over what is not compiled: {short(node.iter)}")
        inside = [n for part in node.body for n in ast.walk(part)]
        if any(isinstance(n, ast.Break | ast.Continue) for n in inside):
            raise self.no(node, "leaves a loop that is written out item by item")
        for piece in [self.held(piece) for piece in pieces]:  # before the body changes them
            if isinstance(node.target, ast.Name):
                self._set(node.target.id, piece)
            else:
                self._take_apart(node.target, self.items(piece), node.target)
            if not self._block(node.body):
                return False
        return True

    def _iterated(self, node: ast.expr) -> list[Piece] | None:
        """What a loop goes over, enumerate and zip included; None if not known one by one."""
        if isinstance(node, ast.Call) and not node.keywords:
            if self._is(node.func, zip):
                columns = [self._iterated(each) for each in node.args]
                return None if None in columns else [*map(tuple_of, zip(*columns, strict=False))]
            if self._is(node.func, enumerate) and len(node.args) == 1:
                column = self._iterated(node.args[0])
                return column and [tuple_of([known(k), each]) for k, each in enumerate(column)]
        return self.all_items(node)

    def _is(self, node: ast.expr, function: object) -> bool:
        return (
            isinstance(node, ast.Name)
            and node.id not in self.env
            and self.visit(node)[1] == Const(function)
        )

    def _do_Break(self, node: ast.stmt) -> bool:
        self.lines.append("break")
        self._breaks.append(self.env)
        return False

    def _do_Continue(self, node: ast.stmt) -> bool:
        self.lines.append("continue")
        self._continues.append(self.env)
        return False


def _joined(ways: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The kinds where these ways meet; what is not there in all, or differs, is not to be read."""
    made = {}
    for name in [name for name in ways[0] if all(name in way for way in ways)]:
        with suppress(Unfit):
            made[name] = reduce(join, [way[name] for way in ways])
    return made


def _stored_in(*nodes: ast.AST) -> set[str]:
    inside = (n for node in nodes for n in ast.walk(node))
    return {n.id for n in inside if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
