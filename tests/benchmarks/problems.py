"""The five problems: a labkit System, an end time, and a reference that no contestant has computed.

    problem = PROBLEMS["relay"]
    problem.p.K, problem.t_end                       # every contestant takes its numbers from here
    instants, state = problem.reference()    # all events before the end, and the state at the end
    instants, state = problem.reference(t_end=200.0, start=(-1.0, 0.5))

References are closed forms, evaluated with 30 digits and with bracketed switching times (mpmath);
only the braking block of the stick-slip problem has no closed form, and takes a Taylor series of
its quadratic equation there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

from mpmath import cos, eig, exp, expm, findroot, lu_solve, matrix, mp, mpf, polyval, sin, sqrt

from labkit import Every, Mode, System, Transition

from .. import systems

DIGITS = 30


@dataclass(frozen=True)
class Problem:
    """One problem. `t_end` lies clear of every event.

    `modes` is what simulate needs to start elsewhere than at the start.
    """

    name: str
    title: str
    make: Callable[[], System]
    t_end: float
    exact: Callable[..., tuple[list, tuple]]

    @cached_property
    def system(self) -> System:
        return self.make()

    @cached_property
    def p(self) -> tuple:
        return self.system.values()

    @cached_property
    def start(self) -> tuple[float, ...]:
        return tuple(self.system.start[name] for name in self.system.states)

    def reference(
        self, t_end: float | None = None, start: tuple[float, ...] | None = None
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """problem.reference() -> (instants of the events in (0, t_end), state at t_end), right to
        the last digit or two.
        """
        return _reference(self, t_end or self.t_end, start or self.start)


@cache
def _reference(
    problem: Problem, t_end: float, start: tuple[float, ...]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    with mp.workdps(DIGITS):
        p = problem.p._replace(**{name: mpf(value) for name, value in problem.p._asdict().items()})
        instants, state = problem.exact(p, mpf(t_end), *map(mpf, start))
        return tuple(map(float, instants)), tuple(map(float, state))


def rise(guard: Callable, t: mpf, t_end: mpf, step: float) -> mpf | None:
    """rise(guard, t, t_end, step) -> the first instant in (t, t_end] where the guard turns
    positive, None if it does not.

    `step` must be shorter than any time for which the guard stays positive.
    """
    a, before = t, guard(t)
    while a < t_end:
        b = min(a + step, t_end)
        after = guard(b)
        if before <= 0 < after and (before < 0 or a > t):
            return findroot(
                guard, (a, b), solver="anderson", tol=mpf(10) ** (-2 * DIGITS + 8), verify=False
            )
        a, before = b, after
    return None


# ---------------------------------------------------------------- the exact solutions


def spiral(p, t, s1, s2):
    """s* + e^{αt}·(rotation by βt)(s − s*)."""
    det = p.alpha**2 + p.beta**2
    r1, r2 = (p.beta * p.b2 - p.alpha * p.b1) / det, (-p.beta * p.b1 - p.alpha * p.b2) / det
    u, w, c, s = s1 - r1, s2 - r2, cos(p.beta * t), sin(p.beta * t)
    return [], (r1 + exp(p.alpha * t) * (u * c + w * s), r2 + exp(p.alpha * t) * (w * c - u * s))


def ball(p, t_end, y, v):
    """Parabolas; a flight that starts at the ground with speed v takes 2v/g."""
    t, instants = mpf(0), []
    while True:
        flight = (v + sqrt(v**2 + 2 * p.g * y)) / p.g
        if t + flight >= t_end:
            tau = t_end - t
            return instants, (y + v * tau - p.g * tau**2 / 2, v - p.g * tau)
        t, y, v = t + flight, mpf(0), p.e * (p.g * flight - v)
        instants.append(t)


def relay(p, t_end, x, v):
    """x'' = (h sin ωt − F)/μ with constant F, integrated by hand.

    Moves to the right at the start if v ≥ 0.
    """
    t, way, instants = mpf(0), 1 if v >= 0 else -1, []
    while True:
        F = p.K if way * x > p.a else -p.K  # against the motion once the switch is passed
        F *= way

        def speed(q, t=t, v=v, F=F):
            return v + (p.h * (cos(p.w * t) - cos(p.w * q)) / p.w - F * (q - t)) / p.mu

        def place(q, t=t, x=x, v=v, F=F):
            return (
                x
                + v * (q - t)
                + (
                    p.h * (cos(p.w * t) * (q - t) / p.w - (sin(p.w * q) - sin(p.w * t)) / p.w**2)
                    - F * (q - t) ** 2 / 2
                )
                / p.mu
            )

        def back(q, way=way, speed=speed):
            return -way * speed(q)

        def passed(q, way=way, place=place):
            return way * place(q) - p.a

        turn = rise(back, t, t_end, 0.05)
        switch = rise(passed, t, turn or t_end, 0.05) if F * way < 0 else None
        if turn is None and switch is None:
            return instants, (place(t_end), speed(t_end))
        t_next = switch or turn
        x, v = place(t_next), mpf(0) if switch is None else speed(t_next)
        x = (
            way * p.a * (1 + mpf(10) ** (1 - DIGITS)) if switch is not None else x
        )  # past the switch, not before it
        way = way if switch is not None else -way
        t = t_next
        instants.append(t)


def stick_slip(p, t_end, x, v):
    """While V > V0 friction is constant; below it is a square of V.

    Taylor series of either, step by step, cut where V meets V0 or 0.
    """
    t, instants = mpf(0), []
    order = DIGITS + 5
    fast = v >= p.V0
    while True:
        if v == 0 and p.k * x < p.Fs:  # sticks
            loose = t + (p.Fs / p.k - x) / p.Vp
            if loose >= t_end:
                return instants, (x + p.Vp * (t_end - t), v)
            t, x = loose, p.Fs / p.k
            instants.append(t)
            fast = False
        xs, vs = [x], [v]
        for n in range(order):
            friction = p.Fc if n == 0 else mpf(0)
            if not fast:  # (1 − V/V0)², as a product of series
                slack = [(1 if m == 0 else 0) - vs[m] / p.V0 for m in range(n + 1)]
                friction += (p.Fs - p.Fc) * sum(slack[m] * slack[n - m] for m in range(n + 1))
            xs.append(((p.Vp if n == 0 else 0) - vs[n]) / (n + 1))
            vs.append((p.k * xs[n] - friction) / p.m / (n + 1))
        size = max(abs(xs[-1]), abs(vs[-1]), mpf(10) ** -60)
        h = min((mpf(10) ** (-DIGITS) / size) ** (mpf(1) / order), mpf(1) / 4, t_end - t)
        X, V = (lambda tau, c=c[::-1]: polyval(c, tau) for c in (xs, vs))

        def passed(tau, V=V, sign=1 if fast else -1):
            return sign * (p.V0 - V(tau))

        kink = rise(passed, mpf(0), h, float(h) / 8)
        stop = None if fast else rise(lambda tau, V=V: -V(tau), mpf(0), h, float(h) / 8)
        tau = min(q for q in (kink, stop, h) if q is not None)
        t, x, v = t + tau, X(tau), V(tau)
        if tau == stop:
            v = mpf(0)
            instants.append(t)
        elif tau == kink:
            v, fast = p.V0, not fast
        if t >= t_end:
            return instants, (x, v)


def boost(p, t_end, i, v):
    """Matrix exponentials on (iL, v, 1).

    A period in which the current would turn negative is cut where it is zero.
    """
    a = 1 / ((p.R + p.RC) * p.C)
    A_on = matrix([[-p.RL / p.L, 0, p.E / p.L], [0, -a, 0], [0, 0, 0]])
    A_diode = matrix(
        [
            [-(p.RL + p.R * p.RC * a * p.C) / p.L, -p.R * a * p.C / p.L, p.E / p.L],
            [p.R * a, -a, 0],
            [0, 0, 0],
        ]
    )
    A_off = matrix([[0, 0, 0], [0, -a, 0], [0, 0, 0]])
    on, off = p.d * p.Ts, (1 - p.d) * p.Ts
    # To find where the current is zero a series of the matrix would take too long
    rates, vectors = eig(A_diode)
    charge, deliver = expm(A_on * on), expm(A_diode * off)
    s, instants = matrix([i, v, 1]), []
    for k in range(int(t_end / p.Ts + mpf("0.5"))):
        begin = k * p.Ts
        if k:
            instants.append(begin)
        instants.append(begin + on)
        s = charge * s
        end = deliver * s
        if end[0] < 0:
            c = lu_solve(vectors, s)

            def reverse(q, c=c):
                return -sum(vectors[0, m] * c[m] * exp(rates[m] * q) for m in range(3)).real

            tau = rise(reverse, mpf(0), off, off)
            s = expm(A_diode * tau) * s
            s[0] = 0
            instants.append(begin + on + tau)
            end = expm(A_off * (off - tau)) * s
        s = end
    return instants, (s[0], s[1])


# ---------------------------------------------------------------- the models


def make_relay() -> System:
    """Handbook sample 3.3 as its notebook reads it.

    The force changes at x = ±a on the way out and at each turn.
    """
    right, left = systems.forced(-1), systems.forced(1)  # the way in which the relay pushes
    return System(
        "hysteresis relay",
        {"x": "m", "v": "m/s"},
        {"mu": 1.2, "K": 0.8, "a": 0.4, "h": 1.0, "w": 1.0},
        [
            Mode("right, driven", right),
            Mode("right, braked", left),
            Mode("left, driven", left),
            Mode("left, braked", right),
        ],
        [
            Transition(
                "right, driven",
                "right, braked",
                guard=lambda t, s, p: s.x - p.a,
                direction=1,
                urgent=True,
            ),
            Transition(
                "left, driven",
                "left, braked",
                guard=lambda t, s, p: s.x + p.a,
                direction=-1,
                urgent=True,
            ),
            Transition(
                ("right, driven", "right, braked"),
                "left, driven",
                guard=lambda t, s, p: s.v,
                direction=-1,
            ),
            Transition(
                ("left, driven", "left, braked"),
                "right, driven",
                guard=lambda t, s, p: s.v,
                direction=1,
            ),
        ],
        start={"x": 0.0, "v": 0.0},
    )


def make_boost() -> System:
    """The boost converter of part 3, item 6.

    A clock, and a diode that blocks when its current is zero.
    """

    def on(t, s, p):
        return (p.E - p.RL * s.iL) / p.L, -s.v / ((p.R + p.RC) * p.C)

    def diode(t, s, p):
        return (p.E - p.RL * s.iL - p.R / (p.R + p.RC) * (s.v + p.RC * s.iL)) / p.L, (
            p.R * s.iL - s.v
        ) / ((p.R + p.RC) * p.C)

    def off(t, s, p):
        return 0.0, -s.v / ((p.R + p.RC) * p.C)

    return System(
        "boost converter",
        {"iL": "A", "v": "V"},
        {"E": 20.0, "L": 1e-3, "C": 220e-6, "R": 50.0, "RL": 0.2, "RC": 0.05, "Ts": 1e-4, "d": 0.5},
        [Mode("on", on), Mode("diode", diode), Mode("off", off)],
        [
            Transition("on", "diode", at=Every("Ts", first=lambda p: p.d * p.Ts)),
            Transition(("diode", "off"), "on", at=Every("Ts")),
            Transition(
                "diode",
                "off",
                guard=lambda t, s, p: s.iL,
                direction=-1,
                reset=lambda t, s, p: (0.0, s.v),
            ),
        ],
        start={"iL": 0.0, "v": 0.0},
    )


PROBLEMS = {
    problem.name: problem
    for problem in (
        Problem("spiral", "linear spiral, t ≤ 10", systems.spiral, 10.0, spiral),
        Problem("ball", "bouncing ball, 12 bounces", systems.ball, 12.0, ball),
        Problem("relay", "hysteresis relay, t ≤ 100", make_relay, 100.0, relay),
        Problem("stick_slip", "stick-slip, t ≤ 30", systems.stick_slip, 30.0, stick_slip),
        Problem("boost", "boost converter, 500 cycles", make_boost, 0.05, boost),
    )
}
