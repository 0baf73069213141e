"""What every study shares: its command line, rows, claims, times and figures."""

import argparse
import csv
import datetime
import os
import platform
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))  # the named problems

import matplotlib.pyplot as plt

import hereditary as hd
from hereditary.analysis.convergence import observed_order

RESULTS = Path(__file__).parent / "results"
CLAIMS = "claims.csv"
# Okabe and Ito's colours and three more, with a marker each.
COLORS = ["#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7"]
COLORS += ["#332288", "#882255", "#7A6A00", "#999999"]
STYLES = list(zip(COLORS, "*osD^v<>PXd", strict=True))


@dataclass(frozen=True)
class Claim:
    """A figure and its limits; `where` names the case, and several cases are one claim.

    A quick run cannot judge speed or large sizes: it judges only what is `small`. A claim without
    limits is a figure that is reported.
    """

    text: str
    figure: float
    at_most: float = np.inf
    at_least: float = -np.inf
    where: str = ""
    small: bool = False

    @property
    def holds(self):
        """Whether the figure is within the limits; nan is not."""
        limited = np.isfinite([self.at_most, self.at_least]).any()
        return not limited or bool(self.at_least <= self.figure <= self.at_most)

    @property
    def limit(self):
        """The limits in words."""
        words = [f"at least {self.at_least:g}"] if np.isfinite(self.at_least) else []
        words += [f"at most {self.at_most:g}"] if np.isfinite(self.at_most) else []
        return ", ".join(words)


def study(measure, claims=None, figure=None, **options):
    """Run the study of a script: measure its rows, draw them, and judge its claims.

    Parameters
    ----------
    measure : callable
        ``measure(quick)`` gives rows (dicts with equal keys), and claims and a figure of what no
        row holds.
    claims, figure : callable, optional
        Of the rows as they were written: the claims, and the figure.
    options : Any
        Options of the command line by name, with their default; `measure` is given them.
    """
    script = measure.__globals__
    own = Study(script["__file__"], script["__doc__"], **options)
    more = []
    if not own.stored:
        found = list(measure(own.quick, **{name: getattr(own.options, name) for name in options}))
        more = [one for one in found if isinstance(one, Claim)]
        own.write([one for one in found if isinstance(one, dict)])
        for drawn in (one for one in found if isinstance(one, plt.Figure)):
            own.save(drawn)
    rows = own.read()
    if figure:
        own.save(figure(rows))
    own.judge([*more, *(claims(rows) if claims else ())])


class Study:
    """One script's settings and results.

    Results of a quick run go to a temporary folder, those of a full one beside the script. What
    is given by name is an option of the command line with this value by default.
    """

    def __init__(self, script, claim, **options):
        parser = argparse.ArgumentParser(description=claim)
        parser.add_argument("--quick", action="store_true", help="a smoke test at small sizes")
        parser.add_argument("--stored", action="store_true", help="draw and judge the last rows")
        parser.add_argument("--folder", type=Path, help="where results go")
        for name, value in options.items():
            parser.add_argument(f"--{name}", type=type(value), default=value)
        self.options = parser.parse_args()
        self.quick, self.stored = self.options.quick, self.options.stored
        given = self.options.folder
        self._folder = given or (Path(tempfile.mkdtemp()) if self.quick else RESULTS)
        self._folder.mkdir(exist_ok=True, parents=True)
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
            _write(file, rows)
        widths = [max(len(k), *(len(str(r[k])) for r in rows)) for k in rows[0]]
        for cells in [rows[0].keys(), *(row.values() for row in rows)]:
            line = (str(cell).rjust(width) for cell, width in zip(cells, widths, strict=True))
            print("  ".join(line))

    def read(self):
        """The rows back, numbers as floats."""
        rows = read((RESULTS if self.stored else self._folder) / f"{self._name}.csv")
        return [{key: _number(value) for key, value in row.items()} for row in rows]

    def save(self, figure):
        """Save the figure and say where it is."""
        figure.savefig(self.path(".png"), dpi=150)
        print(f"{self._name}: {self.path('.csv')}, {self.path('.png')}")

    def judge(self, claims):
        """Print whether each claim holds, and write them; end a run in which one does not."""
        failed, told = [], {}
        for claim in claims:
            told.setdefault((claim.text, claim.limit), []).append(claim.figure)
            text = f"{', '.join(filter(None, (claim.text, claim.where)))}: {claim.figure:.4g}"
            text += f" ({claim.limit})" if claim.limit else ""
            judged = claim.holds or claim.small or not self.quick
            word = "holds" if claim.holds else "FAILS" if judged else "not judged at this size"
            print(f"{word if claim.limit else 'reported'}: {text}")
            failed += [text] if judged and not claim.holds else []
        self._register(told)
        if failed:
            raise SystemExit(f"claims not met: {'; '.join(failed)}")

    def _register(self, told):
        """Write claims by study, one row each; those that stored rows do not hold stay."""
        path, day = self._folder / CLAIMS, str(datetime.date.today())
        if self.stored:
            day = (RESULTS / f"{self._name}.csv").read_text().split(", ", 2)[1]
        new = [
            {"study": self._name, "claim": text, "measured": _range(figures, limit)}
            | {"limit": limit, "day": day}
            for (text, limit), figures in told.items()
        ]
        known = {row["claim"] for row in new}
        kept = [
            row
            for row in (read(path) if path.exists() else ())
            if row["study"] != self._name or (self.stored and row["claim"] not in known)
        ]
        with open(path, "w", newline="") as file:
            _write(file, sorted(kept + new, key=lambda row: row["study"]))


def _write(file, rows):
    writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


def read(path):
    """The rows of a CSV as texts, without its comments."""
    with open(path, newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def _range(figures, limit):
    """Figures of one claim in words: the one next to its limit, or the range."""
    ends = min(figures), max(figures)
    low, high = (f"{v:,.0f}" if 1e3 <= abs(v) < 1e6 else f"{v:.3g}" for v in ends)
    if low == high or ("most" in limit) != ("least" in limit):
        return low if "least" in limit else high
    return f"{low} to {high}"


def _number(text):
    try:
        return float(text)
    except ValueError:
        return text


def check(statement, holds, quick=False):
    """Print whether a claim holds; a full run ends there when it does not."""
    if not holds and quick:
        print(f"not judged at this size: {statement}")
        return
    print(f"{'holds' if holds else 'FAILS'}: {statement}")
    if not holds:
        raise SystemExit(f"claim not met: {statement}")


# Rows and times.


def chosen(rows, **wanted):
    """Rows that have the wanted values in some columns."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def fastest(call, times=9, within=1.5, warm=True):
    """Return the seconds of the fastest of several calls, and what the last one gave.

    A call before warms it up; calls end when they have taken `within` seconds.
    """
    if warm:
        call()
    best, ends = np.inf, time.perf_counter() + within
    for _ in range(times):
        began = time.perf_counter()
        found = call()
        now = time.perf_counter()
        best = min(best, now - began)
        if now > ends:
            break
    return best, found


def in_turns(calls, times, clock=time.perf_counter):
    """Return the least seconds of each call by name; in turns, all see the same machine."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(times):
        for name, call in calls.items():
            began = clock()
            call()
            best[name] = min(best[name], clock() - began)
    return best


def last_order(scheme, alpha, kind, counts, errors, floor):
    """Return a row: the last pairwise order of errors above `floor`, beside the proven one."""
    kept = np.array(errors) > floor
    counts, errors = np.array(counts)[kept], np.array(errors)[kept]
    return {
        "scheme": repr(scheme),
        "alpha": alpha,
        "solution": kind,
        "n_steps": int(counts[-1]),
        "error": f"{errors[-1]:.2e}",
        "order": f"{observed_order(counts, errors)[0][-1]:.3f}",
        "proven": f"{scheme.order(alpha, kind):.2f}",
    }


def last_order_claims(rows):
    """Claims of rows by `last_order`."""
    for row in rows:
        off, where = abs(row["order"] - row["proven"]), f"{row['scheme']}, {row['alpha']:g}"
        yield Claim(f"orders off the proven ones, {row['solution']}", off, 0.15, where=where)


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


def order_claims(rows, labels, least=1e-11):
    """Claims of the last order of each kind of rows whose error is above rounding and modes."""
    last = {}
    for row in rows:
        if np.isfinite(row["order"]) and row["error"] > least:
            last[tuple(row[label] for label in labels)] = row
    for kind, row in last.items():
        less, where = row["expected"] - row["order"], ", ".join(map(str, kind))
        yield Claim("observed orders less than expected by", less, 0.15, where=where, small=True)


# Figures.


def curves(x, y, lines=(), panels=(), log="xy", slopes=(), line="-", of=None, **settings):
    """Return what draws rows: a panel for each value of some columns, a line for each of others.

    A second column of `y` is drawn dotted. `slopes` are orders drawn beside, `settings` those of
    each panel. `of` has the values that some columns of the rows must have.
    """
    y, *beside = (y,) if isinstance(y, str) else y

    def draw(rows, figure=None):
        rows = chosen(rows, **(of or {}))
        kinds = list(dict.fromkeys(_label(row, lines) for row in rows))
        titles = list(dict.fromkeys(_label(row, panels) for row in rows))
        columns = min(len(titles), 4)
        size = (3 + 3.2 * columns, 0.6 + 3.6 * -(-len(titles) // columns))
        figure = figure or plt.figure(figsize=size, layout="constrained")
        shape = {"sharey": True, "squeeze": False}
        axes = figure.subplots(-(-len(titles) // columns), columns, **shape)
        for ax in axes.flat[len(titles) :]:
            ax.axis("off")
        for ax, title in zip(axes.flat, titles, strict=False):
            here = [row for row in rows if _label(row, panels) == title]
            for number, kind in enumerate(kinds):
                mine = [row for row in here if _label(row, lines) == kind and row[x] != ""]
                color, marker = STYLES[number % len(STYLES)]
                fill = color if number < len(STYLES) else "white"
                for column, style in [(y, marker + line), *((other, ":") for other in beside)]:
                    points = [(row[x], row[column]) for row in mine if row[column] != ""]
                    label = (kind or None) if column == y else None
                    how = {"color": color, "ms": 4, "lw": 1, "mfc": fill}
                    ax.plot(*np.reshape(points, (-1, 2)).T, style, **how, label=label)
            ax.set(xlabel=x.replace("_", " "), title=title, **{f"{a}scale": "log" for a in log})
            ends = np.array([row[x] for row in here if row[x] != ""])[[0, -1]]
            top = max((row[y] for row in here if row[x] == ends[0] and row[y] != ""), default=1.0)
            for order in slopes:
                known = ends, top * (ends / ends[0]) ** -order
                ax.plot(*known, "k:", lw=0.8, label=f"order {order} (dotted)")
            if "x" in log:
                ax.xaxis.set_minor_formatter("")
            ax.set(**settings)
            ax.grid(alpha=0.3)
        for ax in axes[:, 0]:
            ax.set_ylabel(settings.get("ylabel", " (line), ".join([y, *beside]).replace("_", " ")))
        if any(kinds):
            handles = axes.flat[0].get_legend_handles_labels()
            figure.legend(*handles, loc="outside right center", fontsize=8)
        return figure

    return draw


def last_orders(rows):
    """Draw rows by `last_order`: observed orders as marks, proven ones dotted."""
    how = {"log": "", "line": "", "xlabel": r"$\alpha$"}
    return curves("alpha", ("order", "proven"), ("scheme",), ("solution",), **how)(rows)


def side_by_side(*draws):
    """Return what draws several of these beside each other."""

    def draw(rows):
        figure = plt.figure(figsize=(5 * len(draws), 5), layout="constrained")
        for part, one in zip(figure.subfigures(1, len(draws)), draws, strict=True):
            one(rows, part)
        return figure

    return draw


def orders(lines=("scheme",), panels=(), slopes=(1, 2), **settings):
    """Return what draws errors against steps."""
    return curves("n_steps", "error", lines, panels, slopes=slopes, **settings)


def bars(y, label, log="", **settings):
    """Return what draws rows as bars with their figures, a label of some columns each."""

    def draw(rows):
        shown = [row for row in rows if row[y] != ""]
        figure, ax = plt.subplots(figsize=(7.5, 1 + 0.25 * len(shown)), layout="constrained")
        labels = [_label(row, label) for row in shown]
        found = ax.barh(range(len(shown)), [row[y] for row in shown], color="#56B4E9")
        ax.bar_label(found, [f"{row[y]:.3g}" for row in shown], padding=3, fontsize=8)
        ax.set_yticks(range(len(shown)), labels, fontsize=8)
        ax.invert_yaxis()
        ax.margins(x=0.12)
        ax.set(xlabel=y.replace("_", " "), **({"xscale": "log"} if log else {}), **settings)
        return figure

    return draw


def _label(row, columns):
    """Name of a row's panel or line: texts, and numbers with their columns."""
    values = [(key, row[key]) for key in columns if row[key] != ""]
    return ", ".join(v if isinstance(v, str) else f"{k} {v:g}" for k, v in values)
