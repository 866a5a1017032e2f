"""Event location on the polynomial of a step.

How an event is found. Each step is a polynomial in θ ∈ [0, 1]. A guard is sampled along it at
Chebyshev points; the samples' polynomial in Bernstein form bounds the guard (convex hull) and its
sign changes bound the number of roots (Descartes). Where that leaves a doubt the interval is halved
and sampled anew; two samples off the nodes say how far to trust the polynomial. One sign change:
one root, found on the guard itself (Chandrupatla 1997). So crossings that come in pairs inside one
step, and dips of rounding size, are found, not only sign changes at its ends.

How an event is not found twice. A guard whose side is known and whose value is zero where the step
begins (w.flat) has that root divided out: leading Bernstein coefficients are set to 0, and the side
says where the rest begins. One that leaves zero only later is not looked at before (w.awake).
"""

from math import isfinite

from .layout import *
from .leaving import shaken
from .rounding import TICKS, doubt
from .sliding import watch, watch_count, watched
from .step import evaluate

#: The Lebesgue constant of nine Chebyshev points is 2.24 (fewer have less): bounds a polynomial by
#: its values there.
LEBESGUE = 2.3
#: Slopes of what is left out of a polynomial of this degree are at most so many times larger
#: (Markov: twice the degree's square).
STRAYS = 128.0


def guard_at(model, w, p, mode, n, t, h, theta, k):
    evaluate(w, n, theta, w.y_try)
    watch(model, w, mode, n, t + theta * h, w.y_try, p, w.g)
    w.i[GUARDS] += 1
    return w.g[k]


def refine(model, w, p, mode, n, t, h, k, a, fa, b, fb):
    """θ of the one root of guard k in [a, b], on b's side of it.

    Chandrupatla's method, Adv. Eng. Softw. 28, 1997.
    """
    side = 1.0 if fb > 0.0 else -1.0
    # Finer than the clock: the state must not come late
    delta = 1e-3 * EPS * max(abs(t), abs(t + h)) / h
    halvings = 0
    while fa * side >= 0.0 and halvings < 100:  # the left end counts as zero: step off it first
        middle = 0.5 * (a + b)
        f = guard_at(model, w, p, mode, n, t, h, middle, k)
        if f * side < 0.0:
            a, fa = middle, f
        else:
            b, fb = middle, f
        halvings += 1
        if b - a <= delta:
            return b
    c, fc = a, fa
    fraction = 0.5
    for _ in range(200):
        x = a + fraction * (b - a)
        f = guard_at(model, w, p, mode, n, t, h, x, k)
        if (f > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, fc = b, fb
            b, fb = a, fa
        a, fa = x, f
        if fa == 0.0:
            return a
        tolerance = 2.0 * EPS * max(abs(a), abs(b)) + delta
        limit = tolerance / abs(b - c) if b != c else 1.0
        if abs(b - a) <= 2.0 * tolerance or limit > 0.5:
            break
        xi = (a - b) / (c - b)
        phi = (fa - fb) / (fc - fb)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            fraction = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
                fc - fb
            )
        else:
            fraction = 0.5
        fraction = min(1.0 - limit, max(limit, fraction))
    return a if fa * side > 0.0 else b


def first_crossing(model, w, p, mode, n, t, h, k, begin, limit):
    """θ ∈ [begin, limit] of the first event of the k-th guard in this step; 2 if none, −2 if it is
    not a number, −3 if it does more than can be followed in so long a step.

    Its side before the step is w.side; w.turn[k] becomes that at `limit`, w.quiet[k] 1 if it went
    back from beyond on the way, which is no event of a guard with a direction.
    """
    transition = watched(w, mode, k)
    slot = transition + 2
    directed = transition < 0 or w.directed[transition] == 1
    side = w.side[slot]
    flat = w.flat[slot] == 1 and w.i[ENTRY] == 1 and begin == 0.0
    slack = 0.0 if transition < 0 else 4.0 * w.tolerance[transition]
    top = w.i[PROXY]
    narrowest, shortest = 1.5e-8, 16.0 * EPS * max(abs(t), abs(t + h)) / h
    value, hull, stack = w.value, w.hull, w.stack
    stack[0], stack[1] = begin, limit
    depth, looks = 1, 0
    # How well the guard is known, and where: asked for when it matters
    own, own_a, own_b, own_size = -1.0, 2.0, 2.0, 0.0
    # What it was located with counts as zero, too, until it is clear of that
    loose = 2.0 * w.slack[slot] if w.flat[slot] == 1 else 0.0
    # Where the guard itself was last seen on its side
    seen, seen_value = begin, 0.0
    w.near[k], w.quiet[k] = 1, 0
    while depth > 0:
        depth -= 1
        looks += 1
        a, b = stack[2 * depth], stack[2 * depth + 1]
        width = b - a
        if a == 0.0 and b == 1.0:
            for j in range(top + 3):
                value[j] = w.at_node[j][k]
        else:
            for j in range(top + 3):
                value[j] = guard_at(model, w, p, mode, n, t, h, a + width * w.node[j], k)
        if value[0] * side > max(own, 0.0) + loose:
            loose = 0.0
        if value[0] * side > 0.0:
            seen, seen_value = a, value[0]
        largest, misfit = 0.0, 0.0
        for j in range(2):
            total = 0.0
            line = w.test[j]
            for q in range(top + 1):
                total += line[q] * value[q]
            miss = abs(total - value[top + 1 + j])
            misfit = max(misfit, miss if isfinite(miss) else 1e300)
        start = flat and a == begin
        if misfit >= 1e300:  # not a number: there may be an event before it
            if looks > 400 or width <= narrowest:
                return -2.0
            middle = 0.5 * (a + b)
            stack[2 * depth], stack[2 * depth + 1] = middle, b
            stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
            depth += 2
            continue
        if not start:
            # Far from zero all along? Between its nodes a polynomial strays at most LEBESGUE times
            # as far from their middle as they do
            low, high = w.low[k], w.high[k]
            if width < 1.0:
                low, high = value[0], value[0]
                for j in range(1, top + 1):
                    low, high = min(low, value[j]), max(high, value[j])
            clear = abs(low + high) - LEBESGUE * (high - low) - 8.0 * misfit
            if clear > 32.0 * EPS * max(abs(low), abs(high)) and (low > 0.0) == (side > 0):
                if width == 1.0 and clear > slack:
                    w.near[k] = 0
                continue
        for j in range(top + 1):
            total = 0.0
            line = w.bernstein[j]
            for q in range(top + 1):
                total += line[q] * value[q]
            hull[j] = total
            largest = max(largest, abs(total))
        # … for as long as the guard has about the size that it had there
        nested = own_a <= a and b <= own_b and width > 0.125 * (own_b - own_a)
        nested = nested and largest > 0.015625 * own_size
        if not nested and (looks > 1 or w.flat[slot] == 1 or largest < 1e-9 * w.scale[slot]):
            own_a, own_b, own_size = a, b, largest
            middle = a + width * w.node[top // 2]
            evaluate(w, n, middle, w.y_try)
            own = doubt(model, w, p, mode, n, t + middle * h, w.y_try, k, value[top // 2])
        zero = own + loose
        margin = max(4.0 * misfit + 8.0 * EPS * largest, zero)
        finest = looks > 400 or width <= (shortest if start else narrowest)
        if value[0] * side < -max(zero, 0.0) and seen_value * side > 0.0:
            # It has crossed before, and its polynomial has shown nothing of that
            side = -side
            if side < 0 and directed:
                w.quiet[k], seen_value = 1, 0.0
            else:
                w.turn[k] = side
                return refine(model, w, p, mode, n, t, h, k, seen, seen_value, a, value[0])
        if largest <= zero:  # zero all along, as far as it is known
            continue
        first = 0
        if start:
            hull[0] = 0.0
            first = 1
            while first < top and abs(hull[first]) <= max(1e-12 * largest, zero):
                hull[first] = 0.0
                first += 1
            if abs(hull[first]) > margin and (hull[first] > 0.0) != (side > 0) and not finest:
                # leaves to the other side than it should: it may turn so early that it cannot be
                # seen here
                middle = 0.5 * (a + b)
                stack[2 * depth], stack[2 * depth + 1] = middle, b
                stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
                depth += 2
                continue
        elif a == begin:
            # exactly on the surface where two steps meet, or hardly off it yet where it leaves zero
            # only later: the side before still counts
            least = 1e-12 * largest if begin > 0.0 else 0.0
            while first < top and abs(hull[first]) <= least:
                first += 1
        changes, doubtful, sign = 0, 0, side
        for j in range(first, top + 1):
            if hull[j] > margin:
                if sign < 0:
                    changes += 1
                sign = 1
            elif hull[j] < -margin:
                if sign > 0:
                    changes += 1
                sign = -1
            else:
                doubtful += 1
        if changes == 0 and (doubtful == 0 or finest):
            continue
        # Where the guard strays from its polynomial it may cross more than once: one root of that
        # is one root of the guard only if both ends are far beyond what it strays by
        sure = max(margin, STRAYS * misfit) if misfit > max(zero, 8.0 * EPS * largest) else margin
        if changes == 1 and abs(hull[first]) > sure and abs(hull[top]) > sure:
            if sign < 0 and directed:
                side, w.quiet[k], seen_value = sign, 1, 0.0
                continue
            if (hull[first] > 0.0) != (side > 0):  # crossed exactly at the seam of two steps
                theta = a
            else:
                theta = refine(model, w, p, mode, n, t, h, k, a, value[0], b, value[top])
            w.turn[k] = sign
            return theta
        if looks > 400 and misfit > zero and w.i[ADAPTIVE] == 1 and w.i[WILD] < MOST_WILD:
            evaluate(w, n, a, w.y_try)  # the sign of one that jumps flickers within its rounding
            if w.leap[slot] < 1 or shaken(model, w, p, mode, n, t + a * h, w.y_try, k) == 0.0:
                w.i[WILD] += 1
                return -3.0
        if finest:  # rounding rules here: believe the samples
            for j in range(1, top + 1):
                if value[j] * side < 0.0 and abs(value[j]) > zero:
                    last = j - 1  # the last sample before it that is not beyond, if there is one
                    while last > 0 and value[last] * side < 0.0:
                        last -= 1
                    one, fa = a + width * w.node[last], value[last]
                    if fa * side < 0.0 and seen_value * side > 0.0:
                        one, fa = seen, seen_value
                    elif fa * side < 0.0:
                        last = j - 1
                        one, fa = a + width * w.node[last], value[last]
                    side = -side
                    if side > 0 or not directed:
                        w.turn[k] = side
                        two = a + width * w.node[last + 1]
                        return refine(model, w, p, mode, n, t, h, k, one, fa, two, value[last + 1])
                    w.quiet[k], seen_value = 1, 0.0
            continue
        middle = 0.5 * (a + b)
        stack[2 * depth], stack[2 * depth + 1] = middle, b
        stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
        depth += 2
    w.turn[k] = side
    return 2.0


def first_look(w, t, h, slot):
    """θ from which on a guard is looked at in this step.

    One that leaves zero by more than its slope is not clear of it at once.
    """
    if w.flat[slot] == 0 or w.awake[slot] <= t:
        return 0.0
    return (w.awake[slot] - t) / h


def find_event(model, w, p, mode, n, t, h, entry, due):
    """(θ, place of the guard) of the step's first event, 2 and −1 if there is none, −2 and −3 as
    above.

    due: its end is an instant anyhow. All guards that cross within rounding of the first are marked
    (w.came); θ is where the last of them has crossed. Without an event the sides become those at
    the end of the step.
    """
    count = watch_count(w, mode)
    top = w.i[PROXY]
    at_node, node, y_try = w.at_node, w.node, w.y_try
    if entry == 0:  # the last step's end is this one's start
        for k in range(count):
            at_node[0][k] = at_node[top][k]
    for j in range(entry ^ 1, top + 3):
        evaluate(w, n, node[j], y_try)
        watch(model, w, mode, n, t + node[j] * h, y_try, p, at_node[j])
    w.i[GUARDS] += top + 3
    tie = TICKS * EPS * max(abs(t), abs(t + h)) / h
    limit, best = 1.0, 2.0
    for k in range(count):
        slot = watched(w, mode, k) + 2
        begin = first_look(w, t, h, slot)
        low = high = at_node[0][k]
        for j in range(1, top + 1):
            value = at_node[j][k]
            if value < low:
                low = value
            elif value > high:
                high = value
        w.low[k], w.high[k], w.swing[slot] = low, high, (high - low) / h
        w.turn[k], w.quiet[k], w.near[k], w.root[k] = w.side[slot], 0, 1, 2.0
        if begin < limit:
            theta = first_crossing(model, w, p, mode, n, t, h, k, begin, limit)
            if theta < -1.0:
                return theta, k
            w.root[k] = theta
            if theta < best:
                best = theta
                limit = min(1.0, best + tie)
    if best > 1.0:
        for k in range(count):
            slot = watched(w, mode, k) + 2
            w.side[slot] = w.turn[k]
            if w.awake[slot] <= t + h and abs(w.at_node[top][k]) > 2.0 * w.slack[slot]:
                w.flat[slot], w.slack[slot] = 0, 0.0
        return 2.0, -1
    chosen, latest, at_end = -1, best, due
    for k in range(count):
        slot = watched(w, mode, k) + 2
        if w.root[k] <= limit:
            if chosen < 0:
                chosen = k
            latest = max(latest, w.root[k])
            # What is due at the end is due now, if neither the clock nor the guard can tell it
            # from its crossing; or none of the guards, where something is
            near, at_end = 1.0 - latest <= 16.0 * tie, at_end and 1.0 - w.root[k] <= 1e-6
            if near or at_end:
                last = w.at_node[top][k]
                own = doubt(model, w, p, mode, n, t + h, w.y_new, k, last)
                if near and (1.0 - latest) * h * w.swing[slot] <= own and abs(last) <= own:
                    latest = 1.0
                if at_end:
                    middle = guard_at(model, w, p, mode, n, t, h, 0.5 * (w.root[k] + 1.0), k)
                    at_end = max(abs(last), abs(middle)) <= own
            w.came[slot] = 1
            w.side[slot] = w.turn[k]
        else:
            if w.at_node[top][k] * w.side[slot] < 0.0:  # it crosses in between
                at_end = False
            if w.quiet[k] == 1:  # was that before the event, or after it?
                begin = first_look(w, t, h, slot)
                if begin < best:
                    first_crossing(model, w, p, mode, n, t, h, k, begin, best)
                    w.side[slot] = w.turn[k]
            w.turn[k] = w.side[slot]
    return 1.0 if at_end else latest, chosen


def note_touches(model, w, p, mode, n, t, h, until):
    """Notes in w.touch where, before θ = until, a guard came up to its limit and turned back:
    within its tolerance, and not beyond.

    The tolerance is in the guard already: zero is where the event is, −tolerance the limit itself,
    and as far below it the reach ends, so that the sign of a numerical error decides nothing. Where
    the samples stop rising there is a peak; w.rises tells the next step that one may lie at the
    seam.
    """
    last = w.i[PROXY]
    for k in range(watch_count(w, mode)):
        transition = watched(w, mode, k)
        if transition < 0 or w.directed[transition] == 0 or w.tolerance[transition] == 0.0:
            continue
        slot = transition + 2
        rises = w.rises[slot] == 1 and w.i[ENTRY] == 0
        for j in range(last + 1):
            here = w.at_node[j][k]
            falls = j == last or w.at_node[j + 1][k] < here
            if falls and rises and w.node[j] <= until and w.near[k] == 1:
                first, end = w.node[max(j - 1, 0)], min(w.node[min(j + 1, last)], until)
                seam = j == last or end == until
                rises = note_peak(model, w, p, mode, n, t, h, k, transition, first, end, seam)
            elif j < last and w.at_node[j + 1][k] != here:
                rises = not falls
        w.rises[slot] = 1 if rises else 0


def note_peak(model, w, p, mode, n, t, h, k, transition, first, end, seam):
    """The top between two θ by golden section; a touch if it is within reach. True if it goes on
    rising at the end.

    seam: the end is that of the step, or the event: the top lies beyond it, if it is not before it.
    """
    a, b, tolerance = first, end, w.tolerance[transition]
    for _ in range(50):
        left, right = b - 0.6180339887498949 * (b - a), a + 0.6180339887498949 * (b - a)
        one = guard_at(model, w, p, mode, n, t, h, left, k)
        if one > guard_at(model, w, p, mode, n, t, h, right, k):
            b = right
        else:
            a = left
    theta = 0.5 * (a + b)
    if seam and end - theta < 1e-6 * (end - first):
        return True
    top = guard_at(model, w, p, mode, n, t, h, theta, k)
    own = 8.0 * EPS * w.scale[transition + 2]
    if -2.0 * tolerance - own <= top <= 0.0 and w.i[TOUCHES] < MOST_TOUCHES:
        line = w.touch[w.i[TOUCHES]]
        line[0], line[1], line[2] = t + theta * h, transition, top + tolerance
        w.i[TOUCHES] += 1
    return False
