"""Assignment 3.14 on the notebook's own models.

Products of matrices, energy, and instants of destruction against Taylor series with 34 digits.
"""

import decimal
import functools
import math

import numpy as np
import pytest

from labkit import simulate

NAME = "part3/14_particle_and_ring"
D = decimal.Decimal
ORDER = 18


def series(x, v, gm, R, near):
    """Taylor coefficients of x(t) for x'' = −GM x/R³ or −GM x/(R² + x²)^(3/2)."""
    c, u, w = [x, v], [R * R + x * x], []
    w.append(1 / R**3 if near else 1 / (u[0] * u[0].sqrt()))
    for n in range(ORDER):
        if n and not near:
            u.append(sum(c[k] * c[n - k] for k in range(n + 1)))
            total = sum((D(-3) / 2 * k - (n - k)) * u[k] * w[n - k] for k in range(1, n + 1))
            w.append(total / (n * u[0]))
        force = c[n] * w[0] if near else sum(c[k] * w[n - k] for k in range(n + 1))
        c.append(-gm * force / ((n + 1) * (n + 2)))
    return c


def value(c, h):
    """x and v after h."""
    x, v = D(0), D(0)
    for n in range(len(c) - 1, -1, -1):
        x = x * h + c[n]
        v = v * h + n * c[n] / h if n and h else v
    return x, sum(n * c[n] * h ** (n - 1) for n in range(1, len(c)))


@functools.cache
def life(G, k, T, t_end):
    """(instant of destruction or t_end, x before each change), written from the handbook."""
    with decimal.localcontext() as context:
        context.prec = 34
        gm, small = D(G) * D(10) ** 20, D(1000)
        t, x, v, wide, places = D(0), D(1), D(0), False, []
        R, due, near = small, D(T), True
        while t < t_end:
            h = min(D("0.1") if wide else D("0.02"), due - t)
            c = series(x, v, gm, R, near)
            limit = R / 10 if near or abs(x) * 10 < 11 * R else 10 * small
            new_x, new_v = value(c, h)
            for bound in (R / 10, 10 * small):
                if (abs(x) < bound) != (abs(new_x) < bound) and abs(abs(x) - bound) > D("1e-20"):
                    limit = bound
                    break
            else:
                limit = None
            if limit is not None:
                goal = limit.copy_sign(new_x if abs(new_x) >= limit else x)
                h = h * (goal - x) / (new_x - x)
                for _ in range(60):  # Newton
                    at, slope = value(c, h)
                    h -= (at - goal) / slope
                    if abs(at - goal) < D("1e-26"):
                        break
                new_x, new_v = value(c, h)
                if limit == 10 * small:
                    return float(t + h), places
                near, new_x = not near, goal
            t, x, v = t + h, new_x, new_v
            if t >= due:
                places.append(float(x))
                wide, due = not wide, due + D(T)
                R = small * k if wide else small
                near = abs(x) < R / 10
        return float(t), places


def test_handbook_values(names):
    p, q = names["system"].values(), names["system_two"].values()
    assert (p.G, p.M, p.R0, p.k, p.T) == (6.6743e-11, 1e20, 1000, 10, 15)
    assert (q.k, q.T) == (5, 20) and names["system"].start == {"x": 1.0, "v": 0.0, "wide": 0.0}
    assert (names["horizon"], names["horizon_two"]) == (150.0, 400.0)


def test_near_the_centre_the_motion_is_harmonic(names):
    omega = math.sqrt(6.6743e9 / 1e9)
    run = simulate(names["system"], 15.0, rtol=1e-12, T=60.0, start={"x": 50.0})
    assert np.abs(run["x"] - 50 * np.cos(omega * run.t)).max() < 1e-8


@pytest.mark.parametrize(
    ("G", "k", "T", "end", "abs_"),
    [
        ("6.6743e-11", 10, 15, 150, 1e-6),
        ("6.674e-11", 10, 15, 150, 1e-6),
        ("6.67445e-11", 10, 15, 150, 1e-6),
        ("6.6743e-11", 5, 20, 400, 1e-4),
    ],
)
def test_instant_of_destruction_with_34_digits(names, G, k, T, end, abs_):
    instant, places = life(G, k, T, end)
    run = simulate(names["system"], end, G=float(G), k=k, T=T, rtol=1e-13)
    assert run.stopped == 'terminal event "destroyed"'
    assert run.t[-1] == pytest.approx(instant, abs=abs_)
    for n, x in enumerate(places[:4], 1):
        assert run.at(float(n * T), side="before")["x"] == pytest.approx(x, rel=1e-8)


def test_what_the_specification_says(names):
    assert life("6.6743e-11", 10, 15, 150)[0] == pytest.approx(110.12, abs=0.005)
    assert life("6.674e-11", 10, 15, 150)[0] == pytest.approx(121.1, abs=0.05)
    assert life("6.6743e-11", 5, 20, 400)[0] == pytest.approx(346.25, abs=0.005)
    assert names["firm"][0].t[-1] == pytest.approx(life("6.6743e-11", 10, 15, 150)[0], abs=1e-6)


def test_energy_stays_between_changes_and_has_no_jump_at_the_seam(names):
    run = simulate(names["system"], 150.0, rtol=1e-12)
    t, R = run.t, 1000 * (1 + 9 * run["wide"])
    gm, x = 6.6743e9, np.abs(run["x"])

    def potential(x, R):  # by quadrature of the two laws, in closed form
        a = np.minimum(x, 0.1 * R)
        far = gm / np.hypot(R, a) - gm / np.hypot(R, x)
        return gm * a**2 / (2 * R**3) + far

    e = run["v"] ** 2 / 2 + potential(x, R)
    between = ~np.isin(t, np.arange(15.0, 110.0, 15.0))  # there the mode is the old one at first
    assert np.abs(run["e"] / e - 1)[between].max() < 1e-9
    for begin in range(0, 110, 15):
        part = e[(t > begin) & (t < begin + 15)]
        assert np.ptp(part) < 1e-9 * part.max()


def test_the_mode_is_chosen_anew_when_the_ring_changes(names):
    run = simulate(names["system"], 150.0, rtol=1e-12)
    R = 1000 * (1 + 9 * run["wide"])
    inside = np.abs(run["x"]) < 0.1 * R * (1 - 1e-9)
    outside = np.abs(run["x"]) > 0.1 * R * (1 + 1e-9)
    # at the very instant of a change the old mode is still there, for one sample
    instant = np.isin(run.t, np.arange(15.0, 110.0, 15.0))
    assert (run.mode[inside & ~instant] == "near").all()
    assert (run.mode[outside & ~instant] == "far").all() and outside.any() and inside.any()


def test_multipliers(names):
    w, product = math.sqrt(6.6743), names["product"]
    assert np.linalg.det(product) == pytest.approx(1, abs=1e-9)
    s = w / 10**1.5
    trace = 2 * math.cos(15 * w) * math.cos(15 * s) - (w / s + s / w) * math.sin(15 * w) * math.sin(
        15 * s
    )
    assert names["factor"] == pytest.approx(
        abs(trace) / 2 + math.sqrt(trace**2 / 4 - 1), rel=1e-9
    ) and names["factor"] == pytest.approx(25.505, abs=1e-3)


def test_a_ring_with_calm_multipliers_survives(names):
    m, calm = names["m"], names["calm"]
    assert m.shape == (29, 61) and 0.1 < calm.mean() < 0.4
    assert (m.values[calm] == 150.0).all() and (m.values[~calm] < 150).mean() > 0.3
    for i, j in ((18, 30), (4, 26), (20, 3), (26, 50)):
        k, T = m.axes["k"][i], m.axes["T"][j]
        w, s = math.sqrt(6.6743), math.sqrt(6.6743) / k**1.5
        half = math.cos(T * w) * math.cos(T * s)
        half -= (w / s + s / w) / 2 * math.sin(T * w) * math.sin(T * s)
        assert calm[i, j] == (abs(half) <= 1)


def test_shares_are_steadier_than_lives(names):
    (coarse, coarse_two), (fine, fine_two) = names["lives"].values()
    assert np.mean(np.abs(coarse_two - fine_two) < 0.1) < 0.4
    assert abs(np.mean(coarse_two < 400) - np.mean(fine_two < 400)) < 0.06
    assert abs(np.mean(coarse < 150) - np.mean(fine < 150)) < 0.06
    near = np.abs(np.linspace(6.67385, 6.67475, len(fine)) - 6.67435) < 5e-5  # an arch
    assert np.ptp(fine[near]) < 1 and np.abs(coarse - fine)[near].max() < 0.1


def test_not_told_of_the_seam(names):
    for told, low, high in ((True, 0, 1e-3), (False, 1, 60)):
        run = simulate(names["system"], 150.0, method="RK4", step=0.005, locate=told)
        assert low <= abs(run.t[-1] - life("6.6743e-11", 10, 15, 150)[0]) < high


def test_one_law(names):
    """The full law everywhere: energy −GM/√(R² + x²) + v²/2 stays between the changes."""
    run = names["one_law"]
    assert run.stopped == 'terminal event "destroyed"' and run.t[-1] == pytest.approx(
        208.7, abs=0.1
    )
    R = 1000 * (1 + 9 * run["wide"])
    e = run["v"] ** 2 / 2 + 6.6743e9 * (1 / R - 1 / np.hypot(R, run["x"]))
    late = (run.t > 195) & (run.t < 208)
    assert np.ptp(e[late]) < 1e-9 * e[late].max()


def test_answers_of_the_tasks(names):
    right = names["solutions"]
    assert right["tenth"] == pytest.approx(life("6.6743e-11", 10, 15, 150)[1][3] / 10, rel=1e-8)
    gm = 6.6743e9
    depth = gm * (0.005 / 1000 + 1 / math.hypot(1000, 100) - 1 / math.hypot(1000, 10_000))
    assert right["escape"] == pytest.approx(math.sqrt(2 * depth), rel=1e-9)
    w, s, T = math.sqrt(6.6743), math.sqrt(6.6743) / 10**1.5, right["calm"]
    half = math.cos(T * w) * math.cos(T * s) - (w / s + s / w) / 2 * math.sin(T * w) * math.sin(
        T * s
    )
    assert half == pytest.approx(-1, abs=1e-7) and 15 < T < 16
