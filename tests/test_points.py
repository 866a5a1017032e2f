"""Points of a characteristic that are parameters, and those that a hand drags."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit import (
    Ended,
    ModelError,
    Transition,
    characteristic,
    explore,
    from_points,
    movable,
    simulate,
)
from labkit.switching import Builder

from .test_characteristics import FORMULAS, law, pendulum
from .test_concept_linear_systems import Hand

ZONE = [(-0.9, -1.0), (-0.4, 0.0), (0.4, 0.0), (0.9, 1.0)]
RISING = [(-0.5, -1.0), (0.0, 0.0), (0.8, 0.0), (1.3, 1.0)]
FALLING = [(-1.3, -1.0), (-0.8, 0.0), (0.0, 0.0), (0.5, 1.0)]
SIZES = {"K": 1.0, "a": 0.4, "b": 0.5, "d": 1.0}
sizes = st.floats(0.1, 3.0)


# ---- points that are formulas


@given(sizes, sizes, sizes, st.lists(st.floats(-9, 9), min_size=1, max_size=20))
@settings(max_examples=40, deadline=None)
def test_points_may_be_formulas_of_parameters(K, a, b, x):
    made = from_points([("-a - b", "-K"), ("-a", 0), ("a", 0), ("a + b", "K")])
    p = {"K": K, "a": a, "b": b}
    assert made.parameters == set(p)
    right = FORMULAS["dead zone with saturation"](np.array(x), 1, p)
    assert made(np.array(x), p) == pytest.approx(right, abs=1e-12)


def test_a_curve_of_formulas_runs_like_the_kind_and_needs_no_rest_at_its_kinks():
    made = from_points([("-a - b", "-K"), ("-a", 0), ("a", 0), ("a + b", "K")])
    p = {name: SIZES[name] for name in "Kab"}
    kind = characteristic("dead zone with saturation")
    assert not Builder(made, law, ("x", "v"))._jumps()
    runs = [simulate(pendulum(one, p), 40.0, rtol=1e-10) for one in (made, kind)]
    assert runs[0].final == pytest.approx(runs[1].final, abs=1e-9)
    assert len(runs[0].events) == len(runs[1].events)


def test_two_points_of_one_name_are_a_jump():
    made = from_points([("a", "-K"), ("a", "K"), ("a + b", "2*K")])
    assert made.rising.edges == ("a", "a + b")
    assert made.rising.pieces == ("-K", "K + ((2*K) - K)*(x - a)/((a + b) - a)", "2*K")
    assert Builder(made, law, ("x", "v"))._jumps() == [0]


@pytest.mark.parametrize(
    "points, words",
    [
        ([("x", 0), (1, 1)], "x is the input"),
        ([("a +", 0), (1, 1)], "no formula"),
        ([("a", 0), ("a", 1), ("a", 2)], "three points at x = a: a jump has two"),
        ([(0, "F"), (1, 1), (0.5, 2)], r"after \(1, 1\) the curve goes back to \(0.5, 2\)"),
        ([(None, 0), (1, 1)], "pairs .* of numbers or of formulas"),
    ],
)
def test_points_without_sense_are_refused(points, words):
    with pytest.raises(ModelError, match=words):
        from_points(points)


@pytest.mark.parametrize(
    "moved, words",
    [
        ({"x2": 0.5}, "must rise, but x2 = 0.5 lies right of x3 = 0.4"),
        ({"x2": 0.4}, "x2 and x3 are both 0.4: the piece"),
    ],
)
def test_values_that_go_back_are_refused_where_a_run_begins(moved, words):
    mine = movable([(-0.9, -1.0), (-0.4, 0.0), (0.4, 0.1), (0.9, 1.0)])
    own = mine.put_in(pendulum(characteristic("saturation"), SIZES), law, "N")
    with pytest.raises(ModelError, match=words):
        simulate(own, 1.0, **moved)


# ---- points that a hand drags


@pytest.mark.parametrize("branches", [(ZONE,), (RISING, FALLING)])
def test_a_movable_curve_is_the_plain_one_until_it_is_moved(branches):
    system = pendulum(characteristic("saturation"), SIZES)
    mine = movable(*branches)
    own = mine.put_in(system, law, "N")
    plain = pendulum(from_points(*branches), SIZES)
    for backend in ("compiled", "plain"):
        runs = [simulate(one, 40.0, rtol=1e-10, backend=backend) for one in (own, plain)]
        assert runs[0].final == pytest.approx(runs[1].final, abs=1e-9)
    assert set(own.parameters) == set(system.parameters) | set(mine.values)


@pytest.mark.parametrize("branches", [(ZONE,), (RISING, FALLING)])
def test_what_ends_a_run_of_the_system_ends_one_with_the_curve(branches):
    """Also where the system left from some of its pieces only: the new ones are others."""
    system = pendulum(characteristic("saturation"), SIZES)
    wall = Transition(
        tuple(system.modes)[:1], None, lambda t, s, p: abs(s.x) - 1.2, 1, label="the wall"
    )
    walled = system.variant("walled", transitions=[*system.transitions, wall])
    own = movable(*branches).put_in(walled, law, "N")
    assert max(abs(simulate(movable(*branches).put_in(system, law), 40.0)["x"])) > 1.3
    run = simulate(own, 40.0)
    assert run.ended is Ended.TERMINAL and abs(run.final["x"]) == pytest.approx(1.2)


def test_a_jump_shares_its_place_and_the_ends_of_two_branches_their_force():
    mine = movable([(-1, -1), (0, -1), (0, 1), (2, 1)])
    assert mine.values == {
        **{"x1": -1.0, "F1": -1.0, "x2": 0.0, "F2": -1.0},
        **{"F3": 1.0, "x4": 2.0, "F4": 1.0},
    }
    loop = movable(RISING, FALLING)
    assert loop.points[0][0][1] == loop.points[1][0][1] == "F_low"
    assert loop.points[0][-1][1] == loop.points[1][-1][1] == "F_high"
    loop.check(loop.values | {"F_low": -2.0, "F_high": 1.5})


def opened(*branches):
    own = movable(*branches).put_in(pendulum(characteristic("saturation"), SIZES), law, "N")
    return Hand(explore(own, 20.0, movable(*branches).draw("x"), sliders=["k3"]))


def test_a_dragged_point_changes_the_curve_and_the_motion():
    hand = opened(ZONE)
    assert [handle.at_place for handle in hand.panel.handles] == ZONE
    hand.drag(2, 0.7013, 0.199)
    moved = [*ZONE[:2], (0.70, 0.20), ZONE[3]]
    right = simulate(pendulum(from_points(moved), SIZES), 20.0, rtol=1e-10)
    assert hand.panel.handles[2].at_place == moved[2]
    assert hand.panel.run.final["x"] == pytest.approx(right.final["x"], abs=1e-5)
    hand.drag(3, 50.0, 50.0)  # no farther than the box
    assert hand.panel.handles[3].at_place == pytest.approx((1.8, 2.0))


def test_a_point_dragged_past_its_neighbour_is_refused_in_words_and_the_picture_stays():
    hand = opened(ZONE)
    before = hand.panel.run
    with pytest.raises(AssertionError):  # Hand wants a picture
        hand.drag(1, 0.6, 0.0)
    answer = hand.answers[-1]
    assert answer["kind"] == "error" and "trace" not in answer
    assert "x2 = 0.6 lies right of x3 = 0.4" in answer["text"]
    assert hand.panel.run is before
    hand.drag(1, -0.2, 0.0)
    assert hand.panel.run.p.x2 == pytest.approx(-0.2)


def test_of_a_loop_the_ends_move_together_and_crossing_branches_are_refused():
    hand = opened(RISING, FALLING)
    hand.drag(3, 1.4, 1.3)
    assert hand.panel.handles[3].at_place == (1.4, 1.3)
    assert hand.panel.handles[7].at_place == (0.5, 1.3)
    with pytest.raises(AssertionError):
        hand.drag(2, 0.8, 1.9)
    assert "branches cross" in hand.answers[-1]["text"]


def test_what_cannot_be_dragged_is_refused():
    with pytest.raises(ModelError, match="points to drag are numbers"):
        movable([("-a", -1), ("a", 1)])
    with pytest.raises(ModelError, match="goes back"):
        movable([(0, 0), (1, 1), (0.5, 2)])
    with pytest.raises(ModelError, match="a parameter 'x1' of its own"):
        movable(ZONE).put_in(pendulum(characteristic("saturation"), {"x1": 1.0, **SIZES}), law)


def test_a_point_dropped_at_no_force_has_no_minus_before_its_zero():
    mine = movable([(-1.0, -1.0), (0.0, 0.0), (1.0, 1.0)])
    dropped = mine._dropped("x2", "F2")(-1e-6, -1e-6)
    assert [math.copysign(1, value) for value in dropped.values()] == [1, 1], dropped
