"""Collision avoidance in closed loop and on the clock."""
