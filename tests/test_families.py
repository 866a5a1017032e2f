"""The abstract models of part 1, and A = S Λ S⁻¹ told in numbers."""

import numpy as np
import pytest

from labkit import (
    Mode,
    ModelError,
    Parameter,
    System,
    affine,
    canonical,
    classify,
    decomposition,
    describe,
    family,
    matrix_a,
    matrix_b,
    planes,
    reflection,
    rotation,
    simulate,
)

RATES = {
    "stable node": {"lambda1": -0.5, "lambda2": -1.5},
    "saddle": {"lambda1": 1.0, "lambda2": -2.0},
    "unstable star": {"lambda0": 0.8},
    "stable improper node": {"lambda0": -2.0},
    "unstable spiral": {"alpha": 0.3, "beta": 2.0},
    "elliptic point": {"beta": 3.0},
}
BY = {
    "matrix A": lambda p: matrix_a((p.u1, p.u2), (p.k * p.u2, -p.k * p.u1)),
    "matrix B": lambda p: matrix_b(
        (p.u1, p.u2), np.dot([[p.d, p.k], [-p.k, p.d]], (p.u1, p.u2)) / (p.u1**2 + p.u2**2)
    ),
    "reflection": lambda p: reflection((p.u1, p.u2)),
    "rotation": lambda p: rotation(p.phi),
}


@pytest.mark.parametrize("by", BY)
@pytest.mark.parametrize("kind", RATES)
def test_flow_and_parts_are_the_handbooks(kind, by):
    """A of the flow is S Λ S⁻¹ with Λ of `canonical` and S of `matrix_a` …, at every end of S."""
    system, parts = family(kind, by, **RATES[kind])
    values = [{}]
    for name, parameter in system.parameters.items():
        if name not in RATES[kind]:
            values += [{name: parameter.low}, {name: parameter.high}]
    for changed in values:
        p = system.values(changed)
        Lambda, S = parts(p)
        assert pytest.approx(canonical(kind, *RATES[kind].values())) == Lambda
        assert pytest.approx(BY[by](p).S) == S.S and pytest.approx(BY[by](p).inverse) == S.inverse
        A, b = affine(system, p)
        assert pytest.approx(S.S @ Lambda @ S.inverse, abs=1e-12) == A and not b.any()
    for value, sign in ((p.low, p.high) for p in list(system.parameters.values())[:1]):
        assert value * sign > 0  # a rate keeps its sign, and the model its type


def test_it_runs_compiled_and_is_drawn():
    system, parts = family("stable node", "matrix A", lambda1=-0.5, lambda2=-1.5, time="d")
    run = simulate(system, 5.0, backend="compiled")
    assert run.work.backend == "compiled" and system.parameters["lambda1"].unit == "1/d"
    assert planes(run, parts).axes[1].get_title("left") == "y-plane: after S"


def test_names_and_rates_that_do_not_fit():
    with pytest.raises(ModelError, match="has no 'u3'"):
        family("stable node", "matrix A", lambda1=-1, lambda2=-2, u3=1.0)
    with pytest.raises(ModelError, match="needs 'lambda2'"):
        family("stable node", "matrix A", lambda1=-1)
    with pytest.raises(ModelError, match="no transformation by 'shear'"):
        family("stable star", "shear", lambda0=-1)
    with pytest.raises(ModelError, match="no type 'knot'"):
        family("knot", "matrix A")
    system, _ = family("saddle", "rotation", lambda1=Parameter(1, "1/s", "", 0.5, 9), lambda2=-1)
    assert system.parameters["lambda1"].high == 9


@pytest.mark.parametrize(
    ("S", "words"),
    [
        (matrix_a((0, 1), (4, 0)), "S = E + u vᵀ, u = (0, 1), v = (4, 0)"),
        (matrix_b((1, 1), (0.5, -0.3)), "S = E + u vᵀ, u = (1, 1), v = (0.5, -0.3), d = 0.2"),
        (reflection((1, -2)), "S = E − γ u uᵀ, u = (0.5, -1)"),
        (rotation(np.pi / 6), "S = G(φ), φ = 30°"),
        (rotation(0.0), "S = E"),
        ((np.diag([2.0, 3.0]), np.diag([1 / 2, 1 / 3])), "S = [[2, 0], [0, 3]]"),
    ],
)
def test_the_form_of_S_in_words(S, words):
    found = decomposition(canonical("stable node", -1, -3), S)
    assert found.form == words and str(found).startswith("A = [[")
    assert found._repr_markdown_().count("bmatrix") == 8 and words in found._repr_markdown_()
    assert sorted(np.linalg.eigvals(found.A).real) == pytest.approx([-3, -1])


def test_describe_names_type_rest_matrix_and_similarity():
    A = [[-0.5, 0.0], [4.0, -1.5]]

    def motion(t, s, p):
        return -0.5 * s.s1 + p.b, 4 * s.s1 - 1.5 * s.s2 + p.b

    states, start = {"s1": "m", "s2": "m"}, {"s1": 0.0, "s2": 0.0}
    system = System("lakes", states, {"b": 0.2}, [Mode("motion", motion)], start=start)
    Lambda, S = canonical("stable node", -0.5, -1.5), matrix_a((0, 1), (4, 0))
    text = describe(simulate(system, 1.0, backend="plain"), lambda p: (Lambda, S))
    assert text.startswith(f"{classify(A)} at (0.4, 1.2); A = [[-0.5, 0], [4, -1.5]]; S = E + u vᵀ")


def test_planes_shade_what_the_model_forbids():
    system, parts = family("stable node", "matrix A", lambda1=-0.5, lambda2=-1.5)
    run = simulate(system, 5.0, backend="plain")
    view = planes(run, parts, allowed={"y1": (-1, None), "y2": (None, 2)})
    boxes = [patch.get_extents() for patch in view.axes[1].patches if patch.get_zorder() == 0.5]
    inside = view.axes[1].transData.transform([(0, 0), (-2, 0), (0, 3)])
    shaded = [any(box.contains(*place) for box in boxes) for place in inside]
    assert shaded == [False, True, True]
    assert [text.get_text() for text in view.axes[1].get_legend().get_texts()][-1] == "forbidden"
    with pytest.raises(ModelError, match="'s3', which is no state"):
        planes(run, parts, allowed={"s3": (0, None)})
