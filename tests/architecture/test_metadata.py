"""Metadata in files: one version, one licence, and only addresses that pyproject.toml declares."""

from __future__ import annotations

import re
import sys
from importlib.metadata import distribution
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
    conda = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert field(citation, "version") == PROJECT["version"] == hqp.__version__
    assert re.findall(r"^  version: (\d.*)$", conda, re.MULTILINE) == [PROJECT["version"]]
    assert field(citation, "license") == field(conda, "license") == PROJECT["license"]
    assert field(citation, "title").partition(":")[0] == PROJECT["name"]
    assert [field(citation, "name")] == [author["name"] for author in PROJECT["authors"]]


def test_conda_asks_for_what_the_project_asks_for() -> None:
    conda = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    listed = re.findall(r"- (?:if: .*\n +then: )?([\w-]+ >=[\d.]+)$", conda.partition("run:")[2], re.MULTILINE)
    asked = {line.partition(";")[0].strip().replace(">=", " >=") for line in PROJECT["dependencies"]}
    assert set(listed) == {line.replace("pin >", "pinocchio >") for line in asked} | {"python >=3.10"}


def test_no_address_but_those_of_the_project() -> None:
    pages = [
        p
        for pattern in ("*.md", "*.cff", "*.toml", "*.yml", ".github/**/*", "docs/**/*.md", "docs/*.py")
        for p in ROOT.glob(pattern)
    ]
    pages += [ROOT / "conda" / "recipe.yaml", *(ROOT / "hqp").glob("**/*.py")]
    allowed = tuple(PROJECT.get("urls", {}).values())
    for page in filter(Path.is_file, pages):
        for address in ADDRESS.findall(page.read_text(encoding="utf-8")):
            assert address.startswith(allowed), f"{page.relative_to(ROOT)}: {address}"


def test_actions_of_workflows_are_pinned_by_commit() -> None:
    """A tag may be moved to other code, a commit not."""
    used = [
        (path.name, action)
        for path in sorted((ROOT / ".github" / "workflows").glob("*.yml"))
        for action in re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8"))
    ]
    assert used
    for name, action in used:
        assert re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40}", action), f"{name}: {action}"


def test_formatters_have_one_version() -> None:
    """Hooks use the versions of the environment: one series of each formatter."""
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    dev = PROJECT["optional-dependencies"]["dev"]
    for name in ("ruff", "clang-format"):
        assert re.findall(rf"entry: (\S*{name})\b", hooks)
        assert set(re.findall(rf"entry: (\S*{name})\b", hooks)) == {f".venv/bin/{name}"}
        assert not re.search(rf"repo: \S*{name}", hooks)
        (asked,) = [each for each in dev if each.startswith(name)]
        assert re.fullmatch(rf"{name}>=[\d.]+,<[\d.]+", asked), asked


def test_an_editable_install_adds_no_folder_but_the_checkout() -> None:
    """A parent folder on sys.path lets files beside the checkout shadow modules."""
    record = distribution("hqp").files or []
    links = [Path(str(file.locate())) for file in record if file.suffix == ".pth"]
    added = {line for link in links for line in link.read_text(encoding="utf-8").split("\n") if line.startswith("/")}
    assert {Path(line).resolve() for line in added} <= {ROOT.resolve()}, f"{links}: install --editable again"
