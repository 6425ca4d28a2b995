"""Bipeds that walk in MuJoCo, many times with trifles changed."""
