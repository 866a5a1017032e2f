"""One instant: everything that happens at it, one transition after the other.

At an instant some guards have crossed (w.wait), some schedules and dead times are due. The
transition of highest priority acts, then sides are taken again, until nobody waits any more. Each
crossing is used once; `sides` says who waits.
"""

from .layout import *
from .leaving import shaken
from .rounding import CLEAR, TICKS, know_flow, straight
from .sides import leaves, sides
from .sliding import back_to_surface, begin_sliding, guard_place, mixing, rates
from .step import sized


def room(w):
    """How many more samples of the grid there is room for.

    Four are kept for the two sides of events and the last state.
    """
    return w.room[ROOM_OUT] - w.i[OUT] - 4


def record(model, w, p, t, mode, n, y):
    """One sample, unless it is the last one again."""
    row, jump = w.i[OUT], w.i[JUMP]
    if row == w.i[OUT_FROM] or w.out[row - 1][0] != t or w.out[row - 1][2] != jump:
        append(model, w, p, t, mode, n, y)


def append(model, w, p, t, mode, n, y):
    """… a sample of which that is clear."""
    i, out = w.i, w.out[w.i[OUT]]
    out[0], out[1], out[2], out[3], out[4] = t, mode, i[JUMP], -1.0, 0.0
    if i[SLIDING] == 1:
        out[3], out[4] = i[SLIDE_B], mixing(model, w, p, n, t, y)
    for k in range(n):
        out[5 + k] = y[k]
    if i[HELD] > 0:
        for k in range(i[WIDTH], i[WIDTH] + i[HELD]):
            out[5 + k] = y[k]
    i[OUT] += 1


def keep_piece(w, t, h, mode, n):
    if w.i[DENSE] == 1:
        piece, width, place = w.pieces[w.i[PIECES]], w.i[WIDTH], 4
        piece[0], piece[1], piece[2] = t, h, mode
        piece[3] = w.i[SLIDE_B] if w.i[SLIDING] == 1 else -1.0
        for d in range(w.i[DEGREE] + 1):
            power = w.poly[d]
            for i in range(n):
                piece[place + i] = power[i]
            place += width
        for i in range(w.i[HELD]):
            piece[place + i] = w.y[width + i]
        w.i[PIECES] += 1


def write_down(w, place, n, y):
    """A state into a line of the ledger: before an event (place 0) or after it (1)."""
    line, width = w.ledger[w.i[LEDGER]], w.i[WIDTH] + w.i[HELD]
    first = 5 + place * width
    for i in range(n):
        line[first + i] = y[i]
    for i in range(w.i[WIDTH], width):
        line[first + i] = y[i]


def leave(model, w, p, mode, source, n, transition):
    """The sample before an event, and the left half of the ledger's line."""
    t = w.f[T]
    record(model, w, p, t, mode, n, w.y)
    line = w.ledger[w.i[LEDGER]]
    line[0], line[1], line[2], line[3] = t, transition, w.i[JUMP], source
    write_down(w, 0, n, w.y)
    w.i[WHO] = transition


def enter(model, w, p, mode, target, n):
    """The right half of the ledger's line for the state in w.y, the mode, and the sample after the
    event.
    """
    i = w.i
    write_down(w, 1, n, w.y)
    w.ledger[i[LEDGER]][4] = target
    i[LEDGER] += 1
    i[JUMP] += 1
    i[MODE] = mode
    i[KNOWN], i[FRESH], i[ENTRY], i[BUSY] = 0, 1, 1, 1
    i[SAME] = i[SAME] + 1 if w.f[T] == w.f[EVENT_T] else 1
    gap = w.f[T] - w.f[EVENT_T]
    if gap > 0.0:
        if i[ADAPTIVE] == 1:  # in a step over many events a guard is seen too coarsely
            w.f[H] = min(w.f[H], 16.0 * max(gap, 0.01 * w.f[GAP]))
        w.f[GAP] = gap
    w.f[EVENT_T] = w.f[T]
    record(model, w, p, w.f[T], mode, n, w.y)


def carry(w):
    """Held variables stand beside every state that the model's functions are called with."""
    for i in range(w.i[WIDTH], w.i[WIDTH] + w.i[HELD]):
        w.y_new[i], w.y_try[i] = w.y[i], w.y[i]
        w.y_look[i], w.y_shake[i], w.y_probe[i] = w.y[i], w.y[i], w.y[i]


def arrive(model, w, p):
    """At an instant.

    What has crossed (w.came, and what else is on its surface), and until when schedules count as
    due.
    """
    i, f = w.i, w.f
    f[UNTIL] = f[T] + TICKS * EPS * abs(f[T])
    i[BUSY], i[ENTRY] = 1, 1
    i[BY_FLOW] = i[MODE] if i[SLIDING] == 0 else -1
    return sides(model, w, p, ARRIVE, -9)


def choose(w):
    """The transition that acts next, and why (w.i[KIND]).

    The ends of sliding (−1, −2) last; −9 if there is none.
    """
    best, rank, i = -9, w.i[TRANSITIONS], w.i
    mode = i[MODE]
    for s in range(i[SCHEDULES]):
        q = w.plan[s]
        if w.rank[q] < rank and w.plan_t[s] <= w.f[UNTIL] and leaves(w, q, mode):
            # Transitions with an equal schedule are one clock: those act that leave the mode in
            # which it struck
            found = w.found[w.clock[s]]
            if found < 0 or w.source[q][found] == 1:
                best, rank, i[KIND] = q, w.rank[q], DUE
    for place in range(i[PENDING]):
        q = w.queue[place]
        if w.rank[q] < rank and w.queue_t[place] <= w.f[UNTIL] and leaves(w, q, mode):
            best, rank, i[KIND] = q, w.rank[q], LATE
    for q in range(i[TRANSITIONS]):
        if w.wait[q + 2] == 1 and w.rank[q] < rank:
            best, rank, i[KIND] = q, w.rank[q], CROSSED
    if best == -9 and i[SLIDING] == 1:
        for end in range(-2, 0):
            if w.wait[end + 2] == 1:
                best, i[KIND] = end, CROSSED
    return best


def use(w, q):
    """Its crossing, its instant or its dead time is used."""
    i = w.i
    if i[KIND] == CROSSED:
        w.wait[q + 2] = 0
        w.came[q + 2] = 2 if w.came[q + 2] == 1 else 3
    elif i[KIND] == DUE:
        for s in range(i[SCHEDULES]):
            if w.plan[s] == q:
                strike(w, s, w.plan_next[s] + 1)
                if w.found[w.clock[s]] < 0:
                    w.found[w.clock[s]] = i[MODE]
    else:
        for place in range(i[PENDING]):
            if w.queue[place] == q and w.queue_t[place] <= w.f[UNTIL]:
                drop(w, place)
                break


def drop(w, place):
    """Takes a dead time off the queue."""
    w.i[PENDING] -= 1
    for later in range(place, w.i[PENDING]):
        w.queue[later], w.queue_t[later] = w.queue[later + 1], w.queue_t[later + 1]


def forget(w):
    """The instant is over: what was due and leaves another mode is dropped."""
    w.i[BUSY], w.f[BLUR] = 0, 0.0
    while w.i[KINK] < w.i[KINKS] and w.kink[w.i[KINK]] <= w.f[UNTIL]:
        w.i[KINK] += 1
    for s in range(w.i[SCHEDULES]):
        while w.plan_t[s] <= w.f[UNTIL]:
            strike(w, s, w.plan_next[s] + 1)
        w.found[s] = -1
    for place in range(w.i[PENDING] - 1, -1, -1):
        if w.queue_t[place] <= w.f[UNTIL]:
            drop(w, place)
    for slot in range(w.i[TRANSITIONS] + 2):
        w.came[slot] = 0


def happen(model, w, p, q):
    """Transition q, or an end of sliding, acts now. PAUSE, or why the run ends."""
    i, t = w.i, w.f[T]
    use(w, q)
    if q < 0:
        return stop_sliding(model, w, p, i[SLIDE_A] if q == -1 else i[SLIDE_B])
    if i[KIND] == CROSSED and w.delay[i[LANE]][q] > 0.0:  # its dead time begins
        if i[PENDING] >= QUEUE:
            i[WHO] = q
            return QUEUE_FULL
        w.queue_t[i[PENDING]], w.queue[i[PENDING]] = t + w.delay[i[LANE]][q], q
        i[PENDING] += 1
        return PAUSE
    slides = begin_sliding(model, w, p, q) if i[KIND] == CROSSED else 0
    if slides == 1:
        return start_sliding(model, w, p)
    if slides == 2:
        i[WHO] = q
        return LOOP
    return fire(model, w, p, q)


def start_sliding(model, w, p):
    i = w.i
    n, surface = w.size[i[SLIDE_A]], w.leave[w.leave_from[i[SLIDE_A]] + i[GUARD_A]]
    carry(w)  # the reset that was only tried may have changed held variables
    i[SLIDING] = 0
    leave(model, w, p, i[SLIDE_B], i[SLIDE_B], n, surface)
    i[SLIDING] = 1
    enter(model, w, p, i[SLIDE_A], SLIDE, n)
    for slot in range(2):
        w.side[slot], w.scale[slot], w.wait[slot], w.flat[slot] = -1, 0.0, 0, 0
    return settled(model, w, p, surface)


def stop_sliding(model, w, p, mode):
    """Over to the mode whose flow no longer pushes.

    Its guard on the surface is on the near side, by that very push.
    """
    i = w.i
    n, surface = w.size[i[SLIDE_A]], w.leave[w.leave_from[i[SLIDE_A]] + i[GUARD_A]]
    place = i[GUARD_A] if mode == i[SLIDE_A] else i[GUARD_B]
    back = w.leave[w.leave_from[mode] + place]
    leave(model, w, p, i[SLIDE_A], SLIDE, n, surface)
    i[SLIDING] = 0
    enter(model, w, p, mode, mode, n)
    guards(model, mode, w.f[T], w.y, p, w.g_probe)
    w.slack[back + 2] = abs(w.g_probe[place])  # it is on the surface, whatever the value
    status = sides(model, w, p, ENTERED, back)
    w.wait[back + 2], w.side[back + 2] = 0, -1
    if w.directed[back] == 0:  # the other flow pushed to the side on which this mode lives
        other = i[SLIDE_B] if mode == i[SLIDE_A] else i[SLIDE_A]
        flow(model, other, w.f[T], w.y, p, w.ahead[1])
        i[FLOWS] += 1
        straight(model, w, p, mode, n, w.f[T], w.y, w.ahead[1], w.f[PROBE], w.g_away)
        if w.g_away[place] > 0.0:
            w.side[back + 2] = 1
    return status


def settled(model, w, p, surface):
    """Sides once sliding has begun: who waited waits on, and nobody else."""
    for slot in range(2, w.i[TRANSITIONS] + 2):
        if not leaves(w, slot - 2, w.i[MODE]):
            w.wait[slot] = 0
    return sides(model, w, p, JUMPED_TO, surface)


def fire(model, w, p, q):
    """The transition at the current time and state."""
    i = w.i
    mode = i[MODE]
    if i[SLIDING] == 1:  # from the one of the two modes that it leaves
        leave(model, w, p, mode, mode, w.size[mode], q)
        i[SLIDING] = 0
        for end in range(2):  # seen from within either mode the surface has not been crossed
            here = i[SLIDE_A] if end == 0 else i[SLIDE_B]
            slot = w.leave[w.leave_from[here] + (i[GUARD_A] if end == 0 else i[GUARD_B])] + 2
            w.side[slot] = -w.side[slot]
        if w.source[q][mode] == 0:
            mode = i[SLIDE_B]
            w.ledger[i[LEDGER]][3] = mode
        i[MODE] = mode
    else:
        leave(model, w, p, mode, mode, w.size[mode], q)
    n, target = w.size[mode], w.target[q]
    if target < 0:
        write_down(w, 1, n, w.y)
        w.ledger[i[LEDGER]][4] = -1
        i[LEDGER] += 1
        return TERMINAL
    size = w.size[target]
    reset(model, q, mode, w.f[T], w.y, p, w.y_new)
    same = w.family[mode] == w.family[target]
    for k in range(size):
        before, after = w.y[k], w.y_new[k]
        if not same:
            w.y[k], w.most[k], w.speed[k], w.lost[k], w.made[k] = after, 0.0, 0.0, 0.0, 0.0
        elif after != before:
            if abs(after - before) > 0.5 * w.most[k]:
                w.most[k] = 0.0  # it has the size that it has now
            w.y[k], w.lost[k] = after, 0.0
            make(w, k, before)
    for k in range(i[WIDTH], i[WIDTH] + i[HELD]):
        before = w.y[k]
        if w.y_new[k] != before:  # guards may have another size now
            for slot in range(i[TRANSITIONS] + 2):
                w.scale[slot], w.swing[slot], w.grain[slot], w.grains[slot] = 0.0, 0.0, 0.0, 0
            w.y[k] = w.y_new[k]
            make(w, k, before)
    carry(w)
    sized(w, target, size)
    enter(model, w, p, target, target, size)
    if same:
        stands_still(model, w, p, size)
    own = q if i[KIND] == CROSSED or mode != target else -9
    status = sides(model, w, p, JUMPED_TO if mode == target else ENTERED, own)
    if status != PAUSE and status != CONTACT:
        return status
    if i[KIND] == CROSSED:
        flight(w, q)
    if status == CONTACT:
        status = pile_up(model, w, p, q, True)
    elif w.few[q] > 3 + i[TRANSITIONS]:
        status = pile_up(model, w, p, q, False)
    elif i[SAME] > 5000 + 10 * i[TRANSITIONS] * i[TRANSITIONS]:
        status = pile_up(model, w, p, q, False) if w.shorter[q] >= 3 else LOOP
    grow_old(w, q, size)
    return status


def make(w, k, before):
    """A reset has changed a state: what it makes small has the rounding of what it was before."""
    size, after = max(abs(before), w.made[k]), abs(w.y[k])
    w.made[k] = 0.0
    if 0.0 < after < 0.125 * size:
        w.made[k], w.i[MADE] = size, 1


def stands_still(model, w, p, n):
    """After an event: a state that came fast and stands still from here on is known as well as the
    clock was when it came, to some ticks.
    """
    i, t = w.i, w.f[T]
    know_flow(model, w, p)
    for k in range(n):
        if abs(w.speed[k]) > 1e4 * abs(w.k[0][k]):
            size, clock = max(abs(w.y[k]), w.made[k]), 0.125 * abs(t * w.speed[k])
            if 0.0 < size < clock:
                w.made[k], i[MADE] = clock, 1
    if i[MADE] == 1:
        for slot in range(i[TRANSITIONS] + 2):
            w.scale[slot] = 0.0


def flight(w, q):
    """How long since the transition's last event.

    Whether flights shrink, and how many in a row are beyond the clock.
    """
    t = w.f[T]
    gap = t - w.last_t[q]
    if gap <= 0.0:
        return
    anchor = w.anchor[q]
    if gap < 0.9999 * w.last_gap[q] + 4.0 * EPS * abs(t):  # as far as the clock can tell
        w.shorter[q] += 1
        anchor[1] += 1.0
        anchor[3] += 1.0
        if (
            gap < 1e-3 * anchor[2]
        ):  # the ratio of flights is taken over at least three decades, where there are
            anchor[0], anchor[1], anchor[2], anchor[3] = anchor[2], anchor[3], gap, 0.0
    else:
        w.shorter[q] = 0
        anchor[0], anchor[1], anchor[2], anchor[3] = gap, 0.0, gap, 0.0
    w.few[q] = w.few[q] + 1 if gap <= 64.0 * EPS * max(abs(t), abs(w.f[BEFORE])) else 0
    w.last_gap[q] = gap


def grow_old(w, q, size):
    w.last_t[q] = w.f[T]
    for k in range(size):
        w.last_move[q][k] = w.y[k] - w.last_y[q][k]
        w.last_y[q][k] = w.y[k]


def pile_up(model, w, p, q, touching):
    """Flights that cannot be resolved any more: over to the mode of rest, at the instant and the
    state they tend to.

    Flights that shrink by the ratio r add up to gap·r/(1 − r) after the last one. States that move
    by r times less from flight to flight go on to s + (s − s_before)·r/(1 − r) (Aitken), the others
    along the flow. touching: the last flight has ended in contact; that is a pile only if the next
    one, by its ratio, could not have been told from rest, else an impact that has taken all speed.
    """
    i, f = w.i, w.f
    t, mode, gap = f[T], i[MODE], w.last_gap[q]
    n, more, factor, ratio = w.size[mode], 0.0, 0.0, 0.0
    zeno = w.shorter[q] >= 2 and w.anchor[q][1] > 0.0
    if zeno:
        ratio = (gap / w.anchor[q][0]) ** (1.0 / w.anchor[q][1])
        if touching:
            height = ratio * ratio * halfway(model, w, p, q)
            short = gap * ratio <= 512.0 * EPS * max(abs(t), abs(f[BEFORE]))
            zeno = short or height <= 8.0 * CLEAR * f[BAND]
    if zeno:
        factor = ratio / (1.0 - ratio)
        more = gap * factor
    f[ZENO_T] = t + more
    i[WHO] = q
    rest = w.zeno[q]
    if rest < 0:
        return ZENO if zeno else CONTACT
    limit = min(next_due(w), f[T_END])
    if t + more > limit:
        more, factor = max(0.0, limit - t), 0.0
    if t + more > t:
        know_flow(model, w, p)
        guards(model, rest, t, w.y, p, w.g_ahead)
        for k in range(n):
            step = w.y[k] - w.last_y[q][k]
            move = w.last_move[q][k]
            if abs(step - ratio * move) <= 0.1 * (1.0 - ratio) * abs(move):
                step *= factor
            else:
                step = more * w.k[0][k]
            w.poly[0][k], w.poly[1][k] = w.y[k], step
            for d in range(2, i[DEGREE] + 1):
                w.poly[d][k] = 0.0
            w.y[k] += step
        keep_piece(w, t, more, mode, n)
        f[T] = t + more
        if w.leap[q + 2] < 1:  # a straight line leaves a surface that is accelerated
            k = guard_place(w, mode, q)
            for _ in range(16):  # also where the guard has no slope
                if back_to_surface(model, w, p, mode, k, n, t + more, w.y) == 0:
                    break
        for slot in range(i[TRANSITIONS] + 2):
            w.came[slot], w.slack[slot], w.wait[slot] = 0, 0.0, 0
        f[BEFORE], f[UNTIL], f[BLUR] = t, f[T], more
        guards(model, rest, t + more, w.y, p, w.g_look)
        i[GUARDS] += 2
        for k in range(w.leave_from[rest + 1] - w.leave_from[rest]):
            # what the extrapolation has moved a guard by, it is not known better than
            w.slack[w.leave[w.leave_from[rest] + k] + 2] = abs(w.g_look[k] - w.g_ahead[k])
    leave(model, w, p, mode, mode, n, q)
    enter(model, w, p, rest, rest, n)
    return sides(model, w, p, ENTERED, q)


def halfway(model, w, p, q):
    """How far the guard of q was from zero in the middle of the flight that its event has just
    ended, by the cubic through both ends of the flight.
    """
    mode, t, gap = w.i[MODE], w.f[T], w.last_gap[q]
    n, line, then = w.size[mode], w.ledger[w.i[LEDGER] - 1], w.last_y[q]
    for i in range(n):
        w.y_look[i], w.y_shake[i] = then[i], line[5 + i]
    rates(model, w, mode, n, t - gap, w.y_look, p, w.ahead[1])
    rates(model, w, mode, n, t, w.y_shake, p, w.ahead[2])
    for i in range(n):
        bend = 0.125 * gap * (w.ahead[1][i] - w.ahead[2][i])
        w.y_look[i] = 0.5 * (then[i] + line[5 + i]) + bend
    guards(model, mode, t - 0.5 * gap, w.y_look, p, w.g_look)
    w.i[FLOWS] += 2
    w.i[GUARDS] += 1
    k = guard_place(w, mode, q)
    height = abs(w.g_look[k])
    if w.leap[q + 2] == 1 and shaken(model, w, p, mode, n, t - 0.5 * gap, w.y_look, k) > 0.0:
        return 0.0
    return height


def strike(w, s, so_far):
    """Schedule s has been due so often: when it is due next, or infinity."""
    lane = w.i[LANE]
    w.plan_next[s] = so_far
    if w.plan_period[lane][s] > 0.0:
        w.plan_t[s] = w.plan_first[lane][s] + so_far * w.plan_period[lane][s]
    else:
        place = w.plan_from[s] + so_far
        w.plan_t[s] = w.instant[lane][place] if place < w.plan_from[s + 1] else 1e300


def next_due(w):
    """The next instant of a schedule, at the end of a dead time, or where a table of the time
    bends.
    """
    due = w.kink[w.i[KINK]] if w.i[KINK] < w.i[KINKS] else 1e300
    for s in range(w.i[SCHEDULES]):
        due = min(due, w.plan_t[s])
    for q in range(w.i[PENDING]):
        due = min(due, w.queue_t[q])
    return due
