"""Parts of a report: checks, tables, the machine, the solvers."""
