"""labkit: simulate() as a notebook calls it, with both back ends."""

from labkit import simulate

from .contest import Answer, Contestant
from .problems import Problem


def contestants(problem: Problem) -> list[Contestant]:
    def run(backend: str, method: str):
        def make(tol: float):
            def solve() -> Answer:
                result = simulate(
                    problem.system,
                    problem.t_end,
                    method=method,
                    rtol=tol,
                    atol=tol,
                    points=2,
                    backend=backend,
                )
                return Answer(
                    result.values[-1], result.t[1:][result.j[1:] > result.j[:-1]]
                )  # the ledger's instants, as an array

            return solve

        return make

    return [
        Contestant(f"labkit {backend}", method, run(backend, method))
        for backend in ("compiled", "plain")
        for method in ("RK45", "DOP853")
    ]
