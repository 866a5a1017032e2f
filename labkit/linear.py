"""Linear systems of second order, ds/dt = A s + b: type of the equilibrium, exact solution.

    classify(A), borders(A), equilibrium(A, b), eigenlines(A)
    exact(A, b, (4, -2), t)      # (len(t), 2), also where A is defective or singular
    true_error(run)              # of a simulated linear model
    error_table(system, 10.0, [("RK4", 0.1), ("DOP853", 1e-10)])

All of it rests on one splitting of a real 2 × 2 matrix, A = a E + q J + R: a = tr A/2, J the
quarter turn [[0, −1], [1, 0]], and R symmetric with trace 0, that is, r times a reflection. Then λ
= a ± √(r² − q²), the singular values are |√(a² + q²) ± r|, and what decides the type is which of r,
|q| and |a| is larger: numbers that come from A without cancellation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

import numpy as np
from numpy.typing import ArrayLike

from .arguments import asked
from .model import ModelError, System, listed
from .run import Run
from .table import Table

__all__ = ["affine", "borders", "classify", "eigenlines", "eigenvalues", "equilibrium"]
__all__ += ["error_table", "exact", "true_error"]

E = np.eye(2)


def finite(value: ArrayLike, shape: tuple[int, ...], what: str) -> np.ndarray:
    """finite(b, (2,), "b") -> array of that shape.

    ModelError, naming it, for another shape or anything that is not a finite number.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} must be made of numbers, not {value!r}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ModelError(
            f"{what} must be {'a 2 × 2 matrix' if len(shape) == 2 else 'a pair'} of finite "
            f"numbers, not {value!r}"
        )
    return array


def _split(A: ArrayLike) -> tuple[float, float, float, float, float]:
    """size, a, q, r and r − |q| of A = size·(a E + q J + R), entries of A/size at most 1.

    The size is 0 for the zero matrix.
    """
    w, x, y, z = finite(A, (2, 2), "the matrix").ravel().tolist()
    size = max(abs(w), abs(x), abs(y), abs(z))
    if size == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    w, x, y, z = w / size, x / size, y / size, z / size
    d, q, r = (w - z) / 2, (y - x) / 2, hypot((w - z) / 2, (x + y) / 2)
    return size, (w + z) / 2, q, r, (d * d + x * y) / ((r + abs(q)) or 1.0)  # r² − q² = d² + xy


# ---- the type


@asked
def borders(A: ArrayLike) -> dict[str, float]:
    """borders(A)["tr A = 0"] -> how far A is from a border between types, relative to ‖A‖.

    The distance is ‖ΔA‖/‖A‖ (spectral norm) of the smallest change that puts A exactly on the
    border: |√(a² + q²) − r| for "det A = 0" (the smallest singular value), |a| for "tr A = 0", |r −
    |q|| for "equal eigenvalues", i.e. det A = (tr A/2)², and r + |q| for "star". A change below
    this distance cannot carry A over that border. All are 0 for the zero matrix.
    """
    return _borders(*_split(A)[1:])


def _borders(a: float, q: float, r: float, gap: float) -> dict[str, float]:
    turn, norm = hypot(a, q), (hypot(a, q) + r) or 1.0
    return {
        "det A = 0": abs(turn - r) / norm,
        "tr A = 0": abs(a) / norm,
        "equal eigenvalues": abs(gap) / norm,
        "star": (r + abs(q)) / norm,
    }


@asked
def classify(A: ArrayLike, tolerance: float = 1e-9) -> str:
    """classify([[-2, 1], [-1, -2]]) -> "stable spiral point": of dy/dt = A y, A 2 × 2.

    From trace and determinant (Strogatz, Nonlinear Dynamics and Chaos, section 5.2), that is, from
    the eigenvalues λ = tr A/2 ± √((tr A/2)² − det A): "stable …" or "unstable …" with "node",
    "star", "improper node" or "spiral point"; "saddle", "centre", and "degenerate (line of
    equilibria)" or "degenerate (all points)" when det A = 0.

    Stars, improper nodes, centres and degenerate cases are equalities, which numbers meet only to
    rounding: A counts as being on a border when its distance to it, as `borders` gives it, is at
    most `tolerance`. With tolerance 0 the answer is right for every matrix farther than 1e-15 from
    all borders. Raises ModelError for anything but a finite 2 × 2 matrix or a tolerance outside 0 …
    0.1.
    """
    if not 0 <= tolerance <= 0.1:
        raise ModelError(f"tolerance = {tolerance:g} must lie in 0 … 0.1")
    size, a, q, r, gap = _split(A)
    if size == 0:
        return "degenerate (all points)"
    near = {name: distance <= tolerance for name, distance in _borders(a, q, r, gap).items()}
    if near["det A = 0"]:
        return "degenerate (line of equilibria)"
    if r > hypot(a, q):
        return "saddle"
    stability = "stable" if a < 0 else "unstable"
    if near["star"]:
        return f"{stability} star"
    if near["equal eigenvalues"]:
        return f"{stability} improper node"
    if gap > 0:
        return f"{stability} node"
    return "centre" if near["tr A = 0"] else f"{stability} spiral point"


@asked
def eigenvalues(A: ArrayLike) -> tuple[complex, complex]:
    """eigenvalues(A) -> (λ1, λ2), larger real part first.

    Equal ones come out equal, which NumPy's eigvals cannot promise.
    """
    a, root = _center_and_root(A)
    return a + root, a - root


def _center_and_root(A: ArrayLike) -> tuple[float, complex]:
    """a and √(r² − q²) of A itself: λ = a ± root."""
    size, a, q, r, gap = _split(A)
    return size * a, size * np.sqrt(complex(gap * (r + abs(q))))


@asked
def eigenlines(A: ArrayLike, tolerance: float = 1e-9) -> list[tuple[float, np.ndarray]]:
    """eigenlines(A) -> [(λ, unit vector), …], largest λ first.

    The directions of straight trajectories through the equilibrium.
    Two for a node or a saddle (there they are the separatrices: unstable first), one for an
    improper node, none for a spiral or a centre. For a star every direction is one; the two axes
    are returned. `tolerance` as in `classify`.
    """
    size, a, q, r, gap = _split(A)
    near = _borders(a, q, r, gap)
    if near["star"] <= tolerance:
        return [(size * a, E[0]), (size * a, E[1])]
    if gap < 0 and near["equal eigenvalues"] > tolerance:
        return []
    (w, x), (y, z) = (np.asarray(A, dtype=float) / size).tolist()
    d, equal = (w - z) / 2, near["equal eigenvalues"] <= tolerance
    root = 0.0 if equal else np.sqrt(gap * (r + abs(q)))
    lines = []
    for s in (root, -root)[: 2 if root else 1]:
        # the column of A − aE + sE without cancellation
        first = d * s > 0 or (d * s == 0 and abs(y) >= abs(x))
        v = np.array([d + s, y] if first else [x, s - d])
        v = v / np.hypot(*v)
        lines.append((size * (a + s), v if tuple(v) > (0, 0) else -v))
    return lines


# ---- equilibrium and exact solution


@asked
def equilibrium(A: ArrayLike, b: ArrayLike, tolerance: float = 1e-12) -> np.ndarray:
    """equilibrium(A, b) -> s* = −A⁻¹ b, the only point where A s + b = 0.

    Raises ModelError when det A = 0 (to `tolerance`, see `borders`), and says whether no point or a
    whole line of points is at rest.
    """
    A, b = finite(A, (2, 2), "A"), finite(b, (2,), "b")
    if not np.any(A) or borders(A)["det A = 0"] <= tolerance:
        U, s, Vt = np.linalg.svd(A)
        drive = abs(float(U[:, -1] @ b))  # the part of b that no A s can balance
        if not np.any(A):
            which = "no point is" if np.any(b) else "all points are"
            why = f"A = 0, so ds/dt = b everywhere: {which} at rest"
        elif drive > 1e-9 * np.hypot(*b):
            why = (
                "A s takes values on one line only and b does not lie on it: no point is at rest, "
                f"the state drifts for ever ({drive:.3g} across that line)"
            )
        else:
            (x, y), (dx, dy) = -Vt[0] * (U[:, 0] @ b) / s[0] + 0.0, Vt[1]  # never −0
            why = (
                f"A does not feel the direction ({dx:.3g}, {dy:.3g}): every point of the line "
                f"through ({x:.3g}, {y:.3g}) along it is at rest"
            )
        raise ModelError(f"there is no single equilibrium, because det A = 0. {why}")
    return np.linalg.solve(A, -b) + 0.0  # never −0


@asked
def exact(A: ArrayLike, b: ArrayLike, start: ArrayLike, t: ArrayLike) -> np.ndarray:
    """exact(A, b, (4, -2), t) -> s(t) = e^{At} s0 + (∫₀ᵗ e^{Aτ} dτ) b, shape (len(t), 2).

    Starts of shape (k, 2) give (k, len(t), 2).
    The integral is A⁻¹(e^{At} − E) where A has an inverse, and exists where it has none. With B = A
    − aE and ±√Δ = ±√(r² − q²) the eigenvalues of B, every function of A is f(A) = ½(f(λ1) + f(λ2))
    E + f[λ1, λ2] B; the divided differences f[λ1, λ2] are evaluated without cancellation, so nodes
    with nearly equal eigenvalues, improper nodes and spirals are one formula. Times may be
    negative. Raises ModelError for wrong shapes, and where the solution leaves the range of numbers
    (1e308).
    """
    A, b = finite(A, (2, 2), "A"), finite(b, (2,), "b")
    t, start = np.asarray(t, dtype=float).reshape(-1, 1, 1), np.asarray(start, dtype=float)
    fits = start.shape[-1:] == (2,) and start.ndim <= 2
    if not fits or not np.isfinite(start).all() or not np.isfinite(t).all():
        raise ModelError(
            "start must be a pair of numbers or an array (k, 2), and t finite; got a start of "
            f"shape {start.shape}"
        )
    a, root = _center_and_root(A)
    B = A - a * E
    w = np.where((root * t).real < 0, -root * t, root * t)  # both functions below are even in it
    with np.errstate(over="ignore", invalid="ignore"):
        mean = (np.exp(a * t + w) + np.exp(a * t - w)) / 2
        slope = t * np.exp(a * t + w) * _phi1(-2 * w)  # e^{at} sinh(√Δ t)/√Δ
        flow = mean.real * E + slope.real * B
        h = t * (_phi1(a * t + w) + _phi1(a * t - w)) / 2
        # f[λ1, λ2] of f(λ) = t φ(λt): the difference quotient, or Gauss's mean of f' where λ1 t and
        # λ2 t are close
        close = np.abs(w) < 1
        far = np.where(close, 1, w)
        nodes = zip(*np.polynomial.legendre.leggauss(8), strict=True)
        between = sum(g / 2 * _phi1_slope(a * t + x * w) for x, g in nodes)
        apart = (_phi1(a * t + far) - _phi1(a * t - far)) / (2 * far)
        steep = t * t * np.where(close, between, apart)
        drive = (h.real * E + steep.real * B) @ b
    s = np.einsum("mij,...j->...mi", flow, start) + drive
    if not np.all(np.isfinite(s)):
        raise ModelError(
            f"the exact solution grows beyond 1e308 within t = {np.abs(t).max():g}: take a "
            "shorter time"
        )
    return s


def _phi1(z: np.ndarray) -> np.ndarray:
    """(e^z − 1)/z, 1 at 0; NumPy's complex expm1 is accurate near 0."""
    zero = np.abs(z) < 1e-100  # a complex quotient of still smaller numbers overflows
    safe = np.where(zero, 1, z)
    return np.where(zero, 1, np.expm1(safe) / safe)


def _phi1_slope(z: np.ndarray) -> np.ndarray:
    """Derivative of (e^z − 1)/z: (e^z (z − 1) + 1)/z², near 0 its series Σ z^k/(k! (k + 2))."""
    near = np.abs(z) < 1
    small, safe = np.where(near, z, 0), np.where(near, 1, z)
    series, term = np.zeros_like(z), np.ones_like(z)
    for k in range(20):
        series, term = series + term / (k + 2), term * small / (k + 1)
    return np.where(near, series, (np.exp(safe) * (safe - 1) + 1) / safe**2)


@asked
def affine(
    system: System, p: tuple | None = None, at: Mapping[str, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """A, b = affine(system, run.p): matrix and inflow of a linear model, from its flow at points.

    Held variables stand as in `at` (run.start, say), or as at the system's start. Raises ModelError
    for a model that has not two states and one mode, or is not linear.
    """
    (mode,) = system.modes.values() if len(system.modes) == 1 else (None,)
    if mode is None or len(system.states) != 2:
        raise ModelError(
            f"{system.name!r} has {len(system.modes)} mode(s) and the states "
            f"{listed(system.states)}; here a system has one mode and two states"
        )
    kind, p = system.S[mode.name], system.values() if p is None else p
    held = [(at or system.start)[name] for name in system.held]

    def flow(x: float, y: float, t: float = 0.0) -> np.ndarray:
        return np.array(mode.flow(t, kind(x, y, *held), p), dtype=float)

    b = flow(0.0, 0.0)
    A = np.column_stack([flow(1.0, 0.0) - flow(-1.0, 0.0), flow(0.0, 1.0) - flow(0.0, -1.0)]) / 2
    x, y, t = 1.7, -2.3, 0.7
    size = np.abs(A).max() + np.abs(b).max()
    if not np.allclose(flow(x, y, t), A @ (x, y) + b, rtol=1e-9, atol=1e-9 * size):
        raise ModelError(
            f"{system.name!r} is not of the form ds/dt = A s + b with constant A and b"
        )
    return A, b


@asked
def true_error(run: Run) -> np.ndarray:
    """true_error(run) -> (m,) distance of each sample from the exact state, of a linear model."""
    return np.hypot(*(run.values[:, :2] - _exact(run)).T)


def _exact(run: Run) -> np.ndarray:
    A, b = affine(run.system, run.p, run.start)
    return exact(A, b, run.values[0, :2], run.t - run.t[0])


@asked
def error_table(
    system: System,
    horizon: float,
    how: Sequence[tuple[str, float]],
    start: Mapping[str, float] | None = None,
    **parameters: float,
) -> Table:
    """error_table(system, 10.0, [("Euler", 0.01), ("DOP853", 1e-10)]) -> Table.

    What each method costs and how far it is from the exact solution.
    The number beside a method is its step where it has a fixed one (Euler, Heun, RK4), else its
    rtol.
    """
    from .solve import simulate
    from .solve.methods import FIXED_STEP

    rows = []
    for method, value in how:
        fixed = method in FIXED_STEP
        options = {"method": method, "step" if fixed else "rtol": value}
        run = simulate(system, horizon, start=start, **options, **parameters)
        error, size = true_error(run), np.hypot(*_exact(run).T).max()
        said = f"{'h' if fixed else 'rtol'} = {value:.4g}"
        far = error.max()
        rows.append((method, said, run.work.evaluations, far, far / (size or 1), error[-1]))
    errors = ("largest error", "of the largest state", "error at the end")
    heads = ("method", "step or tolerance", "evaluations", *((head, "", ".1e") for head in errors))
    return Table(heads, rows)
