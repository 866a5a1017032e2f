"""SciPy's LSODA, Radau and BDF as steppers of the core: their interpolants are polynomials, so they fit its form of a step."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from . import core

if TYPE_CHECKING:
    from .plain import Plain
    from .settings import Settings


class SciPyStep:
    """SciPyStep(settings, model, width)(w, p, t, h) -> length of the step taken, 0 if SciPy's method gave up.

    The method starts anew after each event (its memory of the past would be wrong) and goes on otherwise.
    Its interpolant is sampled at degree + 1 Chebyshev points and solved for the coefficients: exact but for rounding.
    """

    def __init__(self, settings: Settings, model: Plain, width: int):
        import scipy.integrate

        self.kind = getattr(scipy.integrate, settings.method)
        self.settings, self.model, self.width = settings, model, width
        degree = settings.degree
        self.nodes = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
        self.powers = np.linalg.inv(np.vander(self.nodes, increasing=True))
        self.solver = None
        self.last = None

    def __call__(self, w: core.Workspace, p: tuple, t: float, h: float) -> float:
        mode = w.i[core.MODE]
        n = w.size[mode]
        bound = min(core.next_due(w), w.f[core.T_END])
        if (
            w.i[core.FRESH] == 1
            or self.solver is None
            or self.solver.t_bound != bound
            or self.solver.status != "running"
        ):
            self.solver = self._start(w, p, mode, n, t, bound)
            w.i[core.FRESH] = 0
        before = self.solver.nfev
        try:
            self.solver.step()
        except (ValueError, np.linalg.LinAlgError):  # NaN in the Jacobian
            return 0.0
        w.i[core.FLOWS] += self.solver.nfev - before
        if self.solver.status == "failed" or not np.all(np.isfinite(self.solver.y)):
            return 0.0
        length = self.solver.t - t
        mine = self._polynomial(self.solver.dense_output(), np.array(w.y[:n]), t, length)
        for row, values in zip(w.poly, mine, strict=True):
            row[:n] = values.tolist()
        w.y_new[:n] = self.solver.y.tolist()
        return length

    def _polynomial(self, dense, start: np.ndarray, t: float, length: float) -> np.ndarray:
        """(degree + 1, n) coefficients of θ: SciPy's interpolant, made to pass through both ends of the step with both slopes.

        SciPy's own misses them by the tolerance, and then invents events near a surface: what is missing
        is added as a cubic.
        """
        samples = dense(t + self.nodes * length).T
        found = np.zeros((len(samples) + 2, len(start)))
        found[: len(samples)] = self.powers @ (samples - start)
        found = found[: max(len(samples), 4)]
        order = np.arange(len(found))
        end = self.solver.y - start
        fun = self.solver.fun
        slopes = [length * np.asarray(fun(time, y)) for time, y in ((t, start), (t + length, self.solver.y))]
        gap0, gap1 = -found[0], end - found.sum(axis=0)
        rise0, rise1 = slopes[0] - found[1], slopes[1] - order @ found
        found[0] += gap0
        found[1] += rise0
        found[2] += 3 * (gap1 - gap0) - 2 * rise0 - rise1
        found[3] += -2 * (gap1 - gap0) + rise0 + rise1
        found[0] = start
        found[1] += end - found[1:].sum(axis=0)  # the sum at θ = 1 to the last digit
        return found

    def _start(self, w: core.Workspace, p: tuple, mode: int, n: int, t: float, bound: float):
        out, padding, held = [0.0] * self.width, [0.0] * (self.width - n), w.y[self.width :]

        def rates(time: float, y: np.ndarray) -> list[float]:
            core.rates(self.model, w, mode, n, time, y.tolist() + padding + held, p, out)
            return out[:n]

        options = {} if w.f[core.MAX_STEP] == inf else {"max_step": w.f[core.MAX_STEP]}
        return self.kind(
            rates,
            t,
            np.array(w.y[:n]),
            bound,
            rtol=self.settings.rtol,
            atol=self._absolute(w, p, mode, n, t),
            **options,
        )

    def _absolute(self, w: core.Workspace, p: tuple, mode: int, n: int, t: float) -> list[float]:
        """The part of the tolerance that does not grow with a state, as in `allowed`; a state that starts from zero has the
        size that its slope gives it in a first step."""
        core.know_flow(self.model, w, p)
        return [core.allowed(w, mode, i, 0.0, w.f[core.H]) for i in range(n)]
