"""A run that is cut in two and goes on from run.final is the whole run: each event exactly
once, also those at the very seam, be it an impact, a dose, a tick, a switch or a state that
slides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from labkit import At, Every, Mode, System, Transition

from .findings import OTHER, Complaint, close, compare, finished, run

METHODS = ("RK45", "DOP853")
HORIZON = 6.0


@cache
def systems() -> dict[str, System]:
    return {
        "ball": System(
            "elastic ball",
            {"y": "m", "v": "m/s"},
            {"H": 0.0},
            [Mode("flight", lambda t, s, p: (s.v, -10.0))],
            [
                Transition(
                    "flight",
                    "flight",
                    guard=lambda t, s, p: s.y - p.H,
                    direction=-1,
                    reset=lambda t, s, p: (p.H, -s.v),
                )
            ],
            start={"y": 1.25, "v": 0.0},
        ),
        "tank": System(
            "doses and ticks",
            {"n": "", "k": ""},
            {"T": 1.0, "one": 2.0, "two": 3.5},
            [Mode("only", lambda t, s, p: (-0.1 * s.n, 0.0))],
            [
                Transition(
                    "only", "only", at=At("one", "two"), reset=lambda t, s, p: (s.n + 1, s.k)
                ),
                Transition("only", "only", at=Every("T"), reset=lambda t, s, p: (s.n, s.k + 1)),
            ],
            start={"n": 0.0, "k": 0.0},
        ),
        "heater": System(
            "two-point control",
            {"T": "", "n": ""},
            {"low": 4.5, "high": 5.5},
            [
                Mode("on", lambda t, s, p: (10.0 - s.T, 0.0)),
                Mode("off", lambda t, s, p: (-s.T, 0.0)),
            ],
            [
                Transition("on", "off", guard=lambda t, s, p: s.T - p.high, direction=1),
                Transition("off", "on", guard=lambda t, s, p: s.T - p.low, direction=-1),
            ],
            start={"T": 0.0, "n": 0.0},
        ),
        "counter": System(
            "levels passed",
            {"x": "", "up": "", "both": "", "clock": ""},
            {"one": 1.0, "two": 2.0},
            [Mode("only", lambda t, s, p: (1.0, 0.0, 0.0, 0.0))],
            [
                Transition(
                    "only",
                    "only",
                    guard=lambda t, s, p: s.x - p.one,
                    direction=1,
                    urgent=False,
                    reset=lambda t, s, p: (s.x, s.up + 1, s.both, s.clock),
                ),
                Transition(
                    "only",
                    "only",
                    guard=lambda t, s, p: s.x - p.two,
                    urgent=False,
                    reset=lambda t, s, p: (s.x, s.up, s.both + 1, s.clock),
                ),
                Transition(
                    "only",
                    "only",
                    guard=lambda t, s, p: t - p.two,
                    direction=1,
                    urgent=False,
                    reset=lambda t, s, p: (s.x, s.up, s.both, s.clock + 1),
                ),
            ],
            start={"x": 0.0, "up": 0.0, "both": 0.0, "clock": 0.0},
        ),
        "slide": System(
            "two fields",
            {"x": "", "z": ""},
            {"back": 2.0},
            [
                Mode("A", lambda t, s, p: (1.0, 1.0)),
                Mode("B", lambda t, s, p: (t - p.back, -1.0)),
            ],
            [
                Transition("A", "B", guard=lambda t, s, p: s.x, direction=1),
                Transition("B", "A", guard=lambda t, s, p: s.x, direction=-1),
            ],
            start={"x": -0.5, "z": 0.0},
        ),
    }


@dataclass(frozen=True)
class Case:
    name: str
    seams: tuple[float, ...]
    shift: float = 0.0  # height of the floor


def switches() -> list[float]:
    """Of the heater from 0 with 10 above: closed forms."""
    t, times = math.log(10 / 4.5), []
    while t <= HORIZON:
        times.append(t)
        t += math.log(
            5.5 / 4.5
        )  # cooling and heating last equally long, by the symmetry of the levels
    return times


def events(case: Case) -> list[float]:
    """The instants of the whole run. The slide begins at 1/2 and ends where B no longer pushes
    back.
    """
    return {
        "ball": [0.5 + k for k in range(6)],
        "tank": [1.0, 2.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0],
        "heater": switches(),
        "counter": [1.0, 2.0, 2.0],
        "slide": [0.5, 2.0],
    }[case.name]


def final(case: Case) -> dict[str, float]:
    if case.name == "ball":
        return {"y": case.shift + 1.25, "v": 0.0}
    if case.name == "tank":
        return {"n": math.exp(-0.4) + math.exp(-0.25), "k": 6.0}
    if case.name == "counter":
        return {"x": HORIZON, "up": 1.0, "both": 1.0, "clock": 1.0}
    if case.name == "heater":
        times = switches()
        rest = math.exp(times[-1] - HORIZON)
        return {"T": 5.5 * rest if len(times) % 2 else 10 - 5.5 * rest}
    # A pushes with 1, B with t − 2: z' = 1 − 2λ with λ = 1/(3 − t)
    return {"x": (HORIZON - 2.0) ** 2 / 2, "z": 0.5 + 1.5 - 2 * math.log(2.5) - (HORIZON - 2)}


def generate(random) -> Case:
    case = Case(random.choice(("ball", "tank", "heater", "counter", "slide")), ())
    shift = random.choice((0.0, 0.0, 1.0, -3.0, 100.0)) if case.name == "ball" else 0.0
    seams = set()
    for _ in range(random.randint(1, 3)):
        at_event = [t for t in events(case) if t < HORIZON]
        seams.add(random.choice((*at_event, round(random.uniform(0.1, 5.9), 2))))
    return Case(case.name, tuple(sorted(seams)), shift)


def expected(case: Case) -> int:
    return len(events(case))


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    """Seams at events are put where the whole run has them, to the last bit."""
    system = systems()[case.name]
    options = {"rtol": 1e-10, "atol": 1e-12}
    start = dict(system.start)
    if case.name == "ball":
        options["H"] = case.shift
        start["y"] += case.shift
    whole = run(system, HORIZON, backend, method, start=start, **options)
    here = [e.t for e in whole.events]
    seams = [
        min([s, *here], key=lambda t, s=s: (abs(t - s) > 1e-6, abs(t - s))) for s in case.seams
    ]
    t, mode, found, complaints = 0.0, None, [], finished(whole)
    for seam in [*sorted(set(seams)), HORIZON]:
        done = run(system, seam, backend, method, t0=t, start=start, mode=mode, **options)
        complaints += finished(done)
        lines = [e.t for e in done.events]
        if case.name == "slide" and 0.505 < t < 1.995:  # it may say once more that it slides
            lines = [e for e in lines if e > t + 1e-9]
        found += lines
        t, start, mode = seam, done.final, done.mode[-1]
    exact = events(case)
    if case.name == "slide":
        found, here = sorted({round(e, 9) for e in found}), sorted({round(e, 9) for e in here})
    complaints += compare(here, exact, 1e-7, "event of the whole run")
    complaints += compare(found, exact, 1e-7, "event of the cut run")
    if not complaints:
        complaints += close(done.final, final(case), 1e-6)
        complaints += close(whole.final, final(case), 1e-6)
        if done.mode[-1] != whole.mode[-1]:
            text = f"ends in {done.mode[-1]!r}, uncut in {whole.mode[-1]!r}"
            complaints.append(Complaint(OTHER, text))
    return complaints
