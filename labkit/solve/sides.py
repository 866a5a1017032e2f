"""The side of each guard, − or +, where it is not plain from the guard's value: what an event
means.

Between events every guard has a side. At an instant (an event, a schedule, the start, the end) it
is the sign of the guard's value; where that is zero to its own rounding, the sign with which the
guard leaves zero along the flow. `sides` works that out before and after each jump, and a guard
whose side has changed waits for its transition to act (w.wait). Its slot is its transition's number
+ 2.
"""

from math import isfinite

from .layout import *
from .leaving import *
from .rounding import *
from .sliding import guard_place, kept_state, rates, watch, watch_count, watched

STEEP = 1024.0  # a guard that is so many times off where it was located is as good as a jump
STRAY = 100.0  # tolerances: what a state may be off by after many steps


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
        if how != ARRIVE or steep == 0.0:
            steep = steepest(model, w, p, n, slot)
        reach = tick * steep
        if abs(value) <= reach:
            reach = tick * abs(slope_ahead(model, w, p, mode, n, t, k))
            if abs(value) > reach and (how == ENTERED or how == JUMPED_TO):
                reach = tick * slopes(model, w, p, mode, n, t, k)
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


def stopped(model, w, p, mode, n, t, k, slot, order):
    """A guard is beyond its surface after its own reset: does the body rest there (1), or pass
    through (0)?

    It passes if it moves on by its slope in the direction in which it came, or if the reset has
    left its motion as it was (a counter, where the slope is zero). Else the reset has turned it or
    taken its speed, and what carries it beyond is too early to be told from rest; or the flow it
    came by says that it did not come at all: then the method's error decides, not the flight.
    """
    if w.acts[slot - 2] == 0:  # what has no reset takes no speed
        return 0
    by_slope = order == 1 or order == -1
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
