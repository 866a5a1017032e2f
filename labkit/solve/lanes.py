"""Runs of the same model one after the other: how each begins, what is kept of it, and the loop
over all of them.

The same source for both back ends, as core.py, whose `advance` carries on with one run.
"""

from math import isfinite

from .core import advance
from .instant import *
from .layout import *
from .sides import *
from .step import first_step, sized


def begin(model, w, p, lane):
    """Everything as it is at the start of a lane, its first sample, and the sides of its guards.

    PAUSE, or BAD_START.
    """
    place, lanes = w.i[OUT], w.i[LANES]
    for q in range(INTEGERS):
        w.i[q] = w.i0[q]
    for q in range(FLOATS):
        w.f[q] = w.f0[q]
    i, f = w.i, w.f
    i[LANES], i[LANE], i[BEGUN] = lanes, lane, 1
    i[OUT], i[OUT_FROM], i[MODE] = place, place, w.mode0[lane]
    i[BY_FLOW] = i[MODE]
    for q in range(i[TRANSITIONS]):
        w.last_t[q], w.last_gap[q], w.shorter[q], w.few[q] = f[T0], 0.0, 0, 0
    for slot in range(i[TRANSITIONS] + 2):
        w.side[slot], w.flat[slot], w.wait[slot], w.came[slot], w.rises[slot] = -1, 0, 0, 0, 0
        w.leap[slot], w.grains[slot] = 0, 0
        w.slack[slot], w.scale[slot], w.swing[slot], w.grain[slot] = 0.0, 0.0, 0.0, 0.0
    for s in range(i[SCHEDULES]):
        strike(w, s, w.plan_next0[lane][s])
        w.found[s] = -1
    for m in range(i[MODES]):
        for q in range(i[WIDTH]):
            w.terms[m][q], w.ticks[m][q], w.felt[m][q] = 0.0, 0.0, -1.0
    mode = i[MODE]
    n = w.size[mode]
    for q in range(i[WIDTH] + i[HELD]):
        w.y[q], w.made[q] = w.y0[lane][q], 0.0
    for q in range(n):
        w.most[q], w.speed[q], w.lost[q] = 0.0, 0.0, 0.0
    carry(w)
    sized(w, mode, n)
    record(model, w, p, f[T], mode, n, w.y)
    know_flow(model, w, p)
    for q in range(n):
        if not isfinite(w.k[0][q]):
            return BAD_START
    if f[H] <= 0.0:
        f[H] = max(first_step(model, w, p, mode, n), 64.0 * EPS * abs(f[T]))
    status = sides(model, w, p, START, -9)
    return BAD_START if status == GUARD_NAN else status


def finish(model, w, p, lane, status):
    """Whatever stopped it, the last state reached is the last sample.

    Then what is kept of the lane.
    """
    i, done = w.i, w.done[lane]
    record(model, w, p, w.f[T], i[MODE], w.size[i[MODE]], w.y)
    done[STATUS], done[LAST], done[END], done[EVENTS] = status, i[WHO], i[OUT], i[LEDGER]
    done[ACCEPTED], done[FAILED], done[JUMPED] = i[STEPS], i[REJECTED], i[JUMPS]
    done[RATES], done[LOOKS] = i[FLOWS], i[GUARDS]
    i[LANE], i[BEGUN] = lane + 1, 0


def sweep(model, w, p, budget):
    """Lane after lane for about `budget` steps: PAUSE and GROW as `advance`, FINISHED when no lane
    is left.

    A lane that ended otherwise than at the end or at a terminal event is returned from at once, so
    that it can be put into words while its workspace is as it was; the next call goes on with the
    next lane.
    """
    i = w.i
    while i[LANE] < i[LANES]:
        lane = i[LANE]
        mine = row(p, lane, i[PARAMETERS])
        status = PAUSE
        if i[BEGUN] == 0:
            if room(w) < w.i0[SAMPLES]:
                return GROW
            status = begin(model, w, mine, lane)
        before = i[STEPS] + i[REJECTED]
        if status == PAUSE:
            status = advance(model, w, mine, budget)
        if status == PAUSE or status == GROW:
            return status
        budget = max(1, budget - 1 - (i[STEPS] + i[REJECTED] - before))
        finish(model, w, mine, lane, status)
        if status != FINISHED and status != TERMINAL:
            return status
    return FINISHED
