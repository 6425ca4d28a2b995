"""What a simulated experiment is recorded, drawn and filmed with."""
