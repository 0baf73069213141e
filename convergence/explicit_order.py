"""The explicit scheme is of first order at a fixed time, for every order of the equation.

Errors at t_end against exact solutions, over all named problems of the tests (smooth and
t**alpha-singular, several terms, incommensurate, classical), with exponential modes. Terms in
h**(3-beta) and h**(2-gamma) accompany the first-order error: near beta = 2 the observed order
creeps up to 1 from below.
"""

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check
from problems import PROBLEMS

import hereditary as hd
from hereditary.analysis.order import observed_order


def errors(problem, counts):
    equation, exact = problem.equation(), problem.exact(np.array([problem.t_end]))[0]
    ends = (hd.solve(equation, problem.t_end, n, save_every=n).y[-1] for n in counts)
    return [float(np.abs(y - exact).max()) for y in ends]


def measure(quick):
    counts = [100 * 2**k for k in range(5 if quick else 12)]
    rows = []
    for problem in PROBLEMS:
        table = observed_order(counts, errors(problem, counts))
        for n, error, order in zip(counts, table.errors, [np.nan, *table.pairwise], strict=True):
            rows.append(
                {
                    "problem": problem.name,
                    "n_steps": n,
                    "error": f"{error:.4e}",
                    "order": f"{order:.3f}",
                }
            )
    return rows


def draw(rows):
    figure, ax = plt.subplots(figsize=(7.5, 4.5), layout="constrained")
    for problem in PROBLEMS:
        mine = [row for row in rows if row["problem"] == problem.name]
        style = "o--" if "singular" in problem.tags else "o-"
        n = np.array([row["n_steps"] for row in mine])
        ax.loglog(n, [row["error"] for row in mine], style, ms=3, lw=1, label=problem.name)
    ax.loglog(n, 3 / n, "k:", label="order 1")
    ax.set(xlabel="steps $N$", ylabel="error at the end", title="Explicit scheme")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    last = {row["problem"]: row["order"] for row in rows}
    worst = max(last, key=lambda name: abs(last[name] - 1))
    held = abs(last[worst] - 1) <= 0.15
    check(f"last observed order farthest from 1: {last[worst]:.3f} ({worst})", held)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
