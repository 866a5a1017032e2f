"""Expressions of a model function as pieces: names, attributes, tuples, tables, conditions."""

from __future__ import annotations

import ast
import functools
import operator
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .kinds import (
    FLOAT,
    TRUTH,
    Const,
    Items,
    Number,
    Other,
    Record,
    Table,
    Unfit,
    join,
    number,
    of_numpy,
)
from .pieces import Piece, as_float, counted, known, literal, short, tuple_of

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
    ast.USub: ("-", operator.neg),
    ast.UAdd: ("+", operator.pos),
    ast.Not: ("not ", operator.not_),
    ast.Invert: ("~", operator.invert),
}


class Expressions(Arithmetic):
    """visit(node) -> the expression as source, and its kind."""

    env: dict[str, Any]  # name -> kind
    given: dict[str, str]  # name of an argument that is never set anew -> source
    stored: set[str]
    lines: list[str]
    parts: Iterator[int]
    prefix: str

    def visit(self, node: ast.expr) -> Piece:
        """An expression as source, and its kind."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            raise self.no(node, f"has an expression that is not compiled: {short(node)}")
        return method(node)

    def _once(self, piece: Piece) -> Piece:
        """A tuple under a name, so that it is computed once, however many parts are taken."""
        return self.held(piece) if isinstance(piece[1], Items) else piece

    def held(self, piece: Piece) -> Piece:
        """The piece as it is now, under a name that no variable has."""
        text, kind = counted(piece)
        if isinstance(kind, Const | Record):
            return piece
        name = f"{self.prefix[:-1]}part{next(self.parts)}"
        self.lines.append(f"{name} = {text}")
        return name, kind

    def truth(self, node: ast.expr) -> Piece:
        """A condition: whether the expression counts as true."""
        text, kind = self.visit(node)
        if isinstance(kind, Const):
            return self.computed(node, bool, kind.value)
        if number(kind) is None and not isinstance(kind, Other):
            raise self.no(node, f"takes for a condition what is none: {short(node)}")
        return text, kind

    def named(self, name: str) -> str:
        """What a variable of the function is called in the source."""
        return self.given.get(name, self.prefix + name)

    def _of_Constant(self, node: ast.Constant) -> Piece:
        return known(node.value)

    def _of_Name(self, node: ast.Name) -> Piece:
        if node.id in self.env:
            kind = self.env[node.id]
            if isinstance(kind, Record):  # it stands for what it is; its parts have a text
                return "None", kind
            return (literal(kind.value) if isinstance(kind, Const) else self.named(node.id)), kind
        if node.id in self.stored:
            why = "which may have no value there, or values of different kinds"
            raise self.no(node, f"reads {node.id!r}, {why}")
        try:
            return known(self.program.reads.name(self.function, node.id))
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
                return known(self.program.reads.attribute(kind.value, node.attr))
            except AttributeError as error:
                raise self.no(node, f"asks for what is not there: {error}") from None
        if isinstance(kind, Other):
            return f"{text}.{node.attr}", kind
        raise self.no(node, f"asks for an attribute that is not compiled: {short(node)}")

    def _of_Tuple(self, node: ast.Tuple | ast.List) -> Piece:
        return tuple_of(self.elements(node))

    _of_List = _of_Tuple

    def all_items(self, node: ast.expr) -> list[Piece] | None:
        """The items of a tuple in a statement, each part computed once; None where not known."""
        if isinstance(node, ast.Tuple | ast.List):
            return self.elements(node, self._once)
        return self.items(self._once(self.visit(node)))

    def elements(self, node: ast.Tuple | ast.List, once: Callable = lambda x: x) -> list[Piece]:
        """The items of (a, *b): all of them, what is starred taken apart."""
        pieces: list[Piece] = []
        for each in node.elts:
            if not isinstance(each, ast.Starred):
                pieces.append(self.visit(each))
            elif (inner := self.items(once(self.visit(each.value)))) is not None:
                pieces += inner
            else:
                raise self.no(node, f"takes apart what is not known: {short(each)}")
        return pieces

    def items(self, piece: Piece) -> list[Piece] | None:
        """The pieces of a tuple or a known list, None where they are not known."""
        text, kind = piece
        if isinstance(kind, Items):
            return [(f"{text}[{k}]", each) for k, each in enumerate(kind.kinds)]
        if isinstance(kind, Record):
            return [(each, FLOAT) for each in kind.texts()]
        value = kind.value if isinstance(kind, Const) else None
        many = isinstance(value, list | tuple | np.ndarray | range | str)
        return [*map(known, value)] if many else None

    def _of_Subscript(self, node: ast.Subscript) -> Piece:
        base, (index, which) = self.visit(node.value), self._index(node.slice)
        text, kind = base
        if isinstance(kind, Const) and isinstance(which, Const):
            if not isinstance(kind.value, list | tuple | np.ndarray | str | range | dict):
                what = type(kind.value).__name__
                raise self.no(node, f"reads from a {what}, which is not compiled: {short(node)}")
            return self.computed(node, operator.getitem, kind.value, which.value)
        if isinstance(kind, Items | Record) and isinstance(which, Const):
            pieces = self.items(base)
            try:
                found = pieces[which.value]
            except TypeError as error:
                raise self.no(node, f"is not compiled: {short(node)}: {error}") from None
            except IndexError:
                if isinstance(kind, Record):
                    why = f"reads beyond the states or parameters: {short(node)}"
                    raise self.no(node, why) from None
                return self.failure()
            if isinstance(found, list):
                return tuple_of(found)
            return found[0], number(found[1]) or found[1]  # what stands beside it may fail
        if isinstance(kind, Other):
            return f"{text}[{index}]", kind
        table = self._table(base)
        places = self.items((index, which)) if isinstance(which, Items) else [(index, which)]
        if table is None or len(places) > table[1].ndim:
            raise self.no(node, f"reads from what is no table of numbers: {short(node)}")
        self.fails = True
        texts = []
        for place, each in places:
            whole = number(each)
            if whole is None or whole.floating:
                raise self.no(node, f"has an index that is no whole number: {short(node)}")
            fixed = isinstance(each, Const)
            texts.append(place if fixed else f"int({counted((place, each))[0]})")
        left, item = table[1].ndim - len(places), table[1].item
        return f"{table[0]}[{', '.join(texts)}]", Table(item, left) if left else item

    def _index(self, node: ast.expr) -> Piece:
        if not isinstance(node, ast.Slice):
            return self.visit(node)
        ends = [e and self.visit(e)[1] for e in (node.lower, node.upper, node.step)]
        if not all(end is None or isinstance(end, Const) for end in ends):
            raise self.no(node, f"has a slice that is not known: {short(node)}")
        values = [end and end.value for end in ends]
        text = ":".join("" if value is None else str(value) for value in values)
        return text, Const(slice(*values))

    def _of_IfExp(self, node: ast.IfExp) -> Piece:
        test, kind = self.truth(node.test)
        if isinstance(kind, Const):
            return self.visit(node.body if kind.value else node.orelse)
        one, two = self.visit(node.body), self.visit(node.orelse)
        try:
            kind = join(one[1], two[1])
        except Unfit:
            why = f"has values of different kinds in one place: {short(node)}"
            raise self.no(node, why) from None
        if value := number(kind):
            return f"({as_float(one)} if {test} else {as_float(two)})", value.counted()
        return f"({one[0]} if {test} else {two[0]})", kind

    def _of_BoolOp(self, node: ast.BoolOp) -> Piece:
        word, stops = ("and", False) if isinstance(node.op, ast.And) else ("or", True)
        pieces: list[Piece] = []
        for each in node.values:
            text, kind = self.visit(each)
            fixed = isinstance(kind, Const)
            truth = self.computed(each, bool, kind.value)[1] if fixed else None
            if truth == Const(not stops) and each is not node.values[-1]:
                continue  # known and of no consequence
            pieces.append((text, kind))
            if truth == Const(stops):
                break
        if len(pieces) == 1:
            return pieces[0]
        kind = self.joined(pieces)
        if kind is None:
            raise self.no(node, f"joins what are no numbers or conditions: {short(node)}")
        truths = all(isinstance(each, Number) and each.truth for _, each in pieces)
        texts = [text for text, _ in pieces] if truths else map(as_float, pieces)
        return f"({f' {word} '.join(texts)})", replace(kind, truth=truths)

    @staticmethod
    def joined(pieces: list[Piece]) -> Number | None:
        """The kind of what is one of these numbers; None where one is no number."""
        kinds = [number(kind) for _, kind in pieces]
        if None in kinds or not kinds:
            return None
        return functools.reduce(join, [kind.counted() for kind in kinds])

    def _of_Compare(self, node: ast.Compare) -> Piece:
        pieces = [self.visit(each) for each in (node.left, *node.comparators)]
        signs = [_COMPARE[type(op)] for op in node.ops]
        if all(isinstance(kind, Const) for _, kind in pieces):
            return self.computed(node, _compared, signs, *(kind.value for _, kind in pieces))
        kinds = [number(kind) for _, kind in pieces]
        if any(isinstance(kind, Other) for _, kind in pieces):
            kind = Other()
        elif None in kinds or any(sign[0].isalpha() for sign, _ in signs):
            raise self.no(node, f"compares what is not compiled: {short(node)}")
        else:
            self._whole_as_float(node, *pieces)
            pieces = [counted(piece) for piece in pieces]
            kind = replace(TRUTH, numpy=of_numpy(*kinds))
        first, *rest = (text for text, _ in pieces)
        parts = [f" {sign} {text}" for (sign, _), text in zip(signs, rest, strict=True)]
        return f"({first}{''.join(parts)})", kind

    def _of_UnaryOp(self, node: ast.UnaryOp) -> Piece:
        (sign, compute), negated = _UNARY[type(node.op)], isinstance(node.op, ast.Not)
        piece = text, kind = self.truth(node.operand) if negated else self.visit(node.operand)
        if isinstance(kind, Const):
            return self.computed(node, compute, kind.value)
        if negated or isinstance(kind, Other):
            return f"({sign}{text})", TRUTH if negated else kind
        value = number(kind)
        if value is None or sign == "~" or value.truth and value.numpy is not False:
            raise self.no(node, f"is not compiled: {short(node)}")
        text = as_float(piece)
        if sign == "-":
            text = f"(-{text})" if value.floating else f"(0.0 - {text})"  # a whole 0 has no sign
        return text, value.counted()

    def _of_BinOp(self, node: ast.BinOp) -> Piece:
        return self.binary(node, type(node.op), self.visit(node.left), self.visit(node.right))


def _compared(signs: list, first: Any, *others: Any) -> Any:
    """first < other < …, as Python compares: the last comparison, or the first that is not true."""
    result = True
    for (_, compare), a, b in zip(signs, (first, *others), others, strict=False):
        result = result and compare(a, b)
    return result
