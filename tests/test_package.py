"""The installed package: what import pulls in, its names, and examples in its pages."""

import csv
import doctest
import importlib
import pkgutil
import tomllib
from pathlib import Path

import pytest
from fresh_process import python

import hereditary

pytestmark = pytest.mark.rounding

ROOT = Path(__file__).parent.parent
MODULES = sorted(
    name
    for _, name, _ in pkgutil.walk_packages(hereditary.__path__, "hereditary.")
    if not name.endswith("__main__")
)


def test_import_is_light(tmp_path):
    code = (
        "import sys, scipy.special; known = {*sys.modules}; import hereditary; print({'matplotlib',"
        " 'scipy.linalg', 'scipy.integrate', 'scipy.optimize'} & sys.modules.keys() - known);"
        " hereditary.plots; print('matplotlib' in sys.modules)"
    )
    assert python(code, tmp_path).split("\n") == ["set()", "True"]


def test_public_names():
    for name in hereditary.__all__:
        assert getattr(hereditary, name).__doc__


@pytest.mark.estimates
@pytest.mark.parametrize("name", ["hereditary", *MODULES])
def test_examples_in_docstrings(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE).failed == 0


PAGES = [
    "start", "equations", "functions", "resuming", "choosing", "faq", "lyapunov", "step",
    "collocation", "kernels", "memory_terms", "varying_orders", "derivatives", "viscoelastic",
    "events", "friction", "cannot_see", "sweeps", "fitting", "chaos", "frequency_response",
    "scenes", "recipes", "delays", "distributed_memory", "algebraic_rows", "maps", "noise",
    "coming_from", "which_derivative", "large_systems", "thousands_of_runs",
]  # fmt: skip


@pytest.mark.estimates
@pytest.mark.parametrize("page", ["README.md", *(f"docs/{name}.md" for name in PAGES)])
def test_examples_in_pages(page, tmp_path, monkeypatch, capsys):
    """They run, and print what the page shows."""
    monkeypatch.chdir(tmp_path)  # some write files
    text = (ROOT / page).read_text()
    blocks, shown = (
        [block.split("```")[0] for block in text.split(f"```{kind}\n")[1:]]
        for kind in ("python", "text")
    )
    assert blocks
    exec("\n".join(blocks), {})
    printed = capsys.readouterr().out
    for output in shown:
        assert output in printed


def test_the_readme_installs_and_tests_by_one_line_each_as_ci_does():
    page = (ROOT / "README.md").read_text()
    tested = 'python -m pip install "hereditary[test]" && python -m pytest -m core'
    for line in "python -m pip install . && python -m hereditary", tested:
        assert f"\n```\n{line}\n```\n" in page
    stages = (ROOT / ".ci" / "run").read_text()
    assert 'python -m pip install --quiet ".[$extras]"' in stages
    assert "pytestmark = pytest.mark.core" in stages


def test_the_times_of_the_readme_are_those_of_the_study():
    with open(ROOT / "convergence" / "results" / "readme_table.csv") as file:
        lines = (line for line in file if not line.startswith("#"))
        spent = {row["code"]: float(row["ms"]) for row in csv.DictReader(lines)}
    shown = [f"{ms:.0f} ms" if ms > 10 else f"{ms:.2g} ms" for ms in spent.values()]
    assert f"of order 0.5 | {' | '.join(shown)} |" in (ROOT / "README.md").read_text()


def test_every_status_has_a_remedy():
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    for status in hereditary.Status:
        assert f"| `{status}` | {status.sentence} | " in page


def test_exact_is_there_without_an_import_of_its_own(tmp_path):
    seen = "import sys, hereditary as hd; print('pymittagleffler' in sys.modules, end=' ')\n"
    assert python(seen + "print(hd.exact.relaxation()(0.0)[0])", tmp_path) == "False 1.0"
    missing = "import sys; sys.modules['pymittagleffler'] = None; import hereditary as hd\n"
    told = "try:\n    hd.exact\nexcept ImportError as error:\n    print(error)"
    assert python(missing + told, tmp_path).endswith("pip install hereditary[exact]")


def test_version_and_address_are_the_same_everywhere():
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {hereditary.__version__}\n" in citation
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == hereditary.__version__
    assert f"\nrepository-code: {project['urls']['Source']}\n" in citation
    changelog = (ROOT / "CHANGELOG.md").read_text()
    assert f"version, {hereditary.__version__}." in changelog or (
        f"## [{hereditary.__version__}]" in changelog
    )
