"""Damaged files: random damage to recordings, URDF and MJCF files, and the errors that they must cause."""
