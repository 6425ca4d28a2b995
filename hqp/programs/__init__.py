"""A stack on a robot: place of each row, and its evaluation in every tick."""
