"""A hybrid system from a static characteristic in a law of motion: modes, guards, first mode.

Used by `Characteristic.modes` and `Characteristic.output`; see there for what comes out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .formulas import function, python, sympy_of
from .model import Mode, ModelError, Transition

if TYPE_CHECKING:
    from .characteristics import Branch, Characteristic

__all__ = ["Builder", "Law"]

Law = Callable[[Any, Any, Any, Any], Sequence]


class Builder:
    """Modes, transitions and first mode of a characteristic in a law of motion.

    All functions are made from text with the names of states and parameters in it, so that they
    are traced to equations and compiled like those that a notebook writes.
    """

    def __init__(self, made: Characteristic, law: Law | None, states: tuple[str, ...]):
        if isinstance(states, str) or len(states) < 2:
            raise ModelError(f"states names the input and its rate, ('x', 'v'), not {states!r}")
        self.made, self.law, self.states = made, law, states
        self.x, self.v = states[:2]
        self.rates = {
            way: [f"law(t, s, p, {self._value(piece)})" for piece in made.branch(way).pieces]
            for way in (1, -1)
        }

    def _made(self, text: str) -> Callable:
        """A function of (t, s, p) from the text of what it returns."""
        return function(f"lambda t, s, p: {text}", law=self.law, held=held)

    def _value(self, piece: str) -> str:
        return f"({python(piece, {'x': f's.{self.x}'})})"

    def _push(self, way: int, place: int) -> str:
        """The text of the acceleration on a piece."""
        return f"{self.rates[way][place]}[1]"

    def _pushes(self, way: int) -> list[Callable]:
        return [self._made(f"{rates}[1]") for rates in self.rates[way]]

    def _name(self, way: int, place: int) -> str:
        if self.made.memory:
            return f"F = {self.made.rising.pieces[place]}"
        region = self.made.branch(way).region(place, self.x)
        return f"{'→' if way > 0 else '←'} {region}" if self.made.hysteresis else region

    def _modes(self, way: int) -> list[Mode]:
        """One for each piece of a branch."""
        return [
            Mode(self._name(way, k), self._made(rates), meaning=f"F = {piece}")
            for k, (rates, piece) in enumerate(
                zip(self.rates[way], self.made.branch(way).pieces, strict=True)
            )
        ]

    def _rest(self, one: str, two: str) -> Callable:
        """The flow at rest: input and rate stand still, other states go on, with F in balance."""
        law = f"law(t, s, p, {self._at_rest(one, two)})"
        more = "".join(f", {law}[{k}]" for k in range(2, len(self.states)))
        return self._made(f"(0.0, 0.0{more})")

    def _jumps(self) -> list[int]:
        """Break points of a single-valued F at which it jumps, or may for some parameters."""
        import sympy as sp

        branch, found = self.made.rising, []
        names = {name: sp.Symbol(name) for name in (*branch.names, "x")}
        for k, edge in enumerate(branch.edges):
            left, right = (sympy_of(piece, names) for piece in branch.pieces[k : k + 2])
            ends = [side.subs(names["x"], sympy_of(edge, names)) for side in (left, right)]
            step = sp.simplify(ends[1] - ends[0])
            if step.is_number:  # of points typed in, which meet but for rounding
                step = 0 if abs(step) <= 1e-12 * max(map(abs, ends)) else step
            if step != 0:
                found.append(k)
        return found

    def formula(self) -> tuple[list[Mode], list[Transition], Callable]:
        """The branch follows from the sign of the rate."""
        return self._two_branches() if self.made.hysteresis else self._one_branch()

    def _crossing(self, way: int, k: int, one: int, two: int, **more: Any) -> Transition:
        """From a piece to its neighbour, over break point k of a branch, upwards or downwards."""
        up, edge = two > one, self.made.branch(way).edges[k]
        return Transition(
            self._name(way, one),
            self._name(way, two),
            guard=self._made(f"s.{self.x} - ({python(edge, {})})"),
            direction=1 if up else -1,
            label=f"{'up' if up else 'down'} through {edge}",
            **more,
        )

    def _crossings(self, way: int) -> list[Transition]:
        """Over all break points of a branch, the way that it is gone."""
        count = len(self.made.branch(way).edges)
        return [self._crossing(way, k, *(k, k + 1)[::way]) for k in range(count)]

    def _one_branch(self) -> tuple[list[Mode], list[Transition], Callable]:
        jumps, modes, transitions = self._jumps(), self._modes(1), []
        for k, edge in enumerate(self.made.rising.edges):
            rest = self._rest_name(k)
            calm = {"zeno": rest} if k in jumps else {}
            transitions += [
                self._crossing(1, k, k, k + 1, **calm),
                self._crossing(1, k, k + 1, k, **calm),
            ]
            if k in jumps:
                flow = self._rest(*self._beside(k))
                modes.append(Mode(rest, flow, meaning="F lies within the jump"))
                on = {self.x: self._made(f"0.0 * s.{self.x} + ({python(edge, {})})")}
                for place, way in ((k + 1, 1), (k, -1)):
                    label = f"leaves {edge} to the {'right' if way > 0 else 'left'}"
                    guard, side = self._made(self._push(1, place)), self._name(1, place)
                    transitions.append(Transition(rest, side, guard, way, on, label))
        push = self._pushes(1)

        def first(t: float, s: Any, p: Any) -> str:
            self.made.check(p)
            x, v, edges = getattr(s, self.x), getattr(s, self.v), self.made.edges(p)
            low, high = (int(np.searchsorted(edges, x, side=side)) for side in ("left", "right"))
            if low == high or v > 0 or (v == 0 and push[high](t, s, p) > 0):
                return self._name(1, high)
            if v < 0 or push[low](t, s, p) < 0:
                return self._name(1, low)
            for k in range(low, high):  # several break points at one place: the jump that holds it
                if k in jumps and push[k](t, s, p) >= 0 >= push[k + 1](t, s, p):
                    return self._rest_name(k)
            return self._name(1, high)

        return modes, transitions, first

    def _rest_name(self, k: int) -> str:
        return f"rest at {self.made.rising.edges[k]}"

    def _two_branches(self) -> tuple[list[Mode], list[Transition], Callable]:
        modes, transitions, rest = [], [], "at rest"
        for way in (1, -1):
            own = self._modes(way)
            names = tuple(mode.name for mode in own)
            modes += own
            stop = {"guard": self._made(f"s.{self.v}"), "reset": {self.v: 0.0}, "label": "stop"}
            transitions += self._crossings(way)
            transitions.append(Transition(names, rest, direction=-way, **stop))
            label = f"off to the {'right' if way > 0 else 'left'}"
            for k, name in enumerate(names):
                guard = self._made(self._on_piece(way, k))
                transitions.append(Transition(rest, name, guard, way, label=label))
        flow = self._rest(*(self._nested(branch) for _, branch in self.made.branches))
        modes.append(Mode(rest, flow, meaning="F lies within the loop"))
        push = {way: self._pushes(way) for way in (1, -1)}

        def first(t: float, s: Any, p: Any) -> str:
            self.made.check(p)
            x, v = getattr(s, self.x), getattr(s, self.v)
            place = {
                way: int(np.searchsorted(self.made.edges(p, way), x, side=side))
                for way, side in ((1, "right"), (-1, "left"))
            }
            if v > 0 or (v == 0 and push[1][place[1]](t, s, p) > 0):
                return self._name(1, place[1])
            if v < 0 or push[-1][place[-1]](t, s, p) < 0:
                return self._name(-1, place[-1])
            return rest

        return modes, transitions, first

    def _on_piece(self, way: int, k: int) -> str:
        """The acceleration on a piece, where the place is on that piece; else away from leaving."""
        x, less = f"s.{self.x}", ("<=", "<") if way > 0 else ("<", "<=")
        low, high = (end and python(end, {}) for end in self.made.branch(way).spans()[k])
        inside = (low and f"{low} {less[0]} {x}", high and f"{x} {less[1]} {high}")
        where = " and ".join(filter(None, inside))
        push = self._push(way, k)
        return f"({push} if {where} else {-float(way)})" if where else push

    def with_memory(self) -> tuple[list[Mode], list[Transition], Callable]:
        """The output changes at the break points only: modes are its values."""
        names = [self._name(1, k) for k in range(len(self.made.rising.pieces))]
        flows = map(self._made, self.rates[1])
        modes = [Mode(*each) for each in zip(names, flows, strict=True)]
        transitions = [*self._crossings(1), *self._crossings(-1)]

        def first(t: float, s: Any, p: Any) -> str:
            self.made.check(p)
            way = -1 if getattr(s, self.v) < 0 else 1
            side = "right" if way > 0 else "left"
            place = np.searchsorted(self.made.edges(p, way), getattr(s, self.x), side=side)
            return names[int(place)]

        return modes, transitions, first

    def outputs(self) -> dict[str, Callable]:
        """Name of a mode -> its F."""
        made = self.made
        found = {
            self._name(way, k): self._made(self._value(piece))
            for way, branch in made.branches
            for k, piece in enumerate(branch.pieces)
        }
        if made.hysteresis and not made.memory:
            up, down = (self._nested(branch) for _, branch in made.branches)
            found["at rest"] = self._made(self._at_rest(up, down))
        elif not made.memory:
            for k in self._jumps():
                found[self._rest_name(k)] = self._made(self._at_rest(*self._beside(k)))
        return found

    def _nested(self, branch: Branch) -> str:
        """The text of a whole branch, for a place that is not known beforehand."""
        text = self._value(branch.pieces[-1])
        for edge, piece in zip(reversed(branch.edges), reversed(branch.pieces[:-1]), strict=True):
            text = f"({self._value(piece)} if s.{self.x} < {python(edge, {})} else {text})"
        return text

    def _beside(self, k: int) -> tuple[str, str]:
        """The texts of F right and left of a break point."""
        left, right = (self._value(piece) for piece in self.made.rising.pieces[k : k + 2])
        return right, left

    def _at_rest(self, one: str, two: str) -> str:
        """The text of F at rest between two values."""
        if self.law is None:
            return f"(({one} + {two}) / 2)"
        return f"held({one}, {two}, law(t, s, p, {one})[1], law(t, s, p, {two})[1])"


def held(F_1: float, F_2: float, a_1: float, a_2: float) -> float:
    """The F between F_1 and F_2 that holds a body at rest, or at a mere turn what is nearest to it.

    Its acceleration is a_1 with F_1, a_2 with F_2, and linear between.
    """
    F = F_1 if a_1 == a_2 else F_1 - a_1 * (F_2 - F_1) / (a_2 - a_1)
    return min(max(F, min(F_1, F_2)), max(F_1, F_2))
