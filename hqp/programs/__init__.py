"""A stack on a robot: which rows stand where, and what evaluates them in every tick."""
