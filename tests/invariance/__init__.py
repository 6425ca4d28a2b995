"""Metamorphic tests: transform an input, predict how the answer transforms, compare."""
