"""Reports of a retargeted motion alone: causes, pictures, shortfalls, rates; and maps that are suggested."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.motion import shortfalls as room
from hqp.motion.joints import SIDES
from hqp.motion.page import _gave_way, _lines, _shortfalls, _worst
from hqp.motion.person import with_toes
from hqp.motion.rates import velocities
from hqp.motion.shortfalls import LIMITS, PARTS, Shortfall, gave_way, shortfalls
from hqp.motion.suggestion import suggest_map
from hqp.motion.tracker import SLIDE, Tracker

from .people import stand
from .robots import robot as catalogued
from .test_geometry import joints, tracker


def motion_of(**changed: Any) -> Any:
    errors = {part: np.zeros(6) for part in PARTS}
    errors["left_hand"] = np.array([0.0, 0.01, 0.03, 0.02, 0.0, 0.0])
    errors["right_toe"] = np.array([0.0, 0.0, 0.0, 0.0, 0.04, 0.0])
    causes = np.full((6, 4), "", dtype=object)
    causes[1:4, PARTS.index("left_hand")] = ["floor", "limits", "floor"]
    causes[4, PARTS.index("right_toe")] = "limits"
    robot = catalogued("g1")
    person = np.arange(6 * 4 * 3.0).reshape(6, 4, 3)
    fields: dict[str, Any] = {
        "measures": SimpleNamespace(errors=errors), "gave_way": causes, "fps": 10.0, "shortfalls": (), "robot": robot,
        "q": np.array([robot.home] * 6), "person": person, "person_parents": (-1, 0, 1, 1), **changed,
    }  # fmt: skip
    return SimpleNamespace(**fields)


def test_the_page_says_for_how_long_and_by_how_much_each_cause_won() -> None:
    found = _gave_way(motion_of())
    assert "<tr><td>left_hand</td><td>floor</td><td>0.20 s</td><td>20 mm</td></tr>" in found
    assert "<tr><td>left_hand</td><td>limits</td><td>0.10 s</td><td>30 mm</td></tr>" in found
    assert "<tr><td>right_toe</td><td>limits</td><td>0.10 s</td><td>40 mm</td></tr>" in found
    assert found.count("<tr><td>") == 3
    assert "5 mm" in _gave_way(motion_of(gave_way=np.full((6, 4), "", dtype=object)))


def test_the_page_lists_shortfalls_in_seconds() -> None:
    behind = (Shortfall("left_hand", 2, 5, 3, 0.06, "floor"), Shortfall("torso", 0, 4, 1, 1.0, "speed"))
    found = _shortfalls(motion_of(shortfalls=behind))
    assert "<tr><td>left_hand</td><td>0.20 to 0.50 s</td><td>60 mm</td><td>floor</td></tr>" in found
    assert "<tr><td>torso</td><td>0.00 to 0.40 s</td><td>57 degrees</td><td>speed</td></tr>" in found
    assert "<table>" not in _shortfalls(motion_of())


def test_the_worst_frames_are_drawn() -> None:
    graphs = pytest.importorskip("plotly.graph_objects")
    hand, toe = _worst(graphs, motion_of())
    assert "Worst hand: left_hand, 30 mm off at 0.20 s (frame 2)" in hand
    assert "Worst toe: right_toe, 40 mm off at 0.40 s (frame 4)" in toe
    assert len(hand) > 1e6 > len(toe), "plotly is part of the page once"
    assert '"name":"robot"' in toe
    assert '"name":"person"' in toe


def test_lines_lead_from_each_joint_to_its_parent() -> None:
    places = np.arange(12.0).reshape(4, 3)
    found = _lines(places, (-1, 0, 1, 1))
    np.testing.assert_array_equal(found[[0, 1, 3, 4, 6, 7]], places[[1, 0, 2, 1, 3, 1]])
    assert np.isnan(found[2::3]).all()
    np.testing.assert_array_equal(_lines(places, (-1, -1, -1, -1)), places)


def test_a_shortfall_is_explained_by_the_tick_that_led_to_its_worst_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[str, int]] = []

    def reason(_track: Any, _q: Any, _v: Any, part: str, frame: int) -> str:
        seen.append((part, frame))
        return "a limit"

    monkeypatch.setattr(room, "_reason", reason)
    errors = {part: np.zeros(50) for part in LIMITS}
    errors["left_hand"][:3] = [2.0, 1.5, 1.0]
    errors["right_hand"][1:4] = [2.0, 1.5, 1.0]
    errors["torso"][45:] = [1.0, 1.1, 1.2, 1.3, 1.4]
    track: Any = SimpleNamespace(dt=0.01)
    found = shortfalls(track, np.zeros((50, 1)), np.zeros((50, 1)), errors)
    assert sorted(seen) == [("left_hand", 1), ("right_hand", 1), ("torso", 49)]
    assert [(one.part, one.first, one.last, one.worst, one.error) for one in found] == [
        ("left_hand", 0, 3, 0, 2.0), ("right_hand", 1, 4, 1, 2.0), ("torso", 45, 50, 49, 1.4),
    ]  # fmt: skip
    assert str(found[0]) == "left_hand, frames 0 to 2: 2000 mm off, a limit"
    thin = Shortfall("torso", 7, 10, 8, 1.0, "").thinned(4)
    assert (thin.first, thin.last, thin.worst) == (1, 3, 2)
    short = Shortfall("torso", 8, 9, 8, 1.0, "").thinned(4)
    assert (short.first, short.last) == (2, 3)


def test_causes_are_looked_up_only_for_parts_that_are_off(monkeypatch: pytest.MonkeyPatch) -> None:
    frames: list[int] = []

    class Track:
        @staticmethod
        def account(_q: Any, _v: Any, frame: int) -> int:
            frames.append(frame)
            return frame

    monkeypatch.setattr(room, "_to_whom", lambda account, part: f"{part} {account}")
    errors = {part: np.zeros(9) for part in PARTS}
    errors["left_hand"][[0, 4]] = [6e-3, 4e-3]
    errors["right_toe"][8] = 0.1
    track: Any = Track()
    found = gave_way(track, np.zeros((9, 1)), np.zeros((9, 1)), errors, (0, 4, 8))
    assert found.shape == (3, len(PARTS))
    assert frames == [1, 8]
    assert found[0, PARTS.index("left_hand")] == "left_hand 1"
    assert found[2, PARTS.index("right_toe")] == "right_toe 8"
    assert np.count_nonzero(found) == 2


def test_velocities_lead_to_the_next_frame() -> None:
    robot = catalogued("ur5")
    rng = np.random.default_rng(0)
    q = robot.home + rng.uniform(-0.2, 0.2, (4, 6))
    v = velocities(robot, q, 25.0)
    np.testing.assert_allclose(v[:3], np.diff(q, axis=0) * 25.0, atol=1e-9)
    np.testing.assert_array_equal(v[3], v[2])


def test_feet_of_one_who_lies_on_a_side_keep_the_yaw_of_before() -> None:
    motion = stand(0.4, 0.7)
    place = {part: p.copy() for part, p in joints(motion).items() if "toe" not in part}
    half = len(motion) // 2
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # onto a side
    c, s = math.cos(0.7), math.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for p in place.values():
        p[half:] = p[half:] @ (R @ tilt @ R.T).T
    found = with_toes(place)
    for side in SIDES:
        ahead = found[f"{side}_toe"] - found[f"{side}_ankle"]
        np.testing.assert_allclose(np.arctan2(ahead[:, 1], ahead[:, 0]), 0.7, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_a_suggested_map_has_the_feet_and_ankles_of_the_legs(name: str) -> None:
    robot = catalogued(name)
    found = suggest_map(robot)
    state = robot.state(robot.home)
    place = {part: state.position(frame) for part, frame in found.frames.items()}
    soles = robot.landmarks["soles"]
    for side, sole, sign in zip(SIDES, soles, (1.0, -1.0), strict=True):
        assert found.frames[f"{side}_sole"] == sole
        assert np.all(np.diff([place[f"{side}_{limb}"][2] for limb in ("hip", "knee", "ankle", "sole")]) <= 0.0)
        assert sign * place[f"{side}_ankle"][1] > 0.0
        way = np.linalg.norm(place[f"{side}_ankle"] - place[f"{side}_sole"])
        assert way < 0.5 * np.linalg.norm(place[f"{side}_knee"] - place[f"{side}_ankle"])
        point = state.position(sole) + state.rotation(sole) @ np.array(found.offset(f"{side}_sole"))
        assert point[2] == pytest.approx(min(point[2], place[f"{side}_sole"][2]), abs=1e-6)
        thigh, shank = (np.linalg.norm(place[f"{side}_{a}"] - place[f"{side}_{b}"]) for a, b in
                        (("hip", "knee"), ("knee", "ankle")))  # fmt: skip
        assert 0.5 < thigh / shank < 2.0
        assert sign * place[f"{side}_hand"][1] > sign * place["torso"][1]


def test_standing_feet_are_corrected_until_they_stand() -> None:
    """A first tick moves the foot by 2 SLIDE dt; the correction of the next tick cancels it."""
    track, dt = tracker(), tracker().dt
    asked: list[Any] = []

    class Robot:
        def state(self, q: Any, v: Any) -> Any:
            return SimpleNamespace(q=q, v=v)

    class Session:
        def step(self, state: Any, *references: Any) -> Any:
            asked.append(references[-1].velocity)
            moved = 2.0 * SLIDE * np.array([1.0, 0.0]) + references[-1].velocity
            return SimpleNamespace(advance=lambda: (dt * moved, moved), status=hqp.Status.OPTIMAL)

    task: Any = SimpleNamespace(name="spot", error=lambda state, value: state.q - value)
    part: Any = SimpleNamespace(robot=Robot(), dt=dt)
    given = [hqp.Reference("spot", np.zeros(2), np.zeros(2))]
    start: Any = SimpleNamespace(q=np.zeros(2), v=np.zeros(2))
    moved: Any = vars(Tracker)["_moved"]
    state, bent, status = moved(part, Session(), start, given, [task], {})
    assert status == "OPTIMAL"
    assert len(asked) == 2
    np.testing.assert_allclose(asked[1], [-2.0 * SLIDE, 0.0])
    np.testing.assert_allclose(state.q, 0.0, atol=1e-12)
    moved(part, Session(), start, given, [task], bent)
    assert len(asked) == 3, "the correction of the tick before is tried first"
    assert moved(part, Session(), start, given, [], {})[1] == {}
    assert track.dt == dt
