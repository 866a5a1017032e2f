"""What a similarity transformation does to a linear system: z-plane and s-plane side by side.

    planes(run, parts)         # parts(p) -> Λ, (S, S⁻¹) for the parameters of a run
    explore(system, horizon, lambda run: planes(run, parts))

The model's own motion is drawn on both sides: s(t) as it was simulated, and z(t) = S⁻¹ (s − s*).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Polygon

from ..arguments import unambiguous
from ..linear import affine, borders, eigenlines, equilibrium, exact
from ..model import ModelError
from ..run import Run
from ..show import split_name
from ..similarity import Similarity
from .figure import COLORS, FAINT, INK, figure, head, label, stroke, style, symbol, tint
from .view import Shows, View

Parts = Callable[[tuple], tuple[np.ndarray, Similarity]]
#: a letter F, since no turn makes it its mirror image; for a picture that reaches from −8 to 8
FLAG = 0.5 + np.column_stack(
    [
        (0, 0, 1.2, 1.2, 0.4, 0.4, 0.9, 0.9, 0.4, 0.4),
        (0, 2, 2, 1.65, 1.65, 1.25, 1.25, 0.9, 0.9, 0),
    ]
)


@unambiguous
def planes(
    run: Run,
    parts: Parts,
    reach: float | tuple[float, float] = 4.0,
    axes: tuple[Axes, Axes] | None = None,
    allowed: Mapping[str, tuple[float | None, float | None]] | None = None,
    width: float = 9.5,
    height: float = 4.9,
) -> Planes:
    """planes(run, parts) -> Planes: the canonical z-plane, and its image under S in the s-plane.

    Trajectories, a lattice, a letter F and the eigenvectors. The F shows what S does to shapes: no
    turn makes an F its mirror image. In a panel the start can be dragged in the s-plane.
    run      of a linear model; drawn bold in both planes
    parts    parts(run.p) -> Λ, (S, S⁻¹) with A = S Λ S⁻¹
    reach    half the width of the pictures, in both planes or (z, s); the s-plane follows the
             equilibrium
    allowed  {"s1": (0, None)}: what lies beyond these values is shaded, the model does not hold
             there; None is no limit
    Raises ModelError when S Λ S⁻¹ is not the matrix that the model itself has, and for a name in
    `allowed` that is no state.
    """
    sides = tuple(figure(1, 2, width, height).axes) if axes is None else axes
    return Planes(run, parts, reach, sides, allowed or {})


class Planes(View):
    """The picture made by `planes`; view.axes are the two.

    See View for update, artists and relimited.
    """

    def __init__(
        self,
        run: Run,
        parts: Parts,
        reach: float | tuple[float, float],
        axes: Sequence[Axes],
        allowed: Mapping[str, tuple[float | None, float | None]],
    ):
        self.parts, self.system = parts, run.system
        self.reach = tuple(map(float, np.broadcast_to(reach, 2)))
        self.axes = axes
        self.figure = self.axes[0].get_figure()
        self._sides = [_Side(ax) for ax in self.axes]
        self.artists = [artist for side in self._sides for artist in side.artists]
        self._center: np.ndarray | None = None
        first, second = self.system.states
        self.shows = [Shows(self.axes[1], first, (second,))]
        self._named: list | None = None  # in the legend of the z-plane
        self._bands = self._shade(allowed)
        unit, other = map(self.system.unit, (first, second))
        of_z = f" [{unit}]" if unit and unit == other else ""
        with style():
            self.axes[0].set(xlabel=f"$z_1${of_z}", ylabel=f"$z_2${of_z}")
            self.axes[1].set(xlabel=label(self.system, first), ylabel=label(self.system, second))
        for ax in self.axes:
            ax.set_aspect("equal", adjustable="box")
            ax.grid(False)
        self.update(run)

    def _shade(
        self, allowed: Mapping[str, tuple[float | None, float | None]]
    ) -> list[tuple[int, float, float, Patch]]:
        """Bands over what the model forbids, in the s-plane: (axis, from, to, patch)."""
        bands = []
        for name, ends in allowed.items():
            if name not in self.system.states:
                raise ModelError(
                    f"allowed names {name!r}, which is no state of {self.system.name!r}"
                )
            k = self.system.states.index(name)
            draw = (self.axes[1].axvspan, self.axes[1].axhspan)[k]
            for end, far in zip(ends, (-1e4, 1e4), strict=True):
                if end is not None:
                    patch = draw(end, end + far, color=tint(FAINT, 0.3), lw=0, zorder=0.5)
                    bands.append((k, *sorted((end, end + far)), patch))
        return bands

    def _head(self) -> None:
        """Title and legend of the s-plane; "forbidden" only where something shaded is in sight."""
        limits = (self.axes[1].get_xlim(), self.axes[1].get_ylim())
        shaded = [
            (patch, "forbidden")
            for k, low, high, patch in self._bands
            if low < limits[k][1] and high > limits[k][0]
        ][:1]
        one, other = (split_name(name)[0] for name in self.system.states)
        plane = f"${one}$" if one.startswith("\\") else one  # of s1, s2
        if one != other:
            plane = "({}, {})".format(*map(symbol, self.system.states))
        # beside two entries there is no room for more words
        title = f"{plane}-plane" + ("" if shaded else ": after S")
        head(self.axes[1], title, [(self._sides[1].run, "simulated"), *shaded])

    def update(self, run: Run) -> None:
        A, b = affine(run.system, run.p, run.start)
        Lambda, (S, inverse) = self.parts(run.p)
        product, Lambda = S @ Lambda @ inverse, np.asarray(Lambda, dtype=float)
        size, stretch = (max(1.0, float(np.abs(matrix).max())) for matrix in (A, S))
        if np.abs(product - A).max() > 1e-9 * size * stretch**2:
            raise ModelError(
                f"S Λ S⁻¹ = {product.round(6).tolist()} is not the matrix of "
                f"{run.system.name!r}, {A.round(6).tolist()}: check the parts"
            )
        rest = equilibrium(A, b)
        with np.errstate(invalid="ignore", over="ignore"):  # a run that diverged
            own = ((run.values[:, :2] - rest) @ inverse.T, run.values[:, :2])
        # the image of the F reaches over two thirds of a half at most
        far = np.hypot(*(FLAG @ np.asarray(S, dtype=float).T).T).max()
        unit = self.reach[0] / 8
        flag = min(unit, 0.67 * self.reach[1] / far) * FLAG
        lattice = _lattice(2.0 ** np.round(np.log2(2 * unit)))
        curves, arrows = flow_lines(Lambda, self.reach[0])
        ways = ((np.eye(2), np.zeros(2)), (S, rest))
        for side, reach, (T, origin), path in zip(self._sides, self.reach, ways, own, strict=True):
            side.set(T, origin, lattice, flag, curves, path)
            side.point(T, origin, Lambda, arrows, 0.05 * reach)
        eigen = self._sides[0].eigen
        named = [(eigen, "eigenvectors")] if len(eigen.get_xdata()) else []
        half = self.reach[1] / 2
        moved = self._center is None or bool(np.abs(rest - self._center).max() > half)
        self.relimited = moved or named != self._named  # seldom: it costs a new still part
        if named != self._named:
            self._named = named
            head(self.axes[0], "z-plane: canonical", named)
        if moved:
            self._center = half * np.round(rest / half)
            centers = ((0.0, 0.0), self._center)
            for ax, reach, (x, y) in zip(self.axes, self.reach, centers, strict=True):
                ax.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach))
            self._head()


class _Side:
    """One plane: what is drawn in it, and how it follows a transformation s = T z + origin."""

    def __init__(self, ax: Axes):
        self.lattice = stroke(ax, color=tint(COLORS[5], 0.75), lw=0.8, zorder=1)
        look = {"facecolor": tint(COLORS[4], 0.6), "edgecolor": tint("#8A5F00", 0.9), "lw": 1.2}
        self.flag = ax.add_patch(Polygon(FLAG, joinstyle="round", zorder=2.15, **look))
        self.curves = stroke(ax, color=COLORS[0], lw=1.0, zorder=2)
        self.arrows = stroke(ax, color=COLORS[0], lw=1.4, zorder=2.1)
        self.eigen = stroke(ax, color=COLORS[1], lw=2.0, ls=(0, (6, 2)), zorder=2.2)
        self.run = stroke(ax, color=INK, lw=2.2, zorder=3)
        dot = {"color": INK, "marker": "o", "ls": "none"}
        self.start = stroke(ax, ms=7, mfc="white", mew=1.6, zorder=3.2, **dot)
        self.rest = stroke(ax, ms=6, zorder=3.1, **dot)
        self.artists = [self.lattice, self.flag, self.curves, self.arrows, self.eigen, self.run]
        self.artists += [self.rest, self.start]

    def set(
        self,
        T: np.ndarray,
        origin: np.ndarray,
        lattice: np.ndarray,
        flag: np.ndarray,
        curves: np.ndarray,
        path: np.ndarray,
    ) -> None:
        for artist, points in ((self.lattice, lattice), (self.curves, curves)):
            artist.set_data(*(points @ T.T + origin).T)
        self.flag.set_xy(flag @ T.T + origin)
        self.run.set_data(*path.T)
        self.start.set_data(*path[:1].T)
        self.rest.set_data(*origin[:, None])

    def point(
        self, T: np.ndarray, origin: np.ndarray, Lambda: np.ndarray, at: np.ndarray, size: float
    ) -> None:
        """Arrow heads along the flow, and the lines of the eigenvectors."""
        heads = arrow_heads(at @ T.T, at @ Lambda.T @ T.T, size)
        self.arrows.set_data(*(heads + origin).T)
        vectors = [] if _star(Lambda) else [v for _, v in eigenlines(Lambda)]
        lines = [np.outer((-1e3, 1e3, np.nan), v) for v in vectors]
        self.eigen.set_data(*(np.concatenate([np.zeros((0, 2)), *lines]) @ T.T + origin).T)


def _star(Lambda: np.ndarray) -> bool:
    return borders(Lambda)["star"] < 1e-9  # every direction is an eigenvector


def _lattice(space: float) -> np.ndarray:
    """Lines z1 = k·space and z2 = k·space, k = −9 … 9, with NaN between them."""
    k, ends = np.arange(-9, 10.0), np.array([-9, 9, np.nan])
    level = space * np.stack(np.broadcast_arrays(ends, k[:, None]), axis=2).reshape(-1, 2)
    return np.concatenate([level, level[:, ::-1]])


def flow_lines(A: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """lines, points = flow_lines(A, 4.0): the portrait of dy/dt = A y from −reach to reach.

    Any A, also a singular one.
    lines   (n, 2), exact trajectories, forwards and backwards from points on a circle (of a centre:
            on a ray), NaN between
    points  (k, 2), where arrows should stand; the direction there is A y
    """
    a, square = np.trace(A) / 2, (A[0, 0] - A[1, 1]) ** 2 / 4 + A[0, 1] * A[1, 0]
    turns = np.sqrt(max(-square, 0.0))  # rad/s
    values = a + np.sqrt(max(square, 0.0)) * np.array([1, -1])  # eigenvalues, or their real part
    if turns > 50 * abs(a):  # closed, or nearly: half a turn each way
        starts = reach * np.column_stack([np.linspace(0.15, 1.35, 9), np.zeros(9)])
        t = np.linspace(-1, 1, 121) * np.pi / turns
    else:
        # arms of a spiral, a quarter apart
        count = int(np.clip(2 * np.pi * abs(a) / turns / 0.24, 1, 10)) if turns else 16
        angle = (np.arange(count) + 0.5) * 2 * np.pi / count
        starts = 0.62 * reach * np.column_stack([np.cos(angle), np.sin(angle)])
        if turns:
            fine = int(40 * 4.2 * turns / (2 * np.pi * abs(a))) + 80
            t = np.linspace(*sorted((1.2 / a, -3.0 / a)), fine)
        else:
            # an eigenvalue may be 0
            slowest = max(np.abs(values).min(), np.linalg.norm(A) / 200) or 1.0
            # closely spaced near the start: one eigenvalue may be much faster
            t = np.linspace(-1, 1, 91) ** 3 * 4.5 / slowest
            t = t[np.outer(values, t).max(axis=0) < 300]
    z = exact(A, (0.0, 0.0), starts, t)
    z[np.abs(z).max(axis=2) > 8 * reach] = np.nan
    marked = starts
    if turns and len(starts) < 9:  # few arms of a slow spiral: more arrows, at halved distances
        marked = exact(A, (0.0, 0.0), starts, np.log([1.0, 0.7, 0.4, 0.2]) / a).reshape(-1, 2)
    lines = np.pad(z, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
    return lines.reshape(-1, 2), marked


def arrow_heads(at: np.ndarray, way: np.ndarray, size: float) -> np.ndarray:
    """arrow_heads(points, points @ A.T, 0.2) -> (4 k, 2).

    Heads at the points along `way`, as open strokes with NaN between; none where nothing moves.
    """
    length = np.hypot(*way.T)[:, None]
    way = size * way / np.where(length > 0, length, np.nan)
    side = 0.5 * way[:, ::-1] * (-1, 1)
    up = np.full_like(at, np.nan)
    return np.stack([at - way + side, at, at - way - side, up], axis=1).reshape(-1, 2)
