"""Handwritten MJCF with one oddity each: body positions, M and bias forces are MuJoCo's, limits are the file's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

import hqp.robots  # noqa: E402
from hqp.errors import ModelError  # noqa: E402
from hqp.robots.model_map import ModelMap  # noqa: E402

G = '<geom type="capsule" size=".03" fromto="0 0 0 0 0 .2"/>'
TWO = f'<body name="a"><joint name="i" axis="0 1 0"/>{G}</body><body name="b" pos="1 0 0"><joint name="j"/>{G}</body>'
MESH = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1" scale="{}" inertia="exact"/></asset>'
CLASSES = (
    '<default><default class="k"><joint axis="0 1 0" range="-20 20" armature=".1"/><geom mass="2"/>'
    '<default class="kk"><joint axis="1 0 0" range="-5 5"/></default></default></default>'
)

WRITTEN = {  # worldbody, text before it, text after it, compiler settings
    "three hinges with anchors": (
        f'<body><joint axis="0 1 0" pos="0 0 .1"/><joint axis="1 0 0" pos=".1 0 0"/><joint pos="0 .1 0"/>{G}</body>',
    ),
    "slide, hinge and ball": (
        f'<body><joint type="slide" axis="1 1 0"/><joint pos=".1 0 0"/><joint type="ball" pos="0 0 .1"/>{G}</body>',
    ),
    "planar base": (
        f'<body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint/>{G}'
        f'<body pos="0 0 .2"><joint name="j" axis="0 1 0"/>{G}</body></body>',
    ),
    "displaced free base": (
        f'<body pos="1 2 .5" euler="10 20 30"><freejoint/>{G}<body pos="0 0 .2" quat=".7 .7 0 0">'
        f'<joint name="j" axis="0 1 0"/>{G}</body></body>',
    ),
    "two free bodies": (
        f'<body><freejoint/>{G}<body pos="0 0 .2"><joint/>{G}</body></body>'
        f'<body pos="1 0 0"><freejoint/>{G}<body pos="0 0 .2"><joint name="j"/>{G}</body></body>',
    ),
    "two arms and a free cube": (
        f'{TWO}<body name="cube" pos="2 0 0"><freejoint/><geom type="box" size=".1 .2 .1"/></body>',
    ),
    "mocap body": (f'<body mocap="true" pos=".5 0 0"><geom size=".1"/></body>{TWO}',),
    "ref": (
        f'<body><joint name="i" axis="0 1 0" ref="30" range="-10 60" pos="0 0 .1"/><joint axis="1 0 0" ref="-20"/>{G}'
        f'<body pos="0 0 .2"><joint name="j" type="slide" axis="0 0 1" ref=".1" range="0 .3"/>{G}</body></body>',
    ),
    "springs and armature": (
        f'<body><joint name="i" axis="0 1 0" stiffness="5" springref="20" damping="1" armature=".05"/>{G}</body>',
    ),
    "balls with armature": (
        f'<body><joint type="ball" armature=".1"/>{G}'
        f'<body pos="0 0 .2"><joint type="ball" range="0 60"/>{G}</body></body>',
    ),
    "armature of a free joint": (f'<body><joint type="free" armature=".1"/>{G}</body>',),
    "radians": (f'<body euler=".1 .2 .3"><joint name="j" range="-1 1"/>{G}</body>', "", "", 'angle="radian"'),
    "euler sequence": (f'<body euler="10 20 30"><joint name="j" range="-1 100"/>{G}</body>', "", "", 'eulerseq="zYx"'),
    "range without limit": (f'<body><joint name="j" range="-1 1" limited="false"/>{G}</body>',),
    "classes": (
        f'<body childclass="k"><joint name="i"/>{G}<body pos="0 0 .2"><joint name="j" class="kk"/>{G}</body></body>',
        CLASSES,
    ),
    "replicate": (
        f'<replicate count="3" offset="0 .3 0" euler="0 0 20"><body><joint axis="0 1 0"/>{G}</body></replicate>',
    ),
    "frames": (
        f'<frame pos="0 0 .5" euler="0 90 0"><body><joint axis="0 1 0"/>{G}<frame pos=".1 0 0" euler="9 0 0">'
        f'<body><joint name="j"/>{G}</body></frame></body></frame>',
    ),
    "inertia of geoms": (
        '<body><joint name="j"/><geom type="box" size=".1 .2 .3" euler="10 20 30" pos=".1 0 0" density="500"/>'
        '<geom type="cylinder" size=".1 .2" mass="1"/><geom type="ellipsoid" size=".1 .2 .05"/>'
        '<geom size=".1" mass="0"/></body>',
    ),
    "inertia of geoms instead of the file's": (
        f'<body><inertial pos="0 0 .1" mass="3" diaginertia=".1 .2 .2"/><joint name="j"/>{G}</body>',
        "",
        "",
        'inertiafromgeom="true"',
    ),
    "full inertia": (
        '<body><inertial pos="0 0 .1" mass="3" fullinertia=".1 .2 .15 .01 .02 .03"/><joint name="j"/></body>',
    ),
    "balanced inertia": (
        '<body><inertial pos="0 0 .1" mass="3" diaginertia=".1 .2 .5"/><joint name="j"/></body>', "", "",
        'balanceinertia="true"',
    ),
    "bounds of mass": (
        f'<body><joint name="i"/><geom size=".001"/><body pos="0 0 .2"><joint name="j"/>{G}</body></body>', "", "",
        'boundmass=".5" boundinertia=".01"',
    ),
    "fused bodies": (
        f'<body><joint/>{G}<body pos="0 0 .2"><geom size=".1"/><body pos="0 0 .2"><joint name="j"/>{G}</body></body>'
        "</body>",
        "", "", 'fusestatic="true"',
    ),
    "gravity aside": (TWO, '<option gravity="1 2 -1.62"/>'),
    "nothing has a name": (f"<body><joint/>{G}<body><joint/>{G}</body></body>",),
    "mesh with scale": ('<body><joint name="j"/><geom type="mesh" mesh="m"/></body>', MESH.format(".1 .2 .3")),
    "mirrored mesh": ('<body><joint name="j"/><geom type="mesh" mesh="m"/></body>', MESH.format("-.1 .2 .3")),
    "excluded pair": (TWO, "", '<contact><exclude body1="a" body2="b"/></contact>'),
    "tendon": (TWO, "", '<tendon><fixed><joint joint="i" coef="1"/><joint joint="j" coef="-.5"/></fixed></tendon>'),
    "closed loop": (TWO, "", '<equality><connect body1="a" body2="b" anchor=".5 0 0"/></equality>'),
}  # fmt: skip


def written(folder: Path, body: str, before: str = "", after: str = "", compiler: str = "") -> Path:
    path = folder / "written.xml"
    path.write_text(f"<mujoco><compiler {compiler}/>{before}<worldbody>{body}</worldbody>{after}</mujoco>")
    return path


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_written_is_what_moves(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, *WRITTEN[name])
    root = ("a", "b", "cube") if "cube" in name else None
    robot, simulated = hqp.robots.load(path, root=root), mujoco.MjModel.from_xml_path(str(path))
    data, convert = mujoco.MjData(simulated), ModelMap(simulated, robot)
    assert robot.nv == simulated.nv
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-1, 1, robot.nv), 1.0), rng.normal(size=robot.nv)
        data.qpos[:], data.qvel[:] = convert.to_mujoco(q, v)
        mujoco.mj_forward(simulated, data)
        state = robot.state(q, v)
        back = convert.to_mujoco(*convert.to_pinocchio(data.qpos, data.qvel))
        np.testing.assert_allclose(back[0], data.qpos, atol=1e-12)
        for b in range(1, simulated.nbody):
            if simulated.body(b).name in robot.frame_names:
                np.testing.assert_allclose(state.position(simulated.body(b).name), data.xpos[b], atol=1e-12)
        momentum = np.zeros(simulated.nv)
        mujoco.mj_mulM(simulated, data, momentum, data.qvel)
        assert v @ state.mass_matrix() @ v == pytest.approx(data.qvel @ momentum, rel=1e-10)
        if not np.any(simulated.jnt_type == mujoco.mjtJoint.mjJNT_FREE):  # a free joint has accelerations in other axes
            assert v @ state.bias_force() == pytest.approx(data.qvel @ data.qfrc_bias, rel=1e-9, abs=1e-9)
    for joint in ("i", "j"):
        if joint in robot.joint_names:
            column, own = robot.joints(joint)[0], simulated.joint(joint)
            wanted = own.range if simulated.jnt_limited[own.id] else (-np.inf, np.inf)
            np.testing.assert_allclose((robot.lower[column], robot.upper[column]), wanted)
    angles = robot.state(robot.home).angles
    assert (angles >= robot.lower).all()
    assert (angles <= robot.upper).all()


def test_of_unequal_effort_limits_the_smaller_one_counts(tmp_path: Path) -> None:
    joints = "".join(f'<body name="{n}"><joint name="{n}"/>{G}</body>' for n in "abcdef")
    joints = joints.replace('name="b"/>', 'name="b" actuatorfrcrange="-3 5"/>')
    motors = (
        '<motor joint="a" gear="50" ctrlrange="-1 1"/><motor joint="b" gear="2"/><motor joint="c" gear="-10"'
        ' ctrlrange="-1 2"/><position joint="d" kp="10" forcerange="-7 7"/><motor joint="e" forcerange="0 4"/>'
    )
    robot = hqp.robots.load(written(tmp_path, joints, "", f"<actuator>{motors}</actuator>"), root=tuple("abcdef"))
    assert robot.effort_limit.tolist() == [50.0, 3.0, 10.0, 7.0, 4.0, np.inf]
    assert "using the smaller one: b, c" in " ".join(map(str, robot.notes))


@pytest.mark.parametrize("seed", range(6))
def test_motors_weaker_than_the_range_of_their_joint_are_noted(tmp_path: Path, seed: int) -> None:
    """Name the weakest first, for any order in the file; the effort limit is the least of MuJoCo's clips."""
    rng, names = np.random.default_rng(seed), list("abcd")
    bound, pull = rng.uniform(1.0, 100.0, 4).round(3), rng.uniform(1.0, 100.0, 4).round(3)
    gear = rng.choice([-1.0, 1.0, 20.0], 4)
    joints = "".join(
        f'<body name="{n}"><joint name="{n}" actuatorfrcrange="{-b} {b}"/>{G}</body>'
        for n, b in zip(names, bound, strict=True)
    )
    motors = [
        f'<motor joint="{n}" gear="{g}" ctrlrange="{-abs(p / g)} {abs(p / g)}"/>' if rng.random() < 0.5
        else f'<position joint="{n}" kp="10" gear="{g}" forcerange="{-abs(p / g)} {abs(p / g)}"/>'
        for n, g, p in zip(names, gear, pull, strict=True)
    ]  # fmt: skip
    rng.shuffle(motors)
    robot = hqp.robots.load(written(tmp_path, joints, "", f"<actuator>{''.join(motors)}</actuator>"), root=tuple(names))
    np.testing.assert_allclose(robot.effort_limit, np.minimum(bound, pull), rtol=1e-12)
    weak = sorted((p / b, f"{n} ({p:.4g} of {b:.4g})") for n, b, p in zip(names, bound, pull, strict=True) if p < b)
    notes = [str(note) for note in robot.notes if "weaker" in str(note)]
    assert len(notes) == bool(weak)
    assert all(f": {', '.join(text for _, text in weak)} N m" in note for note in notes)


def test_equal_joints_with_refs_hold_at_home(tmp_path: Path) -> None:
    """q1 - ref1 = a0 + a1 (q2 - ref2), also along a chain."""
    body = f'{TWO}<body pos="2 0 0"><joint name="k" ref="10"/>{G}</body>'.replace('name="i"', 'name="i" ref="30"')
    rules = '<joint joint1="j" joint2="i" polycoef=".1 2 0 0 0"/><joint joint1="k" joint2="j" polycoef="0 -1 0 0 0"/>'
    robot = hqp.robots.load(written(tmp_path, body, "", f"<equality>{rules}</equality>"))
    i, j, k = (int(robot.joints(n)[0]) for n in "ijk")
    q = np.zeros(3)
    q[i] = np.deg2rad(30) + 0.2
    q[j] = 0.1 + 2 * 0.2
    q[k] = np.deg2rad(10) - q[j]
    for rule in robot.couplings:
        np.testing.assert_allclose(rule.error(robot.state(q), rule.hold(robot.state(q)).value), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ('<flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" mass="1" dim="2"/>', "flex"),
        ("<body><joint/></body>", "mass"),
    ],
)
def test_what_is_refused_names_the_file(body: str, what: str, tmp_path: Path) -> None:
    path = written(tmp_path, body)
    with pytest.raises(ModelError, match=what) as told:
        hqp.robots.load(path)
    assert path.name in str(told.value)
