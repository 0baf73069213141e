"""The stepper (floor 4): one march over a uniform mesh, advanced a stretch at a time."""

from dataclasses import dataclass, field

import numpy as np

from .._checks import complaint
from .._jit import JAC_SIG, as_value, kernel
from ..kernels.march import BLOWN_UP

# Steps in a block. Measured with 56 modes: 74, 75 and 85 ns a step at 16, 32 and 64, where the
# in-block sums take over; below 16 the calls of the history do.
BLOCK = 32


@kernel
def _no_jacobian(t, y, out, params):
    """Stands in for a Jacobian where the user gives none."""


@dataclass(frozen=True, eq=False)
class State:
    """Everything a run needs to go on, as plain arrays; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    n : int
        Steps made.
    h : float
        Step of the mesh.
    y : ndarray, shape (d,)
        Solution at `t`.
    identity : tuple
        Scheme, history and terms that the state belongs to; checked on resuming.
    """

    t: float
    n: int
    h: float
    y: np.ndarray
    identity: tuple
    block: int = field(repr=False)
    march: tuple = field(repr=False)
    memory: tuple = field(repr=False)
    memory_steps: int = field(repr=False)


class Stepper:
    """A march of one equation with one scheme and one history on the mesh t_n = n h.

    Parameters
    ----------
    equation : Equation
    scheme : Scheme
    history : History
    h : float
        Step [time].
    n_steps : int
        Steps the whole run is going to take; histories prepare for that many.
    block : int
        Steps in a block; results depend on it by rounding alone.
    """

    def __init__(self, equation, scheme, history, h, n_steps, block=BLOCK):
        self.equation, self.scheme, self.history = equation, scheme, history
        self.h = float(h)
        self._n_steps = int(n_steps)
        plan = scheme.plan(equation, self.h)
        d = equation.d
        self.limits = plan.limits
        start = np.where(plan.second == 1, plan.increments, 0.0)
        self.memory = history.open(plan.convolution, start, block, self._n_steps)
        weights = self.memory.block_weights
        self._scheme_arrays = (self.h, plan.classes, plan.second, weights, plan.lead, plan.near)
        self._block = block
        self._march_arrays = (
            np.array([0, 0, -1]),
            equation.y0[0].copy(),
            plan.increments.copy(),
            np.zeros(d),
            np.zeros((d, block)),
            np.zeros((d, block + 1)),
            np.zeros((d, 3)),
        )
        self._jac = equation._jac or as_value(_no_jacobian, JAC_SIG)
        self.n_rhs = 0
        self.largest_ratio = 0.0
        self.blown_up = False

    @property
    def n(self):
        """Steps made."""
        return int(self._march_arrays[0][0])

    @property
    def rows_written(self):
        """Rows that the last `advance` filled; fewer than asked for where it stopped early."""
        return int(self._march_arrays[0][1])

    @property
    def t(self):
        """Time reached."""
        return self.n * self.h

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._march_arrays[1].copy()

    @property
    def ydot(self):
        """First derivative at `t`, from the newest two increments, shape (d,)."""
        _, _, increment, change, *_ = self._march_arrays
        return (increment + 0.5 * change) / self.h

    @property
    def zigzag(self):
        """Step at which a sustained step-to-step zigzag was seen, or None."""
        n = int(self._march_arrays[0][2])
        return None if n < 0 else n

    def advance(self, n_more, positions, rows, slopes):
        """Make up to `n_more` steps and write the rows asked for on the way.

        Parameters
        ----------
        n_more : int
        positions : ndarray, shape (k,)
            Where rows are wanted, in steps, ascending, within the stretch.
        rows, slopes : ndarray, shape (k, d)
            Filled with the solution and its first derivative there.

        Raises whatever the right-hand side raises; the steps before it are made and kept.
        """
        n, n_end = self.n, self.n + n_more
        self.memory.prepare(n_end)
        n_blocks = (n_end - 1) // self._block - n // self._block + 1
        jacobians = np.zeros((n_blocks, self.equation.d, self.equation.d))
        try:
            status = self.scheme.march(
                self.equation._rhs,
                self._jac,
                int(self.equation.has_jac),
                self.equation.params,
                self.memory.exchange,
                self.memory.tables,
                self.memory.arrays,
                self._scheme_arrays,
                self._march_arrays,
                (positions, rows, slopes, jacobians),
                n_end,
            )
            self.blown_up = status == BLOWN_UP
        finally:
            per_block = 0 if self.equation.has_jac else 2 * self.equation.d
            self.n_rhs += self.n - n + per_block * n_blocks
            self.largest_ratio = max(self.largest_ratio, stiffness_ratio(jacobians, self.limits))

    def state(self):
        """A `State` from which a later run goes on bit for bit."""
        return State(
            t=self.t,
            n=self.n,
            h=self.h,
            y=self.y,
            identity=self._identity(),
            block=self._block,
            march=tuple(array.copy() for array in self._march_arrays),
            memory=self.memory.state(),
            memory_steps=self._n_steps,
        )

    def restore(self, state):
        """Take over where `state` was taken."""
        mine = self._identity()
        if state.identity != mine:
            names = ("scheme", "history", "orders", "coefficients")
            pairs = zip(names, state.identity, mine, strict=True)
            name, theirs, ours = next(p for p in pairs if p[1] != p[2])
            required = f"come from a run with the same {name}, here {ours}"
            raise ValueError(complaint("resume", required, theirs, "start anew, or change it back"))
        self._march_arrays = tuple(array.copy() for array in state.march)
        self.memory.restore(state.memory)

    def _identity(self):
        return (
            repr(self.scheme),
            repr(self.history),
            self.equation.orders.tolist(),
            self.equation.coefficients.tolist(),
        )


def stiffness_ratio(jacobians, limits):
    """Largest ratio of stiffness to the step limit over some Jacobians; unstable above 1.

    The zigzag mode of ``D y = J y`` leaves the unit circle where ``-J / limits`` has a real
    eigenvalue above 1. A row-sum bound spares the eigenvalues nearly always.

    Parameters
    ----------
    jacobians : ndarray, shape (k, d, d)
    limits : ndarray, shape (d,)
        Limit of each component, above 0.

    Returns
    -------
    float
    """
    scaled = -jacobians / limits[:, None]
    scaled = scaled[np.isfinite(scaled).all(axis=(1, 2))]
    if scaled.size == 0:
        return 0.0
    if scaled.shape[1] == 1:
        return max(0.0, float(scaled.max()))
    bounds = np.abs(scaled).sum(axis=2).max(axis=1)
    worst = scaled[bounds > 1]
    if worst.size == 0:
        return float(bounds.max())
    values = np.linalg.eigvals(worst)
    real = np.abs(values.imag) <= 1e-9 * np.abs(values)
    return float(np.where(real, values.real, 0.0).max())
