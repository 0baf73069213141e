"""The skeletons in docs/extending.md run as they stand there."""

import importlib.util
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from problems import errors, observed_order, singular_problem, smooth_problem

import hereditary as hd

PAGE = Path(__file__).parent.parent / "docs" / "extending.md"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A module of the page's code."""
    blocks = [block.split("```")[0] for block in PAGE.read_text().split("```python\n")[1:]]
    path = tmp_path_factory.mktemp("extending") / "extensions_of_the_page.py"
    path.write_text("\n\n".join(blocks))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # states of its schemes are pickled
    spec.loader.exec_module(module)
    yield module
    del sys.modules[path.stem]


def oscillator():
    terms = [hd.Caputo(1.6), 0.5 * hd.Caputo(0.7)]
    return hd.Equation(terms, lambda t, y: np.sin(t) - y, [0.2, 0.3])


@pytest.mark.parametrize("theta", [0.75, 1.0])
@pytest.mark.parametrize("alpha", [0.5, 0.6, 0.8])
def test_the_scheme_has_its_order(page, theta, alpha):
    scheme, history = page.Lines(theta), hd.SumOfExponentials(1e-13)
    for problem, kind, which in (
        (smooth_problem(alpha), "smooth", 1),
        (singular_problem(alpha), "singular", 0),
    ):
        steps = [800, 1600, 3200]
        found = [errors(problem, scheme, history, n)[which] for n in steps]
        order = observed_order(steps[1:], found[1:])
        assert order == pytest.approx(scheme.order(alpha, kind), abs=0.15), (kind, found)
        assert found[-1] < 1e-3


def test_the_scheme_is_l1_at_the_end_of_the_step_and_refuses_what_it_does_not_take(page):
    problem = hd.scenes.relaxation(0.6)
    ends = [hd.solve(problem, 1.0, 50, scheme=s).y for s in (page.Lines(1.0), hd.L1())]
    assert np.array_equal(*ends)
    with pytest.raises(ValueError, match=r"order must be at most 1 for Lines\(theta=0.75\)"):
        hd.solve(oscillator(), 1.0, 50, scheme=page.Lines())
    with pytest.raises(ValueError, match="theta must lie in"):
        page.Lines(0.4)
    with pytest.raises(ValueError, match="mesh must be left out with Lines"):
        hd.solve(problem, 1.0, mesh=hd.graded(5, 2.0), scheme=page.Lines())


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.GrunwaldLetnikov()])
def test_the_history_is_direct_where_its_window_covers_the_run(page, scheme):
    n = 300
    runs = [
        hd.solve(oscillator(), 10.0, n, scheme=scheme, history=history, estimate=False).y
        for history in (hd.Direct(), page.Window(n), page.Window(40), page.Window(7))
    ]
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-12)
    for steps, forgets in ((40, runs[2]), (7, runs[3])):
        off = np.abs(forgets - runs[0]).max(axis=1)
        assert off[: steps + 1].max() < 1e-13
        assert off.max() > 1e-3


def test_pairs_of_the_page_resume_bit_for_bit(page):
    problem, how = hd.scenes.relaxation(0.6), (page.Lines(0.6), page.Window(45))
    whole = hd.solve(problem, 2.0, 200, scheme=how[0], history=how[1])
    half = hd.solve(problem, 1.0, 100, scheme=how[0], history=how[1])
    state = pickle.loads(pickle.dumps(half.state))
    assert np.array_equal(hd.solve(problem, 2.0, resume=state).y[-1], whole.y[-1])
