"""Copy of the project for faults: its own folder, its own builds, the packages of this environment."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
TOOLS = ("nanobind>=2.7", "scikit-build-core>=0.11", "cmake", "ninja")
LEFT_OUT = ("tests/mutation", "tests/browser", "tests/docs", "tests/architecture")
"""Tests without information on a fault: tests of this script, of a browser, of words and files."""
ALONE = {
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "HQP_REQUIRE_NATIVE": "1", "PYTHONDONTWRITEBYTECODE": "1",
    "CMAKE_ARGS": "-DHQP_QUICK=ON",
}  # fmt: skip


class Tree:
    """Files of the project under ``folder``, native parts built, importable by ``python`` alone.

    An existing folder is used again: changed files are copied, and builds are kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.python = folder, folder / ".venv" / "bin" / "python"
        listed = subprocess.check_output(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, text=True)
        for path in filter(None, listed.split("\0")):
            self._copy(ROOT / path, folder / path)
        new = not list((folder / "build").glob("*/CMakeCache.txt"))
        if new:
            subprocess.run([sys.executable, "-m", "venv", str(folder / ".venv")], check=True)
        self.packages = next((folder / ".venv" / "lib").glob("python*/site-packages"))
        installed = [path for path in sys.path if "site-packages" in path]  # without the project, which a hook finds
        (self.packages / "installed.pth").write_text("\n".join(installed), encoding="utf-8")
        pip = [str(self.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        project = ["--no-deps", "--no-build-isolation", "--editable", str(folder)]
        for command in [[*pip, *TOOLS], [*pip, *project]] if new else []:
            self._run(command, check=True)
        if not self._built():
            raise SystemExit(f"the copy cannot be built: cmake --build {folder}/build/*")
        shutil.copytree(self.packages / "hqp", folder / "build" / "right", dirs_exist_ok=True)

    @contextmanager
    def fault(self, path: str, text: str) -> Iterator[bool]:
        """Replace the file's text for a while; yield true if it could be built."""
        there, native = self.folder / path, not path.endswith(".py")
        original = there.read_text("utf-8")
        try:
            there.write_text(text, "utf-8")
            yield not native or self._built()
        finally:
            there.write_text(original, "utf-8")
            shutil.copytree(self.folder / "build" / "right", self.packages / "hqp", dirs_exist_ok=True)

    def _built(self) -> bool:
        (build,) = (path.parent for path in (self.folder / "build").glob("*/CMakeCache.txt"))
        steps = ["--build", str(build), "-j1"], ["--install", str(build), "--prefix", str(self.packages)]
        return all(self._run(["cmake", *step]) for step in steps)

    def _run(self, command: Sequence[str], check: bool = False) -> bool:
        tools = self.python.parent, Path(sys.executable).parent, os.environ.get("PATH", "")
        kept = {"CMAKE_CXX_COMPILER_LAUNCHER": "ccache"} if shutil.which("ccache") else {}  # every fault is undone soon
        environment = {**kept, **os.environ, **ALONE, "PATH": os.pathsep.join(map(str, tools))}
        return not subprocess.run(command, env=environment, check=check, stdout=subprocess.DEVNULL,
                                  stderr=None if check else subprocess.DEVNULL).returncode  # fmt: skip

    @staticmethod
    def _copy(there: Path, here: Path) -> None:
        if there.is_symlink():
            here.parent.mkdir(parents=True, exist_ok=True)
            here.unlink(missing_ok=True)
            here.symlink_to(os.readlink(there))
        elif there.exists() and not (here.exists() and here.read_bytes() == there.read_bytes()):
            here.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(there, here)  # a new time of change: it is built again

    def failed(self, tests: Sequence[str], seconds: float, marked: str, but: Iterable[str] = ()) -> tuple[str, str]:
        """First failing test and the kind of failure, ("", "") if all pass.

        seconds: limit of CPU time; the test that exceeds it is returned as ("...", "out of time").
        """
        left_out = [f"--ignore={path}" for path in LEFT_OUT] + [f"--deselect={test}" for test in but]
        options = ["-x", "-v", "--tb=no", "--no-header", "-p", "no:cacheprovider", "-m", marked, *left_out]
        limit = int(seconds), int(seconds) + 5
        run = subprocess.Popen(
            [str(self.python), "-m", "pytest", *options, *tests], cwd=self.folder, env={**os.environ, **ALONE},
            start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, limit),
        )  # fmt: skip
        try:
            told, _ = run.communicate(timeout=60 + 20 * seconds)  # it may wait without computing
        except subprocess.TimeoutExpired:
            told = ""
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
                told, _ = run.communicate()
        if run.returncode in (0, 5):  # 5: none of these tests is left
            return "", ""
        first = re.search(r"^(tests/\S+?::.+?) (?:FAILED|ERROR)|^ERROR (tests/\S+)", told, re.MULTILINE)
        if first:
            return first[1] or first[2], "fails"
        last = re.findall(r"^(tests/\S+?::.+?)(?: [A-Z]+.*)?$", told, re.MULTILINE)
        stopped = run.returncode in (-signal.SIGXCPU, -signal.SIGKILL)
        return (last or ["?"])[-1].strip(), "out of time" if stopped else f"exit code {run.returncode}"
