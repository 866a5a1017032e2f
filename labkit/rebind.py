"""A model's function with other things under the names that it reads: the one place where functions
are copied.

rebound(f, swap)      a copy of f that reads swap(value, name) wherever f reads value under name
names_in(f.__code__)  the global names that f and the functions defined in it read
"""

from __future__ import annotations

import builtins
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from types import CellType, CodeType, FunctionType
from typing import Any

Swap = Callable[[Any, str], Any]


@lru_cache(maxsize=10_000)
def names_in(code: CodeType) -> frozenset[str]:
    """names_in(f.__code__) -> what f, and functions defined in it, may read from outside."""
    inner = (names_in(part) for part in code.co_consts if isinstance(part, CodeType))
    return frozenset(code.co_names).union(*inner)


def rebound(
    function: FunctionType, swap: Swap, copies: dict[int, tuple[FunctionType, FunctionType]]
) -> FunctionType:
    """rebound(f, swap, {}) -> a copy of f: globals, closure variables, builtins and defaults are
    swap(value, name).

    swap may call `rebound` with the same `copies`, for the functions that f calls: each is copied
    once, so one that calls itself is no trouble.
    """
    if id(function) in copies:
        return copies[id(function)][1]
    scope: dict[str, Any] = {"__builtins__": builtins, "__name__": function.__module__}
    cells = tuple(CellType() for _ in function.__closure__ or ())
    copy = FunctionType(function.__code__, scope, function.__name__, None, cells)
    copies[id(function)] = function, copy  # the original too, so that its id stays its own
    for name in names_in(function.__code__):
        if name in function.__globals__:
            scope[name] = swap(function.__globals__[name], name)
        elif hasattr(builtins, name):
            scope[name] = swap(getattr(builtins, name), name)
    given = zip(cells, function.__closure__ or (), function.__code__.co_freevars, strict=True)
    for new, old, name in given:
        with suppress(ValueError):  # a variable that has no value yet
            new.cell_contents = swap(old.cell_contents, name)
    if function.__defaults__:
        copy.__defaults__ = tuple(swap(value, "") for value in function.__defaults__)
    if function.__kwdefaults__:
        copy.__kwdefaults__ = {key: swap(v, key) for key, v in function.__kwdefaults__.items()}
    return copy
