"""Many runs at once, and how cost grows with length, with events and with lanes.

scale(quick, log) -> Scale: .ensembles (many trajectories, many end states) and .growth (times over
sizes, exponents)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import sqrt
from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp

from labkit import simulate, simulate_many

from .. import systems
from . import with_scipy
from .measure import CLOCK
from .problems import PROBLEMS, Problem

GOAL = 1e-5


@dataclass
class Ensemble:
    """Many runs by one tool: seconds for all of them, largest error of an end state.

    `measured` lanes if fewer were run and scaled up.
    """

    what: str
    tool: str
    setting: str
    lanes: int
    seconds: float
    error: float
    measured: int


@dataclass
class Growth:
    """Seconds over size, and the exponent of the last three sizes: 1 is linear."""

    what: str
    tool: str
    sizes: list[int]
    seconds: list[float]

    @property
    def exponent(self) -> float:
        return float(np.polyfit(np.log(self.sizes[-3:]), np.log(self.seconds[-3:]), 1)[0])


@dataclass
class Scale:
    ensembles: list[Ensemble] = field(default_factory=list)
    growth: list[Growth] = field(default_factory=list)


def clock(run: Callable[[], object], now: Callable[[], float] = perf_counter) -> float:
    began = now()
    run()
    return now() - began


# ---------------------------------------------------------------- trajectories


def starts_of(problem: Problem, lanes: int) -> tuple[np.ndarray, np.ndarray, str]:
    """Starts that fill the plane evenly (an additive recurrence), and their mode."""
    u = (0.5 + np.outer(np.arange(lanes), [0.7548776662466927, 0.5698402909980532])) % 1.0
    if problem.name == "relay":
        return -2.0 + 2.3 * u[:, 0], 0.1 + 1.9 * u[:, 1], "right, driven"
    return 0.5 + 2.0 * u[:, 0], 0.2 + 3.0 * u[:, 1], "slip"


def trajectory_tools(
    problem: Problem, x: np.ndarray, y: np.ndarray, mode: str, grid: np.ndarray
) -> dict[str, dict[str, Callable[[], np.ndarray]]]:
    """tool -> setting -> function that computes all trajectories and returns the end states,
    (lanes, 2).
    """
    first, second = problem.system.states
    t_end, tools = float(grid[-1]), {}

    def with_labkit(backend, method, tol):
        starts, accuracy = {first: x, second: y}, {"method": method, "rtol": tol, "atol": tol}
        runs = simulate_many(
            problem.system, t_end, start=starts, mode=mode, points=grid, backend=backend, **accuracy
        )
        return np.transpose([runs.final[first], runs.final[second]])

    def with_solve_ivp(method, tol):
        solver, ends = (
            {"relay": with_scipy.relay, "stick_slip": with_scipy.stick_slip}[problem.name],
            [],
        )
        for start in zip(x.tolist(), y.tolist(), strict=True):
            pieces: list[np.ndarray] = []
            ends.append(
                solver(
                    problem.p,
                    t_end,
                    start,
                    {"method": method, "rtol": tol, "atol": tol},
                    (grid, pieces),
                ).state
            )
            np.concatenate(pieces, axis=1)
        return np.array(ends)

    def grade(run, methods):
        return {
            f"{method}, {tol:.0e}": partial(run, method, tol)
            for method in methods
            for tol in (1e-6, 1e-7, 1e-8, 1e-9)
        }

    for backend in ("compiled", "plain"):
        tools[f"labkit {backend}"] = grade(partial(with_labkit, backend), ("RK45", "DOP853"))
    tools["solve_ivp"] = grade(with_solve_ivp, ("RK45", "DOP853", "LSODA"))
    try:
        from . import with_heyoka
    except ImportError:
        return tools

    def heyoka(tol):
        taylor = {"relay": with_heyoka.relay, "stick_slip": with_heyoka.stick_slip}[problem.name](
            problem.p, problem.start, tol
        ).__self__
        p = problem.p

        def run():
            ends = []
            for start in zip(x.tolist(), y.tolist(), strict=True):
                ends.append(
                    taylor.sample(
                        start,
                        (p.K,) if problem.name == "relay" else (1.0, float(start[1] < p.V0)),
                        grid,
                    )[-1]
                )
            return np.array(ends)

        return run

    tools["heyoka"] = {f"Taylor, {tol:.0e}": heyoka(tol) for tol in (1e-4, 1e-5, 1e-6, 1e-7)}
    return tools


def trajectories(name: str, lanes: int, points: int, rounds: int, log: Callable) -> list[Ensemble]:
    """Many trajectories with samples.

    For each tool the fastest setting that keeps the goal in every lane, then in turn.
    """
    problem, t_end = PROBLEMS[name], {"relay": 20.0, "stick_slip": 10.0}[name]
    x, y, mode = starts_of(problem, lanes)
    exact = np.array(
        [problem.reference(t_end, start)[1] for start in zip(x.tolist(), y.tolist(), strict=True)]
    )
    grid = np.linspace(0.0, t_end, points)
    found = {}
    for tool, settings in trajectory_tools(problem, x, y, mode, grid).items():
        if tool == "labkit compiled":
            settings["DOP853, 1e-06"]()  # compiles
        for setting, run in settings.items():
            error = np.abs(run() - exact).max()
            seconds = clock(run)
            if seconds < 0.1:
                seconds = min(seconds, *(clock(run) for _ in range(5)))
            if error <= GOAL and seconds < found.get(tool, (None, None, np.inf))[2]:
                found[tool] = setting, run, seconds, error
        log(f"    {tool}: {found[tool][0] if tool in found else 'goal not reached'}")
    best = {tool: np.inf for tool in found}
    for _ in range(rounds):
        for tool, (_, run, seconds, _) in found.items():
            for _ in range(5 if seconds < 0.1 else 1):
                best[tool] = min(best[tool], clock(run))
    what = f"{lanes} × {points} points, {problem.title.split(',')[0]}, t ≤ {t_end:g}"
    return [
        Ensemble(what, tool, found[tool][0], lanes, best[tool], found[tool][3], lanes)
        for tool in found
    ]


# ---------------------------------------------------------------- end states


def end_states(lanes: int, log: Callable) -> list[Ensemble]:
    """End states of the linear spiral from many starts.

    Loops over single runs are measured on fewer lanes and scaled up.
    """
    problem = PROBLEMS["spiral"]
    p, t_end = problem.p, problem.t_end
    s1, s2 = np.random.default_rng(1).uniform(-5, 5, (2, lanes))
    exact = np.array(
        [systems.spiral_exact(np.array([t_end]), start)[:, 0] for start in zip(s1, s2, strict=True)]
    )
    few = min(lanes, 200)
    runs = []

    def add(tool, setting, count, run):
        began = perf_counter()
        ends = run(count)
        seconds = (perf_counter() - began) * lanes / count
        runs.append(
            Ensemble(
                f"{lanes} end states, linear spiral",
                tool,
                setting,
                lanes,
                seconds,
                np.abs(ends - exact[:count]).max(),
                count,
            )
        )
        log(f"    {tool}: {seconds:.2f} s")

    def with_labkit(count, backend="compiled"):
        starts = {"s1": s1[:count], "s2": s2[:count]}
        final = simulate_many(
            problem.system,
            t_end,
            start=starts,
            points=np.array([t_end]),
            rtol=1e-6,
            atol=1e-6,
            backend=backend,
        ).final
        return np.transpose([final["s1"], final["s2"]])

    def all_at_once(count):
        def flow(t, y):
            a, b = y[:count], y[count:]
            return np.concatenate(
                [p.alpha * a + p.beta * b + p.b1, p.alpha * b - p.beta * a + p.b2]
            )

        ends = solve_ivp(
            flow,
            (0.0, t_end),
            np.concatenate([s1[:count], s2[:count]]),
            method="DOP853",
            rtol=1e-6,
            atol=1e-6,
            t_eval=[t_end],
        ).y[:, -1]
        return ends.reshape(2, count).T

    def one_by_one(count):
        accuracy = {"method": "DOP853", "rtol": 1e-6, "atol": 1e-6}
        return np.array(
            [
                with_scipy.spiral(p, t_end, start, accuracy).state
                for start in zip(s1[:count], s2[:count], strict=True)
            ]
        )

    with_labkit(2)
    add("labkit compiled", "DOP853, 1e-06", lanes, with_labkit)
    add("labkit plain", "DOP853, 1e-06", few, lambda count: with_labkit(count, "plain"))
    add("solve_ivp, loop", "DOP853, 1e-06", few, one_by_one)
    add("solve_ivp, one big system", "DOP853, 1e-06", lanes, all_at_once)
    try:
        from . import with_cyrk
    except ImportError:
        pass
    else:
        from numba import njit

        address, args, last = (
            with_cyrk.both(with_cyrk.spiral_flow)[0],
            np.array([p.alpha, p.beta, p.b1, p.b2]),
            with_cyrk.last,
        )

        @njit
        def loop(starts, ends):
            for k in range(len(starts)):
                ends[k] = last(address, args, 0.0, starts[k], t_end, "DOP853", 1e-6)

        starts, ends = np.transpose([s1, s2]).copy(), np.empty((lanes, 2))
        loop(starts[:1], ends[:1])

        def with_loop(count):
            loop(starts[:count], ends[:count])
            return ends[:count]

        add("CyRK, own loop", "DOP853, 1e-06", lanes, with_loop)
    try:
        import heyoka as hy
    except ImportError:
        pass
    else:
        a, b = hy.make_vars("s1", "s2")
        ta = hy.taylor_adaptive(
            [(a, p.alpha * a + p.beta * b + p.b1), (b, p.alpha * b - p.beta * a + p.b2)],
            [0.0, 0.0],
            tol=1e-6,
        )
        state = ta.state

        def with_taylor(count):
            ends = np.empty((count, 2))
            for k in range(count):
                ta.time = 0.0
                state[0], state[1] = s1[k], s2[k]
                ta.propagate_until(t_end)
                ends[k] = state
            return ends

        add("heyoka, loop", "Taylor, 1e-06", lanes, with_taylor)
    return runs


# ---------------------------------------------------------------- growth


def growth(quick: bool, log: Callable) -> list[Growth]:
    """Times of labkit over length, events and lanes.

    Those of solve_ivp and the plain back end where they end in good time.
    """
    oscillator, ball, stick_slip = systems.oscillator(), systems.ball(), systems.stick_slip()
    fall = sqrt(20 / 9.81)

    def length(backend):
        return lambda n: simulate(oscillator, float(n), points=2, backend=backend)

    def bounces(backend):
        return lambda n: simulate(ball, 2.0 * fall * n, e=1.0, points=2, backend=backend)

    def lanes(backend):
        def run(n):
            x, y, mode = starts_of(PROBLEMS["stick_slip"], n)
            return simulate_many(
                stick_slip, 10.0, start={"x": x, "V": y}, mode=mode, points=300, backend=backend
            )

        return run

    def length_scipy(n):
        return solve_ivp(
            lambda t, y: (y[1], -y[0]),
            (0.0, float(n)),
            (1.0, 0.0),
            method="DOP853",
            rtol=1e-8,
            atol=1e-10,
        )

    def bounces_scipy(n):
        p = PROBLEMS["ball"].p._replace(e=1.0)
        return with_scipy.ball(
            p, 2.0 * fall * n, (10.0, 0.0), {"method": "DOP853", "rtol": 1e-8, "atol": 1e-10}
        )

    top = 3 if quick else 5
    plan = [
        (
            "length (oscillator, t ≤ n)",
            "labkit compiled",
            length("compiled"),
            [100 * 4**k for k in range(top)],
        ),
        (
            "length (oscillator, t ≤ n)",
            "labkit plain",
            length("plain"),
            [25 * 4**k for k in range(top)],
        ),
        ("length (oscillator, t ≤ n)", "solve_ivp", length_scipy, [25 * 4**k for k in range(top)]),
        (
            "events (ball, n bounces)",
            "labkit compiled",
            bounces("compiled"),
            [40 * 4**k for k in range(top)],
        ),
        (
            "events (ball, n bounces)",
            "labkit plain",
            bounces("plain"),
            [10 * 4**k for k in range(top - 1)],
        ),
        (
            "events (ball, n bounces)",
            "solve_ivp",
            bounces_scipy,
            [10 * 4**k for k in range(top - 1)],
        ),
        (
            "lanes (stick-slip, n × 300 points)",
            "labkit compiled",
            lanes("compiled"),
            [15 * 4**k for k in range(top)],
        ),
        (
            "lanes (stick-slip, n × 300 points)",
            "labkit plain",
            lanes("plain"),
            [4 * 4**k for k in range(top - 1)],
        ),
    ]
    found = []
    for what, tool, run, sizes in plan:
        run(sizes[0])
        best = [float("inf")] * len(sizes)
        for number in range(12):
            for place, n in enumerate(sizes):
                if number < 3 or best[place] < 0.1:
                    best[place] = min(
                        best[place],
                        clock(partial(run, n), perf_counter if what.startswith("lanes") else CLOCK),
                    )
        found.append(Growth(what, tool, sizes, best))
        log(f"    {what}, {tool}: exponent {found[-1].exponent:.2f}")
    return found


def scale(quick: bool, log: Callable = print) -> Scale:
    """scale(quick, print) -> Scale; quick makes small ensembles and short sweeps of size."""
    result = Scale()
    for name in ("relay", "stick_slip"):
        log(f"many trajectories, {PROBLEMS[name].title} …")
        result.ensembles += trajectories(name, 6 if quick else 60, 300, 2 if quick else 8, log)
    log("many end states …")
    result.ensembles += end_states(1000 if quick else 100_000, log)
    log("growth …")
    result.growth = growth(quick, log)
    return result
