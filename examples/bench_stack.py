"""One's own stack in closed loop, measured; the report is one page that opens without a network."""

import tempfile
from pathlib import Path

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

robot = hqp.robots.load("cbi")
stack = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy"), name="balance"),
    Level(Position(frame="r_palm"), name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
result = hqp.bench(stack, robot, trajectory="circle", solvers=("lexicographic",), seconds=0.5)
print(result)
folder = Path(tempfile.mkdtemp())
(folder / "run.json").write_text(result.json())
print([change.verdict for change in result.against(folder / "run.json")])
assert result["lexicographic"].certified == 1.0
