"""The mathematics behind a phase portrait: flows, guards and modes over the plane of two states.

Nothing is drawn here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from itertools import product
from types import BuiltinFunctionType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from contourpy import contour_generator

from ..linear import classify
from ..model import ModelError, System, Transition, check_names, listed
from ..rebind import rebound
from ..run import Run

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
        self.x = x or system.states[0]
        self.y = y or next((name for name in system.states if name != self.x), "")
        if self.y in ("", self.x):
            both = f", and both are {self.x!r}" if self.y else ""
            raise ModelError(
                f"a phase portrait needs two states{both}; {system.name!r} has "
                f"{listed(system.units)}"
            )
        for name in (self.x, self.y, *(at or {})):
            check_names([name], system.units, f"{{}} is not a state of {system.name!r}")
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
        self.chosen = mode
        if mode is None and not (callable(system.mode) and len(able) > 1):
            self.chosen = system.mode if system.mode in able else able[0]
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
            if missing := sorted({*names} - {*self.values, self.x, self.y}, key=names.index):
                give = f"give at={{{missing[0]!r}: …}}"
                raise ModelError(f"the portrait needs a value of {listed(missing)}: {give}")
            values = [self.values.get(name) for name in names]
            self._templates[mode] = values, names.index(self.x), names.index(self.y)
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

        All points at once where the function can (and then gives the same as one by one, which is
        tried at some of them), else one by one: model functions may branch or use math.sin.
        """
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

        new = self._tried[function] < 20
        if len(x) > (16 if new else 3):
            try:
                with np.errstate(all="ignore"):
                    value = self._wide[function](t, state(mode, x, y), p)
                    values = value if width > 1 else (value,)
                    floats = (np.asarray(v, dtype=float) for v in values)
                    result = np.array([np.broadcast_to(v, x.shape) for v in floats])
                probe = [k * (len(x) - 1) // 6 for k in range(7)] if new or len(x) > 1000 else []
                if not probe or _same(result[:, probe].T, np.array([*map(one, probe)], float)):
                    self._tried[function] += 1
                    return result
            except (TypeError, ValueError, AttributeError):
                pass
        rows = np.array([*map(one, range(len(x)))]).reshape(len(x), width).T
        # (-1.0) ** 0.5 is complex in Python
        return np.where(np.imag(rows) == 0, np.real(rows), np.nan).astype(float)

    def flow(
        self, mode: str, X: np.ndarray, Y: np.ndarray, t: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """plane.flow("slip", X, Y) -> dx/dt, dy/dt, of the shape of X.

        NaN where the flow has no value.
        """
        names = self.system.states_of(mode)
        rates = self._evaluate(self.system.modes[mode].flow, mode, X, Y, len(names), t)
        x, y = (rates[names.index(name)].reshape(np.shape(X)) for name in (self.x, self.y))
        return x, y

    def flow_on_grid(self, mode: str, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
        """As flow, on a grid of GRID × GRID points; kept for the layers that ask again."""
        return self.kept((mode, limits), lambda: self.flow(mode, *grid(limits)))

    def kept(self, what: tuple, made: Callable[[], Any]) -> Any:
        """plane.kept(what, made) -> what made() gave for this model and these values, or gives."""
        key = (what, self.key, self.t)
        if key not in self._kept:
            found = made()
            if len(self._kept) > 12:
                self._kept.clear()
            self._kept[key] = found
        return self._kept[key]

    def guards(self, mode: str) -> list[int]:
        """plane.guards("slip") -> places of the transitions out of a mode that have a guard."""
        system = self.system
        return [i for i in system.leaving[mode] if system.transitions[i].guard is not None]

    def guard(
        self, tr: Transition, mode: str, X: np.ndarray, Y: np.ndarray, t: float | None = None
    ) -> np.ndarray:
        return self._evaluate(tr.guard, mode, X, Y, 1, t)[0].reshape(np.shape(X))  # type: ignore

    def governing(self, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """plane.governing(X, Y) -> place in plane.modes of the mode that holds at each point.

        −1 where none of them does.
        A mode does not hold beyond a directed guard of its own: `simulate` refuses to start there.
        """
        x, y = np.ravel(X).astype(float), np.ravel(Y).astype(float)
        if self.chosen is None:
            kind = self.system.S[next(iter(self.system.modes))]
            rest = {name: self.values.get(name, np.nan) for name in kind._fields}
            pairs = zip(x.tolist(), y.tolist(), strict=True)
            states = (kind(**{**rest, self.x: a, self.y: b}) for a, b in pairs)
            place = {name: i for i, name in enumerate(self.modes)}
            chosen = (self.system.mode(self.t, s, self.p) for s in states)  # type: ignore[operator]
            found = np.array([place.get(mode, -1) for mode in chosen], dtype=int)
        else:
            found = np.zeros(len(x), dtype=int)
        size = 1 + np.maximum(np.abs(x), np.abs(y))
        for i, mode in enumerate(self.modes):
            for tr in (self.system.transitions[k] for k in self.guards(mode)):
                leads = tr.target != mode or tr.reset is not None
                if tr.direction and not tr.urgent and leads:
                    beyond = tr.direction * self.guard(tr, mode, x, y) - tr.tolerance > 1e-9 * size
                    found[(found == i) & beyond] = -1
        return found.reshape(np.shape(X))

    def stands_still(self, mode: str, limits: Limits) -> bool:
        """plane.stands_still("rest", limits) -> whether no point of the picture moves in a mode."""
        return not any(np.any(rate != 0) for rate in self.flow(mode, *grid(limits, 5)))

    def depends_on_time(self, limits: Limits, horizon: float = 10.0) -> bool:
        """True when a flow shown takes other values at other instants.

        Then nullclines and equilibria mean nothing.
        """
        X, Y = _some(limits)
        for mode in self.modes:
            now = np.array(self.flow(mode, X, Y))
            for share in (0.137, 0.411, 0.773):
                later = self.flow(mode, X, Y, self.t + share * (horizon or 10.0))
                if not _same(now, np.array(later), 1e-9):
                    return True
        return False

    def guard_depends_on_time(self, tr: Transition, mode: str, limits: Limits) -> bool:
        X, Y = _some(limits)
        now, later = (self.guard(tr, mode, X, Y, t) for t in (self.t, self.t + 1.2345))
        return not _same(now, later, 1e-9)


def _some(limits: Limits) -> list[np.ndarray]:
    """A few points of the picture, on its diagonal."""
    return [np.linspace(low, high, 9)[1:-1:2] for low, high in limits]


def _same(a: np.ndarray, b: np.ndarray, part: float = 1e-12) -> bool:
    """np.allclose(a, b, rtol=part, atol=0, equal_nan=True), which is slow for a few numbers."""
    with np.errstate(invalid="ignore"):
        return bool(((a == b) | (np.abs(a - b) <= part * np.abs(b)) | ((a != a) & (b != b))).all())


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


def grid(limits: Limits, count: int = GRID) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(*(np.linspace(low, high, count) for low, high in limits))


def contour(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray],
    limits: Limits,
    values: np.ndarray | None = None,
    keep: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> list[np.ndarray]:
    """contour(f, limits) -> the curves f(x, y) = 0 as polylines, each an array (k, 2).

    keep(x, y) drops points outside a region.
    `values` are f on the GRID × GRID points where they are known already.

    A function that *jumps* through zero (a relay) is no zero: there the function itself, evaluated
    on the curve, is not smaller than at the nodes around, and such points are dropped. An
    identically vanishing function has no curves.
    """
    X, Y = grid(limits)
    Z = function(X, Y) if values is None else values
    good = np.isfinite(Z)
    if not good.any() or not np.any(Z[good]):
        return []
    lines = contour_generator(X, Y, np.ma.masked_where(~good, Z)).lines(0.0)
    if not lines:
        return []
    points = np.concatenate(lines)
    column, row = (
        np.clip(((points[:, k] - low) / (high - low) * (GRID - 1)).astype(int), 0, GRID - 2)
        for k, (low, high) in enumerate(limits)
    )
    around = np.max([np.abs(Z[row + i, column + k]) for i in (0, 1) for k in (0, 1)], axis=0)
    fine = ~(np.abs(function(points[:, 0], points[:, 1])) > 0.3 * around)
    if keep is not None:
        fine &= keep(points[:, 0], points[:, 1])
    # cut where lines end and where they begin or cease to be fine
    ends = np.cumsum([len(line) for line in lines])[:-1]
    cuts = np.union1d(ends, np.flatnonzero(np.diff(fine)) + 1)
    parts = zip(np.split(points, cuts), np.split(fine, cuts), strict=True)
    return [part for part, use in parts if use[0] and len(part) > 1]


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
    return plane.kept(
        ("equilibria", limits, tolerance), lambda: _equilibria(plane, limits, tolerance)
    )


def _equilibria(
    plane: Plane, limits: Limits, tolerance: float
) -> list[tuple[float, float, str, str]]:
    corner, size = np.array(limits).T[0], np.ptp(limits, axis=1)
    found: list[tuple[float, float, str, str]] = []
    for index, mode in enumerate(plane.modes):
        if not plane.is_plane(mode):
            continue
        F, G = plane.flow_on_grid(mode, limits)
        scale = np.array([np.nanmax(np.abs(rate), initial=0) for rate in (F, G)])
        if not np.all(scale > 0) or not np.all(np.isfinite(scale)):
            continue  # a rate that vanishes everywhere leaves no isolated equilibrium

        def rates(u: np.ndarray, mode: str = mode, scale: np.ndarray = scale) -> np.ndarray:
            """Both rates, relative to their largest, at places u (…, 2) in units of the picture."""
            return _rates(plane, mode, corner + u * size) / scale

        both = np.argwhere(_changes_sign(F) & _changes_sign(G))[:40, ::-1]
        seeds = [*((both + 0.5) / (GRID - 1)), *product((0.2, 0.5, 0.8), repeat=2)]
        roots = _newton(rates, np.array(seeds))
        offs = np.abs(rates(roots)).max(axis=1)
        mine: list[np.ndarray] = []
        for u in roots[np.argsort(offs)][: (offs < 1e-9).sum()]:  # of equals, the best one
            if not np.all((u >= -1e-9) & (u <= 1 + 1e-9)) or any(
                np.abs(u - other).max() < 1e-4 for other in mine
            ):
                continue
            at = corner + u * size
            if plane.governing(*at[:, None])[0] != index:
                continue
            mine.append(u)
            J = _jacobian(rates, u[None], 1e-3)[1][0]
            along = J[np.abs(J).max(axis=1).argmax(), ::-1] * (1, -1)  # along a nullcline
            beside = u + [[0.01], [-0.01]] * along / (np.abs(along).max() or 1.0)
            if along.any() and np.abs(rates(beside)).max() < 1e-9:
                continue  # one of a whole line of equilibria, which the nullclines show
            A = J * scale[:, None] / size[None, :]
            kind = classify(A, tolerance) if np.all(np.isfinite(A)) else "equilibrium"
            x, y = np.where(np.abs(at) < 1e-9 * size, 0.0, at).tolist()  # 3e-17 reads as 0
            found.append((x, y, mode, kind))
    return sorted(found)


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
    corner, size = np.array(limits).T[0], np.ptp(limits, axis=1)
    begin, signs = [], []
    for x, y, mode, kind in find_equilibria(plane, limits):
        if not kind.startswith("saddle"):
            continue
        u = (np.array([x, y]) - corner) / size

        def rates(u: np.ndarray, mode: str = mode) -> np.ndarray:
            return _rates(plane, mode, corner + u * size) / size

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
        for i, mode in enumerate(plane.modes):
            if (here := index == i).any():
                rates[here] = _rates(plane, mode, corner + v[here] * size) / size
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
    into, out = ([c for c, s in zip(kept, signs, strict=True) if s == way] for way in (-1, 1))
    return into, out


def _rates(plane: Plane, mode: str, places: np.ndarray) -> np.ndarray:
    """dx/dt and dy/dt at places (…, 2)."""
    return np.stack(plane.flow(mode, places[..., 0], places[..., 1]), axis=-1)


def _jacobian(
    f: Callable[[np.ndarray], np.ndarray], u: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """f: (…, 2) -> (…, 2) at u (n, 2), and its Jacobian (n, 2, 2) by five-point differences.

    All in one call of f.
    """
    # (n, axis, 5, 2)
    values = f(u[:, None, None] + h * np.arange(-2, 3)[:, None] * np.eye(2)[:, None])
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
            known = (np.abs(J) < 1e100).all(axis=(1, 2)) & np.isfinite(r).all(axis=1)
            lost = ~known | (np.abs(u - 0.5) > 1.5).any(axis=1)  # or out of sight
        J[lost], r[lost] = np.eye(2), 0.0
        rows = np.abs(J).max(axis=2)
        rows[rows == 0] = 1.0  # both rates count alike, however much they differ in size
        way = -np.einsum("nij,nj->ni", np.linalg.pinv(J / rows[:, :, None], rcond=1e-12), r / rows)
        length = np.abs(way).max(axis=1, keepdims=True)
        double = np.abs(length / np.where(before > 0, before, np.nan) - 0.5) < 0.02
        u = u + way * np.where(double, 2.0, 1.0 / np.maximum(1.0, 4 * length))
        before = np.where(double, np.nan, length)
        if length.max() < 1e-8:  # the error left is about the square of it
            break
    return np.where(length < 1e-6, u, np.nan)


def _changes_sign(Z: np.ndarray) -> np.ndarray:
    corners = np.stack([Z[:-1, :-1], Z[1:, :-1], Z[:-1, 1:], Z[1:, 1:]])
    return (corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0)
