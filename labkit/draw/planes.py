"""What a similarity transformation does to a linear system: z-plane and s-plane side by side.

    planes(run, parts)         # parts(p) -> Λ, (S, S⁻¹) for the parameters of a run
    explore(system, horizon, lambda run: planes(run, parts))

The model's own motion is drawn on both sides: s(t) as it was simulated, and z(t) = S⁻¹ (s − s*).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from ..arguments import unambiguous
from ..linear import affine, borders, eigenlines, equilibrium, exact
from ..model import ModelError
from ..run import Run
from ..show import split_name
from ..similarity import Similarity
from .figure import COLORS, FAINT, INK, figure, head, label, style, symbol, tint
from .view import Shows, View

__all__ = ["Planes", "arrow_heads", "flow_lines", "planes"]

Parts = Callable[[tuple], tuple[np.ndarray, Similarity]]
#: a letter F, since no turn makes it its mirror image; for a picture that reaches from −8 to 8
FLAG = (
    np.array(
        [
            (0, 0),
            (0, 2),
            (1.2, 2),
            (1.2, 1.65),
            (0.4, 1.65),
            (0.4, 1.25),
            (0.9, 1.25),
            (0.9, 0.9),
            (0.4, 0.9),
            (0.4, 0),
        ]
    )
    + 0.5
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
    return Planes(run, parts, reach, axes, allowed or {}, width, height)


class Planes(View):
    """The picture made by `planes`; view.axes are the two.

    See View for update, artists and relimited.
    """

    def __init__(
        self,
        run: Run,
        parts: Parts,
        reach: float | tuple[float, float],
        axes: tuple[Axes, Axes] | None,
        allowed: Mapping[str, tuple[float | None, float | None]],
        width: float,
        height: float,
    ):
        self.parts, self.system = parts, run.system
        self.reach = (
            (float(reach),) * 2 if isinstance(reach, int | float) else tuple(map(float, reach))
        )
        self.axes = tuple(figure(1, 2, width, height).axes) if axes is None else axes
        self.figure = self.axes[0].get_figure()
        self._sides = [_Side(ax) for ax in self.axes]
        self.artists = [artist for side in self._sides for artist in side.artists]
        self._center: np.ndarray | None = None
        first, second = self.system.states
        self.shows = [Shows(self.axes[1], first, (second,))]
        self._named: list | None = None  # in the legend of the z-plane
        self._bands = self._shade(allowed)
        with style():
            units = {self.system.unit(name) for name in (first, second)}
            of_z = f" [{units.pop()}]" if len(units) == 1 and units != {""} else ""
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
            across = list(self.system.states).index(name)
            draw = (self.axes[1].axvspan, self.axes[1].axhspan)[across]
            for end, far in zip(ends, (-1e4, 1e4), strict=True):
                if end is not None:
                    patch = draw(end, end + far, color=tint(FAINT, 0.3), linewidth=0, zorder=0.5)
                    bands.append((across, *sorted((end, end + far)), patch))
        return bands

    def _head(self) -> None:
        """Title and legend of the s-plane; "forbidden" only where something shaded is in sight."""
        limits = (self.axes[1].get_xlim(), self.axes[1].get_ylim())
        shaded = [
            (patch, "forbidden")
            for across, low, high, patch in self._bands
            if low < limits[across][1] and high > limits[across][0]
        ][:1]
        letters = [split_name(name)[0] for name in self.system.states]
        if letters[0] == letters[1]:  # s1, s2
            plane = f"${letters[0]}$" if letters[0].startswith("\\") else letters[0]
        else:
            plane = "({}, {})".format(*map(symbol, self.system.states))
        # beside two entries there is no room for more words
        title = f"{plane}-plane" + ("" if shaded else ": after S")
        with style():
            head(self.axes[1], title, [(self._sides[1].run, "simulated"), *shaded])

    def update(self, run: Run) -> None:
        A, b = affine(run.system, run.p, run.start)
        Lambda, (S, inverse) = self.parts(run.p)
        if (
            np.abs(S @ Lambda @ inverse - A).max()
            > 1e-9 * max(1.0, float(np.abs(A).max())) * max(1.0, float(np.abs(S).max())) ** 2
        ):
            raise ModelError(
                f"S Λ S⁻¹ = {(S @ Lambda @ inverse).round(6).tolist()} is not the matrix of "
                f"{run.system.name!r}, {A.round(6).tolist()}: check the parts"
            )
        rest = equilibrium(A, b)
        curves, arrows = flow_lines(np.asarray(Lambda, dtype=float), self.reach[0])
        with np.errstate(invalid="ignore", over="ignore"):  # a run that diverged
            own = ((run.values[:, :2] - rest) @ inverse.T, run.values[:, :2])
        for side, reach, T, origin, path in zip(
            self._sides, self.reach, (np.eye(2), S), (np.zeros(2), rest), own, strict=True
        ):
            side.set(
                T,
                self._flag(S),
                origin,
                np.asarray(Lambda, dtype=float),
                curves,
                arrows,
                path,
                reach,
                self.reach[0] / 8,
            )
        eigen = self._sides[0].eigen
        named = [(eigen, "eigenvectors")] if len(eigen.get_xdata()) else []
        half = self.reach[1] / 2
        moved = self._center is None or bool(np.abs(rest - self._center).max() > half)
        self.relimited = moved or named != self._named  # seldom: it costs a new still part
        if named != self._named:
            self._named = named
            with style():
                head(self.axes[0], "z-plane: canonical", named)
        if moved:
            self._center = half * np.round(rest / half)
            for ax, reach, (x, y) in zip(
                self.axes, self.reach, ((0.0, 0.0), self._center), strict=True
            ):
                ax.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach))
            self._head()

    def _flag(self, S: np.ndarray) -> float:
        """How large the F is in the z-plane.

        Its image reaches over two thirds of a half at most.
        """
        far = np.hypot(*(FLAG @ np.asarray(S, dtype=float).T).T).max()
        return min(self.reach[0] / 8, 0.67 * self.reach[1] / far)


class _Side:
    """One plane: what is drawn in it, and how it follows a transformation s = T z + origin."""

    def __init__(self, ax: Axes):
        def line(**look: object) -> Line2D:
            return ax.add_line(Line2D([], [], **look))  # type: ignore[arg-type]

        self.lattice = line(color=tint(COLORS[5], 0.75), linewidth=0.8, zorder=1)
        self.flag = ax.add_patch(
            Polygon(
                FLAG,
                closed=True,
                facecolor=tint(COLORS[4], 0.6),
                edgecolor=tint("#8A5F00", 0.9),
                linewidth=1.2,
                joinstyle="round",
                zorder=2.15,
            )
        )
        self.curves = line(color=COLORS[0], linewidth=1.0, zorder=2)
        self.arrows = line(color=COLORS[0], linewidth=1.4, zorder=2.1)
        self.eigen = line(color=COLORS[1], linewidth=2.0, linestyle=(0, (6, 2)), zorder=2.2)
        self.run = line(color=INK, linewidth=2.2, zorder=3)
        self.start = line(
            color=INK,
            marker="o",
            markersize=7,
            markerfacecolor="white",
            markeredgewidth=1.6,
            linestyle="none",
            zorder=3.2,
        )
        self.rest = line(color=INK, marker="o", markersize=6, linestyle="none", zorder=3.1)
        self.artists = [
            self.lattice,
            self.flag,
            self.curves,
            self.arrows,
            self.eigen,
            self.run,
            self.rest,
            self.start,
        ]

    def set(
        self,
        T: np.ndarray,
        flag: float,
        origin: np.ndarray,
        Lambda: np.ndarray,
        curves: np.ndarray,
        arrows: np.ndarray,
        path: np.ndarray,
        reach: float,
        unit: float,
    ) -> None:
        def show(line: Line2D, points: np.ndarray) -> None:
            line.set_data(*(points @ T.T + origin).T)

        show(self.lattice, _lattice(2.0 ** np.round(np.log2(2 * unit))))
        self.flag.set_xy(flag * FLAG @ T.T + origin)
        show(self.curves, curves)
        at, way = arrows @ T.T, arrows @ Lambda.T @ T.T
        self.arrows.set_data(*(arrow_heads(at, way, 0.05 * reach) + origin).T)
        lines = [] if _star(Lambda) else [v for _, v in eigenlines(Lambda)]
        show(
            self.eigen,
            np.concatenate([np.outer((-1e3, 1e3, np.nan), v) for v in lines])
            if lines
            else np.zeros((0, 2)),
        )
        self.run.set_data(*path.T)
        self.start.set_data(*path[:1].T)
        self.rest.set_data(*origin[:, None])


def _star(Lambda: np.ndarray) -> bool:
    return borders(Lambda)["star"] < 1e-9  # every direction is an eigenvector


def _lattice(space: float) -> np.ndarray:
    """Lines z1 = k·space and z2 = k·space, k = −9 … 9, with NaN between them."""
    k, far, up = (
        space * np.arange(-9, 10.0),
        space * np.array([-9, 9, np.nan]),
        np.array([1, 1, np.nan]),
    )
    level = np.stack([np.broadcast_to(far, (19, 3)), np.outer(k, up)], axis=2).reshape(-1, 2)
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
    values = a + np.sqrt(max(square, 0.0)) * np.array(
        [1, -1]
    )  # the eigenvalues, or their real part
    if turns > 50 * abs(a):  # closed, or nearly: half a turn each way
        starts = reach * np.column_stack([np.linspace(0.15, 1.35, 9), np.zeros(9)])
        t = np.linspace(-1, 1, 121) * np.pi / turns
    else:
        count = (
            int(np.clip(2 * np.pi * abs(a) / turns / 0.24, 1, 10)) if turns else 16
        )  # arms of a spiral, a quarter apart
        angle = (np.arange(count) + 0.5) * 2 * np.pi / count
        starts = 0.62 * reach * np.column_stack([np.cos(angle), np.sin(angle)])
        if turns:
            t = np.linspace(
                *sorted((1.2 / a, -3.0 / a)), int(40 * 4.2 * turns / (2 * np.pi * abs(a))) + 80
            )
        else:
            slowest = (
                max(np.abs(values).min(), np.linalg.norm(A) / 200) or 1.0
            )  # an eigenvalue may be 0
            t = (
                np.linspace(-1, 1, 91) ** 3 * 4.5 / slowest
            )  # closely spaced near the start: one eigenvalue may be much faster
            t = t[np.outer(values, t).max(axis=0) < 300]
    z = exact(A, (0.0, 0.0), starts, t)
    z[np.abs(z).max(axis=2) > 8 * reach] = np.nan
    marked = starts
    if (
        turns and len(starts) < 9
    ):  # the few arms of a slow spiral get more arrows, at halved distances
        marked = exact(A, (0.0, 0.0), starts, np.log([1.0, 0.7, 0.4, 0.2]) / a).reshape(-1, 2)
    return np.concatenate([z, np.full((len(z), 1, 2), np.nan)], axis=1).reshape(-1, 2), marked


def arrow_heads(at: np.ndarray, way: np.ndarray, size: float) -> np.ndarray:
    """arrow_heads(points, points @ A.T, 0.2) -> (4 k, 2).

    Heads at the points along `way`, as open strokes with NaN between; none where nothing moves.
    """
    length = np.hypot(*way.T)[:, None]
    way = size * way / np.where(length > 0, length, np.nan)
    side = 0.5 * way[:, ::-1] * (-1, 1)
    return np.stack(
        [at - way + side, at, at - way - side, np.full_like(at, np.nan)], axis=1
    ).reshape(-1, 2)
