"""One step: the explicit Runge–Kutta step, its error, its polynomial.

error = explicit_step(model, w, p, mode, n, t, h)      # w.y -> w.y_new; accepted when error < 1
interpolate(model, w, p, mode, n, t, h)                # w.poly
evaluate(w, n, theta, out)
"""

from math import isfinite, sqrt

from .layout import *
from .sliding import rates


def combine(n, first, last, column, value, rows, h, y, out):
    """out = y + h·Σ value[q]·rows[column[q]], q from first to last, two states at a time.

    A sparse row of a table times the stages.
    """
    i = 0
    while i + 1 < n:
        j = i + 1
        one, two = 0.0, 0.0
        for q in range(first, last):
            factor, k = value[q], rows[column[q]]
            one += factor * k[i]
            two += factor * k[j]
        out[i] = y[i] + h * one
        out[j] = y[j] + h * two
        i += 2
    if i < n:
        one = 0.0
        for q in range(first, last):
            one += value[q] * rows[column[q]][i]
        out[i] = y[i] + h * one


def grown(w, mode, n):
    """The largest size of each state so far, and of all states of one unit."""
    kind, most, size_of = w.kind[mode], w.most, w.size_of
    for i in range(n):
        size = abs(w.y[i])
        if size > most[i]:
            most[i] = size
            if size > size_of[kind[i]]:
                size_of[kind[i]] = size


def sized(w, mode, n):
    """The same where states are others than before, or have been made smaller."""
    kind, most, size_of = w.kind[mode], w.most, w.size_of
    for i in range(n):
        size_of[kind[i]] = 0.0
    for i in range(n):
        size = abs(w.y[i])
        if size > most[i]:
            most[i] = size
        if most[i] > size_of[kind[i]]:
            size_of[kind[i]] = most[i]


def allowed(w, mode, i, size, h):
    """What a step h may get state i wrong by, where its size is as given.

    Without an `atol` of the user's the part that does not grow with the state is a hundredth of
    rtol times the largest size that a state of the same unit has had, or what the terms of its
    derivative move it by in this step; so no unit matters. A state without a unit is of its own
    kind. Never less than the rounding of the derivative, by its terms and by the clock.
    """
    absolute = w.absolute[mode][i]
    if absolute < 0.0:
        known = w.size_of[w.kind[mode][i]]
        moved = h * max(w.terms[mode][i], abs(w.k[0][i]))
        rough = 8.0 * EPS * moved + h * w.ticks[mode][i]
        absolute = 0.01 * w.f[RTOL] * (known + moved) + rough
    if w.i[SLIDING] == 1:  # λ is made of differences
        absolute += w.f[MIXED] * h * abs(w.rate_a[i] - w.rate_b[i])
    return max(absolute + w.f[RTOL] * size, 1e-300)


def explicit_step(model, w, p, mode, n, t, h):
    """One step of the table's method from w.y, whose flow is in w.k[0]; returns the error over the
    tolerance.

    w.f[LAMBDA] becomes h·|λ|, as far as the last two stages, both at t + h, tell (Hairer and
    Wanner, IV.2); in every fourth step, else 0.
    """
    k, y, y_new, y_try, err = w.k, w.y, w.y_new, w.y_try, w.err
    a_from, a_column, a_value, c = w.a_from, w.a_column, w.a_value, w.c
    stages, unseen = w.i[STAGES], w.i[UNSEEN]
    every, sliding = 0.0, w.i[SLIDING] == 1
    for stage in range(1, stages):
        combine(n, a_from[stage], a_from[stage + 1], a_column, a_value, k, h, y, y_try)
        if sliding:
            rates(model, w, mode, n, t + c[stage] * h, y_try, p, k[stage])
        else:
            flow(model, mode, t + c[stage] * h, y_try, p, k[stage])
        if stage < unseen:
            for i in range(n):
                every += k[stage][i]
    if w.i[ADAPTIVE] == 0:  # many steps: what each rounds off is kept for the next one (Kahan 1965)
        combine(n, a_from[stages], a_from[stages + 1], a_column, a_value, k, h, w.zero, err[0])
        for i in range(n):
            step = err[0][i] + w.lost[i]
            y_new[i] = y[i] + step
            err[0][i] = step - (y_new[i] - y[i])
    else:
        combine(n, a_from[stages], a_from[stages + 1], a_column, a_value, k, h, y, y_new)
    rates(model, w, mode, n, t + h, y_new, p, k[stages])
    w.i[FLOWS] += stages
    if not isfinite(every):  # the error tells of the other stages
        return 1e300
    if w.i[ADAPTIVE] == 0:
        for i in range(n):
            if not isfinite(y_new[i]):
                return 1e300
        return 0.0
    for part in range(1 + w.i[TWO]):
        begin, end = w.e_from[part], w.e_from[part + 1]
        combine(n, begin, end, w.e_column, w.e_value, k, 1.0, w.zero, err[part])
    asked = w.i[STEPS] & 3 == 0
    high, low, slopes, places = 0.0, 0.0, 0.0, 0.0
    fine, coarse, last, before = err[0], err[1], k[stages], k[stages - 1]
    for i in range(n):
        scale = allowed(w, mode, i, max(abs(y[i]), abs(y_new[i])), h)
        one, two = fine[i] / scale, coarse[i] / scale
        high += one * one
        low += two * two
        if asked:
            one, two = last[i] - before[i], y_new[i] - y_try[i]
            slopes += (one / scale) * (one / scale)
            places += (two / scale) * (two / scale)
    w.f[LAMBDA] = h * sqrt(slopes / places) if 0.0 < places < 1e290 and slopes < 1e290 else 0.0
    if w.i[TWO] == 1:  # DOP853 weighs its fifth- and third-order estimates (ibid., II.10)
        if high == 0.0 and low == 0.0:
            return 0.0
        return h * high / sqrt((high + 0.01 * low) * n)
    return h * sqrt(high / n)


def interpolate(model, w, p, mode, n, t, h):
    """The step's polynomial into w.poly; DOP853 needs three more evaluations for it."""
    k, y, y_try, zero, poly, term = w.k, w.y, w.y_try, w.zero, w.poly, w.term
    a_from, a_column, a_value = w.a_from, w.a_column, w.a_value
    for stage in range(w.i[STAGES] + 1, w.i[ROWS]):
        combine(n, a_from[stage], a_from[stage + 1], a_column, a_value, k, h, y, y_try)
        rates(model, w, mode, n, t + w.c[stage] * h, y_try, p, k[stage])
        w.i[FLOWS] += 1
    degree, powers = w.i[DEGREE], w.i[POWERS] == 1  # the terms are the powers of θ already
    begin, column, value = w.w_from, w.w_column, w.w_value
    for d in range(degree):
        out = poly[d + 1] if powers else term[d]
        combine(n, begin[d], begin[d + 1], column, value, k, h, zero, out)
    for i in range(n):
        poly[0][i] = y[i]
    if not powers:
        begin, column, value = w.q_from, w.q_column, w.q_value
        for d in range(degree):
            combine(n, begin[d], begin[d + 1], column, value, term, 1.0, zero, poly[d + 1])


def evaluate(w, n, theta, out):
    """The state at θ of the current step into out (Horner)."""
    poly, degree = w.poly, w.i[DEGREE]
    i = 0
    while i + 1 < n:
        j = i + 1
        one, two = poly[degree][i], poly[degree][j]
        for d in range(degree - 1, -1, -1):
            power = poly[d]
            one = one * theta + power[i]
            two = two * theta + power[j]
        out[i], out[j] = one, two
        i += 2
    if i < n:
        one = poly[degree][i]
        for d in range(degree - 1, -1, -1):
            one = one * theta + poly[d][i]
        out[i] = one


def feel(model, w, p, mode, n, t):
    """w.terms[mode]: the size of what each derivative is made of, Σ|∂f/∂yⱼ·yⱼ|; w.ticks[mode]: what
    the clock's rounding does to it, by |∂f/∂t·t|. Anew where a state has grown eightfold.

    yⱼ is the largest size so far; w.k[0] is the flow.
    """
    terms, felt, ticks = w.terms[mode], w.felt[mode], w.ticks[mode]
    larger = False
    for j in range(n):
        if w.most[j] > 8.0 * felt[j]:
            larger = True
    if not larger:
        return
    e = max(1e-6 * w.f[H], 1e3 * EPS * abs(t))
    rates(model, w, mode, n, t + e, w.y, p, w.err[0])
    w.i[FLOWS] += 1
    for i in range(n):
        change = 8.0 * EPS * abs((w.err[0][i] - w.k[0][i]) / e * t)
        w.y_try[i], terms[i], ticks[i] = w.y[i], 0.0, change if isfinite(change) else 0.0
    for j in range(n):
        felt[j] = w.most[j]
        if w.most[j] != 0.0:
            w.y_try[j] = w.y[j] + 1e-6 * w.most[j]
            rates(model, w, mode, n, t, w.y_try, p, w.err[0])
            w.i[FLOWS] += 1
            w.y_try[j] = w.y[j]
            for i in range(n):
                moved = abs(w.err[0][i] - w.k[0][i])
                if isfinite(moved):
                    terms[i] += 1e6 * moved


def first_step(model, w, p, mode, n):
    """A step to begin with (Hairer, Nørsett, Wanner, II.4), from w.k[0]."""
    t = w.f[T]
    span = min(w.f[T_END] - t, w.f[MAX_STEP])
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(n):
        scale = allowed(w, mode, i, abs(w.y[i]), 0.0)
        if w.y[i] != 0.0:  # a state that starts from zero has no size yet
            d0 += (w.y[i] / scale) * (w.y[i] / scale)
            d1 += min(1e280, (w.k[0][i] / scale) * (w.k[0][i] / scale))
    d0, d1 = sqrt(d0 / n), sqrt(d1 / n)
    h0 = 1e-6 * span if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(max(h0, 1e-9 * span), span)
    for i in range(n):
        w.y_try[i] = w.y[i] + h0 * w.k[0][i]
    rates(model, w, mode, n, t + h0, w.y_try, p, w.k[1])
    w.i[FLOWS] += 1
    for i in range(n):  # its size is what it is moved by to begin with
        w.most[i] = max(w.most[i], h0 * abs(w.k[0][i]))
        if w.most[i] == 0.0 and isfinite(w.k[1][i]):
            w.most[i] = h0 * abs(w.k[1][i])
    sized(w, mode, n)
    for i in range(n):
        scale = allowed(w, mode, i, abs(w.y[i]), h0)
        change = (w.k[1][i] - w.k[0][i]) / scale
        d2 += change * change
    d2 = sqrt(d2 / n) / h0
    if not isfinite(d2):
        return h0 * 1e-3
    if d1 <= 1e-15 and d2 <= 1e-15:
        h1 = max(1e-6 * span, h0 * 1e-3)
    else:
        h1 = (0.01 / max(d1, d2)) ** (1.0 / w.i[ORDER])
    return min(100.0 * h0, h1, span)
