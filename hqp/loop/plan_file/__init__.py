"""A session as a file that runs without Python."""
