"""Steps of a tick: check the state, take references, fill rows, solve, send a safe command."""
