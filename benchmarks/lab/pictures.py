"""Pictures during a run: a contact sheet, an mp4 on request, or a note if the machine cannot render."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco

from benchmarks.lab import overlay
from benchmarks.lab.outcome import Outcome
from benchmarks.lab.video import Video
from benchmarks.mistry2008.experiments.balance import Balance
from benchmarks.sentis2012.experiments.dreamer_run import Outing

if TYPE_CHECKING:
    from benchmarks.lab.setting import Setting

WIDTH, HEIGHT = 480, 540
FPS = 25


@dataclass(frozen=True, kw_only=True)
class View:
    """Camera: azimuth and elevation [deg], distance from its target and the target's place over the base [m]."""

    azimuth: float
    elevation: float = -10.0
    distance: float = 2.4
    height: float = 0.75
    ahead: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Shoot:
    """Photographed run of an experiment: camera, instants, and drawings in the scene."""

    wanted: Callable[[Any], bool]
    view: View
    instants: Callable[[Any], Sequence[tuple[str, float]]]
    draw: Callable[[Any, Any], None]
    inset: Callable[[Any], overlay.Support] = overlay.feet
    columns: int = 4


def _slope_instants(run: Outing) -> list[tuple[str, float]]:
    walk = run.scene.walk
    way = walk.duration
    return [
        ("at rest", walk.start - 0.1),
        ("onto the slope", walk.start + 0.45 * way),
        ("pulled up", walk.start + 0.62 * way),
        ("turning", walk.start + way + 1.0),
        ("pushed back", walk.turn + 0.5 * way),
        ("down again", walk.turn + 0.85 * way),
    ]


SHOOTS = {
    "cbi-cog": Shoot(
        wanted=lambda run: isinstance(run, Balance),
        view=View(azimuth=180.0, elevation=-8.0, distance=2.3),
        instants=lambda run: [("left", 6.25), ("middle", 7.5), ("right", 8.75)],
        draw=overlay.plumb_line,
        columns=3,
    ),
    "cbi-figure8": Shoot(
        wanted=lambda run: isinstance(run, Balance),
        view=View(azimuth=158.0, elevation=-9.0, distance=2.15, height=0.8),
        instants=lambda run: [("first arc", 3.0), ("first loop", 5.0), ("second arc", 7.0), ("closed", 9.98)],
        draw=overlay.Trace(),
    ),
    "cbi-switch": Shoot(
        wanted=lambda run: isinstance(run, Balance),
        view=View(azimuth=200.0, elevation=-6.0, distance=2.35, height=0.78),
        instants=lambda run: run.instants,
        draw=overlay.plumb_line,
    ),
    "dreamer-slope": Shoot(
        wanted=lambda run: isinstance(run, Outing) and run.choice.normals == "map",
        view=View(azimuth=98.0, elevation=-7.0, distance=2.75, height=0.85, ahead=0.12),
        instants=_slope_instants,
        draw=overlay.human_and_plumb_line,
        inset=overlay.wheels,
        columns=3,
    ),
}


class Photographer:
    """Photographer of the first run that its ``Shoot`` selects; call it after every period of every run."""

    def __init__(self, name: str, setting: Setting) -> None:
        self._name, self._setting = name, setting
        self._shoot = SHOOTS.get(name)
        self._run: Any = None
        self._renderer: Any = None
        self._left: list[tuple[str, float]] = []
        self._images: list[tuple[str, Any, overlay.Support]] = []
        self._video: Video | None = None
        self._next_frame = 0.0
        self._trouble = ""

    def __call__(self, run: Any) -> None:
        """Take a picture if it is time for one."""
        shoot = self._shoot
        if shoot is None or self._trouble or (self._run is None and not shoot.wanted(run)):
            return
        if self._run is None:
            self._begin(run, shoot)
        if run is not self._run or self._trouble:
            return
        if isinstance(shoot.draw, overlay.Trace):
            shoot.draw.follow(run)
        due = bool(self._left) and run.t >= self._left[0][1]
        frame_due = self._video is not None and run.t >= self._next_frame
        if not due and not frame_due:
            return
        image = self._render(run, shoot)
        if frame_due and self._video is not None:
            self._video.add(image)
            self._next_frame += 1.0 / FPS
        if due:
            label, _ = self._left.pop(0)
            inset = shoot.inset(run)
            self._images.append((f"{label}, {run.t:.1f} s", image, inset))

    def _begin(self, run: Any, shoot: Shoot) -> None:
        self._run = run
        try:
            self._renderer = mujoco.Renderer(run.plant.model, HEIGHT, WIDTH)
        except Exception as reason:
            # drivers fail in many ways; the experiment continues without pictures
            self._trouble = f"{type(reason).__name__}: {reason}"
            return
        self._left = list(shoot.instants(run))
        if self._setting.video and self._setting.output is not None:
            self._video = Video(self._setting.output / f"{self._name}.mp4", WIDTH, HEIGHT, FPS)

    def _render(self, run: Any, shoot: Shoot) -> Any:
        camera, view = mujoco.MjvCamera(), shoot.view
        camera.azimuth, camera.elevation, camera.distance = view.azimuth, view.elevation, view.distance
        base = run.plant.data.xpos[1]
        camera.lookat[:] = (base[0] + view.ahead, base[1], overlay.ground_height(run, base[0]) + view.height)
        if hasattr(run, "pull"):
            overlay.place_hand(run)
        self._renderer.update_scene(run.plant.data, camera)
        shoot.draw(self._renderer.scene, run)
        return self._renderer.render()

    def finish(self, outcome: Outcome) -> None:
        """Compose the sheet, close the film, note failures."""
        output: Path | None = self._setting.output
        if self._trouble:
            outcome.notes.append(f"No pictures: {self._trouble}")
        if self._renderer is not None:
            self._renderer.close()
        if self._video is not None:
            if self._video.close():
                outcome.files.append(("video", self._video.path))
            else:
                outcome.notes.append(f"No video: {self._video.trouble}")
        if not self._images or output is None or self._shoot is None:
            return
        try:
            from benchmarks.lab.sheet import compose
        except ImportError as missing:
            outcome.notes.append(f"No contact sheet: {missing}")
            return
        path = output / f"{self._name}_sheet.png"
        compose(self._images, self._shoot.columns, path)
        outcome.files.append((f"{self._name} in simulation", path))
