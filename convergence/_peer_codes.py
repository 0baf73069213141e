"""Other codes as peers.py calls them: pycaputo, SciPy, Octave's, and figures that were published.

Each function yields (code, setting, call) with call() -> (t, y), or rows of its own. Right-hand
sides are compiled by numba, so that their cost counts for none of them.
"""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

try:
    from pycaputo.controller import make_fixed_controller, make_graded_controller
    from pycaputo.derivatives import CaputoDerivative
    from pycaputo.fode.caputo import PECE, ModifiedPECE, Trapezoidal
    from pycaputo.stepping import evolve
except ImportError:
    evolve = None

OCTAVE_FOLDER = "HEREDITARY_OCTAVE_CODES"
# P2 in milliseconds for 8, 16, ... 256 steps, and the Euclidean norm of the error over the mesh, by
# the method that pycaputo has too: data of [KhalighiEtAl2024], mean (Julia) and `timeit` (MATLAB).
PUBLISHED = {
    "FdeSolver.jl, predictor-corrector": (
        "PECE",
        (0.08305, 0.190736, 0.375958, 0.731208, 1.401676, 2.741599),
    ),
    "FdeSolver.jl, Newton": (
        "Trapezoidal",
        (0.13227, 0.257186, 0.47795, 0.922668, 1.755924, 3.257649),
    ),
    "MATLAB fde_pi12_pc": ("PECE", (0.14467, 0.36825, 0.65639, 1.2758, 2.4638, 5.0408)),
    "MATLAB fde_pi2_im": ("Trapezoidal", (0.15254, 0.34659, 0.59889, 1.1458, 2.2578, 4.3248)),
}
PUBLISHED_STEPS = (8, 16, 32, 64, 128, 256)
PUBLISHED_NORMS = {
    "PECE": (0.2146538, 0.0822679, 0.0343128, 0.0151949, 0.0069957, 0.0033047),
    "Trapezoidal": (0.0165597, 0.0056191, 0.0019330, 0.00067723, 0.00023936, 8.4355e-05),
}


def by_pycaputo(problem, quick):
    """Yield pycaputo's methods with each number of steps, implicit ones where df/dy is given."""
    system = problem.system
    if evolve is None or system is None:
        return
    for n in problem.peer_counts[:2] if quick else problem.peer_counts:
        names = ["PECE", "ModifiedPECE"] if "stiff" not in problem.name else []
        names = names if problem.name[:9] != "diffusion" else []
        for name in [*names, *(["Trapezoidal"] if system.jac else [])]:
            if not (name == "Trapezoidal" and n > 2000):
                mesh = f", graded({system.grading:.3g})" if system.grading > 1 else ""
                call = pycaputo(name, system, problem.t_end, n)
                yield f"pycaputo {name}", f"N={n}{mesh}", call


def pycaputo(name, system, t_end, n):
    """Return a call of one of pycaputo's methods."""
    control = make_fixed_controller(t_end / n, nsteps=n)
    if system.grading > 1:
        control = make_graded_controller(0.0, t_end, n, r=system.grading)
    given = {"ds": tuple(map(CaputoDerivative, system.orders)), "control": control}
    given |= {"source": system.f, "y0": system.y0}
    if name == "Trapezoidal":
        method = Trapezoidal(source_jac=system.jac, **given)
    else:
        method = {"PECE": PECE, "ModifiedPECE": ModifiedPECE}[name](corrector_iterations=1, **given)

    def call():
        events = list(evolve(method, dtinit=control.dtinit))
        return tuple(np.array([getattr(event, key) for event in events]) for key in ("t", "y"))

    return call


def by_scipy(problem, quick):
    """Yield SciPy's integrators at tolerances from 1e-3 to 1e-12, for orders 1."""
    for method in problem.scipy:
        for digits in (4, 8) if quick else (3, 4, 6, 8, 10, 12):
            how = {"method": method, "rtol": 10.0**-digits, "atol": 10.0**-digits}
            if method != "DOP853":
                how["jac"] = problem.system.jac

            def call(how=how):
                sol = solve_ivp(problem.system.f, (0.0, problem.t_end), *problem.system.y0, **how)
                return sol.t, sol.y.T

            yield f"SciPy {method}", f"rtol=1e-{digits:02}", call


def published(problem):
    """Yield figures others published for P2: code, steps, milliseconds, error, norm, their norm.

    The error is that of the same method in pycaputo, which repeats their norm.
    """
    if evolve is None or problem.name != "P2":
        return
    for code, (method, milliseconds) in PUBLISHED.items():
        told = zip(PUBLISHED_STEPS, milliseconds, PUBLISHED_NORMS[method], strict=True)
        for n, spent, norm in told:
            t, y = pycaputo(method, problem.system, problem.t_end, n)()
            solution = t**8 - 3 * t**4.25 + 2.25 * t**0.5
            found = np.linalg.norm(y[:, 0] - solution)
            yield code, n, spent, problem.error(t, y), found, norm


OCTAVE = """
addpath('{folder}');
if {first}
  f = @(t, y) -y; df = @(t, y) -1; t_end = 5; y0 = 1; known = @(t) erfcx(sqrt(t));
else
  f = @(t, y) 40320 / gamma(8.5) * t.^7.5 - 3 * gamma(5.25) / gamma(4.75) * t.^3.75 ...
    + 2.25 * gamma(1.5) + (1.5 * t.^0.25 - t.^4).^3 - max(y, 0).^1.5;
  df = @(t, y) -1.5 * sqrt(max(y, 0)); t_end = 1; y0 = 0;
  known = @(t) t.^8 - 3 * t.^4.25 + 2.25 * t.^0.5;
end
for n = [{counts}]
  spent = Inf;
  for k = 1:3
    tic; [t, y] = {call}; spent = min(spent, toc);
  end
  printf('%d %.6e %.6e\\n', n, 1e3 * spent, max(abs(y - known(t))));
end
"""
OCTAVE_CALLS = {
    "fde12": "fde12(0.5, f, 0, t_end, y0, t_end / n)",
    "fde_pi12_pc": "fde_pi12_pc(0.5, f, 0, t_end, y0, t_end / n)",
    "fde_pi2_im": "fde_pi2_im(0.5, f, df, 0, t_end, y0, t_end / n)",
    "flmm2": "flmm2(0.5, f, df, 0, t_end, y0, t_end / n)",
}


def by_octave(problem, quick):
    """Yield (code, steps, milliseconds, error) of Octave codes found for P1 and P2."""
    folder, octave = os.environ.get(OCTAVE_FOLDER), shutil.which("octave")
    if not folder or not octave or problem.name not in ("P1", "P2"):
        return
    for code, call in OCTAVE_CALLS.items():
        if not any(Path(folder).glob(f"{code}.m")):
            continue
        counts = "100" if quick else "100 1000 10000"
        first = str(problem.name == "P1").lower()
        script = OCTAVE.format(folder=folder, first=first, counts=counts, call=call)
        how = {"capture_output": True, "text": True, "timeout": 600}
        told = subprocess.run([octave, "--no-gui", "--quiet", "--eval", script], **how)
        if told.returncode:
            print(f"Octave's {code} ended with: {told.stderr.strip()[-200:]}")
        for line in told.stdout.splitlines():
            n, spent, error = line.split()
            yield f"Octave {code}", int(n), float(spent), float(error)


def told_absent():
    """Say which peers are not here."""
    if evolve is None:
        print("skipped: pycaputo is not installed (extra `peers`), nor are published figures shown")
    if not shutil.which("octave"):
        print("skipped: no octave on the path")
    elif not os.environ.get(OCTAVE_FOLDER):
        print(f"skipped: {OCTAVE_FOLDER} names no folder of Octave codes")
