"""Closed loops that try to make a controller restless: out of reach, at the edge, blocked, contradictory."""
