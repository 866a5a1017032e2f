"""A model's Python functions as plain closures, as one compiled function, and as a fingerprint for the cache.

The compiled form is one C function, model(what, index, t, s, p, out), whose source is put together from the
sources of the model's functions: `s.v` becomes s[1], `p.g` becomes p[0], `return a, b` fills out[0] and out[1], and
names are kept apart by a prefix. One function instead of a dozen, because Numba's time goes by functions:
a model of four modes takes 0.4 s this way and 2.4 s as separate functions. A function whose source cannot be had is
called instead.
"""

from __future__ import annotations

import ast
import dis
import hashlib
import inspect
import linecache
import types
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from math import nan

import numpy as np

from ..model import ModelError, System

FLOW, GUARDS, RESET = range(3)


def references(function: Callable) -> dict[str, object]:
    """references(f) -> name -> value of every global and closure variable that f, or a function nested in it, reads.

    Attribute names (s.m) are not globals, though they stand in the same table of the code object: hence `dis`.
    """
    code = function.__code__
    found = {}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # a variable that has no value yet
            found[name] = cell.cell_contents
    for name in _globals(code):
        if name in function.__globals__:
            found.setdefault(name, function.__globals__[name])
    return found


@lru_cache(maxsize=10_000)
def _globals(code: types.CodeType) -> tuple[str, ...]:
    names = {
        i.argval for i in dis.get_instructions(code) if i.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names.update(_globals(constant))
    return tuple(sorted(names))


def _code_text(code: types.CodeType) -> str:
    constants = [
        _code_text(c) if isinstance(c, types.CodeType) else repr(c) for c in code.co_consts
    ]
    return f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames} {code.co_freevars}"


def fingerprint(function: Callable, seen: frozenset[int] = frozenset()) -> str:
    """fingerprint(f) -> text that changes whenever f, a helper it calls, or a constant it reads changes."""
    if id(function) in seen:
        return "recursion"
    seen |= {id(function)}
    parts = [
        _code_text(function.__code__),
        repr(function.__defaults__),
        repr(function.__kwdefaults__),
    ]
    for name, value in sorted(references(function).items()):
        if isinstance(value, types.FunctionType):
            parts.append(f"{name}: {fingerprint(value, seen)}")
        elif isinstance(value, types.ModuleType | types.BuiltinFunctionType | np.ufunc | type):
            parts.append(
                f"{name}: {getattr(value, '__module__', '')}.{getattr(value, '__name__', value)}"
            )
        elif isinstance(value, np.ndarray):
            parts.append(
                f"{name}: {value.dtype}{value.shape}{hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
            )
        else:
            parts.append(f"{name}: {type(value).__name__} {value!r}")
    return "\n".join(parts)


# ---------------------------------------------------------------- plain closures


class Plain:
    """Plain(system): what the plain back end's core calls; an arithmetic error in a flow or guard becomes NaN."""

    def __init__(self, system: System, orientations: list[list[tuple[Callable, float, float]]]):
        new = tuple.__new__
        sizes = [len(system.states_of(mode)) for mode in system.modes]
        width = max(sizes)
        kinds = [system.S[mode] for mode in system.modes]

        def make_flow(function, kind, n):
            failed = [nan] * width

            def flow(t, y, p, out):
                try:
                    out[:n] = function(t, new(kind, y if n == width else y[:n]), p)
                except (ArithmeticError, ValueError):
                    out[:] = failed

            return flow

        def make_guards(pieces, kind, n):
            def guards(t, y, p, out):
                s = new(kind, y if n == width else y[:n])
                for k, (function, sign, tolerance) in enumerate(pieces):
                    try:
                        out[k] = sign * function(t, s, p) - tolerance
                    except (ArithmeticError, ValueError):
                        out[k] = nan

            return guards

        def make_reset(transition):
            def reset(mode, t, y, p, out):
                n = sizes[mode]
                if transition.reset is None:
                    out[:n] = y[:n]
                else:
                    values = tuple(transition.reset(t, new(kinds[mode], y[:n]), p))
                    out[: len(values)] = values

            return reset

        self.flow = [
            make_flow(mode.flow, kind, n)
            for mode, kind, n in zip(system.modes.values(), kinds, sizes, strict=True)
        ]
        self.guards = [
            make_guards(pieces, kind, n)
            for pieces, kind, n in zip(orientations, kinds, sizes, strict=True)
        ]
        self.reset = [make_reset(transition) for transition in system.transitions]
        self.stepper = None


def orientations(system: System) -> list[list[tuple[Callable, float, float]]]:
    """Per mode its guards as (function, sign, tolerance), turned so that a directed event is always the rise through zero."""
    return [
        [
            (tr.guard, -1.0 if tr.direction < 0 else 1.0, tr.tolerance)
            for i in system.leaving[mode]
            if (tr := system.transitions[i]).guard
        ]
        for mode in system.modes
    ]


# ---------------------------------------------------------------- one compiled function


def _tree(function: Callable) -> ast.FunctionDef | ast.Lambda | None:
    """The syntax tree of a function or lambda, or None when its source cannot be had or is not what runs."""
    code = function.__code__
    try:
        linecache.checkcache(code.co_filename)
        lines, _ = inspect.findsource(function)
        module = ast.parse("".join(lines))
    except (OSError, SyntaxError, TypeError, IndexError, ValueError):
        return None
    found = []
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            line = (
                node.decorator_list[0].lineno
                if isinstance(node, ast.FunctionDef) and node.decorator_list
                else node.lineno
            )
            if (
                line == code.co_firstlineno
                and getattr(node, "name", "<lambda>") == code.co_name
                and _same(node, code)
            ):
                found.append(node)
    return found[0] if len({ast.dump(node) for node in found}) == 1 else None


def _same(node: ast.FunctionDef | ast.Lambda, code: types.CodeType) -> bool:
    """Does this piece of source compile to the code that runs? (Names of closures compile as globals: left out.)"""
    statement = ast.Expr(node) if isinstance(node, ast.Lambda) else node
    module = ast.fix_missing_locations(ast.Module([statement], []))
    fresh = next(
        (c for c in compile(module, "<same>", "exec").co_consts if isinstance(c, types.CodeType)),
        None,
    )
    if fresh is None:
        return False
    if not code.co_freevars:
        return (
            fresh.co_code == code.co_code
            and fresh.co_names == code.co_names
            and _constants(fresh) == _constants(code)
        )
    return (
        fresh.co_varnames == code.co_varnames
        and _constants(fresh) == _constants(code)
        and set(fresh.co_names) == {*code.co_names, *code.co_freevars}
    )


def _constants(code: types.CodeType) -> list[str]:
    return [repr(c) for c in code.co_consts if not isinstance(c, types.CodeType)]


class _Inline(ast.NodeTransformer):
    """Rewrites one function's body for the common function: see the module's docstring."""

    def __init__(
        self,
        prefix: str,
        arguments: list[str],
        states: tuple[str, ...],
        parameters: tuple[str, ...],
        values: dict[str, object],
    ):
        self.prefix, self.arguments, self.values = prefix, arguments, values
        self.fields = {arguments[1]: ("s", states), arguments[2]: ("p", parameters)}
        self.whole = {arguments[1]: False, arguments[2]: False}
        self.locals: set[str] = set()

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and node.value.id in self.fields:
            array, names = self.fields[node.value.id]
            if node.attr in names:
                return ast.copy_location(
                    ast.parse(f"{array}[{names.index(node.attr)}]", mode="eval").body, node
                )
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id == self.arguments[0]:
            return ast.copy_location(ast.Name("t", node.ctx), node)
        if node.id in self.fields:
            self.whole[node.id] = True
            return ast.copy_location(ast.Name(f"{self.prefix}{node.id}", node.ctx), node)
        if node.id in self.locals or node.id in self.values:
            return ast.copy_location(ast.Name(f"{self.prefix}{node.id}", node.ctx), node)
        return node


def _statements(
    function: Callable,
    prefix: str,
    states: tuple[str, ...],
    parameters: tuple[str, ...],
    finish: Callable[[ast.expr], str],
    values: dict[str, object],
) -> list[ast.stmt]:
    """The body of one model function as statements of the common function, each return turned into `finish`."""
    read = references(function)
    node = _tree(function)
    plain = (
        node is not None
        and not node.args.kwonlyargs
        and not node.args.vararg
        and len(node.args.args) == 3
    )
    unusual = (
        ast.Global
        | ast.Nonlocal
        | ast.FunctionDef
        | ast.Lambda
        | ast.comprehension
        | ast.ClassDef
        | ast.Try
        | ast.With
        | ast.Yield
        | ast.Await
    )
    body = (
        [] if not plain else [ast.Return(node.body)] if isinstance(node, ast.Lambda) else node.body
    )
    plain = plain and not any(
        isinstance(inner, unusual) for statement in body for inner in ast.walk(statement)
    )
    if plain:
        arguments = [a.arg for a in node.args.args]
        stored = {
            inner.id
            for statement in body
            for inner in ast.walk(statement)
            if isinstance(inner, ast.Name) and isinstance(inner.ctx, ast.Store)
        }
        stars = max(
            (
                sum(isinstance(part, ast.Starred) for part in inner.value.elts)
                for statement in body
                for inner in ast.walk(statement)
                if isinstance(inner, ast.Return) and isinstance(inner.value, ast.Tuple | ast.List)
            ),
            default=0,
        )
        plain = not stored & {arguments[1], arguments[2]} and stars <= 1
    if not plain:
        values[f"{prefix}f"] = function
        arguments, stored, read = ["t", "s", "p"], set(), {"f": function}
        body = ast.parse("return f(t, s, p)").body
    inline = _Inline(prefix, arguments, states, parameters, read)
    inline.locals = stored - {arguments[0]}
    module = inline.visit(
        ast.Module([ast.parse(ast.unparse(statement)).body[0] for statement in body], [])
    )
    for name, value in read.items():
        values[f"{prefix}{name}"] = value

    class Finish(ast.NodeTransformer):
        def visit_Return(self, node: ast.Return) -> list[ast.stmt]:
            return ast.parse(finish(node.value)).body

    head = ""
    for argument, kind in ((arguments[1], "S"), (arguments[2], "P")):
        if inline.whole[argument]:
            array, names = inline.fields[argument]
            values[f"{prefix}{kind}"] = kind, names
            head += f"{prefix}{argument} = {prefix}{kind}({', '.join(f'{array}[{i}]' for i in range(len(names)))})\n"
    return [*ast.parse(head).body, *Finish().visit(module).body]


def common_source(system: System) -> tuple[str, dict[str, object]]:
    """common_source(system) -> (source of model(what, index, t, s, p, out), the values its names stand for)."""
    parameters = tuple(system.parameters)
    values: dict[str, object] = {}
    modes = list(system.modes)

    def fill(count: int) -> Callable[[ast.expr], str]:
        def finish(value: ast.expr) -> str:
            # All values first, then the assignments: a reset may read what it is about to overwrite
            if not isinstance(value, ast.Tuple | ast.List):
                return (
                    f"result = {ast.unparse(value)}\n"
                    + "".join(f"out[{i}] = result[{i}]\n" for i in range(count))
                    + "return"
                )
            head, texts = "", []
            for part in value.elts:
                if isinstance(
                    part, ast.Starred
                ):  # (*law(s, p), 0.0): Numba does not unpack; its length is what is missing
                    head += f"starred = {ast.unparse(part.value)}\n"
                    texts += [f"starred[{i}]" for i in range(count - len(value.elts) + 1)]
                else:
                    texts.append(ast.unparse(part))
            values = "".join(f"value_{i} = float({text})\n" for i, text in enumerate(texts))
            return (
                head
                + values
                + "".join(f"out[{i}] = value_{i}\n" for i in range(len(texts)))
                + "return"
            )

        return finish

    branches: list[tuple[str, list[ast.stmt]]] = []
    for m, mode in enumerate(system.modes.values()):
        names = system.states_of(mode.name)
        branches.append(
            (
                f"what == {FLOW} and index == {m}",
                _statements(mode.flow, f"f{m}_", names, parameters, fill(len(names)), values),
            )
        )
    helpers = ""
    for m, pieces in enumerate(orientations(system)):
        lines = ""
        for k, (function, sign, tolerance) in enumerate(pieces):
            # a guard returns once, so each is a function of its own when its body is more than one return
            prefix = f"g{m}_{k}_"
            body = _statements(
                function,
                prefix,
                system.states_of(modes[m]),
                parameters,
                lambda value: f"return {ast.unparse(value)}",
                values,
            )
            if len(body) == 1 and isinstance(body[0], ast.Return):
                expression = ast.unparse(body[0].value)
            else:
                helpers += f"def {prefix}guard(t, s, p):\n" + _indent(body)
                values[f"{prefix}guard"] = None
                expression = f"{prefix}guard(t, s, p)"
            shift = f" - {tolerance!r}" if tolerance else ""
            lines += f"out[{k}] = {'-' if sign < 0 else ''}({expression}){shift}\n"
        if lines:
            branches.append(
                (f"what == {GUARDS} and index == {m}", ast.parse(lines + "return").body)
            )
    for i, tr in enumerate(system.transitions):
        if tr.reset is None:
            continue
        for m in {tuple(system.states_of(mode)): modes.index(mode) for mode in tr.sources}.values():
            names = system.states_of(modes[m])
            count = len(system.states_of(tr.target)) if tr.target else 0
            alike = [
                str(modes.index(mode)) for mode in tr.sources if system.states_of(mode) == names
            ]
            condition = (
                f"what >= {RESET} and index == {i} and what - {RESET} in ({', '.join(alike)},)"
            )
            branches.append(
                (
                    condition,
                    _statements(tr.reset, f"r{i}_{m}_", names, parameters, fill(count), values),
                )
            )
    text = "def model(what, index, t, s, p, out):\n"
    for condition, body in branches:
        text += f"    if {condition}:\n" + _indent(body, 2)
    width = max(len(system.states_of(mode)) for mode in modes)
    text += (
        f"    if what >= {RESET}:\n        for i in range({width}):\n            out[i] = s[i]\n"
    )
    return helpers + text, values


def _indent(body: list[ast.stmt], by: int = 1) -> str:
    return "".join(
        "    " * by + line + "\n"
        for statement in body
        for line in ast.unparse(ast.fix_missing_locations(statement)).splitlines()
    )


def check_functions(
    system: System, p: tuple, t: float, start: tuple[float, ...], mode: str
) -> None:
    """Calls flow, guards and resets once, so that a wrong length or a NaN is an error in words before anything runs."""
    for key, each in system.modes.items():
        names = system.states_of(key)
        s = system.S[key](
            *(
                start
                if key == mode
                else start
                if len(start) == len(names) and names == system.states_of(mode)
                else (1.0,) * len(names)
            )
        )
        here = key == mode
        _check_vector(each.flow, f"the flow of mode {key!r}", t, s, p, names, here, "derivatives")
        for i in system.leaving[key]:
            tr = system.transitions[i]
            if tr.guard is not None:
                value = _call(tr.guard, f"the guard of {tr.name!r}", t, s, p, here)
                if value is not None and not isinstance(value, int | float | np.number | np.bool_):
                    raise ModelError(
                        f"the guard of {tr.name!r} must return one number, not {value!r}"
                    )
                if isinstance(value, bool | np.bool_):
                    raise ModelError(
                        f"the guard of {tr.name!r} returns {value}: return the number whose zero is the event (s.y, not s.y < 0)"
                    )
                if here and value is not None and value != value:
                    raise ModelError(
                        f"the guard of {tr.name!r} is not a number (NaN) at the start, {_at(t, s)}"
                    )
            if tr.reset is not None and tr.target is not None:
                _check_vector(
                    tr.reset,
                    f"the reset of {tr.name!r}",
                    t,
                    s,
                    p,
                    system.states_of(tr.target),
                    False,
                    "states",
                )


def _at(t: float, s: tuple) -> str:
    return ", ".join(
        [f"t = {t:g}", *(f"{name} = {value:g}" for name, value in zip(s._fields, s, strict=True))]
    )


def _call(function: Callable, what: str, t: float, s: tuple, p: tuple, here: bool) -> object:
    try:
        return function(t, s, p)
    except (ArithmeticError, ValueError) as error:
        if here:
            raise ModelError(f"{what} fails at the start, {_at(t, s)}: {error}") from error
        return None
    except AttributeError as error:
        raise ModelError(
            f"{what} asks for an unknown name: {error}; states {list(s._fields)}, parameters {list(p._fields)}"
        ) from error
    except TypeError as error:
        raise ModelError(f"{what} cannot be called as f(t, s, p): {error}") from error


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
    if values is None and here or isinstance(values, int | float | np.number):
        raise ModelError(
            f"{what} returns {values!r}: it must return a tuple of {len(names)} {kind} ({', '.join(names)}); for one write `return (value,)`"
        )
    if values is None:
        return
    try:
        values = tuple(values)
    except TypeError:
        raise ModelError(
            f"{what} returns {values!r}: it must return a tuple of {len(names)} {kind} ({', '.join(names)})"
        ) from None
    if len(values) != len(names):
        raise ModelError(
            f"{what} returns {len(values)} values, but there are {len(names)} states: return the {kind} of {', '.join(names)}, in this order"
        )
    for name, value in zip(names, values, strict=True):
        try:
            finite = abs(float(value)) < float("inf")
        except (TypeError, ValueError):
            raise ModelError(
                f"{what} returns {value!r} for {name!r}: it must be a number"
            ) from None
        if here and not finite:
            raise ModelError(
                f"{what} returns {value} for {name!r} at the start, {_at(t, s)}: check for a division by zero or a root of a negative number"
            )
