"""From one stack to another while the robot runs: the path between them, blended answers, eased rows."""
