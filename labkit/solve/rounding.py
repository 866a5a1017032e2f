"""How well guards are known, and how they change: their roundings and their slopes.

A guard is known as well as its terms are, a state as well as what it was made of; all else is not
resolved. Along the flow, or with constant rates, guards change by what `look` and `straight` say.

    gauge     the size of a guard's terms; grain: what they do not show
    doubt     below which size a guard counts as zero
"""

from math import isfinite

from .layout import *
from .sliding import rates, watch, watch_count, watched

SHAKE = 1.4551915228366852e-11  # 2⁻³⁶: guards may bend nearby, and 1e6 s are a long time
DOUBT = 64.0  # roundings: what a guard's terms are off by after some steps
TICKS = 32.0  # the same of the clock
CLEAR = 16.0  # a guard is clear of zero at so many times its doubt; what moves less is not resolved


def know_flow(model, w, p):
    """The flow at the current time and state is in w.k[0]."""
    if w.i[KNOWN] == 0:
        mode = w.i[MODE]
        rates(model, w, mode, w.size[mode], w.f[T], w.y, p, w.k[0])
        w.i[FLOWS] += 1
        w.i[KNOWN] = 1


def known_as(w, y, i):
    """The size whose rounding a state has: its own, or of what a reset has made it of."""
    return abs(y[i]) if w.i[MADE] == 0 else max(abs(y[i]), w.made[i])


def gauge(model, w, p, mode, n, t, y, k, value, wide):
    """Σ|∂g/∂yᵢ·yᵢ| + |∂g/∂t·t| of the k-th guard, whose value is given; wide: with each state's
    largest size so far.

    Times ε it is the guard's rounding; times rtol, and wide, what the tolerance lets it be wrong
    by.
    """
    total = 0.0
    for i in range(n):
        w.y_shake[i] = y[i]
    held = w.i[HELD] if wide == 0 else 0  # they are exact, but terms like others
    for place in range(n + held):
        i = place if place < n else w.i[WIDTH] + place - n
        size = w.most[i] if wide == 1 else known_as(w, y, i)
        if size > 0.0:
            w.y_shake[i] = y[i] + SHAKE * size
            watch(model, w, mode, n, t, w.y_shake, p, w.g_look)
            w.i[GUARDS] += 1
            w.y_shake[i] = y[i]
            if isfinite(w.g_look[k]):
                total += abs(w.g_look[k] - value) / SHAKE
    if t != 0.0 and wide == 0:
        watch(model, w, mode, n, t * (1.0 + SHAKE), w.y_shake, p, w.g_look)
        w.i[GUARDS] += 1
        if isfinite(w.g_look[k]):
            total += abs(w.g_look[k] - value) / SHAKE
    return total


def grain(model, w, p, mode, n, t, y, k):
    """The rounding of the k-th guard's constants, which its terms do not show: hypot(x, y + R) − R
    is known as well as R.

    Fourth differences over steps far too short for the guard itself to bend (Hamming's difference
    table, as in Moré and Wild 2011, ECnoise); the largest of the first four times near zero.
    """
    slot = watched(w, mode, k) + 2
    if w.grains[slot] >= 4:
        return w.grain[slot]
    w.grains[slot] += 1
    e = max(1e-9 * w.f[H], 64.0 * EPS * abs(t))
    value = w.value
    for j in range(5):
        for i in range(n):
            w.y_shake[i] = y[i] + j * e * w.k[0][i]
        watch(model, w, mode, n, t + j * e, w.y_shake, p, w.g_look)
        value[j] = w.g_look[k]
    w.i[GUARDS] += 5
    noise = abs(value[0] - 4.0 * value[1] + 6.0 * value[2] - 4.0 * value[3] + value[4]) / 8.0
    most = w.swing[slot] * (t - w.f[BEFORE])
    if most == 0.0 and noise > 0.0:  # nothing has been simulated yet
        look(model, w, p, mode, n, t, w.f[H], 2, w.g_look)
        most = abs(w.g_look[k] - value[0])
    if noise <= 1e-3 * most:  # else the guard bends even within this: y/(|y| + 1e-9) near zero
        w.grain[slot] = max(w.grain[slot], noise)
    return w.grain[slot]


def doubt(model, w, p, mode, n, t, y, k, value):
    """Below which size the k-th guard counts as zero at (t, y): DOUBT times its own rounding.

    Its terms are worked out anew near zero, or where a state has more than doubled.
    """
    slot = watched(w, mode, k) + 2
    known = w.scale[slot] > 0.0 and abs(t) <= 2.0 * w.scale_y[slot][w.i[WIDTH]]
    for i in range(n):
        if abs(y[i]) > 2.0 * w.scale_y[slot][i]:
            known = False
    if not known or abs(value) <= 4.0 * (DOUBT * EPS * w.scale[slot] + CLEAR * w.grain[slot]):
        w.scale[slot] = gauge(model, w, p, mode, n, t, y, k, value, 0)
        for i in range(n):
            w.scale_y[slot][i] = known_as(w, y, i)
        w.scale_y[slot][w.i[WIDTH]] = abs(t)
    rounding = DOUBT * EPS * w.scale[slot] + CLEAR * w.grain[slot]
    if w.i[SLIDING] == 1 and k < 2:  # a slope, by differences over PROBE
        surface = w.leave[w.leave_from[w.i[SLIDE_A]] + w.i[GUARD_A]]
        rounding += DOUBT * EPS * w.scale[surface + 2] / w.f[PROBE]
    return rounding


def look(model, w, p, mode, n, t, e, order, out):
    """Guards at t + e into `out`, after one step e along the flow.

    Heun's (order 2) or the classical one (4).
    """
    one, two, three, four = w.k[0], w.ahead[1], w.ahead[2], w.ahead[3]
    y, look = w.y, w.y_look
    part = e if order == 2 else 0.5 * e
    for i in range(n):
        look[i] = y[i] + part * one[i]
    rates(model, w, mode, n, t + part, look, p, two)
    if order == 2:
        for i in range(n):
            look[i] = y[i] + 0.5 * e * (one[i] + two[i])
    else:
        for i in range(n):
            look[i] = y[i] + 0.5 * e * two[i]
        rates(model, w, mode, n, t + 0.5 * e, look, p, three)
        for i in range(n):
            look[i] = y[i] + e * three[i]
        rates(model, w, mode, n, t + e, look, p, four)
        for i in range(n):
            look[i] = y[i] + e / 6.0 * (one[i] + 2.0 * (two[i] + three[i]) + four[i])
    w.i[FLOWS] += order - 1
    watch(model, w, mode, n, t + e, look, p, out)
    w.i[GUARDS] += 1


def straight(model, w, p, mode, n, t, y, rate, e, out):
    """By how much all guards change in a time e with a constant rate: central differences, so that
    no guard's own curve counts.

    One that is not defined before t is taken from t on.
    """
    for i in range(n):
        w.y_look[i] = y[i] - e * rate[i]
    watch(model, w, mode, n, t - e, w.y_look, p, w.g_look)
    for i in range(n):
        w.y_look[i] = y[i] + e * rate[i]
    watch(model, w, mode, n, t + e, w.y_look, p, out)
    w.i[GUARDS] += 2
    for k in range(watch_count(w, mode)):
        if isfinite(w.g_look[k]):
            out[k] = 0.5 * (out[k] - w.g_look[k])
        else:
            out[k] -= w.g[k]


def nearby(w, t):
    """How far slopes are looked for.

    A small part of a step, and a difference that the clock shows exactly.
    """
    e = max(1e-6 * w.f[H], 1e3 * EPS * max(abs(t), abs(w.f[BEFORE])))
    return (t + e) - t if abs(t) < 1e300 * e else e


def soonest(w, t):
    """After what time the clock can tell anything."""
    tick = max(abs(t), abs(w.f[BEFORE])) * EPS
    return 64.0 * tick if tick > 0.0 else 1e-13 * w.f[H]


def slope_ahead(model, w, p, mode, n, t, k):
    """dg/dt of the k-th guard along the flow; all guards are worked out at once."""
    e = nearby(w, t)
    if w.i[AHEAD] == 0:
        know_flow(model, w, p)
        straight(model, w, p, mode, n, t, w.y, w.k[0], e, w.g_ahead)
        w.i[AHEAD] = 1
    return w.g_ahead[k] / e


def slopes(model, w, p, mode, n, t, k):
    """Σ|∂g/∂yᵢ·yᵢ'| of the k-th guard, by the larger of the rates here and those by which it came.

    Each state is off by ticks of its own, from instants before, also where the guard does not
    change along the flow.
    """
    total, e = 0.0, nearby(w, t)
    for i in range(n):
        w.y_shake[i] = w.y[i]
    for i in range(n):
        rate = max(abs(w.k[0][i]), abs(w.speed[i]))
        if rate > 0.0:
            w.y_shake[i] = w.y[i] + e * rate
            watch(model, w, mode, n, t, w.y_shake, p, w.g_look)
            w.i[GUARDS] += 1
            w.y_shake[i] = w.y[i]
            if isfinite(w.g_look[k]):
                total += abs(w.g_look[k] - w.g[k]) / e
    return total


def steepest(model, w, p, n, slot):
    """A bound of a guard's |dg/dt|, from here on and before, without asking it: its terms change
    as fast as their states, sixteen times at most.
    """
    know_flow(model, w, p)
    then = w.scale_y[slot]
    if then[w.i[WIDTH]] == 0.0:
        return 1e300
    fastest = 1.0 / then[w.i[WIDTH]]
    for i in range(n):
        rate = max(abs(w.k[0][i]), abs(w.speed[i]))
        if rate > fastest * then[i]:
            if then[i] == 0.0:
                return 1e300
            fastest = rate / then[i]
    return 16.0 * w.scale[slot] * fastest


def drift(model, w, p, mode, n, t, y, k, e, least):
    """By how much a guard changes with the rates in w.ahead[1] in a time e; in a longer one if that
    is not more than `least`; 0 if it cannot be told.
    """
    while True:
        straight(model, w, p, mode, n, t, y, w.ahead[1], e, w.g_away)
        if abs(w.g_away[k]) > least:
            return w.g_away[k]
        e *= 8.0
        if not e <= 0.1 * w.f[H]:
            return 0.0
