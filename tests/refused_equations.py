"""Refusals of operators, equations and the functions that they are given, by what is called."""

import math
from functools import partial

import numpy as np
import scipy.sparse as sp
from problems import laplacian
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


def reading(**given):
    return hd.Equation(C(1.8), airy, [0.5, 0.1], **{"memory": C(0.6)} | given)


def chain(t, u, du, p):
    for i in range(u.size):
        du[i] = u[i - 1] * (i > 0) - 2 * u[i] - u[i] ** 3
        if i < u.size - 1:
            du[i] += u[i + 1]


def chain_and_far(t, u, du, p):
    chain(t, u, du, p)
    du[3] += 0.01 * u[20]


def chain_sparse(t, u):
    return sp.diags_array([np.ones(29), -2 - 3 * u**2, np.ones(29)], offsets=[-1, 0, 1])


def band_of_ones(t, u, ab, p):
    ab[:] = 1.0


def chained(rhs=chain, y0=1.0, **given):
    return hd.Equation(C(0.8), rhs, y0 * np.ones(30), **given)


A, B = C(1.8), C(0.8)
MATRIX = np.array([[0.5, 0.2], [0.2, 0.3]])
NAMED_TERM = r"write Caputo\(0.9\)"
NO_REAL = "rhs must return real numbers"
ARITY = r"rhs must be one of rhs\(t, y\), rhs\(t, y, params\) or"
FOUR = "with four arguments the third is dy, to be filled, and the fourth params"
TOO_SHORT = "rhs must run at t = 0, got IndexError"

OPERATORS = [
    *each(C, [0, -0.5, 20.1, math.nan, math.inf, [0.5, 0.0], [[0.5]], []], "order must"),
    *each(C, ["a", 1j, None, True], "order must", TypeError),
    (lambda: C(21), r"order must lie in \(0, 20\]"),
    *each(lambda c: c * C(0.5), [math.nan, math.inf, "a", 1j, None, [[1.0, 2.0]]],
          "coefficient must", BAD),
    (lambda: np.ones((2, 3)) * C(0.5), r"coefficient must be a real number or have shape \(d,\)"),
    (lambda: (lambda t: t) * A, r"coefficient must .* it cannot vary", TypeError),
    (lambda: A / 0, "divisor must be other than 0"),
    *((call, f"summands must be terms with memory.*, got {got}.*; .* stands in rhs", TypeError)
      for call, got in [
          (lambda: A + 1, "1"),
          (lambda: 1.0 + A, "1.0"),
          (lambda: 1 - (A + B), "1"),
          (lambda: np.ones(2) + A, "array"),
          (lambda: A - "B", "'B'"),
          (lambda: [A] - B, r"\[Caputo"),
      ]),
    (lambda: C(lambda t: 2.5), "order must be a function.*got 2.5 at t = 0"),
    (lambda: C(lambda t: 0.0), "got 0.0 at t = 0"),
    (lambda: C(lambda t: np.nan), "order must be a function.*got nan"),
    *each(C, [lambda t: "half", lambda t: None, lambda t: [0.5, 0.6]],
          "order must be a function", TypeError),
    (lambda: C(lambda t: 1 / t), "ZeroDivisionError at t = 0"),
    (lambda: C(lambda: 0.5), "TypeError at t = 0"),
    *each(RL, [1.0, 1.5, lambda t: 1.5], r"lie in \(0, 1\)"),
    (lambda: hd.Memory(lambda t: t, 1), "kernel must be a MemoryKernel", TypeError),
    (lambda: hd.Memory(PRONY, 3), "derivative must be 0, 1 or 2, got 3"),
    *each(partial(hd.Memory, PRONY), [True, 0.5], "derivative must be 0, 1 or 2"),
    (lambda: hd.Memory(hd.PowerLaw(1.0), 1), "kernel must be integrable at 0"),
    (lambda: hd.Memory(hd.PowerLaw(1.5), 2), "kernel must be integrable at 0"),
]  # fmt: skip

TERMS = [
    *each(lambda terms: hd.Equation(terms, decay, 1.0),
          [[], 0.5, ["D"], None, [C(0.5), 1.0]], "terms must", BAD),
    (lambda: hd.Equation(0.9, decay, 1.0), NAMED_TERM, TypeError),
    (lambda: hd.Equation([0.9, 0.8], decay, 1.0), NAMED_TERM, TypeError),
    (lambda: hd.Equation(decay, A, 1.0), "they come first", TypeError),
    (lambda: hd.solve(equation([np.array([1.0, 0.0]) * C(0.5)], [1.0, 2.0]), 1.0, 10),
     "none for component 1"),
    (lambda: equation(hd.Memory(PRONY, 0)), "terms must hold a derivative.*hereditary.derivative"),
    (lambda: hd.Caputo(-0.5), "order must .* got -0.5; .*hereditary.derivative"),
    (lambda: hd.Caputo(30), r"order must .* got 30.0$"),
    (lambda: equation(hd.Memory(hd.PowerLaw(1e-16), 2), [1.0, 1.0]),
     "exponent must exceed 1e-14 for derivative 2"),
    # matrices
    (lambda: equation(np.ones((2, 2)) * C(0.5), [1.0, 1.0]),
     "terms must have an invertible matrix in front of the highest"),
    (lambda: equation(np.eye(3) * C(0.5), [1.0, 1.0]),
     r"coefficient must be one number, or have shape \(2,\) or \(2, 2\)"),
    (lambda: equation(np.eye(2) * C(0.5) + 0.5 * hd.Memory(PRONY, 1), [1.0, 1.0]),
     "have a Caputo operator of the highest order in each component"),
    (lambda: equation(np.array([[1.0, 1.0], [0.0, 0.0]]) * C(1.5), [[1.0, 1.0], [0.0, 0.0]]),
     "be one Caputo operator of order up to 1"),
    (lambda: equation(np.diag([1.0, 0.0]) * C(0.5) + np.array([[1.0, 1.0], [0.0, 0.0]]) * C(0.9),
                      [1.0, 1.0]), "give each element a component of its own"),
    # orders above 2
    (lambda: equation(C(2.5) + hd.RiemannLiouville(0.5), [1.0, 0, 0]),
     "be Caputo operators of const"),
    (lambda: equation(C(3) - C(3) + C(1), [1.0, 0, 0]),
     "nonzero coefficient before the highest order"),
    # Riemann-Liouville
    (lambda: equation(RL(0.5)), "other than RiemannLiouville"),
    (lambda: equation(C(0.4) + RL(0.5)), r"be below 0\.4 for RiemannLiouville"),
    (lambda: equation(C(1.5) + RL(0.5), [1.0, 0.0]), r"1 below its highest order 1\.5"),
    (lambda: equation(C(2.5) + RL(0.3), [1.0, 0.0, 0.0]), "orders above 2"),
    (lambda: equation(C(1.0) + MATRIX * RL(0.5), [1.0, 0.5]),
     r"got RiemannLiouville\(0\.5\); .* where y = w - C v"),
]  # fmt: skip

INITIAL_VALUES = [
    (lambda: equation(0.5, "one"), "y0 must", BAD),
    (lambda: equation(1.5, [[1.0], [2.0, 3.0]]), "y0 must", BAD),
    *((partial(equation, C(order), y0), words) for order, y0, words in [
        (0.5, math.nan, "y0 must be real, finite numbers, got nan"),
        (0.5, [1.0, math.inf], "y0 must be real, finite"),
        (0.5, complex(1.0, math.nan), "y0 must be finite numbers, got nan"),
        (0.5, complex(0.0, math.inf), "y0 must be finite numbers"),
        (0.5, [[1.0], [2.0]], r"y0 must hold y\(0\), shape \(1, d\), got shape \(2, 1\)"),
        (0.5, [[1.0], [2.0]], r"orders up to 1 need only y\(0\), its components in a row"),
        (0.5, [], r"got shape \(0,\)"),
        (1.5, 1.0, r"y0 must hold y\(0\) and y'\(0\), shape \(2, d\), got 1.; .*\[1.0, 0.0\]"),
        (1.5, [1.0, 2.0, 3.0], r"got shape \(3,\); for 3 components give two rows"),
        (1.5, [[1.0, 2.0]], r"got shape \(1, 2\)"),
        (1.5, [[[1.0]]], r"got shape \(1, 1, 1\)"),
        (2.1, [1.0, 0.0], r"y0 must hold y\(0\), y'\(0\) and y''\(0\), shape \(3, d\)"),
        (2.5, [1.0, 0.0], r"y0 must hold y\(0\), y'\(0\) and y''\(0\), shape \(3, d\)"),
        ([0.5, 0.6], [1.0, 2.0, 3.0], "order must be one number or one for each of the 3"),
        ([1.5, 0.6], [[1.0, 2.0], [0.0, 3.0]], r"got y0\[1\]\[1\] = 3.0; set it to 0"),
        ([2.5, 0.5], [[1.0, 1.0], [0, 1.0], [0, 0]], r"hold no y'\(0\) for component 1"),
        ([2.5, 1.5], [[1.0, 1.0], [0, 0], [0, 2.0]], r"hold no y''\(0\) for component 1"),
    ]),
    *((partial(equation, 1.5, y0, d=d), words) for y0, d, words in [
        ([1.0, 2.0, 3.0], 2, r"y0 must hold at least 2 rows of 2.*got shape \(3,\)"),
        (1.0, 1, "y0 must hold at least 2 rows of 1.*got 1."),
        ([[1.0, 2.0], [0.5, 0.6]], 3, r"got shape \(2, 2\)"),
        ([[1.0, 2.0], [0.5, 0.6]], 0, "d must be a positive integer"),
    ]),
    *each(lambda params: equation(params=params, rhs=faded),
          [[[1.0]], math.nan, [math.nan], "abc", [1j], {"a": 1.0}], "params must", BAD),
    (lambda: equation(t_start="now"), "t_start must be a finite real number", TypeError),
    (lambda: equation(parameters=()), "unexpected keyword", TypeError),
    # complex
    (lambda: equation(0.6, [1.0, 2.0], turns),
     "return real numbers, got .*; give y0 complex numbers", TypeError),
    (lambda: equation(0.6, 1j, turns, jac=lambda t, z: 1j), "jac must be left out for complex y"),
    (lambda: equation(0.6, [1j, 0], lambda t, z: np.zeros(3)),
     r"rhs must return shape \(2,\), got shape \(3,\)"),
    (lambda: equation(np.ones(4) * C(0.6), [1j, 0], turns),
     "coefficient must be one number or one for each of the 2"),
]  # fmt: skip

FUNCTIONS = [
    *each(two, [lambda: 0.0, lambda t: t, lambda t, y, dy, params, more: 0.0, lambda t, *y: 0.0,
                math.hypot, partial(decay, 0.0)], ARITY, TypeError),
    *each(two, [None, 5, "f"], "rhs must be a function", TypeError),
    (lambda: two(lambda t, y: np.zeros(3)), r"rhs must return shape \(2,\), got shape \(3,\)"),
    (lambda: two(lambda t, y: y[0]), r"rhs must return shape \(2,\), got shape \(\)"),
    (lambda: equation(rhs=lambda t, y: np.zeros(2)), r"shape \(1,\) or a number, got shape \(2,\)"),
    (lambda: two(lambda t, y: None), NO_REAL, TypeError),
    (lambda: two(lambda t, y: y * 1j), NO_REAL, TypeError),
    (lambda: two(lambda t, y, dy, params: -y), "rhs must fill dy and return None", TypeError),
    (lambda: equation(rhs=lambda t, y: divides(t, [float(y[0])]) * 1.0),
     r'ZeroDivisionError.*line \d+ .*"ratio = y\[0\] / t"'),
    (lambda: two(reads_too_far), r'IndexError.*"return -params\[7\] \* y".*params = \[2. , 0.5\]'),
    (lambda: two(lambda t, y: np.array([0.0, y[1] * math.nan])),
     r"rhs must be finite at t = 0, got \[ 0., nan\]"),
    (lambda: equation(0.7, rhs=lambda t, y: y / (t - 2.0), t_start=2.0),
     "rhs must be finite at t = 2"),
    (lambda: two(changes_y), "rhs must leave y as it is"),
    (lambda: two(changes_params), "rhs must leave params as it is"),
    (lambda: two(lambda y, t: -y),
     r"rhs must take t first and y second, got .*\(y, t\)", TypeError),
    *each(partial(two, params=(1.0, 2.0, 3.0)),
          [lambda t, y, a, b: -a * b * y, lambda t, y, a, b: a * np.ones(3) + b], FOUR, BAD),
    *each(partial(equation, 1.8, [1.0, 2.0]),
          [lambda t, y: [-y[0], -y[1]], lambda t, y: np.zeros(2)],
          "is taken for .* of one component"),
    (lambda: equation(1.8, [1.0, 0.0], velocity),
     r"two write \[\[y\(0\).*memory=hd.Caputo\(1\).*\(t, y, memory\).*memory\[0, 0\]"),
    (lambda: equation(1.8, [[1.0], [0.0]], velocity), r"memory=hd.Caputo\(1\).*memory\[0, 0\]"),
    *each(lambda y0: equation(0.8, y0, lambda t, y: -math.sin(y)), [[1.0, 2.0], [[1.0, 2.0]]],
          r"must run at t = 0, got TypeError.*converted.*; .* write np\.sin\(y\)"),
    (lambda: equation(0.8, rhs=lambda t, y: -y + np.random.default_rng().normal()),
     "rhs must give equal values for equal t, y.*random numbers.*at line"),
    # functions that fitted an equation before
    *((partial(refit, *given), words) for *given, words in [
        (unlike, [1.0, 2.0], [2.0], TOO_SHORT),
        (unlike, [1.0, 2.0], [0.0, 1.0], r"rhs must be finite at t = 0, got \[-inf"),
        (unlike, [1.0], [2.0, 1.0], TOO_SHORT),
        (unlike, [1.0, 2.0, 3.0], [2.0, 1.0], r"rhs must return shape \(3,\), got shape \(2,\)"),
        (filled, [1.0, 2.0, 3.0], [2.0],
         r"entry of dy, got entries \[\[2\]\] left unset; .*at line \d+ of .*refused_equations.py"),
    ]),
    # jac
    (lambda: two(decay, jac=lambda t, y: np.zeros(2)), r"jac must return shape \(2, 2\)"),
    (lambda: equation(0.8, params=(1.0, 2.0), jac=late_change),
     r"jac must leave y .* \"params\[1\] = 0.0\"", TypeError),
    *each(lambda jac: equation(0.9, jac=jac),
          [lambda t, y: np.array([[1.0]]), lambda t, y: np.array([[-2.0]])], "jac must"),
]  # fmt: skip

READ = [
    (lambda: equation(0.9, rhs=lambda t, y, params: -y, memory=C(0.5)),
     "take memory third.*memory= pass it there", TypeError),
    (lambda: equation(0.9, memory=C(0.5)),
     r"rhs\(t, y, memory\).*got decay\(t, y\); memory= passes memory third, in the", TypeError),
    (lambda: equation(0.9, rhs=lambda t, y, memory, p: -y),
     r"rhs must fill dy.*; rhs\(t, y, memory, params\) needs memory=", TypeError),
    *each(lambda terms: equation(terms), [hd.Delay(1.0), [C(0.9), hd.Delay(1.0)]],
          r"terms must be .*, got Delay\(1.0\); name it in memory=", TypeError),
    *each(lambda order: equation(0.9, rhs=read, memory=C(order)), [0.9, 1.2],
          "memory must have orders below"),
    *each(lambda memory: equation(0.9, rhs=read, memory=memory), [airy, 0.5, [0.5], None],
          "memory must be Caputo or Memory operators", TypeError),
    (lambda: equation(0.9, rhs=changes_memory, memory=C(0.5)), "leave memory as it is"),
    (lambda: equation(1.5, [1.0, 0.0], read, memory=RL(0.3)),
     "memory must hold Caputo or Memory terms"),
    (lambda: equation(2.5, [1.0, 0, 0], read, memory=C(0.5)),
     "memory must be left out with orders above 2"),
    (lambda: equation(1.5, [1.0, 0], read, memory=C(2.5)), "memory must have orders up to 2"),
    (lambda: equation(np.eye(2) * C(0.5), [1.0, 1.0], lambda t, y, m: -y, memory=C(0.3)),
     "memory must be left out with"),
    (lambda: equation(0.5, [1.0, 1.0], lambda t, y, m: -y, memory=np.eye(2) * C(0.3)),
     "memory must have coefficients of shape"),
    (lambda: reading(jac=airy_jac), "jac_memory"),
    (lambda: hd.Equation(C(0.8), lambda t, y, m: -y - 0.4 * m[0], 1.0, memory=C(0.3),
                         jac=lambda t, y, m: np.array([[-1.0]]),
                         jac_memory=lambda t, y, m: np.array([[0.4]])),
     r"jac_memory must hold d rhs\[i\] / d memory\[j\] = -0.4, got 0.4 in row 0, column 0"),
    (lambda: reading(jac=airy_jac, jac_memory=lambda t, x, memory: np.array([[x[0] ** 2 - 1]])),
     "must hold d rhs"),
]  # fmt: skip

STRUCTURE = [
    (lambda: chained(bandwidth=3), "lower, upper", TypeError),
    (lambda: chained(rhs=None), "rhs must be a function", TypeError),
    *((partial(chained, **wrong), words) for wrong, words in [
        ({"bandwidth": (1, -1)}, "bandwidth must be an integer of at least 0"),
        ({"bandwidth": (1, 1), "jac_sparsity": laplacian(30)}, "without bandwidth"),
        ({"jac_sparsity": laplacian(5)}, r"shape \(5, 5\)"),
        ({"jac_sparsity": np.ones(30)}, "pattern of shape"),
        ({"jac_sparsity": sp.coo_array((np.ones(2), ([0, 0], [1, 1])), shape=(30, 30))},
         "hold each entry once"),
        ({"linear": laplacian(5)}, r"shape \(5, 5\)"),
        ({"linear": np.full((30, 30), np.nan)}, "finite real numbers"),
        ({"linear": laplacian(30) * 1j}, "finite real numbers"),
        ({"linear": "A"}, "linear must be a matrix"),
        ({"rhs": None, "y0": 1j, "linear": laplacian(30)}, "complex y"),
        ({"bandwidth": (1, 1), "memory": C(0.3)}, "left out with memory"),
        ({"bandwidth": (1, 1), "jac": lambda t, u: np.eye(30)}, r"shape \(3, 30\)"),
        ({"bandwidth": (1, 1), "jac": band_of_ones}, "jac must hold every entry"),
        ({"bandwidth": (1, 1), "rhs": chain_and_far},
         "jac_sparsity or bandwidth must hold every entry .* row 3"),
        ({"jac_sparsity": sp.eye_array(30, format="csr"), "jac": chain_sparse},
         "without entries outside jac_sparsity"),
    ]),
]  # fmt: skip

REPLACED = [
    (lambda: equation(0.8, rhs=faded, params=[1.0], jac=lambda t, y, p: -p[0]).replace(rhs=decay),
     "jac must come with another rhs"),
    (lambda: reading(jac=airy_jac, jac_memory=lambda t, x, m: np.array([[1 - x[0] ** 2]]))
     .replace(rhs=read), "jac must come with another rhs"),
    (lambda: linear().replace(parameters=[3.0]),
     "changes must be among terms, rhs, y0, params, jac", TypeError),
    (lambda: reading().jacobian(0.0, [1.0]), "read no memory"),
    *((lambda new=new: equation(0.8, rhs=lambda t, y, p: np.log(p[0]) * y, params=[1.0, 2.0])
       .replace(params=new), words)
      for new, words in [([0.0, 1.0], "rhs must be finite at t = 0"), ([], TOO_SHORT),
                       ([np.nan, 1.0], "params must")]),
    # scenes' functions run without bounds checks: the trial call meets what is missing
    *((lambda make=make, n=n: make().replace(params=make().params[:n]),
       "must run at t = 0, got IndexError")
      for make, n_read in [
        (hd.scenes.stick_slip, 3), (hd.scenes.lorenz, 3), (hd.scenes.rossler, 3),
        (hd.scenes.brusselator, 2), (hd.scenes.duffing, 4), (hd.scenes.van_der_pol, 3)]
      for n in range(n_read)),
    *((lambda name=name: setattr(linear(), name, None),
       rf"{name} .* eq.replace\({name}=...\)", AttributeError)
      for name in ("terms", "rhs", "y0", "jac")),
    (lambda: setattr(linear(), "params", [2.0, 1.0]), r"eq.replace\(params=...\)", AttributeError),
    (lambda: setattr(linear(), "d", 2), r"d of an Equation cannot be changed", AttributeError),
    (lambda: setattr(linear().replace(params=[2.0, 1.0]), "d", 3),
     "cannot be changed", AttributeError),
    *each(lambda name: getattr(linear(), name).fill(0.5),
          ["y0", "params", "orders", "coefficients"], "read-only"),
    (lambda: linear().replace(params=[2.0, 1.0]).y0.fill(0.5), "read-only"),
    (lambda: linear().terms[0].coefficient.fill(0.5), "read-only"),
]  # fmt: skip

ROWS = [*OPERATORS, *TERMS, *INITIAL_VALUES, *FUNCTIONS, *READ, *STRUCTURE, *REPLACED]
