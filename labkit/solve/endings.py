"""Why a run ended: the core's status, as a value that code can test and as a sentence.

ended, stopped = ending(status, settings, w, p)
"""

from __future__ import annotations

import numpy as np

from ..model import System, listed
from ..run import Ended
from . import core
from .check import trouble
from .methods import FIXED_STEP
from .settings import Settings

__all__ = ["ending"]

_REST = '(give its transition zeno="…", a mode to rest in)'

#: Status of the core -> what it is, and the sentence; what stands in braces: see `ending`.
ENDINGS = {
    core.FINISHED: (Ended.FINISHED, "finished"),
    core.TERMINAL: (Ended.TERMINAL, 'terminal event "{name}"'),
    core.ZENO: (
        Ended.ZENO,
        'Zeno at t = {zeno:.10g}: "{name}" repeats infinitely often before that instant ' + _REST,
    ),
    core.CONTACT: (
        Ended.CONTACT,
        'resting contact at t = {t:.6g}: after "{name}" its guard does not leave zero ' + _REST,
    ),
    core.LOOP: (
        Ended.LOOP,
        "endless loop at t = {t:.6g}: {same} events at one instant, the last of them "
        '"{name}" (chattering: its own reset, or the flow after it, leads back at once)',
    ),
    core.EVENTS_OUT: (
        Ended.TOO_MANY_EVENTS,
        'too many events: {events} by t = {t:.6g}, the last of them "{name}" '
        "(max_events={max_events})",
    ),
    core.STEPS_OUT: (
        Ended.TOO_MANY_STEPS,
        "too many steps: {steps} by t = {t:.6g} (max_steps={max_steps})",
    ),
    core.QUEUE_FULL: (
        Ended.QUEUE,
        'too many dead-time transitions under way at t = {t:.6g}: "{name}"',
    ),
    core.GUARD_NAN: (Ended.NOT_A_NUMBER, 'not a number: the guard of "{name}" at t = {t:.6g}'),
    core.STIFF: (
        Ended.STIFF,
        "too many steps: {steps} by t = {t:.6g}, for the flow of mode {mode!r} is stiff: the steps "
        "of {method} are as short as its stability asks, not its accuracy (try method='Radau')",
    ),
    core.HIDDEN_JUMP: (
        Ended.JUMP,
        "too many steps: {steps} by t = {t:.6g}, for the flow of mode {mode!r} jumps near "
        "t = {jump:.6g}: make the jump an event (a Transition with a guard, or at=)",
    ),
}


def ending(status: int, settings: Settings, w: core.Workspace, p: tuple) -> tuple[Ended, str]:
    """ending(status, settings, w, p) of the lane that has just ended -> (Ended, sentence)."""
    if status not in ENDINGS or status == core.GUARD_NAN:
        if said := _lost_by_an_event(settings, w):
            return Ended.NOT_A_NUMBER, said
        system, mode = settings.system, settings.modes[w.i[core.MODE]]
        state = [float(w.y[place]) for place in system.places(mode).values()]
        fixed, tried = settings.method in FIXED_STEP, 4.0 * float(w.f[core.H])
        step = settings.step if fixed else tried if settings.external else 0.0
        if why := trouble(system, mode, float(w.f[core.T]), state, p, step):
            return Ended.NOT_A_NUMBER, f"not a number: {why}"
        if any(abs(x) > 1e100 for x in state):  # what is made of it is no number then
            return _why_no_step(settings, w, p)
    if status not in ENDINGS:
        return _why_no_step(settings, w, p)
    transitions = settings.system.transitions
    ended, sentence = ENDINGS[status]
    if status == core.LOOP and w.leap[w.i[core.WHO] + 2] == 1 and w.i[core.SAME] <= 5000:
        sentence = (
            'endless loop at t = {t:.6g}: two modes send each other back at the guard of "{name}", '
            "which jumps there, so that no slope says how the state slides on it (give it a guard "
            "that passes through zero)"
        )
    elif status == core.LOOP and (both := _two_surfaces(w)):
        one, other = (transitions[i].name for i in both)
        sentence = (
            "endless loop at t = {t:.6g}: the state slides on two surfaces at once, those of "
            f'"{one}" and "{other}", and no rule says which mixture of the flows holds it on both '
            "(give it a mode of its own there)"
        )
    return ended, sentence.format(
        name=transitions[w.i[core.WHO]].name if transitions else "",
        mode=settings.modes[w.i[core.MODE]],
        t=w.f[core.T],
        zeno=w.f[core.ZENO_T],
        jump=w.f[core.JUMP_T],
        same=w.i[core.SAME],
        events=w.i[core.LEDGER],
        steps=w.i[core.STEPS] + w.i[core.REJECTED],
        method=settings.method,
        max_events=settings.options.max_events,
        max_steps=settings.options.max_steps,
    )


def _two_surfaces(w: core.Workspace) -> tuple[int, int] | None:
    """The transitions of two surfaces between which a loop goes to and fro, if it slides."""
    end = int(w.i[core.LEDGER])
    last = [w.ledger[line] for line in range(max(end - 64, 0), end)]
    for line, after in zip(last, last[1:], strict=False):
        if line[4] == core.SLIDE and after[3] != core.SLIDE and after[1] != line[1]:
            return int(line[1]), int(after[1])
    return None


def _lost_by_an_event(settings: Settings, w: core.Workspace) -> str:
    """Which variables are no finite numbers since an event at this instant; "" if none."""
    end = int(w.i[core.LEDGER])
    if not end or w.ledger[end - 1][0] != w.f[core.T]:
        return ""
    system = settings.system
    places = system.places(settings.modes[w.i[core.MODE]])
    lost = [name for name, place in places.items() if not np.isfinite(w.y[place])]
    label = system.transitions[int(w.ledger[end - 1][1])].name
    if not lost:
        return ""
    return (
        f"not a number: after {label!r} at t = {w.f[core.T]:.6g} the value of {listed(lost)} is "
        "not finite"
    )


def _why_no_step(settings: Settings, w: core.Workspace, p: tuple) -> tuple[Ended, str]:
    """The step shrank to nothing, or a fixed step overflowed.

    A state that grows without bound, a flow that is no number, or a singular or stiff system.
    """
    system, mode, t = settings.system, settings.modes[w.i[core.MODE]], float(w.f[core.T])
    names = system.states_of(mode)
    y = [float(w.y[place]) for place in system.places(mode).values()]
    rates = _rates(system, mode, t, y, p)
    fixed = settings.method in FIXED_STEP
    # As far as the clock can tell where the step has shrunk; nothing here has a unit
    short = settings.step if fixed else 1e4 * core.EPS * max(abs(t), 1e-3 * abs(settings.step))
    sizes = dict(zip(names, map(abs, y), strict=False))
    grows = [
        name
        for name, x, rate in zip(names, y, rates, strict=False)
        if abs(x) > 1e100 or (x > 0) == (rate > 0) and abs(rate) * short > 0.01 * abs(x) > 0
    ]
    # The last attempt's stages are still there: one that is no number tells more than the tiny step
    kept = [] if settings.external else list(w.k)[: settings.table.stages + 1]
    stages = np.array(kept, dtype=float).reshape(len(kept), settings.width)
    bad = [n for k, n in enumerate(names) if not np.all(np.isfinite(stages[:, k : k + 1]))]
    if grows or (fixed and not bad):
        most = max(grows or names, key=sizes.__getitem__)
        return Ended.DIVERGED, f"diverged: |{most}| = {sizes[most]:.3g} at t = {t:.6g}"
    if bad:
        return (
            Ended.NOT_A_NUMBER,
            f"not a number: the flow of mode {mode!r} gives no finite value for {listed(bad)} "
            f"near t = {t:.6g}",
        )
    return (
        Ended.SINGULAR,
        f"no step is short enough at t = {t:.6g} in mode {mode!r}: the flow is singular there, or "
        "stiff (try method='Radau')",
    )


def _rates(system: System, mode: str, t: float, y: list[float], p: tuple) -> list[float]:
    """The flow at a state; NaN where it has no answer, endless where one is too large."""
    try:
        return [float(rate) for rate in system.modes[mode].flow(t, system.S[mode](*y), p)]
    except OverflowError:
        return [np.inf * x for x in y]
    except Exception:  # what it is has been asked before
        return [np.nan] * len(y)
