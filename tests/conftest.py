"""Set up before anything is imported: the compilation cache, and hypothesis' profiles."""

import gc
import os
import signal
import tempfile
from importlib.metadata import version
from pathlib import Path
from weakref import WeakSet

import hypothesis
import pytest

# A cache folder of the tests' own, kept between runs: an edit compiles anew what it changes, and
# what calls that.
_PARTS = os.getuid(), version("numba"), version("numpy"), os.getenv("HEREDITARY_PLAIN_NUMBA", "")
_FOLDER = "-".join(map(str, ("hereditary-cache", *_PARTS)))
os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / _FOLDER)
os.environ.setdefault("MPLBACKEND", "Agg")
# Each core has a process of tests. Threads of BLAS beside these make linear algebra four times as
# slow.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, max_examples=40)
hypothesis.settings.register_profile("dev", deadline=None, max_examples=25)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")


@pytest.fixture
def no_collection():
    """Keep Python from collecting: what is raised in hypothesis' hook of that is lost."""
    gc.disable()
    yield
    gc.enable()


@pytest.fixture
def ctrl_c():
    """Let Ctrl-C raise KeyboardInterrupt here and in new processes; background jobs ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def _untold(monkeypatch):
    """Let every test see the warnings that are given once."""
    monkeypatch.setattr("hereditary.functions.python_calls._warned", WeakSet())


@pytest.fixture(autouse=True)
def _estimates(request, monkeypatch):
    """Let tests that are not marked take coarse steps on purpose, without estimates of errors.

    Estimates have a minute: no test depends on how busy the processor is.
    """
    monkeypatch.setattr("hereditary.solver.accuracy._MIN_SECONDS_ALLOWED", 60.0)
    if not request.node.get_closest_marker("estimates"):
        monkeypatch.setattr("hereditary.solver.accuracy._off.value", True)
