"""Hands blocked by shapes, and a table in MuJoCo."""
