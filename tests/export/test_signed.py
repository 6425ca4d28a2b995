"""Plan files know their robot, and are signed with the key of a site."""

from __future__ import annotations

import hashlib
import hmac
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.errors import DeclarationError, HqpError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import fnv1a, text

KEY = b"the key of this site"


@pytest.fixture(scope="module")
def robot() -> Any:
    if "ur5" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return hqp.robots.load("ur5")


@pytest.fixture(scope="module")
def session(robot: Any) -> Any:
    return hqp.Controller(Stack(Level(t.Posture()), subject_to=[t.JointLimits()])).session(robot, 0.002)


def test_a_signed_plan_is_loaded_with_its_key_and_with_none(session: Any, robot: Any, tmp_path: Path) -> None:
    session.export(tmp_path / "a.hqp", key=KEY)
    for key in (KEY, None):
        loaded = hqp.load(tmp_path / "a.hqp", key=key, robot=robot)
        assert loaded.step(loaded.home).status is hqp.Status.OPTIMAL
        assert hqp.Batch.load(tmp_path / "a.hqp", 2, key=key).count == 2


def test_the_signature_is_that_of_the_standard_library(session: Any) -> None:
    """All lengths around a block of SHA-256, for the key and the body."""
    for key in (KEY, b"\0", *(bytes(range(n)) for n in (55, 56, 63, 64, 65, 127, 128, 200))):
        file = text(session, key=key)
        head, body = file.split(b"\n", 1)
        assert head.endswith(b"hmac " + hmac.new(key, body, hashlib.sha256).hexdigest().encode())
        for more in range(64):
            longer = body + b" " * more
            parts = head.split(b", size ")[0].decode(), len(longer), fnv1a(longer), hmac.digest(key, longer, "sha256")
            first = f"{parts[0]}, size {parts[1]}, hash {parts[2]:016x}, hmac {parts[3].hex()}"
            LoadedSession(first.encode() + b"\n" + longer, key)
            if key != KEY:
                break


def test_other_keys_no_signature_and_changes_are_refused(session: Any) -> None:
    signed, plain = text(session, key=KEY), text(session)
    rng = np.random.default_rng(0)
    with pytest.raises(HqpError, match="not signed"):
        LoadedSession(plain, KEY)
    for other in (b"x", KEY + b"\0x", KEY[:-1]):
        with pytest.raises(HqpError, match="another key"):
            LoadedSession(signed, other)
    head, body = signed.split(b"\n", 1)
    for _ in range(20):  # forged with a recomputed hash
        at = int(rng.integers(len(body)))
        forged = body[:at] + bytes([body[at] ^ 1]) + body[at + 1 :]
        first = head.replace(f"{fnv1a(body):016x}".encode(), f"{fnv1a(forged):016x}".encode())
        with pytest.raises(HqpError, match="another key"):
            LoadedSession(first + b"\n" + forged, KEY)
    for bad in (head + b"0", head[:-1], head + b", more", head.replace(b", hmac", b", HMAC"), head[:-1] + b"G"):
        with pytest.raises(HqpError, match="first line"):
            LoadedSession(bad + b"\n" + body)


@pytest.mark.parametrize("key", [b"", "text", 3])
def test_bad_keys_are_refused(session: Any, key: Any, tmp_path: Path) -> None:
    with pytest.raises(DeclarationError, match="key"):
        session.export(tmp_path / "a.hqp", key=key)
    session.export(tmp_path / "a.hqp")
    with pytest.raises(DeclarationError, match="key"):
        hqp.load(tmp_path / "a.hqp", key=key)


URDF = """<robot name="one"><link name="base"/><link name="a"><inertial><mass value="{mass}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="{upper}" velocity="{velocity}" effort="{effort}"/></joint></robot>"""
SAME = {"mass": "2.0", "joint": "j", "upper": "1.0", "velocity": "3.0", "effort": "4.0"}


def made(where: Path, **changes: str) -> Any:
    where.write_text(URDF.format(**{**SAME, **changes}))
    return hqp.robots.load(where, floating=False)


@pytest.mark.parametrize(
    "change", [{"mass": "2.1"}, {"joint": "k"}, {"upper": "1.01"}, {"velocity": "2.9"}, {"effort": "5"}]
)
def test_a_plan_of_another_robot_is_refused(change: dict[str, str], tmp_path: Path) -> None:
    robot, other = made(tmp_path / "one.urdf"), made(tmp_path / "two.urdf", **change)
    hqp.Controller(Stack(Level(t.Posture()))).session(robot, 0.01).export(tmp_path / "a.hqp")
    same = made(tmp_path / "three.urdf", mass="2.00")
    assert hqp.load(tmp_path / "a.hqp", robot=same).fingerprint == hqp.fingerprint(robot)
    with pytest.raises(HqpError, match="another robot"):
        hqp.load(tmp_path / "a.hqp", robot=other)
