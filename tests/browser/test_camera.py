"""A visitor who turns the scene up to the end stays above the floor."""

from __future__ import annotations

import numpy as np
import pytest

from hqp.viewer.camera import LOWEST, Cameras
from hqp.web.doors import LOOPBACK, Doors, address
from hqp.web.serve import serve
from tests.browser.chromium import drag, tab_at

pytestmark = pytest.mark.browser


def test_nobody_looks_from_below_the_floor() -> None:
    pytest.importorskip("viser")
    doors = Doors(LOOPBACK)
    server = serve(doors, 0)
    server.scene.set_up_direction("+z")
    server.scene.add_grid("/ground")
    Cameras(server, np.array([[-0.2, -0.3, 0.0], [0.2, 0.3, 1.3]]))
    try:
        with tab_at(address(LOOPBACK, server.get_port(), doors.token), "hqp") as tab:
            (client,) = server.get_clients().values()
            before = client.camera.position[2]
            drag(tab, 600, 800, 0, -600)
            tab.wait_for_timeout(3_000)
            assert LOWEST - 1e-3 <= client.camera.position[2] < 0.5 * before
    finally:
        server.stop()
