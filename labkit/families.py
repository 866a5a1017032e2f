"""The abstract model of an assignment of part 1, dy/dt = S Λ S⁻¹ y, and A = S Λ S⁻¹ in numbers.

    system_two, parts_two = family("stable node", "matrix A", lambda1=-0.5, lambda2=-1.5)
    explore(system_two, 10.0, lambda run: planes(run, parts_two),
            verdict=lambda run: describe(run, parts_two))
    decomposition(*parts(system.values()))

A notebook states its own model in the quantities of its story; parts(p) says which Λ and S they
make. The family has the quantities of the handbook, λ, u, v and φ, on its sliders.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan2, cos, degrees, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from .arguments import asked
from .linear import E, affine, borders, classify, equilibrium, finite
from .model import Mode, ModelError, Parameter, System, check_names, listed
from .run import Run
from .similarity import BLOCKS, Similarity, base_of, clean, pair, rows

__all__ = ["Decomposition", "decomposition", "describe", "family"]

Parts = Callable[[tuple], tuple[np.ndarray, Similarity]]


# ---- S as functions of the parameters, entry by entry: so that models can use them


def _matrix_a(p):
    v1, v2 = p.k * p.u2, -p.k * p.u1
    return 1 + p.u1 * v1, p.u1 * v2, p.u2 * v1, 1 + p.u2 * v2


def _matrix_b(p):
    size = p.u1 * p.u1 + p.u2 * p.u2
    v1, v2 = (p.d * p.u1 + p.k * p.u2) / size, (p.d * p.u2 - p.k * p.u1) / size
    return 1 + p.u1 * v1, p.u1 * v2, p.u2 * v1, 1 + p.u2 * v2


def _reflection(p):
    gamma = 2 / (p.u1 * p.u1 + p.u2 * p.u2)
    return 1 - gamma * p.u1 * p.u1, -gamma * p.u1 * p.u2, -gamma * p.u1 * p.u2, 1 - gamma * p.u2**2


def _rotation(p):
    return cos(p.phi), -sin(p.phi), sin(p.phi), cos(p.phi)


#: of each transformation: S, and its numbers, in ranges where S has an inverse
_WAYS = {
    "matrix A": (
        _matrix_a,
        {
            "u1": Parameter(0.8, "", "u, direction of the shear", -1, 1),
            "u2": Parameter(0.6, "", "u, direction of the shear", -1, 1),
            "k": Parameter(1.2, "", "shear along u: v = k (u2, −u1)", -6, 6),
        },
    ),
    "matrix B": (
        _matrix_b,
        {
            "u1": Parameter(1.0, "", "u, direction of the stretch", 0.2, 2),
            "u2": Parameter(0.5, "", "u, direction of the stretch", -2, 2),
            "d": Parameter(0.8, "", "d = (u, v): u is stretched 1 + d times", -0.9, 3),
            "k": Parameter(-1.0, "", "shear along u", -3, 3),
        },
    ),
    "reflection": (
        _reflection,
        {
            "u1": Parameter(0.5, "", "u, at right angles to the mirror", 0.2, 2),
            "u2": Parameter(1.5, "", "u, at right angles to the mirror", -3, 3),
        },
    ),
    "rotation": (_rotation, {"phi": Parameter(0.6, "rad", "angle of the turn", -pi, pi)}),
}


@asked
def family(
    kind: str,
    by: str,
    *,
    start: tuple[float, float] = (2.0, 1.0),
    unit: str = "",
    time: str = "s",
    **values: float | Parameter,
) -> tuple[System, Parts]:
    """system_two, parts_two = family("stable node", "matrix A", lambda1=-0.5, lambda2=-1.5)

    The model dy/dt = S Λ S⁻¹ y of the deviation y = s − s* from rest, and its parts(p) -> Λ,
    (S, S⁻¹), which `planes`, `describe` and `decomposition` take.
    kind     a type as `canonical` knows it; its numbers are lambda1, lambda2 (node, saddle),
             lambda0 (star, improper node), alpha, beta (spiral), beta (centre), and must be given
    by       "matrix A": u1, u2, k with v = k (u2, −u1) · "matrix B": u1, u2, d, k with
             v = (d u + k (u2, −u1))/(u, u) · "reflection": u1, u2 · "rotation": phi
    values   a number, or a Parameter with a range of its own. A rate goes from a tenth to four
             times its number, so that the type stays
    start    y(0), in `unit`; rates are in 1/`time`

    Raises ModelError for an unknown type, transformation or name, and for a rate left out.
    """
    block, rates, _ = BLOCKS[base_of(kind)]
    check_names([by], _WAYS, "there is no transformation by {}")
    entries, own = _WAYS[by]
    check_names(values, [*rates, *own], f"{kind}, {by} has no {{}}")
    if missing := [name for name in rates if name not in values]:
        raise ModelError(f"{kind}, {by} needs {listed(missing)}")
    parameters: dict[str, Parameter] = dict(own)
    for name, value in values.items():
        if isinstance(value, Parameter):
            parameters[name] = value
        elif name in own:
            parameters[name] = replace(own[name], value=value)
        else:
            ends = sorted((value / 10, 4 * value))
            parameters[name] = Parameter(value, f"1/{time}", rates[name], *ends)
    parameters = {name: parameters[name] for name in (*rates, *own)}

    def motion(t, s, p):
        a, b, c, d = entries(p)
        w, x, y, z = block(p)
        size = a * d - b * c
        z1, z2 = (d * s.y1 - b * s.y2) / size, (a * s.y2 - c * s.y1) / size  # z = S⁻¹ y
        w1, w2 = w * z1 + x * z2, y * z1 + z * z2  # Λ z
        return a * w1 + b * w2, c * w1 + d * w2

    def parts(p: tuple) -> tuple[np.ndarray, Similarity]:
        a, b, c, d = entries(p)
        inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        Lambda = np.array(block(p), float).reshape(2, 2)
        return Lambda, Similarity(np.array([[a, b], [c, d]]), inverse)

    system = System(
        f"{kind}, {by}",
        states={name: (unit, "deviation from rest") for name in ("y1", "y2")},
        parameters=parameters,
        modes=[Mode("motion", motion)],
        start=dict(zip(("y1", "y2"), start, strict=True)),
        time=time,
    )
    return system, parts


# ---- A = S Λ S⁻¹ in numbers


@dataclass(frozen=True)
class Decomposition:
    """What `decomposition` gives: .A, .Lambda, .S, .inverse, and .form, S with its u, v, d or φ.

    It shows itself as matrices in a notebook, and as one line in print.
    """

    Lambda: np.ndarray
    S: np.ndarray
    inverse: np.ndarray

    @property
    def A(self) -> np.ndarray:
        return self.S @ self.Lambda @ self.inverse

    @property
    def form(self) -> str:
        N = self.S - E
        u = N[:, np.abs(N).sum(axis=0).argmax()]  # all columns are multiples of it
        if np.abs(N).max() < 1e-12:
            return "S = E"
        if np.abs(self.S.T @ self.S - E).max() < 1e-9:
            if np.linalg.det(self.S) > 0:
                return f"S = G(φ), φ = {degrees(atan2(self.S[1, 0], self.S[0, 0])):.4g}°"
            return f"S = E − γ u uᵀ, u = {pair(u / np.abs(u).max() * np.sign(u[0] or 1))}"
        if borders(N)["det A = 0"] > 1e-9:
            return f"S = {rows(self.S)}"
        u = u / u[np.abs(u).argmax()]
        v, d = u @ N / (u @ u), float(np.trace(N))
        more = "" if abs(d) < 1e-9 else f", d = {d:.4g}"
        return f"S = E + u vᵀ, u = {pair(u)}, v = {pair(v)}{more}"

    def __str__(self) -> str:
        return f"A = {rows(self.A)}; {self.form}"

    __repr__ = __str__

    def _repr_markdown_(self) -> str:
        A, *factors = map(_bracket, (self.A, self.S, self.Lambda, self.inverse))
        words = r"A = S \, \Lambda \, S^{-1}: \qquad "
        return f"$${words} {A} = {' '.join(factors)}$$\n\n{self.form}"


@asked
def decomposition(Lambda: ArrayLike, similarity: Similarity) -> Decomposition:
    """decomposition(*parts(system.values())) -> A = S Λ S⁻¹ in numbers, with u, v, d or φ of S.

    A Decomposition shows itself as matrices in a notebook, and as one line in print. u is scaled
    so that its largest entry is 1. Raises ModelError for what is not 2 × 2.
    """
    S, inverse = (finite(M, (2, 2), "a matrix of the similarity") for M in similarity)
    return Decomposition(finite(Lambda, (2, 2), "Lambda"), S, inverse)


@asked
def describe(run: Run, parts: Parts) -> str:
    """describe(run, parts) -> "stable node at (0.4, 1.2); A = [[-0.5, 0], …]; S = E + u vᵀ, …".

    Type, point of rest, matrix and similarity of a linear run: the verdict of a panel.
    """
    A, b = affine(run.system, run.p, run.start)
    rest = f" at {pair(equilibrium(A, b))}" if np.any(b) else ""
    return f"{classify(A)}{rest}; {decomposition(*parts(run.p))}"


def _bracket(M: np.ndarray) -> str:
    a, b, c, d = (f"{value:.4g}" for value in clean(M).ravel())
    return rf"\begin{{bmatrix}} {a} & {b} \\ {c} & {d} \end{{bmatrix}}"
