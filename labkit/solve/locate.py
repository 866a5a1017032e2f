"""Event location on the polynomial of a step.

How an event is found. Each step is a polynomial in θ ∈ [0, 1]. A guard is sampled along it at Chebyshev points;
the samples' polynomial in Bernstein form bounds the guard (convex hull) and its sign changes bound the number of
roots (Descartes). Where that leaves a doubt the interval is halved and sampled anew; two samples off the
nodes say how far to trust the polynomial. One sign change: one root, found on the guard itself (Chandrupatla 1997).
So crossings that come in pairs inside one step, and dips of rounding size, are found, not only sign changes at its ends.

How an event is not found twice. After a reset a guard that lies within rounding of zero *counts as* zero: that
root is divided out (leading Bernstein coefficients set to 0), and what remains tells to which side the guard leaves.
"""

from math import isfinite

from .layout import *
from .sliding import watch, watch_count, watched
from .step import evaluate

#: The Lebesgue constant of nine Chebyshev points is 2.24 (fewer have less): bounds a polynomial by its values there.
LEBESGUE = 2.3


def guard_at(model, w, p, mode, n, t, h, theta, k):
    evaluate(w, n, theta, w.y_try)
    watch(model, w, mode, n, t + theta * h, w.y_try, p, w.g)
    w.i[GUARDS] += 1
    return w.g[k]


def refine(model, w, p, mode, n, t, h, k, a, fa, b, fb):
    """θ of the one root of guard k in [a, b], on b's side of it (Chandrupatla's method, Adv. Eng. Softw. 28, 1997)."""
    side = 1.0 if fb > 0.0 else -1.0
    delta = 2.0 * EPS * max(abs(t), abs(t + h)) / h
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


def first_crossing(model, w, p, mode, n, t, h, k, directed, held, limit, entry):
    """θ ∈ [0, limit] of the first event of guard k in this step; 2 if none, −1 if it rests on its surface, −2 if it is NaN.

    w.side[k] is the guard's side before the step (0: not known yet) and is left as that at `limit`.
    """
    top = w.i[PROXY]
    side = w.side[k]
    undecided = entry == 1
    narrowest = 1.5e-8
    value, hull, stack = w.value, w.hull, w.stack
    stack[0], stack[1] = 0.0, limit
    depth = 1
    state = 0.0
    for j in range(n):
        state = max(state, abs(w.poly[0][j]))
    floor = 8.0 * EPS * state  # a guard is not known better than this
    w.near[k] = 1
    slack = 0.0 if watched(w, mode, k) < 0 else 2.0 * w.tolerance[watched(w, mode, k)]
    looks = 0
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
        largest, spread, misfit = 0.0, 0.0, 0.0
        for j in range(2):
            total = 0.0
            line = w.test[j]
            for q in range(top + 1):
                total += line[q] * value[q]
            misfit = max(misfit, abs(total - value[top + 1 + j]))
            if not isfinite(total - value[top + 1 + j]):
                return -2.0
        if entry == 0 or a > 0.0:
            # Far from zero all along? Between its nodes a polynomial strays at most LEBESGUE times as far from their middle as they do
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
            spread = max(spread, abs(total - hull[0]))
        if largest <= floor and not (entry == 1 and a == 0.0):
            continue
        margin = 4.0 * misfit + 8.0 * EPS * largest
        finest = width <= narrowest or looks > 400
        start = 0
        if entry == 1 and a == 0.0:
            # Within rounding of zero? In time: the surface is 256 ulp of t away; in value: 8 ulp of the state.
            band = top * spread * 256.0 * EPS * max(abs(t), abs(t + h)) / (width * h) + floor
            if abs(hull[0]) <= band:
                hull[0] = 0.0
                start = 1
                while start < top and abs(hull[start]) <= 1e-12 * largest:
                    hull[start] = 0.0
                    start += 1
                if undecided:
                    # It is a slope that is judged here, and a polynomial of degree N misses slopes by N² times what it misses values
                    if (
                        abs(hull[start]) <= margin + 4.0 * top * top * misfit
                        and not finest
                        and largest > 0.0
                    ):
                        middle = 0.5 * (a + b)
                        stack[2 * depth], stack[2 * depth + 1] = middle, b
                        stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
                        depth += 2
                        continue
                    undecided = False
                    if hull[start] > 0.0:
                        if directed:
                            if not held:
                                return 0.0
                            if start > 1:
                                return -1.0
                        side = 1
                    elif hull[start] < 0.0 or directed:
                        side = -1
            elif undecided:
                undecided = False
                side = 1 if hull[0] > 0.0 else -1
        elif a == 0.0:
            while (
                start < top and hull[start] == 0.0
            ):  # exactly on the surface where two steps meet: the side before still counts
                start += 1
        changes, doubtful, sign = 0, 0, side
        for j in range(start, top + 1):
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
            side = sign
            continue
        if changes == 1 and abs(hull[start]) > margin and abs(hull[top]) > margin:
            if (hull[start] > 0.0) != (side > 0):  # crossed exactly at the seam of two steps
                theta = a
            else:
                theta = refine(model, w, p, mode, n, t, h, k, a, value[0], b, value[top])
            if sign > 0 or not directed:
                w.side[k] = sign
                return theta
            side = sign
            continue
        if finest:  # rounding rules here: believe the samples
            for j in range(1, top + 1):
                if value[j] * side < 0.0:
                    side = -side
                    if side > 0 or not directed:
                        w.side[k] = side
                        return refine(
                            model,
                            w,
                            p,
                            mode,
                            n,
                            t,
                            h,
                            k,
                            a + width * w.node[j - 1],
                            value[j - 1],
                            a + width * w.node[j],
                            value[j],
                        )
            continue
        middle = 0.5 * (a + b)
        stack[2 * depth], stack[2 * depth + 1] = middle, b
        stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
        depth += 2
    w.side[k] = side
    return 2.0


def find_event(model, w, p, mode, n, t, h, entry):
    """(θ, position of the guard) of the step's first event: of those within rounding of the first, the one of highest priority."""
    count = watch_count(w, mode)
    if count == 0:
        return 2.0, -1
    top = w.i[PROXY]
    if entry == 0:  # the last step's end is this one's start
        for k in range(count):
            w.at_node[0][k] = w.at_node[top][k]
    for j in range(entry ^ 1, top + 3):
        evaluate(w, n, w.node[j], w.y_try)
        watch(model, w, mode, n, t + w.node[j] * h, w.y_try, p, w.at_node[j])
    w.i[GUARDS] += top + 3
    tie = 16.0 * EPS * max(abs(t), abs(t + h)) / h
    limit, best = 1.0, 2.0
    for k in range(count):
        transition = watched(w, mode, k)
        directed = transition < 0 or w.directed[transition] == 1
        held = transition >= 0 and w.hold[transition] == 1
        theta = first_crossing(model, w, p, mode, n, t, h, k, directed, held, limit, entry)
        w.root[k] = theta
        if theta < best:
            best = theta
            limit = min(1.0, max(best, 0.0) + tie)
    if best > 1.0:
        return 2.0, -1
    chosen, latest = -1, best
    for k in range(count):
        if w.root[k] <= max(best, 0.0) + tie:
            if chosen < 0:
                chosen = k
            latest = max(latest, w.root[k])
    return (latest if w.root[chosen] >= 0.0 else w.root[chosen]), chosen


def note_touches(model, w, p, mode, n, t, h, until):
    """Notes in w.touch where, before θ = until, a guard came up to its limit and turned back: above −tolerance, but not through zero.

    (The tolerance is in the guard already: zero is where the event is, −tolerance is the limit itself.) Among the samples of
    the step a peak stands out; golden section finds its top.
    """
    state = 0.0
    for j in range(n):
        state = max(state, abs(w.poly[0][j]))
    for k in range(watch_count(w, mode)):
        transition = watched(w, mode, k)
        if w.near[k] == 0 or transition < 0 or w.directed[transition] == 0:
            continue
        reach = w.tolerance[transition] + 8.0 * EPS * state
        last = w.i[PROXY]
        for j in range(
            w.i[ENTRY], last + 1
        ):  # a peak beside the seam of two steps stands out at the end of both, but lies in one
            here = w.at_node[j][k]
            before, after = w.at_node[max(j - 1, 0)][k], w.at_node[min(j + 1, last)][k]
            if (
                here > 0.0
                or here < before
                or here < after
                or 2.0 * here - min(before, after) < -reach
                or w.i[TOUCHES] == MOST_TOUCHES
            ):
                continue
            first, end = w.node[max(j - 1, 0)], min(w.node[min(j + 1, last)], until)
            a, b = first, end
            for _ in range(50):
                left, right = b - 0.6180339887498949 * (b - a), a + 0.6180339887498949 * (b - a)
                if guard_at(model, w, p, mode, n, t, h, left, k) > guard_at(
                    model, w, p, mode, n, t, h, right, k
                ):
                    b = right
                else:
                    a = left
            top = guard_at(model, w, p, mode, n, t, h, 0.5 * (a + b), k)
            if -reach <= top <= 0.0 and a > first and b < end:
                line = w.touch[w.i[TOUCHES]]
                line[0], line[1], line[2] = (
                    t + 0.5 * (a + b) * h,
                    transition,
                    top + w.tolerance[transition],
                )
                w.i[TOUCHES] += 1
