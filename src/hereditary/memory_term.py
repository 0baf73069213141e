"""A memory term that another program advances step by step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .equation.operators import Caputo, Memory, Term
from .equation.statement import left_side
from .equation.system import System, refuse_late
from .given.block import close_piece, open_lag
from .given.fixed_stepper import BLOCK
from .given.history.exponentials import SumOfExponentials
from .given.history.history import History
from .given.plan import Plan
from .given.signatures import MarchMemory
from .given.steps import UniformSteps
from .kernels.memory_kernel import MemoryKernel, warn_of_fit
from .solver.elsewhere import lacking
from .stepping.scheme import Scheme
from .stepping.state import described, described_terms
from .support.checks import count, instance, positive, real, real_array, refuse, shown

# Number of first steps that may be corrected: one, by the value of the term at 0.
_CORRECTED = 1


class MemoryTermState(NamedTuple):
    """Everything that a resumed `MemoryTerm` needs."""

    made: dict  # arguments of the term
    n: int  # number of steps
    opened: int  # step at which the open block begins
    u: np.ndarray  # (W,)
    start: np.ndarray  # h v0 and term0, (2, W)
    lag: np.ndarray  # of the block
    pieces: np.ndarray  # newest ones of the block
    memory: tuple[np.ndarray, ...]  # of older pieces


class MemoryTerm:
    """A memory term of an array u, one step after the other; made by `memory_term`.

    In the step from t_n to t_n + h its value at t_n + theta h is ``weight * u_new + lag``. The
    unknown u_new is that at the end of the step.

    Attributes
    ----------
    n : int
        Steps absorbed.
    theta : float
        Fraction of the step at which the value is taken: 1, its end; 1/2 for `L1` above order 1;
        1 - alpha/2 for `L2Sigma` [-].
    """

    def __init__(
        self, settings: dict[str, Any], system: System, plan: Plan, memory: Any, h: float,
        u0: np.ndarray, v0: np.ndarray, term0: np.ndarray,
    ) -> None:  # fmt: skip
        self._settings, self._system, self._plan = settings, system, plan
        self._memory, self._h = memory, h
        self._shape, width = u0.shape, u0.size
        self._groups = np.zeros(width, dtype=np.int64)
        self._u, self._shift, self._term0 = u0.ravel(), h * v0.ravel(), term0.ravel()
        self._lag, self._pieces = np.zeros((width, BLOCK)), np.zeros((width, BLOCK + 1))
        self.n, self._opened, self.theta = 0, -1, float(plan.rows.theta[0])
        self._step_lag: np.ndarray | None = None

    def _factor(self, rows: Any) -> Any:
        return float(rows[0, min(self.n, 1)])

    @property
    def t(self) -> float:
        """Time t_n at the end of the newest step."""
        return self.n * self._h

    @property
    def u(self) -> np.ndarray:
        """Newest values absorbed; a copy."""
        return self._u.reshape(self._shape).copy()

    @property
    def weight(self) -> float:
        """Factor of the unknown; the first step of `L12` and of `L2Sigma` has another factor."""
        return self._factor(self._plan.rows.scale) / self._factor(self._plan.rows.lead)

    @property
    def lag(self) -> np.ndarray:
        """Known part of the step's value, in the shape of u."""
        if self._step_lag is None:
            self._step_lag = self._lag_of_step()
        return self._step_lag.reshape(self._shape).copy()

    def _lag_of_step(self) -> np.ndarray:
        refuse_late(self._system, (self.n + 1) * self._h)
        if self.n >= self._settings["steps"]:
            refuse("n_steps", "cover all steps", f"{self.n + 1} of them", "make the term for more")
        p = self.n % BLOCK
        if p == 0 and self._opened < self.n:
            self._open()
            self._opened = self.n
        rows = self._plan.rows
        lag = self._factor(rows.near) * self._pieces[:, p] + self._lag[:, p]
        lag /= self._factor(rows.lead)
        lag -= self.weight * (self._u + self._shift)
        corrections = self._plan.corrections
        if corrections is not None and self.n < len(corrections):
            lag -= corrections[self.n, 0] * self._term0
        return lag

    def _open(self) -> None:
        """Open the block that begins here: the memory adds all older pieces to its lag."""
        n, memory = self.n, self._memory
        memory.prepare(min(n + BLOCK, self._settings["steps"]))
        memory.reach(n, self._pieces, self._groups)
        march_memory = MarchMemory(memory.exchange, memory.tables, memory.arrays)
        open_lag(self._lag, self._pieces, n, self._groups, memory.block_weights, march_memory)

    def absorb(self, u: ArrayLike) -> None:
        """Add the solution at the end of a step to the memory.

        Parameters
        ----------
        u : array_like
            In the shape of u0.
        """
        new = _array("u", u, self._shape).ravel()
        if self._step_lag is None:
            self._step_lag = self._lag_of_step()
        p, piece = self.n % BLOCK, new - self._u - self._shift
        close_piece(p, self._memory.block_weights[0], piece, self._lag, self._pieces)
        weights = self._memory.block_start_weights
        if self.n == 0 and weights.shape[1] > 0:  # the first increment weighs as a start value
            self._memory.arrays.starts[...] = piece[:, None]
            self._lag[:, 1:] += np.outer(piece, weights[0, 1:BLOCK])
        self.n, self._u, self._step_lag = self.n + 1, new, None

    def state(self) -> MemoryTermState:
        """Return what `restore` needs to continue from here, bit for bit.

        Returns
        -------
        MemoryTermState
            A named tuple of numbers and arrays, which can be pickled.
        """
        start = np.array([self._shift, self._term0])
        return MemoryTermState(
            self._made(self.n), self.n, self._opened, self._u.copy(), start, self._lag.copy(),
            self._pieces.copy(), self._memory.state(),
        )  # fmt: skip

    def _made(self, n: int) -> dict[str, Any]:
        """Return the properties that a term shares with that of a restored state at step n."""
        terms = described_terms(self._system, n * self._h)
        return {**self._settings, **terms, "shape": self._shape, "h": self._h}

    def restore(self, state: MemoryTermState) -> None:
        """Continue from a `state` of a term made with the same arguments.

        Parameters
        ----------
        state : MemoryTermState
        """
        instance("state", state, MemoryTermState, "what state() returned")
        mine = self._made(state.n)
        for name, value in state.made.items():
            if value != mine[name]:
                refuse("state", f"come from a term with the same {name}, here {mine[name]}", value)
        self.n, self._opened, self._u = state.n, state.opened, state.u.copy()
        self._shift, self._term0 = state.start.copy()
        self._lag, self._pieces = state.lag.copy(), state.pieces.copy()
        self._memory.restore(state.memory)
        self._step_lag = None


@lacking("the program that makes the steps has it")
def memory_term(
    kernel_or_order: float | MemoryKernel,
    h: float,
    scheme: Scheme,
    u0: ArrayLike,
    *,
    v0: ArrayLike = 0.0,
    term0: ArrayLike = 0.0,
    history: History | None = None,
    n_steps: int | None = None,
) -> MemoryTerm:
    """Make a memory term ``D^alpha u`` or ``int_0^t K(t-s) u'(s) ds`` for another program's steps.

    It is for finite elements, finite volumes and other programs that solve their own equation. In
    each step they solve ``weight * u_new + lag = ...`` for the unknown, of any shape, and return
    it::

        term = hd.memory_term(0.7, h, hd.BDF(2), u0, term0=rhs(0, u0))
        for n in range(n_steps):
            u = ...  # solve  term.weight * u + term.lag = rhs((n + 1) * h, u)
            term.absorb(u)

    Parameters
    ----------
    kernel_or_order : float or MemoryKernel
        Order alpha of Caputo's derivative, 0 < alpha <= 2, or a kernel K, with L1.
    h : float
        Step [time].
    scheme : Scheme
        `L1`, ``BDF(1)`` or ``BDF(2)``, or for orders up to 1 `L12` or `L2Sigma`: implicit, with
        steps of one length.
    u0 : array_like
        u(0), of any shape.
    v0 : array_like, optional
        u'(0) for orders above 1, in the shape of u0 or a number.
    term0 : array_like, optional
        The term's value at t = 0 by the equation, in the shape of u0 or a number. `BDF(2)` keeps
        its order with it for solutions like ``t**alpha``; others do not need it.
    history : History, optional
        `SumOfExponentials` by default.
    n_steps : int, optional
        Steps of the run; without it any number of steps is possible. Kernels given by their values
        need it, and allow no more steps.

    Returns
    -------
    MemoryTerm
        With ``weight`` (a number), ``lag`` (an array like u), ``absorb(u)``, ``state()`` and
        ``restore(state)``. The equation of the step is at t_n + ``theta`` h.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required.

    Notes
    -----
    Order and regularity are those of the scheme. A step takes about 20 us, and 80 ns for each
    value. With the default history a value takes 1.4 kB of storage for any number of steps.

    Examples
    --------
    ``D^0.5 u = -u`` in implicit steps, u(0) = 1:

    >>> import hereditary as hd
    >>> h = 1e-3
    >>> term = hd.memory_term(0.5, h, hd.BDF(2), 1.0, term0=-1.0)
    >>> for _ in range(1000):
    ...     term.absorb(-term.lag / (term.weight + 1))
    >>> round(float(term.u), 5)
    0.42758
    """
    h = positive("h", h)
    instance("scheme", scheme, Scheme, "hereditary.L1()")
    if history is None:
        history = SumOfExponentials()
    instance("history", history, History, "hereditary.SumOfExponentials()")
    start = real_array("u0", u0)
    speed, value = _array("v0", v0, start.shape), _array("term0", term0, start.shape)
    operator, by_values = _operator(kernel_or_order)
    if n_steps is None and by_values:
        required = "be given with a kernel that is known by its values"
        refuse("n_steps", required, "None", kind=TypeError)
    system = _alone(operator)
    if system.m == 1 and np.any(speed):
        refuse("v0", "be left out for orders up to 1", shown(speed))
    plan = _plan(scheme, system, h)
    most = 1 if n_steps is None else count("n_steps", n_steps)
    covered = UniformSteps(h).covered(most, getattr(history, "horizon", None) or 0.0)
    memory = history.open(plan.past, start.size, BLOCK, covered)
    warn_of_fit(max(memory.kernel_errors), getattr(history, "tol", 0.0))
    last = most if by_values else math.inf
    settings = {"scheme": described(scheme), "history": described(history), "steps": last}
    return MemoryTerm(settings, system, plan, memory, h, start, speed, value)


def _operator(kernel_or_order: Any) -> Any:
    """Return the operator of an order or a kernel, and whether a kernel is known by its values."""
    if isinstance(kernel_or_order, MemoryKernel):
        return Memory(kernel_or_order, 1), kernel_or_order.by_values
    required = "be an order alpha or a memory kernel"
    return Caputo(real("kernel_or_order", kernel_or_order, required)), False


def _alone(operator: Any) -> System:
    """Return the system with this operator as its left side, and f = 1."""
    term = Term(operator, 1.0).plain()
    orders = getattr(term.operator, "order", ())  # a kernel has none
    left = left_side((term,), term.coefficient.reshape(1, 1), np.reshape(orders, (-1, 1)), 0.0)
    y0 = np.eye(term.operator.derivative)[:, :1]
    return System(left, y0, force_of_plan=lambda t, y: np.ones(y.size))


def _plan(scheme: Scheme, system: System, h: float) -> Plan:
    """Return the plan of a scheme; refuse a scheme whose steps are more than one equation."""
    required = "solve one equation a step here"
    remedy = "use BDF(1), BDF(2), L1, or up to order 1 L12, L2 or L2Sigma"
    if scheme.solve == "newton":
        scheme.check_terms(system)
        plan: Plan | None = None if scheme.reduction(system) else scheme.plan(system, h)
        corrected = 0 if plan is None or plan.corrections is None else len(plan.corrections)
        if plan and plan.given is None and not plan.integral and corrected <= _CORRECTED:
            return plan
    refuse("scheme", required, repr(scheme), remedy)


def _array(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers in the shape of u0; refuse any other shape."""
    array = real_array(name, values)
    if array.shape not in (shape, ()):
        refuse(name, f"have the shape of u0, {shape}", f"shape {array.shape}")
    return np.broadcast_to(array, shape).copy()
