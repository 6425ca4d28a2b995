"""Sentis, Petersen, Philippsen 2012: equations and experiments on Dreamer."""
