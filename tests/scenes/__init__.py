"""Scenes shared by tests and benchmarks: stored and drawn problems, stacks of the papers, closed loops, figures.

This folder imports hqp only, and no wheel contains it.
"""
