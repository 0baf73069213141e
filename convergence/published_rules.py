"""Published rules, compared with the schemes here: which are equal, and how others differ.

The rules of `fde12`, `flmm2`, the `fde_pi` and the `mt_fde_pi` codes in plain NumPy, with Newton's
method to rounding. Beside them are the schemes with past sums term by term. Claims of
docs/coming_from.md:

* `ProductTrapezoid` is fde_pi2_im to 1e-12, and 30 corrections of the textbook's PECE are it too;
* `Adams` is 1.9 to 45 times as accurate as that PECE with one correction, on a smooth solution. On
  one like t**alpha the ratio of errors at the end lies between 0.8 and 3.6;
* at order 1 fde_pi1_ex is `ExplicitCaputo` and `GrunwaldLetnikov`, fde_pi1_im is `BDF(1)`;
* flmm2's starting weights make its largest error smaller than that of `BDF(2)`, up to order 0.8;
* with several terms mt_fde_pi2_im errs less than `BDF(2)` with as many steps.
"""

from math import gamma

import numpy as np
from _published_rules import flmm2, product_integration, several_terms
from _study import Claim, chosen, curves, study

import hereditary as hd


def logistic(t, y):
    return y * (1 - y)


def decay(t, y):
    return -y


def swing(t, y):
    return np.sin(t) - y


def brusselator(t, y):
    product = y[0] * y[0] * y[1]
    return np.array([1 - 5 * y[0] + product, 4 * y[0] - product])


def smooth(alpha):
    """Right-hand side of the solution t**2."""
    factor = 2 / gamma(3 - alpha)

    def rhs(t, y):
        return factor * t ** (2 - alpha) + t**4 - y**2

    return rhs


SEVERAL = [
    ([1.5, 2.0], [0.5, 1.0], swing, [0.0, 1.0], 10.0),
    ([0.8, 1.8], [0.25, 1.0], swing, [0.2, 0.3], 10.0),
    ([0.4, 0.9], [0.5, 1.0], decay, [1.0], 5.0),
]


def ours(terms, f, y0, t_end, n, scheme):
    """Rows of a scheme, and of a run with a tolerance at the same times."""
    equation = hd.Equation(terms, f, y0)
    sol = hd.solve(equation, t_end, n, scheme=scheme, history=hd.Direct())
    return sol.y, hd.solve(equation, t_end, rtol=1e-11)(sol.t)


def row(what, orders, n, theirs, own, exact):
    """Largest difference, and errors at the end and at most, of both."""
    errors = [np.abs(rows - exact) for rows in (theirs, own)]
    return {
        "what": what,
        "orders": orders,
        "n_steps": n,
        "difference": f"{np.abs(theirs - own).max():.1e}",
        "theirs_at_end": f"{errors[0][-1].max():.2e}",
        "ours_at_end": f"{errors[1][-1].max():.2e}",
        "theirs_largest": f"{errors[0].max():.2e}",
        "ours_largest": f"{errors[1].max():.2e}",
    }


def one_term(kind, scheme, alpha, f, y0, t_end, n, name="", corrections=1):
    own, exact = ours(hd.Caputo(alpha), f, y0, t_end, n, scheme)
    given = y0 if alpha > 1 else [np.array(y0)]
    theirs = product_integration(kind, alpha, f, given, t_end, n, corrections)
    return row(name or f"{kind}, {scheme!r}", f"{alpha:g}", n, theirs, own, exact)


def measure(quick):
    """Yield all rows."""
    few, many = (50, 100) if quick else (50, 400)
    for alpha in (0.2, 0.5, 0.8, 1.0, 1.3, 1.8):
        y0 = [0.3, 0.1] if alpha > 1 else [0.3]
        for n in (few, many):
            yield one_term("trapezoids", hd.ProductTrapezoid(), alpha, logistic, y0, 5.0, n)
    y0, scheme = [0.2, 0.03], hd.ProductTrapezoid()
    yield one_term(
        "trapezoids", scheme, 0.8, brusselator, y0, 10.0, many, "Brusselator, trapezoids"
    )
    yield one_term("pece", scheme, 0.8, logistic, [0.3], 5.0, few, "pece, 30 corrections", 30)
    for n in (50, 200) if quick else (50, 200, 800):
        for alpha in (0.3, 0.5, 0.7, 0.9):
            yield one_term("pece", hd.Adams(), alpha, smooth(alpha), [0.0], 1.0, n, "smooth, pece")
        for alpha in (0.3, 0.5, 0.7, 0.9, 1.0, 1.5, 1.8):
            y0 = [1.0, 0.0] if alpha > 1 else [1.0]
            yield one_term("pece", hd.Adams(), alpha, decay, y0, 5.0, n, "decay, pece")
    for scheme in (hd.ExplicitCaputo(), hd.GrunwaldLetnikov()):
        yield one_term("explicit", scheme, 1.0, logistic, [0.3], 5.0, few)
    yield one_term("rectangles", hd.BDF(1), 1.0, logistic, [0.3], 5.0, few)
    for name, f, start in (("decay", decay, 1.0), ("logistic", logistic, 0.3)):
        for alpha in (0.3, 0.5, 0.8):
            own, exact = ours(hd.Caputo(alpha), f, [start], 5.0, many, hd.BDF(2))
            theirs = flmm2(alpha, f, [start], 5.0, many)
            yield row(f"{name}, flmm2, BDF(2)", f"{alpha:g}", many, theirs, own, exact)
    for orders, coefficients, f, y0, t_end in SEVERAL:
        terms = [c * hd.Caputo(order) for order, c in zip(orders, coefficients, strict=True)]
        for kind, scheme in (
            ("explicit", hd.ExplicitCaputo()),
            ("explicit", hd.GrunwaldLetnikov()),
            ("rectangles", hd.BDF(1)),
            ("pece", hd.BDF(2)),
            ("trapezoids", hd.BDF(2)),
        ):
            own, exact = ours(terms, f, y0, t_end, many, scheme)
            theirs = several_terms(kind, orders, coefficients, f, y0, t_end, many)
            told = f"several terms, {kind}, {scheme!r}"
            yield row(told, " ".join(map(str, orders)), many, theirs, own, exact)


def claims(rows):
    for found in rows:
        what = found["what"]
        how = {"where": f"{what}, order {found['orders']}, N = {found['n_steps']:g}", "small": True}
        ratio = found["theirs_at_end"] / found["ours_at_end"]
        equal = "trapezoids, Prod" in what or what.startswith(("Brus", "pece, 30"))
        if equal or what.startswith(("explicit", "rectangles")):
            told = "trapezoids" if equal else "rectangles at order 1"
            yield Claim(f"{told} differ from ours by", found["difference"], 1e-12, **how)
        elif what == "smooth, pece":
            yield Claim("error of PECE over that of Adams, smooth solution", ratio, 45, 1.9, **how)
        elif what == "decay, pece":
            yield Claim("error of PECE over that of Adams, decay", ratio, 3.6, 0.8, **how)
        elif "flmm2" in what:
            most = found["theirs_largest"] / found["ours_largest"]
            yield Claim("largest error of flmm2 over that of BDF(2)", most, 1, **how)
        elif "trapezoids" in what:
            yield Claim("error of mt_fde_pi2_im over that of BDF(2)", ratio, 1, **how)


if __name__ == "__main__":
    columns = ("ours_at_end", "theirs_at_end")
    draw = curves("n_steps", columns, ("orders",), title="Adams and PECE, y = t^2")
    study(measure, claims, lambda rows: draw(chosen(rows, what="smooth, pece")))
