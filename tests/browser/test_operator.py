"""The operator's page in a real browser: a recorded headset, and a pointer, move the robot's hand."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Follow, Level, P, Stack
from hqp.tasks import JointLimits, Pose, Posture
from hqp.teleoperation import WEBXR, OperatorPage

from .chromium import CHROMIUM, FLAGS

pytestmark = pytest.mark.browser

HEADSET = """
const frames = RECORDING;
class Session extends EventTarget {
  constructor() { super(); this.inputSources = []; this.next = null; this.count = 0; }
  updateRenderState() {}
  async requestReferenceSpace() { return {}; }
  requestAnimationFrame(callback) { this.next = callback; }
  start() {
    const tick = () => {
      const now = frames[this.count], callback = this.next;
      if (!now) return;
      this.count += 1;
      this.inputSources = Object.entries(now.hands).map(([handedness, hand]) => ({
        handedness, gripSpace: { hand }, gamepad: { buttons: [{}, { pressed: hand.engaged }] },
      }));
      const pose = (hand) => ({ emulatedPosition: hand.guessed, transform: {
        position: { x: hand.position[0], y: hand.position[1], z: hand.position[2] },
        orientation: Object.fromEntries(['x', 'y', 'z', 'w'].map((c, i) => [c, hand.quaternion[i]])) } });
      callback(now.time, { getViewerPose: () => pose(now.head), getPose: (space) => pose(space.hand) });
    };
    setInterval(tick, 1000 / 72);
  }
}
window.XRWebGLLayer = class {};
Object.defineProperty(navigator, "xr", { value: {
  isSessionSupported: async (kind) => kind === "immersive-vr",
  requestSession: async () => {
    const session = new Session();
    setTimeout(() => session.start(), 100);
    return session;
  },
} });
"""


def recording() -> list[dict[str, Any]]:
    """Two seconds at 72 Hz: the right hand moves 20 cm ahead with its grip squeezed, then 50 cm up with it open.

    In between its pose is estimated for a while, and wrong.
    """
    frames = []
    for i in range(144):
        u = min(max((i - 20) / 60.0, 0.0), 1.0)
        ahead, up = 0.2 * u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 0.005 * max(0, i - 100)
        guessed = 50 <= i < 54
        place = [0.3, 1.2 + up, -0.4 - ahead + (1.0 if guessed else 0.0)]
        hand = {"position": place, "quaternion": [0, 0, 0, 1], "engaged": i < 100, "guessed": guessed}
        head = {"position": [0, 1.6, 0], "quaternion": [0, 0, 0, 1]}
        frames.append({"time": 1e3 * i / 72.0, "hands": {"right": hand}, "head": head})
    return frames


def follow_page(script: str, act: Any, seconds: float) -> tuple[np.ndarray, np.ndarray, set[str]]:
    """Hand of UR5 by tick ``(n, 3)`` [m], speeds of its joints, notes; act: actions in the tab."""
    api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    robot = hqp.robots.load("ur5")
    hand = Pose(frame="tool0", law=P(8.0), name="hand")
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    session = hqp.Controller(stack, deadline=np.inf).session(robot, 0.004)
    follow = Follow(hand, clutch=True, frame=WEBXR, max_age=5.0)
    q = robot.integrate(robot.home, np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2]), 1.0)
    v, places, speeds, notes = np.zeros(robot.nv), [], [], set()
    with OperatorPage({"right": follow}) as page, api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        tab = browser.new_page()
        if script:
            tab.add_init_script(script)
        tab.goto(page.url)
        tab.wait_for_selector("text=connected")
        act(tab)
        due = time.monotonic()
        end = due + seconds
        while due < end:
            state = robot.state(q, v)
            tick = session.step(state, follow.reference(state))
            places.append(state.position("tool0"))
            speeds.append(tick.command)
            notes |= {note.detail for note in tick.notes}
            q, v = tick.advance()
            due += 0.004
            time.sleep(max(0.0, due - time.monotonic()))
        assert page.hands.refused == 0
        browser.close()
    return np.array(places), np.array(speeds), notes


def test_a_recorded_headset_moves_the_hand() -> None:
    script = HEADSET.replace("RECORDING", json.dumps(recording()))
    places, speeds, notes = follow_page(script, lambda tab: tab.click("text=Enter XR"), 4.0)
    moved = places[-1] - places[0]
    assert moved[0] == pytest.approx(0.2, abs=0.01)  # ahead, without the motion up
    assert np.abs(moved[1:]).max() < 0.01
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.2 + 1e-9
    assert any("clutch is open" in note for note in notes)


def test_a_pointer_will_do() -> None:
    def drag(tab: Any) -> None:
        box = tab.locator("#pad").bounding_box()
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.evaluate("setTimeout(() => 0, 0)")
        tab.wait_for_timeout(200)
        tab.evaluate(
            "() => { let n = 0; const pad = document.getElementById('pad'); const timer = setInterval(() => {"
            "pad.dispatchEvent(new PointerEvent('pointermove', { movementX: 2, movementY: 0 }));"
            "if (++n === 50) clearInterval(timer); }, 16); }"
        )

    places, _, _ = follow_page("", drag, 2.5)
    moved = places[-1] - places[0]
    assert moved[1] == pytest.approx(-0.1, abs=0.02)  # to the right
    assert np.abs(moved[[0, 2]]).max() < 0.01
