"""Hands that shapes block, and a table in MuJoCo."""
