"""Tasks and interfaces of pink, mink, LeRobot, IsaacTeleop and Gymnasium on hqp; each imports its library when used.

They are part of the wheel because programs import them: a stack keeps its pink or mink tasks while it moves over.
"""
