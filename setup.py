"""Build step: machine code goes with the package, so that nobody waits for its compilation.

HEREDITARY_BUILD=plain leaves it out. HEREDITARY_BUILD=baseline makes it for all processors of the
last ten years, for a wheel that others install, in place of the processor of this machine.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.dist import Distribution

KIND = os.environ.get("HEREDITARY_BUILD", "")
if KIND not in ("", "plain", "baseline"):
    raise SystemExit(f"HEREDITARY_BUILD must be plain, baseline or not set, got {KIND}")
X86_64_V3 = "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sahf sse3 sse4.1 sse4.2 ssse3 xsave"
# numba's names of the processors that baseline code is made for, and their features.
BASELINES = {
    "x86_64": ("x86-64-v3", ",".join(f"+{name}" for name in X86_64_V3.split())),
    "arm64": ("generic", ""),
}
MACHINES = {"amd64": "x86_64", "aarch64": "arm64"}
# First line of a reason, before what the compiler said.
FAILED = "its compilation failed at installation\n"
COMPILE = "import sys; from hereditary import precompile; precompile.precompile_into(sys.argv[1])"


class BuildWithCode(build_py):
    """Add the folder `machine_code` to the package: the code, or the reason why there is none."""

    def run(self):
        super().run()
        if self.editable_mode:
            return
        code = Path(self.build_lib, "hereditary", "machine_code").resolve()
        code.mkdir()
        reason = "HEREDITARY_BUILD=plain left it out"
        if KIND != "plain":
            try:
                reason = self.compile_into(code)
            except Exception as error:  # numba may fail in any way
                reason = FAILED + str(error)
        if reason:
            shutil.rmtree(code)
            code.mkdir()
            (code / "none.txt").write_text(reason + "\n", encoding="utf-8")
            sys.stderr.write(f"hereditary is built without machine code: {reason}\n")

    def compile_into(self, code):
        """Compile the package that was built; return the reason of a failure, or ""."""
        with tempfile.TemporaryDirectory() as elsewhere:
            how = {"env": self.environment(), "cwd": elsewhere, "stderr": subprocess.PIPE}
            command = [sys.executable, "-c", COMPILE, code]
            done = subprocess.run(command, **how, text=True, errors="replace", check=False)
        sys.stderr.write(done.stderr)
        said = done.stderr.strip() or f"the compiler ended with {done.returncode}"
        return FAILED + said[-4000:] if done.returncode else ""

    def environment(self):
        """Return the environment of the compilation, which imports the package that was built."""
        self.run_command("egg_info")  # the package reads its version there
        folders = self.build_lib, self.get_finalized_command("egg_info").egg_base
        paths = [*map(os.path.abspath, folders), *filter(None, [os.environ.get("PYTHONPATH")])]
        found = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
        if KIND == "baseline":
            machine = platform.machine().lower()
            name, features = BASELINES[MACHINES.get(machine, machine)]
            found |= {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}
        return found


class WithCode(Distribution):
    """A distribution for one Python and one platform, unless code is left out."""

    def has_ext_modules(self):
        return KIND != "plain"


# A build has folders of its own, which no other build of this clone has used or uses.
with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as made:
    own = {"build": {"build_base": made}, "egg_info": {"egg_base": made}}
    setup(cmdclass={"build_py": BuildWithCode}, distclass=WithCode, options=own)
