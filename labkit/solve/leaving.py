"""How a guard that is zero leaves zero along the flow.

By its slope or, if that says nothing, by following the flow until it is clear of zero. A guard that
jumps has no slope and no size there: only its sign says something, where that does not hang on
rounding.
"""

from math import isfinite

from .layout import *
from .rounding import *
from .sliding import kept_state, watch


def leaving(model, w, p, mode, n, t, k, value, band):
    """How the k-th guard leaves zero along the flow: ±1 by its slope, ±2 later, 0 never.

    Where ±2, w.f[LATER] is when it is clear of zero, and w.f[GONE] how far it was w.f[GONE_T] from
    now.
    """
    slope = slope_ahead(model, w, p, mode, n, t, k)
    first = soonest(w, t)
    if slope != 0.0 and isfinite(slope):
        e = max(first, 2.0 * CLEAR * band / abs(slope))
        if e <= 0.1 * w.f[H]:
            look(model, w, p, mode, n, t, e, 2, w.g_look)
            gone, by_slope = w.g_look[k], slope * e
            if abs(w.g_ahead[k]) < band:  # the slope may be rounding
                straight(model, w, p, mode, n, t, w.y, w.k[0], e, w.g_away)
                by_slope = w.g_away[k]
            near = 0.25 * abs(by_slope) < abs(gone) < 4.0 * abs(by_slope)
            if near and (gone > 0.0) == (by_slope > 0.0) and abs(gone) > 0.25 * CLEAR * band:
                w.f[LATER], w.f[GONE_T] = t, e
                return 1 if gone > 0.0 else -1
    # The slope says nothing, or what it says is over before it can be told from rounding
    found, e = 0, first
    tolerated = -1.0
    while e <= 64.0 * w.f[H]:
        look(model, w, p, mode, n, t, e, 4, w.g_look)
        gone = w.g_look[k]
        if not isfinite(gone):
            break
        clear = abs(gone) > CLEAR * band
        if clear and found == 0:  # it is known there only as well as the states are there
            away = gauge(model, w, p, mode, n, t + e, w.y_look, k, gone, 0)
            clear = abs(gone) > CLEAR * DOUBT * EPS * away
        if clear:
            if found == 0:
                found = 2 if gone > 0.0 else -2
                w.f[GONE], w.f[GONE_T] = abs(gone), e
                straight(model, w, p, mode, n, t, w.y, w.k[0], e, w.g_away)
                by_slope = w.g_away[k]
                if (by_slope > 0.0) == (gone > 0.0) and abs(by_slope) > 0.25 * abs(gone):
                    w.f[LATER] = t
                    return 1 if gone > 0.0 else -1  # by its slope after all
            if (gone > 0.0) != (found > 0):
                if tolerated > 0.0 and w.f[GONE] > 1e-9 * tolerated:
                    break
                found = -found  # that was the flow's own rounding, on leaving a mode of rest
                w.f[GONE], w.f[GONE_T] = abs(gone), e
            w.f[LATER] = t + e
            if tolerated < 0.0:
                tolerated = 0.01 * w.f[RTOL] * gauge(model, w, p, mode, n, t, w.y, k, value, 1)
            # A guard whose states have never moved has no size yet
            if abs(gone) > tolerated and (tolerated > 0.0 or e > 1e-4 * w.f[H]):
                break
        e *= 2.0 if found == 0 else 8.0
    return found


def shaken(model, w, p, mode, n, t, y, k, times=1.0):
    """By how much the k-th guard changes where a state, or the clock, is off by its own rounding,
    or so many times that; 0 if its sign does not depend on that.
    """
    most = 0.0
    for i in range(n):
        w.y_shake[i] = y[i]
    for i in range(n + 1):
        off, tick = 0.0, times * DOUBT * EPS * abs(t)
        if i < n:
            off, tick = times * max(DOUBT * EPS * known_as(w, y, i), 1e-300), 0.0
            w.y_shake[i] = y[i] + off
        watch(model, w, mode, n, t + tick, w.y_shake, p, w.g_away)
        if i < n:
            w.y_shake[i] = y[i] - off
        watch(model, w, mode, n, t - tick, w.y_shake, p, w.g_look)
        if i < n:
            w.y_shake[i] = y[i]
        if (w.g_away[k] > 0.0) != (w.g_look[k] > 0.0):
            most = max(most, abs(w.g_away[k] - w.g_look[k]))
    w.i[GUARDS] += 2 * n + 2
    return most


def leaps(model, w, p, mode, n, t, k, swing, last):
    """Does a guard jump here (1), or is it steeper than the clock and the states are fine? Then its
    values say nothing, only their signs do. Else −1.

    swing: its largest slope for a while, `last`.
    """
    if w.i[SLIDING] == 1:
        return -1
    know_flow(model, w, p)
    rounding = DOUBT * EPS * gauge(model, w, p, mode, n, t, w.y, k, w.g[k], 0)
    e, least = soonest(w, t), max(2e-8 * swing * last, 4.0 * rounding)
    straight(model, w, p, mode, n, t, w.y, w.k[0], e, w.g_away)
    near = abs(w.g_away[k])
    if near > least:
        straight(model, w, p, mode, n, t, w.y, w.k[0], 16.0 * e, w.g_away)
        if near > 0.125 * abs(w.g_away[k]):  # a slope goes 16 times as far
            return 1
    near = shaken(model, w, p, mode, n, t, w.y, k)
    if near > least and near > 0.125 * shaken(model, w, p, mode, n, t, w.y, k, 16.0):
        return 1
    return -1


def at_leap(model, w, p, mode, n, t, k, slot):
    """Is the k-th guard at its jump still (1), after an event? Then the reset has left it as it was
    located, or the rounding of a state, or the flow by which it came, goes through it.
    """
    if shaken(model, w, p, mode, n, t, w.y, k) > 0.0:
        return 1
    line, came = w.ledger[w.i[LEDGER] - 1], w.i[BY_FLOW]
    if came < 0 or w.family[came] != w.family[mode] or line[3] < 0 or w.size[int(line[3])] != n:
        return 0
    for i in range(n):
        w.y_shake[i] = line[5 + i]
    watch(model, w, mode, n, t, w.y_shake, p, w.g_look)
    w.i[GUARDS] += 1
    if w.came[slot] == 2 and w.g_look[k] == w.g[k] and kept_state(w, n) == 1:
        return 1
    flow(model, came, t, w.y_shake, p, w.ahead[1])
    w.i[FLOWS] += 1
    straight(model, w, p, mode, n, t, w.y, w.ahead[1], 16.0 * soonest(w, t), w.g_away)
    back, half = w.g_look[k], w.g_away[k]
    return 1 if (back > 0.0) != (back + 2.0 * half > 0.0) else 0


def after_leap(model, w, p, mode, n, t, k):
    """How a guard that is at its jump leaves it along the flow, ±2: by its sign as soon as that
    does not depend on rounding (w.f[LATER], in a time w.f[GONE_T]); 0 if it always does.
    """
    know_flow(model, w, p)
    e = soonest(w, t)
    found, far = 0, 4096.0 * e  # it may have been located so late that it has to come back first
    while e <= 64.0 * w.f[H] and (found == 0 or e <= far):
        look(model, w, p, mode, n, t, e, 2, w.g_look)
        back = w.g_look[k] <= 0.0
        if (found == 0 or back) and shaken(model, w, p, mode, n, t + e, w.y_look, k) == 0.0:
            w.f[LATER], w.f[GONE_T] = t + e, e
            if back:
                return -2
            found = 2
        e *= 2.0
    return found
