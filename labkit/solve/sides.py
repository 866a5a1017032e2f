"""The side of each guard, − or +, where it is not plain from the guard's value: what an event
means.

Between events every guard has a side. At an instant (an event, a schedule, the start, the end) it
is the sign of the guard's value; where that is zero to its own rounding, the sign with which the
guard leaves zero along the flow. `sides` works that out before and after each jump, and a guard
whose side has changed waits for its transition to act (w.wait). Its slot is its transition's number
+ 2.

    doubt     how well a guard is known: its own rounding, from its own terms
    leaving   to which side a guard that is zero leaves, by the slope or, if that says nothing, by
              following the flow until it is clear of zero
    sides     all guards of the mode: side, and who waits
"""

from math import isfinite

from .layout import *
from .sliding import guard_place, kept_state, rates, watch, watch_count, watched

SHAKE = 1.4551915228366852e-11  # 2⁻³⁶: guards may bend nearby, and 1e6 s are a long time
DOUBT = 64.0  # roundings: what a guard's terms are off by after some steps
TICKS = 32.0  # the same of the clock
STEEP = 1024.0  # a guard that is so many times off where it was located is as good as a jump
STRAY = 100.0  # tolerances: what a state may be off by after many steps
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


def slope_behind(model, w, p, mode, n, t, k):
    """|dg/dt| of the k-th guard with the rates by which the flow came."""
    e = nearby(w, t)
    straight(model, w, p, mode, n, t, w.y, w.speed, e, w.g_away)
    return abs(w.g_away[k]) / e


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


def side_of(model, w, p, how, k, tick):
    """(side, order, clear, band) of the k-th guard, whose value is in w.g: the side, ±1; how it
    leaves zero (`leaving`, `after_leap`; 1 where it is not zero); whether its value says the side;
    the size below which it does not.

    tick: how fine the clock is.
    """
    i, f = w.i, w.f
    mode, t = i[MODE], f[T]
    n, q = w.size[mode], watched(w, mode, k)
    slot = q + 2
    value, was, directed = w.g[k], w.side[slot], q < 0 or w.directed[q] == 1
    jumped = w.leap[slot] == 1 and (w.came[slot] > 0 or how == ENTERED) and how != ARRIVE
    if how == START and shaken(model, w, p, mode, n, t, w.y, k) > 0.0:
        know_flow(model, w, p)
        swing = 0.0
        for half in range(1, 3):
            look(model, w, p, mode, n, t, 0.5 * half * f[H], 2, w.g_look)
            swing = max(swing, abs(w.g_look[k] - value) / f[H])
        w.leap[slot] = leaps(model, w, p, mode, n, t, k, swing, f[H])
        jumped = w.leap[slot] == 1
    own = 0.0
    if not jumped:
        own = doubt(model, w, p, mode, n, t, w.y, k, value)
    if not jumped and abs(value) <= 4.0 * own and w.grains[slot] < 4 and i[SLIDING] == 0:
        know_flow(model, w, p)
        own += CLEAR * grain(model, w, p, mode, n, t, w.y, k)
    band = own + 2.0 * w.slack[slot]
    clear = abs(value) > band
    if jumped:
        clear = how != START and at_leap(model, w, p, mode, n, t, k, slot) == 0
    elif clear and i[LOCATE] == 1:
        # On the surface within the rounding of the clock: its crossing belongs to this instant
        # (a bound of its slope first: that costs little)
        steep = w.swing[slot]
        if how == ENTERED or how == START or steep == 0.0:
            steep = steepest(model, w, p, n, slot)
        reach = tick * steep
        if abs(value) <= reach:
            reach = tick * abs(slope_ahead(model, w, p, mode, n, t, k))
            if abs(value) > reach and how != ARRIVE:  # the clock that it came by
                reach = tick * slope_behind(model, w, p, mode, n, t, k)
        if how == START and tick > 0.0:  # where its slope is zero, too
            know_flow(model, w, p)
            look(model, w, p, mode, n, t, tick, 2, w.g_look)
            reach = max(reach, abs(w.g_look[k] - value))
        if abs(value) <= reach:
            clear = False
            w.slack[slot] = abs(value)
            band += 2.0 * abs(value)
    beyond = clear and directed and q >= 0 and how == ENTERED and value > 0.0
    if beyond and sent_back(model, w, p, q, mode, n, t) == 1:
        # the error of the integration may have put it there; what the flow says next counts
        if value <= STRAY * f[RTOL] * gauge(model, w, p, mode, n, t, w.y, k, value, 1):
            clear = False
            w.slack[slot] = value
            band += 2.0 * value
    now = 1 if value > 0.0 else -1
    order = 1
    if not clear:
        if jumped:
            order = after_leap(model, w, p, mode, n, t, k)
        else:
            order = leaving(model, w, p, mode, n, t, k, value, band)
        now = 1 if order > 0 else -1
        if order == 0 and (how == ARRIVE or how == JUMPED_TO):
            if w.came[slot] > 0 and abs(value) > own + tick * w.swing[slot]:
                now, clear = was, True  # a guard that jumps itself: no reset has put it back
            elif not directed:
                now = was  # to rest on a surface is not to cross it
    return now, order, clear, band


def sides(model, w, p, how, fired):
    """The side of every guard here, and which of them wait for their transitions to act. PAUSE, or
    why the run ends.

    how: ARRIVE (at an instant, before anything happens), JUMPED_TO (an event has left the mode as
    it is; `fired` is its transition), ENTERED (it has changed the mode), START.
    """
    i, f = w.i, w.f
    mode, t = i[MODE], f[T]
    n, count = w.size[mode], watch_count(w, mode)
    if how == ENTERED:
        for q in range(i[TRANSITIONS]):  # the mode they leave is gone
            if w.wait[q + 2] == 1 and not leaves(w, q, mode):
                w.wait[q + 2] = 0
    if count == 0:
        return PAUSE
    i[AHEAD] = 0
    tick = TICKS * EPS * max(abs(t), abs(f[BEFORE])) + 2.0 * f[BLUR]
    watch(model, w, mode, n, t, w.y, p, w.g)
    i[GUARDS] += 1
    for k in range(count):
        q = watched(w, mode, k)
        slot = q + 2
        value, was = w.g[k], w.side[slot]
        if not isfinite(value):
            i[WHO] = max(q, 0)
            return GUARD_NAN
        if how == ARRIVE and q < 0 and w.came[slot] == 1:
            # An end of sliding was located beside the surface: on it, it may be still to come
            if value < -doubt(model, w, p, mode, n, t, w.y, k, value):
                w.came[slot], w.side[slot], w.flat[slot], w.slack[slot] = 0, -1, 0, 0.0
                continue
        if how == ARRIVE and w.came[slot] == 1:  # just located: zero, whatever its value
            w.slack[slot] = abs(value)
            w.wait[slot] = 1
            suspect = w.leap[slot] < 0 and abs(value) > STEEP * tick * w.swing[slot]
            if w.leap[slot] == 0 or suspect:
                w.leap[slot] = leaps(model, w, p, mode, n, t, k, w.swing[slot], t - f[BEFORE])
            if w.leap[slot] == 1:
                w.slack[slot], w.grain[slot], w.grains[slot] = 0.0, 0.0, 4
            continue
        directed = q < 0 or w.directed[q] == 1
        urgent = YES if q < 0 else w.urgent[q]
        now, order, clear, band = side_of(model, w, p, how, k, tick)
        w.flat[slot] = 0 if clear else 1
        if clear:
            w.slack[slot] = 0.0
        w.awake[slot] = f[LATER] if order == 2 or order == -2 else t
        w.side[slot] = now
        again = urgent == YES and q >= 0 and now > 0 and w.delay[i[LANE]][max(q, 0)] == 0.0
        if how == ENTERED:
            beyond = directed and now > 0
            if w.wait[slot] == 1:  # it leaves the mode before, too: only a jump undoes its crossing
                kept = not clear and kept_state(w, n) == 1
                w.wait[slot] = 1 if beyond or kept or not directed and now == was else 0
            elif q != fired:
                # one that the mode before had, too, and that has acted at this instant, is not
                # beyond anew
                acted = w.came[slot] >= 2 and was > 0 and left_before(w, q)
                if beyond and urgent != NO and not acted:
                    w.wait[slot] = 1
                elif not clear and not directed and kept_state(w, n) == 1:
                    came = i[BY_FLOW]
                    if came >= 0 and w.family[came] == w.family[mode]:
                        w.wait[slot] = opposed(model, w, p, mode, came, n, t, k, band, now)
        elif how == START:
            # where both flows push towards the surface, the run begins on it; a jump has no slope
            both = not clear and (not directed or now > 0 and w.leap[slot] == 1)
            both = both and returns(model, w, p, q, mode, n, t) == 1
            both = both and opposed(model, w, p, mode, w.target[q], n, t, k, band, now) == 1
            if both and w.leap[slot] == 1:
                i[WHO] = q
                return LOOP
            if directed and now > 0:
                if clear and urgent == REFUSE:
                    i[WHO] = max(q, 0)
                    return BAD_START
                over = order == 1 and urgent == REFUSE  # a body at rest there is not over it
                over = over and acted_before(model, w, p, mode, n, t, k, q, band) == 1
                w.wait[slot] = 0 if urgent == NO or over else 1
            elif both:
                w.wait[slot] = 1
        elif q == fired and how == JUMPED_TO:
            w.wait[slot] = 1 if again else 0
            if not clear and now == was and order != 0 and not again:
                if stopped(model, w, p, mode, n, t, k, slot, order) == 1:
                    f[BAND] = band
                    return CONTACT
        else:
            crossed = now != was and (now > 0 or not directed)
            if w.wait[slot] == 1:  # a jump may have undone its crossing, but not by going beyond
                w.wait[slot] = 1 if now == was or now > 0 and directed else 0
            elif crossed and (urgent != NO or how == ARRIVE):
                w.wait[slot] = 1
                w.came[slot] = 1 if how == ARRIVE else 0
    return PAUSE


def at_edge(model, w, p):
    """No step is possible beyond here: is that the surface of a guard, √h as a tank runs dry (1)?

    Guards that go towards zero, and are as near as the clock or the tolerance can tell, have
    crossed (w.came).
    """
    i, found = w.i, 0
    mode, t = i[MODE], w.f[T]
    n = w.size[mode]
    w.f[H] = max(w.f[H], w.f[RECENT])  # so far the model is looked at
    i[KNOWN], i[AHEAD] = 0, 0
    watch(model, w, mode, n, t, w.y, p, w.g)
    i[GUARDS] += 1
    for k in range(watch_count(w, mode)):
        q = watched(w, mode, k)
        slot, value = q + 2, w.g[k]
        side, slope = w.side[slot], slope_ahead(model, w, p, mode, n, t, k)
        if slope * side < 0.0 and (side < 0 or q >= 0 and w.directed[q] == 0):
            near = w.f[RTOL] * gauge(model, w, p, mode, n, t, w.y, k, value, 1)
            if abs(value) <= max(near, 2.0 * soonest(w, t) * abs(slope)):
                w.came[slot], w.side[slot], found = 1, -side, 1
    return found


def leaves(w, q, mode):
    """Does transition q leave the mode, or one of the two while sliding?"""
    return w.source[q][mode] == 1 or w.i[SLIDING] == 1 and w.source[q][w.i[SLIDE_B]] == 1


def left_before(w, q):
    """Does transition q leave the mode that the last event came from?"""
    before = int(w.ledger[w.i[LEDGER] - 1][3])
    return before >= 0 and w.source[q][before] == 1


def sent_back(model, w, p, q, mode, n, t):
    """Would transition q, on entering a mode, lead back to where the flow has just left, with the
    state as it was but for errors (1)? Then that would be left again, and so on.
    """
    line = w.ledger[w.i[LEDGER] - 1]
    target = w.target[q]
    if target < 0 or target != line[3] or target == mode or w.family[target] != w.family[mode]:
        return 0
    if w.came[int(line[1]) + 2] != 2 or kept_state(w, n) == 0 or w.delay[w.i[LANE]][q] > 0.0:
        return 0
    after = w.y_look
    reset(model, q, mode, t, w.y, p, after)
    back = 1
    for i in range(n):
        if abs(after[i] - w.y[i]) > STRAY * w.f[RTOL] * max(w.most[i], abs(w.y[i])):
            back = 0
    for i in range(w.i[WIDTH], w.i[WIDTH] + w.i[HELD]):
        if after[i] != w.y[i]:
            back = 0
        after[i] = w.y[i]
    return back


def acted_before(model, w, p, mode, n, t, k, q, band):
    """Is a guard that is beyond at the start one that has acted in the run which ended there (1)?

    Its transition leads back into the mode and leaves the guard at zero (within `band`), going
    beyond: nothing has crossed anew. As with schedules a run from t = 0 has none before it.
    """
    if t == 0.0 or w.target[q] != mode or w.delay[w.i[LANE]][q] > 0.0:
        return 0
    after = w.y_look
    reset(model, q, mode, t, w.y, p, after)
    watch(model, w, mode, n, t, after, p, w.g_look)
    zero = abs(w.g_look[k]) <= band
    rates(model, w, mode, n, t, after, p, w.ahead[1])
    for i in range(n):
        after[i] += w.f[GONE_T] * w.ahead[1][i]
    watch(model, w, mode, n, t + w.f[GONE_T], after, p, w.g_look)
    w.i[FLOWS] += 1
    w.i[GUARDS] += 2
    for i in range(w.i[WIDTH], w.i[WIDTH] + w.i[HELD]):
        after[i] = w.y[i]
    return 1 if zero and w.g_look[k] > 0.0 else 0


def returns(model, w, p, q, mode, n, t):
    """Does transition q lead to a mode with a way back whose guard is zero here, too (1)?"""
    target = w.target[q]
    if w.urgent[q] == NO or target < 0 or target == mode or w.size[target] != n:
        return 0
    for back in range(w.i[TRANSITIONS]):
        k = guard_place(w, target, back) if w.target[back] == mode else -1
        if k >= 0 and shaken(model, w, p, target, n, t, w.y, k) > 0.0:
            return 1
    return 0


def opposed(model, w, p, mode, other, n, t, k, band, now):
    """Does a guard that is zero change along the flow of another mode the other way than it goes
    here (1)?

    So a change of mode without a jump has turned it back: it has the far side of the arrival.
    """
    flow(model, other, t, w.y, p, w.ahead[1])
    w.i[FLOWS] += 1
    far = drift(model, w, p, mode, n, t, w.y, k, nearby(w, t), 2.0 * band)
    return 1 if far != 0.0 and (far > 0.0) != (now > 0) else 0


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


def stopped(model, w, p, mode, n, t, k, slot, order):
    """A guard is beyond its surface after its own reset: does the body rest there (1), or pass
    through (0)?

    It passes if it moves on by its slope in the direction in which it came, or if the reset has
    left its motion as it was (a counter, where the slope is zero). Else the reset has turned it or
    taken its speed, and what carries it beyond is too early to be told from rest; or the flow it
    came by says that it did not come at all: then the method's error decides, not the flight.
    """
    by_slope = order == 1 or order == -1
    if w.acts[slot - 2] == 0:
        return 0
    if w.came[slot] != 2 and not by_slope:  # not by the flow
        return 1
    line = w.ledger[w.i[LEDGER] - 1]
    e = w.f[GONE_T] if by_slope else 0.125 * w.f[GONE_T]
    if w.leap[slot] == 1:
        e = w.f[GONE_T]
    far = 1.0 if order > 0 else -1.0
    straight(model, w, p, mode, n, t, w.y, w.k[0], e, w.g_away)
    after = far * w.g_away[k]
    if w.leap[slot] == 1 and shaken(model, w, p, mode, n, t + e, w.y_look, k) > 0.0:
        return 1
    for i in range(n):
        w.y_shake[i] = line[5 + i]
    rates(model, w, mode, n, t, w.y_shake, p, w.ahead[1])
    w.i[FLOWS] += 1
    if by_slope and w.leap[slot] < 1:
        least = DOUBT * EPS * w.scale[slot]
        return 1 if far * drift(model, w, p, mode, n, t, w.y_shake, k, e, least) < 0.0 else 0
    straight(model, w, p, mode, n, t, w.y_shake, w.ahead[1], e, w.g_away)
    before = far * w.g_away[k]
    if w.leap[slot] == 1:
        return 0 if before > 0.0 and after > 0.0 else 1
    if before > 0.0 and after > 0.1 * before:
        return 0
    for i in range(n):
        if w.ahead[1][i] != w.k[0][i]:
            return 1
    return 0
