"""One thread of BLAS in each process of tests, as in the control loop (set before numpy is imported); no deadlines."""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")


def pytest_configure() -> None:
    """Examples of hypothesis may take any time: the machine may be busy."""
    from hypothesis import HealthCheck, settings

    settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
    settings.load_profile("patient")
