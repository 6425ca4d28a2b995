"""Benchmarks of hqp: the papers' equations, all solvers side by side, time against the budget.

One BLAS thread, decided before NumPy is loaded: the matrices are too small for more to pay.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_name] = "1"
