"""What tests and benchmarks both run: stored and drawn problems, stacks of the papers, closed loops and their figures.

It knows hqp alone, and no wheel holds it.
"""
