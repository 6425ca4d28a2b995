"""Recorders, plots and films of simulated experiments."""
