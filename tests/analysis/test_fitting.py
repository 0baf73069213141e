"""Fits: true parameters are found, and known as well as their standard errors say."""

import warnings

import matplotlib
import numpy as np
import pytest

import hereditary as hd
from hereditary import exact

matplotlib.use("Agg")
T = np.linspace(0.1, 5.0, 30)


def decay(t, y, p):
    return -p[0] * y


def relaxation(alpha, rate):
    return hd.Equation(hd.Caputo(alpha), decay, 1.0, params=[rate])


def oscillator(beta, stiffness, x0=1.0):
    terms = hd.Caputo(beta) + 0.3 * hd.Caputo(0.6)
    return hd.Equation(terms, lambda t, x, p: -p[0] * x, [x0, 0.0], params=[stiffness], d=1)


def measured(alpha=0.7, rate=1.5, t=T, noise=0.0, seed=0):
    y = exact.relaxation(alpha, rate)(t)[:, 0]
    return y + noise * np.random.default_rng(seed).normal(size=y.size)


GUESS = {"alpha": 0.9, "rate": 1.0}
BOUNDS = {"alpha": (0.1, 1.0)}


def test_exact_data_give_back_the_parameters():
    found = hd.fit(relaxation, T, measured(), GUESS, bounds=BOUNDS)
    assert found.success
    assert found.parameters == pytest.approx({"alpha": 0.7, "rate": 1.5}, abs=1e-6)
    assert max(found.standard_errors.values()) < 1e-6
    assert np.abs(found.residuals[0]).max() < 1e-7
    assert found.solutions[0].t.tolist() == T.tolist()


def test_standard_errors_are_those_of_many_trials():
    """Spread of estimates and stated errors agree within the scatter of 40 trials."""
    noise, values, errors = 0.02, [], []
    for seed in range(40):
        data = measured(noise=noise, seed=seed)
        found = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, rtol=1e-6)
        values.append(list(found.parameters.values()))
        errors.append(list(found.standard_errors.values()))
    spread, stated = np.std(values, axis=0, ddof=1), np.mean(errors, axis=0)
    assert np.all(np.abs(spread / stated - 1) < 0.35)
    assert np.all(np.abs(np.mean(values, axis=0) - [0.7, 1.5]) < 4 * stated / np.sqrt(40))


def test_sigma_weighs_and_scales():
    """Data of a tenth of the deviation count a hundred times; given deviations are believed."""
    data, sigma = measured(noise=0.02), np.full(T.size, 0.02)
    free = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS)
    given = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, sigma=0.02)
    twice = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, sigma=2 * sigma)
    assert given.parameters == pytest.approx(free.parameters, rel=1e-5)
    for name, error in given.standard_errors.items():
        assert twice.standard_errors[name] == pytest.approx(2 * error, rel=1e-3)
    wrong = data + np.where(T > 3, 0.5, 0.0)
    sigma = np.where(T > 3, 1e3, 0.02)
    spared = hd.fit(relaxation, T, wrong, GUESS, bounds=BOUNDS, sigma=sigma)
    part = hd.fit(relaxation, T[T <= 3], data[T <= 3], GUESS, bounds=BOUNDS)
    assert spared.parameters == pytest.approx(part.parameters, abs=1e-4)


def test_missing_values_are_left_out():
    data = measured(noise=0.01)
    gaps = np.where(np.arange(T.size) % 3 == 0, np.nan, data)
    here = np.isfinite(gaps)
    found = hd.fit(relaxation, T, gaps, GUESS, bounds=BOUNDS)
    less = hd.fit(relaxation, T[here], data[here], GUESS, bounds=BOUNDS)
    masked = np.ma.array(np.where(here, data, 1e3), mask=~here)
    assert hd.fit(relaxation, T, masked, GUESS, bounds=BOUNDS).parameters == found.parameters
    assert found.parameters == pytest.approx(less.parameters, abs=1e-6)
    weighed = hd.fit(relaxation, T, gaps, GUESS, bounds=BOUNDS, sigma=0.1 * gaps)
    alone = hd.fit(relaxation, T[here], data[here], GUESS, bounds=BOUNDS, sigma=0.1 * data[here])
    assert weighed.standard_errors == pytest.approx(alone.standard_errors, rel=1e-3)
    assert np.array_equal(np.isnan(found.residuals[0][:, 0]), ~here)


def test_an_order_crosses_1():
    truth = hd.solve(oscillator(0.9, 1.2), 5.0, rtol=1e-10, t_eval=T)
    found = hd.fit(oscillator, T, truth.y, {"beta": 1.2, "stiffness": 1.0})
    assert found.parameters == pytest.approx({"beta": 0.9, "stiffness": 1.2}, abs=1e-5)


def test_what_is_observed():
    """A function of y, chosen components, a sequence for p0, and steps instead of a tolerance."""

    def model(p):
        return hd.Equation(hd.Caputo([0.7, 0.9]), decay, [1.0, 2.0], params=p)

    y = hd.solve(model([1.5]), 5.0, rtol=1e-10, t_eval=T).y
    total = hd.fit(model, T, y.sum(axis=1), [1.0], observe=lambda y: y.sum(axis=1))
    second = hd.fit(model, T, y[:, 1], [1.0], observe=[1])
    both = hd.fit(model, T, y, [1.0])
    for found in (total, second, both):
        assert found.parameters == pytest.approx({"p0": 1.5}, abs=1e-5)
    stepped = hd.fit(model, T, y, [1.0], n_steps=2000, scheme=hd.BDF(2))
    assert stepped.parameters == pytest.approx({"p0": 1.5}, abs=1e-3)


def test_parameters_that_data_do_not_tell():
    def model(rate, more):
        return relaxation(0.7, rate + more)

    with pytest.warns(hd.IdentifiabilityWarning, match="do not tell rate and more"):
        found = hd.fit(model, T, measured(), {"rate": 1.0, "more": 0.2})
    assert sum(found.parameters.values()) == pytest.approx(1.5, abs=1e-5)
    assert np.all(np.isnan(list(found.standard_errors.values())))


def test_a_parameter_without_effect_leaves_the_others_known():
    def model(rate, idle):
        return relaxation(0.7, rate)

    with pytest.warns(hd.IdentifiabilityWarning, match="do not tell idle"):
        found = hd.fit(model, T, measured(noise=0.01), {"rate": 1.0, "idle": 1.0})
    alone = hd.fit(lambda rate: relaxation(0.7, rate), T, measured(noise=0.01), {"rate": 1.0})
    assert np.isnan(found.standard_errors["idle"])
    ratio = found.standard_errors["rate"] / alone.standard_errors["rate"]
    assert ratio == pytest.approx(1.0, abs=0.02)  # one degree of freedom less


def test_a_parameter_at_its_bound_counts_as_fixed():
    data, asked = measured(noise=0.01), []

    def bounded(alpha, rate):
        asked.append(alpha)
        return relaxation(alpha, rate)

    found = hd.fit(bounded, T, data, GUESS, bounds={"alpha": (0.8, 1.0)}, sigma=0.01)
    assert 0.8 <= min(asked) < max(asked) <= 1.0  # derivatives are taken inside as well
    fixed = hd.fit(lambda rate: relaxation(0.8, rate), T, data, {"rate": 1.0}, sigma=0.01)
    assert found.parameters["alpha"] == pytest.approx(0.8)
    assert np.isnan(found.standard_errors["alpha"])
    assert found.standard_errors["rate"] == pytest.approx(fixed.standard_errors["rate"], rel=1e-3)
    assert "At a bound: alpha" in found.message


@pytest.mark.parametrize("scale", [1e-100, 1e-12, 1e-6, 1e8, 1e60])
def test_the_unit_of_the_data_does_not_matter(scale):
    def model(alpha, rate, y0):
        return relaxation(alpha, rate).replace(y0=y0)

    guess = GUESS | {"y0": 0.8 * scale}
    bounds = BOUNDS | {"y0": (0.1 * scale, 10 * scale)}
    found = hd.fit(model, T, scale * measured(), guess, bounds=bounds)
    assert "bound" not in found.message
    assert found.parameters["alpha"] == pytest.approx(0.7, abs=1e-6)
    assert found.parameters["y0"] == pytest.approx(scale, rel=1e-6)


def test_a_true_value_of_0_has_an_error():
    def gain(t, y, p):
        return p[1] - p[0] * y

    def model(rate, source):
        return hd.Equation(hd.Caputo(0.7), gain, 1.0, params=[rate, source])

    found = hd.fit(model, T, measured(noise=0.01), {"rate": 1.0, "source": 0.1})
    assert abs(found.parameters["source"]) < 3 * found.standard_errors["source"] < 0.05


def test_outliers_are_spared():
    data = measured(noise=0.01)
    data[[5, 20]] += [3.0, -2.0]
    found = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, sigma=0.01, loss="soft_l1")
    assert found.parameters["alpha"] == pytest.approx(0.7, abs=0.03)


@pytest.mark.parametrize("sigma", [None, 1e-6])
def test_runs_that_end_early_are_left_behind(sigma):
    """A first guess that blows up is far from the data, in whatever units."""

    def model(gain):
        return hd.Equation(hd.Caputo(0.9), lambda t, y, p: p[0] * y * y, 1.0, params=[gain])

    t = np.linspace(0.05, 1.0, 20)
    data = hd.solve(model(0.5), 1.0, rtol=1e-9, t_eval=t).y
    with pytest.warns(hd.SolveWarning):
        found = hd.fit(model, t, data, {"gain": 2.5}, sigma=sigma)
    assert found.success
    assert found.parameters["gain"] == pytest.approx(0.5, abs=1e-6)


def test_a_fit_whose_runs_all_fail_says_why():
    def model(rate):
        return hd.Equation(hd.Caputo(0.9), lambda t, y, p: p[0] + y**2, 1.0, params=[rate])

    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        found = hd.fit(model, [5.0, 6.0, 7.0], [1.0, 2.0, 3.0], {"rate": 3.0})
    assert not found.success
    assert found.message == f"the run with these parameters failed: {found.solutions[0].message}"
    assert np.isnan([found.standard_errors["rate"], found.covariance[0, 0]]).all()
    assert not [one for one in given if one.category is hd.IdentifiabilityWarning]


def test_figure_shows_the_model_between_the_data_too():
    data = np.where(np.arange(T.size) == 3, np.nan, measured(noise=0.01))
    found = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, sigma=0.01)
    ax = hd.plots.fit(found)
    t, model = ax.lines[1].get_data()
    assert t.size > 1000
    assert (t[0], t[-1]) == (T[0], T[-1])
    np.testing.assert_allclose(model, measured(*found.parameters.values(), t=t), rtol=0, atol=1e-7)
    assert "alpha 0.7" in ax.get_title()


@pytest.mark.parametrize(
    "observe", [lambda y: y[:, 0] * T, lambda y: -np.diff(y[:, 0], prepend=1.0)]
)
def test_what_is_observed_at_the_times_of_the_data_alone_is_drawn_there(observe):
    data = observe(measured()[:, None])
    found = hd.fit(relaxation, T, data, GUESS, bounds=BOUNDS, observe=observe)
    t, model = hd.plots.fit(found).lines[1].get_data()
    assert np.array_equal(t, T)
    np.testing.assert_allclose(model, data, rtol=0, atol=1e-6)


def hunt(t, y, dy, p):
    dy[0] = y[0] * (p[0] - p[1] * y[1])
    dy[1] = y[1] * (p[2] * y[0] - p[3])


def predators(a, b, c, d, u, v):
    return hd.Equation(hd.Caputo(0.9), hunt, [u, v], params=[a, b, c, d])


@pytest.mark.parametrize("power", [1, 2])
def test_parameters_and_initial_values_share_a_run_with_tangents(power):
    """`max_steps` asks for what tangents do not have, so that each parameter takes a run."""
    true, t = (1.0, 0.8, 0.7, 1.2, 1.0, 0.5), np.linspace(0.2, 10.0, 50)
    data = hd.solve(predators(*true), 10.0, t_eval=t, rtol=1e-10).y ** power
    data += 0.01 * np.random.default_rng(3).normal(size=data.shape)
    guess = dict(zip("abcduv", (0.9, 0.75, 0.65, 1.1, 1.05, 0.52), strict=True))
    ways = {}, {"max_steps": 10_000}
    few, many = (
        hd.fit(predators, t, data, guess, observe=lambda y: y**power, **how) for how in ways
    )
    assert few.success
    assert few.n_runs < many.n_runs / 2
    assert few.parameters == pytest.approx(many.parameters, rel=1e-4)
    assert few.standard_errors == pytest.approx(many.standard_errors, rel=1e-3)


def free(t, y):
    return np.array([-y[0] * y[1], y[0] - y[1]])


def test_initial_values_of_an_equation_without_parameters():
    def started(u, v):
        return hd.Equation(hd.Caputo(0.9), free, [u, v])

    t = np.linspace(0.1, 3.0, 20)
    data = hd.solve(started(1.0, 0.5), 3.0, t_eval=t, rtol=1e-10).y
    found = hd.fit(started, t, data, {"u": 0.8, "v": 0.7})
    assert found.parameters == pytest.approx({"u": 1.0, "v": 0.5}, abs=1e-6)
    assert found.n_runs < 20


def test_parameters_of_several_series():
    """One is shared, one is the initial value of each, and an order takes runs of its own."""

    def both(alpha, rate, first, second):
        return [hd.Equation(hd.Caputo(alpha), decay, y0, params=[rate]) for y0 in (first, second)]

    times = [T, np.linspace(1.0, 8.0, 20)]
    data = [y0 * measured(t=t) for y0, t in zip((1.0, 3.0), times, strict=True)]
    guess = {"alpha": 0.9, "rate": 1.0, "first": 1.2, "second": 2.0}
    found = hd.fit(both, times, data, guess, bounds={"alpha": (0.1, 1.0)})
    true = {"alpha": 0.7, "rate": 1.5, "first": 1.0, "second": 3.0}
    assert found.parameters == pytest.approx(true, abs=1e-6)
    assert [r.shape for r in found.residuals] == [(30, 1), (20, 1)]
    many = hd.fit(both, times, data, guess, bounds={"alpha": (0.1, 1.0)}, max_steps=10_000)
    assert found.n_runs < 0.8 * many.n_runs
