"""PathSim: one ODE block, zero-crossing events and schedules that act on it.

No connections, since every block costs time.
"""

from math import sin

import numpy as np
from pathsim import Simulation
from pathsim.blocks import ODE
from pathsim.events import Schedule, ZeroCrossingDown, ZeroCrossingUp
from pathsim.exceptions import StopSimulation
from pathsim.solvers import RKCK54, RKDP54, RKDP87, RKV65

from .contest import ENOUGH, Answer, Contestant
from .problems import Problem

SOLVERS = {"RKCK54": RKCK54, "RKDP54": RKDP54, "RKV65": RKV65, "RKDP87": RKDP87}


class Model:
    """The block, and what its events share: a list of their instants and a few switches."""

    def __init__(self, flow, start):
        self.block = ODE(flow, np.array(start))
        self.events: list = []
        self.instants: list[float] = []

    @property
    def state(self):
        return self.block.engine.state

    def when(self, kind, guard, act, tol):
        def note(t):
            if act(t) is not False:
                self.instants.append(t)
            if len(self.instants) > ENOUGH:
                raise StopSimulation

        self.events.append(kind(func_evt=guard, func_act=note, tolerance=tol))

    def every(self, period, first, act):
        def note(t):
            act(t)
            self.instants.append(t)

        self.events.append(Schedule(t_start=first, t_period=period, func_act=note))

    def solve(self, t_end, solver, tol):
        simulation = Simulation(
            [self.block],
            [],
            self.events,
            dt=None,
            Solver=solver,
            tolerance_lte_abs=tol,
            tolerance_lte_rel=tol,
            log=False,
        )
        simulation.run(t_end)
        return Answer(self.state, self.instants)


def spiral(p, start, tol):
    return Model(
        lambda s, u, t: np.array(
            [p.alpha * s[0] + p.beta * s[1] + p.b1, p.alpha * s[1] - p.beta * s[0] + p.b2]
        ),
        start,
    )


def ball(p, start, tol):
    model = Model(lambda s, u, t: np.array([s[1], -p.g]), start)

    def bounce(t):
        model.block.engine.state = np.array([0.0, -p.e * model.state[1]])

    model.when(ZeroCrossingDown, lambda t: model.state[0], bounce, tol)
    return model


def relay(p, start, tol):
    push = p.K

    def flow(s, u, t):
        return np.array([s[1], (p.h * sin(p.w * t) + push) / p.mu])

    model = Model(flow, start)

    def up(t):
        nonlocal push
        push = -p.K

    def down(t):
        nonlocal push
        push = p.K

    def to_left(t):
        nonlocal push
        push = -p.K if model.state[0] > -p.a else p.K

    def to_right(t):
        nonlocal push
        push = p.K if model.state[0] < p.a else -p.K

    model.when(ZeroCrossingUp, lambda t: model.state[0] - p.a, up, tol)
    model.when(ZeroCrossingDown, lambda t: model.state[0] + p.a, down, tol)
    model.when(ZeroCrossingDown, lambda t: model.state[1], to_left, tol)
    model.when(ZeroCrossingUp, lambda t: model.state[1], to_right, tol)
    return model


def stick_slip(p, start, tol):
    slips = False

    def flow(s, u, t):
        if not slips:
            return np.array([p.Vp, 0.0])
        x, V = s
        return np.array(
            [
                p.Vp - V,
                (p.k * x - (p.Fc + (p.Fs - p.Fc) * (1 - V / p.V0) ** 2 if V < p.V0 else p.Fc))
                / p.m,
            ]
        )

    model = Model(flow, start)

    def loose(t):
        nonlocal slips
        slips = True
        model.events[0].off()
        model.events[1].on()

    def stop(t):
        nonlocal slips
        slips = False
        model.block.engine.state = np.array([model.state[0], 0.0])
        model.events[1].off()
        model.events[0].on()

    model.when(ZeroCrossingUp, lambda t: p.k * model.state[0] - p.Fs, loose, tol)
    model.when(ZeroCrossingDown, lambda t: model.state[1], stop, tol)
    model.events[1].off()
    return model


def boost(p, start, tol):
    a, b = 1 / ((p.R + p.RC) * p.C), p.R / (p.R + p.RC)
    mode = "on"

    def flow(s, u, t):
        i, v = s
        if mode == "on":
            return np.array([(p.E - p.RL * i) / p.L, -a * v])
        if mode == "diode":
            return np.array([(p.E - p.RL * i - b * (v + p.RC * i)) / p.L, a * (p.R * i - v)])
        return np.array([0.0, -a * v])

    model = Model(flow, start)

    def opens(t):
        nonlocal mode
        mode = "diode"

    def closes(t):
        nonlocal mode
        mode = "on"

    def blocks(t):
        nonlocal mode
        if mode != "diode":
            return False
        mode = "off"
        model.block.engine.state = np.array([0.0, model.state[1]])

    model.every(p.Ts, p.d * p.Ts, opens)
    model.every(p.Ts, p.Ts, closes)
    model.when(ZeroCrossingDown, lambda t: model.state[0], blocks, tol)
    return model


def contestants(problem: Problem) -> list[Contestant]:
    build = {
        "spiral": spiral,
        "ball": ball,
        "relay": relay,
        "stick_slip": stick_slip,
        "boost": boost,
    }[problem.name]

    def make(solver):
        return lambda tol: (
            lambda: build(problem.p, problem.start, tol).solve(problem.t_end, solver, tol)
        )

    return [Contestant("PathSim", name, make(solver)) for name, solver in SOLVERS.items()]
