"""Weights that come from a recurrence."""

import numpy as np

from .jit import compiled


@compiled
def series_of_power(factor, alpha, n):
    """Return coefficients of ``(1-z)**(alpha-1) * F(z)**alpha``, F with the coefficients `factor`.

    The product G obeys ``(1-z) F G' = ((1-alpha) F + alpha (1-z) F') G``; comparing coefficients
    gives each of them from those before, a few operations each and without cancellation.
    """
    # factor (m,)
    m = factor.shape[0]
    a, b = np.zeros(m + 1), np.zeros(m + 1)  # (1-z) F, and the bracket on the right
    for j in range(m):
        a[j] += factor[j]
        a[j + 1] -= factor[j]
        b[j] += (1.0 - alpha) * factor[j]
        if j > 0:
            b[j - 1] += alpha * j * factor[j]
            b[j] -= alpha * j * factor[j]
    g = np.zeros(n)
    g[0] = factor[0] ** alpha
    for k in range(1, n):
        total = 0.0
        for j in range(min(k, m + 1)):
            total += b[j] * g[k - 1 - j]
        for j in range(1, min(k, m) + 1):
            total -= a[j] * (k - j) * g[k - j]
        g[k] = total / (k * a[0])
    return g
