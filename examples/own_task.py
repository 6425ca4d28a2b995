"""A user's task in twenty lines: the distance between two frames."""

from dataclasses import dataclass

import numpy as np

import hqp
from hqp import Level, P, Stack, Task
from hqp.tasks import Com, FixedContact, JointLimits


@dataclass(frozen=True, kw_only=True)
class Spread(Task):
    """|p_b - p_a| [m], with J = n' (J_b - J_a)."""

    a: str
    b: str

    def default_name(self) -> str:
        return f"{self.a} to {self.b}"

    def rows(self, robot) -> int:
        return 1

    def value(self, state):
        return np.array([np.linalg.norm(state.position(self.b) - state.position(self.a))])

    def jacobian(self, state):
        way = state.position(self.b) - state.position(self.a)
        return ((way / np.linalg.norm(way)) @ (state.jacobian(self.b)[:3] - state.jacobian(self.a)[:3]))[None]


robot = hqp.robots.load("cbi")
hands = Spread(a="l_palm", b="r_palm", law=P(5.0))
feet = [FixedContact(frame="l_sole"), FixedContact(frame="r_sole")]
stack = Stack(Level(*feet, Com(axes="xy")), Level(hands), subject_to=[JointLimits()])
session = hqp.Controller(stack).session(robot, dt=0.005)
q, v = robot.home, np.zeros(robot.nv)
for _ in range(400):
    tick = session.step(robot.state(q, v), hands.at([0.35]))
    q, v = tick.advance()
print(f"hands {hands.value(robot.state(q))[0]:.4f} m apart, asked 0.35")
assert abs(hands.value(robot.state(q))[0] - 0.35) < 1e-3
