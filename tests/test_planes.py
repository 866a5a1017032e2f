"""The picture of a similarity transformation.

Its data, and that it cannot disagree with the model.
"""

import numpy as np
import pytest

from labkit import (
    Mode,
    ModelError,
    System,
    canonical,
    family,
    matrix_a,
    matrix_b,
    planes,
    reflection,
    rotation,
    simulate,
)

CASES = {
    "node": (canonical("stable node", -1, -3), matrix_a((1, 0.5), (-0.5, 1))),
    "saddle": (canonical("saddle", 1, -2), reflection((1, 3))),
    "centre": (canonical("centre", 2), rotation(0.7)),
    "improper": (canonical("stable improper node", -1), matrix_a((0, 1), (1, 0))),
    "spiral": (canonical("unstable spiral", 0.5, 2), matrix_b((1, 0.3), (0.6, 0.4))),
    "star": (canonical("stable star", -2), reflection((1, 3))),
    "stiff": (canonical("stable node", -1, -1000), rotation(0.3)),
    "slow spiral": (canonical("stable spiral", -0.01, 5), matrix_a((1, 0), (0, 1))),
}


def run_of(Lambda, S, at=(1.0, 0.5)):
    A = S.S @ Lambda @ S.inverse
    (a, b), (c, d) = A.tolist()
    x, y = (-A @ at).tolist()
    system = System(
        "linear",
        {"s1": "", "s2": ""},
        {"a": a, "b": b, "c": c, "d": d, "x": x, "y": y},
        [
            Mode(
                "motion",
                lambda t, s, p: (p.a * s.s1 + p.b * s.s2 + p.x, p.c * s.s1 + p.d * s.s2 + p.y),
            )
        ],
        start={"s1": 3.0, "s2": -1.0},
    )
    return simulate(system, 2.0, backend="plain")


@pytest.mark.parametrize("name", CASES)
def test_both_planes_show_the_same_system(name):
    Lambda, S = CASES[name]
    run = run_of(Lambda, S)
    view = planes(run, lambda p: (Lambda, S))
    left, right = view._sides
    for part in ("lattice", "curves", "eigen"):
        z, s = getattr(left, part).get_xydata(), getattr(right, part).get_xydata()
        assert s == pytest.approx(z @ S.S.T + (1.0, 0.5), nan_ok=True, rel=1e-9, abs=1e-9)
    assert right.flag.get_xy() == pytest.approx(left.flag.get_xy() @ S.S.T + (1.0, 0.5))
    assert right.run.get_xydata() == pytest.approx(np.column_stack([run["s1"], run["s2"]]))
    assert right.run.get_xydata() == pytest.approx(left.run.get_xydata() @ S.S.T + (1.0, 0.5))
    curves = left.curves.get_xydata()
    seen = curves[np.isfinite(curves).all(axis=1)]
    assert (
        len(seen) > 500
        and (np.abs(seen).max(axis=0) >= 2).all()
        and len(view.figure.png()) <= 60_000
    )


def test_curves_follow_the_field():
    """Each little stretch of a trajectory points along Λ z."""
    for name in ("node", "saddle", "improper", "spiral", "centre", "star"):
        Lambda, S = CASES[name]
        z = planes(run_of(Lambda, S), lambda p, L=Lambda, S=S: (L, S))._sides[0].curves.get_xydata()
        step, middle = np.diff(z, axis=0), (z[1:] + z[:-1]) / 2
        good = (
            np.isfinite(step).all(axis=1) & (np.hypot(*step.T) > 1e-6) & (np.hypot(*step.T) < 0.3)
        )
        way = middle[good] @ Lambda.T
        cosine = (step[good] * way).sum(axis=1) / np.hypot(*step[good].T) / np.hypot(*way.T)
        assert len(cosine) > 200 and cosine.min() > 0.99, name


def test_a_star_shows_no_eigenvector_and_a_spiral_has_none():
    for name, count in (("node", 6), ("improper", 3), ("star", 0), ("spiral", 0), ("centre", 0)):
        Lambda, S = CASES[name]
        assert (
            len(
                planes(run_of(Lambda, S), lambda p, Lambda=Lambda, S=S: (Lambda, S))
                ._sides[0]
                .eigen.get_xydata()
            )
            == count
        )


def test_the_picture_follows_the_equilibrium_and_moves_its_axes_seldom():
    Lambda, S = CASES["node"]
    view = planes(run_of(Lambda, S), lambda p: (Lambda, S))
    for at, moves in (((1.2, 0.4), False), ((6.0, 0.4), True), ((6.1, 0.4), False)):
        view.update(run_of(Lambda, S, at))
        low, high = view.axes[1].get_xlim()
        assert view.relimited is moves and low + 1.9 < at[0] < high - 1.9
        assert view._sides[1].rest.get_xydata()[0] == pytest.approx(at)


def test_parts_that_do_not_make_the_model_are_refused():
    Lambda, S = CASES["node"]
    with pytest.raises(ModelError, match="is not the matrix of 'linear'"):
        planes(run_of(Lambda, S), lambda p: (Lambda, S.__class__(S.inverse, S.S)))


@pytest.mark.parametrize("a", [-0.3, -0.1, 0.05, 0.1])
def test_spirals_have_no_seam(a):
    """An arm runs from outside the picture to its middle in one stroke: no end of a line shows.

    Unless the radius hardly changes in a turn.
    """
    from labkit.draw import flow_lines

    curves, starts = flow_lines(
        canonical("stable spiral point" if a < 0 else "unstable spiral point", a, 1), 2.0
    )
    for piece in np.split(curves, np.flatnonzero(np.isnan(curves[:, 0]))):
        radius = np.hypot(*piece[np.isfinite(piece[:, 0])].T)
        assert not len(radius) or (radius.max() > 1.9 and radius.min() < 0.1)


def test_a_centre_closes_its_curves():
    from labkit.draw import flow_lines

    curves, starts = flow_lines(canonical("centre", 1), 2.0)
    pieces = curves.reshape(len(starts), -1, 2)[:, :-1]
    assert np.allclose(pieces[:, 0], pieces[:, -1], atol=1e-9)


def test_the_legend_names_eigenvectors_only_where_there_are_some_and_follows():
    system, parts = family("unstable node", "rotation", lambda1=1.2, lambda2=0.3, phi=0.5)
    view = planes(simulate(system, 1.0, backend="plain"), parts)
    for values, there in (({}, True), ({"lambda1": 0.6, "lambda2": 0.6}, False), ({}, True)):
        view.update(simulate(system, 1.0, backend="plain", **values))
        legend = view.axes[0].get_legend()
        names = [text.get_text() for text in legend.get_texts()] if legend else []
        assert names == ["eigenvectors"] * there, values
    view.update(simulate(system, 1.0, backend="plain"))
    assert not view.relimited


def test_the_plane_is_named_by_its_states_and_forbidden_is_said_where_it_is_seen():
    def head_of(view):
        legend = view.axes[1].get_legend()
        return view.axes[1].get_title("left"), [text.get_text() for text in legend.get_texts()]

    Lambda, S = CASES["node"]

    def parts(p):
        return Lambda, S

    run = run_of(Lambda, S)
    assert head_of(planes(run, parts)) == ("s-plane: after S", ["simulated"])
    far = {"s1": (None, 7)}  # the picture ends at 5, and follows the equilibrium to 10
    view = planes(run, parts, allowed=far)
    assert head_of(view) == ("s-plane: after S", ["simulated"])
    view.update(run_of(Lambda, S, (6.0, 0.5)))
    assert head_of(view) == ("s-plane", ["simulated", "forbidden"])
    view.update(run)
    assert head_of(view) == ("s-plane: after S", ["simulated"])
    circuit = System(
        "circuit",
        {"i": "A", "v": "V"},
        {},
        [Mode("ring", lambda t, s, p: (s.v - s.i, -s.i))],
        start={"i": 1.0, "v": 0.0},
    )
    run = simulate(circuit, 2.0, backend="plain")
    own = [[-1.0, 1.0], [-1.0, 0.0]]
    view = planes(run, lambda p: (np.array(own), matrix_a((0, 0), (1, 0))))
    assert head_of(view)[0] == "($i$, $v$)-plane: after S"
