"""Bipeds from files with no name that the project knows: soles, start, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.__main__ import main
from hqp.errors import DeclarationError, ModelError
from hqp.robots.soles import UPRIGHT, feet, sole
from hqp.walking import LEFT, RIGHT, Foothold, Gait, Walker, Walkers
from hqp.walking.stance import weakest
from tests.scenes.bipeds import biped
from tests.scenes.masses import scaled


def loaded(path: Path) -> tuple[Any, tuple[str, str]]:
    return feet(hqp.robots.load(path, floating=True, rotors=True))


@pytest.mark.parametrize("seed", range(8))
def test_soles_that_are_not_level_at_home_are_whole_and_left_is_left(seed: int, tmp_path: Path) -> None:
    """On their heels or toes at home, in any order of the legs: an edge that is lowest is no sole, nor shows toes."""
    rng = np.random.default_rng(seed)
    heel, ahead, tilt, bend = rng.uniform([-0.5, 0.02, -0.3, 0.0], [0.5, 0.05, 0.3, 1.0]).tolist()
    right_first = bool(rng.integers(2))
    robot, soles = loaded(biped(tmp_path, bend=bend, heel=heel, tilt=tilt, ahead=ahead, right_first=right_first))
    home = robot.state(robot.home)
    for frame, side in zip(soles, "uw", strict=True):
        assert robot.model.names[robot.model.frames[robot.frame(frame)].parentJoint] == f"{side}_a_roll"
        np.testing.assert_allclose(home.rotation(frame)[:, 2], [-math.sin(heel), 0.0, math.cos(heel)], atol=UPRIGHT)
        low, high = np.min(sole(robot, frame), axis=0), np.max(sole(robot, frame), axis=0)
        np.testing.assert_allclose([*low, *high], [ahead - 0.1, -0.045, ahead + 0.1, 0.045], atol=2e-3)
    state = robot.copy().state(Walker(robot, soles=soles).start)
    for frame in soles:
        assert state.rotation(frame)[2, 2] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_the_sole_of_round_shapes_is_as_wide_as_they_touch(seed: int, tmp_path: Path) -> None:
    """Two lying cylinders bear on two lines, 50 mm apart: beyond them a foot rolls."""
    size, radius, bend = np.random.default_rng(seed).uniform([0.7, 0.005, 0.2], [1.3, 0.05, 0.8]).tolist()
    robot, soles = loaded(biped(tmp_path, size=size, rods=radius, bend=bend))
    for frame in soles:
        low, high = np.min(sole(robot, frame), axis=0), np.max(sole(robot, frame), axis=0)
        rolled = size * radius * math.sin(math.radians(8.0))
        np.testing.assert_allclose([low[0], high[0]], [-0.06 * size, 0.14 * size], atol=1e-6)
        np.testing.assert_allclose([-low[1], high[1]], 0.025 * size + 0.5 * rolled, atol=0.5 * rolled)


def test_shapes_that_touch_by_contact_pairs_are_soles_and_stand(tmp_path: Path) -> None:
    """Geoms without contact bits, whose pairs with the floor are in the file: on the plant's ground they bear it."""
    plain, paired = (loaded(biped(tmp_path, pairs=pairs, name=f"p{pairs}")) for pairs in (False, True))
    assert [sole(plain[0], frame) for frame in plain[1]] == [sole(paired[0], frame) for frame in paired[1]]
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot, soles = paired
    course = course_of(Walker(robot, soles=soles, deadline=math.inf), sensors=None)
    for _ in range(200):
        course.step()
    assert not course.fallen
    load = course.plant.measure().contacts.load.sum()
    assert load == pytest.approx(course.walker.weight, rel=0.1)


def test_sensors_of_the_files_floor_leave_with_it(tmp_path: Path) -> None:
    """Files for training measure between feet and floor, which the plant's ground replaces: MuJoCo missed the name."""
    plant_of = pytest.importorskip("hqp.robots.on_mujoco").Plant
    path = biped(tmp_path, pairs=True)
    text = path.read_text()
    foot = text.split('_s" type="box"')[0].rpartition('"')[2] + "_s"
    sensors = f'<sensor><distance name="gap" geom1="{foot}" geom2="floor"/><clock name="time"/></sensor></mujoco>'
    path.write_text(text.replace("</mujoco>", sensors))
    model = plant_of(hqp.robots.load(path)).model
    names = [model.sensor(k).name for k in range(model.nsensor)]
    assert "time" in names
    assert "gap" not in names


@pytest.mark.parametrize("seed", range(3))
def test_feet_are_loaded_alike_whatever_solver_the_file_allows(seed: int, tmp_path: Path) -> None:
    """Files for training have few iterations, which no contact of a stance converges in: feet chatter."""
    plant_of = pytest.importorskip("hqp.robots.on_mujoco").Plant
    rng = np.random.default_rng(seed)
    path = biped(tmp_path, bend=0.6, pairs=bool(seed % 2))
    few = path.with_name("few.xml")
    options = (
        f'iterations="{rng.integers(1, 5)}" ls_iterations="{rng.integers(1, 5)}" tolerance="{rng.uniform(1e-3, 0.1)}" '
        f'solver="{("CG", "PGS", "Newton")[seed]}"'
    )
    few.write_text(path.read_text().replace("<worldbody>", f"<option {options}/><worldbody>"))
    found = []
    for each in (path, few):
        robot, soles = loaded(each)
        plant = plant_of(robot, watched=soles)
        plant.reset(Walker(robot, soles=soles).start)
        plant.step(np.zeros(len(plant.joint_names)), steps=100)
        found.append(plant.data.qpos.copy())
    np.testing.assert_array_equal(*found)


def test_a_frame_that_was_added_is_one_of_the_plant(tmp_path: Path) -> None:
    """A sole that no frame of the file has is watched in MuJoCo where the robot has it."""
    plant_of = pytest.importorskip("hqp.robots.on_mujoco").Plant
    robot, soles = loaded(biped(tmp_path, bend=0.6, heel=0.2, tilt=0.3))
    assert soles == ("u_f_sole", "w_f_sole")
    plant = plant_of(robot, watched=soles)
    plant.reset(robot.home)
    state = robot.state(robot.home)
    for frame in soles:
        place, turn = plant.place(frame)
        np.testing.assert_allclose(place, state.position(frame), atol=1e-9)
        np.testing.assert_allclose(turn, state.rotation(frame), atol=1e-9)


@pytest.mark.parametrize("ankles", [(), ("pitch",), ("roll",)])
def test_legs_that_do_not_hold_a_sole_flat_are_refused(ankles: tuple[str, ...], tmp_path: Path) -> None:
    """A walker for them stands at first, then falls."""
    robot = hqp.robots.load(biped(tmp_path, ankles=ankles), floating=True)
    frames = ("u_f", "w_f") if ankles else ("u_k", "w_k")
    with pytest.raises(DeclarationError, match=rf"walker: joints that move .*'{4 + len(ankles)} \(.*six"):
        Walker(robot, soles=frames)


def test_a_biped_without_shapes_is_refused_by_name(tmp_path: Path) -> None:
    path = biped(tmp_path, pairs=True)
    text = path.read_text()
    path.write_text(text[: text.index("<contact>")] + text[text.index("</contact>") + len("</contact>") :])
    with pytest.raises(ModelError, match=r"no moving link has collision shapes.*scene file"):
        loaded(path)


@pytest.mark.parametrize("seed", range(4))
def test_the_feet_of_a_small_robot_rise_no_higher_than_its_size_allows(seed: int, tmp_path: Path) -> None:
    size = float(np.random.default_rng(seed).uniform(0.3, 1.2))
    robot, soles = loaded(biped(tmp_path, size=size, bend=0.5))
    walker = Walker(robot, soles=soles)
    walker.go()
    walk = walker.plan(5.0)
    heights = [robot.state(q).position(frame)[2] for q in walk.q for frame in soles]
    assert max(heights) - min(heights) == pytest.approx(min(0.05, 0.1 * walker.height), abs=4e-3)
    given = Walker(robot, Gait(height=0.04), soles=soles)
    assert given.gait.height == 0.04


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(0.16, 0.0, 0.0), (-0.11, 0.0, 0.0), (0.0, 0.05, 0.0)])
def test_a_small_robot_walks_ahead_back_and_aside(velocity: tuple[float, float, float], tmp_path: Path) -> None:
    """0.23 m to its hips, joints that brake as much as OP3's: it falls each way if its feet rise by 50 mm."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot, soles = loaded(biped(tmp_path, size=0.3, bend=0.5, damping=2.0))
    course = course_of(Walker(robot, soles=soles, deadline=math.inf))
    while course.plant.time < 5.0 and not course.fallen:
        if course.walker.time >= 1.0 and not course.walker.walking:
            course.walker.go(*velocity)
        course.step()
    assert not course.fallen


@pytest.mark.parametrize("seed", range(4))
def test_arms_that_a_body_hangs_between_are_no_legs(seed: int, tmp_path: Path) -> None:
    """A file without legs whose hands are the lowest shapes: they part above the base, at the end of a spine."""
    rng = np.random.default_rng(seed)
    spine = tuple(rng.permutation(["yaw", "roll", "pitch"])[: rng.integers(1, 4)].tolist())
    path = biped(tmp_path, bend=float(rng.uniform(0.0, 1.0)), waist=spine)
    loaded(path)
    below, above = '<body name="pelvis" pos="0 0 0">', f'<body name="pelvis" pos="0 0 {rng.uniform(0.3, 0.6):.6g}">'
    text = path.read_text()
    assert below in text
    path.write_text(text.replace(below, above))
    with pytest.raises(ModelError, match=r"u_a_roll and w_a_roll, are on arms.*part at waist_.*above its base"):
        loaded(path)


@pytest.mark.long
@pytest.mark.parametrize("waist", [("yaw",), ("roll", "yaw"), ("pitch", "roll", "yaw")])
def test_joints_between_trunk_and_both_legs_belong_to_no_leg(waist: tuple[str, ...], tmp_path: Path) -> None:
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot, soles = loaded(biped(tmp_path, bend=0.6, waist=waist))
    walker = Walker(robot, soles=soles, deadline=math.inf)
    for foot in walker.feet:
        assert len(foot.leg) == 6
        assert not any(name.startswith("waist_") for name in foot.leg)
    course = course_of(walker, sensors=None, delay=0.0)
    start = course.plant.com()
    walker.go(0.15)
    while walker.time < 4.0:
        course.step()
    assert not course.fallen
    assert course.plant.com()[0] - start[0] > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_hips_too_weak_for_one_foot_walk_with_more_time_on_both(seed: int, tmp_path: Path) -> None:
    """Hips that lack 8 % of the torque: a quarter of the time on both feet did not throw the body back."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot, soles = loaded(biped(tmp_path, bend=0.5, hips=26.0))
    walker = Walker(robot, soles=soles, deadline=math.inf)
    assert any("u_h_roll needs 108 %" in why for why in walker.why)
    walks(course_of(walker, edit=scaled(1.1 - 0.2 * (seed % 2)), seed=seed), 0.2)


def test_plants_of_other_masses_have_them(tmp_path: Path) -> None:
    """Masses of geoms count as those of bodies: a biped with 20 % more had 3 % more."""
    on_mujoco = pytest.importorskip("hqp.robots.on_mujoco")
    for robot in (hqp.robots.load(biped(tmp_path)), hqp.robots.load("cbi")):
        plain, heavy = (on_mujoco.Plant(robot, edit=scaled(x)).model.body_mass.sum() for x in (1.0, 1.2))
        assert heavy - plain == pytest.approx(0.2 * robot.mass)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_weak_hips_walk_or_stand_with_a_reason(seed: int, tmp_path: Path) -> None:
    """Drawn sizes, masses and torques: without the bound two of these six fall."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    rng = np.random.default_rng([seed, 7])
    size, mass, hips = rng.choice([0.6, 1.0, 1.4]), rng.uniform(0.9, 1.1), rng.uniform(20.0, 28.0)
    robot, soles = loaded(biped(tmp_path, size=size, bend=rng.uniform(0.3, 0.8), hips=hips))
    walker = Walker(robot, soles=soles, deadline=math.inf)
    course = course_of(walker, edit=scaled(mass), seed=seed)
    start = course.plant.com()
    while walker.time < 10.0:
        if round(walker.time / walker.dt) == 500:
            walker.go(0.15 * math.sqrt(size))
        if round(walker.time / walker.dt) == 4000:
            walker.stop()
        course.step()
        assert not course.fallen
    stands = any("u_h_roll" in why and "it stands" in why for why in walker.why)
    assert (np.linalg.norm((course.plant.com() - start)[:2]) > 0.4 * size) is not stands


@pytest.mark.parametrize("way", ["go", "follow"])
def test_it_stops_as_it_measures_a_weight_that_its_hips_do_not_bear(way: str, tmp_path: Path) -> None:
    robot, soles = loaded(biped(tmp_path, bend=0.5, hips=26.0))
    walker = Walker(robot, soles=soles, deadline=math.inf)
    worlds = Walkers(walker, 1)
    load, q = 0.55 * walker.weight, walker.start[None]

    def order() -> None:
        for each in (walker, worlds):
            if way == "go":
                each.go(0.1)
            else:
                each.follow([Foothold(LEFT, 0.1, 0.1), Foothold(RIGHT, 0.1, -0.1)])

    order()
    assert walker.walking
    assert not any("stands" in why for why in walker.why)
    for _ in range(500):
        walker.step(robot.state(walker.start), (load, load))
        worlds.step(q, np.zeros((1, robot.nv)), loads=np.full((1, 2), load))
    assert not walker.walking
    assert any("on one foot, walks fall above" in why for why in walker.why)
    assert worlds.why(0) == walker.why
    order()
    assert not walker.walking
    assert worlds.why(0) == walker.why


def test_the_command_ends_once_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It gave the order again in each tick, and returned 0."""
    pytest.importorskip("mujoco")
    file = biped(tmp_path, bend=0.5, hips=20.0)
    for more in ((), ("--output", str(tmp_path / "walk.npz"))):
        assert main(["walk", "--robot", str(file), "--seconds", "2", *more]) == 1
        assert capsys.readouterr().out.count("it stands") == 1
    assert not (tmp_path / "walk.npz").exists()


def test_no_biped_that_walks_is_refused() -> None:
    """Masses up to a quarter over the model's."""
    for name in ("g1", "talos", "cbi", "romeo", "icub"):
        if name in hqp.robots.names():
            walker = Walker(hqp.robots.load(name, rotors=True), deadline=math.inf)
            _, share, most = weakest(walker.robot, walker.feet, walker.start, walker.gait)
            assert 1.25 * share < most


@pytest.mark.slow
def test_ankles_balance_on_narrow_soles(tmp_path: Path) -> None:
    """Soles of +-9 mm: without a share as its limit the margin to their edge left +-1 mm."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot, soles = loaded(biped(tmp_path, size=0.35, bend=0.5, rods=0.01))
    walker = Walker(robot, soles=soles, deadline=math.inf)
    walks(course_of(walker, edit=scaled(1.1), seed=0), 0.06, turn=0.25)


def walks(course: Any, forward: float, turn: float = 0.0) -> None:
    """Walk for 5 s and stop, without a fall."""
    walker = course.walker
    walker.go(forward, turn=turn)
    while walker.time < 8.0:
        if walker.time > 5.0:
            walker.stop()
        course.step()
        assert not course.fallen
    assert walker.phase == "stand"
