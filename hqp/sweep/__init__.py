"""Sweeps: one function at many cases, on this machine or on a cluster, that can be stopped and resumed.

sweep = hqp.sweep.load("cases.toml")            # function, fixed parameters, grid
hqp.sweep.run(sweep, "runs/", on="local")       # repeat the call to compute missing cases
table = hqp.sweep.read("runs/")                 # a pyarrow.Table, one row a case

Needs ``hqp[sweep]`` (pyarrow, and Ray for more than one process); without Ray it runs in this process.
"""

from hqp.sweep.cases import Case, Sweep, load
from hqp.sweep.running import Summary, run
from hqp.sweep.store import read

__all__ = ["Case", "Summary", "Sweep", "load", "read", "run"]
