"""Closed loops out of reach, at the edge, and blocked; neighbouring problems; times of arrival."""
