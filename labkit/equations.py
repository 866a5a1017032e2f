"""A System as mathematics: the functions that are simulated, traced with SymPy.

There is no second copy to disagree.

equations(ball)                          # shows every mode, guard, reset and output in LaTeX
equations(ball).flows["flight"]["v"]     # SymPy expressions: -g
jacobian(ball)                           # ∂f/∂s of a mode
jacobian(ball).at({"y": 1, "v": 0}, g=1.62)    # … in numbers
parameter_table(ball)
"""

from __future__ import annotations

import inspect
import sys
import textwrap
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.printing.latex import LatexPrinter

from .arguments import asked
from .model import At, Every, ModelError, System, Transition, check_names, listed
from .show import latex_name, split_name
from .table import Table
from .trace import Quantity, Tracer, Untraceable, expression

__all__ = ["Equations", "Jacobian", "Untraced", "equations", "jacobian", "parameter_table"]


@dataclass(frozen=True)
class Untraced:
    """Stands where a function could not be made a formula: its source text, and why."""

    source: str
    why: str

    def __str__(self) -> str:
        return f"(shown as code, because {self.why})\n{self.source}"


@dataclass(frozen=True)
class _Row:
    """A transition as seen from source modes that have the same states."""

    transition: Transition
    sources: tuple[str, ...]
    guard: Any
    reset: Any


class Equations:
    """The equations of a system, as made by `equations(system)`; as a cell's last line they show.

    flows     mode -> {state: expression of its derivative}
    guards    one expression a transition, in their order; None where a schedule stands instead
    resets    one {state after: expression in the states before} a transition, of a reset that names
              what changes only that; None where the state is kept
    outputs   output -> {mode: expression}
    Symbols are real and carry the Python names: sympy.Symbol("x", real=True). Helper functions with
    cases are written out in these; the display keeps their names. What cannot be traced is an
    `Untraced` in its place.
    """

    def __init__(self, system: System, whole: bool = True):
        self.system = system
        self.t = sp.Symbol("t", real=True)
        self.states = {name: sp.Symbol(name, real=True) for name in system.units}
        self.parameters = {name: sp.Symbol(name, real=True) for name in system.parameters}
        self._tracer = Tracer([*self.states.values(), self.t])
        self._p = system.P(*map(Quantity, self.parameters.values()))
        trs = system.transitions
        if not whole:  # for a mode diagram: the guards alone are traced, and nothing else is there
            self.guards = [self._expand(self._guard(tr, tr.sources[0])) for tr in trs]
            return
        # All at once, and now: helpers are defined in this order, and the functions may change
        self._flows = {
            mode: self._trace(what.flow, mode, system.states_of(mode))
            for mode, what in system.modes.items()
        }
        self._rows = [self._row(tr, group) for tr in trs for group in _groups(system, tr)]
        self._outputs = {
            name: {mode: self._trace(f, mode) for mode in system.modes if (f := what.of(mode))}
            for name, what in system.outputs.items()
        }
        first = {id(row.transition): row for row in reversed(self._rows)}
        self.flows: dict[str, Any] = self._expand(self._flows)
        self.guards = [self._expand(first[id(tr)].guard) for tr in trs]
        self.resets = [self._expand(first[id(tr)].reset) for tr in trs]
        self.outputs: dict[str, dict[str, Any]] = self._expand(self._outputs)

    def _guard(self, tr: Transition, mode: str) -> Any:
        return None if tr.guard is None else self._trace(tr.guard, mode)

    def _trace(self, function: Callable, mode: str, names: Sequence[str] | None = None) -> Any:
        """An expression, or {name: expression} where names are given, or Untraced."""
        kind = self.system.S[mode]
        s = kind(*(Quantity(self.states[name]) for name in kind._fields))
        try:
            result = self._tracer.trace(function, Quantity(self.t), s, self._p)
        except Untraceable as error:
            return Untraced(_source(function), str(error))
        if names is None and not isinstance(result, tuple):
            return result
        values = result if isinstance(result, tuple) else (result,)
        if names is not None and len(values) == len(names):
            return dict(zip(names, values, strict=True))
        goal = f"for the {len(names)} states {listed(names)}" if names else "and not one number"
        return Untraced(_source(function), f"it returns {len(values)} values {goal}")

    def _row(self, tr: Transition, sources: tuple[str, ...]) -> _Row:
        mode = sources[0]
        guard, reset = self._guard(tr, mode), None
        if isinstance(tr.reset, Mapping):
            parts = self.system.reset_parts(tr, mode)
            reset = {name: self._trace(parts[name], mode) for name in tr.reset}
            reset = next((e for e in reset.values() if isinstance(e, Untraced)), reset)
        elif tr.reset is not None:
            reset = self._trace(tr.reset, mode, self.system.states_of(tr.target or mode))
        return _Row(tr, sources, guard, reset)

    def _expand(self, what: Any) -> Any:
        if isinstance(what, Mapping):
            return {name: self._expand(e) for name, e in what.items()}
        return self._tracer.expand(what) if isinstance(what, sp.Expr) else what

    def latex(self, what: sp.Basic | float | str | Callable) -> str:
        """equations(system).latex(e) -> LaTeX with the system's symbols.

        Also of a number, a parameter's name or f(p).
        """
        if callable(what) and not isinstance(what, sp.Basic):
            try:
                what = self._tracer.trace(what, self._p)
            except Untraceable:
                return rf"\text{{{getattr(what, '__name__', 'a function of p')}}}"
        if isinstance(what, str):
            what = self.parameters[what]
        return _Printer(self).doprint(what if isinstance(what, sp.Basic) else expression(what))

    def _repr_markdown_(self) -> str:
        system = self.system
        words = {}
        for name, unit in system.units.items():
            word = f"${latex_name(name)}$", system.meanings[name], unit and f"[{unit}]"
            words[name] = " ".join(filter(None, word))
        held = ", ".join(words.pop(name) for name in system.held)
        held = f"; held, changed by events only: {held}" if held else ""
        parts = [f"**{system.name}**: states {', '.join(words.values())}{held}"]
        for mode in system.modes.values():
            title = " — ".join(filter(None, [f"Mode *{mode.name}*", mode.meaning]))
            shown = self._flows[mode.name]
            if isinstance(shown, Untraced):
                parts.append(_code(title, shown))
            else:
                lines = (f"{_dot(name)} &= {self.latex(e)}" for name, e in shown.items())
                parts += [title, _aligned(lines)]
        parts += self._output_parts()
        if helpers := self._tracer.definitions.values():
            heads = (_called(each.name, map(self.latex, each.args)) for each in helpers)
            lines = zip(heads, (self.latex(each.e) for each in helpers), strict=True)
            parts += ["where", _aligned(map(" &= ".join, lines))]
        if self._rows:
            parts += ["Transitions", "\n".join(f"- {self._words(row)}" for row in self._rows)]
        return "\n\n".join([*parts, self._start()])

    def _output_parts(self) -> list[str]:
        lines, parts = [], []
        for name, modes in self._outputs.items():
            if bad := next((e for e in modes.values() if isinstance(e, Untraced)), None):
                parts.append(_code(f"Output ${latex_name(name)}$", bad))
                continue
            same = len(modes) == len(self.system.modes) and len({*modes.values()}) == 1
            for mode, e in list(modes.items())[: 1 if same else None]:
                where = "" if same else rf" && \text{{({mode})}}"
                lines.append(f"{latex_name(name)} &= {self.latex(e)}{where}")
        return ["Outputs", _aligned(lines), *parts] if lines else parts

    def _words(self, row: _Row) -> str:
        """**bounce**, flight → flight: when $y$ falls through 0; then $v^{+} = - e v$."""
        tr = row.transition
        sources = " or ".join(f"*{name}*" for name in row.sources)
        target = f"*{tr.target}*" if tr.target else "**end of the run**"
        text = f"**{tr.label}**, " if tr.label else ""
        text += f"{sources} → {target}: {self.condition(tr, row.guard)}"
        if isinstance(row.reset, Untraced):
            code = textwrap.indent(_code("", row.reset).strip(), "  ")
            text += f"; then the state is changed by\n\n{code}\n"
        elif row.reset:
            before = self.system.states_of(row.sources[0])
            after = [
                rf"${latex_name(name)}^{{+}} = {self.latex(e)}$"
                for name, e in row.reset.items()
                if e != self.states[name] or name not in before
            ]
            text += f"; then {', '.join(after)}" if after else "; the state is kept"
        if tr.zeno:
            text += f"; if infinitely many of these pile up: over to *{tr.zeno}*"
        return text + (f" (priority {tr.priority:g})" if tr.priority else "")

    def condition(self, tr: Transition, guard: Any) -> str:
        """When a transition fires, in words and LaTeX."""
        way = _WAYS[tr.direction]
        if isinstance(tr.at, Every):
            text = f"every {self._time(tr.at.period)}"
            text += "" if tr.at.first is None else f", first at {self._time(tr.at.first)}"
        elif isinstance(tr.at, At):
            text = "at $t$ = " + ", ".join(map(self._time, tr.at.instants))
        elif isinstance(guard, Untraced):
            code = " ".join(guard.source.split())
            text = f"when its guard {way} 0 (a guard shown as code, because {guard.why}: `{code}`)"
        else:
            text = f"when ${self.latex(guard)}$ {way} 0"
        text += f" by more than {tr.tolerance:g}" if tr.tolerance else ""
        if tr.urgent:
            side = "above" if tr.direction > 0 else "below"
            text += f", or is {side} 0 already when the mode is entered"
        return text + (f", after a dead time of {self._time(tr.delay)}" if tr.delay else "")

    def _time(self, value: Any) -> str:
        unit = "" if isinstance(value, str) or callable(value) else f" {self.system.time}"
        return f"${self.latex(value)}${unit}"

    def _start(self) -> str:
        system = self.system
        at = ", ".join(
            f"${latex_name(name)} = {self.latex(value)}$ {system.units[name]}".strip()
            for name, value in system.start.items()
        )
        own = "the mode that suits the state" if callable(system.mode) else f"*{system.mode}*"
        return f"Start in {own}" + (f" with {at}" if at else "")

    def __repr__(self) -> str:
        lines = [self.system.name]
        for mode, flow in self.flows.items():
            lines.append(f"  {mode}:")
            if isinstance(flow, Untraced):
                lines.append(textwrap.indent(str(flow), "    "))
            else:
                lines += [f"    {name}' = {e}" for name, e in flow.items()]
        for tr, guard, reset in zip(self.system.transitions, self.guards, self.resets, strict=True):
            when = f"{guard} {_WAYS[tr.direction]} 0"
            when = self.condition(tr, guard).replace("$", "") if guard is None else when
            lines.append(f"  {tr.name}: {when}" + (f"; then {reset}" if reset else ""))
        return "\n".join(lines)


_WAYS = {-1: "falls through", 0: "passes through", 1: "rises through"}


@asked
def equations(system: System) -> Equations:
    """equations(system) -> Equations: of each mode, then transitions, outputs and start.

    The formulas come from the functions themselves, called with symbols; see `labkit.trace`.
    `.flows`, `.guards`, `.resets` and `.outputs` hold SymPy expressions. A function that is no
    formula is shown as its source, with the reason; no exception.
    """
    return Equations(system)


class Jacobian(sp.ImmutableDenseMatrix):
    """The matrix ∂f/∂s of one mode.

    A SymPy matrix that is shown in the system's symbols and has `.at` for numbers.
    """

    equations: Equations
    mode: str

    @asked
    def at(
        self, state: Mapping[str, float] | None = None, t: float = 0.0, **parameters: float
    ) -> np.ndarray:
        """jacobian(system).at({"x": 1, "v": 0}, k=2) -> (n, n) array at that state.

        What is left out is as in the system. Raises ModelError for an unknown or missing state or
        parameter.
        """
        made, system = self.equations, self.equations.system
        names = system.S[self.mode]._fields
        state = {name: system.start[name] for name in names if name in system.start} | (state or {})
        values = [t, *system.check_start(state, self.mode), *system.values(parameters)]
        symbols = [made.t, *(made.states[name] for name in names), *made.parameters.values()]
        return np.array(sp.lambdify(symbols, sp.Matrix(self), "numpy")(*values), dtype=float)

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self.equations.latex(sp.ImmutableDenseMatrix(self))}$"


@asked
def jacobian(system: System, mode: str | None = None) -> Jacobian:
    """jacobian(system, "slip") -> Jacobian: ∂(derivative i)/∂(state j) of a mode.

    Left out, the mode is the start mode.
    Right between switching instants: at a jump of sign, floor or of a case the derivative does not
    exist, beside it their part is 0. Raises ModelError for an unknown mode, or where the flow could
    not be traced.
    """
    made = equations(system)
    if mode is None:
        mode = next(iter(system.modes)) if callable(system.mode) else system.mode
    check_names([mode], system.modes, f"{{}} is not a mode of {system.name!r}")
    flow = made.flows[mode]
    if isinstance(flow, Untraced):
        raise ModelError(
            f"the flow of mode {mode!r} has no Jacobian: it cannot be written as a formula, "
            f"because {flow.why}"
        )
    result = Jacobian(
        [[_derivative(e, made.states[n]) for n in system.states_of(mode)] for e in flow.values()]
    )
    result.equations, result.mode = made, mode
    return result


def _derivative(e: sp.Expr, x: sp.Symbol) -> sp.Expr:
    """Steps are constant between their jumps.

    SymPy alone would give Dirac pulses and unevaluated derivatives of floor.
    """
    e = e.replace(sp.Mod, lambda a, b: a - b * sp.floor(a / b))
    jumps = e.atoms(sp.sign, sp.floor, sp.ceiling, sp.Heaviside)
    steps = {step: sp.Dummy(real=True) for step in jumps}
    slope = sp.diff(e.xreplace(steps), x).xreplace({dummy: step for step, dummy in steps.items()})
    return slope.replace(sp.DiracDelta, lambda *_: sp.Integer(0))


@asked
def parameter_table(system: System) -> Table:
    """parameter_table(system) -> Table: a row for every parameter, then for every held variable.

    Symbol, name in the code, meaning, value (of a held variable: at the start), unit and range.
    """

    def row(name: str, what: Any, value: float, symbol: str | None, span: str) -> tuple:
        shown = f"${symbol or latex_name(name)}$", f"`{name}`"
        return *shown, what.meaning, _plain(value), what.unit, span

    rows = []
    for name, what in system.parameters.items():
        low, high = ("" if bound is None else _plain(bound) for bound in (what.low, what.high))
        half = f"≥ {low}" if low else f"≤ {high}" if high else "any"
        span = f"{low} … {high}" if low and high else half
        rows.append(row(name, what, what.value, what.symbol, span))
    for name, held in system.held.items():
        rows.append(row(name, held, held.start, None, "changed by events"))
    return Table(("symbol", "in the code", "meaning", "value", "unit", "range"), rows)


def _plain(value: float) -> str:
    return f"{value:.10g}".replace("-", "−")


def _groups(system: System, tr: Transition) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, ...], list[str]] = {}
    for source in tr.sources:
        groups.setdefault(system.states_of(source), []).append(source)
    return [tuple(group) for group in groups.values()]


def _aligned(lines: Iterable[str]) -> str:
    return "$$\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}$$"


def _called(name: str, args: Iterable[str]) -> str:
    """LaTeX of a helper with its arguments, if it has some."""
    inner = ", ".join(args)
    return latex_name(name) + (rf"\left({inner}\right)" if inner else "")


def _dot(name: str) -> str:
    head, index = split_name(name)
    return rf"\dot{{{head}}}" + (f"_{{{index}}}" if index else "")


def _source(function: Callable) -> str:
    try:
        return textwrap.dedent(inspect.getsource(function)).strip()
    except (OSError, TypeError):
        name = getattr(function, "__name__", repr(function))
        return f"{name}(t, s, p): …  # its source is not at hand"


def _code(title: str, what: Untraced) -> str:
    return f"{title}\n\n```python\n{what.source}\n```\n\nShown as code, because {what.why}."


class _Printer(LatexPrinter):
    """SymPy's LaTeX with the system's symbols, named helpers, short decimals.

    In sums states come first, constants last, and no minus leads.
    """

    def __init__(self, owner: Equations):
        # e v is not a variable "ev"
        how = {"ln_notation": True, "inv_trig_style": "full", "mul_symbol": r" \, "}
        super().__init__(how)
        self._owner = owner

    def _print_Symbol(self, expr: sp.Symbol, style: str = "plain") -> str:
        own = self._owner.system.parameters.get(expr.name)
        if own and own.symbol and expr == self._owner.parameters[expr.name]:
            return own.symbol
        return latex_name(expr.name)

    _print_Dummy = _print_Symbol

    def _print_Function(self, expr: Any, exp: str | None = None) -> str:
        known = self._owner._tracer.definitions if isinstance(expr, AppliedUndef) else {}
        definition = known.get(expr.func.__name__)
        if definition is None:
            return super()._print_Function(expr, exp)
        put = dict(zip(definition.formals, expr.args, strict=True))
        args = (self._print(put.get(a, a)) for a in definition.args)
        return _called(definition.name, args) + (f"^{{{exp}}}" if exp else "")

    def _print_Float(self, expr: sp.Float) -> str:
        mantissa, _, power = f"{float(expr):.6g}".partition("e")
        if not power:
            return mantissa
        times = "" if mantissa == "1" else rf"{mantissa} \cdot "
        return f"{times}10^{{{int(power)}}}"

    def _as_ordered_terms(self, expr: sp.Add, order: str | None = None) -> list[sp.Expr]:
        rank = {x: i for i, x in enumerate([*self._owner.states.values(), self._owner.t])}
        terms = sorted(
            super()._as_ordered_terms(expr, order),
            key=lambda term: min((rank.get(x, 99) for x in term.free_symbols), default=99),
        )
        first = next((term for term in terms if not term.could_extract_minus_sign()), terms[0])
        terms.remove(first)
        return [first, *terms]


class _Callable(types.ModuleType):
    """`labkit.equations` is the function, and this module once it is imported: both do the same."""

    def __call__(self, system: System) -> Equations:
        return equations(system)


sys.modules[__name__].__class__ = _Callable
