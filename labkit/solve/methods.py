"""The methods as tables: Runge–Kutta coefficients (from SciPy, not retyped), dense output as one polynomial a step.

    table = explicit("DOP853")
    table.A, table.C, table.E, table.W, table.Q

Every method hands a step to the event location and the output in the same form, a polynomial in
θ = (t − t0)/h with the state at t0 as its constant term: RK45 of degree 4 (Shampine), DOP853 of degree 7
(Hairer, Nørsett, Wanner), fixed-step methods the cubic Hermite interpolant (Euler: the chord), SciPy's implicit
methods their own interpolants, which are polynomials too.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

EXPLICIT = ("Euler", "Heun", "RK4", "RK45", "DOP853")
IMPLICIT = ("LSODA", "Radau", "BDF")
METHODS = EXPLICIT + IMPLICIT
FIXED_STEP = ("Euler", "Heun", "RK4")
#: Degree of the interpolant of SciPy's methods (the highest order that LSODA and BDF may choose).
DEGREE = {"LSODA": 12, "Radau": 4, "BDF": 5}


@dataclass(frozen=True)
class Table:
    """stages: evaluations of a step; row `stages` of K is the flow at its end, later rows serve the dense output."""

    stages: int
    order: int  # of the error estimate plus one: the exponent of the step control
    A: np.ndarray  # (rows, rows); row `stages` holds the weights of the step itself
    C: np.ndarray  # (rows,)
    E: np.ndarray  # (2, rows) error weights; the second row is DOP853's third-order estimate
    W: np.ndarray  # (rows, degree) weights of the interpolant's own terms, F = h·Wᵀ·K
    Q: np.ndarray  # (degree, degree) from those terms to powers: coefficient of θ^(k+1) is Σ Q[k, i]·F[i]; zero: they are the powers


def _hermite(B: np.ndarray, stages: int) -> np.ndarray:
    """Cubic through both ends with both slopes: y0 + hf0·θ + (3Δ − 2hf0 − hf1)θ² + (hf0 + hf1 − 2Δ)θ³."""
    P = np.zeros((stages + 1, 3))
    P[0, 0] = 1
    P[:stages, 1], P[:stages, 2] = 3 * B, -2 * B
    P[0] += (0, -2, 1)
    P[stages] += (0, -1, 1)
    return P


def _fixed(
    A: list[list[float]], B: list[float], C: list[float], P: np.ndarray | None = None
) -> Table:
    stages = len(B)
    full = np.zeros((stages + 1, stages + 1))
    full[:stages, :stages], full[stages, :stages] = A, B
    P = _hermite(np.array(B), stages) if P is None else P
    return Table(
        stages,
        len(B),
        full,
        np.array([*C, 1.0]),
        np.zeros((2, stages + 1)),
        P,
        np.zeros((P.shape[1],) * 2),
    )


def _dop853() -> Table:
    S = _from_scipy("dop853_coefficients")
    rows, stages = S.N_STAGES_EXTENDED, S.N_STAGES
    E = np.zeros((2, rows))
    E[0, : stages + 1], E[1, : stages + 1] = S.E5, S.E3
    # The interpolant is F0·x + F1·x(1−x) + F2·x²(1−x) + …. The F are formed first and turned into powers of x
    # with small whole numbers: their sum at x = 1 then cancels to rounding, which it does not with the product W·Q.
    F = np.zeros((7, rows))
    F[0, :stages] = S.B
    F[1] = -F[0]
    F[1, 0] += 1
    F[2] = 2 * F[0]
    F[2, 0] -= 1
    F[2, stages] -= 1
    F[3:] = S.D
    Q = np.zeros((7, 7))
    basis = np.polynomial.Polynomial([1.0])
    for i in range(7):
        basis = basis * ([0, 1] if i % 2 == 0 else [1, -1])
        Q[: i + 1, i] = basis.coef[1:]
    return Table(stages, 8, S.A, S.C, E, F.T.copy(), Q)


def _from_scipy(file: str, owner: str = "") -> SimpleNamespace:
    """The numbers that a file of SciPy, or a class in it, assigns; scipy.integrate itself takes half a second to import, and most runs need no more of it."""
    import scipy

    path = Path(scipy.__file__).parent / "integrate" / "_ivp" / f"{file}.py"
    body = ast.parse(path.read_text(encoding="utf8")).body
    if owner:
        body = next(
            node.body for node in body if isinstance(node, ast.ClassDef) and node.name == owner
        )
    space = {"np": np}
    exec(
        compile(
            ast.Module([node for node in body if isinstance(node, ast.Assign | ast.AugAssign)], []),
            str(path),
            "exec",
        ),
        space,
    )
    return SimpleNamespace(**space)


@cache
def explicit(method: str) -> Table:
    """explicit("RK45") -> Table of an explicit method."""
    if method == "Euler":
        return _fixed([[0]], [1.0], [0], P=np.array([[1.0], [0.0]]))
    if method == "Heun":
        return _fixed([[0, 0], [1, 0]], [0.5, 0.5], [0, 1])
    if method == "RK4":
        return _fixed(
            [[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1, 0]],
            [1 / 6, 1 / 3, 1 / 3, 1 / 6],
            [0, 0.5, 0.5, 1],
        )
    if method == "DOP853":
        return _dop853()
    S = _from_scipy("rk", "RK45")
    A = np.zeros((7, 7))
    A[:6, :5], A[6, :6] = S.A, S.B
    E = np.zeros((2, 7))
    E[0] = S.E
    return Table(6, 5, A, np.concatenate([S.C, [1.0]]), E, S.P, np.zeros((4, 4)))


@cache
def proxy(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """proxy(N) -> nodes (N + 3,), bernstein (N + 1, N + 1), test (2, N + 1) for the guard's polynomial proxy on [0, 1].

    The first N + 1 nodes are Chebyshev–Lobatto points; `bernstein` turns values there into Bernstein coefficients,
    whose sign changes bound the number of roots (Descartes' rule; Lane & Riesenfeld 1981). The last two nodes
    are test points: `test` predicts the values there, and the misfit says how far the proxy can be trusted.
    """
    from math import comb

    x = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
    x[0], x[-1] = 0.0, 1.0
    extra = np.array([0.1370, 0.6180])  # no node of any degree used, not symmetric about the middle

    def vandermonde(points: np.ndarray) -> np.ndarray:
        return np.array(
            [
                [comb(degree, k) * v**k * (1 - v) ** (degree - k) for k in range(degree + 1)]
                for v in points
            ]
        )

    bernstein = np.linalg.inv(vandermonde(x))
    bernstein[0], bernstein[-1] = (
        np.eye(degree + 1)[0],
        np.eye(degree + 1)[-1],
    )  # the ends are values, exactly
    return np.concatenate([x, extra]), bernstein, vandermonde(extra) @ bernstein
