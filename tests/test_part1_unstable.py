"""Part 1, the later assignments: what is special in each.

What all twelve share is tested elsewhere.
"""

import numpy as np
import pytest
from scipy.linalg import expm

from labkit import affine, classify, equilibrium, rotation, simulate, true_error

from .helpers import load

# ---- 12: unstable node by rotation


@pytest.fixture(scope="module")
def lava():
    return load("part1/12_unstable_node_rotation")


def test_12_the_matrix_is_a_turned_diagonal_and_a_landscape(lava):
    system = lava["system"]
    for phi in (-120.0, 0.0, 30.0, 77.0):
        A, b = affine(system, system.values({"phi": phi}))
        c, s = np.cos(np.radians(phi)), np.sin(np.radians(phi))
        G = np.array([[c, -s], [s, c]])
        assert pytest.approx(G @ np.diag([1.2, 0.3]) @ G.T, abs=1e-13) == A and A[
            0, 1
        ] == pytest.approx(A[1, 0], abs=1e-13)
        assert equilibrium(A, b) == pytest.approx([1, 2]) and classify(A) == "unstable node"


def test_12_two_streams_part_when_theory_says(lava):
    for side, run in ((1, lava["right"]), (-1, lava["left"])):
        z1, z2 = lava["ridge"](run)
        assert z1 == pytest.approx(
            side * 0.001 * np.exp(1.2 * run.t), rel=1e-5
        ) and z2 == pytest.approx(0.1 * np.exp(0.3 * run.t), rel=1e-5)
        assert np.interp(0, np.log(np.abs(z1 / z2)), run.t) == pytest.approx(
            np.log(100) / 0.9, abs=1e-4
        )
    height = -0.5 * np.einsum("im,ij,jm->m", lava["Y"], lava["A"], lava["Y"])
    assert np.all(np.diff(height) < 0)


def test_12_a_fixed_step_turns_with_the_system_and_a_tolerance_does_not(lava):
    errors = lava["errors"]
    rk4 = errors["RK4, h = 0.3"]
    assert (
        np.ptp(rk4) < 1e-6 * rk4.min()
        and errors["RK45, rtol 1e-5"].max() > 3 * errors["RK45, rtol 1e-5"].min()
    )
    growth = np.array([1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24 for z in (0.36, 0.09)]) ** 20
    assert rk4[0] == pytest.approx(np.hypot(*(growth * (0.001, 0.1) - lava["z_exact"])), rel=1e-6)


def test_12_only_rounding_leaves_the_crest(lava):
    for options in lava["trials"].values():
        assert lava["leaves"](0.0, **options) is None
        for phi in (20.0, 50.0):
            assert 33 < lava["leaves"](phi, **options) < 50
    assert (
        lava["leaves"](30.0, method="Euler", step=0.3) > 45
    )  # Euler's own growth is slower: (1 + hλ)^n


def test_12_a_tolerance_is_relative_to_the_origin_of_the_map(lava):
    near, far = (
        simulate(lava["system"], 6.0, rtol=1e-10, atol=1e-16, **options)
        for options in ({"x0": 0, "y0": 0, "start": lava["y0"]}, {})
    )
    assert true_error(near)[-1] < true_error(far)[-1] / 3


def test_12_answers_to_the_tasks(lava):
    assert affine(
        lava["system"], lava["system"].values({"lambda1": 3.0, "lambda2": 1.0, "phi": 45.0})
    )[0] == pytest.approx(np.array([[2, 1], [1, 2]]))
    assert 0.01 * np.exp(-7.2) == pytest.approx(7.5e-6, rel=0.01)
    assert np.degrees(30) % 360 == pytest.approx(278.9, abs=0.05)
    assert expm(np.diag([1.2, 0.3]) * 6) @ (0.001, 0.1) == pytest.approx(lava["z_exact"])
    assert pytest.approx(rotation(np.radians(278.8734)).S, abs=1e-5) == rotation(30).S


# ---- 11: stable node by reflection


@pytest.fixture(scope="module")
def learner():
    return load("part1/11_stable_node_reflection")


def test_11_the_flow_is_steepest_descent_on_the_data(learner):
    system, load_, length = learner["system"], learner["load"], learner["length"]
    A, b = affine(system)
    X = np.column_stack([load_, np.ones(5)])
    assert pytest.approx(-X.T @ X / 5, abs=1e-14) == A and b == pytest.approx(
        X.T @ length / 5, abs=1e-14
    )
    assert equilibrium(A, b) == pytest.approx(np.linalg.lstsq(X, length, rcond=None)[0])
    point, step = np.array([0.3, -0.8]), 1e-6
    gradient = [
        (learner["misfit"](*(point + e)) - learner["misfit"](*(point - e))) / (2 * step)
        for e in step * np.eye(2)
    ]
    mode = system.modes["descend"]
    assert mode.flow(0.0, system.S["descend"](*point), system.values()) == pytest.approx(
        -np.array(gradient), abs=1e-8
    )


def test_11_two_speeds(learner):
    long = learner["long"]
    s = (
        np.array([[2.0], [1.0]])
        + 0.4 * np.exp(-0.1 * long.t) * [[-0.6], [0.8]]
        - 2.2 * np.exp(-2.6 * long.t) * [[0.8], [0.6]]
    )
    assert np.array([long["s1"], long["s2"]]) == pytest.approx(s, abs=1e-8)
    now = long.at(2.0)
    misfit, best = learner["misfit"], learner["best"]
    assert (
        misfit(now["s1"], now["s2"]) - best < 1e-3 * (misfit(0.0, 0.0) - best) and now["s2"] > 1.25
    )
    assert long.at(10 * np.log(32))["s2"] == pytest.approx(1.01, abs=1e-6)


def test_11_a_mirrored_node_is_a_turned_node(learner):
    G, H = learner["G"], learner["H"].S
    assert (
        np.linalg.det(G) == pytest.approx(1)
        and pytest.approx(np.eye(2)) == G.T @ G
        and np.linalg.det(H) == pytest.approx(-1)
    )
    assert G @ learner["Lambda"] @ G.T == pytest.approx(learner["A"])


def test_11_gradient_descent(learner):
    for h, _, measured, theory in learner["rows"]:
        assert (
            float(measured)
            == pytest.approx(max(abs(1 - 0.1 * float(h)), abs(1 - 2.6 * float(h))), abs=2e-4)
            == float(theory)
        )
    factors = {h: max(abs(1 - 0.1 * h), abs(1 - 2.6 * h)) for h in np.linspace(0.5, 0.8, 301)}
    best = min(factors, key=factors.get)
    assert best == pytest.approx(2 / 2.7, abs=1e-3) and factors[best] == pytest.approx(
        25 / 27, abs=2e-3
    )


def test_11_answers_to_the_tasks(learner):
    def bowl(x):
        X = np.column_stack([x, np.ones(len(x))])
        return np.linalg.eigvalsh(X.T @ X / len(x))

    few = bowl(np.arange(10.0, 16.0))
    assert (
        few == pytest.approx([0.0182, 160.15], rel=1e-2)
        and few[1] / few[0] == pytest.approx(8800, rel=0.01)
        and 2 / few[1] == pytest.approx(0.0125, rel=0.01)
    )
    x = learner["load"]
    for factor, condition in ((1.02, 26.3), (102, 1.157e5), (1 / 1.7**0.5, 24.1)):
        low, high = bowl(factor * x)
        assert high / low == pytest.approx(condition, rel=0.01)
    roots = np.roots([1, 2 * np.sqrt(0.1), 0.1])  # task 5: s'' + δ s' + 0.1 s = 0, δ = 2 √0.1
    assert roots.real == pytest.approx([-0.3162] * 2, abs=1e-3)


# ---- 10: unstable spiral by matrix B


@pytest.fixture(scope="module")
def oscillator():
    return load("part1/10_unstable_spiral_matrix_b")


def test_10_the_design_is_the_circuit(oscillator):
    A, b = affine(oscillator["system"])
    assert pytest.approx(
        np.array([[-0.4 / 1.0, 1 / 1.0], [-1 / 0.8, 0.48 / 0.8]])
    ) == A and b == pytest.approx([0, 0.808 / 0.8])
    assert pytest.approx(affine(oscillator["circuit"])[0]) == A and np.linalg.eigvals(
        A
    ).real == pytest.approx([0.1, 0.1])
    for g, kind in (
        (0.319, "stable spiral point"),
        (0.32, "centre"),
        (0.321, "unstable spiral point"),
    ):
        assert (
            classify(affine(oscillator["circuit"], oscillator["circuit"].values({"g": g}))[0])
            == kind
        )


def test_10_growth_and_frequency_are_those_of_a_neighbouring_system(oscillator):
    for _, _, growth, theory, frequency, turning in oscillator["rows"]:
        assert float(growth) == pytest.approx(float(theory), abs=2e-8) and float(
            frequency
        ) == pytest.approx(float(turning), abs=2e-8)
    assert oscillator["rate"] == pytest.approx(0.1, abs=1e-7) and oscillator[
        "frequency"
    ] == pytest.approx(1, abs=1e-7)
    h, lam = 0.1, 0.1 + 1j  # Euler by hand: |1 + hλ|
    assert float(oscillator["rows"][0][2]) == pytest.approx(
        np.log((1 + h * 0.1) ** 2 + h * h) / (2 * h), abs=1e-8
    )
    assert abs(np.log(1 + h * lam) / h - (lam - h * lam**2 / 2)) < 0.4 * h**2


def test_10_ghosts(oscillator):
    """Euler starts an oscillator that cannot start, implicit Euler stops one that does.

    In runs, not only in formulas.
    """
    circuit = oscillator["circuit"]
    euler = simulate(circuit, 100.0, g=0.30, method="Euler", step=0.1)
    truth = simulate(circuit, 100.0, g=0.30)
    assert (
        np.abs(euler["v"][-100:]).max() > 20 * np.abs(euler["v"][:100]).max()
        and np.abs(truth["v"][-100:]).max() < np.abs(truth["v"][:100]).max()
    )
    A, _ = affine(circuit, circuit.values({"g": 0.36}))
    y, step = np.array([0.05, 0.0]), np.linalg.inv(np.eye(2) - 0.1 * A)
    for _ in range(1000):
        y = step @ y
    assert np.hypot(*y) < 0.01 and oscillator["alpha_of"](0.36) == pytest.approx(0.025)
    limit = 2 * 0.0125 / 1.1  # task 2
    for factor, grows in ((0.97, False), (1.03, True)):
        run = simulate(circuit, 4000.0, g=0.30, method="Euler", step=factor * limit, points=20_001)
        assert (np.abs(run["v"][-500:]).max() > np.abs(run["v"][:500]).max()) == grows


def test_10_a_stretch_below_minus_one_turns_the_sense(oscillator):
    system = oscillator["system"]
    one, other = (
        affine(system, system.values(values))[0] for values in ({}, {"d": -1.8, "k": 0.4})
    )
    assert one[1, 0] < 0 < other[1, 0] and other == pytest.approx(
        np.array([[-0.4, -1], [1.25, 0.6]])
    )
    assert np.trace(one) == pytest.approx(np.trace(other)) and np.linalg.det(one) == pytest.approx(
        np.linalg.det(other)
    )


def test_10_answers_to_the_tasks(oscillator):
    M = np.array([[-0.4, 1.0], [-1.25, 0.336 / 0.8]])
    lam = np.linalg.eigvals(M)[0]
    assert (lam.real, abs(lam.imag)) == pytest.approx((0.01, 1.040), abs=5e-4)
    assert np.log(1e6) / lam.real * abs(lam.imag) / (2 * np.pi) == pytest.approx(229, abs=0.6)
    assert np.trace(np.array([[-0.4, 1.0], [-1 / 1.2, 0.48 / 1.2]])) == pytest.approx(0)


# ---- 9: stable spiral by matrix A


@pytest.fixture(scope="module")
def patient():
    return load("part1/09_stable_spiral_matrix_a")


def test_09_the_curve_after_a_drink(patient):
    A, b = affine(patient["system"])
    assert pytest.approx(np.array([[-1.5, 2.0], [-2.125, -0.5]])) == A and b == pytest.approx(
        [-8.5, 4.625]
    )
    fine = patient["fine"]
    s1 = 1 + 5 * np.exp(-fine.t) * np.sin(2 * fine.t)
    s2 = 5 + 5 * np.exp(-fine.t) * (np.cos(2 * fine.t) + 0.25 * np.sin(2 * fine.t))
    assert fine["s1"] == pytest.approx(s1, abs=1e-8) and fine["s2"] == pytest.approx(s2, abs=1e-8)
    assert patient["t_sugar"][0] == pytest.approx(
        (np.pi - np.arctan(2 / 9)) / 2, abs=1e-5
    ) and patient["sugar"][0] == pytest.approx(s2.min(), abs=1e-5)


@pytest.mark.parametrize("k", [-1.0, 0.0, 0.25, 2.0])
def test_09_period_and_decrement_are_the_eigenvalues_and_the_lag_is_the_shear(patient, k):
    fine = simulate(patient["system"], 6.0, k=k, points=6001, rtol=1e-10, atol=1e-12)
    (t1, y1), (t2, y2) = (patient["extremes"](fine.t, fine[name]) for name in ("s1", "s2"))
    for t, y in ((t1, y1 - 1), (t2, y2 - 5)):
        assert np.diff(t)[:2] == pytest.approx(np.pi / 2, abs=1e-4) and (y[1:] / y[:-1])[
            :2
        ] == pytest.approx(-np.exp(-np.pi / 2), abs=1e-4)
    lag = (t1[0] - t2[0]) % (np.pi / 2)
    assert lag == pytest.approx((np.angle(k + 1j) / 2) % (np.pi / 2), abs=1e-4)


def test_09_the_matrix_from_samples_and_the_wrong_one_from_rare_samples(patient):
    A, identify, samples = patient["A"], patient["identify"], patient["samples"]
    found, rest = identify(samples(0.5, 8), 0.5)
    assert found == pytest.approx(A, abs=1e-9) and rest == pytest.approx([1, 5])
    wrong, rest = identify(samples(2.0, 10), 2.0)
    assert (
        np.linalg.eigvals(wrong).imag.max() == pytest.approx(np.pi - 2, abs=1e-6)
        and wrong[0, 1] < 0 < A[0, 1]
    )
    assert expm(2.0 * wrong) == pytest.approx(
        expm(2.0 * A), abs=1e-9
    )  # two systems, the same samples
    assert 2 * np.pi / np.sqrt(np.linalg.det(wrong)) > 4 > 2 * np.pi / np.sqrt(np.linalg.det(A))
    for h, right in ((1.5, True), (1.65, False)):
        value = np.linalg.eigvals(identify(samples(h, 10), h)[0]).imag.max()
        assert (abs(value - 2) < 1e-5) == right


def test_09_euler_makes_a_healthy_patient_ill(patient):
    for h, stable in ((0.39, True), (0.41, False)):
        run = simulate(patient["system"], 200 * h, method="Euler", step=h, points=2)
        z = patient["S_inverse"] @ (np.array(list(run.final.values())) - (1, 5))
        assert (np.hypot(*z) < 5) == stable and np.hypot(*z) == pytest.approx(
            5 * abs(1 + h * (-1 + 2j)) ** 200, rel=1e-6
        )


def test_09_answers_to_the_tasks(patient):
    system = patient["system"]
    assert affine(system, system.values({"k": 0.5}))[0][1, 1] == pytest.approx(0)
    ill = simulate(system, 8.0, alpha=-0.5, beta=1.2, points=8001)
    assert ill["s2"].min() == pytest.approx(3.632, abs=1e-3) and ill.t[
        ill["s2"].argmin()
    ] == pytest.approx(2.493, abs=2e-3)
    for k, grows in ((0.485, False), (0.487, True)):
        M = affine(system, system.values({"k": k}))[0]
        assert bool(np.linalg.eigvalsh(M + M.T)[-1] > 0) == grows
    h, alpha, beta = 0.4, -1.0, 2.0  # task 5, on the sugar alone
    g = patient["samples"](h, 6)[:, 1] - 5
    assert g[2:] == pytest.approx(
        2 * np.exp(alpha * h) * np.cos(beta * h) * g[1:-1] - np.exp(2 * alpha * h) * g[:-2],
        abs=1e-12,
    )
