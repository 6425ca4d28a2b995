"""The loop in a rival's own environment, where hqp is not installed: times, states, failures of every scene.

A rival is a class made of a scene, with ``aim(name, values)``, ``prepare()``, ``solve()``, ``advance()``, ``base()``,
``angles()``, ``speeds()`` and ``com()``.  The timed part is setting new targets and the solve with its kinematics;
``prepare`` makes the task equal for all, and is not timed.
"""

from __future__ import annotations

import gc
import json
import logging
import sys
import time
import warnings
from pathlib import Path

import numpy as np

WARM_UP = 50


def main(make):
    """Run every scene of the job in the folder that is the first argument; write ``answer.npz`` and ``answer.json``."""
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    folder = Path(sys.argv[1])
    job = json.loads((folder / "job.json").read_text())
    only = set(sys.argv[2:])
    targets = np.load(folder / "targets.npz")
    arrays, said = {}, {}
    for scene in job["scenes"]:
        name = scene["name"]
        if only and name not in only:
            continue
        wanted = {t["name"]: targets[f"{name}/{t['name']}"] for t in scene["tasks"]}
        try:
            rival = make(scene, job["dt"], {k: v[0] for k, v in wanted.items()})
        except NotImplementedError as error:
            said[name] = {"refused": str(error)}
            continue
        found, first = _loop(rival, scene, wanted)
        for key, value in found.items():
            arrays[f"{name}/{key}"] = value
        said[name] = {"failed": first, "com": [float(x) for x in rival.com_at_start]}
    np.savez(folder / "answer.npz", **arrays)
    (folder / "answer.json").write_text(json.dumps(said))


def _loop(rival, scene, wanted):
    ticks = scene["ticks"]
    moving = {n: w for n, w in wanted.items() if np.any(w != w[0])}
    rival.com_at_start = np.asarray(rival.com())
    wall, failed = np.zeros(ticks), np.zeros(ticks, dtype=bool)
    base, angles, speeds = [], [], []
    first = ""
    gc.collect()
    gc.disable()
    for k in range(-WARM_UP, ticks):
        at = max(k, 0)
        if k >= 0:
            base.append(rival.base())
            angles.append(rival.angles())
        problem = ""
        start = time.perf_counter_ns()
        aimed = start
        try:
            for name, values in moving.items():
                rival.aim(name, values[at])
            aimed = time.perf_counter_ns()
            rival.prepare()
            begun = time.perf_counter_ns()
            rival.solve()
        except Exception as error:
            problem = f"{type(error).__name__}: {error}".split("\n")[0] or type(error).__name__
            begun = aimed
        spent = time.perf_counter_ns() - begun + aimed - start
        if not problem and not np.all(np.isfinite(rival.speeds())):
            problem = "answers NaN"
        if problem:
            rival.stop()
        if k >= 0:
            wall[k], failed[k] = 1e-3 * spent, bool(problem)
            speeds.append(np.array(rival.speeds()))
            first = first or problem
            rival.advance()
    gc.enable()
    return {"wall": wall, "failed": failed, "base": np.array(base), "angles": np.array(angles),
            "speeds": np.array(speeds)}, first  # fmt: skip


def weighed(task, dt):
    """Cost, gain of a step and mask of x, y, z of a task in one weighted QP; a hard one costs 1."""
    weight = 1.0 if task["level"] < 0 else cost(task["level"], task["weight"])
    mask = np.array([1.0 if a in task["axes"] else 0.0 for a in "xyz"])
    return weight, min(1.0, task["gain"] * dt), mask


def cost(level, weight):
    """Levels by weight: 100, 10, 1, ... costs, which the objective squares."""
    return weight * 10.0 ** (2 - level)


class WeighedTasks:
    """Tasks of one weighted QP, as pink and mink alike have them: q, v, model and configuration are the rival's.

    It makes ``com_task(cost, gain)``, ``posture_task(cost, gain)`` and ``frame_task(frame, position, orientation,
    gain)``, and ``moved(pose, kind, mask, value)`` is a pose with a part of it elsewhere.
    """

    def take(self, scene, targets):
        self.tasks, self.hard, self.soft = {}, [], []
        for t in scene["tasks"]:
            w, gain, mask = weighed(t, self.dt)
            kind = t["kind"]
            if kind == "com":
                task = self.com_task(w * mask, gain)
            elif kind == "posture":
                task = self.posture_task(w, gain)
            else:
                costs = {"position": (w * mask, 0.0), "orientation": (0.0, w * mask), "pose": (w, w)}[kind]
                task = self.frame_task(t["frame"], *costs, gain)
            task.set_target_from_configuration(self.configuration)
            self.tasks[t["name"]] = (task, kind, mask > 0.0)
            (self.hard if t["level"] < 0 else self.soft).append(task)
            if kind != "posture":
                self.aim(t["name"], targets[t["name"]])
        self.v = np.zeros(self.model.nv)

    def aim(self, name, value):
        task, kind, mask = self.tasks[name]
        if kind == "com":
            goal = task.target_com.copy()
            goal[mask] = value
        else:
            goal = self.moved(task.transform_target_to_world, kind, mask, value)
        task.set_target(goal)

    def prepare(self):
        pass

    def stop(self):
        self.v = np.zeros(self.model.nv)

    def angles(self):
        return self.q[self.at]

    def speeds(self):
        return self.v[self.columns]
