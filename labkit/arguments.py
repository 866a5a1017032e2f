"""Arguments of a wrong kind, in words: what a public function's annotations ask for is its check.

@asked above a function: an error of Python's that comes of a wrong argument becomes a ModelError.
"""

from __future__ import annotations

import sys
import traceback
import types
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import wraps
from inspect import signature
from numbers import Integral
from typing import Any, Literal, Union, get_args, get_origin

__all__ = ["asked", "takes", "unambiguous"]


def asked(function: Callable) -> Callable:
    """@asked above a public function or method: its annotations are what it asks for.

    Where it fails with an error of Python's, its arguments are looked at: one that is not what its
    annotation says makes a ModelError that names it, its value and how the function is called.
    What works is left to work, and costs nothing; an error inside a function that was given stays
    what it is, unless the argument was handed on to it.
    """

    @wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        try:
            return function(*given, **named)
        except Exception as error:
            from .model import ModelError  # whose own functions are asked, too

            if isinstance(error, ModelError):
                raise
            if said := _wrong(function, given, named, _guests(error)):
                raise ModelError(said) from error
            raise

    return checked


def unambiguous(function: Callable) -> Callable:
    """@unambiguous above a function of a System or a Run (or several, by name) and options.

    A name that is both one of the options and a parameter of the system is refused when it is
    given: one could not tell which is meant. Its arguments are @asked.
    """
    ask = asked(function)
    form = signature(function).parameters.values()
    own = {each.name for each in form if each.kind != each.VAR_KEYWORD}

    @wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        from .model import ModelError, listed

        first = given[0] if given else next(iter(named.values()), None)
        for one in first.values() if isinstance(first, Mapping) else (first,):
            system = getattr(one, "system", one)
            known = getattr(system, "parameters", ())
            if clash := [name for name in named if name in own and name in known]:
                raise ModelError(
                    f"{listed(clash)} is an option of {function.__name__} and a parameter of "
                    f"{system.name!r}: one cannot tell which is meant: rename the parameter"
                )
        return ask(*given, **named)

    return checked


def _guests(error: BaseException) -> list[types.FrameType]:
    """Calls in its traceback of code that is neither labkit's nor of a library: functions given."""
    # the first two are `checked` and the function itself
    calls = [frame for frame, _ in traceback.walk_tb(error.__traceback__)][2:]
    names = [str(each.f_globals.get("__name__", "")) for each in calls]  # of eval: none
    own = [name.partition(".")[0] not in _LIBRARIES for name in names]
    return [each for each, guest in zip(calls, own, strict=True) if guest]


_LIBRARIES = {
    "IPython",
    "PIL",
    "labkit",
    "matplotlib",
    "numba",
    "numpy",
    "scipy",
    "sympy",
    "traitlets",
}
_LIBRARIES |= sys.stdlib_module_names


def _wrong(
    function: Callable, given: tuple, named: Mapping[str, Any], guests: list[types.FrameType]
) -> str:
    """The first argument that is not what its annotation says, in words; "" if there is none.

    Of an error of guests only one of which they know can be the cause.
    """
    heard = [id(value) for guest in guests for value in guest.f_locals.values()]
    form = signature(function)
    try:
        arguments = form.bind(*given, **named).arguments
    except TypeError:  # too few or too many: Python's own words are clear
        return ""
    for name, value in arguments.items():
        each = form.parameters[name]
        hint = Any if each.annotation is each.empty else each.annotation
        try:
            hint = eval(hint, function.__globals__) if isinstance(hint, str) else hint
        except NameError:  # one that only a type checker imports
            continue
        found = [(name, value)]
        if each.kind == each.VAR_POSITIONAL:
            found = [(name, one) for one in value]
        elif each.kind == each.VAR_KEYWORD:
            found = list(value.items())
        for key, one in found:
            if not _fits(one, hint) and (not guests or id(one) in heard):
                what = function.__qualname__.removesuffix(".__init__").rpartition(".")[2]
                usage = " ".join((function.__doc__ or "").partition("\n\n")[0].split())
                usage = f". It is called so: {usage.partition(' -> ')[0]}" * bool(usage)
                shown = f"{one!r:.60}"
                if isinstance(one, types.FunctionType):
                    shown = f"{one.__name__}{signature(one)}"
                return f"{key} of {what} must be {_said(hint)}, not {shown}{usage}"
    return ""


def _fits(value: Any, hint: Any) -> bool:
    import numpy as np  # not before it is installed: `python -m labkit` has a use for models

    kind, inner = get_origin(hint), get_args(hint)
    if hint is float or _numbers(hint):
        try:
            found = np.asarray(float(value) if hint is float else value, dtype=float)
            return bool(np.isfinite(found).all())
        except (TypeError, ValueError):
            return False
    if kind in (Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if hint is int:
        return isinstance(value, Integral)
    if kind is Callable:
        return callable(value) if inner[0] is Ellipsis else takes(value, len(inner[0]))
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if hint is None or hint is bool or kind is Literal:
        return value in ((None,) if hint is None else inner or (True, False))
    cls = kind or hint
    if cls is Any or not isinstance(cls, type) or getattr(cls, "_is_protocol", False):
        return True
    if not isinstance(value, cls):
        return False
    if isinstance(value, Mapping) and inner:
        return all(_fits(k, inner[0]) and _fits(v, inner[1]) for k, v in value.items())
    if cls is tuple and inner and inner[-1] is not Ellipsis:
        return len(value) == len(inner) and all(map(_fits, value, inner))
    sized = inner and isinstance(value, Collection) and not isinstance(value, Mapping)
    return not sized or all(_fits(one, inner[0]) for one in value)


def _numbers(hint: Any) -> bool:
    from numpy import ndarray
    from numpy.typing import ArrayLike

    return hint is ArrayLike or ndarray in (hint, get_origin(hint))


def takes(function: object, count: int) -> bool:
    """takes(flow, 3) -> whether it is a function that can be called with so many arguments."""
    if not callable(function):
        return False
    try:
        signature(function).bind(*range(count))
    except ValueError:  # one of C
        return True
    except TypeError:
        return False
    return True


def _said(hint: Any) -> str:
    kind, inner = get_origin(hint), get_args(hint)
    if _numbers(hint):
        return "finite numbers"
    if kind in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_said, inner)))
    if kind is Callable:
        if inner[0] is Ellipsis:
            return "a function"
        count = len(inner[0])
        of = {1: "one argument", 3: "(t, s, p)"}.get(count, f"{count} arguments")
        return f"a function of {of}"
    if kind is Literal:
        return " or ".join(map(repr, inner))
    cls = kind or hint
    words = {float: "a number", int: "a whole number", str: "a text", bool: "True or False"}
    words |= {None: "None", type(None): "None"}
    if cls in words:
        return words[cls]
    if isinstance(cls, type) and issubclass(cls, Mapping):
        of = f" {{name: {_said(inner[1])}}}" if inner and inner[1] is not object else ""
        return f"a dict{of}"
    if isinstance(cls, type) and issubclass(cls, tuple) and inner and inner[-1] is not Ellipsis:
        return f"({', '.join(map(_said, inner))})"
    if isinstance(cls, type) and issubclass(cls, Iterable) and kind:
        return f"a list [{_said(inner[0])}, …]"
    return f"{'an' if cls.__name__[0] in 'AEIOU' else 'a'} {cls.__name__}"
