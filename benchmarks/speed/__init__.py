"""Times of solvers and ticks, on stored problems and in the loop."""
