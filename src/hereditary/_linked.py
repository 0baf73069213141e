"""Compilation of functions that are linked into others and have no machine code of their own.

numba optimises every function together with all that it calls, and makes machine code of the
result, before it links the function into its callers, where both happen again. Of functions that
only compiled code calls neither is needed: a loop and its helpers are optimised once, as a whole.
"""

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class LinkedCompiler(Compiler):
    """numba's compiler, for a function whose code is kept to be linked."""

    def compile_extra(self, func):
        """Compile a function."""
        self.state.library = _LinkedLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _NoEnvironment:
    """Stands in where numba would tell machine code its environment."""

    def set_env(self, name, environment):
        """Do nothing."""


class _LinkedLibrary(JITCodeLibrary):
    """Code that is neither optimised as a whole nor made machine code."""

    codegen = _NoEnvironment()

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """Return 0, for there is no such machine code."""
        self._ensure_finalized()
        return 0


def set_environments(result):
    """Tell the machine code of a compile result the environments of all that is linked into it."""
    codegen = result.library.codegen
    for environment in result._find_referenced_environments():
        codegen.set_env(environment.env_name, environment)
