"""A person's motion on robots: standing feet stand, floor and limits are kept, equal motions give equal bits."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.__main__ import main
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.motion import Motion, Retargeted, anchored, retarget, retargeting
from hqp.motion.contacts import NAMES
from hqp.motion.holds import Hold
from hqp.motion.shortfalls import NOTED, PARTS
from hqp.motion.skeleton_map import find_map
from hqp.motion.smoothing import Course
from hqp.motion.stacks import Stacks
from hqp.motion.tracker import Pass, Tracker
from hqp.search.starts import turned

from .files import mirrored, renamed
from .people import FPS, stand, stretch, walk, write_npz
from .robots import robot as catalogued


@pytest.fixture(scope="module")
def g1() -> hqp.robots.Robot:
    """One robot for many motions: its meshes are read once."""
    return catalogued("g1")


@pytest.fixture(scope="module")
def walked() -> Retargeted:
    return retarget(walk(2.0), "g1")


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param("talos", marks=pytest.mark.slow), "cbi"])
def test_a_walk_on_other_robots_with_nothing_tuned(name: str) -> None:
    found = retarget(walk(1.2), name)
    _is_sound(found)
    assert found.summary["slide_share"] < 0.005


def test_a_walk(walked: Retargeted) -> None:
    _is_sound(walked)
    assert walked.summary["slide_share"] < 0.005
    assert walked.q[-1, 0] - walked.q[0, 0] > 0.7 * 0.8 * 2.0 * walked.scale


@pytest.mark.long
def test_a_walk_without_toes_that_is_mirrored(g1: hqp.robots.Robot) -> None:
    """Estimates of 17 joints end at the ankles; the report begins with the person's oddities."""
    found = retarget(renamed(mirrored(walk(1.2)), "estimate")[0], g1)
    assert found.summary["slide_share"] < 0.005
    assert found.q[-1, 0] - found.q[0, 0] > 0.7 * 0.8 * 1.2 * found.scale
    assert str(found).startswith("the person is mirrored")


def _is_sound(found: Retargeted) -> None:
    figures = found.summary
    assert figures["penetration"] < 2e-3
    assert figures["clearance"] > -5e-3
    assert figures["foot_p99"] < 0.02
    assert figures["hand_p99"] < 0.05
    assert figures["beyond"] < 1e-6
    assert figures["speed"] < 1.0 + 1e-5
    assert not any("toe" in each.part for each in found.shortfalls)
    assert np.isfinite(found.q).all()


@pytest.mark.long
def test_joints_are_no_quicker_than_a_persons(
    walked: Retargeted, monkeypatch: pytest.MonkeyPatch, g1: hqp.robots.Robot
) -> None:
    """In the last pass, a nearly straight knee and a landing foot do not jerk."""
    monkeypatch.setattr(retargeting, "smoothed", lambda tracker, found: found)
    quick = retarget(walk(2.0), g1).summary
    calm = walked.summary
    assert calm["acceleration_p99"] < 0.5 * quick["acceleration_p99"]
    assert calm["jerk_p99"] < 0.5 * quick["jerk_p99"]


@pytest.mark.long
def test_the_last_pass_stands_on_the_ends_that_the_pass_before_tells(
    monkeypatch: pytest.MonkeyPatch, g1: hqp.robots.Robot
) -> None:
    kept: list[tuple[Tracker, Pass]] = []

    def keep(tracker: Tracker, found: Pass) -> Pass:
        kept.append((tracker, found))
        return found

    monkeypatch.setattr(retargeting, "smoothed", keep)
    retarget(stand(0.5), g1)
    ((tracker, found),) = kept
    ends: list[int] = []
    take = Hold.take

    def taken(hold: Hold, end: int, *where: Any) -> None:
        ends.append(end)
        take(hold, end, *where)

    monkeypatch.setattr(Hold, "take", taken)
    course = Course(tracker, found.q)
    for low, end in (((0.0, 0.02), 1), ((0.02, 0.0), -1)):
        ends.clear()
        monkeypatch.setattr(course, "heights", lambda side, i, low=low: low)
        tracker.run(found.q[0], np.zeros(tracker.robot.nv), 0, len(found.q) - 1, course)
        assert ends == [end, end]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "rise"),
    [("g1", 0.34), *(pytest.param(*each, marks=pytest.mark.slow) for each in (("cbi", 0.15), ("talos", 0.34)))],
)
def test_a_flat_sole_rolls_for_a_hand_but_does_not_pivot(
    name: str, rise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heels rise for hands that straight legs on flat soles do not lift high enough."""
    motion, robot = stretch(rise), catalogued(name)
    found, feet = retarget(motion, robot, collision=False), find_map(None, robot).frames
    assert found.summary["slide_share"] == 0.0
    assert found.summary["penetration"] < 2e-3
    for side in ("left", "right"):
        assert found.measures.errors[f"{side}_sole"].max() > 0.1
        across = [robot.state(q).rotation(feet[f"{side}_sole"])[:, 1] for q in found.q]
        np.testing.assert_allclose(across, [across[0]] * len(found), atol=0.02)
    monkeypatch.setattr(retargeting, "Stacks", lambda *of, **given: Stacks(*of, **(given | {"flat": True})))
    flat = retarget(motion, robot, collision=False)
    for hand in ("left_hand", "right_hand"):
        assert found.measures.errors[hand][-1] < 0.3 * flat.measures.errors[hand][-1]


@pytest.mark.long
@pytest.mark.parametrize("heading", [pytest.param(1.5, marks=pytest.mark.slow), 3.1])
def test_it_begins_in_the_heading_of_the_person(heading: float, g1: hqp.robots.Robot) -> None:
    found = retarget(stand(0.3, heading), g1)
    _, _, z, w = found.q[0, 3:7]
    assert np.cos(2.0 * np.arctan2(z, w) - heading) > 0.99
    assert found.summary["hand_p99"] < 0.02


@pytest.mark.long
def test_the_same_bits_again(walked: Retargeted) -> None:
    again = retarget(walk(2.0), "g1")
    np.testing.assert_array_equal(again.q, walked.q)


@pytest.mark.long
def test_units_and_places_of_the_file_do_not_matter(walked: Retargeted, g1: hqp.robots.Robot) -> None:
    motion = walk(2.0)
    other = retarget(Motion(motion.names, 100.0 * motion.positions, motion.fps), g1)
    np.testing.assert_allclose(other.q, walked.q, atol=1e-3)


@pytest.mark.slow
def test_out_of_reach_is_told_with_what_it_gave_way_to(g1: hqp.robots.Robot) -> None:
    motion = stand(1.0)
    places = motion.positions.copy()
    hand = motion.names.index("LeftHand")
    places[:, hand] += np.maximum(np.linspace(-2.0, 1.0, len(motion)), 0.0)[:, None] * [3.0, 0.0, 0.0]
    found = retarget(Motion(motion.names, places, motion.fps), g1)
    assert found.shortfalls
    told = max((each for each in found.shortfalls if each.part == "left_hand"), key=lambda each: each.error)
    assert told.error > 0.05
    assert "toe" in told.reason or "limit" in told.reason
    assert "left_hand" in str(found)
    hand = PARTS.index("left_hand")
    assert found.gave_way[-1, hand] not in ("", "on its way")
    assert found.gave_way[0].tolist() == [""] * len(PARTS)
    off = np.column_stack([found.measures.errors[part] for part in PARTS]) > NOTED
    np.testing.assert_array_equal(found.gave_way != "", off)


@pytest.mark.long
def test_shortfalls_are_told_in_frames_of_the_result(g1: hqp.robots.Robot) -> None:
    motion = stand(2.0)
    places = motion.positions.copy()
    places[len(motion) // 2 :, motion.names.index("LeftHand"), 0] += 3.0
    found = retarget(Motion(motion.names, places, motion.fps), g1, fps=25.0)
    (told,) = (each for each in found.shortfalls if each.part == "left_hand")
    assert 20 < told.first <= told.worst < told.last < 30


@pytest.mark.slow
def test_a_corner_is_left_for_another_anchor(monkeypatch: pytest.MonkeyPatch, g1: hqp.robots.Robot) -> None:
    """From a start that faces backwards no tick leads to the hands and feet; the pass from the last frame does."""
    begin = anchored.start

    def astray(tracker: Tracker, frame: int, *also: Vec) -> Vec:
        q = begin(tracker, frame, *also)
        return q if frame else turned(tracker.robot, q, np.pi)

    monkeypatch.setattr(anchored, "start", astray)
    forwards = anchored._from
    assert retarget(walk(1.0), g1).summary["hand_p99"] < 0.05
    monkeypatch.setattr(anchored, "_from", lambda tracker, anchor, hint: forwards(tracker, 0, hint))
    assert retarget(walk(1.0), g1).summary["hand_p99"] > 0.1


@pytest.mark.long
def test_contacts_of_ones_own(tmp_path: Path, g1: hqp.robots.Robot) -> None:
    motion = stand(0.5)
    mask = np.zeros((len(motion), len(NAMES)), dtype=bool)
    mask[:, 1] = True
    assert retarget(motion, g1, contacts=mask).contacts[:, :2].tolist() == mask[:, :2].tolist()
    np.savez(tmp_path / "c.npz", contacts=mask[:, [1]], contact_names=["right_foot"])
    assert retarget(motion, g1, contacts=tmp_path / "c.npz").contacts.tolist() == mask.tolist()
    with pytest.raises(DeclarationError, match="contacts have shape"):
        retarget(motion, g1, contacts=mask[1:])
    np.savez(tmp_path / "c.npz", contacts=mask[:, [1, 1]], contact_names=["right_foot", "right_foot"])
    with pytest.raises(DeclarationError, match="named twice"):
        retarget(motion, g1, contacts=tmp_path / "c.npz")


def test_files(walked: Retargeted, tmp_path: Path) -> None:
    robot = catalogued("g1")
    with np.load(walked.save(tmp_path / "a.npz")) as told:
        assert told["q"].shape == (len(walked), robot.nq)
        assert told["v"].shape == (len(walked), robot.nv)
        assert told["contacts"].shape == (len(walked), len(told["contact_names"]))
        assert tuple(told["joint_names"]) == robot.joint_names
        assert len(told["body_names"]) == len(robot.bodies) - 1
        assert told["gave_way"].shape == told["part_errors"].shape == (len(walked), len(told["part_names"]))
        assert str(told["quaternion_order"]) == "xyzw"
        assert float(told["fps"]) == FPS
        moved = robot.integrate(told["q"][3], told["v"][3], 1.0 / FPS)
        np.testing.assert_allclose(moved, told["q"][4], atol=1e-9)
    rows = np.loadtxt(walked.save(tmp_path / "a.csv"), delimiter=",")
    np.testing.assert_allclose(rows[:, :7], walked.q[:, :7], atol=1e-8)
    np.testing.assert_allclose(rows[:, 7:], walked.angles, atol=1e-8)
    told = pickle.loads(walked.save(tmp_path / "a.pkl").read_bytes())
    assert {"fps", "root_pos", "root_rot", "dof_pos", "local_body_pos", "link_body_list"} <= set(told)
    np.testing.assert_array_equal(told["root_rot"], walked.q[:, 3:7])
    with pytest.raises(DeclarationError, match="unknown file type"):
        walked.save(tmp_path / "a.txt")


def test_the_report_page(walked: Retargeted, tmp_path: Path) -> None:
    pytest.importorskip("plotly")
    page = walked.html(tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<html") == 1
    assert "Slide of standing feet" in page
    assert "Unmet targets" in page
    assert "Causes of deviations" in page
    assert "Worst hand" in page
    assert "Worst toe" in page
    assert page.count("plotly.js v") == 1


@pytest.mark.long
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_npz(tmp_path / "stand.npz", stand(0.3))
    assert (
        main(["retarget", str(path), "--robot", "g1", "-o", str(tmp_path / "q.npz"), "-o", str(tmp_path / "q.csv")])
        == 0
    )
    assert (tmp_path / "q.npz").exists()
    assert (tmp_path / "q.csv").exists()
    assert "g1: 9 frames" in capsys.readouterr().out
    assert main(["retarget", "--robot", "g1", "--suggest-map"]) == 0
    assert 'left_knee = "left_knee_link"' in capsys.readouterr().out
    assert main(["retarget", str(path), "--robot", "g1", "-o", str(tmp_path / "q.txt")]) == 2
    assert main(["retarget", str(path), "--robot", "ur5"]) == 2


@pytest.mark.parametrize(
    ("given", "what"), [({"fps": 0.0}, "fps"), ({"fps": 1e9}, "fps"), ({"up": "w"}, "up"), ({"map": "nobody"}, "map")]
)
def test_what_is_wrong_is_told(given: dict[str, object], what: str, tmp_path: Path) -> None:
    with pytest.raises(DeclarationError, match=what):
        retarget(write_npz(tmp_path / "stand.npz", stand(0.3)), "g1", **given)  # type: ignore[arg-type]
