"""SciPy's LSODA, Radau and BDF as steppers of the core.

Their interpolants are polynomials, so they fit its form of a step.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from . import core

if TYPE_CHECKING:
    from .plain import Plain
    from .settings import Settings


#: Zero at both ends, slope 1 at the start, slope 0 where Radau collocates: makes its interpolant
#: leave with the flow.
RADAU = np.array([0.0, 1.0, -4.5, 6.0, -2.5])


class SciPyStep:
    """SciPyStep(settings, model, width)(w, p, t, h) -> length of the step taken, 0 if SciPy's
    method gave up.

    The method starts anew after each event (its memory of the past would be wrong) and goes on
    otherwise. Its interpolant is sampled at degree + 1 Chebyshev points and solved for the
    coefficients: exact but for rounding.
    """

    def __init__(self, settings: Settings, model: Plain, width: int):
        import scipy.integrate

        self.kind = getattr(scipy.integrate, settings.method)
        self.settings, self.model, self.width = settings, model, width
        degree = settings.degree
        self.nodes = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
        self.powers = np.linalg.inv(np.vander(self.nodes, increasing=True))
        self.solver = None
        self.seen, self.sizes = None, []

    def __call__(self, w: core.Workspace, p: tuple, t: float, h: float) -> float:
        mode = w.i[core.MODE]
        n = w.size[mode]
        bound = min(core.next_due(w), w.f[core.T_END])
        longest = w.f[core.MAX_STEP]
        if bound - t <= 64 * core.EPS * abs(t):
            return self._moment(w, p, n, bound - t)
        anew = w.i[core.FRESH] == 1 or self.solver is None
        # the tolerance of a solver is that of its start: anew where states have outgrown it
        outgrown = w.i[core.OWN_SIZE] == 1 and any(
            size > 100 * then for size, then in zip(w.size_of, self.sizes, strict=False)
        )
        over = anew or self.solver.t_bound != bound or self.solver.status != "running"
        if over or outgrown:
            self.solver, self.seen = self._start(w, p, mode, n, t, bound, longest), None
            w.i[core.FRESH] = 0
        while not self._step(w):  # it has gone where the flow is no number, or given up: shorter
            longest = min(longest, self.solver.max_length, bound - t) / 4
            if longest < 1e3 * core.EPS * abs(t) or longest < 1e-290:
                return 0.0
            self.solver = self._start(w, p, mode, n, t, bound, longest)
        length, before = float(self.solver.t) - t, self.solver.nfev
        mine = self._polynomial(self.solver.dense_output(), np.array(w.y[:n]), t, length)
        for row, values in zip(w.poly, mine, strict=True):
            row[:n] = values.tolist()
        if length < 1e-3 * w.f[core.RECENT]:  # for `jumps_within`
            stages = [self._rates_at(mine, length, theta) for theta in (0.3, 0.8, 1.0)]
            for row, rates in zip(w.k, [self._slope(t, mine[0]), *stages], strict=False):
                row[:n] = rates.tolist()
            for stage in range(4, w.i[core.STAGES] + 1):
                w.k[stage][:n] = w.k[3][:n]
        w.i[core.FLOWS] += self.solver.nfev - before
        w.y_new[:n] = self.solver.y.tolist()
        return length

    def _moment(self, w: core.Workspace, p: tuple, n: int, length: float) -> float:
        """A straight step over what the clock can hardly tell: LSODA refuses to start there."""
        core.know_flow(self.model, w, p)
        self.solver = None
        for row, values in zip(w.poly, (w.y, [length * rate for rate in w.k[0]]), strict=False):
            row[:n] = values[:n]
        for row in w.poly[2:]:
            row[:n] = [0.0] * n
        w.y_new[:n] = [y + move for y, move in zip(w.y[:n], w.poly[1][:n], strict=True)]
        return length

    def _rates_at(self, polynomial: np.ndarray, length: float, theta: float) -> np.ndarray:
        """The flow at a place within the step."""
        y = theta ** np.arange(len(polynomial)) @ polynomial
        return np.asarray(self.solver.fun(self.solver.t - (1 - theta) * length, y), dtype=float)

    def _step(self, w: core.Workspace) -> bool:
        """One step of SciPy's; False if it cannot be used."""
        before = self.solver.nfev
        try:
            self.solver.step()
        except (ValueError, np.linalg.LinAlgError):  # NaN in the Jacobian
            return False
        w.i[core.FLOWS] += self.solver.nfev - before
        return self.solver.status != "failed" and bool(np.all(np.isfinite(self.solver.y)))

    def _polynomial(self, dense, start: np.ndarray, t: float, length: float) -> np.ndarray:
        """(degree + 1, n) coefficients of θ: SciPy's interpolant, made to pass through both ends of
        the step with both slopes.

        SciPy's own misses them by the tolerance, and then invents events near a surface: what is
        missing is added as a cubic.
        """
        samples = dense(t + self.nodes * length).T
        found = self.powers @ (samples - start)
        end, slope = self.solver.y - start, length * self._slope(t, start)
        if (
            self.settings.method == "Radau"
        ):  # passes through both ends, with the right slope where it collocates
            found += np.outer(RADAU, slope - found[1])
        else:
            last = length * self._slope(t + length, self.solver.y)
            order = np.arange(len(found))
            gap, rise, fall = end - found[1:].sum(axis=0), slope - found[1], last - order @ found
            found[1] += rise
            found[2] += 3 * gap - 2 * rise - fall
            found[3] += -2 * gap + rise + fall
        found[0] = start
        found[1] += end - found[1:].sum(axis=0)  # the sum at θ = 1 to the last digit
        return found

    def _slope(self, t: float, y: np.ndarray) -> np.ndarray:
        """The flow at the ends of the step; that at the start was the last one's at the end."""
        if self.seen is None or self.seen[0] != t or not np.array_equal(self.seen[1], y):
            self.seen = t, y, np.asarray(self.solver.fun(t, y), dtype=float)
        return self.seen[2]

    def _start(
        self, w: core.Workspace, p: tuple, mode: int, n: int, t: float, bound: float, longest: float
    ):
        out, padding, held = [0.0] * self.width, [0.0] * (self.width - n), w.y[self.width :]

        def rates(time: float, y: np.ndarray) -> list[float]:
            core.rates(self.model, w, mode, n, float(time), y.tolist() + padding + held, p, out)
            return out[:n]

        options = {} if longest == inf else {"max_step": longest}
        clock = 256 * core.EPS * abs(t)
        if self.settings.method != "Radau" and clock > 1e-6 * w.f[core.H]:
            # their own guess may be finer than the clock
            options["first_step"] = min(max(1e-4 * w.f[core.H], clock), bound - t)
        solver = self.kind(
            rates,
            t,
            np.array(w.y[:n]),
            bound,
            rtol=self.settings.rtol,
            atol=self._absolute(w, p, mode, n, t),
            **options,
        )
        solver.max_length = longest
        return solver

    def _absolute(self, w: core.Workspace, p: tuple, mode: int, n: int, t: float) -> list[float]:
        """The part of the tolerance that does not grow with a state, as in `allowed`; a state that
        starts from zero has the
        size that its slope gives it in a first step."""
        core.know_flow(self.model, w, p)
        h = max(w.f[core.H], 1e-3 * (w.f[core.T_END] - t))
        core.feel(self.model, w, p, mode, n, t)
        self.sizes = list(w.size_of)
        # Their steps are rounded to the clock, which moves a state by ε·|t|·|rate|: not finer
        tick, terms = 8.0 * core.EPS * abs(t), w.terms[mode]
        found = []
        for i in range(n):
            size, rate = w.size_of[w.kind[mode][i]], w.k[0][i]
            if not size and not rate:  # at rest at zero it has no size: any tolerance does
                found.append(0.01 * w.f[core.RTOL])
                continue
            most = core.allowed(w, mode, i, 0.0, h)
            if size:  # a rough guess of how far it moves may double its size, not more
                known = 2.0 * core.allowed(w, mode, i, 0.0, 0.0)
                most = min(most, max(known, core.allowed(w, mode, i, 0.0, w.f[core.H])))
            found.append(max(most, tick * max(terms[i], abs(rate))))
        return found
