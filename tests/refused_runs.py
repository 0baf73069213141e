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
RANGE = "n_steps must be a positive integer, got"
BREAKS = "breaks must be increasing times above 0, got"
NO_EVENT = r"events must be functions event\(t, y\), got"
NO_TERMINAL = "terminal must be True, False or the number of zeros"
PAST = "history must hold 100000000000000 steps in memory"

STEPS_GIVEN = [
    (lambda: run(n_steps=0), ValueError, f"{RANGE} 0"),
    (lambda: run(n_steps=-3), ValueError, f"{RANGE} -3"),
    (lambda: run(n_steps=2.5), TypeError, f"{RANGE} 2.5"),
    (lambda: run(n_steps=True), TypeError, "n_steps must"),
    (lambda: run(n_steps=None, scheme=hd.L1()), TypeError, "n_steps must be given"),
    (lambda: run(n_steps=10**40), ValueError, r"n_steps must be at most 9e\+15, .*, got 1e\+40"),
    (lambda: run(n_steps=10**13), ValueError, "save_every must keep as many rows as fit in memory"),
    *each(lambda h: run(n_steps=10**14, save_every=10**13, history=h), [hd.Direct(), hd.FFT()],
          ValueError, PAST),
    (lambda: run(t_end=5e-324), ValueError, "t_end must leave steps h .* another unit of time"),
    *each(lambda t: run(equation=equation(1.5, [1.0, 0.0]), t_end=t), [1e-300, 1e300],
          ValueError, "t_end must leave steps h whose power h"),
    (lambda: run(t_end=0.0), ValueError, "t_end must be a finite number above 0, got 0.0"),
    (lambda: run(t_end=math.inf), ValueError, "t_end must be a finite number above 0, got inf"),
    *each(lambda t: run(t_end=t), [-1.0, math.nan], ValueError, "t_end"),
    *each(lambda t: run(t_end=t), ["late", [1.0]], TypeError, "t_end"),
    *each(lambda t: run(t_end=t), [(0, 1), [0.0, 1.0], np.array([0.0, 1.0])],
          TypeError, r"t_end must be .*, got .*1.*; hd\.solve_ivp takes a span; .*t_start"),
    (lambda: later(t_end=(2.0, 3.0)), TypeError, r"t_end must be .*; hd\.solve_ivp takes a span"),
    (lambda: run(equation=5), TypeError, "equation must be an Equation"),
    (lambda: run(scheme="explicit"), TypeError, r"scheme must be a Scheme.*hd.ExplicitCaputo\(\)"),
    (lambda: run(scheme="L1"), TypeError, r"scheme must be a Scheme.*'L1'.*hd.L1\(\)"),
    (lambda: run(scheme="bdf2"), TypeError, r"hd.BDF\(\)"),
    (lambda: run(scheme="IMEX"), TypeError, r"hd.IMEX\(...\)"),
    (lambda: run(scheme="Radau"), TypeError, r"pass hereditary.ExplicitCaputo\(\)"),
    (lambda: run(scheme=hd.L1), TypeError, r"a Scheme, got the class L1; write L1\(...\)"),
    (lambda: run(history=hd.Direct), TypeError, r"a History, got the class Direct; write Direct\("),
    (lambda: run(history="direct"), TypeError, "history must be a History"),
    (lambda: run(history="FFT"), TypeError, r"history must be a History.*hd.FFT\(\)"),
    (lambda: run(save_every=0), ValueError, "save_every must be a positive integer"),
    (lambda: run(save_every=1.5), TypeError, "save_every"),
    (lambda: run(save_every=2, t_eval=[0.5]), ValueError, "save_every must"),
    (lambda: run(t_eval=[0.5, 0.2]), ValueError, "t_eval must be increasing times"),
    *each(lambda t: run(t_eval=t), [[0.5, 2.0], [-0.5], [], [math.nan]], ValueError, "t_eval"),
    (lambda: run(resume="state"), TypeError, "resume must be a State"),
    (lambda: run(steps=10), TypeError, "steps"),
    (lambda: run(t0=1.0), TypeError, "t0 must be left out.*t_start"),
    (lambda: run(t_span=(0, 1)), TypeError, r"t_span must.*t_start.* and t_end the end"),
    (lambda: run(method="RK45"), TypeError, "method must.*scheme="),
    (lambda: run(breaks=[0.123]), ValueError, r"breaks must be times of steps.*got \[0.123\]"),
    (lambda: run(breaks=[0.5, 0.2]), ValueError, "breaks must be increasing times above 0"),
    (lambda: run(allow_change=True), ValueError, "allow_change must come with resume"),
    (lambda: run(params="a"), TypeError, "params must be real, finite numbers"),
    *each(lambda c: run(equation=equation(0.8, np.ones(5)), components=c),
          [[], [5], [-1], [0.5], "a", [[0]]],
          ValueError, "components must be numbers of components, 0 to 4"),
    (lambda: run(equation=equation(2.5, [1.0, 0.0, 0.0]), components=[0]),
     ValueError, "components must be left out"),
    # meshes
    (lambda: on_mesh(mesh=[0.0, 0.5, 0.4, 1.0]),
     ValueError, "mesh must be times that increase from 0"),
    *each(lambda mesh: on_mesh(mesh=mesh), [[0.1, 1.0], [0.0, 0.9], [0.0], [0.0, np.nan, 1.0]],
          ValueError, "mesh must"),
    (lambda: on_mesh(n_steps=10), ValueError, "n_steps must be left out if a mesh is given"),
    *((lambda scheme=scheme: on_mesh(scheme=scheme),
       ValueError, f"mesh must be left out with {type(scheme).__name__}")
      for scheme in (hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L12(), hd.Adams())),
    (lambda: on_mesh(history=hd.FFT()), ValueError, "mesh must be left out with FFT"),
    (lambda: on_mesh(equation=hd.scenes.oscillator(), scheme=hd.L2()),
     ValueError, "order must be at most 1 for L2"),
    *each(lambda given: hd.graded(*given), [(0, 2.0), (10, 0.0), (10, np.nan), (2.5, 1.0)],
          BAD, "must"),
]  # fmt: skip

STEPS_THAT_ADAPT = [
    (lambda: adapt(n_steps=100, scheme=hd.Collocation()),
     ValueError, "n_steps must be left out with rtol, which chooses the steps, got 100"),
    (lambda: hd.sensitivities(hd.scenes.relaxation(), 1.0, n_steps=10, rtol=1e-6),
     ValueError, "n_steps must be left out with rtol, which chooses the steps, got 10"),
    (lambda: run(scheme=hd.Collocation()),
     ValueError, "n_steps must be left out with Collocation.*, got 10"),
    *each(lambda mesh: adapt(mesh=mesh, scheme=hd.Collocation()),
          [hd.graded(10, 2.0), np.linspace(0.0, 1.0, 5)],
          ValueError, "mesh must be left out with rtol.*, got"),
    (lambda: adapt(history=hd.Direct()),
     ValueError, r"history must be left out .*, got Direct\(\)"),
    (lambda: adapt(history=hd.FFT()), ValueError, "history must be left out .*, got FFT"),
    (lambda: adapt(rtol=1e-13), ValueError, r"rtol must lie in \[1e-12, 0.1\], got 1e-13"),
    *each(lambda rtol: adapt(rtol=rtol), [0.0, 0.2, np.nan], ValueError, "rtol must lie in"),
    (lambda: adapt(rtol="fine"), TypeError, "rtol must lie in .*, got 'fine'"),
    (lambda: adapt(rtol=1), ValueError, "rtol must lie.*rtol=1e-6"),
    (lambda: adapt(rtol="1e-6"), TypeError, "rtol must lie.*a number"),
    (lambda: adapt(atol=0.0), ValueError, "atol must be a finite number above 0, got 0.0"),
    (lambda: adapt(atol=-1e-8), ValueError, "atol must be a finite number above 0, got -1e-08"),
    *each(lambda atol: adapt(atol=atol), [[1e-8, 1e-8], [0.0], [-1.0], [[1.0]]],
          ValueError, r"atol must be a positive number, or one for each of the 1 comp.*, got \["),
    (lambda: adapt(atol=[[1e-8], 2]), TypeError, "atol must be real, finite numbers"),
    (lambda: adapt(breaks=[0.5, 0.2]), ValueError, rf"{BREAKS} \[0.5"),
    (lambda: adapt(breaks=[0.5, 0.5]), ValueError, "breaks must be increasing"),
    *each(lambda breaks: adapt(breaks=breaks), [[0.0, 0.5], [-1.0], 0.5, [[0.5]]],
          ValueError, BREAKS),
    *each(lambda changes: adapt(changes=changes), [[1.0], {"soon": fire}, {0.5: 1.0}],
          TypeError, "changes must"),
    *each(lambda time: adapt(changes={time: fire}), [0.0, -1.0], ValueError, "belongs into y0"),
    (lambda: adapt(events=marked(forget=True)), ValueError, "begin another Equation with t_start"),
    (lambda: adapt(breaks=[np.inf]), ValueError, "breaks must be real, finite numbers, got"),
    (lambda: adapt(breaks=["soon"]), TypeError, "breaks must be real, finite numbers, got"),
    (lambda: adapt(t_end=5e-324), ValueError, r"t_end must lie in \[1e-300, 1e\+300\], got 5e-324"),
    (lambda: adapt(equation=equation(1.5, [0.0, 0.0]), t_end=1e250),
     ValueError, r"t_end must lie in \[1e-300, 1e\+200\], got 1e\+250"),
    (lambda: adapt(save_every=0), ValueError, "save_every must be a positive integer, got 0"),
    (lambda: adapt(t_eval=[2.0]), ValueError, "t_eval must be increasing times"),
    (lambda: adapt(max_step=0.0), ValueError, "max_step must be a finite number above 0"),
    *((lambda name=name, value=value: run(scheme=hd.BDF(2), **{name: value}),
       ValueError, rf"{name} must be left out or come with scheme=Collocation\(\), got")
      for name, value in [("rtol", 1e-6), ("atol", 1e-8), ("max_step", 0.1), ("max_steps", 10)]),
    *((lambda scheme=scheme: hd.solve(hd.scenes.stick_slip(), 1.0, rtol=1e-3, scheme=scheme),
       ValueError,
       r"rtol must be left out or come with scheme=Collocation\(\), got .*; or give mesh=graded")
      for scheme in [hd.L1(), hd.L2(), hd.L2Sigma(), hd.IMEX(hd.L1())]),
    (lambda: run(max_steps=5), ValueError, "max_steps must be left out or come with"),
    (lambda: adapt(equation=equation([C(0.5), -C(0.5), C(0.3)])),
     ValueError, "terms must leave a nonzero coefficient"),
    *((lambda order=order, y0=y0: adapt(equation=equation(order, y0)),
       ValueError, "order must keep 5e-10 above integers")
      for order, y0 in [(1 + 1e-10, [1.0, 0.5]), (1e-10, 1.0)]),
    *each(lambda nodes: hd.Collocation(nodes=nodes), [1, 13, 0, -2, 2.5, True, "six"],
          BAD, "nodes must .*, got"),
    *each(lambda horizon: hd.Collocation(horizon=horizon), [0.0, -1.0, np.inf, "far"],
          BAD, "horizon must .*, got"),
    # memory that is read, and Riemann-Liouville
    (lambda: adapt(equation=equation(1.6, [0.5, 0.0], read, memory=C(lambda t: 0.5 + 0.1 * t))),
     ValueError, "constant order and kernels with Collocation"),
    (lambda: adapt(equation=equation(C(0.9) + RL(0.4), rhs=read, memory=C(0.3))),
     ValueError, "where memory is read"),
    (lambda: adapt(equation=equation(C(0.8) + RL(half))),
     ValueError, "one of 1 or more where that of RiemannLiouville varies"),
    (lambda: adapt(equation=equation(C(2.0) + RL(waving) + C(half), [1.0, 0.0])),
     ValueError, "not mix"),
    (lambda: adapt(equation=equation(C(lambda t: 1.9 - 0.05 * t) + RL(0.3), [1.0, 0.0])),
     ValueError, "constant order in front"),
    # a run that begins later
    (lambda: later(t_end=1.0), ValueError, "t_end must exceed t_start = 2, got 1.0"),
    (lambda: later(t_eval=[1.0, 2.5]),
     ValueError, r"t_eval must be increasing times in \[2.0, 3.0\]"),
    (lambda: later(breaks=[1.5]), ValueError, "breaks must be increasing times above 2"),
    (lambda: later(rtol=None, mesh=[1.9, 3.0], scheme=hd.L1()),
     ValueError, r"increase from 2 to t_end = 3.0, got \[1.9, 3. \]"),
    (lambda: later(rtol=None, n_steps=100, breaks=[2.5003]),
     ValueError, r"breaks must be times of steps.*got \[2.5003\]"),
    (lambda: later(rtol=None, t_end=3.53, resume=later(rtol=None, n_steps=10).state),
     ValueError, "got 3.53; the nearest is 3.5"),
    (lambda: later(rtol=None, n_steps=10)(1.0),
     ValueError, r"t must lie in \[2.0, 3.0\], got \[1.\]"),
]  # fmt: skip

EVENTS = [
    (lambda: adapt(events=[1.0]), TypeError, f"{NO_EVENT} 1.0"),
    (lambda: adapt(events="zero"), TypeError, f"{NO_EVENT} 'zero'"),
    (lambda: adapt(events=1.0), TypeError, NO_EVENT),
    *each(lambda events: adapt(events=events), [[first, 1.0], [None]], TypeError, NO_EVENT),
    *each(lambda n: adapt(events=marked(terminal=n)), [-1, 1.5, "yes"], ValueError, NO_TERMINAL),
    (lambda: adapt(events=marked(direction="up")),
     TypeError, "direction must be a finite real number, got 'up'"),
    (lambda: adapt(events=marked(change=5.0)), TypeError, "have a function change"),
    (lambda: adapt(events=fails(lambda t: 1 / t)),
     TypeError, "events must .*, got event raised ZeroDivisionError"),
    (lambda: adapt(events=fails(lambda t: np.ones(2))),
     ValueError, r"events must .* one number, got event returned \[1., 1.\]"),
    (lambda: adapt(events=fails(lambda t: np.nan)),
     ValueError, "events must be finite at the start, got nan from event"),
    (lambda: later(equation=equation(t_start=-20.0), t_end=-1.0, events=lambda t, y: np.nan),
     ValueError, "at t = -20.0"),
    (lambda: adapt(equation=equation(C(1.0) + RL(0.4)), events=fire),
     ValueError, "beside RiemannLiouville"),
    *each(lambda term: run(equation=equation(C(1.0) + term), events=fire),
          [RL(0.4), hd.Memory(PRONY, 0)], ValueError, "acts on, on given steps"),
    (lambda: adapt(equation=equation(varying), events=fire), ValueError, "highest order varies"),
    *((lambda how=how: hd.maxima(
        hd.solve(equation(0.9, 0.0, lambda t, y: 1.5 - y), 5.0, **how, events=fire), 0),
       ValueError, "hold no changes by events") for how in ({"rtol": 1e-6}, {"n_steps": 500})),
    (lambda: adapt(events=lambda t, y, memory: memory[0, 0]),
     TypeError, r"events must .* memory= has delays alone, got <lambda>\(t, y, memory\); name"),
    *each(lambda how: hd.solve(
        equation(0.8, 1.0, read, memory=[C(0.4)]), 1.0, events=lambda t, y, late: late[0, 0], **how
    ), [{"rtol": 1e-6}, {"n_steps": 10}],
          TypeError, r"events must .*, got <lambda>\(t, y, late\); by rtol= let y\[1\] of an"),
    # switches
    (lambda: adapt(switches=lambda t, y, memory: memory[0, 0]),
     TypeError, r"switches must be functions switch\(t, y\), got .*; an event\(t, y, memory\)"),
    (lambda: adapt(switches=looked_up),
     TypeError, "switches must.*numba cannot compile it at line.*LOOKUP"),
    *each(lambda bad: adapt(switches=bad), [3.0, lambda t: t], TypeError, "switches"),
    (lambda: adapt(switches=Switch()), TypeError, "that numba compiles"),
    (lambda: adapt(equation=equation(0.8, 1j), switches=first), TypeError, "real components"),
    (lambda: adapt(equation=equation(varying), switches=first), ValueError, "highest order varies"),
    (lambda: imex(switches=fire), ValueError, "switches must be left out with IMEX"),
]  # fmt: skip

RESUMED = [
    *((partial(again, **change), ValueError, words) for change, words in [
        ({"history": hd.Direct()}, "same history"),
        ({"history": hd.SumOfExponentials(1e-8)}, "same history"),
        ({"t_end": 0.5}, "t_end must exceed the state's time 1"),
        ({"t_end": 1.0}, "t_end must exceed"),
        ({"t_end": 2.03}, "whole number of the state's steps"),
        ({"n_steps": 7}, "n_steps must be 10"),
        ({"scheme": hd.L1()}, "same scheme"),
        ({"t_end": 1e308}, r"t_end must be at most 9e\+15 steps h = 0.1.*1e\+308"),
    ]),
    *((lambda make=make: again(equation=make()), ValueError, words) for make, words in [
        (lambda: hd.scenes.relaxation(alpha=0.6), "same orders"),
        (lambda: equation(2 * C(0.5)), "same coefficients"),
        (lambda: equation(0.5, [1.0, 1.0]), "same coefficients"),
        (lambda: hd.scenes.relaxation(y0=2.0), "same y0"),
        (lambda: hd.scenes.relaxation(rate=2.0), "same params"),
        (lambda: equation(0.5, params=[-1.0]), "same right-hand side"),
    ]),
    *((partial(adapt_again, **change), error, words) for change, error, words in [
        ({"rtol": 1e-6}, ValueError, "resume must come from a run with the same"),
        ({"atol": 1e-3}, ValueError, "same tolerances"),
        ({"scheme": hd.Collocation(nodes=5)}, ValueError, "same number of nodes"),
        ({"t_end": 1.0}, ValueError, "t_end must exceed the state's time 1"),
        ({"scheme": hd.BDF(2), "rtol": None, "n_steps": 10}, ValueError, "come from a run by"),
    ]),
    (lambda: adapt_again(equation=hd.scenes.relaxation(0.6)), ValueError, "same orders"),
    (lambda: adapt_again(equation=equation(2 * C(0.5))), ValueError, "same coeff"),
    (lambda: adapt_again(resume=begun()), ValueError, "resume must come from a run by"),
    # orders and terms
    (lambda: resumed(equation(waving), equation(2 * C(waving)), STEPS[0]),
     ValueError, "same coefficients"),
    *each(lambda other: resumed(equation(waving), equation(other), STEPS[0]),
          [lambda t: 0.5 + 0.3 * np.sin(2 * t), lambda t: 0.5], ValueError, "same orders"),
    *((lambda how=how: resumed(*(equation(C(3) + c * C(1), [1.0, 0, 0]) for c in (2.0, 40.0)), how),
       ValueError, "same terms") for how in ({"rtol": 1e-6}, {"n_steps": 10, "scheme": hd.BDF(2)})),
    *each(lambda gamma: resumed(
        equation(C(2.0) + RL(gamma), [1.0, 0.3]), equation(C(2.0) + C(0.5), [1.0, 0.3]), STEPS[1],
        allow_change=True), [0.5, waving], ValueError, "same orders"),
    *each(lambda scheme: resumed(
        *(equation(1.8, [0.5, 0.1], read, memory=C(gamma)) for gamma in (0.6, 0.7)),
        {"n_steps": 10, "scheme": scheme}), [hd.ExplicitCaputo(), hd.L1(), hd.Adams()],
        ValueError, "orders"),
    (lambda: resumed(*(equation(0.8, [1.0, 1.0], None, linear=c * np.eye(2)) for c in (-1, -2)),
                     STEPS[0]), ValueError, "right-hand side"),
    (lambda: resumed(equation(0.7, t_start=0.5), equation(0.7), STEPS[0]),
     ValueError, "same t_start, here 0"),
    (lambda: hd.solve(equation(0.7, t_start=-2.0), -1.5,
                      resume=hd.solve(equation(0.7, t_start=-2.0), -1.0, 10).state),
     ValueError, "exceed the state's time -1.0, got -1.5"),
    (lambda: resumed(imex_equation(), imex_equation(), {"n_steps": 10, "scheme": hd.IMEX(hd.L1())},
                     scheme=hd.L1()), ValueError, "same scheme"),
    # meshes
    (lambda: again(resume=mesh_state()),
     TypeError, "mesh must be given if a run on a mesh is resumed"),
    (lambda: again(mesh=1 + hd.graded(20, 4.0).times(1.0), resume=mesh_state()),
     ValueError, "mesh must have no steps below 0.0025, the shortest"),
    (lambda: again(t_end=20.0, mesh=[1.0, 20.0], resume=mesh_state()),
     ValueError, "resume must stay within t = 10"),
    (lambda: again(mesh=[0.0, 2.0], resume=mesh_state()),
     ValueError, "mesh must be times that increase from 1 "),
    (lambda: again(mesh=[1.0, 2.0], resume=run(scheme=hd.L1()).state),
     ValueError, "mesh must be left out if a run of uniform steps"),
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
           hd.GrunwaldLetnikov(), hd.L12()], ValueError, CONSTANT_ORDERS),
    (lambda: run(equation=equation(waving), history=hd.FFT()),
     ValueError, "history must be Direct or SumOfExponentials"),
    (lambda: on_mesh(equation=equation(waving), scheme=hd.L2()), ValueError, CONSTANT_ORDERS),
    (lambda: hd.ExplicitCaputo().step_limit(equation(waving), 1.0),
     ValueError, "equation must have constant orders"),
    *each(lambda scheme: scheme.step_limit(hd.scenes.relaxation(alpha=1.0), -1.0),
          [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], ValueError, "stiffness must"),
    *each(lambda scheme: scheme.step_limit(hd.scenes.relaxation().system, 1.0),
          [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], TypeError, "equation must be"),
    (lambda: hd.GrunwaldLetnikov().step_limit(equation(waving), 1.0),
     ValueError, "terms must have constant orders with GrunwaldLetnikov"),
    *((lambda scheme=scheme, m=m: run(equation=equation([KERNEL_BESIDE, hd.Memory(PRONY, m)]),
                                      scheme=scheme), ValueError, NO_LEFT_KERNEL)
      for scheme in (hd.ExplicitCaputo(), hd.L1()) for m in (0, 1)),
    *each(lambda scheme: run(equation=equation(C(1.0) + 0.5 * hd.Memory(PRONY, 1)), scheme=scheme),
          [hd.GrunwaldLetnikov(), hd.L12(), hd.L2(), hd.L2Sigma(), hd.BDF(2), hd.Adams(),
           hd.ProductTrapezoid()], ValueError, NO_MEMORY),
    (lambda: on_mesh(equation=equation(C(1.0) + 0.5 * hd.Memory(PRONY, 1))),
     ValueError, NO_LEFT_KERNEL),
    (lambda: run(equation=equation(1.8, [0.5, 0.1], read, memory=C(0.6)), scheme=hd.L2Sigma()),
     ValueError, "terms must need no memory that .* with L2Sigma"),
    (lambda: run(equation=equation([C(1.0), -1.0 * C(1.0)])), ValueError, "leading weight"),
    (lambda: hd.ExplicitCaputo(h=0.1), TypeError, "unexpected keyword"),
    (lambda: hd.ExplicitCaputo().order(2.5), ValueError, r"alpha must lie in \(0, 2\], got 2.5"),
    (lambda: hd.ExplicitCaputo().order(0.5, "rough"), ValueError, "smoothness must"),
    (lambda: hd.L12().order(1.5), ValueError, r"alpha must lie in \(0, 1\], got 1.5; use L1"),
    *each(hd.Adams, [0, -1, 1.5], BAD, "corrections must"),
    *each(hd.BDF, [0, 7, 2.0, "2"], BAD, "order must"),
    *((lambda p=p, a=a: run(equation=equation(a + 0.01, [1.0, 0.0]), scheme=hd.BDF(p)),
       ValueError, f"be at most {a} for BDF") for p, a in [(3, 1.9156), (6, 1.11)]),
    *((lambda p=p, a=a: hd.BDF(p).order(a + 0.01),
       ValueError, "alpha must lie in its sector of stability")
      for p, a in [(3, 1.9156), (6, 1.11)]),
    (lambda: run(scheme=hd.IMEX(hd.L1())), ValueError, "linear must be given with IMEX"),
    *each(hd.IMEX, [hd.BDF(3), hd.L12(), hd.L1], ValueError, "scheme must be hereditary"),
    (lambda: imex(n_steps=None, mesh=hd.graded(5, 2.0), scheme=hd.IMEX(hd.BDF(2))),
     ValueError, "mesh must be left out with IMEX"),
    (lambda: hd.lyapunov(imex_equation(), 1.0, 10, scheme=hd.IMEX(hd.L1())),
     ValueError, "scheme must give tangents"),
    *each(hd.SumOfExponentials, [1e-14, 0.0, 1.0, "loose"], BAD, "tol must"),
    *each(lambda t: hd.SumOfExponentials(horizon=t), [0, -1, np.inf, "far"], BAD, "horizon must"),
    (lambda: hd.SumOfExponentials(tolerance=1e-8), TypeError, "unexpected keyword"),
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
     ValueError, r"t must have shape \(n,\), got shape \(2, 2\)"),
    (lambda: hd.derivative([0.0, 1.0], np.sin, hd.Caputo(0.5), scheme=hd.L1()),
     TypeError, "scheme must be left out for a function"),
    (lambda: hd.derivative([0.0, 1.0], lambda t: np.ones((2, 2, 2)), hd.Caputo(0.5)),
     ValueError, r"y must return shape \(k,\) or \(k, d\)"),
    (lambda: hd.Delay(1.0, past="warm"), TypeError, "past must be numbers or a function of t"),
    *each(lambda how: hd.solve(noisy(), 1.0, **how), [{"rtol": 1e-6}, {"n_steps": 10}],
          ValueError, "past must return equal values at equal times"),
    (lambda: hd.frequency_response(mixed(1.0).replace(t_start=1.0), [1.0], frequency=0),
     ValueError, "t_start must be 0"),
    (lambda: hd.Collocation().plan(None, 0.1), ValueError, "n_steps must be left out with Coll"),
    (lambda: hd.GrunwaldLetnikov(map=3), TypeError, "map must be True or False, got 3"),
    (lambda: hd.solve(mixed(-0.5), 1.0, 10, scheme=hd.L2Sigma()),
     ValueError, "terms must have positive coefficients with L2Sigma"),
    (lambda: hd.solve(mixed(1.0), 0.5, resume=hd.solve(mixed(1.0), 1.0, 10).state),
     ValueError, "t_end must exceed the state's time 1.0, got 0.5"),
    (lambda: hd.convergence_table(resting(), 1.0, [9, 18]),
     ValueError, "n_steps must leave errors above 0"),
    (lambda: hd.fit_exponentials(NARROW, 4.5, 4.9, 1e-3),
     ValueError, "the table must have at least 4 times, got 0 between 4.5 and 4.9"),
    (lambda: hd.fit(mixed, [1.0, 2.0], [["one"], ["two"]], {"c": 1.0}),
     TypeError, "data must be real numbers, NaN for missing ones"),
]  # fmt: skip

ROWS = [*STEPS_GIVEN, *STEPS_THAT_ADAPT, *EVENTS, *RESUMED, *SCHEMES, *OF_ONE_PART]
