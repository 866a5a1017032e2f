"""The formulas that are shown are the functions that are simulated.

Traced expressions against the functions themselves.
"""

import functools
import math
import re
import subprocess
import sys
import types
from math import copysign, pi, sin
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.diagram import mode_diagram
from labkit.equations import Untraced, equations, jacobian, parameter_table
from labkit.model import At, Every, Mode, ModelError, Output, Parameter, System, Transition
from labkit.show import latex_name
from labkit.table import Table

from .systems import stick_slip

HERE = Path(__file__).resolve().parent.parent
RATIO = 1.7
POINTS = (-1.0, 0.0, 0.5, 2.0)
SLOPES = (0.3, 2.0, -1.0)
MATRIX = np.array([[0.0, 1.0], [-2.0, -0.3]])


def sgn(x):
    return 1.0 if x > 0 else -1.0 if x < 0 else 0.0


def clipped(x, low, high=1.5):
    if x < low:
        return low
    elif x > high:
        return high
    return x


def stribeck(s, p):
    if s.v < p.k:
        return 4 + 1.88 * (1 - s.v / p.k) ** 2
    return 4.0


def hysteresis(x, v, a, branch=+1):
    edge = a if branch > 0 else -a
    return sgn(x - edge) if v > 0 else sgn(x + edge)


def both(x, v):
    return x * v, x + v


def inside(x, a):
    return -a < x and x < a


def broken_line(x):
    total = 0.5
    for i in range(len(POINTS) - 1):
        if x > POINTS[i]:
            total += SLOPES[i] * (min(x, POINTS[i + 1]) - POINTS[i])
    return total


def recursive(x, n):
    return x if n == 0 else 0.5 * recursive(sin(x), n - 1)


def make_gear(q):
    ratio = (50, 32, 20, 14)[q]
    return lambda t, s, p: ratio / p.k * s.v - np.sign(s.v) * s.v**2


def flow_if(t, s, p):
    if s.x >= 0 and s.v > 0:
        f = p.k
    elif s.x < -1 or t > 3:
        f = -p.k * t
    else:
        f = 0
    return f - p.d * s.v


# Each is a function (t, s, p) -> number of the states x, v and the parameters k > 0, d.
FUNCTIONS = {
    "arithmetic": lambda t, s, p: -p.k * s.x / 3 + 2 * (s.v - p.d) ** 2 - +s.x,
    "from math": lambda t, s, p: sin(s.x) + copysign(p.k, s.v) + abs(s.x - 1),
    "math": lambda t, s, p: (
        math.sqrt(s.x**2 + 1) * math.exp(-p.k)
        + math.atan2(s.x, p.k)
        + math.hypot(s.x, s.v)
        + math.log(p.k, 3)
        + math.fabs(p.d)
    ),
    "numpy": lambda t, s, p: (
        np.sin(np.pi * t)
        + np.arctan(s.x)
        + np.sign(s.v) * np.tanh(s.x)
        + np.maximum(s.x, s.v)
        - np.clip(s.v, -1, p.k)
    ),
    "numpy where": lambda t, s, p: (
        np.where(s.x > p.d, s.v, -s.v)
        + np.interp(s.x, POINTS, (0, 2, 1, 5))
        + np.heaviside(s.v, 0.5)
    ),
    "numpy scalar on the left": lambda t, s, p: np.float64(2.0) * s.x - np.float64(1.5) / p.k,
    "remainder": lambda t, s, p: (
        s.x % 2 + s.v // 0.5 + math.floor(t) % 2 + math.fmod(s.x, 1.5) + int(s.v) + math.ceil(s.x)
    ),
    "min and max": lambda t, s, p: max(s.x, 0.0, p.d) - min([s.x, s.v]),
    "constants": lambda t, s, p: RATIO * s.x + pi / 3 + 2 * pi * t + MATRIX[1, 0] * s.v + 0.1,
    "matrix": lambda t, s, p: (MATRIX @ np.array([s.x, s.v]))[1],
    "truth as a number": lambda t, s, p: (s.x > 0) * 2.0 - (s.x < p.d) + float(s.v),
    "if": flow_if,
    "conditional": lambda t, s, p: (s.x if -1 < s.x < 1 else 2 * s.x) if not s.v > 0 else p.k,
    "number as truth": lambda t, s, p: 1.0 if s.x else 2.0,
    "equality": lambda t, s, p: 3.0 if s.x == 1.0 else 4.0 if s.v != 0 else 5.0,
    "helper": lambda t, s, p: p.k * sgn(s.x - p.d) + sgn(2 * s.v),
    "helper of the state": lambda t, s, p: (p.k * s.x - stribeck(s, p)) / p.k,
    "helper with keywords": lambda t, s, p: clipped(s.x, low=-p.k) + clipped(s.v, 0.0, high=p.k),
    "helper in a helper": lambda t, s, p: (
        hysteresis(s.x, s.v, p.k) - hysteresis(s.x, s.v, p.k, branch=-1)
    ),
    "helper of two values": lambda t, s, p: both(s.x, p.k)[0] + both(s.v, s.x)[1],
    "helper of truth": lambda t, s, p: s.x if inside(s.v, p.k) else 0.0,
    "loop": lambda t, s, p: broken_line(s.x),
    "recursion": lambda t, s, p: recursive(s.x, 3),
    "closure": make_gear(1),
    "inner function": lambda t, s, p: (lambda u: u**2 if u > p.d else -u)(s.x),
    "partial": functools.partial(lambda q, t, s, p: q * s.x, 3.0),
    "constant": lambda t, s, p: 0.0,
    "index": lambda t, s, p: s[0] - p[1],
}


def system_of(function, **options):
    return System(
        "test",
        states={"x": "m", "v": "m/s"},
        parameters={"k": 1.0, "d": 0.0},
        modes=[Mode("only", lambda t, s, p: (s.v, function(t, s, p)))],
        start={"x": 0.0, "v": 0.0},
        **options,
    )


@functools.cache
def compiled(name):
    made = equations(system_of(FUNCTIONS[name]))
    flow = made.flows["only"]
    assert not isinstance(flow, Untraced), flow
    assert flow["x"] == made.states["v"]
    return sp.lambdify(
        [made.t, *made.states.values(), *made.parameters.values()], flow["v"], "math"
    ), made.system


numbers = st.one_of(
    st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0]),
    st.floats(-4, 4).filter(lambda x: abs(x) > 1e-6),
)


@pytest.mark.parametrize("name", FUNCTIONS)
@settings(max_examples=60, deadline=None)
@given(
    t=st.floats(0, 7),
    x=numbers,
    v=numbers,
    k=st.one_of(st.sampled_from([0.5, 1.0, 1.5]), st.floats(0.1, 3)),
    d=numbers,
)
def test_formula_is_the_function(name, t, x, v, k, d):
    formula, system = compiled(name)
    p = system.P(k, d)
    exact = float(FUNCTIONS[name](t, system.S["only"](x, v), p))
    assert formula(t, x, v, k, d) == pytest.approx(exact, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize(
    "first", ["import labkit.equations", "from labkit import jacobian", "pass"]
)
def test_name_of_function_and_module(first):
    code = (
        f"{first}\nfrom labkit import equations, Mode, System\n"
        "mode = Mode('m', lambda t, s, p: (1.0,))\n"
        "print(equations(System('s', states={'x': ''}, modes=[mode], start={'x': 0})))"
    )
    assert (
        "x' = 1"
        in subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=HERE
        ).stdout
    )


def test_functions_are_left_alone():
    before = dict(sgn.__globals__)
    equations(system_of(FUNCTIONS["helper"]))
    assert sgn.__globals__["sin"] is before["sin"] and sgn(-3.0) == -1.0
    relation = sp.Gt(sp.Symbol("x"), 0)
    assert (relation == True) is False  # noqa: E712  SymPy's own relations are as before
    with pytest.raises(TypeError):
        bool(sp.Symbol("x") > 0)


def friction():
    def slip(t, s, p):
        return p.Vp - s.V, (p.k * s.x - F(s.V, p)) / p.m

    def F(V, p):
        if V < p.V0:
            return p.Fc + (p.Fs - p.Fc) * (1 - V / p.V0) ** 2
        return p.Fc

    return stick_slip().variant(
        "dry friction",
        states={"x": ("m", "spring")},
        parameters={
            "m": Parameter(1.0, "kg", "mass", 0.1, 5.0),
            "k": Parameter(2.0, "N/m", low=0.0),
            "V0": Parameter(1.0, symbol=r"\hat V"),
        },
        modes={
            "stick": Mode("stick", lambda t, s, p: (p.Vp, 0.0), meaning="at rest"),
            "slip": slip,
        },
        transitions={"break loose": {"label": "breaks loose"}, "stick again": {"label": ""}},
        outputs={"F": Output({"slip": lambda t, s, p: F(s.V, p)}, "N")},
    )


def test_display_keeps_the_helper_and_flows_write_it_out():
    made = equations(friction())
    text = made._repr_markdown_()
    assert r"\dot{x} &= V_{p} - V" in text
    assert r"\dot{V} &= \frac{k \, x - F\left(V\right)}{m}" in text
    assert (
        r"F\left(V\right) &= \begin{cases} \left(F_{s} - F_{c}\right) \, \left(1 - \frac{V}{\hat "
        r"V}\right)^{2} + F_{c} & \text{for}\: V < \hat V" in text
    )
    assert "- **breaks loose**, *stick* → *slip*: when $k \\, x - F_{s}$ rises through 0" in text
    assert "- *slip* → *stick*: when $V$ falls through 0; then $V^{+} = 0$" in text
    assert (
        "$x$ spring [m], $V$ [m/s]" in text
        and "Mode *stick* — at rest" in text
        and "Start in *stick* with $x = 0$ m, $V = 0$ m/s" in text
    )
    V, m, k, x, Fc = (sp.Symbol(n, real=True) for n in ("V", "m", "k", "x", "Fc"))
    assert made.flows["slip"]["V"].has(sp.Piecewise)
    assert (
        made.flows["slip"]["V"].subs(V, 3).subs(sp.Symbol("V0", real=True), 1) == (k * x - Fc) / m
    )
    assert made.guards[1] == V and made.resets == [None, {"x": x, "V": 0}]
    assert made.outputs["F"]["slip"].has(sp.Piecewise) and list(made.outputs["F"]) == ["slip"]
    assert "V' = " in repr(made)


def test_one_helper_with_two_fixed_numbers_gives_two_definitions():
    text = equations(system_of(FUNCTIONS["helper in a helper"]))._repr_markdown_()
    assert (
        r"\mathrm{hysteresis}\left(x, v, k, 1\right) - \mathrm{hysteresis}\left(x, v, k, -1\right)"
        in text
    )
    assert r"\mathrm{hysteresis}\left(x, v, a, -1\right) &= \begin{cases}" in text


def test_a_helper_is_walked_once_for_arguments_of_one_kind():
    walks = []
    walked = walks.append

    def helper(x, side):
        walked(side)
        return side * x if x > 0 else -x

    def flow(t, s, p):
        return helper(s.x, 1) + 2 * helper(s.v - 1, 1) + helper(s.x * s.v, 2)

    system = system_of(flow)
    walks.clear()  # what a System tries when it is made
    made = equations(system)
    e = made.flows["only"]["v"]
    assert walks == [1, 1, 2, 2]  # both ways, once for each fixed number
    assert e.subs({made.states["x"]: 3, made.states["v"]: -1}) == 3 + 2 * 2 + 3
    assert r"\mathrm{helper}\left(v - 1, 1\right)" in made._repr_markdown_()


def test_a_helper_is_walked_again_when_what_it_reads_may_have_changed():
    box, count = types.SimpleNamespace(k=0.0), [0]

    def stiff(x, box):
        return box.k * x

    def counted(x):
        count[0] += 1
        return count[0] * x

    def by_way(x):
        return counted(x)

    def flow(t, s, p):
        box.k = 1.0
        a = stiff(s.x, box)
        box.k = 2.0
        count[0] = 0
        return a + 10 * stiff(s.x, box) + 100 * counted(s.x) + 1000 * by_way(s.x)

    x = sp.Symbol("x", real=True)
    assert sp.expand(equations(system_of(flow)).flows["only"]["v"]) == 2121 * x


def test_formulas_are_those_of_the_call():
    """Not those of the first look: a notebook's K may be another by then."""
    scope = {}
    exec("K = 2\ndef flow(t, s, p):\n    return K * s.x", scope)
    system = system_of(scope["flow"])
    made = equations(system)
    scope["K"] = 3
    assert made.flows["only"]["v"] == 2 * made.states["x"]
    assert "2 \\, x" in made._repr_markdown_()


def test_helpers_stand_in_one_order_whatever_is_looked_at_first():
    guard = Transition("only", None, lambda t, s, p: clipped(s.v, -1), direction=1)
    system = system_of(lambda t, s, p: sgn(s.x), transitions=[guard])
    first = equations(system)
    assert first.guards and first._repr_markdown_() == equations(system)._repr_markdown_()


def test_words_of_transitions():
    def up(t, s, p):
        return s.x - p.k

    def text(**options):
        return equations(
            system_of(FUNCTIONS["constant"], transitions=[Transition("only", **options)])
        )._repr_markdown_()

    same = {"target": "only"}
    assert "when $x - k$ passes through 0\n" in text(guard=up, **same)
    assert "rises through 0 by more than 0.1\n" in text(
        guard=up, direction=1, tolerance=0.1, **same
    )
    assert "falls through 0, or is below 0 already when the mode is entered" in text(
        guard=up, direction=-1, urgent=True, **same
    )
    assert "passes through 0, after a dead time of $k$" in text(guard=up, delay="k", **same)
    assert "after a dead time of $0.25$ s" in text(guard=up, delay=0.25, **same)
    assert "every $k$\n" in text(at=Every("k"), **same)
    assert "every $20$ s, first at $d \\, k$" in text(at=Every(20, lambda p: p.d * p.k), **same)
    assert "at $t$ = $25$ s, $d$\n" in text(at=At(25, "d"), **same)
    assert "*only* → **end of the run**: when" in text(guard=up, target=None)
    assert "over to *only* (priority 2)" in text(guard=up, zeno="only", priority=2, **same)
    assert "; then $v^{+} = - k \\, v$" in text(
        guard=up, reset=lambda t, s, p: (s.x, -p.k * s.v), **same
    )
    assert "; the state is kept" in text(guard=up, reset=lambda t, s, p: (s.x, s.v), **same)


def test_modes_with_states_of_their_own():
    torn = System(
        "torn pendulum",
        states={"theta": "", "omega": "1/s"},
        parameters={"L": 2.0, "g": 9.81},
        modes=[
            Mode("swing", lambda t, s, p: (s.omega, -p.g / p.L * sin(s.theta))),
            Mode("flight", lambda t, s, p: (s.vx, -p.g), states={"x": "m", "vx": "m/s"}),
        ],
        transitions=[
            Transition(
                "swing",
                "flight",
                guard=lambda t, s, p: s.theta,
                reset=lambda t, s, p: (p.L * sin(s.theta), p.L * s.omega),
            ),
            Transition(("swing", "flight"), "swing", at=At(1.0), reset=lambda t, s, p: (s[0], 0.0)),
        ],
        start={"theta": 1.0, "omega": 0.0},
    )
    made = equations(torn)
    assert list(made.flows["flight"]) == ["x", "vx"] and made.flows["flight"]["vx"] == -sp.Symbol(
        "g", real=True
    )
    text = made._repr_markdown_()
    assert r"x^{+} = L \, \sin{\left(\theta \right)}" in text and r"v_{x}^{+} = L \, \omega" in text
    assert (
        r"\theta^{+} = x" in text
    )  # the reset from flight reads other states than the one from swing


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (lambda t, s, p: endless(s.x), "too many comparisons"),
        (lambda t, s, p: many(s.x), "more than 64 branches"),
        (lambda t, s, p: None, "returns nothing"),
        (lambda t, s, p: s.x > 0, "true or false"),
        (lambda t, s, p: round(s.x), "halves to even"),
        (lambda t, s, p: math.isqrt(s.x), "isqrt|integer"),
        (lambda t, s, p: forever(s.x), "calls itself without end"),
        (lambda t, s, p: s.wrong, "no attribute 'wrong'"),
        (lambda t, s, p: (1.0, 2.0), "2 values"),
    ],
)
def test_what_is_no_formula_is_shown_as_code(function, why):
    system = system_of(
        FUNCTIONS["constant"], transitions=[Transition("only", "only", guard=function)]
    )
    guard = equations(system).guards[0]
    assert isinstance(guard, Untraced)
    assert re.search(why, guard.why), guard.why
    assert "lambda t, s, p" in guard.source
    assert guard.why in equations(system)._repr_markdown_() and repr(equations(system))
    mode_diagram(system)


def endless(x):
    while x > 0:
        pass


def many(x):
    return sum(k if x > k else -k for k in range(100))


def forever(x):
    return forever(x + 1)


def test_flow_that_is_no_formula():
    system = System(
        "test",
        states={"x": "", "v": ""},
        modes=[Mode("only", lambda t, s, p: (s.v, round(s.x)))],
        start={"x": 0, "v": 0},
    )
    text = equations(system)._repr_markdown_()
    assert "```python" in text and "round(s.x)" in text and "Shown as code, because" in text
    with pytest.raises(ModelError, match="flow of mode 'only' has no Jacobian"):
        jacobian(system)
    wrong = System(
        "test",
        states={"x": "", "v": ""},
        modes=[Mode("only", lambda t, s, p: s.v)],
        start={"x": 0, "v": 0},
    )
    assert "it returns 1 values for the 2 states 'x', 'v'" in equations(wrong)._repr_markdown_()


def test_source_that_is_not_at_hand():
    scope = {}
    exec("def flow(t, s, p):\n    return (round(s.x),)", scope)
    text = equations(
        System("test", states={"x": ""}, modes=[Mode("only", scope["flow"])], start={"x": 0})
    )._repr_markdown_()
    assert "flow(t, s, p)" in text and "not at hand" in text


@settings(max_examples=40, deadline=None)
@given(x=st.floats(-2, 2), v=st.floats(-2, 2), k=st.floats(0.5, 2))
def test_jacobian_against_differences(x, v, k):
    def flow(t, s, p):
        return s.v * sin(s.x), (p.k * s.x - stribeck(s, p)) + s.v**2 * np.sign(s.v) + math.floor(
            t
        ) * s.x + s.x * (t % 2) + max(s.x, s.v)

    system = System(
        "test",
        states={"x": "", "v": ""},
        parameters={"k": 1.0},
        modes=[Mode("only", flow)],
        start={"x": 0, "v": 0},
    )
    if min(abs(v), abs(v - k), abs(x - v)) < 1e-3:  # at a kink there is no derivative
        return
    h = 1e-5
    p = system.values({"k": k})
    columns = []
    for dx, dv in ((h, 0), (0, h)):
        up, down = (
            np.array(flow(1.3, system.S["only"](x + a * dx, v + a * dv), p)) for a in (1, -1)
        )
        columns.append((up - down) / (2 * h))
    assert jacobian(system).at({"x": x, "v": v}, t=1.3, k=k) == pytest.approx(
        np.array(columns).T, abs=1e-4
    )


def test_jacobian():
    system = friction()
    matrix = jacobian(system, "slip")
    k, m = (sp.Symbol(n, real=True) for n in "km")
    assert isinstance(matrix, sp.MatrixBase) and matrix.shape == (2, 2)
    assert matrix[0, 1] == -1 and matrix[1, 0] == k / m
    assert jacobian(system).mode == "stick" and jacobian(system).is_zero_matrix
    assert matrix.at({"V": 2.0}).tolist() == [[0, -1], [2, 0]]
    assert matrix.at({"V": 0.5}, m=2.0)[1, 1] == pytest.approx(2 * (5.88 - 4) * 0.5 / 2)
    assert r"\hat V" in matrix._repr_latex_()
    with pytest.raises(
        ModelError, match="'slide' is not a mode of 'dry friction'; there are 'stick', 'slip'"
    ):
        jacobian(system, "slide")
    with pytest.raises(ModelError, match="'q' is not a parameter"):
        matrix.at(q=1)
    with pytest.raises(ModelError, match="unknown state"):
        matrix.at({"y": 1})


def test_parameter_table():
    table = parameter_table(friction())
    assert isinstance(table, Table) and len(table) == 6
    assert table.rows[0] == ("$m$", "`m`", "mass", "1", "kg", "0.1 … 5")
    assert table.rows[1][-1] == "≥ 0" and table.rows[2] == ("$V_{p}$", "`Vp`", "", "2", "", "any")
    assert table.rows[5][0] == r"$\hat V$"
    assert "<code>Fs</code>" in table._repr_html_() and ">5.88</td>" in table._repr_html_()
    assert "5.88" in repr(table)
    big = System(
        "b",
        states={"x": ""},
        parameters={"M": 1e20, "G": 6.6743e-11, "p0": Parameter(101325.0, high=2e5), "a": -1},
        modes=[Mode("m", lambda t, s, p: (0,))],
        start={"x": 0},
    )
    assert [row[3] for row in parameter_table(big).rows] == ["1e+20", "6.6743e−11", "101325", "−1"]


def test_a_case_of_a_helper_that_has_no_value_for_its_arguments_is_left_out():
    def share(a, b, c):
        return a if b == c else min((a - b) / (b - c), 1.0)

    made = System(
        "shares",
        {"x": "", "y": ""},
        modes=[Mode("m", lambda t, s, p: (share(s.x, s.x, s.x), share(s.x, s.y, s.x)))],
        start={"x": 1.0, "y": 2.0},
    )
    found = equations(made)
    x, y = found.states.values()
    assert found.flows["m"]["x"] == x
    assert found.flows["m"]["y"].subs({x: 1, y: 3}) == -1


@pytest.mark.parametrize("wrong", [equations, jacobian, parameter_table, mode_diagram])
def test_only_a_system_has_equations(wrong):
    with pytest.raises(ModelError, match="system of .* must be a System, not .ball."):
        wrong("ball")


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("x", "x"),
        ("k1", "k_{1}"),
        ("x0", "x_{0}"),
        ("omega", r"\omega"),
        ("omega1", r"\omega_{1}"),
        ("F_s", "F_{s}"),
        ("Fs", "F_{s}"),
        ("Vp", "V_{p}"),
        ("iL", "i_{L}"),
        ("Td", "T_{d}"),
        ("ktr", r"k_{\mathrm{tr}}"),
        ("vref", r"v_{\mathrm{ref}}"),
        ("Cmax", r"C_{\mathrm{max}}"),
        ("mass", r"\mathrm{mass}"),
        ("rod", r"\mathrm{rod}"),
        ("lambda_", r"\lambda"),
        ("lam0", r"\lambda_{0}"),
        ("ω0", r"\omega_{0}"),
        ("phi", r"\varphi"),
        ("eps1", r"\varepsilon_{1}"),
        ("omega_high", r"\omega_{\mathrm{high}}"),
        ("mass2", r"\mathrm{mass}_{2}"),
        ("T_c1", "T_{c1}"),
        ("on", r"\mathrm{on}"),
        ("Delta_x", r"\Delta_{x}"),
        ("mu", r"\mu"),
        ("p10", "p_{10}"),
        ("_", "_"),
    ],
)
def test_names_in_formulas(name, latex):
    assert latex_name(name) == latex


def test_sums_put_states_first_and_constants_last():
    made = equations(system_of(lambda t, s, p: p.d - 3 * s.v + p.k * t - p.k * s.x))
    assert r"\dot{v} &= k \, t - k \, x - 3 \, v + d" in made._repr_markdown_()
    made = equations(system_of(lambda t, s, p: p.d + s.v - 2 * s.x**2 + s.x**3 + 1))
    assert r"\dot{v} &= x^{3} - 2 \, x^{2} + v + d + 1" in made._repr_markdown_()


def test_numbers_in_formulas():
    made = equations(system_of(FUNCTIONS["constants"]))
    assert [
        made.latex(x)
        for x in (
            0.1,
            2.0,
            1e20,
            6.6743e-11,
            2 / 3,
            math.pi,
            2 * math.pi / 3,
            "k",
            lambda p: p.k * p.d,
        )
    ] == [
        "0.1",
        "2",
        "10^{20}",
        r"6.6743 \cdot 10^{-11}",
        "0.666667",
        r"\pi",
        r"\frac{2 \, \pi}{3}",
        "k",
        r"d \, k",
    ]


def graph(n, edges, start=0):
    names = [f"mode {i}" for i in range(n)]
    return System(
        "graph",
        states={"x": ""},
        parameters={"k": 1.0},
        modes=[
            Mode(name, lambda t, s, p: (1.0,), meaning="a meaning" * (i % 2))
            for i, name in enumerate(names)
        ],
        transitions=[
            Transition(
                names[a],
                None if b == n else names[b],
                guard=lambda t, s, p: s.x - p.k,
                direction=1,
                label=label,
            )
            for a, b, label in edges
        ],
        start={"x": 0.0},
        mode=names[start],
    )


def check_labels(fig):
    """No label meets another, a box or the edge of the picture."""
    renderer = fig.canvas.get_renderer()
    texts = [text for text in fig.axes[0].texts if text.get_text()]
    boxes = [text.get_window_extent(renderer) for text in texts]
    for i, box in enumerate(boxes):
        assert (
            fig.bbox.x0 <= box.x0
            and box.x1 <= fig.bbox.x1
            and fig.bbox.y0 <= box.y0
            and box.y1 <= fig.bbox.y1
        ), texts[i]
        for k in range(i):
            assert not box.overlaps(boxes[k]), (texts[i], texts[k])
    return texts


@settings(max_examples=15, deadline=None)
@given(data=st.data(), n=st.integers(1, 6))
def test_labels_of_a_mode_diagram_never_overlap(data, n):
    edge = st.tuples(
        st.integers(0, n - 1),
        st.integers(0, n),
        st.sampled_from(["", "up", "reaches the limit", "spring lets go of the block"]),
    )
    edges = data.draw(st.lists(edge, max_size=2 * n))
    texts = check_labels(mode_diagram(graph(n, edges, data.draw(st.integers(0, n - 1)))))
    words = " ".join(text.get_text().replace("\n", " ") for text in texts)
    for i in range(n):
        assert f"mode {i}" in words
    for _, _, label in edges:
        assert label in words


def test_a_condition_in_a_mode_diagram_is_large_enough_to_read():
    """Bars of Matplotlib's \\left| shrink to dots, and its fractions are of half the size."""
    guard = Transition("a", None, lambda t, s, p: abs(s.x) - s.x / p.k, direction=1)
    modes = [Mode("a", lambda t, s, p: (1.0,))]
    system = System("far", {"x": ""}, {"k": 1.0}, modes, [guard], start={"x": 0.0})
    (condition,) = (t.get_text() for t in mode_diagram(system).axes[0].texts if "$" in t.get_text())
    assert "left" not in condition and "dfrac" in condition


def test_a_mode_diagram_traces_the_guards_alone():
    seen = []

    def told(what, value):
        return lambda t, s, p: seen.append(what) or value(s)

    system = System(
        "test",
        {"x": "m"},
        modes=[Mode("a", told("flow", lambda s: (1.0,)))],
        transitions=[
            Transition(
                "a",
                "a",
                guard=told("guard", lambda s: s.x - 1),
                reset=told("reset", lambda s: (0.0,)),
            )
        ],
        outputs={"y": Output(told("output", lambda s: s.x))},
        start={"x": 0.0},
    )
    seen.clear()
    mode_diagram(system)
    assert seen == ["guard"]
    equations(system)._repr_markdown_()
    assert set(seen) == {"flow", "guard", "reset", "output"}


def test_mode_diagram_shows_conditions_and_is_the_same_every_time():
    fig = mode_diagram(friction())
    texts = [text.get_text() for text in check_labels(fig)]
    assert "breaks loose\n" + r"$k \, x - F_{s} \uparrow 0$" in texts and "at rest" in texts
    assert (
        fig._repr_png_() == mode_diagram(friction())._repr_png_() and len(fig._repr_png_()) < 60_000
    )
