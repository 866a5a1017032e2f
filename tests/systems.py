"""Small systems with known answers that several tests share."""

from math import sin

import numpy as np

from labkit import Every, Mode, Output, Parameter, System, Transition


def ball(zeno="rest"):
    return System(
        "bouncing ball",
        states={"y": "m", "v": "m/s"},
        parameters={
            "g": Parameter(9.81, "m/s²", "gravity"),
            "e": Parameter(0.8, "", "restitution", 0, 1),
        },
        modes=[
            Mode("flight", lambda t, s, p: (s.v, -p.g)),
            Mode("rest", lambda t, s, p: (0.0, 0.0)),
        ],
        transitions=[
            Transition(
                "flight",
                "flight",
                guard=lambda t, s, p: s.y,
                direction=-1,
                zeno=zeno,
                reset=lambda t, s, p: (0.0, -p.e * s.v),
                label="bounce",
            )
        ],
        start={"y": 10.0, "v": 0.0},
    )


def spiral():
    def flow(t, s, p):
        return p.alpha * s.s1 + p.beta * s.s2 + p.b1, -p.beta * s.s1 + p.alpha * s.s2 + p.b2

    return System(
        "spiral",
        {"s1": "", "s2": ""},
        {"alpha": -2.0, "beta": 1.0, "b1": 2.0, "b2": 3.0},
        [Mode("motion", flow)],
        start={"s1": 4.0, "s2": -2.0},
    )


def spiral_exact(t, s0=(4.0, -2.0), alpha=-2.0, beta=1.0, b=(2.0, 3.0)):
    """s* + e^{At}(s0 − s*), with e^{At} of a rotation and scaling in closed form; t an array."""
    A = np.array([[alpha, beta], [-beta, alpha]])
    rest = -np.linalg.solve(A, b)
    u, w = np.asarray(s0) - rest
    growth, c, s = np.exp(alpha * t), np.cos(beta * t), np.sin(beta * t)
    return rest[:, None] + growth * np.array([u * c + w * s, -u * s + w * c])


def friction_force(V, p):
    return p.Fc + (p.Fs - p.Fc) * (1 - V / p.V0) ** 2 if p.V0 > V else p.Fc


def stick_slip():
    def slip(t, s, p):
        return p.Vp - s.V, (p.k * s.x - friction_force(s.V, p)) / p.m

    return System(
        "stick and slip",
        {"x": "m", "V": "m/s"},
        {"m": 1.0, "k": 2.0, "Vp": 2.0, "Fs": 5.88, "Fc": 4.0, "V0": 1.0},
        [Mode("stick", lambda t, s, p: (p.Vp, 0.0)), Mode("slip", slip)],
        [
            Transition(
                "stick",
                "slip",
                guard=lambda t, s, p: p.k * s.x - p.Fs,
                direction=1,
                label="break loose",
            ),
            Transition(
                "slip",
                "stick",
                guard=lambda t, s, p: s.V,
                direction=-1,
                reset=lambda t, s, p: (s.x, 0.0),
                label="stick again",
            ),
        ],
        start={"x": 0.0, "V": 0.0},
        outputs={
            "F": Output(
                {
                    "stick": lambda t, s, p: p.k * s.x,
                    "slip": lambda t, s, p: friction_force(s.V, p),
                },
                "N",
            )
        },
    )


def forced(sign):
    return lambda t, s, p: (s.v, (p.h * sin(p.w * t) - sign * p.K) / p.mu)


def relay():
    """Handbook sample 3.3: hysteresis by the sign of x', each of the four combinations of direction
    and output a mode.
    """
    return System(
        "relay with hysteresis",
        {"x": "m", "v": "m/s"},
        {"mu": 1.2, "K": 0.8, "a": 0.4, "h": 1.0, "w": 1.0},
        [
            Mode("right, pulled", forced(-1)),
            Mode("right, held", forced(1)),
            Mode("left, held", forced(1)),
            Mode("left, pulled", forced(-1)),
        ],
        [
            Transition(
                "right, pulled",
                "right, held",
                guard=lambda t, s, p: s.x - p.a,
                direction=1,
                label="switch up",
            ),
            Transition(
                "right, pulled",
                "left, pulled",
                guard=lambda t, s, p: s.v,
                direction=-1,
                label="turn",
            ),
            Transition(
                "right, held", "left, held", guard=lambda t, s, p: s.v, direction=-1, label="turn"
            ),
            Transition(
                "left, held",
                "left, pulled",
                guard=lambda t, s, p: s.x + p.a,
                direction=-1,
                label="switch down",
            ),
            Transition(
                "left, held", "right, held", guard=lambda t, s, p: s.v, direction=1, label="turn"
            ),
            Transition(
                "left, pulled",
                "right, pulled",
                guard=lambda t, s, p: s.v,
                direction=1,
                label="turn",
            ),
        ],
        start={"x": 0.0, "v": 0.0},
    )


def oscillator(**more):
    return System(
        "oscillator",
        {"x": "m", "v": "m/s"},
        {"w": 1.0},
        [Mode("motion", lambda t, s, p: (s.v, -(p.w**2) * s.x))],
        start={"x": 1.0, "v": 0.0},
        **more,
    )


def heater():
    """On-off control with dead time; the limit cycle is known in closed form."""
    return System(
        "room heater",
        {"tau": "°C"},
        {
            "T": 1.0,
            "K": 2.0,
            "u": 5.0,
            "low": 4.5,
            "high": 5.5,
            "Td": Parameter(0.2, "h", "dead time", 0, 2),
        },
        [
            Mode("on", lambda t, s, p: ((p.K * p.u - s.tau) / p.T,)),
            Mode("off", lambda t, s, p: (-s.tau / p.T,)),
        ],
        [
            Transition(
                "on",
                "off",
                guard=lambda t, s, p: s.tau - p.high,
                direction=1,
                delay="Td",
                label="off",
            ),
            Transition(
                "off",
                "on",
                guard=lambda t, s, p: s.tau - p.low,
                direction=-1,
                delay="Td",
                label="on",
            ),
        ],
        start={"tau": 0.0},
    )


def circuit():
    """Series circuit whose resistance alternates every second: known instants, never a guard."""
    return System(
        "series circuit",
        {"i": "A", "u": "V"},
        {"L": 0.5, "C": 0.2, "E": 5.0, "R1": 1.0, "R2": 4.0},
        [
            Mode("R1", lambda t, s, p: ((p.E - p.R1 * s.i - s.u) / p.L, s.i / p.C)),
            Mode("R2", lambda t, s, p: ((p.E - p.R2 * s.i - s.u) / p.L, s.i / p.C)),
        ],
        [Transition("R1", "R2", at=Every(1.0)), Transition("R2", "R1", at=Every(1.0))],
        start={"i": 0.0, "u": 0.0},
    )
