"""Writes every generated page of the reference: `python -m tests.reference`."""

from __future__ import annotations

from tests.reference.pages import FOLDER, pages

if __name__ == "__main__":
    for name, text in pages().items():
        path = FOLDER / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
