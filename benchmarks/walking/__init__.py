"""Bipeds that walk in MuJoCo, many times with small changes."""
