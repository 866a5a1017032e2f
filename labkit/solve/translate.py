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
import functools
import inspect
import math
import operator
import sys
import types
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .checked import OF_MATH
from .kinds import (
    EXACT,
    FLOAT,
    LARGE,
    MADE,
    OF_NUMPY,
    TRUTH,
    Const,
    Items,
    Number,
    Other,
    Record,
    Table,
    Unfit,
    growing,
    join,
    number,
)
from .syntax import tree

if TYPE_CHECKING:
    from .source import Program

Piece = tuple[str, Any]  # source of an expression, and its kind

_BINARY = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.FloorDiv: ("//", operator.floordiv),
    ast.Mod: ("%", operator.mod),
    ast.Pow: ("**", operator.pow),
    ast.MatMult: ("@", operator.matmul),
    ast.BitAnd: ("&", operator.and_),
    ast.BitOr: ("|", operator.or_),
    ast.BitXor: ("^", operator.xor),
    ast.LShift: ("<<", operator.lshift),
    ast.RShift: (">>", operator.rshift),
}
_COMPARE = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
    ast.Is: ("is", operator.is_),
    ast.IsNot: ("is not", operator.is_not),
    ast.In: ("in", lambda a, b: a in b),
    ast.NotIn: ("not in", lambda a, b: a not in b),
}
_UNARY = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Invert: operator.invert,
}
_PURE = (abs, bool, divmod, float, int, len, list, max, min, pow, round, sorted, sum, tuple)
_ROUND = {
    int: "do_trunc",
    math.trunc: "do_trunc",
    math.floor: "do_floor",
    math.ceil: "do_ceil",
    round: "do_rint",
}
_TRUTHS = (math.isnan, math.isinf, math.isfinite)
UNROLLED = 64  # items of a known list that a loop is written out for
TURNS = 16  # rounds of a loop that are followed one by one
_PLACES = ("argmax", "argmin", "searchsorted", "digitize")  # of NumPy: they give an index
_METHODS = (
    "all",
    "any",
    "argmax",
    "argmin",
    "item",
    "max",
    "mean",
    "min",
    "sum",
)  # of known arrays


class Body:
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

    # ------------------------------------------------------------ statements

    def no(self, node: ast.AST, why: str) -> Unfit:
        line = f" (line {node.lineno})" if hasattr(node, "lineno") else ""
        return Unfit(f"{self.what}{line} {why}")

    def _block(self, body: Sequence[ast.stmt]) -> bool:
        """Statements one after the other; False when what follows them is never reached."""
        for statement in body:
            method = getattr(self, f"_do_{type(statement).__name__}", None)
            if method is None:
                raise self.no(
                    statement, f"has a statement that is not compiled: {_short(statement)}"
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
            raise self.no(node, f"computes something for its effect: {_short(node)}")

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
            raise self.no(node, f"assigns to two targets at once: {_short(node)}")
        self._assign(node.targets[0], node.value, node)

    def _do_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assign(node.target, node.value, node)

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        if not isinstance(node.target, ast.Name):
            raise self.no(node, f"changes something in place: {_short(node)}")
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
                    node, f"takes apart what is no tuple of {len(target.elts)}: {_short(node)}"
                )
            for place, piece in enumerate(pieces):  # all values first: a, b = b, a
                self._set(f"{target.elts[place].id} new", piece, node)
            for each in target.elts:
                name = f"{each.id} new"
                self._set(each.id, (self.text[name], self.env[name]), node)
        elif isinstance(target, ast.Subscript) and isinstance(self.visit(target.value)[1], Other):
            self.lines.append(f"{self.visit(target)[0]} = {self.visit(value)[0]}")
        else:
            raise self.no(node, f"changes something in place: {_short(node)}")

    def _once(self, piece: Piece) -> Piece:
        """The piece under a name, so that its parts can be taken without computing all of it
        again.
        """
        text, kind = piece
        if not isinstance(kind, Items) or text.isidentifier():
            return piece
        name = f"{self.prefix}part{len(self.lines)}"
        self.lines.append(f"{name} = {text}")
        return name, kind

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
                raise self.no(node, f"counts over what are no whole numbers: {_short(node.iter)}")
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
            raise self.no(node, f"loops over what is not compiled: {_short(node.iter)}")
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
                    raise self.no(node, f"takes apart what is no such tuple: {_short(node.target)}")
                for target, item in zip(node.target.elts, inner, strict=True):
                    if not isinstance(target, ast.Name):
                        raise self.no(node, f"takes apart too much at once: {_short(node.target)}")
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
                    return [_tuple(row) for row in zip(*columns, strict=False)]
                return None
            if self._is(node.func, enumerate) and len(node.args) == 1:
                column = self._iterated(node.args[0])
                return column and [
                    _tuple(((str(k), Const(k)), piece)) for k, piece in enumerate(column)
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

    # ------------------------------------------------------------ expressions

    def visit(self, node: ast.expr) -> Piece:
        """An expression as source, and its kind."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            raise self.no(node, f"has an expression that is not compiled: {_short(node)}")
        return method(node)

    def known(self, value: Any) -> Piece:
        """The piece of a known value; tables and functions get a name when they are used."""
        return literal(value), Const(value)

    def _of_Constant(self, node: ast.Constant) -> Piece:
        return self.known(node.value)

    def _of_Name(self, node: ast.Name) -> Piece:
        if node.id in self.env:
            kind = self.env[node.id]
            return (literal(kind.value) if isinstance(kind, Const) else self.text[node.id]), kind
        if node.id in self.stored:
            raise self.no(
                node,
                f"reads {node.id!r}, which may have no value there, or values of different kinds",
            )
        try:
            return self.known(self.program.reads.name(self.function, node.id))
        except NameError as error:
            raise self.no(node, f"asks for a name that is not there: {error}") from None

    def _of_Attribute(self, node: ast.Attribute) -> Piece:
        text, kind = self.visit(node.value)
        if isinstance(kind, Record):
            for name, place in kind.places:
                if name == node.attr:
                    return f"{kind.array}[{place}]", FLOAT
            raise self.no(node, f"asks for {_short(node)}, which is not a state or parameter")
        if isinstance(kind, Const):
            try:
                return self.known(self.program.reads.attribute(kind.value, node.attr))
            except AttributeError as error:
                raise self.no(node, f"asks for what is not there: {error}") from None
        if isinstance(kind, Other):
            return f"{text}.{node.attr}", kind
        raise self.no(node, f"asks for an attribute that is not compiled: {_short(node)}")

    def _of_Tuple(self, node: ast.Tuple | ast.List) -> Piece:
        return _tuple(self.elements(node))

    _of_List = _of_Tuple

    def all_items(self, node: ast.expr) -> list[Piece] | None:
        """The items of what a `return` returns; None where they are not known one by one."""
        if isinstance(node, ast.Tuple | ast.List):
            return self.elements(node, once=True)
        return self.items(self._once(self.visit(node)))

    def elements(self, node: ast.Tuple | ast.List, once: bool = False) -> list[Piece]:
        """The items of (a, *b): all of them, what is starred taken apart."""
        pieces: list[Piece] = []
        for each in node.elts:
            if isinstance(each, ast.Starred):
                piece = self.visit(each.value)
                inner = self.items(self._once(piece) if once else piece)
                if inner is None:
                    raise self.no(node, f"takes apart what is not known: {_short(each)}")
                pieces += inner
            else:
                pieces.append(self.visit(each))
        return pieces

    def items(self, piece: Piece) -> list[Piece] | None:
        """The pieces of a tuple or a known list, None where they are not known."""
        text, kind = piece
        if isinstance(kind, Items):
            return [(f"{text}[{k}]", each) for k, each in enumerate(kind.kinds)]
        if isinstance(kind, Record):
            return [(each, FLOAT) for each in kind.texts()]
        if isinstance(kind, Const) and isinstance(
            kind.value, list | tuple | np.ndarray | range | str
        ):
            return [self.known(value) for value in kind.value]
        return None

    def _of_Subscript(self, node: ast.Subscript) -> Piece:
        base, index = self.visit(node.value), self._index(node.slice)
        pieces = self.items(base) if not isinstance(base[1], Const) else None
        if isinstance(index[1], Const):
            try:
                if isinstance(base[1], Const):
                    self._plain_table(base[1].value, node)
                    return self.known(base[1].value[index[1].value])
                if pieces is not None:
                    found = pieces[index[1].value]
                    return _tuple(found) if isinstance(found, list) else found
            except IndexError:
                if isinstance(base[1], Record):
                    raise self.no(
                        node, f"reads beyond the states or parameters: {_short(node)}"
                    ) from None
                return self.failure()
            except TypeError as error:
                raise self.no(node, f"is not compiled: {_short(node)}: {error}") from None
        if isinstance(base[1], Other):
            return f"{base[0]}[{index[0]}]", base[1]
        table = self._table(base)
        places = self.items(index) if isinstance(index[1], Items) else [index]
        if table is None or len(places) > table[1].ndim:
            raise self.no(node, f"reads from what is no table of numbers: {_short(node)}")
        self.fails = True
        texts = []
        for text, kind in places:
            which = number(kind)
            if which is None or which.floating:
                raise self.no(node, f"has an index that is no whole number: {_short(node)}")
            texts.append(text if isinstance(kind, Const) else f"int({counted((text, kind))[0]})")
        left = table[1].ndim - len(places)
        kind = Table(table[1].item, left) if left else table[1].item
        return f"{table[0]}[{', '.join(texts)}]", kind

    def _index(self, node: ast.expr) -> Piece:
        if isinstance(node, ast.Slice):
            ends = [
                Const(None) if e is None else self.visit(e)[1]
                for e in (node.lower, node.upper, node.step)
            ]
            if all(isinstance(end, Const) for end in ends):
                text = ":".join("" if end.value is None else str(end.value) for end in ends)
                return text, Const(slice(*(end.value for end in ends)))
            raise self.no(node, f"has a slice that is not known: {_short(node)}")
        return self.visit(node)

    def _plain_table(self, value: object, node: ast.AST) -> None:
        if not isinstance(value, list | tuple | np.ndarray | str | range):
            raise self.no(
                node, f"reads from a {type(value).__name__}, which is not compiled: {_short(node)}"
            )

    def _table(self, piece: Piece) -> Piece | None:
        """A table of numbers under a name of its own."""
        text, kind = piece
        if isinstance(kind, Table):
            return piece
        if not isinstance(kind, Const) or not isinstance(kind.value, list | tuple | np.ndarray):
            return None
        return self.program.table(kind.value)

    def failure(self) -> Piece:
        """What Python cannot compute at all: an index beyond a known table."""
        self.fails = True
        return "do_trunc(nan)", FLOAT

    def _of_IfExp(self, node: ast.IfExp) -> Piece:
        test, kind = self.visit(node.test)
        if isinstance(kind, Const):
            return self.visit(node.body if kind.value else node.orelse)
        (one, a), (two, b) = self.visit(node.body), self.visit(node.orelse)
        try:
            kind = join(a, b) if a != b else _run_time(a)
            if isinstance(kind, Number):
                one, two, kind = self._float((one, a)), self._float((two, b)), kind.counted()
            return f"({one} if {test} else {two})", kind
        except Unfit:
            raise self.no(
                node, f"has values of different kinds in one place: {_short(node)}"
            ) from None

    def _of_BoolOp(self, node: ast.BoolOp) -> Piece:
        word, stops = ("and", False) if isinstance(node.op, ast.And) else ("or", True)
        pieces: list[Piece] = []
        for each in node.values:
            piece = self.visit(each)
            last = each is node.values[-1]
            if isinstance(piece[1], Const) and not last and bool(piece[1].value) is not stops:
                continue  # known and of no consequence
            pieces.append(piece)
            if isinstance(piece[1], Const) and bool(piece[1].value) is stops:
                break
        if len(pieces) == 1:
            return pieces[0]
        kinds = [number(kind) for _, kind in pieces]
        if None in kinds:
            raise self.no(node, f"joins what are no numbers or conditions: {_short(node)}")
        truths = all(kind == TRUTH for _, kind in pieces)
        texts = [text if truths else self._float((text, kind)) for text, kind in pieces]
        kind = TRUTH if truths else functools.reduce(join, [each.counted() for each in kinds])
        return f"({f' {word} '.join(texts)})", kind

    def _of_Compare(self, node: ast.Compare) -> Piece:
        pieces = [self.visit(each) for each in (node.left, *node.comparators)]
        signs = [_COMPARE[type(op)] for op in node.ops]
        if all(isinstance(kind, Const) for _, kind in pieces):
            values = [kind.value for _, kind in pieces]
            with self._folding(node):
                return self.known(
                    all(
                        bool(f(a, b))
                        for (_, f), a, b in zip(signs, values, values[1:], strict=False)
                    )
                )
        if any(isinstance(kind, Other) for _, kind in pieces):
            return self._plainly(signs, pieces), Other()
        kinds = [number(kind) for _, kind in pieces]
        if None in kinds or any(sign[0] in ("is", "is not", "in", "not in") for sign in signs):
            raise self.no(node, f"compares what is not compiled: {_short(node)}")
        for kind in kinds:
            self._not_larger(kind.bound, node)
        return self._plainly(signs, [counted(piece) for piece in pieces]), TRUTH

    @staticmethod
    def _plainly(signs: list, pieces: list[Piece]) -> str:
        text = pieces[0][0]
        for (sign, _), (other, _) in zip(signs, pieces[1:], strict=True):
            text += f" {sign} {other}"
        return f"({text})"

    def _of_UnaryOp(self, node: ast.UnaryOp) -> Piece:
        text, kind = self.visit(node.operand)
        if isinstance(kind, Const):
            with self._folding(node):
                return self.known(_UNARY[type(node.op)](kind.value))
        if isinstance(node.op, ast.Not):
            return f"(not {text})", TRUTH
        if isinstance(kind, Other):
            return f"({ast.unparse(ast.UnaryOp(node.op, ast.Name('x')))[:-1]}{text})", kind
        value = number(kind)
        if value is None or isinstance(node.op, ast.Invert):
            raise self.no(node, f"is not compiled: {_short(node)}")
        text = self._float((text, kind))
        return (f"(-{text})" if isinstance(node.op, ast.USub) else text), value.counted()

    def _folding(self, node: ast.AST) -> _Folding:
        return _Folding(self, node)

    def _of_BinOp(self, node: ast.BinOp) -> Piece:
        return self.binary(node, type(node.op), self.visit(node.left), self.visit(node.right))

    def binary(self, node: ast.AST, op: type, left: Piece, right: Piece) -> Piece:
        """left op right: Python's own value where both are known."""
        sign, compute = _BINARY[op]
        (a, one), (b, two) = left, right
        if (
            isinstance(one, Const)
            and isinstance(two, Const)
            and not _huge(op, one.value, two.value)
        ):
            try:
                with np.errstate(all="ignore"):
                    return self.known(compute(one.value, two.value))
            except ArithmeticError:
                return self.failure()
            except (TypeError, ValueError) as error:
                raise self.no(node, f"is not compiled: {_short(node)}: {error}") from None
        if any(isinstance(kind, Other | Table) or _is_table(kind) for kind in (one, two)):
            a, b = (self._table(piece) or piece for piece in (left, right))
            return f"({a[0]} {sign} {b[0]})", Other()
        x, y = number(one), number(two)
        if x is None or y is None or op in (ast.MatMult, ast.LShift, ast.RShift):
            raise self.no(node, f"is not compiled: {_short(node)}")
        if op is ast.Pow:
            return self._power(node, left, right)
        if op in (ast.BitAnd, ast.BitOr, ast.BitXor):
            if not (x.truth and y.truth):
                raise self.no(node, f"is not compiled: {_short(node)}")
            return f"({a} {sign} {b})", TRUTH
        numpy = x.numpy or y.numpy
        if op is ast.Div and numpy and not (isinstance(two, Const) and two.value != 0):
            return f"do_division({self._float(left)}, {self._float(right)})", OF_NUMPY
        if op in (ast.Div, ast.FloorDiv, ast.Mod) and not (
            isinstance(two, Const) and two.value != 0
        ):
            self.fails = True
        if x.bound is None or y.bound is None:  # no whole numbers among themselves
            return f"({self._in_float(left)} {sign} {self._in_float(right)})", Number(
                True, numpy=numpy
            )
        if op in (ast.FloorDiv, ast.Mod):
            self._every_digit(x, node)
            self._every_digit(y, node)
            self._own_rules(node, x, y)
        bound = {
            ast.Add: x.bound + y.bound,
            ast.Sub: x.bound + y.bound,
            ast.Mult: x.bound * y.bound,
            ast.Div: None,
            ast.FloorDiv: x.bound,
            ast.Mod: y.bound,
        }[op]
        self._not_larger(bound, node)
        floating = bound is None or x.floating or y.floating
        kind = Number(floating, bound, numpy)
        return f"({self._float(left)} {sign} {self._float(right)})", kind

    def _power(self, node: ast.AST, left: Piece, right: Piece) -> Piece:
        self.fails = True
        x, y = number(left[1]), number(right[1])
        exponent = right[1].value if isinstance(right[1], Const) else None
        bound = None
        if x.bound is not None and y.bound is not None:
            self._own_rules(node, x, y)
            bound = 1.0 if x.bound <= 1 else _grown(x.bound, y.bound)
            self._not_larger(bound, node)
        floating = x.floating or y.floating or exponent is None or exponent < 0
        numpy = x.numpy or y.numpy
        kind = Number(floating or bound is None, bound, numpy)
        if numpy:
            return f"do_numpy_power({self._float(left)}, {self._float(right)})", kind
        return f"do_power({self._float(left)}, {self._float(right)})", kind

    def _not_larger(self, bound: float | None, node: ast.AST) -> None:
        if bound is not None and bound > LARGE:
            raise self.no(
                node,
                f"has whole numbers that may grow beyond 2**63, {_short(node)}: "
                "make one of them a float",
            )

    def _every_digit(self, kind: Number, node: ast.AST) -> None:
        if kind.bound is not None and kind.bound > EXACT:
            raise self.no(
                node, f"has whole numbers beyond 2**53 of which every digit counts: {_short(node)}"
            )

    def _own_rules(self, node: ast.AST, x: Number, y: Number) -> None:
        if x.numpy or y.numpy:
            raise self.no(
                node,
                "reckons with NumPy's whole numbers, which have rules of their own: "
                f"{_short(node)}",
            )

    def _float(self, piece: Piece) -> str:
        """The piece as a float."""
        return as_float(piece)

    def _in_float(self, piece: Piece) -> str:
        """The piece beside a float, which makes it one where it must."""
        text, kind = piece
        return self._float(piece) if number(kind).bound == 1.0 else text

    # ------------------------------------------------------------ calls

    def _of_Call(self, node: ast.Call) -> Piece:
        text, kind = self.visit(node.func)
        if isinstance(kind, Other):  # a method of an array made here
            arguments = [self._argument(self.visit(each)) for each in node.args]
            if node.keywords:
                raise self.no(node, f"is not compiled: {_short(node)}")
            return f"{text}({', '.join(arguments)})", kind
        if not isinstance(kind, Const):
            raise self.no(node, f"calls what is no function: {_short(node)}")
        pieces = self.elements(ast.Tuple(node.args))
        named = {each.arg: self.visit(each.value) for each in node.keywords}
        if None in named:
            raise self.no(node, f"is not compiled: {_short(node)}")
        return self._call(node, kind.value, pieces, named)

    def _call(
        self, node: ast.Call, function: Any, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        if not _hashable(function):
            raise self.no(node, f"calls what is no function: {_short(node)}")
        of_numpy = _of_numpy(function)
        inner, first, words = underlying(function)
        module = (getattr(inner, "__module__", None) or "").split(".")[0]
        if inner is not None and not of_numpy and module not in sys.stdlib_module_names:
            pieces = [*map(self.known, first), *pieces]
            named = {**{key: self.known(value) for key, value in words.items()}, **named}
            return self.program.helper(self, node, inner, pieces, named)
        pure = function in _PURE or (
            isinstance(getattr(function, "__self__", None), np.ndarray)
            and function.__name__ in _METHODS
        )
        name = OF_MATH.get(function)
        of_math = getattr(function, "__module__", None) == "math"
        if (pure or of_math or of_numpy) and all(
            isinstance(kind, Const) for _, kind in (*pieces, *named.values())
        ):
            return self._folded(node, function, pieces, named)
        if of_numpy:
            return self._numpy(function, pieces, named)
        numbers = [number(kind) for _, kind in pieces]
        if not named and None not in numbers:
            if name is not None:
                self.fails = True
                return f"{name}({', '.join(map(self._float, pieces))})", FLOAT
            if function in _ROUND and len(pieces) == 1:
                return self._whole(function, pieces[0])
            if function in _TRUTHS:
                return f"{self.program.name(function)}({self._float(pieces[0])})", TRUTH
            if function in (float, np.float64) and len(pieces) == 1:
                return self._float(pieces[0]), FLOAT
            if function is bool and len(pieces) == 1:
                return f"({pieces[0][0]} != 0)", TRUTH
            if function is abs and len(pieces) == 1:
                return f"abs({self._float(pieces[0])})", numbers[0].counted()
            if function is pow and len(pieces) == 2:
                return self.binary(node, ast.Pow, *pieces)
        if function in (min, max) and not named:
            return self._extreme(node, function, pieces)
        if function is len and len(pieces) == 1 and (found := self.items(pieces[0])) is not None:
            return self.known(len(found))
        raise self.no(node, f"calls {_called(function)}, which is not compiled")

    def _folded(
        self, node: ast.AST, function: Callable, pieces: list[Piece], named: dict[str, Piece]
    ) -> Piece:
        values = [kind.value for _, kind in pieces]
        words = {key: kind.value for key, (_, kind) in named.items()}
        try:
            with np.errstate(all="ignore"):
                return self.known(function(*values, **words))
        except OverflowError:
            return (literal(math.inf), FLOAT) if function in OF_MATH else self.failure()
        except (ArithmeticError, ValueError, LookupError):
            return self.failure()
        except TypeError as error:
            raise self.no(node, f"is not compiled: {_short(node)}: {error}") from None

    def _whole(self, function: Callable, piece: Piece) -> Piece:
        kind = number(piece[1])
        if not kind.floating:
            return self._float(piece), Number(False, kind.bound)
        self.fails = True
        return f"{_ROUND[function]}({self._float(piece)})", Number(
            False, max(MADE, kind.bound or 0.0)
        )

    def _extreme(self, node: ast.AST, function: Callable, pieces: list[Piece]) -> Piece:
        if len(pieces) == 1:
            pieces = self.items(pieces[0]) or []
        kinds = [number(kind) for _, kind in pieces]
        if not kinds or None in kinds:
            raise self.no(
                node, f"calls {function.__name__} of what is not compiled: {_short(node)}"
            )
        bounds = [kind.bound for kind in kinds if kind.bound is not None]
        kind = Number(
            any(k.floating for k in kinds), max(bounds, default=None), any(k.numpy for k in kinds)
        )
        text = self._float(pieces[0])
        for piece in pieces[1:]:  # two at a time, as Python compares them
            text = f"{function.__name__}({text}, {self._float(piece)})"
        return text, kind

    def _numpy(self, function: Callable, pieces: list[Piece], named: dict[str, Piece]) -> Piece:
        arguments = [self._argument(piece) for piece in pieces]
        arguments += [f"{key}={self._argument(piece)}" for key, piece in named.items()]
        text = f"{self.program.name(function)}({', '.join(arguments)})"
        numbers = [number(kind) is not None for _, kind in pieces]
        if isinstance(function, np.ufunc) and all(numbers) or function is np.interp and numbers[0]:
            return text, OF_NUMPY
        if function.__name__ in _PLACES:
            return text, Number(False, 2.0**31, True)
        return text, Other()

    def _argument(self, piece: Piece) -> str:
        """The piece as NumPy's functions take it; whole numbers as they are."""
        table = self._table(piece)
        if table is not None:
            return table[0]
        if isinstance(piece[1], Const) and number(piece[1]) is None and piece[1].value is not None:
            raise Unfit(
                f"{self.what} hands a {type(piece[1].value).__name__} to a function of NumPy"
            )
        if isinstance(piece[1], Record):
            return f"({', '.join(piece[1].texts())},)"
        return piece[0]


class _Folding:
    """with body._folding(node): errors while known values are computed become Unfit."""

    def __init__(self, body: Body, node: ast.AST):
        self.body, self.node = body, node

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, TypeError | ValueError | ArithmeticError):
            raise self.body.no(
                self.node, f"is not compiled: {_short(self.node)}: {error}"
            ) from None


def underlying(function: Any) -> tuple[types.FunctionType | None, tuple, dict]:
    """underlying(partial(f, 2.0)) -> (f, (2.0,), {}), also of methods and objects that can be
    called; (None, (), {}) of others.
    """
    function = getattr(function, "py_func", function)  # a helper under @njit
    if isinstance(function, types.FunctionType):
        return function, (), {}
    if isinstance(function, functools.partial):
        inner, first, words = underlying(function.func)
        return inner, (*first, *function.args), {**words, **function.keywords}
    if isinstance(function, types.MethodType):
        inner, first, words = underlying(function.__func__)
        return inner, (function.__self__, *first), words
    kinds = [vars(kind) for kind in type(function).__mro__]
    call = next((kind["__call__"] for kind in kinds if "__call__" in kind), None)
    if isinstance(call, types.FunctionType):
        return call, (function,), {}
    return None, (), {}


def bind(
    function: types.FunctionType, pieces: list[Any], named: dict[str, Any], default: Callable
) -> dict[str, Any]:
    """bind(f, pieces, named, default) -> argument -> piece; default(name, value) makes the
    others' pieces.
    """
    signature = inspect.signature(function)
    bound = signature.bind(*pieces, **named)
    for name, parameter in signature.parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise TypeError(f"it takes *{name}")
    return {
        name: bound.arguments[name] if name in bound.arguments else default(name, parameter.default)
        for name, parameter in signature.parameters.items()
    }


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


def _tuple(pieces: Sequence[Piece]) -> Piece:
    pieces = [counted(piece) for piece in pieces]
    if pieces and all(isinstance(kind, Const) for _, kind in pieces):
        return "None", Const(tuple(kind.value for _, kind in pieces))
    texts = [
        literal(float(kind.value)) if isinstance(kind, Const) and number(kind) else text
        for text, kind in pieces
    ]
    return f"({', '.join(texts)},)", Items(tuple(kind for _, kind in pieces))


def _run_time(kind: Any) -> Any:
    return number(kind) or kind


def _is_table(kind: Any) -> bool:
    return isinstance(kind, Const) and isinstance(kind.value, np.ndarray | list | tuple)


def _grown(base: float, exponent: float) -> float:
    return base**exponent if exponent * math.log2(base) < 1000 else math.inf


def _huge(op: type, a: Any, b: Any) -> bool:
    """Would Python compute for ever, or fill the memory?"""
    whole = isinstance(a, int) and isinstance(b, int)
    if whole and op is ast.Pow:
        return abs(a) > 1 and b > 0 and a.bit_length() * b > 100_000
    return op is ast.LShift and whole and b > 100_000


def _of_numpy(function: Any) -> bool:
    if isinstance(function, np.ufunc):
        return True
    module = getattr(function, "__module__", None) or ""
    random = module.startswith("numpy.random")
    return (
        callable(function)
        and not isinstance(function, type)
        and module.split(".")[0] == "numpy"
        and not random
    )


def _hashable(value: Any) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True


def _called(function: Any) -> str:
    name = (
        getattr(function, "__qualname__", None)
        or getattr(function, "__name__", None)
        or repr(function)
    )
    module = getattr(function, "__module__", None) or ""
    return name if module in ("builtins", "") else f"{module}.{name}"


def _stored_in(node: ast.AST) -> set[str]:
    return {
        n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return f"`{text}`" if len(text) <= 60 else f"`{text[:57]}…`"
