"""NumPy reference of the lexicographic solver: the kernel's algorithm with orthogonal factors, clear before fast."""

from hqp.solvers.lexicographic_reference.workspace import ReferenceWorkspace

__all__ = ["ReferenceWorkspace"]
