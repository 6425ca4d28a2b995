"""The numbers of one run of Dreamer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.sentis2012.experiments.dreamer_run import Outing
from hqp.arrays import Vec


@dataclass(frozen=True)
class Measures:
    """Numbers of one run: errors [mm], forces [N], angles [deg], speeds [m/s], torques [N m]; NaN if not reached.

    com_first: largest CoM error while the robot settles on its wheels; com_up, com_back: after it, before and after
    the turn.  speed: median over the pull's steady part.
    load_quantile: 0.5 % quantile of the least wheel load from 0.5 s on; unloaded: time without load [s];
    told: time of the status CONTACT_LOST (with measured loads) [s].
    rate_ratio: largest joint speed over its table limit, and the joint.
    """

    fell: float
    com_first: float
    com_up: float
    com_back: float
    travel: float
    speed: float
    peak_speed: float
    pull: float
    hand_pulled: float
    hand_rest: float
    posture: float
    coupling: float
    load_least: float
    load_quantile: float
    unloaded: float
    told: float
    wheel_torque: float
    torque_ratio: float
    slip: float
    yaw: float
    rate_ratio: float
    rate_joint: str
    tick_us: float
    real_time: float

    @property
    def com(self) -> float:
        """Largest CoM error of the whole run [mm], inf after a fall."""
        return math.inf if math.isfinite(self.fell) else max(self.com_up, self.com_back)


def measure(outing: Outing, since: float = 0.5) -> Measures:
    """The numbers of a run, from ``since`` [s] on (after the robot has settled on its wheels)."""
    log, scene, robot = outing.log, outing.scene, outing.robot
    t = log["t"]
    on = t >= since
    com = 1e3 * np.linalg.norm(log["com"], axis=1)
    turn = scene.walk.turn if scene.push is None else 2.5
    up, back = on & (t < turn), on & (t >= turn)
    speed = np.linalg.norm(log["velocity"][:, :2], axis=1)
    easing = scene.walk.start + scene.walk.easing
    steady = (t >= easing) & (t < max(scene.walk.start + scene.walk.distance / scene.walk.speed, easing + 0.01))
    hand = 1e3 * np.linalg.norm(log["hand"], axis=1)
    rest = on & (t < scene.walk.start) & (t >= max(since, scene.walk.start - 0.1))
    moved = np.linalg.norm(log["base"][:, :2] - log["base"][0, :2], axis=1)
    load = log["load"][on].min(axis=1)
    limit = robot.velocity_limit[robot.actuated]
    ratio = np.abs(log["rate"][on]) / limit
    worst = int(np.argmax(ratio.max(axis=0))) if len(ratio) else 0
    return Measures(
        fell=float(t[-1]) if outing.fallen else math.nan,
        com_first=_largest(com[~on]),
        com_up=_largest(com[up]),
        com_back=_largest(com[back]),
        travel=_largest(moved),
        speed=float(np.median(speed[steady])) if steady.any() else math.nan,
        peak_speed=_largest(speed[on]),
        pull=_largest(np.linalg.norm(log["pull"], axis=1)),
        hand_pulled=_largest(hand[on]),
        hand_rest=_largest(hand[rest]),
        posture=math.degrees(_largest(np.abs(log["posture"][on]).max(axis=1))),
        coupling=math.degrees(_largest(np.abs(log["coupling"][on]))),
        load_least=float(load.min()) if load.size else math.nan,
        load_quantile=float(np.quantile(load, 0.005)) if load.size else math.nan,
        unloaded=float(np.count_nonzero(load <= 0.0) * outing.choice.period),
        told=float(np.count_nonzero(log["lost"][on]) * outing.choice.period),
        wheel_torque=_largest(np.abs(log["torque"][on][:, 9:]).max(axis=1)),
        torque_ratio=_largest((np.abs(log["torque"][on]) / robot.effort_limit[robot.actuated]).max(axis=1)),
        slip=_largest(np.abs(log["slip"][on]).max(axis=1)),
        yaw=math.degrees(_largest(np.abs(np.unwrap(log["base"][on][:, 3]) - scene.heading))),
        rate_ratio=float(ratio.max()) if ratio.size else math.nan,
        rate_joint=robot.joint_names[worst],
        tick_us=float(1e6 * np.median(log["tick"])),
        real_time=outing.real_time[0],
    )


def _largest(values: Vec) -> float:
    return float(values.max()) if values.size else math.nan
