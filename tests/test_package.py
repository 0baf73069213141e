"""The installed package: caching across processes and edits, what import pulls in, its examples."""

import doctest
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import hereditary

ROOT = Path(__file__).parent.parent
SOURCE = Path(hereditary.__file__).parent
MODULES = sorted(
    name
    for _, name, _ in pkgutil.walk_packages(hereditary.__path__, "hereditary.")
    if not name.endswith("__main__")
)
compiled = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"
)


def python(code, cache, path=SOURCE.parent):
    """What `code` prints in a fresh process."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(path)}
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


SOLVE = """
import hereditary as hd
from hereditary.compiled import march, past
hd.solve(hd.scenes.stick_slip(), 1.0, 100)
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, 100)
entry = march.MARCHES["explicit"].dispatcher
print(len(entry.overloads), sum(entry.stats.cache_hits.values()),
      sum(past.exchange_modes.stats.cache_hits.values()))
"""


@compiled
def test_solver_loops_compile_once_per_machine_whatever_the_function(tmp_path):
    assert python(SOLVE, tmp_path) == "1 0 0"
    assert python(SOLVE, tmp_path) == "1 1 1"


@pytest.fixture
def package(tmp_path):
    """A copy of the package that may be edited, in a folder of its own."""
    ignored = shutil.ignore_patterns("__pycache__")
    return Path(shutil.copytree(SOURCE, tmp_path / "copied" / "hereditary", ignore=ignored))


TINY = """
from .compiled.jit import F8, entry, inlined, compiled
from .limit import LIMIT

@compiled
def doubled(x):
    \"\"\"Double.\"\"\"
    return 2.0 * x

@inlined
def raised(x):
    return x + LIMIT

@entry(F8)
def more(x):
    return doubled(x) + 1.0

@entry(F8)
def higher(x):
    return raised(x)
"""
# Results of both, and how often an entry of each was found and missed; {} comes before the calls.
CALL = """
from hereditary import tiny
{}
for f in tiny.more, tiny.higher:
    stats = f.dispatcher.stats
    print(f(3.0), sum(stats.cache_hits.values()), sum(stats.cache_misses.values()), end=" ")
"""
EDITED = """
from pathlib import Path
file = Path(tiny.__file__)
file.write_text(file.read_text().replace("2.0 * x", "5.0 * x"))
"""


@compiled
def test_an_edit_anywhere_in_the_package_compiles_anew(package, tmp_path):
    """numba itself looks only at the file that defines the cached function."""
    (package / "tiny.py").write_text(TINY)
    (package / "limit.py").write_text("LIMIT = 1.0")

    def run(before=""):
        return python(CALL.format(before), tmp_path / "cache", package.parent)

    assert run() == "7.0 0 1 4.0 0 1"
    assert run(EDITED) == "7.0 1 0 4.0 1 0"  # of the code that this process loaded
    assert run() == "16.0 0 1 4.0 0 1"
    (package / "limit.py").write_text("LIMIT = 2.0")  # what an inlined helper reads
    assert run() == "16.0 0 1 5.0 0 1"
    assert run() == "16.0 1 0 5.0 1 0"
    assert len(list((tmp_path / "cache").rglob("tiny.*"))) == 6  # of an edit none is left over


@compiled
def test_code_that_is_compiled_after_an_edit_is_not_stored_as_that_of_the_edit(package, tmp_path):
    (package / "tiny.py").write_text(TINY)
    (package / "limit.py").write_text("LIMIT = 1.0")
    for before, expected in (EDITED, "7.0 0 1 4.0 0 1"), ("", "16.0 0 1 4.0 0 1"):
        assert python(CALL.format(before), tmp_path / "cache", package.parent) == expected


LINKED = """
from .compiled.jit import F8, entry, inner, reordered

@inner
def halved(x):
    if x < 0.0:
        raise ValueError("below 0")
    return 0.5 * x

@reordered
def added(x):
    return halved(x) + halved(x)

@entry(F8, told="the sum")
def summed(x):
    return added(x)

@entry(F8)
def half(x):
    return halved(x)

def print_all():
    print(summed(3.0), half(3.0), end=" ")
    try:
        summed(-1.0)
    except ValueError as error:
        print(error)
"""


@compiled
def test_linked_helpers_belong_to_each_loop_and_raise_there(package, tmp_path):
    """Also where the loop comes from the disk, when standard error has nothing to tell."""
    (package / "linked.py").write_text(LINKED)
    call = [sys.executable, "-c", "from hereditary import linked; linked.print_all()"]
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(package.parent)}
    told = "hereditary: compiling the sum, once on this machine ...\n"
    for message in (told, ""):
        done = subprocess.run(
            call,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout == "3.0 1.5 below 0\n"
        assert done.stderr == message
    assert not list((tmp_path / "cache").rglob("*halved*"))


@compiled
def test_damaged_entries_and_a_missing_folder_cost_no_more_than_time(package, tmp_path):
    (package / "tiny.py").write_text(TINY)
    (package / "limit.py").write_text("LIMIT = 1.0")
    cache, code = tmp_path / "cache", CALL.format("")
    assert python(code, cache, package.parent) == "7.0 0 1 4.0 0 1"
    for ending in ("nbc", "nbi"):
        for path in cache.rglob(f"*.{ending}"):
            path.write_bytes(path.read_bytes()[:-20])
        assert python(code, cache, package.parent) == "7.0 0 1 4.0 0 1"
    assert python(code, cache, package.parent) == "7.0 1 0 4.0 1 0"
    nowhere = tmp_path / "file" / "cache"  # no folder can be made there, nor beside the file
    nowhere.parent.write_text("")
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    (package / "__pycache__").write_text("")
    environment = {
        "NUMBA_CACHE_DIR": str(nowhere), "HOME": str(nowhere), "PYTHONPATH": str(package.parent)
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split()[0] == "7.0"
    assert done.stderr.count("compiled code cannot be kept on disk") == 1


MISSING = """
import warnings
import numba
from numba.core import caching, codegen, dispatcher
{}
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    import hereditary
    from hereditary.compiled import numba_internals as found
told = [str(each.message) for each in told if each.category is RuntimeWarning]
assert all(f"plain numba {{numba.__version__}}" in message for message in told)
print(len(told), *map(int, (found.LINKED, found.VALUES, found.STORED)))
"""


@compiled
@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        ("", "0 1 1 1"),
        ("del codegen.CPUCodeLibrary._finalize_dynamic_globals", "1 0 1 1"),
        ("dispatcher.Dispatcher.get_compile_result = lambda self, other: 1", "1 1 0 1"),
        ("del caching.Cache._index_key", "1 1 1 0"),
        ("import os; os.environ['HEREDITARY_PLAIN_NUMBA'] = '1'", "1 0 0 0"),
    ],
)
def test_plain_numba_stands_in_for_what_it_lacks_and_that_is_told_once(missing, expected, tmp_path):
    code = "import os; os.environ.pop('HEREDITARY_PLAIN_NUMBA', None)\n" + MISSING.format(missing)
    assert python(code, tmp_path) == expected


INTERRUPTED = """
import signal
import hereditary as hd
equation, interrupted = hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 0
signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
while interrupted < 3:
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3, 0.3)
        if hd.solve(equation, 10.0, 100).success:
            break
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0)
        interrupted += 1
signal.setitimer(signal.ITIMER_REAL, 0)
print(interrupted, hd.solve(equation, 10.0, 100).success)
"""


@compiled
def test_interrupting_a_compilation_leaves_the_process_whole(tmp_path):
    assert python(INTERRUPTED, tmp_path) == "3 True"


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


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE).failed == 0


PAGES = ["README.md"]
PAGES += [
    f"docs/{name}.md"
    for name in (
        "start",
        "equations",
        "functions",
        "resuming",
        "choosing",
        "faq",
        "lyapunov",
        "step",
        "collocation",
        "kernels",
        "memory_terms",
        "varying_orders",
        "derivatives",
        "viscoelastic",
        "events",
        "sweeps",
        "fitting",
        "chaos",
        "frequency_response",
        "scenes",
        "recipes",
        "coming_from",
        "which_derivative",
        "large_systems",
    )
]


@pytest.mark.parametrize("page", PAGES)
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
    tested = 'python -m pip install ".[test]" && python -m pytest'
    for line in "python -m pip install . && python -m hereditary", tested:
        assert f"\n```\n{line}\n```\n" in page
    assert f"\n{tested} || exit 1\n" in (ROOT / ".ci" / "run").read_text()


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
