"""The integrator: steps, one after the other, from instant to instant.

One source for both back ends. As it stands here it runs in plain Python on lists; backend.py loads
it a second time with the same functions compiled by Numba on arrays. So: scalar loops only, no
NumPy, nothing but indexing, and `w`, the workspace (fields in `workspace`), holds everything that
must survive a pause.
"""

from .instant import *
from .layout import *
from .locate import find_event, guard_at, note_touches, refine
from .sides import *
from .sliding import back_to_surface, rates, watch_count, watched
from .step import *


def sample(model, w, p, t, h, end, mode, n):
    """Samples of the grid within (t, end], from the step's polynomial; the end's own from w.y."""
    place = w.i[GRID]
    while place < w.i[SAMPLES] and w.grid[place] < end:
        if w.grid[place] > t:
            evaluate(w, n, (w.grid[place] - t) / h, w.y_try)
            append(model, w, p, w.grid[place], mode, n, w.y_try)
        place += 1
    if place < w.i[SAMPLES] and w.grid[place] == end:
        record(model, w, p, end, mode, n, w.y)
        place += 1
    w.i[GRID] = place


def defect(model, w, p, mode, n, t, h, theta):
    """By how much the step's polynomial misses the differential equation at θ, times h, over the
    tolerance.
    """
    evaluate(w, n, theta, w.y_try)
    rates(model, w, mode, n, t + theta * h, w.y_try, p, w.err[0])
    w.i[FLOWS] += 1
    largest, poly, flow_there, degree = 0.0, w.poly, w.err[0], w.i[DEGREE]
    for q in range(n):
        slope = 0.0
        for d in range(degree, 0, -1):
            slope = slope * theta + d * poly[d][q]
        miss = abs(slope - h * flow_there[q])
        if miss > 0.0:
            size = max(abs(w.y[q]), abs(w.y_try[q]), abs(w.y_new[q]))
            largest = max(largest, miss / allowed(w, mode, q, size, h))
    return largest


def retake(model, w, p, mode, n, t, h, theta, k, limit):
    """Take the step anew, as long as the event needs: (h, θ) of the event on the new step, or the
    old ones where that is not clear.

    Between its ends a step is known by an interpolant of lower order than the method's. So an event
    in its middle is less accurate than the tolerance promises, and the state that starts the next
    mode with it. The new step ends near the event.
    """
    if watched(w, mode, k) < 0 or w.i[SLIDING] == 1:
        return h, theta
    short = theta * h
    if defect(model, w, p, mode, n, t, h, theta) < 1e-3:
        return h, theta
    for q in range(n):  # for the way back
        for d in range(w.i[DEGREE] + 1):
            w.kept[d][q] = w.poly[d][q]
    far = 1.0 if w.turn[k] > 0 else -1.0
    better = 2.0
    if explicit_step(model, w, p, mode, n, t, short) < 1.0:
        interpolate(model, w, p, mode, n, t, short)
        value = guard_at(model, w, p, mode, n, t, short, 1.0, k)
        slope = (value - guard_at(model, w, p, mode, n, t, short, 0.999, k)) / 0.001
        off = abs(value / slope) if slope != 0.0 else 1.0
        if off < 0.02:
            reach = 2.0 * off + 1e-13
            one = guard_at(model, w, p, mode, n, t, short, 1.0 - reach, k)
            two = guard_at(model, w, p, mode, n, t, short, 1.0 + reach, k)
            if one * far < 0.0 and two * far > 0.0:
                better = refine(
                    model, w, p, mode, n, t, short, k, 1.0 - reach, one, 1.0 + reach, two
                )
    if better < 1.5 and t + better * short <= limit:
        guard_at(model, w, p, mode, n, t, short, better, k)
        for q in range(watch_count(w, mode)):  # no other guard may have passed in between
            slot = watched(w, mode, q) + 2
            if w.turn[q] * w.g[q] < 0.0 and w.came[slot] == 0 and w.flat[slot] == 0:
                better = 2.0
        if better < 1.5:
            return short, better
    for q in range(n):
        for d in range(w.i[DEGREE] + 1):
            w.poly[d][q] = w.kept[d][q]
    return h, theta


def speeds(w, n, theta, h):
    """The rates at the end of a step, or at the event in it, into w.speed: the flow, where it is
    known there, or by the step's polynomial.
    """
    degree = w.i[DEGREE]
    for q in range(n):
        if w.i[KNOWN] == 1:
            w.speed[q] = w.k[0][q]
        else:
            slope = 0.0
            for d in range(degree, 0, -1):
                slope = slope * theta + d * w.poly[d][q]
            w.speed[q] = slope / h


def refused(w, h, factor):
    """A step is not good enough: the next try is shorter."""
    w.i[REJECTED] += 1
    w.i[FIRST] = 1
    w.f[H] = factor * h


def accepted(w, mode, n, t, h):
    """… and one that is. One far shorter than those before it may have found a jump in the flow."""
    i, f = w.i, w.f
    recent = 0.0 if i[ENTRY] == 1 or i[ADAPTIVE] == 0 else f[RECENT]
    if h < 1e-3 * recent and jumps_within(w, mode, n, i[STAGES], recent) == 1:
        if i[JUMPS] == 0:
            f[JUMP_T] = t + h
        i[JUMPS] += 1
        recent = 0.0  # once each
    f[RECENT] = max(h, 0.9 * recent)
    i[FIRST] = 0
    i[STEPS] += 1


def jumps_within(w, mode, n, stages, recent):
    """Does a rate have two values in this step and none between (1), so far apart that a step as
    long as those before could not have been accepted?
    """
    k = w.k
    for q in range(n):
        first, change = k[0][q], k[stages][q] - k[0][q]
        if abs(change) * recent > 100.0 * allowed(w, mode, q, abs(w.y[q]), 0.0):
            between = 0
            for stage in range(1, stages):
                part = (k[stage][q] - first) / change
                if abs(part) > 0.05 and abs(part - 1.0) > 0.05:
                    between = 1
            if between == 0:
                return 1
    return 0


def jumps_here(w, n):
    """Does a rate change by half in a step that hardly moves its state (1)?"""
    i, f = w.i, w.f
    for q in range(n):
        change, largest = 0.0, 0.0
        for stage in range(i[STAGES] + 1):
            change = max(change, abs(w.k[stage][q] - w.k[0][q]))
            largest = max(largest, abs(w.k[stage][q]))
        if change > 0.5 * largest and f[H] * largest < 1e-4 * w.most[q]:
            if i[JUMPS] == 0:
                f[JUMP_T] = f[T]
            i[JUMPS] += 1
            return 1
    return 0


def given_up(w):
    """Why there are no more steps: the flow is stiff, it jumps, or neither is known."""
    i = w.i
    if i[ADAPTIVE] == 1 and 8 * i[STIFFS] > i[STEPS]:  # asked for in one of four steps
        return STIFF
    if i[ADAPTIVE] == 1 and (jumps_here(w, w.size[i[MODE]]) == 1 or i[JUMPS] > 0):
        return HIDDEN_JUMP
    return STEPS_OUT


def no_further(model, w, p, status):
    """No step is short enough: an instant, where the flow ends on a surface; else why it ends."""
    if w.i[LOCATE] == 1 and at_edge(model, w, p) == 1:
        speeds(w, w.size[w.i[MODE]], 1.0, 1.0)  # the flow is known: at_edge has asked for it
        return arrive(model, w, p)
    return status


def advance(model, w, p, budget):
    """Go on for up to `budget` steps.

    Returns PAUSE, GROW (an output array is full), or why the run ended.
    """
    i, f = w.i, w.f
    for _ in range(budget):
        full = i[LEDGER] + 2 > w.room[ROOM_LEDGER] or i[PIECES] + 2 > w.room[ROOM_PIECES]
        if full or room(w) < i[SAMPLES] - i[GRID]:
            return GROW
        mode, t = i[MODE], f[T]
        n = w.size[mode]
        if i[LEDGER] >= i[MAX_EVENTS]:
            return EVENTS_OUT
        if i[STEPS] + i[REJECTED] >= i[MAX_STEPS]:
            return given_up(w)
        if i[BUSY] == 1:
            transition = choose(w)
            if transition > -9:
                status = happen(model, w, p, transition)
                if status != PAUSE:
                    return status
            else:
                forget(w)
            continue
        if t >= f[T_END]:
            record(model, w, p, t, mode, n, w.y)
            return FINISHED

        # A step
        count = watch_count(w, mode)
        due = next_due(w)
        least = 8.0 * EPS * abs(t)
        if i[ADAPTIVE] < 2:
            know_flow(model, w, p)
            if i[ADAPTIVE] == 1 and i[OWN_SIZE] == 1:
                feel(model, w, p, mode, n, t)
        limit = min(due, f[T_END])
        h = min(f[H], f[MAX_STEP], f[CAP])
        # a thousand steps of a thousandth are a thousand steps, not one more
        snapped = h >= limit - t - max(least, 1e-9 * h)
        h = limit - t if snapped else (t + h) - t  # the length that the clock will show
        if i[ADAPTIVE] == 2:
            h = external_step(model, w, p, t, h)
        if h <= 0.0:
            status = no_further(model, w, p, UNDERFLOW)
            if status != PAUSE:
                return status
            continue
        if i[ADAPTIVE] == 2:
            snapped = t + h >= limit - least
            f[H] = max(f[H], h) if snapped else h
            i[KNOWN] = 0
        else:
            error = explicit_step(model, w, p, mode, n, t, h)
            order = i[ORDER]
            if not error < 1.0:  # also when it is NaN
                if i[ADAPTIVE] == 0:
                    return UNDERFLOW
                shrink = max(0.2, 0.9 * error ** (-1.0 / order)) if error < 1e290 else 0.1
                refused(w, h, shrink)
                if f[H] < least or f[H] < 1e-290:
                    jump = jumps_here(w, n) == 1 and error < 1e290
                    status = no_further(model, w, p, HIDDEN_JUMP if jump else UNDERFLOW)
                    if status != PAUSE:
                        return status
                continue
            if i[ADAPTIVE] == 1:
                factor = 10.0 if error == 0.0 else min(10.0, 0.9 * error ** (-1.0 / order))
                if i[FIRST] == 1:
                    factor = min(1.0, factor)
                longer = h * max(0.2, factor)
                # a step cut short says nothing against the long one
                f[H] = max(f[H], longer) if snapped else longer
                if f[LAMBDA] > (6.1 if i[TWO] == 1 else 3.25):
                    i[STIFFS] += 1
        end = limit if snapped else t + h

        theta, k = 2.0, -1
        wanted = i[DENSE] == 1 or (count > 0 and i[LOCATE] == 1)
        wanted = wanted or (i[GRID] < i[SAMPLES] and w.grid[i[GRID]] < end)
        if i[ADAPTIVE] < 2 and wanted:
            interpolate(model, w, p, mode, n, t, h)
            if i[TWO] == 1 and h > 1e3 * least:
                # On a stiff stretch DOP853's ends may be good and what lies between them wild, and
                # samples and events lie between
                miss = defect(model, w, p, mode, n, t, h, 0.8)
                factor = 10.0 if miss == 0.0 else 0.2
                if 0.0 < miss < 1e290:
                    factor = min(10.0, max(0.2, 0.9 * (MOST_DEFECT / miss) ** 0.125))
                if not miss <= MOST_DEFECT:
                    refused(w, h, factor)
                    continue
                if not snapped:
                    f[H] = min(f[H], factor * h)
        if i[LOCATE] == 1 and count > 0:
            theta, k = find_event(model, w, p, mode, n, t, h, i[ENTRY], snapped)
            if i[DENSE] == 1 and i[SLIDING] == 0 and theta >= 0.0:
                note_touches(model, w, p, mode, n, t, h, min(theta, 1.0))
        if theta == -3.0:  # a guard does too much in it
            f[CAP] = 0.1 * h
            refused(w, h, 0.1)
            continue
        if theta == -2.0:  # not a number: the step may have gone too far
            refused(w, h, 0.25)
            i[FRESH], i[KNOWN] = 1, 0
            i[WHO] = max(watched(w, mode, k), 0)
            if f[H] < least or f[H] < 1e-290 or i[ADAPTIVE] != 1:
                status = no_further(model, w, p, GUARD_NAN)
                if status != PAUSE:
                    return status
            continue
        accepted(w, mode, n, t, h)
        if k >= 0:
            if 0.0 < theta < 1.0 and i[ADAPTIVE] == 1:
                h, theta = retake(model, w, p, mode, n, t, h, theta, k, limit)
            end = t + theta * h
            if end >= limit - least:
                end = limit
            evaluate(w, n, theta, w.y_new)
            i[FRESH], i[KNOWN] = 1, 0
        if end > t:
            if wanted:
                keep_piece(w, t, h, mode, n)
            for q in range(n):
                if w.y[q] != w.y_new[q]:
                    w.y[q], w.made[q] = w.y_new[q], 0.0
            if i[ADAPTIVE] == 0:
                for q in range(n):
                    w.lost[q] = w.err[0][q] if k < 0 else 0.0
            f[T], f[BEFORE] = end, t
            i[ENTRY] = 0
            if i[SLIDING] == 1:
                back_to_surface(model, w, p, i[SLIDE_A], i[GUARD_A], n, end, w.y)
            grown(w, mode, n)
            if wanted or (i[GRID] < i[SAMPLES] and w.grid[i[GRID]] <= end):
                sample(model, w, p, t, h, end, mode, n)
        if k < 0 and i[ADAPTIVE] < 2:
            last = w.k[i[STAGES]]
            for q in range(n):
                w.k[0][q] = last[q]
        if k >= 0 or end >= limit - least or i[LOCATE] == 0:
            speeds(w, n, min(theta, 1.0), h)
            status = arrive(model, w, p)
            if status != PAUSE:
                return status
    return PAUSE
