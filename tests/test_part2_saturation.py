"""Assignments 1.e and 1.f on their notebooks' models: closed forms, SciPy, and the real play."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from labkit import Ended, ModelError, from_points, simulate

from .helpers import load

LIMIT = "part2/1e_saturation"
LATE = "part2/1f_saturation_hysteresis"
few = settings(max_examples=15, deadline=None)
sizes = st.floats(0.3, 2.0)


def potential(x, kappa, a, k2):
    x = abs(x)
    motor = kappa * x * x / (2 * a) if x <= a else kappa * (x - a / 2)
    return motor - k2 * x * x / 2


def swing(A, kappa, a, k2):
    """Time of a free swing by quadrature, x = A (1 − u²)."""

    def slow(u):
        x = A * (1 - u * u)
        return 2 * A * u / math.sqrt(2 * (potential(A, kappa, a, k2) - potential(x, kappa, a, k2)))

    kink = [math.sqrt(1 - a / A)] if a < A else []
    ends = [1e-9, *kink, 1.0]
    return 4 * sum(
        quad(slow, *two, epsabs=1e-11, limit=200)[0] for two in zip(ends, ends[1:], strict=False)
    )


def clipped(p):
    """The law of 1.e for SciPy, written from the handbook."""

    def flow(t, y):
        F = min(p["K"], max(-p["K"], p["K"] * y[0] / p["a"]))
        push = p["k1"] * F + p["k2"] * y[0] + p["k3"] * math.sin(p["k4"] * t)
        return [y[1], push - p["delta"] * y[1]]

    return flow


def along(piece, p, t0, x, v):
    """x(τ) and v(τ) from (x, v) at t0, with F = slope·x + level, without damping: closed form."""
    slope, level = piece
    k = -p["k1"] * slope - p["k2"]  # x'' = −k x + k1·level + k3 sin k4 t
    middle, wave = p["k1"] * level / k, p["k3"] / (k - p["k4"] ** 2)
    root = np.sqrt(complex(k))
    c = x - middle - wave * math.sin(p["k4"] * t0)
    d = v - wave * p["k4"] * math.cos(p["k4"] * t0)

    def place(tau):
        own = c * np.cos(root * tau) + d / root * np.sin(root * tau)
        return middle + wave * np.sin(p["k4"] * (t0 + tau)) + own.real

    def speed(tau):
        own = d * np.cos(root * tau) - c * root * np.sin(root * tau)
        return wave * p["k4"] * np.cos(p["k4"] * (t0 + tau)) + own.real

    return place, speed


def walk(modes, mode, p, t_end, x=1.0, v=0.0):
    """(x, v, modes entered) at t_end from closed forms.

    modes: name -> function of the last turn -> (slope, level), [(is it x, limit, way, next mode)].
    """
    t, turn, seen, step = 0.0, x, [], 0.002
    while True:
        piece, exits = modes[mode](turn)
        place, speed = along(piece, p, t, x, v)
        tau, found = 1e-7 + step * np.arange(int(min(t_end - t, 20.0) / step) + 2), []
        for is_x, limit, way, after in exits:
            g = place if is_x else speed
            values = way * (g(tau) - limit)
            for k in np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))[:1].tolist():
                root = brentq(lambda q, g=g, u=limit: g(q) - u, tau[k], tau[k + 1], xtol=1e-14)
                found.append((root, after))
        if not found or t + min(found)[0] > t_end:
            return float(place(t_end - t)), float(speed(t_end - t)), seen
        first, mode = min(found)
        t, x, v = t + first, float(place(first)), float(speed(first))
        turn = x if abs(v) < 1e-9 else turn
        seen.append(mode)


def test_the_default_run_at_a_hundred_seconds_is_exact():
    book = load(LIMIT)
    p = book["system"].values()._asdict()
    modes = {
        "left": lambda turn: ((0.0, -1.0), [(True, -0.4, 1, "middle")]),
        "middle": lambda turn: ((2.5, 0.0), [(True, 0.4, 1, "right"), (True, -0.4, -1, "left")]),
        "right": lambda turn: ((0.0, 1.0), [(True, 0.4, -1, "middle")]),
    }
    x, v, seen = walk(modes, "right", p, 100.0)
    run, switches = simulate(book["system"], 100.0, rtol=1e-10), len(seen)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert len(run.events) == switches


@few
@given(st.floats(0.1, 8.0), sizes, sizes, st.floats(0.2, 3.0))
def test_the_hanging_masss_swing_takes_the_time_of_theory(A, K, a, spring):
    book = load(LIMIT)
    p = book["hanging"].values({"K": K, "a": a, "k2": -spring})
    T = book["period"](A, p)
    assert swing(A, K, a, -spring) == pytest.approx(T, rel=1e-6)
    changes = {"K": K, "a": a, "k2": -spring, "x_end": 50.0, "rtol": 1e-11}
    run = simulate(book["hanging"], T, start={"x": A}, **changes)
    assert run.final["x"] == pytest.approx(A, abs=1e-7)


@few
@given(st.floats(0.1, 0.98), st.floats(0.3, 1.5), st.floats(0.1, 0.9), st.floats(0.7, 2.0))
def test_upside_down_the_swing_and_the_brink_are_those_of_theory(part, K, share, gravity):
    book = load(LIMIT)
    top = K / gravity
    a, A = share * top, part * top
    p = book["upside_down"].values({"K": K, "a": a, "k2": gravity})
    assert book["period"](A, p) == pytest.approx(swing(A, K, a, gravity), rel=1e-6)
    assert book["brink"](p) == pytest.approx((top, math.sqrt(K * K / gravity - K * a)))
    for v, falls in ((0.999, False), (1.001, True)):
        start = {"v": v * book["brink"](p)[1]}
        run = simulate(book["upside_down"], 60.0, K=K, a=a, k2=gravity, start=start)
        assert (run.ended is not Ended.FINISHED) == falls


def test_a_mass_at_rest_beyond_the_top_falls():
    model = load(LIMIT)["upside_down"]
    for x, falls in ((0.999, False), (1.001, True), (-1.001, True)):
        run = simulate(model, 40.0, start={"x": x})
        assert (abs(run.final["x"]) > 9.99) == falls


@pytest.mark.parametrize("k4", [0.7, 1.0, 2.0])
def test_fingers_begin_where_the_integrals_along_the_simulated_way_say(k4):
    """Melnikov's integrals by SciPy along the way from top to top: no formula of the notebook."""
    book = load(LIMIT)
    p = book["shaken"].values()._replace(k4=k4)
    rest = {**p._asdict(), "k3": 0.0, "delta": 0.0}
    flow = clipped(rest)

    def both(t, y):
        x, v = y[:2]
        return [*flow(t, [x, v]), v * v, v * math.cos(k4 * t)]

    v0 = math.sqrt(p.K**2 / p.k2 - p.K * p.a)
    done = solve_ivp(both, (0, 14.0), [0.0, v0, 0, 0], rtol=1e-12, atol=1e-13, max_step=0.02)
    lost, given_back = done.y[2:, -1]
    assert abs(done.y[0, -1] - 1) < 1e-3
    assert book["fingers_begin"](p) == pytest.approx(p.delta * lost / given_back, rel=1e-4)


def test_the_linear_swing_is_a_solution_and_rest_does_not_lead_to_it():
    book = load(LIMIT)
    p = book["shaken"].values()
    size, x, v = book["linear"](p)
    flow = clipped(p._asdict())
    for start in ([x, v], [0.0, 0.0]):
        right = solve_ivp(flow, (0, 60), start, method="DOP853", rtol=1e-11, atol=1e-13,
                          max_step=0.05).y[:, -1]  # fmt: skip
        run = simulate(book["shaken"], 60.0, start=dict(zip("xv", start, strict=True)), rtol=1e-11)
        assert [run.final["x"], run.final["v"]] == pytest.approx(right, abs=1e-5)
        wide = np.abs(run["x"][run.t > 50]).max()
        assert (wide < p.a) == (start[0] != 0.0)
        if start[0] != 0:
            assert list(right) == pytest.approx(book["linear"](p, 60.0)[1:], abs=1e-6)


def test_the_maps_lose_their_safe_starts():
    book = load(LIMIT)
    maps, side = book["maps"], book["side"]
    cell = (side[1] - side[0]) ** 2
    assert maps[0.0].max() == 2 and set(maps[0.0].ravel()) == {0.0, 2.0}
    area = 4 * quad(lambda x: math.sqrt(2 * (0.3 - potential(x, 1, 0.4, 1))), 0, 1)[0]
    assert maps[0.0].sum() / 2 * cell > area  # friction adds to what is held without it
    assert book["safe"][0.2] < 30 < 80 < book["safe"][0.1]


def test_a_curve_of_ones_own_holds_less_on_its_weak_side():
    book = load(LIMIT)
    v = math.sqrt(2 * (0.5 * 0.5 - 0.5 * 0.2 / 2 - 0.125))  # motor of 0.5 N from −0.2 m on
    assert -book["knock"]["left"] == pytest.approx(v)
    for share, falls in ((0.999, False), (1.001, True)):
        run = simulate(book["own"], 40.0, start={"v": -share * v})
        assert (run.ended is not Ended.FINISHED) == falls


@pytest.mark.parametrize(
    "lists, words",
    [
        ([[(0, 0), (0.4, 1), (0.3, 1)]], r"goes back to \(0.3, 1\)"),
        ([[(-1, -1), (1, 1)], [(-1, -1), (1, 2)]], "do not meet on the right"),
        ([[(-0.4, -1), (-0.4, 1)], [(0.4, -1), (0.4, 1)]], "the branches cross"),
    ],
)
def test_a_list_that_is_no_characteristic_is_refused_with_a_reason(lists, words):
    with pytest.raises(ModelError, match=words):
        from_points(*lists)


# ---- 1.f: the lag


def lines(d=1.0, a=0.4):
    """The formula of 1.f for `walk`, from the handbook: three pieces a direction, K = 1."""
    found = {}
    for way, arrow, back in ((1, "→", "←"), (-1, "←", "→")):
        low, high = way * d * a - a, way * d * a + a
        slope = (1 / a, -way * d)
        pieces = (
            ((0.0, -1.0), -math.inf, low),
            (slope, low, high),
            ((0.0, 1.0), high, math.inf),
        )
        for k, (piece, left, right) in enumerate(pieces):
            wall, after = (right, k + 1) if way > 0 else (left, k - 1)

            def exits(turn, piece=piece, wall=wall, way=way, back=back, after=after, arrow=arrow):
                place = turn_of(back, d, a)
                return piece, [(True, wall, way, f"{arrow}{after}"), (False, 0.0, -way, place)]

            found[f"{arrow}{k}"] = exits
    return found


def turn_of(arrow, d, a):
    """All turns of these tests lie outside the loop: F stays as it was."""
    return "←2" if arrow == "←" else "→0"


def teeth(d=1.0, a=0.4):
    """The play with a limit, for `walk`, from its meaning: the driven wheel rests in the gap."""
    gap, full = d * a, (1 + d) * a

    def inside(turn):
        w = turn - gap if turn > 0 else turn + gap  # turned at the right or at the left tooth
        return (0.0, w / a), [(True, w + gap, 1, "right"), (True, w - gap, -1, "left")]

    return {
        "top": lambda turn: ((0.0, 1.0), [(True, a - gap, -1, "left")]),
        "bottom": lambda turn: ((0.0, -1.0), [(True, gap - a, 1, "right")]),
        "right": lambda turn: ((1 / a, -d), [(True, full, 1, "top"), (False, 0.0, -1, "gap")]),
        "left": lambda turn: ((1 / a, d), [(True, -full, -1, "bottom"), (False, 0.0, 1, "gap")]),
        "gap": inside,
    }


def test_the_formulas_default_run_at_a_hundred_seconds_is_exact():
    system = load(LATE)["system"]
    x, v, seen = walk(lines(), "←2", system.values()._asdict(), 100.0)
    run = simulate(system, 100.0, rtol=1e-10)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    through = sum("through" in event.transition for event in run.events)
    assert through + len(run.events["stop"].t) == len(seen)


@pytest.mark.parametrize("x, k3", [(1.0, 0.5), (0.7, 0.1), (0.45, 0.05)])
def test_the_gear_is_the_play_followed_by_a_limit(x, k3):
    gear = load(LATE)["gear"]
    p = gear.values({"k3": k3})._asdict()
    right = walk(teeth(), "top" if x > 0.8 else "gap", p, 60.0, x=x)
    run = simulate(gear, 60.0, k3=k3, start={"x": x}, rtol=1e-11)
    assert [run.final["x"], run.final["v"]] == pytest.approx(right[:2], abs=1e-7)
    names = {"→ slope": "right", "← slope": "left", "in the gap": "gap", "F = K": "top",
             "F = -K": "bottom"}  # fmt: skip
    entered = [names[mode] for mode in run.mode[1:][run.mode[1:] != run.mode[:-1]]]
    assert [mode for mode in entered if mode != "gap"] == [m for m in right[2] if m != "gap"]


@few
@given(st.floats(0.02, 0.39))
def test_within_the_gap_the_gear_gives_nothing(x):
    run = simulate(load(LATE)["gear"], 50.0, k3=0.0, start={"x": x}, rtol=1e-11)
    assert not run.events and run.at(14 * math.pi)["x"] == pytest.approx(x, abs=1e-8)


@few
@given(st.floats(0.3, 4.0), sizes, st.floats(0.2, 0.8), st.floats(0.0, 1.5))
def test_the_free_pendulum_turns_where_the_energy_says(A, K, a, d):
    """Work by quadrature of the printed formula."""
    book = load(LATE)
    p = book["system"].values({"K": K, "a": a, "d": d})
    if (K * d) / (K / a + 1) * 1.05 >= A:  # it may begin to either side
        return

    def F(x):
        return min(K, max(-K, K * (x - d * a) / a))

    B = book["next_turn"](A, p)
    cuts = [q for q in ((d - 1) * a, (d + 1) * a) if -A < q < B]
    work = sum(quad(F, low, high)[0] for low, high in zip([-A, *cuts], [*cuts, B], strict=True))
    assert -work - B * B / 2 + A * A / 2 == pytest.approx(0, abs=1e-9)
    run = simulate(book["system"], 8.0, K=K, a=a, d=d, k3=0.0, start={"x": A}, rtol=1e-11)
    assert abs(run.events["stop"].before["x"][0]) == pytest.approx(B, abs=1e-7)


def half_swing(A, delta):
    """(next turn, time) with friction, from the line for x' > 0, by SciPy."""

    def flow(t, y):
        F = min(1.0, max(-1.0, y[0] / 0.4 - 1))
        return [y[1], -F - y[0] - delta * y[1]]

    def stops(t, y):
        return y[1]

    stops.terminal, stops.direction = True, -1
    done = solve_ivp(flow, (0, 100), [-A, 0.0], events=stops, rtol=1e-11, atol=1e-13,
                     max_step=0.02)  # fmt: skip
    return done.y[0, -1], done.t[-1]


@pytest.mark.parametrize("row", range(6))
def test_the_self_oscillation_is_the_fixed_point_of_the_half_swing(row):
    delta, A, _, T, _ = load(LATE)["rows_of_friction"][row]
    B, half = half_swing(A, delta)
    assert pytest.approx(A, rel=1e-6) == B
    assert 2 * half == pytest.approx(T, rel=1e-4)
    assert B > 2 / 7


def test_strong_friction_stops_the_gear_and_not_the_formula():
    book = load(LATE)
    stop = book["solutions"]["stop"]
    for name, model in book["pair"].items():
        for delta in (0.95 * stop, 1.05 * stop):
            run = simulate(model, 400.0, k3=0.0, delta=delta)
            size = np.abs(run["x"][run.t > 380]).max()
            assert (size > 0.3) == (name == "formula" or delta < stop)


def test_the_swing_follows_the_force_within_a_band_and_keeps_no_phase_of_its_own():
    book = load(LATE)
    for k4, follows in ((1.22, True), (1.36, True), (1.12, False), (1.5, False)):
        run = simulate(book["clock"], 500.0, k4=k4, rtol=1e-10)
        t = 400.0 + np.linspace(0, 40, 100)
        gap = np.abs(run.at(t)["x"] - run.at(t + 2 * math.pi / k4)["x"]).max()
        assert (gap < 1e-4) == follows
    assert book["gaps"][1] < 1e-6 < 0.1 < book["gaps"][0]


def test_with_the_other_sign_the_formula_stands_where_its_lines_hold_it():
    book = load(LATE)
    for x in (-0.66, 0.0, 0.4, 0.66):
        run = simulate(book["system"], 20.0, k1=1.0, k3=0.0, start={"x": x})
        assert np.ptp(run["x"]) == 0 and run.mode[-1] == "at rest"
        assert run["F"][-1] == pytest.approx(x)
    run = simulate(book["system"], 20.0, k1=1.0, k3=0.0, start={"x": 0.68})
    assert np.ptp(run["x"]) > 0.01
