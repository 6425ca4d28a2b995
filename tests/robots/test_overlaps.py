"""Links of a robot that overlap at home do not collide in its plant, in any file format; others do."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import hqp.robots
from hqp.robots.on_mujoco import Plant

INERTIA = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def links(rng: np.random.Generator) -> list[tuple[int, float, float, float]]:
    """Balls on hinges: parent, place along x and z [m], radius [m]."""
    return [
        (int(rng.integers(0, k)) if k else -1, *rng.uniform(-0.3, 0.3, 2), rng.uniform(0.05, 0.2)) for k in range(7)
    ]


def urdf(tree: list[tuple[int, float, float, float]]) -> str:
    text = '<robot name="balls"><link name="base"/>'
    for k, (parent, x, z, radius) in enumerate(tree):
        shape = f'<collision><geometry><sphere radius="{radius}"/></geometry></collision>'
        text += f'<link name="l{k}">{INERTIA}{shape}</link><joint name="j{k}" type="revolute"><child link="l{k}"/>'
        text += f'<parent link="{"base" if parent < 0 else f"l{parent}"}"/><origin xyz="{x} 0 {z}"/><axis xyz="0 1 0"/>'
        text += '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
    return text + "</robot>"


def mjcf(tree: list[tuple[int, float, float, float]]) -> str:
    def body(k: int) -> str:
        _, x, z, radius = tree[k]
        inside = "".join(body(i) for i, link in enumerate(tree) if link[0] == k)
        joint = f'<joint name="j{k}" axis="0 1 0" range="-57 57" actuatorfrcrange="-9 9"/>'
        geom = f'<geom type="sphere" size="{radius}"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
        return f'<body name="l{k}" pos="{x} 0 {z}">{joint}{geom}{inside}</body>'

    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(tree)))
    return f'<mujoco><worldbody><body name="base">{body(0)}</body></worldbody><actuator>{motors}</actuator></mujoco>'


@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.filterwarnings("ignore")
def test_links_that_overlap_at_home_do_not_collide(kind: str, seed: int, tmp_path: Path) -> None:
    """Links with a joint between them never do."""
    tree = links(np.random.default_rng(seed))
    path = tmp_path / f"balls.{kind}"
    path.write_text(urdf(tree) if kind == "urdf" else mjcf(tree))
    robot = hqp.robots.load(path)
    home = robot.state(robot.home)
    apart: dict[tuple[str, str], bool] = {}
    for one, two in combinations(range(len(tree)), 2):
        if one not in (tree[two][0],):
            gap = np.linalg.norm(home.position(f"l{one}") - home.position(f"l{two}"))
            apart[f"l{one}", f"l{two}"] = bool(gap > tree[one][3] + tree[two][3])
    assert len(set(apart.values())) == 2
    plant = Plant(robot, terrain=None)
    q, _ = plant.reset()
    assert not plant.data.ncon
    met = set()
    for turn in np.random.default_rng(seed).uniform(-3.0, 3.0, (400, robot.nv)):
        plant.reset(robot.integrate(q, turn, 1.0))
        bodies = plant.model.geom_bodyid[plant.data.contact.geom]
        met |= {tuple(sorted(plant.model.body(b).name for b in pair)) for pair in bodies.tolist()}
    assert met
    assert all(apart[pair] for pair in met)
