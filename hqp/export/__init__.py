"""A session as a file: what a tick is made of, for C++ and for Python without the robot's model."""
