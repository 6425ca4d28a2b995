"""What a session does each tick: states checked, references taken, rows and solver run, a safe command sent."""
