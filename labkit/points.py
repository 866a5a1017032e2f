"""A characteristic whose break points a hand can drag: each is two parameters of the system.

mine = movable([(-0.9, -1), (-0.4, 0), (0.4, 0), (0.9, 1)])
own = mine.put_in(system, law, "N")
explore(own, 40.0, mine.draw("x"), sliders=["k3", "k4"])
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import asked
from .characteristics import Characteristic, Points, from_points
from .draw import COLORS, Handle, View, curves, figure, time_plot
from .model import ModelError, Parameter, System
from .switching import Law

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Movable", "movable"]

ROOM = 0.5  # how far beyond the points, in parts of their width, a hand may drag them


@asked
def movable(rising: Points, falling: Points | None = None, name: str = "my curve") -> Movable:
    """movable([(-0.9, -1), (0.9, 1)]) -> Movable, a Characteristic through points that move.

    rising, falling  as for `from_points`, numbers. The two points of a jump share their place x;
                     where there are two branches, their first points share F, and their last ones

    Raises ModelError as from_points.
    """
    plain = from_points(rising, falling, name)
    if plain.parameters:
        raise ModelError(
            f"points to drag are numbers, and not formulas of {sorted(plain.parameters)}"
        )
    curves = [[(float(x), float(F)) for x, F in curve] for curve in (rising, falling) if curve]
    made: dict[str, float] = {}
    named = []
    for way, curve in zip(("r", "l") if falling else ("",), curves, strict=True):
        points: list[tuple[str, str]] = []
        for k, (x, F) in enumerate(curve):
            end = "F_low" if k == 0 else "F_high" if k == len(curve) - 1 else ""
            level = end if falling and end else f"F{way}{k + 1}"
            place = points[-1][0] if k and curve[k - 1][0] == x else f"x{way}{k + 1}"
            points.append((place, level))
            made |= {place: x, level: F}
        named.append(points)
    return Movable(from_points(*named, name=name), named, made)  # type: ignore[arg-type]


class Movable(Characteristic):
    """What `movable` makes; mine.parameters are the names of its places.

    values     name -> where the points are at first
    points     for each branch, [(name of x, name of F)]
    box        ((x low, x high), (F low, F high)): as far as the points may go
    """

    def __init__(
        self,
        curve: Characteristic,
        points: Sequence[Sequence[tuple[str, str]]],
        values: dict[str, float],
    ):
        super().__init__(curve.name, curve.rising, curve.falling if curve.hysteresis else None)
        self.points, self.values = points, values
        found = np.array(
            [[values[name] for name in point] for branch in points for point in branch]
        )
        low, high = found.min(axis=0), found.max(axis=0)
        room = np.where(high > low, ROOM * (high - low), 1.0)
        self.box = tuple(map(tuple, np.transpose([low - room, high + room]).tolist()))

    @asked
    def put_in(self, system: System, law: Law, unit: str = "") -> System:
        """mine.put_in(system, law, "N") -> a variant with this curve and its output F.

        law and the first two states, input and rate, as for `modes`. What ends a run of the
        system ends one of the variant, from whatever piece of the curve. Raises ModelError where
        the system has a parameter that is called like a point.
        """
        if taken := sorted(set(self.values) & set(system.parameters)):
            raise ModelError(f"{system.name!r} has a parameter {taken[0]!r} of its own: rename it")
        states = tuple(system.units)[:2]
        units = {"x": system.unit(states[0]), "F": unit}
        made = self.modes(law, states)
        pieces = tuple(mode.name for mode in made["modes"])
        ends = [replace(tr, source=pieces) for tr in system.transitions if tr.target is None]
        made["transitions"] += ends
        meaning = f"of a point of {self.name}"
        made["parameters"] = {
            key: Parameter(value, units[key[0]], meaning, *self.box[key[0] == "F"])
            for key, value in self.values.items()
        }
        output = self.output(unit, law=law, states=states)
        return system.variant(self.name, **made, outputs={"F": output})

    @asked
    def draw(self, *names: str) -> Callable[[Run], list[View]]:
        """explore(system, horizon, mine.draw("x", "F")): the curve with its points, and the run.

        The points are dragged on the left; on the right are states or outputs over time. A point
        that goes past its neighbour is refused with the reason, and the picture stays.
        """

        def picture(run: Run) -> list[View]:
            system = run.system
            x, F = tuple(system.units)[0], system.outputs["F"]
            left, right = figure(1, 2, width=10, height=4.2, widths=[2, 3]).axes
            branches = {way: rf"$\dot {x} {'>' if way > 0 else '<'} 0$" for way, _ in self.branches}
            reach = max(abs(end) for end in self.box[0])

            def shape(run: Run) -> dict[str, Any]:
                lines = {way: self.curve(run.p, reach, way) for way in branches}
                found = {"as it is traced": (run[x], run["F"])}
                if len(branches) == 2:
                    found["_loop"] = tuple(np.concatenate(list(lines.values())).T)
                return found | {branches[way]: tuple(line.T) for way, line in lines.items()}

            styles = dict(zip(branches.values(), ("C0-", "C1--"), strict=False))
            styles |= {"as it is traced": {"color": "#C8C8C8", "lw": 6}}
            styles |= {"_loop": "fill"} if len(branches) == 2 else {}
            look = {"title": self.name, "legend": len(branches) == 2, "styles": styles}
            look |= dict(zip(("xlim", "ylim"), self.box, strict=True))
            look |= {"xlabel": f"${x}$ [{system.unit(x)}]"}
            look |= {"ylabel": f"$F$ [{F.unit}]" if F.unit else "$F$"}
            views = [
                curves(left, shape, **look),
                time_plot(run, names or x, axes=[right], modes=False, events=False, title=""),
            ]
            grips = {point: COLORS[k] for k, branch in enumerate(self.points) for point in branch}
            for k, (point, color) in enumerate(grips.items(), 1):
                how = {"values": self._dropped(*point), "color": color, "meaning": f"point {k}"}
                views.append(Handle(left, *point, **how))
            return views

        return picture

    def _dropped(self, place: str, level: str) -> Callable[[float, float], dict[str, float]]:
        """Where a point comes to lie: within the box, at a short number."""

        def values(x: float, F: float) -> dict[str, float]:
            found = {}
            for key, value, (low, high) in zip((place, level), (x, F), self.box, strict=True):
                digits = 2 - math.floor(math.log10(high - low))
                found[key] = min(max(round(value, digits) + 0.0, low), high)  # never −0
            return found

        return values
