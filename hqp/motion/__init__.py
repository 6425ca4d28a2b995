"""Human motion to robots: readers, skeleton maps, contacts, and the motion that strict levels make of it."""

from .box import Box
from .clip import Motion
from .readers import read_motion
from .retargeted import Retargeted
from .retargeting import retarget
from .skeleton_map import SkeletonMap
from .training import save_training, training_arrays

__all__ = ["Box", "Motion", "Retargeted", "SkeletonMap", "read_motion", "retarget", "save_training", "training_arrays"]
