"""Sliding along a switching surface (Filippov 1988): two modes that push each other back.

Then the state can stay in neither; it moves along the surface with the one mixture of both flows
that does not leave it,

    (1 − λ)·f_A + λ·f_B   with   λ = a/(a − b),   a = dγ/dt along f_A > 0,   b = dγ/dt along f_B <
    0,

γ being the guard of A, turned so that B begins where it is positive. Sliding ends when a falls to 0
(back into A) or b rises to 0 (on into B): two more guards, located like all others. Slopes of γ are
central differences along the flows.

`rates` and `watch` are `flow` and `guards` for all that integrate and look for events, sliding or
not.
"""

from .layout import *

KEPT = 64.0 * EPS  # of a state's size: it has not jumped


def slope(model, w, p, n, t, y, rate):
    """dγ/dt of the surface's guard along a flow."""
    e, mode, k = w.f[PROBE], w.i[SLIDE_A], w.i[GUARD_A]
    for i in range(n):
        w.y_probe[i] = y[i] + e * rate[i]
    guards(model, mode, t + e, w.y_probe, p, w.g_probe)
    ahead = w.g_probe[k]
    for i in range(n):
        w.y_probe[i] = y[i] - e * rate[i]
    guards(model, mode, t - e, w.y_probe, p, w.g_probe)
    w.i[GUARDS] += 2
    return w.f[TURN] * (ahead - w.g_probe[k]) / (2.0 * e)


def pushes(model, w, p, n, t, y):
    """(a, b), with both flows left in w.rate_a and w.rate_b."""
    flow(model, w.i[SLIDE_A], t, y, p, w.rate_a)
    flow(model, w.i[SLIDE_B], t, y, p, w.rate_b)
    return slope(model, w, p, n, t, y, w.rate_a), slope(model, w, p, n, t, y, w.rate_b)


def rates(model, w, mode, n, t, y, p, out):
    """The right-hand side in force."""
    if w.i[SLIDING] == 0:
        flow(model, mode, t, y, p, out)
        return
    part = mixing(model, w, p, n, t, y)
    for i in range(n):
        out[i] = (1.0 - part) * w.rate_a[i] + part * w.rate_b[i]


def watch_count(w, mode):
    """How many guards are looked at."""
    count = w.leave_from[mode + 1] - w.leave_from[mode]
    if w.i[SLIDING] == 1:
        count += w.leave_from[w.i[SLIDE_B] + 1] - w.leave_from[w.i[SLIDE_B]]
    return count  # both ends of sliding in place of the two guards that make the surface


def watched(w, mode, k):
    """The transition of guard number k; −1 and −2 are the ends of sliding, into A and into B."""
    if w.i[SLIDING] == 0:
        return w.leave[w.leave_from[mode] + k]
    if k < 2:
        return -1 - k
    k -= 2
    others = w.leave_from[mode + 1] - w.leave_from[mode] - 1
    if k < others:
        return w.leave[w.leave_from[mode] + (k if k < w.i[GUARD_A] else k + 1)]
    k -= others
    return w.leave[w.leave_from[w.i[SLIDE_B]] + (k if k < w.i[GUARD_B] else k + 1)]


def watch(model, w, mode, n, t, y, p, out):
    """All guards looked at."""
    if w.i[SLIDING] == 0:
        guards(model, mode, t, y, p, out)
        return
    a, b = pushes(model, w, p, n, t, y)
    out[0], out[1] = -a, b
    place = 2
    for side in range(2):
        here, surface = (mode, w.i[GUARD_A]) if side == 0 else (w.i[SLIDE_B], w.i[GUARD_B])
        guards(model, here, t, y, p, w.g_probe)
        for k in range(w.leave_from[here + 1] - w.leave_from[here]):
            if k != surface:
                out[place] = w.g_probe[k]
                place += 1


def begin_sliding(model, w, p, second):
    """Sliding begins (1) instead of `second`, if that would send back at once what has just come;
    else 0. 2: it should, but the guard jumps at its surface, and no slope says how the flows mix.

    The last event came at this very instant from the mode that `second` leads to, neither changes
    the state, and γ falls along f_B while it rises along f_A: a > b.
    """
    t, mode, line = w.f[T], w.i[MODE], w.i[LEDGER] - 1
    if w.i[SLIDING] == 1 or line < 0 or w.f[EVENT_T] != t or w.ledger[line][4] != mode:
        return 0
    first, before = int(w.ledger[line][1]), int(w.ledger[line][3])
    n, lane = w.size[mode], w.i[LANE]
    if before < 0 or before == mode or w.target[second] != before or w.size[before] != n:
        return 0
    if w.delay[lane][first] > 0.0 or w.delay[lane][second] > 0.0:
        return 0
    surface, place = guard_place(w, before, first), guard_place(w, mode, second)
    if surface < 0 or place < 0:  # a schedule brought it here, or takes it away
        return 0
    reset(model, second, mode, t, w.y, p, w.y_new)
    if kept_state(w, n) == 0:
        return 0
    for i in range(n):
        if abs(w.y_new[i] - w.y[i]) > KEPT * w.most[i]:
            return 0
    if same_surface(model, w, p, n, t, before, surface, mode, place) == 0:
        return 0
    scale = 0.0
    for i in range(n):
        scale += abs(w.rate_a[i])  # the gradient of γ, in units of each state's size
    w.i[SLIDE_A], w.i[SLIDE_B], w.i[GUARD_A], w.i[GUARD_B] = before, mode, surface, place
    w.f[TURN] = w.side[first + 2]  # a guard without direction may have crossed downwards
    # Slopes are taken over a time in which the guard moves by 10¹⁰ of its roundings
    least = max(1e-6 * w.f[H], 1e3 * EPS * abs(t))
    w.f[PROBE] = (t + least) - t
    a, b = pushes(model, w, p, n, t, w.y)
    speed = abs(a) + abs(b)
    if speed > 0.0 and scale > 0.0:
        e = max(1e10 * EPS * scale / speed, 1e3 * EPS * abs(t))
        w.f[PROBE] = (t + e) - t
        a, b = pushes(model, w, p, n, t, w.y)
    w.f[MIXED] = 1e-9
    if speed > 0.0:  # how well λ is known
        w.f[MIXED] += 8.0 * EPS * scale / (w.f[PROBE] * speed)
    if not a > b:
        return 0
    if w.leap[first + 2] == 1:
        return 2
    w.i[SLIDING] = 1
    return 1


def kept_state(w, n):
    """Has the last event left the state as it was, but for rounding (1)?"""
    line = w.ledger[w.i[LEDGER] - 1]
    if line[3] >= 0 and w.size[int(line[3])] != n:
        return 0
    for i in range(n):
        if abs(line[5 + i] - w.y[i]) > KEPT * w.most[i]:
            return 0
    return 1


def guard_place(w, mode, transition):
    """Where a transition's guard stands among those of a mode; −1 if it has none there."""
    for k in range(w.leave_from[mode + 1] - w.leave_from[mode]):
        if w.leave[w.leave_from[mode] + k] == transition:
            return k
    return -1


def mixing(model, w, p, n, t, y):
    """λ here: how much of the second mode is in the mixture; 0 when not sliding."""
    if w.i[SLIDING] == 0:
        return 0.0
    a, b = pushes(model, w, p, n, t, y)
    return a / (a - b) if a != b else 0.5


def gradient(model, w, p, n, t, y, mode, k, out):
    """∂g/∂(yᵢ/size) of a mode's k-th guard into out, in units of each state's largest size.

    No unit matters. Its square.
    """
    square = 0.0
    for i in range(n):
        w.y_probe[i] = y[i]
    for i in range(n):
        size = max(w.most[i], abs(y[i]))
        if size == 0.0:
            size = 1.0
        w.y_probe[i] = y[i] + 1e-6 * size
        guards(model, mode, t, w.y_probe, p, w.g_probe)
        ahead = w.g_probe[k]
        w.y_probe[i] = y[i] - 1e-6 * size
        guards(model, mode, t, w.y_probe, p, w.g_probe)
        w.y_probe[i] = y[i]
        out[i] = (ahead - w.g_probe[k]) / 2e-6
        square += out[i] * out[i]
    w.i[GUARDS] += 2 * n
    return square


def same_surface(model, w, p, n, t, a, k_a, b, k_b):
    """Do two guards vanish on one surface (1)? Their gradients are parallel.

    Two tanks that run dry in turn have two.
    """
    one = gradient(model, w, p, n, t, w.y, a, k_a, w.rate_a)
    two = gradient(model, w, p, n, t, w.y, b, k_b, w.rate_b)
    both = 0.0
    for i in range(n):
        both += w.rate_a[i] * w.rate_b[i]
    return 1 if both * both >= 0.999999 * one * two else 0


def back_to_surface(model, w, p, mode, k, n, t, y):
    """One Newton step along the gradient of a mode's k-th guard, if it comes nearer (1; else 0).

    Rounding and the step's error would let the state drift off.
    """
    square = gradient(model, w, p, n, t, y, mode, k, w.rate_a)
    guards(model, mode, t, y, p, w.g_probe)
    w.i[GUARDS] += 1
    off = w.g_probe[k]
    if not square > 0.0:
        return 0
    for i in range(w.i[WIDTH] + w.i[HELD]):
        w.y_shake[i] = y[i]
    for i in range(n):
        size = max(w.most[i], abs(y[i]))
        w.y_shake[i] -= off * w.rate_a[i] / square * (size if size > 0.0 else 1.0)
    guards(model, mode, t, w.y_shake, p, w.g_probe)
    w.i[GUARDS] += 1
    if not abs(w.g_probe[k]) < abs(off):
        return 0
    for i in range(n):
        y[i] = w.y_shake[i]
    return 1
