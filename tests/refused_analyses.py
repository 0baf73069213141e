"""Refusals of kernels, scenes, exact solutions and analyses, by what is called."""

import math
import warnings
from functools import cache, partial

import numpy as np
from refusals import BAD, MASKED, PRONY, adapt, decay, each, equation, faded, linear, run

import hereditary as hd
from hereditary import (
    DistributedOrder,
    Kernel,
    MittagLeffler,
    Prony,
    StretchedExponential,
    TemperedPowerLaw,
    classify,
    exact,
    viscoelastic,
)

PowerLaw = hd.PowerLaw
T = np.linspace(0.1, 5.0, 30)


def driven(t, x, p):
    return p[1] * np.cos(p[0] * t) - x - p[2] * x**3


@cache
def parabola():
    """Return x = 1 + 3 t - t**2 / 2."""
    return hd.solve(
        equation(2.0, [1.0, 3.0], lambda t, x: -1.0), 8.0, 80, scheme=hd.L1(), save_every=7
    )


@cache
def relaxed():
    return hd.solve(hd.scenes.relaxation(0.5), 1.0, 40)


@cache
def plain():
    """Return a run of two components without a derivative."""
    return hd.solve(equation(0.5, [1.0, 2.0]), 1.0, 50)


def logistic():
    x = [0.3]
    for _ in range(1999):
        x.append(4.0 * x[-1] * (1 - x[-1]))
    return np.array(x[500:])


def respond(omegas=(1.0,), terms=None, rhs=driven, params=(1.0, 0.3, 0.5), **given):
    terms = hd.Caputo(1.95) + 0.1 * hd.Caputo(0.9) if terms is None else terms
    forced = hd.Equation(terms, rhs, [0.0, 0.0], params=params)
    return hd.frequency_response(forced, omegas, **given)


def respond_in_python():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        return respond(rhs=partial(driven))


def steady(kernel, m):
    """Seek the steady state of an oscillator with this memory."""
    return respond(terms=hd.Caputo(2.0) + hd.Memory(kernel, m), params=[1.0, 1.0, 0.0])


def relaxation(alpha, rate):
    return hd.Equation(hd.Caputo(alpha), faded, 1.0, params=[rate])


def fit(**change):
    guess = {"alpha": 0.9, "rate": 1.0}
    return hd.fit(**{"model": relaxation, "t": T, "data": np.exp(-T), "p0": guess} | change)


def fit_rate(**change):
    t, data = [0.1, 0.2, 0.5], [0.9, 0.8, 0.6]
    return hd.fit(lambda r: linear().replace(params=[r]), t, data, {"r": 1.0}, **change)


def fit_order():
    t = np.linspace(0.1, 3.0, 10)
    return hd.fit(lambda a: equation(a, [1.0, 0.0], d=1), t, 5.0 * t, {"a": 0.1})


def differ(**given):
    """Take the sensitivities of a relaxation."""
    return hd.sensitivities(**{"equation": linear(), "t_end": 1.0, "rtol": 1e-6} | given)


def members(**given):
    relaxing = hd.Equation(hd.Caputo(0.8), faded, 1.0, [1.0])
    return hd.ensemble(**{"equation": relaxing, "t_end": 1.0, "n_steps": 40} | given)


def product(a, b):
    return a * b


def swept(function=product, a=(1.0,), b=(1.0,), **given):
    return hd.sweep(function, {"a": a, "b": b}, **given)


def slid(**given):
    return hd.lyapunov(
        **{"equation": hd.scenes.stick_slip(), "t_end": 20.0, "n_steps": 2000} | given
    )


def remember(order=0.5, h=0.1, scheme=None, u0=1.0, **given):
    return hd.memory_term(order, h, scheme or hd.L1(), u0, **given)


def fade(**change):
    arguments = {"kernel": PowerLaw(0.5), "t_min": 1.0, "t_max": 1e3, "tol": 1e-8}
    return hd.fit_exponentials(**arguments | change)


@cache
def table():
    return Kernel.from_table([1.0, 2.0, 3.0, 4.0], [4.0, 3.0, 2.5, 2.2])


FACTOR = "must be a finite number other than 0, got"
CLOSED = hd.StretchedExponential(0.5, 1.0)
STEADY = "kernel must be integrable over all times"

KERNELS = [
    *each(PowerLaw, [2.5, 1 - 1.7], r"exponent must lie in \(0, 2\], .*Caputo\(beta\) .* beta - 1"),
    (lambda: PowerLaw(1.0).integral(1.0), "exponent must be below 1 for a finite integral"),
    (lambda: TemperedPowerLaw(1.0, 1.0), r"exponent must lie in \(0, 1\), got 1.0"),
    (lambda: TemperedPowerLaw(0.5, -1.0), "rate must be .* at least 0, got -1.0"),
    (lambda: MittagLeffler(1.2, 1.0), r"order must lie in \[0.01, 1\], got 1.2"),
    (lambda: MittagLeffler(0.5, math.nan), "rate must be a finite number above 0"),
    (lambda: StretchedExponential(0.5, 0.0), "rate must be .* above 0, got 0.0"),
    (lambda: StretchedExponential("b", 1.0), "exponent must", TypeError),
    (lambda: Prony([-1.0], [1.0]), r"rates must not be negative.*signed=True"),
    (lambda: Prony([1.0], [-1.0]), "weights must be positive"),
    (lambda: Prony([1 + 2j], [1.0]), "rates and weights must be complex in conjugate"),
    (lambda: Prony([1 + 2j, 1 - 2j], [1j, 1j]), "must be complex in conjugate pairs"),
    (lambda: Prony([], []), r"rates must have shape \(n,\) as weights, n >= 1"),
    (lambda: Prony([1.0, 2.0], [1.0]), "rates must have shape"),
    (lambda: DistributedOrder([1.0], [1.0]), r"orders must lie in \[0, 1\)"),
    (lambda: DistributedOrder.from_density(lambda a: a - 0.5), "weights must be po"),
    (lambda: Kernel(0.5), "function must be callable, got 0.5; use Kernel.from_tab", TypeError),
    (lambda: Kernel(lambda t: t**-1.5), "integrable at 0 .* got a = 1.5"),
    (lambda: Kernel(lambda t: t * math.nan), "finite values at t > 0, got none"),
    (lambda: Kernel(lambda t: t + 1j), "function must give one real number", TypeError),
    (lambda: Kernel(np.exp, singular_exponent=1.0), "integrable at 0"),
    (lambda: Kernel(lambda t: np.exp(-t), signed="abc"), "signed must be", TypeError),
    (lambda: Kernel.from_table([], []), r"t must have shape \(n,\) as values"),
    (lambda: Kernel.from_table([1, 3, 2, 4], [4, 3, 2, 1]), "sort the table by t"),
    (lambda: Kernel.from_table([1, 2, 3, 4], [2, 1, 0, 1]), "got 0 at t = 3; end"),
    (lambda: Kernel.from_table([1, 2, 3, 4], [2, 1, math.inf, 1]), "values must"),
    (lambda: Kernel.from_table([1, 2, 3, 4], [16, 4, 2, 1]), "integrable at 0"),
    *((lambda K=K: Kernel(K).fit(1e-3, 3.0, 1e-6), words) for K, words in [
        (np.exp, "got rising at t = .*; pass signed=True"),
        (lambda t: -np.exp(-t), "got negative at t = 3e-08; pass signed=True"),
        (lambda t: np.exp(-t) * (1.01 + np.cos(9 * t)), "kernel must be completely monotone"),
        (lambda t: np.exp(-(t**2)), "one from which positive sums differ by 8.*e-01; pass sig"),
        (lambda t: np.where(t < 1.0, 1.0, np.nan), "finite values at t > 0, got nan at t = 1"),
        (lambda t: np.where(t > 1.0, np.inf, 1.0), "finite values at t > 0, got inf at t = 1"),
    ]),
    (lambda: Kernel(lambda t: np.sign(np.cos(40 * t)), signed=True).fit(1e-3, 10.0, 1e-8),
     "tol must be at least .* for this kernel, got 1e-08"),
    (lambda: table().fit(0.1, 4.0, 1e-2), r"t_min and t_max must lie within the table, \[1, 4\]"),
    (lambda: table()(5.0), "t must not exceed the table's last time, 4, got 5"),
    (lambda: TemperedPowerLaw(0.5, 1.0).fit(1e3, 1e4, 1e-6),
     "t_min must come before the kernel is 0 in rounding"),
    *each(lambda make: make().fit(1.0, 0.5, 1e-6),
          [lambda: PRONY, lambda: MittagLeffler(0.5, 1.0), table], "t_max must lie between"),
    *each(lambda make: make().fit(1.0, 2.0, 0.0),
          [lambda: PRONY, lambda: MittagLeffler(0.5, 1.0), table], "tol must lie in"),
    *each(lambda tol: fade(tol=tol), [1e-14, 0.5], r"tol must lie in \[1e-13, 0.1\], got"),
    (lambda: fade(tol="small"), "tol", TypeError),
    *each(lambda t: fade(t_min=t), [0.0, math.nan], "t_min"),
    (lambda: fade(t_min=1e-200, t_max=1e200), "t_max"),
    (lambda: fade(kernel=PowerLaw(2.0), t_min=1e-300, t_max=1e-299),
     "t_min must leave the kernel a finite value"),
    (lambda: fade(t_max=0.5), r"t_max must lie between t_min = 1.0 and 1e\+100 times that, got"),
    (lambda: fade(t_max=math.inf), "t_max"),
    (lambda: fade(kernel=0.5), "kernel must be a MemoryKernel, got 0.5", TypeError),
    # factors
    *((lambda c=c: c * PowerLaw(0.5), f"factor {FACTOR} {float(c)}")
      for c in (0, 0.0, math.nan, math.inf, -math.inf)),
    *((lambda c=c: PowerLaw(0.5) / c, f"divisor {FACTOR} {float(c)}")
      for c in (0, 0.0, math.nan, math.inf, -math.inf)),
    *(row for c in (True, "2", 1j, None, [1.0, 2.0], np.ones(2), PowerLaw(0.5)) for row in each(
        lambda compute, c=c: compute(PowerLaw(0.5), c),
        [lambda k, c: k * c, lambda k, c: c * k, lambda k, c: k / c], FACTOR, TypeError)),
    (lambda: 1e200 * (1e200 * PowerLaw(0.5)), f"factor {FACTOR} inf"),
    (lambda: 1e-200 * (1e-200 * PowerLaw(0.5)), rf"factor {FACTOR} 0\.0"),
    (lambda: PowerLaw(0.5) / 5e-324, r"divisor must be a finite number .* its inverse, got 5e-324"),
    # memory terms
    *each(remember, ["0.5", True], "kernel_or_order must be an order alpha", TypeError),
    (lambda: remember(h=0.0), "h must be a finite number above 0"),
    (lambda: remember(2.5), "order must be at most 2"),
    *((lambda order=order, scheme=scheme: remember(order, scheme=scheme),
       "scheme must solve one equation a step") for order, scheme in [
        (0.5, hd.ExplicitCaputo()), (0.5, hd.BDF(3)), (0.5, hd.ProductTrapezoid()),
        (1.5, hd.L2Sigma()), (0.5, hd.Collocation())]),
    (lambda: remember(v0=1.0), "v0 must be left out"),
    (lambda: remember(u0=[1.0, 2.0], term0=[1.0, 2.0, 3.0]), "term0 must have the shape"),
    (lambda: remember(Kernel(np.exp)), "n_steps must be given", BAD),
]  # fmt: skip

# components and parameters
COUPLED = {
    hd.scenes.brusselator: (2, "a b"),
    hd.scenes.lorenz: (3, "sigma rho b"),
    hd.scenes.rabinovich_fabrikant: (3, "a b"),
    hd.scenes.rossler: (3, "a b c"),
    hd.scenes.van_der_pol: (2, "mu force frequency"),
}
DUFFING = hd.scenes.duffing, "friction stiffness cubic force frequency x0 v0"

SCENES = [
    *(row for scene, (d, _) in COUPLED.items() for row in [
        *each(lambda a, scene=scene: scene(alpha=a), [0.0, -0.5, 1.5, 2, [1.0, 1.0, 1.2][-d:]],
              r"alpha must lie in \(0, 1\], got .*; orders above 1 need"),
        *each(lambda a, scene=scene: scene(alpha=a),
              [[0.9] * (d - 1), [0.9] * (d + 1), [[0.9] * d], []],
              f"alpha must be one number or one for each of the {d} components, got shape"),
        *each(lambda y0, scene=scene: scene(y0=y0),
              [[1.0] * (d - 1), [1.0] * (d + 1), [[1.0] * d], 1.0, []],
              f"y0 must hold one number for each of the {d} components, got shape"),
        *each(lambda a, scene=scene: scene(alpha=a), ["one", 1j, None, True, math.nan, math.inf],
              "alpha must be real, finite numbers, got", BAD),
        *each(lambda v, scene=scene, d=d: scene(y0=[v] * d),
              ["one", 1j, None, True, math.nan, math.inf],
              "y0 must be real, finite numbers, got", BAD),
    ]),
    *((partial(scene, **{name: value}), f"^{name} must be a finite real number, got", error)
      for scene, names in [*((scene, names) for scene, (_, names) in COUPLED.items()), DUFFING]
      for name in names.split()
      for value, error in ((math.nan, ValueError), ("one", TypeError), ([1.0], TypeError))),
    *each(lambda well: hd.scenes.stick_slip(well=well), [[], [[1.0]], ["a"], [math.nan]],
          "well must", BAD),
    *((partial(hd.scenes.stick_slip, **{name: math.nan}), f"{name} must")
      for name in ("friction", "omega", "spring_speed", "adhesion")),
    *((partial(getattr(hd.scenes, scene), **given), words) for scene, given, words in [
        ("oscillator", {"beta": 1.0}, r"beta must lie in \(1, 2\], got 1.0"),
        ("oscillator", {"gamma": 1.5}, r"gamma must lie in \(0, 1\], got 1.5"),
        ("relaxation", {"alpha": 1.5}, r"alpha must lie in \(0, 1\], got 1.5"),
        ("stick_slip", {"beta": 0.9}, r"beta must lie in \(1, 2\], got 0.9"),
        ("stick_slip", {"beta": lambda t: 0.9 + t}, r"beta must lie in \(1, 2\]"),
        ("duffing", {"beta": 1.0}, r"beta must lie in \("),
        ("duffing", {"beta": 2.1}, r"beta must lie in \("),
        ("duffing", {"gamma": 1.1}, r"gamma must lie in \("),
        ("selkov", {"alpha": (0.9, lambda t: 0.8)}, "alpha must be functions of the time for both"),
        ("selkov", {"alpha": 1.2}, "alpha must lie in"),
        ("selkov", {"time_scale": 0.0}, "time_scale must be"),
        ("fitzhugh_nagumo", {"c": 0.0}, "c must not be 0"),
        ("mathieu", {"gamma": 1.5}, "gamma must lie in"),
        ("riccati", {"alpha": 1.5}, "alpha must lie in"),
        ("riccati", {"linear": complex("nan")}, "linear must be a finite number"),
        ("subdiffusion", {"points": 4, "alpha": 2.5}, "alpha must lie in"),
        ("subdiffusion", {"points": 4, "dimensions": 3}, "dimensions must be 1 or 2"),
        ("subdiffusion", {"points": 4, "u0": [1.0, 2.0]}, r"u0 must have shape \(4,\)"),
        ("subdiffusion", {"points": 4, "v0": np.zeros(4)}, "v0 must be left out"),
        ("subdiffusion", {"points": 4, "diffusivity": 0.0}, "diffusivity must be"),
    ]),
    *((partial(hd.scenes.stick_slip_chain, 3, **given), words) for given, words in [
        ({"x0": [0.1, 0.2]}, r"x0 must be a number or have shape \(3,\)"),
        ({"adhesion": [1.0, 2.0]}, r"adhesion must be a number or have shape \(3,\)"),
        ({"well": []}, "well must be a flat sequence"),
        ({"beta": 0.9}, "beta must lie in"),
    ]),
    (lambda: hd.scenes.stick_slip(x0=[1, 2]), "x0 must", BAD),
    (lambda: hd.scenes.well_coefficients(0), "n must be a positive integer"),
    (lambda: hd.scenes.stick_slip(b=1.0), "unexpected keyword", TypeError),
    (lambda: hd.Caputo(alpha=0.5), "unexpected keyword", TypeError),
    (lambda: hd.nonsense, "no attribute 'nonsense'", AttributeError),
]  # fmt: skip

FORCING = "forcing must be pairs"
EXACT = [
    (lambda: exact.relaxation(0.0), r"alpha must lie in \(0, 2\], got 0.0"),
    (lambda: exact.relaxation(2.1, 1.0, [1.0, 0.0]), r"alpha must lie in \(0, 2\], got 2.1"),
    (lambda: exact.relaxation([0.5]), "alpha must", BAD),
    (lambda: exact.relaxation(0.5, np.nan), "rate must be a finite real number, got nan"),
    (lambda: exact.relaxation(1.5, 1.0, 1.0), r"y0 must hold y\(0\) and y'\(0\)"),
    (lambda: exact.oscillator(beta=1.0), r"beta must lie in \(1, 2\], got 1.0"),
    (lambda: exact.oscillator(gamma=1.1), r"gamma must lie in \(0, 1\], got 1.1"),
    (lambda: exact.oscillator(friction=np.inf), "friction must"),
    (lambda: exact.oscillator(x0=[1.0, 2.0]), "x0 must", BAD),
    *((partial(exact.several_terms, *given), words, BAD) for *given, words in [
        ([0.5, 2.5], [1, 1], 1.0, r"order must lie in \(0, 2\]"),
        ([], [], 1.0, "order must"),
        ([0.5, 0.2], [1.0], 1.0, "coefficients must have shape"),
        ([0.5, 0.2], [0.0, 1.0], 1.0, "coefficients must not be 0"),
        ([0.5, 0.5], [1.0, -1.0], 1.0, "coefficients must not be 0"),
        ([1.5], [1.0], 1.0, "y0 must hold"),
        ([2.0, 1.0], [1.0, -2.0], [1.0, 1.0], 1.0, "coefficients must give .* 2 poles, of which 1"),
        ([2.0, 1.0], [1.0, -2.0], [1.0, 1.0], 1 - 1e-7,
         "coefficients must give .* 2 poles, of which 1"),
    ]),
    (lambda: exact.several_terms(0.5, 1.0, 1.0, rate="a"), "rate must", BAD),
    *((partial(exact.several_terms, order, 1.0, 1.0, forcing=forcing), FORCING)
      for order, forcing in [(0.5, (1.0, 0.0)), (0.5, [(1.0, -0.5)]), (1.0, [(1.0, -1.0)])]),
    (lambda: exact.system(0.5, [[1.0, 1.0]], [1.0, 1.0]), r"matrix must have shape \(2, 2\)"),
    (lambda: exact.system(0.5, -np.eye(2), [1.0, 1.0], [1.0]), "forcing must have shape"),
    (lambda: exact.system(0.5, [[1.0, 1.0], [0.0, 1.0]], [1.0, 1.0]), "be diagonalisable, got"),
    (lambda: exact.relaxation()(-1.0), "t must be finite numbers of at least 0"),
    *each(lambda t: exact.relaxation()(t), [[[1.0]], [np.inf]], "t must be finite numbers"),
]  # fmt: skip

SOLUTIONS = [
    *each(lambda t: adapt()(t), [-1e-9, 1.0 + 1e-9, [0.5, 3.0], np.inf, np.nan, "soon"],
          "t must .*, got", BAD),
    *each(lambda m: adapt()(1.0, m), [2, -1, 0.5, "first"], "derivative must be 0 or 1, got"),
    (lambda: adapt()([[0.1], [0.2]]), r"t must be a number or of shape .k,., got shape"),
    *each(lambda scheme: run(scheme=scheme)(1.1),
          [hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.L12(), hd.L2(), hd.L2Sigma(),
           hd.BDF(3), hd.Adams(), hd.ProductTrapezoid()], "lie in"),
    *each(lambda kept: run(**kept)(0.5), [{"save_every": 2}, {"t_eval": [0.5]}],
          "this run kept no dense output"),
    # sections
    (lambda: hd.stroboscopic(parabola(), 0.0), "period must"),
    (lambda: hd.stroboscopic(parabola(), 1e-12), "period must give at most"),
    (lambda: hd.stroboscopic(parabola(), 1.0, count=0), "count must"),
    *each(lambda j: hd.maxima(parabola(), component=j), [1, "x"],
          "component must be one of 0 .. 0"),
    (lambda: hd.maxima(parabola(), derivative=2), "derivative must be 0 or 1"),
    (lambda: hd.maxima(parabola(), count=10**12), "count must be at most"),
    (lambda: hd.maxima(plain(), derivative=1), "solution must hold a first derivative"),
    (lambda: hd.maxima(run(equation=equation(0.9, 1 + 0j, lambda t, z: 1j * z))),
     "solution must be real, got a complex one"),
    # chaos
    (lambda: hd.zero_one_test(np.zeros(100)), "series must hold 200 values"),
    (lambda: hd.zero_one_test(logistic(), n_c=0), "n_c must be a positive integer"),
    (lambda: hd.zero_one_test(logistic(), take="minima"), "take must be .maxima. or"),
    (lambda: hd.zero_one_test(relaxed()), "run longer: so many maxima, or values, are needed"),
    (lambda: hd.power_spectrum(np.zeros(100)), "series must be of shape"),
    (lambda: hd.power_spectrum(np.zeros(5), 0.1), "series must leave 16 values"),
    (lambda: hd.power_spectrum(np.zeros(99), 0.1, transient=9.0), "series must leave 16 values"),
    (lambda: hd.power_spectrum(relaxed(), transient=2.0), "series must leave 16 values"),
    (lambda: hd.power_spectrum(np.zeros(99), np.inf), "step must be"),
    (lambda: hd.power_spectrum(run(n_steps=None, mesh=hd.graded(40, 2), scheme=hd.L1())),
     "series must have dense output, or rows at equal times"),
    (lambda: hd.power_spectrum(relaxed(), component=1), "component must be one of 0 .. 0"),
    *((lambda change=change: classify(parabola(), **{"period": 6.28} | change), words)
      for change, words in [
        ({"period": -1.0}, "period must"), ({"spacing": 0.0}, "spacing must"),
        ({"transient": 1e6}, "transient must lie before the end of the run")]),
    (lambda: hd.plots.velocity(plain()), "solution must hold a first derivative"),
    (lambda: hd.plots.oscillogram(plain(), components=2), "components must"),
    (lambda: hd.plots.oscillogram(plain(), components=[0.5]), "components must"),
    (lambda: hd.plots.phase_portrait(plain(), components=0), "components must"),
]  # fmt: skip

INDEPENDENT = "directions must be linearly independent"
EXPONENTS = [
    (lambda: slid(k=3), "k must be at most the number of initial data, 2, got 3"),
    (lambda: slid(mode="benettin"), "mode must be one of .*, got 'benettin'"),
    *each(lambda renorm: hd.lyapunov(linear(), 2.0, 200, renorm=renorm), [1e300, 1e308],
          "renorm must be at"),
    (lambda: slid(transient=20.0), r"transient must lie in \[0, t_end\)"),
    (lambda: slid(directions=[[1.0]]), r"directions must have shape \(2, 1\)"),
    (lambda: slid(k=2, directions=[[1.0, 2.0], [1.0, 2.0]]), INDEPENDENT),
    (lambda: slid(directions=[[0.0], [0.0]]), INDEPENDENT),
    (lambda: slid(seed=-1), "seed must be a whole number", TypeError),
    (lambda: slid(separation=1e3), "separation must be at most 1, that orbits be neighb"),
    *each(viscoelastic.spring(1.0).stiffness, [math.nan, [1j, complex(0, math.inf)], MASKED],
          "s must be finite complex numbers"),
    *each(viscoelastic.spring(1.0).stiffness, ["abc", None, {}], "s must be finite", TypeError),
    (lambda: slid(verify="twice"), "verify must be True, False or None, got 'twice'", TypeError),
    (lambda: slid(n_blocks=10**9), "n_blocks must be at most"),
    (lambda: slid(scheme="L1"), "scheme must be a Scheme", TypeError),
    (lambda: slid(rtol=1e-8, scheme=hd.BDF(2)),
     "rtol must be left out or come with scheme=Collocation"),
    (lambda: slid(scheme=hd.Collocation(), mode="pair"), 'mode must be "tangent" with Collocation'),
    (lambda: hd.lyapunov(linear(), 1e-320, rtol=1e-6, scheme=hd.Collocation()),
     "another unit of time"),
]  # fmt: skip

PERIODIC = "rhs must have period 2 pi / omega"
RESPONSES = [
    *each(respond, [[], [1.0, 1.0], [-1.0, 1.0]], "omegas must be frequencies above 0"),
    (lambda: respond(frequency=3), "frequency must be the number of a parameter, 0 .. 2", BAD),
    (lambda: respond(harmonics=0), "harmonics must be a positive integer"),
    (lambda: respond([1.3], frequency=1), rf"{PERIODIC} in t, omega being params\[1\]"),
    # at 0.5 and 1 a force of frequency 1 has the period of the first; between them it has not
    (lambda: respond(np.linspace(0.5, 1.0, 6), params=[1.0],
                     rhs=lambda t, x, p: 0.1 * np.cos(p[0] * t) + np.cos(t) - x), PERIODIC),
    (lambda: respond([1.0, 0.0, -1.0], hd.Caputo(1.8), params=[1.0, 1.0], along=1,
                     rhs=lambda t, x, p: np.sqrt(p[1]) * np.cos(p[0] * t) - x),
     "rhs must be finite over a period"),
    (lambda: respond([0.0, 1.0], params=[0.0, 0.3, 0.5], along=1),
     "equation must have a frequency above 0"),
    (lambda: respond([0.0, 1.0], params=[0.0, 0.3, 0.5], along=7),
     "along must be the number of a parameter"),
    (respond_in_python, "equation must have functions that numba compiles"),
    *((lambda given=given: hd.frequency_response(equation(**given, params=[1.0, 1.0, 0.0]), [1.0]),
       f"equation must {words}, got Equation.*; ") for words, given in [
        ("have constant orders", {"order": lambda t: 0.5 + 0.1 * t, "y0": 0.0, "rhs": driven}),
        ("have real y", {"y0": 1j, "rhs": driven}),
        ("have orders up to 2", {"order": 2.5, "y0": [0.0, 0.0, 0.0], "rhs": driven}),
        ("have no matrix with a row of zeros",
         {"order": np.diag([1.0, 0.0]) * hd.Caputo(0.5), "y0": [0.0, 0.0], "rhs": driven}),
        ("have no delays",
         {"y0": 0.0, "rhs": lambda t, x, late, p: late[0], "memory": hd.Delay(1.0)})]),
    # kernels without a steady state
    (lambda: steady(CLOSED, 1), "kernel must have a Laplace transform in closed"),
    (lambda: steady(Prony([0.0, 1.0], [1.0, 1.0]), 1), "kernel must fade"),
    (lambda: steady(DistributedOrder([0.0, 0.5], [1.0, 1.0]), 1), "kernel must fade"),
    (lambda: steady(TemperedPowerLaw(0.5, 0.0), 0), STEADY),
    (lambda: steady(hd.fit_exponentials(PowerLaw(0.4), 1e-3, 1e3, 1e-8), 0), STEADY),
]  # fmt: skip

OBSERVED = "observe must be numbers of components"
BOUNDED = r"bounds\['alpha'\] must hold"
FITS = [
    *each(lambda p0: fit(p0=p0), [{"alpha": 0.9, "speed": 1.0}, {"alpha": 0.9}],
          r"p0 must name the arguments of model\(alpha, rate\), got names .*'rate'", TypeError),
    (lambda: fit(p0=[0.9, 1.0]),
     r"p0 must be a mapping of names.* model\(alpha, rate\), got \[0.9, 1. \]; missing .*'rate'",
     TypeError),
    *((partial(fit, **change), words, BAD) for change, words in [
        ({"p0": {}}, "p0 must be a mapping of names to numbers"),
        ({"p0": {"alpha": np.nan, "rate": 1.0}}, "p0 must be"),
        ({"bounds": {"gamma": (0, 1)}}, "bounds must name parameters, alpha, rate"),
        ({"bounds": {"alpha": (0.1, 0.5)}}, BOUNDED),
        ({"bounds": {"alpha": (0, 1, 2)}}, BOUNDED),
        ({"bounds": [(0, 1)]}, "bounds must be a mapping"),
        ({"t": T[::-1]}, "t must be increasing times"),
        ({"t": np.linspace(-1.0, 1.0, 30)}, "t must begin at t_start = 0 or later"),
        ({"t": [T, T]}, "data must be a list of 2 series"),
        ({"data": np.full(30, np.nan)}, "data must be finite, or NaN"),
        ({"data": np.zeros(29)}, r"data must have shape \(30,\)"),
        ({"data": np.where(np.arange(30), np.nan, 1.0)}, "data must hold at least 2 values"),
        ({"data": np.exp(-T) + 1j}, "data must be real"),
        ({"sigma": -1.0}, "sigma must be above 0"),
        ({"sigma": np.ones(7)}, "sigma must be one number"),
        ({"t": [T, T], "data": [T, T], "sigma": [0.1, None]}, "sigma must be given for all"),
        ({"loss": "huber"}, "sigma must be given with loss='huber'"),
        ({"t_eval": T}, "t_eval must be left out"),
        ({"params": [1.0]}, "params must be left out, for model makes"),
        ({"model": lambda alpha, rate: None}, "model must return an Equation"),
        ({"observe": lambda y: y[:, [0, 0]]}, r"observe must give real values of shape \(30,\)"),
    ]),
    (lambda: fit_rate(observe=np.diff), r"shape \(3,\).*got shape \(3, 0\)"),
    (lambda: fit_rate(observe=[1]), f"{OBSERVED}, 0 to 0"),
    *each(lambda observe: fit_rate(observe=observe), [0.5, [-1], True], OBSERVED),
    (fit_order, r"order must lie in \(0, 20\].*from model at a = 0.*bounds="),
    # sensitivities
    *each(lambda wrt: differ(wrt=wrt), ["rate", ()],
          "wrt must hold some of params, y0, orders", BAD),
    *((partial(differ, **{"n_steps": 10, "rtol": None} | given), words, BAD) for given, words in [
        ({"t_eval": [0.33]}, "t_eval must be times of steps"),
        ({"rtol": 1e-3, "scheme": hd.BDF(2)}, "rtol must be left out or come with scheme"),
        ({"scheme": hd.Collocation()}, "n_steps must be left out"),
        ({"t_end": 1e-320}, "t_eval must be times of steps"),
    ]),
    (lambda: differ(t_end=1e-320), "another unit of time"),
    (lambda: differ(equation=equation(0.8), wrt="params"), "wrt must leave out params"),
    (lambda: differ(
        equation=equation(lambda t: 0.7 + 0.1 * t, rhs=faded, params=[1.0]), wrt="orders"),
     "wrt must leave out orders"),
    (lambda: differ(wrt="orders", equation=hd.Equation(
        hd.Caputo([1 - 1e-5, 1 + 1e-5]), faded, [[1.0, 1.0], [0.0, 0.0]], [1.0])),
     "orders of a term must lie on one side of 1"),
    # tables of convergence
    *each(lambda n: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, n), [[100], [200, 100]],
          "n_steps must be two or more increasing numbers"),
    *each(lambda given: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, **given),
          [{}, {"n_steps": [4, 8], "rtol": [0.1, 0.01]}],
          "n_steps or rtol must be given, one of the two, got (neither|both)"),
    *each(lambda rtol: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, rtol=rtol),
          [1e-6, [1e-8, 1e-6]], "rtol must be two or more decreasing tolerances"),
    (lambda: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, rtol=[1e-6, 1e-12]),
     "rtol must exceed 1e-12, the tolerance of the run that others are compared with"),
    (lambda: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, [100, 200.5]),
     "n_steps must be a positive integer", BAD),
    (lambda: hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, [100, 200], exact=np.sin),
     "exact must return shape"),
]  # fmt: skip

FLAT = r"grid\['b'\] must be a flat sequence"
TABLES = [
    *((partial(members, **given), words, BAD) for given, words in [
        ({}, "params must be given, params or y0 or both"),
        ({"params": [[1.0, 2.0]]}, r"params must have shape \(E, 1\)"),
        ({"params": []}, "params must have a row for each member"),
        ({"params": [1.0, np.nan]}, "params must be real, finite numbers"),
        ({"params": [1.0], "y0": [1.0, 2.0]}, "params must have as many rows as y0"),
        ({"y0": [[1.0, 2.0]]}, "y0 must hold 1 components"),
        ({"params": [1.0], "t_eval": [0.333]}, "t_eval must be times of steps"),
        ({"params": [1.0], "t_eval": [0.5], "save_every": 2}, "save_every must be left out"),
        ({"params": [1.0], "n_steps": None, "rtol": 1e-3, "save_every": 2}, "save_every must be"),
        ({"params": [1.0], "n_steps": None, "rtol": 5.0}, "rtol must lie in"),
        ({"params": [1.0], "atol": 1e-6}, "atol must be left out or come with"),
        ({"params": [1.0], "max_step": 0.1}, "max_step must be left out or come with"),
        ({"params": [1.0], "workers": 2, "threads": 2}, "threads must be left out with workers"),
        ({"params": [1.0], "components": [1]}, "components must be numbers of components, 0 to 0"),
        ({"params": [1.0], "changes": [{}, {}]}, "one for each of the 1 members, got 2"),
        ({"params": [1.0], "changes": [3]}, r"changes\[0\] must map times to functions"),
        ({"params": [1.0], "changes": {0.0: product}}, "changes must lie above 0"),
        ({"params": [1.0], "events": 3}, r"events must be functions event\(t, y\)"),
    ]),
    (lambda: members(
        equation=equation(hd.Caputo([1.8, 0.8]), [[1.0, 1.0], [0.5, 0.0]], faded, params=[1.0]),
        y0=[[[1.0, 1.0], [0.5, 0.0]], [[1.0, 1.0], [0.5, 0.1]]]),
     r"y0\[1\] must hold no y'\(0\)"),
    # sweeps
    (lambda: swept(3), "function must be callable, got 3", TypeError),
    (lambda: hd.sweep(product, {}),
     "grid must be a mapping of axis names to values, got {}", TypeError),
    (lambda: hd.sweep(product, [1.0]), "grid must be a mapping", TypeError),
    (lambda: hd.sweep(product, {"a": [1.0]}),
     "grid must have an axis for each argument .*'b'", TypeError),
    (lambda: hd.sweep(product, {"a": [1], "b": [1], "c": [1]}),
     "got axes a, b, c; .* 'c'", TypeError),
    (lambda: swept(b=[]), f"{FLAT} of at least one value"),
    (lambda: swept(b=1.0), f"{FLAT} .* got 1.0"),
    *each(lambda b: swept(b=b), ["one", [[1.0]], [[1.0], [1.0, 2.0]]], FLAT),
    (lambda: swept(b=[1.0, math.nan]), r"grid\['b'\] must hold finite numbers"),
    (lambda: swept(b=[1.0, 2.0, 1.0]), r"grid\['b'\] must hold distinct values"),
    (lambda: swept(b=[1.0, "x"]), r"grid\['b'\] must have only numbers or strings", TypeError),
    *each(lambda b: swept(b=b), [[1j], [None]],
          r"grid\['b'\] must have only numbers or strings", TypeError),
    (lambda: hd.sweep(product, {"a": [1.0], "b": [1.0], "status": [1.0]}),
     "axes of grid must be named .* got 'status'"),
    (lambda: hd.sweep(product, {"a": [1.0], "b": [1.0], 1: [1.0]}),
     "axes of grid must be named by strings"),
    (lambda: swept(executor=4), "executor must be an Executor, got 4; pass concurrent", TypeError),
    (lambda: swept(store=4), "store must be the path of a file, got 4", TypeError),
    (lambda: hd.sweep(lambda a: {"b": a, "state": 1}, {"a": [1.0]}, carry=True),
     'takes "state" too', TypeError),
    (lambda: hd.sweep(lambda step, state: state, {"state": [1.0]}, carry=True), 'no axis "state"'),
    (lambda: hd.sweep(lambda a: 1 / 0, {"a": [1]})["value"],
     "none: no point gave a value", KeyError),
]  # fmt: skip

MASKS = each(lambda read: read(MASKED), [
    partial(hd.Equation, hd.Caputo(0.7), decay),
    lambda y0: hd.Equation(hd.Caputo(0.7), decay, 1j * y0),
    lambda y0: hd.Equation(hd.Caputo(0.7), decay, [y0, y0]),
    lambda params: linear().replace(params=params),
    lambda order: hd.Caputo(order),
    lambda coefficient: coefficient * hd.Caputo(0.5),
    lambda t_eval: run(t_eval=t_eval),
    lambda mesh: run(mesh=np.ma.concatenate([[0.0], mesh]), n_steps=None, scheme=hd.L1()),
    lambda breaks: run(breaks=breaks),
    lambda components: run(components=np.ma.array([0, 0], mask=components.mask)),
    lambda t: run()(t),
    lambda y0: hd.ensemble(linear(), 1.0, 10, y0=y0),
    lambda matrix: hd.Equation(hd.Caputo(0.7), None, [1, 1], linear=np.ma.stack([matrix] * 2)),
    lambda rates: Prony(rates, [1.0, 1.0]),
    lambda t: Kernel.from_table(np.ma.concatenate([t, [2.0, 3.0]]), [4.0, 3.0, 2.0, 1.0]),
    hd.zero_one_test,
    hd.power_spectrum,
    lambda sigma: fit_rate(sigma=np.ma.concatenate([[1.0], sigma])),
    lambda a: hd.sweep(lambda a: {"a": a}, {"a": a}),
], "got masked entries; leave these entries out, or fill")  # fmt: skip

DATA = [1.0, 2.0], [1.0, 0.5]
MODULI = [1.0, 2.0], [1.0, 2.0], [1.0, 2.0]
DAYS, TIMES = np.arange(6.0), np.geomspace(1e-3, 1e3, 100)
SHARES = np.array([0.0, 0.4, 0.3, 0.2, 0.1, 0.0])


def scarpi(s):
    return s ** ((1.8 + 0.6 * s) / (2 + s) - 1)


def of_moduli(moduli=MODULI, model=viscoelastic.SpringPot, p0=None, **given):
    guess = {"modulus": 1.0, "order": 0.5} if p0 is None else p0
    return viscoelastic.fit_moduli(model, *moduli, guess, **given)


MODELS = [
    (lambda: viscoelastic.fit_relaxation(viscoelastic.dashpot, *DATA, {"viscosity": 1.0}),
     "model must have relaxation above 0, got 0 from SpringPot"),
    (lambda: viscoelastic.fit_creep(viscoelastic.spring, [1.0, 2.0], [1.0], {"modulus": 1.0}),
     r"creep must have shape \(n,\) as t"),
    (lambda: viscoelastic.SpringPot(1.0, 1.5), r"order must lie in \[0, 1\]"),
    (lambda: viscoelastic.spring(0.0), "modulus must be a finite number above 0"),
    (lambda: viscoelastic.series(2.0), "parts must be a Model", TypeError),
    (viscoelastic.parallel, "parts must hold at least one model"),
    (lambda: viscoelastic.spring(1.0).relaxation([0.0, 1.0]), "t must be above 0"),
    (lambda: of_moduli(([1.0, 2.0], [1.0], [1.0])), "storage and loss must have shape"),
    (lambda: of_moduli(bounds={"alpha": (0, 1)}), "bounds must be of modulus"),
    (lambda: of_moduli(bounds={"order": (0.9, 1.0)}), "p0 must lie within the bounds"),
    (lambda: of_moduli(model=lambda a: a, p0={"a": 1.0}),
     "what model returns must be a Model", TypeError),
    # kernels by their transforms
    (lambda: hd.kernel_from_laplace(3.0), "be callable", TypeError),
    (lambda: hd.kernel_from_laplace(lambda s: s**0.2), "integrable at 0"),
    (lambda: hd.kernel_from_laplace(lambda s: 3.0), "give one number for each s", TypeError),
    (lambda: hd.kernel_from_laplace(lambda s: 1 / (s**2 + 0.2 * s + 1), signed=True)(TIMES),
     "analytic off the negative real axis"),
    (lambda: hd.kernel_from_laplace(scarpi).fit(1e-3, 10.0, 1e-6), "signed=True"),
    # densities
    (lambda: Kernel.from_table(DAYS, SHARES),
     "t must be positive, got 0 first; leave that row out"),
    (lambda: Kernel.from_table(DAYS, SHARES - 0.01, signed=True),
     "values must be positive at 4 times t > 0 or more, and 0 before and after them o"),
    (lambda: Kernel.from_table(DAYS[::-1], SHARES), "t must increase"),
    (lambda: hd.LognormalDensity(1.5, 0.0), r"sigma must lie in \[0.05, 5\]"),
    (lambda: hd.WeibullDensity(30.0, 1.0), r"shape must lie in \[0.1, 20\]"),
    (lambda: hd.WeibullDensity.from_mean(5.0, 0.1), "sd must be 0.063 to 400 times the mean"),
]  # fmt: skip

ROWS = [*KERNELS, *SCENES, *EXACT, *SOLUTIONS, *EXPONENTS, *RESPONSES, *FITS, *TABLES, *MASKS]
ROWS += MODELS
