"""Types, exact solutions and designs of linear systems, against 50-digit arithmetic, SciPy's expm
and closed forms.
"""

import math
from decimal import Decimal, localcontext

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from labkit import Mode, ModelError, Parameter, System, simulate
from labkit.linear import (
    affine,
    borders,
    classify,
    eigenlines,
    eigenvalues,
    equilibrium,
    error_table,
    exact,
    true_error,
)
from labkit.similarity import (
    canonical,
    check_design,
    design,
    matrix_a,
    matrix_b,
    reflection,
    rotation,
)

KINDS = {
    "stable node": (-1.0, -3.0),
    "unstable node": (3.0, 1.0),
    "stable star": (-2.0,),
    "unstable star": (2.0,),
    "stable improper node": (-1.0,),
    "unstable improper node": (1.5,),
    "saddle": (1.0, -2.0),
    "centre": (2.0,),
    "stable spiral point": (-0.5, 2.0),
    "unstable spiral point": (0.5, -2.0),
}
BY = {
    "matrix A": matrix_a((1, 2), (-2, 1)),
    "matrix B": matrix_b((1, 2), (0.5, 0.5)),
    "reflection": reflection((1, 3)),
    "rotation": rotation(0.7),
}

sizes = st.floats(0.05, 5)
signed = st.floats(-3, 3)


@st.composite
def canonicals(draw):
    """A kind and its Λ, some way from the borders that are no equality."""
    kind = draw(st.sampled_from(list(KINDS)))
    sign = -1 if kind.startswith("stable") else 1
    x = sign * draw(sizes)
    if kind.endswith(" node") and "improper" not in kind:
        return kind, canonical(kind, x, x + sign * draw(sizes))
    if kind == "saddle":
        return kind, canonical(kind, x, -draw(sizes))
    if "spiral" in kind:
        return kind, canonical(kind, x, draw(sizes) * draw(st.sampled_from([-1, 1])))
    return kind, canonical(kind, x)


@st.composite
def similarities(draw):
    by = draw(st.sampled_from(list(BY)))
    u = (draw(signed), draw(signed))
    if by == "rotation":
        return by, rotation(draw(st.floats(-7, 7)))
    if by == "reflection":
        assume(math.hypot(*u) > 1e-3)
        return by, reflection(u)
    if by == "matrix A":
        k = draw(signed)
        return by, matrix_a(u, (-k * u[1], k * u[0]))
    v = (draw(signed), draw(signed))
    assume(abs(1 + u[0] * v[0] + u[1] * v[1]) > 0.05)
    return by, matrix_b(u, v)


points = st.tuples(signed, signed)


# ---- the type, against eigenvalues in 50 digits


def in_fifty_digits(A):
    """Type from the eigenvalues, and distances to the borders, in decimals of 50 digits."""
    w, x, y, z = (Decimal(value) for value in A.ravel().tolist())
    a, q, d, p = (w + z) / 2, (y - x) / 2, (w - z) / 2, (x + y) / 2
    r, turn = (d * d + p * p).sqrt(), (a * a + q * q).sqrt()
    square = d * d + x * y
    distance = min(abs(turn - r), abs(r - abs(q)), abs(a) if square < 0 else r) / (turn + r)
    if square < 0:
        return ("stable" if a < 0 else "unstable") + " spiral point", distance
    high, low = a + square.sqrt(), a - square.sqrt()
    return "saddle" if low < 0 < high else (
        "stable" if high < 0 else "unstable"
    ) + " node", distance


def matrices(count, seed):
    """Random matrices of all sizes.

    Half of them on purpose near a border, at relative distances from 1e-1 to 1e-15.
    """
    rng = np.random.default_rng(seed)
    made = rng.normal(size=(count, 2, 2))
    bases = np.array(
        [
            S @ canonical(kind, *KINDS[kind]) @ inverse
            for kind in KINDS
            for S, inverse in BY.values()
        ]
    )
    near = bases[rng.integers(len(bases), size=count // 2)]
    made[::2] = near + 10.0 ** -rng.uniform(1, 15, size=(count // 2, 1, 1)) * made[::2]
    return made * 10.0 ** rng.uniform(-12, 12, size=(count, 1, 1))


def compare_types(count, seed):
    """How many matrices lay outside the border width 1e-15, and which were named wrongly."""
    compared, wrong = 0, []
    with localcontext(prec=50):
        for A in matrices(count, seed):
            kind, distance = in_fifty_digits(A)
            if distance > Decimal("1e-15"):
                compared += 1
                if classify(A, tolerance=0) != kind:
                    wrong.append((A.tolist(), kind, classify(A, 0), float(distance)))
    return compared, wrong


def test_type_of_100000_matrices_against_50_digits():
    compared, wrong = compare_types(100_000, seed=1)
    assert compared > 95_000 and not wrong, wrong[:3]


def test_the_decimal_truth_agrees_with_mpmath():
    with mpmath.workdps(50), localcontext(prec=50):
        for A in matrices(100, seed=2):
            values = mpmath.eig(mpmath.matrix(A.tolist()), left=False, right=False)
            high, low = sorted((value.real for value in values), reverse=True)
            turns = max(abs(value.imag) for value in values) > 1e-30 * abs(values[0])
            name = "spiral point" if turns else "saddle" if low < 0 < high else "node"
            assert in_fifty_digits(A)[0] == (
                "saddle" if name == "saddle" else f"{'stable' if high < 0 else 'unstable'} {name}"
            )


@settings(max_examples=300, deadline=None)
@given(canonicals(), similarities())
def test_the_type_is_unchanged_by_every_similarity(case, similarity):
    kind, Lambda = case
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 300)
    A = S @ Lambda @ inverse
    assert classify(A, tolerance=1e-11) == kind
    assert np.trace(A) == pytest.approx(np.trace(Lambda), abs=1e-9) and np.linalg.det(
        A
    ) == pytest.approx(np.linalg.det(Lambda), rel=1e-8, abs=1e-8)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(-5, 5), min_size=4, max_size=4),
    st.floats(0, 2 * math.pi),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_borders_are_distances(entries, angle, x, y):
    """Nothing nearer than the distance crosses, and a change of that size does reach the border."""
    A = np.array(entries).reshape(2, 2)
    norm = np.linalg.norm(A, 2)
    assume(norm > 0.1)
    near = borders(A)
    assert near["det A = 0"] * norm == pytest.approx(np.linalg.svd(A)[1][-1], abs=1e-12)
    G, H = rotation(angle).S, reflection((1.0, 0.3)).S
    change = (x * G + y * H) / max(np.linalg.norm(x * G + y * H, 2), 1e-9)
    for name, value in (
        ("det A = 0", np.linalg.det),
        ("tr A = 0", np.trace),
        ("equal eigenvalues", lambda M: (M[0, 0] - M[1, 1]) ** 2 + 4 * M[0, 1] * M[1, 0]),
    ):
        if near[name] > 1e-6:
            assert np.sign(value(A + 0.999 * near[name] * norm * change)) == np.sign(value(A))
    a, q = np.trace(A) / 2, (A[1, 0] - A[0, 1]) / 2
    R = A - a * np.eye(2) - q * np.array([[0, -1], [1, 0]])
    r = np.hypot(R[0, 0], R[0, 1])
    turned = A - (abs(q) - r) * (1 if q >= 0 else -1) * np.array([[0, -1], [1, 0]])  # |q| becomes r
    assert np.linalg.norm(turned - A, 2) == pytest.approx(
        near["equal eigenvalues"] * norm, abs=1e-12
    )
    assert (turned[0, 0] - turned[1, 1]) ** 2 + 4 * turned[0, 1] * turned[1, 0] == pytest.approx(
        0, abs=1e-10
    )
    assert np.linalg.norm(A - a * np.eye(2), 2) == pytest.approx(near["star"] * norm, abs=1e-12)


def test_tolerance_is_the_distance_to_the_border():
    for kind, on, off in (
        ("stable star", np.diag([-2.0, -2.0]), [[0, 1], [1, 0]]),
        ("centre", [[0.0, 2], [-2, 0]], np.eye(2)),
        ("stable improper node", [[-1.0, 0], [1, -1]], [[0, 0.5], [-0.5, 0]]),
    ):
        for distance in (1e-3, 1e-6):
            A = np.array(on) + distance * np.array(off)
            measured = {
                "stable star": "star",
                "centre": "tr A = 0",
                "stable improper node": "equal eigenvalues",
            }[kind]
            near = borders(A)[measured]
            assert classify(A, 1.01 * near) == kind != classify(A, 0.99 * near)
    assert borders(np.zeros((2, 2))) == {
        "det A = 0": 0,
        "tr A = 0": 0,
        "equal eigenvalues": 0,
        "star": 0,
    }


# ---- directions and equilibrium


@settings(max_examples=300, deadline=None)
@given(canonicals(), similarities())
def test_eigenlines(case, similarity):
    kind, Lambda = case
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 100)
    A = S @ Lambda @ inverse
    lines = eigenlines(A, 1e-11)
    assert len(lines) == (
        1 if "improper" in kind else 0 if "spiral" in kind or kind == "centre" else 2
    )
    for value, v in lines:
        assert np.hypot(*v) == pytest.approx(1) and A @ v == pytest.approx(
            value * v, abs=1e-6 if "improper" in kind else 1e-9
        )
    if len(lines) == 2:
        assert lines[0][0] >= lines[1][0] and sorted(value for value, _ in lines) == pytest.approx(
            sorted(np.diag(Lambda)), rel=1e-9
        )


@settings(max_examples=200, deadline=None)
@given(canonicals(), similarities())
def test_eigenvalues(case, similarity):
    kind, Lambda = case
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 100)
    found, right = eigenvalues(S @ Lambda @ inverse), np.linalg.eigvals(Lambda)
    assert found[0].real >= found[1].real and sum(found) == pytest.approx(
        np.trace(Lambda), abs=1e-9
    )
    assert abs(found[0] - found[1]) == pytest.approx(
        abs(right[0] - right[1]), abs=1e-5 if "improper" in kind or "star" in kind else 1e-7
    )
    assert len(set(eigenvalues([[-1.5, 0], [1, -1.5]]))) == 1 and eigenvalues(
        [[0, 2], [-2, 0]]
    ) == (2j, -2j)


def test_eigenlines_near_a_border_do_not_cancel():
    for e in (1e-3, 1e-6, 1e-8):
        for A in ([[-1, 0], [1, -1 - e]], [[-1 - e, 1e-9], [0, -1]], [[1e8, 1], [1, -1e8]]):
            A = np.array(A, dtype=float)
            for value, v in eigenlines(A, 1e-16):
                assert np.abs(A @ v - value * v).max() <= 4e-16 * np.abs(A).max()


@given(canonicals(), similarities(), points)
def test_design_puts_the_equilibrium_there(case, similarity, at):
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 100)
    A, b = design(case[1], similarity[1], at)
    assert S @ inverse == pytest.approx(np.eye(2), abs=1e-11) and inverse @ A @ S == pytest.approx(
        case[1], abs=1e-8
    )
    assert equilibrium(A, b) == pytest.approx(np.array(at), abs=1e-7)


@pytest.mark.parametrize(
    ("A", "b", "words"),
    [
        ([[1, 2], [2, 4]], [1, 0], "no point is at rest"),
        ([[1, 2], [2, 4]], [1, 2], "every point of the line"),
        ([[0, 0], [0, 0]], [1, 0], "no point is at rest"),
        ([[0, 0], [0, 0]], [0, 0], "all points are at rest"),
        ([[0.1, 0.2], [0.3, 0.6]], [0.1, 0.3], "every point"),
    ],
)
def test_a_singular_matrix_has_no_single_equilibrium(A, b, words):
    with pytest.raises(ModelError, match=f"det A = 0.*{words}"):
        equilibrium(A, b)


def test_the_line_of_equilibria_is_right():
    with pytest.raises(ModelError) as error:
        equilibrium([[1, 2], [2, 4]], [-5, -10])
    numbers = [
        float(x)
        for x in __import__("re").findall(
            r"-?\d+\.?\d*(?:e-?\d+)?", str(error.value).split("direction")[1]
        )
    ]
    direction, point = np.array(numbers[:2]), np.array(numbers[2:4])
    A = np.array([[1, 2], [2, 4]])
    assert A @ direction == pytest.approx(0, abs=1e-2) and A @ point - [5, 10] == pytest.approx(
        0, abs=1e-2
    )


# ---- the exact solution


def truth(A, b, start, t):
    """s(t) from the exponential of [[A, b], [0, 0]] t in 50 digits."""
    with mpmath.workdps(50):
        M = mpmath.matrix(
            [
                [*map(mpmath.mpf, row), mpmath.mpf(float(c))]
                for row, c in zip(np.asarray(A).tolist(), b, strict=True)
            ]
            + [[0, 0, 0]]
        )
        s = mpmath.expm(M * mpmath.mpf(float(t))) * mpmath.matrix([*map(float, start), 1.0])
        return np.array([float(s[0]), float(s[1])])


def relative_error(A, b, start, t):
    """Error over what rounding of the data alone may do.

    ‖e^{|A|t}‖-like size of the largest term.
    """
    got, right = exact(A, b, start, [t])[0], truth(A, b, start, t)
    M = np.zeros((3, 3))
    M[:2, :2], M[:2, 2] = A, b
    size = (
        np.linalg.norm(expm(M * t), 2)
        * np.linalg.norm([*start, 1.0])
        * (1 + np.linalg.norm(A, 2) * abs(t))
    )
    return np.abs(got - right).max() / size


@settings(max_examples=150, deadline=None)
@given(canonicals(), similarities(), points, points, st.floats(-2, 8))
def test_exact_solution_of_every_type(case, similarity, at, start, t):
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 100)
    A, b = design(case[1], similarity[1], at)
    assert relative_error(A, b, start, t) < 1e-14


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from([-1.0, 1.0, 0.0]),
    st.floats(-18, 0),
    st.sampled_from([-1.0, 0.0, 1.0]),
    st.floats(-18, 0),
    st.floats(0.01, 20),
    similarities(),
)
def test_exact_solution_on_and_near_the_borders(a, first, sign, second, t, similarity):
    """Nearly equal, nearly vanishing and exactly vanishing eigenvalues, defective or not, real or
    complex.
    """
    S, inverse = similarity[1]
    assume(np.linalg.cond(S) < 100)
    for Lambda in (
        [[a, 0], [0, a + sign * 10**first]],
        [[a, sign * 10**first], [1, a]],
        [[sign * 10**first, 0], [0, a * 10**second]],
        [[sign * 10**first, 0], [1, sign * 10**first]],
    ):
        assert (
            relative_error(S @ np.array(Lambda) @ inverse, np.array([1.0, -2.0]), (0.3, 0.7), t)
            < 1e-14
        )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("by", BY)
def test_exact_solution_against_scipy(kind, by):
    """The handbook's own form, with SciPy's expm: e^{At} s0 + A⁻¹ (e^{At} − E) b."""
    A, b = design(canonical(kind, *KINDS[kind]), BY[by], (1.4, 0.8))
    t = np.linspace(0, 3, 13)
    starts = np.array([(4.0, -2.0), (-1.0, 2.0)])
    for start, got in zip(starts, exact(A, b, starts, t), strict=True):
        right = [expm(A * x) @ start + np.linalg.solve(A, (expm(A * x) - np.eye(2)) @ b) for x in t]
        assert got == pytest.approx(np.array(right), rel=1e-11, abs=1e-11)
    assert exact(A, b, starts[0], t).shape == (13, 2)


def test_exact_solution_at_rest_and_far_away():
    A, b = design(canonical("stable node", -1, -1000), BY["matrix A"], (1, 2))
    assert exact(A, b, (1, 2), np.linspace(0, 1e4, 5)) == pytest.approx(
        np.tile([1.0, 2.0], (5, 1)), abs=1e-10
    )
    assert exact(A, b, (7, 8), [1e6])[0] == pytest.approx([1, 2], abs=1e-10)
    with pytest.raises(ModelError, match="grows beyond"):
        exact([[1, 0], [0, 2]], (0, 0), (1, 1), [0, 1e3])
    for start, t in (((1, 2, 3), 1.0), ((1, np.nan), 1.0), ((1, 2), np.inf)):
        with pytest.raises(ModelError, match="start must be"):
            exact(A, b, start, t)


# ---- simulation


def model(A, b):
    def flow(t, s, p):
        return p.a11 * s.s1 + p.a12 * s.s2 + p.b1, p.a21 * s.s1 + p.a22 * s.s2 + p.b2

    names = ("a11", "a12", "a21", "a22", "b1", "b2")
    return System(
        "linear",
        {"s1": "", "s2": ""},
        dict(zip(names, (*np.ravel(A), *b), strict=True)),
        [Mode("motion", flow)],
        start={"s1": 1.0, "s2": -0.5},
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("by", BY)
def test_simulation_reaches_the_exact_solution(kind, by):
    A, b = design(canonical(kind, *KINDS[kind]), BY[by], (1.4, 0.8))
    run = simulate(model(A, b), 4.0, rtol=1e-10, atol=1e-12)
    size = np.abs(
        [run["s1"], run["s2"]]
    ).max()  # an unstable system multiplies early errors by e^{λt}, here by up to 160 000
    assert (
        true_error(run).max()
        < (1e-9 if kind.startswith("stable") or kind == "centre" else 1e-8) * size
        and true_error(run)[0] == 0
    )


def test_matrix_and_inflow_are_read_from_the_model():
    A, b = np.array([[1.5, -2], [0.25, 3]]), np.array([0.5, -7])
    found = affine(model(A, b))
    assert found[0].tolist() == A.tolist() and found[1].tolist() == b.tolist()
    bad = System(
        "pendulum",
        {"x": "", "v": ""},
        {"k": Parameter(1.0)},
        [Mode("swing", lambda t, s, p: (s.v, -p.k * s.x**2))],
        start={"x": 1.0, "v": 0.0},
    )
    with pytest.raises(ModelError, match="not of the form"):
        affine(bad)
    timed = System(
        "driven",
        {"x": "", "v": ""},
        {},
        [Mode("swing", lambda t, s, p: (s.v, -s.x + t))],
        start={"x": 1.0, "v": 0.0},
    )
    with pytest.raises(ModelError, match="not of the form"):
        affine(timed)
    with pytest.raises(ModelError, match="two states"):
        affine(System("x", {"x": ""}, {}, [Mode("m", lambda t, s, p: (s.x,))], start={"x": 1.0}))


def test_error_table():
    A, b = design(canonical("centre", 1), BY["rotation"], (0, 0))
    table = error_table(
        model(A, b),
        2 * math.pi,
        [("Euler", 2 * math.pi / 1000), ("RK4", 0.1), ("DOP853", 1e-10)],
        start={"s1": 1.0, "s2": 0.0},
    )
    euler = float(table.rows[0][3])
    h = 2 * math.pi / 1000
    assert (
        euler == pytest.approx((1 + h * h) ** 500 - 1, rel=0.05) and float(table.rows[2][3]) < 1e-8
    )
    assert 1000 <= int(table.rows[0][2]) <= 1003 and table.rows[2][1] == "rtol = 1e-10"


# ---- canonical forms and transformations


def test_canonical_forms():
    assert canonical("stable improper node", -2).tolist() == [[-2, 0], [1, -2]]
    assert canonical("unstable spiral", 1, 3).tolist() == [[1, 3], [-3, 1]]
    assert canonical("elliptic point", 3).tolist() == [[0, 3], [-3, 0]]
    for kind, numbers in KINDS.items():
        assert classify(canonical(kind, *numbers)) == kind


@pytest.mark.parametrize(
    ("kind", "numbers", "words"),
    [
        ("stable node", (-1, 3), "saddle.*two different negative"),
        ("stable node", (-1, -1), "stable star"),
        ("unstable node", (-1, -3), "stable node.*positive"),
        ("stable node", (-1,), "takes 2"),
        ("stable star", (0,), "degenerate"),
        ("stable star", (2,), "unstable star.*negative"),
        ("saddle", (1, 2), "one positive and one"),
        ("centre", (0,), "not zero"),
        ("stable spiral", (-1, 0), "stable star.*not zero"),
        ("stable improper node", (1,), "unstable improper"),
        ("vortex", (1,), "no type"),
        ("stable node", (-1, float("nan")), "finite"),
    ],
)
def test_canonical_explains_numbers_that_do_not_fit(kind, numbers, words):
    with pytest.raises(ModelError, match=words):
        canonical(kind, *numbers)


def test_what_the_transformations_are():
    assert np.linalg.det(matrix_a((1, 2), (-4, 2)).S) == pytest.approx(1)
    assert np.linalg.det(matrix_b((1, 2), (1, 1)).S) == pytest.approx(4)
    H, G = reflection((1, -1)).S, rotation(math.pi / 6).S
    assert (
        H.tolist() == [[0, 1], [1, 0]]
        and np.linalg.det(H) == pytest.approx(-1)
        and pytest.approx(np.eye(2)) == H @ H
    )
    assert pytest.approx(np.array([[math.sqrt(3), -1], [1, math.sqrt(3)]]) / 2) == G and rotation(
        math.pi / 6
    ).inverse == pytest.approx(rotation(-math.pi / 6).S)
    assert pytest.approx(np.array([[0, -1], [-1, 0]])) == reflection((1e200, 1e200)).S


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: matrix_a((1, 2), (1, 1)), r"\(u, v\) = 3"),
        (lambda: matrix_b((1, 1), (-1, 0)), "≠ −1"),
        (lambda: matrix_b((0.1, 0.3), (-1, -3)), "≠ −1"),
        (lambda: reflection((0, 0)), "u ≠ 0"),
        (lambda: rotation(float("inf")), "finite"),
        (lambda: matrix_a((1, 2, 3), (0, 0)), "u must be a pair"),
        (lambda: reflection("up"), "numbers"),
    ],
)
def test_invalid_choices_are_explained(make, words):
    with pytest.raises(ModelError, match=words):
        make()


@pytest.mark.parametrize("kind", ["stable star", "unstable star"])
@pytest.mark.parametrize("by", BY)
def test_no_similarity_changes_a_star(kind, by):
    S, inverse = BY[by]
    assert S @ canonical(kind, *KINDS[kind]) @ inverse == pytest.approx(
        canonical(kind, *KINDS[kind]), abs=1e-14
    )


def test_a_reflection_reverses_the_sense_of_rotation_and_a_rotation_keeps_a_spiral():
    Lambda = canonical("stable spiral", -0.5, 2)
    for S, inverse in (BY["reflection"], matrix_b((1, 2), (-1, -1))):  # both turn the plane over
        A = S @ Lambda @ inverse
        assert np.sign(A[1, 0] - A[0, 1]) == -np.sign(Lambda[1, 0] - Lambda[0, 1])
    S, inverse = BY["rotation"]
    assert S @ Lambda @ inverse == pytest.approx(Lambda)


# ---- reviews of a student's design


@settings(max_examples=150, deadline=None)
@given(canonicals(), similarities(), points)
def test_a_good_design_passes(case, similarity, at):
    by, S = similarity
    assume(np.linalg.cond(S.S) < 30)
    A, b = design(case[1], S, at)
    review = check_design(A, b, S.S, case[0], by, at)
    assert review.passed and bool(review) and "The task is met." in repr(review), review


def failed(review):
    assert not review.passed and "✗" in repr(review)
    return "; ".join(text for good, text in review.remarks if not good)


def test_a_review_says_what_is_wrong():
    Lambda, S = canonical("stable node", -1, -3), BY["matrix A"]
    A, b = design(Lambda, S, (1, 2))
    assert (
        failed(check_design(A, b, S.S, "unstable node", "matrix A"))
        == "type: stable node (eigenvalues -1, -3), but the task asks for: unstable node"
    )
    assert "b must be −A s*" in failed(check_design(A, -b, S.S, "stable node", "matrix A", (1, 2)))
    assert "not the canonical form" in failed(
        check_design(Lambda, b, S.S, "stable node", "matrix A")
    )
    assert "have changed places" in failed(
        check_design(S.inverse @ Lambda @ S.S, b, S.S, "stable node", "matrix A")
    )
    assert "this is matrix B" in failed(
        check_design(A, b, BY["matrix B"].S, "stable node", "matrix A")
    )
    assert "not unit vectors at right angles" in failed(
        check_design(A, b, S.S, "stable node", "reflection")
    )
    assert "S is a rotation" in failed(
        check_design(*design(Lambda, BY["rotation"]), BY["rotation"].S, "stable node", "reflection")
    )
    assert "S is a reflection" in failed(
        check_design(
            *design(Lambda, BY["reflection"]), BY["reflection"].S, "stable node", "rotation"
        )
    )
    assert "would have determinant 0" in failed(
        check_design(Lambda, b, np.diag([2.0, 3.0]), "stable node", "matrix B")
    )
    assert "no inverse" in failed(
        check_design(Lambda, b, np.diag([0.0, 1.0]), "stable node", "matrix B")
    )
    assert "no single equilibrium" in failed(
        check_design([[1, 2], [2, 4]], (1, 0), np.eye(2), "saddle", "matrix A")
    )
    assert "should be 1" in failed(
        check_design([[-1, 0], [2, -1]], (0, 0), np.eye(2), "stable improper node", "matrix B")
    )
    assert "[[α, β], [−β, α]]" in failed(
        check_design([[0, 4], [-1, 0]], (0, 0), np.eye(2), "centre", "rotation")
    )
    assert "changes nothing" in repr(
        check_design(Lambda, (0, 0), np.eye(2), "stable node", "matrix A")
    )
    for bad in ({"kind": "vortex", "by": "matrix A"}, {"kind": "saddle", "by": "scaling"}):
        with pytest.raises(ModelError, match="there is no"):
            check_design(A, b, S.S, **bad)
    with pytest.raises(ModelError, match="S must be a 2 × 2"):
        check_design(A, b, [1, 2], "saddle", "rotation")


def test_an_equilibrium_at_zero_has_no_sign():
    assert not np.signbit(equilibrium([[-1, 0], [0, -2]], [0, 0])).any()
