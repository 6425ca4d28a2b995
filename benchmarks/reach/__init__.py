"""Inverse kinematics to random reachable poses: how many, how fast."""
