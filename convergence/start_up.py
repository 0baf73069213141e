"""A fresh process is ready in well under a second once the machine has compiled the library.

The cache is warm, and bytecode is stored as for installed packages. `import hereditary` takes less
than 0.3 s more than the import of numba, NumPy and SciPy, and the first `solve` less than 1 s more.
Another right-hand side costs only its own compilation: no loop of the library is compiled again.
From an empty cache the first explicit run ends within 15 s, and the first implicit one within 25 s.
The first collocation ends within 60 s. This holds on all machines where it was tried.
"""

import os
import statistics
import subprocess
import sys
import tempfile

import numpy as np
from _study import Claim, bars, study

CODE = """
import time
marks = [time.perf_counter()]
import numba, numpy, scipy.fft, scipy.linalg, scipy.special
marks.append(time.perf_counter())
import hereditary as hd
marks.append(time.perf_counter())
hd.solve(hd.scenes.stick_slip(), 1.0, 1000)
marks.append(time.perf_counter())
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, 1000)
marks.append(time.perf_counter())
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -2 * y, 1.0), 1.0, 1000)
marks.append(time.perf_counter())
print(*(b - a for a, b in zip(marks, marks[1:])))
"""
STAGES = (
    "numba, NumPy and SciPy",
    "import hereditary",
    "first solve",
    "first user function",
    "second user function",
)
LIMITS = {"import hereditary": 0.3, "first solve": 1.0}
FIRST_USE = """
import time
import hereditary as hd
began = time.perf_counter()
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, {how})
print(time.perf_counter() - began)
"""
# What is first used, and the longest that it may take.
FIRST = {
    "explicit": ("n_steps=40", 15.0),
    "implicit": ("n_steps=40, scheme=hd.L1()", 25.0),
    "collocation": ("rtol=1e-6", 60.0),
}


def printed(code, bytecode, **more):
    """Return what a fresh process prints that keeps its bytecode in a folder."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode} | more
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    how = {"env": environment, "capture_output": True, "text": True, "check": True}
    return subprocess.run([sys.executable, "-c", code], **how).stdout


def first_use(how, bytecode):
    """Return the seconds of a first run in a process with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        return float(printed(FIRST_USE.format(how=how), bytecode, NUMBA_CACHE_DIR=folder))


def measure(quick):
    with tempfile.TemporaryDirectory() as bytecode:
        printed("import hereditary", bytecode)
        runs = [
            [float(number) for number in printed(CODE, bytecode).split()]
            for _ in range(3 if quick else 9)
        ]
        medians = [statistics.median(column) for column in zip(*runs[1:], strict=True)]
        for stage, cold, warm in zip(STAGES, runs[0], medians, strict=True):
            yield {"stage": stage, "cold": f"{cold:.3f}", "warm": f"{warm:.3f}"}
        for name, (how, _) in list(FIRST.items())[: 1 if quick else None]:
            seconds = first_use(how, bytecode)
            yield {"stage": f"empty cache, {name}", "cold": f"{seconds:.1f}", "warm": ""}


def claims(rows):
    limits = {f"empty cache, {name}": limit for name, (_, limit) in FIRST.items()} | LIMITS
    for row in rows:
        seconds = row["cold"] if row["warm"] == "" else row["warm"]
        yield Claim(f"{row['stage']} [s]", seconds, limits.get(row["stage"], np.inf))


if __name__ == "__main__":
    study(measure, claims, bars("warm", ("stage",), title="A fresh process, warm cache [s]"))
