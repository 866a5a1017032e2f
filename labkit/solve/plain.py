"""What the core calls in the plain back end: a model's functions on lists of numbers.

    model = Plain(system, orientations(system))
    model.flow[mode](t, y, p, out)

What a function cannot answer is NaN, as in the compiled back end, and the core then rejects the
step: a division by zero, a root of a negative number, an index beyond its table, anything that is
raised. An overflow of math.exp and its kind is infinity. What is a mistake in the text of a
function, wherever the state may be, is a ModelError.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from math import nan
from types import BuiltinFunctionType, FunctionType, SimpleNamespace

import numpy as np

from ..model import ModelError, System, Transition
from ..rebind import rebound
from .check import mistake, vector

Pieces = list[tuple[Callable, float, float]]


def orientations(system: System) -> list[Pieces]:
    """orientations(system) -> per mode its guards (function, sign, tolerance): events are rises."""
    return [
        [
            (tr.guard, -1.0 if tr.direction < 0 else 1.0, tr.tolerance)
            for i in system.leaving[mode]
            if (tr := system.transitions[i]).guard
        ]
        for mode in system.modes
    ]


class Plain:
    """Plain(system, orientations(system)): flow, guards and reset as lists of functions, by mode or
    transition.

    A state is a list of `width` numbers, of which a mode uses the first, and the held variables
    behind.
    """

    def __init__(self, system: System, orientations: list[Pieces]):
        self.flow = [_flow(system, mode) for mode in system.modes]
        self.guards = [
            _guards(system, mode, pieces)
            for mode, pieces in zip(system.modes, orientations, strict=True)
        ]
        self.reset = [_reset(system, tr) for tr in system.transitions]
        self.stepper = None


_new = tuple.__new__  # _new(kind, own(y) if own else y) is the s of a mode's functions


def _reader(system: System, mode: str) -> tuple[type, Callable[[list[float]], list] | None]:
    """_reader(system, mode) -> (kind of its s, what it is made of; None: all of a state).

    Functions call `_new` themselves: a call more would be a tenth of a step's time.
    """
    n, width = len(system.states_of(mode)), system.width
    return system.S[mode], None if n == width else lambda y: [*y[:n], *y[width:]]


def _flow(system: System, mode: str) -> Callable:
    function, names = system.modes[mode].flow, system.states_of(mode)
    what, new, (kind, own) = f"the flow of mode {mode!r}", _new, _reader(system, mode)
    n, rescue = len(names), _rescue(what, function, names)
    places = range(n)

    def flow(t, y, p, out):
        s = new(kind, own(y) if own else y)
        try:
            values = function(t, s, p)
            if type(values) is not tuple or len(values) != n:
                values = vector(values, what, names, "derivatives")
            for place in places:  # a slice takes half as long again
                out[place] = float(values[place])
        except Exception as error:
            out[:n] = rescue(error, t, s, p)

    return flow


def _guards(system: System, mode: str, pieces: Pieces) -> Callable:
    new, (kind, own) = _new, _reader(system, mode)
    rescues = [_rescue(f"a guard of mode {mode!r}", function, None) for function, _, _ in pieces]

    def guards(t, y, p, out):
        s = new(kind, own(y) if own else y)
        for k, (function, sign, tolerance) in enumerate(pieces):
            try:
                out[k] = sign * float(function(t, s, p)) - tolerance
            except Exception as error:
                out[k] = sign * rescues[k](error, t, s, p)[0] - tolerance

    return guards


def _reset(system: System, transition: Transition) -> Callable:
    """The reset of one transition: (mode, t, y, p, out); what it does not name is carried over."""
    modes, what = list(system.modes), f"the reset of {transition.name!r}"
    readers = [_reader(system, mode) for mode in modes]

    def state(mode: int, y: list[float]) -> tuple:
        kind, own = readers[mode]
        return _new(kind, own(y) if own else y)

    target = transition.target or transition.sources[0]
    names, places = system.states_of(target), system.places(target)
    if callable(transition.reset):
        rescue = _rescue(what, transition.reset, names)

        def values_of(mode, t, s, y, p):
            try:
                values = transition.reset(t, s, p)
                if type(values) is not tuple or len(values) != len(names):
                    values = vector(values, what, names, "states")
                values = [*map(float, values)]
            except Exception as error:
                values = rescue(error, t, s, p)
            return [*values, *y[system.width :]]

        def reset(mode, t, y, p, out):
            values = values_of(mode, t, state(mode, y), y, p)
            for place, value in zip(places.values(), values, strict=True):
                out[place] = value

        return reset
    parts = {}
    for source in transition.sources:
        here = system.places(source)
        there = system.places(transition.target or source)  # a run that ends keeps its own states
        parts[modes.index(source)] = [
            (part, _rescue(what, part, None), here.get(name), there[name])
            for name, part in system.reset_parts(transition, source).items()
        ]

    def reset_parts(mode, t, y, p, out):
        s = state(mode, y)
        for part, rescue, before, after in parts[mode]:
            try:
                out[after] = float(part(t, s, p)) if part else y[before]
            except Exception as error:
                (out[after],) = rescue(error, t, s, p)

    return reset_parts


# ---------------------------------------------------------------- when a function fails


def _rescue(what: str, function: Callable | None, names: tuple[str, ...] | None) -> Callable:
    """_rescue(what, f, names)(error, t, s, p) -> values, NaN, or a ModelError; names None: one."""
    ieee: list[Callable] = []

    def rescue(error: Exception, t: float, s: tuple, p: tuple) -> list[float]:
        if isinstance(error, OverflowError):
            ieee or ieee.append(_with_infinity(function))
            try:
                values = ieee[0](t, s, p)
                return [*map(float, (values,) if names is None else values)]
            except Exception as second:
                error = second
        if words := mistake(error, what, t, s, p):
            raise ModelError(words) from error
        return [nan] * (1 if names is None else len(names))

    return rescue


def _infinite(function: Callable) -> Callable:
    def call(*values: float) -> float:
        try:
            return function(*values)
        except OverflowError:
            with np.errstate(all="ignore"):
                same = getattr(np, {"pow": "power"}.get(function.__name__, function.__name__), None)
                return float(same(*values)) if same else math.inf

    return call


#: function of math that may overflow -> one that is infinity then
INFINITE = {
    getattr(math, name): _infinite(getattr(math, name))
    for name in ["exp", "exp2", "expm1", "cosh", "sinh", "gamma", "lgamma", "pow", "hypot", "ldexp"]
    if hasattr(math, name)
}


def _with_infinity(function: Callable) -> Callable:
    """A copy of a function in which, helpers included, an overflow of math.exp is infinity."""
    copies: dict = {}

    def swap(value: object, name: str) -> object:
        if value is math:
            return SimpleNamespace(**{k: swap(v, k) for k, v in vars(math).items()})
        if isinstance(value, BuiltinFunctionType):
            return INFINITE.get(value, value)
        return rebound(value, swap, copies) if isinstance(value, FunctionType) else value

    return swap(function, "")  # type: ignore[return-value]
