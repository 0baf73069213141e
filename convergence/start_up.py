"""The first result of an installed package waits for its right-hand side alone to be compiled.

`pip install .` compiles the rest, which comes with the package. So first results from an empty
cache compile no function of the package, and take less than 1 s. Tried are `rtol=`, `n_steps=`,
BDF(2), eleven components, `lyapunov` and the command line. The same holds for whatever stands
around a right-hand side: a start, memory, delays, switches, matrices, complex numbers, bands and
responses to a frequency. These take less than 1.5 s, because some have two functions to compile.
`import hereditary` takes less than 0.3 s more than the import of numba, NumPy and SciPy, and the
first `solve` less than 1 s more. Another right-hand side costs only its own compilation. An
editable installation carries no such code. From an empty cache its first explicit run ends within
15 s, and its first implicit one within 25 s. Its first collocation ends within 60 s. This holds on
all machines where it was tried.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from _study import Claim, bars, study

from hereditary.compiled.cache import SHIPPED, shipped_target

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
# The seconds of a first use, and the functions of the package that it compiles. Those that are made
# of the user's function, or are the function of a scene, are compiled in every process.
FIRST_USE = """
import contextlib, os, time
from numba.core import event
import numpy as np
import hereditary as hd
from hereditary.__main__ import main
compiled = []
class Listener(event.Listener):
    def on_start(self, happened):
        function = happened.data["dispatcher"].py_func
        room, _, name = function.__module__.partition(".")
        made = "<locals>" in function.__qualname__ or name.startswith("scenes.")
        if room == "hereditary" and not made:
            compiled.append(function.__qualname__)
    def on_end(self, happened):
        pass
event.register("numba:compile", Listener())
def decay(y0=1.0):
    return hd.Equation(hd.Caputo(0.5), lambda t, y: -y, y0)
def reading(memory, n_steps=None):
    equation = hd.Equation(hd.Caputo(0.9), lambda t, y, m: -m[0], 1.0, memory=memory)
    how = dict(rtol=1e-6) if n_steps is None else dict(estimate=False)
    return hd.solve(equation, 1.0, n_steps, **how)
def band(t, y):
    return np.full((1, 12), -1.0)
def swing():
    forced = lambda t, y, p: -y + np.cos(p[0] * t)
    return hd.Equation([hd.Caputo(2.0), hd.Caputo(0.5)], forced, [0.0, 0.0], params=[1.0])
began = time.perf_counter()
with contextlib.redirect_stdout(None):
    {how}
print(time.perf_counter() - began, len(compiled))
"""
# What is first used, and the longest that it may take without machine code.
FIRST = {
    "explicit": ("hd.solve(decay(), 1.0, 40, estimate=False)", 15.0),
    "implicit": ("hd.solve(decay(), 1.0, 40, scheme=hd.L1(), estimate=False)", 25.0),
    "collocation": ("hd.solve(decay(), 1.0, rtol=1e-6)", 60.0),
}
# What is first used of an installed package, where something stands around the right-hand side.
AROUND = {
    "t_start": "hd.solve(decay().replace(t_start=1.0), 2.0, 40, estimate=False)",
    "memory": "reading(hd.Caputo(0.5), 40)",
    "gamma densities": "reading(hd.Memory(hd.GammaDensity(2.0, 1.0), 0))",
    "delays": "reading(hd.Delay(0.5))",
    "delays, n_steps=": "reading(hd.Delay(0.5), 40)",
    "switches": "hd.solve(decay(), 1.0, rtol=1e-6, switches=[lambda t, y: y[0] - 0.5])",
    "matrices": "hd.solve(decay([1.0, 2.0]).replace(terms=np.eye(2) * hd.Caputo(0.5)), 1.0)",
    "order 2.5": "hd.solve(decay().replace(terms=hd.Caputo(2.5), y0=[1.0, 0.0, 0.0]), 1.0)",
    "complex y": "hd.solve(decay(1.0 + 0.0j), 1.0, rtol=1e-6)",
    "linear=": "hd.solve(decay(np.ones(12)).replace(linear=-np.eye(12)), 1.0, rtol=1e-6)",
    "a band and jac": "hd.solve(decay(np.ones(12)).replace(bandwidth=(0, 0), jac=band), 1.0)",
    "frequency response": "hd.frequency_response(swing(), [0.5, 0.7])",
}
# What is first used of an installed package.
INSTALLED = {
    "rtol=": "hd.solve(decay(), 1.0, rtol=1e-6)",
    "rtol=, not linear": "hd.solve(decay().replace(rhs=lambda t, y: -y * y), 1.0, rtol=1e-6)",
    "n_steps=": "hd.solve(decay(), 1.0, 40)",
    "BDF(2)": "hd.solve(decay(), 1.0, 40, scheme=hd.BDF(2))",
    "eleven components": "hd.solve(decay(np.ones(11)), 1.0, rtol=1e-6)",
    "lyapunov": "hd.lyapunov(decay(), 1.0, 40)",
    "lyapunov, rtol=": "hd.lyapunov(decay(), 1.0, rtol=1e-6)",
    "command line": "main(['--out', os.environ['NUMBA_CACHE_DIR'] + '/figure.png'])",
}


def printed(code, bytecode, **more):
    """Return what a fresh process prints that keeps its bytecode in a folder."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode} | more
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    how = {"env": environment, "capture_output": True, "text": True, "check": True}
    return subprocess.run([sys.executable, "-c", code], **how).stdout


def first_use(how, bytecode, **more):
    """Return the seconds of a first use in a process with an empty cache, and what it compiles."""
    with tempfile.TemporaryDirectory() as folder:
        told = printed(FIRST_USE.format(how=how), bytecode, NUMBA_CACHE_DIR=folder, **more)
    seconds, n_compiled = told.split()
    return float(seconds), int(n_compiled)


def row(stage, cold="", warm="", compiled=""):
    return {"stage": stage, "cold": cold, "warm": warm, "compiled": compiled}


def measure(quick):
    with tempfile.TemporaryDirectory() as bytecode, tempfile.TemporaryDirectory() as folder:
        printed("import hereditary", bytecode)
        runs = [
            [float(number) for number in printed(CODE, bytecode).split()]
            for _ in range(3 if quick else 9)
        ]
        medians = [statistics.median(column) for column in zip(*runs[1:], strict=True)]
        for stage, cold, warm in zip(STAGES, runs[0], medians, strict=True):
            yield row(stage, f"{cold:.3f}", f"{warm:.3f}")
        for name, how in () if shipped_target()[1] else (INSTALLED | AROUND).items():
            seconds, n_compiled = first_use(how, bytecode)
            yield row(f"first result, {name}", f"{seconds:.2f}", compiled=n_compiled)
        ignored = shutil.ignore_patterns("__pycache__", SHIPPED.name)
        shutil.copytree(SHIPPED.parent, Path(folder, "hereditary"), ignore=ignored)
        for name, (how, _) in list(FIRST.items())[: 1 if quick else None]:
            seconds, n_compiled = first_use(how, bytecode, PYTHONPATH=folder)
            yield row(f"empty cache, {name}", f"{seconds:.1f}", compiled=n_compiled)


def claims(rows):
    limits = {f"empty cache, {name}": limit for name, (_, limit) in FIRST.items()} | LIMITS
    for found in rows:
        stage = found["stage"]
        seconds = found["cold"] if found["warm"] == "" else found["warm"]
        if stage.startswith("first result"):
            text = "functions of the package that a first result compiles"
            yield Claim(text, found["compiled"], at_most=0, where=stage, small=True)
        limit = 1.0 if stage.startswith("first result") else limits.get(stage, np.inf)
        limit += 0.5 * (stage.removeprefix("first result, ") in AROUND)
        yield Claim(f"{stage} [s]", seconds, limit)


if __name__ == "__main__":
    study(measure, claims, bars("warm", ("stage",), title="A fresh process, warm cache [s]"))
