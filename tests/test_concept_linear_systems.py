"""concepts/linear_systems: canonical forms, the map of equilibria, panels under a hand."""

import ast

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from labkit import ModelError, affine, borders, classify, equilibrium, explore, simulate
from labkit.draw import arrow_heads, flow_lines

from .helpers import code_cells, load, read, source

NAME = "concepts/linear_systems"
NUMBERS = st.floats(-4, 4).map(lambda value: round(value, 3))


@settings(max_examples=200, deadline=None)
@given(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS))
def test_the_recipe_reaches_the_canonical_form_of_any_matrix(entries):
    A = np.array(entries).reshape(2, 2)
    far = borders(A)["equal eigenvalues"]
    assume(far < 1e-12 or far > 1e-4)  # beside the border S is nearly singular, as the text says
    S, Lambda = load(NAME)["reduce"](A)
    size = max(1.0, np.abs(A).max() * np.abs(S).max())
    assert np.abs(A @ S - S @ Lambda).max() < 1e-7 * size
    assert np.linalg.matrix_rank(S, tol=1e-12) == 2
    (w, x), (y, z) = Lambda
    assert (x == 0 and y in (0, 1)) or (w == z and x == -y)


def test_the_family_has_its_trace_and_determinant_and_reaches_all_but_stars(names):
    rng = np.random.default_rng(0)
    for T, D, m in zip(
        rng.uniform(-8, 8, 50), rng.uniform(-16, 32, 50), rng.uniform(0.25, 3, 50), strict=True
    ):
        A, b = affine(names["system"], names["system"].values({"trace": T, "det": D, "m": m}))
        assert np.trace(A) == pytest.approx(T) and not b.any()
        assert np.linalg.det(A) == pytest.approx(D, abs=1e-9)
        assert pytest.approx(names["matrix"](T, D, m)) == A and not classify(A).endswith("star")
    # a turn makes the diagonal equal, by the formula of the text
    for A in rng.normal(size=(50, 2, 2)):
        (a, b), (c, d) = A
        angle = np.arctan2(-(a - d), b + c) / 2
        G = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turned = G.T @ A @ G
        assert turned[0, 0] == pytest.approx(turned[1, 1], abs=1e-12)


def test_the_solution_by_hand_is_the_exponential(names):
    t = np.linspace(0, 2, 5)
    for A in (
        [[1, 2], [3, 2]],
        [[1, -1], [1, 3]],
        [[-1, -2], [2, 1]],
        [[-2, 0], [0, -2]],
        [[0, 1], [0, 0]],
        [[-1, 2], [-3, -2]],
    ):
        right = np.array([expm(np.array(A, float) * now) @ (0.3, -0.8) for now in t]).T
        assert names["by_hand"](np.array(A, float), (0.3, -0.8), t) == pytest.approx(
            right, abs=1e-9
        )


@pytest.mark.parametrize(
    "T, D, border",
    [
        (-1, 2.25, "tr A = 0"),
        (-3, 2.2, "equal eigenvalues"),
        (-4, 0.3, "det A = 0"),
        (0, -1, "det A = 0"),
        (0, 1, "tr A = 0"),
    ],
)
def test_the_nearest_border_is_one_that_the_type_has(names, T, D, border):
    A = names["matrix"](T, D)
    assert names["named"](A) == (border, borders(A)[border])


@pytest.mark.parametrize(
    "A",
    [
        [[0, 0], [0, 0]],
        [[0, 1], [0, 0]],
        [[-1, 1], [1, -1]],
        [[-1, 1e-7], [1e-7, 0]],
        [[2, 1], [0, 2]],
        [[-1, 300], [-1e-3, -1]],
    ],
)
def test_flow_lines_solve_the_equation_also_where_a_is_singular(A):
    """Neighbours on a line are joined by a motion along A y.

    Heads stand at the points, and there are none where all is at rest.
    """
    A = np.array(A, float)
    lines, points = flow_lines(A, 4.0)
    pieces = lines.reshape(len(points), -1, 2)[:, :-1]
    # none is outside the picture all the way
    assert np.isfinite(pieces).all(axis=2).any(axis=1).all() and len(pieces) >= 6
    with np.errstate(invalid="ignore"):
        middle, way = (pieces[:, 1:] + pieces[:, :-1]) / 2, np.diff(pieces, axis=1)
        speed = middle @ A.T
        sine = (
            np.abs(way[..., 0] * speed[..., 1] - way[..., 1] * speed[..., 0])
            / (np.hypot(*way.T) * np.hypot(*speed.T)).T
        )
        small = np.hypot(*way.T).T < 0.05
    assert not np.any(sine[small & (np.hypot(*speed.T).T > 1e-6)] > 0.1)
    heads = arrow_heads(points, points @ A.T, 0.2).reshape(len(points), 4, 2)
    assert np.isnan(heads[:, 0]).any() == (not A.any()) and (heads[:, 1] == points).all()


# ---- the panels


class Hand:
    """Moves the handles of a panel as a browser does."""

    def __init__(self, panel):
        self.panel, self.answers = panel, []
        panel.send = lambda answer, buffers=(): self.answers.append(answer)
        panel._handle_custom_msg({"kind": "ready", "seq": 0, "view": "here"}, [])

    def drag(self, handle, x, y):
        made = self.panel.handles[handle]
        px, py = made.axes.transData.transform((x, y))
        self.panel._handle_custom_msg(
            {
                "kind": "drag",
                "seq": 1,
                "view": "here",
                "handle": handle,
                "x": px,
                "y": self.panel.scene.recorder.height - py,
            },
            [],
        )
        assert self.answers[-1]["kind"] == "picture", self.answers[-1]
        return self.answers[-1]["verdict"]

    def places(self):
        return [complex(*handle.at_place) for handle in self.panel.handles]


def drawn(hand, name):
    """What the curves of a panel have drawn under a name."""
    views = [view for view in hand.panel.view.views if name in getattr(view, "drawn", {})]
    (view,) = views
    return view.drawn[name]


@pytest.fixture
def chart(names, monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)
    return Hand(
        explore(
            names["system"],
            names["horizon"],
            names["draw_map"],
            verdict=names["verdict"],
            method=False,
            sliders={"trace": False, "det": False},
        )
    )


@pytest.mark.parametrize(
    "place, kind",
    [
        ((-3.0, 1.0), "stable node"),
        ((2.0, 4.0), "unstable spiral point"),
        ((0.03, 3.0), "centre"),
        ((-3.01, 2.21), "stable improper node"),
        ((1.0, -2.5), "saddle"),
        ((-2.0, 0.03), "degenerate (line of equilibria)"),
        ((0.0, 0.0), "degenerate (line of equilibria)"),
    ],
)
def test_the_dot_on_the_map_sets_the_system_and_the_portrait_follows(chart, names, place, kind):
    before = drawn(chart, "exact").get_xydata().copy()
    words = chart.drag(0, *place)
    A, _ = affine(names["system"], chart.panel.run.p)
    assert classify(A) == kind and f": {kind};" in words
    assert drawn(chart, "type").get_text() == kind
    trace, det = np.trace(A), np.linalg.det(A)
    assert [trace, det] == pytest.approx(place, abs=0.09)
    assert chart.places()[0] == pytest.approx(complex(trace, det), abs=1e-9)
    after = drawn(chart, "exact").get_xydata()
    assert after.shape != before.shape or np.nanmax(np.abs(after - before)) > 0.1
    assert after == pytest.approx(flow_lines(A, 4.0)[0], nan_ok=True)


def test_the_dot_stays_on_the_map_and_leaves_a_border_by_one_press_of_a_key(chart):
    chart.drag(0, 99, -99)
    assert chart.places()[0] == 5 - 4j
    for T, D in ((0.0, 3.0), (-3.0, 2.25), (-2.0, 0.0)):
        for dT, dD in ((0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1)):
            chart.drag(0, T, D)
            begin = chart.places()[0]
            chart.drag(0, T + dT, D + dD)
            assert chart.places()[0] != begin


def test_on_a_line_of_equilibria_the_line_is_drawn_and_the_run_ends_on_it(chart, names):
    chart.drag(0, -2.0, 0.0)
    run = chart.panel.run
    A, _ = affine(names["system"], run.p)
    line = drawn(chart, "_at rest").get_xydata()
    assert np.ptp(line[:, 0]) > 50 and pytest.approx(0, abs=1e-12) == A @ line.T
    assert A @ list(run.final.values()) == pytest.approx(0, abs=1e-6)
    chart.drag(0, -2.0, 0.8)
    assert len(set(map(tuple, drawn(chart, "_at rest").get_xydata()))) == 1


def test_the_orange_ring_of_the_text_is_in_the_picture_and_is_the_start(chart):
    """In the saved picture too, where the panel has drawn nothing of its own."""
    ring = drawn(chart, "_start")
    assert ring.get_xydata().tolist() == [[3.0, 0.0]] and ring.get_markeredgecolor() == "#D55E00"
    start = [handle.meaning for handle in chart.panel.handles].index("start")
    chart.drag(start, -1.0, 2.0)
    assert ring.get_xydata() == pytest.approx(np.array([[-1.0, 2.0]]), abs=0.06)
    begin = drawn(chart, "simulated").get_xydata()[0]
    assert begin == pytest.approx(ring.get_xydata()[0], abs=1e-9)


@pytest.fixture
def rings(names, monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)
    return Hand(
        explore(
            names["system"],
            names["horizon"],
            names["draw_spectrum"],
            verdict=names["verdict"],
            method=False,
            trace=-1.0,
            det=2.25,
            sliders={"trace": False, "det": False},
        )
    )


def test_a_pair_moves_as_mirror_images_and_the_matrix_follows(rings, names):
    rings.drag(0, -0.5, 2.0)
    assert rings.places()[:2] == pytest.approx([-0.5 + 2j, -0.5 - 2j])
    words = rings.drag(1, 0.75, -1.0)
    assert rings.places()[:2] == pytest.approx([0.75 + 1j, 0.75 - 1j])
    assert "unstable spiral point" in words
    A, _ = affine(names["system"], rings.panel.run.p)
    assert sorted(np.linalg.eigvals(A), key=lambda value: value.imag) == pytest.approx(
        [0.75 - 1j, 0.75 + 1j]
    )
    text = drawn(rings, "formulas").get_text()
    assert "x' =  0.75 x + 1.00 y" in text and "y' = −1.00 x + 0.75 y" in text
    S, Lambda = names["reduce"](A)
    for name, M in (("Λ", Lambda), ("S", S)):  # in brackets, above each other
        upper, lower = names["bracketed"](name, M)
        assert f"{M[0, 1] + 0.0:.2f} ⎤" in upper.replace("−", "-") and "⎣" in lower
        assert all(part.replace("-", "−") in text for part in (upper, lower))


def test_one_ring_alone_cannot_leave_the_axis_but_two_that_met_can(rings):
    rings.drag(0, -1.0, 0.0)  # the pair falls onto the axis, both at −1
    assert rings.places()[:2] == pytest.approx([-1, -1])
    rings.drag(0, 1.5, 0.0)
    assert rings.places()[:2] == pytest.approx([1.5, -1])
    words = rings.drag(0, 1.5, 2.0)
    assert rings.places()[:2] == pytest.approx([1.5, -1]) and "saddle" in words
    rings.drag(0, -2.0, 0.1)  # past the other one: it stays the same ring
    assert rings.places()[:2] == pytest.approx([-2, -1])
    rings.drag(0, -1.05, 0.0)
    rings.drag(0, -1.05, 1.2)
    assert rings.places()[:2] == pytest.approx([-1 + 1.2j, -1 - 1.2j])


def test_the_rings_stay_within_the_picture(rings):
    rings.drag(0, 99, 99)
    assert rings.places()[:2] == pytest.approx([3 + 3j, 3 - 3j])
    assert rings.panel.run.stopped == "finished"


def test_two_tanks_against_the_closed_form(names):
    """The total grows by the tap alone; the difference obeys u' = b − 2k u."""
    k, b = 0.7, 0.3
    run = simulate(names["tanks"], 5.0, k=k, tap=b, rtol=1e-11, atol=1e-13)
    assert run["x"] + run["y"] == pytest.approx(5 + b * run.t, abs=1e-9)
    assert run["x"] - run["y"] == pytest.approx(
        b / (2 * k) + (3 - b / (2 * k)) * np.exp(-2 * k * run.t), abs=1e-9
    )


def test_the_sentence_on_the_tanks_names_the_line_at_rest(names):
    with pytest.raises(ModelError, match=r"line through \(0, 0\) along it is at rest"):
        equilibrium(*affine(names["tanks"]))


# ---- what the reader answers

RIGHT = {
    "my_same": [True, True, True, False],
    "my_ratio": 1.0,
    "my_upright": "saddle",
    "my_rest": False,
    "my_difference": 0.25,  # b/2k
    "my_shift": 1e-5,
    "my_alone": False,
    "my_road": "improper node",
    "my_m": 1.5,
    "my_same_matrix": False,  # S (Λ − Λ') S⁻¹ = 0 forces Λ = Λ'
    "my_same_type": True,
    "my_step": 1 / 4.25,  # −2α/|λ|²
    "my_type": "stable node",
    "my_total": 10.0,  # b/ε
    "my_spirals": 23 / 72,  # 1 − P(real) for entries uniform in −1 … 1
}
WRONG = {
    "my_same": [True, True, True, True],
    "my_ratio": 2.0,
    "my_upright": "node",
    "my_rest": True,
    "my_difference": 0.5,
    "my_shift": 1e-10,
    "my_alone": True,
    "my_road": "centre",
    "my_m": 2.25,
    "my_same_matrix": True,
    "my_same_type": False,
    "my_step": 0.5,
    "my_type": "degenerate (line of equilibria)",
    "my_total": 5.0,
    "my_spirals": 1 - 2**-0.5,  # the normal distribution's
}


@pytest.mark.parametrize("answers, good", [(RIGHT, True), (WRONG, False)], ids=["right", "wrong"])
def test_every_check_knows_right_from_wrong(names, answers, good):
    asked = {}
    for cell in code_cells(read(NAME)):
        for node in ast.walk(ast.parse(source(cell))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "check":
                words = ast.unparse(node)
                asked[ast.unparse(node.args[0])] = eval(words, dict(names) | answers).ok
    assert asked == dict.fromkeys(answers, good)


def test_the_recipe_has_an_inverse_just_where_the_text_says(names):
    """c ≠ 0, and different eigenvalues must differ; β = 0 leaves the third S without a value."""
    c, l1, l2, beta = (names[name] for name in ("c", "l1", "l2", "beta"))
    found = {name: parts[1].det() for name, parts in names["forms"].items()}
    assert found["different"].expand() == (c * (l1 - l2)).expand()
    assert found["equal"] == c and found["complex"] == -c / beta
