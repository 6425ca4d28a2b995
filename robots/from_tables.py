"""Write the model files of our own robots from their tables: ``python -m hqp.robots.from_tables``.

The files are committed; a test compares them with the output of this program.
"""

from __future__ import annotations

from pathlib import Path

from .tables import Tables
from .write_mjcf import mjcf
from .write_urdf import urdf

FOLDER = Path(__file__).resolve().parent
OWN = ("cbi", "dreamer")


def files() -> dict[Path, str]:
    """Path and text of every generated file."""
    written: dict[Path, str] = {}
    for name in OWN:
        tables = Tables.read(FOLDER / name)
        written[FOLDER / name / tables.description["urdf"]] = urdf(tables)
        for stem, wheels in tables.description["mjcf"].items():
            written[FOLDER / name / f"{stem}.xml"] = mjcf(tables, wheels)
    return written


if __name__ == "__main__":
    for path, content in files().items():
        path.write_text(content)
        print(path.relative_to(FOLDER))
