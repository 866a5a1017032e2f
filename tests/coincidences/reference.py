"""The rules of events, followed literally in exact arithmetic.

Flows are constant velocities in the plane, guards a·x + b·y + c·t − d, jumps x → k·x + h: so
every crossing is a fraction, and what coincides coincides exactly. Where the rules leave room,
`Unclear` is raised and the case is no case. The rules, as they are used here:

* A guard's side is the sign of its value, or of its rate where the value is zero; − where both
  are zero. It changes along the flow, by a jump, or on entering a mode.
* With a direction a guard (turned so that the event is the rise) fires when its side goes from
  − to +; without, whenever its side changes.
* All that is due at an instant (crossings, schedules, ends of dead times) fires by priority,
  then in the order of the list. What is pending is dropped when its mode is left or a jump has
  undone it, not by a flow that turns back what has just come.
* A crossing is used once: what has fired fires again at this instant only after some jump has
  put its guard back and a later one has carried it over again.
* A jump that carries a guard over is a crossing, except with urgent=False.
* On entering another mode, guards with a direction that are beyond, or at zero and moving
  beyond, fire once, except with urgent=False. One without direction that is zero after a change
  of mode without a jump has the far side of the arrival; a flow that turns it back crosses it
  at once.
* urgent=True fires whenever it is beyond.
* A dead time that has begun runs on; its transition fires if it then leaves the current mode.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

MOST_AT_ONCE, MOST = 12, 60
Pair = tuple[Fraction, Fraction]


class Unclear(Exception):
    """The rules do not say what happens here (or say that the run ends in words)."""


@dataclass(frozen=True)
class Jump:
    """x → kx·x + hx, y → ky·y + hy."""

    kx: Fraction = Fraction(1)
    hx: Fraction = Fraction(0)
    ky: Fraction = Fraction(1)
    hy: Fraction = Fraction(0)

    def __call__(self, state: Pair) -> Pair:
        return self.kx * state[0] + self.hx, self.ky * state[1] + self.hy


@dataclass(frozen=True)
class Guard:
    a: Fraction
    b: Fraction
    c: Fraction
    d: Fraction

    def value(self, t: Fraction, state: Pair) -> Fraction:
        return self.a * state[0] + self.b * state[1] + self.c * t - self.d

    def rate(self, flow: Pair) -> Fraction:
        return self.a * flow[0] + self.b * flow[1] + self.c


@dataclass(frozen=True)
class Edge:
    """A transition between numbered modes, by a guard or at instants."""

    sources: tuple[int, ...]
    target: int | None
    guard: Guard | None = None
    direction: int = 0
    at: tuple[Fraction, ...] = ()
    jump: Jump | None = None
    priority: int = 0
    urgent: bool | None = None
    delay: Fraction = Fraction(0)


@dataclass(frozen=True)
class Line:
    """One event."""

    t: Fraction
    edge: int
    source: int
    target: int | None


def sign(value: Fraction) -> int:
    return (value > 0) - (value < 0)


@dataclass
class Story:
    """Story(flows, edges, mode, state).tell(t_end) fills `lines`, and leaves t, mode and state."""

    flows: list[Pair]
    edges: list[Edge]
    mode: int
    state: Pair
    t: Fraction = Fraction(0)
    lines: list[Line] = field(default_factory=list)
    side: dict[int, int] = field(default_factory=dict)  # of the guards of the current mode
    queue: list[tuple[Fraction, int]] = field(default_factory=list)  # dead times under way
    over: bool = False

    # ------------------------------------------------------------ guards

    def turn(self, e: int) -> int:
        return self.edges[e].direction or 1

    def value(self, e: int) -> Fraction:
        return self.turn(e) * self.edges[e].guard.value(self.t, self.state)

    def rate(self, e: int) -> Fraction:
        return self.turn(e) * self.edges[e].guard.rate(self.flows[self.mode])

    def side_now(self, e: int) -> int:
        return sign(self.value(e)) or sign(self.rate(e)) or -1

    def directed(self, e: int) -> bool:
        return self.edges[e].direction != 0

    def watched(self, mode: int) -> list[int]:
        return [e for e, edge in enumerate(self.edges) if edge.guard and mode in edge.sources]

    def degenerate(self, e: int) -> bool:
        return self.value(e) == 0 == self.rate(e)

    # ------------------------------------------------------------ from instant to instant

    def begin(self) -> None:
        for e in self.watched(self.mode):
            self.side[e] = self.side_now(e)
            if self.value(e) == 0:
                raise Unclear("a start on a surface")
            if self.directed(e) and self.side[e] > 0 and self.edges[e].urgent is None:
                raise Unclear("a start beyond a guard is an error")

    def tell(self, t_end: Fraction) -> Story:
        self.begin()
        self.instant(set(), set())
        while not self.over:
            if len(self.lines) > MOST:
                raise Unclear("events without end: they may pile up")
            crossings = {
                e: self.t - self.value(e) / self.rate(e)
                for e, side in self.side.items()
                if self.rate(e) * side < 0
            }
            clocks = [t for edge in self.edges for t in edge.at if t > self.t]
            dues = [t for t, _ in self.queue]
            t = min([*crossings.values(), *clocks, *dues, t_end])
            flow = self.flows[self.mode]
            self.state = tuple(x + u * (t - self.t) for x, u in zip(self.state, flow, strict=True))
            self.t = t
            pending = set()
            for e, when in crossings.items():
                if when == t:
                    self.side[e] = -self.side[e]
                    if self.side[e] > 0 or not self.directed(e):
                        pending.add(e)
            self.instant(pending, {e for e, edge in enumerate(self.edges) if t in edge.at})
            if t == t_end:
                break
        return self

    # ------------------------------------------------------------ one instant

    def instant(self, pending: set[int], ticks: set[int]) -> None:
        self.pending, self.ticks = pending, ticks
        self.dues = [e for t, e in self.queue if t == self.t]
        self.queue = [(t, e) for t, e in self.queue if t > self.t]
        self.arrival, self.arrival_flow = self.mode, self.flows[self.mode]
        self.used: set[int] = set()
        self.jumped = self.begun = False
        self.visited, self.by_guard = [self.mode], False
        for _ in range(MOST_AT_ONCE):
            choice = self.next_one()
            if choice is None:
                return
            how, e = choice
            if how == "guard" and self.edges[e].delay:
                self.pending.discard(e)
                self.used.add(e)
                self.begun = True
                self.queue.append((self.t + self.edges[e].delay, e))
                if len(self.visited) > 1:
                    raise Unclear("a dead time begins while the mode changes")
                continue
            self.fire(how, e)
            if self.over:
                return
        raise Unclear("too much at one instant")

    def next_one(self) -> tuple[str, int] | None:
        """What fires next: ("guard", "tick" or "due", edge)."""
        mode, found = self.mode, []
        found += [("guard", e) for e in self.pending]
        for e in self.watched(mode):
            if self.edges[e].urgent and self.side[e] > 0 and e not in self.pending:
                found.append(("guard", e))
        found += [("tick", e) for e in self.ticks if mode in self.edges[e].sources]
        found += [("due", e) for e in self.dues if mode in self.edges[e].sources]
        if len({e for _, e in found}) < len(found):
            raise Unclear("one transition is due and crosses at once")
        return min(found, key=lambda it: (-self.edges[it[1]].priority, it[1]), default=None)

    def fire(self, how: str, e: int) -> None:
        edge, source = self.edges[e], self.mode
        if how == "tick":
            self.use_tick(e)
        elif how == "due":
            self.dues.remove(e)
        else:
            self.pending.discard(e)
            self.used.add(e)
        self.lines.append(Line(self.t, e, source, edge.target))
        if edge.target is None:
            self.over = True
            return
        before = self.state
        if edge.jump:
            self.state = edge.jump(self.state)
        self.mode = edge.target
        if edge.target == source:
            if edge.jump:
                self.jumped = True
                self.stay(e if how == "guard" else None)
            return
        if self.begun:
            raise Unclear("a dead time begins while the mode changes")
        self.by_guard |= how == "guard"
        if edge.target in self.visited and self.by_guard:
            raise Unclear("back at one instant: sliding, or a loop")
        self.visited.append(edge.target)
        if edge.jump and before == self.state:
            raise Unclear("a reset that changes nothing: a jump or none?")
        self.jumped |= edge.jump is not None
        self.arrive(e if how == "guard" else None, edge.jump is not None)

    def use_tick(self, e: int) -> None:
        """Transitions with equal instants are one clock: of them one fires that leaves the mode
        of arrival.
        """
        clock = [q for q in self.ticks if self.edges[q].at == self.edges[e].at]
        leaving = [q for q in clock if self.arrival in self.edges[q].sources]
        if len(clock) > 1 and (len(leaving) > 1 or e not in leaving):
            raise Unclear("one clock, two transitions")
        self.ticks -= set(clock)

    # ------------------------------------------------------------ after jumps and changes of mode

    def stay(self, fired: int | None) -> None:
        """Sides after a jump within a mode."""
        for e in self.watched(self.mode):
            old, new = self.side[e], self.side_now(e)
            if new == old:
                continue
            if self.degenerate(e) and not self.directed(e):
                raise Unclear("a guard without direction that rests on its surface")
            self.side[e] = new
            if e in self.pending:
                if new < 0 or not self.directed(e):  # undone
                    self.pending.discard(e)
            elif e in self.used:
                if not self.directed(e) and e != fired:
                    raise Unclear("put back, or a crossing the other way?")
                self.used.discard(e)  # put back; if it is carried over once more it fires again
            elif (new > 0 or not self.directed(e)) and self.edges[e].urgent is not False:
                self.pending.add(e)

    def arrive(self, fired: int | None, jump: bool) -> None:
        """Sides and pending guards after a change of mode."""
        waiting, known, self.pending, self.side = self.pending, self.side, set(), {}
        for e in self.watched(self.mode):
            if self.degenerate(e) and not self.directed(e):
                raise Unclear("a guard without direction that rests on its surface")
            if e in waiting and self.value(e) == 0 and not jump:
                self.side[e] = self.side_now(e)
                self.pending.add(e)
                continue
            if self.directed(e):
                self.side[e] = self.side_now(e)
                self.arrive_directed(e, e == fired, e in waiting)
                continue
            if self.value(e) != 0:
                self.side[e] = sign(self.value(e))
                if e in waiting or e in self.used or known.get(e, self.side[e]) != self.side[e]:
                    raise Unclear("a guard without direction that is carried into another mode")
                continue
            if e in known or e in self.used or (self.jumped and not jump):
                raise Unclear("a guard without direction that is carried into another mode")
            if jump:
                self.side[e] = self.side_now(e)
                continue
            far = sign(self.edges[e].guard.rate(self.arrival_flow))
            if far == 0:
                raise Unclear("an arrival along a surface")
            self.side[e] = sign(self.rate(e))
            if self.side[e] != far:
                self.pending.add(e)

    def arrive_directed(self, e: int, fired: bool, waiting: bool) -> None:
        new = self.side[e]
        if waiting and new < 0 and self.value(e) == 0:
            raise Unclear("a crossing that the new flow turns back")
        if new < 0:
            self.used.discard(e)
        elif fired:
            if self.edges[e].urgent:
                raise Unclear("used once, or urgent again?")
        elif e in self.used:
            raise Unclear("used in another mode")
        elif self.edges[e].urgent is False:
            if waiting:
                raise Unclear("a crossing that waits in another mode")
        elif self.edges[e].delay:
            raise Unclear("a dead time on entering")
        else:
            self.pending.add(e)
