"""The handbook's checks of sample 2.3, on the system and the functions of the notebook itself."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import ModelError, affine, describe, explore, jacobian, planes, simulate
from labkit.linear import classify

from .helpers import load, read, source

NAME = "part1/00_sample_stable_spiral"
STARTS = [(4.0, -2.0), (-1.0, 2.0), (2.0, 1.1), (1.4, 5.0), (0.0, 0.0)]


@pytest.fixture(scope="module")
def book():
    return load(NAME)


def by_matrices(run):
    """The handbook's own form, e^{At} s0 + A⁻¹(e^{At} − E) b, as complex numbers s1 + j s2."""
    A, b = affine(run.system, run.p)
    s0 = np.array([run.start["s1"], run.start["s2"]])
    rows = [expm(A * t) @ s0 + np.linalg.solve(A, (expm(A * t) - np.eye(2)) @ b) for t in run.t]
    return np.array([complex(*row) for row in rows])


def test_handbook_values(book):
    system = book["system"]
    assert book["horizon"] == 10.0 and list(system.units) == ["s1", "s2"]
    assert affine(system)[1].tolist() == [2.0, 3.0] and system.time == "ms"
    A = jacobian(system).at()
    assert A.tolist() == [[-2.0, 1.0], [-1.0, -2.0]]
    assert (round(np.linalg.det(A), 12), np.trace(A)) == (5.0, -4.0)
    assert classify(A) == "stable spiral point"
    assert book["rest"](system.values()) == pytest.approx(1.4 + 0.8j, abs=1e-15)
    assert system.modes["motion"].flow(
        0.0, system.S["motion"](1.4, 0.8), system.values()
    ) == pytest.approx((0.0, 0.0), abs=1e-15)


def test_jacobian_is_constant(book):
    A = jacobian(book["system"])
    assert not A.free_symbols & {A.equations.t, *A.equations.states.values()}


@pytest.mark.parametrize(
    "changed",
    [{}, {"R": 0.3, "omega": 4.0, "v1": -1.0}, {"R": 0.0, "omega": 2.0}, {"L": 2.5, "v2": -2.0}],
)
def test_exact_solution_of_the_notebook_is_the_handbooks(book, changed):
    run = simulate(book["system"], 5.0, points=20, **changed)
    assert book["exact"](run) == pytest.approx(by_matrices(run), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(
    "start, method",
    [
        *((start, method) for start in STARTS for method in ("RK45", "DOP853")),
        (STARTS[0], "LSODA"),
        (STARTS[0], "Radau"),
    ],
)
def test_simulation_against_exact_solution(book, start, method):
    run = simulate(
        book["system"],
        book["horizon"],
        start=dict(zip(("s1", "s2"), start, strict=True)),
        method=method,
        rtol=1e-10,
        atol=1e-12,
    )
    error = np.abs(book["state"](run) - book["exact"](run))
    assert run.stopped == "finished" and not run.events
    assert error[-1] < 1e-9
    assert error.max() < (1e-8 if method in ("RK45", "DOP853") else 1e-6)


def test_simulation_against_scipy(book):
    system, run = book["system"], simulate(book["system"], book["horizon"], rtol=1e-10, atol=1e-12)
    flow, kind, p = system.modes["motion"].flow, system.S["motion"], system.values()
    other = solve_ivp(
        lambda t, y: flow(t, kind(*y), p),
        (0, 10),
        [4.0, -2.0],
        method="DOP853",
        t_eval=run.t,
        rtol=1e-12,
        atol=1e-14,
    )
    assert np.abs(other.y - [run["s1"], run["s2"]]).max() < 1e-8


def test_both_back_ends(book):
    plain, compiled = (simulate(book["system"], 10.0, backend=b) for b in ("plain", "compiled"))
    assert np.abs(book["state"](plain) - book["state"](compiled)).max() < 1e-13
    assert (plain.work.steps, plain.work.evaluations) == (
        compiled.work.steps,
        compiled.work.evaluations,
    )


def test_logarithmic_spiral_in_the_runs_of_the_notebook(book):
    """ln r falls with slope α, the angle with −β: what section 4 shows and the eye cannot see."""
    for run in book["runs"].values():
        y = book["state"](run) - 1.4 - 0.8j
        assert np.polyfit(run.t, np.log(np.abs(y)), 1)[0] == pytest.approx(-2.0, abs=2e-3)
        assert np.polyfit(run.t, np.unwrap(np.angle(y)), 1)[0] == pytest.approx(-1.0, abs=2e-3)
    turn = simulate(book["system"], 2 * np.pi, rtol=1e-12, atol=1e-14)
    r = np.abs(book["state"](turn) - 1.4 - 0.8j)
    assert r[-1] / r[0] == pytest.approx(np.exp(-4 * np.pi), rel=1e-4)


def test_orders_of_the_methods(book):
    assert [round(book["orders"][m], 1) for m in ("Euler", "Heun", "RK4")] == [1.0, 2.0, 4.0]


@pytest.mark.parametrize("method, terms", [("Euler", 1), ("Heun", 2), ("RK4", 4)])
def test_largest_stable_step(book, method, terms):
    """The limit of Euler and the answers on Heun and RK4, as the engine really behaves."""
    factor = np.array([1, 1, 1 / 2, 1 / 6, 1 / 24])[: terms + 1]
    limit = brentq(lambda h: abs(np.polyval(factor[::-1], h * (-2 - 1j))) - 1, 0.3, 3)
    assert limit == pytest.approx(
        {"Euler": book["limit"], "Heun": 0.9611, "RK4": 1.2751}[method], abs=5e-5
    )
    for h, grows in ((0.97 * limit, False), (1.03 * limit, True)):
        run = simulate(
            book["system"], 40 * h, method=method, step=h, points=np.linspace(0, 40 * h, 41)
        )
        r = np.abs(book["state"](run) - 1.4 - 0.8j)
        assert bool(r[-1] > r[0]) is grows
        assert r[-1] / r[0] == pytest.approx(
            abs(np.polyval(factor[::-1], h * (-2 - 1j))) ** 40, rel=1e-9
        )


def test_euler_at_its_limit_shows_a_centre(book):
    run = simulate(book["system"], 16.0, method="Euler", step=0.8, points=np.linspace(0, 16, 21))
    r = np.abs(book["state"](run) - 1.4 - 0.8j)
    assert r == pytest.approx(np.full(21, abs(2.6 - 2.8j)), rel=1e-12)


def test_tolerance_is_about_the_state_and_not_about_the_distance(book):
    """Section 6: only at a tight tolerance the distance follows theory to the end."""
    ends = {}
    for q in (1e-3, 1e-9):
        run = simulate(book["system"], 10.0, method="RK45", rtol=q, atol=q / 100)
        ends[q] = abs(book["state"](run)[-1] - 1.4 - 0.8j) / abs(
            book["exact"](run)[-1] - 1.4 - 0.8j
        )
    assert ends[1e-3] > 1000 and ends[1e-9] == pytest.approx(1, abs=0.2)


def test_answers_to_the_tasks(book):
    system, state, rest = book["system"], book["state"], book["rest"]
    half = simulate(system, 2 * np.pi, R=0.1103)
    r = np.abs(state(half) - rest(half.p))
    assert r[-1] / r[0] == pytest.approx(0.5, abs=1e-3)
    assert rest(system.values({"v1": -2.0, "v2": 4.0})) == pytest.approx(2j)
    centre = simulate(system, 6.3, R=0.0, method="Euler", step=0.1)
    r = np.abs(state(centre) - rest(centre.p))
    assert r[-1] / r[0] == pytest.approx(1.368, abs=5e-4)
    mirror = np.diag([1.0, -1.0])
    assert (mirror @ [[-2, 1], [-1, -2]] @ mirror).tolist() == [[-2, -1], [1, -2]]
    errors = []
    for k in (0.1, 1.0):
        run = simulate(system, 10.0, start={"s1": 4.0 * k, "s2": -2.0 * k}, v1=2.0 * k, v2=3.0 * k)
        errors.append(np.abs(state(run) - book["exact"](run)).max())
    assert errors[1] / errors[0] == pytest.approx(10, rel=0.3)


def test_panel_at_the_ends_of_its_sliders(book):
    panel = explore(
        book["system"],
        book["horizon"],
        book["picture"],
        verdict=book["verdict"],
        sliders={"s1": (-5, 5), "s2": (-5, 5)},
    )
    panel.check()
    words = {R: book["verdict"](simulate(book["system"], 10.0, R=R)) for R in (2.0, 0.0)}
    assert [text.split(" at ")[0] for text in words.values()] == ["stable spiral point", "centre"]
    assert "(1.4, 0.8)" in words[2.0] and "3.5e-06" in words[2.0]
    assert "saturates" not in words[2.0]
    assert "saturates" in book["verdict"](simulate(book["system"], 10.0, R=0.0, omega=0.5))


def test_second_panel_is_the_sample_and_its_likes(book):
    system, parts = book["system_two"], book["parts_two"]
    explore(system, book["horizon_two"], lambda run: planes(run, parts)).check()
    assert affine(system, system.values({"alpha": -2.0, "k": 0.0}))[0] == pytest.approx(
        np.array([[-2.0, 1.0], [-1.0, -2.0]])
    )
    for alpha, kind in ((-2.0, "stable spiral point"), (0.5, "unstable spiral point")):
        assert kind in describe(simulate(system, 5.0, alpha=alpha), parts)


def test_solutions(book):
    found = book["solutions"]
    assert found["halving"] == pytest.approx(0.1103, abs=5e-5)
    assert found["voltages"] == [-2.0, 4.0]
    assert found["growth"] == pytest.approx(1.368, abs=5e-4)
    assert found["Heun"] == pytest.approx(0.9611, abs=5e-5)


def test_ranges_keep_a_spiral(book):
    with pytest.raises(ModelError, match="omega"):
        simulate(book["system"], 10.0, omega=0.0)


def test_misprint_of_the_handbook(book):
    """z = S⁻¹ s makes A canonical, the printed z = A⁻¹ s leaves A as it is."""
    A, S = book["sheared"], book["S"]
    assert book["S_inverse"] @ S == pytest.approx(np.eye(2))
    assert np.linalg.inv(S) @ A @ S == pytest.approx(book["Lambda"])
    assert np.linalg.inv(A) @ A @ A == pytest.approx(A) and not np.allclose(A, book["Lambda"])


def test_nine_headings_in_order():
    heads = [
        line
        for cell in read(NAME)["cells"]
        if cell["cell_type"] == "markdown"
        for line in source(cell).splitlines()
        if line.startswith("## ")
    ]
    assert [head.split()[1] for head in heads] == list("123456789")
