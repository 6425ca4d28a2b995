"""Machine of a measurement: the lab's manifest as lines of a report."""

from __future__ import annotations

from hqp import native
from hqp.commands.manifest import manifest


def description() -> tuple[tuple[str, str], ...]:
    """Pairs of name and value for the head of a report."""
    m = manifest()
    machine = m["machine"]
    return (
        ("machine", f"{machine['processor']}, {machine['cores']} logical cores, {machine['system']}"),
        ("Python", m["python"]),
        ("hqp", f"{m['hqp']} {m['commit'][:10]}, {native.describe()}"),
        ("packages", ", ".join(f"{name} {version}" for name, version in m["packages"].items())),
        ("BLAS", m["blas"]),
        ("load average", ", ".join(f"{x:.1f}" for x in machine["load"])),
    )


def line() -> str:
    """Machine and load, below a table of times."""
    return "; ".join(f"{what}: {which}" for what, which in description() if what in ("machine", "load average")) + "."
