"""Where everything stands in the workspace `w` of a run, and the calls into the model.

The functions here are those of the plain back end; in the compiled one `flow`, `guards` and `reset`
call the model's C function, `row` moves an address, and w.k is built from a table of addresses
(backend.py).

A state vector has the states of its mode first and, from w.i[WIDTH] on, the held variables: only
events change those, so no step touches them, and loops over the n states of a mode leave them
alone.

What belongs to a guard beyond one step (its side, whether it waits) stands at its *slot*, its
transition's number + 2; slots 0 and 1 are the two ends of sliding.
"""

from collections import namedtuple

EPS = 2.220446049250313e-16

# Places in w.i, whole numbers that survive a pause. Where the run is, and what it has left behind
(MODE, JUMP, GRID, OUT, OUT_FROM, LEDGER, PIECES, STEPS, REJECTED, FLOWS, GUARDS) = range(11)
# FRESH: the step size must be found anew and SciPy's methods started; KNOWN: w.k[0] is the flow
# here; ENTRY: the next step begins at an instant, whose sides are known; BUSY: this instant is not
# over; SAME: events at it so far; WHO: the last transition that acted; FIRST: the last step was
# refused; KIND: why the chosen transition acts (CROSSED, DUE, LATE)
(FRESH, KNOWN, ENTRY, BUSY, SAME, WHO, FIRST, KIND, PENDING, TOUCHES) = range(11, 21)
# AHEAD: w.g_ahead holds the guards a little later; STIFFS: steps at the border of stability; JUMPS:
# places where the flow seemed to jump
(AHEAD, STIFFS, JUMPS) = range(21, 24)
# Sliding: on or not; its two modes; the place of the surface's guard among those of each
(SLIDING, SLIDE_A, SLIDE_B, GUARD_A, GUARD_B) = range(24, 29)
# Settings. OWN_SIZE: the tolerance of some state follows from its own size; UNSEEN: stages below it
# may be missing in the error
(STAGES, DEGREE, PROXY, ADAPTIVE, TWO, LOCATE, DENSE, TRANSITIONS, MAX_EVENTS, MAX_STEPS, ORDER) = (
    range(29, 40)
)
(ROWS, WIDTH, HELD, MODES, PARAMETERS, SAMPLES, SCHEDULES, POWERS) = range(40, 48)
(OWN_SIZE, KINKS, UNSEEN, LANES) = range(48, 52)
# Which lane is under way, and whether it has begun
LANE, BEGUN = 52, 53
# The next place where a table of the time bends; steps refused as a guard does too much in them;
# whether w.made says anything; the mode whose flow led to this instant, −1 if it was sliding
KINK, WILD, MADE, BY_FLOW = 54, 55, 56, 57
INTEGERS = 58
# Rows of the outputs, in w.room
ROOM_OUT, ROOM_LEDGER, ROOM_PIECES = range(3)
# Places in w.f. BEFORE: where the last step began; EVENT_T: the last instant with an event; UNTIL:
# what is due up to here is due now; LATER, GONE, GONE_T: how a guard leaves zero (leaving); LAMBDA:
# h·|λ| of the last step (stiffness); RECENT: how long the last steps were; TURN: −1 where the
# surface's guard crossed downwards
(T, H, T_END, RTOL, MAX_STEP, T0, EVENT_T, ZENO_T, PROBE) = range(9)
(BEFORE, UNTIL, LATER, GONE, LAMBDA, RECENT, JUMP_T, TURN, GONE_T) = range(9, 18)
# BAND: below which size the guard whose body rests is zero; BLUR: how far the clock has just been
# moved on; CAP: a longer step would step over what a guard does; GAP: time between the last two
# events; MIXED: how well λ is known while sliding
(BAND, BLUR, CAP, GAP, MIXED) = range(18, 23)
FLOATS = 23
# What is kept of a lane that is done, in w.done: why it ended, the last transition, where its
# samples end, its work, places where its flow seemed to jump
STATUS, LAST, END, EVENTS, ACCEPTED, FAILED, RATES, LOOKS, JUMPED = range(9)

# Why `advance` returns
PAUSE, FINISHED, GROW, TERMINAL, ZENO, CONTACT, LOOP, EVENTS_OUT, STEPS_OUT = range(9)
UNDERFLOW, QUEUE_FULL, GUARD_NAN, BAD_START, STIFF, HIDDEN_JUMP = range(9, 15)

QUEUE = 256  # dead-time transitions under way at once
MOST_TOUCHES = 64  # touched limits that are noted
# After so many steps refused for a guard that cannot be followed, its samples are believed
MOST_WILD = 40
SLIDE = -2  # stands for the sliding mode in the ledger
# Of DOP853's polynomial; on smooth stretches it is below 30, and the error between the ends then
# below the tolerance
MOST_DEFECT = 100.0
NO, YES, REFUSE = 0, 1, 2  # in w.urgent: a start beyond the guard waits, fires, is refused
CROSSED, DUE, LATE = 0, 1, 2  # in w.i[KIND]: its guard has crossed, it is due by schedule, delay
ARRIVE, JUMPED_TO, ENTERED, START = 0, 1, 2, 3  # how `sides` was come to


def workspace(z):
    """The fields of w as (name, "f" or "i", shape) for the sizes in z: one list for the plain
    lists, the arrays and their addresses.
    """
    y, slots = z.width + z.held, z.transitions + 2
    return (
        ("i", "i", (INTEGERS,)),
        ("f", "f", (FLOATS,)),
        ("room", "i", (3,)),
        # what is to be done: how w.i and w.f begin, and what each lane begins with
        ("i0", "i", (INTEGERS,)),
        ("f0", "f", (FLOATS,)),
        ("mode0", "i", (z.lanes,)),
        ("y0", "f", (z.lanes, y)),
        ("done", "i", (z.lanes, 9)),
        ("delay", "f", (z.lanes, z.transitions)),
        ("plan_next0", "i", (z.lanes, z.schedules)),
        ("plan_first", "f", (z.lanes, z.schedules)),
        ("plan_period", "f", (z.lanes, z.schedules)),
        ("instant", "f", (z.lanes, z.instants)),
        ("grid", "f", (z.grid,)),
        ("kink", "f", (z.kinks,)),
        # the method: sparse rows of its matrices
        ("a_from", "i", (z.rows + 1,)),
        ("a_column", "i", (z.a,)),
        ("a_value", "f", (z.a,)),
        ("c", "f", (z.rows,)),
        ("e_from", "i", (3,)),
        ("e_column", "i", (z.e,)),
        ("e_value", "f", (z.e,)),
        ("w_from", "i", (z.degree + 1,)),
        ("w_column", "i", (z.w,)),
        ("w_value", "f", (z.w,)),
        ("q_from", "i", (z.degree + 1,)),
        ("q_column", "i", (z.q,)),
        ("q_value", "f", (z.q,)),
        ("node", "f", (z.proxy + 3,)),
        ("bernstein", "f", (z.proxy + 1, z.proxy + 1)),
        ("test", "f", (2, z.proxy + 1)),
        # the model. absolute: the part of the tolerance that does not grow with the state, −1 where
        # it follows from the state's own size; family: modes with the same states have the same
        ("size", "i", (z.modes,)),
        ("family", "i", (z.modes,)),
        ("absolute", "f", (z.modes, z.width)),
        ("kind", "i", (z.modes, z.width)),  # states of one unit are of one kind
        ("leave_from", "i", (z.modes + 1,)),
        ("leave", "i", (z.guards,)),
        ("source", "i", (z.transitions, z.modes)),
        ("target", "i", (z.transitions,)),
        ("zeno", "i", (z.transitions,)),
        ("directed", "i", (z.transitions,)),
        ("acts", "i", (z.transitions,)),  # its reset may change a state
        ("urgent", "i", (z.transitions,)),
        ("rank", "i", (z.transitions,)),
        ("tolerance", "f", (z.transitions,)),
        # schedules: their transitions; clock: those with the same `at` are one, with one number
        ("plan", "i", (z.schedules,)),
        ("plan_from", "i", (z.schedules + 1,)),
        ("clock", "i", (z.schedules,)),
        # the state and its surroundings
        ("y", "f", (y,)),
        ("y_new", "f", (y,)),
        ("y_try", "f", (y,)),
        ("zero", "f", (z.width,)),
        ("lost", "f", (z.width,)),  # what the last step of fixed length has rounded off
        ("k", "f", (z.rows, z.width)),
        ("err", "f", (2, z.width)),
        ("term", "f", (z.degree, z.width)),
        ("poly", "f", (z.degree + 1, z.width)),
        ("kept", "f", (z.degree + 1, z.width)),
        ("most", "f", (z.width,)),  # the largest size of each state so far
        ("size_of", "f", (z.kinds,)),  # … and of each kind
        ("speed", "f", (z.width,)),  # the rates with which the flow came to this instant
        # a state has the rounding of this size: it came fast by the clock and stands still since,
        # or a reset made it of something large
        ("made", "f", (y,)),
        ("terms", "f", (z.modes, z.width)),  # the size of what each derivative is made of
        ("ticks", "f", (z.modes, z.width)),  # what the clock's rounding does to it
        ("felt", "f", (z.modes, z.width)),  # … for states of this size, −1 if never
        # guards in a step, by their place among those looked at
        ("at_node", "f", (z.proxy + 3, z.guards + 2)),
        ("value", "f", (z.proxy + 3,)),
        ("hull", "f", (z.proxy + 1,)),
        ("g", "f", (z.guards + 2,)),
        ("stack", "f", (256,)),
        ("root", "f", (z.guards + 2,)),
        ("low", "f", (z.guards + 2,)),  # of its samples at the nodes
        ("high", "f", (z.guards + 2,)),
        ("turn", "i", (z.guards + 2,)),  # the side at the end of the step
        ("quiet", "i", (z.guards + 2,)),  # whether it went back in this step, which is no event
        ("near", "i", (z.guards + 2,)),
        # guards between steps, by slot
        ("side", "i", (slots,)),
        ("flat", "i", (slots,)),  # zero where the step begins
        ("leap", "i", (slots,)),  # 1: it jumps, or is steeper than the clock is fine; −1: not
        ("awake", "f", (slots,)),  # … and from this time on clear of zero
        ("wait", "i", (slots,)),  # it has crossed and its transition has not acted yet
        # 1: it crosses at this instant along the flow; 2: and has acted; 3: has acted by a jump
        ("came", "i", (slots,)),
        ("slack", "f", (slots,)),  # what it was located with: counts as zero while it is flat
        # Σ|∂g/∂yᵢ·yᵢ| + |∂g/∂t·t| where it was last worked out, at w.scale_y
        ("scale", "f", (slots,)),
        ("scale_y", "f", (slots, z.width + 1)),
        ("grain", "f", (slots,)),  # the rounding of its constants, as measured
        ("grains", "i", (slots,)),  # … so many times
        ("swing", "f", (slots,)),  # the largest slope seen in the last step
        ("rises", "i", (slots,)),  # it was rising where the last step ended (for touches)
        # room for looking ahead, and for sliding
        ("y_look", "f", (y,)),
        ("y_shake", "f", (y,)),
        ("ahead", "f", (4, z.width)),
        ("g_ahead", "f", (z.guards + 2,)),
        ("g_look", "f", (z.guards + 2,)),
        ("g_away", "f", (z.guards + 2,)),
        ("rate_a", "f", (z.width,)),
        ("rate_b", "f", (z.width,)),
        ("y_probe", "f", (y,)),
        ("g_probe", "f", (z.guards + 2,)),
        # how often a schedule has been due; in which mode a clock has struck at this instant, or −1
        ("plan_next", "i", (z.schedules,)),
        ("plan_t", "f", (z.schedules,)),  # … and when it is due next
        ("found", "i", (z.schedules,)),
        ("queue_t", "f", (QUEUE,)),
        ("queue", "i", (QUEUE,)),
        # flights of a transition: since when, how long, how often ever shorter, two earlier ones
        ("last_t", "f", (z.transitions,)),
        ("last_gap", "f", (z.transitions,)),
        ("shorter", "i", (z.transitions,)),
        ("few", "i", (z.transitions,)),
        ("anchor", "f", (z.transitions, 4)),
        ("last_y", "f", (z.transitions, y)),
        ("last_move", "f", (z.transitions, y)),
        # what comes out
        ("out", "f", (z.out, 5 + y)),
        ("ledger", "f", (z.ledger, 5 + 2 * y)),
        ("pieces", "f", (z.pieces, 4 + (z.degree + 1) * z.width + z.held)),
        ("touch", "f", (MOST_TOUCHES, 3)),
    )


class _Ones:
    """Every size 1: for the names, kinds and numbers of dimensions alone."""

    def __getattr__(self, name):
        return 1


FIELDS = workspace(_Ones())
Workspace = namedtuple("Workspace", [name for name, _, _ in FIELDS])


def flow(model, mode, t, y, p, out):
    model.flow[mode](t, y, p, out)


def guards(model, mode, t, y, p, out):
    model.guards[mode](t, y, p, out)


def reset(model, transition, mode, t, y, p, out):
    model.reset[transition](mode, t, y, p, out)


def external_step(model, w, p, t, h):
    """A step by one of SciPy's methods: fills w.y_new and w.poly, returns its length (0: failed).

    Plain back end only."""
    return model.stepper(w, p, t, h)


def row(p, lane, parameters):
    """The parameters of a lane."""
    return p[lane]
