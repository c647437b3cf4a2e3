from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "deploy").rglob("*.md")])
HISTORY = {"CHANGELOG.md"}  # names files as they were
FOLDERS = (ROOT, ROOT / "gateway", ROOT / "tests")

_FILE = re.compile(r"`([\w./-]+\.(?:py|sh|conf|csv|toml|service))(?:::\w+)?`")
_LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[\w-]+)?\)")
_OF_USERS = {
    "site.toml",
    "plant.toml",
    "family.toml",
    "bits.csv",
    "enums.csv",
    "alarms.csv",
    "es.csv",
    "pt.csv",
    "parameters.csv",
    "mosquitto.conf",  # of a kit
    "bridge.conf",
}


def files_named(document: Path) -> list[str]:
    return [name for name in _FILE.findall(document.read_text("utf-8")) if name not in _OF_USERS]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_that_a_document_names_exists(document: Path) -> None:
    if document.name in HISTORY:
        return

    missing = {
        name for name in files_named(document) if not any((folder / name).exists() for folder in FOLDERS)
    }

    assert missing == set()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_of_a_document_leads_to_a_file(document: Path) -> None:
    links = [link for link in _LINK.findall(document.read_text("utf-8")) if "//" not in link]

    assert [link for link in links if not (document.parent / link).exists()] == []


def test_the_readme_is_short_and_its_number_was_measured() -> None:
    readme, measured = ((ROOT / name).read_text("utf-8") for name in ("README.md", "docs/performance.md"))

    (share,) = re.findall(r"still polled at ([\d.]+) %", readme)
    assert len(readme.splitlines()) <= 120
    assert f"| at least {float(share) / 100:.3f};" in measured
