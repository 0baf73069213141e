"""Viscoelastic models: closed forms, thermodynamic limits, responses, fits, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymittagleffler import mittag_leffler
from scipy.special import gamma

import hereditary as hd
from hereditary import viscoelastic as ve
from hereditary.viscoelastic import SpringPot, dashpot, spring

T = np.geomspace(1e-6, 1e6, 25)


def decaying(order, time, t):
    """E_order(-(t/time)**order)."""
    return mittag_leffler(-((t / time) ** order), order, 1.0).real


CREEP = {
    "spring-pot": (SpringPot(2.0, 0.3), lambda t: t**0.3 / 2 / gamma(1.3)),
    "Maxwell": (
        ve.maxwell(SpringPot(2.0, 0.8), SpringPot(3.0, 0.3)),
        lambda t: t**0.8 / 2 / gamma(1.8) + t**0.3 / 3 / gamma(1.3),
    ),
    "Kelvin-Voigt": (
        ve.kelvin_voigt(spring(2.0), SpringPot(6.0, 0.4)),
        lambda t: (1 - decaying(0.4, 3**2.5, t)) / 2,
    ),
    "Poynting-Thomson": (
        ve.poynting_thomson(spring(4.0), spring(2.0), SpringPot(2.0, 0.7)),
        lambda t: 0.25 + (1 - decaying(0.7, 1.0, t)) / 2,
    ),
    "Burgers": (
        ve.burgers(spring(4.0), dashpot(5.0), spring(2.0), SpringPot(2.0, 0.7)),
        lambda t: 0.25 + t / 5 + (1 - decaying(0.7, 1.0, t)) / 2,
    ),
}
RELAXATION = {
    "spring-pot": (SpringPot(2.0, 0.3), lambda t: 2 * t**-0.3 / gamma(0.7)),
    "Maxwell": (
        ve.maxwell(SpringPot(2.0, 0.8), SpringPot(3.0, 0.3)),
        lambda t: 3 * t**-0.3 * mittag_leffler(-1.5 * t**0.5, 0.5, 0.7).real,
    ),
    "Kelvin-Voigt": (
        ve.kelvin_voigt(spring(2.0), SpringPot(6.0, 0.4)),
        lambda t: 2 + 6 * t**-0.4 / gamma(0.6),
    ),
    "Zener": (
        ve.zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.6)),
        lambda t: 1 + 4 * decaying(0.6, 1.0, t),
    ),
    "Jeffreys": (
        ve.parallel(dashpot(0.5), ve.maxwell(spring(4.0), SpringPot(4.0, 0.6))),
        lambda t: 4 * decaying(0.6, 1.0, t),
    ),
}


@pytest.mark.parametrize("name", CREEP)
def test_creep(name):
    model, known = CREEP[name]
    assert np.abs(model.creep(T) / known(T) - 1).max() < 2e-10  # what 1 - E loses at 1e-6
    assert np.abs(model.creep(T) / known(T) - 1)[12:].max() < 1e-12


@pytest.mark.parametrize("name", RELAXATION)
def test_relaxation(name):
    model, known = RELAXATION[name]
    assert np.abs(model.relaxation(T) / known(T) - 1).max() < 1e-12


def test_moduli():
    storage, loss = ve.maxwell(spring(3.0), dashpot(6.0)).moduli(0.7)
    assert storage == pytest.approx(3 * 1.4**2 / (1 + 1.4**2), rel=1e-14)
    assert loss == pytest.approx(3 * 1.4 / (1 + 1.4**2), rel=1e-14)


ELEMENTS = st.builds(
    SpringPot,
    st.floats(-2.0, 2.0).map(lambda x: 10**x),
    st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.1, 0.9)),
)
MODELS = st.recursive(
    ELEMENTS,
    lambda parts: st.builds(
        lambda join, some: join(*some),
        st.sampled_from([ve.series, ve.parallel]),
        st.lists(parts, min_size=2, max_size=3),
    ),
    max_leaves=6,
)


@settings(deadline=None, max_examples=60)
@given(MODELS)
def test_thermodynamic_limits(model):
    """Moduli are not negative, G falls, J rises, and G J stays between the classical bounds."""
    t = np.geomspace(1e-8, 1e8, 60)
    storage, loss = model.moduli(1 / t)
    size = np.abs(storage + 1j * loss)
    assert np.all(storage >= -1e-13 * size)
    assert np.all(loss >= -1e-13 * size)
    (viscosity, _), (compliance, _) = model._split(np.ones(1, dtype=complex))
    relaxation, creep = model.relaxation(t), model.creep(t)
    mean = np.abs(model.stiffness(1 / t))  # of G from 0 to t, up to a factor of 3
    assert np.all(relaxation >= -1e-12 * mean)
    assert np.all(np.diff(relaxation) <= 1e-12 * mean[:-1])
    assert np.all(np.diff(creep) >= -1e-12 * creep[1:])
    assert np.all(relaxation * creep <= 1 + 1e-12)
    assert viscosity == 0 or compliance == 0
    if compliance:
        early = model.relaxation(1e-290)
        assert early == pytest.approx(1 / compliance, rel=1e-10)


def test_limits_of_a_solid():
    solid = ve.zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.6))
    assert solid.relaxation(1e-30) == pytest.approx(5.0, rel=1e-12)
    assert solid.relaxation(1e30) == pytest.approx(1.0, rel=1e-12)
    assert solid.creep(1e-30) == pytest.approx(0.2, rel=1e-12)
    assert solid.creep(1e30) == pytest.approx(1.0, rel=1e-12)


def unit(t, y):
    return 1.0


def waves(t, y):
    return 0.5 * np.cos(2 * t)


RESPONSES = {
    **{name: model for name, (model, _) in (CREEP | RELAXATION).items()},
    "classical Kelvin-Voigt": ve.kelvin_voigt(spring(2.0), dashpot(3.0)),
    "classical Maxwell": ve.maxwell(spring(2.0), dashpot(3.0)),
    "spring": spring(2.0),
    "dashpot": dashpot(2.0),
}


@pytest.mark.parametrize("name", RESPONSES)
def test_strain_after_a_step_of_the_stress(name):
    model = RESPONSES[name]
    found = hd.solve(model.strain_equation(unit), 3.0, rtol=1e-7)
    assert found.success
    t = np.array([0.01, 0.5, 3.0])
    assert np.abs(found(t)[:, 0] / model.creep(t) - 1).max() < 1e-7


@pytest.mark.parametrize("name", RESPONSES)
def test_stress_of_a_large_oscillation(name):
    model = RESPONSES[name]
    found = hd.solve(model.stress_equation(waves), 9.0, rtol=1e-7)
    assert found.success
    t = np.array([1.0, 5.0, 9.0])
    known = hd.derivative(t, lambda s: 0.25 * np.sin(2 * s), model.operator)
    assert np.abs(found(t)[:, 0] - known).max() < 1e-7 * np.abs(known).max()


@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
@pytest.mark.parametrize("order", [0.05, 0.87, 0.95, 0.99])
def test_spring_pots_of_any_order_have_both_equations(order, rtol):
    model = SpringPot(0.9, order)
    stress = hd.solve(model.stress_equation(unit), 3.0, rtol=rtol)
    known = 0.9 * 3.0 ** (1 - order) / gamma(2 - order)
    assert stress.success
    assert stress.y[-1, 0] == pytest.approx(known, rel=rtol)
    strain = hd.solve(model.strain_equation(unit), 3.0, rtol=rtol)
    assert strain.y[-1, 0] == pytest.approx(model.creep(3.0), rel=rtol)


def symbol(term, s):
    """Factor of a term on exp(s t)."""
    operator = term.operator
    if isinstance(operator, hd.Caputo):
        return term.coefficient * s**operator.order
    return term.coefficient * s * operator.kernel.laplace(s)


@pytest.mark.parametrize("join", [ve.parallel, ve.series])
def test_elements_keep_closed_forms(join):
    """Only what has none is a kernel by its transform, and that is one kernel."""
    other = ve.series if join is ve.parallel else ve.parallel
    elements = join(join(spring(2.0), SpringPot(3.0, 0.4)), dashpot(5.0))
    mixed = join(
        elements, other(spring(1.0), SpringPot(1.0, 0.5)), other(spring(2.0), dashpot(1.0))
    )
    s = np.array([0.3, 2.0 + 1.0j])
    for model, n_transforms in ((elements, 0), (mixed, 1)):
        found = model.operator if join is ve.parallel else model.rate_operator
        kernels = [t.operator.kernel for t in found if isinstance(t.operator, hd.Memory)]
        assert len(kernels) - sum(isinstance(k, hd.Prony) for k in kernels) == n_transforms
        wanted = model.stiffness(s) if join is ve.parallel else s / model.stiffness(s)
        assert sum(symbol(term, s) for term in found) == pytest.approx(wanted, rel=1e-13)


def test_oscillations_become_what_the_moduli_say():
    model = ve.zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.9))
    found = hd.solve(model.stress_equation(waves), 60.0, rtol=1e-6)
    storage, loss = model.moduli(2.0)
    t = np.linspace(50.0, 60.0, 30)
    steady = 0.25 * (storage * np.sin(2 * t) + loss * np.cos(2 * t))
    assert np.abs(found(t)[:, 0] - steady).max() < 5e-3


def test_ramps_and_later_steps_superpose():
    model = ve.zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.6))
    stress, strain = (
        hd.solve(equation(lambda t, y: 1.0 if t < 0.7 else 0.0), 4.0, rtol=1e-8, breaks=[0.7])
        for equation in (model.stress_equation, model.strain_equation)
    )
    kernel = hd.kernel_from_laplace(lambda s: model.stiffness(s) / s)
    known = kernel.integral(4.0) - kernel.integral(3.3)
    assert stress.y[-1, 0] == pytest.approx(known, rel=1e-8)
    assert strain.y[-1, 0] == pytest.approx(model.creep(4.0) - model.creep(3.3), rel=1e-7)


def test_a_mass_on_a_model_swings():
    model = ve.kelvin_voigt(spring(3.0), SpringPot(0.5, 0.6))
    terms = 2.0 * hd.Caputo(2) + model.operator
    found = hd.solve(hd.Equation(terms, lambda t, x: 0.0 * x, [0.0, 1.0]), 8.0, rtol=1e-8)
    known = hd.exact.several_terms([2.0, 0.6], [2.0, 0.5], [0.0, 1.0], rate=3.0)(8.0)
    assert found.y[-1, 0] == pytest.approx(known[0], abs=1e-7)


# Frequencies, storage and loss moduli, and the fit to them, as RHEOS.jl publishes them.
DATA = np.array(
    [
        (0.091160329, 0.828556819, 0.149921737),
        (0.304963687, 0.862943457, 0.142491695),
        (0.77022935, 0.898757203, 0.151197212),
        (4.24686265, 0.974905392, 0.182173688),
        (9.175279817, 1.036221356, 0.210393172),
        (29.44212077, 1.124016346, 0.313294598),
        (103.7540299, 1.244293227, 0.552659563),
        (309.5187241, 1.494145654, 1.070122282),
        (1003.289067, 3.170324762, 1.871798151),
    ]
).T
PUBLISHED = {"c_a": 0.009444444, "a": 0.76694686, "c_b": 0.91477855, "b": 0.09972298}


def two_spring_pots(c_a, a, c_b, b):
    return ve.kelvin_voigt(SpringPot(c_a, a), SpringPot(c_b, b))


def cost(model):
    return np.sum(np.log(np.array(model.moduli(DATA[0])) / DATA[1:]) ** 2)


def test_fit_of_moduli():
    guess = {"c_a": 0.1, "a": 0.5, "c_b": 1.0, "b": 0.2}
    orders = {"a": (0, 1), "b": (0, 1)}
    found = ve.fit_moduli(two_spring_pots, *DATA, guess, bounds=orders)
    assert found.success
    assert found.residuals.shape == (2, 9)
    for name, value in PUBLISHED.items():
        assert abs(found.parameters[name] - value) < 0.1 * found.standard_errors[name]
    assert np.sum(found.residuals**2) <= cost(two_spring_pots(**PUBLISHED))
    exact = two_spring_pots(**PUBLISHED).moduli(DATA[0])
    found = ve.fit_moduli(two_spring_pots, DATA[0], *exact, guess, bounds=orders)
    assert found.parameters == pytest.approx(PUBLISHED, rel=1e-6)


def test_fit_of_creep():
    def body(modulus, order):
        model = ve.kelvin_voigt(spring(2.0), SpringPot(modulus, order))
        return model.strain_equation(lambda t, strain, p: p[0], [3.0])

    t = np.linspace(0.2, 6.0, 8)
    data = 3 * ve.kelvin_voigt(spring(2.0), SpringPot(6.0, 0.4)).creep(t)
    guess = {"modulus": 4.0, "order": 0.6}
    found = hd.fit(body, t, data, guess, bounds={"order": (0.1, 1.0)}, rtol=1e-5)
    assert found.parameters == pytest.approx({"modulus": 6.0, "order": 0.4}, rel=1e-4)


# a model, its parameters and a first guess
FITTED = {
    "Zener": (
        lambda e, g, m, a: ve.zener(spring(e), spring(g), SpringPot(m, a)),
        {"e": 1.0, "g": 4.0, "m": 4.0, "a": 0.6},
        {"e": 0.5, "g": 2.0, "m": 2.0, "a": 0.5},
    ),
    "Burgers": (
        lambda e, v, g, w: ve.burgers(spring(e), ve.dashpot(v), spring(g), ve.dashpot(w)),
        {"e": 3.0, "v": 50.0, "g": 5.0, "w": 20.0},
        {"e": 1.0, "v": 20.0, "g": 2.0, "w": 10.0},
    ),
}


@pytest.mark.parametrize("response", ["relaxation", "creep"])
@pytest.mark.parametrize("name", FITTED)
def test_fits_of_responses(name, response):
    """Exact data give the parameters; errors of 1 % move them by some standard errors."""
    (model, true, guess), fit = FITTED[name], getattr(ve, f"fit_{response}")
    t, bounds = np.geomspace(1e-2, 60.0, 40), {"a": (0, 1)} if name == "Zener" else None
    data = getattr(model(**true), response)(t)
    found = fit(model, t, data, guess, bounds=bounds)
    assert found.success
    assert found.parameters == pytest.approx(true, rel=1e-6)
    assert found.residuals.shape == t.shape
    noise = np.random.default_rng(0).normal(size=t.size)
    found = fit(model, t, data * np.exp(0.01 * noise), guess, bounds=bounds)
    for part, value in true.items():
        assert abs(found.parameters[part] - value) < 4 * found.standard_errors[part]
        assert found.standard_errors[part] < 0.2 * value
    assert np.array_equal(found.model.relaxation(t), model(**found.parameters).relaxation(t))


@settings(deadline=None, max_examples=12)
@given(MODELS, st.floats(-3.0, 3.0), st.sampled_from(["relaxation", "creep"]))
def test_many_rows_are_polynomials_through_few(model, decade, response):
    """They differ from inverse transforms by rounding of the mean from 0 to t."""
    t = np.geomspace(1.0, 40.0, 700) * 10**decade
    calls = []

    class Counted(ve.Model):
        def _split(self, s):
            calls.append(s.size)
            return model._split(s)

    known, mean = getattr(model, response)(t), np.abs(model.stiffness(1 / t))
    size = mean if response == "relaxation" else known
    (found,) = ve._curve(response, Counted(), t)
    assert sum(calls) < 200 * 54
    assert np.all(np.abs(found - known) <= 1e-11 * size.max())


def test_an_order_at_its_bound_is_told():
    t, noise = np.linspace(0.1, 5.0, 60), np.random.default_rng(3).normal(size=(2, 60))
    true = ve.maxwell(spring(2.0), dashpot(3.0))
    measured = np.array(true.moduli(t)) * np.exp(0.01 * noise)

    def model(g, v, a):
        return ve.maxwell(spring(g), SpringPot(v, a))

    guess, bounds = {"g": 1.0, "v": 1.0, "a": 0.7}, {"a": (0, 0.9)}
    found = ve.fit_moduli(model, t, *measured, guess, bounds=bounds)
    assert found.at_bound == ["a"]
    assert "At a bound: a." in found.message
    assert "a = 0.9 (at a bound)" in repr(found)
    assert len(repr(found)) < 250
    assert "nan" not in repr(found)
    assert np.isnan(found.intervals()["a"]).all()
    assert np.isnan(found.correlation[2, :2]).all()


def test_confidence_intervals_hold_true_values_as_often_as_they_say():
    """The bounds are four standard deviations of the binomial law, of correlated pairs."""
    true, t = {"modulus": 2.0, "order": 0.4}, np.geomspace(0.1, 10.0, 6)
    data, rng, held = SpringPot(**true).relaxation(t), np.random.default_rng(5), 0
    for _ in range(100):
        drawn = data * np.exp(0.02 * rng.normal(size=t.size))
        found = ve.fit_relaxation(SpringPot, t, drawn, {"modulus": 1.0, "order": 0.5})
        for name, (low, high) in found.intervals(0.8).items():
            held += low <= true[name] <= high
    assert 200 * 0.8 - 33 < held < 200 * 0.8 + 33
    assert found.freedom == 4
    spread = np.sqrt(np.diag(found.covariance))
    assert spread == pytest.approx(list(found.standard_errors.values()))
    assert np.diag(found.correlation) == pytest.approx([1.0, 1.0])
    with pytest.raises(ValueError, match="confidence must lie in"):
        found.intervals(1.0)


def test_parameters_that_data_do_not_determine_have_no_errors():
    """A spring in parallel with another changes the sum alone."""

    def model(e, g, viscosity):
        return ve.parallel(spring(e), spring(g), ve.maxwell(spring(1.0), ve.dashpot(viscosity)))

    t, guess = np.geomspace(0.1, 10.0, 20), {"e": 1.0, "g": 2.0, "viscosity": 1.0}
    data = model(2.0, 2.0, 3.0).relaxation(t) * (1 + 0.01 * np.sin(9 * t))
    with pytest.warns(hd.IdentifiabilityWarning, match="do not tell e and g"):
        found = ve.fit_relaxation(model, t, data, guess)
    assert np.isnan([found.standard_errors["e"], found.standard_errors["g"]]).all()
    assert found.parameters["e"] + found.parameters["g"] == pytest.approx(4.0, rel=0.05)
    assert 0 < found.standard_errors["viscosity"] < 0.2 * found.parameters["viscosity"]


@pytest.mark.parametrize("pascals", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("response", ["moduli", "relaxation", "creep"])
def test_fits_find_moduli_in_any_unit_from_guesses_of_one(response, pascals):
    def solid(alone, beside, damping, order):
        return ve.zener(spring(alone), spring(beside), SpringPot(damping, order))

    true = {"alone": pascals, "beside": 4 * pascals, "damping": 2 * pascals, "order": 0.47}
    at, guess = np.geomspace(1e-2, 1e2, 20), dict.fromkeys(true, 1.0) | {"order": 0.5}
    noise = np.exp(0.02 * np.random.default_rng(4).normal(size=(2, 20)))
    values = (
        np.atleast_2d(getattr(solid(**true), response)(at)) * noise[: 1 + (response == "moduli")]
    )
    found = getattr(ve, f"fit_{response}")(solid, at, *values, guess, bounds={"order": (0, 1)})
    assert found.success
    for name, value in true.items():
        assert abs(found.parameters[name] - value) < 4 * found.standard_errors[name]
        assert found.standard_errors[name] < 0.3 * value
