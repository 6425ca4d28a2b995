"""How long solvers and ticks take, on stored problems and in the loop."""
