"""Tables of errors: observed orders are those of the scheme, Runge's rule finds the errors."""

import numpy as np
import pytest

import hereditary as hd
from hereditary import exact


@pytest.mark.parametrize(
    ("scheme", "order"), [(hd.ExplicitCaputo(), 1.0), (hd.BDF(2), 2.0)], ids=repr
)
def test_runges_rule_finds_the_errors_themselves(scheme, order):
    equation, truth = hd.scenes.relaxation(0.6), exact.relaxation(0.6)
    how = {"scheme": scheme, "at_end": True}
    known = hd.convergence_table(equation, 2.0, [200, 400, 800], exact=truth, **how)
    found = hd.convergence_table(equation, 2.0, [200, 400, 800], **how)
    for table in (known, found):
        assert table.slope == pytest.approx(order, abs=0.15)
        assert np.allclose(table.orders, order, atol=0.15)
    assert np.allclose(found.errors, known.errors, rtol=0.05)
    assert known.h.tolist() == [0.01, 0.005, 0.0025]


def test_errors_at_all_times_are_at_least_those_at_the_end():
    equation, truth = hd.scenes.relaxation(0.6), exact.relaxation(0.6)
    everywhere = hd.convergence_table(equation, 2.0, [100, 200], exact=truth)
    end = hd.convergence_table(equation, 2.0, [100, 200], exact=truth, at_end=True)
    assert np.all(everywhere.errors > 2 * end.errors)


def test_the_table_in_print():
    table = hd.convergence_table(hd.scenes.relaxation(0.6), 2.0, [100, 200], scheme=hd.BDF(2))
    first, second = (f"{error:.3e}" for error in table.errors)
    rows = [f"| 100 | 0.02 | {first} |  |", f"| 200 | 0.01 | {second} | {table.orders[0]:.2f} |"]
    assert table.to_markdown().splitlines()[2:] == rows
    assert table.to_latex().splitlines()[4] == rf"100 & 0.02 & {first} &  \\"
    assert repr(table).splitlines()[-1].endswith("errors by Runge's rule")


def test_errors_of_tolerances():
    """Errors against a finer run are those against the exact solution, and stay below rtol."""
    equation = hd.scenes.van_der_pol(y0=(1.0, 0.5))
    rtol = np.array([1e-3, 1e-5, 1e-7])
    found = hd.convergence_table(equation, 5.0, rtol=rtol)
    size = np.abs(hd.solve(equation, 5.0, rtol=1e-8).y).max()
    assert np.all(found.errors < 10 * rtol * size)
    assert np.all(np.diff(found.n_steps) > 0)
    assert found.slope > 0.5
    assert found.h.tolist() == (5.0 / found.n_steps).tolist()
    assert repr(found).endswith("errors against a run with rtol = 1e-09")
    reference = hd.solve(equation, 5.0, rtol=1e-11)
    known = hd.convergence_table(equation, 5.0, rtol=rtol, exact=reference)
    assert known.errors == pytest.approx(found.errors, rel=0.05, abs=1e-9 * size)
    heads, _, first, *_ = found.to_markdown().splitlines()
    assert heads == "| rtol | N | error | order |"
    assert first.startswith(f"| 0.001 | {found.n_steps[0]} |")
    assert r"rtol & $N$ & error & order \\" in found.to_latex()


def test_a_break_is_a_step():
    equation = hd.Equation(hd.Caputo(0.8), lambda t, y: -y + (1.0 if t >= 1.0 else 0.0), 1.0)
    table = hd.convergence_table(equation, 2.0, rtol=[1e-4, 1e-8], breaks=[1.0])
    assert table.errors[-1] < 1e-7
    with pytest.raises(ValueError, match="breaks must be times of steps"):
        hd.convergence_table(equation, 2.0, [3, 6], breaks=[1.0])


def test_a_run_that_does_not_complete_is_told():
    growing = hd.Equation(hd.Caputo(0.8), lambda t, y: y**2, 5.0)
    with (
        pytest.warns(hd.SolveWarning),
        pytest.raises(RuntimeError, match="100 steps: the solution"),
    ):
        hd.convergence_table(growing, 5.0, [100, 200])
