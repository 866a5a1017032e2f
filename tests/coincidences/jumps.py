"""Jumps by schedules and by other transitions' resets that carry a guard beyond, put it back,
or undo a crossing at its very instant; urgent False, True and None. `reference.py` says what is
right.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from . import linear
from .linear import GUARDS, Case, expected, settled, shape
from .reference import Edge, Guard, Jump

METHODS = linear.METHODS
check = linear.check
__all__ = ["METHODS", "check", "expected", "generate"]


def draw(random, shapes: int) -> Case:
    """x moves slowly or rests, clocks throw it about; thresholds lie at whole numbers and their
    halves.
    """
    quarter = Fraction(1, 4)
    flows = tuple(
        (random.choice((0, 0, 1, -1, 2)) * quarter * 2, Fraction(random.randint(0, 1)))
        for _ in range(linear.MODES)
    )
    start = Fraction(random.randint(-2, 2), 4) + Fraction(1, 8), Fraction(0)
    edges = []
    for i, (sources, direction, jumps, priority) in enumerate(shape(random.randrange(shapes))):
        target = random.choice((*sources, *sources, random.randrange(linear.MODES)))
        shift = random.choice((-2, -1, 1, 2)) * Fraction(1, 2)
        edge = Edge(
            sources,
            target,
            jump=random.choice((Jump(hx=shift), Jump(hx=2 * shift))) if jumps else None,
            priority=priority,
        )
        if i < GUARDS:
            level = Fraction(random.randint(-3, 3), 2) + random.choice((0, 0, quarter / 2))
            urgent = random.choice((None, None, False, True if direction else None))
            k = random.choice((1, 1, -1, 2))
            guard = Guard(Fraction(k), Fraction(0), Fraction(0), k * level)
            edges.append(replace(edge, guard=guard, direction=direction, urgent=urgent))
        else:
            at = sorted(random.sample([Fraction(k, 4) for k in range(1, 13)], 2))
            if i == GUARDS:
                at = [at[0] + k * quarter * 3 for k in range(8)]
            edges.append(replace(edge, at=tuple(at[: 1 if i == GUARDS + 2 else None])))
    return Case(flows, tuple(edges), start, Fraction(33, 8))


def generate(random, shapes: int = linear.SHAPES) -> Case:
    """Of a case at least two events are by guards."""
    while True:
        case = draw(random, shapes)
        edges = settled(case)
        if edges and sum(e < GUARDS for e in edges) >= 2:
            return linear.in_units(case, random)
