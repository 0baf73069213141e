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


@compiled
def test_an_edited_helper_is_never_served_from_an_old_cache(tmp_path):
    """numba itself looks only at the file that defines the cached function."""
    copy = tmp_path / "copy"
    shutil.copytree(SOURCE, copy / "hereditary", ignore=shutil.ignore_patterns("__pycache__"))
    code = "import hereditary as hd; print(hd.solve(hd.scenes.stick_slip(), 1.0, 100).y[-1, 0])"
    before = python(code, tmp_path / "cache", copy)
    helper = copy / "hereditary" / "kernels" / "modes.py"
    text = helper.read_text()
    assert "f0 * r0[j]" in text
    helper.write_text(text.replace("f0 * r0[j]", "2.0 * f0 * r0[j]"))
    after = python(code, tmp_path / "cache", copy)
    assert before != after


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
