"""part2/00_relay_pendulum: its model against the closed form of each piece, written once more."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

from labkit import simulate

from .helpers import load

NAME = "part2/00_relay_pendulum"


def piece(s, x, v, a, c):
    """Place and speed after s seconds of x'' + a x' + c = 0."""
    fade = -math.expm1(-a * s) / a if a else s
    drift = (s - fade) / a if a else s * s / 2
    return x + v * fade - c * drift, v - (c + a * v) * fade


def exact(phi, v, t_end, a, b1, b2):
    """(phi, v, [(t, phi / π, v) of each switch]) at t_end; no rest rule.

    Within a half the motion turns at most once; each monotonic part is searched for its exit.
    """
    t, switches = 0.0, []
    half = math.floor(phi / math.pi)  # even: right
    if math.sin(phi) == 0:
        half = round(phi / math.pi) - (v < 0)
    while True:
        c = b2 if half % 2 else b1
        edges = half * math.pi, (half + 1) * math.pi
        turn = math.log1p(a * v / c) / a if a and 1 + a * v / c > 1 else (v / c if not a else 0)
        ends = [turn] if turn > 0 else []
        last = ends[-1] if ends else 0.0
        step = 0.05
        while True:  # far enough to have left, or to the end
            last += step
            step *= 1.5
            ends.append(min(last, t_end - t))
            if last >= t_end - t or not edges[0] < piece(last, phi, v, a, c)[0] < edges[1]:
                break
        low, found = 1e-13, None
        for high in (e for e in ends if e > 1e-13):
            for edge, way in zip(edges, (-1, 1), strict=True):

                def beyond(s, phi=phi, v=v, c=c, edge=edge, way=way):
                    return (piece(s, phi, v, a, c)[0] - edge) * way

                if beyond(min(high, t_end - t)) > 0 >= beyond(low):
                    found = edge, way, brentq(beyond, low, high, xtol=1e-15)
            if found:
                break
            low = high
        if not found or t + found[2] > t_end:
            return *piece(t_end - t, phi, v, a, c), switches
        edge, way, s = found
        _, v = piece(s, phi, v, a, c)
        t, phi, half = t + s, edge, half + way
        switches.append((t, round(edge / math.pi), v))


def switches_of(run):
    return [(e.t, e.after["phi"], e.after["v"]) for e in run.events if "slow" not in e.transition]


@pytest.mark.parametrize("t_end", [40.0, 60.0])
def test_the_default_motion_is_the_exact_one(t_end):
    system = load(NAME)["system"]
    p = system.values()
    assert [p.a, p.b1, p.b2] == [0.2, 1, -1]
    assert [system.start[key] for key in ("phi", "v")] == [2, 0]
    phi, v, switches = exact(2.0, 0.0, t_end, 0.2, 1.0, -1.0)
    run = simulate(system, t_end, v_rest=0.0, rtol=1e-12, atol=1e-16)
    assert [run.final["phi"], run.final["v"]] == pytest.approx([phi, v], abs=1e-7)
    found = switches_of(run)
    assert len(found) == len(switches)
    assert np.allclose([t for t, *_ in found], [t for t, *_ in switches], rtol=0, atol=1e-8)


def test_a_motion_that_goes_over_the_top_is_the_exact_one():
    system = load(NAME)["system"]
    for start, a, b2 in (
        ((0.0, -3.0), 0.1, -0.5),
        ((1.0, 5.0), 0.15, -0.7),
        ((-2.0, 3.0), 0.0, -1),
    ):
        phi, v, switches = exact(*start, 30.0, a, 1.0, b2)
        run = simulate(
            system,
            30.0,
            start=dict(zip(("phi", "v"), start, strict=True)),
            a=a,
            b2=b2,
            v_rest=0.0,
            rtol=1e-11,
        )
        assert [run.final["phi"], run.final["v"]] == pytest.approx([phi, v], abs=1e-7)
        assert [round(x / math.pi) for _, x, _ in switches_of(run)] == [k for _, k, _ in switches]
        assert {k % 2 for _, k, _ in switches} == {0, 1}  # bottoms and tops
        inside = run["x"]
        assert np.all(np.abs(inside) <= math.pi)
        assert np.allclose(np.exp(1j * inside), np.exp(1j * run["phi"]), atol=1e-12)


def test_the_hundredth_and_the_thousandth_passage():
    """From x = 0 with 2 rad/s; and the notebook's closed form says the same."""
    names = load(NAME)
    _, _, switches = exact(0.0, 2.0, 84.0, 0.2, 1.0, -1.0)
    times = [t for t, *_ in switches]
    assert [times[99], times[999]] == pytest.approx([49.8427, 83.8821], abs=5e-5)
    assert np.allclose(
        names["passages"](0.0, 2.0, names["system"].values(), 1000)[0],
        times[:1000],
        rtol=0,
        atol=1e-7,
    )
    assert np.allclose(names["bottoms"](names["kick"])[:1000], times[:1000], rtol=0, atol=1e-6)


def test_the_passages_grow_like_the_exponential_of_a_third():
    _, _, switches = exact(2.0, 0.0, 90.0, 0.2, 1.0, -1.0)
    times = np.array([t for t, *_ in switches])
    counts = [np.sum(times < t) for t in (60, 75, 90)]
    assert counts[1] / counts[0] == pytest.approx(math.e, rel=0.05)
    assert counts[2] / counts[1] == pytest.approx(math.e, rel=0.02)
    names = load(NAME)
    assert names["early"] == np.sum(times < 20)
    assert names["late"] == np.sum((times >= 40) & (times < 60))


def test_the_rest_rule_stops_at_the_first_slow_passage_and_stays():
    names = load(NAME)
    _, _, switches = exact(2.0, 0.0, 60.0, 0.2, 1.0, -1.0)
    first = next(t for t, k, v in switches if k % 2 == 0 and abs(v) < 0.05)
    run = names["run"]
    (rest,) = run.events["too slow"].t
    assert rest == pytest.approx(first, abs=1e-6) and names["rested"] == rest
    assert run.mode[-1] == "rest" and run.final["v"] == 0
    assert abs(run.final["phi"]) < 1e-12
    pushed = simulate(names["system"], 20.0, b2=0.5, a=0.3, start={"phi": 2.0})
    assert not len(pushed.events["too slow"])  # no rest where one half pushes on


def test_the_rotation_lives_up_to_the_damping_that_is_said():
    """By the time of each half, not by the angle formula of the notebook."""

    def over(a):
        fall = brentq(lambda s: piece(s, 0.0, 0.0, a, -1.0)[0] - math.pi, 0.1, 50.0)
        w = piece(fall, 0.0, 0.0, a, -1.0)[1]
        turn = math.log1p(a * w / 0.5) / a
        return piece(turn, 0.0, w, a, 0.5)[0] - math.pi

    names = load(NAME)
    assert names["a_most"] == pytest.approx(brentq(over, 0.05, 0.4), rel=1e-9)


def test_the_time_of_a_turn_is_that_of_the_cycle_and_the_phase_is_the_starts():
    def half(w, c):
        last = math.log1p(0.1 * w / c) / 0.1 if c > 0 else 30.0  # where it turns
        s = brentq(lambda s: piece(s, 0.0, w, 0.1, c)[0] - math.pi, 1e-3, last, xtol=1e-15)
        return s, piece(s, 0.0, w, 0.1, c)[1]

    def turn(w):  # from the bottom up the weak half, down the strong one
        up, w = half(w, 0.5)
        down, w = half(w, -1.0)
        return up + down, w

    w = brentq(lambda w: turn(w)[1] - w, 2.2, 6.0, xtol=1e-14)
    names = load(NAME)
    for start, found in ((-3.0, "1"), (-4.0, "2")):
        assert names["T" + found] == pytest.approx(turn(w)[0], abs=1e-7)
        *_, switches = exact(0.0, start, 300.0, 0.1, 1.0, -0.5)
        last = [t for t, k, _ in switches if k % 2 == 0][-1]
        assert names["last" + found] == pytest.approx(last, abs=1e-5)
    assert 0.1 < names["shift"] < 0.9


def test_the_basins_are_those_of_the_exact_motion():
    names, rng = load(NAME), np.random.default_rng(7)
    seen = set()
    for phi, v in rng.uniform((-3.1, -5), (3.1, 5), size=(40, 2)):
        end, _, switches = exact(phi, v, 50.0, 0.1, 1.0, -0.5)
        then = [t for t, k, _ in switches if k % 2]  # over the top
        exact_fate = "rotation" if then and then[-1] > 40 else "rest"
        run = simulate(names["uneven"], 50.0, start={"phi": phi, "v": v})
        assert names["fate"](run) == exact_fate
        seen.add(exact_fate)
    assert seen == {"rest", "rotation"}


def test_just_over_the_top():
    """v²/2 = π, and the relay pendulum is there after √(2π) s, by x'' = −1."""
    names = load(NAME)
    assert names["least"] == pytest.approx(math.sqrt(2 * math.pi))
    for extra, relay, smooth in names["rows"]:
        v = math.sqrt(2 * math.pi) + extra
        at_top = math.sqrt(v * v - 2 * math.pi)
        assert relay == pytest.approx(v - at_top, abs=1e-6)
        # the smooth one: K(k)/… by quadrature of 1/θ'
        m = (2 + extra) ** 2 / 4
        assert smooth == pytest.approx(ellipk(1 / m) / math.sqrt(m), abs=1e-4)
