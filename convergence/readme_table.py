"""The row of README's table that has times: a relaxation of order 0.5 to an error of 1e-6.

The equation is D^0.5 y = -y, y(0) = 1, to t = 5. Both codes are called in turns, warm; the fastest
call counts. Errors are the largest over the steps. pycaputo takes the fewest steps of its
trapezoidal rule that leave the error, on a graded mesh. A full run writes README's row. Claims:

* both leave less than the error;
* pycaputo takes at least 20 times as long, where it is installed.
"""

import datetime
import re
from pathlib import Path

import numba
import numpy as np
from _peer_codes import evolve, pycaputo
from _peer_problems import System
from _study import Claim, curves, in_turns, study

import hereditary as hd

README = Path(__file__).parent.parent / "README.md"
ERROR, T_END, RTOL = 1e-6, 5.0, 1e-4
# As a system for pycaputo.
RELAXATION = System(
    (0.5,), numba.njit(lambda t, y: -y), (np.ones(1),), lambda t, y: -np.ones(1), grading=2.0
)


def decay(t, y):
    return -y


def error_of(t, y):
    return float(np.abs(y[:, 0] - hd.exact.relaxation(0.5)(t)[:, 0]).max())


def measure(quick):
    equation = hd.Equation(hd.Caputo(0.5), decay, 1.0)
    calls = {"hereditary": lambda: hd.solve(equation, T_END, rtol=RTOL)}
    found = calls["hereditary"]()
    told = {"hereditary": (f"rtol={RTOL:g}", error_of(found.t, found.y))}
    for n in range(100, 3001, 50) if evolve else ():
        call = pycaputo("Trapezoidal", RELAXATION, T_END, n)
        error = error_of(*call())
        if error <= ERROR or quick:
            calls["pycaputo"], told["pycaputo"] = call, (f"{n} graded steps", error)
            break
    milliseconds = in_turns(calls, 2 if quick else 15)
    for code, (setting, error) in told.items():
        row = {"code": code, "setting": setting, "error": f"{error:.1e}"}
        yield row | {"ms": f"{1e3 * milliseconds[code]:.3g}"}
    if not quick:
        write({code: (*told[code], 1e3 * milliseconds[code]) for code in told})


def write(rows):
    """Write the row of times and the sentences on it into README."""
    text, (_, error, _) = README.read_text(), rows["hereditary"]
    spent = [rows[code][2] for code in ("hereditary", "pycaputo")]
    cells = " | ".join(f"{ms:.0f} ms" if ms > 10 else f"{ms:.2g} ms" for ms in spent)
    text = re.sub(r"(\| error of 1e-6, .*?\|) .* ms \| .* ms \|", rf"\1 {cells} |", text)
    text = re.sub(r"warm calls of \d+-\d+-\d+", f"warm calls of {datetime.date.today()}", text)
    text = re.sub(
        r"`rtol=1e-4` left an error of \S+\.\s", f"`rtol=1e-4` left an error of {error:.0e}. ", text
    )
    steps, theirs, _ = rows["pycaputo"]
    text = re.sub(r"left \S+ with \d+ graded steps", f"left {theirs:.0e} with {steps}", text)
    README.write_text(text)


def claims(rows):
    by = {row["code"]: row for row in rows}
    for code, row in by.items():
        yield Claim("error of a relaxation", row["error"], ERROR, where=code)
    if "pycaputo" in by:
        ratio = by["pycaputo"]["ms"] / by["hereditary"]["ms"]
        yield Claim("pycaputo's time for it, of that of `solve`", ratio, at_least=20)


if __name__ == "__main__":
    study(
        measure, claims, curves("ms", "error", ("code",), title="D^0.5 y = -y to an error of 1e-6")
    )
