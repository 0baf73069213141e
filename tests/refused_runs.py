"""Refusals of runs and of what is computed from runs, by what is called."""

import math
from functools import cache, partial

import numpy as np
from refusals import BAD, PRONY, adapt, adapted, begun, each, equation, read, run

import hereditary as hd

C, RL = hd.Caputo, hd.RiemannLiouville
LOOKUP = {"level": 0.5}


def looked_up(t, y):
    return y[0] - LOOKUP.get("level")


def first(t, y):
    return y[0]


def waving(t):
    return 0.5 + 0.3 * np.sin(t)


def half(t):
    return 0.5 + 0.0 * t


def varying(t):
    return 0.8 - 0.1 * t


def marked(function=first, **attributes):
    """Return the event function with these attributes."""

    def event(t, y):
        return function(t, y)

    for name, value in attributes.items():
        setattr(event, name, value)
    return event


def fails(how):
    def event(t, y):
        return how(t) if t > -1.0 else y[0]

    return event


class Switch:
    def __call__(self, t, y):
        return y[0]


def fire(t, y):
    return y[0] - 1.0


fire.direction, fire.change = 1, lambda t, y: 0 * y


def later(**change):
    """Run from t = 2 on."""
    return adapt(**{"equation": equation(0.7, t_start=2.0), "t_end": 3.0} | change)


def on_mesh(**change):
    arguments = {"n_steps": None, "mesh": hd.graded(10, 2.0), "scheme": hd.L1()}
    return run(**arguments | change)


def imex(**change):
    return run(**{"equation": imex_equation(), "scheme": hd.IMEX(hd.L1())} | change)


def imex_equation():
    return equation(0.5, [1.0], linear=[[-1.0]])


def again(**change):
    """Resume a run with these differences."""
    return hd.solve(
        **{"equation": hd.scenes.relaxation(), "t_end": 2.0, "resume": begun()} | change
    )


def adapt_again(**change):
    given = {"equation": hd.scenes.relaxation(), "t_end": 2.0, "rtol": 1e-8, "resume": adapted()}
    return hd.solve(**given | change)


def resumed(first, second, how, **given):
    """Resume a run of one equation with another."""
    return hd.solve(second, 2.0, resume=hd.solve(first, 1.0, **how).state, **given)


STEPS = ({"n_steps": 10}, {"rtol": 1e-6})
BREAKS = "breaks must be increasing times above 0, got"
NO_EVENT = r"events must be functions event\(t, y\), got"
NO_TERMINAL = "terminal must be True, False or the number of zeros"
PAST = "history must hold 100000000000000 steps in memory"

STEPS_GIVEN = [
    (lambda: run(n_steps=None, scheme=hd.L1()), "n_steps must be given", TypeError),
    (lambda: run(n_steps=10**40), r"n_steps must be at most 9e\+15, .*, got 1e\+40"),
    (lambda: run(n_steps=10**13), "save_every must keep as many rows as fit in memory"),
    *each(lambda h: run(n_steps=10**14, save_every=10**13, history=h), [hd.Direct(), hd.FFT()],
          PAST),
    (lambda: run(t_end=5e-324), "t_end must leave steps h .* another unit of time"),
    *each(lambda t: run(equation=equation(1.5, [1.0, 0.0]), t_end=t), [1e-300, 1e300],
          "t_end must leave steps h whose power h"),
    *each(lambda t: run(t_end=t), [(0, 1), [0.0, 1.0], np.array([0.0, 1.0])],
          r"t_end must be .*, got .*1.*; hd\.solve_ivp takes a span; .*t_start", TypeError),
    (lambda: later(t_end=(2.0, 3.0)), r"t_end must be .*; hd\.solve_ivp takes a span", TypeError),
    (lambda: run(equation=5), "equation must be an Equation", TypeError),
    (lambda: run(scheme="explicit"), r"scheme must be a Scheme.*hd.ExplicitCaputo\(\)", TypeError),
    (lambda: run(scheme="L1"), r"scheme must be a Scheme.*'L1'.*hd.L1\(\)", TypeError),
    (lambda: run(scheme="bdf2"), r"hd.BDF\(\)", TypeError),
    (lambda: run(scheme="IMEX"), r"hd.IMEX\(...\)", TypeError),
    (lambda: run(scheme="Radau"), r"pass hereditary.ExplicitCaputo\(\)", TypeError),
    (lambda: run(scheme=hd.L1), r"a Scheme, got the class L1; write L1\(...\)", TypeError),
    (lambda: run(history=hd.Direct), r"a History, got the class Direct; write Direct\(", TypeError),
    (lambda: run(history="direct"), "history must be a History", TypeError),
    (lambda: run(history="FFT"), r"history must be a History.*hd.FFT\(\)", TypeError),
    (lambda: run(save_every=2, t_eval=[0.5]), "save_every must"),
    (lambda: run(t_eval=[0.5, 0.2]), "t_eval must be increasing times"),
    *each(lambda t: run(t_eval=t), [[0.5, 2.0], [-0.5], [], [math.nan]], "t_eval"),
    (lambda: run(resume="state"), "resume must be a State", TypeError),
    (lambda: run(steps=10), "steps", TypeError),
    (lambda: run(t0=1.0), "t0 must be left out.*t_start", TypeError),
    (lambda: run(t_span=(0, 1)), r"t_span must.*t_start.* and t_end the end", TypeError),
    (lambda: run(method="RK45"), "method must.*scheme=", TypeError),
    (lambda: run(breaks=[0.123]), r"breaks must be times of steps.*got \[0.123\]"),
    (lambda: run(breaks=[0.5, 0.2]), "breaks must be increasing times above 0"),
    (lambda: run(allow_change=True), "allow_change must come with resume"),
    (lambda: run(params="a"), "params must be real, finite numbers", TypeError),
    *each(lambda c: run(equation=equation(0.8, np.ones(5)), components=c),
          [[], [5], [-1], [0.5], "a", [[0]]], "components must be numbers of components, 0 to 4"),
    (lambda: run(equation=equation(2.5, [1.0, 0.0, 0.0]), components=[0]),
     "components must be left out"),
    # meshes
    (lambda: on_mesh(mesh=[0.0, 0.5, 0.4, 1.0]), "mesh must be times that increase from 0"),
    *each(lambda mesh: on_mesh(mesh=mesh), [[0.1, 1.0], [0.0, 0.9], [0.0], [0.0, np.nan, 1.0]],
          "mesh must"),
    (lambda: on_mesh(n_steps=10), "n_steps must be left out if a mesh is given"),
    *((lambda scheme=scheme: on_mesh(scheme=scheme),
       f"mesh must be left out with {type(scheme).__name__}")
      for scheme in (hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L12(), hd.Adams())),
    (lambda: on_mesh(history=hd.FFT()), "mesh must be left out with FFT"),
    (lambda: on_mesh(equation=hd.scenes.oscillator(), scheme=hd.L2()),
     "order must be at most 1 for L2"),
    *each(lambda given: hd.graded(*given), [(0, 2.0), (10, 0.0), (10, np.nan), (2.5, 1.0)],
          "must", BAD),
]  # fmt: skip

STEPS_THAT_ADAPT = [
    (lambda: adapt(n_steps=100, scheme=hd.Collocation()),
     "n_steps must be left out with rtol, which chooses the steps, got 100"),
    (lambda: hd.sensitivities(hd.scenes.relaxation(), 1.0, n_steps=10, rtol=1e-6),
     "n_steps must be left out with rtol, which chooses the steps, got 10"),
    (lambda: run(scheme=hd.Collocation()), "n_steps must be left out with Collocation.*, got 10"),
    *each(lambda mesh: adapt(mesh=mesh, scheme=hd.Collocation()),
          [hd.graded(10, 2.0), np.linspace(0.0, 1.0, 5)], "mesh must be left out with rtol.*, got"),
    (lambda: adapt(history=hd.Direct()), r"history must be left out .*, got Direct\(\)"),
    (lambda: adapt(history=hd.FFT()), "history must be left out .*, got FFT"),
    *each(lambda rtol: adapt(rtol=rtol), [1e-13, 0.2, 1], "rtol must lie.*rtol=1e-6"),
    (lambda: adapt(rtol="1e-6"), "rtol must lie.*a number", TypeError),
    *each(lambda atol: adapt(atol=atol), [0.0, -1e-8, np.nan, np.inf],
          "atol must be a finite number above 0, got"),
    *each(lambda atol: adapt(atol=atol), [[1e-8, 1e-8], [0.0], [-1.0], [[1.0]]],
          r"atol must be a positive number, or one for each of the 1 comp.*, got \["),
    (lambda: adapt(atol=[[1e-8], 2]), "atol must be real, finite numbers", TypeError),
    *each(lambda breaks: adapt(breaks=breaks), [[0.5, 0.2], [0.5, 0.5]], rf"{BREAKS} \[0.5"),
    *each(lambda breaks: adapt(breaks=breaks), [[0.0, 0.5], [-1.0], 0.5, [[0.5]]], BREAKS),
    *each(lambda changes: adapt(changes=changes), [[1.0], {"soon": fire}, {0.5: 1.0}],
          "changes must", TypeError),
    *each(lambda time: adapt(changes={time: fire}), [0.0, -1.0], "belongs into y0"),
    (lambda: adapt(events=marked(forget=True)), "begin another Equation with t_start"),
    (lambda: adapt(breaks=[np.inf]), "breaks must be real, finite numbers, got"),
    (lambda: adapt(breaks=["soon"]), "breaks must be real, finite numbers, got", TypeError),
    (lambda: adapt(t_end=5e-324), r"t_end must lie in \[1e-300, 1e\+300\], got 5e-324"),
    (lambda: adapt(equation=equation(1.5, [0.0, 0.0]), t_end=1e250),
     r"t_end must lie in \[1e-300, 1e\+200\], got 1e\+250"),
    (lambda: adapt(t_eval=[2.0]), "t_eval must be increasing times"),
    *((lambda name=name, value=value: run(scheme=hd.BDF(2), **{name: value}),
       rf"{name} must be left out or come with scheme=Collocation\(\), got")
      for name, value in [("rtol", 1e-6), ("atol", 1e-8), ("max_step", 0.1), ("max_steps", 10)]),
    *((lambda scheme=scheme: hd.solve(hd.scenes.stick_slip(), 1.0, rtol=1e-3, scheme=scheme),
       r"rtol must be left out or come with scheme=Collocation\(\), got .*; or give mesh=graded")
      for scheme in [hd.L1(), hd.L2(), hd.L2Sigma(), hd.IMEX(hd.L1())]),
    (lambda: run(max_steps=5), "max_steps must be left out or come with"),
    (lambda: adapt(equation=equation([C(0.5), -C(0.5), C(0.3)])),
     "terms must leave a nonzero coefficient"),
    *((lambda order=order, y0=y0: adapt(equation=equation(order, y0)),
       "order must keep 5e-10 above integers")
      for order, y0 in [(1 + 1e-10, [1.0, 0.5]), (1e-10, 1.0)]),
    *each(lambda nodes: hd.Collocation(nodes=nodes), [1, 13, 0, -2, 2.5, True, "six"],
          "nodes must .*, got", BAD),
    # memory that is read, and Riemann-Liouville
    (lambda: adapt(equation=equation(1.6, [0.5, 0.0], read, memory=C(lambda t: 0.5 + 0.1 * t))),
     "constant order and kernels with Collocation"),
    (lambda: adapt(equation=equation(C(0.9) + RL(0.4), rhs=read, memory=C(0.3))),
     "where memory is read"),
    (lambda: adapt(equation=equation(C(0.8) + RL(half))),
     "one of 1 or more where that of RiemannLiouville varies"),
    (lambda: adapt(equation=equation(C(2.0) + RL(waving) + C(half), [1.0, 0.0])), "not mix"),
    (lambda: adapt(equation=equation(C(lambda t: 1.9 - 0.05 * t) + RL(0.3), [1.0, 0.0])),
     "constant order in front"),
    # a run that begins later
    (lambda: later(t_end=1.0), "t_end must exceed t_start = 2, got 1.0"),
    (lambda: later(t_eval=[1.0, 2.5]), r"t_eval must be increasing times in \[2.0, 3.0\]"),
    (lambda: later(breaks=[1.5]), "breaks must be increasing times above 2"),
    (lambda: later(rtol=None, mesh=[1.9, 3.0], scheme=hd.L1()),
     r"increase from 2 to t_end = 3.0, got \[1.9, 3. \]"),
    (lambda: later(rtol=None, n_steps=100, breaks=[2.5003]),
     r"breaks must be times of steps.*got \[2.5003\]"),
    (lambda: later(rtol=None, t_end=3.53, resume=later(rtol=None, n_steps=10).state),
     "got 3.53; the nearest is 3.5"),
    (lambda: later(rtol=None, n_steps=10)(1.0), r"t must lie in \[2.0, 3.0\], got \[1.\]"),
]  # fmt: skip

EVENTS = [
    (lambda: adapt(events=[1.0]), f"{NO_EVENT} 1.0", TypeError),
    (lambda: adapt(events="zero"), f"{NO_EVENT} 'zero'", TypeError),
    *each(lambda events: adapt(events=events), [1.0, [first, 1.0], [None]], NO_EVENT, TypeError),
    *each(lambda n: adapt(events=marked(terminal=n)), [-1, 1.5, "yes"], NO_TERMINAL),
    (lambda: adapt(events=marked(direction="up")),
     "direction must be a finite real number, got 'up'", TypeError),
    (lambda: adapt(events=marked(change=5.0)), "have a function change", TypeError),
    (lambda: adapt(events=fails(lambda t: 1 / t)),
     "events must .*, got event raised ZeroDivisionError", TypeError),
    (lambda: adapt(events=fails(lambda t: np.ones(2))),
     r"events must .* one number, got event returned \[1., 1.\]"),
    (lambda: adapt(events=fails(lambda t: np.nan)),
     "events must be finite at the start, got nan from event"),
    (lambda: later(equation=equation(t_start=-20.0), t_end=-1.0, events=lambda t, y: np.nan),
     "at t = -20.0"),
    (lambda: adapt(equation=equation(C(1.0) + RL(0.4)), events=fire), "beside RiemannLiouville"),
    *each(lambda term: run(equation=equation(C(1.0) + term), events=fire),
          [RL(0.4), hd.Memory(PRONY, 0)], "acts on, on given steps"),
    (lambda: adapt(equation=equation(varying), events=fire), "highest order varies"),
    *((lambda how=how: hd.maxima(
        hd.solve(equation(0.9, 0.0, lambda t, y: 1.5 - y), 5.0, **how, events=fire), 0),
       "hold no changes by events") for how in ({"rtol": 1e-6}, {"n_steps": 500})),
    (lambda: adapt(events=lambda t, y, memory: memory[0, 0]),
     r"events must .* memory= has delays alone, got <lambda>\(t, y, memory\); name", TypeError),
    *each(lambda how: hd.solve(
        equation(0.8, 1.0, read, memory=[C(0.4)]), 1.0, events=lambda t, y, late: late[0, 0], **how
    ), [{"rtol": 1e-6}, {"n_steps": 10}],
          r"events must .*, got <lambda>\(t, y, late\); by rtol= let y\[1\] of an", TypeError),
    # switches
    (lambda: adapt(switches=lambda t, y, memory: memory[0, 0]),
     r"switches must be functions switch\(t, y\), got .*; an event\(t, y, memory\)", TypeError),
    (lambda: adapt(switches=looked_up),
     "switches must.*numba cannot compile it at line.*LOOKUP", TypeError),
    *each(lambda bad: adapt(switches=bad), [3.0, lambda t: t], "switches", TypeError),
    (lambda: adapt(switches=Switch()), "that numba compiles", TypeError),
    (lambda: adapt(equation=equation(0.8, 1j), switches=first), "real components", TypeError),
    (lambda: adapt(equation=equation(varying), switches=first), "highest order varies"),
    (lambda: imex(switches=fire), "switches must be left out with IMEX"),
]  # fmt: skip

RESUMED = [
    *((partial(again, **change), words) for change, words in [
        ({"history": hd.Direct()}, "same history"),
        ({"history": hd.SumOfExponentials(1e-8)}, "same history"),
        ({"t_end": 0.5}, "t_end must exceed the state's time 1"),
        ({"t_end": 1.0}, "t_end must exceed"),
        ({"t_end": 2.03}, "whole number of the state's steps"),
        ({"n_steps": 7}, "n_steps must be 10"),
        ({"scheme": hd.L1()}, "same scheme"),
        ({"t_end": 1e308}, r"t_end must be at most 9e\+15 steps h = 0.1.*1e\+308"),
    ]),
    *((lambda make=make: again(equation=make()), words) for make, words in [
        (lambda: hd.scenes.relaxation(alpha=0.6), "same orders"),
        (lambda: equation(2 * C(0.5)), "same coefficients"),
        (lambda: equation(0.5, [1.0, 1.0]), "same coefficients"),
        (lambda: hd.scenes.relaxation(y0=2.0), "same y0"),
        (lambda: hd.scenes.relaxation(rate=2.0), "same params"),
        (lambda: equation(0.5, params=[-1.0]), "same right-hand side"),
    ]),
    *((partial(adapt_again, **change), words) for change, words in [
        ({"rtol": 1e-6}, "resume must come from a run with the same"),
        ({"atol": 1e-3}, "same tolerances"),
        ({"scheme": hd.Collocation(nodes=5)}, "same number of nodes"),
        ({"t_end": 1.0}, "t_end must exceed the state's time 1"),
        ({"scheme": hd.BDF(2), "rtol": None, "n_steps": 10}, "come from a run by"),
    ]),
    (lambda: adapt_again(equation=hd.scenes.relaxation(0.6)), "same orders"),
    (lambda: adapt_again(equation=equation(2 * C(0.5))), "same coeff"),
    (lambda: adapt_again(resume=begun()), "resume must come from a run by"),
    # orders and terms
    (lambda: resumed(equation(waving), equation(2 * C(waving)), STEPS[0]), "same coefficients"),
    *each(lambda other: resumed(equation(waving), equation(other), STEPS[0]),
          [lambda t: 0.5 + 0.3 * np.sin(2 * t), lambda t: 0.5], "same orders"),
    *((lambda how=how: resumed(*(equation(C(3) + c * C(1), [1.0, 0, 0]) for c in (2.0, 40.0)), how),
       "same terms") for how in ({"rtol": 1e-6}, {"n_steps": 10, "scheme": hd.BDF(2)})),
    *each(lambda gamma: resumed(
        equation(C(2.0) + RL(gamma), [1.0, 0.3]), equation(C(2.0) + C(0.5), [1.0, 0.3]), STEPS[1],
        allow_change=True), [0.5, waving], "same orders"),
    *each(lambda scheme: resumed(
        *(equation(1.8, [0.5, 0.1], read, memory=C(gamma)) for gamma in (0.6, 0.7)),
        {"n_steps": 10, "scheme": scheme}), [hd.ExplicitCaputo(), hd.L1(), hd.Adams()],
        "orders"),
    (lambda: resumed(*(equation(0.8, [1.0, 1.0], None, linear=c * np.eye(2)) for c in (-1, -2)),
                     STEPS[0]), "right-hand side"),
    (lambda: resumed(equation(0.7, t_start=0.5), equation(0.7), STEPS[0]), "same t_start, here 0"),
    (lambda: hd.solve(equation(0.7, t_start=-2.0), -1.5,
                      resume=hd.solve(equation(0.7, t_start=-2.0), -1.0, 10).state),
     "exceed the state's time -1.0, got -1.5"),
    (lambda: resumed(imex_equation(), imex_equation(), {"n_steps": 10, "scheme": hd.IMEX(hd.L1())},
                     scheme=hd.L1()), "same scheme"),
    # meshes
    (lambda: again(resume=mesh_state()),
     "mesh must be given if a run on a mesh is resumed", TypeError),
    (lambda: again(mesh=1 + hd.graded(20, 4.0).times(1.0), resume=mesh_state()),
     "mesh must have no steps below 0.0025, the shortest"),
    (lambda: again(t_end=20.0, mesh=[1.0, 20.0], resume=mesh_state()),
     "resume must stay within t = 10"),
    (lambda: again(mesh=[0.0, 2.0], resume=mesh_state()),
     "mesh must be times that increase from 1 "),
    (lambda: again(mesh=[1.0, 2.0], resume=run(scheme=hd.L1()).state),
     "mesh must be left out if a run of uniform steps"),
]  # fmt: skip


@cache
def mesh_state():
    return on_mesh(mesh=hd.graded(20, 2.0)).state


CONSTANT_ORDERS = r"constant orders with .*waving.*use ExplicitCaputo, L1 or"
NO_MEMORY = "terms must be Caputo operators with"
NO_LEFT_KERNEL = "terms must be Caputo operators .* Collocation"
KERNEL_BESIDE = C(lambda t: 0.6 + 0.1 * t)

SCHEMES = [
    *each(lambda scheme: run(equation=equation(waving), scheme=scheme),
          [hd.L2(), hd.L2Sigma(), hd.BDF(2), hd.Adams(), hd.ProductTrapezoid(),
           hd.GrunwaldLetnikov(), hd.L12()], CONSTANT_ORDERS),
    (lambda: run(equation=equation(waving), history=hd.FFT()),
     "history must be Direct or SumOfExponentials"),
    (lambda: on_mesh(equation=equation(waving), scheme=hd.L2()), CONSTANT_ORDERS),
    (lambda: hd.ExplicitCaputo().step_limit(equation(waving), 1.0),
     "equation must have constant orders"),
    *each(lambda scheme: scheme.step_limit(hd.scenes.relaxation(alpha=1.0), -1.0),
          [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], "stiffness must"),
    *each(lambda scheme: scheme.step_limit(hd.scenes.relaxation().system, 1.0),
          [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], "equation must be", TypeError),
    (lambda: hd.GrunwaldLetnikov().step_limit(equation(waving), 1.0),
     "terms must have constant orders with GrunwaldLetnikov"),
    *((lambda scheme=scheme, m=m: run(equation=equation([KERNEL_BESIDE, hd.Memory(PRONY, m)]),
                                      scheme=scheme), NO_LEFT_KERNEL)
      for scheme in (hd.ExplicitCaputo(), hd.L1()) for m in (0, 1)),
    *each(lambda scheme: run(equation=equation(C(1.0) + 0.5 * hd.Memory(PRONY, 1)), scheme=scheme),
          [hd.GrunwaldLetnikov(), hd.L12(), hd.L2(), hd.L2Sigma(), hd.BDF(2), hd.Adams(),
           hd.ProductTrapezoid()], NO_MEMORY),
    (lambda: on_mesh(equation=equation(C(1.0) + 0.5 * hd.Memory(PRONY, 1))), NO_LEFT_KERNEL),
    (lambda: run(equation=equation(1.8, [0.5, 0.1], read, memory=C(0.6)), scheme=hd.L2Sigma()),
     "terms must need no memory that .* with L2Sigma"),
    (lambda: run(equation=equation([C(1.0), -1.0 * C(1.0)])), "leading weight"),
    (lambda: hd.ExplicitCaputo(h=0.1), "unexpected keyword", TypeError),
    (lambda: hd.ExplicitCaputo().order(2.5), r"alpha must lie in \(0, 2\], got 2.5"),
    (lambda: hd.ExplicitCaputo().order(0.5, "rough"), "smoothness must"),
    (lambda: hd.L12().order(1.5), r"alpha must lie in \(0, 1\], got 1.5; use L1"),
    *each(hd.Adams, [0, -1, 1.5], "corrections must", BAD),
    *each(hd.BDF, [0, 7, 2.0, "2"], "order must", BAD),
    *((lambda p=p, a=a: run(equation=equation(a + 0.01, [1.0, 0.0]), scheme=hd.BDF(p)),
       f"be at most {a} for BDF") for p, a in [(3, 1.9156), (6, 1.11)]),
    *((lambda p=p, a=a: hd.BDF(p).order(a + 0.01),
       "alpha must lie in its sector of stability")
      for p, a in [(3, 1.9156), (6, 1.11)]),
    (lambda: run(scheme=hd.IMEX(hd.L1())), "linear must be given with IMEX"),
    *each(hd.IMEX, [hd.BDF(3), hd.L12(), hd.L1], "scheme must be hereditary"),
    (lambda: imex(n_steps=None, mesh=hd.graded(5, 2.0), scheme=hd.IMEX(hd.BDF(2))),
     "mesh must be left out with IMEX"),
    (lambda: hd.lyapunov(imex_equation(), 1.0, 10, scheme=hd.IMEX(hd.L1())),
     "scheme must give tangents"),
    *each(hd.SumOfExponentials, [1e-14, 0.2], "tol must"),
    (lambda: hd.SumOfExponentials(tolerance=1e-8), "unexpected keyword", TypeError),
]  # fmt: skip


def mixed(c):
    """D^0.9 y + c D^0.4 y = -y."""
    return hd.Equation(hd.Caputo(0.9) + c * hd.Caputo(0.4), lambda t, y: -y, 1.0)


def noisy():
    """A past that is drawn anew by each call."""
    draw = np.random.default_rng(0).normal
    return hd.Equation(
        C(1), lambda t, y, m: -m[0], 1.0, memory=hd.Delay(1.0, past=lambda t: float(draw()))
    )


def resting():
    return hd.Equation(hd.Caputo(0.5), lambda t, y: 0 * y, 1.0)


NARROW = hd.Kernel.from_table([1.0, 2.0, 3.0, 4.0, 5.0], [5.0, 4.0, 3.0, 2.0, 1.0])
OF_ONE_PART = [
    (lambda: hd.derivative(np.ones((2, 2)), np.ones(4), hd.Caputo(0.5)),
     r"t must have shape \(n,\), got shape \(2, 2\)"),
    (lambda: hd.derivative([0.0, 1.0], np.sin, hd.Caputo(0.5), scheme=hd.L1()),
     "scheme must be left out for a function", TypeError),
    (lambda: hd.derivative([0.0, 1.0], lambda t: np.ones((2, 2, 2)), hd.Caputo(0.5)),
     r"y must return shape \(k,\) or \(k, d\)"),
    (lambda: hd.Delay(1.0, past="warm"), "past must be numbers or a function of t", TypeError),
    *each(lambda how: hd.solve(noisy(), 1.0, **how), [{"rtol": 1e-6}, {"n_steps": 10}],
          "past must return equal values at equal times"),
    (lambda: hd.frequency_response(mixed(1.0).replace(t_start=1.0), [1.0], frequency=0),
     "t_start must be 0"),
    (lambda: hd.Collocation().plan(None, 0.1), "n_steps must be left out with Coll"),
    (lambda: hd.GrunwaldLetnikov(map=3), "map must be True or False, got 3", TypeError),
    (lambda: hd.solve(mixed(-0.5), 1.0, 10, scheme=hd.L2Sigma()),
     "terms must have positive coefficients with L2Sigma"),
    (lambda: hd.solve(mixed(1.0), 0.5, resume=hd.solve(mixed(1.0), 1.0, 10).state),
     "t_end must exceed the state's time 1.0, got 0.5"),
    (lambda: hd.convergence_table(resting(), 1.0, [9, 18]), "n_steps must leave errors above 0"),
    (lambda: hd.fit_exponentials(NARROW, 4.5, 4.9, 1e-3),
     "the table must have at least 4 times, got 0 between 4.5 and 4.9"),
    (lambda: hd.fit(mixed, [1.0, 2.0], [["one"], ["two"]], {"c": 1.0}),
     "data must be real numbers, NaN for missing ones", TypeError),
]  # fmt: skip

ROWS = [*STEPS_GIVEN, *STEPS_THAT_ADAPT, *EVENTS, *RESUMED, *SCHEMES, *OF_ONE_PART]
