"""Held variables in everything that shows a model or a run.

Columns, files, equations, tables, pictures, sliders.
"""

import csv

import numpy as np
import pytest

from labkit import (
    At,
    Mode,
    Parameter,
    System,
    Transition,
    equations,
    explore,
    jacobian,
    load_npz,
    mode_diagram,
    parameter_table,
    phase_portrait,
    simulate,
    simulate_many,
    time_plot,
)
from labkit.draw.layers import Nullclines
from labkit.draw.plane import Plane
from labkit.linear import affine, true_error

BOTH = ("plain", "compiled")


def tank():
    """x' = v, v' = u − x − c v.

    The pump's level u goes from 1 to 3 at t = 2, and counts its switchings.
    """
    return System(
        "tank",
        {"x": ("m", "level"), "v": "m/s"},
        {"c": Parameter(0.5, "1/s", "damping", 0, 2)},
        [Mode("run", lambda t, s, p: (s.v, s.u - s.x - p.c * s.v))],
        [
            Transition(
                "run",
                "run",
                at=At(2.0),
                reset={"u": 3.0, "count": lambda t, s, p: s.count + 1},
                label="pump",
            )
        ],
        start={"x": 0.0, "v": 0.0},
        held={"u": ("m", 1.0, "what the pump holds"), "count": ("", 0)},
    )


@pytest.mark.parametrize("backend", BOTH)
def test_a_run_has_columns_of_them(backend, tmp_path):
    run = simulate(tank(), 4.0, points=9, backend=backend)
    before = run.j == 0
    assert run.values.shape == (len(run), 4)
    assert run["u"].tolist() == np.where(before, 1.0, 3.0).tolist()
    assert run["count"].tolist() == np.where(before, 0.0, 1.0).tolist()
    assert run.start == {"x": 0.0, "v": 0.0, "u": 1.0, "count": 0.0}
    assert run.final["u"] == 3.0 and list(run.final) == ["x", "v", "u", "count"]
    assert run.at(2.0)["u"] == 3.0 and run.at(2.0, side="before")["u"] == 1.0
    assert run.at([0.3, 1.7, 2.3, 4.0])["u"].tolist() == [1.0, 1.0, 3.0, 3.0]
    pump = run.events["pump"]
    assert pump.before["u"].tolist() == [1.0] and pump.after["u"].tolist() == [3.0]
    assert pump.after["x"].tolist() == pump.before["x"].tolist()
    assert "u 1 → 3, count 0 → 1" in run.ledger()
    with open(run.to_csv(tmp_path / "run.csv"), encoding="utf-8", newline="") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    assert rows[0] == ["t [s]", "j", "mode", "x [m]", "v [m/s]", "u [m]", "count"]
    assert [float(row[5]) for row in rows[1:]] == run["u"].tolist()
    assert load_npz(run.to_npz(tmp_path / "run.npz"))["count"].tolist() == run["count"].tolist()


@pytest.mark.parametrize("backend", BOTH)
def test_the_flow_reads_them(backend):
    """With c = 0: x = u (1 − cos t) until the pump switches, then a cosine about 3."""
    run = simulate(tank(), 4.0, c=0.0, start={"u": 2.0}, backend=backend, rtol=1e-10)
    t = np.linspace(0, 4, 21)
    x, v = 2 * (1 - np.cos(2)), 2 * np.sin(2)
    later = 3 + (x - 3) * np.cos(t - 2) + v * np.sin(t - 2)
    np.testing.assert_allclose(
        run.at(t)["x"], np.where(t < 2, 2 * (1 - np.cos(t)), later), atol=1e-8
    )
    assert run.again(start={"x": 1.0}).start == {"x": 1.0, "v": 0.0, "u": 2.0, "count": 0.0}


@pytest.mark.parametrize("backend", BOTH)
def test_lanes_have_their_own(backend):
    u = np.array([0.5, 1.5, 2.5])
    runs = simulate_many(tank(), 4.0, start={"u": u}, points=5, backend=backend)
    assert runs["u"][:, 0].tolist() == u.tolist() and runs.final["u"].tolist() == [3.0] * 3
    for value, run in zip(u, runs, strict=True):
        alone = simulate(tank(), 4.0, start={"u": value}, points=5, rtol=1e-6, backend=backend)
        assert np.array_equal(run.values, alone.values) and run.at(1.3) == alone.at(1.3)


def test_equations_tell_what_changes():
    made = equations(tank())
    text = made._repr_markdown_()
    assert text.startswith(
        "**tank**: states $x$ level [m], $v$ [m/s]; held, changed by events only: "
    )
    assert "$u$ what the pump holds [m], $count$" in text.replace(r"\mathrm{count}", "count")
    assert r"\dot{x}" in text and r"\dot{u}" not in text
    line = next(line for line in text.splitlines() if line.startswith("- **pump**"))
    assert "$u^{+} = 3$" in line and "x^{+}" not in line and "count" in line
    assert {name: str(e) for name, e in made.resets[0].items()} == {"u": "3", "count": "count + 1"}
    assert "u = 1" in text.splitlines()[-1] and "then {u: 3, count: count + 1}" in repr(
        made
    ).replace("'", "")


def test_a_part_that_is_no_formula_is_shown_as_code():
    def odd(t, s, p):
        return float(str(s.u))

    tr = Transition("run", "run", at=At(1.0), reset={"u": odd})
    system = System(
        "odd",
        {"x": ""},
        {},
        [Mode("run", lambda t, s, p: (1.0,))],
        tr,
        {"x": 0.0},
        held={"u": ("", 1.0)},
    )
    assert "then the state is changed by" in equations(system)._repr_markdown_()


def test_tables_and_matrices():
    rows = parameter_table(tank()).rows
    assert [row[1] for row in rows] == ["`c`", "`u`", "`count`"]
    assert rows[1][2:] == ("what the pump holds", "1", "m", "changed by events")
    np.testing.assert_allclose(jacobian(tank()).at({"u": 2.0}), [[0, 1], [-1, -0.5]])
    A, b = affine(tank(), at={"u": 2.0, "count": 0})
    assert (
        A.tolist() == [[0, 1], [-1, -0.5]]
        and b.tolist() == [0, 2]
        and affine(tank())[1].tolist() == [0, 1]
    )
    assert true_error(simulate(tank(), 1.9, start={"u": 2.0})).max() < 1e-6


def test_pictures_hold_them():
    system = tank()
    run = simulate(system, 4.0)
    view = phase_portrait(run)
    assert any(isinstance(layer, Nullclines) for layer in view.layers)
    assert [round(found[0], 6) for found in view.equilibria] == [1.0]
    assert view.notes == ["arrows and lines for u and count as at the start"]
    view.update(run.again(start={"u": 0.5}))  # a parameter of the picture
    assert [round(found[0], 6) for found in view.equilibria] == [0.5]
    many = phase_portrait(
        system, starts={"x": [0.0, 1.0], "v": [0.0, 0.0]}, run=run.again(start={"u": 2.0})
    )
    thin = next(
        layer.runs
        for layer in many.layers
        if hasattr(layer, "runs") and not hasattr(layer.runs, "j")
    )
    assert thin["u"][:, 0].tolist() == [2.0, 2.0]
    plane = Plane(system, at={"u": 4.0})
    assert plane.flow("run", np.array(1.0), np.array(0.0))[1] == 3.0
    plane.hold(run.start)  # what is given stays
    assert plane.flow("run", np.array(1.0), np.array(0.0))[1] == 3.0
    picture = time_plot(run, "u")
    line = picture._curves[0][0][0].line
    # Nothing between: steps
    assert set(line.get_ydata()[np.isfinite(line.get_ydata())]) == {1.0, 3.0}
    assert len(time_plot(run).axes) == 4
    mode_diagram(system)


def test_a_panel_moves_them():
    panel = explore(tank(), 4.0)
    slider = next(control for control in panel.controls if control.key == "start.u")
    assert (
        slider.value == 1.0
        and slider.low <= 0 < 3 <= slider.high
        and slider.meaning == "what the pump holds"
    )
    panel._show(panel.defaults | {"start.u": 2.0})
    assert panel.run.start["u"] == 2.0 and panel.run.final["u"] == 3.0
    assert "start.count" not in {
        c.key for c in explore(tank(), 4.0, sliders={"count": False}).controls
    }
    panel.check()
