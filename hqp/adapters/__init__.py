"""Other libraries' tasks and interfaces on hqp: pink, mink, LeRobot, Gymnasium; each imports its library when used."""
