"""What the translator knows of a value before the model runs.

Whole numbers are the reason. Python's have no end; a processor's wrap around at 2⁶³. In compiled
code they are computed as floats, which is exact up to 2⁵³, and `bound` says how large they can
become; where that is not known to be enough, the model runs in plain Python.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

EXACT = (
    2.0**54
)  # for //, % and the like, in which every digit counts: 2⁵³ and something small on top
LARGE = 2.0**63  # for what is used as a float: the last digit may be off, of numbers beyond 9·10¹⁵
MADE = (
    2.0**53
)  # a whole number made of a float by int(), floor() …; larger floats are whole numbers themselves


class Unfit(Exception):
    """A function cannot be compiled, or not so that it is sure to give Python's numbers; the
    message says why.
    """


@dataclass(frozen=True)
class Const:
    """A value that is known: a number, a text, a table, a function, a module."""

    value: Any

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Const) or type(self.value) is not type(other.value):
            return False
        same = self.value is other.value
        return same or isinstance(self.value, int | float | str) and repr(self) == repr(other)

    def __hash__(self) -> int:
        plain = isinstance(self.value, int | float | str)
        return hash(repr(self.value)) if plain else id(self.value)


@dataclass(frozen=True)
class Number:
    """A number that the run decides: a float, or a whole number of at most `bound`, or either."""

    floating: bool
    bound: float | None = None
    numpy: bool = False  # one of NumPy's numbers: a division by zero is infinity, whole ones wrap
    truth: bool = (
        False  # of a comparison, as it stands in an expression: Numba adds and converts no truths
    )

    def counted(self) -> Number:
        """The kind once it has been made a number."""
        return Number(self.floating, self.bound, self.numpy)


FLOAT, TRUTH = Number(True), Number(False, 1.0, truth=True)
OF_NUMPY = Number(True, numpy=True)


@dataclass(frozen=True)
class Items:
    """A tuple that a function makes."""

    kinds: tuple[Any, ...]


@dataclass(frozen=True)
class Record:
    """s or p: names and their places in the array of that letter."""

    array: str
    places: tuple[tuple[str, int], ...]

    def texts(self) -> list[str]:
        return [f"{self.array}[{place}]" for _, place in self.places]


@dataclass(frozen=True)
class Table:
    """Rows of a table of numbers, or the whole of it."""

    item: Number
    ndim: int


@dataclass(frozen=True)
class Other:
    """Whatever Numba makes of it: an array made inside a function."""


def number(kind: Any) -> Number | None:
    """number(kind) -> the kind as a Number, also of a known one; None if it is no number."""
    if isinstance(kind, Number):
        return kind
    if not isinstance(kind, Const):
        return None
    value = kind.value
    if isinstance(value, bool | int) or type(value).__name__ in ("int64", "bool", "bool_"):
        return Number(False, float(min(abs(int(value)), 10**300)), not isinstance(value, int))
    of_numpy = type(value).__name__ == "float64"
    return (OF_NUMPY if of_numpy else FLOAT) if isinstance(value, float) else None


def join(a: Any, b: Any) -> Any:
    """join(a, b) -> the kind of what is one or the other; Unfit if that cannot be said."""
    if a == b:
        return a
    if isinstance(a, Items) and isinstance(b, Items) and len(a.kinds) == len(b.kinds):
        return Items(tuple(map(join, a.kinds, b.kinds)))
    one, two = number(a), number(b)
    if one is None or two is None:
        if isinstance(a, Other | Number) and isinstance(b, Other | Number):
            return Other()
        raise Unfit("it has values of different kinds in different branches")
    bounds = [each.bound for each in (one, two) if each.bound is not None]
    floating, numpy = one.floating or two.floating, one.numpy or two.numpy
    return Number(floating, max(bounds, default=None), numpy)


def growing(before: Any, after: Any, last: Any) -> Any:
    """growing(kinds of a variable in three rounds of a loop) -> its kind in all rounds.

    What grows by no more each time is a count, and no function is called that counts beyond 2³¹.
    """
    if not isinstance(last, Number) or last.bound is None or after == last:
        return last
    known = [number(kind) for kind in (before, after)]
    bounds = [(kind and kind.bound) or 0.0 for kind in known]
    step = bounds[1] - bounds[0]
    steady = last.bound - bounds[1] <= step
    return Number(last.floating, last.bound + step * 2.0**31 if steady else inf, last.numpy)
