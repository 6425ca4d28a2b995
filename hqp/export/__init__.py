"""Sessions from plan files: one, or many worlds at once; the robot's model is not needed."""
