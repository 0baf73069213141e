"""Set up before anything is imported: the compilation cache, and hypothesis' profiles."""

import os
import tempfile
from pathlib import Path

import hypothesis

# A cache folder of the tests' own, kept between runs: an edit compiles anew what it changes, and
# what calls that.
os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"hereditary-cache-{os.getuid()}")
os.environ.setdefault("MPLBACKEND", "Agg")

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, max_examples=40)
hypothesis.settings.register_profile("dev", deadline=None, max_examples=25)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")
