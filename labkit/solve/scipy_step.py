"""SciPy's LSODA, Radau and BDF as steppers of the core: their interpolants are polynomials, so they fit its form of a step."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from . import core

if TYPE_CHECKING:
    from . import Settings
    from .plain import Plain


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
        samples = self.solver.dense_output()(t + self.nodes * length).T
        samples[0], samples[-1] = w.y[:n], self.solver.y
        for row, values in zip(w.poly, self.powers @ samples, strict=True):
            row[:n] = values.tolist()
        w.y_new[:n] = self.solver.y.tolist()
        return length

    def _start(self, w: core.Workspace, p: tuple, mode: int, n: int, t: float, bound: float):
        out, padding = [0.0] * self.width, [0.0] * (self.width - n)

        def rates(time: float, y: np.ndarray) -> list[float]:
            core.rates(self.model, w, mode, n, time, y.tolist() + padding, p, out)
            return out[:n]

        options = {} if w.f[core.MAX_STEP] == inf else {"max_step": w.f[core.MAX_STEP]}
        return self.kind(
            rates,
            t,
            np.array(w.y[:n]),
            bound,
            rtol=self.settings.rtol,
            atol=self.settings.atol,
            **options,
        )
