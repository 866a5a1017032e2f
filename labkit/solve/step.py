"""One step: the explicit Runge–Kutta step, its error, its polynomial.

error = explicit_step(model, w, p, mode, n, t, h)      # w.y -> w.y_new; accepted when error < 1
interpolate(model, w, p, mode, n, t, h)                # w.poly
evaluate(w, n, theta, out)
"""

from math import isfinite, sqrt

from .layout import *
from .sliding import rates


def combine(n, first, last, column, value, rows, h, y, out):
    """out = y + h·Σ value[q]·rows[column[q]], q from first to last: a sparse row of a table times the stages, two states at a time."""
    i = 0
    while i + 1 < n:
        one, two = 0.0, 0.0
        for q in range(first, last):
            factor, k = value[q], rows[column[q]]
            one += factor * k[i]
            two += factor * k[i + 1]
        out[i] = y[i] + h * one
        out[i + 1] = y[i + 1] + h * two
        i += 2
    if i < n:
        one = 0.0
        for q in range(first, last):
            one += value[q] * rows[column[q]][i]
        out[i] = y[i] + h * one


def explicit_step(model, w, p, mode, n, t, h):
    """One step of the table's method from w.y, whose flow is in w.k[0]; returns the error over the tolerance."""
    k, y, y_new, err = w.k, w.y, w.y_new, w.err
    a_from, a_column, a_value = w.a_from, w.a_column, w.a_value
    stages = w.i[STAGES]
    for stage in range(1, stages):
        combine(n, a_from[stage], a_from[stage + 1], a_column, a_value, k, h, y, w.y_try)
        rates(model, w, mode, n, t + w.c[stage] * h, w.y_try, p, k[stage])
    combine(n, a_from[stages], a_from[stages + 1], a_column, a_value, k, h, y, y_new)
    rates(model, w, mode, n, t + h, y_new, p, k[stages])
    w.i[FLOWS] += stages
    if w.i[ADAPTIVE] == 0:
        for i in range(n):
            if not isfinite(y_new[i]):
                return 1e300
        return 0.0
    rtol, atol = w.f[RTOL], w.f[ATOL]
    for part in range(1 + w.i[TWO]):
        combine(
            n, w.e_from[part], w.e_from[part + 1], w.e_column, w.e_value, k, 1.0, w.zero, err[part]
        )
    high, low = 0.0, 0.0
    for i in range(n):
        scale = atol + rtol * max(abs(y[i]), abs(y_new[i]))
        high += (err[0][i] / scale) * (err[0][i] / scale)
        low += (err[1][i] / scale) * (err[1][i] / scale)
    if (
        w.i[TWO] == 1
    ):  # DOP853 weighs its fifth- and third-order estimates (Hairer, Nørsett, Wanner, II.10)
        if high == 0.0 and low == 0.0:
            return 0.0
        return h * high / sqrt((high + 0.01 * low) * n)
    return h * sqrt(high / n)


def interpolate(model, w, p, mode, n, t, h):
    """The step's polynomial into w.poly; DOP853 needs three more evaluations for it."""
    k = w.k
    for stage in range(w.i[STAGES] + 1, w.i[ROWS]):
        combine(n, w.a_from[stage], w.a_from[stage + 1], w.a_column, w.a_value, k, h, w.y, w.y_try)
        rates(model, w, mode, n, t + w.c[stage] * h, w.y_try, p, k[stage])
        w.i[FLOWS] += 1
    degree, powers = w.i[DEGREE], w.i[POWERS] == 1  # the terms are the powers of θ already
    for d in range(degree):
        combine(
            n,
            w.w_from[d],
            w.w_from[d + 1],
            w.w_column,
            w.w_value,
            k,
            h,
            w.zero,
            w.poly[d + 1] if powers else w.term[d],
        )
    for i in range(n):
        w.poly[0][i] = w.y[i]
    for d in range(0 if powers else degree):
        combine(
            n,
            w.q_from[d],
            w.q_from[d + 1],
            w.q_column,
            w.q_value,
            w.term,
            1.0,
            w.zero,
            w.poly[d + 1],
        )


def evaluate(w, n, theta, out):
    """The state at θ of the current step into out (Horner)."""
    poly, degree = w.poly, w.i[DEGREE]
    i = 0
    while i + 1 < n:
        one, two = poly[degree][i], poly[degree][i + 1]
        for d in range(degree - 1, -1, -1):
            power = poly[d]
            one = one * theta + power[i]
            two = two * theta + power[i + 1]
        out[i], out[i + 1] = one, two
        i += 2
    if i < n:
        one = poly[degree][i]
        for d in range(degree - 1, -1, -1):
            one = one * theta + poly[d][i]
        out[i] = one


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
    rates(model, w, mode, n, t + h0, w.y_try, p, w.k[1])
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
