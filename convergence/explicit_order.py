"""The explicit scheme is of first order at a fixed time, for every order of the equation.

Errors at t_end against exact solutions, over all named problems of the tests (smooth and
t**alpha-singular, several terms, incommensurate, classical), with exponential modes. Terms in
h**(3-beta) and h**(2-gamma) accompany the first-order error: near beta = 2 the observed order
creeps up to 1 from below.
"""

import numpy as np
from _study import Claim, orders, study
from problems import PROBLEMS

import hereditary as hd
from hereditary.analysis.convergence import observed_order


def errors(problem, counts):
    equation, exact = problem.equation(), problem.exact(np.array([problem.t_end]))[0]
    ends = (hd.solve(equation, problem.t_end, n, save_every=n).y[-1] for n in counts)
    return [float(np.abs(y - exact).max()) for y in ends]


def measure(quick):
    counts = [100 * 2**k for k in range(5 if quick else 12)]
    rows = []
    for problem in PROBLEMS:
        found = errors(problem, counts)
        orders = [np.nan, *observed_order(counts, found)[0]]
        for n, error, order in zip(counts, found, orders, strict=True):
            rows.append(
                {
                    "problem": problem.name,
                    "n_steps": n,
                    "error": f"{error:.4e}",
                    "order": f"{order:.3f}",
                }
            )
    return rows


def claims(rows):
    for name, order in {row["problem"]: row["order"] for row in rows}.items():
        yield Claim("last observed order off 1", abs(order - 1), 0.15, where=name, small=True)


if __name__ == "__main__":
    study(measure, claims, orders(("problem",), slopes=(1,)))
