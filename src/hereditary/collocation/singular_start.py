"""First step after a point where the solution is not smooth: a singular start.

After t = 0, a break or a jump the solution is a sum of powers of the time since; the step is solved
in a basis of such powers (power_basis.py).
"""

import importlib

import numpy as np
from scipy.special import rgamma

from ..compiled.error_estimate import LEAST, OF_SPEED
from ..compiled.rows import FORCE, POSITION, PRIMARY
from ..compiled.single_step import SINGLE_STEPS
from ..schemes.stability import eigenvalues
from .power_basis import TINY, choose_map_rates, power_basis
from .stage_solver import has_stages, stage_solver

# Factors of the length after a refused step, at most and at least; trials with rational maps.
_SHORTER, _SHORTEST, _MAPPED_TRIALS = 0.3, 0.01, 12
# Factor of the tolerance that the first power without a function may be of, on a first trial: bases
# approximate better than sums of powers do. Shorter trials cost a step or two, but seldom fail.
_MISSING = 2e6
# Weight of the interpolation error of the basis, which affects dense output alone.
_BASIS_WEIGHT = 0.25
# Size that counts of a component at rest among many, as fraction of the largest.
_OF_LARGEST = 0.01


class SingularStart:
    """Solver of the step that begins at a singular point t.

    Parameters
    ----------
    equation : System
    form : Form
    orbit : OrbitAndTangents
    t, t_stop : float
    least : float
        Length below which the modes cannot follow.
    tolerances : (float, float, float)
        Tolerances of y and p: relative to them, absolute, and relative to the size of a component.
    state : MarchState
        Counts, contraction of Newton's method, the largest |p| so far where p is y', and the sizes
        of y so far.
    longest, t_end : float
        Longest step, and length of the run.
    units : ndarray, shape (d,)
        Units of the components.

    Attributes
    ----------
    n_refused : int
        Steps refused.
    solved : bool
        Whether Newton's method converged on the last of them.
    """

    def __init__(
        self, equation, form, orbit, t, t_stop, least, tolerances, state, longest, t_end, units
    ):  # fmt: skip
        self._equation, self._form, self._orbit = equation, form, orbit
        self._t, self._t_stop, self._least = t, t_stop, least
        self._tolerances, self._state, self._t_end = tolerances, state, t_end
        self._largest = np.maximum(np.abs(orbit.p[0]), state.largest)
        # the first time after t, for the right-hand side may jump at t
        self._just_after = equation.beside(t, 1) if t > 0 else 0.0
        self._many = has_stages(form)
        self._units = units
        self._jacobian = equation.derivative(self._just_after, orbit.x[0], units)
        state.counts["rhs"] += 1
        self._force = equation.force(self._just_after, orbit.x[0])
        self.n_refused, self.solved, self._longest = 0, True, longest
        forces = form.terms["index"][form.terms["integrand"] == FORCE]
        # solutions of tiny order change at once and then hardly: the defect decides there
        self._order = max(float((form.orders[forces] + form.second).min()), 0.1)

    def step(self):
        """Solve the step; return its length, basis and values (1 + k, 3, d, n), or None.

        None means that every length was refused. A stiff start of tiny order is first tried with
        rational maps on long steps.
        """
        size, left = self._rate(), self._t_stop - self._t
        most = min(left / 16, self._longest)
        generators = self._form.generators
        rates = self._decay_rates() if generators[0] < TINY else ()
        map_rates = choose_map_rates(generators, rates)
        if map_rates:
            mapped = power_basis(generators, map_rates)
            found = self._try_lengths(mapped, most, _MAPPED_TRIALS)
            if found:
                return found
        basis = power_basis(generators)
        return self._try_lengths(basis, self._first_length(size, most, basis.missing), np.inf)

    def _try_lengths(self, basis, h, trials):
        """Try ever shorter steps, from length h on, with one power basis."""
        orbit, t, t_stop = self._orbit, self._t, self._t_stop
        points = np.concatenate([basis.nodes, basis.between])
        self._stages = stage_solver(self._equation.structure, self._form, basis.nodes.size)
        operators = basis.integrals(tuple(self._form.orders.tolist()))
        n_columns, d = orbit.x.shape
        values = np.empty((n_columns, 3, d, basis.nodes.size))
        shortest = _SHORTER if basis.map_rates else _SHORTEST  # maps are for long steps
        while t + h > t and h > self._least and trials > 0:
            # no tiny remainder is left before the stop
            h = min(h, 0.5 * (t_stop - t)) if h < t_stop - t else h
            values[0, PRIMARY] = orbit.p[0][:, None]
            # strictly before the stop, where the right-hand side may jump too
            last = self._equation.beside(t_stop, -1)
            times = np.clip(t + h * points, self._just_after, last)
            local = self._convolutions(basis, h)
            self._sizes = np.maximum(self._state.sizes, self._state.floors)
            excess = self._solve_and_check(
                basis, times, h, orbit.history(np.log(h) + basis.logs), operators, local, values
            )
            if excess <= 1:
                return h, basis, values
            if self.solved:  # errors fall faster than by the power 4/3 of the change of y
                h *= max(shortest, min(_SHORTER, excess ** (-0.75 / self._order)))
            else:
                h *= _SHORTER
            trials -= 1
            self.n_refused += 1
        return None

    def _convolutions(self, basis, h):
        """Return the convolution matrices of the general kernels, (n_k, n + k, n)."""
        kernels = self._form.kernels
        empty = np.zeros((0, basis.nodes.size + basis.between.size, basis.nodes.size))
        return np.array([basis.convolutions(k, h) for k in kernels]) if kernels else empty

    def _decay_rates(self):
        """Return |eigenvalues| of the coefficients of p in the integral of smallest order, (d,)."""
        smallest = self._form.generators[0]
        gains = self._gains(lambda a: 1.0 if a == smallest else 0.0)
        return np.abs(eigenvalues(gains)) if np.isfinite(abs(gains).sum()) else np.zeros(0)

    def _gains(self, weight):
        """Return the derivative of p with respect to p through its integrals, (d, d).

        The integral of order a counts with the factor weight(a). It is sparse as the Jacobian is.
        """
        form = self._form
        d = form.second.size
        of_force, of_p = np.zeros(d), np.zeros(d)
        for q, k, coefficient, rows, _ in form.groups:
            own = rows[rows < d]
            if k < form.orders.size and q in (FORCE, PRIMARY):
                factors = of_force if q == FORCE else of_p
                np.add.at(factors, own, coefficient * weight(form.orders[k]))
        of_values = np.where(form.second == 1, 0.0, 1.0)
        if isinstance(self._jacobian, np.ndarray):
            return of_force[:, None] * self._jacobian * of_values + np.diag(of_p)
        diagonal = importlib.import_module("scipy.sparse").diags_array
        scaled = diagonal(of_force) @ self._jacobian @ diagonal(of_values)
        return (scaled + diagonal(of_p)).tocsr()

    def _rate(self):
        """Return how fast the solution may change at first: the largest sum of sqrt(J_ij J_ji).

        For many components |J v| / |v| for v = f and v = y' tells more: of a partial differential
        equation with smooth initial data it does not grow as the mesh becomes finer.
        """
        if not self._many:  # units of components do not enter
            pairs = np.sqrt(np.abs(self._jacobian * self._jacobian.T))
            return float(pairs.sum(axis=1).max())
        size, sizes = float(abs(self._jacobian).max()), np.abs(self._orbit.x[0])
        if not np.isfinite(size):
            return size
        scale, rates = sizes + _OF_LARGEST * (sizes.max() or 1.0), [0.0]
        with np.errstate(over="ignore", invalid="ignore"):
            for v in (self._force, np.where(self._form.second, self._orbit.p[0], 0.0)):
                largest = np.abs(v / scale).max()
                if largest > 0.0:
                    rates.append(np.abs(self._jacobian @ v / scale).max() / largest)
        rate = max(rates)
        return rate if 0.0 < rate < size else size

    def _first_length(self, size, most, missing):
        """Return a first trial length: over it the solution changes by about half of itself.

        It is less with several orders; `missing` is the exponent of the first power left out.
        """
        order = self._order
        # a right-hand side of time alone gives no estimate
        h = most if size * most**order < 0.5 else (0.5 / size) ** (1 / order)
        if size > 0.0 and len(self._form.generators) < 3:
            return h  # a single order and integers: such solutions need few powers
        # the first power that the basis lacks is to be small
        return h * min(1.0, _MISSING * self._tolerances[0]) ** (1 / missing)

    def _solve_and_check(self, basis, times, h, base, operators, local, values):
        """Solve for the values at the nodes; return the error between them over the tolerance."""
        equation, form, orbit, state = self._equation, self._form, self._orbit, self._state
        n, stages = basis.nodes.size, self._stages
        equations = orbit.equations(self._units)
        solved = SINGLE_STEPS[self._many](
            *equation.compiled, stages.solver, stages.stages, equations, times[:n],
            np.ascontiguousarray(operators[:, :n]), np.ascontiguousarray(local[:, :n]), h,
            np.ascontiguousarray(base[:, :, :n]), orbit.x,
            1e-3 * self._tolerance_of_p(self._size(h)), values, state.counts, state.contraction,
        )  # fmt: skip
        self.solved = solved
        if not solved:
            return np.inf
        inner = (operators[:, n:], local[:, n:])
        defect = self._defect(basis, times[n:], h, base[0, :, n:], *inner, values[0])
        # y', and y that begins at 0, may become large at once: tolerances follow sizes on this step
        size = np.maximum(self._largest, np.abs(values[0, PRIMARY]).max(axis=1))
        reached = np.abs(values[0, POSITION]).max(axis=1)
        self._sizes = np.maximum(self._sizes, reached)
        excess = defect / self._tolerance_of_p(size)
        of_y = np.where(form.second, h * defect / self._tolerance(np.abs(orbit.x[0])), 0.0)
        excess = float(np.maximum(excess, of_y).max())
        return excess if np.isfinite(excess) else np.inf

    def _tolerance(self, values):
        """Return the tolerance of y of these absolute values, (d,)."""
        rtol, atol, by_size = self._tolerances
        return np.maximum(atol + by_size * self._sizes + rtol * values, LEAST)

    def _tolerance_of_p(self, values):
        """Return the tolerance of y, or of y' where that is p, of these absolute values, (d,)."""
        rtol, atol, by_size = self._tolerances
        sizes = np.where(self._form.second == 1, OF_SPEED * self._sizes / self._t_end, self._sizes)
        return np.maximum(atol + by_size * sizes + rtol * values, LEAST)

    def _size(self, h):
        """Estimate the size of p on a step of length h, (d,)."""
        form, size = self._form, self._largest.copy()
        for q, k, coefficient, rows, _ in form.groups:
            own = rows[form.second[rows % size.size] == 1]
            if q == FORCE and own.size:
                size[own] += abs(coefficient * self._force[own]) * h ** form.orders[k]
        return size

    def _defect(self, basis, times, h, base, operators, local, values):
        """Return the error between the nodes, of integrated equations and of the basis, (d,)."""
        equation, form, orbit = self._equation, self._form, self._orbit
        found, d, n_a = base.copy(), form.second.size, form.orders.size
        for q, k, coefficient, rows, numbers in form.groups:
            integrand = values[q, rows % d] - orbit.offsets[0, numbers][:, None]
            matrix = h ** form.orders[k] * operators[k] if k < n_a else local[k - n_a]
            found[rows] += coefficient * (integrand @ matrix.T)
        p = found[:d]
        x = orbit.x[0][:, None] + h * (values[PRIMARY] @ operators[-1].T)
        x = np.where(form.second[:, None] == 1, x, p)
        f = np.array([equation.force(*pair) for pair in zip(times, x.T, strict=True)]).T
        f[: form.n_rows - d] -= found[d:]
        self._state.counts["rhs"] += times.size
        deviation = np.array([f, p, x]) - basis.interpolate_between(values)
        early, u = self._early(p), np.exp(basis.logs[values.shape[2] :])
        defect, caused = np.zeros(d), np.zeros(deviation.shape)
        for q, k, coefficient, rows, _ in form.groups:
            own = rows[rows < d]
            gain = (h * u) ** form.orders[k] if k < n_a else np.abs(local[k - n_a]).sum(axis=1)
            # a defect matters from its time on
            weight = np.maximum.accumulate((gain * early[own])[:, ::-1], axis=1)[:, ::-1]
            change = abs(coefficient) * weight * deviation[q, own]
            caused[q, own] += change
            defect[own] += np.abs(change).max(axis=1)
        deviation = np.abs(deviation) * early
        # the error of the basis affects dense output alone, and y there through the means of y'
        n, means = values.shape[2], self._means(basis, values[PRIMARY])
        deviation_of_means = means[:, n:] - basis.interpolate_between(means[:, :n])
        of_means = np.abs(deviation_of_means).max(axis=1)
        of_y = np.where(form.second, of_means, deviation[POSITION].max(axis=1))
        of_basis = np.maximum(deviation[PRIMARY].max(axis=1), of_y)
        return np.maximum(self._error_from_defect(defect, caused, h), _BASIS_WEIGHT * of_basis)

    def _early(self, p):
        """Return how many times less the tolerance of y allows at early times than later, (d, n).

        At a time it is that of the largest |y| until then; p (d, n). Of y' it is that at the end.
        """
        sizes = np.maximum(np.maximum.accumulate(np.abs(p), axis=1), self._largest[:, None])
        allowed = self._tolerance(sizes.T).T
        return np.where(self._form.second[:, None] == 1, 1.0, allowed[:, -1:] / allowed)

    def means(self, basis, values):
        """Return the means of p from the start to the nodes, (d, n); values (3, d, n)."""
        return self._means(basis, values[PRIMARY])[:, : values.shape[2]]

    def _means(self, basis, p):
        """Return the means of p (d, n) from the start to nodes and points between, (d, n + k).

        Differences from the last value are integrated, so that a constant is exact.
        """
        operator = basis.means(tuple(self._form.orders.tolist()))[-1]  # the last order is 1
        return p[:, -1:] + (p - p[:, -1:]) @ operator.T

    def _error_from_defect(self, defect, caused, h):
        """Return the error of p that a defect (d,) causes, less than the defect if stiff; (d,).

        `caused` (3, d, k) tells it apart, with signs, by integrands and times: of many components.
        """
        gain = self._gains(lambda a: h**a * rgamma(1 + a))
        units = np.where(self._sizes > LEAST, self._sizes, 1.0)
        if self._many:
            return _damped(gain, defect, caused, units)
        gain = gain * units / units[:, None]
        if not np.all(np.isfinite(gain)) or np.linalg.eigvals(gain).real.max() > 0:
            return defect
        return np.abs(np.linalg.inv(np.eye(defect.size) - gain)) @ (defect / units) * units


def _damped(gain, defect, caused, units):
    """Return the error of p that defects of many components cause, at most the largest defect.

    `gain` is a dense or sparse matrix. The defects of each time are damped with the signs that they
    have: rounding of y makes large ones in stiff components, which hardly move y. Errors of
    components are compared in these units, (d,).
    """
    if not np.isfinite(abs(gain).sum()):
        return defect
    caused = caused[caused.any(axis=(1, 2))]
    n_q, d, n_times = caused.shape
    right = caused.transpose(1, 0, 2).reshape(d, n_q * n_times)
    try:
        if isinstance(gain, np.ndarray):
            found = np.linalg.solve(np.eye(d) - gain, right)
        else:
            sparse = importlib.import_module("scipy.sparse")
            linalg = importlib.import_module("scipy.sparse.linalg")
            matrix = sparse.eye_array(d, format="csc") - gain.tocsc()
            found = linalg.splu(matrix).solve(right)
    except (np.linalg.LinAlgError, RuntimeError):  # singular
        return defect
    errors = np.abs(found.reshape(d, n_q, n_times)).max(axis=2).sum(axis=1)
    return np.minimum(errors, units * (defect / units).max())
