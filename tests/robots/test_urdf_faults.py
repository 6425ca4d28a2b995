"""Faults of a URDF are reported with file, line and element; content identifies files; names may clash."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.errors import DeclarationError, ModelError, ModelWarning
from hqp.robots.on_mujoco import Plant

SEEDS = range(8)


SHAPES = ('<box size=".1 .2 .3"/>', '<sphere radius=".1"/>', '<cylinder radius=".1" length=".2"/>')


class Drawn:
    """A URDF with one element a line: a tree of links and joints of drawn kinds."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        count = int(rng.integers(4, 8))
        self.lines = ['<?xml version="1.0"?>', "<!-- <robot/> written", "by a test -->", '<robot name="drawn">']
        for k in range(count):
            self.lines += [f'<link name="l{k}">', "<inertial>", '<mass value="1"/>']
            self.lines += ['<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>', "</inertial>"]
            self.lines += ["<collision>", '<origin xyz="0 0 .1"/>', "<geometry>", SHAPES[int(rng.integers(3))]]
            self.lines += ["</geometry>", "</collision>", "</link>"]
            if k:
                kind = str(rng.choice(["revolute", "prismatic", "revolute"]))
                self.lines += [f'<joint name="j{k}" type="{kind}">', f'<parent link="l{int(rng.integers(k))}"/>']
                self.lines += [f'<child link="l{k}"/>', '<axis xyz="0 1 0"/>', '<dynamics damping=".1"/>']
                self.lines += ['<limit lower="-1" upper="1" effort="9" velocity="2"/>', "</joint>"]
        self.lines.append("</robot>")

    def find(self, start: str) -> int:
        """Index of a drawn line with this beginning."""
        return int(self.rng.choice([i for i, line in enumerate(self.lines) if line.startswith(start)]))

    def element(self, at: int) -> str:
        """The link or joint around a line, as messages name it."""
        head = next(line for line in reversed(self.lines[: at + 1]) if line.startswith(("<link", "<joint")))
        return f"{head[1:].split()[0]} '{head.split(chr(34))[1]}'"

    def write(self, folder: Path, name: str = "drawn.urdf") -> Path:
        path = folder / name
        path.write_text("\n".join(self.lines))
        return path


def change(drawn: Drawn, start: str, old: str, new: str) -> int:
    at = drawn.find(start)
    assert old in drawn.lines[at]
    drawn.lines[at] = drawn.lines[at].replace(old, new)
    return at


def removed(drawn: Drawn, start: str) -> int:
    """Remove a line: the fault is reported for the element around it."""
    at = drawn.find(start)
    del drawn.lines[at]
    return next(i for i in range(at, 0, -1) if drawn.lines[i].startswith(("<joint", "<inertial")))


def shaped(drawn: Drawn, shape: str) -> int:
    """Put another shape in the place of a drawn one."""
    at = drawn.find(str(drawn.rng.choice([line[:5] for line in drawn.lines if line in SHAPES])))
    drawn.lines[at] = shape
    return at


FAULTS: dict[str, Any] = {
    "no effort": lambda d: change(d, "<limit", ' effort="9"', ""),
    "no velocity": lambda d: change(d, "<limit", ' velocity="2"', ""),
    "no limit": lambda d: removed(d, "<limit"),
    "no parent": lambda d: removed(d, "<parent"),
    "no child": lambda d: removed(d, "<child"),
    "unknown parent": lambda d: change(d, "<parent", 'link="l', 'link="of_nobody_l'),
    "unknown child": lambda d: change(d, "<child", 'link="l', 'link="of_nobody_l'),
    "no mass": lambda d: removed(d, "<mass"),
    "no inertia": lambda d: removed(d, "<inertia "),
    "no moment": lambda d: change(d, "<inertia ", ' iyy=".01"', ""),
    "mass of a word": lambda d: change(d, "<mass", '"1"', '"heavy"'),
    "mass below zero": lambda d: change(d, "<mass", '"1"', '"-1"'),
    "axis of two": lambda d: change(d, "<axis", "0 1 0", "0 1"),
    "axis zero": lambda d: change(d, "<axis", "0 1 0", "0 0 0"),
    "limits swapped": lambda d: change(d, "<limit", 'lower="-1"', 'lower="3"'),
    "effort below zero": lambda d: change(d, "<limit", 'effort="9"', 'effort="-9"'),
    "unknown type": lambda d: change(d, "<joint", 'type="', 'type="rotary_'),
    "no damping": lambda d: change(d, "<dynamics", ' damping=".1"', ""),
    "damping of nan": lambda d: change(d, "<dynamics", '".1"', '"nan"'),
    "limit in degrees": lambda d: change(d, "<limit", 'lower="-1"', 'lower="-57deg"'),
    "decimal comma": lambda d: change(d, "<mass", '"1"', '"1,5"'),
    "digits of Python": lambda d: change(d, "<mass", '"1"', '"1_0"'),
    "axis in upper case": lambda d: change(d, "<axis", "<axis", "<Axis"),
    "attribute in upper case": lambda d: change(d, "<axis", "xyz", "XYZ"),
    "box in upper case": lambda d: shaped(d, '<Box size=".1 .1 .1"/>'),
    "box of nan": lambda d: shaped(d, '<box size=".1 nan .1"/>'),
    "box of two": lambda d: shaped(d, '<box size=".1 .1"/>'),
    "box below zero": lambda d: shaped(d, '<box size=".1 -.1 .1"/>'),
    "sphere below zero": lambda d: shaped(d, '<sphere radius="-.1"/>'),
    "sphere without radius": lambda d: shaped(d, "<sphere/>"),
    "cylinder without length": lambda d: shaped(d, '<cylinder radius=".1"/>'),
    "mesh without file": lambda d: shaped(d, "<mesh/>"),
    "mesh of one scale": lambda d: shaped(d, '<mesh filename="a.stl" scale=".001"/>'),
    "mesh of scale zero": lambda d: shaped(d, '<mesh filename="a.stl" scale="1 0 1"/>'),
    "shape of nan": lambda d: change(d, "<origin", "0 0 .1", "0 nan .1"),
    "shape of words": lambda d: change(d, "<origin", "0 0 .1", "a b c"),
    "calibration of words": lambda d: change(d, "<axis", "/>", '/><calibration rising="up"/>'),
    "safety of nan": lambda d: change(d, "<axis", "/>", '/><safety_controller k_velocity="nan"/>'),
    "mimic of nan": lambda d: change(d, "<axis", "/>", '/><mimic joint="j1" multiplier="nan"/>'),
    "mimics nobody": lambda d: change(d, "<axis", "/>", '/><mimic multiplier="2"/>'),
}
INCOMPLETE = {"no mass", "no inertia", "no moment"}
AT_LINK = {"mass below zero"}
AT_JOINT = {"axis zero", "unknown type"}


@pytest.mark.parametrize("seed", SEEDS[:3])
@pytest.mark.parametrize("fault", sorted(set(FAULTS) - INCOMPLETE))
def test_a_fault_is_told_with_line_and_element(fault: str, seed: int, tmp_path: Path) -> None:
    drawn = Drawn(seed)
    assert hqp.robots.load(drawn.write(tmp_path)).nv >= 3
    at = FAULTS[fault](drawn)
    element = drawn.element(at)
    if fault in AT_LINK | AT_JOINT:
        at = next(i for i in range(at, 0, -1) if drawn.lines[i].startswith(("<link", "<joint")))
    with pytest.raises(ModelError) as told:
        hqp.robots.load(drawn.write(tmp_path))
    assert f"drawn.urdf, line {at + 1}: " in str(told.value)
    assert element in str(told.value)


@pytest.mark.parametrize("seed", SEEDS[:3])
@pytest.mark.parametrize("fault", sorted(INCOMPLETE))
def test_an_inertia_that_the_reader_takes_as_zero_is_told(fault: str, seed: int, tmp_path: Path) -> None:
    drawn = Drawn(seed)
    at = FAULTS[fault](drawn)
    element = drawn.element(at)
    with pytest.warns(ModelWarning, match=rf"line {at + 1}: {element}: .*read as zero"):
        hqp.robots.load(drawn.write(tmp_path))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_shape_of_an_unknown_kind_is_warned_of(seed: int, tmp_path: Path) -> None:
    """It has no capsules: nothing keeps a distance from it."""
    drawn = Drawn(seed)
    at = shaped(drawn, '<capsule radius=".1" length=".2"/>')
    with pytest.warns(ModelWarning, match=rf"line {at + 1}: {drawn.element(at)}: .*<capsule> is not read"):
        hqp.robots.load(drawn.write(tmp_path))
    drawn.lines[at] = ""
    with pytest.raises(ModelError, match=rf"{drawn.element(at)}: its <collision> has no shape"):
        hqp.robots.load(drawn.write(tmp_path))


@pytest.mark.parametrize("seed", SEEDS[:3])
@pytest.mark.parametrize("start", ["<inertial", "<mass", "<limit", "<axis", "<parent"])
def test_an_element_that_is_there_twice_is_warned_of(start: str, seed: int, tmp_path: Path) -> None:
    drawn = Drawn(seed)
    at = drawn.find(start)
    if start == "<inertial":
        drawn.lines[at] = '<inertial><mass value="3"/></inertial><inertial>'
    else:
        drawn.lines[at] *= 2
    with pytest.warns(ModelWarning, match=rf"line {at + 1}: .* has one more {start}>, using the first"):
        hqp.robots.load(drawn.write(tmp_path))


@pytest.mark.parametrize("length", [2, 3])
def test_joints_that_mimic_each_other_are_refused(length: int, tmp_path: Path) -> None:
    drawn = Drawn(1)
    joints = [i for i, line in enumerate(drawn.lines) if line.startswith("<axis")][:length]
    for k, at in enumerate(joints):
        drawn.lines[at] += f'<mimic joint="j{(k + 1) % length + 1}"/>'
    with pytest.raises(ModelError, match=rf"line {joints[0] + 1}: joint 'j1' mimics itself by j2"):
        hqp.robots.load(drawn.write(tmp_path))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('<robot name="drawn">', "<robot>", "line 4: <robot> has no name"),
        ('<robot name="drawn">', '<robot name="drawn" version="2.0">', "line 4: version '2.0'"),
        ('name="j1"', 'name=""', "<joint> has no name"),
        ('name="j1"', 'name="universe"', "joint 'universe': its name is reserved"),
        ("<!--", '<!DOCTYPE robot [<!ENTITY a "1">]><!--', "line 2: an entity 'a' is declared"),
        ('name="l0"', 'name="gel\u00e9e"', "line 5: a byte that is not UTF-8"),
    ],
)
def test_faults_of_the_file_are_told(old: str, new: str, told: str, tmp_path: Path) -> None:
    drawn = Drawn(0)
    path = drawn.write(tmp_path)
    text = path.read_text().replace(old, new, 1)
    header = text.replace('<?xml version="1.0"?>', '<?xml version="1.0" encoding="latin-1"?>')
    path.write_text(header, encoding="latin-1")
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(path)


@pytest.mark.parametrize("seed", SEEDS)
def test_faults_of_the_tree_are_told(seed: int, tmp_path: Path) -> None:
    drawn = Drawn(seed)
    where = 4 if seed % 2 else len(drawn.lines) - 1
    drawn.lines.insert(where, '<link name="odom"/>')
    with pytest.raises(ModelError, match=rf"'odom' \(line {where + 1}\)"):
        hqp.robots.load(drawn.write(tmp_path))
    drawn = Drawn(seed)
    drawn.lines.insert(-1, '<link name="l0"/>')
    with pytest.raises(ModelError, match=rf"line {len(drawn.lines) - 1}: link 'l0' is there twice, first on line 5"):
        hqp.robots.load(drawn.write(tmp_path))
    drawn = Drawn(seed)
    drawn.lines.insert(-1, '<joint name="again" type="fixed"><parent link="l0"/><child link="l1"/></joint>')
    with pytest.raises(ModelError, match=rf"line {len(drawn.lines) - 1}: link 'l1' is the child of two joints"):
        hqp.robots.load(drawn.write(tmp_path))
    drawn = Drawn(seed)
    drawn.lines[-1:] = [
        '<link name="a"/><link name="b"/>',
        '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>',
        '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
    ]
    with pytest.raises(ModelError, match=rf"line {len(drawn.lines) - 2}: links in a loop"):
        hqp.robots.load(drawn.write(tmp_path))
    drawn = Drawn(seed)
    drawn.lines.insert(where, '<xacro:hand parent="l0"/>')
    with pytest.raises(ModelError, match=rf"line {where + 1}: <xacro:hand>.*run xacro"):
        hqp.robots.load(drawn.write(tmp_path))


@pytest.mark.parametrize(
    "name", ["arm.urdf", "arm.URDF", "ARM.Urdf", "arm.xml", "arm.txt", "arm.mjcf", "arm", "arm.xacro"]
)
def test_a_file_is_known_by_its_content(name: str, tmp_path: Path) -> None:
    assert hqp.robots.load(Drawn(1).write(tmp_path, name)).description.simulated is None
    body = '<body name="a"><joint name="j"/><geom size=".1"/></body>'
    (tmp_path / name).write_text(f"<?xml version='1.0'?><!-- <robot> --><mujoco><worldbody>{body}</worldbody></mujoco>")
    robot = hqp.robots.load(tmp_path / name)
    assert robot.description.simulated is not None
    assert robot.joint_names == ("j",)
    for text, told in (("<sdf/>", "<sdf>"), ("words", "no element"), ("", "no element")):
        (tmp_path / name).write_text(text)
        with pytest.raises(ModelError, match=rf"root element is {told}; allowed: <robot>"):
            hqp.robots.load(tmp_path / name)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_name_of_a_joint_and_of_a_link_elsewhere_is_noted(seed: int, tmp_path: Path) -> None:
    drawn = Drawn(seed)
    assert not [note for note in hqp.robots.load(drawn.write(tmp_path)).notes if "one name" in note]
    text = "\n".join(drawn.lines).replace('name="j2"', 'name="l2"')  # a joint with the name of the link it carries
    (tmp_path / "drawn.urdf").write_text(text)
    assert not [note for note in hqp.robots.load(tmp_path / "drawn.urdf").notes if "one name" in note]
    (tmp_path / "drawn.urdf").write_text("\n".join(drawn.lines).replace('name="j2"', 'name="l3"'))
    robot = hqp.robots.load(tmp_path / "drawn.urdf")
    assert [note for note in robot.notes if "one name" in note and note.endswith(": l3")]
    carrier = robot.model.frames[robot.frame("l3")].parentJoint
    assert robot.model.names[carrier] == "j3"
    assert robot.joints("l3").tolist() == [robot.model.joints[robot.model.getJointId("l3")].idx_v]


def test_a_compiled_model_of_mujoco_loads(tmp_path: Path) -> None:
    path = Path(__file__).parents[1] / "data" / "mjcf" / "mobile_arm.xml"
    simulated = mujoco.MjModel.from_xml_path(str(path))
    robot, of_file = hqp.robots.load(simulated), hqp.robots.load(path)
    assert (robot.name, robot.source, robot.joint_names) == ("mobile_arm", None, of_file.joint_names)
    rng = np.random.default_rng(0)
    q, v = of_file.random_configuration(rng), rng.normal(size=robot.nv)
    np.testing.assert_array_equal(robot.state(q, v).mass_matrix(), of_file.state(q, v).mass_matrix())
    np.testing.assert_array_equal(robot.home, of_file.home)
    assert robot.geometry.ngeoms == of_file.geometry.ngeoms
    assert hqp.robots.load(simulated, root="post").joint_names == ("door",)
    assert hqp.robots.load(simulated, name="mine").name == "mine"
    with pytest.raises(DeclarationError, match="base differs"):
        hqp.robots.load(simulated, floating=True)
    with pytest.raises(ModelError, match="a plant needs a file"):
        Plant(robot)
    with pytest.raises(DeclarationError, match="MjModel"):
        hqp.robots.load(pin.SE3.Identity())
