"""heyoka: Taylor series compiled for the model and the tolerance, terminal events with callbacks
that flip parameters.

One integrator a problem, made once; a run sets time, state and parameters back. What decides about
a mode is a parameter of the right side, so that no integrator is exchanged, and no event is a false
alarm.
"""

import heyoka as hy

from .contest import Answer, Contestant
from .problems import Problem


def event(expression, act, direction):
    return hy.t_event(expression, callback=act, direction=getattr(hy.event_direction, direction))


class Taylor:
    """An integrator with its events and a list of their instants.

    Each problem adds its own equations and callbacks.
    """

    def __init__(self, equations, start, tol, events=(), parameters=()):
        self.begin, self.settings, self.instants = tuple(start), tuple(parameters), []
        options = {"pars": list(parameters)} if parameters else {}
        self.ta = hy.taylor_adaptive(
            equations, list(start), tol=tol, t_events=list(events), **options
        )
        self.state, self.pars = self.ta.state, self.ta.pars

    def restart(self):
        self.ta.time = 0.0
        self.state[:] = self.begin
        if self.settings:
            self.pars[:] = self.settings
        self.instants.clear()
        self.ta.reset_cooldowns()

    def sample(self, start, parameters, grid):
        """States on a grid from another start."""
        self.begin, self.settings = start, parameters
        self.restart()
        return self.ta.propagate_grid(grid)[-1]

    def run(self, t_end):
        self.restart()
        self.ta.propagate_until(t_end)
        return Answer(self.state.tolist(), list(self.instants))


def spiral(p, start, tol):
    s1, s2 = hy.make_vars("s1", "s2")
    ta = hy.taylor_adaptive(
        [(s1, p.alpha * s1 + p.beta * s2 + p.b1), (s2, p.alpha * s2 - p.beta * s1 + p.b2)],
        list(start),
        tol=tol,
    )

    def run(t_end):
        ta.time = 0.0
        ta.state[:] = start
        ta.propagate_until(t_end)
        return Answer(ta.state.tolist(), [])

    return run


def ball(p, start, tol):
    y, v = hy.make_vars("y", "v")

    def bounce(ta, sign):
        taylor.state[0] = 0.0
        taylor.state[1] *= -p.e
        taylor.instants.append(ta.time)
        return True

    taylor = Taylor([(y, v), (v, hy.expression(-p.g))], start, tol, [event(y, bounce, "negative")])
    return taylor.run


def relay(p, start, tol):
    x, v = hy.make_vars("x", "v")
    push = hy.par[0]

    def up(ta, sign):
        taylor.pars[0] = -p.K
        taylor.instants.append(ta.time)
        return True

    def down(ta, sign):
        taylor.pars[0] = p.K
        taylor.instants.append(ta.time)
        return True

    def turn(ta, sign):
        if ta.time == 0.0:  # the start, at rest, is no turn
            return True
        place = taylor.state[0]
        if sign > 0:  # to the right from now on
            taylor.pars[0] = p.K if place < p.a else -p.K
        else:
            taylor.pars[0] = -p.K if place > -p.a else p.K
        taylor.instants.append(ta.time)
        return True

    events = [
        event(x - p.a, up, "positive"),
        event(x + p.a, down, "negative"),
        event(v, turn, "any"),
    ]
    taylor = Taylor(
        [(x, v), (v, (p.h * hy.sin(p.w * hy.time) + push) / p.mu)], start, tol, events, [p.K]
    )
    return taylor.run


def stick_slip(p, start, tol):
    x, V = hy.make_vars("x", "V")
    slips, slow = hy.par[0], hy.par[1]

    def change(ta, sign):
        taylor.pars[:] = 1.0 - taylor.pars[0], 1.0
        taylor.state[1] = 0.0
        taylor.instants.append(ta.time)
        return True

    def kink(ta, sign):
        taylor.pars[1] = 0.0 if sign > 0 else 1.0
        return True

    # One event for release and stop: its cool-down hides that the speed is zero at the release
    events = [
        event(slips * V + (1.0 - slips) * (p.Fs - p.k * x), change, "negative"),
        event(V - p.V0, kink, "any"),
    ]
    friction = p.Fc + slow * (p.Fs - p.Fc) * (1.0 - V / p.V0) ** 2
    taylor = Taylor(
        [(x, p.Vp - V), (V, slips * (p.k * x - friction) / p.m)], start, tol, events, [0.0, 1.0]
    )
    return taylor.run


def boost(p, start, tol):
    i, v = hy.make_vars("i", "v")
    conducts, blocked = hy.par[0], hy.par[1]
    a, b = 1 / ((p.R + p.RC) * p.C), p.R / (p.R + p.RC)

    def blocks(ta, sign):
        taylor.state[0] = 0.0
        taylor.pars[:] = 0.0, 0.0
        taylor.instants.append(ta.time)
        return True

    equations = [
        (i, blocked * (p.E - p.RL * i - conducts * b * (v + p.RC * i)) / p.L),
        (v, a * (conducts * p.R * i - v)),
    ]
    taylor = Taylor(equations, start, tol, [event(i, blocks, "negative")], [0.0, 1.0])

    def run(t_end):
        taylor.restart()
        until, pars, instants = taylor.ta.propagate_until, taylor.pars, taylor.instants
        for k in range(round(t_end / p.Ts)):
            begin, middle = k * p.Ts, k * p.Ts + p.d * p.Ts
            if k:
                instants.append(begin)
            pars[:] = 0.0, 1.0
            until(middle)
            instants.append(middle)
            pars[0] = 1.0
            until((k + 1) * p.Ts)
        return Answer(taylor.state.tolist(), list(instants))

    return run


def contestants(problem: Problem) -> list[Contestant]:
    build = {
        "spiral": spiral,
        "ball": ball,
        "relay": relay,
        "stick_slip": stick_slip,
        "boost": boost,
    }[problem.name]

    def make(tol):
        run = build(problem.p, problem.start, tol)
        return lambda: run(problem.t_end)

    return [Contestant("heyoka", "Taylor", make)]
