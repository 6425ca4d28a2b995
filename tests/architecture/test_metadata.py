"""What files say of the package: one version, one licence, and no address but those that pyproject.toml declares."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import hqp

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ADDRESS = re.compile(
    r"https?://(?:github|gitlab)\.com/[\w.-]+/hqp\b[^\s)\"']*|https?://[\w.-]*hqp[\w.-]*\.(?:org|io|dev|com)\b"
)


def field(text: str, name: str) -> str:
    (found,) = re.findall(rf"^\s*(?:- )?{name}: \"?(.*?)\"?$", text, re.MULTILINE)[:1]
    return str(found)


def test_citation_conda_and_package_agree_with_the_project() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    conda = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    assert field(citation, "version") == PROJECT["version"] == hqp.__version__
    assert re.findall(r'set version = "(.*?)"', conda) == [PROJECT["version"]]
    assert field(citation, "license") == field(conda, "license") == PROJECT["license"]
    assert field(citation, "title").partition(":")[0] == PROJECT["name"]
    assert [field(citation, "name")] == [author["name"] for author in PROJECT["authors"]]


def test_conda_asks_for_what_the_project_asks_for() -> None:
    conda = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    run = {
        re.split(r"[ >]", line.strip("- "))[0] for line in conda.partition("run:")[2].partition("test:")[0].splitlines()
    }
    asked = {re.split(r"[>;]", line)[0].strip() for line in PROJECT["dependencies"]}
    assert {"pinocchio" if name == "pin" else name for name in asked} <= run


def test_no_address_but_those_of_the_project() -> None:
    pages = [
        p
        for pattern in ("*.md", "*.cff", "*.toml", "*.yml", ".github/**/*", "docs/**/*.md", "docs/*.py")
        for p in ROOT.glob(pattern)
    ]
    pages += [ROOT / "conda" / "meta.yaml", *(ROOT / "hqp").glob("**/*.py")]
    allowed = tuple(PROJECT.get("urls", {}).values())
    for page in filter(Path.is_file, pages):
        for address in ADDRESS.findall(page.read_text(encoding="utf-8")):
            assert address.startswith(allowed), f"{page.relative_to(ROOT)}: {address}"
