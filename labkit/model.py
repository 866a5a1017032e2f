"""The model as an object: what a hybrid system *is*, checked when it is made. No numerics live
here.

    ball = System(
        "bouncing ball",
        states={"y": "m", "v": "m/s"},
        parameters={"g": Parameter(9.81, "m/s²", "gravity"),
                    "e": Parameter(0.8, "", "restitution", 0, 1)},
        modes=[Mode("flight", lambda t, s, p: (s.v, -p.g))],
        transitions=[Transition("flight", "flight", guard=lambda t, s, p: s.y, direction=-1,
                                reset=lambda t, s, p: (0.0, -p.e * s.v), label="bounce")],
        start={"y": 10.0, "v": 0.0},
    )

Words: a *mode* has a *flow* (the right-hand side of its differential equations); a *transition*
leaves a source mode when its *guard* crosses zero in the stated direction, or at the instants of a
*schedule*, applies its *reset* and enters the target mode. All functions are plain Python functions
of (t, s, p) with named states and parameters.
"""

from __future__ import annotations

import keyword
import math
import unicodedata
from collections import namedtuple
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from itertools import product
from typing import Any

from .arguments import asked, takes

__all__ = ["At", "Every", "Held", "Mode", "ModelError", "Output", "Parameter", "System"]
__all__ += ["Transition", "OPTIONS"]

_OWN = """system t_end t0 start mode method rtol atol step max_step points locate backend max_events
max_steps workers draw show title horizon dense executor progress accept"""
#: Names that `simulate`, `simulate_many`, `sweep` and `explore` use for their own options; a
#: parameter may not be called so.
OPTIONS = frozenset(_OWN.split())

#: What a run and its files call their own columns; a state or an output may not be called so.
COLUMNS = frozenset({"t", "j", "mode", "stopped", "file"})

Function = Callable[[float, Any, Any], object]  # of (t, s, p)
Number = float | str | Callable[..., float]


class ModelError(ValueError):
    """Raised when a model or a request about it does not make sense; the message names the thing
    and the mend.
    """


def listed(names: Iterable[str]) -> str:
    return ", ".join(repr(name) for name in names) or "none"


def check_names(names: Iterable[str], known: Iterable[str], said: str) -> None:
    """check_names(start, system.units, "start names the unknown state(s) {}")

    ModelError, said of the names that are not known, and which there are.
    """
    known = list(known)
    if lost := [name for name in names if name not in known]:
        raise ModelError(f"{said.replace('{}', listed(lost), 1)}; there are {listed(known)}")


def one_of(value: object, known: tuple) -> bool:
    """one_of(direction, (-1, 0, 1)) -> whether it is one of these; an array is none."""
    return not hasattr(value, "__len__") and value in known


def number(value: object, what: str) -> float:
    """number(value, "parameter 'g'") -> float; ModelError when it is not a finite real number."""
    try:
        result = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ModelError(f"{what} must be a number, not {value!r}") from None
    if not math.isfinite(result):
        raise ModelError(f"{what} must be finite, not {result}")
    return result


def _letters(name: object) -> object:
    """The name as Python reads it in source: µ (keyboard) is μ (Greek), ϕ is φ, ϵ is ε; hence
    p.µ asks for "μ".
    """
    return unicodedata.normalize("NFKC", name) if isinstance(name, str) else name


def named(given: Mapping, what: str, form: str = "{name: …}") -> dict:
    """A mapping with its names as Python reads them; ModelError where two become one."""
    if not isinstance(given, Mapping):
        raise ModelError(f"{what} must be a dict {form}, not {given!r:.60}")
    made = {_letters(key): value for key, value in given.items()}
    if len(made) < len(given):
        raise ModelError(
            f"two names in {what} are the same to Python, which reads ϕ as φ, ϵ as ε, µ as μ "
            f"(unicode NFKC): {listed(given)}"
        )
    return made


def _function(value: object, what: str, more: str = "") -> None:
    if not takes(value, 3):
        given = f"f{signature(value)}" if callable(value) else repr(value)  # one of C takes any
        raise ModelError(f"{what} must be a function f(t, s, p), not {given}{more}")


@dataclass(frozen=True)
class Parameter:
    """Parameter(value, unit, meaning, low, high): a number of the model that a slider may move.

    `low` and `high` bound what `simulate` accepts and where the slider runs; left out, anything
    finite goes. `symbol` is LaTeX for the equations ("\\\\lambda_0"); left out, it is made from the
    name.
    """

    value: float
    unit: str = ""
    meaning: str = ""
    low: float | None = None
    high: float | None = None
    symbol: str | None = None

    def check(self, name: str, value: object) -> float:
        """parameter.check("e", 1.2) -> the value as float; ModelError when it is no number or
        out of range.
        """
        what = f"parameter {name!r}"
        low, high = (
            end if bound is None else number(bound, f"a bound of {what}")
            for bound, end in ((self.low, -math.inf), (self.high, math.inf))
        )
        result = number(value, what)
        if low <= result <= high:
            return result
        span = f"[{low:g}, {high:g}]".replace("inf", "∞")
        if low > high:
            raise ModelError(f"{what} has the range {span}: its lower bound is above the upper one")
        raise ModelError(f"{what} = {result:g} is outside its range {span} {self.unit}".rstrip())


@dataclass(frozen=True)
class Held:
    """Held("Ω", 50.0, "load"): a variable that only events change: no derivative, read as s.load.

    It keeps its value, `start` at first, until the reset of a transition names it.
    """

    unit: str
    start: float
    meaning: str = ""


@dataclass(frozen=True)
class Mode:
    """Mode("flight", flow): one law of motion; flow(t, s, p) returns the derivatives in the order
    of the states.

    `states` (name -> unit) is given only by a mode that has variables of its own (a torn pendulum);
    otherwise the mode has those of the system. `meaning` is shown in tables and the mode diagram.
    """

    name: str
    flow: Function
    states: Mapping[str, str] | None = None
    meaning: str = ""


@dataclass(frozen=True)
class Every:
    """Every(period, first=None): the instants first, first + period, … on the clock.

    Both may be a number, the name of a parameter, or a function of p. `first` defaults to one
    period. Instants are multiples of the period, not sums, and do not depend on where a run starts:
    a run cut in two meets the same ones.
    """

    period: Number
    first: Number | None = None


@dataclass(frozen=True)
class At:
    """At(25.0) or At(5, "t_back"): single known instants: numbers, names of parameters, or
    functions of p. Raises ModelError without any.
    """

    instants: tuple[Number, ...]

    def __init__(self, *instants: Number):
        if not instants:
            raise ModelError("At() names no instant: give one or more, At(25.0), or leave out at=")
        for each in instants:
            if not isinstance(each, str) and hasattr(each, "__len__"):
                raise ModelError(
                    f"At({each!r}) is given a collection: write the instants one by one, At(1, 2), "
                    "or unpack them, At(*times)"
                )
        object.__setattr__(self, "instants", instants)


Schedule = Every | At


@dataclass(frozen=True)
class Transition:
    """Transition("stick", "slip", guard=…, direction=+1): when to leave a mode, and what changes.

    source     name of a mode, or a tuple of names; target: a mode; None ends the run ("destroyed")
    guard      g(t, s, p) -> number; the event is its zero. direction: +1 rising, -1 falling, 0 both
    at         a schedule (Every, At) instead of a guard: instants known beforehand
    reset      r(t, s, p) -> the states after the event, in the order of the target's; or {"v":
               function or number, …} names what changes and keeps the rest; left out: all kept
    delay      dead time (number, parameter name or function of p) from the crossing to the event
    priority   at one instant the highest goes first; equal ones in the order of the list
    urgent     True: fires whenever its guard is beyond zero, again and again. False: only by a
               crossing along the flow. Left out: see below
    zeno       mode that takes over when infinitely many of these events pile up (a ball at rest);
               its states are those of the target, or the first ones of them, and keep their values
    tolerance  the guard must pass zero by this much (in its unit): a touch is not a crossing

    What an event means:

    - Every guard has a side, − or +: the sign of its value or, where that is zero to its own
      rounding, the sign with which it leaves zero along the flow; − if it never does.
    - With a direction it fires when its side goes to beyond (+ for 1, − for -1), without one when
      the side changes: along the flow, or by a jump of the state at that very instant.
    - What crosses or is due at one instant goes by priority. The others wait, unless their mode is
      gone or a reset has undone their crossing. Each crossing counts once.
    - On entering another mode a guard that is beyond fires at once (not with urgent=False; nor if
      it would only lead back to where the flow has just left, is beyond by no more than the error
      of the integration, and the flow takes it back). At the start that is an error in words,
      unless `urgent` says what to do.
    - Without a direction, a change of mode that keeps the state crosses a guard that is zero there
      if the new flow turns it back. Two modes that send each other back so slide on their surface.
    - Schedules with an equal `at` (equal numbers, names, formulas of p) are one clock: only what
      leaves the mode in which it strikes fires. Different clocks each strike, in whatever mode the
      one before them has left behind. A dead time runs on, whatever its guard does, and is dropped
      if its mode is not the current one.
    - Where the flow is not defined any more, like √h of a tank that runs dry, a guard whose zero is
      there has crossed.
    - Flights of one guard too small to be told from rest have piled up: over to `zeno`, or the run
      ends and says so; so it is when a reset takes away the speed with which the guard came.
    - The end of a run is an instant like others, and what happens at it belongs to this run, not to
      one that starts there.
    """

    source: str | tuple[str, ...]
    target: str | None
    guard: Function | None = None
    direction: int = 0
    reset: Function | Mapping[str, Function | float] | None = None
    label: str = ""
    at: Schedule | None = None
    delay: Number = 0.0
    priority: float = 0.0
    urgent: bool | None = None
    zeno: str | None = None
    tolerance: float = 0.0

    @property
    def sources(self) -> tuple[str, ...]:
        return (self.source,) if isinstance(self.source, str) else tuple(self.source)

    @property
    def name(self) -> str:
        return self.label or f"{' | '.join(self.sources)} → {self.target or 'end'}"


@dataclass(frozen=True)
class Output:
    """Output(function, "N", "friction force"): a quantity computed from the run, read like a state:
    run["F"].

    `function` is f(t, s, p) for all modes, or a mapping mode name -> function (NaN in modes that
    are not named).
    """

    function: Function | Mapping[str, Function]
    unit: str = ""
    meaning: str = ""

    def of(self, mode: str) -> Function | None:
        """output.of("slip") -> its function in that mode, if it has one there."""
        return self.function.get(mode) if isinstance(self.function, Mapping) else self.function


class System:
    """System(name, states, parameters, modes, transitions, start, mode=…, outputs=…): a hybrid
    system, checked.

    states       name -> unit, or name -> (unit, meaning)
    parameters   name -> Parameter, or a bare number
    modes        one or more Mode
    transitions  any number of Transition
    start        state name -> value at t0, for every state of the start mode
    mode         start mode: a name (default: the first), or a function (t, s, p) -> name that suits
                 the start
    outputs      name -> Output
    held         name -> (unit, start), or (unit, start, meaning): variables that only events
                 change, read as s.name like states; a flow returns no derivative of them
    time         unit of the time

    Raises ModelError, naming the piece and the mend, for an unknown mode, a name used twice, a
    value out of range…
    """

    @asked
    def __init__(
        self,
        name: str,
        states: Mapping[str, str | tuple[str, str]],
        parameters: Mapping[str, Parameter | float] | None = None,
        modes: Sequence[Mode] = (),
        transitions: Sequence[Transition] = (),
        start: Mapping[str, float] | None = None,
        mode: str | Function | None = None,
        outputs: Mapping[str, Output] | None = None,
        time: str = "s",
        held: Mapping[str, tuple] | None = None,
    ):
        self.name, self.time = name, time
        self.units: dict[str, str] = {}  # of states and held variables
        self.meanings: dict[str, str] = {}
        self.parameters: dict[str, Parameter] = {}
        if not states:
            raise ModelError(f"system {name!r} has no states: give states={{'x': 'm', …}}")
        self.states = self._add_states(states, "the system")
        self.parameters = self._make_parameters(parameters or {})
        self.modes = self._make_modes([modes] if isinstance(modes, Mode) else modes)
        #: name -> Held, in the order of their places behind the states
        self.held = self._make_held(held or {})
        #: the most states of any mode; held variables stand from here on in the vector of a state
        self.width = max(len(self.states_of(key)) for key in self.modes)
        given = [transitions] if isinstance(transitions, Transition) else transitions
        self.transitions = tuple(map(self._make_transition, given))
        self.outputs = self._make_outputs(outputs or {})
        if callable(mode):
            _function(mode, f"the start mode of {name!r}")
        elif mode is not None:
            check_names([mode], self.modes, f"start mode {{}} is not a mode of {name!r}")
        self.mode = mode if mode is not None else next(iter(self.modes))
        self.start = self._make_start(start or {})
        self.P = namedtuple("P", list(self.parameters))  # type: ignore[misc]
        #: mode -> the named tuple s of its states, then the held variables
        self.S = {key: namedtuple("S", [*self.states_of(key), *self.held]) for key in self.modes}
        #: mode -> places in `transitions` of those that may leave it, highest priority first
        self.leaving = {
            key: sorted(
                (i for i, tr in enumerate(self.transitions) if key in tr.sources),
                key=lambda i: -self.transitions[i].priority,
            )
            for key in self.modes
        }

    @asked
    def variant(
        self,
        name: str,
        /,
        *,
        states: Mapping[str, str | tuple[str, str] | None] | None = None,
        parameters: Mapping[str, Parameter | float | None] | None = None,
        modes: Sequence[Mode] | Mapping[str, Mode | Function | None] | None = None,
        transitions: Sequence[Transition]
        | Mapping[str, Transition | Mapping[str, object] | None]
        | None = None,
        start: Mapping[str, float] | None = None,
        mode: str | Function | None = None,
        outputs: Mapping[str, Output | None] | None = None,
        time: str | None = None,
        held: Mapping[str, tuple | None] | None = None,
        **values: float,
    ) -> System:
        """system.variant("light load", R=200.0) -> a new System that keeps what is not named.

            system.variant("no diode", modes={"off": None}, R=200.0)
            system.variant("as printed", modes={"diode": another_flow})
            system.variant("no tolerance", transitions={"destroyed": {"tolerance": 0.0}})

        The parts are those of System. A list is the whole part. A mapping changes what it names,
        adds what is new, and takes away what is None:

        modes        name -> Mode, or a flow: then meaning and states of the mode stay
        transitions  label -> Transition, or field -> value: then its other fields stay
        parameters   name -> Parameter, or a number, as in `values`
        values       new default values of parameters by name; unit, meaning and range stay

        With a mode that is gone go the transitions into it and out of it, and its outputs; with a
        state that is gone, its start. A start mode that is gone becomes the first mode.

        Raises ModelError, naming the piece, for an unknown name, for a value out of range, for a
        keyword that is both a part of System and a parameter (say parameters={"time": 3.0}), and as
        System does.
        """
        from .variant import variant_of  # it makes a System, so it comes after this file

        parts = {"states": states, "parameters": parameters, "modes": modes, "mode": mode}
        parts |= {"transitions": transitions, "start": start, "outputs": outputs}
        return variant_of(self, name, {**parts, "time": time, "held": held}, values)

    @property
    def described(self) -> dict[str, tuple[str, str]]:
        """The states as they were given."""
        return {key: (self.units[key], self.meanings[key]) for key in self.states}

    def __reduce__(self) -> tuple:
        start = {key: value for key, value in self.start.items() if key not in self.held}
        modes = tuple(self.modes.values())
        given = (self.name, self.described, self.parameters, modes, self.transitions)
        return System, (*given, start, self.mode, self.outputs, self.time, self.held)

    def _check_name(self, name: object, what: str, *free: str) -> None:
        """A new name is a plain one, and none that something else has, but for what is free."""
        plain = isinstance(name, str) and name.isidentifier() and not name.startswith("_")
        if not plain or keyword.iskeyword(name):
            raise ModelError(
                f"{what} {name!r} must be a plain Python name (letters, digits, _), so that "
                f"s.{name} or p.{name} can be written"
            )
        taken = {"the time": {"t"}, "a column": COLUMNS, "an option of simulate": OPTIONS}
        taken |= {"a state": self.units, "a parameter": self.parameters}
        more = {"the time": ", the first argument of every function", "a column": " of every run"}
        apart = "; a formula could not tell them apart"
        for owner, names in taken.items():
            if owner not in free and name in names:
                hint = apart * (owner in ("a state", "a parameter"))
                raise ModelError(
                    f"{what} {name!r} has the name of {owner}{more.get(owner, '')}: give it "
                    f"another, {name}_ for example{hint}"
                )

    def _add_states(self, states: Mapping, owner: str) -> tuple[str, ...]:
        states = named(states, f"the states of {owner}", "{'x': 'm', …}")
        for key, what in states.items():
            self._check_name(key, f"state of {owner}", "an option of simulate", "a state")
            words = (what, "") if isinstance(what, str) else what
            pair = isinstance(words, tuple) and len(words) == 2
            if not pair or not all(isinstance(word, str) for word in words):
                raise ModelError(
                    f"state {key!r} of {owner} needs a unit, or (unit, meaning), not {what!r}"
                )
            unit, meaning = words
            if self.units.setdefault(key, unit) != unit:
                raise ModelError(
                    f"state {key!r} has the unit {unit!r} in {owner} and {self.units[key]!r} "
                    "elsewhere: use another name"
                )
            self.meanings.setdefault(key, meaning)
        return tuple(states)

    def _make_parameters(self, parameters: Mapping[str, Parameter | float]) -> dict[str, Parameter]:
        made = {}
        for key, value in named(parameters, f"parameters of {self.name!r}").items():
            self._check_name(key, "parameter", "a column")
            what = value if isinstance(value, Parameter) else Parameter(value)  # type: ignore[arg-type]
            made[key] = replace(what, value=what.check(key, what.value))
        return made

    def _make_modes(self, modes: Sequence[Mode]) -> dict[str, Mode]:
        if not modes:
            raise ModelError(f"system {self.name!r} has no mode: give modes=[Mode('motion', flow)]")
        made: dict[str, Mode] = {}
        for mode in modes:
            if not isinstance(mode, Mode) or not isinstance(mode.name, str) or not mode.name:
                raise ModelError(f"modes of {self.name!r} must be Mode(name, flow), not {mode!r}")
            what = f"mode {mode.name!r}"
            if mode.name in made:
                raise ModelError(f"two modes are called {mode.name!r}: give each its own name")
            _function(mode.flow, f"the flow of {what}")
            if mode.states is not None:
                if not mode.states:
                    raise ModelError(f"{what} has no states: leave states= out")
                self._add_states(mode.states, what)
                mode = replace(mode, states=named(mode.states, what))
            made[mode.name] = mode
        return made

    def _make_held(self, held: Mapping[str, tuple]) -> dict[str, Held]:
        made: dict[str, Held] = {}
        form = "{'load': ('Ω', 50.0)}"
        for key, what in named(held, f"held of {self.name!r}", form).items():
            self._check_name(key, "held variable")
            parts = (what.unit, what.start, what.meaning) if isinstance(what, Held) else what
            few = isinstance(parts, tuple | list) and len(parts) in (2, 3)
            if not few or not all(isinstance(word, str) for word in parts[::2]):
                raise ModelError(
                    f"held variable {key!r} must be (unit, start value) or "
                    f"(unit, start value, meaning), not {what!r}"
                )
            unit, start, *meaning = parts
            made[key] = Held(unit, number(start, f"start of {key!r}"), *meaning)
        for key, each in made.items():
            self.units[key], self.meanings[key] = each.unit, each.meaning
        return made

    def _make_transition(self, tr: Transition) -> Transition:
        sources = tr.source if isinstance(tr, Transition) else None
        if not isinstance(sources, str | tuple | list) or not all(
            isinstance(source, str) for source in sources
        ):
            raise ModelError(
                f"transitions of {self.name!r} must be Transition(source mode, target mode, "
                f"…), not {tr!r}"
            )
        what = f"transition {tr.name!r}"
        if not isinstance(tr.label or "", str):
            raise ModelError(f"the label of {what} must be a text, not {tr.label!r}")
        if not tr.sources:
            raise ModelError(f"{what} has no source mode")
        ends = [end for end in (*tr.sources, tr.target, tr.zeno) if end is not None]
        check_names(ends, self.modes, f"{what} names the unknown mode {{}}")
        if (tr.guard is None) == (tr.at is None):
            raise ModelError(
                f"{what} needs either a guard (a function) or at= (a schedule), and not both"
            )
        if tr.guard is not None:
            _function(tr.guard, f"the guard of {what}")
        if tr.at is not None and not isinstance(tr.at, Schedule):
            raise ModelError(f"{what}: at= takes Every(period) or At(instant, …), not {tr.at!r}")
        if not one_of(tr.urgent, (None, True, False)):
            raise ModelError(f"urgent of {what} is True, False or None, not {tr.urgent!r}")
        if not one_of(tr.direction, (-1, 0, 1)):
            raise ModelError(
                f"{what} has direction {tr.direction!r}: it is -1 (falling), +1 (rising) or 0 "
                "(both)"
            )
        if tr.urgent and tr.direction == 0:
            raise ModelError(
                f"{what} is urgent, so it needs a direction: +1 fires while the guard is > 0, "
                "-1 while it is < 0"
            )
        priority = number(tr.priority, f"priority of {what}")
        tolerance = number(tr.tolerance, f"tolerance of {what}")
        if tolerance < 0 or (tolerance and tr.direction == 0):
            raise ModelError(f"{what}: tolerance must be ≥ 0, and needs a direction of +1 or -1")
        times = [tr.delay]
        if isinstance(tr.at, Every):
            times += [tr.at.period, tr.at.first]
        elif tr.at:
            times += tr.at.instants
        needed = [_letters(value) for value in times if isinstance(value, str)]
        check_names(needed, self.parameters, f"{what} names the unknown parameter {{}}")
        reset = self._make_reset(tr)
        return replace(tr, priority=priority, tolerance=tolerance, reset=reset)

    def _make_reset(self, tr: Transition) -> Function | Mapping[str, Function | float] | None:
        """The reset: a function, or a mapping of names that there are to functions or numbers."""
        what = f"the reset of transition {tr.name!r}"
        kept = () if tr.target is None else tr.sources if tr.reset is None else (tr.target,)
        for one, other in product(kept, (tr.target, tr.zeno or tr.target)):
            have, get = self.states_of(one), self.states_of(other)
            # those of a zeno mode are taken from the front of the target's
            if have != get and (tr.reset is None or have[: len(get)] != get):
                lacks, rule = "needs a reset", ""
                if tr.reset is not None:
                    lacks, rule = (
                        "cannot pile up",
                        ": its zeno mode keeps the first of them, or all",
                    )
                raise ModelError(
                    f"transition {tr.name!r} {lacks}: mode {one!r} has the states "
                    f"{listed(have)}, mode {other!r} has {listed(get)}{rule}"
                )
        if tr.reset is None:
            return None
        if not isinstance(tr.reset, Mapping):
            _function(tr.reset, what, "; or a dict of what changes, {'v': 0.0}")
            return tr.reset
        parts = named(tr.reset, what)
        for source in tr.sources:
            before, after = self.states_of(source), self.states_of(tr.target or source)
            if unknown := [key for key in parts if key not in after and key not in self.held]:
                raise ModelError(
                    f"{what} names {listed(unknown)}; after it there are "
                    f"{listed([*after, *self.held])}"
                )
            if missing := [key for key in after if key not in parts and key not in before]:
                raise ModelError(
                    f"{what} gives no value for {listed(missing)}, which mode {source!r} does "
                    "not have"
                )
        for key, value in parts.items():
            if callable(value):
                _function(value, f"{what} for {key!r}")
            else:
                parts[key] = number(value, f"{what}: {key!r}")
        return parts

    def _make_outputs(self, outputs: Mapping[str, Output]) -> dict[str, Output]:
        made = named(outputs, "outputs")
        for key, what in made.items():
            self._check_name(key, "output", "an option of simulate")
            functions = what.function if isinstance(what, Output) else None
            by_mode = functions if isinstance(functions, Mapping) else {}
            if not all(takes(one, 3) for one in by_mode.values() or [functions]):
                raise ModelError(
                    f"output {key!r} must be Output(function of (t, s, p), unit, meaning), "
                    f"not {what!r}"
                )
            check_names(by_mode, self.modes, f"output {key!r} names the unknown mode(s) {{}}")
        return made

    def _make_start(self, start: Mapping[str, float]) -> dict[str, float]:
        made = {
            key: number(value, f"start of {key!r}")
            for key, value in named(start, "start", "{'x': 1.0, …}").items()
        }
        if twice := [key for key in made if key in self.held]:
            raise ModelError(
                f"start names the held variable(s) {listed(twice)}: their start stands in held= "
                "(simulate(…, start=…) may change it)"
            )
        check_names(made, self.units, "start names the unknown state(s) {}")
        made |= {key: each.start for key, each in self.held.items()}
        if not callable(self.mode):
            self.check_start(made, self.mode)
        return made

    def reset_parts(self, transition: Transition, mode: str) -> dict[str, Function | None]:
        """system.reset_parts(transition, "flight") -> name after the event -> f(t, s, p), None if
        kept.

        Names are the target's states (the mode's own where the run ends), then the held variables.
        """

        def part(place: int) -> Function:
            return lambda t, s, p: reset(t, s, p)[place]

        def constant(value: float) -> Function:
            return lambda t, s, p: value

        names, reset = self.states_of(transition.target or mode), transition.reset
        parts: dict[str, Function | None] = dict.fromkeys([*names, *self.held])
        if callable(reset):
            return parts | {name: part(k) for k, name in enumerate(names)}
        for key, value in (reset or {}).items():
            parts[key] = value if callable(value) else constant(value)
        return parts

    def places(self, mode: str) -> dict[str, int]:
        """system.places("flight") -> name -> its place in the vector of a state of that mode."""
        own = {name: place for place, name in enumerate(self.states_of(mode))}
        return own | {name: self.width + place for place, name in enumerate(self.held)}

    def states_of(self, mode: str) -> tuple[str, ...]:
        """system.states_of("flight") -> names of that mode's state variables, in order."""
        own = self.modes[mode].states
        return self.states if own is None else tuple(own)

    def unit(self, name: str) -> str:
        """system.unit("v") -> the unit of a state, output or parameter, or of the time "t"."""
        if name == "t":
            return self.time
        described = {key: each.unit for key, each in (self.outputs | self.parameters).items()}
        known = self.units | described
        said = f"{{}} is neither a state, an output nor a parameter of {self.name!r}"
        check_names([name], known, said)
        return known[name]

    def values(self, changed: Mapping[str, object] | None = None) -> tuple[float, ...]:
        """system.values({"e": 0.9}) -> all parameters as a named tuple p; ModelError for an
        unknown name or bad value.
        """
        if not changed:
            return self.P(*(parameter.value for parameter in self.parameters.values()))
        if not self.parameters.keys() >= changed.keys():
            changed = named(changed, "the parameters")
            check_names(changed, self.parameters, f"{{}} is not a parameter of {self.name!r}")
        return self.P(
            *(
                parameter.check(key, changed[key]) if key in changed else parameter.value
                for key, parameter in self.parameters.items()
            )
        )

    def check_start(self, start: Mapping[str, float], mode: str) -> tuple[float, ...]:
        """system.check_start(start, mode) -> the values in the order of S[mode]; ModelError when
        one is missing or too many.

        Held variables that are not named start as `held` says.
        """
        names = self.states_of(mode)
        if not self.units.keys() >= start.keys():
            start = named(start, "start")
            has = f"(mode {mode!r} has {listed(names)})"
            check_names(start, self.units, f"start names the unknown state(s) {{}} {has}")
        if self.held:
            start = {key: each.start for key, each in self.held.items()} | dict(start)
        if missing := [key for key in names if key not in start]:
            raise ModelError(
                f"start gives no value for {listed(missing)}: mode {mode!r} has the states "
                f"{listed(names)}"
            )
        return tuple(number(start[key], f"start of {key!r}") for key in (*names, *self.held))

    def resolve(self, value: Number, p: tuple[float, ...], what: str) -> float:
        """system.resolve("Td", p, "delay of …") -> a number given as such, as a parameter's name
        or as a function of p.
        """
        if callable(value):
            value = value(p)
        elif isinstance(value, str):
            value = getattr(p, _letters(value))
        return number(value, what)

    def __repr__(self) -> str:
        states = ", ".join(name for name in self.units if name not in self.held)
        held = f"; held {', '.join(self.held)}" if self.held else ""
        modes, count = ", ".join(self.modes), len(self.transitions)
        return f"System({self.name!r}: states {states}{held}; modes {modes}; {count} transitions)"
