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
            way: [self._flow(piece) for piece in branch.pieces]
            for way, branch in ((1, made.rising), (-1, made.falling))
        }

    def _made(self, text: str) -> Callable:
        """A function of (t, s, p) from the text of what it returns."""
        return function(f"lambda t, s, p: {text}", law=self.law)

    def _value(self, piece: str) -> str:
        return f"({python(piece, {'x': f's.{self.x}'})})"

    def _flow(self, piece: str) -> str:
        return f"law(t, s, p, {self._value(piece)})"

    def _push(self, way: int, place: int) -> str:
        """The text of the acceleration on a piece."""
        return f"{self.rates[way][place]}[1]"

    def _edge(self, text: str) -> str:
        return python(text, {})

    def _name(self, way: int, place: int) -> str:
        if self.made.memory:
            return f"F = {self.made.rising.pieces[place]}"
        branch = self.made.rising if way > 0 else self.made.falling
        region = branch.region(place, self.x)
        if not self.made.hysteresis:
            return region
        return f"{'→' if way > 0 else '←'} {region}"

    def _rest(self, one: str, two: str) -> Callable:
        """The flow at rest: input and rate stand still, other states go on, with F in balance."""
        law = f"law(t, s, p, {self._balance(one, two)})"
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
        branch = self.made.rising if way > 0 else self.made.falling
        up = two > one
        return Transition(
            self._name(way, one),
            self._name(way, two),
            guard=self._made(f"s.{self.x} - ({self._edge(branch.edges[k])})"),
            direction=1 if up else -1,
            label=f"{'up' if up else 'down'} through {branch.edges[k]}",
            **more,
        )

    def _crossings(self, way: int) -> list[Transition]:
        """Over all break points of a branch, the way that it is gone."""
        count = len((self.made.rising if way > 0 else self.made.falling).edges)
        places = [(k, k + 1)[::way] for k in range(count)]
        return [self._crossing(way, k, *pair) for k, pair in enumerate(places)]

    def _one_branch(self) -> tuple[list[Mode], list[Transition], Callable]:
        branch, jumps = self.made.rising, self._jumps()
        modes = [
            Mode(self._name(1, k), self._made(text), meaning=f"F = {branch.pieces[k]}")
            for k, text in enumerate(self.rates[1])
        ]
        transitions = []
        for k, edge in enumerate(branch.edges):
            rest = self._rest_name(k)
            calm = {"zeno": rest} if k in jumps else {}
            transitions += [
                self._crossing(1, k, k, k + 1, **calm),
                self._crossing(1, k, k + 1, k, **calm),
            ]
            if k in jumps:
                flow = self._rest(*self._beside(k))
                modes.append(Mode(rest, flow, meaning="F lies within the jump"))
                on = {self.x: self._made(f"0.0 * s.{self.x} + ({self._edge(edge)})")}
                for place, way in ((k + 1, 1), (k, -1)):
                    transitions.append(
                        Transition(
                            rest,
                            self._name(1, place),
                            guard=self._made(self._push(1, place)),
                            direction=way,
                            reset=on,
                            label=f"leaves {edge} to the {'right' if way > 0 else 'left'}",
                        )
                    )
        push = [self._made(self._push(1, k)) for k in range(len(branch.pieces))]

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
        for way, branch in self.made.branches:
            count, names = len(branch.pieces), []
            for k in range(count):
                names.append(self._name(way, k))
                flow = self._made(self.rates[way][k])
                modes.append(Mode(names[-1], flow, meaning=f"F = {branch.pieces[k]}"))
            transitions += self._crossings(way)
            transitions.append(
                Transition(
                    tuple(names),
                    rest,
                    guard=self._made(f"s.{self.v}"),
                    direction=-way,
                    reset={self.v: 0.0},
                    label="stop",
                )
            )
            for k, name in enumerate(names):
                transitions.append(
                    Transition(
                        rest,
                        name,
                        guard=self._made(self._on_piece(way, k)),
                        direction=way,
                        label=f"off to the {'right' if way > 0 else 'left'}",
                    )
                )
        flow = self._rest(*(self._nested(branch) for _, branch in self.made.branches))
        modes.append(Mode(rest, flow, meaning="F lies within the loop"))
        push = {
            way: [self._made(self._push(way, k)) for k in range(len(branch.pieces))]
            for way, branch in self.made.branches
        }

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
        branch = self.made.rising if way > 0 else self.made.falling
        x, less = f"s.{self.x}", ("<=", "<") if way > 0 else ("<", "<=")
        low = f"{self._edge(branch.edges[k - 1])} {less[0]} {x}" if k else ""
        high = f"{x} {less[1]} {self._edge(branch.edges[k])}" if k < len(branch.edges) else ""
        where = " and ".join(filter(None, (low, high)))
        push = self._push(way, k)
        return f"({push} if {where} else {-float(way)})" if where else push

    def with_memory(self) -> tuple[list[Mode], list[Transition], Callable]:
        """The output changes at the break points only: modes are its values."""
        names = [self._name(1, k) for k in range(len(self.made.rising.pieces))]
        modes = [
            Mode(name, self._made(text)) for name, text in zip(names, self.rates[1], strict=True)
        ]
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
        made, value = self.made, self._value
        if made.memory:
            pieces = made.rising.pieces
            return {self._name(1, k): self._made(value(what)) for k, what in enumerate(pieces)}
        found = {
            self._name(way, k): self._made(value(piece))
            for way, branch in made.branches
            for k, piece in enumerate(branch.pieces)
        }
        if made.hysteresis:
            up, down = (self._nested(branch) for _, branch in made.branches)
            found["at rest"] = self._made(self._held(up, down))
        else:
            for k in self._jumps():
                found[self._rest_name(k)] = self._made(self._held(*self._beside(k)))
        return found

    def _nested(self, branch: Branch) -> str:
        """The text of a whole branch, for a place that is not known beforehand."""
        text = self._value(branch.pieces[-1])
        for edge, piece in zip(reversed(branch.edges), reversed(branch.pieces[:-1]), strict=True):
            text = f"({self._value(piece)} if s.{self.x} < {self._edge(edge)} else {text})"
        return text

    def _beside(self, k: int) -> tuple[str, str]:
        """The texts of F right and left of a break point."""
        left, right = (self._value(piece) for piece in self.made.rising.pieces[k : k + 2])
        return right, left

    def _held(self, one: str, two: str) -> str:
        """The text of F at rest: the balance, and at a mere turn what is nearest to it."""
        low, high = f"min({one}, {two})", f"max({one}, {two})"
        return f"min(max({self._balance(one, two)}, {low}), {high})"

    def _balance(self, one: str, two: str) -> str:
        """The text of the F at which the law, linear in F, has no acceleration."""
        if self.law is None:
            return f"(0.5 * ({one} + {two}))"
        law = "law(t, s, p, {})[1]"
        a, b = law.format(one), law.format(two)
        return f"({one} if {a} == {b} else {one} - {a} * ({two} - {one}) / ({b} - {a}))"
