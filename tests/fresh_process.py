"""Run code in a fresh process."""

import os
import subprocess
import sys
from pathlib import Path

import hereditary

SOURCE = Path(hereditary.__file__).parent


def fresh(code, cache, path=SOURCE.parent, warn="error::UserWarning", **environment):
    """Return what `code` prints in a fresh process, and what that says on standard error."""
    places = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(path)}
    done = subprocess.run(
        [sys.executable, "-W", warn, "-c", code],
        env=os.environ | places | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


def python(code, cache, path=SOURCE.parent):
    """Return what `code` prints in a fresh process."""
    return fresh(code, cache, path)[0]
