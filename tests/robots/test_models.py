"""The project's robots: files against the tables, and URDF against MJCF through Pinocchio and MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from hqp.robots.from_tables import FOLDER, OWN, files
from hqp.robots.mujoco_extra import full_inertia
from hqp.robots.tables import Tables, axis, inertia, vector

FIGURES = {  # moving joints, mass [kg], motors
    "cbi": (51, 87.000, 51),
    "dreamer": (13, 71.464, 12),
}
FRAMES = {
    "cbi": ("l_sole", "r_sole", "l_palm", "r_palm", "head_top"),
    "dreamer": ("hand_point", "imu", "wheel_contact_0", "wheel_contact_1", "wheel_contact_2"),
}
TWIN = {"cbi": "cbi.xml", "dreamer": "dreamer_hinges.xml"}  # the MJCF with the URDF's degrees of freedom
PLANTS = [("cbi", "cbi.xml"), *(("dreamer", f"dreamer{s}.xml") for s in ("", "_rollers", "_hinges"))]


@pytest.fixture(scope="module", params=OWN)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def tables(name: str) -> Tables:
    return Tables.read(FOLDER / name)


@pytest.fixture(scope="module")
def urdf(name: str) -> pin.Model:
    return pin.buildModelFromUrdf(str(FOLDER / name / f"{name}.urdf"), pin.JointModelFreeFlyer())


@pytest.fixture(scope="module")
def twin(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(FOLDER / name / TWIN[name]))


def random_states(urdf: pin.Model, twin: mujoco.MjModel, count: int):
    """Pairs (q, qpos, turn) with equal base pose and joint angles; turn maps Pinocchio's v to MuJoCo's qvel."""
    rng = np.random.default_rng(5)
    lower = np.maximum(urdf.lowerPositionLimit[7:], -np.pi)
    upper = np.minimum(urdf.upperPositionLimit[7:], np.pi)
    for _ in range(count):
        q = pin.neutral(urdf)
        q[:3] = rng.uniform(-1, 1, 3)
        q[3:7] = pin.Quaternion(pin.SE3.Random().rotation).coeffs()
        q[7:] = rng.uniform(lower, upper)
        qpos = np.zeros(twin.nq)
        qpos[:3], qpos[3], qpos[4:7] = q[:3], q[6], q[3:6]
        turn = np.zeros((twin.nv, urdf.nv))
        turn[:3, :3] = pin.Quaternion(q[3:7]).matrix()
        turn[3:6, 3:6] = np.eye(3)
        for joint in urdf.names[2:]:
            index = urdf.joints[urdf.getJointId(joint)]
            there = twin.joint(joint)
            qpos[there.qposadr[0]] = q[index.idx_q]
            turn[there.dofadr[0], index.idx_v] = 1.0
        yield q, qpos, turn


def test_generated_files_are_committed() -> None:
    for path, content in files().items():
        assert path.read_text() == content, f"{path.name} is stale: run python -m hqp.robots.from_tables"


def test_counts_names_and_mass(name: str, tables: Tables, urdf: pin.Model, twin: mujoco.MjModel) -> None:
    joints, mass, motors = FIGURES[name]
    moving = [joint["name"] for joint in tables.moving()]
    assert urdf.nv == urdf.nq - 1 == joints + 6 == twin.nv
    assert sorted(urdf.names[2:]) == sorted(moving) == sorted(twin.joint(i + 1).name for i in range(joints))
    assert pin.computeTotalMass(urdf) == pytest.approx(mass, abs=5e-4)
    assert mujoco.mj_getTotalmass(twin) == pytest.approx(mass, abs=5e-4)
    assert [twin.actuator(i).name for i in range(twin.nu)] == [joint["name"] for joint in tables.actuated()]
    assert twin.nu == motors


def test_limits(tables: Tables, urdf: pin.Model, twin: mujoco.MjModel) -> None:
    for joint in tables.moving():
        here = urdf.joints[urdf.getJointId(joint["name"])]
        lower, upper, velocity, effort = vector(joint, "lower", "upper", "velocity", "effort")
        assert urdf.lowerPositionLimit[here.idx_q] == lower
        assert urdf.upperPositionLimit[here.idx_q] == upper
        assert urdf.velocityLimit[here.idx_v] == velocity
        assert urdf.upperEffortLimit[here.idx_v] == effort
        there = twin.joint(joint["name"])
        if joint["type"] == "continuous":
            assert not twin.jnt_limited[there.id]
        else:
            assert there.range.tolist() == [lower, upper]
        assert twin.dof_damping[there.dofadr[0]] == float(joint["damping"])
    for joint in tables.actuated():
        assert twin.actuator(joint["name"]).ctrlrange[1] == float(joint["effort"])


def test_inertias_are_the_tables(tables: Tables, urdf: pin.Model, twin: mujoco.MjModel) -> None:
    for link in tables.links:
        body = twin.body(link["name"])
        flat = np.zeros(9)
        mujoco.mju_quat2Mat(flat, body.iquat)
        turn = flat.reshape(3, 3)
        np.testing.assert_allclose(body.mass[0], float(link["mass"]), rtol=1e-14)
        np.testing.assert_allclose(body.ipos, vector(link, "cx", "cy", "cz"), atol=1e-14)
        np.testing.assert_allclose(turn @ np.diag(body.inertia) @ turn.T, inertia(link), atol=1e-13)
    carried = dict.fromkeys(range(1, urdf.njoints), pin.Inertia.Zero())
    for link in tables.links:  # Pinocchio adds fixed links to their joint
        frame = urdf.frames[urdf.getFrameId(link["name"], pin.FrameType.BODY)]
        own = pin.Inertia(float(link["mass"]), vector(link, "cx", "cy", "cz"), inertia(link))
        carried[frame.parentJoint] = carried[frame.parentJoint] + frame.placement.act(own)
    for joint, expected in carried.items():
        found = urdf.inertias[joint]
        np.testing.assert_allclose(found.mass, expected.mass, rtol=1e-14)
        np.testing.assert_allclose(found.lever, expected.lever, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.inertia, expected.inertia, rtol=0, atol=1e-13)


def test_zero_posture_is_the_tree_of_the_table(tables: Tables, urdf: pin.Model) -> None:
    """Every link frame is parallel to the root's and sits at the sum of the offsets on its path."""
    data = urdf.createData()
    pin.framesForwardKinematics(urdf, data, pin.neutral(urdf))
    where = {tables.description["root"]: np.zeros(3)}
    for joint in tables.joints:
        where[joint["child"]] = where[joint["parent"]] + vector(joint, "x", "y", "z")
    for link, position in where.items():
        placement = data.oMf[urdf.getFrameId(link, pin.FrameType.BODY)]
        np.testing.assert_allclose(placement.translation, position, atol=1e-14)
        np.testing.assert_allclose(placement.rotation, np.eye(3), atol=1e-14)
    for joint in tables.moving():
        v = np.zeros(urdf.nv)
        v[urdf.joints[urdf.getJointId(joint["name"])].idx_v] = 1.0
        pin.forwardKinematics(urdf, data, pin.neutral(urdf), v)
        turning = data.v[urdf.getJointId(joint["name"])].angular
        np.testing.assert_allclose(turning, axis(joint), atol=1e-14)


def test_urdf_equals_mjcf(name: str, tables: Tables, urdf: pin.Model, twin: mujoco.MjModel) -> None:
    data, sim = urdf.createData(), mujoco.MjData(twin)
    for q, qpos, turn in random_states(urdf, twin, 20):
        pin.crba(urdf, data, q)
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        com = pin.centerOfMass(urdf, data, q)
        pin.framesForwardKinematics(urdf, data, q)
        sim.qpos[:] = qpos
        mujoco.mj_forward(twin, sim)
        np.testing.assert_allclose(turn.T @ full_inertia(twin, sim) @ turn, mass, rtol=0, atol=1e-10)
        np.testing.assert_allclose(sim.subtree_com[0], com, rtol=0, atol=1e-10)
        for frame in FRAMES[name]:
            here = data.oMf[urdf.getFrameId(frame)]
            np.testing.assert_allclose(sim.site(frame).xpos, here.translation, rtol=0, atol=1e-10)
            np.testing.assert_allclose(sim.site(frame).xmat.reshape(3, 3), here.rotation, rtol=0, atol=1e-10)
        for link in tables.links:
            here = data.oMf[urdf.getFrameId(link["name"], pin.FrameType.BODY)]
            np.testing.assert_allclose(sim.body(link["name"]).xpos, here.translation, rtol=0, atol=1e-10)


def test_pinocchio_reads_the_mjcf(name: str, urdf: pin.Model) -> None:
    """Pinocchio's own reader of the MJCF gives the same mass matrix and posture."""
    model = pin.buildModelFromMJCF(str(FOLDER / name / TWIN[name]))
    assert model.nv == urdf.nv
    data, other = urdf.createData(), model.createData()
    rng = np.random.default_rng(1)
    for _ in range(5):
        angles = {joint: rng.uniform(-1, 1) for joint in urdf.names[2:]}
        matrices = []
        for m, d in ((urdf, data), (model, other)):
            q = pin.neutral(m)
            order = [m.joints[m.getJointId(joint)].idx_v for joint in urdf.names[2:]]
            for joint, angle in angles.items():
                q[m.joints[m.getJointId(joint)].idx_q] = angle
            pin.crba(m, d, q)
            mass = np.triu(d.M) + np.triu(d.M, 1).T
            index = [*range(6), *order]
            matrices.append(mass[np.ix_(index, index)])
        np.testing.assert_allclose(matrices[0], matrices[1], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("robot", "file"), PLANTS)
def test_default_posture_stands_on_the_ground(robot: str, file: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(FOLDER / robot / file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    tables = Tables.read(FOLDER / robot)
    for joint in tables.moving():
        if model.joint(joint["name"]).type[0] == mujoco.mjtJoint.mjJNT_HINGE:
            angle = tables.description["posture"].get(joint["name"], 0.0)
            assert data.joint(joint["name"]).qpos[0] == angle
    touching = model.geom_conaffinity > 0
    sphere = touching & (model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)
    lowest = data.geom_xpos[sphere, 2] - model.geom_size[sphere, 0]
    if file == "dreamer_rollers.xml":
        rollers = [i for i in range(model.ngeom) if "roller" in model.geom(i).name]
        assert len(rollers) == 54
        lowest = data.geom_xpos[rollers, 2].reshape(3, 18).min(axis=1) - 0.013
    np.testing.assert_allclose(lowest, 0.0, atol=1e-4)
    assert mujoco.mj_getTotalmass(model) == pytest.approx(FIGURES[robot][1], abs=5e-4)


def test_wheel_variants_have_the_wheel_of_the_table() -> None:
    """Ball and rollers at zero, rotated about the axle alone, are the hinge's wheel."""
    turned = {}
    for file in ("dreamer.xml", "dreamer_rollers.xml", "dreamer_hinges.xml"):
        model = mujoco.MjModel.from_xml_path(str(FOLDER / "dreamer" / file))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        full = full_inertia(model, data)
        columns = np.zeros((model.nv, 19))
        columns[:6, :6] = np.eye(6)
        for k, joint in enumerate(Tables.read(FOLDER / "dreamer").moving()):
            first = model.joint(joint["name"]).dofadr[0]
            if model.joint(joint["name"]).type[0] == mujoco.mjtJoint.mjJNT_BALL:
                columns[first : first + 3, 6 + k] = axis(joint)
            else:
                columns[first, 6 + k] = 1.0
        turned[file] = columns.T @ full @ columns
    for file in ("dreamer.xml", "dreamer_rollers.xml"):
        np.testing.assert_allclose(turned[file], turned["dreamer_hinges.xml"], rtol=0, atol=1e-10)


def test_cbi_height_sole_and_centre_of_mass() -> None:
    model = pin.buildModelFromUrdf(str(FOLDER / "cbi" / "cbi.urdf"), pin.JointModelFreeFlyer())
    data = model.createData()
    q = pin.neutral(model)
    pin.framesForwardKinematics(model, data, q)
    sole = data.oMf[model.getFrameId("l_sole")].translation[2]
    assert data.oMf[model.getFrameId("head_top")].translation[2] - sole == pytest.approx(1.575, abs=1e-9)
    com = pin.centerOfMass(model, data, q)
    assert com[2] - sole == pytest.approx(0.796, abs=1e-3)


def test_cbi_mirrors() -> None:
    """With equal angles left and right, palms and soles are mirror images."""
    model = pin.buildModelFromUrdf(str(FOLDER / "cbi" / "cbi.urdf"), pin.JointModelFreeFlyer())
    data = model.createData()
    rng = np.random.default_rng(2)
    q = pin.neutral(model)
    for joint in model.names[2:]:
        if joint.startswith("L_"):
            index = model.joints[model.getJointId(joint)].idx_q
            low, high = model.lowerPositionLimit[index], model.upperPositionLimit[index]
            q[index] = q[model.joints[model.getJointId("R" + joint[1:])].idx_q] = rng.uniform(low, high)
    pin.framesForwardKinematics(model, data, q)
    for frame in ("sole", "palm"):
        left, right = (data.oMf[model.getFrameId(f"{side}_{frame}")].translation for side in "lr")
        np.testing.assert_allclose(left * [1, -1, 1], right, atol=1e-6)


def test_dreamer_centre_of_mass() -> None:
    model = pin.buildModelFromUrdf(str(FOLDER / "dreamer" / "dreamer.urdf"), pin.JointModelFreeFlyer())
    data = model.createData()
    q = pin.neutral(model)
    q[model.joints[model.getJointId("arm_j3")].idx_q] = np.pi / 2
    com = pin.centerOfMass(model, data, q)
    np.testing.assert_allclose(com, [0.010, -0.020, 0.767], atol=6e-4)
    joint = model.getJointId("torso_yaw")
    assert data.mass[joint] == pytest.approx(28.76, abs=6e-3)
    upper = data.oMi[joint].act(data.com[joint])
    np.testing.assert_allclose(upper[:2], [0.0289, -0.0522], atol=1e-4)


def test_descriptions_name_what_exists(name: str, tables: Tables, urdf: pin.Model) -> None:
    description = tables.description
    joints = {joint["name"] for joint in tables.moving()}
    for group, members in description["groups"].items():
        assert set(members) <= joints, group
        assert len(set(members)) == len(members), group
    assert set(description["posture"]) <= joints
    for contact in description.get("contacts", ()):
        table = {tuple(vector(p, "x", "y")) for p in tables.points if _is_corner(p, contact["frame"])}
        assert table == {(x, y) for x, y, _ in contact["points"]}
        assert urdf.existFrame(contact["frame"])
    for wheel in description.get("wheels", ()):
        assert urdf.existFrame(wheel["frame"])
        row = next(joint for joint in tables.moving() if joint["name"] == wheel["joint"])
        np.testing.assert_allclose(wheel["axle"], axis(row), rtol=0, atol=1e-15)
        centre, contact = (
            vector(next(r for r in rows if r[key] == value), "x", "y", "z")
            for rows, key, value in (
                (tables.joints, "name", wheel["joint"]),
                (tables.points, "name", wheel["contact"]),
            )
        )
        np.testing.assert_allclose(centre - contact, [0, 0, wheel["radius"]], atol=1e-12)
    for frames in description["frames"].values():
        for frame in [frames] if isinstance(frames, str) else frames:
            assert urdf.existFrame(frame), frame


def _is_corner(point: dict[str, str], sole: str) -> bool:
    return point["set"] == "rect4" and point["frame"][0] == sole[0]
