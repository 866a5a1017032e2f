"""SciPy's solve_ivp: terminal events and a restart loop, right sides on plain floats, nothing
stored that is not asked for.
"""

from collections.abc import Callable
from math import sin

from scipy.integrate import solve_ivp

from .contest import ENOUGH, Answer, Contestant
from .problems import Problem

METHODS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")


def event(function: Callable, direction: int) -> Callable:
    function.terminal, function.direction = True, direction
    return function


def go(flow, t, t_end, y, events, options, samples=None):
    """One piece: (end time, state, index of the event that ended it or None).

    `samples` is (grid, list of arrays to fill).
    """
    if samples is not None:
        grid, out = samples
        options = {**options, "t_eval": grid[grid.searchsorted(t) :]}
    run = solve_ivp(flow, (t, t_end), y, events=events, **options)
    if samples is not None:
        out.append(run.y)
    if run.status != 1:
        return t_end, run.y[:, -1], None
    which = next(k for k, instants in enumerate(run.t_events) if len(instants))
    return run.t_events[which][0], run.y_events[which][0], which


def spiral(p, t_end, y, options):
    def flow(t, y):
        s1, s2 = y.tolist()
        return p.alpha * s1 + p.beta * s2 + p.b1, p.alpha * s2 - p.beta * s1 + p.b2

    return Answer(solve_ivp(flow, (0.0, t_end), y, **options).y[:, -1], [])


def ball(p, t_end, y, options):
    g = p.g

    def flow(t, y):
        return y[1], -g

    ground = event(lambda t, y: y[0], -1)
    t, instants = 0.0, []
    while len(instants) < ENOUGH:
        t, y, hit = go(flow, t, t_end, y, ground, options)
        if hit is None:
            break
        y = 0.0, -p.e * y[1]
        instants.append(t)
    return Answer(y, instants)


def relay(p, t_end, y, options, samples=None):
    mu, h, w, K, a = p.mu, p.h, p.w, p.K, p.a

    def left(t, y):
        return y[1], (h * sin(w * t) - K) / mu

    def right(t, y):
        return y[1], (h * sin(w * t) + K) / mu

    turns = {1: event(lambda t, y: y[1], -1), -1: event(lambda t, y: y[1], 1)}
    switches = {1: event(lambda t, y: y[0] - a, 1), -1: event(lambda t, y: y[0] + a, -1)}
    t, way, instants = 0.0, 1 if y[1] >= 0 else -1, []
    driven = way * y[0] < a
    while True:
        flow = right if (way == 1) == driven else left
        t, y, which = go(
            flow,
            t,
            t_end,
            y,
            (turns[way], switches[way]) if driven else turns[way],
            options,
            samples,
        )
        if which is None:
            return Answer(y, instants)
        instants.append(t)
        if which == 0:
            way = -way
            driven = way * y[0] < a
        else:
            driven = False


def stick_slip(p, t_end, y, options, samples=None):
    m, k, Vp, Fs, Fc, V0 = p.m, p.k, p.Vp, p.Fs, p.Fc, p.V0

    def stick(t, y):
        return Vp, 0.0

    def slip(t, y):
        x, V = y.tolist()
        return Vp - V, (k * x - (Fc + (Fs - Fc) * (1 - V / V0) ** 2 if V < V0 else Fc)) / m

    loose, stop = event(lambda t, y: k * y[0] - Fs, 1), event(lambda t, y: y[1], -1)
    t, sticks, instants = 0.0, y[1] == 0.0, []
    while True:
        t, y, hit = go(
            stick if sticks else slip, t, t_end, y, loose if sticks else stop, options, samples
        )
        if hit is None:
            return Answer(y, instants)
        sticks = not sticks
        y = y[0], 0.0
        instants.append(t)


def boost(p, t_end, y, options):
    E, L, RL, Ts = p.E, p.L, p.RL, p.Ts
    a, b, c = 1 / ((p.R + p.RC) * p.C), p.R / (p.R + p.RC), p.RC

    def on(t, y):
        i, v = y.tolist()
        return (E - RL * i) / L, -a * v

    def diode(t, y):
        i, v = y.tolist()
        return (E - RL * i - b * (v + c * i)) / L, a * (p.R * i - v)

    def off(t, y):
        return 0.0, -a * y[1]

    blocks = event(lambda t, y: y[0], -1)
    instants = []
    for k in range(round(t_end / Ts)):
        begin, middle, end = k * Ts, k * Ts + p.d * Ts, (k + 1) * Ts
        whole = (
            {}
            if options["method"] == "LSODA"
            else {"first_step": min(middle - begin, end - middle)}
        )  # one step will often do
        y = solve_ivp(on, (begin, middle), y, **options, **whole).y[:, -1]
        run = solve_ivp(diode, (middle, end), y, events=blocks, **options, **whole)
        y = run.y[:, -1]
        instants += (begin, middle) if k else (middle,)
        if run.status == 1:
            instants.append(run.t[-1])
            y = solve_ivp(off, (run.t[-1], end), (0.0, y[1]), **options).y[:, -1]
    return Answer(y, instants)


def contestants(problem: Problem) -> list[Contestant]:
    solver = {
        "spiral": spiral,
        "ball": ball,
        "relay": relay,
        "stick_slip": stick_slip,
        "boost": boost,
    }[problem.name]

    def make(method: str):
        return lambda tol: (
            lambda: solver(
                problem.p,
                problem.t_end,
                problem.start,
                {"method": method, "rtol": tol, "atol": tol},
            )
        )

    return [Contestant("solve_ivp", method, make(method)) for method in METHODS]
