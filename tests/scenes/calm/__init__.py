"""Closed loops out of reach, at the edge, blocked; problems close to one another; when goals are reached."""
