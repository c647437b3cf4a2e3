"""Writes every generated page of the documents: `python -m tests.reference`."""

from __future__ import annotations

from tests.reference.pages import FOLDER, NAMES, made

if __name__ == "__main__":
    for name in NAMES:
        (FOLDER / name).write_text(made(name), "utf-8")
