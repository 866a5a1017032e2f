"""Static characteristics F(x): each stated once, as text, and everything else made from that.

    relay = characteristic("relay with hysteresis")          # F = ±K, changes over at x = ±a
    system = System(…, **relay.modes(law), outputs={"F": relay.output()})
    relay.formula(); relay.picture(system); relay.describing(2.0, system.values())

`law(t, s, p, F)` is the law of motion with the value F of the characteristic in it. `modes` makes
of it one mode for each piece of the characteristic, with guards at the break points, so that every
switch is an event and no right-hand side ever jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from . import formulas
from .arguments import asked
from .formulas import FUNCTIONS, names_of, number_of, parsed, sympy_of, values_of
from .model import ModelError, Output, check_names
from .switching import Builder, Law

__all__ = ["Branch", "Characteristic", "characteristic", "from_points"]


@dataclass(frozen=True)
class Branch:
    """Branch(("-a", "a"), ("-K", "K*x/a", "K")): break points, and one more piece than these.

    Both are formulas as text, in x and the names of parameters. Piece k holds up to edge k.
    """

    edges: tuple[str, ...]
    pieces: tuple[str, ...]

    @cached_property
    def names(self) -> set[str]:
        return {n for text in self.texts for n in names_of(text)} - {"x", *FUNCTIONS}

    @property
    def texts(self) -> tuple[str, ...]:
        return (*self.edges, *self.pieces)

    def spans(self) -> list[tuple[str, str]]:
        """branch.spans() -> the ends of each piece, (edge below, edge above); "" for none."""
        ends = ("", *self.edges, "")
        return list(zip(ends, ends[1:], strict=False))

    def region(self, place: int, x: str) -> str:
        """region(1, "x") -> "-a < x < a": where piece 1 holds, in words."""
        low, high = self.spans()[place]
        if low and high:
            return f"|{x}| < {high}" if low == f"-{high}" else f"{low} < {x} < {high}"
        return f"{x} > {low}" if low else f"{x} < {high}" if high else f"any {x}"


#: kind -> the Branch, or the one for x' > 0 and the one for x' < 0; the assignments of part 2
#: that it belongs to are named.
KINDS = {
    "relay": (  # 1.a, 2.a
        Branch(("0",), ("-K", "K")),
    ),
    "relay with hysteresis": (  # 1.b, the sample
        Branch(("a",), ("-K", "K")),
        Branch(("-a",), ("-K", "K")),
    ),
    "relay with dead zone": (  # 1.c, 2.c
        Branch(("-a", "a"), ("-K", "0", "K")),
    ),
    "relay with dead zone and hysteresis": (  # 1.d
        Branch(("-b*a", "a"), ("-K", "0", "K")),
        Branch(("-a", "b*a"), ("-K", "0", "K")),
    ),
    "saturation": (  # 1.e, 2.b
        Branch(("-a", "a"), ("-K", "K*x/a", "K")),
    ),
    "saturation with hysteresis": (  # 1.f
        Branch(("d*a - a", "d*a + a"), ("-K", "K*(x - d*a)/a", "K")),
        Branch(("-d*a - a", "-d*a + a"), ("-K", "K*(x + d*a)/a", "K")),
    ),
    "dead zone with saturation": (  # 1.g
        Branch(("-a - b", "-a", "a", "a + b"), ("-K", "K*(x + a)/b", "0", "K*(x - a)/b", "K")),
    ),
    "dead zone with saturation and hysteresis": (  # 1.h
        Branch(
            ("d*a - a - b", "d*a - a", "d*a + a", "d*a + a + b"),
            ("-K", "K*(x - d*a + a)/b", "0", "K*(x - d*a - a)/b", "K"),
        ),
        Branch(
            ("-d*a - a - b", "-d*a - a", "-d*a + a", "-d*a + a + b"),
            ("-K", "K*(x + d*a + a)/b", "0", "K*(x + d*a - a)/b", "K"),
        ),
    ),
    "smooth relay": (  # 1.i
        Branch((), ("2*K/pi*atan(alpha*x)",)),
    ),
    "smooth relay with dead zone": (  # 1.j
        Branch((), ("K/pi*(atan(alpha*(x + a)) + atan(alpha*(x - a)))",)),
    ),
    "preload": (  # 2.d
        Branch(("0",), ("p*x - c", "p*x + c")),
    ),
    "two springs": (  # 2.e
        Branch(("L",), ("p1*x + c1", "p2*x + c2")),
    ),
    "clearance": (  # 2.f
        Branch(("-L", "L"), ("p*x + c2", "0", "p*x + c1")),
    ),
}


@asked
def characteristic(kind: str, *, memory: bool = False, **names: str | float) -> Characteristic:
    """characteristic("saturation", K="p*L", a="L") -> Characteristic: one of KINDS.

    names     for each name of the formula what stands for it in the system: another parameter, a
              formula or a number. A name that is not given is a parameter of that name
    memory    the output changes at the break points only and is kept at a turn (a real relay);
              otherwise the sign of x' chooses the branch at once (the handbook's formula)

    Raises ModelError for an unknown kind or name, and for memory where it has no meaning.
    """
    check_names([kind], KINDS, "there is no characteristic {}")
    branches = KINDS[kind]
    known = sorted({name for branch in branches for name in branch.names})
    check_names(names, known, f"{kind!r} has no {{}}")
    for name, value in names.items():
        real = isinstance(value, int | float) and not isinstance(value, bool)
        if not isinstance(value, str) and not (real and math.isfinite(value)):
            raise ModelError(f"{name} = {value!r} is neither a number nor a formula as text")
        _no_x(str(value), f"{name} = {value!r}")

    def put(texts: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(formulas.put(text, names) for text in texts)

    made = [Branch(put(branch.edges), put(branch.pieces)) for branch in branches]
    return Characteristic(kind, *made, memory=memory)


def _no_x(text: str, what: str) -> None:
    if "x" in names_of(text):
        raise ModelError(f"{what}: x is the input, no parameter can be called so")


Points = Sequence[Sequence[float | str]]


@asked
def from_points(rising: Points, falling: Points | None = None, name: str = "") -> Characteristic:
    """from_points([(-1, -1), (0, -1), (0, 1), (2, 1)]) -> Characteristic through break points.

    rising    (x, F) from left to right, for x' > 0; falling the same for x' < 0, left out: the same
              curve. Two points at one x are a jump. Beyond the first and the last F is constant.
              Each is a number, or the name of a parameter or a formula as text: ("-a", "-K")

    Raises ModelError, with the points, where x goes back, where three points stand at one x, where
    the two curves do not meet at their ends or the rising one lies above the falling one; of points
    with parameters where a run begins. `movable` makes points that a hand can drag.
    """
    curves = [_points(curve) for curve in ([rising] if falling is None else [rising, falling])]
    if len(curves) == 2:
        for end, word in ((0, "left"), (-1, "right")):
            ends = [curve[end][1] for curve in curves]
            if ends[0] != ends[1] and not any(isinstance(end, str) for end in ends):
                raise ModelError(
                    f"the branches do not meet on the {word}: F = {ends[0]:g} for x' > 0 and "
                    f"{ends[1]:g} for x' < 0; the {'first' if end == 0 else 'last'} points "
                    "must have the same F"
                )
    made = Characteristic(name or "curve through points", *map(_through, curves))
    if not made.parameters:
        made.check({})
    return made


def _points(curve: Points) -> list[tuple[float | str, float | str]]:
    try:
        points = [
            tuple(value if isinstance(value, str) else float(value) for value in (x, F))
            for x, F in curve
        ]
    except (TypeError, ValueError):
        raise ModelError(
            f"points are pairs (x, F) of numbers or of formulas as text, not {curve!r:.80}"
        ) from None
    numbers = []
    for value in (value for point in points for value in point):
        if isinstance(value, str):
            _no_x(value, repr(value))
        else:
            numbers.append(value)
    if len(points) < 2 or not np.all(np.isfinite(numbers)):
        raise ModelError(f"a curve needs two points or more, all finite, not {points}")
    for one, two in zip(points, points[1:], strict=False):
        if not isinstance(one[0], str) and not isinstance(two[0], str) and two[0] < one[0]:
            raise ModelError(
                f"after ({', '.join(map(_said, one))}) the curve goes back to "
                f"({', '.join(map(_said, two))}): F would not be a function of x; give the "
                "points from left to right"
            )
    for one, three in zip(points, points[2:], strict=False):
        if one[0] == three[0]:
            raise ModelError(f"three points at x = {_said(one[0])}: a jump has two, its ends")
    return points


def _said(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _through(points: list[tuple[float | str, float | str]]) -> Branch:
    def term(value: float | str) -> str:
        """As a part of a formula."""
        text = str(value)
        return f"({text})" if isinstance(value, str) and not text.isidentifier() else text

    edges, pieces = [str(points[0][0])], [str(points[0][1])]
    for (x0, F0), (x1, F1) in zip(points, points[1:], strict=False):
        if x1 == x0:
            continue  # a jump
        a, low, b, high = map(term, (x0, F0, x1, F1))
        if F1 == F0:
            pieces.append(str(F0))
        elif any(isinstance(value, str) for value in (x0, F0, x1, F1)):
            pieces.append(f"{low} + ({high} - {low})*(x - {a})/({b} - {a})")
        else:
            pieces.append(f"{low} + {(F1 - F0) / (x1 - x0)}*(x - {a})")
        edges.append(str(x1))
    return Branch(tuple(edges), (*pieces, str(points[-1][1])))


class Characteristic:
    """Characteristic("saturation", Branch(("-a", "a"), ("-K", "K*x/a", "K"))): F of x.

    rising, falling   the Branch for x' > 0 and the one for x' < 0; without falling F is
                      single-valued
    memory            see `characteristic`

    Methods take the parameters `p` as `system.values()` gives them, or as a dict.
    """

    def __init__(
        self, name: str, rising: Branch, falling: Branch | None = None, *, memory: bool = False
    ):
        self.name, self.rising, self.memory = name, rising, memory
        self.falling = falling or rising
        self.hysteresis = falling is not None and falling != rising
        self._right: dict[str, float] | None = None  # values that `check` has found right
        for branch in {self.rising, self.falling}:
            if len(branch.pieces) != len(branch.edges) + 1:
                raise ModelError(
                    f"{name!r}: {len(branch.edges)} break points need {len(branch.edges) + 1} "
                    f"pieces, not {len(branch.pieces)}"
                )
            for text in branch.texts:
                parsed(text)
        if memory and not (self.hysteresis and self.rising.pieces == self.falling.pieces):
            raise ModelError(
                f"{name!r} cannot keep its output: its two branches must have the same pieces"
            )

    def __repr__(self) -> str:
        return f"Characteristic({self.name!r}: {', '.join(sorted(self.parameters)) or 'numbers'})"

    @property
    def parameters(self) -> set[str]:
        """Names of the parameters that the formulas read."""
        return self.rising.names | self.falling.names

    @property
    def branches(self) -> list[tuple[int, Branch]]:
        """[(sign of x', Branch)], one entry if F is single-valued."""
        return [(1, self.rising), (-1, self.falling)][: 1 + self.hysteresis]

    # -- the value ---------------------------------------------------------------------------------

    def edges(self, p: object, way: int = 1) -> np.ndarray:
        """edges(p) -> (k,) the break points for x' > 0 (way=1) or x' < 0 (way=-1)."""
        return np.array([float(number_of(text, p)) for text in self.branch(way).edges])

    def branch(self, way: int) -> Branch:
        """branch(-1) -> the Branch for x' < 0."""
        return self.rising if way > 0 else self.falling

    def __call__(self, x: object, p: object = (), v: object = 1.0) -> np.ndarray | float:
        """relay(x, p, v=-1.0) -> F, an array if x or v is one; v = x' chooses the branch.

        At a break point it is the piece that the motion enters. With memory: what a relay gives
        that comes from far away in this direction. Raises ModelError as `check`.
        """
        self.check(p)
        x, v = np.broadcast_arrays(_numbers(x, "x"), _numbers(v, "x'"))
        found = np.where(v < 0, self._on(-1, x, p, "left"), self._on(1, x, p, "right"))
        return found if found.shape else float(found)

    def _on(self, way: int, x: np.ndarray, p: object, side: str) -> np.ndarray:
        place = np.asarray(np.searchsorted(self.edges(p, way), x, side=side))
        pieces = [
            np.broadcast_to(number_of(text, p, x), x.shape) for text in self.branch(way).pieces
        ]
        return np.take_along_axis(np.stack(pieces), place[None], axis=0)[0]

    def check(self, p: object) -> None:
        """check(p): raises ModelError, naming the points, where they make no characteristic.

        The break points must not go back. Of two branches the rising one (x' > 0) must not lie
        above the falling one, and both must be the same far out on either side.
        """
        values = values_of(p)
        plain = all(isinstance(value, int | float) for value in values.values())
        if plain and values == self._right:  # arrays have no one answer to ==
            return
        if fault := self._fault(p):
            said = ", ".join(f"{name} = {values[name]:g}" for name in sorted(self.parameters))
            raise ModelError(f"{self.name}: {fault}{f' ({said})' * bool(said)}")
        if plain:
            self._right = dict(values)

    def _fault(self, p: object) -> str:
        for way, branch in self.branches:
            edges = self.edges(p, way)
            if not np.all(np.isfinite(edges)):
                return f"the break points {edges} are not all finite"
            if np.any(back := np.diff(edges) < 0):
                k = int(np.argmax(back))
                return (
                    f"the break points must rise, but {branch.edges[k]} = {edges[k]:g} lies right "
                    f"of {branch.edges[k + 1]} = {edges[k + 1]:g}"
                )
            ends = np.concatenate([edges[:1], edges, edges[-1:]])
            spans = zip(branch.spans(), branch.pieces, ends, ends[1:], strict=False)
            for names, text, low, high in spans:
                if not np.all(np.isfinite(number_of(text, p, np.array([low, high])))):
                    point = low == high and all(names)
                    where = f"{' and '.join(names)} are both {low:g}: " if point else ""
                    return f"{where}the piece {text} has no value between {low:g} and {high:g}"
        if not self.hysteresis:
            return ""
        edges = np.unique(np.concatenate([self.edges(p, 1), self.edges(p, -1)]))
        gap = max(float(np.ptp(edges)), float(np.abs(edges).max()), 1e-300)
        beside = edges - 1e-9 * gap, edges + 1e-9 * gap  # pieces are monotonic between break points
        middles, ends = (edges[1:] + edges[:-1]) / 2, (edges[0] - gap, edges[-1] + gap)
        x = np.sort(np.concatenate([*beside, middles, ends]))
        up, down = (self._on(way, x, p, "right") for way in (1, -1))
        size = 1e-12 * max(np.abs(up).max(), np.abs(down).max())
        worst = np.flatnonzero(up - down >= (up - down).max() - size)
        k = worst[len(worst) // 2]
        if up[k] > down[k] + size:
            return (
                f"the branches cross: at x = {x[k]:.6g} the one for x' > 0 has F = {up[k]:.6g}, "
                f"above the {down[k]:.6g} of the one for x' < 0"
            )
        for k in (0, -1):
            if abs(up[k] - down[k]) > size:
                return (
                    f"the branches do not meet: at x = {x[k]:.6g} they have F = {up[k]:.6g} and "
                    f"{down[k]:.6g}"
                )
        return ""

    # -- what theory makes of it -------------------------------------------------------------------

    @asked
    def potential(self, x: object, p: object = ()) -> np.ndarray | float:
        """potential(x, p) -> ∫₀ˣ F dx, an array if x is one; as `describing`, to rounding.

        Raises ModelError where F has two branches: then the work depends on the way.
        """
        if self.hysteresis:
            raise ModelError(f"{self.name!r} has no potential: its work depends on the way")
        self.check(p)
        x, edges = _numbers(x, "x"), self.edges(p)
        low, high = min(0.0, x.min(initial=0.0)), max(0.0, x.max(initial=0.0))
        places = np.unique([0.0, *x.ravel(), *edges[(edges > low) & (edges < high)]])
        piece = np.searchsorted(edges, (places[1:] + places[:-1]) / 2)  # of each gap between them
        gaps = np.zeros(len(piece))
        for k in set(piece.tolist()):
            ends = places[:-1][piece == k], places[1:][piece == k]
            f = partial(number_of, self.rising.pieces[k], p)
            gaps[piece == k] = formulas.integrals(f, *ends)
        work = np.concatenate([[0.0], np.cumsum(gaps)])
        total = work[np.searchsorted(places, x)] - work[np.searchsorted(places, 0.0)]
        return total if total.shape else float(total)

    @asked
    def describing(self, amplitude: float, p: object = ()) -> complex:
        """describing(A, p) -> N(A), the complex gain of the first harmonic for x = A sin θ.

        N = (b + j a)/A with b = (1/π)∮F sin θ dθ and a = (1/π)∮F cos θ dθ, by Gauss's formula
        between the break points, halved until it agrees with itself to rounding. (Gelb and Vander
        Velde, Multiple-Input Describing Functions, 1968.) Raises ModelError for an amplitude that
        is no number above 0, and for a relay with memory where it does not reach every break
        point: what F is there depends on what was before.
        """
        if not (isinstance(amplitude, int | float | np.number) and 0 < amplitude < math.inf):
            raise ModelError(f"a describing function needs an amplitude > 0, not {amplitude!r:.40}")
        self.check(p)
        far = max((np.abs(self.edges(p, way)).max(initial=0.0) for way in (1, -1)), default=0.0)
        if self.memory and amplitude <= far:
            raise ModelError(
                f"{self.name}: an amplitude of {amplitude:g} does not reach the break points at "
                f"±{far:g}; a relay with memory then keeps what it had before"
            )

        def harmonic(a: np.ndarray, text: str, way: int) -> np.ndarray:
            x = amplitude * np.sin(a)
            return number_of(text, p, x) * (np.sin(a) + 1j * way * np.cos(a))

        total = 0j
        for way in (1, -1):
            cuts = np.arcsin(np.clip(self.edges(p, way) / amplitude, -1, 1)).tolist()
            corners = [-math.pi / 2, *cuts, math.pi / 2]
            # x' < 0: the same places again, θ runs on from π/2 to 3π/2
            for text, *ends in zip(self.branch(way).pieces, corners, corners[1:], strict=False):
                total += formulas.integral(partial(harmonic, text=text, way=way), *ends)
        return complex(total) / (math.pi * amplitude)

    # -- the hybrid system -------------------------------------------------------------------------

    @asked
    def modes(self, law: Law, states: tuple[str, ...] = ("x", "v")) -> dict[str, Any]:
        """System(…, **relay.modes(law)): modes, transitions, first mode; exact switching.

        law       law(t, s, p, F) -> the derivatives, in the order of `states`; F is a number there
        states    names of the input of the characteristic, of its rate, and of any more states

        One mode for each piece; of two branches "→ x < a" is the piece for x' > 0, "← x > -a" the
        one for x' < 0. Guards are x − edge, labelled "up through a", "down through -a". Where F
        jumps, the motion may come to rest on the jump, and with two branches at any turn: it rests
        in a mode of its own as long as F between the two values holds it (the acceleration left of
        the jump is positive, right of it negative; of x' > 0 not positive, of x' < 0 not negative).

        A start that moves begins in the piece that it enters. A start at rest begins where its
        acceleration leads; where both directions are possible, to the right (give `mode=` for the
        other one); where neither is, at rest.
        """
        build = Builder(self, law, states)
        made = build.with_memory() if self.memory else build.formula()
        return {"modes": made[0], "transitions": made[1], "mode": made[2]}

    @asked
    def output(
        self,
        unit: str = "",
        meaning: str = "output of the characteristic",
        *,
        law: Law | None = None,
        states: tuple[str, ...] = ("x", "v"),
    ) -> Output:
        """outputs={"F": relay.output("N", law=law)} -> Output: F along the run.

        With law (and states, as for `modes`) F at rest is the value that holds the balance, if the
        law is linear in F; without it, the mean of the two values between which it lies.
        """
        return Output(Builder(self, law, states).outputs(), unit, meaning)

    # -- pictures ----------------------------------------------------------------------------------

    @asked
    def curve(self, p: object, reach: float | None = None, way: int = 1) -> np.ndarray:
        """curve(p, 2.0) -> (k, 2) points (x, F) over −reach … reach in the direction of the motion.

        reach: left out, 1.6 times the farthest break point.
        """
        self.check(p)
        every = np.abs(np.concatenate([self.edges(p, 1), self.edges(p, -1)]))
        reach = reach or 1.6 * float(every.max(initial=0.0)) or 1.0
        edges, pieces = self.edges(p, way), self.branch(way).pieces
        corners = [-reach, *edges[abs(edges) < reach], reach]
        points = []
        for low, high in zip(corners, corners[1:], strict=False):
            x = np.linspace(low, high, 2 if len(edges) else 201)
            place = np.searchsorted(edges, (low + high) / 2, side="right")
            F = np.broadcast_to(number_of(pieces[place], p, x), x.shape)
            points.append(np.column_stack([x, F]))
        found = np.concatenate(points)
        return found if way > 0 else found[::-1]

    @asked
    def symbol(self, p: object) -> np.ndarray:
        """symbol(p) -> (k, 2) in the square −1 … 1, for `Sketch.characteristic`."""
        found = np.concatenate([self.curve(p, way=way) for way, _ in self.branches])
        return found / np.maximum(np.abs(found).max(axis=0), 1e-300)

    def formula(self) -> Formula:
        """formula() -> shows itself in a notebook: F in LaTeX, by pieces and branches."""
        return Formula(self)

    @asked
    def picture(
        self, p: object, reach: float | None = None, *, axes: Any = None, unit: str = ""
    ) -> Any:
        """picture(system) -> a figure: F over x; of a loop both branches, with arrows.

        p: a System (its default values), its values, or a dict; axes: draw there, and return them.
        """
        from .draw import COLORS, figure

        fig = None if axes is not None else figure(width=6.4, height=3.0)
        ax = axes if fig is None else fig.axes[0]
        drawn = [(way, self.curve(p, reach, way)) for way, _ in self.branches]
        if self.hysteresis:
            ax.fill(*np.concatenate([points for _, points in drawn]).T, color="#EFEFEF", lw=0)
        for way, points in drawn:
            name = {1: r"$\dot x > 0$", -1: r"$\dot x < 0$"}[way] if self.hysteresis else ""
            color = COLORS[0 if way > 0 else 1]
            ax.plot(*points.T, color=color, lw=2, label=name or "_", ls="-" if way > 0 else "--")
            if self.hysteresis:
                _arrows(ax, points, color)
        span = [np.abs(points[:, k]).max() for k in (0, 1) for _, points in drawn]
        ax.set_ylim(*(1.25 * (max(span[len(drawn) :]) or 1.0) * np.array([-1, 1])))
        ax.set(xlabel="$x$", ylabel=f"$F$ [{unit}]" if unit else "$F$")
        ax.set_title(self.name, loc="left", fontsize=11)
        if self.hysteresis:
            ax.legend(loc="upper left", frameon=False)
        return fig or ax


def _arrows(ax: Any, points: np.ndarray, color: str) -> None:
    size = np.abs(points).max(axis=0)
    for one, two in zip(points, points[1:], strict=False):
        if np.linalg.norm((two - one) / size) > 0.3:
            middle = 0.55 * two + 0.45 * one
            look = {"arrowstyle": "-|>", "color": color, "mutation_scale": 16}
            look |= {"shrinkA": 0, "shrinkB": 0}
            ax.annotate("", middle + 0.01 * (two - one), middle, arrowprops=look)


def _numbers(values: object, what: str) -> np.ndarray:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} must be a number or an array, not {values!r:.40}") from None


class Formula:
    """The formula of a characteristic, for a notebook: LaTeX, and plain text."""

    def __init__(self, made: Characteristic):
        self.made = made

    def _repr_latex_(self) -> str:
        import sympy as sp

        from .show import latex_name

        def tex(text: str) -> str:
            names = {
                name: sp.Symbol(name if name == "x" else latex_name(name))
                for name in names_of(text)
                if name not in FUNCTIONS
            }
            return sp.latex(sympy_of(text, names))

        lines = []
        for way, branch in self.made.branches:
            when = rf",\ \dot x {'>' if way > 0 else '<'} 0" if self.made.hysteresis else ""
            for piece, (low, high) in zip(branch.pieces, branch.spans(), strict=True):
                below, above = low and f"{tex(low)} < ", high and f" < {tex(high)}"
                where = f"{below}x{above}" if low or high else ""
                lines.append(f"{tex(piece)}, & {where}{when}" if where or when else tex(piece))
        rows = r" \\ ".join(lines)
        body = rows if len(lines) == 1 else rf"\begin{{cases}}{rows}\end{{cases}}"
        return f"$$F(x) = {body}$$"

    def __repr__(self) -> str:
        lines = []
        for way, branch in self.made.branches:
            for k, piece in enumerate(branch.pieces):
                when = f", x' {'>' if way > 0 else '<'} 0" if self.made.hysteresis else ""
                lines.append(f"F = {piece} for {branch.region(k, 'x')}{when}")
        return "\n".join(lines)
