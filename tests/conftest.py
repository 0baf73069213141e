"""Set up before anything is imported: the compilation cache, and hypothesis' profiles."""

import hashlib
import os
import tempfile
from pathlib import Path

import hypothesis

# A cache folder of its own for every state of the sources and every way of compiling them, kept
# between runs: tests then never meet machine code from elsewhere, and a second run is warm.
_SOURCES = Path(__file__).parent.parent / "src" / "hereditary"
_FLAGS = ("NUMBA_BOUNDSCHECK", "NUMBA_DISABLE_JIT")


def _digest():
    digest = hashlib.sha256(repr([os.environ.get(flag) for flag in _FLAGS]).encode())
    for path in sorted(_SOURCES.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


os.environ["NUMBA_CACHE_DIR"] = str(
    Path(tempfile.gettempdir()) / f"hereditary-cache-{os.getuid()}" / _digest()
)
os.environ.setdefault("MPLBACKEND", "Agg")

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, max_examples=40)
hypothesis.settings.register_profile("dev", deadline=None, max_examples=25)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")
