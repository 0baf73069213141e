"""Diffusion with memory on a line or a square."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..equation.operators import Caputo
from ..support.checks import count, one_of, positive, real_array, refuse, shown, within


def subdiffusion(
    alpha: float = 0.7,
    points: int = 100,
    *,
    dimensions: int = 1,
    diffusivity: float = 1.0,
    u0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    source: Callable | None = None,
    params: ArrayLike = (),
) -> Equation:
    """Make a diffusion equation by the method of lines, ``D^alpha u = K Laplace u + source``.

    The domain is the line [0, 1] or the square [0, 1]**2, with u = 0 on the boundary. The equation
    is subdiffusion for alpha below 1, the heat equation at 1, and the diffusion-wave equation up
    to 2. The Laplacian is the second difference on `points` inner points in each direction, of
    second order in their distance ``1 / (points + 1)``. It is the sparse `linear` of the equation.

    Parameters
    ----------
    alpha : float
        Order, 0 < alpha <= 2 [-].
    points : int
        Inner points n in each direction; there are d = n**dimensions components, the last direction
        running fastest.
    dimensions : {1, 2}
    diffusivity : float
        K [length**2 / time**alpha].
    u0, v0 : array_like, shape (n,) or (n, n), optional
        u and, for alpha above 1, its rate at t = 0. By default u0 is the lowest mode,
        ``sin(pi x)`` or ``sin(pi x) sin(pi y)``, and v0 is 0.
    source : callable, optional
        As `rhs` of `Equation`: ``source(t, u)``, of shape (d,). If it couples no points, state this
        by ``.replace(bandwidth=(0, 0))``.
    params : float or sequence of float, optional
        Parameters of the source.

    Returns
    -------
    Equation

    Notes
    -----
    With v0 = 0 and without a source the default u0 decays as ``u0 E_alpha(-rate t**alpha)``, with
    ``rate = K dimensions (2 (n + 1) sin(pi / (2 n + 2)))**2``: the exact solution in time of the
    discrete equation.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> eq = hd.scenes.subdiffusion(0.7, 20, dimensions=2)
    >>> sol = hd.solve(eq, 0.1, 200, scheme=hd.BDF(2), save_every=200)
    >>> rate = 2 * (42 * np.sin(np.pi / 42)) ** 2
    >>> exact = hd.exact.mittag_leffler(-rate * 0.1**0.7, 0.7, 1.0) * eq.y0[0]
    >>> bool(abs(sol.y[-1] - exact).max() < 1e-5)
    True
    """
    alpha = within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
    points = count("points", points)
    dimensions = one_of("dimensions", dimensions, (1, 2), "be 1 or 2")
    shape, places = (points,) * dimensions, np.arange(1, points + 1) / (points + 1)
    wave = np.sin(np.pi * places)
    start = _field("u0", u0, shape, wave if dimensions == 1 else np.outer(wave, wave))
    rows = [start]
    if alpha > 1:
        rows.append(_field("v0", v0, shape, np.zeros(shape)))
    elif v0 is not None:
        refuse("v0", "be left out for alpha up to 1", shown(v0))
    matrix = positive("diffusivity", diffusivity) * _laplacian(points, dimensions)
    return Equation(Caputo(alpha), source, rows, params, linear=matrix)


def _field(
    name: str, values: ArrayLike | None, shape: tuple[int, ...], default: np.ndarray
) -> np.ndarray:
    """Return values on the points as one row."""
    field = default if values is None else real_array(name, values)
    if field.shape != shape:
        refuse(name, f"have shape {shape}", f"shape {field.shape}")
    return field.ravel()


def _laplacian(points: int, dimensions: int) -> Any:
    """Return the second differences on the points, a SciPy CSR array."""
    sparse: Any = importlib.import_module("scipy.sparse")
    stencil, shape = [1.0, -2.0, 1.0], (points, points)
    line = (points + 1) ** 2 * sparse.diags_array(stencil, offsets=[-1, 0, 1], shape=shape)
    if dimensions == 1:
        return line.tocsr()
    unit = sparse.eye_array(points)
    return (sparse.kron(line, unit) + sparse.kron(unit, line)).tocsr()
