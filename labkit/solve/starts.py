"""Where and when runs begin: start states and modes, delays and schedules, and what does not fit.

A start that does not fit is an error of a single run, and one lane's reason among many.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ..model import Every, ModelError, System, Transition, listed, number
from . import core
from .check import check_functions
from .options import Options
from .settings import Settings

__all__ = ["Refused", "check_start", "clocks", "start_of", "starts_of", "try_functions"]

Refused = dict[int, ModelError]  # lane -> why it cannot begin


def start_of(
    options: Options, start: Mapping[str, float], mode: object, p: tuple
) -> tuple[tuple[float, ...], str]:
    """start_of(options, start, mode, p) -> (values in the order of S[mode], name of the mode).

    The mode is given, or the system's, or chosen by the system's function.
    """
    system, t0 = options.system, options.t0
    mode = system.mode if mode is None else mode
    if callable(mode):
        s = system.S[next(iter(system.modes))]
        values = {name: number(start.get(name, np.nan), f"start of {name!r}") for name in s._fields}
        try:
            mode = mode(t0, s(**values), p)
        except Exception as error:
            raise _said(error, "the start mode") from error
    if mode not in system.modes:
        raise ModelError(
            f"start mode {mode!r} is not a mode of {system.name!r}; "
            f"there are {listed(system.modes)}"
        )
    values = system.check_start(start, mode)
    if surfaces := _surfaces(system, mode):
        s = dict(zip(system.places(mode), values, strict=True))
        off = {tr.name: _off(tr, options, s, p) for tr in surfaces}
        if all(off.values()):
            name, value = next(iter(off.items()))
            raise ModelError(
                f"the start does not fit mode {mode!r}, where a body rests on the surface of "
                f"{name!r}: its guard is {value:.6g} at t = {t0:g}, not 0. Start on the surface, "
                f"or in another mode (mode={surfaces[0].sources[0]!r}?)"
            )
    return values, mode


def _surfaces(system: System, mode: object) -> list[Transition]:
    """The transitions whose events pile up to this mode; none if it is entered otherwise, too."""
    found = [tr for tr in system.transitions if tr.zeno == mode and mode not in tr.sources]
    if found and any(tr.target == mode and {*tr.sources} != {mode} for tr in system.transitions):
        return []
    return [tr for tr in found if tr.guard]


def _off(tr: Transition, options: Options, here: Mapping[str, float], p: tuple) -> float:
    """The value of a guard that is not zero at a start; 0 where it may be.

    A run may have left the state there: to half of the digits that are asked for, on the scale of
    the guard's terms. A state has the size of its usual start at least, 1 where that is zero.
    """
    system, t0 = options.system, options.t0
    try:
        kind = system.S[tr.sources[0]]
        s = kind(*(here[name] for name in kind._fields))
        value, scale = float(tr.guard(t0, s, p)), 0.0
        for name, x in zip(kind._fields, s, strict=True):
            size = max(abs(x), abs(system.start.get(name, 0.0)) or 1.0)
            near = [x - 1e-6 * size, x + 1e-6 * size]
            moved = [float(tr.guard(t0, s._replace(**{name: one}), p)) for one in near]
            if min(*moved, value) <= 0.0 <= max(*moved, value):  # also of one that jumps there
                return 0.0
            scale += max(abs(one - value) for one in moved) / 1e-6
    except (ArithmeticError, ValueError, KeyError, TypeError):  # not to be told, or said elsewhere
        return 0.0
    return value if abs(value) > tr.tolerance + options.rtol**0.5 * scale else 0.0


def starts_of(
    settings: Settings, start: Mapping[str, np.ndarray], mode: object, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Refused]:
    """starts_of(settings, start, mode, p (lanes, parameters)) -> states, modes, refused lanes.

    States (lanes, length), in the order of a state's vector; modes (lanes,) by place.
    Raises ModelError for what would be wrong in every lane.
    """
    system, lanes = settings.system, len(p)
    begin, modes = np.zeros((lanes, settings.length)), np.zeros(lanes, dtype=np.int64)
    refused: Refused = {}
    for key, value in start.items():
        if not np.all(np.isfinite(value)):
            raise ModelError(
                f"start of {key!r} must be finite, not {value[~np.isfinite(value)].flat[0]}"
                if np.ndim(value)
                else f"start of {key!r} must be finite, not {value}"
            )
    first = {key: float(np.ravel(value)[0]) for key, value in start.items()}
    mode = system.mode if mode is None else mode
    if not callable(mode) and not _surfaces(system, mode):
        _, name = start_of(settings.options, first, mode, ())
        for key, place in system.places(name).items():
            begin[:, place] = start[key]
        modes[:] = settings.place[name]
        return begin, modes, refused
    if unknown := [key for key in start if key not in system.units]:
        system.check_start({key: first[key] for key in unknown}, settings.modes[0])
    lists = {key: np.broadcast_to(value, lanes).tolist() for key, value in start.items()}
    for lane, values in enumerate(p.tolist()):
        mine = {key: value[lane] for key, value in lists.items()}
        try:
            state, name = start_of(settings.options, mine, mode, system.P(*values))
        except ModelError as error:  # it stands in the first mode then, as far as it goes
            refused[lane], name = error, settings.modes[0]
            state = [mine.get(key, np.nan) for key in system.places(name)]
        begin[lane, settings.places[name]] = state
        modes[lane] = settings.place[name]
    return begin, modes, refused


def try_functions(
    settings: Settings, state: np.ndarray, mode: int, p: tuple
) -> tuple[str, tuple[float, ...]]:
    """try_functions(settings, state (length,), mode by place, p) -> the mode's name, the start s.

    Raises ModelError where a function of the model does not do there.
    """
    system, name = settings.system, settings.modes[mode]
    start = tuple(float(state[place]) for place in system.places(name).values())
    check_functions(system, p, settings.options.t0, start, name)
    return name, system.S[name](*start)


def check_start(settings: Settings, state: np.ndarray, mode: int, p: tuple) -> None:
    """check_start(settings, state (length,), mode by place, p): why a start is refused, in words.

    The model's functions are tried there; else a guard is passed already.
    """
    system, t0 = settings.system, settings.options.t0
    name, s = try_functions(settings, state, mode, p)
    for i in system.leaving[name]:
        tr = system.transitions[i]
        if tr.guard is None or tr.direction == 0 or tr.urgent is not None:
            continue
        value = float(tr.guard(t0, s, p))
        beyond = tr.direction * value - tr.tolerance
        if beyond > 0:  # the core has found that it is more than rounding
            elsewhere = "" if tr.target in (None, name) else f" (mode={tr.target!r}?)"
            raise ModelError(
                f"the start does not fit mode {name!r}: the guard of {tr.name!r} is already "
                f"{value:.6g} ({'> 0' if tr.direction > 0 else '< 0'}) at t = {t0:g}. Start "
                f"elsewhere, choose another mode{elsewhere}, or say what the transition shall do: "
                "urgent=True fires at once, urgent=False waits for the next crossing"
            )


def clocks(settings: Settings, p: np.ndarray) -> tuple[dict[str, np.ndarray], Refused]:
    """clocks(settings, p (lanes, parameters)) -> fields of the workspace, refused lanes.

    Dead times, and when the schedules strike: first + m·period on the clock for m = 0 (or 1), 2, …;
    or a list of instants. What strikes at t0 belongs to the run that ended there, so that a run cut
    in two is the whole run; a run from t = 0 has none before it. Arrays are (lanes, columns).
    """
    if not settings.timed:
        return {}, {}
    system, lanes = settings.system, len(p)
    refused: Refused = {}
    t0 = settings.options.t0
    # what strikes up to here is over
    over = float(settings.fixed["f0"][core.UNTIL]) if t0 != 0.0 else -5e-324
    plans, plan_from = settings.plans, settings.fixed["plan_from"]

    def resolve(
        value: object, what: str, allowed: Callable[[float], bool], mend: str
    ) -> np.ndarray:
        """A number, a parameter's name or a function of p, for every lane."""
        if isinstance(value, str):
            place = system.resolve(value, system.P(*range(p.shape[1])), what)
            found = p[:, int(place)].copy()
        elif not callable(value):
            found = np.full(lanes, system.resolve(value, (), what))
        else:
            found = np.full(lanes, np.nan)
            for lane, values in enumerate(p.tolist()):
                try:
                    found[lane] = system.resolve(value, system.P(*values), what)
                except Exception as error:
                    refused.setdefault(lane, _said(error, what))
        if not (fits := allowed(found)).all():
            for lane in np.flatnonzero(~fits & np.isfinite(found)).tolist():
                refused.setdefault(lane, ModelError(f"{what} is {found[lane]:g}: {mend}"))
        return found

    made = {
        "delay": np.zeros((lanes, len(system.transitions))),
        "plan_first": np.zeros((lanes, len(plans))),
        "plan_period": np.zeros((lanes, len(plans))),
        "plan_next0": np.zeros((lanes, len(plans)), dtype=np.int64),
        "instant": np.zeros((lanes, int(plan_from[-1]))),
    }
    for i, tr in enumerate(system.transitions):
        if tr.delay != 0:
            what = f"the delay of {tr.name!r}"
            made["delay"][:, i] = resolve(
                tr.delay, what, lambda v: v >= 0, "a dead time cannot be negative"
            )
    for k, tr in enumerate(plans):
        if isinstance(tr.at, Every):
            made["plan_period"][:, k] = resolve(
                tr.at.period,
                f"the period of {tr.name!r}",
                lambda v: v > 0,
                "a period must be positive",
            )
            made["plan_first"][:, k] = resolve(
                0.0 if tr.at.first is None else tr.at.first,
                f"the first instant of {tr.name!r}",
                lambda v: v >= 0,
                "it must not be negative",
            )
            made["plan_next0"][:, k] = at_least = tr.at.first is None
            if over > 0.0:
                period, first = made["plan_period"][:, k], made["plan_first"][:, k]
                with np.errstate(divide="ignore", invalid="ignore"):  # refused lanes
                    before = np.floor((over - first) / period) + 1.0
                before = np.nan_to_num(before, posinf=0, neginf=0)
                made["plan_next0"][:, k] = np.maximum(before, at_least)
        else:
            found = [
                resolve(x, f"an instant of {tr.name!r}", np.isfinite, "") for x in tr.at.instants
            ]
            found = np.sort(found, axis=0)
            made["instant"][:, plan_from[k] : plan_from[k + 1]] = found.T
            made["plan_next0"][:, k] = (found <= over).sum(axis=0)
    return made, refused


def _said(error: Exception, what: str) -> ModelError:
    if isinstance(error, ModelError):
        return error
    made = ModelError(f"{what} cannot be worked out: {type(error).__name__}: {error}")
    made.__cause__ = error
    return made
