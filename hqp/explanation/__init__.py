"""Explain a command: shares of each level from the multipliers, constraints in conflict, in words."""

from hqp.explanation.words import Account, Explanation, HeldBack, Loss, Short

__all__ = ["Account", "Explanation", "HeldBack", "Loss", "Short"]
