"""Command line: run the hereditary stick-slip oscillator and draw it."""

from __future__ import annotations

import argparse
import inspect
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backend_bases import FigureCanvasBase

import hereditary as hd

from . import plots
from .paper.command import main as paper
from .scenes import stick_slip, sticking_intervals
from .solver.progress import ProgressBar
from .support.checks import complaint

# scene parameter -> what it is
_PARAMETERS = {
    "beta": "order of the inertia term, in (1, 2]",
    "gamma": "order of the friction term, in (0, 1]",
    "friction": "friction coefficient lambda",
    "omega": "frequency of the spring",
    "spring_speed": "speed b of the spring",
    "adhesion": "depth c of the wells",
    "x0": "initial position",
    "v0": "initial velocity",
}
# Components, more than those of which a step is one dense system (system.FEW).
_MANY = 12


def main(argv: Sequence[str] | None = None) -> int:
    """Run the scene with the parameters on the command line; return the exit status.

    With "paper" as the first word, compute the figures of the source. With "compile", make all
    machine code for which first runs would wait.
    """
    argv = sys.argv[1:] if argv is None else argv
    if argv and argv[0] == "paper":
        return paper(argv[1:])
    if argv == ["compile"]:
        return _compile_all()
    arguments = _parser().parse_args(argv)
    parameters = {name: getattr(arguments, name) for name in _PARAMETERS}
    try:
        _check_out(arguments.out)
        equation = stick_slip(**parameters)
        solution = hd.solve(
            equation,
            arguments.t_end,
            arguments.n_steps,
            history=hd.SumOfExponentials(arguments.tol),
            progress=True,
        )
    except (TypeError, ValueError) as error:
        print(f"hereditary: {error}", file=sys.stderr)
        return 2
    _report(solution, parameters, _halving_difference(equation, solution, arguments))
    matplotlib.use("Agg")
    _draw(solution, arguments.out)
    print(f"figure          {arguments.out}")
    return 0 if solution.success else 1


def _compile_all() -> int:
    """Compile the loops that take seconds into the cache on disk; return the exit status.

    These are not run, and take at most a second each: SuperLU's solvers, and direct sums on meshes
    and of orders that vary. Others are memory terms of other programs, and the divergence of
    orbits.
    """
    runs, bar = _runs(), ProgressBar(True)
    for number, run in enumerate(runs):
        found = run()
        if not np.all(found.success):
            print(f"hereditary: {found}", file=sys.stderr)
            return 1
        bar.update((number + 1) / len(runs))
    bar.close()
    print(f"compiled: {len(runs)} runs are ready")
    return 0


def _runs():
    """List short runs that enter all compiled loops."""

    def equation(order, y0=1.0, **given):
        return hd.Equation(hd.Caputo(order), lambda t, y: -y, y0, **given)

    one, varying = equation(0.5), equation(lambda t: 0.5 + 0.0 * t)
    wave, orders = np.ones(_MANY), np.linspace(0.5, 0.9, _MANY)
    dense, band = equation(0.5, wave), equation(0.5, wave, bandwidth=(0, 0))
    mixed = equation(orders, wave), equation(orders, wave, bandwidth=(0, 0))
    linear = equation(0.5, wave, linear=-np.eye(_MANY))
    steps, explicit, implicit = {"n_steps": 40}, hd.ExplicitCaputo(), hd.L1()
    runs: list[tuple[hd.Equation, dict[str, Any]]] = [
        *((one, steps | {"scheme": scheme}) for scheme in (explicit, implicit, hd.Adams())),
        *((one, steps | {"history": history}) for history in (hd.Direct(), hd.FFT())),
        (one, {"mesh": hd.graded(40, 2.0), "scheme": implicit}),
        *((varying, steps | {"scheme": scheme}) for scheme in (explicit, implicit)),
        *((eq, steps | {"scheme": hd.BDF(2)}) for eq in (dense, band)),
        (linear, steps | {"scheme": hd.IMEX(hd.BDF(2))}),
        *((eq, {"rtol": 1e-4}) for eq in (one, dense, band, *mixed)),
    ]
    return [
        *(partial(hd.solve, equation, 1.0, **how) for equation, how in runs),
        partial(hd.ensemble, one, 1.0, 40, y0=[1.0, 2.0]),
        partial(hd.lyapunov, one, 1.0, 40),
    ]


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m hereditary",
        description="Hereditary stick-slip: D^beta x + lambda D^gamma x + omega^2 x "
        "= b t + c sum a_n sin(n x), Caputo derivatives. `paper --out DIR` computes the source's "
        "figures, see `paper --help`; `compile` makes all machine code ahead.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    defaults = inspect.signature(stick_slip).parameters
    for name, text in _PARAMETERS.items():
        flag = "--" + name.replace("_", "-")
        parser.add_argument(flag, type=float, default=defaults[name].default, help=text)
    parser.add_argument("--version", action="version", version=f"hereditary {hd.__version__}")
    parser.add_argument("--t-end", type=float, default=100.0, help="end of the run")
    parser.add_argument("--n-steps", type=int, default=200_000, help="number of steps")
    parser.add_argument("--tol", type=float, default=1e-10, help="tolerance of the memory kernels")
    parser.add_argument("--out", default="stick_slip.png", help="file of the figure")
    return parser


def _halving_difference(equation: hd.Equation, solution: hd.Solution, arguments) -> str:
    """Return differences to a run with half the steps: an error estimate at first order."""
    half = arguments.n_steps // 2
    if arguments.n_steps % 2 or half == 0 or not solution.success:
        return "none (it needs an even number of steps and a completed run)"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.SolveWarning)
        coarse = hd.solve(
            equation, arguments.t_end, half, history=hd.SumOfExponentials(arguments.tol)
        )
    if not coarse.success:
        return f"none (with half the steps: {coarse.status.sentence})"
    difference = np.abs(solution.y[::2] - coarse.y)
    return f"{difference[-1, 0]:.1e} at the end, {difference.max():.1e} at most (half the steps)"


def _check_out(path: str) -> None:
    """Refuse a figure file that could not be written, before anything is computed."""
    folder, suffix = Path(path).resolve().parent, Path(path).suffix.lstrip(".").lower()
    if not folder.is_dir():
        raise ValueError(complaint("--out", "lie in a folder that exists", path))
    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix not in known:
        raise ValueError(complaint("--out", f"end in one of {', '.join(known)}", path))


def _report(solution: hd.Solution, parameters, estimate: str) -> None:
    stats = solution.stats
    print("parameters      " + ", ".join(f"{k} {v:g}" for k, v in parameters.items()))
    print(f"result          {solution.message}")
    print(f"steps           {stats['n_steps']} to t = {solution.t[-1]:g}")
    print(f"memory          {stats['n_modes']} modes, {stats['history_bytes']} bytes")
    print(f"seconds         {stats['setup_seconds']:.3f} set-up, {stats['run_seconds']:.3f} run")
    print(f"error estimate  {estimate}")
    stays = ", ".join(f"{a:.2f} .. {b:.2f}" for a, b in sticking_intervals(solution))
    print(f"sticking        {stays or 'none'}")


def _draw(solution: hd.Solution, path: str) -> None:
    """Oscillogram and velocity above each other, the phase portrait beside them."""
    with plt.style.context(plots.STYLE):
        figure, axes = plt.subplot_mosaic("xo;vo", figsize=(10, 5), layout="constrained")
        plots.oscillogram(solution, axes["x"])
        plots.velocity(solution, axes["v"])
        plots.phase_portrait(solution, axes["o"])
        figure.savefig(path, dpi=150)
        plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
