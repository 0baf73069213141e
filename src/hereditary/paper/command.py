"""`python -m hereditary paper`: the paper's figures, and maps beyond them."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import matplotlib
import matplotlib.style

from ..plots import STYLE
from ..support.checks import complaint
from . import figures, maps
from .job import Job

FIGURES: dict[str, Callable[[Job], list[str]]] = {
    "1": figures.figure_1, "2": figures.figure_2, "3": figures.figure_3, "4": figures.figure_4,
    "5": figures.figure_5, "6": figures.figure_6, "7": figures.figure_7, "8": figures.figure_8,
    "b": maps.bifurcation_b, "c": maps.bifurcation_c, "lambda": maps.bifurcation_lambda,
    "beta": maps.bifurcation_beta, "gamma": maps.bifurcation_gamma, "b-c": maps.regimes_b_c,
    "lambda-c": maps.regimes_lambda_c, "beta-gamma": maps.regimes_beta_gamma,
}  # fmt: skip


def run_paper(argv: Sequence[str]) -> int:
    """Compute the figures named on the command line; return the exit status."""
    arguments = _parser().parse_args(argv)
    names = list(FIGURES) if arguments.figures is None else arguments.figures.split(",")
    for name in names:
        if name not in FIGURES:
            required = f"name figures among {', '.join(FIGURES)}"
            print(f"hereditary: {complaint('--figures', required, name)}", file=sys.stderr)
            return 2
    folder = Path(arguments.out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        required = "be a folder that can be made"
        got = f"{arguments.out} ({error})"
        print(f"hereditary: {complaint('--out', required, got)}", file=sys.stderr)
        return 2
    matplotlib.use("Agg")
    # short runs gain from processes; a handful of points does not pay for starting them
    pool = contextlib.nullcontext() if arguments.quick else ProcessPoolExecutor(os.cpu_count())
    with matplotlib.style.context(STYLE), pool as executor:
        job = Job(folder, arguments.quick, executor)
        for name in names:
            began = time.perf_counter()
            lines = FIGURES[name](job)
            print(f"{FIGURES[name].__name__}  {time.perf_counter() - began:.1f} s", flush=True)
            for line in lines:
                print(f"    {line}", flush=True)
    print(f"figures and tables in {folder}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m hereditary paper",
        description="Figures 1 to 8 of the paper, bifurcation diagrams (b, c, lambda, beta, "
        "gamma) and regime maps (b-c, lambda-c, beta-gamma): PNG, PDF and the data as NPZ.",
    )
    parser.add_argument("--out", required=True, help="folder of the figures; made if need be")
    parser.add_argument("--figures", help=f"comma-separated, of {', '.join(FIGURES)}; default all")
    parser.add_argument("--quick", action="store_true", help="a smoke test: few points, short runs")
    return parser
