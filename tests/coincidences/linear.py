"""Random systems of constant flows and linear guards, made so that things coincide: the same
guard twice, multiples of a guard, guards through one point of the path, clocks at those very
instants. `reference.py` says in fractions what is right.

A case is run in units of its own (0.1, 1/3, 9.81 …): then what coincides in fractions coincides in
floating-point numbers up to rounding only.
"""

from __future__ import annotations

import random as randoms
from collections import defaultdict
from dataclasses import dataclass, replace
from fractions import Fraction

from labkit import At, Every, Mode, System, Transition

from .findings import EPS, OTHER, UNITS, Complaint, close, compare, finished, run
from .reference import Edge, Guard, Jump, Story, Unclear

METHODS = ("RK4", "RK45", "DOP853")
MODES, GUARDS, CLOCKS = 3, 5, 3
SHAPES = 24  # what is compiled anew is the shape; everything else is a number
NEVER = 1e6

FLOWS = (
    lambda t, s, p: (p.u0, p.w0),
    lambda t, s, p: (p.u1, p.w1),
    lambda t, s, p: (p.u2, p.w2),
)
VALUES = (
    lambda t, s, p: p.a0 * s.x + p.b0 * s.y + p.c0 * t - p.d0,
    lambda t, s, p: p.a1 * s.x + p.b1 * s.y + p.c1 * t - p.d1,
    lambda t, s, p: p.a2 * s.x + p.b2 * s.y + p.c2 * t - p.d2,
    lambda t, s, p: p.a3 * s.x + p.b3 * s.y + p.c3 * t - p.d3,
    lambda t, s, p: p.a4 * s.x + p.b4 * s.y + p.c4 * t - p.d4,
)
JUMPS = (
    lambda t, s, p: (p.kx0 * s.x + p.hx0, p.ky0 * s.y + p.hy0),
    lambda t, s, p: (p.kx1 * s.x + p.hx1, p.ky1 * s.y + p.hy1),
    lambda t, s, p: (p.kx2 * s.x + p.hx2, p.ky2 * s.y + p.hy2),
    lambda t, s, p: (p.kx3 * s.x + p.hx3, p.ky3 * s.y + p.hy3),
    lambda t, s, p: (p.kx4 * s.x + p.hx4, p.ky4 * s.y + p.hy4),
    lambda t, s, p: (p.kx5 * s.x + p.hx5, p.ky5 * s.y + p.hy5),
    lambda t, s, p: (p.kx6 * s.x + p.hx6, p.ky6 * s.y + p.hy6),
    lambda t, s, p: (p.kx7 * s.x + p.hx7, p.ky7 * s.y + p.hy7),
)
SCHEDULES = (Every("period", "first"), At("one", "two"), At("three"))
NUMBERS = [f"{k}{m}" for m in range(MODES) for k in "uw"]
NUMBERS += [f"{k}{i}" for i in range(GUARDS) for k in "abcd"]
NUMBERS += [f"{k}{i}" for i in range(GUARDS + CLOCKS) for k in ("kx", "hx", "ky", "hy")]
NUMBERS += [f"delay{i}" for i in range(GUARDS)]
NUMBERS += ["period", "first", "one", "two", "three"]


@dataclass(frozen=True)
class Case:
    flows: tuple[tuple[Fraction, Fraction], ...]
    edges: tuple[Edge, ...]
    start: tuple[Fraction, Fraction]
    horizon: Fraction
    units: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of x, y, t
    sizes: tuple[float, ...] = (1.0,) * GUARDS  # what guards are multiplied by
    t0: float = 0.0

    def story(self) -> Story:
        return Story(list(self.flows), list(self.edges), 0, self.start).tell(self.horizon)

    def system(self) -> System:
        return System(
            "constant flows",
            {"x": "", "y": ""},
            {
                name: (1.0 if name[0] == "k" else NEVER if len(name) > 2 else 0.0)
                for name in NUMBERS
            },
            [Mode(f"m{k}", flow) for k, flow in enumerate(FLOWS)],
            [
                Transition(
                    tuple(f"m{k}" for k in edge.sources),
                    None if edge.target is None else f"m{edge.target}",
                    guard=VALUES[i] if edge.guard else None,
                    direction=edge.direction,
                    at=None if edge.guard else SCHEDULES[i - GUARDS],
                    reset=JUMPS[i] if edge.jump else None,
                    priority=edge.priority,
                    urgent=edge.urgent,
                    delay=f"delay{i}" if edge.delay else 0.0,
                    label=f"e{i}",
                )
                for i, edge in enumerate(self.edges)
            ],
            start={
                name: float(z) * unit
                for name, z, unit in zip("xy", self.start, self.units, strict=False)
            },
        )

    def parameters(self) -> dict[str, float]:
        values: dict[str, float] = {}
        (x, y, s), t0 = self.units, self.t0
        for m, (u, w) in enumerate(self.flows):
            values |= {f"u{m}": float(u) * x / s, f"w{m}": float(w) * y / s}
        for i, edge in enumerate(self.edges):
            if edge.guard:
                g, k = edge.guard, self.sizes[i]
                values |= {f"a{i}": float(g.a) * k / x, f"b{i}": float(g.b) * k / y}
                values |= {f"c{i}": float(g.c) * k / s}
                values[f"d{i}"] = float(g.d) * k + values[f"c{i}"] * t0
                values[f"delay{i}"] = float(edge.delay) * s
            if edge.jump:
                j = edge.jump
                values |= {f"kx{i}": float(j.kx), f"hx{i}": float(j.hx) * x}
                values |= {f"ky{i}": float(j.ky), f"hy{i}": float(j.hy) * y}
        every, twice, once = (edge.at for edge in self.edges[GUARDS:])
        instants = {"first": every[0], "period": every[1] - every[0]}
        instants |= {"one": twice[0], "two": twice[1], "three": once[0]}
        later = {name: 0.0 if name == "period" else t0 for name in instants}
        return values | {name: later[name] + float(t) * s for name, t in instants.items()}

    def __str__(self) -> str:
        edges = "; ".join(f"e{i} {edge}" for i, edge in enumerate(self.edges))
        told = f"flows {self.flows}, start {self.start}, to {self.horizon}, units {self.units}, "
        told += f"from {self.t0:g}, "
        return f"{told}guards times {self.sizes}: {edges}".replace("Fraction", "")


def shape(number: int) -> list[tuple[tuple[int, ...], int, bool, int]]:
    """(sources, direction, jumps or not, priority) of every slot."""
    random = randoms.Random(1000 + number)
    found = []
    for i in range(GUARDS + CLOCKS):
        sources = random.choice(((0,), (0,), (1,), (2,), (0, 1), (1, 2), (0, 1, 2)))
        direction = random.choice((1, 1, -1, -1, 0)) if i < GUARDS else 0
        found.append((sources, direction, random.random() < 0.5, random.choice((0, 0, 0, 1, 2))))
    return found


def half(random, most: int) -> Fraction:
    return Fraction(random.randint(-2 * most, 2 * most), 2)


def draw(random, shapes: int) -> Case:
    """A case, perhaps one in which the rules leave room."""
    places = [Fraction(random.randint(1, 12), 4) for _ in range(2)]
    flows = [(half(random, 2), half(random, 2)) for _ in range(MODES)]
    start = half(random, 2), half(random, 2)
    edges: list[Edge] = []
    for i, (sources, direction, jumps, priority) in enumerate(shape(random.randrange(shapes))):
        target = random.choice((*sources, random.randrange(MODES), random.randrange(MODES)))
        if random.random() < 0.04:
            target = None
        jump = None
        if jumps:
            jump = random.choice(
                (
                    Jump(hx=half(random, 2), hy=half(random, 1)),
                    Jump(hx=half(random, 3)),
                    Jump(kx=Fraction(-1)),
                    Jump(ky=Fraction(-1), hx=half(random, 1)),
                )
            )
        edge = Edge(sources, target, jump=jump, priority=priority)
        if i < GUARDS:
            urgent = random.choice((None, None, None, False, True if direction else None))
            delay = Fraction(random.randint(1, 4), 4) if random.random() < 0.1 else Fraction(0)
            edge = replace(edge, direction=direction, urgent=None if delay else urgent, delay=delay)
            edges.append(replace(edge, guard=draw_guard(random, edges, flows, start, places)))
        else:
            edges.append(replace(edge, at=draw_instants(random, i - GUARDS, places)))
    horizon = random.choice((*places, Fraction(4), Fraction(4), Fraction(33, 8)))
    return Case(tuple(flows), tuple(edges), start, horizon)


def draw_guard(random, edges, flows, start, places) -> Guard:
    """One like another before it, or through a point of the path at a chosen instant, or
    anywhere.
    """
    if edges and random.random() < 0.3:
        k = random.choice((Fraction(1), Fraction(2), Fraction(-1), Fraction(1, 2)))
        g = random.choice(edges).guard
        return Guard(k * g.a, k * g.b, k * g.c, k * g.d)
    a, b, c = (
        half(random, 2),
        half(random, 2),
        random.choice((Fraction(0), Fraction(0), Fraction(1))),
    )
    if random.random() < 0.1:
        a, b, c = Fraction(0), Fraction(0), Fraction(1)
    if random.random() < 0.6:
        t = random.choice(places)
        x, y = (z + u * t for z, u in zip(start, flows[0], strict=True))
        return Guard(a, b, c, a * x + b * y + c * t)
    return Guard(a, b, c, half(random, 3))


def draw_instants(random, which: int, places) -> tuple[Fraction, ...]:
    if which == 0:
        if random.random() < 0.5:
            return Fraction(int(NEVER)), Fraction(2 * int(NEVER))
        first, period = random.choice(places), random.choice((*places, Fraction(1), Fraction(2)))
        return tuple(first + k * period for k in range(int(5 / period) + 2))
    far = Fraction(int(NEVER))
    one, two = (random.choice((*places, far, half(random, 2) + Fraction(5, 2))) for _ in range(2))
    return tuple(sorted((one, two if two != one else far + 1)))[: 2 if which == 1 else 1]


def in_units(case: Case, random) -> Case:
    """The case in other units and later."""
    x, y, s = (random.choice(UNITS) for _ in range(3))
    sizes = tuple(random.choice((1.0, 0.1, 3.3, 1e-8 / 3, 1e9 / 7)) for _ in range(GUARDS))
    t0 = random.choice((0.0, 0.0, 1e3, 1e5 / 3))
    return replace(case, units=(x, y, s), sizes=sizes, t0=t0)


def settled(case: Case) -> list[int] | None:
    """The transitions of the case in order, or None where the rules leave room or nothing is
    told.
    """
    try:
        lines = case.story().lines
    except Unclear:
        return None
    times = [line.t for line in lines]
    apart = all(a == b or b - a > Fraction(1, 1000) for a, b in zip(times, times[1:], strict=False))
    return [line.edge for line in lines] if apart and 2 <= len(lines) <= 10 else None


def generate(random, shapes: int = SHAPES) -> Case:
    while True:
        case = draw(random, shapes)
        if settled(case) is not None:
            return in_units(case, random)


def expected(case: Case) -> int:
    return len(case.story().lines)


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    story, second = case.story(), case.units[2]
    options = {"t0": case.t0, "step": 0.0625 * second, **case.parameters()}
    end = case.t0 + float(case.horizon) * second
    done = run(case.system(), end, backend, method, **options)
    right, found = defaultdict(list), defaultdict(list)
    for line in story.lines:
        right[line.edge].append(case.t0 + float(line.t) * second)
    for event in done.events:
        found[event.index].append(event.t)
    off = 1e-9 + 1024 * EPS * case.t0 / second  # a guard that changes slowly beside the clock
    complaints = [] if story.over else finished(done)
    for e in sorted({*right, *found}):
        complaints += compare(found[e], right[e], off * second, f"e{e}")
    lines = [
        (line.edge, f"m{line.source}", None if line.target is None else f"m{line.target}")
        for line in story.lines
    ]
    ledger = [(event.index, event.source, event.target) for event in done.events]
    if not complaints and ledger != lines:
        complaints.append(Complaint(OTHER, f"ledger {ledger}, right {lines}"))
    final = {name: done.final[name] / u for name, u in zip("xy", case.units, strict=False)}
    x, y = map(float, story.state)
    return complaints + close(final, {"x": x, "y": y}, 8 * off)
