"""Sliding along switches: runs to two tolerances agree on drawn friction, relays and controllers.

Drawn are blocks on a belt with friction that weakens, alone and in pairs, and Coulomb friction with
a force. Besides there are relays of orders below and above 1, and controllers on a surface. Orders
are 0.3 to 1.7. A run to 1e-5 is compared with one to 1e-7. The difference is relative to the
largest value of a component. For a component that rests it is a hundredth of that of all.
Claims:

* the difference is at most 2e-5, wherever both complete;
* at least nine in ten runs to 1e-5 complete, and eight in ten to 1e-7.

Rounding makes steps short where a controller has orders below 0.5: these end early at 1e-7.
"""

import warnings

import numpy as np
from _study import Claim, curves, study

import hereditary as hd

T_END = 20.0
# Speed of the belt, and slope of the surface of the controller.
BELT = 0.2
SLOPE = 1.2
MOST_STEPS = 10_000


def belt(t, y, p):
    relative = BELT - y[1]
    friction = p[1] * np.sign(relative) / (1 + p[2] * abs(relative))
    return np.array([y[1], -(p[3] ** 2) * y[0] - p[4] * y[1] + friction])


def relay(t, y, p):
    return p[0] * np.sin(p[1] * t) - p[2] * np.sign(y) - p[3] * y


def controlled(t, y, p):
    disturbed = np.sin(y[0]) + 0.5 * np.cos(p[2] * t)
    return np.array([y[1], disturbed - p[1] * np.sign(y[1] + SLOPE * y[0])])


def coulomb(t, y, p):
    return np.array([y[1], -y[0] + p[0] * np.cos(p[1] * t) - p[2] * np.sign(y[1])])


def two_blocks(t, y, p):
    pull, relative = p[3] * (y[1] - y[0]), BELT - y[2:]
    force = np.array([-y[0] + pull, -y[1] - pull])
    return np.concatenate((y[2:], force + p[1:3] * np.sign(relative) / (1 + np.abs(relative))))


def relative_speed(t, y):
    return BELT - y[1]


def first(t, y):
    return y[0]


def second(t, y):
    return y[1]


def surface(t, y):
    return y[1] + SLOPE * y[0]


def of_blocks(number):
    return lambda t, y: BELT - y[2 + number]


BOTH = [of_blocks(0), of_blocks(1)]


def drawn(random, kind):
    """An equation of a kind and its switches."""
    u = random.uniform
    a = float(u(0.3, 1.0) if u() < 0.7 else 1.0)
    if kind == "block on a belt":
        p = [0.0, u(0.3, 1.2), u(0, 2), u(0.7, 1.5), u(0, 0.1)]
        return hd.Equation(hd.Caputo([1.0, a]), belt, [0.0, 0.0], p), relative_speed
    if kind == "relay":
        p = [u(0.5, 2), u(0.5, 2), u(0.5, 1.5), 0.3]
        return hd.Equation(hd.Caputo(a), relay, u(-1, 1), p), first
    if kind == "relay of order above 1":
        b, p = float(u(1.1, 1.7)), [u(0.5, 2), u(0.5, 2), u(0.5, 1.5), 0.0]
        terms = hd.Caputo(b) + 0.5 * hd.Caputo(b / 2)
        return hd.Equation(terms, relay, [u(-1, 1), 0.0], p), first
    if kind == "controller":
        p = [0.0, u(1.5, 3), u(0.3, 1)]
        return hd.Equation(hd.Caputo([a, a]), controlled, [1.0, 0.0], p), surface
    if kind == "Coulomb friction":
        p = [u(0.3, 1.5), u(0.5, 2), u(0.1, 0.8)]
        return hd.Equation(hd.Caputo([1.0, a]), coulomb, [u(-1, 1), 0.0], p), second
    p = [0.0, u(0.3, 1), u(0.3, 1), u(0.3, 1.5)]
    return hd.Equation(hd.Caputo([1.0, 1.0, a, a]), two_blocks, [0.0, 0.1, 0.0, 0.0], p), BOTH


KINDS = (
    "block on a belt", "relay", "relay of order above 1", "controller", "Coulomb friction",
    "two blocks",
)  # fmt: skip


def measure(quick):
    rows, random, t = [], np.random.default_rng(1129), np.linspace(0.0, T_END, 200)
    for number in range(12 if quick else 120):
        kind = KINDS[number % len(KINDS)]
        equation, switches = drawn(random, kind)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.SolveWarning)
            loose, tight = (
                hd.solve(equation, T_END, rtol=rtol, switches=switches, max_steps=MOST_STEPS)
                for rtol in (1e-5, 1e-7)
            )
        both = t[t <= min(loose.t[-1], tight.t[-1])]
        sizes = np.abs(tight.y).max(axis=0)
        sizes = np.maximum(sizes, 0.01 * sizes.max())
        apart = (np.abs(loose(both) - tight(both)).max(axis=0) / sizes).max()
        rows.append(
            {
                "kind": kind,
                "order": round(float(equation.system.highest_orders()[-1]), 4),
                "loose": str(loose.status),
                "tight": str(tight.status),
                "steps": loose.stats["n_steps"],
                "slides": len(loose.stats["slides"]),
                "error": f"{apart:.2e}",
            }
        )
    return sorted(rows, key=lambda row: (row["kind"], row["order"]))


def claims(rows):
    for row in rows:
        if row["loose"] == row["tight"] == "completed":
            where = f"{row['kind']}, order {row['order']:g}"
            yield Claim("difference", row["error"], at_most=2e-5, where=where, small=True)
    for name, least in (("loose", 0.9), ("tight", 0.8)):
        share = np.mean([row[name] == "completed" for row in rows])
        yield Claim(f"share of {name} runs that complete", share, at_least=least)


if __name__ == "__main__":
    study(measure, lambda rows: list(claims(rows)), curves("order", "error", lines=("kind",)))
