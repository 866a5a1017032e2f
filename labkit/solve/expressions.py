"""Expressions of a model function as pieces: names, attributes, tuples, tables, conditions."""

from __future__ import annotations

import ast
import functools
import operator
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .kinds import FLOAT, TRUTH, Const, Items, Number, Other, Record, Table, Unfit, join, number
from .pieces import Piece, counted, literal, run_time, short, tuple_of

__all__ = ["Expressions"]

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


class Expressions(Arithmetic):
    """visit(node) -> the expression as source, and its kind."""

    env: dict[str, Any]  # name -> kind
    text: dict[str, str]  # name -> source
    stored: set[str]
    lines: list[str]
    prefix: str

    def visit(self, node: ast.expr) -> Piece:
        """An expression as source, and its kind."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            raise self.no(node, f"has an expression that is not compiled: {short(node)}")
        return method(node)

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
            raise self.no(node, f"asks for {short(node)}, which is not a state or parameter")
        if isinstance(kind, Const):
            try:
                return self.known(self.program.reads.attribute(kind.value, node.attr))
            except AttributeError as error:
                raise self.no(node, f"asks for what is not there: {error}") from None
        if isinstance(kind, Other):
            return f"{text}.{node.attr}", kind
        raise self.no(node, f"asks for an attribute that is not compiled: {short(node)}")

    def _of_Tuple(self, node: ast.Tuple | ast.List) -> Piece:
        return tuple_of(self.elements(node))

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
                    raise self.no(node, f"takes apart what is not known: {short(each)}")
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
                    return tuple_of(found) if isinstance(found, list) else found
            except IndexError:
                if isinstance(base[1], Record):
                    raise self.no(
                        node, f"reads beyond the states or parameters: {short(node)}"
                    ) from None
                return self.failure()
            except TypeError as error:
                raise self.no(node, f"is not compiled: {short(node)}: {error}") from None
        if isinstance(base[1], Other):
            return f"{base[0]}[{index[0]}]", base[1]
        table = self._table(base)
        places = self.items(index) if isinstance(index[1], Items) else [index]
        if table is None or len(places) > table[1].ndim:
            raise self.no(node, f"reads from what is no table of numbers: {short(node)}")
        self.fails = True
        texts = []
        for text, kind in places:
            which = number(kind)
            if which is None or which.floating:
                raise self.no(node, f"has an index that is no whole number: {short(node)}")
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
            raise self.no(node, f"has a slice that is not known: {short(node)}")
        return self.visit(node)

    def _plain_table(self, value: object, node: ast.AST) -> None:
        if not isinstance(value, list | tuple | np.ndarray | str | range):
            raise self.no(
                node, f"reads from a {type(value).__name__}, which is not compiled: {short(node)}"
            )

    def _of_IfExp(self, node: ast.IfExp) -> Piece:
        test, kind = self.visit(node.test)
        if isinstance(kind, Const):
            return self.visit(node.body if kind.value else node.orelse)
        (one, a), (two, b) = self.visit(node.body), self.visit(node.orelse)
        try:
            kind = join(a, b) if a != b else run_time(a)
            if isinstance(kind, Number):
                one, two, kind = self._float((one, a)), self._float((two, b)), kind.counted()
            return f"({one} if {test} else {two})", kind
        except Unfit:
            raise self.no(
                node, f"has values of different kinds in one place: {short(node)}"
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
            raise self.no(node, f"joins what are no numbers or conditions: {short(node)}")
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
            raise self.no(node, f"compares what is not compiled: {short(node)}")
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
            raise self.no(node, f"is not compiled: {short(node)}")
        text = self._float((text, kind))
        return (f"(-{text})" if isinstance(node.op, ast.USub) else text), value.counted()

    def _of_BinOp(self, node: ast.BinOp) -> Piece:
        return self.binary(node, type(node.op), self.visit(node.left), self.visit(node.right))
