"""Shipped capsules belong to the surface of a link: another file of that name gets its own fit."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.errors import ModelWarning
from hqp.robots import capsule_files, capsules
from hqp.robots.surface import Surface
from tests.scenes.collision.surfaces import MASS, arm, drawn, outside

SHIPPED = ("cbi", "dreamer", "anymal", "panda", "ur5", "talos", "xarm7")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def copied(name: str, folder: Path, stem: str, change: Any = lambda text: text) -> Path:
    source = hqp.robots.load(name).source
    assert source is not None
    path = folder / f"{stem}.urdf"
    text = source.read_text(encoding="utf-8").replace('filename="meshes', f'filename="{source.parent}/meshes')
    path.write_text(change(text))
    return path


@pytest.mark.parametrize("stem", ["panda", "talos", "cbi", "xarm7", "my_arm"])
@pytest.mark.parametrize("shape", ['<box size=".3 .2 .1"/>', '<sphere radius=".2"/>'])
def test_a_users_file_of_a_shipped_name_has_its_own_fit(stem: str, shape: str, tmp_path: Path) -> None:
    path = arm(tmp_path, shape).source.rename(tmp_path / f"{stem}.urdf")
    path.write_text(path.read_text().replace('name="arm"', f'name="{stem}_link1"').replace('"arm"', f'"{stem}_link1"'))
    robot = hqp.robots.load(path, name=stem)
    with pytest.warns(ModelWarning, match="fitting capsules"):
        found = robot.capsules
    (item,) = robot.geometry.geometryObjects
    assert outside(drawn(item, 3000, np.random.default_rng(0)), found) < 1e-6


@pytest.mark.filterwarnings("error:.*fitting capsules")
def test_a_renamed_copy_has_the_shipped_capsules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = hqp.robots.load("cbi")
    text = own.source.read_text()
    path = tmp_path / "of_mine.urdf"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = hqp.robots.load(path, floating=True, name="mine")
    monkeypatch.setattr(capsules, "fit", lambda part: pytest.fail("fitted anew"))
    assert robot.capsules == own.capsules
    assert not [note for note in robot.notes if "capsules" in note]


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in range(1, 8))])
def test_a_link_that_differs_has_a_fit_of_its_own(seed: int, tmp_path: Path) -> None:
    """Add a ball of drawn size to a drawn link: only this link is fitted again, with a note."""
    rng = np.random.default_rng(seed)
    own = hqp.robots.load("cbi")
    links = sorted({capsules.link_name(own, c.body) for c in own.capsules})
    link = str(rng.choice(links))
    place, radius = rng.uniform(-0.2, 0.2, 3), rng.uniform(0.003, 0.1)
    ball = (
        f'<link name="knob">{MASS}<collision><geometry><sphere radius="{radius}"/></geometry></collision></link>'
        f'<joint name="knob_joint" type="fixed"><parent link="{link}"/><child link="knob"/>'
        f'<origin xyz="{place[0]} {place[1]} {place[2]}"/></joint></robot>'
    )
    path = tmp_path / "cbi.urdf"
    path.write_text(own.source.read_text().replace("</robot>", ball))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = hqp.robots.load(path, floating=True)
        found = robot.capsules
    assert any("fitted to other shapes" in note and note.endswith(f": {link}") for note in robot.notes)
    for item in robot.geometry.geometryObjects:
        about = [c for c in found if c.body == item.parentJoint]
        assert outside(drawn(item, 300, rng), about) < 1e-6, item.name


def divided(part: Surface, rng: Any) -> Surface:
    """Split each triangle in four, rotated and in another order."""
    t, middle = part.triangles, 0.5 * (part.triangles + np.roll(part.triangles, 1, axis=1))
    corners = [np.stack((t[:, k], middle[:, k], middle[:, (k + 1) % 3]), axis=1) for k in range(3)]
    whole = part.radii > 0.0  # a swept triangle has a weight for its perimeter, too
    found = np.concatenate([middle[~whole], t[whole], *(c[~whole] for c in corners)])
    radii = np.concatenate([part.radii[~whole], part.radii[whole], *[part.radii[~whole]] * 3])
    order = rng.permutation(len(radii))
    return Surface(found[order][:, rng.permutation(3)], radii[order])


@pytest.mark.parametrize("name", SHIPPED)
def test_measures_do_not_depend_on_the_triangles(name: str) -> None:
    rng = np.random.default_rng(1)
    for part in capsules.surfaces(hqp.robots.load(name)).values():
        told = capsule_files.measures(part)
        np.testing.assert_allclose(capsule_files.measures(divided(part, rng)), told, atol=1e-8)
        shift, scale = rng.normal(size=3), rng.uniform(1.001, 1.1)
        moved = Surface(part.triangles + 1e-5 * shift / np.linalg.norm(shift), part.radii)
        for change in (moved, Surface(part.triangles * scale, part.radii * scale)):
            assert np.abs(capsule_files.measures(change) - told).max() > capsule_files.SAME


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_capsules_are_found_without_a_fit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capsules, "fit", lambda part: pytest.fail("fitted anew"))
    robot = hqp.robots.load(name)
    assert {c.body for c in robot.capsules} == set(capsules.surfaces(robot))


@pytest.mark.long
def test_a_file_fitted_to_other_shapes_warns(tmp_path: Path) -> None:
    box = arm(tmp_path, '<box size=".1 .1 .1"/>')
    path = tmp_path / "fit.toml"
    path.write_text(capsule_files.text(box, capsules.fitted(box)))
    assert box.with_capsules(path).capsules
    with pytest.warns(ModelWarning, match="other shapes than generated_arm has at arm"):
        arm(tmp_path, '<box size=".1 .1 .12"/>').with_capsules(path)
