"""Two thousand damaged files of each kind, drawn from a seed, raise only the library's errors in a separate process."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import hqp
import hqp.robots
from hqp.errors import DeclarationError, ModelError
from hqp.recorder import load
from tests.damage.kinds import ARM, HAND, recorded

ROOT = Path(__file__).parents[2]
FILES, SEED = 2000, 28


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["recordings", "urdf", "mjcf"])
def test_damaged_files_end_in_our_errors(kind: str, tmp_path: Path) -> None:
    if kind == "mjcf":
        pytest.importorskip("mujoco")
    pytest.importorskip("resource")  # Windows has none
    command = [sys.executable, "-m", "tests.damage", kind, str(FILES), str(SEED)]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(  # MuJoCo writes a log to the current folder
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    told = json.loads(done.stdout.splitlines()[-1]) if done.stdout else {}
    assert told, f"it ended with {done.returncode}: {done.stderr[-2000:]}"
    assert not told["raised"]
    assert told["read"] == FILES
    assert 0.3 * FILES < told["refused"] < 0.9 * FILES  # some damage matters, some does not


def test_a_recording_does_not_ask_for_more_memory_than_it_fills(tmp_path: Path) -> None:
    """A header may claim 464 GiB, and a pattern rows that no array has."""
    whole = recorded("ur5", hqp.Velocity())
    header = io.BytesIO()
    said = {"descr": "<f8", "fortran_order": False, "shape": (250_000, 250_000)}
    np.lib.format.write_array_header_1_0(header, said)
    with zipfile.ZipFile(io.BytesIO(whole)) as file:
        members = {name: file.read(name) for name in file.namelist()}
    told = json.loads(members["recording.json"])
    told["segments"][0]["pattern"]["levels"][1]["shape"] = [250_000, 250_000]
    path = tmp_path / "large.npz"
    for name, content in (("0_q.npy", header.getvalue()), ("recording.json", json.dumps(told).encode())):
        with zipfile.ZipFile(path, "w") as file:
            for other, same in members.items():
                file.writestr(other, content if other == name else same)
        with pytest.raises(DeclarationError, match="recording"):
            load(path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('mass value="2"', 'mass value="2 3"', "link 'upper': value='2 3' has 2 numbers, allowed 1"),
        ('ixx=".02"', 'ixx="1e308"', "link 'upper': ixx='1e308' is not finite or too large"),
        ('lower="-2"', 'lower=""', "joint 'shoulder': lower='' has 0 numbers"),
        ("<robot", '<?xml version="1.0" encoding="utf-1"?><robot', "could not be read"),
        ('<link name="tool"/>', '<link name="a"/>' * 5001, "links, allowed"),
        ("</robot>", '<joint name="j" type="floating"/>' * 67 + "</robot>", "nv = 406, allowed 400"),
    ],
)
def test_damaged_urdf_files_are_refused_by_name(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "arm.urdf"
    assert old in ARM
    path.write_text(ARM.replace(old, new, 1))
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (b"palm", b"p\xfflm", "a name is not valid UTF-8"),
        (b"0 1 0 0 0", b"nan 1 0 0 0", "polycoef='nan 1 0 0 0' is not finite"),
        (b'ref=".1"', b'ref="1e300"', "ref='1e300' is not finite or too large"),
    ],
)
def test_damaged_mjcf_files_are_refused(tmp_path: Path, old: bytes, new: bytes, told: str) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "hand.xml"
    assert old in HAND.encode()
    path.write_bytes(HAND.encode().replace(old, new))
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(path)
