"""Command line: run the hereditary stick-slip oscillator and draw it."""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backend_bases import FigureCanvasBase

import hereditary as hd

from . import plots
from .compiled.cache import shipped_target
from .paper.command import run_paper as paper
from .precompile import precompile
from .scenes import stick_slip, sticking_intervals
from .support.checks import refuse

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
# Members of the ensemble that is shown.
_MEMBERS = 100


def main(argv: Sequence[str] | None = None) -> int:
    """Run a scene, the figures of the paper or the compilation; return the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    if argv and argv[0] == "paper":
        return paper(argv[1:])
    if argv == ["compile"]:
        print(f"compiled: {precompile()} runs are ready")
        return 0
    arguments = _parser().parse_args(argv)
    if arguments.version:
        print(_version())
        return 0
    parameters = {name: getattr(arguments, name) for name in _PARAMETERS}
    try:
        _check_out(arguments.out)
        equation = stick_slip(**parameters)
        accurate = hd.solve(equation, arguments.t_end, rtol=arguments.rtol)
        solution = hd.solve(
            equation,
            arguments.t_end,
            arguments.n_steps,
            history=hd.SumOfExponentials(arguments.tol),
            progress=True,
            estimate=False,
        )
        starts = equation.y0 + np.multiply.outer(np.linspace(0.0, 1.0, _MEMBERS), [[1.0], [0.0]])
        members = hd.ensemble(equation, 0.1 * arguments.t_end, y0=starts[:, :, 0], rtol=1e-6)
    except (TypeError, ValueError) as error:
        print(f"hereditary: {error}", file=sys.stderr)
        return 2
    _report(parameters, accurate, solution)
    each = f"{1e3 * members.stats['seconds'] / _MEMBERS:.2f} ms each"
    print(f"ensemble        {_MEMBERS} initial positions to t = {members.t[-1]:g} in {each}")
    matplotlib.use("Agg")
    _draw(solution, arguments.out)
    print(f"figure          {Path(arguments.out).resolve()}")
    return 0 if accurate.success and solution.success else 1


def _version() -> str:
    """Return the version, and whether the installation has machine code that fits, or why not."""
    target, reason = shipped_target()
    code = f"installed, for numba {target.numba} and {target.processor}" if target else ""
    code = f"none, first runs compile: {reason}" if reason else code
    return f"hereditary {hd.__version__}\nmachine code: {code}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m hereditary",
        description="Hereditary stick-slip: D^beta x + lambda D^gamma x + omega^2 x "
        "= b t + c sum a_n sin(n x), Caputo derivatives. `paper --out DIR` computes the paper's "
        "figures, see `paper --help`; `compile` makes all machine code ahead.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    defaults = inspect.signature(stick_slip).parameters
    for name, text in _PARAMETERS.items():
        flag = "--" + name.replace("_", "-")
        parser.add_argument(flag, type=float, default=defaults[name].default, help=text)
    about = "print the version, and whether machine code came with it"
    parser.add_argument("--version", action="store_true", help=about)
    parser.add_argument("--t-end", type=float, default=100.0, help="end of the run")
    parser.add_argument("--rtol", type=float, default=1e-8, help="tolerance of the first run")
    parser.add_argument("--n-steps", type=int, default=200_000, help="steps of the second run")
    parser.add_argument("--tol", type=float, default=1e-10, help="tolerance of the memory kernels")
    parser.add_argument("--out", default="stick_slip.png", help="file of the figure")
    return parser


def _check_out(path: str) -> None:
    """Refuse a figure file that could not be written, before anything is computed."""
    folder, suffix = Path(path).resolve().parent, Path(path).suffix.lstrip(".").lower()
    if not folder.is_dir():
        refuse("--out", "lie in a folder that exists", path)
    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix not in known:
        refuse("--out", f"end in one of {', '.join(known)}", path)


def _report(parameters: dict[str, float], accurate: hd.Solution, solution: hd.Solution) -> None:
    """Print the run by a tolerance, then that of the explicit scheme and how far it is from it."""
    stats, estimate = solution.stats, accurate.stats["error_estimate"]
    error = "none" if estimate is None else f"{estimate:.1e} of the size of x"
    print("parameters      " + ", ".join(f"{k} {v:g}" for k, v in parameters.items()))
    print(f"by tolerance    {_counts(accurate)}: {accurate.message}")
    print(f"error estimate  {error}")
    print(f"explicit        {_counts(solution)}: {solution.message}")
    print(f"memory          {stats['n_modes']} modes, {stats['history_bytes']} bytes")
    print(f"difference      {_difference(accurate, solution)}")
    stays = ", ".join(f"{a:.2f} .. {b:.2f}" for a, b in sticking_intervals(solution))
    print(f"sticking        {stays or 'none'}")


def _counts(solution: hd.Solution) -> str:
    stats = solution.stats
    seconds = stats["setup_seconds"] + stats["run_seconds"]
    return f"{stats['n_steps']} steps to t = {solution.t[-1]:g} in {seconds:.3f} s"


def _difference(accurate: hd.Solution, solution: hd.Solution) -> str:
    """Return the distance of x between both runs, relative to the largest |x|."""
    if not (accurate.success and solution.success):
        return "none, both runs must complete"
    exact = accurate(solution.t)[:, 0]
    apart = np.abs(solution.y[:, 0] - exact) / np.abs(exact).max()
    return f"{apart.max():.1e} of the size of x at most, {apart[-1]:.1e} at the end"


def _draw(solution: hd.Solution, path: str) -> None:
    """Draw oscillogram and velocity above each other, and the phase portrait beside them."""
    with plt.style.context(plots.STYLE):
        figure, axes = plt.subplot_mosaic("xo;vo", figsize=(10, 5), layout="constrained")
        plots.oscillogram(solution, axes["x"])
        plots.velocity(solution, axes["v"])
        plots.phase_portrait(solution, axes["o"])
        figure.savefig(path, dpi=150)
        plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
