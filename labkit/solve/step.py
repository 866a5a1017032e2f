"""One step: the explicit Runge–Kutta step, its error, its polynomial.

    error = explicit_step(model, w, p, mode, n, t, h)      # w.y -> w.y_new; accepted when error < 1
    interpolate(model, w, p, mode, n, t, h)                # w.poly
    evaluate(w, n, theta, out)
"""

from math import isfinite, sqrt

from .layout import *
from .sliding import rates


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
        rates(model, w, mode, n, t + w.c[row] * h, y_try, p, k[row])
    for i in range(n):
        total = 0.0
        for row in range(stages):
            total += w.b[row] * k[row][i]
        y_new[i] = y[i] + h * total
    rates(model, w, mode, n, t + h, y_new, p, k[stages])
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
        rates(model, w, mode, n, t + w.c[row] * h, y_try, p, k[row])
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
