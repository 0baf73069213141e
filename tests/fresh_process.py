"""Run code in a fresh process."""

import os
import subprocess
import sys
from pathlib import Path

import hereditary

SOURCE = Path(hereditary.__file__).parent


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
