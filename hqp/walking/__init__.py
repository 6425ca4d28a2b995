"""Walking on two feet: footsteps, the pendulum that goes with them, swing feet, and a walker made of these."""

from hqp.walking.adjustment import Landing, adjust
from hqp.walking.bound import largest_push
from hqp.walking.footsteps import LEFT, RIGHT, Command, Foothold, Footsteps
from hqp.walking.gait import Gait, Reach
from hqp.walking.pendulum import DcmPlan, Piece, capture_point, natural_frequency
from hqp.walking.plan import Walk
from hqp.walking.stacks import Laws, Stacks
from hqp.walking.stance import borne, standing
from hqp.walking.swing import Swing
from hqp.walking.walker import Walker
from hqp.walking.walkers import Walkers

__all__ = [
    "LEFT",
    "RIGHT",
    "Command",
    "DcmPlan",
    "Foothold",
    "Footsteps",
    "Gait",
    "Landing",
    "Laws",
    "Piece",
    "Reach",
    "Stacks",
    "Swing",
    "Walk",
    "Walker",
    "Walkers",
    "adjust",
    "borne",
    "capture_point",
    "largest_push",
    "natural_frequency",
    "standing",
]
