"""Inverse kinematics to random reachable poses: share of poses reached, times."""
