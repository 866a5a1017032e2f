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

from ..model import ModelError, System, Transition

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
    """Plain(system, orientations(system)): what the plain back end's core calls.

    A state is a list of `width` numbers, of which a mode uses the first, and the held variables behind.
    An arithmetic error in a function becomes NaN.
    """

    def __init__(self, system: System, orientations: list[list[tuple[Callable, float, float]]]):
        states = [_reader(system, mode) for mode in system.modes]
        self.flow = [
            _plain_flow(mode.flow, state, len(system.states_of(mode.name)))
            for mode, state in zip(system.modes.values(), states, strict=True)
        ]
        self.guards = [
            _plain_guards(pieces, state) for pieces, state in zip(orientations, states, strict=True)
        ]
        self.reset = [_plain_reset(system, tr, states) for tr in system.transitions]
        self.stepper = None


def _reader(system: System, mode: str) -> Callable[[list[float]], tuple]:
    """_reader(system, mode)(y) -> the named tuple s that a function of this mode gets."""
    new, kind = tuple.__new__, system.S[mode]
    n, width = len(system.states_of(mode)), system.width
    if n == width:
        return lambda y: new(kind, y)
    return lambda y: new(kind, [*y[:n], *y[width:]])


def _plain_flow(function: Callable, state: Callable, n: int) -> Callable:
    failed = [nan] * n

    def flow(t, y, p, out):
        try:
            out[:n] = function(t, state(y), p)
        except (ArithmeticError, ValueError):
            out[:n] = failed

    return flow


def _plain_guards(pieces: list[tuple[Callable, float, float]], state: Callable) -> Callable:
    def guards(t, y, p, out):
        s = state(y)
        for k, (function, sign, tolerance) in enumerate(pieces):
            try:
                out[k] = sign * function(t, s, p) - tolerance
            except (ArithmeticError, ValueError):
                out[k] = nan

    return guards


def _plain_reset(system: System, transition: Transition, states: list[Callable]) -> Callable:
    """The reset of one transition: (mode, t, y, p, out); what it does not name is carried over."""
    modes = list(system.modes)
    targets = system.places(transition.target or transition.sources[0])
    count = len(targets) - len(system.held)
    if callable(transition.reset):

        def values_of(mode, t, s, y, p):
            values = tuple(transition.reset(t, s, p))
            return [*values, *y[system.width :]] if len(values) == count else values
    else:
        parts = {
            mode: [
                (part, system.places(modes[mode]).get(name))
                for name, part in system.reset_parts(transition, modes[mode]).items()
            ]
            for mode in (modes.index(source) for source in transition.sources)
        }

        def values_of(mode, t, s, y, p):
            return [part(t, s, p) if part else y[place] for part, place in parts[mode]]

    def reset(mode, t, y, p, out):
        try:
            values = values_of(mode, t, states[mode](y), y, p)
        except (ArithmeticError, ValueError):
            values = [nan] * len(targets)
        for place, value in zip(targets.values(), values, strict=True):
            out[place] = value

    return reset


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
        states: dict[str, int],
        parameters: dict[str, int],
        values: dict[str, object],
    ):
        self.prefix, self.arguments, self.values = prefix, arguments, values
        self.fields = {arguments[1]: ("s", states), arguments[2]: ("p", parameters)}
        self.whole = {arguments[1]: False, arguments[2]: False}
        self.locals: set[str] = set()

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and node.value.id in self.fields:
            array, places = self.fields[node.value.id]
            if node.attr in places:
                return ast.copy_location(
                    ast.parse(f"{array}[{places[node.attr]}]", mode="eval").body, node
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
    states: dict[str, int],
    parameters: dict[str, int],
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
            array, places = inline.fields[argument]
            values[f"{prefix}{kind}"] = kind, tuple(places)
            fields = ", ".join(f"{array}[{i}]" for i in places.values())
            head += f"{prefix}{argument} = {prefix}{kind}({fields})\n"
    return [*ast.parse(head).body, *Finish().visit(module).body]


def common_source(system: System) -> tuple[str, dict[str, object]]:
    """common_source(system) -> (source of model(what, index, t, s, p, out), what its names stand for)."""
    return _Common(system).made()


def _fill(places: list[int], keep: str) -> Callable[[ast.expr], str]:
    """_fill([0, 1], "")(returned expression) -> statements that put its values into out, then `keep`."""

    def finish(value: ast.expr) -> str:
        # All values first, then the assignments: a reset may read what it is about to overwrite
        if not isinstance(value, ast.Tuple | ast.List):
            lines = "".join(f"out[{place}] = result[{i}]\n" for i, place in enumerate(places))
            return f"result = {ast.unparse(value)}\n{lines}{keep}return"
        head, texts = "", []
        for part in value.elts:
            # (*law(s, p), 0.0): Numba does not unpack; its length is what is missing
            if isinstance(part, ast.Starred):
                head += f"starred = {ast.unparse(part.value)}\n"
                texts += [f"starred[{i}]" for i in range(len(places) - len(value.elts) + 1)]
            else:
                texts.append(ast.unparse(part))
        return head + _store(dict(zip(places, texts, strict=False))) + f"{keep}return"

    return finish


def _store(values: dict[int, str]) -> str:
    """Statements that put expressions into their places of out, all worked out before the first is put."""
    lines = "".join(f"value_{i} = float({text})\n" for i, text in values.items())
    return lines + "".join(f"out[{i}] = value_{i}\n" for i in values)


class _Common:
    """_Common(system).made() -> the source of the common function and the values of its names."""

    def __init__(self, system: System):
        self.system, self.modes = system, list(system.modes)
        self.parameters = {name: place for place, name in enumerate(system.parameters)}
        self.values: dict[str, object] = {}
        self.helpers = ""
        self.branches: list[tuple[str, list[ast.stmt]]] = []
        self.kept = "".join(f"out[{i}] = s[{i}]\n" for i in self._behind())

    def _behind(self) -> range:
        """The places of held variables."""
        return range(self.system.width, self.system.width + len(self.system.held))

    def made(self) -> tuple[str, dict[str, object]]:
        for m, mode in enumerate(self.system.modes.values()):
            finish = _fill(list(range(len(self.system.states_of(mode.name)))), "")
            body = self._body(mode.flow, f"f{m}_", mode.name, finish)
            self.branches.append((f"what == {FLOW} and index == {m}", body))
        for m, pieces in enumerate(orientations(self.system)):
            self._add_guards(m, pieces)
        for i, tr in enumerate(self.system.transitions):
            if tr.reset is not None:
                self._add_reset(i, tr)
        text = "def model(what, index, t, s, p, out):\n"
        for condition, body in self.branches:
            text += f"    if {condition}:\n" + _indent(body, 2)
        text += f"    if what >= {RESET}:\n"
        text += f"        for i in range({self._behind().stop}):\n            out[i] = s[i]\n"
        return self.helpers + text, self.values

    def _body(
        self, function: Callable, prefix: str, mode: str, finish: Callable[[ast.expr], str]
    ) -> list[ast.stmt]:
        places = self.system.places(mode)
        return _statements(function, prefix, places, self.parameters, finish, self.values)

    def _expression(self, function: Callable, prefix: str, mode: str) -> str:
        """A function of one number as an expression; a helper of its own when it is more than one return."""
        body = self._body(function, prefix, mode, lambda value: f"return {ast.unparse(value)}")
        if len(body) == 1 and isinstance(body[0], ast.Return):
            return f"({ast.unparse(body[0].value)})"
        self.helpers += f"def {prefix}helper(t, s, p):\n" + _indent(body)
        self.values[f"{prefix}helper"] = None
        return f"{prefix}helper(t, s, p)"

    def _add_guards(self, m: int, pieces: list[tuple[Callable, float, float]]) -> None:
        lines = ""
        for k, (function, sign, tolerance) in enumerate(pieces):
            expression = self._expression(function, f"g{m}_{k}_", self.modes[m])
            shift = f" - {tolerance!r}" if tolerance else ""
            lines += f"out[{k}] = {'-' if sign < 0 else ''}{expression}{shift}\n"
        if lines:
            condition = f"what == {GUARDS} and index == {m}"
            self.branches.append((condition, ast.parse(lines + "return").body))

    def _add_reset(self, i: int, tr: Transition) -> None:
        """A branch for each kind of source mode; modes of the same states share one."""
        system = self.system
        states = system.states_of
        for m in {states(mode): self.modes.index(mode) for mode in tr.sources}.values():
            name, prefix = self.modes[m], f"r{i}_{m}_"
            alike = [self.modes.index(mode) for mode in tr.sources if states(mode) == states(name)]
            among = ", ".join(map(str, alike))
            condition = f"what >= {RESET} and index == {i} and what - {RESET} in ({among},)"
            if callable(tr.reset):
                count = len(states(tr.target)) if tr.target else 0
                body = self._body(tr.reset, prefix, name, _fill(list(range(count)), self.kept))
            else:
                body = ast.parse(_store(self._parts(tr, name, prefix)) + "return").body
            self.branches.append((condition, body))

    def _parts(self, tr: Transition, mode: str, prefix: str) -> dict[int, str]:
        """Place after the event -> expression, of a reset that names what changes."""
        before, texts = self.system.places(mode), {}
        for name, place in self.system.places(tr.target or mode).items():
            value = tr.reset.get(name)
            if callable(value):
                texts[place] = self._expression(value, f"{prefix}{place}_", mode)
            else:
                texts[place] = f"s[{before[name]}]" if value is None else repr(value)
        return texts


def _indent(body: list[ast.stmt], by: int = 1) -> str:
    return "".join(
        "    " * by + line + "\n"
        for statement in body
        for line in ast.unparse(ast.fix_missing_locations(statement)).splitlines()
    )


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
            elif tr.reset:
                for name, part in tr.reset.items():
                    if callable(part):
                        _check_number(part, f"{what} for {name!r}", t, s, p, False)


def _check_number(function: Callable, what: str, t: float, s: tuple, p: tuple, here: bool) -> None:
    value = _call(function, what, t, s, p, here)
    if value is not None and not isinstance(value, int | float | np.number | np.bool_):
        raise ModelError(f"{what} must return one number, not {value!r}")
    if isinstance(value, bool | np.bool_) and what.startswith("the guard"):
        raise ModelError(
            f"{what} returns {value}: return the number whose zero is the event (s.y, not s.y < 0)"
        )
    if here and value is not None and value != value:
        raise ModelError(f"{what} is not a number (NaN) at the start, {_at(t, s)}")


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
