"""Where everything stands in the workspace `w` of a run, and the calls into the model.

The functions here are those of the plain back end; in the compiled one `flow`, `guards` and `reset` call the model's C
function, and w.k builds an array from a table of addresses (backend.py).
"""

from collections import namedtuple

EPS = 2.220446049250313e-16

# Places in w.i (whole numbers that survive a pause) …
MODE, JUMP, GRID, OUT, LEDGER, PIECES, STEPS, REJECTED, FLOWS, GUARDS, FRESH, ENTRY, PENDING, SAME, WHO, FIRST = range(16)
# … and settings among them
STAGES, DEGREE, PROXY, ADAPTIVE, TWO, LOCATE, DENSE, TRANSITIONS, MAX_EVENTS, MAX_STEPS, ORDER, ROWS, WIDTH = range(16, 29)
ARRIVED = 29  # the mode in which the instant of a schedule was reached
# Sliding: on or not; its two modes and the position of the surface's guard among those of the first and of the second
SLIDING, SLIDE_A, SLIDE_B, GUARD_A, GUARD_B = range(30, 35)
INTEGERS = 35
# Places in w.f
T, H, T_END, RTOL, ATOL, MAX_STEP, T0, EVENT_T, ZENO_T, SPAN, DUE_T, PROBE = range(12)
FLOATS = 12

# Why `advance` returns
PAUSE, FINISHED, GROW, TERMINAL, ZENO, CONTACT, LOOP, EVENTS_OUT, STEPS_OUT, UNDERFLOW, QUEUE_FULL, GUARD_NAN = range(12)

QUEUE = 256  # dead-time transitions under way at once
SLIDE = -2  # stands for the sliding mode in the ledger
SAME_INSTANT = 100  # events at one instant before the run is called a loop


def workspace(n, modes, transitions, guards, rows, degree, proxy, instants, schedules, grid, events, pieces, nonzeros, weights):
    """The fields of w as (name, "f" or "i", shape): one list for the plain lists, the arrays and their addresses."""
    return (
        ("i", "i", (INTEGERS,)), ("f", "f", (FLOATS,)),
        # the method
        ("a_from", "i", (rows + 1,)), ("a_column", "i", (nonzeros,)), ("a_value", "f", (nonzeros,)), ("b", "f", (rows,)), ("c", "f", (rows,)),
        ("e", "f", (2, rows)), ("w_from", "i", (degree + 1,)), ("w_row", "i", (weights,)), ("w_value", "f", (weights,)), ("q", "f", (degree, degree)),
        ("node", "f", (proxy + 3,)), ("bernstein", "f", (proxy + 1, proxy + 1)), ("test", "f", (2, proxy + 1)),
        # the model
        ("size", "i", (modes,)), ("leave_from", "i", (modes + 1,)), ("leave", "i", (guards,)), ("source", "i", (transitions, modes)),
        ("target", "i", (transitions,)), ("zeno", "i", (transitions,)), ("directed", "i", (transitions,)), ("urgent", "i", (transitions,)),
        ("rank", "i", (transitions,)), ("delay", "f", (transitions,)),
        ("plan", "i", (schedules,)), ("plan_next", "i", (schedules,)), ("plan_first", "f", (schedules,)), ("plan_period", "f", (schedules,)),
        ("plan_from", "i", (schedules + 1,)), ("instant", "f", (instants,)),
        # the state and its surroundings
        ("y", "f", (n,)), ("y_new", "f", (n,)), ("y_try", "f", (n,)), ("k", "f", (rows, n)), ("term", "f", (degree, n)), ("poly", "f", (degree + 1, n)),
        ("at_node", "f", (proxy + 3, guards + 2)), ("value", "f", (proxy + 3,)), ("hull", "f", (proxy + 1,)), ("g", "f", (guards + 2,)),
        ("stack", "f", (256,)), ("side", "i", (guards + 2,)), ("hold", "i", (transitions,)), ("root", "f", (guards + 2,)),
        ("rate_a", "f", (n,)), ("rate_b", "f", (n,)), ("y_probe", "f", (n,)), ("g_probe", "f", (guards + 2,)),
        ("queue_t", "f", (QUEUE,)), ("queue", "i", (QUEUE,)),
        ("last_t", "f", (transitions,)), ("last_gap", "f", (transitions,)), ("last_ratio", "f", (transitions,)), ("last_y", "f", (transitions, n)),
        # what comes out
        ("grid", "f", (grid,)), ("out", "f", (grid + 4 + 3 * events, 3 + n)), ("ledger", "f", (events, 5 + 2 * n)), ("pieces", "f", (pieces, 3 + (degree + 1) * n)),
    )


def flow(model, mode, t, y, p, out):
    model.flow[mode](t, y, p, out)


def guards(model, mode, t, y, p, out):
    model.guards[mode](t, y, p, out)


def reset(model, transition, mode, t, y, p, out):
    model.reset[transition](mode, t, y, p, out)


def external_step(model, w, p, t, h):
    """A step by one of SciPy's methods: fills w.y_new and w.poly, returns its length (0: failed). Plain back end only."""
    return model.stepper(w, p, t, h)


# The functions above have other bodies in the compiled back end; those below are the same source in both.


Workspace = namedtuple("Workspace", [name for name, _, _ in workspace(*[1] * 14)])
