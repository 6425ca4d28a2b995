"""A batch of walkers as a vector environment: a simple agent steers eight of them towards a point."""

import numpy as np

import hqp
from hqp.adapters.gym import WalkersEnv
from hqp.walking import Walker

GOAL = np.array([0.5, 0.3])  # [m]


def reward(q, v, action):
    return -np.linalg.norm(q[:, :2] - GOAL, axis=1)


robot = hqp.robots.load("g1", rotors=True)
env = WalkersEnv(Walker(robot, dt=0.002), 8, frame_skip=50, reward=reward, spread=0.01)  # 0.1 s an action
seen, _ = env.reset(seed=0)
for k in range(60):
    heading = 2.0 * np.arctan2(seen[:, 5], seen[:, 6])
    away = GOAL - seen[:, :2]
    turn = np.angle(np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) - heading)))
    ahead = 0.2 * np.cos(turn) * (np.linalg.norm(away, axis=1) > 0.1)
    seen, value, fallen, _, info = env.step(np.column_stack((ahead, 0.0 * turn, 0.3 * np.tanh(turn))))
    if k % 20 == 19:
        print(f"{0.1 * (k + 1):.0f} s: {-value.mean():.2f} m from the goal, {int(fallen.sum())} have fallen")
env.close()
