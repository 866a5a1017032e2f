"""CyRK, twice: its pysolve_ivp with its own events, and its solver called from a hybrid solver
written for the purpose.

"CyRK": pysolve_ivp with compiled right sides, terminal events and a restart loop. "CyRK, own loop":
nbsolve2_ivp inside loops that Numba compiles. It has no events, so the loop integrates a stretch
with dense output, looks for a change of sign at the steps, finds the root on the dense output
(Illinois) and starts again there. The length of the stretch is chosen for each problem so that
little work is thrown away. That is the fastest form, and it is no longer a call of a tool: event
location is the user's own program.
"""

from functools import cache

import numpy as np
from CyRK import cyjit, nbsolve2_ivp, pysolve_ivp
from numba import njit

from .contest import ENOUGH, Answer, Contestant
from .problems import Problem

OWN_LOOP = "CyRK, own loop"
METHODS = ("RK45", "DOP853", "Tsit5", "Vern7", "Vern8")


@cache
def both(function):
    """One right side, function(dy, t, y, p), as the C function that nbsolve2_ivp takes and as the
    one that pysolve_ivp calls.
    """
    return cyjit(function).address, njit(function)


@njit
def chase(address, p, guard, t, y, t_end, stretch, method, tol):
    """(t, state, True) where guard(y, p) first falls through zero after t, or (t_end, state,
    False).
    """
    while t < t_end:
        until = min(t + stretch, t_end)
        run = nbsolve2_ivp(
            address, (t, until), y, method=method, dense_output=True, args=p, rtol=tol, atol=tol
        )
        ts, ys = run.t, run.y
        before = guard(ys[:, 0], p)
        for k in range(1, len(ts)):
            after = guard(ys[:, k], p)
            if before > 0.0 and after <= 0.0:
                a, b, ga, gb, side = ts[k - 1], ts[k], before, after, 0
                while abs(b - a) > 1e-14 * abs(b):
                    middle = (a * gb - b * ga) / (gb - ga)
                    if not a < middle < b:  # one end is as good as the root
                        a = b = a if abs(ga) < abs(gb) else b
                        break
                    g = guard(run.call(middle)[:, 0], p)
                    if g == 0.0:
                        a = b = middle
                    elif g > 0.0:
                        a, ga, gb, side = middle, g, gb / 2 if side == 1 else gb, 1
                    else:
                        b, gb, ga, side = middle, g, ga / 2 if side == -1 else ga, -1
                found = run.call(b)[:, 0].copy()
                run.free()
                return b, found, True
            before = after
        y = ys[:, -1].copy()
        t = until
        run.free()
    return t_end, y, False


@njit
def last(address, p, t, y, t_end, method, tol, first_step=0.0):
    """State at t_end."""
    run = nbsolve2_ivp(
        address, (t, t_end), y, method=method, args=p, rtol=tol, atol=tol, first_step=first_step
    )
    end = run.y[:, -1].copy()
    run.free()
    return end


def terminal(function, direction):
    function.terminal, function.direction = True, direction
    return function


# ---------------------------------------------------------------- spiral


def spiral_flow(dy, t, y, p):
    dy[0] = p[0] * y[0] + p[1] * y[1] + p[2]
    dy[1] = p[0] * y[1] - p[1] * y[0] + p[3]


def spiral(p, start, t_end, nb, method, tol):
    address, flow = both(spiral_flow)
    args = np.array([p.alpha, p.beta, p.b1, p.b2])
    if nb:
        return lambda: Answer(last(address, args, 0.0, start, t_end, method, tol), [])
    return lambda: Answer(
        pysolve_ivp(
            flow,
            (0.0, t_end),
            start,
            method=method,
            args=(args,),
            rtol=tol,
            atol=tol,
            pass_dy_as_arg=True,
        ).y[:, -1],
        [],
    )


# ---------------------------------------------------------------- ball


def fall(dy, t, y, p):
    dy[0] = y[1]
    dy[1] = -p[0]


@njit
def height(y, p):
    return y[0]


@njit
def ball_loop(address, p, y, t_end, method, tol):
    t, instants = 0.0, []
    while len(instants) < ENOUGH:
        t, y, hit = chase(address, p, height, t, y, t_end, 3.0, method, tol)
        if not hit:
            break
        instants.append(t)
        y[0], y[1] = 0.0, -p[1] * y[1]
    return y, instants


def ball(p, start, t_end, nb, method, tol):
    address, flow = both(fall)
    args = np.array([p.g, p.e])
    if nb:
        return lambda: Answer(*ball_loop(address, args, start, t_end, method, tol))
    ground = terminal(lambda t, y, p: y[0], -1)

    def run():
        t, y, instants = 0.0, start, []
        while len(instants) < ENOUGH:
            piece = pysolve_ivp(
                flow,
                (t, t_end),
                y,
                method=method,
                args=(args,),
                rtol=tol,
                atol=tol,
                events=(ground,),
                pass_dy_as_arg=True,
            )
            if not piece.event_terminated:
                return Answer(piece.y[:, -1], instants)
            t = piece.t_events[0][-1]
            y = np.array([0.0, -p.e * piece.y[1, -1]])
            instants.append(t)
        return Answer(y, instants)

    return run


# ---------------------------------------------------------------- relay


def relay_flow(dy, t, y, p):
    dy[0] = y[1]
    dy[1] = (p[1] * np.sin(p[2] * t) + p[5]) / p[0]


@njit
def turn_or_switch(y, p):
    """Falls through zero at the turn, or, while the relay drives, at the switch before it."""
    if p[5] * p[6] > 0.0:
        return min(p[6] * y[1], p[4] - p[6] * y[0])
    return p[6] * y[1]


@njit
def relay_loop(address, p, y, t_end, method, tol):
    """p: mu, h, w, K, a, push of the relay, way of the motion."""
    t, instants = 0.0, []
    p = p.copy()
    while True:
        t, y, hit = chase(address, p, turn_or_switch, t, y, t_end, 2.0, method, tol)
        if not hit:
            return y, instants
        instants.append(t)
        if p[5] * p[6] > 0.0 and p[6] * y[1] > p[4] - p[6] * y[0]:  # the switch
            p[5] = -p[5]
        else:
            p[6] = -p[6]
            p[5] = p[3] * p[6] if p[6] * y[0] < p[4] else -p[3] * p[6]


def relay(p, start, t_end, nb, method, tol):
    address, flow = both(relay_flow)
    args = np.array([p.mu, p.h, p.w, p.K, p.a, p.K, 1.0])
    if nb:
        return lambda: Answer(*relay_loop(address, args, start, t_end, method, tol))
    turns = {1: terminal(lambda t, y, q: y[1], -1), -1: terminal(lambda t, y, q: y[1], 1)}
    switches = {
        1: terminal(lambda t, y, q: y[0] - p.a, 1),
        -1: terminal(lambda t, y, q: y[0] + p.a, -1),
    }

    def run():
        q, t, y, way, driven, instants = args.copy(), 0.0, start, 1, True, []
        while True:
            q[5] = p.K * way if driven else -p.K * way
            events = (turns[way], switches[way]) if driven else (turns[way],)
            piece = pysolve_ivp(
                flow,
                (t, t_end),
                y,
                method=method,
                args=(q,),
                rtol=tol,
                atol=tol,
                events=events,
                pass_dy_as_arg=True,
            )
            if not piece.event_terminated:
                return Answer(piece.y[:, -1], instants)
            which = piece.event_terminate_index
            t, y = piece.t_events[which][-1], piece.y_events[which][:, -1].copy()
            instants.append(t)
            if which == 0:
                way = -way
                driven = way * y[0] < p.a
            else:
                driven = False

    return run


# ---------------------------------------------------------------- stick-slip


def slip_flow(dy, t, y, p):
    """p: m, k, Vp, Fs, Fc, V0, 1 while it slips.

    The square is held beyond V = −0.2, or a stretch past the stop would run off to infinity.
    """
    friction = p[4]
    if y[1] < p[5]:
        friction += (p[3] - p[4]) * (1.0 - max(y[1], -0.2) / p[5]) ** 2
    dy[0] = p[2] - y[1]
    dy[1] = p[6] * (p[1] * y[0] - friction) / p[0]


@njit
def hold_or_speed(y, p):
    return y[1] if p[6] > 0.0 else p[3] - p[1] * y[0]


@njit
def stick_slip_loop(address, p, y, t_end, method, tol):
    t, instants = 0.0, []
    p = p.copy()
    while True:
        t, y, hit = chase(address, p, hold_or_speed, t, y, t_end, 1.5, method, tol)
        if not hit:
            return y, instants
        instants.append(t)
        y[1] = 0.0
        p[6] = 1.0 - p[6]


def stick_slip(p, start, t_end, nb, method, tol):
    address, flow = both(slip_flow)
    args = np.array([p.m, p.k, p.Vp, p.Fs, p.Fc, p.V0, 0.0])
    if nb:
        return lambda: Answer(*stick_slip_loop(address, args, start, t_end, method, tol))
    loose, stop = terminal(lambda t, y, q: p.k * y[0] - p.Fs, 1), terminal(lambda t, y, q: y[1], -1)

    def run():
        q, t, y, instants = args.copy(), 0.0, start, []
        while True:
            event = stop if q[6] else loose
            piece = pysolve_ivp(
                flow,
                (t, t_end),
                y,
                method=method,
                args=(q,),
                rtol=tol,
                atol=tol,
                events=(event,),
                pass_dy_as_arg=True,
            )
            if not piece.event_terminated:
                return Answer(piece.y[:, -1], instants)
            t, y = piece.t_events[0][-1], np.array([piece.y[0, -1], 0.0])
            instants.append(t)
            q[6] = 1.0 - q[6]

    return run


# ---------------------------------------------------------------- boost


def boost_flow(dy, t, y, p):
    """p: E, L, RL, 1/((R + RC)C), R/(R + RC), RC, R, 1 while the diode conducts, 0 while both
    block.
    """
    dy[0] = p[8] * (p[0] - p[2] * y[0] - p[7] * p[4] * (y[1] + p[5] * y[0])) / p[1]
    dy[1] = p[3] * (p[7] * p[6] * y[0] - y[1])


@njit
def current(y, p):
    return y[0]


@njit
def boost_loop(address, p, y, Ts, d, cycles, method, tol):
    instants = []
    p = p.copy()
    for k in range(cycles):
        begin, middle, end = k * Ts, k * Ts + d * Ts, (k + 1) * Ts
        p[7], p[8] = 0.0, 1.0
        if k:
            instants.append(begin)
        y = last(
            address, p, begin, y, middle, method, tol, 0.49 * (middle - begin)
        )  # the longest that is allowed
        instants.append(middle)
        p[7] = 1.0
        ahead = last(address, p, middle, y, end, method, tol, 0.49 * (end - middle))
        if ahead[0] > 0.0:  # the usual case, without dense output
            y = ahead
            continue
        t, y, hit = chase(address, p, current, middle, y, end, Ts, method, tol)
        instants.append(t)
        y[0], p[7], p[8] = 0.0, 0.0, 0.0
        y = last(address, p, t, y, end, method, tol)
    return y, instants


def boost(p, start, t_end, nb, method, tol):
    address, flow = both(boost_flow)
    args = np.array(
        [p.E, p.L, p.RL, 1 / ((p.R + p.RC) * p.C), p.R / (p.R + p.RC), p.RC, p.R, 0.0, 1.0]
    )
    cycles = round(t_end / p.Ts)
    if nb:
        return lambda: Answer(*boost_loop(address, args, start, p.Ts, p.d, cycles, method, tol))
    blocks = terminal(lambda t, y, q: y[0], -1)

    def run():
        q, y, instants = args.copy(), start, []
        options = {"method": method, "args": (q,), "rtol": tol, "atol": tol, "pass_dy_as_arg": True}
        for k in range(cycles):
            begin, middle, end = k * p.Ts, k * p.Ts + p.d * p.Ts, (k + 1) * p.Ts
            q[7], q[8] = 0.0, 1.0
            y = pysolve_ivp(flow, (begin, middle), y, **options).y[:, -1].copy()
            q[7] = 1.0
            instants += (begin, middle) if k else (middle,)
            piece = pysolve_ivp(flow, (middle, end), y, events=(blocks,), **options)
            y = piece.y[:, -1].copy()
            if piece.event_terminated:
                instants.append(piece.t_events[0][-1])
                y[0], q[7], q[8] = 0.0, 0.0, 0.0
                y = pysolve_ivp(flow, (instants[-1], end), y, **options).y[:, -1].copy()
        return Answer(y, instants)

    return run


def contestants(problem: Problem) -> list[Contestant]:
    build = {
        "spiral": spiral,
        "ball": ball,
        "relay": relay,
        "stick_slip": stick_slip,
        "boost": boost,
    }[problem.name]

    def make(nb: bool, method: str):
        return lambda tol: build(problem.p, np.array(problem.start), problem.t_end, nb, method, tol)

    return [
        Contestant(tool, method, make(tool == OWN_LOOP, method))
        for tool in ("CyRK", OWN_LOOP)
        for method in METHODS
    ]
