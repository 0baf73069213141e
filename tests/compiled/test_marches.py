"""Every march, in short runs: with indices checked if numba checks them, and without a leak.

The records of a march count no references (compiled/reference.py). What compiled code allocates by
itself, it releases.
"""

import gc

import numpy as np
import pytest
from numba import config
from numba.core.runtime import _nrt_python, rtsys

import hereditary as hd

pytestmark = pytest.mark.core

MANY, ORDERS = np.linspace(0.5, 1.0, 12), np.linspace(0.6, 0.9, 12)
# Its rates are complex.
SWINGING = hd.Prony([1.0 - 3.0j, 1.0 + 3.0j], [0.5, 0.5])


def decay(order, y0=1.0, **given):
    return hd.Equation(hd.Caputo(order), lambda t, y: -y, y0, **given)


FEW = {
    "one": lambda: decay(0.5),
    "of second order": lambda: decay(1.5, [1.0, 0.0]),
    "two terms": lambda: hd.Equation(hd.Caputo(0.9) + hd.Caputo(0.4), lambda t, y: -y, 1.0),
    "varying": lambda: decay(lambda t: 0.5 + 0.1 * t),
}
# Without a compiler there are no functions of LAPACK.
COMPILED = {
    "given Jacobian": lambda: decay(0.5, jac=lambda t, y: -np.ones((1, 1))),
    "kernel": lambda: hd.Equation(hd.Caputo(1.0) + hd.Memory(SWINGING, 0), lambda t, y: -y, 1.0),
    "many": lambda: decay(0.5, MANY),
    "band": lambda: decay(0.5, MANY, bandwidth=(0, 0)),
    "sparse": lambda: decay(0.5, MANY, jac_sparsity=np.eye(12)),
    "orders": lambda: decay(ORDERS, MANY),
    "orders, band": lambda: decay(ORDERS, MANY, bandwidth=(0, 0)),
    "orders, sparse": lambda: decay(ORDERS, MANY, jac_sparsity=np.eye(12)),
}
KINDS = FEW if config.DISABLE_JIT else FEW | COMPILED


@pytest.fixture(autouse=True, scope="module")
def _frozen():
    """Let collections pass over the objects of earlier tests, which are millions in a whole run."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def allocated():
    """Number of allocations of compiled code that it has not released."""
    _nrt_python.memsys_enable_stats()
    gc.collect()
    counts = rtsys.get_allocation_stats()
    return counts.alloc - counts.free


def several(run):
    """Run a few times, and check that no more is allocated than for two results."""
    first, again = run(), run()
    before = allocated()
    for _ in range(1 if config.DISABLE_JIT else 4):
        again = run()
    assert allocated() <= before
    return first, again


SCHEMES = {
    "explicit": hd.ExplicitCaputo(),
    "implicit": hd.BDF(2),
    "predictor-corrector": hd.Adams(),
}
# What one of these schemes does not take.
REFUSED = {
    "implicit": {"kernel", "varying"},
    "predictor-corrector": {"kernel", "varying", "two terms"},
}
WAYS = {"by a tolerance": {"rtol": 1e-3}} | {
    name: {"n_steps": 80, "scheme": scheme} for name, scheme in SCHEMES.items()
}
MARCHES = [(kind, way) for kind in KINDS for way in WAYS if kind not in REFUSED.get(way, ())]


def solved_twice(equation, how):
    one, other = several(lambda: hd.solve(equation, 0.5, **how))
    assert one.success
    assert np.array_equal(one.y, other.y)


@pytest.mark.parametrize(("name", "way"), MARCHES)
def test_marches(name, way):
    solved_twice(KINDS[name](), WAYS[way])


@pytest.mark.parametrize(("name", "way"), MARCHES)
def test_tangents(name, way):
    equation = KINDS[name]()
    one, other = several(lambda: hd.lyapunov(equation, 0.5, k=1, verify=False, **WAYS[way]))
    assert np.array_equal(one.exponents, other.exponents)


@pytest.mark.parametrize("history", [hd.Direct(), hd.FFT(), hd.SumOfExponentials()], ids=repr)
@pytest.mark.parametrize("way", SCHEMES)
def test_histories_of_marches_on_given_steps(way, history):
    solved_twice(decay(0.5), WAYS[way] | {"history": history})


@pytest.mark.parametrize("history", [hd.Direct(), hd.SumOfExponentials()], ids=repr)
def test_marches_on_meshes(history):
    solved_twice(decay(0.5), {"mesh": hd.graded(40, 2.0), "scheme": hd.L1(), "history": history})


def test_marches_with_a_linear_part():
    how = {"n_steps": 80, "scheme": hd.IMEX(hd.L1())}
    solved_twice(decay(0.5, linear=[[-10.0]]), how)
