"""Derivatives of data have the orders of their schemes, in O(n log n); those of functions 1e-11.

D^a of t^4 + t^2 on [0, 1], with even times and all that `hd.derivative` takes. Rows have the
largest error from t = 1/4 on, and its order beside 2 - a, or 3 - a. They have the time of a call.
Functions are smooth ones or smooth in t^a, and steps are the values that they are asked for.
"""

import numpy as np
from _study import Claim, chosen, curves, fastest, order_claims, order_rows, study
from scipy.special import gamma

import hereditary as hd

ORDERS = (0.3, 0.8, 1.5)
SCHEMES = (hd.L1(), hd.L12(), hd.L2())
LABELS = "scheme", "alpha"
# Rounding of data changes a derivative by about 10 eps h**-alpha; the last order is taken from an
# error above 50 eps h**-alpha and above this floor.
FLOOR, ROUNDING = 1e-10, 50 * np.finfo(float).eps


def smooth(t):
    return t**4 + t**2


def of_smooth(t, alpha):
    return sum(gamma(k + 1) / gamma(k + 1 - alpha) * t ** (k - alpha) for k in (4, 2))


def started(t):
    return t**0.8 - t**1.6


def of_started(t, alpha):
    parts = [gamma(p + 1) / gamma(p + 1 - alpha) * t ** (p - alpha) for p in (0.8, 1.6)]
    return parts[0] - parts[1]


FUNCTIONS = (
    ("smooth function", ORDERS, smooth, of_smooth),
    ("function of t^0.8", (0.8,), started, of_started),
)


def of_data(scheme, alpha, n):
    """Return the error from t = 1/4 on, and the seconds of a call."""
    t = np.linspace(0.0, 1.0, n + 1)
    y, known = smooth(t), of_smooth(t, alpha)
    seconds, found = fastest(lambda: hd.derivative(t, y, hd.Caputo(alpha), scheme), 3)
    return np.abs(found - known)[n // 4 :].max(), seconds


def of_function(function, known, alpha, n):
    """Return the error relative to the largest value, and the seconds of a call."""
    t = np.linspace(0.01, 1.0, n)
    seconds, found = fastest(lambda: hd.derivative(t, function, hd.Caputo(alpha)), 3)
    exact = known(t, alpha)
    return np.abs(found - exact).max() / np.abs(exact).max(), seconds


def measure(quick):
    counts = 10 * 2 ** np.arange(3, 7 if quick else 17)
    rows = []
    for scheme in SCHEMES:
        for alpha in ORDERS:
            expected = scheme.order(alpha) if alpha < 1 else 3 - alpha
            found = {int(n): of_data(scheme, alpha, n) for n in counts}
            rows += order_rows({"scheme": repr(scheme), "alpha": alpha}, expected, found)
    for name, alphas, *pair in FUNCTIONS:
        for alpha in alphas:
            found = {n: of_function(*pair, alpha, n) for n in (100, 1000)}
            rows += order_rows({"scheme": name, "alpha": alpha}, np.nan, found)
    return rows


def claims(rows):
    data = [row for row in rows if np.isfinite(row["expected"])]
    sharp = [r for r in data if r["error"] > ROUNDING * r["n_steps"] ** r["alpha"]]
    yield from order_claims(sharp, LABELS, FLOOR)
    for row in rows:
        if not np.isfinite(row["expected"]):
            where = {"where": f"{row['scheme']}, {row['alpha']:g}", "small": True}
            limit = 1e-11 if row["alpha"] < 1 else 1e-10
            kind = "below order 1" if row["alpha"] < 1 else "above order 1"
            yield Claim(f"error of functions, {kind}", row["error"], limit, **where)
    for scheme in SCHEMES:
        times = {row["n_steps"]: row["milliseconds"] for row in chosen(data, scheme=repr(scheme))}
        last = max(times)
        yield Claim("milliseconds of the longest data", times[last], where=repr(scheme))


if __name__ == "__main__":
    study(measure, claims, curves("milliseconds", "error", ("scheme",), ("alpha",)))
