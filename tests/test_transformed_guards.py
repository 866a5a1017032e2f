"""A guard and a monotone function of it that keeps its zero are the same guard: the bounces of a
ball by exact answers, however many decades the guard's values span along a step, and where it jumps
or stands upright at its zero.
"""

import random
from collections.abc import Iterator
from math import atan, copysign, exp, floor, sinh, sqrt, tanh

import pytest

from labkit import Mode, System, Transition, simulate

BOTH = ("plain", "compiled")
OWN, SCIPY = ["RK45", "DOP853", "RK4"], ["Radau", "LSODA", "BDF"]  # SciPy's run plain only
G = 9.81
GUARDS = {
    "plain": lambda t, s, p: s.y,
    "exp − 1": lambda t, s, p: exp(p.k * s.y) - 1,
    "1 − exp": lambda t, s, p: 1 - exp(-p.k * s.y),
    "sinh": lambda t, s, p: sinh(p.k * s.y),
    "tanh": lambda t, s, p: tanh(p.k * s.y),
    "atan": lambda t, s, p: atan(p.k * s.y),
    "cubic": lambda t, s, p: p.k * s.y**3 + s.y,
    "quintic": lambda t, s, p: p.k * s.y**5 + s.y,
    "rational": lambda t, s, p: s.y / (1 + p.k * s.y * s.y),
    "y exp(−ky)": lambda t, s, p: s.y * exp(-p.k * s.y),
    "y exp(ky)": lambda t, s, p: s.y * exp(p.k * s.y),
    "floor": lambda t, s, p: floor(p.k * s.y) + 0.5,
    "sign": lambda t, s, p: 1.0 if s.y > 0 else -1.0 if s.y < 0 else 0.0,
    "y ± k": lambda t, s, p: s.y + (p.k if s.y > 0 else -p.k),
    "step": lambda t, s, p: s.y if s.y > 0 else s.y - p.k,
    "cube root": lambda t, s, p: copysign(abs(p.k * s.y) ** (1 / 3), s.y),
    "root": lambda t, s, p: copysign(sqrt(abs(p.k * s.y)), s.y),
}
UPRIGHT = ["floor", "sign", "y ± k", "step", "cube root", "root"]


def fly(t, s, p):
    return s.v, -G


def rest(t, s, p):
    return 0.0, 0.0


def bounce(t, s, p):
    return 0.0, -p.e * s.v


def ball(guard: str) -> System:
    return System(
        "ball",
        {"y": "m", "v": "m/s"},
        {"k": 1.0, "e": 0.8},
        [Mode("flight", fly), Mode("rest", rest)],
        [
            Transition(
                "flight", "flight", GUARDS[guard], direction=-1, reset=bounce, label="bounce",
                zeno="rest",
            )
        ],
        start={"y": 10.0, "v": 0.0},
    )  # fmt: skip


SYSTEMS = {guard: ball(guard) for guard in GUARDS}


def bounces(height: float, e: float, t_end: float) -> Iterator[float]:
    """Until the flights are 500 times shorter than the first fall."""
    fall = t = sqrt(2 * height / G)
    gap = 2 * fall * e
    while t < t_end and gap > 2e-3 * fall:
        yield t
        t, gap = t + gap, gap * e


def wrong(
    guard: str, k: float, height: float, e: float, t_end: float, options: dict, backend: str
) -> str:
    run = simulate(
        SYSTEMS[guard], t_end, k=k, e=e, start={"y": height, "v": 0.0}, backend=backend, **options
    )
    found = [event.t for event in run.events if event.target == "flight"]
    right = list(bounces(height, e, t_end))
    allowed = max(100 * options.get("rtol", 1e-8), 1e-9) * t_end
    if run.stopped != "finished":
        return run.stopped
    if len(found) < len(right):
        return f"{len(found)} bounces of {len(right)}"
    for one, other in zip(found, right, strict=False):
        if abs(one - other) > allowed:
            return f"a bounce at {one}, not {other}"
    return f"{run['y'].min()} m below the ground" if run["y"].min() < -1e-4 * height else ""


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("guard", GUARDS)
def test_a_guard_may_be_bent(guard, backend):
    dice = random.Random(guard)
    for _ in range(4 if guard in UPRIGHT else 8):
        k, height = 10 ** dice.uniform(-1, 1.7), 10 ** dice.uniform(-2, 2)
        height = min(height, 500 / k)  # beyond that its value is no number, or 0
        t_end = sqrt(2 * height / G) * dice.uniform(2, 12)
        options = {"method": dice.choice(OWN if backend == "compiled" else OWN + SCIPY)}
        if options["method"] == "RK4":
            options["step"] = t_end / dice.choice([7, 100, 1000])
        elif dice.random() < 0.75:
            options["rtol"] = dice.choice([1e-4, 1e-6, 1e-10])
        case = (guard, k, height, dice.choice([0.5, 0.8, 0.9]), t_end, options)
        assert not wrong(*case, backend), case


# Found as these: a rest far below the ground, or bounces that were stepped over
@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize(
    "case",
    [
        ("1 − exp", 1.0, 10.0, 0.8, 15.0, {}),
        ("1 − exp", 11.95, 85.8414, 0.8, 36.816, {"rtol": 1e-4}),
        ("1 − exp", 30.614, 0.4034, 0.9, 2.782, {"rtol": 1e-10}),
        ("1 − exp", 17.782, 19.6099, 0.5, 14.001, {"method": "Radau"}),
        ("sinh", 3.143, 1.3057, 0.9, 4.824, {"rtol": 1e-6}),
        ("sinh", 3.147, 38.8602, 0.8, 27.117, {"rtol": 1e-6}),
        ("sinh", 1.439, 95.6299, 0.5, 33.465, {"method": "LSODA"}),
        ("sinh", 1.599, 92.8012, 0.9, 32.087, {"method": "RK4", "step": 4.583845176738499}),
        ("quintic", 0.277, 42.0742, 0.5, 33.303, {"method": "LSODA", "rtol": 1e-4}),
        ("y exp(−ky)", 2.067, 18.8966, 0.9, 21.364, {"method": "LSODA", "rtol": 1e-6}),
        ("y exp(−ky)", 4.154, 9.4493, 0.8, 13.009, {"method": "Radau", "rtol": 1e-4}),
    ],
    ids=str,
)
def test_no_rest_below_the_ground(case, backend):
    if case[-1].get("method") in SCIPY:
        backend = "plain"
    assert not wrong(*case, backend)
