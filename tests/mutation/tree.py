"""A copy of the project to put faults into: its own folder, its own builds, the packages of this environment."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
TOOLS = ("nanobind>=2.7", "scikit-build-core>=0.11", "cmake", "ninja")
LEFT_OUT = ("tests/mutation", "tests/browser", "tests/architecture/test_format.py")
"""Tests that say nothing of a fault: of this script, of a browser, of how a line is written."""
LONGER = "longer than"
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "HQP_REQUIRE_NATIVE": "1", "PYTHONDONTWRITEBYTECODE": "1"}


class Tree:
    """Files of the project under ``folder``, native parts built, importable by ``python`` alone."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.python = folder, folder / ".venv" / "bin" / "python"
        listed = subprocess.check_output(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, text=True)
        for path in filter(None, listed.split("\0")):
            if os.path.lexists(ROOT / path):
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / path, folder / path, follow_symlinks=False)
        subprocess.run([sys.executable, "-m", "venv", str(folder / ".venv")], check=True)
        packages = next((folder / ".venv" / "lib").glob("python*/site-packages"))
        installed = [path for path in sys.path if "site-packages" in path]  # but for the project, which a hook finds
        (packages / "installed.pth").write_text("\n".join(installed), encoding="utf-8")
        for what in (TOOLS, self._project):
            if told := self._install(what):
                raise SystemExit(f"the copy cannot be built:\n{told[-2000:]}")

    @contextmanager
    def fault(self, path: str, text: str) -> Iterator[bool]:
        """The file with another text, for a while; whether it could be built."""
        there, native = self.folder / path, not path.endswith(".py")
        original = there.read_text("utf-8")
        try:
            there.write_text(text, "utf-8")
            yield not native or not self._install(self._project)
        finally:
            there.write_text(original, "utf-8")
            if native:
                self._install(self._project)

    @property
    def _project(self) -> tuple[str, ...]:
        return "--no-deps", "--no-build-isolation", "--editable", str(self.folder)

    def _install(self, what: Sequence[str]) -> str:
        """What pip says where it fails, "" where it does not."""
        path = f"{self.python.parent}{os.pathsep}{os.environ.get('PATH', '')}"
        kept = {"CMAKE_CXX_COMPILER_LAUNCHER": "ccache"} if shutil.which("ccache") else {}  # a fault is undone at once
        environment = {**kept, **os.environ, "PATH": path}
        command = [str(self.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *what]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        return done.stderr or "pip failed" if done.returncode else ""


def failed(tests: Sequence[str], seconds: float, folder: Path = ROOT, python: str | Path = sys.executable) -> str:
    """The first of these tests that fails, or how else the run ended; "" where all pass.  seconds: at most."""
    left_out = [f"--ignore={path}" for path in LEFT_OUT]
    options = ["-x", "-q", "--tb=no", "--no-header", "-p", "no:cacheprovider", *left_out]
    run = subprocess.Popen(
        [str(python), "-m", "pytest", *options, *tests], cwd=folder, env={**os.environ, **ALONE}, text=True,
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        told, _ = run.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return f"{LONGER} {seconds:.0f} s"
    if run.returncode in (0, 5):  # 5: no test of these is left
        return ""
    first = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", told, re.MULTILINE)
    return first[1] if first else f"exit code {run.returncode}"
