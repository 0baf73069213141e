"""Refusals of operators, equations and the functions that they are given, by what is called."""

import math
from functools import partial

import numpy as np
import scipy.sparse as sp
from refusals import BAD, PRONY, decay, each, equation, faded, linear, read

import hereditary as hd

C, RL = hd.Caputo, hd.RiemannLiouville


def two(rhs, **given):
    return hd.Equation(C(0.8), rhs, [1.0, 2.0], **({"params": (2.0, 0.5)} | given))


def divides(t, y):
    ratio = y[0] / t
    return -y * ratio


def reads_too_far(t, y, params):
    return -params[7] * y


def changes_y(t, y):
    y *= -1.0
    return y


def changes_params(t, y, params):
    params[0] += 1.0
    return -y


def changes_memory(t, y, memory):
    memory[0] = 1.0
    return -y


def late_change(t, y, jacobian, params):
    if t > 0.0:
        params[1] = 0.0
    jacobian[0, 0] = -1.0


def velocity(t, x):
    return -x[0] - 0.3 * x[1]


def noisy(t, y):
    return -y + np.random.default_rng().normal()


def turns(t, z):
    return 1j * z


def unlike(t, y, p):
    return np.array([np.log(p[0]) * y[0], p[1] * y[1]])


def filled(t, y, dy, p):
    for i in range(2):
        dy[i] = p[0] * y[i]


def refit(rhs, y0, params):
    """Give a function that was compiled in an equation another equation."""
    equation(0.5, [1.0, 2.0], rhs, params=[2.0, 1.0])
    return equation(0.5, y0, rhs, params=params)


def airy(t, x, memory):
    return (1.0 - x[0] ** 2) * memory[0, 0] - t * x[0]


def airy_jac(t, x, memory):
    return np.array([[-2 * x[0] * memory[0, 0] - t]])


def airy_jac_memory(t, x, memory):
    return np.array([[1 - x[0] ** 2]])


def reading(**given):
    given = {"memory": C(0.6)} | given
    return hd.Equation(C(1.8), airy, [0.5, 0.1], **given)


def chain(t, u, du, p):
    for i in range(u.size):
        du[i] = u[i - 1] * (i > 0) - 2 * u[i] - u[i] ** 3
        if i < u.size - 1:
            du[i] += u[i + 1]


def chain_and_far(t, u, du, p):
    chain(t, u, du, p)
    du[3] += 0.01 * u[20]


def chain_dense(t, u):
    return np.diag(-2 - 3 * u**2) + np.eye(u.size, k=1) + np.eye(u.size, k=-1)


def chain_sparse(t, u):
    return sp.diags_array([np.ones(29), -2 - 3 * u**2, np.ones(29)], offsets=[-1, 0, 1])


def band_of_ones(t, u, ab, p):
    ab[:] = 1.0


def chained(rhs=chain, y0=1.0, **given):
    return hd.Equation(C(0.8), rhs, y0 * np.ones(30), **given)


def tridiagonal(d=30):
    ones = np.ones(d - 1)
    return sp.diags_array([ones, -2 * np.ones(d), ones], offsets=[-1, 0, 1]).tocsr()


A, B = C(1.8), C(0.8)
MATRIX = np.array([[0.5, 0.2], [0.2, 0.3]])
NAMED_TERM = r"write Caputo\(0.9\)"
NO_REAL = "rhs must return real numbers"
ARITY = r"rhs must be one of rhs\(t, y\), rhs\(t, y, params\) or"
FOUR = "with four arguments the third is dy, to be filled, and the fourth params"
TOO_SHORT = "rhs must run at t = 0, got IndexError"

OPERATORS = [
    *each(C, [0, -0.5, 20.1, math.nan, math.inf, [0.5, 0.0], [[0.5]], []],
          ValueError, "order must"),
    *each(C, ["a", 1j, None, True], TypeError, "order must"),
    (lambda: C(21), ValueError, r"order must lie in \(0, 20\]"),
    *each(lambda c: c * C(0.5), [math.nan, math.inf, "a", 1j, None, [[1.0, 2.0]]],
          BAD, "coefficient must"),
    (lambda: np.ones((2, 3)) * C(0.5),
     ValueError, r"coefficient must be a real number or have shape \(d,\)"),
    (lambda: (lambda t: t) * A, TypeError, r"coefficient must .* it cannot vary"),
    (lambda: A / 0, ValueError, "divisor must be other than 0"),
    *((call, TypeError, f"summands must be terms with memory.*, got {got}.*; .* stands in rhs")
      for call, got in [
          (lambda: A + 1, "1"),
          (lambda: 1.0 + A, "1.0"),
          (lambda: 1 - (A + B), "1"),
          (lambda: np.ones(2) + A, "array"),
          (lambda: A - "B", "'B'"),
          (lambda: [A] - B, r"\[Caputo"),
      ]),
    (lambda: C(lambda t: 2.5), ValueError, "order must be a function.*got 2.5 at t = 0"),
    (lambda: C(lambda t: 0.0), ValueError, "got 0.0 at t = 0"),
    (lambda: C(lambda t: np.nan), ValueError, "order must be a function.*got nan"),
    *each(C, [lambda t: "half", lambda t: None, lambda t: [0.5, 0.6]],
          TypeError, "order must be a function"),
    (lambda: C(lambda t: 1 / t), ValueError, "ZeroDivisionError at t = 0"),
    (lambda: C(lambda: 0.5), ValueError, "TypeError at t = 0"),
    *each(RL, [1.0, 1.5, lambda t: 1.5], ValueError, r"lie in \(0, 1\)"),
    (lambda: hd.Memory(lambda t: t, 1), TypeError, "kernel must be a MemoryKernel"),
    (lambda: hd.Memory(PRONY, 3), ValueError, "derivative must be 0, 1 or 2, got 3"),
    *each(partial(hd.Memory, PRONY), [True, 0.5], ValueError, "derivative must be 0, 1 or 2"),
    (lambda: hd.Memory(hd.PowerLaw(1.0), 1), ValueError, "kernel must be integrable at 0"),
    (lambda: hd.Memory(hd.PowerLaw(1.5), 2), ValueError, "kernel must be integrable at 0"),
]  # fmt: skip

TERMS = [
    *each(lambda terms: hd.Equation(terms, decay, 1.0),
          [[], 0.5, ["D"], None, [C(0.5), 1.0]], BAD, "terms must"),
    (lambda: hd.Equation(0.9, decay, 1.0), TypeError, NAMED_TERM),
    (lambda: hd.Equation([0.9, 0.8], decay, 1.0), TypeError, NAMED_TERM),
    (lambda: hd.Equation(decay, A, 1.0), TypeError, "they come first"),
    (lambda: hd.solve(equation([np.array([1.0, 0.0]) * C(0.5)], [1.0, 2.0]), 1.0, 10),
     ValueError, "none for component 1"),
    (lambda: equation(hd.Memory(PRONY, 0)), ValueError,
     "terms must hold a derivative.*hereditary.derivative"),
    (lambda: hd.Caputo(-0.5), ValueError, "order must .* got -0.5; .*hereditary.derivative"),
    (lambda: hd.Caputo(30), ValueError, r"order must .* got 30.0$"),
    (lambda: equation(hd.Memory(hd.PowerLaw(1e-16), 2), [1.0, 1.0]),
     ValueError, "exponent must exceed 1e-14 for derivative 2"),
    # matrices
    (lambda: equation(np.ones((2, 2)) * C(0.5), [1.0, 1.0]),
     ValueError, "terms must have an invertible matrix in front of the highest"),
    (lambda: equation(np.eye(3) * C(0.5), [1.0, 1.0]),
     ValueError, r"coefficient must be one number, or have shape \(2,\) or \(2, 2\)"),
    (lambda: equation(np.eye(2) * C(0.5) + 0.5 * hd.Memory(PRONY, 1), [1.0, 1.0]),
     ValueError, "have a Caputo operator of the highest order in each component"),
    (lambda: equation(np.array([[1.0, 1.0], [0.0, 0.0]]) * C(1.5), [[1.0, 1.0], [0.0, 0.0]]),
     ValueError, "be one Caputo operator of order up to 1"),
    (lambda: equation(np.diag([1.0, 0.0]) * C(0.5) + np.array([[1.0, 1.0], [0.0, 0.0]]) * C(0.9),
                      [1.0, 1.0]), ValueError, "give each element a component of its own"),
    # orders above 2
    (lambda: equation(C(2.5) + hd.RiemannLiouville(0.5), [1.0, 0, 0]),
     ValueError, "be Caputo operators of const"),
    (lambda: equation(C(3) - C(3) + C(1), [1.0, 0, 0]),
     ValueError, "nonzero coefficient before the highest order"),
    # Riemann-Liouville
    (lambda: equation(RL(0.5)), ValueError, "other than RiemannLiouville"),
    (lambda: equation(C(0.4) + RL(0.5)), ValueError, r"be below 0\.4 for RiemannLiouville"),
    (lambda: equation(C(1.5) + RL(0.5), [1.0, 0.0]), ValueError, r"1 below its highest order 1\.5"),
    (lambda: equation(C(2.5) + RL(0.3), [1.0, 0.0, 0.0]), ValueError, "orders above 2"),
    (lambda: equation(C(1.0) + MATRIX * RL(0.5), [1.0, 0.5]),
     ValueError, r"got RiemannLiouville\(0\.5\); .* where y = w - C v"),
]  # fmt: skip

INITIAL_VALUES = [
    *((partial(equation, C(order), y0), error, words) for order, y0, error, words in [
        (0.5, math.nan, ValueError, "y0 must be real, finite numbers, got nan"),
        (0.5, [1.0, math.inf], ValueError, "y0 must be real, finite"),
        (0.5, complex(1.0, math.nan), ValueError, "y0 must be finite numbers, got nan"),
        (0.5, complex(0.0, math.inf), ValueError, "y0 must be finite numbers"),
        (0.5, "one", BAD, "y0 must"),
        (0.5, [[1.0], [2.0]], ValueError,
         r"y0 must hold y\(0\), shape \(1, d\), got shape \(2, 1\)"),
        (0.5, [[1.0], [2.0]], ValueError,
         r"orders up to 1 need only y\(0\), its components in a row"),
        (0.5, [], ValueError, r"got shape \(0,\)"),
        (1.5, 1.0, ValueError,
         r"y0 must hold y\(0\) and y'\(0\), shape \(2, d\), got 1.; .*\[1.0, 0.0\]"),
        (1.5, [1.0, 2.0, 3.0], ValueError, r"got shape \(3,\); for 3 components give two rows"),
        (1.5, [[1.0, 2.0]], ValueError, r"got shape \(1, 2\)"),
        (1.5, [[[1.0]]], ValueError, r"got shape \(1, 1, 1\)"),
        (1.5, [[1.0], [2.0, 3.0]], BAD, "y0 must"),
        (2.1, [1.0, 0.0], ValueError, r"y0 must hold y\(0\), y'\(0\) and y''\(0\), shape \(3, d\)"),
        (2.5, [1.0, 0.0], ValueError, r"y0 must hold y\(0\), y'\(0\) and y''\(0\), shape \(3, d\)"),
        ([0.5, 0.6], [1.0, 2.0, 3.0], ValueError,
         "order must be one number or one for each of the 3"),
        ([1.5, 0.6], [[1.0, 2.0], [0.0, 3.0]], ValueError, r"got y0\[1\]\[1\] = 3.0; set it to 0"),
        ([2.5, 0.5], [[1.0, 1.0], [0, 1.0], [0, 0]], ValueError,
         r"hold no y'\(0\) for component 1"),
        ([2.5, 1.5], [[1.0, 1.0], [0, 0], [0, 2.0]], ValueError,
         r"hold no y''\(0\) for component 1"),
    ]),
    *((partial(equation, 1.5, y0, d=d), ValueError, words) for y0, d, words in [
        ([1.0, 2.0, 3.0], 2, r"y0 must hold at least 2 rows of 2.*got shape \(3,\)"),
        (1.0, 1, "y0 must hold at least 2 rows of 1.*got 1."),
        ([[1.0, 2.0], [0.5, 0.6]], 3, r"got shape \(2, 2\)"),
        ([[1.0, 2.0], [0.5, 0.6]], 0, "d must be a positive integer"),
    ]),
    *each(lambda params: equation(params=params, rhs=faded),
          [[[1.0]], math.nan, [math.nan], "abc", [1j], {"a": 1.0}], BAD, "params must"),
    (lambda: equation(t_start="now"), TypeError, "t_start must be a finite real number"),
    (lambda: equation(parameters=()), TypeError, "unexpected keyword"),
    # complex
    (lambda: equation(0.6, [1.0, 2.0], turns),
     TypeError, "return real numbers, got .*; give y0 complex numbers"),
    (lambda: equation(0.6, 1j, turns, jac=lambda t, z: 1j),
     ValueError, "jac must be left out for complex y"),
    (lambda: equation(0.6, [1j, 0], lambda t, z: np.zeros(3)),
     ValueError, r"rhs must return shape \(2,\), got shape \(3,\)"),
    (lambda: equation(np.ones(4) * C(0.6), [1j, 0], turns),
     ValueError, "coefficient must be one number or one for each of the 2"),
]  # fmt: skip

FUNCTIONS = [
    *each(two, [lambda: 0.0, lambda t: t, lambda t, y, dy, params, more: 0.0, lambda t, *y: 0.0,
                math.hypot, partial(decay, 0.0)], TypeError, ARITY),
    *each(two, [None, 5, "f"], TypeError, "rhs must be a function"),
    (lambda: two(lambda t, y: np.zeros(3)),
     ValueError, r"rhs must return shape \(2,\), got shape \(3,\)"),
    (lambda: two(lambda t, y: y[0]), ValueError, r"rhs must return shape \(2,\), got shape \(\)"),
    (lambda: equation(rhs=lambda t, y: np.zeros(2)),
     ValueError, r"shape \(1,\) or a number, got shape \(2,\)"),
    (lambda: two(lambda t, y: None), TypeError, NO_REAL),
    (lambda: two(lambda t, y: y * 1j), TypeError, NO_REAL),
    (lambda: two(lambda t, y, dy, params: -y), TypeError, "rhs must fill dy and return None"),
    (lambda: equation(rhs=lambda t, y: divides(t, [float(y[0])]) * 1.0),
     ValueError, r'ZeroDivisionError.*line \d+ .*"ratio = y\[0\] / t"'),
    (lambda: two(reads_too_far),
     ValueError, r'IndexError.*"return -params\[7\] \* y".*params = \[2. , 0.5\]'),
    (lambda: two(lambda t, y: np.array([0.0, y[1] * math.nan])),
     ValueError, r"rhs must be finite at t = 0, got \[ 0., nan\]"),
    (lambda: equation(0.7, rhs=lambda t, y: y / (t - 2.0), t_start=2.0),
     ValueError, "rhs must be finite at t = 2"),
    (lambda: two(changes_y), ValueError, "rhs must leave y as it is"),
    (lambda: two(changes_params), ValueError, "rhs must leave params as it is"),
    (lambda: two(lambda y, t: -y),
     TypeError, r"rhs must take t first and y second, got .*\(y, t\)"),
    *each(partial(two, params=(1.0, 2.0, 3.0)),
          [lambda t, y, a, b: -a * b * y, lambda t, y, a, b: a * np.ones(3) + b], BAD, FOUR),
    *each(partial(equation, 1.8, [1.0, 2.0]),
          [lambda t, y: [-y[0], -y[1]], lambda t, y: np.zeros(2)],
          ValueError, "is taken for .* of one component"),
    (lambda: equation(1.8, [1.0, 0.0], velocity), ValueError,
     r"two write \[\[y\(0\).*memory=hd.Caputo\(1\).*\(t, y, memory\).*memory\[0, 0\]"),
    (lambda: equation(1.8, [[1.0], [0.0]], velocity),
     ValueError, r"memory=hd.Caputo\(1\).*memory\[0, 0\]"),
    *each(lambda y0: equation(0.8, y0, lambda t, y: -math.sin(y)), [[1.0, 2.0], [[1.0, 2.0]]],
          ValueError, r"must run at t = 0, got TypeError.*converted.*; .* write np\.sin\(y\)"),
    (lambda: equation(0.8, rhs=noisy),
     ValueError, "rhs must give equal values for equal t, y.*random numbers.*at line"),
    # functions that fitted an equation before
    *((partial(refit, *given), ValueError, words) for *given, words in [
        (unlike, [1.0, 2.0], [2.0], TOO_SHORT),
        (unlike, [1.0, 2.0], [0.0, 1.0], r"rhs must be finite at t = 0, got \[-inf"),
        (unlike, [1.0], [2.0, 1.0], TOO_SHORT),
        (unlike, [1.0, 2.0, 3.0], [2.0, 1.0], r"rhs must return shape \(3,\), got shape \(2,\)"),
        (filled, [1.0, 2.0, 3.0], [2.0], r"set every entry of dy, got entries \[\[2\]\]"),
    ]),
    # jac
    (lambda: two(decay, jac=lambda t, y: np.zeros(2)),
     ValueError, r"jac must return shape \(2, 2\)"),
    (lambda: equation(0.8, params=(1.0, 2.0), jac=late_change),
     TypeError, r"jac must leave y .* \"params\[1\] = 0.0\""),
    *each(lambda jac: equation(0.9, jac=jac),
          [lambda t, y: np.array([[1.0]]), lambda t, y: np.array([[-2.0]])],
          ValueError, "jac must"),
]  # fmt: skip

READ = [
    (lambda: equation(0.9, rhs=lambda t, y, params: -y, memory=C(0.5)),
     TypeError, "take memory third.*memory= pass it there"),
    (lambda: equation(0.9, memory=C(0.5)),
     TypeError, r"rhs\(t, y, memory\).*got decay\(t, y\); memory= passes memory third, in the"),
    (lambda: equation(0.9, rhs=lambda t, y, memory, p: -y),
     TypeError, r"rhs must fill dy.*; rhs\(t, y, memory, params\) needs memory="),
    *each(lambda terms: equation(terms), [hd.Delay(1.0), [C(0.9), hd.Delay(1.0)]],
          TypeError, r"terms must be .*, got Delay\(1.0\); name it in memory="),
    *each(lambda order: equation(0.9, rhs=read, memory=C(order)), [0.9, 1.2],
          ValueError, "memory must have orders below"),
    *each(lambda memory: equation(0.9, rhs=read, memory=memory), [airy, 0.5, [0.5], None],
          TypeError, "memory must be Caputo or Memory operators"),
    (lambda: equation(0.9, rhs=changes_memory, memory=C(0.5)), ValueError, "leave memory as it is"),
    (lambda: equation(1.5, [1.0, 0.0], read, memory=RL(0.3)),
     ValueError, "memory must hold Caputo or Memory terms"),
    (lambda: equation(2.5, [1.0, 0, 0], read, memory=C(0.5)),
     ValueError, "memory must be left out with orders above 2"),
    (lambda: equation(1.5, [1.0, 0], read, memory=C(2.5)),
     ValueError, "memory must have orders up to 2"),
    (lambda: equation(np.eye(2) * C(0.5), [1.0, 1.0], lambda t, y, m: -y, memory=C(0.3)),
     ValueError, "memory must be left out with"),
    (lambda: equation(0.5, [1.0, 1.0], lambda t, y, m: -y, memory=np.eye(2) * C(0.3)),
     ValueError, "memory must have coefficients of shape"),
    (lambda: reading(jac=airy_jac), ValueError, "jac_memory"),
    (lambda: reading(jac=airy_jac, jac_memory=lambda t, x, memory: np.array([[x[0] ** 2 - 1]])),
     ValueError, "must hold d rhs"),
]  # fmt: skip

STRUCTURE = [
    *((partial(chained, **wrong), error, words) for wrong, error, words in [
        ({"bandwidth": 3}, TypeError, "lower, upper"),
        ({"bandwidth": (1, -1)}, ValueError, "bandwidth must be an integer of at least 0"),
        ({"bandwidth": (1, 1), "jac_sparsity": tridiagonal()}, ValueError, "without bandwidth"),
        ({"jac_sparsity": tridiagonal(5)}, ValueError, r"shape \(5, 5\)"),
        ({"jac_sparsity": np.ones(30)}, ValueError, "pattern of shape"),
        ({"jac_sparsity": sp.coo_array((np.ones(2), ([0, 0], [1, 1])), shape=(30, 30))},
         ValueError, "hold each entry once"),
        ({"linear": tridiagonal(5)}, ValueError, r"shape \(5, 5\)"),
        ({"linear": np.full((30, 30), np.nan)}, ValueError, "finite real numbers"),
        ({"linear": tridiagonal() * 1j}, ValueError, "finite real numbers"),
        ({"linear": "A"}, ValueError, "linear must be a matrix"),
        ({"rhs": None}, TypeError, "rhs must be a function"),
        ({"rhs": None, "y0": 1j, "linear": tridiagonal()}, ValueError, "complex y"),
        ({"bandwidth": (1, 1), "memory": C(0.3)}, ValueError, "left out with memory"),
        ({"bandwidth": (1, 1), "jac": chain_dense}, ValueError, r"shape \(3, 30\)"),
        ({"bandwidth": (1, 1), "jac": band_of_ones}, ValueError, "jac must hold every entry"),
        ({"bandwidth": (1, 1), "rhs": chain_and_far},
         ValueError, "jac_sparsity or bandwidth must hold every entry .* row 3"),
        ({"jac_sparsity": sp.eye_array(30, format="csr"), "jac": chain_sparse},
         ValueError, "without entries outside jac_sparsity"),
    ]),
]  # fmt: skip

REPLACED = [
    (lambda: equation(0.8, rhs=faded, params=[1.0], jac=lambda t, y, p: -p[0]).replace(rhs=decay),
     ValueError, "jac must come with another rhs"),
    (lambda: reading(jac=airy_jac, jac_memory=airy_jac_memory).replace(rhs=read),
     ValueError, "jac must come with another rhs"),
    (lambda: linear().replace(parameters=[3.0]),
     TypeError, "changes must be among terms, rhs, y0, params, jac"),
    (lambda: reading().jacobian(0.0, [1.0]), ValueError, "read no memory"),
    *((lambda new=new: equation(0.8, rhs=lambda t, y, p: np.log(p[0]) * y, params=[1.0, 2.0])
       .replace(params=new), ValueError, words)
      for new, words in [([0.0, 1.0], "rhs must be finite at t = 0"), ([], TOO_SHORT),
                       ([np.nan, 1.0], "params must")]),
    # scenes' functions run without bounds checks: the trial call meets what is missing
    *((lambda make=make, n=n: make().replace(params=make().params[:n]), ValueError,
       "must run at t = 0, got IndexError")
      for make, n_read in [
        (hd.scenes.stick_slip, 3), (hd.scenes.lorenz, 3), (hd.scenes.rossler, 3),
        (hd.scenes.brusselator, 2), (hd.scenes.duffing, 4), (hd.scenes.van_der_pol, 3)]
      for n in range(n_read)),
    *((lambda name=name: setattr(linear(), name, None), AttributeError,
       rf"{name} .* eq.replace\({name}=...\)") for name in ("terms", "rhs", "y0", "jac")),
    (lambda: setattr(linear(), "params", [2.0, 1.0]), AttributeError, r"eq.replace\(params=...\)"),
    (lambda: setattr(linear(), "d", 2), AttributeError, r"d of an Equation cannot be changed"),
    (lambda: setattr(linear().replace(params=[2.0, 1.0]), "d", 3),
     AttributeError, "cannot be changed"),
    *each(lambda name: getattr(linear(), name).fill(0.5),
          ["y0", "params", "orders", "coefficients"], ValueError, "read-only"),
    (lambda: linear().replace(params=[2.0, 1.0]).y0.fill(0.5), ValueError, "read-only"),
    (lambda: linear().terms[0].coefficient.fill(0.5), ValueError, "read-only"),
]  # fmt: skip

ROWS = [*OPERATORS, *TERMS, *INITIAL_VALUES, *FUNCTIONS, *READ, *STRUCTURE, *REPLACED]
