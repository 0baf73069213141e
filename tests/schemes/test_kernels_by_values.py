"""Kernels of a function, a table or a fitted sum give what the closed form gives."""

import warnings

import numpy as np
import pytest

import hereditary as hd

CLOSED = hd.StretchedExponential(0.5, 1.0)
T = 10.0
TIMES = np.geomspace(1e-4, 30.0, 300)
WAYS = {
    "default": {"n_steps": 1000},
    "L1": {"n_steps": 1000, "scheme": hd.L1()},
    "FFT": {"n_steps": 1000, "history": hd.FFT()},
    "Direct": {"n_steps": 1000, "history": hd.Direct()},
    "rtol": {"rtol": 1e-4},
}
KERNELS = {
    "function": lambda: hd.Kernel(lambda t: np.exp(-np.sqrt(t))),
    "table": lambda: hd.Kernel.from_table(TIMES, np.exp(-np.sqrt(TIMES))),
    "sum": lambda: hd.fit_exponentials(CLOSED, 1e-7, 30.0, 1e-9),
}


def pull(t, x):
    return -x


def with_kernel(kernel, m=1):
    return hd.Equation([hd.Caputo(2), hd.Memory(kernel, m)], pull, [1.0, 0.0])


def solved(kernel, t_end=T, m=1, **way):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.KernelWarning)
        return hd.solve(with_kernel(kernel, m), t_end, **way)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", KERNELS)
def test_all_ways_give_the_closed_forms_solution(name, way):
    sol, exact = solved(KERNELS[name](), **WAYS[way]), solved(CLOSED, **WAYS[way])
    assert sol.success
    error = np.abs(sol.y[-1] - exact.y[-1]).max()
    # lines in log K between data err by (0.042**2 / 8) d^2 log K / d (log t)^2
    known = {"function": 1e-8, "table": 4e-4, "sum": 1e-7}[name]
    assert error < (2e-5 if way == "rtol" and name != "table" else known)


@pytest.mark.filterwarnings("ignore::hereditary.KernelWarning")
@pytest.mark.parametrize("way", ["default", "rtol"])
@pytest.mark.parametrize("first", [1e-6, 3e-2])
def test_a_table_of_a_power_law_is_one_wherever_it_begins(first, way):
    t = np.geomspace(first, 1e3, 150)
    orders = [hd.Memory(hd.Kernel.from_table(t, t**-0.5), 1), hd.Memory(hd.PowerLaw(0.5), 1)]
    table, exact = (
        hd.solve(hd.Equation([hd.Caputo(1), order], pull, 1.0), T, **WAYS[way]) for order in orders
    )
    assert abs(table.y[-1, 0] - exact.y[-1, 0]) < (1e-8 if way == "default" else 1e-5)


def test_a_few_data_of_an_exponential_are_that_exponential():
    t = np.geomspace(1e-3, 100, 60)
    table, exact = (
        solved(kernel, n_steps=1000)
        for kernel in (hd.Kernel.from_table(t, np.exp(-t / 10)), hd.Prony([0.1], [1.0]))
    )
    # the first step's integral is that of the power laws between the data
    assert abs(table.y[-1, 0] - exact.y[-1, 0]) < 1e-4
    assert table.stats["kernel_error"] < 1.05e-10  # the tolerance, and 5 per cent between points


COMPLETELY_MONOTONE = {
    "tempered": lambda t: np.exp(-t) / np.sqrt(t),
    "power and decay": lambda t: t**-0.5 + np.exp(-2 * t),
    "by differences": lambda t: (1 - np.exp(-t)) / t,  # rounding makes it rise at small t
}
OTHERS = {
    "rising before the first of few steps": lambda t: t * np.exp(-1000 * t),
    "negative": lambda t: np.exp(-t) - 0.4 * np.exp(-t / 3),
    "Gaussian": lambda t: np.exp(-(t**2)),
}


@pytest.mark.parametrize("n_steps", [10, 5000, 10_000, 10**7])
def test_whether_a_kernel_is_accepted_does_not_depend_on_the_steps(n_steps):
    for function in COMPLETELY_MONOTONE.values():
        fit = hd.Kernel(function).closest_fit(T / n_steps, T, 1e-10)
        t = np.geomspace(T / n_steps, T, 5001)
        size = np.maximum(function(t), 1e-3 * hd.Kernel(function).integral(t) / t)
        assert (np.abs(fit(t) - function(t)) / size).max() < 1.1e-10
    for function in OTHERS.values():
        with pytest.raises(ValueError, match=r"kernel must be completely monotone .* signed=True"):
            hd.Kernel(function).closest_fit(T / n_steps, T, 1e-10)


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_a_tempered_power_law_by_values_keeps_the_tolerance(rtol):
    own, closed = (
        hd.Equation(hd.Caputo(2) + 0.25 * hd.Memory(kernel, 1), pull, [0.2, 0.3])
        for kernel in (hd.Kernel(COMPLETELY_MONOTONE["tempered"]), hd.TemperedPowerLaw(0.5, 1.0))
    )
    sol, exact = hd.solve(own, T, rtol=rtol), hd.solve(closed, T, rtol=1e-11)
    assert sol.success
    assert abs(sol.y[-1] - exact.y[-1]) < rtol
    assert sol.stats["kernel_error"] < rtol


def rippled(t):
    """A kernel that no sum of decays follows: its slope turns, by 1e-7 of itself."""
    return np.exp(-np.sqrt(t)) * (1 + 1e-7 * np.sin(20 * np.sqrt(t)))


@pytest.mark.parametrize("way", ["default", "rtol"])
def test_the_note_is_not_below_the_error(way):
    """Between dense times, of a function that no sum follows to 1e-13."""
    kernel, how = KERNELS["function"](), dict(WAYS[way])
    if way == "default":
        kernel = hd.Kernel(rippled)
        how["n_steps"], how["history"] = 100_000, hd.SumOfExponentials(tol=1e-13)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sol = hd.solve(with_kernel(kernel), T, **how)
    told = sol.stats["kernel_error"]
    fit = kernel.closest_fit(1e-4, T, 1e-13)
    t = np.geomspace(1e-4, T, 20_001)
    if way == "default":
        error = np.abs(fit(t) / rippled(t) - 1).max()
        assert 1e-13 < error <= told < 2 * error
        assert [w.category for w in caught] == [hd.KernelWarning]
        assert caught[0].filename == __file__
    else:
        assert 0 < told < 1e-4
        assert not caught


def test_noise_is_told_before_the_run():
    noise = 1 + 0.01 * np.random.default_rng(1).standard_normal(TIMES.size)
    kernel = hd.Kernel.from_table(TIMES, CLOSED(TIMES) * noise)
    with pytest.warns(hd.KernelWarning, match="a kernel differs by up to .*e-02"):
        sol = hd.solve(with_kernel(kernel), T, 1000)
    assert sol.success
    assert 0.01 < sol.stats["kernel_error"] < 0.06
    assert abs(sol.y[-1, 0] - solved(CLOSED, n_steps=1000).y[-1, 0]) < 0.01


@pytest.mark.parametrize("way", ["default", "rtol"])
def test_a_table_that_rises_first_is_no_success(way):
    """No positive sum rises; noise of a table stays below a tenth."""
    t = np.geomspace(1e-3, T, 200)
    eq = with_kernel(hd.Kernel.from_table(t, t * np.exp(-t)))
    with pytest.warns(hd.SolveWarning, match="a memory kernel is less accurate"):
        sol = hd.solve(eq, T, **WAYS[way])
    assert sol.status == "kernel_inaccurate"
    assert sol.stats["kernel_error"] > 0.1


def wavy(t):
    """A kernel from which decaying exponentials differ by 1e-3 at the least."""
    return np.exp(-np.sqrt(t)) * (1 + 1e-3 * np.sin(20 * np.sqrt(t)))


@pytest.mark.parametrize("way", ["default", "rtol"])
@pytest.mark.parametrize("events", [None, lambda t, x: x[0] - 0.5])
def test_a_run_whose_kernel_misses_its_tolerance_is_no_success(way, events):
    eq = with_kernel(hd.Kernel(wavy))
    if events:
        events.terminal = True
    with pytest.warns(hd.SolveWarning, match=r"differs by up to .*e-03, more than") as caught:
        sol = hd.solve(eq, T, events=events, **WAYS[way])
    assert len(caught) == 1
    assert sol.status == "kernel_inaccurate"
    assert not sol.success
    assert sol.stats["kernel_error"] > 1e-3
    assert bool(events) == (sol.t[-1] < T)
    if way == "default":
        assert hd.solve(eq, T, events=events, **WAYS["Direct"]).success


@pytest.mark.parametrize("way", ["default", "rtol"])
def test_ensembles_and_exponents_say_that_a_kernel_misses_its_tolerance(way):
    memory = hd.Memory(hd.Kernel(wavy), 1)
    eq = hd.Equation([hd.Caputo(2), memory], lambda t, x, p: -p[0] * x, [1.0, 0.0], params=[1.0])
    with pytest.warns(hd.SolveWarning, match="2 kernel_inaccurate"):
        members = hd.ensemble(eq, T, params=[1.0, 2.0], **WAYS[way])
    assert not members.success.any()
    assert "differs by up to" in members.messages[0]
    scheme = hd.Collocation() if way == "rtol" else None
    with pytest.warns(hd.SolveWarning, match="differs by up to"):
        found = hd.lyapunov(eq, T, scheme=scheme, **WAYS[way])
    assert found.status == "kernel_inaccurate"
    assert not found.success


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["table", "sum"])
def test_runs_beyond_what_is_known_are_refused(name, way):
    kernel = KERNELS[name]()
    with pytest.raises(ValueError, match=r"t_end must stay within t = 30.* got 31;"):
        solved(kernel, 31.0, **WAYS[way])
    # whole blocks, and fewer steps than fill one, may look beyond
    few = {**WAYS[way]} if way == "rtol" else {**WAYS[way], "n_steps": 20}
    assert solved(kernel, 30.0, **few).t[-1] == pytest.approx(30.0)


@pytest.mark.parametrize("way", ["default", "rtol"])
def test_runs_resume_as_far_as_their_horizon(way):
    kernel, how = KERNELS["function"](), WAYS[way]
    short = solved(kernel, **how)
    scheme = {"scheme": hd.Collocation(horizon=2 * T)} if way == "rtol" else {}
    far = {"history": hd.SumOfExponentials(horizon=2 * T)} if way == "default" else {}
    again = {key: value for key, value in how.items() if key != "n_steps"}
    with pytest.raises(ValueError, match=r"resume must stay within .*horizon="):
        solved(kernel, 2 * T, resume=short.state, **again)
    long = solved(kernel, **how, **scheme, **far)
    later = solved(kernel, 2 * T, resume=long.state, **again, **scheme, **far)
    twice = {**how, "n_steps": 2000} if way == "default" else how
    through = solved(kernel, 2 * T, **twice, **scheme, **far)
    np.testing.assert_allclose(later.y[-1], through.y[-1], rtol=0, atol=1e-5 if scheme else 0)


@pytest.mark.parametrize("way", ["default", "Direct", "rtol"])
def test_what_a_kernels_function_raises_is_told_as_its_own(way):
    def broken(t):
        if np.any(np.asarray(t) > 3.0):
            raise ZeroDivisionError("no")
        return np.exp(-t)

    kernel = hd.Kernel(broken)
    with pytest.raises(ValueError, match=r"function must .* got ZeroDivisionError at t = .*: no"):
        solved(kernel, **WAYS[way])


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.filterwarnings("ignore::hereditary.KernelWarning")
@pytest.mark.parametrize("seed", range(4))
def test_a_table_that_rhs_reads_acts_as_the_term_of_it(seed):
    """The sum of exponentials misses the drawn table by more than the tightest tolerance."""
    random = np.random.default_rng(seed)
    t, power, rate = np.geomspace(1e-3, 4.9, 40), random.uniform(0.1, 0.6), random.uniform(0.3, 2)
    noise = 1 + random.choice([0.0, 1e-5]) * random.normal(size=t.size)
    table = hd.Kernel.from_table(t, t**-power * np.exp(-rate * t) * noise)
    order = hd.Caputo((1.0, random.uniform(0.6, 1.0))[seed % 2])

    read = hd.Equation(order, lambda t, y, m: -y - 0.8 * m[0], 1.0, memory=hd.Memory(table, 0))
    term = hd.Equation(order + 0.8 * hd.Memory(table, 0), lambda t, y: -y, 1.0)
    for rtol in (1e-4, 1e-7, 1e-10):
        found, exact = (hd.solve(each, 4.8, rtol=rtol) for each in (read, term))
        error = found.stats["kernel_error"]
        assert found.success
        assert found.t[-1] == 4.8
        assert abs(found(exact.t) - exact.y).max() < rtol + 1e-2 * error
    assert error > 1e-10


def test_the_derivative_of_a_table_that_rhs_reads_names_the_way_out():
    t = np.geomspace(1e-3, 4.9, 40)
    table = hd.Kernel.from_table(t, t**-0.4 * np.exp(-t))
    read = hd.Equation(hd.Caputo(0.7), lambda t, y, m: -y - m[0], 1.0, memory=hd.Memory(table, 1))
    with pytest.warns(hd.SolveWarning, match=r"rougher at the start than the tolerance"):
        assert not hd.solve(read, 4.8, rtol=1e-4).success
    smooth = hd.fit_exponentials(table, t[0], t[-1], 1e-4)
    assert hd.solve(read.replace(memory=hd.Memory(smooth, 1)), 4.8, rtol=1e-10).success
