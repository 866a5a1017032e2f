"""Where everything stands in the workspace `w` of a run, and the calls into the model.

The functions here are those of the plain back end; in the compiled one `flow`, `guards` and `reset` call the model's C
function, `row` moves an address, and w.k is built from a table of addresses (backend.py).
"""

from collections import namedtuple

EPS = 2.220446049250313e-16

# Places in w.i (whole numbers that survive a pause) …
(
    MODE,
    JUMP,
    GRID,
    OUT,
    OUT_FROM,
    LEDGER,
    PIECES,
    STEPS,
    REJECTED,
    FLOWS,
    GUARDS,
    FRESH,
    ENTRY,
    PENDING,
    SAME,
    WHO,
    FIRST,
) = range(17)
ARRIVED, TOUCHES = (
    17,
    18,
)  # the mode in which the instant of a schedule was reached; how many limits were touched
# Sliding: on or not; its two modes and the position of the surface's guard among those of the first and of the second
SLIDING, SLIDE_A, SLIDE_B, GUARD_A, GUARD_B = range(19, 24)
# … settings among them …
(
    STAGES,
    DEGREE,
    PROXY,
    ADAPTIVE,
    TWO,
    LOCATE,
    DENSE,
    TRANSITIONS,
    MAX_EVENTS,
    MAX_STEPS,
    ORDER,
    ROWS,
    WIDTH,
    PARAMETERS,
    SAMPLES,
    SCHEDULES,
    POWERS,
    LANES,
) = range(24, 42)
# … and which lane is under way, and whether it has begun
LANE, BEGUN = 42, 43
INTEGERS = 44
# Rows of the outputs, in w.room
ROOM_OUT, ROOM_LEDGER, ROOM_PIECES = range(3)
# Places in w.f
T, H, T_END, RTOL, ATOL, MAX_STEP, T0, EVENT_T, ZENO_T, SPAN, DUE_T, PROBE = range(12)
FLOATS = 12
# What is kept of a lane that is done, in w.done: why it ended, the last transition, where its samples end, its work
STATUS, LAST, END, EVENTS, ACCEPTED, FAILED, RATES, LOOKS = range(8)

# Why `advance` returns
(
    PAUSE,
    FINISHED,
    GROW,
    TERMINAL,
    ZENO,
    CONTACT,
    LOOP,
    EVENTS_OUT,
    STEPS_OUT,
    UNDERFLOW,
    QUEUE_FULL,
    GUARD_NAN,
    BAD_START,
) = range(13)

QUEUE = 256  # dead-time transitions under way at once
MOST_TOUCHES = 64  # touched limits that are noted
SLIDE = -2  # stands for the sliding mode in the ledger
MOST_DEFECT = 100.0  # of DOP853's polynomial; on smooth stretches it is below 30, and the error between the ends then below the tolerance
SAME_INSTANT = 100  # events at one instant before the run is called a loop
NO, YES, REFUSE = 0, 1, 2  # in w.urgent: a start beyond the guard waits, fires, is refused


def workspace(z):
    """The fields of w as (name, "f" or "i", shape) for the sizes in z: one list for the plain lists, the arrays and their addresses."""
    return (
        ("i", "i", (INTEGERS,)),
        ("f", "f", (FLOATS,)),
        ("room", "i", (3,)),
        # what is to be done: how w.i and w.f begin, and what each lane begins with
        ("i0", "i", (INTEGERS,)),
        ("f0", "f", (FLOATS,)),
        ("mode0", "i", (z.lanes,)),
        ("y0", "f", (z.lanes, z.n)),
        ("done", "i", (z.lanes, 8)),
        ("delay", "f", (z.lanes, z.transitions)),
        ("plan_next0", "i", (z.lanes, z.schedules)),
        ("plan_first", "f", (z.lanes, z.schedules)),
        ("plan_period", "f", (z.lanes, z.schedules)),
        ("instant", "f", (z.lanes, z.instants)),
        ("grid", "f", (z.grid,)),
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
        # the model
        ("size", "i", (z.modes,)),
        ("leave_from", "i", (z.modes + 1,)),
        ("leave", "i", (z.guards,)),
        ("source", "i", (z.transitions, z.modes)),
        ("target", "i", (z.transitions,)),
        ("zeno", "i", (z.transitions,)),
        ("directed", "i", (z.transitions,)),
        ("urgent", "i", (z.transitions,)),
        ("rank", "i", (z.transitions,)),
        ("tolerance", "f", (z.transitions,)),
        ("plan", "i", (z.schedules,)),
        ("plan_from", "i", (z.schedules + 1,)),
        # the state and its surroundings
        ("y", "f", (z.n,)),
        ("y_new", "f", (z.n,)),
        ("y_try", "f", (z.n,)),
        ("zero", "f", (z.n,)),
        ("k", "f", (z.rows, z.n)),
        ("err", "f", (2, z.n)),
        ("term", "f", (z.degree, z.n)),
        ("poly", "f", (z.degree + 1, z.n)),
        ("kept", "f", (z.degree + 1, z.n)),
        ("at_node", "f", (z.proxy + 3, z.guards + 2)),
        ("value", "f", (z.proxy + 3,)),
        ("hull", "f", (z.proxy + 1,)),
        ("g", "f", (z.guards + 2,)),
        ("stack", "f", (256,)),
        ("side", "i", (z.guards + 2,)),
        ("hold", "i", (z.transitions,)),
        ("root", "f", (z.guards + 2,)),
        ("near", "i", (z.guards + 2,)),
        ("rate_a", "f", (z.n,)),
        ("rate_b", "f", (z.n,)),
        ("y_probe", "f", (z.n,)),
        ("g_probe", "f", (z.guards + 2,)),
        ("plan_next", "i", (z.schedules,)),
        ("queue_t", "f", (QUEUE,)),
        ("queue", "i", (QUEUE,)),
        ("last_t", "f", (z.transitions,)),
        ("last_gap", "f", (z.transitions,)),
        ("last_ratio", "f", (z.transitions,)),
        ("last_y", "f", (z.transitions, z.n)),
        # what comes out
        ("out", "f", (z.out, 3 + z.n)),
        ("ledger", "f", (z.ledger, 5 + 2 * z.n)),
        ("pieces", "f", (z.pieces, 3 + (z.degree + 1) * z.n)),
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
    """A step by one of SciPy's methods: fills w.y_new and w.poly, returns its length (0: failed). Plain back end only."""
    return model.stepper(w, p, t, h)


def row(p, lane, parameters):
    """The parameters of a lane."""
    return p[lane]
