"""concepts/solvers_and_tolerances: its closed forms hold.

Its broken solvers are broken in the way it says; labkit is not.
"""

from math import acos, hypot, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import quad

from labkit import METHODS, simulate

NAME = "concepts/solvers_and_tolerances"
TIGHT = {"rtol": 1e-12, "atol": 1e-13}


def test_the_planet_returns_and_keeps_energy_and_area(names):
    run = simulate(names["planet"], 4 * pi, **TIGHT)
    assert list(run.final.values()) == pytest.approx([0.5, 0.0, 0.0, sqrt(3)], abs=1e-9)
    energy = (run["u"] ** 2 + run["w"] ** 2) / 2 - 1 / np.hypot(run["x"], run["y"])
    assert energy == pytest.approx(-0.5, abs=1e-10)  # −1/(2a), a = 1
    assert run["x"] * run["w"] - run["y"] * run["u"] == pytest.approx(sqrt(0.75), abs=1e-10)


def test_the_follower_is_its_closed_form(names):
    for rate in (-3.0, -1000.0):
        run = simulate(names["follower"], 2.0, rate=rate, **TIGHT)
        assert run["y"] == pytest.approx(np.cos(run.t) + np.exp(rate * run.t), abs=1e-10)


@pytest.mark.parametrize("A", [0.1, 1.0, 3.0])
def test_the_relay_is_circles_about_two_centres(names, A):
    """Against the energy integral for the quarter period, and against a simulation."""

    def slowness(s):  # x = A − s² takes away the singular end
        return 2 * s / sqrt((A + 1) ** 2 - (A - s * s + 1) ** 2)

    quarter = quad(slowness, 0, sqrt(A))[0]
    assert acos(1 / (1 + A)) == pytest.approx(quarter, rel=1e-9)
    run = simulate(names["relay"], 10.0, start={"x": A}, **TIGHT)
    x, v = names["relay_exact"](run.t, A)
    smooth = np.abs(run["x"]) > 1e-6
    assert run["x"] == pytest.approx(x, abs=1e-9)
    assert run["v"][smooth] == pytest.approx(v[smooth], abs=1e-9)


def test_every_method_falls_and_none_is_missing(names):
    for (name, method), (_, error) in names["found"].items():
        good = np.isfinite(error)
        assert good.sum() >= 4 and error[good][-1] < error[good][0], (name, method)
    assert {method for _, method in names["found"]} == set(METHODS)


def test_orders_on_the_planet_are_the_methods_orders(names):
    for method, order in {"Heun": 2, "RK4": 4, "RK45": 5, "DOP853": 8}.items():
        assert 1 / np.log10(names["price"]("smooth: planet", method)) == pytest.approx(
            order, rel=0.25
        )


def test_explicit_methods_have_a_wall_on_the_stiff_problem_and_implicit_ones_do_not(names):
    for method in METHODS:
        work, error = names["found"]["stiff: follower", method]
        cheapest = work[np.isfinite(error)].min()
        if method in ("LSODA", "Radau", "BDF"):
            assert cheapest < 400, method
        else:
            assert cheapest > 10 * 1000 / names["bounds"][method] / 1.5, method


def test_location_keeps_the_order_and_lateness_loses_it(names):
    slope = names["slope"]
    assert slope("located") == pytest.approx(4, abs=0.4)
    assert slope("noticed late") == pytest.approx(1, abs=0.2)
    assert slope("hidden") < 2
    tried = names["tried"]
    assert tried["noticed late", "DOP853"][1].min() > 1  # no tolerance mends it
    assert tried["hidden", "DOP853"][0][-1] > 4 * tried["located", "DOP853"][0][-1]
    assert tried["located", "DOP853"][1][-1] < 1e-9


@pytest.mark.parametrize("d", [1e-1, 1e-5, 1e-10])
def test_the_bar_is_seen_by_labkit_and_not_by_solve_ivp(names, d):
    done, count = names["crossings"](d)
    assert count == 0
    assert done.sol(20 / 9.81)[0] == pytest.approx(names["top"], abs=1e-9)  # above the bar
    for backend in ("plain", "compiled"):
        events = simulate(names["thrown"], 4.0, d=d, backend=backend).events
        exact = [20 / 9.81 - sqrt(2 * d / 9.81), 20 / 9.81 + sqrt(2 * d / 9.81)]
        assert [e.t for e in events] == pytest.approx(exact, abs=5e-13 / sqrt(2 * 9.81 * d))


def test_the_broken_balls(names):
    frozen, _, why, _ = names["ball_by_solve_ivp"](0, True, cap=20)
    first = sqrt(2 * 10 / 9.81)
    assert len(frozen) == 20 and set(np.round(frozen, 9)) == {round(first, 9)}
    assert why.startswith("given up")
    good, *_ = names["ball_by_solve_ivp"](-1, True, cap=20)
    theory = [first * (1 + 2 * sum(0.8**j for j in range(1, k + 1))) for k in range(20)]
    assert good == pytest.approx(theory, rel=1e-9)
    path, turned = names["ball_by_hand"]()
    assert turned > 500 and path[1, -1] < -0.3


def test_the_loop_never_gets_past_zeno_and_labkit_comes_to_rest(names):
    zeno = sqrt(2 * 10 / 9.81) * 1.8 / 0.2
    assert names["t_zeno"] == pytest.approx(zeno, rel=1e-14)
    bounces, right = names["bounces"], names["right"]
    assert len(bounces) == 300 and max(bounces) < zeno + 1e-9 and len(set(bounces)) < 200
    assert right.events[-1].t == pytest.approx(zeno, rel=1e-10) and right.mode[-1] == "rest"
    assert simulate(names["never"], 15.0).stopped.startswith("Zeno at t = 12.85058")


def test_sliding_against_chatter(names):
    run = names["slide"]
    assert [e.t for e in run.events if e.source == "sliding"] == pytest.approx(
        [np.arcsin(2 / 3), pi + np.arcsin(2 / 3)], abs=1e-9
    )
    resting = (run.t > 0.34) & (run.t < 0.72)
    assert np.abs(run["x"][resting]).max() < 1e-12
    counts = [names["sign_changes"](names["euler"](h)[1]) for h in (0.02, 0.01, 0.005)]
    assert counts[1] > 1.6 * counts[0] and counts[2] > 1.6 * counts[1]
    t, x = names["euler"](0.005)
    # below 2h: a step from next to zero
    assert 0.005 < np.abs(x[(t > 0.4) & (t < 0.7)]).max() <= 0.01
    assert names["adaptive"].nfev > 100 * run.work.evaluations


def test_stability_functions_are_those_of_the_books(names):
    R, z = names["R"], np.array([0.3 + 1j, -2.1, 1.5j])
    taylor = {
        "Euler": 1 + z,
        "Heun": 1 + z + z**2 / 2,
        "RK4": 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24,
    }
    for method, value in taylor.items():
        assert R(method, z) == pytest.approx(value, rel=1e-13)
    dormand_prince = taylor["RK4"] + z**5 / 120 + z**6 / 600  # 1980
    assert R("RK45", z) == pytest.approx(dormand_prince, rel=1e-12)
    small = 0.1 + 0.1j
    assert abs(R("DOP853", small) - np.exp(small)) < 1e-13  # order 8
    values, vectors = np.linalg.eig(np.array([[0, 1], [-2, -1.0]]))
    for method in ("Euler", "Heun", "RK4"):  # the tableau that is read is the one that simulates
        start = {"x": 0.3, "v": 0.4}
        how = {"method": method, "step": 0.7, "start": start}
        run = simulate(names["linear"], 0.7, trace=-1.0, det=2.0, **how)
        y = (vectors @ np.diag(R(method, 0.7 * values)) @ np.linalg.inv(vectors) @ [0.3, 0.4]).real
        assert run.work.steps == 1
        assert [run.final["x"], run.final["v"]] == pytest.approx(y, rel=1e-12)


def test_bounds_of_the_step(names):
    assert names["bounds"] == pytest.approx(
        {"Euler": 2, "Heun": 2, "RK4": 2.785293563, "RK45": 3.3065679, "DOP853": 6.394}, rel=1e-3
    )
    for method in ("Euler", "Heun", "RK4"):
        assert names["measured_bound"](method) == pytest.approx(names["bounds"][method], abs=2e-5)


def test_growth_of_the_centre(names):
    for method, n, square in (
        ("Euler", 25, lambda h: 1 + h * h),
        ("Heun", 10, lambda h: 1 + h**4 / 4),
        ("RK4", 5, lambda h: 1 - h**6 / 72 + h**8 / 576),
    ):
        run = simulate(names["linear"], 6 * pi, method=method, step=2 * pi / n, points=2)
        assert hypot(*run.final.values()) == pytest.approx(
            square(2 * pi / n) ** (1.5 * n), rel=1e-9
        )
    low, high = names["drift"](True)
    assert low > 0.8 and high < 1.2 and names["drift"](False)[1] > 1e50


def test_exact_solution_of_the_panel(names):
    linear = names["linear"]
    for trace, det in ((0.0, 1.0), (-0.1, 1.0025), (-41.0, 40.0)):
        run = simulate(linear, 20.0, trace=trace, det=det, **TIGHT)
        assert names["exact"](run.t, run.p) == pytest.approx(run["x"], abs=1e-8)


def test_the_panel_of_the_relay_follows_the_slider(names):
    """The curve of the error and the verdict's error fall with the tolerance."""
    relay, horizon, verdict = names["relay"], names["horizon"], names["verdict"]
    coarse, fine = (simulate(relay, horizon, rtol=rtol, atol=rtol / 100) for rtol in (1e-4, 1e-9))
    plane, error = names["draw_relay"](coarse)
    for view in (plane, error):
        view.update(coarse)
    before = error.drawn["distance"].get_ydata().max()
    for view in (plane, error):
        view.update(fine)
    assert 0 < error.drawn["distance"].get_ydata().max() < 1e-3 * before
    assert plane.drawn["simulated"].get_xdata() == pytest.approx(fine["x"])
    assert verdict(fine).endswith("10 switches seen, of 10")
    late = simulate(relay, horizon, rtol=1e-5, locate=False)
    off = float(verdict(late).split()[4].rstrip(";"))
    assert off == pytest.approx(hypot(late.final["x"] - 1, late.final["v"]), rel=0.1) and off > 1


def test_the_panel_of_the_plane_follows_the_slider(names):
    """The dots of the plane are hλ and leave the region with the step; the region is exact."""
    linear, judge = names["linear"], names["judge"]
    how = {"trace": -41.0, "det": 40.0, "method": "Euler"}
    stable, unstable = (simulate(linear, 20.0, step=h, **how) for h in (0.049, 0.051))
    assert "does not grow" in judge(stable) and ": grows" in judge(unstable)
    region, dots, solution = views = names["draw_steps"](stable)
    dots.update(stable)
    assert dots.drawn["$h\\lambda$"].get_xdata().min() == pytest.approx(-40 * 0.049)

    def area():
        return region.image.get_array().mean() * (11 + 11 / 330) ** 2  # pixels around the points

    assert area() == pytest.approx(pi, rel=2e-3)  # Euler: the unit disc about −1
    for view in views:
        view.update(simulate(linear, 20.0, method="RK4", step=0.1))
    assert area() > 3 * pi
    z = dots.drawn["$h\\lambda$"].get_data()
    assert z[0] == pytest.approx(0, abs=1e-12) and np.abs(z[1]).max() == pytest.approx(0.1)
    exact, steps = (solution.drawn[key].get_ydata()[-1] for key in ("exact", "steps"))
    assert steps == pytest.approx(exact, abs=1e-3) and exact == pytest.approx(np.cos(20.0))
    region.update(simulate(linear, 20.0, method="Radau"))
    inside = region.image.get_array()
    assert inside[:, names["Region"].grid[0].real < -0.1].min() == 1  # the left half plane
    assert inside.min() == 0  # around its poles not
    region.update(simulate(linear, 20.0, method="BDF"))
    assert region.image.get_array().max() == 0


def test_errors_add_up_on_the_relay_and_are_forgotten_by_the_follower(names):
    """The relay's period follows from its energy: x'²/2 + x²/2 + |x| = A²/2 + A."""
    run, lengths = names["loose"], (50, 150)
    missed, lag = [], []
    for n in lengths:
        end = run.again(t_end=n * names["period"]).final
        energy = end["v"] ** 2 / 2 + end["x"] ** 2 / 2 + abs(end["x"])
        A = sqrt(1 + 2 * energy) - 1
        swing = 2 * acos(1 / (1 + A))
        # drifting steadily to the last swing, the clock is wrong by the half of it at each swing
        lag.append(abs(2 * n * (swing - names["period"] / 2) / 2))
        missed.append(hypot(end["x"] - 1, end["v"]))
    # at (1, 0) the speed in the plane is |x''| = 2
    assert missed == pytest.approx([2 * value for value in lag], rel=0.1)
    assert missed[1] / missed[0] == pytest.approx(9, rel=0.2)
    assert max(names["follower_errors"]) < 1e-7


def test_predictions_and_tasks_know_their_answers(names):
    """What the checks take as right is what the theory says."""
    assert names["nearest"](names["ratio"], (2, 10, 100, 1000)) == 2  # 1000^(1/8) = 2.4
    assert names["nearest"](names["more"], (1, 4, 30, 1000)) == 1
    assert [name[0] for name in names["followed"]] == ["3"]
    assert names["turn"]["Euler", 30] == "out" and names["turn"]["RK4", 6] == "in"
    solutions = names["solutions"]
    assert solutions["spiral"] == pytest.approx(0.0997506, rel=1e-5)
    assert solutions["trapezoid"] == pytest.approx(49 / 51)
    assert 1.5 < solutions["planet"] < 6


def test_euler_makes_the_slow_spiral_unstable_where_theory_says(names):
    limit = 0.1 / 1.0025
    for factor, grows in ((0.98, False), (1.02, True)):
        how = {"method": "Euler", "step": factor * limit, "points": 2}
        start = {"x": 1.0, "v": 0.0}
        run = simulate(names["linear"], 2000.0, trace=-0.1, det=1.0025, start=start, **how)
        assert (hypot(*run.final.values()) > 1) == grows
