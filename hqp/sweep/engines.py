"""Execution of the function: this process, or the workers of a Ray cluster."""

from __future__ import annotations

import importlib
import importlib.util
import os
import socket
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from hqp.errors import DeclarationError
from hqp.sweep.cases import Case, code_version, resolve

Result = dict[str, Any]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""For workers: the matrices are too small for more threads of BLAS to pay, and workers fill the machine."""

RETRIES = 3
"""Number of reruns of a batch after its worker died, before its cases are tried one by one."""

NOT_SENT = ("**/*.parquet", "**/*.npz", "**/*.png", "**/*.mp4", "**/.git", "**/.venv", "**/__pycache__")
"""Files of the cases' folder that a cluster does not receive."""

BATCH_SECONDS, LARGEST_BATCH = 1.0, 200
"""Cases that take little go out together: a call costs a millisecond."""


def carry_out(case: Case, code: str, declared: bool) -> Result:
    """One case as a row; an exception becomes a row with its text.

    code: version that the caller has; unless it was ``declared`` by hand, a worker with other sources refuses.
    """
    began = time.perf_counter()
    row: Result = {
        "key": case.key(code),
        "code": code,
        "function": case.function,
        "case": case.text,
        "ok": True,
        "error": None,
        **{f"case.{name}": value for name, value in case.arguments.items()},
    }
    try:
        function = resolve(case.function)
        if not declared and (own := code_version(case.function)) != code:
            raise RuntimeError(f"this worker has other sources: code {own}, needed {code}")
        row |= {f"result.{name}": _plain(value) for name, value in function(**case.arguments).items()}
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        row |= {"ok": False, "error": f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"}
    row |= {
        "seconds": time.perf_counter() - began,
        "host": _host(),
        "process": os.getpid(),
        "finished": time.time(),
    }
    return row


def _host() -> str:
    """Name of the machine, with the node's beginning in a Ray cluster."""
    ray = sys.modules.get("ray")
    if ray is None or not ray.is_initialized():
        return socket.gethostname()
    return f"{socket.gethostname()}/{ray.get_runtime_context().get_node_id()[:8]}"


def _plain(value: Any) -> Any:
    """Arrays and NumPy's numbers as lists and Python's."""
    return value.tolist() if hasattr(value, "tolist") else value


def serial(cases: Iterable[Case], code: str, declared: bool) -> Iterator[list[Result]]:
    """One after the other in this process."""
    for case in cases:
        yield [carry_out(case, code, declared)]


def has_ray() -> bool:
    """Return true if Ray is installed."""
    return importlib.util.find_spec("ray") is not None


class Cluster:
    """A Ray cluster: on this machine (``local``), the one that runs here (``auto``), or ``ray://host:port``.

    jobs: workers at a time; all processors of the cluster by default.  Raises DeclarationError without Ray, or where
    no cluster answers.
    """

    def __init__(self, address: str, jobs: int | None, folder: str = "") -> None:
        if not has_ray():
            raise DeclarationError(
                "sweep", "needs Ray", value=address, allowed="pip install 'hqp[sweep]', or --on serial"
            )
        ray: Any = importlib.import_module("ray")  # an extra, without types

        self._ray = ray
        environment: dict[str, Any] = {"env_vars": dict(ONE_THREAD)}
        if address in ("local", "auto"):  # shared disk: modules importable here are importable there
            environment["env_vars"]["PYTHONPATH"] = os.pathsep.join(
                dict.fromkeys([os.getcwd(), *filter(None, sys.path)])
            )
        elif folder:  # the module beside the cases is sent along
            environment |= {"working_dir": folder, "excludes": list(NOT_SENT)}
        options: dict[str, Any] = {"runtime_env": environment, "log_to_driver": False, "logging_level": "error"}
        options["address"] = address
        if address == "local":
            options |= {"num_cpus": jobs or os.cpu_count() or 1, "include_dashboard": False}
        try:
            ray.init(**options)
        except (ConnectionError, RuntimeError) as error:
            raise DeclarationError("sweep", f"no Ray cluster answers: {error}", value=address) from error
        self.workers = jobs or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._call = ray.remote(max_retries=RETRIES)(_batch)

    def close(self) -> None:
        """Disconnect; a cluster that was started for this ends."""
        self._ray.shutdown()

    def run(
        self, cases: Sequence[Case], code: str, declared: bool, started: Callable[[int], None] = lambda _: None
    ) -> Iterator[list[Result]]:
        """Results as they come; at most two batches a worker are under way.

        A batch whose worker dies runs again on another; if it keeps killing them its cases run one by one, and the
        one that does it becomes a row with an error.
        """
        ray, left = self._ray, deque(cases)
        alone: deque[Case] = deque()
        waiting: dict[Any, list[Case]] = {}
        seconds = BATCH_SECONDS
        while left or alone or waiting:
            while (left or alone) and len(waiting) < 2 * self.workers:
                if alone:
                    batch = [alone.popleft()]
                else:
                    size = int(BATCH_SECONDS / max(seconds, 1e-6))
                    fair = -(-len(left) // (2 * self.workers))  # the last batches spread over all workers
                    batch = [left.popleft() for _ in range(max(1, min(size, fair, LARGEST_BATCH)))]
                waiting[self._call.remote(batch, code, declared)] = batch
                started(len(batch))
            ready, _ = ray.wait(list(waiting), num_returns=1)
            for future in ready:
                batch = waiting.pop(future)
                try:
                    rows = ray.get(future)
                except ray.exceptions.RayError as error:
                    if len(batch) > 1:
                        alone.extend(batch)
                    else:
                        yield [_crashed(batch[0], code, error)]
                    continue
                mean = sum(row["seconds"] for row in rows) / len(rows)
                seconds = mean if seconds == BATCH_SECONDS else 0.5 * (seconds + mean)
                yield rows


def _batch(cases: list[Case], code: str, declared: bool) -> list[Result]:
    return [carry_out(case, code, declared) for case in cases]


def _crashed(case: Case, code: str, error: Exception) -> Result:
    text = str(error).splitlines()[0] if str(error) else ""
    return {
        "key": case.key(code), "code": code, "function": case.function, "case": case.text, "ok": False,
        "error": f"its worker died {RETRIES + 1} times: {type(error).__name__}: {text}",
        **{f"case.{name}": value for name, value in case.arguments.items()},
        "seconds": 0.0, "host": "", "process": 0, "finished": time.time(),
    }  # fmt: skip
