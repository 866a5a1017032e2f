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
import types
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .calls import Calls
from .kinds import FLOAT, MADE, Const, Number, Other, Record, Table, Unfit, growing, join, number
from .pieces import Piece, counted, short, tuple_of
from .syntax import tree

if TYPE_CHECKING:
    from .source import Program

UNROLLED = 64  # items of a known list that a loop is written out for
TURNS = 16  # rounds of a loop that are followed one by one


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
        self.fails = False
        self.returns: list[Any] = []
        self._unrolling = False
        program.reads.text(function)
        node = tree(function)
        if node is None:
            raise Unfit(f"{what} cannot be compiled: its source text is not at hand or has changed")
        self.stored = set(function.__code__.co_varnames)
        self.env: dict[str, Any] = {}
        self.text: dict[str, str] = {}
        body = (
            [ast.Return(node.body, lineno=node.lineno)]
            if isinstance(node, ast.Lambda)
            else node.body
        )
        changed = {
            n.id
            for part in body
            for n in ast.walk(part)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        for name, (text, kind) in given.items():
            self.env[name], self.text[name] = kind, text
            if name in changed:
                self._set(name, (text, kind), node)
        if self._block(body):
            raise Unfit(f"{what} can end without a `return`")

    def _block(self, body: Sequence[ast.stmt]) -> bool:
        """Statements one after the other; False when what follows them is never reached."""
        for statement in body:
            method = getattr(self, f"_do_{type(statement).__name__}", None)
            if method is None:
                raise self.no(
                    statement, f"has a statement that is not compiled: {short(statement)}"
                )
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
            parts = [
                [ast.copy_location(ast.Return(part), node)] for part in (value.body, value.orelse)
            ]
            self._do_If(ast.copy_location(ast.If(value.test, *parts), node))
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
        if not isinstance(node.target, ast.Name):
            raise self.no(node, f"changes something in place: {short(node)}")
        old = ast.copy_location(ast.Name(node.target.id, ast.Load()), node)
        self._set(
            node.target.id,
            self.visit(ast.copy_location(ast.BinOp(old, node.op, node.value), node)),
            node,
        )

    def _assign(self, target: ast.expr, value: ast.expr, node: ast.AST) -> None:
        if isinstance(target, ast.Name):
            self._set(target.id, self.visit(value), node)
        elif isinstance(target, ast.Tuple | ast.List) and all(
            isinstance(t, ast.Name) for t in target.elts
        ):
            tuples = isinstance(value, ast.Tuple | ast.List)
            pieces = self.elements(value) if tuples else self.items(self._once(self.visit(value)))
            if pieces is None or len(pieces) != len(target.elts):
                raise self.no(
                    node, f"takes apart what is no tuple of {len(target.elts)}: {short(node)}"
                )
            for place, piece in enumerate(pieces):  # all values first: a, b = b, a
                self._set(f"{target.elts[place].id} new", piece, node)
            for each in target.elts:
                name = f"{each.id} new"
                self._set(each.id, (self.text[name], self.env[name]), node)
        elif isinstance(target, ast.Subscript) and isinstance(self.visit(target.value)[1], Other):
            self.lines.append(f"{self.visit(target)[0]} = {self.visit(value)[0]}")
        else:
            raise self.no(node, f"changes something in place: {short(node)}")

    def _set(self, name: str, piece: Piece, node: ast.AST) -> None:
        text, kind = counted(piece)
        self.env[name], self.text[name] = kind, self.prefix + name.replace(" ", "__")
        if isinstance(kind, Record) or isinstance(kind, Const) and number(kind) is None:
            return  # it stands for what it is; nothing to compute
        self.lines.append(f"{self.text[name]} = {text}")

    def _do_If(self, node: ast.If) -> bool:
        test, kind = self.visit(node.test)
        if isinstance(kind, Const):
            return self._block(node.body if kind.value else node.orelse)
        before, texts = self.env.copy(), self.text.copy()
        lines, on = self._inside(node.body)
        one, one_texts = self.env, self.text
        self.env, self.text = before.copy(), texts
        others, other_on = self._inside(node.orelse) if node.orelse else ([], True)
        self.lines += [f"if {test}:", *lines, *(["else:", *others] if others else [])]
        if on and other_on:
            self.env, self.text = self._joined(one, self.env), {**one_texts, **self.text}
        elif on:
            self.env, self.text = one, one_texts
        return on or other_on

    @staticmethod
    def _joined(one: dict[str, Any], two: dict[str, Any]) -> dict[str, Any]:
        """The kinds after two branches; a name that only one of them sets, or that differs, is
        not to be read.
        """
        made = {}
        for name in one.keys() & two.keys():
            try:
                made[name] = join(one[name], two[name])
            except Unfit:
                continue
        return made

    def _do_While(self, node: ast.While) -> None:
        self._no_else(node)
        self._loop(node, lambda: f"while {self.visit(node.test)[0]}:", None)

    def _do_For(self, node: ast.For) -> bool | None:
        self._no_else(node)
        if not isinstance(node.target, ast.Name):
            return self._unroll(node)
        if isinstance(node.iter, ast.Call) and self._is(node.iter.func, range):
            pieces = [self.visit(each) for each in node.iter.args]
            kinds = [number(kind) for _, kind in pieces]
            if node.iter.keywords or not all(k and not k.floating for k in kinds):
                raise self.no(node, f"counts over what are no whole numbers: {short(node.iter)}")
            known = all(isinstance(kind, Const) for _, kind in pieces)
            count = len(range(*(int(kind.value) for _, kind in pieces))) if known else None
            bound = max(k.bound for k in kinds)
            texts = ", ".join(
                text if isinstance(k, Const) else f"int({text})" for text, k in pieces
            )
            item, over = Number(False, MADE if bound > MADE else bound), f"range({texts})"
        else:
            text, kind = self.visit(node.iter)
            table = self._table((text, kind))
            if table is None or table[1].ndim != 1:
                if isinstance(kind, Other):
                    table, item = (text, Table(FLOAT, 1)), FLOAT
                else:
                    return self._unroll(node)
            over, item, count = table[0], table[1].item, None
            if isinstance(kind, Const):
                count = len(kind.value)
        name = node.target.id

        def head() -> str:
            self.env[name], self.text[name] = item, self.prefix + name
            return f"for {self.text[name]} in {over}:"

        self._loop(node, head, count)
        return None

    def _no_else(self, node: ast.For | ast.While) -> None:
        if node.orelse:
            raise self.no(node, "has a loop with `else`, which is not compiled")

    def _loop(self, node: ast.For | ast.While, head: Callable[[], str], count: int | None) -> None:
        """A loop: its body is gone through until the kinds of its variables change no more, then
        written.
        """
        outside = self.env.copy()
        history = [outside]
        unrolling, self._unrolling = self._unrolling, False
        turns = min(count, TURNS) if count else 3
        for _ in range(turns):
            lines, first = self._turn(node, head)
            after = self._joined(outside, self.env) | {
                k: v for k, v in self.env.items() if k not in outside
            }
            if after == history[-1]:
                break
            history.append(after)
            self.env = after.copy()
        else:
            if count != turns:
                a, b, c = history[-3:]
                self.env = {
                    name: growing(a.get(name), b.get(name), kind) for name, kind in c.items()
                }
                lines, first = self._turn(node, head)
        self._unrolling = unrolling
        self.lines += [first, *lines]
        if not count:  # perhaps it is not gone through at all
            self.env = {name: kind for name, kind in self.env.items() if name in outside}

    def _turn(self, node: ast.For | ast.While, head: Callable[[], str]) -> tuple[list[str], str]:
        known = {name: kind for name, kind in self.env.items()}
        for name in _stored_in(node):  # inside a loop a variable is no constant
            if name in known and (kind := number(known[name])) is not None:
                self.env[name] = kind
        first = head()
        lines, _ = self._inside(node.body)
        return lines, first

    def _unroll(self, node: ast.For) -> bool:
        """A loop over a few known items, or the items of a tuple, is written out."""
        pieces = self._iterated(node.iter)
        if pieces is None or len(pieces) > UNROLLED:
            raise self.no(node, f"loops over what is not compiled: {short(node.iter)}")
        if any(
            isinstance(n, ast.Break | ast.Continue) for part in node.body for n in ast.walk(part)
        ):
            raise self.no(node, "leaves a loop that is written out item by item")
        for piece in pieces:
            if isinstance(node.target, ast.Name):
                self._set(node.target.id, piece, node)
            else:
                inner = self.items(piece)
                if (
                    inner is None
                    or not isinstance(node.target, ast.Tuple)
                    or len(inner) != len(node.target.elts)
                ):
                    raise self.no(node, f"takes apart what is no such tuple: {short(node.target)}")
                for target, item in zip(node.target.elts, inner, strict=True):
                    if not isinstance(target, ast.Name):
                        raise self.no(node, f"takes apart too much at once: {short(node.target)}")
                    self._set(target.id, item, node)
            if not self._block(node.body):
                return False
        return True

    def _iterated(self, node: ast.expr) -> list[Piece] | None:
        """The items that a loop goes over, enumerate and zip included, if they are known one by
        one.
        """
        if isinstance(node, ast.Call) and not node.keywords:
            if self._is(node.func, zip):
                columns = [self._iterated(each) for each in node.args]
                if None not in columns:
                    # type: ignore[arg-type]
                    return [tuple_of(row) for row in zip(*columns, strict=False)]
                return None
            if self._is(node.func, enumerate) and len(node.args) == 1:
                column = self._iterated(node.args[0])
                return column and [
                    tuple_of(((str(k), Const(k)), piece)) for k, piece in enumerate(column)
                ]
        return self.items(self.visit(node))

    def _is(self, node: ast.expr, function: object) -> bool:
        return (
            isinstance(node, ast.Name)
            and node.id not in self.env
            and self.visit(node)[1] == Const(function)
        )

    def _do_Break(self, node: ast.stmt) -> bool:
        self.lines.append("break")
        return True

    def _do_Continue(self, node: ast.stmt) -> bool:
        self.lines.append("continue")
        return True


def _stored_in(node: ast.AST) -> set[str]:
    return {
        n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
