"""`stats["error_estimate"]` of `Collocation` on long runs without damping grows as the error does.

Errors of undamped oscillations add up in proportion to time. Forty random problems over 20 to 2,000
periods: ``D^alpha y = J y`` with eigenvalues on the edge of stability, abs(arg) = alpha pi / 2, of
orders from 0.3 on, next to 1, of 1 and above; ``x'' = -omega**2 x``; and two terms of which the
lower one drives what the higher one damps. Each has damped partners, on which errors do not add up:
eigenvalues turned away from the edge with a constant force and with one that oscillates.
"""

import numpy as np

TURNED = 0.15  # by which the eigenvalues of damped partners are turned, in radians
TIMES = 400  # at the end of the run, at which errors are taken


def linear(t, y, p, dy):  # J, by rows, and amplitude and frequency of the force
    d = y.shape[0]
    for i in range(d):
        dy[i] = p[d * d] * np.cos(p[d * d + 1] * t)
        for j in range(d):
            dy[i] += p[i * d + j] * y[j]


def rotation(size, angle, skew, n):
    """Return a matrix with n pairs of eigenvalues of this argument, of this size and multiples."""
    matrix = np.zeros((2 * n, 2 * n))
    for k in range(n):
        a, b = size * 0.6**k * np.array([np.cos(angle), np.sin(angle)])
        matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[a, -b * skew], [b / skew, a]]
    return matrix


def drawn(number):
    """Return the kind of a problem, its orders, size of the eigenvalues, skewness and pairs."""
    rng = np.random.default_rng([20261125, number])
    kind = ("fractional", "next to 1", "classical", "above 1", "two terms")[number % 5]
    alpha = {
        "fractional": rng.uniform(0.3, 0.95),
        "next to 1": 1 - 10 ** rng.uniform(-5, -1.3),
        "classical": (1.0, 2.0)[number // 5 % 2],
        "above 1": rng.uniform(1.05, 1.95),
        "two terms": rng.uniform(1.2, 1.9),
    }[kind]
    omega, rtol = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-9, -3.5)
    periods = 10 ** rng.uniform(1.3, 3.3)
    skew, pairs, gamma = (
        2 ** rng.uniform(-1.5, 1.5),
        1 + int(rng.random() < 0.2),
        rng.uniform(0.2, 0.8),
    )
    if number == 0:  # D^0.5 y = 10 (y1 - y2, y1 + y2)
        alpha, omega, rtol, periods, skew, pairs = 0.5, 200.0, 1e-6, 3183.0, 1.0, 1
    return kind, alpha, gamma, omega, rtol, 2 * np.pi / omega * periods, skew, pairs, periods
