"""The integrator: explicit Runge–Kutta steps, event location on their polynomials, modes, schedules, dead times.

One source for both back ends. As it stands here it runs in plain Python on lists; backend.py loads it a second
time with the same functions compiled by Numba on arrays. So: scalar loops only, no NumPy, nothing but indexing,
and `w`, the workspace (fields in `workspace`), holds everything that must survive a pause.
"""

from math import isfinite

from .layout import *
from .locate import find_event, guard_at, note_touches, refine
from .sliding import back_to_surface, begin_sliding, rates, watch, watch_count, watched
from .step import *


def room(w):
    """How many more samples of the grid there is room for; four are kept for the two sides of events and the last state."""
    return w.room[ROOM_OUT] - w.i[OUT] - 4


def record(w, t, mode, n, y):
    """One sample, unless it is the last one again."""
    row, jump = w.i[OUT], w.i[JUMP]
    if row > w.i[OUT_FROM] and w.out[row - 1][0] == t and w.out[row - 1][2] == jump:
        return
    out = w.out[row]
    out[0], out[1], out[2] = t, mode, jump
    for i in range(n):
        out[3 + i] = y[i]
    w.i[OUT] = row + 1


def enter(w, t, transition, target, size):
    """Book-keeping of a jump whose new state stands in w.y."""
    ledger = w.ledger[w.i[LEDGER]]
    width = w.i[WIDTH]
    for i in range(size):
        ledger[5 + width + i] = w.y[i]
    ledger[4] = target
    w.i[LEDGER] += 1
    w.i[JUMP] += 1
    w.i[MODE] = target
    w.i[ENTRY] = 1
    w.i[FRESH] = 1
    record(w, t, target, size, w.y)


def leave(w, t, mode, n, transition):
    """Write the sample and the left half of the ledger's line."""
    record(w, t, mode, n, w.y)
    ledger = w.ledger[w.i[LEDGER]]
    ledger[0], ledger[1], ledger[2], ledger[3] = t, transition, w.i[JUMP], mode
    for i in range(n):
        ledger[5 + i] = w.y[i]
    w.i[WHO] = transition


def slide(w, t, n, source, target):
    """A line of the ledger for the start (target SLIDE) or the end (source SLIDE) of sliding, named after the surface's transition."""
    surface = w.leave[w.leave_from[w.i[SLIDE_A]] + w.i[GUARD_A]]
    leave(w, t, source, n, surface)
    mode = target
    if target == SLIDE:
        mode = w.i[SLIDE_A]
    else:
        w.i[SLIDING] = 0
    enter(w, t, surface, mode, n)
    w.ledger[w.i[LEDGER] - 1][4] = target
    w.i[SAME] = w.i[SAME] + 1 if t == w.f[EVENT_T] else 1
    w.f[EVENT_T] = t
    return LOOP if w.i[SAME] > SAME_INSTANT else PAUSE


def fire(model, w, p, transition):
    """Carry out a transition at the current time and state; returns PAUSE to go on, or why the run ends."""
    if w.i[SLIDING] == 1:  # from the one of the two modes that has this transition
        w.i[SLIDING] = 0
        if w.source[transition][w.i[MODE]] == 0:
            w.i[MODE] = w.i[SLIDE_B]
    t, mode = w.f[T], w.i[MODE]
    n = w.size[mode]
    leave(w, t, mode, n, transition)
    target = w.target[transition]
    if target < 0:
        w.ledger[w.i[LEDGER]][4] = -1
        for i in range(n):
            w.ledger[w.i[LEDGER]][5 + w.i[WIDTH] + i] = w.y[i]
        w.i[LEDGER] += 1
        return TERMINAL
    size = w.size[target]
    reset(model, transition, mode, t, w.y, p, w.y_new)
    for i in range(size):
        w.y[i] = w.y_new[i]
    for q in range(w.i[TRANSITIONS]):
        if mode != target or t > w.f[EVENT_T]:
            w.hold[q] = 0
    if mode == target:
        w.hold[transition] = 1
    w.i[SAME] = w.i[SAME] + 1 if t == w.f[EVENT_T] else 1
    w.f[EVENT_T] = t
    enter(w, t, transition, target, size)
    if w.i[SAME] > SAME_INSTANT:
        return LOOP
    return pile_up(w, t, transition, mode, size)


def postpone(w, t, transition):
    """Its dead time begins: the transition is queued, and its guard, just crossed, is passed through."""
    place = w.i[PENDING]
    if place >= QUEUE:
        w.i[WHO] = transition
        return QUEUE_FULL
    w.queue_t[place], w.queue[place] = t + w.delay[w.i[LANE]][transition], transition
    w.i[PENDING] = place + 1
    w.i[ENTRY], w.i[FRESH] = 1, 1
    w.hold[transition] = 1
    return PAUSE


def pile_up(w, t, transition, mode, size):
    """Zeno: intervals of one transition that shrink geometrically pile up at t + gap·r/(1 − r); when that is near, go there.

    The state's limit follows from the same ratio (Aitken): s + (s − s_before)·r/(1 − r).
    """
    gap = t - w.last_t[transition]
    ratio = gap / w.last_gap[transition] if w.last_gap[transition] > 0.0 else 2.0
    status = PAUSE
    if 0.0 < ratio < 0.9999 and abs(ratio - w.last_ratio[transition]) < 0.01 * (1.0 - ratio):
        remaining = gap * ratio / (1.0 - ratio)
        if remaining < 1e-9 * w.f[SPAN]:
            w.f[ZENO_T] = t + remaining
            w.i[WHO] = transition
            rest = w.zeno[transition]
            if rest < 0:
                status = ZENO
            elif t + remaining < w.f[T_END]:
                for i in range(size):
                    w.y_new[i] = w.y[i] + (w.y[i] - w.last_y[transition][i]) * ratio / (1.0 - ratio)
                come_to_rest(w, t + remaining, transition, size)
                return PAUSE
    w.last_t[transition], w.last_gap[transition], w.last_ratio[transition] = t, gap, ratio
    for i in range(size):
        w.last_y[transition][i] = w.y[i]
    return status


def come_to_rest(w, t, transition, size):
    """Over to the rest mode of a transition, at time t with the state in w.y_new."""
    for i in range(size):
        w.y[i] = w.y_new[i]
    w.f[T] = t
    leave(w, t, w.i[MODE], size, transition)
    enter(w, t, transition, w.zeno[transition], size)
    w.f[EVENT_T] = t


def plan_time(w, s):
    """Next instant of schedule s, or infinity."""
    lane = w.i[LANE]
    if w.plan_period[lane][s] > 0.0:
        return w.f[T0] + (w.plan_first[lane][s] + w.plan_next[s] * w.plan_period[lane][s])
    place = w.plan_from[s] + w.plan_next[s]
    return w.instant[lane][place] if place < w.plan_from[s + 1] else 1e300


def next_due(w):
    """The next instant of a schedule or at the end of a dead time."""
    due = 1e300
    for s in range(w.i[SCHEDULES]):
        due = min(due, plan_time(w, s))
    for q in range(w.i[PENDING]):
        due = min(due, w.queue_t[q])
    return due


def take_due(w, until):
    """Take the transition of highest priority that is due off its schedule or queue; −1 if there is none. Not for this mode: dropped."""
    best, where, queued = -1, -1, False
    for s in range(w.i[SCHEDULES]):
        if plan_time(w, s) <= until and (best < 0 or w.rank[w.plan[s]] < w.rank[best]):
            best, where, queued = w.plan[s], s, False
    for q in range(w.i[PENDING]):
        if w.queue_t[q] <= until and (best < 0 or w.rank[w.queue[q]] < w.rank[best]):
            best, where, queued = w.queue[q], q, True
    if where >= 0 and queued:
        w.i[PENDING] -= 1
        for q in range(where, w.i[PENDING]):
            w.queue[q], w.queue_t[q] = w.queue[q + 1], w.queue_t[q + 1]
    elif where >= 0:
        w.plan_next[where] += 1
    return best


def sample(w, t, h, end, mode, n):
    """Samples of the grid within (t, end], from the step's polynomial; the end's own from w.y."""
    place = w.i[GRID]
    while place < w.i[SAMPLES] and w.grid[place] < end:
        if w.grid[place] > t:
            evaluate(w, n, (w.grid[place] - t) / h, w.y_try)
            record(w, w.grid[place], mode, n, w.y_try)
        place += 1
    if place < w.i[SAMPLES] and w.grid[place] == end:
        record(w, end, mode, n, w.y)
        place += 1
    w.i[GRID] = place


def keep_piece(w, t, h, mode, n):
    if w.i[DENSE] == 1:
        piece = w.pieces[w.i[PIECES]]
        piece[0], piece[1], piece[2] = t, h, mode
        width = w.i[WIDTH]
        for d in range(w.i[DEGREE] + 1):
            for i in range(n):
                piece[3 + d * width + i] = w.poly[d][i]
        w.i[PIECES] += 1


def defect(model, w, p, mode, n, t, h, theta):
    """By how much the step's polynomial misses the differential equation at θ, times h, over the tolerance."""
    evaluate(w, n, theta, w.y_try)
    rates(model, w, mode, n, t + theta * h, w.y_try, p, w.err[0])
    w.i[FLOWS] += 1
    largest = 0.0
    for q in range(n):
        slope = 0.0
        for d in range(w.i[DEGREE], 0, -1):
            slope = slope * theta + d * w.poly[d][q]
        largest = max(
            largest,
            abs(slope - h * w.err[0][q])
            / (w.f[ATOL] + w.f[RTOL] * max(abs(w.y[q]), abs(w.y_try[q]), abs(w.y_new[q]))),
        )
    return largest


def retake(model, w, p, mode, n, t, h, theta, k, limit):
    """Take the step anew, as long as the event needs: (h, θ) of the event on the new step, or the old ones where that is not clear.

    Between its ends a step is known by an interpolant of lower order than the method's. So an event in its middle is less
    accurate than the tolerance promises, and the state that starts the next mode with it. The new step ends near the event.
    """
    transition = watched(w, mode, k)
    if transition < 0 or w.i[SLIDING] == 1:
        return h, theta
    short = theta * h
    if defect(model, w, p, mode, n, t, h, theta) < 1e-3:
        return h, theta
    for q in range(n):  # for the way back
        for d in range(w.i[DEGREE] + 1):
            w.kept[d][q] = w.poly[d][q]
    side = 1.0 if w.side[k] > 0 else -1.0
    better = 2.0
    if explicit_step(model, w, p, mode, n, t, short) < 1.0:
        interpolate(model, w, p, mode, n, t, short)
        value = guard_at(model, w, p, mode, n, t, short, 1.0, k)
        slope = (value - guard_at(model, w, p, mode, n, t, short, 0.999, k)) / 0.001
        off = abs(value / slope) if slope != 0.0 else 1.0
        if off < 0.02:
            reach = 2.0 * off + 1e-13
            one, two = (
                guard_at(model, w, p, mode, n, t, short, 1.0 - reach, k),
                guard_at(model, w, p, mode, n, t, short, 1.0 + reach, k),
            )
            if one * side < 0.0 and two * side > 0.0:
                better = refine(
                    model, w, p, mode, n, t, short, k, 1.0 - reach, one, 1.0 + reach, two
                )
    if t + better * short <= limit:
        guard_at(model, w, p, mode, n, t, short, better, k)
        for q in range(watch_count(w, mode)):  # no other guard may have passed in between
            if w.g[q] * w.side[q] < 0.0:
                better = 2.0
    if better < 1.5 and t + better * short <= limit:
        return short, better
    for q in range(n):
        for d in range(w.i[DEGREE] + 1):
            w.poly[d][q] = w.kept[d][q]
    return h, theta


def unlocated_event(model, w, p, mode, n, entry):
    """The guard that has changed sign by the end of the step, −1 if none: what a solver without event location sees."""
    first, count = w.leave_from[mode], w.leave_from[mode + 1] - w.leave_from[mode]
    chosen = -1
    for when in range(2 if entry == 1 else 1):
        guards(model, mode, w.f[T], w.poly[0] if when == 0 and entry == 1 else w.y_new, p, w.g)
        w.i[GUARDS] += 1
        for k in range(count):
            sign = 1 if w.g[k] > 0.0 else -1
            if entry == 1 and when == 0:
                w.side[k] = sign
            elif sign != w.side[k]:
                w.side[k] = sign
                if chosen < 0 and (sign > 0 or w.directed[w.leave[first + k]] == 0):
                    chosen = k
    return chosen


def advance(model, w, p, budget):
    """Go on for up to `budget` steps; returns PAUSE, GROW (an output array is full), or why the run ended."""
    i, f = w.i, w.f
    for _ in range(budget):
        if (
            i[LEDGER] + 2 > w.room[ROOM_LEDGER]
            or i[PIECES] + 1 > w.room[ROOM_PIECES]
            or room(w) < i[SAMPLES] - i[GRID]
        ):
            return GROW
        mode, t = i[MODE], f[T]
        n = w.size[mode]
        if i[LEDGER] >= i[MAX_EVENTS]:
            return EVENTS_OUT
        if i[STEPS] + i[REJECTED] >= i[MAX_STEPS]:
            return STEPS_OUT

        # Instants known beforehand
        least = 10.0 * EPS * max(abs(t), abs(f[T_END]) * 1e-3)
        due = next_due(w)
        if due - t <= least:
            # Two schedules that swap two modes at the same instants swap once each time: what counts is the mode on arrival
            if f[DUE_T] != t:
                f[DUE_T], i[ARRIVED] = t, mode
            transition = take_due(w, t + least)
            here = i[SLIDING] == 1 and transition >= 0 and w.source[transition][i[SLIDE_B]] == 1
            if transition >= 0 and (
                here or (w.source[transition][mode] == 1 and w.source[transition][i[ARRIVED]] == 1)
            ):
                status = fire(model, w, p, transition)
                if status != PAUSE:
                    return status
            continue
        if t >= f[T_END]:
            record(w, t, mode, n, w.y)
            return FINISHED

        # Guards that are already true and do not wait
        count = watch_count(w, mode)
        if i[ENTRY] == 1 and count > 0:
            watch(model, w, mode, n, t, w.y, p, w.g)
            i[GUARDS] += 1
            chosen = -1
            for k in range(2 * i[SLIDING], count):
                transition = watched(w, mode, k)
                if not isfinite(w.g[k]):
                    i[WHO] = transition
                    return GUARD_NAN
                if (
                    chosen < 0
                    and w.urgent[transition] == YES
                    and w.g[k] > 0.0
                    and w.hold[transition] == 0
                ):
                    chosen = transition
            if chosen >= 0:
                status = (
                    postpone(w, t, chosen)
                    if w.delay[i[LANE]][chosen] > 0.0
                    else fire(model, w, p, chosen)
                )
                if status != PAUSE:
                    return status
                continue

        # A step
        if i[FRESH] == 1 and i[ADAPTIVE] < 2:
            rates(model, w, mode, n, t, w.y, p, w.k[0])
            i[FLOWS] += 1
            if f[H] <= 0.0:
                f[H] = first_step(model, w, p, mode, n)
            i[FRESH] = 0
        limit = min(due, f[T_END])
        h = min(f[H], f[MAX_STEP])
        snapped = h >= limit - t - max(
            least, 1e-9 * h
        )  # a thousand steps of a thousandth are a thousand steps, not one more
        h = limit - t if snapped else (t + h) - t  # the length that the clock will show
        if i[ADAPTIVE] == 2:
            h = external_step(model, w, p, t, h)
            if h <= 0.0:
                return UNDERFLOW
            snapped = t + h >= limit - least
        else:
            error = explicit_step(model, w, p, mode, n, t, h)
            order = i[ORDER]
            if not error < 1.0:  # also when it is NaN
                i[REJECTED] += 1
                f[H] = h * (max(0.2, 0.9 * error ** (-1.0 / order)) if error < 1e290 else 0.1)
                i[FIRST] = 1
                if f[H] < least or i[ADAPTIVE] == 0:
                    return UNDERFLOW
                continue
            if i[ADAPTIVE] == 1:
                factor = 10.0 if error == 0.0 else min(10.0, 0.9 * error ** (-1.0 / order))
                if i[FIRST] == 1:
                    factor = min(1.0, factor)
                grown = h * max(0.2, factor)
                f[H] = (
                    max(f[H], grown) if snapped else grown
                )  # a step cut short says nothing against the long one
        i[FIRST] = 0
        i[STEPS] += 1
        end = limit if snapped else t + h

        theta, k = 2.0, -1
        wanted = (
            i[DENSE] == 1
            or (count > 0 and i[LOCATE] == 1)
            or (i[GRID] < i[SAMPLES] and w.grid[i[GRID]] < end)
        )
        if i[ADAPTIVE] < 2 and wanted:
            interpolate(model, w, p, mode, n, t, h)
            if i[TWO] == 1 and h > 1e3 * least:
                # On a stiff stretch DOP853's ends may be good and what lies between them wild, and samples and events lie between
                miss = defect(model, w, p, mode, n, t, h, 0.8)
                factor = (
                    min(10.0, max(0.2, 0.9 * (MOST_DEFECT / miss) ** 0.125))
                    if 0.0 < miss < 1e290
                    else 10.0
                    if miss == 0.0
                    else 0.2
                )
                if not miss <= MOST_DEFECT:
                    i[STEPS] -= 1
                    i[REJECTED] += 1
                    i[FIRST] = 1
                    f[H] = factor * h
                    continue
                if not snapped:
                    f[H] = min(f[H], factor * h)
        if i[LOCATE] == 1:
            theta, k = find_event(model, w, p, mode, n, t, h, i[ENTRY])
            if count > 0 and i[DENSE] == 1 and i[SLIDING] == 0 and theta >= 0.0:
                note_touches(model, w, p, mode, n, t, h, min(theta, 1.0))
        elif count > 0:
            for q in range(n):
                w.poly[0][q] = w.y[q]
            f[T] = end
            k = unlocated_event(model, w, p, mode, n, i[ENTRY])
            f[T] = t
            theta = 1.0 if k >= 0 else 2.0
        if theta == -2.0:  # not a number: the step may have gone too far
            i[STEPS] -= 1
            i[REJECTED] += 1
            f[H] = 0.25 * h
            i[FRESH] = 1
            i[WHO] = max(watched(w, mode, k), 0)
            if f[H] < least or i[ADAPTIVE] != 1:
                return GUARD_NAN
            continue
        if k >= 0 and theta < 0.0:  # it rests on its surface: a reset has not taken it off
            transition = watched(w, mode, k)
            i[WHO] = transition
            if w.zeno[transition] < 0:
                return CONTACT
            for q in range(n):
                w.y_new[q] = w.y[q]
            come_to_rest(w, t, transition, n)
            continue
        if k >= 0 and theta < 1.0:
            if theta > 0.0 and i[ADAPTIVE] == 1:
                h, theta = retake(model, w, p, mode, n, t, h, theta, k, limit)
            end = t + theta * h
            evaluate(w, n, theta, w.y_new)
            i[FRESH] = 1
        if end > t:
            if wanted:
                keep_piece(w, t, h, mode, n)
            for q in range(n):
                w.y[q] = w.y_new[q]
            f[T] = end
            i[ENTRY] = 0
            if i[SLIDING] == 1:
                back_to_surface(model, w, p, n, end, w.y)
            if wanted or (i[GRID] < i[SAMPLES] and w.grid[i[GRID]] <= end):
                sample(w, t, h, end, mode, n)
        if k < 0:
            if i[ADAPTIVE] == 1 or i[ADAPTIVE] == 0:
                last = w.k[i[STAGES]]
                for q in range(n):
                    w.k[0][q] = last[q]
            continue
        transition = watched(w, mode, k)
        if transition < 0:
            status = slide(w, end, n, SLIDE, i[SLIDE_A] if transition == -1 else i[SLIDE_B])
        elif end == t and begin_sliding(model, w, p, n, transition, k) == 1:
            status = slide(w, end, n, i[SLIDE_B], SLIDE)
        elif w.delay[i[LANE]][transition] > 0.0:
            status = postpone(w, end, transition)
        else:
            status = fire(model, w, p, transition)
        if status != PAUSE:
            return status
    return PAUSE
