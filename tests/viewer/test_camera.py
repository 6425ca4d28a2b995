"""View of a visitor, without a browser: points in the free part of the picture, cameras above the floor."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hqp.viewer.camera import ARRIVING, FORWARD, LOWEST, MARGIN, NEAREST, OVERLAY, Cameras, Window

SIZES = ((1100, 900), (700, 1000), (2400, 1200), (900, 500))


def project(points: Any, camera: Any, look_at: Any) -> Any:
    """Slopes to the right and upwards, and depth, by a matrix of a pinhole camera."""
    z = (look_at - camera) / np.linalg.norm(look_at - camera)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    local = (points - camera) @ np.array([x, np.cross(x, z), z]).T
    return local[:, 0] / local[:, 2], local[:, 1] / local[:, 2], local[:, 2]


@pytest.mark.parametrize("overlay", [OVERLAY, 0.0])
@pytest.mark.parametrize("size", SIZES)
def test_all_points_are_in_the_free_part(size: tuple[int, int], overlay: float) -> None:
    rng = np.random.default_rng(1)
    window = Window.of(1.3, *size, overlay)
    assert (window.top == window.bottom) is (overlay == 0.0)
    for _ in range(100):
        points = rng.normal(size=(rng.integers(2, 20), 3)) * rng.uniform(0.1, 3.0, 3)
        forward = rng.normal(size=3)
        camera, look_at = window.fit(points, forward)
        x, y, z = project(points, camera, look_at)
        assert z.min() > NEAREST - 1e-9
        assert abs(x).max() <= window.side
        assert y.max() <= window.top + 1e-9
        assert y.min() >= -window.bottom - 1e-9
        assert window.holds(points, camera, look_at - camera)
        wide, tall = np.ptp(x) / (2.0 * window.side), np.ptp(y) / (window.top + window.bottom)
        assert max(wide, tall) == pytest.approx(MARGIN) or z.min() == pytest.approx(NEAREST), "it could stand nearer"


class Client:
    """Camera of a visitor as in viser: a change of position moves its target as well."""

    def __init__(self, position: Any, look_at: Any) -> None:
        self._position, self.look_at = np.array(position), np.array(look_at)
        self.fov, self.image_width, self.image_height = 1.3, 1100, 900
        self.camera, self.atomic = self, nullcontext
        self.on_update = lambda callback: setattr(self, "callback", callback)

    @property
    def position(self) -> Any:
        return self._position

    @position.setter
    def position(self, position: Any) -> None:
        self.look_at = self.look_at + position - self._position
        self._position = position


def serve(client: Client, points: Any, overlay: float = OVERLAY) -> Cameras:
    """Cameras of a server with one visitor."""
    server = SimpleNamespace(initial_camera=Client([3.0, 3.0, 3.0], [0.0, 0.0, 0.0]), get_clients=lambda: {1: client})
    server.on_client_connect = lambda callback: asyncio.run(callback(client))
    return Cameras(server, points, overlay)


def test_a_visitor_begins_with_robot_and_targets_in_the_picture() -> None:
    body, target = np.array([[-0.2, -0.3, 0.0], [0.2, 0.3, 1.3]]), np.array([[0.1, -0.9, 1.4]])
    first = Client([3.0, 3.0, 3.0], [0.0, 0.0, 0.0])
    server = SimpleNamespace(initial_camera=first, get_clients=dict, on_client_connect=lambda _callback: None)
    Cameras(server, body).update(body, target)
    assert Window.of(1.3, 1100, 900).holds(np.vstack((body, target)), first.position, first.look_at - first.position)


def test_a_target_high_up_comes_into_the_picture() -> None:
    body = np.array([[-0.2, -0.3, 0.0], [0.2, 0.3, 1.3]])
    client = Client([2.0, -1.5, 1.0], [0.0, 0.0, 0.9])
    cameras = serve(client, body)
    window = Window.of(1.3, 1100, 900)
    for _ in range(ARRIVING):
        cameras.update(body, np.array([[0.4, 0.0, 1.0]]))
    assert client.position[2] > 0.3
    first = client.position.copy()
    assert window.holds(body, client.position, client.look_at - client.position)
    cameras.update(body, np.array([[0.4, 0.0, 1.05]]))
    assert np.array_equal(client.position, first), "it moved though all is to be seen"
    for high in (2.3, 3.5):
        target = np.array([[0.4, 0.0, high]])
        cameras.update(body, target)
        assert window.holds(np.vstack((body, target)), client.position, client.look_at - client.position)
    client.position = client.position + [0.0, 0.0, -5.0]  # the visitor looks away; the camera stays
    there = client.position.copy()
    cameras.update(body, target)
    assert np.array_equal(client.position, there)
    cameras.update(body, np.array([[1e4, 0.0, 0.0]]))
    assert np.array_equal(client.position, there)


def test_a_new_camera_that_falls_back_looks_from_in_front_again() -> None:
    body = np.array([[-0.2, -0.3, 0.0], [0.2, 0.3, 1.3]])
    client = Client([3.0, 3.0, 3.0], [0.0, 0.0, 0.0])
    cameras = serve(client, body)
    for _ in range(ARRIVING):
        cameras.update(body, body[:1])
        ahead = client.look_at - client.position
        assert np.allclose(ahead / np.linalg.norm(ahead), FORWARD / np.linalg.norm(FORWARD))
        client.position, client.look_at = np.full(3, 3.0), np.zeros(3)  # a late update of a slow browser


def test_a_page_without_an_overlay_is_filled() -> None:
    """Page of a retargeted motion: the camera need not keep the distance of a page with cards."""
    body = np.array([[-0.2, -0.3, 0.0], [0.2, 1.3, 1.3]])
    near = []
    for overlay in (OVERLAY, 0.0):
        client = Client([3.0, 3.0, 3.0], [0.0, 0.0, 0.0])
        serve(client, body, overlay).update(body, np.empty((0, 3)))
        assert Window.of(1.3, 1100, 900, overlay).holds(body, client.position, client.look_at - client.position)
        near.append(np.linalg.norm(client.position - body.mean(axis=0)))
    assert near[1] < 0.9 * near[0]


def test_no_camera_goes_below_the_floor() -> None:
    client = Client([1.0, 0.0, -1.0], [0.0, 0.0, 0.5])
    serve(client, np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 1.0]]))
    distance = np.linalg.norm(client.position - client.look_at)
    asyncio.run(client.callback(client))
    assert client.look_at.tolist() == [0.0, 0.0, 0.5]
    assert client.position[1:].tolist() == [0.0, LOWEST]
    assert np.linalg.norm(client.position - client.look_at) == pytest.approx(distance), "it went nearer"
    client.look_at = np.array([0.0, 0.0, -0.5])
    asyncio.run(client.callback(client))
    assert client.look_at.tolist() == [0.0, 0.0, 0.0]
    there = client.position.copy()
    asyncio.run(client.callback(client))
    assert np.array_equal(client.position, there)
