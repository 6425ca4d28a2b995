"""Refuse an MJCF with too many bodies at once, for every way to make them."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

import hqp.robots
from hqp.errors import ModelError

pytest.importorskip("mujoco")
BODY = '<body><joint name="j{0}" axis="0 1 0"/><geom size=".1" mass="1"/></body>'
MANY = {
    "replicated": '<replicate count="1000000" offset="0 .3 0"><body><joint/><geom size=".1"/></body></replicate>',
    "nested": '<replicate count="1000" offset="0 .3 0"><replicate count="1000" offset="1 0 0"><body><joint/>'
    '<geom size=".1"/></body></replicate></replicate>',
    "inside": '<body><replicate count="5000" euler="0 0 1"><body><geom size=".1"/></body></replicate></body>',
    "plain": "<body/>" * 20000,
    "included": '<replicate count="50000" offset="0 .3 0"><include file="part.xml"/></replicate>',
}


@pytest.mark.parametrize("kind", MANY)
def test_too_many_bodies_are_refused_before_they_are_made(kind: str, tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text("<mujoco><body><geom size='.1'/></body></mujoco>")
    path = tmp_path / "many.xml"
    path.write_text(f"<mujoco><worldbody>{MANY[kind]}</worldbody></mujoco>")
    tracemalloc.start()
    with pytest.raises(ModelError, match=r"bodies.*allowed at most 3000"):
        hqp.robots.load(path)
    assert tracemalloc.get_traced_memory()[1] < 1e8
    tracemalloc.stop()


def test_few_replicated_bodies_a_circle_of_files_and_nonsense_are_left_to_mujoco(tmp_path: Path) -> None:
    path = tmp_path / "few.xml"
    few = (
        '<replicate count="5" offset="0 .3 0"><body><joint name="j" axis="0 1 0"/><geom size=".1"/></body></replicate>'
    )
    path.write_text(f"<mujoco><worldbody>{few}</worldbody></mujoco>")
    assert hqp.robots.load(path).nv == 5
    for other in (
        '<include file="few.xml"/>',
        '<replicate count="many"><body/></replicate>',
        "<body>",
        '<include file="no"/>',
    ):
        path.write_text(f"<mujoco><worldbody>{other}</worldbody></mujoco>")
        with pytest.raises(ModelError, match=r"could not be read|are no numbers"):
            hqp.robots.load(path)
