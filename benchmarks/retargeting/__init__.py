"""Human motion on robots: hqp, and weighted inverse kinematics frame by frame, on the same targets."""
