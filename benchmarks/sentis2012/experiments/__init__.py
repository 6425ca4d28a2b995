"""Sentis 2012's experiments in MuJoCo: Dreamer is pulled up a slope."""
