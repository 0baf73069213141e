"""A problem of the campaign: a piecewise linear equation, its exact solution, how it is run."""

from dataclasses import dataclass

import numpy as np
from _laplace_truth import Truth

import hereditary as hd


def piecewise_linear(t, y, dy, p):
    """dy = A y - k sign(y[0] - level) e_0 + forces that begin at their times.

    params: A by rows, k, level, then start, power, 1 where the force acts at its start, amplitudes.
    """
    d = y.shape[0]
    for c in range(d):
        dy[c] = 0.0
        for e in range(d):
            dy[c] += p[c * d + e] * y[e]
    if p[d * d] != 0.0:
        dy[0] -= p[d * d] * np.sign(y[0] - p[d * d + 1])
    for k in range(d * d + 2, p.shape[0], 3 + d):
        passed = t - p[k]
        if passed > 0.0 or (passed == 0.0 and p[k + 2] == 1.0):
            size = passed ** p[k + 1] if p[k + 1] != 0.0 else 1.0
            for c in range(d):
                dy[c] += p[k + 3 + c] * size


@dataclass(frozen=True)
class Problem:
    """A problem, what solves it, and how it is to be run.

    `truth` has the pieces between which a relay switches. `relay` is (size, level) of the jump in
    y[0], and `settles` the time after which y[0] stays on the level. `perturbed` are solutions from
    values that are rtol larger and smaller, if a relay switches.
    """

    kind: str
    truth: Truth
    t_end: float
    rtol: float
    n_forces: int = 0
    closed: bool = True
    breaks: tuple[float, ...] = ()
    relay: tuple[float, float] = (0.0, 0.0)
    settles: float = np.inf
    perturbed: tuple[Truth, ...] = ()
    max_step: float | None = None
    scheme: str = "Collocation()"
    n_steps: int | None = None

    @property
    def params(self):
        """What `piecewise_linear` reads."""
        rows = [self.truth.matrix.ravel(), self.relay]
        for force in self.truth.forces[: self.n_forces]:
            rows.append([force.start, force.power, float(self.closed), *force.amplitudes])
        return np.concatenate(rows)

    @property
    def y0(self):
        """Initial values as an equation takes them."""
        return self.truth.start[: 2 if self.truth.orders.max() > 1 else 1]

    def equation(self):
        """The equation; refusals come from here or from `solve`."""
        return hd.Equation(self._terms(), piecewise_linear, self.y0, params=self.params)

    def _terms(self):
        pairs = zip(self.truth.coefficients, self.truth.orders, strict=True)
        return [c * hd.Caputo(a) for c, a in pairs]

    def how(self):
        """Keyword arguments of `solve`."""
        scheme = eval(f"hd.{self.scheme}", {"hd": hd})
        if self.n_steps is not None:
            return {"n_steps": self.n_steps, "scheme": scheme}
        given = {"rtol": self.rtol, "scheme": scheme}
        given |= {"breaks": list(self.breaks)} if self.breaks else {}
        return given | ({"max_step": self.max_step} if self.max_step else {})

    def solve(self):
        """Run it."""
        return hd.solve(self.equation(), self.t_end, **self.how())

    def solution(self, t, derivative=0):
        """y or y' at times t, shape (n, d)."""
        out = self.truth(np.minimum(t, self.settles), derivative)
        out[np.asarray(t) >= self.settles] = 0.0 if derivative else self.relay[1]
        return out

    def code(self):
        """The same as lines to paste."""
        terms = ", ".join(
            f"np.array({c.tolist()!r}) * hd.Caputo({a.tolist()!r})"
            for c, a in zip(self.truth.coefficients, self.truth.orders, strict=True)
        )
        given = self.how() | {"scheme": f"hd.{self.scheme}"}
        how = ", ".join(f"{k}={v if k == 'scheme' else repr(v)}" for k, v in given.items())
        return (
            "import numpy as np, hereditary as hd\n"
            "from _campaign_problems import piecewise_linear  # convergence/\n"
            f"eq = hd.Equation([{terms}], piecewise_linear, {self.y0.tolist()!r}, "
            f"params={self.params.tolist()!r})\n"
            f"sol = hd.solve(eq, {self.t_end!r}, {how})"
        )
