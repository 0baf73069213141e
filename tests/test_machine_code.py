"""Machine code on disk: across processes and edits, with the package, damaged or not for us."""

import ast
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import pytest
from decorators import DECORATORS
from fresh_process import SOURCE, fresh, python

from hereditary.compiled.cache import SHIPPED, Target

compiled = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"
)


SOLVE = """
import hereditary as hd
from hereditary.given import (march, past)
hd.solve(hd.scenes.stick_slip(), 1.0, 100, estimate=False)
hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, 100, estimate=False)
entry = march.MARCHES["explicit"].dispatcher
print(len(entry.overloads), sum(entry.stats.cache_hits.values()),
      sum(past.exchange_modes.stats.cache_hits.values()))
"""


@compiled
def test_solver_loops_compile_once_per_machine_whatever_the_function(package, tmp_path):
    assert python(SOLVE, tmp_path, package.parent) == "1 0 0"
    assert python(SOLVE, tmp_path, package.parent) == "1 1 1"


def copied_package(folder):
    """Return a copy of the package in a folder, without machine code."""
    ignored = shutil.ignore_patterns("__pycache__", SHIPPED.name)
    return Path(shutil.copytree(SOURCE, folder / "copied" / "hereditary", ignore=ignored))


@pytest.fixture
def package(tmp_path):
    """A copy of the package that may be edited."""
    return copied_package(tmp_path)


TINY = """
from .compiled.jit import F8, entry, inner, compiled
from .compiled.limit import LIMIT

@compiled
def doubled(x):
    \"\"\"Double.\"\"\"
    return 2.0 * x

@inner
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


def append(path):
    """Add a comment to a file."""
    path.write_text(path.read_text() + "# edited")


@pytest.fixture
def tiny(package):
    return with_tiny(package)


def with_tiny(package, options="F8"):
    """Add the module `tiny` to a package, which then imports nothing else by itself."""
    (package / "__init__.py").write_text("")
    (package / "tiny.py").write_text(TINY.replace("@entry(F8)", f"@entry({options})"))
    (package / "compiled" / "limit.py").write_text("LIMIT = 1.0")
    return package


@compiled
def test_an_edit_of_what_is_compiled_compiles_anew(tiny, tmp_path):
    """numba itself looks only at the file that defines the cached function."""

    def run(before=""):
        return python(CALL.format(before), tmp_path / "cache", tiny.parent)

    assert run() == "7.0 0 1 4.0 0 1"
    assert run(EDITED) == "7.0 1 0 4.0 1 0"  # of the code that this process loaded
    assert run() == "16.0 0 1 4.0 0 1"
    (tiny / "compiled" / "limit.py").write_text("LIMIT = 2.0")  # what an inner helper reads
    assert run() == "16.0 0 1 5.0 0 1"
    for elsewhere in ("plots/lines.py", "stepping/status.py", "analysis/table.py"):
        append(tiny / elsewhere)
    assert run() == "16.0 1 0 5.0 1 0"
    assert len(list((tmp_path / "cache").rglob("*tiny.*"))) == 6  # of an edit none is left over


def sources(path, node):
    """Return files of the package from which an import statement takes names, by name."""
    folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
    return {
        alias.asname or alias.name: next(
            (file for file in (folder / f"{alias.name}.py", folder.with_suffix(".py"))
             if file.exists()),
            folder / "__init__.py",
        )
        for alias in node.names
    }  # fmt: skip


def test_compiled_functions_use_files_that_compile_of_their_own_room_and_of_compiled():
    """So one digest of these files tells of every change."""
    seen = 0
    for path in sorted(SOURCE.rglob("*.py")):
        room, tree, origin = path.relative_to(SOURCE).parts[0], ast.parse(path.read_text()), {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                origin |= sources(path, node)
        for node in ast.walk(tree):
            found = getattr(node, "decorator_list", ())
            if {getattr(getattr(each, "func", each), "id", "") for each in found} & DECORATORS:
                seen += 1
                used = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
                for name in used & origin.keys():
                    own = origin[name].relative_to(SOURCE).parts[0]
                    digested = own == room and "jit import" in origin[name].read_text()
                    assert digested or own == "compiled", f"{path}, {node.name}, {name}"
    assert seen > 150


@compiled
def test_code_that_is_compiled_after_an_edit_is_not_stored_as_that_of_the_edit(tiny, tmp_path):
    for before, expected in (EDITED, "7.0 0 1 4.0 0 1"), ("", "16.0 0 1 4.0 0 1"):
        assert python(CALL.format(before), tmp_path / "cache", tiny.parent) == expected


LINKED = """
from .compiled.jit import F8, entry, inner

@inner
def halved(x):
    if x < 0.0:
        raise ValueError("below 0")
    return 0.5 * x

@inner(reorders=True)
def added(x):
    return halved(x) + halved(x)

@entry(F8, announced="the sum")
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
    (package / "__init__.py").write_text("")
    (package / "linked.py").write_text(LINKED)
    call = "from hereditary import linked; linked.print_all()"
    told = "hereditary: compiling the sum, once on this machine (no installed code is used: "
    told += "this is an editable installation, or a folder of sources) ...\n"
    for message in (told, ""):
        expected = "3.0 1.5 below 0", message
        assert fresh(call, tmp_path / "cache", package.parent, "default") == expected
    assert not list((tmp_path / "cache").rglob("*halved*"))


@compiled
def test_damaged_entries_and_a_missing_folder_cost_no_more_than_time(tiny, tmp_path):
    cache, code = tmp_path / "cache", CALL.format("")
    assert python(code, cache, tiny.parent) == "7.0 0 1 4.0 0 1"
    for ending in ("nbc", "nbi"):
        for path in cache.rglob(f"*.{ending}"):
            path.write_bytes(path.read_bytes()[:-20])
        assert python(code, cache, tiny.parent) == "7.0 0 1 4.0 0 1"
    assert python(code, cache, tiny.parent) == "7.0 1 0 4.0 1 0"
    nowhere = tmp_path / "file" / "cache"  # no folder can be made there, nor beside the file
    nowhere.parent.write_text("")
    shutil.rmtree(tiny / "__pycache__", ignore_errors=True)
    (tiny / "__pycache__").write_text("")
    homes = {"HOME": str(nowhere), "XDG_CACHE_HOME": str(nowhere)}
    printed, said = fresh(code, nowhere, tiny.parent, "always", **homes)
    assert printed.split()[0] == "7.0"
    assert said.count("compiled code cannot be kept on disk") == 1


MOVED = """
import os
from pathlib import Path
from hereditary.compiled import cache
cache.SHIPPED.mkdir()
for path in Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*tiny*.nb[ci]"):
    path.rename(cache.SHIPPED / path.name)
cache.note_target(cache.SHIPPED)
"""


ANNOUNCED = "F8, announced='it'"


@pytest.fixture(scope="module")
def carrying(tmp_path_factory):
    """A copy of the package that carries the machine code of `tiny`."""
    folder = tmp_path_factory.mktemp("carrying")
    package = with_tiny(copied_package(folder), ANNOUNCED)
    assert python(CALL.format(""), folder / "made", package.parent) == "7.0 0 1 4.0 0 1"
    python(MOVED, folder / "made", package.parent)
    return package


@pytest.fixture
def carried(carrying, tmp_path):
    """Another copy of it, which a test may damage."""
    return shutil.copytree(carrying, tmp_path / "carried" / carrying.name)


def run_tiny(package, cache, **more):
    """Return what a fresh process prints that calls the functions of `tiny`."""
    return fresh(CALL.format(""), cache, package.parent, "error", **more)


def targets(package):
    """Return the file of the target, and what it says."""
    file = package / SHIPPED.name / "made_for.json"
    return file, json.loads(file.read_text())


CARRIED = "7.0 1 0 4.0 1 0", ""
COMPILED = "7.0 0 1 4.0 0 1"


def told(reason):
    """Return what a process tells that compiles both functions of `tiny` for a reason."""
    once = "hereditary: compiling it, once on this machine"
    return f"{once} (no installed code is used: {reason}) ...\n" * 2


OTHER = "it is for other sources or options"


@compiled
def test_code_comes_with_the_package_which_is_only_read(carried, tmp_path):
    """Also where no cache can be made, and from a numba that differs in the last number."""
    files = {path: path.read_bytes() for path in (carried / SHIPPED.name).iterdir()}
    for path in carried.rglob("*"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    nowhere = tmp_path / "file"
    nowhere.write_text("")
    assert run_tiny(carried, nowhere / "cache", HOME=str(nowhere)) == CARRIED
    assert {path: path.read_bytes() for path in (carried / SHIPPED.name).iterdir()} == files
    for path in carried.rglob("*"):
        path.chmod(0o755)
    file, target = targets(carried)
    other = target["numba"].rsplit(".", 1)[0] + ".77"
    for path in file.parent.glob("*.nbi"):
        content = BytesIO(path.read_bytes())
        assert pickle.load(content) == target["numba"]
        path.write_bytes(pickle.dumps(other) + content.read())
    file.write_text(json.dumps(target | {"numba": other}))
    assert run_tiny(carried, tmp_path / "cache") == CARRIED
    assert not list((tmp_path / "cache").rglob("*.nb?"))


@compiled
@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"numba": "0.1.0"}, "numba 0.1.0, and this is {numba}"),
        ({"python": "cpython-210"}, "cpython-210, and this is {python}"),
        ({"system": "riscv64-linux"}, "riscv64-linux, and this is {system}"),
        ({"features": "+none"}, "processors with +none, and this is {processor}"),
    ],
)
def test_code_for_another_target_is_left_alone(other, reason, carried, tmp_path):
    file, target = targets(carried)
    file.write_text(json.dumps(target | other))
    cache = tmp_path / "cache"
    assert run_tiny(carried, cache) == (COMPILED, told("it is for " + reason.format(**target)))
    if "system" in other:  # now from the user's cache, whatever the reason was
        assert run_tiny(carried, cache) == CARRIED
        assert len(list(cache.rglob("*tiny.*.nbc"))) == 3


@compiled
def test_a_processor_that_the_user_chose_is_not_ignored(carried, tmp_path):
    how = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    reason = f"it is for {targets(carried)[1]['processor']}, and this is NUMBA_CPU_NAME=generic"
    assert run_tiny(carried, tmp_path / "cache", **how) == (COMPILED, told(reason))
    how = {"NUMBA_BOUNDSCHECK": "1"}
    assert run_tiny(carried, tmp_path / "cache", **how) == (COMPILED, told(OTHER))


@compiled
@pytest.mark.parametrize(
    ("written", "reason"),
    [
        ("HEREDITARY_BUILD=plain left it out\n", "HEREDITARY_BUILD=plain left it out"),
        ("its compilation failed\nMemoryError\n", "its compilation failed, see {}"),
    ],
)
def test_an_installation_without_code_says_so(written, reason, package, tmp_path):
    with_tiny(package, ANNOUNCED)
    (package / SHIPPED.name).mkdir()
    (package / SHIPPED.name / "none.txt").write_text(written)
    expected = told(reason.format("python -m hereditary --version"))
    assert run_tiny(package, tmp_path / "cache") == (COMPILED, expected)
    ask = "from hereditary.compiled.cache import shipped_target; print(shipped_target())"
    assert python(ask, tmp_path / "cache", package.parent) == str((None, written.strip()))


@compiled
@pytest.mark.parametrize(
    "damage", [lambda kept: kept[:-20], lambda kept: b""], ids=["torn", "empty"]
)
@pytest.mark.parametrize("ending", ["nbc", "nbi", "json"])
def test_damaged_files_beside_the_package_cost_a_compilation(damage, ending, carried, tmp_path):
    reason = f"{targets(carried)[0]} is missing or damaged" if ending == "json" else OTHER
    for path in (carried / SHIPPED.name).glob(f"*.{ending}"):
        path.write_bytes(damage(path.read_bytes()))
    assert run_tiny(carried, tmp_path / "cache") == (COMPILED, told(reason))


@compiled
@pytest.mark.parametrize("ending", ["1.nbc", "nbi"])
def test_files_of_other_functions_cost_a_compilation(ending, carried, tmp_path):
    """All have the same signature."""
    files = sorted((carried / SHIPPED.name).glob(f"*tiny.*{ending}"))
    kept = [path.read_bytes() for path in files]
    assert len(files) == 3
    for path, other in zip(files, kept[1:] + kept[:1], strict=True):
        path.write_bytes(other)
    assert run_tiny(carried, tmp_path / "cache") == (COMPILED, told(OTHER))


@compiled
def test_code_of_other_sources_is_left_alone(carried, tmp_path):
    append(carried / "tiny.py")
    assert run_tiny(carried, tmp_path / "cache") == (COMPILED, told(OTHER))


def test_what_code_needs_of_a_processor():
    host = Target("0.68.1", "cpython-311", "x86_64-linux", "znver5", "+avx,+avx2,-avx512f,+fma")
    baseline = host._replace(processor="x86-64-v3", features="+avx,+avx2")
    fitting = baseline._replace(numba="0.68.0", features="")
    assert [each.misfit(host) for each in (host, baseline, fitting)] == [""] * 3
    assert "+fma" in host.misfit(baseline)
    for other in ({"numba": "0.67.1"}, {"system": "x86_64-windows"}, {"features": "+avx512f"}):
        assert baseline._replace(**other).misfit(host)


BUILD = "import sys, setuptools.build_meta as build; build.build_wheel(sys.argv[1])"
# How the package is built, and what is said of its code, where its compilation fails.
REASONS = {
    "": "its compilation failed at installation\nTraceback .*MemoryError: on purpose\n",
    "plain": "HEREDITARY_BUILD=plain left it out\n",
}


@compiled
def test_builds_of_one_clone_do_not_meet_and_say_why_they_have_no_code(tmp_path):
    """Nor do they use what earlier ones left, here files in place of folders."""
    pytest.importorskip("setuptools", minversion="77", reason="what pyproject.toml asks for")
    clone, root = tmp_path / "clone", Path(__file__).parents[1]
    shutil.copytree(root / "src", clone / "src", ignore=shutil.ignore_patterns("*.egg-info"))
    for name in "setup.py", "pyproject.toml", "README.md", "LICENSE":
        shutil.copy(root / name, clone)
    for left in "build", "src/hereditary.egg-info":
        (clone / left).write_text("")
    broken = clone / "src" / "hereditary" / "precompile.py"
    broken.write_text(f"raise MemoryError('on purpose')\n{broken.read_text()}")
    builds = {}
    for kind in REASONS:
        with (tmp_path / f"said {kind}").open("w") as said:
            builds[kind] = subprocess.Popen(
                [sys.executable, "-c", BUILD, str(tmp_path / f"wheel {kind}")],
                cwd=clone,
                env=os.environ | {"HEREDITARY_BUILD": kind},
                stdout=said,
                stderr=subprocess.STDOUT,
            )
    for kind, build in builds.items():
        assert build.wait() == 0, (tmp_path / f"said {kind}").read_text()
        (wheel,) = (tmp_path / f"wheel {kind}").glob("*.whl")
        with zipfile.ZipFile(wheel) as content:
            carried = [name for name in content.namelist() if SHIPPED.name in name]
            assert carried == [f"hereditary/{SHIPPED.name}/none.txt"]
            assert re.fullmatch(REASONS[kind], content.read(carried[0]).decode(), re.DOTALL)


MISSING = """
import warnings
import numba
from numba.core import caching, codegen, compiler, cpu, dispatcher, environment
{}
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    import hereditary
    from hereditary.compiled import numba_internals as found
told = [str(each.message) for each in told if each.category is RuntimeWarning]
assert all(f"plain numba {{numba.__version__}}" in message for message in told)
print(len(told), *map(int, (found.LINKED, found.STORED)))
"""


@compiled
@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        ("", "0 1 1"),
        ("del codegen.CPUCodeLibrary._finalize_dynamic_globals", "1 0 1"),
        ("dispatcher.Dispatcher.get_call_template = lambda self, other: 1", "1 0 1"),
        ("del environment.lookup_environment", "1 0 1"),
        ("codegen.RuntimeLinker.__init__ = lambda self: None", "1 0 1"),
        ("cpu.CPUTargetOptions = object", "1 0 1"),
        ("del caching.Cache._index_key", "1 1 0"),
        ("caching.IndexDataCacheFile.load = lambda self: 1", "1 1 0"),
        ("del compiler.CompileResult._rebuild", "1 1 0"),
        ("import os; os.environ['HEREDITARY_PLAIN_NUMBA'] = '1'", "1 0 0"),
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
        # a second signal, should numba lose the first, comes after a slow machine has ended
        signal.setitimer(signal.ITIMER_REAL, 0.3, 3.0)
        if hd.solve(equation, 10.0, 100, estimate=False).success:
            break
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0)
        interrupted += 1
signal.setitimer(signal.ITIMER_REAL, 0)
print(interrupted, hd.solve(equation, 10.0, 100, estimate=False).success)
"""


@compiled
@pytest.mark.usefixtures("ctrl_c")
def test_interrupting_a_compilation_leaves_the_process_whole(package, tmp_path):
    assert python(INTERRUPTED, tmp_path, package.parent) == "3 True"
