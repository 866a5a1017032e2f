"""A model's functions tried, and what is wrong with them in words.

check_functions(system, p, t, start, mode)      raises ModelError, before anything runs
trouble(system, mode, t, y, p)                  why a run can go no further there, "" if the
                                                functions are not to blame
"""

from __future__ import annotations

import os
import re
import traceback
from collections.abc import Callable, Mapping, Set

import numpy as np

from ..model import ModelError, System

#: What is wrong with the text of a function, wherever the state may be; anything else depends on
#: the state.
MISTAKES = (TypeError, NameError, AttributeError, ImportError)
HERE = os.path.dirname(__file__)


def check_functions(
    system: System, p: tuple, t: float, start: tuple[float, ...], mode: str
) -> None:
    """check_functions(system, p, t, start, mode): calls flow, guards and resets of every mode once.

    So a wrong length or a NaN is an error in words before anything runs. `start` is in the order of
    S[mode]; other modes are tried there too where they have the same states, else at ones.
    """
    for key, each in system.modes.items():
        names, here = system.states_of(key), key == mode
        own = len(system.states_of(mode))
        first = start[:own] if names == system.states_of(mode) else (1.0,) * len(names)
        s = system.S[key](*first, *start[own:])
        _check_vector(each.flow, f"the flow of mode {key!r}", t, s, p, names, here, "derivatives")
        for i in system.leaving[key]:
            tr = system.transitions[i]
            if tr.guard is not None:
                _check_number(tr.guard, f"the guard of {tr.name!r}", t, s, p, here)
            what = f"the reset of {tr.name!r}"
            if callable(tr.reset) and tr.target is not None:
                target = system.states_of(tr.target)
                _check_vector(tr.reset, what, t, s, p, target, False, "states")
            elif isinstance(tr.reset, Mapping):
                for name, part in tr.reset.items():
                    if callable(part):
                        _check_number(part, f"{what} for {name!r}", t, s, p, False)


def vector(values: object, what: str, names: tuple[str, ...], kind: str) -> object:
    """vector(values, "the flow of mode 'm'", ("x", "v"), "derivatives") -> values, or a
    ModelError in words.
    """
    shape = f"it must return a tuple of {len(names)} {kind} ({', '.join(names)})"
    if isinstance(values, Set):
        raise ModelError(f"{what} returns a set, which has no order: {shape}, in ( ), not in {{ }}")
    if isinstance(values, Mapping):
        raise ModelError(f"{what} returns a dict: {shape}, in this order and without names")
    if isinstance(values, str | bytes) or values is None:
        raise ModelError(f"{what} returns {values!r}: {shape}" + _missing(values))
    if not hasattr(values, "__iter__") or isinstance(values, np.ndarray) and not values.ndim:
        raise ModelError(f"{what} returns {values!r}: {shape}; for one write `return (value,)`")
    values = tuple(values)
    if len(values) != len(names):
        raise ModelError(
            f"{what} returns {len(values)} values, but there are {len(names)} states: "
            f"return the {kind} of {', '.join(names)}, in this order"
        )
    for name, value in zip(names, values, strict=True):
        if isinstance(value, tuple | list | Mapping | Set) or np.ndim(value):
            raise ModelError(
                f"{what} returns {value!r} for {name!r}: it must be one number, "
                "and all of them stand in one tuple"
            )
    return values


def _missing(value: object) -> str:
    return " (is a `return` missing in one branch?)" if value is None else ""


def _number(value: object, what: str, name: str = "") -> float | complex:
    """One number that a function returned; a ModelError for what is none. A complex one is as
    good as NaN.
    """
    if isinstance(value, complex | np.complexfloating):
        return float("nan")
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        pass
    of = f" for {name!r}" if name else ""
    raise ModelError(f"{what} returns {value!r}{of}: it must be a number{_missing(value)}")


def number_of(function: Callable, what: str, t: float, s: tuple, p: tuple) -> float:
    """number_of(function, "output 'E'", t, s, p) -> its value; ModelError when it has none."""
    try:
        value = function(t, s, p)
    except Exception as error:
        if words := mistake(error, what, t, s, p):
            raise ModelError(words) from error
        raise ModelError(
            f"{what} fails at {at(t, s)}: {_said(error)}. Where it has no value let it return "
            "math.nan: a gap in the curve"
        ) from error
    if isinstance(value, complex | np.complexfloating):
        raise ModelError(f"{what} is a complex number at {at(t, s)}: {value}")
    return _number(value, f"{what} at {at(t, s)}")


# ---------------------------------------------------------------- words


def at(t: float, s: tuple) -> str:
    """at(t, s) -> "t = 0, x = 1, v = 0"."""
    return ", ".join(
        [f"t = {t:g}", *(f"{name} = {value:g}" for name, value in zip(s._fields, s, strict=True))]
    )


def line_of(error: BaseException) -> str:
    """line_of(error) -> " (line 5: U[int(t)])", the line of a model's text where it was raised;
    "" if in none.
    """
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(HERE)
    ]
    if not frames or not frames[-1].line:
        return ""
    text = frames[-1].line.strip()
    return f" (line {frames[-1].lineno}: {text if len(text) <= 70 else text[:67] + '…'})"


def mistake(error: Exception, what: str, t: float, s: tuple, p: tuple) -> str:
    """mistake(error, "the flow of mode 'm'", t, s, p) -> words for a mistake in the text of a
    function; "" if it is none.
    """
    if isinstance(error, ModelError):
        return str(error)
    if not isinstance(error, MISTAKES) or "complex" in str(error):
        return ""
    text, where = str(error), line_of(error)
    if isinstance(error, AttributeError) and "can't set" in text:
        return (
            f"{what} assigns to a state or parameter{where}: they can only be read; "
            "a flow returns derivatives, and only a reset changes a state"
        )
    if isinstance(error, AttributeError):
        states, parameters = list(s._fields), list(p._fields)
        names = f"states {states}, parameters {parameters}"
        return f"{what} asks for an unknown name: {text}{where}; {names}"
    if "tuple indices must be integers" in text:
        asked = [word for word in re.findall(r"\[['\"](\w+)['\"]\]", where) if word in s._fields]
        name = asked[0] if asked else s._fields[0]
        return f"{what} fails{where}: a state or parameter is read as s.{name}, not s['{name}']"
    if isinstance(error, NameError):
        return f"{what} asks for a name that is not there{where}: {text}"
    if "positional argument" in text and not where:
        return f"{what} cannot be called as f(t, s, p): {text}"
    return f"{what} fails at {at(t, s)}: {type(error).__name__}: {text}{where}"


_FAILED = object()


def _call(function: Callable, what: str, t: float, s: tuple, p: tuple, here: bool) -> object:
    """What a function returns; _FAILED where it does not, unless that is a mistake or happens at
    the start.
    """
    try:
        return function(t, s, p)
    except Exception as error:
        if words := mistake(error, what, t, s, p):
            raise ModelError(words) from error
        if here and not isinstance(error, OverflowError):  # an exp that overflows may be right
            raise ModelError(f"{what} fails at the start, {at(t, s)}: {_said(error)}") from error
        return _FAILED


def _said(error: Exception) -> str:
    kind = "" if isinstance(error, ArithmeticError | ValueError) else f"{type(error).__name__}: "
    return f"{kind}{error}{line_of(error)}"


def _check_number(function: Callable, what: str, t: float, s: tuple, p: tuple, here: bool) -> None:
    value = _call(function, what, t, s, p, here)
    if value is _FAILED:
        return
    if isinstance(value, bool | np.bool_) and what.startswith("the guard"):
        raise ModelError(
            f"{what} returns {value}: return the number whose zero is the event (s.y, not s.y < 0)"
        )
    if np.ndim(value) or isinstance(value, str | Mapping | Set):
        raise ModelError(f"{what} must return one number, not {value!r}")
    if _number(value, what) != value and here:
        raise ModelError(f"{what} is not a number (NaN) at the start, {at(t, s)}")


def _check_vector(
    function: Callable,
    what: str,
    t: float,
    s: tuple,
    p: tuple,
    names: tuple[str, ...],
    here: bool,
    kind: str,
) -> None:
    values = _call(function, what, t, s, p, here)
    if values is _FAILED:
        return
    # type: ignore[call-overload]
    for name, value in zip(names, vector(values, what, names, kind), strict=True):
        if not abs(_number(value, what, name)) < float("inf") and here:
            raise ModelError(
                f"{what} returns {value} for {name!r} at the start, {at(t, s)}: "
                "check for a division by zero or a root of a negative number"
            )


def trouble(
    system: System, mode: str, t: float, y: list[float], p: tuple, step: float = 0.0
) -> str:
    """trouble(system, "m", t, y, p) -> what a function of the mode raises there or just ahead, ""
    if nothing.

    For the words at the end of a run: the back ends only see that a step is not a number. `y` is in
    the order of S[mode]; step: how far ahead the last one has looked.
    """
    kind, n = system.S[mode], len(system.states_of(mode))
    flow = system.modes[mode].flow
    functions = [(f"the flow of mode {mode!r}", flow)]
    for i in system.leaving[mode]:
        if guard := system.transitions[i].guard:
            functions.append((f"the guard of {system.transitions[i].name!r}", guard))
    slope = [0.0] * n
    near = [10.0**k * max(1.0, abs(t)) for k in range(-15, -5)]
    for h in (0.0, *near, 0.5 * step, step):
        s = kind(*(v + h * d for v, d in zip(y, slope, strict=False)), *y[n:])
        for what, function in functions:
            try:
                values = function(t + h, s, p)
                parts = values if function is flow else (values,)
                if any(isinstance(part, complex | np.complexfloating) for part in parts):
                    return _complex(what, t, s, "")
                slope = [*map(float, values)] if function is flow else slope
            except Exception as error:
                if isinstance(error, TypeError) and "complex" in str(error):
                    return _complex(what, t, s, line_of(error))
                if not isinstance(error, OverflowError):
                    kind_of = f"{type(error).__name__}: {error}{line_of(error)}"
                    return f"{what} fails near {at(t, s)}: {kind_of}"
    return ""


def _complex(what: str, t: float, s: tuple, where: str) -> str:
    return (
        f"{what} is a complex number near {at(t, s)}{where}: a root or another broken power is "
        "taken of a negative number there. Keep what it is taken of at 0 or above, max(…, 0), or "
        "let an event end the mode before"
    )
