"""Part 1, the later assignments: what is special in each. What all twelve share is tested elsewhere."""

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
        assert A == pytest.approx(G @ np.diag([1.2, 0.3]) @ G.T, abs=1e-13) and A[0, 1] == pytest.approx(A[1, 0], abs=1e-13)
        assert equilibrium(A, b) == pytest.approx([1, 2]) and classify(A) == "unstable node"


def test_12_two_streams_part_when_theory_says(lava):
    for side, run in ((1, lava["right"]), (-1, lava["left"])):
        z1, z2 = lava["ridge"](run)
        assert z1 == pytest.approx(side * 0.001 * np.exp(1.2 * run.t), rel=1e-5) and z2 == pytest.approx(0.1 * np.exp(0.3 * run.t), rel=1e-5)
        assert np.interp(0, np.log(np.abs(z1 / z2)), run.t) == pytest.approx(np.log(100) / 0.9, abs=1e-4)
    height = -0.5 * np.einsum("im,ij,jm->m", lava["Y"], lava["A"], lava["Y"])
    assert np.all(np.diff(height) < 0)


def test_12_a_fixed_step_turns_with_the_system_and_a_tolerance_does_not(lava):
    errors = lava["errors"]
    rk4 = errors["RK4, h = 0.3"]
    assert np.ptp(rk4) < 1e-6 * rk4.min() and errors["RK45, rtol 1e-5"].max() > 3 * errors["RK45, rtol 1e-5"].min()
    growth = np.array([1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24 for z in (0.36, 0.09)]) ** 20
    assert rk4[0] == pytest.approx(np.hypot(*(growth * (0.001, 0.1) - lava["z_exact"])), rel=1e-6)


def test_12_only_rounding_leaves_the_crest(lava):
    for options in lava["trials"].values():
        assert lava["leaves"](0.0, **options) is None
        for phi in (20.0, 50.0):
            assert 33 < lava["leaves"](phi, **options) < 50
    assert lava["leaves"](30.0, method="Euler", step=0.3) > 45  # Euler's own growth is slower: (1 + hλ)^n


def test_12_a_tolerance_is_relative_to_the_origin_of_the_map(lava):
    near, far = (simulate(lava["system"], 6.0, rtol=1e-10, atol=1e-16, **options)
                 for options in ({"x0": 0, "y0": 0, "start": lava["y0"]}, {}))
    assert true_error(near)[-1] < true_error(far)[-1] / 3


def test_12_answers_to_the_tasks(lava):
    assert affine(lava["system"], lava["system"].values({"lambda1": 3.0, "lambda2": 1.0, "phi": 45.0}))[0] == pytest.approx(np.array([[2, 1], [1, 2]]))
    assert 0.01 * np.exp(-7.2) == pytest.approx(7.5e-6, rel=0.01)
    assert np.degrees(30) % 360 == pytest.approx(278.9, abs=0.05)
    assert expm(np.diag([1.2, 0.3]) * 6) @ (0.001, 0.1) == pytest.approx(lava["z_exact"])
    assert rotation(30).S == pytest.approx(rotation(np.radians(278.8734)).S, abs=1e-5)
