"""Part 3, item 8 on the notebook's own model: rules by division, ξ piece by piece in closed form.

With all jumps the body moves in space without any: there the reference is a run of its height.
"""

from math import cos, exp, pi, sin, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labkit import simulate

NAME = "part3/08_leaf_spring_machines"
W = sqrt(0.5 / 0.7)
PRINTED = (1 - exp(-1.0), (1 - exp(-1.0)) * cos(2.0))
JOINED = ((1 - exp(-1.0)) / cos(1.0), (1 - exp(-1.0)) / cos(1.0) * cos(2.0) / sin(2.0))
ENDS = (1.0, 2.0, 4.0)


def rules(end):
    """[(instant, V1, V2)] of the default start: every crossing by hand, V in whole steps."""
    rows, t, V1, V2 = [(0.0, 0.9 * 1.3, 1.3)], 0.0, 0.9 * 1.3, 1.3
    while t <= end:
        for slow in (np.array([1.0, 0.5]), np.array([0.5, 1.0])):  # 2 comes round, then 1
            for way, factor in ((14.8, slow), (0.8, 1.3)):
                t += way / abs(V2 - V1)
                V1, V2 = (np.array([V1, V2]) * factor).tolist()
                rows.append((t, V1, V2))
    return [row for row in rows if row[0] <= end]


def pieces(machine, end):
    """[(begin, end, speed, piece, u at the begin)]: the way of a machine, cut at all corners."""
    changes = [(t, (V1, V2)[machine - 1]) for t, V1, V2 in rules(end)]
    found, t, u, k, V = [], 0.0, float(machine - 1), machine - 1, changes[0][1]
    for until, new in [*changes[1:], (end, None)]:
        while True:
            stop = min(until, t + (ENDS[k] - u) / V)
            found.append((t, stop, V, k, u))
            u, t = u + V * (stop - t), stop
            if stop == until:
                break
            u, k = (0.0, 0) if k == 2 else (ENDS[k], k + 1)
        V = new
    return found


def closed(machine, end, road=PRINTED):
    """(ξ, ξ') at the end of every piece, without jumps: free swing and forced part."""
    x, rows = np.zeros(2), []
    for begin, stop, V, k, u in pieces(machine, end):

        def forced(u, V=V, k=k):
            if k == 0:
                e = V**2 * exp(-u) / (V**2 + W**2)
                return np.array([e, -V * e])
            a = road[k - 1] * V**2 / (W**2 - V**2)
            return a * np.array([(cos(u), -V * sin(u)), (sin(u), V * cos(u))][k - 1])

        tau = stop - begin
        c, s = cos(W * tau), sin(W * tau)
        free = np.array([[c, s / W], [-W * s, c]]) @ (x - forced(u))
        x = free + forced(u + V * tau)
        rows.append((stop, *x))
    return np.array(rows)


def in_space(machine, end, road):
    """ξ at the end of every piece with all jumps: z'' = −(c/m)(z − y) knows no corner."""
    height = [
        lambda u: 1 - np.exp(-u),
        lambda u: road[0] * np.cos(u),
        lambda u: road[1] * np.sin(u),
    ]
    way, rows = pieces(machine, end), []
    begin, _, V, k, u = way[0]
    V0 = (0.9, 1.0)[machine - 1]  # ξ = ξ' = 0 at the start, before rule 1 acts
    state = [height[k](u), V0 * (exp(-u) if k == 0 else -road[0] * sin(u))]
    for begin, stop, V, k, u in way:
        y = height[k]
        found = solve_ivp(
            lambda t, z, b=begin, V=V, u=u, y=y: (z[1], -(W**2) * (z[0] - y(u + V * (t - b)))),
            (begin, stop), state, "DOP853", rtol=1e-12, atol=1e-13)  # fmt: skip
        state = found.y[:, -1]
        rows.append((stop, state[0] - y(u + V * (stop - begin))))
    return np.array(rows)


def test_handbook_values(names):
    system, p = names["system"], names["system"].values()
    assert names["horizon"] == names["horizon_two"] == 600.0
    assert (p.m, p.c, p.h, p.alpha, 4 * p.n) == (0.7, 0.5, 1.0, 1.0, 16.0)
    assert (p.near, p.crash, p.far, p.boost, p.brake) == (0.2, 0.1, 1.0, 1.3, 0.5)
    assert p.joined == p.kinks == p.steps == p.surges == 0
    run = simulate(system, 0.001)
    assert (run["V1"][0], run["V2"][0], run["x1"][0], run["x2"][0]) == (0.9, 1.0, 0.0, 1.0)


def test_the_forces_of_the_handbook(names):
    system, p = names["system"], names["system"].values()
    for k, u, force in (
        (0, 0.3, exp(-0.3)),
        (1, 1.4, PRINTED[0] * cos(1.4)),
        (2, 3.1, PRINTED[1] * sin(3.1)),
    ):
        s = system.S["far"](0.2, 0.1, 4 + u, 0.0, 0.0, 1.5, 0.9, 1.0, float(k), 1.0, 4.0, 0.0)
        s = s._replace(V1=0.9, k1=float(k), o1=4.0, V2=1.0, k2=1.0, o2=0.0)
        flow = system.modes["far"].flow(0.0, s, p)
        assert flow[:3] == pytest.approx([0.1, 0.81 * force - 0.5 / 0.7 * 0.2, 0.9])


def test_the_rules_by_division(names):
    run = simulate(names["system"], 600.0)
    found = [
        (e.t, e.after["V1"], e.after["V2"]) for e in run.events if e.transition.startswith("too")
    ]
    expected = rules(600.0)
    assert len(found) == len(expected) == 13
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-9)
    assert run.ended == "finished" and run["d"].min() == pytest.approx(0.2, abs=1e-9)


@pytest.mark.parametrize("joined", [0.0, 1.0])
@pytest.mark.parametrize("machine", [1, 2])
def test_the_swing_in_closed_form(names, machine, joined):
    run = simulate(names["system"], 600.0, joined=joined, rtol=1e-11)
    rows = closed(machine, 600.0, JOINED if joined else PRINTED)
    at = run.at(np.minimum(rows[:, 0], 600.0), side="before")
    assert np.abs(at[f"xi{machine}"] - rows[:, 1]).max() < 1e-6
    assert np.abs(at[f"w{machine}"] - rows[:, 2]).max() < 1e-6


def test_the_default_run_is_as_good_as_its_tolerance(names):
    run, rows = simulate(names["system"], 600.0), closed(1, 600.0)
    at = run.at(np.minimum(rows[:, 0], 600.0), side="before")["xi1"]
    assert np.abs(at - rows[:, 1]).max() < 5e-6


@pytest.mark.parametrize("road", ["printed", "joined"])
@pytest.mark.parametrize("machine", [1, 2])
def test_with_all_jumps_the_body_has_none(names, machine, road):
    """At the ends of pieces `before` the jump; instants differ by their rounding."""
    run = simulate(names["system_two"], 300.0, joined=float(road == "joined"), rtol=1e-11)
    rows = in_space(machine, 300.0, JOINED if road == "joined" else PRINTED)
    rows = rows[np.diff(rows[:, 0], prepend=-1.0) > 1e-6]  # a rule may act on a border
    t = np.minimum(rows[:, 0], 300.0)
    at = run.at(t - 1e-9, side="before")[f"xi{machine}"]
    assert np.abs(at - rows[:, 1]).max() < 1e-6


def test_the_jumps_of_the_reading(names):
    """ξ by −Δy and ξ' by −V Δy' at a border, ξ' by −y' ΔV at a change of speed."""
    run = simulate(names["system"], 120.0, kinks=1.0, steps=1.0, surges=1.0)
    first = next(e for e in run.events if e.transition == "border 1")
    assert first.t == pytest.approx(1 / 1.17, abs=1e-9)
    dy, slope = PRINTED[0] * (cos(1.0) - 1), -PRINTED[0] * sin(1.0) - exp(-1.0)
    assert first.after["xi1"] - first.before["xi1"] == pytest.approx(-dy, abs=1e-12)
    assert first.after["w1"] - first.before["w1"] == pytest.approx(-1.17 * slope, abs=1e-12)
    start = next(e for e in run.events if e.transition == "too far")
    assert start.after["w1"] - start.before["w1"] == pytest.approx(-1.0 * 0.27, abs=1e-12)
    expected = PRINTED[0] * sin(1.0) * 0.3
    assert start.after["w2"] - start.before["w2"] == pytest.approx(expected, abs=1e-12)


def test_steps_of_the_road(names):
    p, height, jump = names["system"].values(), names["height"], names["jump"]
    ends = [(height(k, 2.0**k, p), height(k, 2.0**k, p) + jump(height, k, p)) for k in range(3)]
    expected = [(0.632, 0.342), (-0.263, -0.239), (0.199, 0.0)]
    assert np.array(ends) == pytest.approx(np.array(expected), abs=6e-4)
    joined = p._replace(joined=1.0)
    assert [abs(jump(height, k, joined)) < 1e-12 for k in range(3)] == [True, True, False]


def test_largest_growth_by_the_jumps(names):
    largest = {}
    for jumps in (0.0, 1.0):
        run = simulate(
            names["system"], 600.0, joined=1.0, kinks=jumps, steps=jumps, surges=jumps, points=6001
        )
        largest[jumps] = np.array([np.abs(run[f"xi{i}"]).max() for i in (1, 2)])
    assert (largest[1.0] / largest[0.0]).max() == pytest.approx(2.1, abs=0.05)


@pytest.mark.parametrize(
    ("V1", "V2", "crash"),
    [(0.9, 1.79, False), (0.9, 1.81, True), (1.79, 0.9, False), (1.81, 0.9, True)],
)
def test_a_crash_needs_a_quotient_above_two(names, V1, V2, crash):
    run = simulate(names["rules_only"], 3000.0, start={"V1": V1, "V2": V2}, points=2)
    assert (run.ended == "terminal event") is crash
    if crash and V2 > V1:  # 14.8 m to rule 2, then 0.1 m at the halved speed
        t = 14.8 / (1.3 * (V2 - V1)) + 0.1 / (1.3 * (V2 / 2 - V1))
        assert run.t[-1] == pytest.approx(t, rel=1e-9)


def test_open_road(names):
    run = simulate(names["system"], 600.0, n=1e6)
    assert [e.transition for e in run.events if "border" not in e.transition] == ["too far"]
    assert run["d"][-1] == pytest.approx(1 + 0.13 * 600, abs=1e-9)


def test_critical_speeds_shake_without_bound(names):
    alone = names["alone"]
    for j in (1, 2):
        V = 4 * W / (2 * pi * j)
        assert names["critical"][j - 1] == pytest.approx(V, rel=1e-12)
        half, whole = (
            np.abs(simulate(alone, T, start={"V1": V}, points=4001, kinks=1.0, steps=1.0)["xi1"])
            .max()
            for T in (400.0, 800.0)
        )  # fmt: skip
        assert 1.7 < whole / half < 2.3
    calm = [
        np.abs(simulate(alone, T, start={"V1": 0.8}, points=4001)["xi1"]).max()
        for T in (400.0, 800.0)
    ]
    assert calm[1] < 1.05 * calm[0]


def test_place_and_product_differ_by_74_metres(names):
    t = 14.8 / 0.13
    assert names["off"] == pytest.approx(0.65 * t, rel=1e-9) == pytest.approx(74.0)


def test_tasks(names):
    found = names["solutions"]
    assert found["boost"] == pytest.approx(sqrt(2)) and found["crash"] == pytest.approx(1.8)
    assert found["behind"] == pytest.approx(0.65, rel=1e-9)
    V1, V2 = 0.9 * 1.6, 1.6
    first = 14.8 / (V2 - V1) + 0.8 / (V1 - V2 / 2)
    first += 14.8 / (1.6 * (V1 - V2 / 2)) + 0.8 / (1.6 * (V2 / 2 - V1 / 2))
    assert found["over"] == pytest.approx(first / (1 - 1 / 1.28), rel=1e-12)
    run = simulate(names["rules_only"], 600.0, boost=1.6, points=2, max_events=600)
    assert run.t[-1] == pytest.approx(found["over"], abs=1e-3)
