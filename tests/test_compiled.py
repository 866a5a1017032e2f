"""Compiled = plain = Python: whole numbers, tables, constants wherever they stand, failures."""

import ctypes
import dataclasses
import functools
import gc
import linecache
import math
import os
import random
import re
import subprocess
import sys
import textwrap
import types
import warnings
import weakref

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labkit import At, Mode, ModelError, System, Transition, simulate, simulate_many
from labkit.solve import backend, cache
from labkit.solve.kinds import Unfit
from labkit.solve.plain import Plain, orientations
from labkit.solve.source import Program

ROOT = os.path.dirname(os.path.dirname(__file__))
NUMBER = iter(range(10**9))


def written(text, **names):
    """The names that a piece of source defines, with its text at hand as in a notebook's cell."""
    text, place = textwrap.dedent(text), f"<written {next(NUMBER)}>"
    linecache.cache[place] = len(text), None, text.splitlines(True), place
    space = {"math": math, "np": np, "__name__": "written", **names}
    exec(compile(text, place, "exec"), space)
    return space


def flow_of(*texts, **names):
    """The flow whose derivatives are these expressions."""
    return written(f"flow = lambda t, s, p: ({', '.join(texts)},)", **names)["flow"]


def one(flow, **more):
    options = {"states": {"x": ""}, "parameters": {"k": 2.0}, "start": {"x": 1.0}} | more
    return System("one", modes=[Mode("m", flow)], **options)


def both(system, mode, t, y):
    """(plain, compiled): what the flows of both back ends give for a mode, in one state.

    A run that meets whole numbers which compiled code cannot hold is made again in plain Python.
    """
    code, p, n = backend.compiled(system, wait=True), system.values(), len(y)
    vector, pointer = ctypes.c_double * n, ctypes.POINTER(ctypes.c_double)
    whole = ctypes.c_int64
    kind = ctypes.CFUNCTYPE(None, whole, whole, ctypes.c_double, pointer, pointer, pointer)
    slow, fast = [0.0] * n, vector()
    Plain(system, orientations(system)).flow[mode](t, [*map(float, y)], p, slow)
    values = (ctypes.c_double * (len(p) + 1))(*p)
    kind(code.model)(0, mode, t, vector(*y), values, fast)
    return slow, slow if values[len(p)] else list(fast)


def slope(system):
    """The derivative of x as the compiled back end has it at the start."""
    plain, fast = both(system, 0, 0.0, [1.0])
    assert plain == fast or plain != plain
    return fast[0]


# ---------------------------------------------------------------- random expressions

EARTH = types.SimpleNamespace(R=6371000, big=10**18)
TABLES = {
    "U": [0.5, -1.25, 3.0],
    "W": [3, -7, 11, 1000003],
    "A": np.array([0.1, 0.2, 0.3, 0.4]),
    "N": np.array([5, -6, 7]),
    "M": ((1.5, 2.5), (3.5, 4.5)),
    "R": 6371000,
    "K": 100,
    "n": 10,
    "planet": types.SimpleNamespace(g=9.81, n=7, earth=EARTH),
}
HELPERS = """
def half(a, b=2):
    return a / b
def pick(a, c=(1, 2.5)):
    if a > c[0]:
        return c[1] * a
    return 0
def count(a, m=5):
    total = 0
    for i in range(m):
        if i * a < 3:
            total += i
    return total
def power(a, e):
    return a**e
"""
LEAVES = [
    "s.x",
    "s.v",
    "t",
    "p.k",
    "0",
    "1",
    "2",
    "3",
    "-1",
    "7",
    "0.5",
    "-2.5",
    "1e-3",
    "10**9",
    "2**40",
    "R",
    "K",
    "n",
    "planet.g",
    "planet.n",
    "planet.earth.R",
    "planet.earth.big",
    "len(U)",
    "U[1]",
    "W[3]",
    "W[-1]",
    "N[2]",
    "M[1][0]",
    "math.pi",
    "True",
    "(s.x>0)",
    "int(t)",
    "int(s.x)",
]
ONE = [
    "-({})",
    "abs({})",
    "int({})",
    "round({})",
    "float({})",
    "math.floor({})",
    "math.ceil({})",
    "math.sqrt({})",
    "math.exp({})",
    "math.log({})",
    "math.sin({})",
    "math.atan({})",
    "half({})",
    "pick({})",
    "count({})",
    "({})**2",
    "({})**3",
    "2**min({},60)",
    "(-1)**int({})",
    "U[int({})]",
    "W[int({})%4]",
    "A[int({})%4]",
    "N[int({})%3]",
    "M[int({})%2][1]",
]
TWO = [
    "({}+{})",
    "({}-{})",
    "({}*{})",
    "({}/{})",
    "({}//{})",
    "({}%{})",
    "(float({})**{})",
    "min({},{})",
    "max({},{})",
    "half({},{})",
    "power(float({}),{})",
    "math.hypot({},{})",
    "(({})and({}))",
    "(({})or({}))",
    "math.atan2({},{})",
]
POINTS = [(0.0, 1.5, -0.5), (2.7, -3.25, 1e6), (1.0, 0.0, 3.0), (13.0, 1e3, -2.0), (1e6, 40.5, 0.1)]


def combined(inner):
    three = st.builds("({} if {} > {} else {})".format, inner, inner, inner, inner)
    alone = st.builds(lambda form, a: form.format(a), st.sampled_from(ONE), inner)
    pairs = st.builds(lambda form, a, b: form.format(a, b), st.sampled_from(TWO), inner, inner)
    return st.one_of(pairs, alone, three)


EXPRESSIONS = st.recursive(st.sampled_from(LEAVES), combined, max_leaves=6)


@functools.cache
def helpers():
    made = written(HELPERS)
    return {name: made[name] for name in ("half", "pick", "count", "power")}


def plane(flows):
    modes = [Mode(f"m{k}", flow) for k, flow in enumerate(flows)]
    return System("many", {"x": "", "v": ""}, {"k": 2.0}, modes, start={"x": 1, "v": 1})


def fits(flow):
    """Is it compiled? If not, the reason has its line."""
    try:
        Program(plane([flow]))
    except Unfit as why:
        assert "(line" in str(why) or "too large for a float" in str(why)
        return False
    return True


def compared(flows, points):
    """(text, point, plain value, compiled value) of those flows that are compiled, everywhere."""
    flows = {text: flow for text, flow in flows.items() if fits(flow)}
    system = plane(flows.values()) if flows else None
    for k, text in enumerate(flows):
        for t, *y in points:
            yield text, (t, *y), *both(system, k, t, y)


def alike(a, b):
    return a == b or (a != a and b != b) or abs(a - b) <= 1e-13 * abs(b)


@settings(max_examples=6, suppress_health_check=list(HealthCheck))
@given(st.lists(EXPRESSIONS, min_size=10, max_size=25))
def test_random_expressions_are_pythons(texts):
    flows = {text: flow_of(text, "0.0", **TABLES, **helpers()) for text in texts}
    for text, place, plain, fast in compared(flows, POINTS):
        assert alike(plain[0], fast[0]), (text, place, plain[0], fast[0])


# ---------------------------------------------------------------- random loops and tuples

PARTS = """
def half(a, b=2):
    return a / b
def swap(a, b):
    return b, a
def total(a, n):
    sums = (0, a)
    for k in range(n):
        sums = (sums[0] + sums[1], a)
    return sums[0]
"""
ATOMS = (
    "a b c i a b c q[0] q[1] r[0] r[1][0] r[1][1] s.x s.v int(s.x) int(s.v) (a>b) 0 1 2 -3 7 0.5"
)
ATOMS += " True W[i%3] 10**9 2**31 2**53 10**18+1 1e17 n"
FORMS = """{}+{};{}-{};3*{};{}*-1;{}//{};{}%{};{}/{};-{};abs({});int({});round({});float({})
min({},{});max({},{});{} if {} > {} else {};half({});swap({},{})[0];total({},3);{} and {};{} or {}
math.copysign({},{});math.atan2({},{});{} == {};{} < {} < {};math.floor({})"""
PRODUCTS = "{}*{};{}**2;2**(int({})%70);{}**(int({})%4);pow({},2);{}*{}+{};{}**-1;int({})<<3"
LINES = """a = {};b = {};c = {};a += {};b -= {};a, b = b, {};q = (q[1], q[0] + q[1]);q = ({}, {})
q = (q[1], {});r = ({}, ({}, {}));r = (r[1][0], (r[0], {}));q = swap({}, b);a, q = {}, (a, b)
a, b = swap(a, {});c += q[0];a = a + b;c *= 3;c = c * 3 + 1;i += 1;q = (q[0] + r[0], r[1][1])"""
HEADS = """for i in range(5):;for i in range(90):;for i in range(int(s.v) % 7):;if {} > {}:
for b in (a, {}, 2):;for a, b in zip((1, {}), q):;while i < 4 and {} < c:
while i < 60 and a < 10**17:"""
STARTS = """a, b, c, i = 0, 1, 2, 0;q, r = (0, 1), (1, (2, 3))
a, b, c, i = int(s.x), 1, s.v, 0;q, r = (a, 1), (1, (a, 2))"""


def formed(forms, *inner):
    """One of these forms, its gaps filled with what is drawn, in brackets."""

    def filled(form, parts):
        first, *pieces = form.split("{}")
        return first + "".join(f"({a}){b}" for a, b in zip(parts, pieces, strict=False))

    forms = st.sampled_from(forms.replace("\n", ";").split(";"))
    return st.builds(filled, forms, st.tuples(*4 * inner))


def indented(head, lines):
    more = ["i += 1", "a += 1 + abs(a)"] if head.startswith("while") else []
    return "\n".join([head, *("    " + line for line in (*more, *lines))])


ATOM = st.sampled_from(ATOMS.split())
FORMULA = ATOM | formed(FORMS, ATOM) | formed(FORMS, ATOM | formed(FORMS, ATOM))
TOP = FORMULA | formed(PRODUCTS, FORMULA)  # not in a loop: Python would reckon for ever
LINE = formed(LINES, FORMULA)
BLOCK = st.builds(indented, formed(HEADS, FORMULA), st.lists(LINE, min_size=1, max_size=3))
BODIES = st.builds(
    lambda start, blocks, *ends: [*start.split(";"), *blocks, f"return {ends[0]}, {ends[1]}"],
    st.sampled_from(STARTS.splitlines()),
    st.lists(LINE | BLOCK | formed(LINES, TOP), min_size=1, max_size=4),
    TOP,
    TOP,
)
HARD = [
    (0.0, 1.5, -0.5),
    (2.0, -3.25, 1e17),
    (1.0, 0.0, 3.0),
    (3.0, 2.0**53, -2.0),
    (4.0, 1e19, 6.1),
]


@settings(max_examples=2, suppress_health_check=list(HealthCheck))
@given(st.lists(BODIES, min_size=6, max_size=9))
def test_random_functions_are_pythons(bodies):
    """Whole numbers of any size, loops, tuples: the value to the last bit, or a failure."""
    texts = [textwrap.indent("\n".join(body), "    ") for body in bodies]
    names = {"n": 10, "W": TABLES["W"], **functions()}
    flows = {text: written(f"def flow(t, s, p):\n{text}", **names)["flow"] for text in texts}
    for text, place, plain, fast in compared(flows, HARD):
        assert repr(plain) == repr(fast), f"{text}\n{place}"


@functools.cache
def functions():
    made = written(PARTS)
    return {name: made[name] for name in ("half", "swap", "total")}


SUM = written("def sum2(a):\n    return a[0] + a[1]")["sum2"]


@pytest.mark.parametrize(
    "body",
    [
        "return 0.0, (int(s.x) + 1) % 2",
        "return 0.0, (int(s.x) + 1) - int(s.x)",
        "return 0.0, int(s.x) * 3 // 7 % 5",
        "return 0.0, s.x < int(s.x) + 1",
        "return 0.0, math.copysign(1.0, int(-0.5 + 0 * s.x) * 2.0)",
        "a = (0, 1)\nfor i in range(90):\n    a = (a[1], sum2(a))\nreturn 0.0, a[0] % 999",
    ],
)
def test_whole_numbers_that_no_float_holds_are_left_to_python(body):
    flow = written("def flow(t, s, p):\n" + textwrap.indent(body, "    "), sum2=SUM)["flow"]
    system = one(flow, states={"x": "", "y": ""}, start={"x": 1.0, "y": 0.0})
    how = {"method": "Euler", "step": 1.0, "backend": "compiled"}
    for x in (3.0, 2.0**53, 1e16, 1e19, -1e300):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            run = simulate(system, 1.0, start={"x": x}, **how)
            plain = bool(said)
            many = simulate_many(system, 1.0, start={"x": [2.0, x, x]}, **how)
        right = float(flow(0.0, types.SimpleNamespace(x=x), None)[1])
        assert run["y"][-1] == many[1]["y"][-1] == right
        assert run.work.backend == ("plain" if plain else "compiled")
        assert all("2**53, `" in str(each.message) for each in said)
        if x == 3.0 and "range" not in body:
            assert not said


def test_squares_are_pythons_to_the_last_bit():
    """pow(x, 2.0) is another number than x*x for about one x in 1,200."""
    names = [f"x{k}" for k in range(20)]
    squares = System(
        "squares",
        dict.fromkeys(names, ""),
        modes=[Mode("m", flow_of(*(f"s.{name}**2" for name in names)))],
        start=dict.fromkeys(names, 1.0),
    )
    chance = random.Random(7)
    seen = 0
    for _ in range(1000):
        y = [chance.uniform(-2.0, 2.0) * 2.0 ** chance.randint(-560, 500) for _ in names]
        plain, fast = both(squares, 0, 0.0, y)
        assert plain == fast, [v.hex() for v, a, b in zip(y, plain, fast, strict=True) if a != b]
        seen += sum(v * v != a for v, a in zip(y, plain, strict=True))
    assert seen > 0  # else it has tried nothing
    square = one(flow_of("s.x**2"))
    for value in (0.0, -0.0, 5e-324, 1e-162, 1e-140, 1.3e154, 1e200, math.inf, math.nan):
        (plain,), (fast,) = both(square, 0, 0.0, [value])
        assert repr(plain) == repr(fast)


# ---------------------------------------------------------------- whole numbers

R, C, K, N = 6371000, 299792458, 100, 10


WHOLE = [
    "1e20/R**3",
    "c**3/1e25",
    "K**n/1e20",
    "K**(n-12)",
    "100**10*s.x",
    "10**-2",
    "2**62*2**62*s.x",
    "7//2*s.x",
    "-7//2+s.x",
    "-7%3+s.x",
    "(s.x>0)*3+True",
    "R*R*R*R*s.x",
    "sum([R,R,R])**3/1e20",
    "divmod(R,7)[1]*s.x",
    "round(2.5)*s.x",
    "round(3.14159,2)*s.x",
    "int(-2.7*s.x)",
    "abs(-R)**3*s.x",
    "1_000_003**4%97*s.x",
    "max(R,c)**3*s.x",
    "(1<<40)**2*s.x",
    "len([1,2])**100*s.x",
]


def test_whole_constants():
    names = {"R": R, "c": C, "K": K, "n": N, "s": types.SimpleNamespace(x=1.0)}
    system = plane([flow_of(text, "0.0", **names) for text in WHOLE])
    for k, text in enumerate(WHOLE):
        right = float(eval(text, dict(names)))
        assert both(system, k, 0.0, [1.0, 0.0]) == ([right, 0.0], [right, 0.0]), text


def test_whole_numbers_in_closures_defaults_and_helpers():
    def make(c):
        def cube(x, e=3):
            return x**e

        def flow(t, s, p, R=R, *, K=K):
            return (1e20 / R**3 + cube(c) / 1e25 + cube(K, 10) / 1e20 + 0 * s.x,)

        return flow

    assert slope(one(make(C))) == pytest.approx(1e20 / R**3 + C**3 / 1e25 + 1, 1e-15)


def test_counting_in_loops():
    flow = written(
        """
        def flow(t, s, p):
            total, k, product = 0, 0, 1
            for i in range(10):
                total += i
                product = product * 3
            while k * k < 50 * s.x:
                k += 1
            for a, b in zip((1, 2), (0.5, 0.25)):
                total += a * b
            return (total + k + product,)
        """
    )["flow"]
    assert slope(one(flow)) == 45 + 1 + 8 + 3**10


CORNERS = {
    "a number set before break": """
        for i in range(3):
            if s.x > 1:
                a = 5
                break
            a = 1
        return a * 1.0, 0.0""",
    "a kind set before continue": """
        a = 0
        for i in range(3):
            if i == 2:
                a = 2.5
                continue
            a = 1
        return a + s.x, 0.0""",
    "a list for a condition": """
        a = 0
        while U:
            a += 1
            if a > s.v or a > 9:
                break
        return a, 0.0""",
    "a loop that only return leaves": """
        a = 0.0
        while True:
            a += 1.0
            if a > s.v or a > 9:
                return a, 0.0""",
    "items that the loop changes": """
        x, c = s.x, 0.0
        for a in (x, x + 1, p.k):
            x = 5.0
            c = c + a
        return c, 0.0""",
    "an array of two names": """
        new = np.zeros(2)
        q = np.array([s.x, 1.0])
        new += s.x
        r = q
        r += s.x
        r[1] = 7.0
        return q[0] + q[1] + new[1], 0.0""",
    "truths of NumPy known": "return (f > 0) + (f > 1) + s.x, 0.0",
    "truths of NumPy's functions": "return np.greater(s.x, 0) * s.x, 0.0",
    "numbers of NumPy": """
        q = np.array([s.x, s.v])
        a = np.where(s.x > 1, s.x, s.v) * (1 / np.clip(s.x, -1, 2))
        return 1 / np.float64(s.x) + a + 1 / q.sum() + 1 / q[0], 0.0""",
    "a logarithm to a base": "return math.log(8 + s.x * s.x, 2) + math.log(s.x, 3), 0.0",
    "a dict, and s in a tuple": """
        z = (s, s.x)
        return D["a"] * z[1] + z[0].v, 0.0""",
    "a negative shift": """
        if s.x > 0:
            return (1 << -1) + 1.0, 0.0
        return 1.0, 0.0""",
    "a name that the translator gives, too": """
        part0 = s.x
        part1 = s.x
        a, b = pair(s.v)
        return part0 + part1 + a * b, 0.0""",
    "a whole zero has no sign": "return math.atan2(int(-0.5 + 0 * s.x), -1.0), 0.0",
    "an object with fields": "return law(s.x), 0.0",
    "a constant after what may fail": "return late(s.x) * s.v, 0.0",
}


def test_loops_tuples_and_numpy_are_pythons():
    call = written("def call(self, x):\n    return 2.5 * x")["call"]
    law = dataclasses.make_dataclass("Law", ["g"], namespace={"__call__": call})(1.0)  # no hash
    made = written("""
        def late(x):
            y = 1 / x
            return 2
        def pair(x):
            return x + 1, x
        """)
    names = {"U": [1.0, 2.0], "D": {"a": 1.5}, "f": np.float64(2.5), "law": law}
    names |= {"late": made["late"], "pair": made["pair"]}
    exec("unread = lambda t, s, p, k=2.0: (k * s.x - t, 0.0)", names)  # no source to be had
    bodies = [textwrap.indent(textwrap.dedent(body), "    ") for body in CORNERS.values()]
    flows = [written(f"def flow(t, s, p):\n{body}", **names)["flow"] for body in bodies]
    system = plane([*flows, names["unread"]])
    for k, text in enumerate([*CORNERS, "a default without source"]):
        for t, *y in POINTS:
            with np.errstate(all="ignore"):
                plain, fast = both(system, k, t, y)
            assert alike(plain[0], fast[0]), (text, t, y, plain[0], fast[0])


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            "k = 1\n    while k < s.x + 1e30:\n        k *= 10\n    return (k,)",
            r"\(line 4\) .* 2\*\*53",
        ),
        (
            "return (int(t + 1e10) * int(s.x + 1e9),)",
            r"\(line 2\) has whole numbers beyond 2\*\*53",
        ),
        ("return ((s.x > 10**17 + 1) + 1.0,)", r"\(line 2\) has whole numbers beyond 2\*\*53"),
        ("return (round(s.x, 2),)", r"\(line 2\) calls round"),
        ("print(s.x)\n    return (1.0,)", r"the flow of mode 'm' \(line 2\) calls print"),
        ("assert s.x > 0\n    return (1.0,)", r"\(line 2\) has a statement .* `assert s.x > 0`"),
        (
            "if s.x > 2:\n        raise ValueError\n    return (1.0,)",
            r"\(line 3\) .*`raise ValueErr",
        ),
        ("return (random.random(),)", r"calls Random.random"),
        ("return (np.random.normal(),)", r"calls .*RandomState.normal"),
        ("return (generator.normal(),)", r"calls .*Generator.normal"),
        ("return (helper(s.x),)", r"calls 'helper': it \(line 2\) calls list.append"),
        ("if s.x < 2:\n        return (1.0,)", "can end without a `return`"),
        ("return (s['x'],)", "s\\.x, not s\\['x'\\]"),
        ("return (again(s.x),)", "calls itself"),
        ("return (math.hypot(s.x, 1.0, 2.0),)", r"\(line 2\) calls math.hypot, which"),
        ("return ((U * int(s.x + 2))[0] * s.x,)", r"\(line 2\) is not compiled: `U \* int"),
        ("q = A\n    q *= 1\n    return (q[0],)", r"\(line 3\) changes something in place"),
        ("return (1 / max(A[0], s.x),)", r"\(line 2\) reckons with what may be NumPy's"),
        ("return ((not s) + s.x,)", r"\(line 2\) takes for a condition what is none: `s`"),
        (
            "q = np.float64(s.x)\n    return ((q > 0) + (q > 1),)",
            "what may be NumPy's numbers, which have",
        ),
    ],
)
def test_what_is_not_compiled_runs_plain_and_says_why(body, words):
    helper = written("def helper(x):\n    log.append(x)\n    return x", log=[])["helper"]
    again = written("def again(x):\n    return x if x < 0 else again(x - 1)")["again"]
    names = {"random": random, "generator": np.random.default_rng(1), "helper": helper}
    names |= {"U": [1.0, 2.0], "A": np.ones(2)}
    flow = written(f"def flow(t, s, p):\n    {body}", again=again, **names)["flow"]
    system = one(flow, start={"x": 0.5})
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            run = simulate(system, 1.0, backend="compiled", max_steps=500)  # chance has no end
            assert run.work.backend == "plain"
            told = [str(each.message) for each in said]
        except ModelError as error:  # it cannot run at all
            told = [str(error)]
    assert any(re.search(words, text) for text in told), told
    if "s[" not in body:
        with pytest.warns(UserWarning, match="'one' runs in plain Python, because the flow"):
            run = simulate(one(flow, start={"x": 0.5}), 1.0, method="RK4", step=0.5)
        assert run.work.backend == "plain"


# ---------------------------------------------------------------- never an old value


class Planet:
    n = 2

    def __init__(self):
        self.g, self.deep = 9.81, types.SimpleNamespace(R=3)


def test_constants_in_modules_and_objects():
    module, planet = types.ModuleType("module"), Planet()
    module.g, module.table, module.inner = 1.5, [1.0, 2.0], types.SimpleNamespace(k=4)
    text = "module.g + 10*planet.g + 100*planet.deep.R + 1000*planet.n + module.table[int(t)]"
    system = one(flow_of(text + " + 1e4*module.inner.k", module=module, planet=planet))

    def right():
        s, t = types.SimpleNamespace(x=1.0), 0.0
        return eval(
            text + " + 1e4*module.inner.k", {"module": module, "planet": planet, **locals()}
        )

    for change in (
        lambda: None,
        lambda: setattr(module, "g", 2.5),
        lambda: setattr(planet, "g", 1.62),
        lambda: setattr(planet.deep, "R", 5),
        lambda: setattr(planet, "deep", types.SimpleNamespace(R=7)),
        lambda: setattr(Planet, "n", 3),
        lambda: module.table.__setitem__(0, -1.0),
        lambda: setattr(module.inner, "k", 5),
        lambda: setattr(module, "g", 2),
    ):
        change()
        assert slope(system) == right()


def test_tables_that_change_in_place():
    A, L, nested, shared = np.ones(3001), [1.0, 2.0], ([1, 2], [3, 4]), {"a": 1}
    space = written(
        """
        def helper(x, M=M):
            return M[0] * x
        def flow(t, s, p, A=A, *, L=L):
            return (A[1500] + L[0] + nested[1][int(t)] + helper(s.x),)
        """,
        A=A, L=L, M=np.array([2.0, 0.0]), nested=nested,
    )  # fmt: skip
    system = one(space["flow"])
    assert slope(system) == 1 + 1 + 3 + 2
    A[1500] = 5.0
    assert slope(system) == 5 + 1 + 3 + 2
    L[0] = 7.0
    assert slope(system) == 5 + 7 + 3 + 2
    nested[1][0] = -3
    assert slope(system) == 5 + 7 - 3 + 2
    space["helper"].__defaults__[0][0] = 4.0
    assert slope(system) == 5 + 7 - 3 + 4
    space["flow"].__kwdefaults__ = {"L": [0.0]}
    assert slope(system) == 5 + 0 - 3 + 4
    space["helper"].__code__ = written("def helper(x, M=0):\n    return 9.0")["helper"].__code__
    del shared


def test_a_value_is_part_of_the_key_with_all_its_bytes():
    A = np.zeros(5000)
    system = one(flow_of("A[int(t)]", A=A))
    first = Program(system).key
    A[2500] = 1e-300
    assert Program(system).key != first
    A[2500] = 0.0
    assert Program(system).key == first


def test_without_source_text_the_names_are_part_of_the_key():
    def made(text):  # both have the same bytecode, which counts names
        exec(f"flow = lambda t, s, p: {text}", space := {})
        return Program(plane([space["flow"]])).key

    assert made("(s.x, s.v + 1.0)") != made("(s.v, s.x + 1.0)")
    exec("whole = lambda t, s, p, k=2: (k * s.x, 0.0)", space := {})
    with pytest.raises(Unfit, match="reckons with more than floats"):
        Program(plane([space["whole"]]))


def test_systems_that_are_used_no_more_are_let_go(monkeypatch):
    """The caches of code and workspaces hold the system that they are for."""
    monkeypatch.setattr(backend, "MOST", 2)
    flow, seen = flow_of("-s.x"), []
    for kind, count in (("plain", 66), ("compiled", 4)):
        for _ in range(count):
            system = one(flow)
            simulate(system, 0.1, method="RK4", step=0.1, backend=kind)
            seen.append(weakref.ref(system))
    del system
    for _ in range(64):  # other pools; the code of the last two is kept
        simulate(one(flow), 0.1, method="RK4", step=0.1, backend="plain")
    gc.collect()
    assert [ref() is not None for ref in seen] == [False] * 68 + [True] * 2


def test_a_slider_compiles_and_translates_nothing(monkeypatch):
    system = one(flow_of("p.k*A[int(t)]", A=np.arange(3.0)))
    simulate(system, 1.0, backend="compiled")
    monkeypatch.setattr(backend, "Program", None)
    for k in (1.0, 2.0):
        assert simulate(system, 1.0, backend="compiled", k=k).work.backend == "compiled"


# ---------------------------------------------------------------- failures are the same


@pytest.mark.parametrize("kind", ["compiled", "plain"])
def test_an_index_beyond_its_table_ends_the_run_in_words(kind):
    for table in ([1.0, 2.0, 3.0], np.arange(3.0), (1, 2, 3)):
        run = simulate(one(flow_of("U[int(t)]", U=table)), 10.0, backend=kind)
        assert run.t[-1] == pytest.approx(3.0) and "the flow of mode 'm'" in run.stopped
        assert "index" in run.stopped and "out of" in run.stopped and "U[int(t)]" in run.stopped
    for text, right in (("U[-1]", 3.0), ("U[-int(s.x)-2]", 1.0), ("M[1][-2]", 3.0)):
        tables = {"U": [1.0, 2.0, 3.0], "M": np.array([[1.0, 2.0], [3.0, 4.0]])}
        assert simulate(one(flow_of(text, **tables)), 1e-3, backend=kind).final["x"] == (
            pytest.approx(1 + 1e-3 * right)
        )


@pytest.mark.parametrize("kind", ["compiled", "plain"])
def test_a_logistic_switch_whose_exp_overflows(kind):
    flow = flow_of("-1.0 / (1.0 + math.exp(-s.x / 0.001)) - 0.5")
    run = simulate(one(flow, start={"x": 0.5}), 3.0, backend=kind)
    assert run.final["x"] == pytest.approx(-4 / 3, abs=2e-3)


FAILURES = [
    "1/(s.x-1)",
    "math.sqrt(-s.x)",
    "math.log(s.x-1)",
    "(-s.x)**0.5",
    "(s.x-1)**-1",
    "s.x%(s.x-1)",
    "s.x//(s.x-1)",
    "int(1e308*s.x*10)",
    "math.asin(2*s.x)",
    "math.fmod(s.x,0.0)",
    "(1e200*s.x)**2",
    "1/(1+1/(s.x-1))",
    "max(0.0,math.log(s.x-1))",
    "U[int(5*s.x)]",
    "1/(U[0]-1)",
]


def test_a_failure_is_not_a_number_in_both():
    system = plane([flow_of(text, "0.0", U=[1.0, 2.0]) for text in FAILURES])
    for k, text in enumerate(FAILURES):
        plain, fast = both(system, k, 0.0, [1.0, 0.0])
        assert math.isnan(plain[0]) and math.isnan(fast[0]), text


def test_a_failing_guard_leaves_the_others_their_values():
    guards = [flow_of("math.sqrt(s.x)"), flow_of("s.x - 5")]
    guards = [written("g = lambda t, s, p: f(t, s, p)[0]", f=f)["g"] for f in guards]
    made = [Transition("m", "m", guard=guard) for guard in guards]
    system = one(flow_of("1.0"), transitions=made)
    code, vector = backend.compiled(system, wait=True), ctypes.c_double * 2
    whole, pointer = ctypes.c_int64, ctypes.POINTER(ctypes.c_double)
    kind = ctypes.CFUNCTYPE(None, whole, whole, ctypes.c_double, pointer, pointer, pointer)
    out = vector()
    kind(code.model)(1, 0, 0.0, vector(-1.0, 0.0), vector(2.0, 0.0), out)
    assert math.isnan(out[0]) and out[1] == -6.0


# ---------------------------------------------------------------- what else is a function


class Law:
    def __init__(self, g):
        self.g = g

    def __call__(self, t, s, p):
        return (self.g * s.x,)

    def method(self, t, s, p):
        return (self.g + s.x,)


def test_lambdas_of_one_line_are_told_apart_without_columns(tmp_path):
    """Python 3.12 keeps no columns of a lambda that gives a constant; this option, none at all."""
    text = """
        import ast
        from labkit.solve.syntax import tree

        made = [lambda s: (1.0,), lambda s: (0.0,), lambda s: (-0.0,), lambda s: (1,)]
        made += [lambda s: (s.x,), lambda s: (s.y,), lambda s, k=2: (s.x,), lambda s: s.x]
        for function in made:
            again = eval(compile(ast.Expression(tree(function)), "<again>", "eval"))
            for part in ("co_consts", "co_names", "co_varnames", "co_code"):
                mine, its = getattr(again.__code__, part), getattr(function.__code__, part)
                assert repr(mine) == repr(its), (part, mine, its)
    """
    path = tmp_path / "lines.py"
    path.write_text(textwrap.dedent(text), encoding="utf-8")
    subprocess.run([sys.executable, "-X", "no_debug_ranges", path], check=True, cwd=ROOT)


def test_partials_objects_and_methods():
    law = Law(3.0)
    part = functools.partial(written("def f(k, t, s, p, m=1):\n    return (k*m*s.x,)")["f"], 2, m=5)
    systems = [one(part), one(law), one(law.method)]
    assert [slope(system) for system in systems] == [10.0, 3.0, 4.0]
    law.g = 4.0
    assert [slope(system) for system in systems] == [10.0, 4.0, 5.0]
    tables = np.arange(3.0), np.array([0.0, 10.0, 20.0])
    assert slope(one(flow_of("np.interp(s.x, table[0], table[1])", table=tables))) == 10.0
    deep = written("def f(x, n):\n    return x if n == 0 else 2 * f(x, n - 1)")["f"]
    assert slope(one(flow_of("f(s.x, 5)", f=deep))) == 32.0


@pytest.mark.parametrize("letter", ["\u00b5", "\u03d5", "\u03f5"])
def test_letters_that_python_makes_into_others(letter):
    flow = flow_of(f"-p.{letter} * s.x")
    system = one(flow, parameters={letter: 0.5})
    assert simulate(system, 1.0, **{letter: 1.0}).final["x"] == pytest.approx(math.exp(-1))
    with pytest.raises(ModelError, match="the same to Python"):
        one(flow, parameters={letter: 0.5, **dict.fromkeys(system.parameters, 1.0)})


# ---------------------------------------------------------------- words


def fall(flow, **more):
    states, start = {"x": "m", "v": "m/s"}, {"x": 1.0, "v": 0.0}
    return System("fall", states, {"g": 9.81}, [Mode("m", flow)], start=start, **more)


GOOD = flow_of("s.v", "-p.g")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{s.v, -p.g}", "the flow of mode 'm' returns a set, which has no order"),
        ("{'x': s.v, 'v': -p.g}", "returns a dict: it must return a tuple of 2 derivatives"),
        ("None", r"returns None: .* \(is a `return` missing"),
        ("'ab'", "returns 'ab': it must return a tuple"),
        ("(s.v, '-9.81')", "returns '-9.81' for 'v': it must be a number"),
        ("(s.v, None)", "returns None for 'v': it must be a number"),
        ("(s['v'], -p.g)", r"read as s.v, not s\['v'\]"),
        ("(s[5], 0.0)", "the flow of mode 'm' fails at the start, .*IndexError"),
        ("(s.v, -G)", "the flow of mode 'm' asks for a name that is not there .*'G'"),
        ("(s.v, -p.G)", "unknown name: 'P' object has no attribute 'G'"),
        ("(np.ones(2), np.ones(2))", "returns array.* for 'x': it must be one number"),
    ],
)
def test_flows_in_words(text, words):
    flow = written(f"flow = lambda t, s, p: {text}")["flow"]
    with pytest.raises(ModelError, match=words):
        simulate(fall(flow), 1.0)


def test_more_words():
    assigns = written("def flow(t, s, p):\n    s.v = 0.0\n    return s.v, -p.g")["flow"]
    later = written("def flow(t, s, p):\n    if s.x > 0.5:\n        return s.v, -p.g")["flow"]
    longer = written("def flow(t, s, p):\n    return (s.v, -p.g) if s.x > 0.5 else (0, 1, 2)")[
        "flow"
    ]
    none = Transition("m", "m", guard=lambda t, s, p: None)
    mapping = Transition("m", "m", guard=lambda t, s, p: s.x, reset=lambda t, s, p: {"x": 1})
    for make, words in (
        (lambda: fall(assigns), "assigns to a state or parameter .*only a reset changes a state"),
        (lambda: fall(later), "the flow of mode 'm' returns None"),
        (lambda: fall(longer), "returns 3 values, but there are 2 states"),
        (lambda: fall(GOOD, transitions=[none]), "the guard of 'm → m' returns None"),
        (lambda: fall(GOOD, transitions=[mapping]), "the reset of 'm → m' returns a dict"),
        (lambda: At([1.0, 2.0]), r"write the instants one by one, At\(1, 2\)"),
    ):
        with pytest.raises(ModelError, match=words):
            simulate(make(), 1.0, backend="plain")


# ---------------------------------------------------------------- what is kept on disk

posix = pytest.mark.skipif(
    sys.platform == "win32", reason="a user's folders are kept by other means"
)


@posix
def test_the_cache_is_a_folder_of_the_users_own(tmp_path, monkeypatch):
    good = tmp_path / "good"
    monkeypatch.setenv("LABKIT_CACHE", str(good))
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(cache, "_users", lambda: tmp_path / "file" / "home")
    cache.write("a.bin", b"code")
    assert cache.folder() == good and cache.read("a.bin") == b"code" and cache.has("a.bin")
    assert good.stat().st_mode & 0o777 == 0o700
    (good / "a.bin").chmod(0o666)
    assert cache.read("a.bin") is None
    (good / "a.bin").chmod(0o600)
    (good / "link.bin").symlink_to(good / "a.bin")
    assert cache.read("link.bin") is None
    good.chmod(0o777)
    assert cache.folder() != good and cache.read("a.bin") is None
    good.chmod(0o700)
    (tmp_path / "link").symlink_to(good)
    monkeypatch.setenv("LABKIT_CACHE", str(tmp_path / "link"))
    assert cache.folder() != good and cache.read("a.bin") is None
    monkeypatch.setenv("LABKIT_CACHE", str(tmp_path / "file" / "inside"))
    assert cache.folder().stat().st_mode & 0o777 == 0o700  # one of this process's own
    assert cache.folder() == cache.folder()


@posix
@pytest.mark.parametrize("owner, code", [(0, b"code"), (4321, None)])
def test_a_folder_of_the_administrator_is_read_and_of_another_user_is_not(
    tmp_path, monkeypatch, owner, code
):
    """A cache for all users of a server: nobody else writes to it, what is new goes home."""
    shared, home = tmp_path / "shared", tmp_path / "home"
    monkeypatch.setenv("LABKIT_CACHE", str(shared))
    cache.write("a.bin", b"code")
    monkeypatch.setattr(cache, "_users", lambda: home)
    state, opened = os.lstat, os.fstat

    def owned(found):
        return os.stat_result([*found[:4], owner, *found[5:]])

    theirs = state(shared / "a.bin").st_ino
    monkeypatch.setattr(
        os, "lstat", lambda path: owned(state(path)) if path == shared else state(path)
    )
    monkeypatch.setattr(
        os, "fstat", lambda k: owned(opened(k)) if opened(k).st_ino == theirs else opened(k)
    )
    user = os.geteuid() + 7
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert cache.read("a.bin") == code and cache.has("a.bin") == bool(code)
    assert cache.folder() != shared


def test_damaged_code_is_made_anew():
    data = backend._packed(b"no machine code", b"")
    assert backend._load(data) is None
    assert backend._load(data[:-1]) is None and backend._load(b"") is None


def test_loops_of_the_core_stay_loops():
    """What `python -m labkit.solve` tells Numba is heard: else a run takes a fifth longer."""
    text = """
        from numba import njit
        from labkit.solve.__main__ import keep_loops_short
        def size():
            def add(n, a):
                for i in range(n):
                    a[i] += 1.0
            function = njit("void(int64, float64[::1])", no_cpython_wrapper=True)(add)
            (code,) = function.inspect_asm().values()
            return len(code)
        long = size()
        keep_loops_short()
        assert size() < 0.85 * long, (size(), long)
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(text)], check=True)


def test_numba_switched_off():
    """Also where the compiled code lies on the disk already."""
    program = (
        "from tests.systems import ball\nfrom labkit import simulate, ModelError\n"
        "print(simulate(ball(), 1.0).work.backend)\n"
        "try: simulate(ball(), 1.0, backend='compiled')\nexcept ModelError as e: print(e)"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": ROOT}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.stdout.split()[0] == "plain" and "NUMBA_DISABLE_JIT" in done.stdout, done.stderr
