"""The mathematics behind a phase portrait: flows, guards and modes over the plane of two states.

Nothing is drawn here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from types import BuiltinFunctionType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from contourpy import contour_generator

from ..linear import classify
from ..model import ModelError, System, Transition, listed
from ..rebind import rebound
from ..run import Run

__all__ = ["Plane", "contour", "find_equilibria", "separatrices"]

Limits = tuple[tuple[float, float], tuple[float, float]]
GRID = 49  # points along each side for nullclines, guard lines and the search for equilibria


class Plane:
    """Plane(system, "x", "v"): flows and guards at points of the (x, v) plane, arrays of any shape.

    mode   the mode whose flow counts; left out: at each point the one that system.mode chooses
           there when it is a function, else the start mode
    t      the instant, for flows that depend on it
    at     values of all further states of a larger system, and of held variables, which are
           parameters of the picture (default: system.start)
    Raises ModelError for unknown names and when no mode has both states.
    """

    def __init__(
        self,
        system: System,
        x: str | None = None,
        y: str | None = None,
        *,
        mode: str | None = None,
        t: float = 0.0,
        at: Mapping[str, float] | None = None,
        p: tuple | None = None,
    ):
        self.system, self.t = system, t
        self.x, self.y = (
            x or system.states[0],
            y or next((name for name in system.states if name != (x or system.states[0])), ""),
        )
        if not self.y:
            raise ModelError(
                f"a phase portrait needs two states; {system.name!r} has {listed(system.units)}"
            )
        for name in (self.x, self.y, *(at or {})):
            if name not in system.units:
                raise ModelError(
                    f"{name!r} is not a state of {system.name!r}; there are {listed(system.units)}"
                )
        able = [key for key in system.modes if {self.x, self.y} <= set(system.states_of(key))]
        if mode is not None and mode not in able:
            raise ModelError(
                f"mode {mode!r} has no plane ({self.x}, {self.y}); modes with both states: "
                f"{listed(able)}"
            )
        if not able:
            raise ModelError(
                f"no mode of {system.name!r} has both states {self.x!r} and {self.y!r}"
            )
        self.chosen = mode or (
            None
            if callable(system.mode) and len(able) > 1
            else system.mode
            if system.mode in able
            else able[0]
        )
        #: modes whose flow is shown somewhere
        self.modes = able if self.chosen is None else [self.chosen]
        self.values = {**system.start, **(at or {})}
        self._followed = [name for name in system.held if name not in (at or {})]
        self.p = system.values() if p is None else p
        self._templates: dict[str, tuple[list, int, int]] = {}
        self._kept: dict[tuple, Any] = {}  # rates on grids, equilibria
        self._wide: dict[Callable, Callable] = {}
        self._tried: Counter[Callable] = Counter()  # how often it gave the same as one by one

    def hold(self, values: Mapping[str, float]) -> None:
        """plane.hold(run.start): held variables at the values of another run, but those of `at`."""
        self.values |= {name: values[name] for name in self._followed}
        self._templates.clear()

    def follow(self, run: Run) -> None:
        """plane.follow(run): its parameters, held variables and, of a variant, its functions."""
        if run.system is not self.system:
            self.system = run.system
            self._kept.clear()
        self.p = run.p
        self.hold(run.start)

    @property
    def key(self) -> tuple:
        """What a picture of this plane depends on beside its limits: model, parameters, held."""
        held = tuple(self.values[name] for name in self.system.held)
        return id(self.system), tuple(self.p), held

    def is_plane(self, mode: str) -> bool:
        """True when the mode has no states beside the two: its equilibria lie in the plane."""
        return set(self.system.states_of(mode)) == {self.x, self.y}

    def _template(self, mode: str) -> tuple[list, int, int]:
        """The mode's states at their values beside the plane, and where x and y belong."""
        if mode not in self._templates:
            names = self.system.S[mode]._fields
            if missing := [
                name for name in names if name not in self.values and name not in (self.x, self.y)
            ]:
                raise ModelError(
                    f"the portrait needs a value of {listed(missing)}: give at={{{missing[0]!r}: "
                    f"…}}"
                )
            self._templates[mode] = (
                [self.values.get(name) for name in names],
                names.index(self.x),
                names.index(self.y),
            )
        return self._templates[mode]

    def _state(self, mode: str, x: float | np.ndarray, y: float | np.ndarray) -> tuple:
        template, i, k = self._template(mode)
        state = template.copy()
        state[i], state[k] = x, y
        return self.system.S[mode](*state)

    def _evaluate(
        self,
        function: Callable,
        mode: str,
        X: np.ndarray,
        Y: np.ndarray,
        width: int,
        t: float | None = None,
    ) -> np.ndarray:
        """function(t, s, p) at all points -> (width, points).

        All points at once where the function can (and then gives the
        same as one by one, which is tried at some of them), else one by one: model functions may
        branch or use math.sin."""
        x, y, t = np.ravel(X).astype(float), np.ravel(Y).astype(float), self.t if t is None else t
        state, p = self._state, self.p
        if function not in self._wide:
            self._wide[function] = over_arrays(function)

        def one(i: int) -> tuple:
            try:
                value = function(t, state(mode, float(x[i]), float(y[i])), p)
            except (ZeroDivisionError, OverflowError, ValueError) as error:
                if isinstance(error, ModelError):
                    raise
                return (np.nan,) * width
            return tuple(value) if width > 1 else (value,)

        if len(x) > (16 if self._tried[function] < 20 else 3):
            try:
                with np.errstate(all="ignore"):
                    value = self._wide[function](t, state(mode, x, y), p)
                    result = np.array(
                        [
                            np.broadcast_to(np.asarray(v, dtype=float), x.shape)
                            for v in (value if width > 1 else (value,))
                        ]
                    )
                probe = (
                    [k * (len(x) - 1) // 6 for k in range(7)]
                    if self._tried[function] < 20 or len(x) > 1000
                    else []
                )
                if not probe or _same(
                    result[:, probe].T, np.array([one(i) for i in probe], dtype=float)
                ):
                    self._tried[function] += 1
                    return result
            except (TypeError, ValueError, AttributeError):
                pass
        rows = np.array([one(i) for i in range(len(x))]).reshape(len(x), width).T
        return np.where(np.imag(rows) == 0, np.real(rows), np.nan).astype(
            float
        )  # (-1.0) ** 0.5 is complex in Python

    def flow(
        self, mode: str, X: np.ndarray, Y: np.ndarray, t: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """plane.flow("slip", X, Y) -> dx/dt, dy/dt, of the shape of X.

        NaN where the flow has no value.
        """
        names = self.system.states_of(mode)
        rates = self._evaluate(self.system.modes[mode].flow, mode, X, Y, len(names), t)
        return rates[names.index(self.x)].reshape(np.shape(X)), rates[names.index(self.y)].reshape(
            np.shape(X)
        )

    def flow_on_grid(self, mode: str, limits: Limits, count: int) -> tuple[np.ndarray, np.ndarray]:
        """As flow, on a grid of count × count points; kept for the layers that ask again."""
        key = (mode, limits, count, self.key, self.t)
        if key not in self._kept:
            if len(self._kept) > 12:
                self._kept.clear()
            self._kept[key] = self.flow(mode, *grid(limits, count))
        return self._kept[key]

    def guard(
        self,
        transition: Transition,
        mode: str,
        X: np.ndarray,
        Y: np.ndarray,
        t: float | None = None,
    ) -> np.ndarray:
        assert transition.guard is not None
        return self._evaluate(transition.guard, mode, X, Y, 1, t)[0].reshape(np.shape(X))

    def governing(self, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """plane.governing(X, Y) -> place in plane.modes of the mode that holds at each point.

        −1 where none of them does.
        A mode does not hold beyond a directed guard of its own: `simulate` refuses to start there.
        """
        x, y = np.ravel(X).astype(float), np.ravel(Y).astype(float)
        if self.chosen is None:
            kind = self.system.S[next(iter(self.system.modes))]
            place = {name: i for i, name in enumerate(self.modes)}
            rest = {name: self.values.get(name, np.nan) for name in kind._fields}
            states = (
                kind(**{**rest, self.x: a, self.y: b})
                for a, b in zip(x.tolist(), y.tolist(), strict=True)
            )
            found = np.array(
                [place.get(self.system.mode(self.t, s, self.p), -1) for s in states], dtype=int
            )  # type: ignore[operator, arg-type]
        else:
            found = np.zeros(len(x), dtype=int)
        size = 1 + np.maximum(np.abs(x), np.abs(y))
        for i, mode in enumerate(self.modes):
            for k in self.system.leaving[mode]:
                tr = self.system.transitions[k]
                if (
                    tr.guard is not None
                    and tr.direction
                    and not tr.urgent
                    and (tr.target != mode or tr.reset is not None)
                ):
                    beyond = tr.direction * self.guard(tr, mode, x, y) - tr.tolerance > 1e-9 * size
                    found[(found == i) & beyond] = -1
        return found.reshape(np.shape(X))

    def stands_still(self, mode: str, limits: Limits) -> bool:
        """plane.stands_still("rest", limits) -> whether no point of the picture moves in a mode."""
        return not any(np.any(rate != 0) for rate in self.flow_on_grid(mode, limits, 5))

    def depends_on_time(self, limits: Limits, horizon: float = 10.0) -> bool:
        """True when a flow shown takes other values at other instants.

        Then nullclines and equilibria mean nothing.
        """
        X, Y = (np.linspace(low, high, 9)[1:-1:2] for low, high in limits)
        for mode in self.modes:
            first = np.array(self.flow(mode, X, Y))
            for share in (0.137, 0.411, 0.773):
                if not np.allclose(
                    first,
                    self.flow(mode, X, Y, self.t + share * (horizon or 10.0)),
                    rtol=1e-9,
                    atol=0,
                    equal_nan=True,
                ):
                    return True
        return False

    def guard_depends_on_time(self, transition: Transition, mode: str, limits: Limits) -> bool:
        X, Y = (np.linspace(low, high, 9)[1:-1:2] for low, high in limits)
        return not np.allclose(
            self.guard(transition, mode, X, Y),
            self.guard(transition, mode, X, Y, self.t + 1.2345),
            rtol=1e-9,
            atol=0,
            equal_nan=True,
        )


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """np.allclose(a, b, rtol=1e-12, atol=0, equal_nan=True), which is slow for a few numbers."""
    with np.errstate(invalid="ignore"):
        return bool(((a == b) | (np.abs(a - b) <= 1e-12 * np.abs(b)) | ((a != a) & (b != b))).all())


_NUMPY = {
    name: getattr(np, name) for name in dir(math) if not name.startswith("_") and hasattr(np, name)
}


def over_arrays(function: Callable) -> Callable:
    """over_arrays(f) -> f with NumPy's functions in the place of those of `math`.

    In its helpers too: a hundred times as fast over a grid.
    Whether it gives the same as f itself is for the caller to try: a branch, for one, does not work
    on arrays.
    """
    copies: dict = {}

    def swap(value: object, name: str) -> object:
        if value is math:
            return SimpleNamespace(**{**vars(math), **_NUMPY})
        if isinstance(value, BuiltinFunctionType) and value.__module__ == "math":
            return _NUMPY.get(value.__name__, value)
        return rebound(value, swap, copies) if isinstance(value, FunctionType) else value

    return swap(function, "")


def grid(limits: Limits, count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(*(np.linspace(low, high, count) for low, high in limits))


def contour(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray],
    limits: Limits,
    count: int = GRID,
    values: np.ndarray | None = None,
    keep: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> list[np.ndarray]:
    """contour(f, limits) -> the curves f(x, y) = 0 as polylines, each an array (k, 2).

    keep(x, y) drops points outside a region.
    `values` are f on the count × count grid where they are known already.

    A function that *jumps* through zero (a relay) is no zero: there the function itself, evaluated
    on the curve, is not smaller than at the nodes around, and such points are dropped. An
    identically vanishing function has no curves.
    """
    X, Y = grid(limits, count)
    Z = function(X, Y) if values is None else values
    good = np.isfinite(Z)
    if not good.any() or not np.any(Z[good]):
        return []
    lines = [
        np.asarray(line)
        for line in contour_generator(X, Y, np.ma.masked_where(~good, Z)).lines(0.0)
    ]
    if not lines:
        return []
    points = np.concatenate(lines)
    column, row = (
        np.clip(((points[:, k] - low) / (high - low) * (count - 1)).astype(int), 0, count - 2)
        for k, (low, high) in enumerate(limits)
    )
    around = np.max([np.abs(Z[row + i, column + k]) for i in (0, 1) for k in (0, 1)], axis=0)
    fine = ~(np.abs(function(points[:, 0], points[:, 1])) > 0.3 * around)
    if keep is not None:
        fine &= keep(points[:, 0], points[:, 1])
    kept = []
    for line, use in zip(
        lines, np.split(fine, np.cumsum([len(line) for line in lines])[:-1]), strict=True
    ):
        cuts = np.flatnonzero(np.diff(use.astype(int))) + 1
        kept += [
            part
            for part, whole in zip(np.split(line, cuts), np.split(use, cuts), strict=True)
            if whole[0] and len(part) > 1
        ]
    return kept


def find_equilibria(
    plane: Plane, limits: Limits, tolerance: float = 1e-7
) -> list[tuple[float, float, str, str]]:
    """find_equilibria(plane, limits) -> [(x, y, mode, type in words), …] of plane modes, sorted.

    Newton's method from a 3 × 3 grid and from every cell where both rates change sign, all at once;
    a root counts when both rates are below 1e-9 of their largest in the picture, it lies inside and
    its mode holds there; roots closer than 1e-4 of the picture are one, and the points of a whole
    line of them are none. The Jacobian comes from five-point differences (error about 1e-12 of the
    rates), `tolerance` goes to `classify`.
    """
    kept = ("equilibria", limits, plane.key, plane.t, tolerance)
    if kept in plane._kept:
        return plane._kept[kept]
    (x0, x1), (y0, y1) = limits
    size = np.array([x1 - x0, y1 - y0])
    found: list[tuple[float, float, str, str]] = []
    for index, mode in enumerate(plane.modes):
        if not plane.is_plane(mode):
            continue
        F, G = plane.flow_on_grid(mode, limits, GRID)
        scale = np.array([np.nanmax(np.abs(F), initial=0), np.nanmax(np.abs(G), initial=0)])
        if not np.all(scale > 0) or not np.all(np.isfinite(scale)):
            continue  # a rate that vanishes everywhere leaves no isolated equilibrium

        def rates(u: np.ndarray, mode: str = mode, scale: np.ndarray = scale) -> np.ndarray:
            """Both rates, relative to their largest, at places u (…, 2) in units of the picture."""
            return (
                np.stack(
                    plane.flow(mode, x0 + u[..., 0] * size[0], y0 + u[..., 1] * size[1]), axis=-1
                )
                / scale
            )

        both = _changes_sign(F) & _changes_sign(G)
        seeds = [((k + 0.5) / (GRID - 1), (i + 0.5) / (GRID - 1)) for i, k in np.argwhere(both)][
            :40
        ] + [(a, b) for a in (0.2, 0.5, 0.8) for b in (0.2, 0.5, 0.8)]
        roots = _newton(rates, np.array(seeds))
        offs = np.abs(rates(roots)).max(axis=1)
        mine: list[np.ndarray] = []
        for u in roots[np.argsort(offs)][: (offs < 1e-9).sum()]:  # of equals, the best one
            if not np.all((u >= -1e-9) & (u <= 1 + 1e-9)) or any(
                np.abs(u - other).max() < 1e-4 for other in mine
            ):
                continue
            x, y = x0 + u[0] * size[0], y0 + u[1] * size[1]
            if plane.governing(np.array([x]), np.array([y]))[0] != index:
                continue
            mine.append(u)
            J = _jacobian(rates, u[None], 1e-3)[1][0]
            along = J[np.abs(J).max(axis=1).argmax(), ::-1] * (1, -1)  # along a nullcline
            if (
                along.any()
                and np.abs(rates(u + [[0.01], [-0.01]] * along / np.abs(along).max())).max() < 1e-9
            ):
                continue  # one of a whole line of equilibria, which the nullclines show
            A = J * scale[:, None] / size[None, :]
            kind = classify(A, tolerance) if np.all(np.isfinite(A)) else "equilibrium"
            near = 1e-9 * size  # 3e-17 reads as 0
            found.append(
                (
                    0.0 if abs(x) < near[0] else float(x),
                    0.0 if abs(y) < near[1] else float(y),
                    mode,
                    kind,
                )
            )
    plane._kept[kept] = sorted(found)
    return plane._kept[kept]


def separatrices(
    plane: Plane, limits: Limits, step: float = 0.02, reach: float = 3.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """separatrices(plane, limits) -> curves into the saddles, curves out of them; each (n, 2).

    From each saddle of find_equilibria, an eigenvector of the Jacobian to both sides, forwards in
    time along the growing one and backwards along the dying one; four curves a saddle. They go
    through the modes as the picture shows them and end where no mode holds, at a rest, or after
    `reach` widths of the picture. Runge and Kutta's method of order 4 by the length of the curve
    in units of the picture, so that a saddle's slowness costs no steps.
    """
    (x0, x1), (y0, y1) = limits
    size, corner = np.array([x1 - x0, y1 - y0]), np.array([x0, y0])
    begin, signs = [], []
    for x, y, mode, kind in find_equilibria(plane, limits):
        if not kind.startswith("saddle"):
            continue
        u = (np.array([x, y]) - corner) / size

        def rates(u: np.ndarray, mode: str = mode) -> np.ndarray:
            there = corner[0] + u[..., 0] * size[0], corner[1] + u[..., 1] * size[1]
            return np.stack(plane.flow(mode, *there), axis=-1) / size

        values, vectors = np.linalg.eig(_jacobian(rates, u[None], 1e-3)[1][0])
        if np.any(np.imag(values)):  # complex numbers without imaginary part from NumPy 2.5 on
            continue
        for value, way in zip(np.real(values), np.real(vectors).T, strict=True):
            begin += [u + 1e-3 * way, u - 1e-3 * way]
            signs += [np.sign(value)] * 2
    if not begin:
        return [], []
    u, sign = np.array(begin), np.array(signs)[:, None]
    saddles = u[::2] / 2 + u[1::2] / 2
    path, live = [u], np.ones(len(u), dtype=bool)

    def ways(v: np.ndarray, index: np.ndarray, sign: np.ndarray) -> np.ndarray:
        rates = np.full_like(v, np.nan)
        x, y = (corner + v * size).T
        for i, mode in enumerate(plane.modes):
            if (here := index == i).any():
                rates[here] = np.column_stack(plane.flow(mode, x[here], y[here])) / size
        with np.errstate(all="ignore"):
            return sign * rates / np.hypot(*rates.T)[:, None]

    for _ in range(int(reach / step)):
        u, h = path[-1].copy(), np.zeros((live.sum(), 1)) + step
        v, s = u[live], sign[live]
        index = plane.governing(*(corner + v * size).T)
        a = ways(v, index, s)
        b = ways(v + h / 2 * a, index, s)
        c = ways(v + h / 2 * b, index, s)
        d = ways(v + h * c, index, s)
        new = v + h / 6 * (a + 2 * b + 2 * c + d)
        # No mode, no value; a rest, where the way turns round; far outside
        ends = ~np.isfinite(new).all(axis=1) | ((a * d).sum(axis=1) < 0) | (index < 0)
        new[ends] = np.nan
        u[~live], u[live] = np.nan, new
        path.append(u)
        live[live] = ~ends & (np.abs(new - 0.5) < 0.75).all(axis=1)
        if not live.any():
            break
    curves = corner + np.stack(path, axis=1) * size
    begun = corner + np.repeat(saddles, 2, axis=0) * size
    curves = np.concatenate([begun[:, None], curves], axis=1)
    kept = [curve[np.isfinite(curve).all(axis=1)] for curve in curves]
    into = [curve for curve, way in zip(kept, sign[:, 0], strict=True) if way < 0]
    return into, [curve for curve, way in zip(kept, sign[:, 0], strict=True) if way > 0]


def _jacobian(
    f: Callable[[np.ndarray], np.ndarray], u: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """f: (…, 2) -> (…, 2) at u (n, 2), and its Jacobian (n, 2, 2) by five-point differences.

    All in one call of f.
    """
    values = f(
        u[:, None, None] + h * np.arange(-2, 3)[:, None] * np.eye(2)[:, None]
    )  # (n, axis, 5, 2)
    return values[:, 0, 2], np.einsum("k,nakf->nfa", np.array([1, -8, 0, 8, -1]) / (12 * h), values)


def _newton(f: Callable[[np.ndarray], np.ndarray], u: np.ndarray, steps: int = 40) -> np.ndarray:
    """Newton's method from all of u (n, 2) at once; NaN for one that does not converge.

    At most a quarter of the picture at a time.
    Steps are those of least squares, so that a singular Jacobian (a double root, a line of roots)
    does no harm; where each is half of the one before, a double root is near, and twice the step
    lands on it.
    """
    before = np.full((len(u), 1), np.nan)
    for _ in range(steps):
        with np.errstate(all="ignore"):
            r, J = _jacobian(f, u, 1e-4)
            lost = (
                ~(np.abs(J) < 1e100).all(axis=(1, 2))
                | ~np.isfinite(r).all(axis=1)
                | (np.abs(u - 0.5) > 1.5).any(axis=1)
            )  # out of sight, or without a value
        J[lost], r[lost] = np.eye(2), 0.0
        rows = np.abs(J).max(axis=2)
        rows[rows == 0] = 1.0  # both rates count alike, however much they differ in size
        way = -np.einsum("nij,nj->ni", np.linalg.pinv(J / rows[:, :, None], rcond=1e-12), r / rows)
        length = np.abs(way).max(axis=1, keepdims=True)
        double = np.abs(length / np.where(before > 0, before, np.nan) - 0.5) < 0.02
        u, before = (
            u + way * np.where(double, 2.0, 1.0 / np.maximum(1.0, 4 * length)),
            np.where(double, np.nan, length),
        )
        if length.max() < 1e-8:  # the error left is about the square of it
            break
    return np.where(length < 1e-6, u, np.nan)


def _changes_sign(Z: np.ndarray) -> np.ndarray:
    corners = np.stack([Z[:-1, :-1], Z[1:, :-1], Z[:-1, 1:], Z[1:, 1:]])
    return (corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0)
