"""Frames of a MuJoCo model by name: its sites, and its bodies."""

from __future__ import annotations

from typing import Any

from hqp.errors import FrameNotFound

from .mujoco_extra import mujoco


class Frames:
    """Finds sites and bodies of a MjModel; a body goes before a site of the same name, which is ``NAME_site``."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._found: dict[str, tuple[bool, int]] = {}

    def find(self, name: str) -> tuple[bool, int]:
        """Return true and the index for a site, false and the index for a body; raises FrameNotFound."""
        if name not in self._found:
            self._found[name] = self._search(name)
        return self._found[name]

    def body(self, name: str) -> int:
        """Index of the body that carries a frame; raises FrameNotFound."""
        site, index = self.find(name)
        return int(self._model.site_bodyid[index]) if site else index

    def _search(self, name: str) -> tuple[bool, int]:
        site, body = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_BODY
        for kind, own in ((body, name), (site, name), (site, name.removesuffix("_site"))):
            index = int(mujoco.mj_name2id(self._model, kind, own))
            if index >= 0:
                return kind == site, index
        known = [self._model.site(i).name for i in range(self._model.nsite)]
        known += [self._model.body(i).name for i in range(self._model.nbody)]
        raise FrameNotFound(name, known, "the MuJoCo model")
