"""Runs of the same model one after the other: how each begins, what is kept of it, and the loop over all of them.

The same source for both back ends, as core.py, whose `advance` carries on with one run.
"""

from math import isfinite

from .core import advance, record, room
from .layout import *


def begin(w, lane):
    """Everything as it is at the start of a lane, and its first sample."""
    place, lanes = w.i[OUT], w.i[LANES]
    for q in range(INTEGERS):
        w.i[q] = w.i0[q]
    for q in range(FLOATS):
        w.f[q] = w.f0[q]
    w.i[LANES], w.i[LANE], w.i[BEGUN] = lanes, lane, 1
    w.i[OUT], w.i[OUT_FROM], w.i[MODE] = place, place, w.mode0[lane]
    for q in range(w.i[TRANSITIONS]):
        w.hold[q] = 0
        w.last_t[q], w.last_gap[q], w.last_ratio[q] = w.f[T0], 0.0, 0.0
    for s in range(w.i[SCHEDULES]):
        w.plan_next[s] = w.plan_next0[lane][s]
    n = w.size[w.i[MODE]]
    for q in range(n):
        w.y[q] = w.y0[lane][q]
    record(w, w.f[T], w.i[MODE], n, w.y)


def fits(model, w, p):
    """BAD_START if the flow or a guard is no number at the start, or a guard is passed already that does not say what then; else PAUSE."""
    mode = w.i[MODE]
    n = w.size[mode]
    flow(model, mode, w.f[T], w.y, p, w.k[0])
    largest = 0.0
    for q in range(n):
        largest = max(largest, abs(w.y[q]))
        if not isfinite(w.k[0][q]):
            return BAD_START
    first, last = w.leave_from[mode], w.leave_from[mode + 1]
    if last > first:
        guards(model, mode, w.f[T], w.y, p, w.g)
    for k in range(last - first):
        transition = w.leave[first + k]
        beyond = (
            w.directed[transition] == 1
            and w.urgent[transition] == REFUSE
            and w.g[k] > 1e-9 * (1.0 + largest)
        )
        if beyond or not isfinite(w.g[k]):
            return BAD_START
    return PAUSE


def finish(w, lane, status):
    """Whatever stopped it, the last state reached is the last sample; then what is kept of the lane."""
    i, done = w.i, w.done[lane]
    record(w, w.f[T], i[MODE], w.size[i[MODE]], w.y)
    done[STATUS], done[LAST], done[END], done[EVENTS] = status, i[WHO], i[OUT], i[LEDGER]
    done[ACCEPTED], done[FAILED], done[RATES], done[LOOKS] = (
        i[STEPS],
        i[REJECTED],
        i[FLOWS],
        i[GUARDS],
    )
    i[LANE], i[BEGUN] = lane + 1, 0


def sweep(model, w, p, budget):
    """Lane after lane for about `budget` steps: PAUSE and GROW as `advance`, FINISHED when no lane is left.

    A lane that ended otherwise than at the end or at a terminal event is returned from at once, so that it can be put
    into words while its workspace is as it was; the next call goes on with the next lane.
    """
    i = w.i
    while i[LANE] < i[LANES]:
        lane = i[LANE]
        mine = row(p, lane, i[PARAMETERS])
        status = PAUSE
        if i[BEGUN] == 0:
            if room(w) < w.i0[SAMPLES]:
                return GROW
            begin(w, lane)
            status = fits(model, w, mine)
        before = i[STEPS] + i[REJECTED]
        if status == PAUSE:
            status = advance(model, w, mine, budget)
        if status == PAUSE or status == GROW:
            return status
        budget = max(1, budget - 1 - (i[STEPS] + i[REJECTED] - before))
        finish(w, lane, status)
        if status != FINISHED and status != TERMINAL:
            return status
    return FINISHED
