"""Linear systems of second order: the type of an equilibrium."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .model import ModelError

__all__ = ["classify"]


def classify(A: ArrayLike, tolerance: float = 1e-9) -> str:
    """classify([[-2, 1], [-1, -2]]) -> "stable spiral point": the type of the equilibrium of dy/dt = A y, A 2 × 2.

    From trace and determinant (Strogatz, Nonlinear Dynamics and Chaos, section 5.2), that is, from the eigenvalues
    λ = tr A/2 ± √((tr A/2)² − det A): "stable …" or "unstable …" with "node", "star", "improper node" or "spiral point";
    "saddle", "centre", and "degenerate (line of equilibria)" or "degenerate (all points)" when det A = 0.

    Stars, improper nodes, centres and degenerate cases are equalities, which numbers meet only to rounding. With a = tr A/2,
    B = A − a E and ‖·‖ the largest absolute entry, what counts as equal is: det A = 0 to tolerance·‖A‖²; B = 0 (star) to
    tolerance·‖A‖; equal eigenvalues (det B = 0) to tolerance·‖A‖·‖B‖; a = 0 (centre) to tolerance·‖A‖. Raises ModelError
    for anything but a finite 2 × 2 matrix or a tolerance outside 0 … 0.1.
    """
    M = np.asarray(A, dtype=float)
    if M.shape != (2, 2) or not np.all(np.isfinite(M)):
        raise ModelError(f"classify takes a 2 × 2 matrix of finite numbers, not {A!r}")
    if not 0 <= tolerance <= 0.1:
        raise ModelError(f"tolerance = {tolerance:g} must lie in 0 … 0.1")
    size = np.abs(M).max()
    if size == 0:
        return "degenerate (all points)"
    M = M / size
    a = (M[0, 0] + M[1, 1]) / 2
    d = (M[0, 0] - M[1, 1]) / 2  # B = [[d, M01], [M10, −d]]
    square = d * d + M[0, 1] * M[1, 0]  # −det B = (tr A/2)² − det A, without the cancellation
    spread = max(abs(d), abs(M[0, 1]), abs(M[1, 0]))
    determinant = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    if abs(determinant) <= tolerance:
        return "degenerate (line of equilibria)"
    if determinant < 0:
        return "saddle"
    stability = "stable" if a < 0 else "unstable"
    if spread <= tolerance:
        return f"{stability} star"
    if abs(square) <= tolerance * spread:
        return f"{stability} improper node"
    if square > 0:
        return f"{stability} node"
    return "centre" if abs(a) <= tolerance else f"{stability} spiral point"
