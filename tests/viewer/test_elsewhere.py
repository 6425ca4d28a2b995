"""The page's process imports the hqp of its parent process, in any current folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from hqp import Level, Stack, serial
from hqp.tasks import Posture

pytest.importorskip("viser")


@pytest.mark.long
def test_a_checkout_in_the_current_folder_is_not_imported(tmp_path: Path) -> None:
    here, script = tmp_path / "checkout", tmp_path / "bin" / "view.py"
    (here / "hqp").mkdir(parents=True)
    (here / "hqp" / "__init__.py").write_text("raise ImportError('the wrong hqp')\n")
    (here / "stack.toml").write_text(serial.dumps(Stack(Level(Posture()))))
    script.parent.mkdir()
    script.write_text("import sys\nfrom hqp.__main__ import main\nsys.exit(main(sys.argv[1:]))\n")
    command = [sys.executable, str(script), "view", "stack.toml", "--robot", "cbi", "--seconds", "0.2"]
    found = subprocess.run(command, cwd=here, capture_output=True, text=True, timeout=1200, check=False)
    assert found.returncode == 0, found.stderr
    assert "open http" in found.stdout
