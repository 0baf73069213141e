"""`stats["error_estimate"]` of `Collocation` on long runs without damping grows as the error does.

Nothing damps errors of undamped oscillations: they add up in proportion to time. Forty random
problems over 20 to 5,000 periods are of three kinds. ``D^alpha y = J y`` has eigenvalues on the
edge of stability, abs(arg) = alpha pi / 2, and orders from 0.3 on, next to 1, 1 and above. The
second is ``x'' = -omega**2 x``. Of two terms the lower one drives what the higher one damps. The
first problem is ``D^0.5 y =
10 (y1 - y2, y1 + y2)``. Damped partners, where errors do not add up, show what the estimate then
overstates. Their eigenvalues are turned away from the edge, alone and with a force that oscillates.

Errors are those at the last times, over the largest size of each component. Exact solutions are
those of `hereditary.exact`, and of forced partners runs with a hundredth of the tolerance.
"""

import numpy as np
from _study import Claim, chosen, curves, study

import hereditary as hd
from hereditary import exact

N_PROBLEMS, N_TIMES = 40, 200
TURNED = 0.1  # angle by which the eigenvalues of damped partners are turned
LOOSEST = 1e-9  # tolerances below this reach rounding of the modes within hundreds of periods
KINDS = ("fractional", "next to 1", "classical", "above 1", "two terms")


def linear(t, y, dy, p):  # J by rows; amplitude and frequency of the force
    d = y.shape[0]
    for i in range(d):
        dy[i] = p[d * d] * np.cos(p[d * d + 1] * t)
        for j in range(d):
            dy[i] += p[i * d + j] * y[j]


class Problem:
    """A random problem, or its damped partner."""

    def __init__(self, number, longest, partner=""):
        rng = np.random.default_rng([20261125, number])
        self.kind, self.partner = KINDS[number % 5], partner
        self.alpha = {
            "fractional": rng.uniform(0.3, 0.95),
            "next to 1": 1 - 10 ** rng.uniform(-5, -1.3),
            "classical": 1.0 + number // 5 % 2,
            "above 1": rng.uniform(1.05, 1.95),
            "two terms": rng.uniform(1.2, 1.9),
        }[self.kind]
        self.gamma = rng.uniform(0.2, 0.8)
        self.omega, self.rtol = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-11, -3)
        self.periods = min(10 ** rng.uniform(1.3, 3.7), longest)
        self.skew = 2 ** rng.uniform(-1.5, 1.5)
        if number == 0:
            self.alpha, self.omega, self.rtol, self.skew = 0.5, 200.0, 1e-6, 1.0
            self.periods = min(3183.0, longest)
        self.t_end = 2 * np.pi / self.omega * self.periods
        self.start = [[1.0, 0.0], [0.0, 0.0]][: int(np.ceil(self.alpha))]

    def _of_two_terms(self):
        """Return friction and rate for which s = i omega is a root; friction is negative."""
        quarter = np.pi / 2
        a, g, omega = self.alpha, self.gamma, self.omega
        friction = -(omega ** (a - g)) * np.sin(a * quarter) / np.sin(g * quarter)
        if self.partner:
            friction *= 1 - TURNED
        rate = -(omega**a) * np.cos(a * quarter) - friction * omega**g * np.cos(g * quarter)
        return friction, rate

    def equation_and_exact(self):
        """Return the equation, and its exact solution or None."""
        force = [1.0 * self.omega**self.alpha, 0.7 * self.omega]
        force = force if self.partner == "forced" else [0.0, 1.0]
        if self.kind == "two terms":
            friction, rate = self._of_two_terms()
            terms = hd.Caputo(self.alpha) + friction * hd.Caputo(self.gamma)
            params, start = [-rate, *force], [1.0, 0.0]
            of = exact.several_terms([self.alpha, self.gamma], [1.0, friction], start, rate)
        else:
            terms, start = hd.Caputo(self.alpha), self.start
            angle = self.alpha * np.pi / 2 + (TURNED if self.partner else 0.0)
            a, b = self.omega**self.alpha * np.array([np.cos(angle), np.sin(angle)])
            matrix = np.array([[a, -b * self.skew], [b / self.skew, a]])
            params, of = [*matrix.ravel(), *force], exact.system(self.alpha, matrix, start)
        return hd.Equation(terms, linear, start, params), None if force[0] else of

    def solve(self):
        """Return the run, its error, and the largest size of a component in each period."""
        equation, of = self.equation_and_exact()
        sol = hd.solve(equation, self.t_end, rtol=self.rtol)
        times = sol.t[-N_TIMES:]
        of = of or hd.solve(equation, self.t_end, rtol=1e-2 * self.rtol)
        off = np.abs(sol.y[-N_TIMES:] - of(times)) / np.abs(sol.y).max(axis=0)
        return sol, float(off.max())


def measure(quick):
    longest = 100.0 if quick else np.inf
    for number in range(10 if quick else N_PROBLEMS):
        for partner in ("", "damped", "forced"):
            problem = Problem(number, longest, partner)
            # x'' = -omega**2 x turned grows
            if partner and (problem.rtol < LOOSEST or problem.alpha == 2.0):
                continue
            sol, error = problem.solve()
            estimate = sol.stats["error_estimate"]
            yield {
                "number": number, "kind": problem.kind, "partner": partner or "undamped",
                "alpha": problem.alpha, "rtol": problem.rtol, "periods": problem.periods,
                "steps": sol.stats["n_steps"], "status": sol.status, "error": error,
                "estimate": estimate, "error_over_rtol": error / problem.rtol,
                "estimate_over_rtol": estimate / problem.rtol,
                "error_over_estimate": error / estimate,
            }  # fmt: skip


def claims(rows):
    undamped = chosen(rows, partner="undamped")
    early = sum(row["status"] != "completed" for row in rows)
    yield Claim("runs that end early", early, 0, small=True)
    worst = max(row["error_over_estimate"] for row in undamped)
    yield Claim("undamped: largest error over the estimate", worst, 2, small=True)
    largest = max(row["error_over_rtol"] for row in undamped)
    yield Claim("undamped: largest error over rtol", largest)
    largest = max(row["error_over_rtol"] for row in undamped if row["rtol"] >= LOOSEST)
    yield Claim("undamped, rtol from 1e-9 on: largest error over rtol", largest, 2, small=True)
    for partner in ("damped", "forced"):
        told = max(row["estimate_over_rtol"] for row in chosen(rows, partner=partner))
        yield Claim(f"{partner}: largest estimate over rtol", told, 5, small=True)


draw = curves("periods", "error_over_estimate", ("kind",), ("partner",), line="")


if __name__ == "__main__":
    study(measure, claims, draw)
