"""The integrator: explicit Runge–Kutta steps, event location on their polynomials, modes, schedules, dead times.

One source for both back ends. As it stands here it runs in plain Python on lists; backend.py loads it a second
time with the same functions compiled by Numba on arrays. So: scalar loops only, no NumPy, nothing but indexing,
and `w`, the workspace (fields in `workspace`), holds everything that must survive a pause.

How an event is found. Each step is a polynomial in θ ∈ [0, 1]. A guard is sampled along it at Chebyshev points;
the samples' polynomial in Bernstein form bounds the guard (convex hull) and its sign changes bound the number of
roots (Descartes). Where that leaves a doubt the interval is halved and sampled anew; two samples off the
nodes say how far to trust the polynomial. One sign change: one root, found on the guard itself (Chandrupatla 1997).
So crossings that come in pairs inside one step, and dips of rounding size, are found, not only sign changes at its ends.

How an event is not found twice. After a reset a guard that lies within rounding of zero *counts as* zero: that
root is divided out (leading Bernstein coefficients set to 0), and what remains tells to which side the guard leaves.
"""

from collections import namedtuple
from math import isfinite, sqrt

EPS = 2.220446049250313e-16

# Places in w.i (whole numbers that survive a pause) …
MODE, JUMP, GRID, OUT, LEDGER, PIECES, STEPS, REJECTED, FLOWS, GUARDS, FRESH, ENTRY, PENDING, SAME, WHO, FIRST = range(16)
# … and settings among them
STAGES, DEGREE, PROXY, ADAPTIVE, TWO, LOCATE, DENSE, MODES, TRANSITIONS, MAX_EVENTS, MAX_STEPS, ORDER, ROWS, WIDTH = range(16, 30)
ARRIVED = 30  # the mode in which the instant of a schedule was reached
INTEGERS = 31
# Places in w.f
T, H, T_END, RTOL, ATOL, MAX_STEP, T0, EVENT_T, ZENO_T, SPAN, DUE_T = range(11)
FLOATS = 11

# Why `advance` returns
PAUSE, FINISHED, GROW, TERMINAL, ZENO, CONTACT, LOOP, EVENTS_OUT, STEPS_OUT, UNDERFLOW, QUEUE_FULL, GUARD_NAN = range(12)

QUEUE = 256  # dead-time transitions under way at once
SAME_INSTANT = 100  # events at one instant before the run is called a loop


def workspace(n, modes, transitions, guards, rows, degree, proxy, instants, schedules, grid, events, pieces, nonzeros, weights):
    """The fields of w as (name, "f" or "i", shape): one list for the plain lists, the arrays and their addresses."""
    return (
        ("i", "i", (INTEGERS,)), ("f", "f", (FLOATS,)),
        # the method
        ("a_from", "i", (rows + 1,)), ("a_column", "i", (nonzeros,)), ("a_value", "f", (nonzeros,)), ("b", "f", (rows,)), ("c", "f", (rows,)),
        ("e", "f", (2, rows)), ("w_from", "i", (degree + 1,)), ("w_row", "i", (weights,)), ("w_value", "f", (weights,)), ("q", "f", (degree, degree)),
        ("node", "f", (proxy + 3,)), ("bernstein", "f", (proxy + 1, proxy + 1)), ("test", "f", (2, proxy + 1)),
        # the model
        ("size", "i", (modes,)), ("leave_from", "i", (modes + 1,)), ("leave", "i", (guards,)), ("source", "i", (transitions, modes)),
        ("target", "i", (transitions,)), ("zeno", "i", (transitions,)), ("directed", "i", (transitions,)), ("urgent", "i", (transitions,)),
        ("rank", "i", (transitions,)), ("delay", "f", (transitions,)),
        ("plan", "i", (schedules,)), ("plan_next", "i", (schedules,)), ("plan_first", "f", (schedules,)), ("plan_period", "f", (schedules,)),
        ("plan_from", "i", (schedules + 1,)), ("instant", "f", (instants,)),
        # the state and its surroundings
        ("y", "f", (n,)), ("y_new", "f", (n,)), ("y_try", "f", (n,)), ("k", "f", (rows, n)), ("term", "f", (degree, n)), ("poly", "f", (degree + 1, n)),
        ("at_node", "f", (proxy + 3, guards)), ("value", "f", (proxy + 3,)), ("hull", "f", (proxy + 1,)), ("g", "f", (guards,)),
        ("stack", "f", (256,)), ("side", "i", (guards,)), ("hold", "i", (transitions,)), ("root", "f", (guards,)),
        ("queue_t", "f", (QUEUE,)), ("queue", "i", (QUEUE,)),
        ("last_t", "f", (transitions,)), ("last_gap", "f", (transitions,)), ("last_ratio", "f", (transitions,)), ("last_y", "f", (transitions, n)),
        # what comes out
        ("grid", "f", (grid,)), ("out", "f", (grid + 4 + 3 * events, 3 + n)), ("ledger", "f", (events, 5 + 2 * n)), ("pieces", "f", (pieces, 3 + (degree + 1) * n)),
    )


def flow(model, mode, t, y, p, out):
    model.flow[mode](t, y, p, out)


def guards(model, mode, t, y, p, out):
    model.guards[mode](t, y, p, out)


def reset(model, transition, mode, t, y, p, out):
    model.reset[transition](mode, t, y, p, out)


def external_step(model, w, p, t, h):
    """A step by one of SciPy's methods: fills w.y_new and w.poly, returns its length (0: failed). Plain back end only."""
    return model.stepper(w, p, t, h)


# The functions above have other bodies in the compiled back end; those below are the same source in both.


def explicit_step(model, w, p, mode, n, t, h):
    """One step of the table's method from w.y, whose flow is in w.k[0]; returns the error over the tolerance."""
    k, y, y_try, y_new = w.k, w.y, w.y_try, w.y_new
    a_from, a_column, a_value = w.a_from, w.a_column, w.a_value
    stages = w.i[STAGES]
    for row in range(1, stages):
        first, last = a_from[row], a_from[row + 1]
        for i in range(n):
            total = 0.0
            for q in range(first, last):
                total += a_value[q] * k[a_column[q]][i]
            y_try[i] = y[i] + h * total
        flow(model, mode, t + w.c[row] * h, y_try, p, k[row])
    for i in range(n):
        total = 0.0
        for row in range(stages):
            total += w.b[row] * k[row][i]
        y_new[i] = y[i] + h * total
    flow(model, mode, t + h, y_new, p, k[stages])
    w.i[FLOWS] += stages
    if w.i[ADAPTIVE] == 0:
        for i in range(n):
            if not isfinite(y_new[i]):
                return 1e300
        return 0.0
    rtol, atol = w.f[RTOL], w.f[ATOL]
    high, low = 0.0, 0.0
    for i in range(n):
        scale = atol + rtol * max(abs(y[i]), abs(y_new[i]))
        first_sum, second_sum = 0.0, 0.0
        for row in range(stages + 1):
            first_sum += w.e[0][row] * k[row][i]
            second_sum += w.e[1][row] * k[row][i]
        first_sum /= scale
        second_sum /= scale
        high += first_sum * first_sum
        low += second_sum * second_sum
    if w.i[TWO] == 1:  # DOP853 weighs its fifth- and third-order estimates (Hairer, Nørsett, Wanner, II.10)
        if high == 0.0 and low == 0.0:
            return 0.0
        return h * high / sqrt((high + 0.01 * low) * n)
    return h * sqrt(high / n)


def interpolate(model, w, p, mode, n, t, h):
    """The step's polynomial into w.poly; DOP853 needs three more evaluations for it."""
    k, y, y_try = w.k, w.y, w.y_try
    stages, degree = w.i[STAGES], w.i[DEGREE]
    for row in range(stages + 1, w.i[ROWS]):
        for i in range(n):
            total = 0.0
            for q in range(w.a_from[row], w.a_from[row + 1]):
                total += w.a_value[q] * k[w.a_column[q]][i]
            y_try[i] = y[i] + h * total
        flow(model, mode, t + w.c[row] * h, y_try, p, k[row])
        w.i[FLOWS] += 1
    for d in range(degree):
        for i in range(n):
            total = 0.0
            for q in range(w.w_from[d], w.w_from[d + 1]):
                total += w.w_value[q] * k[w.w_row[q]][i]
            w.term[d][i] = h * total
    for i in range(n):
        w.poly[0][i] = y[i]
    for d in range(degree):
        powers = w.q[d]
        for i in range(n):
            total = 0.0
            for q in range(degree):
                if powers[q] != 0.0:
                    total += powers[q] * w.term[q][i]
            w.poly[d + 1][i] = total


def evaluate(w, n, theta, out):
    """The state at θ of the current step into out (Horner)."""
    poly = w.poly
    for i in range(n):
        out[i] = poly[w.i[DEGREE]][i]
    for d in range(w.i[DEGREE] - 1, -1, -1):
        row = poly[d]
        for i in range(n):
            out[i] = out[i] * theta + row[i]


def guard_at(model, w, p, mode, n, t, h, theta, k):
    evaluate(w, n, theta, w.y_try)
    guards(model, mode, t + theta * h, w.y_try, p, w.g)
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
            fraction = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        else:
            fraction = 0.5
        fraction = min(1.0 - limit, max(limit, fraction))
    return a if fa * side > 0.0 else b


def first_crossing(model, w, p, mode, n, t, h, k, transition, limit, entry):
    """θ ∈ [0, limit] of the first event of guard k in this step; 2 if none, −1 if it rests on its surface, −2 if it is NaN.

    w.side[k] is the guard's side before the step (0: not known yet) and is left as that at `limit`.
    """
    top = w.i[PROXY]
    directed = w.directed[transition] == 1
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
        for j in range(top + 1):
            total = 0.0
            row = w.bernstein[j]
            for q in range(top + 1):
                total += row[q] * value[q]
            hull[j] = total
            largest = max(largest, abs(total))
            spread = max(spread, abs(total - hull[0]))
        for j in range(2):
            total = 0.0
            row = w.test[j]
            for q in range(top + 1):
                total += row[q] * value[q]
            misfit = max(misfit, abs(total - value[top + 1 + j]))
        if not (isfinite(largest) and isfinite(misfit)):
            return -2.0
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
                    if abs(hull[start]) <= margin and not finest and largest > 0.0:
                        middle = 0.5 * (a + b)
                        stack[2 * depth], stack[2 * depth + 1] = middle, b
                        stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
                        depth += 2
                        continue
                    undecided = False
                    if hull[start] > 0.0:
                        if directed:
                            if w.hold[transition] == 0:
                                return 0.0
                            if start > 1:
                                return -1.0
                        side = 1
                    elif hull[start] < 0.0 or directed:
                        side = -1
            elif undecided:
                undecided = False
                side = 1 if hull[0] > 0.0 else -1
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
                        return a + width * w.node[j]
            continue
        middle = 0.5 * (a + b)
        stack[2 * depth], stack[2 * depth + 1] = middle, b
        stack[2 * depth + 2], stack[2 * depth + 3] = a, middle
        depth += 2
    w.side[k] = side
    return 2.0


def find_event(model, w, p, mode, n, t, h, entry):
    """(θ, position of the guard) of the step's first event: of those within rounding of the first, the one of highest priority."""
    first, count = w.leave_from[mode], w.leave_from[mode + 1] - w.leave_from[mode]
    if count == 0:
        return 2.0, -1
    top = w.i[PROXY]
    if entry == 0:  # the last step's end is this one's start
        for k in range(count):
            w.at_node[0][k] = w.at_node[top][k]
    for j in range(entry ^ 1, top + 3):
        evaluate(w, n, w.node[j], w.y_try)
        guards(model, mode, t + w.node[j] * h, w.y_try, p, w.at_node[j])
    w.i[GUARDS] += top + 3
    tie = 16.0 * EPS * max(abs(t), abs(t + h)) / h
    limit, best = 1.0, 2.0
    for k in range(count):
        theta = first_crossing(model, w, p, mode, n, t, h, k, w.leave[first + k], limit, entry)
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


def record(w, t, mode, n, y):
    """One sample, unless it is the last one again."""
    row, jump = w.i[OUT], w.i[JUMP]
    if row > 0 and w.out[row - 1][0] == t and w.out[row - 1][2] == jump:
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


def fire(model, w, p, transition):
    """Carry out a transition at the current time and state; returns PAUSE to go on, or why the run ends."""
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
    if w.plan_period[s] > 0.0:
        return w.f[T0] + (w.plan_first[s] + w.plan_next[s] * w.plan_period[s])
    place = w.plan_from[s] + w.plan_next[s]
    return w.instant[place] if place < w.plan_from[s + 1] else 1e300


def next_due(w):
    """The next instant of a schedule or at the end of a dead time."""
    due = 1e300
    for s in range(len(w.plan)):
        due = min(due, plan_time(w, s))
    for q in range(w.i[PENDING]):
        due = min(due, w.queue_t[q])
    return due


def take_due(w, until):
    """Take the transition of highest priority that is due off its schedule or queue; −1 if there is none. Not for this mode: dropped."""
    best, where, queued = -1, -1, False
    for s in range(len(w.plan)):
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


def first_step(model, w, p, mode, n):
    """A step to begin with (Hairer, Nørsett, Wanner, II.4), from w.k[0]."""
    t, rtol, atol = w.f[T], w.f[RTOL], w.f[ATOL]
    span = min(w.f[T_END] - t, w.f[MAX_STEP])
    d0, d1 = 0.0, 0.0
    for i in range(n):
        scale = atol + abs(w.y[i]) * rtol
        d0 += (w.y[i] / scale) * (w.y[i] / scale)
        d1 += (w.k[0][i] / scale) * (w.k[0][i] / scale)
    d0, d1 = sqrt(d0 / n), sqrt(d1 / n)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(h0, span)
    for i in range(n):
        w.y_try[i] = w.y[i] + h0 * w.k[0][i]
    flow(model, mode, t + h0, w.y_try, p, w.k[1])
    w.i[FLOWS] += 1
    d2 = 0.0
    for i in range(n):
        scale = atol + abs(w.y[i]) * rtol
        d2 += ((w.k[1][i] - w.k[0][i]) / scale) * ((w.k[1][i] - w.k[0][i]) / scale)
    d2 = sqrt(d2 / n) / h0
    if not isfinite(d2):
        return h0 * 1e-3
    if d1 <= 1e-15 and d2 <= 1e-15:
        h1 = max(1e-6, h0 * 1e-3)
    else:
        h1 = (0.01 / max(d1, d2)) ** (1.0 / w.i[ORDER])
    return min(100.0 * h0, h1, span)


def sample(w, t, h, end, mode, n):
    """Samples of the grid within (t, end], from the step's polynomial; the end's own from w.y."""
    place = w.i[GRID]
    while place < len(w.grid) and w.grid[place] < end:
        if w.grid[place] > t:
            evaluate(w, n, (w.grid[place] - t) / h, w.y_try)
            record(w, w.grid[place], mode, n, w.y_try)
        place += 1
    if place < len(w.grid) and w.grid[place] == end:
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
        if i[LEDGER] + 2 > len(w.ledger) or i[PIECES] + 1 > len(w.pieces):
            return GROW
        mode, t = i[MODE], f[T]
        n = w.size[mode]
        if i[OUT] == 0:
            record(w, t, mode, n, w.y)
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
            if transition >= 0 and w.source[transition][mode] == 1 and w.source[transition][i[ARRIVED]] == 1:
                status = fire(model, w, p, transition)
                if status != PAUSE:
                    return status
            continue
        if t >= f[T_END]:
            record(w, t, mode, n, w.y)
            return FINISHED

        # Guards that are already true and do not wait
        first, count = w.leave_from[mode], w.leave_from[mode + 1] - w.leave_from[mode]
        if i[ENTRY] == 1 and count > 0:
            guards(model, mode, t, w.y, p, w.g)
            i[GUARDS] += 1
            chosen = -1
            for k in range(count):
                transition = w.leave[first + k]
                if not isfinite(w.g[k]):
                    i[WHO] = transition
                    return GUARD_NAN
                if chosen < 0 and w.urgent[transition] == 1 and w.g[k] > 0.0 and w.hold[transition] == 0:
                    chosen = transition
            if chosen >= 0:
                if w.delay[chosen] > 0.0:
                    if i[PENDING] >= QUEUE:
                        return QUEUE_FULL
                    w.queue_t[i[PENDING]], w.queue[i[PENDING]] = t + w.delay[chosen], chosen
                    i[PENDING] += 1
                    w.hold[chosen] = 1
                else:
                    status = fire(model, w, p, chosen)
                    if status != PAUSE:
                        return status
                continue

        # A step
        if i[FRESH] == 1 and i[ADAPTIVE] < 2:
            flow(model, mode, t, w.y, p, w.k[0])
            i[FLOWS] += 1
            if f[H] <= 0.0:
                f[H] = first_step(model, w, p, mode, n)
            i[FRESH] = 0
        limit = min(due, f[T_END])
        h = min(f[H], f[MAX_STEP])
        snapped = h >= limit - t - least
        if snapped:
            h = limit - t
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
                f[H] = max(f[H], grown) if snapped else grown  # a step cut short says nothing against the long one
        i[FIRST] = 0
        i[STEPS] += 1
        end = limit if snapped else t + h

        theta, k = 2.0, -1
        wanted = i[DENSE] == 1 or (count > 0 and i[LOCATE] == 1) or (i[GRID] < len(w.grid) and w.grid[i[GRID]] < end)
        if i[ADAPTIVE] < 2 and wanted:
            interpolate(model, w, p, mode, n, t, h)
        if i[LOCATE] == 1:
            theta, k = find_event(model, w, p, mode, n, t, h, i[ENTRY])
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
            i[WHO] = w.leave[first + k]
            if f[H] < least or i[ADAPTIVE] != 1:
                return GUARD_NAN
            continue
        if k >= 0 and theta < 0.0:  # it rests on its surface: a reset has not taken it off
            transition = w.leave[first + k]
            i[WHO] = transition
            if w.zeno[transition] < 0:
                return CONTACT
            for q in range(n):
                w.y_new[q] = w.y[q]
            come_to_rest(w, t, transition, n)
            continue
        if k >= 0 and theta < 1.0:
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
            if wanted or (i[GRID] < len(w.grid) and w.grid[i[GRID]] <= end):
                sample(w, t, h, end, mode, n)
        if k < 0:
            if i[ADAPTIVE] == 1 or i[ADAPTIVE] == 0:
                last = w.k[i[STAGES]]
                for q in range(n):
                    w.k[0][q] = last[q]
            continue
        transition = w.leave[first + k]
        if w.delay[transition] > 0.0:
            if i[PENDING] >= QUEUE:
                i[WHO] = transition
                return QUEUE_FULL
            w.queue_t[i[PENDING]], w.queue[i[PENDING]] = end + w.delay[transition], transition
            i[PENDING] += 1
            i[ENTRY], i[FRESH] = 1, 1
            w.hold[transition] = 1
        else:
            status = fire(model, w, p, transition)
            if status != PAUSE:
                return status
    return PAUSE


Workspace = namedtuple("Workspace", [name for name, _, _ in workspace(*[1] * 14)])
