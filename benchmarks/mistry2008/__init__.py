"""Mistry, Nakanishi, Cheng, Schaal 2008: every equation checked on a robot, the library as the thing under test."""
