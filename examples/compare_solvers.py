"""One stack through several solvers, judged level by level by an independent certificate."""

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

robot = hqp.robots.load("g1")
stack = Stack(
    Level(*(FixedContact(frame=sole) for sole in robot.landmarks["soles"]), Com(axes="xy"), name="balance"),
    Level(Position(frame="right_wrist_yaw_link"), name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
result = hqp.compare(stack, robot, solvers=("lexicographic", "weighted"))
print(result)
assert result["lexicographic"].certified == 1.0
