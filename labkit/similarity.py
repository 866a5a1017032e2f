"""Equilibria made to measure: canonical forms, the four similarity transformations of part 1, and
whether a design meets its task.

    A, b = design(canonical("stable node", -1, -3), matrix_a(u=(0, 1), v=(2, 0)), at=(1, 2))
    check_design(A, b, S, "stable node", "matrix A")  # prints what is right and what is wrong

A = S Λ S⁻¹ has the eigenvalues of Λ, and so its type; b = −A s* puts the equilibrium at s*. In
z = S⁻¹ (s − s*) the motion is canonical, dz/dt = Λ z.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .arguments import asked
from .linear import E, borders, classify, eigenvalues, equilibrium, finite
from .model import ModelError, check_names, number

__all__ = ["Review", "Similarity", "canonical", "check_design", "design", "matrix_a", "matrix_b"]
__all__ += ["reflection", "rotation"]

# ---- Λ as functions of its numbers, entry by entry: so that models can use them


def _two(p):
    return p.lambda1, 0.0, 0.0, p.lambda2


def _star(p):
    return p.lambda0, 0.0, 0.0, p.lambda0


def _improper(p):
    return p.lambda0, 0.0, 1.0, p.lambda0


def _spiral(p):
    return p.alpha, p.beta, -p.beta, p.alpha


def _centre(p):
    return 0.0, p.beta, -p.beta, 0.0


_PAIR = {"lambda1": "eigenvalue 1", "lambda2": "eigenvalue 2"}
#: of each type: Λ, what its numbers mean, and which they must be
BLOCKS = {
    "node": (_two, _PAIR, "two different {sign} eigenvalues λ1, λ2"),
    "star": (_star, {"lambda0": "both eigenvalues"}, "one {sign} number λ0"),
    "improper node": (_improper, {"lambda0": "both eigenvalues"}, "one {sign} number λ0"),
    "spiral point": (
        _spiral,
        {"alpha": "growth rate", "beta": "turning rate"},
        "α {sign} and β not zero",
    ),
    "saddle": (_two, _PAIR, "one positive and one negative eigenvalue"),
    "centre": (_centre, {"beta": "turning rate"}, "β not zero"),
}


@asked
def canonical(kind: str, *numbers: float) -> np.ndarray:
    """canonical("stable node", -1, -3) -> Λ = diag(−1, −3).

    Kinds as `classify` names them; "elliptic point" is a centre.
    node, saddle: (λ1, λ2) -> diag(λ1, λ2) · star: (λ0) -> λ0 E · improper node: (λ0) -> [[λ0, 0],
    [1, λ0]] · spiral point: (α, β) -> [[α, β], [−β, α]] · centre: (β). Raises ModelError, with the
    type that they would make, for numbers that do not fit.
    """
    kind = _kind(kind)
    un, base = kind.rpartition("stable ")[0], base_of(kind)
    block, names, need = BLOCKS[base]
    need = need.format(sign="positive" if un else "negative")
    if (count := len(names)) != len(numbers):
        raise ModelError(
            f"{_a(kind)} takes {count} number{'s' * (count > 1)} ({need}), not {len(numbers)}"
        )
    values = (number(value, f"a number of the {kind}") for value in numbers)
    entries = block(SimpleNamespace(**dict(zip(names, values, strict=True))))
    Lambda = np.array(entries, dtype=float).reshape(2, 2)
    if (made := classify(Lambda)) != kind:
        raise ModelError(
            f"{', '.join(f'{value:g}' for value in numbers)} would make the type “{made}”; "
            f"{_a(kind)} needs {need}"
        )
    return Lambda


def base_of(kind: str) -> str:
    """base_of("unstable node") -> "node"; ModelError for a type that there is not."""
    return _kind(kind).rpartition("stable ")[2]


def _kind(kind: str) -> str:
    other = {"elliptic point": "centre", "stable spiral": "stable spiral point"}
    other |= {"unstable spiral": "unstable spiral point"}
    *both, saddle, centre = BLOCKS
    known = [f"{un}stable {base}" for base in both for un in ("", "un")]
    name = other.get(kind, kind)
    check_names([name], [*known, saddle, centre], "there is no type {}")
    return name


def _a(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


#: the transformations of part 1, in words
WAYS = ("matrix A", "matrix B", "reflection", "rotation")


class Similarity(NamedTuple):
    """S, inverse = matrix_a(u, v): a similarity transformation and its inverse."""

    S: np.ndarray
    inverse: np.ndarray


@asked
def matrix_a(u: ArrayLike, v: ArrayLike) -> Similarity:
    """matrix_a(u=(0, 1), v=(2, 0)) -> S = E + u vᵀ and S⁻¹ = E − u vᵀ, a shear along u.

    Raises ModelError unless (u, v) = 0.
    """
    u, v, d = _vectors(u, v)
    if abs(d) > 1e-12 * np.hypot(*u) * np.hypot(*v):
        raise ModelError(
            f"matrix A needs u and v at right angles, but (u, v) = {d:g}: then E − u vᵀ is not the "
            "inverse of E + u vᵀ. Take v = k (u2, −u1) with any k, or use matrix_b, which allows it"
        )
    return Similarity(E + np.outer(u, v), E - np.outer(u, v))


@asked
def matrix_b(u: ArrayLike, v: ArrayLike) -> Similarity:
    """matrix_b(u=(1, 0), v=(2, 1)) -> S = E + u vᵀ and S⁻¹ = E − u vᵀ/(1 + d), d = (u, v).

    det S = 1 + d: areas grow by this factor, and for d < −1 the plane is turned over as well.
    Raises ModelError for d = −1.
    """
    u, v, d = _vectors(u, v)
    if abs(1 + d) <= 1e-12 * (1 + np.hypot(*u) * np.hypot(*v)):
        raise ModelError(
            "matrix B needs (u, v) ≠ −1: at −1 it maps u to 0 and presses the whole plane flat on "
            "one line, so it has no inverse"
        )
    return Similarity(E + np.outer(u, v), E - np.outer(u, v) / (1 + d))


def _vectors(u: ArrayLike, v: ArrayLike) -> tuple[np.ndarray, np.ndarray, float]:
    """u, v and (u, v)."""
    u, v = finite(u, (2,), "u"), finite(v, (2,), "v")
    return u, v, float(u @ v)


@asked
def reflection(u: ArrayLike) -> Similarity:
    """reflection(u=(1, -1)) -> S = S⁻¹ = E − γ u uᵀ, γ = 2/(uᵀu), Householder's.

    The mirror line is at right angles to u. Raises ModelError for u = 0.
    """
    u = finite(u, (2,), "u")
    if not np.any(u):
        raise ModelError("a reflection needs u ≠ 0: u stands at right angles to the mirror line")
    u = u / np.abs(u).max()
    H = E - 2 / (u @ u) * np.outer(u, u)
    return Similarity(H, H)


@asked
def rotation(phi: float) -> Similarity:
    """rotation(np.pi/6) -> S = [[cos φ, −sin φ], [sin φ, cos φ]], Givens', and S⁻¹ = Sᵀ.

    φ in radians, counter-clockwise.
    """
    phi = number(phi, "phi")
    G = np.array([[cos(phi), -sin(phi)], [sin(phi), cos(phi)]])
    return Similarity(G, G.T)


@asked
def design(
    Lambda: ArrayLike, similarity: Similarity, at: ArrayLike = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """A, b = design(canonical("saddle", 1, -2), rotation(0.5), at=(1, 2))

    A = S Λ S⁻¹ and b = −A s* put the equilibrium s* there.
    """
    S, inverse = similarity
    A = S @ finite(Lambda, (2, 2), "Lambda") @ inverse
    return A, -A @ finite(at, (2,), "at")


# ---- does a design meet its task?


@dataclass(frozen=True)
class Review:
    """What `check_design` found: review.passed, review.remarks (True or False, sentence).

    It prints itself, and counts as True or False.
    """

    remarks: tuple[tuple[bool, str], ...]

    @property
    def passed(self) -> bool:
        return all(good for good, _ in self.remarks)

    def __bool__(self) -> bool:
        return self.passed

    def __repr__(self) -> str:
        lines = [f"{'✓' if good else '✗'} {text}" for good, text in self.remarks]
        end = "The task is met." if self.passed else "Not yet: mend the lines marked ✗."
        return "\n".join([*lines, end])


@asked
def check_design(
    A: ArrayLike,
    b: ArrayLike,
    S: ArrayLike,
    kind: str,
    by: str,
    at: ArrayLike | None = None,
    tolerance: float = 1e-9,
) -> Review:
    """check_design(A, b, S, "stable node", "matrix A") -> Review

    Do A, b and S meet an assignment of part 1, and if not, why? Looks at the type of A, the
    equilibrium (and whether it lies `at` the wanted point), the form of S (`by` is "matrix A",
    "matrix B", "reflection" or "rotation") and whether S⁻¹ A S is the canonical form. Raises
    ModelError for input that is not 2 × 2 or a name that is unknown.
    """
    A, b, S = finite(A, (2, 2), "A"), finite(b, (2,), "b"), finite(S, (2, 2), "S")
    goal = None if at is None else finite(at, (2,), "at")
    kind = _kind(kind)
    check_names([by], WAYS, "there is no transformation by {}")
    made = classify(A, tolerance)
    values = ", ".join(f"{z:.4g}" if z.imag else f"{z.real:.4g}" for z in eigenvalues(A))
    wanted = "" if made == kind else f", but the task asks for: {kind}"
    remarks = [(made == kind, f"type: {made} (eigenvalues {values}){wanted}")]
    try:
        rest = equilibrium(A, b)
    except ModelError as error:
        remarks.append((False, str(error)))
    else:
        there = goal is None or bool(np.allclose(rest, goal, rtol=1e-6, atol=1e-6))
        wanted = "" if there else " and not at ({:g}, {:g}): b must be −A s*".format(*goal)
        remarks.append((there, f"equilibrium at {pair(rest)}{wanted}"))
    remarks.append(_form(S, by, tolerance))
    if borders(S)["det A = 0"] > tolerance:
        L, other = np.linalg.solve(S, A @ S), S @ A @ np.linalg.inv(S)
        slack = 10 * tolerance * float(np.abs(A).max() + 1) * np.linalg.cond(S)
        said, fault = ", the canonical form", _not_canonical(L, kind, slack)
        if fault:
            swapped = not _not_canonical(other, kind, slack)
            said = f" is not the canonical form: {fault}"
            said += " (S A S⁻¹ is: S and S⁻¹ have changed places)" * swapped
        remarks.append((not fault, f"S⁻¹ A S = {rows(np.where(np.abs(L) < slack, 0.0, L))}{said}"))
    return Review(tuple(remarks))


def clean(M: np.ndarray) -> np.ndarray:
    """clean(M) -> without what is rounding beside the largest entry, and without −0."""
    return np.where(np.abs(M) < 1e-12 * np.abs(M).max(), 0.0, M) + 0.0


def pair(v: np.ndarray) -> str:
    return "({:.4g}, {:.4g})".format(*clean(v))


def rows(M: np.ndarray) -> str:
    return "[[{:.4g}, {:.4g}], [{:.4g}, {:.4g}]]".format(*clean(M).ravel())


def _form(S: np.ndarray, by: str, tolerance: float) -> tuple[bool, str]:
    """Is S of the form that its name says?

    With S = E + u vᵀ the matrix S − E has determinant 0 and trace (u, v).
    """
    N, slack = S - E, tolerance * max(1.0, float(np.abs(S).max())) ** 2
    d, rest = float(np.trace(N)), float(N[0, 0] * N[1, 1] - N[0, 1] * N[1, 0])
    note = " (S = E changes nothing: choose another one to see something)"
    note *= bool(np.abs(N).max() <= slack)
    if by in ("reflection", "rotation"):
        if np.abs(S.T @ S - E).max() > slack:
            return False, (
                f"S is no {by}: its columns are not unit vectors at right angles, "
                f"SᵀS = {np.round(S.T @ S, 4).tolist()}"
            )
        turns = bool(S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0] > 0)
        made, det = ("rotation", 1) if turns else ("reflection", -1)
        return made == by, f"S is a {made} (det S = {det}){note}"
    if abs(rest) > slack:
        return False, f"S is not E + u vᵀ: S − E would have determinant 0, and has {rest:.4g}"
    if by == "matrix A":
        if abs(d) <= slack:
            return True, f"S = E + u vᵀ with (u, v) = 0{note}"
        needs = "which matrix A needs to be 0 (this is matrix B)"
        return False, f"S = E + u vᵀ with (u, v) = {d:.4g}, {needs}"
    good = abs(1 + d) > slack
    return good, f"S = E + u vᵀ with d = (u, v) = {d:.4g}{note if good else ': no inverse exists'}"


def _not_canonical(L: np.ndarray, kind: str, slack: float) -> str:
    """What is wrong with L as the canonical form of this kind; "" when nothing is."""
    (w, x), (y, z) = L.tolist()
    if "spiral" in kind or kind == "centre":
        turns = abs(w - z) <= slack and abs(x + y) <= slack
        return "" if turns else "it should read [[α, β], [−β, α]]"
    if abs(x) > slack:
        return f"the upper right entry is {x:.4g} and should be 0"
    goal = int("improper" in kind)
    return "" if abs(y - goal) <= slack else f"the lower left entry is {y:.4g} and should be {goal}"
