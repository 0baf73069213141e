"""The step out of a point where the solution is not smooth (floor 4).

There it is a sum of powers of the time since, and so are the functions that stand for it.
"""

import numpy as np
from scipy.special import rgamma

from ..kernels.collocation import FORCE, POSITION, PRIMARY, solve_once
from .orbit import rows
from .power_basis import bends_for, power_basis

# A step that is refused is made this many times smaller; so often with bent functions.
_SHORTER, _BENT_TRIALS = 0.3, 12
# What the functions themselves err by, which nothing integrates, counts by this.
_SHARE = 0.25


class Corner:
    """One corner at time t, and the step out of it.

    Parameters
    ----------
    equation : System
    form : Form
    strands : Strands
    t, t_stop : float
    least : float
        Length below which the modes cannot follow.
    tolerances : (float, float)
        Relative and absolute error that y and p may have.
    run : Run
        Counts, Newton's contraction, and the size of p before, where it is a velocity.
    longest : float
        Longest step.

    Attributes
    ----------
    n_refused : int
        Steps refused.
    solved : bool
        Whether Newton's method converged on the last of them.
    """

    def __init__(self, equation, form, strands, t, t_stop, least, tolerances, run, longest):
        self._equation, self._form, self._strands = equation, form, strands
        self._t, self._t_stop, self._least = t, t_stop, least
        self._tolerances, self._run = tolerances, run
        self._largest = np.maximum(np.abs(strands.p[0]), run.largest)
        # just after the corner, where the right-hand side may jump
        self._first = np.nextafter(t, np.inf) if t > 0 else 0.0
        self._jacobian = equation.jacobian(self._first, strands.x[0])
        self._force = np.empty(form.second.size)
        run.counts.rhs += 1
        equation._rhs(self._first, strands.x[0], self._force, equation._params)
        self.n_refused, self.solved, self._longest = 0, True, longest

    def leave(self):
        """Length, basis and values (1 + k, 3, d, n) of the step; None where none is small enough.

        Functions that follow a stiff start with a tiny order are tried on long steps at first.
        """
        size, left = float(np.abs(self._jacobian).max()), self._t_stop - self._t
        most = min(left / 16, self._longest)
        bends = bends_for(self._form.generators, self._drives())
        found = self._try(bends, most, _BENT_TRIALS) if bends else None
        return found or self._try((), self._first_length(size, most), np.inf)

    def _try(self, bends, h, trials):
        """Ever shorter steps from h on."""
        strands, t, t_stop = self._strands, self._t, self._t_stop
        basis = power_basis(self._form.generators, bends)
        points = np.concatenate([basis.nodes, basis.between])
        operators = basis.integrals(tuple(self._form.orders.tolist()))
        n_strands, d = strands.x.shape
        values = np.empty((n_strands, 3, d, basis.nodes.size))
        while t + h > t and h > self._least and trials > 0:
            # no crumb is left before the stop
            h = min(h, 0.5 * (t_stop - t)) if h < t_stop - t else h
            values[0, PRIMARY] = strands.p[0][:, None]
            # before the stop: the right-hand side may jump there too
            times = np.clip(t + h * points, self._first, np.nextafter(t_stop, 0.0))
            local = self._convolutions(basis, h)
            if self._stages(
                basis, times, h, strands.past(np.log(h) + basis.logs), operators, local, values
            ):
                return h, basis, values
            h *= _SHORTER
            trials -= 1
            self.n_refused += 1
        return None

    def _convolutions(self, basis, h):
        """Matrices of the general kernels, (n_k, 2 n + 1, n)."""
        kernels = self._form.kernels
        empty = np.zeros((0, basis.nodes.size + basis.between.size, basis.nodes.size))
        return np.array([basis.convolutions(k, h) for k in kernels]) if kernels else empty

    def _drives(self):
        """How strongly the integrals of the smallest order drive the components of p, (d,)."""
        smallest = self._form.generators[0]
        gains = self._gains(lambda a: 1.0 if a == smallest else 0.0)
        return np.abs(np.linalg.eigvals(gains)) if np.all(np.isfinite(gains)) else np.zeros(0)

    def _gains(self, share):
        """Derivative of p by itself through its integrals of order a, times share(a), (d, d)."""
        form, gains = self._form, np.zeros_like(self._jacobian)
        for c, q, k, kappa in rows(form):
            if k >= form.orders.size:
                continue
            factor = kappa * share(form.orders[k])
            if q == FORCE:
                gains[c] += factor * np.where(form.second == 1, 0.0, self._jacobian[c])
            elif q == PRIMARY:
                gains[c, c] += factor
        return gains

    def _first_length(self, size, most):
        """A length over which the solution changes by some half of itself, as a first trial."""
        form = self._form
        forces = form.terms[form.terms.integrand == FORCE]
        order = (form.orders[forces.index] + form.second).min()
        # tiny orders change at once and then hardly: the check between the nodes decides there
        order = max(order, 0.1)
        # a right-hand side of time alone says nothing about itself
        return most if size * most**order < 0.5 else (0.5 / size) ** (1 / order)

    def _stages(self, basis, times, h, base, operators, local, values):
        """Solve for the values at the basis' nodes; whether the orbit's hold in between too."""
        equation, form, strands, run = self._equation, self._form, self._strands, self._run
        n = basis.nodes.size
        solved = solve_once(
            equation._rhs, equation._jac, int(equation.has_jac), equation._params,
            strands.equations(), times[:n], np.ascontiguousarray(operators[:, :n]),
            np.ascontiguousarray(local[:, :n]), h, np.ascontiguousarray(base[:, :, :n]), strands.x,
            1e-3 * self._tolerance(self._size(h)), values, run.counts, run.contraction,
        )  # fmt: skip
        self.solved = solved
        if not solved:
            return False
        inner = (operators[:, n:], local[:, n:])
        defect = self._defect(basis, times[n:], h, base[0, :, n:], *inner, values[0])
        # y' may have to grow to any size at once, y grows from what it is
        size = np.maximum(self._largest, np.abs(values[0, PRIMARY]).max(axis=1))
        size = np.where(form.second, size, self._largest)
        fits = defect <= self._tolerance(size)  # False where it is not finite
        fits &= (form.second == 0) | (h * defect <= self._tolerance(np.abs(strands.x[0])))
        return bool(np.all(fits))

    def _tolerance(self, size):
        """Error that something of this size may have."""
        rtol, atol = self._tolerances
        return atol + rtol * size

    def _size(self, h):
        """The size that p will be of on a step of length h."""
        form, size = self._form, self._largest.copy()
        for c, q, k, kappa in rows(form):
            if q == FORCE and form.second[c]:
                size[c] += abs(kappa * self._force[c]) * h ** form.orders[k]
        return size

    def _defect(self, basis, times, h, base, operators, local, values):
        """How far the equation, integrated, and the basis are off between the nodes, (d,)."""
        equation, form, strands = self._equation, self._form, self._strands
        found, d, n_a = base.copy(), form.second.size, form.orders.size
        for row, (c, q, k, kappa) in enumerate(rows(form)):
            driver = values[q, c % d] - strands.offsets[0, row]
            matrix = h ** form.orders[k] * operators[k] if k < n_a else local[k - n_a]
            found[c] += kappa * (matrix @ driver)
        p = found[:d]
        x = strands.x[0][:, None] + h * (values[PRIMARY] @ operators[-1].T)
        x = np.where(form.second[:, None] == 1, x, p)
        f, out = np.empty_like(x), np.empty(d)
        for i, t in enumerate(times):
            equation._rhs(t, np.ascontiguousarray(x[:, i]), out, equation._params)
            f[:, i] = out
        f[: form.n_rows - d] -= found[d:]
        self._run.counts.rhs += times.size
        off_at = np.abs(np.array([f, p, x]) - basis.interpolate_between(values))
        off = off_at.max(axis=2)
        defect = np.zeros(d)
        for c, q, k, kappa in rows(form):
            if c < d:
                size = h ** form.orders[k] if k < n_a else np.abs(local[k - n_a]).sum(axis=1).max()
                defect[c] += abs(kappa) * size * off[q, c]
        # the basis itself shows in the dense output alone, that of y' through its means
        n, means = values.shape[2], self._means(basis, values[PRIMARY])
        off_means = means[:, n:] - basis.interpolate_between(means[:, :n])
        early = self._early(off_at[POSITION], x)
        shown = np.where(form.second, np.abs(off_means).max(axis=1), early)
        return np.maximum(self._damped(defect, h), _SHARE * np.maximum(off[PRIMARY], shown))

    def _early(self, off, x):
        """Largest error of y between the nodes, early ones in units of what y is late, (d,).

        `off`, x (d, n): the error at a time counts by how large y has been until then.
        """
        allowed = self._tolerance(np.maximum.accumulate(np.abs(x), axis=1))
        return (off * (allowed[:, -1:] / allowed)).max(axis=1)

    def means(self, basis, values):
        """Means of p from the corner to the nodes, from values (3, d, n), shape (d, n)."""
        return self._means(basis, values[PRIMARY])[:, : values.shape[2]]

    def _means(self, basis, p):
        """Means of p (d, n) from the corner to the nodes and between, (d, 2 n + 1).

        Its differences from the last value are what the basis takes: a constant stays exact.
        """
        operator = basis.means(tuple(self._form.orders.tolist()))[-1]  # the last order is 1
        return p[:, -1:] + (p - p[:, -1:]) @ operator.T

    def _damped(self, defect, h):
        """Error of p that a defect leaves where the equation is stiff and nothing grows."""
        gain = self._gains(lambda a: h**a * rgamma(1 + a))
        if not np.all(np.isfinite(gain)) or np.linalg.eigvals(gain).real.max() > 0:
            return defect
        return np.abs(np.linalg.inv(np.eye(defect.size) - gain)) @ defect
