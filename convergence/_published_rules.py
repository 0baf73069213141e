"""Published rules in plain NumPy: fractional Adams, product integration, a multistep method.

By the formulas of Diethelm, Ford and Freed and of Garrappa, on uniform steps, all sums in full.
Right-hand sides are f(t, y) with y (d,), initial values rows of d; solutions are (n + 1, d).
"""

from math import factorial

import numpy as np
from scipy.special import gamma


def weights(alpha, n):
    """Weights of product integration: of trapezoids, of their first point, of rectangles.

    Orders may be one for each component.
    """
    k = np.arange(n + 2.0).reshape(-1, *(1 for _ in np.shape(alpha)))
    power, next_power = k**alpha, k ** (alpha + 1)
    inner, first = np.ones_like(power[1:]), np.zeros_like(power[1:])
    inner[1:] = next_power[:-2] - 2 * next_power[1:-1] + next_power[2:]
    first[1:] = next_power[:-2] - power[1:-1] * (k[1:-1] - alpha - 1)
    return inner, first, power[1:] - power[:-1]


def summed(weights, values):
    """Sum of rows by weights, one for all components or one for each."""
    return weights @ values if weights.ndim == 1 else (weights * values).sum(axis=0)


def solved(residual, y):
    """Solve by Newton's method with differences, to rounding."""
    y = np.array(y, dtype=float)
    for _ in range(60):
        value, slopes = residual(y), np.empty((y.size, y.size))
        for j, step in enumerate(1e-7 * np.maximum(1.0, np.abs(y))):
            apart = step * (np.arange(y.size) == j)
            slopes[:, j] = (residual(y + apart) - residual(y - apart)) / (2 * step)
        change = np.linalg.solve(slopes, value)
        y = y - change
        if np.abs(change).max() < 1e-14 * max(1.0, np.abs(y).max()):
            break
    return y


def taylor(t, y0):
    """Taylor polynomial of the initial values."""
    return sum(t**k / factorial(k) * row for k, row in enumerate(y0))


def _begun(f, y0, t_end, n):
    """Times, rows and values of f, of which the first are known, and the initial values."""
    y0 = np.array(y0, dtype=float).reshape(len(y0), -1)
    y, values = np.zeros((n + 1, y0.shape[1])), np.zeros((n + 1, y0.shape[1]))
    y[0], values[0] = y0[0], f(0.0, y0[0])
    return t_end / n * np.arange(n + 1), y, values, y0


def product_integration(kind, alpha, f, y0, t_end, n, corrections=1):
    """March one term by fde_pi1_ex ("explicit"), fde_pi1_im ("rectangles") or others.

    They are fde_pi2_im ("trapezoids") and fde12 ("pece"), the latter with some corrections.
    """
    t, y, values, y0 = _begun(f, y0, t_end, n)
    inner, first, flat = weights(alpha, n)
    of_flat, of_lines = (t[1] ** alpha / gamma(alpha + order) for order in (1, 2))
    for m in range(1, n + 1):
        start, older = taylor(t[m], y0), values[1:m]
        guess = start + of_flat * summed(flat[m - 1 :: -1][:m], values[:m])
        known = start + of_lines * (first[m] * values[0] + summed(inner[m - 1 : 0 : -1], older))
        new = of_lines
        if kind == "rectangles":
            known, new = start + of_flat * (flat[m - 1 : 0 : -1] @ older), of_flat
        if kind in ("explicit", "pece"):
            y[m] = guess
            for _ in range(corrections if kind == "pece" else 0):
                y[m] = known + new * f(t[m], y[m])
        else:
            y[m] = solved(lambda v: v - known - new * f(t[m], v), y[m - 1])  # noqa: B023
        values[m] = f(t[m], y[m])
    return y


def flmm2(alpha, f, y0, t_end, n):
    """flmm2 with method 3: the second backward differentiation formula with starting weights."""
    t, y, values, y0 = _begun(f, y0, t_end, n)
    series = np.zeros(n + 1)
    series[0] = 1.5**-alpha
    for k in range(1, n + 1):  # of (3/2 - 2 z + z**2 / 2)**-alpha
        terms = ((1, -2.0), (2, 0.5))
        total = sum((-alpha * j - (k - j)) * c * series[k - j] for j, c in terms if j <= k)
        series[k] = total / (1.5 * k)
    powers = [j * alpha for j in range(int(1 / alpha + 1e-12) + 1)]
    powers += [1.0] * (abs(powers[-1] - 1.0) > 1e-12)
    s, steps = len(powers) - 1, np.arange(n + 1.0)
    exact = [gamma(p + 1) / gamma(p + 1 + alpha) * steps ** (p + alpha) for p in powers]
    lacking = [
        e - np.convolve(series, steps**p)[: n + 1] for e, p in zip(exact, powers, strict=True)
    ]
    starting = np.linalg.solve([np.arange(s + 1.0) ** p for p in powers], lacking)
    scale = t[1] ** alpha
    known = np.array([taylor(time, y0) for time in t])

    def first_steps(flat):
        rows = flat.reshape(s, -1)
        found = np.vstack([values[:1], *(f(t[j + 1], row)[None] for j, row in enumerate(rows))])
        own = np.array(
            [[series[i - j] if i >= j else 0.0 for j in range(s + 1)] for i in range(s + 1)]
        )
        return (rows - known[1 : s + 1] - scale * ((starting.T[: s + 1] + own) @ found)[1:]).ravel()

    y[1 : s + 1] = solved(first_steps, np.tile(y[0], s)).reshape(s, -1)
    for m in range(1, n + 1):
        if m > s:
            past = known[m] + scale * (starting[:, m] @ values[: s + 1])
            past = past + scale * (series[m:0:-1] @ values[:m])
            new = scale * series[0]
            y[m] = solved(lambda v: v - past - new * f(t[m], v), y[m - 1])  # noqa: B023
        values[m] = f(t[m], y[m])
    return y


def several_terms(kind, orders, coefficients, f, y0, t_end, n):
    """mt_fde_pi1_ex ("explicit"), pi1_im ("rectangles"), pi2_im ("trapezoids"), pi12_pc ("pece").

    Orders ascend; every lower term is integrated as it stands.
    """
    t, y, values, y0 = _begun(f, y0, t_end, n)
    powers = [orders[-1] - order for order in orders[:-1]] + [orders[-1]]
    shares = [-c / coefficients[-1] for c in coefficients[:-1]] + [1 / coefficients[-1]]
    tables = [weights(power, n) for power in powers]
    parts = [y] * (len(powers) - 1) + [values]
    lines = kind in ("trapezoids", "pece")
    flats = [c * t[1] ** p / gamma(p + 1) for c, p in zip(shares, powers, strict=True)]
    news = [c * t[1] ** p / gamma(p + 1 + lines) for c, p in zip(shares, powers, strict=True)]
    for m in range(1, n + 1):
        start = taylor(t[m], y0)
        for order, power, share in zip(orders[:-1], powers, shares, strict=False):
            for k in range(int(np.ceil(order))):
                start = start - share * t[m] ** (k + power) / gamma(k + power + 1) * y0[k]
        guess, known = start, start
        for (inner, first, flat), part, of_flat, new in zip(
            tables, parts, flats, news, strict=True
        ):
            guess = guess + of_flat * (flat[m - 1 :: -1][:m] @ part[:m])
            older = inner if lines else flat
            known = known + new * (older[m - 1 : 0 : -1] @ part[1:m] + lines * first[m] * part[0])
        lower, of_f = sum(news[:-1]), news[-1]
        y[m] = guess
        if kind == "pece":
            y[m] = known + lower * y[m] + of_f * f(t[m], y[m])
        elif kind != "explicit":
            y[m] = solved(lambda v: v - known - lower * v - of_f * f(t[m], v), y[m - 1])  # noqa: B023
        values[m] = f(t[m], y[m])
    return y
