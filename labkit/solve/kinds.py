"""What the translator knows of a value before the model runs.

Whole numbers are the reason. Python's have no end; a processor's wrap around at 2⁶³. In compiled
code they are computed as floats, which is exact up to 2⁵³, and `bound` says how large they can
become; where that may be more the code looks, and a run that meets a larger one is made again in
plain Python.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

EXACT = 2.0**53  # beyond it not every whole number is a float


class Unfit(Exception):
    """A function cannot be compiled, or not so that it surely gives Python's numbers; says why."""


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
    """A number that the run decides: a float, or a whole number of at most `bound`, or either.

    numpy: one of NumPy's, whose division by zero is infinity and whose whole numbers wrap; None:
    perhaps. truth: of a comparison, as it stands in an expression (Numba adds and converts no
    truths).
    """

    floating: bool
    bound: float | None = None
    numpy: bool | None = False
    truth: bool = False

    def counted(self) -> Number:
        """The kind once it has been made a number."""
        return replace(self, truth=False) if self.truth else self


FLOAT, TRUTH = Number(True), Number(False, 1.0, truth=True)
OF_NUMPY, NUMPYS_TRUTH = Number(True, numpy=True), replace(TRUTH, numpy=True)


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
    if isinstance(kind, Number) or not isinstance(kind, Const):
        return kind if isinstance(kind, Number) else None
    value = kind.value
    if isinstance(value, int | np.int64 | np.bool_):
        return Number(False, float(min(abs(int(value)), 10**300)), not isinstance(value, int))
    if isinstance(value, float):
        return OF_NUMPY if isinstance(value, np.float64) else FLOAT
    return None


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
    numpy = one.numpy if one.numpy == two.numpy else None
    return Number(one.floating or two.floating, max(bounds, default=None), numpy)


def of_numpy(*kinds: Number) -> bool | None:
    """of_numpy(kind, kind) -> whether what is computed of them is one of NumPy's numbers."""
    flags = [kind.numpy for kind in kinds]
    return True in flags or (None if None in flags else False)


def widest(kind: Any) -> Any:
    """widest(kind) -> the kind with whole numbers of any size that they may have."""
    if isinstance(kind, Items):
        return Items(tuple(map(widest, kind.kinds)))
    if isinstance(kind, Number) and kind.bound is not None:
        return replace(kind, bound=max(kind.bound, EXACT))
    return kind
