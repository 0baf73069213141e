"""The page docs/measured.md: every claim of every study, from results/claims.csv.

Nothing is measured here. A full run writes the page, a quick one compares it.
"""

import ast
import sys
from pathlib import Path

from _study import CLAIMS, RESULTS, read

PAGE = Path(__file__).parent.parent / "docs" / "measured.md"
HEAD = """# Measured claims

Every figure of accuracy and speed is measured by a [study](made/studies/index.md), and each study
fails if a figure exceeds its limit. The limits allow for other machines and days. A figure
without a limit is only reported. If several cases share a claim, the figure next to the limit is
shown; without a limit, the range. P1 to P6 are the problems of
[work_precision](made/studies/work_precision.md).

The machine has two shared cores of an AMD EPYC, with Python 3.11. `python convergence/measured.py`
writes this page from `convergence/results/claims.csv`.
"""
SECTIONS = {
    "Accuracy and orders": "orders explicit_order graded_meshes imex riemann_liouville memory_terms"
    " varying_orders stability published_rules models derivatives delays sliding",
    "Steps chosen by a tolerance": "collocation undamped coincidences work_precision peers"
    " readme_table campaign solve_ivp",
    "Errors of given steps": "estimates",
    "Memory and kernels": "memory_is_nearly_free histories exponential_sum_modes memory_kernels"
    " random_kernels kernels_and_sticking viscoelastic_responses laplace_kernels",
    "Large systems, ensembles and sweeps": "large_systems large_compared stick_slip_chain ensembles"
    " thousands_of_runs sweeps paper_spectra",
    "Exponents, resonance and fits": "lyapunov_rows lyapunov_cost chaos_tests resonance fits",
    "Start and short runs": "start_up short_runs python_functions",
}


def page():
    """Return the text of the page; a study without claims or a section is an error."""
    anchors = {title: title.lower().replace(",", "").replace(" ", "-") for title in SECTIONS}
    links = "\n".join(f"- [{title}](#{anchor})" for title, anchor in anchors.items())
    text, claims = f"{HEAD}\n{links}\n", {}
    for row in read(RESULTS / CLAIMS):
        claims.setdefault(row["study"], []).append(row)
    for title, names in SECTIONS.items():
        text += f"\n## {title}\n"
        for name in names.split():
            script = Path(__file__).with_name(f"{name}.py")
            summary = ast.get_docstring(ast.parse(script.read_text())).split("\n\n")[0]
            rows = claims.pop(name)
            days = sorted({row["day"] for row in rows})
            text += f"\n{' '.join(summary.replace('``', '`').split())}\n"
            text += f"([{name}](made/studies/{name}.md), {' and '.join(days)})\n\n"
            text += "| claim | measured | limit |\n|---|---:|---:|\n"
            for row in rows:
                text += f"| {row['claim']} | {row['measured']} | {row['limit']} |\n"
    if claims:
        raise SystemExit(f"studies without a section: {', '.join(claims)}")
    return text


if __name__ == "__main__":
    if "--quick" not in sys.argv[1:]:
        PAGE.write_text(page())
    elif PAGE.read_text() != page():
        raise SystemExit("docs/measured.md is not what claims.csv gives: run this without --quick")
