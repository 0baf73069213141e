"""The installed package: caching across processes and edits, what import pulls in, its examples."""

import doctest
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
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
from hereditary.kernels import march, modes, convolution
hd.solve(hd.scenes.stick_slip(), 1.0, 100)
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, 100)
entry = march.march_explicit.dispatcher
print(len(entry.overloads), sum(entry.stats.cache_hits.values()),
      sum(modes.exchange_modes.stats.cache_hits.values()))
"""


@compiled
def test_solver_loops_compile_once_per_machine_whatever_the_function(tmp_path):
    assert python(SOLVE, tmp_path) == "1 0 0"
    assert python(SOLVE, tmp_path) == "1 1 1"


STATS = """
import hereditary as hd
from hereditary.kernels import march, block, modes, convolution
print(hd.solve(hd.scenes.stick_slip(), 1.0, 100).y[-1, 0])
for f in (march.march_explicit.dispatcher, block.open_block, modes.exchange_modes):
    print(f.__name__, sum(f.stats.cache_hits.values()), sum(f.stats.cache_misses.values()))
"""


@compiled
def test_an_edited_helper_compiles_its_callers_anew_and_only_those(tmp_path):
    """numba itself looks only at the file that defines the cached function."""
    copy = tmp_path / "copy"
    shutil.copytree(SOURCE, copy / "hereditary", ignore=shutil.ignore_patterns("__pycache__"))

    def run():
        first, *rows = python(STATS, tmp_path / "cache", copy).split("\n")
        return float(first), {row.split()[0]: row.split()[1:] for row in rows}

    def edit(name, old, new):
        helper = copy / "hereditary" / "kernels" / name
        assert old in helper.read_text()
        helper.write_text(helper.read_text().replace(old, new))

    before, _ = run()
    edit("modes.py", "f0 * r0[j]", "2.0 * f0 * r0[j]")
    after, counts = run()
    assert before != after
    assert counts["exchange_modes"] == ["0", "1"]
    assert counts["march_explicit"] == ["1", "0"]  # takes histories as function values
    # words and lines that move compile nothing anew
    edit("block.py", '"""', '"""\n\n')
    assert run() == (after, counts | {"exchange_modes": ["1", "0"]})
    edit("block.py", "1e300", "1e299")  # in a function that is inlined into the march
    assert run()[1]["march_explicit"] == ["0", "1"]


TINY = """
from hereditary._jit import F8, entry, kernel

@kernel
def doubled(x):
    return 2.0 * x

@entry(F8)
def more(x):
    return doubled(x) + 1.0
"""
# The result, and how often an entry was found and missed.
CALL = (
    "import sys; sys.path.insert(0, {!r}); import tiny; print(tiny.more(3.0), "
    "*(sum(f.values()) for f in (tiny.more.dispatcher.stats.cache_hits, "
    "tiny.more.dispatcher.stats.cache_misses)))"
)


@compiled
def test_damaged_entries_and_a_missing_folder_cost_no_more_than_time(tmp_path):
    (tmp_path / "tiny.py").write_text(TINY)
    cache, code = tmp_path / "cache", CALL.format(str(tmp_path))
    assert python(code, cache).split()[0] == "7.0"
    assert python(code, cache) == "7.0 1 0"
    for ending, left in (("nbc", b""), ("nbi", b""), ("nbc", None)):
        for path in cache.rglob(f"*.{ending}"):
            data = path.read_bytes()
            middle = data[: len(data) // 2]
            path.write_bytes(middle + b"?" + data[len(middle) + 1 :] if left is None else left)
        assert python(code, cache) == "7.0 0 1"
    assert python(code, cache) == "7.0 1 0"
    nowhere = tmp_path / "file" / "cache"  # no folder can be made there
    nowhere.parent.write_text("")
    environment = {"NUMBA_CACHE_DIR": str(nowhere), "HOME": str(nowhere)}
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", code],
        env=os.environ | environment | {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split()[0] == "7.0"
    assert done.stderr.count("compiled code cannot be kept on disk") == 1


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
        "import sys, hereditary; print([m for m in ('matplotlib', 'scipy.linalg', 'scipy.integrate'"
        ", 'scipy.optimize') if m in sys.modules]); hereditary.plots; print('matplotlib' in"
        " sys.modules)"
    )
    assert python(code, tmp_path).split("\n") == ["[]", "True"]


def test_public_names():
    for name in hereditary.__all__:
        assert getattr(hereditary, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = hereditary.nonsense


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE).failed == 0


PAGES = ["README.md"]
PAGES += [f"docs/{name}.md" for name in ("start", "collocation", "kernels")]


@pytest.mark.parametrize("page", PAGES)
def test_examples_in_pages(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write files
    text = (ROOT / page).read_text()
    blocks = [block.split("```")[0] for block in text.split("```python\n")[1:]]
    assert blocks
    exec("\n".join(blocks), {})


def test_exact_is_there_without_an_import_of_its_own(tmp_path):
    seen = "import sys, hereditary as hd; print('pymittagleffler' in sys.modules, end=' ')\n"
    assert python(seen + "print(hd.exact.relaxation()(0.0)[0])", tmp_path) == "False 1.0"
    missing = "import sys; sys.modules['pymittagleffler'] = None; import hereditary as hd\n"
    told = "try:\n    hd.exact\nexcept ImportError as error:\n    print(error)"
    assert python(missing + told, tmp_path).endswith("pip install hereditary[exact]")
