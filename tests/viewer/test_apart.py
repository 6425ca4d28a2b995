"""Rods between links that are kept apart."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.viewer.meshes import nearest, thinned

pytest.importorskip("viser", reason="the extra view")
from hqp.viewer.scene import Scene


@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_points_of_two_clouds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = rng.normal(size=(int(rng.integers(1, 40)), 3)), rng.normal(size=(int(rng.integers(1, 40)), 3)) + 2.0
    found = nearest(one, two)
    assert np.linalg.norm(found[0] - found[1]) == pytest.approx(
        min(float(np.linalg.norm(a - b)) for a in one for b in two)
    )
    for most in (1, 7, 39, 100):
        assert 1 <= len(thinned(one, most)) <= most


def test_rods_stand_between_links_and_go_when_nothing_is_near() -> None:
    robot = hqp.robots.load("ur5")
    drawn: list[Any] = []

    def add_line_segments(name: str, points: Any, *color: Any, **style: Any) -> Any:
        drawn.append(points)
        return SimpleNamespace(remove=drawn.clear)

    scene = object.__new__(Scene)
    scene._robot, scene._rods = robot, None
    scene._server = SimpleNamespace(scene=SimpleNamespace(add_line_segments=add_line_segments))
    links = ("forearm_link", "wrist_2_link")
    bodies = [robot.body(robot.frame(link)) for link in links]
    scene._drawn = SimpleNamespace(vertices={body: [np.zeros((1, 3))] for body in bodies})  # type: ignore[assignment]
    for shift in (0.0, 0.4):
        state = robot.state(robot.integrate(robot.home, np.full(robot.nv, shift), 1.0))
        state.kinematics()
        scene.show_apart([f"{links[0]}/1 - {links[1]}", f"{links[0]} - box of the world", "free"])
        ((rod,),) = drawn
        for end, body in zip(rod, bodies, strict=True):
            np.testing.assert_allclose(end, robot.bodies[body][5][0], atol=1e-12)
    scene.show_apart([])
    assert drawn == []
