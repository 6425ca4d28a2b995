"""Pages of the site that are made from the sources: examples and changelog; links out of docs/ go to the repository."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SOURCE = "https://github.com/hqp-robotics/hqp/blob/main/"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fill the generated pages, and point links that leave docs/ at the repository."""
    if page.file.src_uri == "examples.md":
        markdown += _examples()
    if page.file.src_uri == "changelog.md":
        markdown = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return re.sub(r"\]\(\.\./([^)#]+)", lambda m: f"]({SOURCE}{m[1]}", markdown)


def _examples() -> str:
    parts = []
    for path in sorted((ROOT / "examples").glob("*.py")):
        text = path.read_text(encoding="utf-8")
        title = (ast.get_docstring(ast.parse(text)) or "").split("\n")[0]
        parts.append(f"\n## {path.stem}\n\n{title}\n\n```python\n{text}```\n")
    return "".join(parts)
