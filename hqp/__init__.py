"""hqp: strict task priorities for floating-base robots, any solver, at control rate."""
