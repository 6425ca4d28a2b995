"""What a report is made of: checks, tables, the machine, the solvers."""
