"""What a model's functions read from outside themselves, and whether it is still the same.

reads = Reads()
value = reads.name(f, "table")         # a global, closure or builtin name of f
value = reads.attribute(planet, "g")
reads.same()                           # quickly: is everything that was read as it was?
"""

from __future__ import annotations

import builtins
import types
from collections.abc import Callable
from typing import Any

import numpy as np

_NOTHING = object()


class Reads:
    """Reads(): looks things up and remembers what was there; a copy of what may change in place."""

    def __init__(self) -> None:
        self._done: dict[tuple, Any] = {}
        # What is looked up again before every run, the cheapest first
        self._texts: list[tuple[types.FunctionType, types.CodeType, Any, Any]] = []
        self._names: list[tuple[dict[str, Any], str, Any]] = []
        self._looks: list[tuple[Callable[[], Any], Any]] = []

    def _read(self, key: tuple, look: Callable[[], Any]) -> Any:
        if key not in self._done:
            value = self._done[key] = look()
            kept = _frozen(value)
            if kept is not value or key[0] != "name":
                self._looks.append((look, kept))
        return self._done[key]

    def name(self, function: types.FunctionType, name: str) -> Any:
        """reads.name(f, "g") -> what f reads under that name; NameError where there is nothing."""
        free = function.__code__.co_freevars
        if name in free:
            cell = function.__closure__[free.index(name)]  # type: ignore[index]
            return self._read(("cell", id(cell)), lambda: _content(cell, name))
        space = function.__globals__
        key = "name", id(space), name
        if key not in self._done:
            self._names.append((space, name, space.get(name, _NOTHING)))
        return self._read(key, lambda: _global(space, name))

    def attribute(self, value: Any, name: str) -> Any:
        """reads.attribute(planet, "g") -> planet.g; AttributeError where there is nothing."""
        return self._read(("attribute", id(value), name), lambda: getattr(value, name))

    def default(self, function: types.FunctionType, name: str, value: Any) -> Any:
        """reads.default(f, "table", value) -> value, an argument's default, which may change."""
        return self._read(("default", id(function), name), lambda: value)

    def text(self, function: types.FunctionType) -> None:
        """reads.text(f): its code and defaults, which some tools replace."""
        if ("text", id(function)) not in self._done:
            self._done["text", id(function)] = function
            parts = function.__code__, function.__defaults__, function.__kwdefaults__
            self._texts.append((function, *parts))

    def same(self) -> bool:
        """reads.same() -> True while everything reads as it did."""
        for function, code, defaults, words in self._texts:
            if (
                function.__code__ is not code
                or function.__defaults__ is not defaults
                or function.__kwdefaults__ is not words
            ):
                return False
        for space, name, value in self._names:
            if (now := space.get(name, _NOTHING)) is not value and not _equal(now, value):
                return False
        try:
            for look, value in self._looks:
                if (now := look()) is not value and not _equal(now, value):
                    return False
            return True
        except (NameError, AttributeError):
            return False


def _content(cell: types.CellType, name: str) -> Any:
    try:
        return cell.cell_contents
    except ValueError:
        raise NameError(f"name {name!r} has no value yet") from None


def _global(space: dict[str, Any], name: str) -> Any:
    for there in (space, vars(builtins)):
        if name in there:
            return there[name]
    raise NameError(f"name {name!r} is not defined")


def _frozen(value: Any) -> Any:
    """The value itself if nothing in it can be changed in place, else a copy."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple):
        items = tuple(map(_frozen, value))
        return value if all(a is b for a, b in zip(items, value, strict=True)) else items
    if isinstance(value, list):
        return [*map(_frozen, value)]
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value.copy() if isinstance(value, set) else value


def _equal(now: Any, kept: Any) -> bool:
    """The same kind, the same value: 2 is not 2.0, and -0.0 is not 0.0."""
    if type(now) is not type(kept):
        return False
    if isinstance(now, np.ndarray):
        same = now.dtype == kept.dtype and now.shape == kept.shape
        return same and now.tobytes() == kept.tobytes()
    if isinstance(now, list | tuple):
        return len(now) == len(kept) and all(map(_equal, now, kept))
    if isinstance(now, dict):
        return now.keys() == kept.keys() and all(_equal(now[key], kept[key]) for key in now)
    if isinstance(now, float):
        return now is kept or repr(now) == repr(kept)
    return now is kept or (isinstance(now, _BY_VALUE) and bool(now == kept))


_BY_VALUE = (int, complex, str, range, set, np.generic, types.MethodType, types.BuiltinMethodType)
