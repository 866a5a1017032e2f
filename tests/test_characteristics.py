"""Static characteristics against the handbook's formulas, Fourier integrals and exact solutions."""

import math
from math import pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import Ended, ModelError, System, characteristic, equations, from_points, simulate
from labkit.characteristics import KINDS

P = {"K": 1.0, "a": 0.4, "b": 0.5, "d": 1.0, "alpha": 5.0, "p": 0.5, "c": 0.4, "L": 0.5}
P |= {"p1": 2.0, "c1": 0.5, "p2": 1.0, "c2": 1.0}
CLEARANCE = {"p": 0.6, "L": 0.4, "c1": 0.2, "c2": -0.2}


def parameters(kind):
    values = P | (CLEARANCE if kind == "clearance" else {})
    return {name: values[name] for name in characteristic(kind).parameters}


def saturated(x, p):
    return np.clip(p["K"] * x / p["a"], -p["K"], p["K"])


def slack(x, p):
    return np.sign(x) * np.clip(p["K"] * (abs(x) - p["a"]) / p["b"], 0, p["K"])


sign = np.sign
FORMULAS = {  # as the handbook prints them: F(x, sign of x', p)
    "relay": lambda x, w, p: p["K"] * sign(x),
    "relay with hysteresis": lambda x, w, p: p["K"] * sign(x - w * p["a"]),
    "relay with dead zone": lambda x, w, p: p["K"] / 2 * (sign(x + p["a"]) + sign(x - p["a"])),
    "relay with dead zone and hysteresis": lambda x, w, p: (
        p["K"] / 2 * (sign(x - w * p["a"]) + sign(x + w * p["b"] * p["a"]))
    ),
    "saturation": lambda x, w, p: saturated(x, p),
    "saturation with hysteresis": lambda x, w, p: saturated(x - w * p["d"] * p["a"], p),
    "dead zone with saturation": lambda x, w, p: slack(x, p),
    "dead zone with saturation and hysteresis": lambda x, w, p: slack(x - w * p["d"] * p["a"], p),
    "smooth relay": lambda x, w, p: 2 * p["K"] / pi * np.arctan(p["alpha"] * x),
    "smooth relay with dead zone": lambda x, w, p: (
        p["K"] / pi * (np.arctan(p["alpha"] * (x + p["a"])) + np.arctan(p["alpha"] * (x - p["a"])))
    ),
    "preload": lambda x, w, p: p["p"] * x + p["c"] * sign(x),
    "two springs": lambda x, w, p: np.where(
        x < p["L"], p["p1"] * x + p["c1"], p["p2"] * x + p["c2"]
    ),
    "clearance": lambda x, w, p: np.where(
        abs(x) <= p["L"], 0.0, p["p"] * x + np.where(x > 0, p["c1"], p["c2"])
    ),
}
POSITIVE = st.floats(0.05, 5)


def test_every_kind_has_a_formula_here():
    assert set(FORMULAS) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
@given(
    x=st.lists(st.floats(-10, 10), min_size=1, max_size=20),
    way=st.sampled_from((1, -1)),
    sizes=st.tuples(*[POSITIVE] * 6),
    share=st.floats(0.01, 0.99),
)
@settings(max_examples=60, deadline=None)
def test_the_value_is_the_formulas_on_both_branches(kind, x, way, sizes, share):
    made = characteristic(kind)
    p = {name: sizes[k % 6] for k, name in enumerate(sorted(made.parameters))}
    if "hysteresis" in kind and "b" in p and "d" not in p:
        p["b"] = share
    if kind == "clearance":
        p["c2"] = -p["c2"]
    x = np.array(x)
    edges = made.edges(p, way)
    far = np.all(np.abs(x[:, None] - edges) > 1e-9 * (1 + np.abs(x[:, None])), axis=1)
    right = FORMULAS[kind](x, way, p)
    assert made(x, p, way)[far] == pytest.approx(right[far], rel=1e-12, abs=1e-12)


# ---- describing functions, potentials


@pytest.mark.parametrize("kind", KINDS)
@given(amplitude=st.floats(0.05, 20))
@settings(max_examples=5, deadline=None)
def test_the_describing_function_is_the_fourier_integral(kind, amplitude):
    p = parameters(kind)

    def wave(part):
        total = 0.0
        for way, start in ((1, -pi / 2), (-1, pi / 2)):
            cuts = np.arcsin(np.clip(characteristic(kind).edges(p, way) / amplitude, -1, 1))
            corners = [-pi / 2, *cuts, pi / 2]
            turned = [start + (c + pi / 2 if way > 0 else pi / 2 - c) for c in corners]
            for low, high in zip(*(sorted(turned)[k:] for k in (0, 1)), strict=False):
                total += quad(
                    lambda o, way=way: (
                        float(FORMULAS[kind](np.float64(amplitude * sin(o)), way, p)) * part(o)
                    ),
                    low,
                    high,
                    epsabs=1e-13,
                    limit=200,
                )[0]
        return total / (pi * amplitude)

    found = characteristic(kind).describing(amplitude, p)
    assert found.real == pytest.approx(wave(math.sin), abs=2e-9)
    assert found.imag == pytest.approx(wave(math.cos), abs=2e-9)


def test_describing_functions_are_those_of_the_books():
    K, a, A = 1.3, 0.4, 1.7
    relay = characteristic("relay").describing(A, {"K": K})
    assert relay == pytest.approx(4 * K / (pi * A), rel=1e-13)
    loop = characteristic("relay with hysteresis").describing(A, {"K": K, "a": a})
    right = 4 * K / (pi * A) * (math.sqrt(1 - (a / A) ** 2) - 1j * a / A)
    assert loop == pytest.approx(right, rel=1e-12)
    dead = characteristic("relay with dead zone").describing(A, {"K": K, "a": a})
    assert dead == pytest.approx(4 * K / (pi * A) * math.sqrt(1 - (a / A) ** 2), rel=1e-12)
    s = a / A
    full = 2 * K / a / pi * (math.asin(s) + s * math.sqrt(1 - s**2))
    assert characteristic("saturation").describing(A, {"K": K, "a": a}) == pytest.approx(full)
    assert characteristic("saturation").describing(0.3, {"K": K, "a": a}) == pytest.approx(K / a)
    with pytest.raises(ModelError, match="amplitude"):
        characteristic("relay").describing(0.0, {"K": 1.0})


@pytest.mark.parametrize("kind", [kind for kind in KINDS if len(KINDS[kind]) == 1])
@given(x=st.floats(-5, 5))
@settings(max_examples=6, deadline=None)
def test_the_potential_is_the_integral(kind, x):
    p, made = parameters(kind), characteristic(kind)
    corners = sorted({0.0, x, *(e for e in made.edges(p) if min(0, x) < e < max(0, x))})
    right = sum(
        quad(lambda q: float(FORMULAS[kind](np.float64(q), 1, p)), low, high)[0]
        for low, high in zip(corners, corners[1:], strict=False)
    )
    assert made.potential(x, p) == pytest.approx(right * (1 if x > 0 else -1), abs=1e-9)


def test_a_loop_has_no_potential():
    with pytest.raises(ModelError, match="depends on the way"):
        characteristic("relay with hysteresis").potential(1.0, {"K": 1.0, "a": 0.4})


# ---- the hybrid system


def law(t, s, p, F):
    return s.v, p.k1 * F + p.k2 * s.x + p.k3 * sin(p.k4 * t)


def pendulum(made, values, start=(1.0, 0.0), **options):
    return System(
        made.name,
        {"x": "", "v": ""},
        {"k1": -1.0, "k2": -1.0, "k3": 0.5, "k4": 0.7, **values},
        **made.modes(law),
        start=dict(zip("xv", start, strict=True)),
        outputs={"F": made.output(law=law)},
        **options,
    )


def exact(made, p, t_end, start=(1.0, 0.0), k=(-1.0, -1.0, 0.5, 0.7), t0=0.0):
    """(x, v, switches) at t_end from matrix exponentials on each piece, if it never rests."""
    k1, k2, k3, k4 = k
    wave = math.sin(k4 * t0), math.cos(k4 * t0)
    t, y, switches = t0, np.array([*start, 1.0, *wave]), 0  # x, v, 1, sin, cos
    way = 1 if start[1] > 0 or (start[1] == 0 and start[0] < 0) else -1
    while True:
        edges = np.array([-math.inf, *made.edges(p, way), math.inf])
        place = int(np.searchsorted(edges[1:-1], y[0] + way * 1e-9, side="right"))
        low, high = max(edges[place], -1e3), min(edges[place + 1], 1e3)
        one, two = low + 0.3 * (high - low), low + 0.6 * (high - low)
        F1, F2 = made(one, p, float(way)), made(two, p, float(way))
        slope = (F2 - F1) / (two - one)
        level = F1 - slope * one
        A = np.zeros((5, 5))
        A[0, 1], A[1] = 1.0, [k1 * slope + k2, 0.0, k1 * level, k3, 0.0]
        A[3, 4], A[4, 3] = k4, -k4
        step, wall = expm(0.002 * A), (high if way > 0 else low)

        def g(tau, A=A, y=y, wall=wall, way=way):
            x, v = (expm(tau * A) @ y)[:2]
            return way * (wall - x), way * v

        tau, state = 0.0, y
        while True:
            state, tau = step @ state, tau + 0.002
            if t + tau >= t_end:
                return (*(expm((t_end - t) * A) @ y)[:2], switches)
            if way * (wall - state[0]) < 0 or (tau > 0.003 and way * state[1] < 0):
                break
        which = 0 if way * (wall - state[0]) < 0 else 1
        root = brentq(
            lambda q, which=which, g=g: g(q)[which], max(tau - 0.004, 1e-5), tau, xtol=1e-14
        )
        t, y = t + root, expm(root * A) @ y
        if which == 0:
            y[0], switches = wall, switches + 1
        else:
            y[1], way = 0.0, -way


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "smooth" not in kind])
def test_the_run_is_the_piecewise_exact_solution(kind):
    made, p = characteristic(kind), parameters(kind)
    x, v, switches = exact(made, p, 40.0)
    for method in ("DOP853", "RK45"):
        run = simulate(pendulum(made, p), 40.0, rtol=1e-10, method=method)
        assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
        assert sum("through" in event.transition for event in run.events) == switches > 0


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_is_plain_and_its_equations_are_written(kind):
    system = pendulum(characteristic(kind), parameters(kind))
    runs = [simulate(system, 20.0, backend=backend) for backend in ("compiled", "plain")]
    assert [len(run.events) for run in runs] == [len(runs[0].events)] * 2
    assert runs[0].final == pytest.approx(runs[1].final, rel=1e-9, abs=1e-11)
    assert runs[0].work.backend == "compiled" and "v" in str(equations(system))
    right = FORMULAS[kind](runs[0]["x"], np.sign(runs[0]["v"]), parameters(kind))
    inside = np.array([not name.startswith(("rest", "at rest")) for name in runs[0].mode])
    off = np.abs(runs[0]["F"] - right)[inside]  # at an event both values are right
    assert np.quantile(off, 0.8) < 1e-9


@pytest.mark.parametrize("kind", [kind for kind in KINDS if len(KINDS[kind]) == 1])
def test_a_free_single_valued_pendulum_keeps_its_energy(kind):
    made, p = characteristic(kind), parameters(kind)
    run = simulate(pendulum(made, p), 40.0, k3=0.0, rtol=1e-11)
    energy = run["v"] ** 2 / 2 + made.potential(run["x"], p) + run["x"] ** 2 / 2
    assert np.ptp(energy) < 1e-8


@pytest.mark.parametrize(
    "kind, fed",
    [
        ("relay with hysteresis", lambda p: 4 * p["a"] * p["K"]),
        ("relay with dead zone and hysteresis", lambda p: 2 * p["a"] * p["K"] * (1 - p["b"])),
    ],
)
def test_a_loop_feeds_its_area_each_cycle(kind, fed):
    p = parameters(kind)
    run = simulate(pendulum(characteristic(kind), p), 20.0, k3=0.0, rtol=1e-11)
    turns = run.events["stop"].before["x"]
    right = turns[turns > p["a"]]
    assert len(right) >= 3  # between them a whole cycle; without k3 the rest is a spring
    relay = {"relay with hysteresis": abs(right) * p["K"]}.get(kind, abs(right) * p["K"])
    energy = right**2 / 2 + relay
    assert np.diff(energy) == pytest.approx(fed(p), abs=1e-8)


def test_with_the_other_sign_the_loop_takes_energy_and_the_motion_sticks_inside():
    made, p = characteristic("relay with hysteresis"), {"K": 1.0, "a": 0.4}
    run = simulate(pendulum(made, p, (0.3, 0.0)), 20.0, k1=1.0, k2=0.0, k3=0.5)
    assert set(run.mode) == {"at rest"} and run.final["x"] == 0.3
    assert run["F"] == pytest.approx(-0.5 * np.sin(0.7 * run.t), abs=1e-12)  # the balance
    run = simulate(pendulum(made, p, (0.3, 0.0)), 20.0, k1=1.0, k2=0.0, k3=1.5)
    assert run.events[0].t == pytest.approx(math.asin(1 / 1.5) / 0.7, abs=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if len(KINDS[kind]) == 2])
def test_at_a_turn_the_force_lies_between_the_branches(kind):
    """Where nothing holds the mass the balance lies outside: it only turns, F jumps."""
    made, p = characteristic(kind), parameters(kind)
    run = simulate(pendulum(made, p), 40.0, rtol=1e-10)
    low, high = made(run["x"], p, 1.0), made(run["x"], p, -1.0)
    turns = run.mode == "at rest"
    assert np.any(turns)
    assert np.all((run["F"] >= low - 1e-12) & (run["F"] <= high + 1e-12) | ~turns)


# ---- the second pendulum


def forced(t, s, p, F):
    return s.v, (p.h * sin(p.omega * t) - F) / p.mu


def second(made, values, x=0.0):
    given = {"mu": 1.2, "h": 1.0, "omega": 1.0, **values}
    start = {"x": x, "v": 0.0}
    return System("second", {"x": "", "v": ""}, given, **made.modes(forced), start=start)


@pytest.mark.parametrize("backend", ["plain", "compiled"])
def test_a_body_at_rest_on_a_jump_waits_for_the_force(backend):
    run = simulate(second(characteristic("relay"), {"K": 0.8}), 3.0, backend=backend)
    assert run.mode[0] == "rest at 0"
    assert run.events[0].t == pytest.approx(math.asin(0.8), abs=1e-9)
    assert run.events[0].target == "x > 0"


def test_the_switches_of_a_free_relay_pendulum_come_ever_faster_and_a_long_run_says_so():
    def damped(t, s, p, F):
        return s.v, -p.a * s.v - F

    def swing(v, a=0.2):
        """Time of a swing from x = 0 with speed v under the force 1, and the speed afterwards."""
        top = (v + 1 / a) / a  # x(t) = top·(1 − e^{−at}) − t/a
        time = brentq(lambda t: top * -math.expm1(-a * t) - t / a, 1e-3 * v, 4 * v)
        return time, abs((v + 1 / a) * math.exp(-a * time) - 1 / a)

    system = System(
        "relay pendulum",
        {"x": "", "v": ""},
        {"a": 0.2, "K": 1.0},
        **characteristic("relay").modes(damped),
        start={"x": 0.0, "v": 2.0},
    )
    run = simulate(system, 50.0, rtol=1e-11)
    t, v, instants = 0.0, 2.0, []
    for _ in range(100):
        time, v = swing(v)
        t += time
        instants.append(t)
    assert [event.t for event in run.events[:100]] == pytest.approx(instants, abs=1e-7)
    long = simulate(system, 400.0, max_events=2000)
    assert long.ended is Ended.TOO_MANY_EVENTS and long.t[-1] < 100


def test_the_sample_has_two_futures_and_a_relay_with_memory_a_third():
    values = {"K": 0.8, "a": 0.4}
    made = characteristic("relay with hysteresis")
    right = simulate(second(made, values), 10.0, rtol=1e-10)
    stops = right.events["stop"]
    assert stops.t[:2] == pytest.approx([3.967, 8.503], abs=1e-3)
    assert stops.before["x"][:2] == pytest.approx([3.035, -4.092], abs=1e-3)
    left = simulate(second(made, values), 10.0, rtol=1e-10, mode="← x > -a")
    assert left.events["stop"].t[0] == pytest.approx(1.966, abs=1e-3)
    assert left.events["stop"].before["x"][0] == pytest.approx(-0.410, abs=1e-3)
    kept = characteristic("relay with hysteresis", memory=True)
    run = simulate(second(kept, values), 10.0)
    assert set(run.mode) == {"F = -K", "F = K"}
    # within the loop a relay keeps its output, the formula does not
    still = {"k2": -10.0, "k3": 0.0}
    calm = {"K": 1.0, "a": 0.4}
    assert not simulate(pendulum(kept, calm, (0.0, 0.0)), 10.0, **still).events
    assert simulate(pendulum(made, calm, (0.0, 0.0)), 10.0, **still).events


# ---- what is refused


def test_names_may_be_put_for_names():
    made = characteristic("saturation", K="p*L", a="L")
    assert made.rising.pieces == ("-L*p", "p*x", "L*p") and made.rising.edges == ("-L", "L")
    assert made.parameters == {"p", "L"} and made(0.25, {"p": 2.0, "L": 0.5}) == 0.5
    assert made(3.0, {"p": 2.0, "L": 0.5}) == 1.0
    assert characteristic("relay", K=0.7)(-1.0) == -0.7
    assert characteristic("smooth relay", alpha="2*b").rising.pieces == ("2*K*atan(2*b*x)/pi",)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: characteristic("relais"), "no characteristic 'relais'"),
        (lambda: characteristic("relay", a=1), "has no 'a'; there are 'K'"),
        (lambda: characteristic("relay", K="1 +"), "no formula"),
        (lambda: characteristic("relay", K="__import__('os')"), "calls 'atan'"),
        (lambda: characteristic("relay", K="K.real"), "no formula"),
        (lambda: characteristic("saturation", memory=True), "cannot keep its output"),
        (lambda: characteristic("saturation with hysteresis", memory=True), "cannot keep"),
        (lambda: from_points([(0, 0)]), "two points or more"),
        (lambda: from_points([(0, 0), (math.nan, 1)]), "finite"),
        (lambda: from_points([(0, 0), (1, 1), (0.5, 2)]), r"\(1, 1\).*goes back to \(0.5, 2\)"),
        (lambda: from_points([(0, 0), (0, 1), (0, 2)]), "three points at x = 0"),
        (lambda: from_points("abc"), "pairs .* of numbers"),
        (lambda: from_points([(0, 0), (1, 1)], [(0, 0), (1, 2)]), "do not meet on the right"),
        (lambda: from_points([(-1, -1), (1, 1)], [(0, -1), (2, 1)]), "branches cross"),
        (
            lambda: from_points([(-1, -1), (-1, 1)], [(1, -1), (1, 1)]),
            "x = 0 the one for x' > 0 has F = 1, above the -1 of the one for x' < 0$",
        ),
        (lambda: characteristic("relay")(1.0, {}), "needs the parameter 'K'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(make, words):
    with pytest.raises(ModelError, match=words):
        make()


@pytest.mark.parametrize(
    "kind, wrong, words",
    [
        ("relay with dead zone and hysteresis", {"b": 1.5}, "branches cross.*b = 1.5"),
        ("relay with dead zone", {"a": -0.1}, "must rise, but -a = 0.1 lies right of a = -0.1"),
        ("clearance", {"L": -0.4}, "must rise"),
        ("relay with hysteresis", {"a": -0.2}, "branches cross"),
        ("dead zone with saturation", {"b": -1.0}, "must rise"),
    ],
)
def test_parameters_without_sense_are_refused_where_a_run_begins(kind, wrong, words):
    made = characteristic(kind)
    system = pendulum(made, parameters(kind))
    with pytest.raises(ModelError, match=words):
        simulate(system, 1.0, **wrong)
    with pytest.raises(ModelError, match=words):
        made(0.0, parameters(kind) | wrong)


# ---- curves through points


@given(
    st.lists(st.tuples(st.floats(0.1, 2), st.floats(-3, 3)), min_size=2, max_size=6),
    st.lists(st.floats(-10, 10), min_size=1, max_size=10),
)
@settings(max_examples=60, deadline=None)
def test_a_curve_through_points_goes_through_them(steps, x):
    corners = np.cumsum([step for step, _ in steps])
    points = list(zip(corners, (F for _, F in steps), strict=True))
    made = from_points(points)
    assert made(np.array(x)) == pytest.approx(np.interp(x, *np.transpose(points)), abs=1e-9)


def test_the_points_of_a_loop_give_the_same_run_as_its_formula():
    K, a = 1.0, 0.4
    rising, falling = ([(w * a, -K), (w * a, K)] for w in (1, -1))
    rising, falling = [(-1, -K), *rising, (1, K)], [(-1, -K), *falling, (1, K)]
    drawn = simulate(pendulum(from_points(rising, falling), {}), 40.0, rtol=1e-10)
    made = pendulum(characteristic("relay with hysteresis"), {"K": K, "a": a})
    assert drawn.final == pytest.approx(simulate(made, 40.0, rtol=1e-10).final, abs=1e-7)


# ---- how it shows itself


@pytest.mark.parametrize("kind", KINDS)
def test_formula_picture_and_symbol(kind):
    made, p = characteristic(kind), parameters(kind)
    tex = made.formula()._repr_latex_()
    assert tex.startswith("$$F(x) = ") and tex.count("{") == tex.count("}")
    assert repr(made.formula()).count("F = ") == sum(len(b.pieces) for _, b in made.branches)
    assert np.abs(made.symbol(p)).max() == pytest.approx(1.0)
    fig = made.picture(p)
    assert len(fig.axes[0].lines) == 1 + made.hysteresis


# ---- found by who tried to break it


def test_other_states_go_on_at_rest_with_the_force_that_holds_the_body():
    def with_filter(t, s, p, F):
        return s.v, p.h - F, F - s.z

    made = characteristic("relay").modes(with_filter, ("x", "v", "z"))
    start = {"x": 0.0, "v": 0.0, "z": 0.0}
    system = System("filter", dict.fromkeys("xvz", ""), {"K": 1.0, "h": 0.3}, **made, start=start)
    for backend in ("plain", "compiled"):
        run = simulate(system, 5.0, backend=backend)
        assert run.final["z"] == pytest.approx(0.3 * (1 - math.exp(-5)), abs=1e-8)

    def coupled(t, s, p, F):
        return s.v, 0.5 * t + 0.5 * s.z - F, F - s.z

    made = characteristic("relay").modes(coupled, ("x", "v", "z"))
    system = System("coupled", dict.fromkeys("xvz", ""), {"K": 1.0}, **made, start=start)
    right = brentq(lambda t: t - 2 + math.exp(-t / 2), 1.0, 3.0)  # where F has grown to K
    assert simulate(system, 5.0, rtol=1e-10).events[0].t == pytest.approx(right, abs=1e-7)


def test_break_points_at_one_place_rest_on_the_jump_that_holds():
    made = characteristic("relay with dead zone")
    system = System(
        "no zone",
        {"x": "", "v": ""},
        {"K": 1.0, "h": 0.5, "a": 0.0},
        **made.modes(lambda t, s, p, F: (s.v, p.h - F)),
        start={"x": 0.0, "v": 0.0},
    )
    for h, mode in ((0.5, "rest at a"), (-0.5, "rest at -a")):
        run = simulate(system, 3.0, h=h)
        assert set(run.mode) == {mode} and not run.events


def test_points_that_meet_but_for_rounding_make_no_jump():
    made = from_points([(-0.7, -0.9), (0.1, 0.3), (0.4, 0.35), (1.3, 2.7)])
    names = [mode.name for mode in made.modes(law)["modes"]]
    assert len(names) == 5 and not any(name.startswith("rest") for name in names)


def test_the_potential_does_not_cancel_and_sharp_bends_are_met():
    assert from_points([(1e9, 0), (1e9 + 1, 1)]).potential(1e9 + 1) == pytest.approx(0.5)
    p = {"a": 1e6, "b": 1e-3, "K": 1.0}
    slope = characteristic("dead zone with saturation").potential(1e6 + 1e-3, p)
    assert slope == pytest.approx(5e-4, rel=1e-6)
    smooth = characteristic("smooth relay").potential(2.0, {"K": 1.0, "alpha": 1e-9})
    assert smooth == pytest.approx(4e-9 / pi, rel=1e-9)
    ideal = 4 / (pi * 2.0) * math.sqrt(1 - 0.25**2)
    sharp = characteristic("smooth relay with dead zone")
    found = sharp.describing(2.0, {"K": 1.0, "a": 0.5, "alpha": 1e6}).real
    assert found == pytest.approx(ideal, rel=1e-5)


def test_a_formula_keeps_its_names():
    made = characteristic("relay", K="exp(1)*c")
    assert made.parameters == {"c"} and made(1.0, {"c": 2.0}) == pytest.approx(2 * math.e)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: characteristic(["relay"]), "no characteristic"),
        (lambda: characteristic("relay", K="1/0"), "divides by zero"),
        (lambda: characteristic("relay", K="K^2"), "no formula"),
        (lambda: characteristic("relay", K="atan(1, 2)"), "of one number"),
        (lambda: characteristic("relay", K="pi(1)"), "calls 'atan', .* 'tanh' only"),
        (lambda: characteristic("relay", K="'abc'"), "no formula"),
        (lambda: characteristic("relay", K=None), "neither a number"),
        (lambda: characteristic("relay", K=math.nan), "neither a number"),
        (lambda: characteristic("relay", K="x"), "x is the input"),
        (lambda: characteristic("relay")("a", {"K": 1.0}), "number or an array"),
        (lambda: characteristic("relay")(1.0, {"K": "a"}), "no value"),
        (lambda: characteristic("relay").describing("1", {"K": 1.0}), "amplitude"),
        (lambda: characteristic("relay").describing(math.inf, {"K": 1.0}), "amplitude"),
        (lambda: characteristic("relay").modes(law, ("x",)), "names the input and its rate"),
        (lambda: characteristic("saturation").check({"K": 1.0, "a": 0.0}), "has no value"),
        (
            lambda: characteristic("relay with hysteresis", memory=True).describing(
                0.3, {"K": 1.0, "a": 0.4}
            ),
            "does not reach the break points",
        ),
    ],
)
def test_more_that_makes_no_sense(make, words):
    with pytest.raises(ModelError, match=words):
        make()


def test_a_curve_of_many_points_is_as_one_of_few():
    x = np.linspace(0.0, 4.0, 41)
    made, between = from_points(list(zip(x, np.sin(x), strict=True))), np.linspace(-1, 5, 77)
    assert made(between) == pytest.approx(np.interp(between, x, np.sin(x)), abs=1e-12)
    assert made(1.0) == pytest.approx(np.interp(1.0, x, np.sin(x)))


def test_the_force_at_rest_is_a_short_formula():
    """One helper with its cases, and not all of the law in each of them."""

    def pulled(t, s, p, F):
        return s.v, (p.h * sin(p.omega * t) - F - p.delta * s.v) / p.mu

    springs = characteristic("two springs")
    values = {"h": 1.0, "omega": 2.0, "delta": 0.1, "mu": 0.3, **parameters("two springs")}
    values["c1"] = -1.0  # at L the force jumps from 0 to 1.5
    model = System(
        "springs",
        {"x": "m", "v": "m/s"},
        values,
        start={"x": 1.0, "v": 0.0},
        outputs={"F": springs.output(law=pulled)},
        **springs.modes(pulled),
    )
    shown = equations(model)
    (line,) = (
        line for line in shown._repr_markdown_().splitlines() if line.endswith("(rest at L)}")
    )
    assert line.count("held") == 1 and len(line) < 300
    held, symbols = shown.outputs["F"]["rest at L"], shown.states | shown.parameters
    at = {symbols[name]: value for name, value in (values | {"x": 0.5, "v": 0.0}).items()}
    for t in (0.1, 0.6, 2.0):
        found = float(held.subs(at | {shown.t: t}))
        assert found == pytest.approx(min(max(sin(2.0 * t), 0.0), 1.5))


def test_values_found_right_do_not_speak_for_others():
    relay, p = characteristic("relay with hysteresis"), {"K": 1.0, "a": 0.4}
    assert relay(1.0, p) == 1.0
    p["a"] = -0.2  # the same dict
    with pytest.raises(ModelError, match="branches cross"):
        relay(1.0, p)
    assert relay(1.0, p | {"a": 0.3}) == 1.0


def test_a_formula_that_has_no_value_says_so_in_an_output():
    """A function made of text has no __name__ among its globals: that must not hide its error."""
    relay, other = characteristic("relay", K="1"), characteristic("relay", K="1/c")
    model = System(
        "two relays",
        {"x": "m", "v": "m/s"},
        {"c": 0.0},
        start={"x": 1.0, "v": 0.0},
        outputs={"F": other.output("N")},
        **relay.modes(lambda t, s, p, F: (s.v, -F)),
    )
    with pytest.raises(ModelError, match="output 'F' fails at t = 0.*division by zero"):
        simulate(model, 1.0)["F"]


def test_a_parameter_may_be_an_array_as_x_may():
    relay = characteristic("relay")
    for _ in range(2):  # the second time two arrays would be compared
        assert relay([-1.0, 1.0], {"K": np.array([1.0, 2.0])}) == pytest.approx([-1.0, 2.0])
