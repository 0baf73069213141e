"""What every study shares: its command line, its CSV, its figure."""

import argparse
import csv
import datetime
import os
import platform
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))  # the named problems

import hereditary as hd
from hereditary.analysis.order import observed_order

RESULTS = Path(__file__).parent / "results"


class Study:
    """One script's settings and results.

    Results of a quick run go to a temporary folder, those of a full one beside the script. What
    is given by name is an option of the command line with this value by default.
    """

    def __init__(self, script, claim, **options):
        parser = argparse.ArgumentParser(description=claim)
        parser.add_argument("--quick", action="store_true", help="a smoke test at small sizes")
        for name, value in options.items():
            parser.add_argument(f"--{name}", type=type(value), default=value)
        self.options = parser.parse_args()
        self.quick = self.options.quick
        self._folder = Path(tempfile.mkdtemp()) if self.quick else RESULTS
        self._folder.mkdir(exist_ok=True)
        self._name = Path(script).stem

    def path(self, suffix):
        """File of this study's results."""
        return self._folder / f"{self._name}{suffix}"

    def write(self, rows):
        """Write rows (dicts with equal keys) as CSV under a line of settings, and print them."""
        with open(self.path(".csv"), "w", newline="") as file:
            machine = f"{platform.machine()}, {os.cpu_count()} cores"
            file.write(f"# hereditary {hd.__version__}, {datetime.date.today()}, {machine}, ")
            file.write(f"Python {platform.python_version()}\n")
            writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        widths = [max(len(k), *(len(str(r[k])) for r in rows)) for k in rows[0]]
        for cells in [rows[0].keys(), *(row.values() for row in rows)]:
            line = (str(cell).rjust(width) for cell, width in zip(cells, widths, strict=True))
            print("  ".join(line))

    def read(self):
        """The rows back, numbers as floats."""
        with open(self.path(".csv"), newline="") as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
        return [{key: _number(value) for key, value in row.items()} for row in rows]

    def save(self, figure):
        """Save the figure and say where it is."""
        figure.savefig(self.path(".png"), dpi=150)
        print(f"{self._name}: {self.path('.csv')}, {self.path('.png')}")


def last_order(scheme, alpha, kind, counts, errors, floor):
    """Return a row: the last pairwise order of errors above `floor`, beside the proven one."""
    kept = np.array(errors) > floor
    table = observed_order(np.array(counts)[kept], np.array(errors)[kept])
    return {
        "scheme": repr(scheme),
        "alpha": alpha,
        "solution": kind,
        "n_steps": int(table.n_steps[-1]),
        "error": f"{table.errors[-1]:.2e}",
        "order": f"{table.pairwise[-1]:.3f}",
        "proven": f"{scheme.order(alpha, kind):.2f}",
    }


def order_rows(labels, expected, found):
    """Rows of errors and orders: labels, then what {steps: (error, seconds)} tells."""
    rows, before = [], np.nan
    for n, (error, seconds) in found.items():
        told = {
            "n_steps": n,
            "error": f"{error:.3e}",
            "order": f"{np.log2(before / error):.3f}",
            "expected": f"{expected:.2f}",
            "milliseconds": f"{1e3 * seconds:.2f}",
        }
        rows.append(labels | told)
        before = error
    return rows


def check_orders(rows, labels, least=1e-11):
    """Check the last order of each kind of rows whose error is above rounding and modes."""
    last = {}
    for row in rows:
        if np.isfinite(row["order"]) and row["error"] > least:
            last[tuple(row[label] for label in labels)] = row
    for kind, row in last.items():
        claim = f"{', '.join(map(str, kind))}: order {row['order']:.2f}, {row['expected']:.2f} told"
        check(claim, row["order"] - row["expected"] > -0.15)


def _number(text):
    try:
        return float(text)
    except ValueError:
        return text


def check(statement, holds, quick=False):
    """Print whether a claim holds; a full run ends there when it does not.

    A quick run cannot judge claims about speed or large sizes: it passes `quick`.
    """
    if not holds and quick:
        print(f"not judged at this size: {statement}")
        return
    print(f"{'holds' if holds else 'FAILS'}: {statement}")
    if not holds:
        raise SystemExit(f"claim not met: {statement}")
