"""Scenes of many components: diffusion with memory, the chain of stick-slip blocks."""

import numpy as np
import pytest
from problems import assert_converges
from scipy.special import gamma

import hereditary as hd
from hereditary.exact import mittag_leffler


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize(("alpha", "largest"), [(0.4, 2e-6), (0.7, 4e-6), (1.0, 3e-6), (1.5, 2e-4)])
def test_subdiffusion_decays_as_mittag_and_leffler_say(alpha, largest, dimensions):
    n = 15
    equation = hd.scenes.subdiffusion(alpha, n, dimensions=dimensions, diffusivity=0.1)
    rate = 0.1 * dimensions * (2 * (n + 1) * np.sin(np.pi / (2 * n + 2))) ** 2
    truth = mittag_leffler(-rate * 2.0**alpha, alpha, 1.0) * equation.y0[0]

    def end(steps):
        return hd.solve(equation, 2.0, steps, scheme=hd.BDF(2), save_every=steps).y[-1]

    assert_converges(end, truth, (200, 400), 2.0, largest)
    tight = hd.solve(equation, 2.0, rtol=1e-8)
    assert np.abs(tight.y[-1] - truth).max() < 1e-8


def manufactured(alpha, n):
    """Equation with u = (1 + t**2) x (1 - x) sin(pi y), but for differences in space; that u."""
    x = np.arange(1, n + 1) / (n + 1)
    shape = np.outer(x * (1 - x), np.sin(np.pi * x))
    flat = shape.ravel()
    pushed = np.outer(2 + np.pi**2 * x * (1 - x), np.sin(np.pi * x)).ravel()
    rate = 2 / gamma(3 - alpha)

    def source(t, u):
        return rate * t ** (2 - alpha) * flat + (1 + t * t) * pushed

    return hd.scenes.subdiffusion(alpha, n, dimensions=2, u0=shape, source=source), flat


@pytest.mark.parametrize("alpha", [0.6, 1.4])
def test_subdiffusion_with_a_source_is_second_order_in_space(alpha):
    def off(n):
        equation, flat = manufactured(alpha, n - 1)
        sol = hd.solve(equation, 1.0, 400, scheme=hd.IMEX(hd.BDF(2)), save_every=400)
        return sol.y[-1] - 2 * flat

    assert_converges(off, 0.0, (8, 16), 2.0, 2e-3)


def test_the_jacobian_of_the_chain_is_that_of_differences():
    depths, places = [50.0, 40.0, 30.0, 20.0], np.array([0.2, -3.0, 7.0, 19.0])
    chain = hd.scenes.stick_slip_chain(4, coupling=3.0, omega=1.3, adhesion=depths)
    found, expected = (eq.jacobian(0.3, places) for eq in (chain, chain.replace(jac=None)))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_uncoupled_blocks_are_single_ones():
    places, depths = [0.2, 0.3], [50.0, 40.0]
    chain = hd.scenes.stick_slip_chain(2, coupling=0.0, x0=places, v0=0.3, adhesion=depths)
    together = hd.solve(chain, 10.0, 2000).y
    for j in range(2):
        one = hd.scenes.stick_slip(x0=places[j], v0=0.3, adhesion=depths[j])
        np.testing.assert_allclose(together[:, j], hd.solve(one, 10.0, 2000).y[:, 0], atol=1e-10)


def test_the_middle_of_equal_blocks_moves_as_one():
    chain = hd.scenes.stick_slip_chain(12, coupling=30.0, x0=0.2, v0=0.3)
    one = hd.solve(hd.scenes.stick_slip(), 10.0, 2000).y
    np.testing.assert_allclose(hd.solve(chain, 10.0, 2000).y, one * np.ones(12), atol=1e-9)
    tight = hd.solve(chain, 5.0, rtol=1e-8).y[-1]
    alone = hd.solve(hd.scenes.stick_slip(), 5.0, rtol=1e-8).y[-1, 0]
    np.testing.assert_allclose(tight, np.full(12, alone), rtol=1e-6)


def test_slips_are_moves_that_touch_in_space_and_time():
    moving = np.zeros((9, 5))
    moving[1:3, 0:2] = 1.0  # blocks 0 and 1 between rows 1 and 3
    moving[2, 2] = 1.0
    moving[6, 4] = -2.0
    y = np.vstack([np.zeros(5), np.cumsum(moving, axis=0)])
    sol = hd.Solution(np.arange(10.0), y, None, hd.Status.COMPLETED, "", {}, None)
    found = hd.scenes.slips(sol, speed=0.5)
    assert found.start.tolist() == [1.0, 6.0]
    assert found.end.tolist() == [3.0, 7.0]
    assert (found.first.tolist(), found.last.tolist()) == ([0, 4], [2, 4])
    assert found.size.tolist() == [5.0, 2.0]
    assert hd.scenes.slips(sol, speed=3.0).size.size == 0
    one = hd.Solution(np.zeros(1), y[:1], None, hd.Status.COMPLETED, "", {}, None)
    assert hd.scenes.slips(one).size.size == 0
