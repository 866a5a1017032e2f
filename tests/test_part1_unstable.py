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
    assert lava["parting"] == pytest.approx(np.log(100) / 0.9)
    assert lava["gap"] == pytest.approx(lava["apart"], rel=1e-6)


def test_12_the_stream_runs_down_the_shape_of_the_mountain(lava):
    """The height is that of the ridge; another mountain must fail."""
    run, p = lava["right"], lava["p"]
    z1, z2 = lava["ridge"](run)
    assert lava["height"](run["s1"], run["s2"]) == pytest.approx(-0.2 * z1**2 - 0.05 * z2**2)
    slope, flow = lava["slope"], lava["flow"]
    off = np.hypot(*(flow + p.mu * slope)) / np.hypot(*flow)
    assert off[2:-2].max() < 1e-3
    other = np.array([slope[0], 0.5 * slope[1]])  # a mountain half as steep to the north
    cosine = -np.sum(flow * other, axis=0) / np.hypot(*flow) / np.hypot(*other)
    assert cosine.min() < 0.99 < 1 - 1e-6 < lava["cosine"][2:-2].min()


def test_12_a_fixed_step_turns_with_the_system_and_a_tolerance_does_not(lava):
    errors = lava["errors"]
    rk4 = errors["RK4, h = 0.3 h"]
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
    assert true_error(lava["here"])[-1] < true_error(lava["there"])[-1] / 3


def test_12_a_run_ends_at_the_foot_of_the_ridge(lava):
    run = simulate(lava["system"], 20.0)
    assert run.events[-1].transition == "foot of the ridge"
    assert np.hypot(run["s1"][-1] - 1, run["s2"][-1] - 2) == pytest.approx(3.0, rel=1e-8)


def test_12_answers_to_the_tasks(lava):
    found, other = lava["solutions"], lava["system_two"]
    large, small, degrees = found["parts"]
    p = other.values({"lambda1": large, "lambda2": small, "phi": np.radians(degrees)})
    assert affine(other, p)[0] == pytest.approx(np.array([[2, 1], [1, 2]]))
    assert found["near"] == pytest.approx(7.5, rel=0.01)
    assert np.degrees(30) % 360 == pytest.approx(found["mistake"])
    assert expm(np.diag([1.2, 0.3]) * 6) @ (0.001, 0.1) == pytest.approx(lava["z_exact"])
    assert pytest.approx(rotation(np.radians(found["mistake"])).S, abs=1e-9) == rotation(30).S


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


def test_11_any_loads_make_a_mirrored_diagonal(learner):
    system, rng = learner["system"], np.random.default_rng(4)
    ends = [
        (0.0, 0.05),
        (0.0, 1.0),
        (3.0, 0.05),
        (3.0, 1.0),
        *rng.uniform((0, 0.05), (3, 1), (9, 2)),
    ]
    for mean, variance in ends:
        p = system.values({"mean": mean, "variance": variance})
        Lambda, (H, inverse) = learner["parts"](p)
        A, _ = affine(system, p)
        assert H @ Lambda @ inverse == pytest.approx(A) and np.linalg.det(H) == pytest.approx(-1)
        assert np.linalg.det(A) == pytest.approx(variance)


def test_11_gradient_descent(learner):
    for h, _, measured, theory in learner["descents"]:
        assert theory == pytest.approx(max(abs(1 - 0.1 * h), abs(1 - 2.6 * h)))
        assert measured == pytest.approx(theory, abs=2e-4 if h != 0.74 else 3e-3)  # two factors
    factors = {h: max(abs(1 - 0.1 * h), abs(1 - 2.6 * h)) for h in np.linspace(0.5, 0.8, 301)}
    best = min(factors, key=factors.get)
    assert best == pytest.approx(2 / 2.7, abs=1e-3) and factors[best] == pytest.approx(
        25 / 27, abs=2e-3
    )
    assert learner["nearest"] == 0.74 and learner["best_step"] == pytest.approx(2 / 2.7)


def test_11_answers_to_the_tasks(learner):
    few, x, found = learner["few"], learner["load"], learner["solutions"]
    assert few == pytest.approx([0.0182, 160.15], rel=1e-2)
    assert found["condition"] == pytest.approx(8800, rel=0.01)
    assert 2 / few[1] == pytest.approx(0.0125, rel=0.01)
    for factor, condition in ((1.02, 26.3), (102, 1.157e5), (1 / 1.7**0.5, 24.1)):
        low, high = learner["bowl"](factor * x)
        assert high / low == pytest.approx(condition, rel=0.01)
    assert found["unit"] == pytest.approx(1.7**0.5, rel=1e-2)
    assert found["momentum"] == pytest.approx(2 * np.sqrt(0.1), rel=5e-3)
    run = simulate(learner["system"], 8.0, start={"s1": 2 + 0.8, "s2": 1 + 0.6})  # task 4
    assert np.hypot(run["s1"][-1] - 2, run["s2"][-1] - 1) < 1e-7


# ---- 10: unstable spiral by matrix B


@pytest.fixture(scope="module")
def oscillator():
    return load("part1/10_unstable_spiral_matrix_b")


def test_10_the_design_is_the_circuit(oscillator):
    system = oscillator["system"]
    A, b = affine(system)
    assert pytest.approx(
        np.array([[-0.4 / 1.0, 1 / 1.0], [-1 / 0.8, 0.48 / 0.8]])
    ) == A and b == pytest.approx([0, 0.808 / 0.8])
    assert np.linalg.eigvals(A).real == pytest.approx([0.1, 0.1])
    for g, kind in (
        (0.319, "stable spiral point"),
        (0.32, "centre"),
        (0.321, "unstable spiral point"),
    ):
        assert classify(affine(system, system.values({"g": g}))[0]) == kind
    other, p = oscillator["system_two"], {"u1": 1.0, "u2": 0.0, "d": -0.2, "k": -0.4}
    assert affine(other, other.values(p))[0] == pytest.approx(A)


def test_10_growth_and_frequency_are_those_of_a_neighbouring_system(oscillator):
    rows = oscillator["neighbours"]
    for _, _, growth, theory, frequency, turning in rows:
        assert growth == pytest.approx(theory, abs=2e-8)
        assert frequency == pytest.approx(turning, abs=2e-8)
    assert oscillator["measured"](oscillator["run"]) == pytest.approx((0.1, 1.0), abs=1e-7)
    h, lam = 0.1, 0.1 + 1j  # Euler by hand: |1 + hλ|
    assert rows[0][2] == pytest.approx(np.log((1 + h * 0.1) ** 2 + h * h) / (2 * h), abs=1e-8)
    assert abs(np.log(1 + h * lam) / h - (lam - h * lam**2 / 2)) < 0.4 * h**2


def test_10_ghosts(oscillator):
    """Euler starts an oscillator that cannot start, implicit Euler stops one that does.

    In runs, not only in formulas.
    """
    assert oscillator["starts"] == ["yes", "no"]
    system, beside = oscillator["system"], {"i": 0.05, "v": 0.0}
    euler = simulate(system, 100.0, start=beside, g=0.30, I0=0.0, method="Euler", step=0.1)
    truth = simulate(system, 100.0, start=beside, g=0.30, I0=0.0)
    assert (
        np.abs(euler["v"][-100:]).max() > 20 * np.abs(euler["v"][:100]).max()
        and np.abs(truth["v"][-100:]).max() < np.abs(truth["v"][:100]).max()
    )
    A, _ = affine(system, system.values({"g": 0.36}))
    y, step = np.array([0.05, 0.0]), np.linalg.inv(np.eye(2) - 0.1 * A)
    for _ in range(1000):
        y = step @ y
    assert np.hypot(*y) < 0.01 and oscillator["alpha_of"](0.36) == pytest.approx(0.025)
    limit = oscillator["solutions"]["step"]
    assert limit == pytest.approx(2 * 0.0125 / 1.1)
    for factor, grows in ((0.97, False), (1.03, True)):
        run = simulate(
            system,
            4000.0,
            start=beside,
            g=0.30,
            I0=0.0,
            method="Euler",
            step=factor * limit,
            points=20_001,
        )
        assert (np.abs(run["v"][-500:]).max() > np.abs(run["v"][:500]).max()) == grows


def test_10_a_run_ends_where_the_supply_is_used_up(oscillator):
    run = simulate(oscillator["system"], 200.0)
    assert run.events[-1].transition == "supply used up"
    assert np.abs(run["v"]).max() == pytest.approx(12.0, rel=1e-8)


def test_10_a_stretch_below_minus_one_turns_the_sense(oscillator):
    one, other = oscillator["A"], oscillator["A_over"]
    assert one[1, 0] < 0 < other[1, 0] and other == pytest.approx(
        np.array([[-0.4, -1], [1.25, 0.6]])
    )
    assert np.trace(one) == pytest.approx(np.trace(other)) and np.linalg.det(one) == pytest.approx(
        np.linalg.det(other)
    )
    assert np.linalg.det(oscillator["over"].S) == pytest.approx(-0.8)


def test_10_answers_to_the_tasks(oscillator):
    M = np.array([[-0.4, 1.0], [-1.25, 0.336 / 0.8]])
    lam = np.linalg.eigvals(M)[0]
    assert (lam.real, abs(lam.imag)) == pytest.approx((0.01, 1.040), abs=5e-4)
    found = oscillator["solutions"]
    assert found["turns"] == pytest.approx(229, abs=0.6)
    assert found["C"] == pytest.approx(1.2)
    assert oscillator["threshold"] == pytest.approx(0.32)


# ---- 9: stable spiral by matrix A


@pytest.fixture(scope="module")
def patient():
    return load("part1/09_stable_spiral_matrix_a")


def test_09_the_curve_after_a_drink(patient):
    A, b = affine(patient["system"])
    assert pytest.approx(np.array([[-1.5, 2.0], [-2.125, -0.5]])) == A and b == pytest.approx(
        [-7.0, 6.75]
    )
    fine = patient["fine"]
    s1 = 2 + 5 * np.exp(-fine.t) * np.sin(2 * fine.t)
    s2 = 5 + 5 * np.exp(-fine.t) * (np.cos(2 * fine.t) + 0.25 * np.sin(2 * fine.t))
    assert fine["s1"] == pytest.approx(s1, abs=1e-8) and fine["s2"] == pytest.approx(s2, abs=1e-8)
    assert patient["t_sugar"][0] == pytest.approx(
        (np.pi - np.arctan(2 / 9)) / 2, abs=1e-5
    ) and patient["sugar"][0] == pytest.approx(s2.min(), abs=1e-5)
    assert patient["dip"] == pytest.approx(5 - s2.min(), abs=1e-5)


def test_09_any_person_is_a_shear_of_the_canonical_form(patient):
    system, rng = patient["system"], np.random.default_rng(3)
    for _ in range(50):
        p = system.values(
            {
                name: rng.uniform(each.low, each.high)
                for name, each in system.parameters.items()
                if name in "cred"
            }
        )
        A, _ = affine(system, p)
        Lambda, (S, inverse) = patient["parts"](p)
        assert S @ Lambda @ inverse == pytest.approx(A) and np.linalg.det(S) == pytest.approx(1)
        assert np.trace(S) == pytest.approx(2)  # so that (S − E)² = 0
        assert classify(A) == "stable spiral point"


@pytest.mark.parametrize("k", [-1.0, 0.0, 0.25, 2.0])
def test_09_period_and_decrement_are_the_eigenvalues_and_the_lag_is_the_shear(patient, k):
    fine = simulate(
        patient["system_two"],
        6.0,
        start={"y1": 0.0, "y2": 5.0},
        u1=0.0,
        u2=1.0,
        k=k,
        points=6001,
        rtol=1e-10,
        atol=1e-12,
    )
    (t1, y1), (t2, y2) = (patient["extremes"](fine.t, fine[name]) for name in ("y1", "y2"))
    for t, y in ((t1, y1), (t2, y2)):
        assert np.diff(t)[:2] == pytest.approx(np.pi / 2, abs=1e-4) and (y[1:] / y[:-1])[
            :2
        ] == pytest.approx(-np.exp(-np.pi / 2), abs=1e-4)
    lag = (t1[0] - t2[0]) % (np.pi / 2)
    assert lag == pytest.approx((np.angle(k + 1j) / 2) % (np.pi / 2), abs=1e-4)


def test_09_the_matrix_from_samples_and_the_wrong_one_from_rare_samples(patient):
    A, identify, samples = patient["A"], patient["identify"], patient["samples"]
    found, rest = identify(samples(0.5, 8), 0.5)
    assert found == pytest.approx(A, abs=1e-9) and rest == pytest.approx([2, 5])
    assert patient["good"] == ["no", "yes"]
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
    assert patient["edge"] == pytest.approx(0.4)
    for h, stable in ((0.39, True), (0.41, False)):
        run = simulate(patient["system"], 200 * h, method="Euler", step=h, points=2)
        z = patient["S_inverse"] @ (np.array(list(run.final.values())) - (2, 5))
        assert (np.hypot(*z) < 5) == stable and np.hypot(*z) == pytest.approx(
            5 * abs(1 + h * (-1 + 2j)) ** 200, rel=1e-6
        )


def test_09_answers_to_the_tasks(patient):
    found = patient["solutions"]
    assert found["k"] == pytest.approx(0.5)
    assert found["natural"] == pytest.approx(2 * np.pi / 1.3)
    assert found["lowest"] == pytest.approx(3.632, abs=1e-3)
    assert found["star"] == pytest.approx(np.pi)
    k = found["grows"]  # the largest eigenvalue of (A + Aᵀ)/2 is α + β k √(k² + 4)/2
    assert k * np.sqrt(k * k + 4) == pytest.approx(1.0)
    h, alpha, beta = 0.4, -1.0, 2.0  # task 5, on the sugar alone
    g = patient["samples"](h, 6)[:, 1] - 5
    assert g[2:] == pytest.approx(
        2 * np.exp(alpha * h) * np.cos(beta * h) * g[1:-1] - np.exp(2 * alpha * h) * g[:-2],
        abs=1e-12,
    )
