"""Solvers on steps given in advance, uniform or on a mesh: schemes, histories, and the march."""
