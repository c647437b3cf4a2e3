"""The package's copyright file: Starter Gateway's licence, and those of every wheel in it, word for word."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

from deploy.libraries import libraries

TREE = "usr/lib/starter-gateway/site-packages"
_APACHE = "Apache License, Version 2.0: on Debian systems in /usr/share/common-licenses/Apache-2.0."
_LICENCES = ("licen", "copying", "notice", "authors")


def copyright_of(packages: Path) -> str:
    """Return the text, in Debian's machine-readable form, for the wheels and the libraries in JavaScript."""
    found = sorted(distributions(path=[str(packages)]), key=lambda each: each.name.lower())
    parts = [part for each in found if each.name != "starter-gateway" for part in _paragraphs(each)]
    parts += [
        _paragraph(
            f"{TREE}/{each.files}", " ".join(filter(None, (each.name, each.version))), _brief(each.text)
        )
        for each in libraries(packages)
    ]
    own = "Files: *\nCopyright: the authors of Starter Gateway\nLicense: Apache-2.0"
    apache = "License: Apache-2.0\n On Debian systems the text is in /usr/share/common-licenses/Apache-2.0."
    head = (
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n"
        "Upstream-Name: Starter Gateway\n"
        f"Comment: {TREE} holds wheels of other projects, as published."
    )
    return "\n\n".join([head, own, *parts, apache]) + "\n"


def _paragraphs(wheel: Distribution) -> Iterator[str]:
    info = wheel.metadata
    name = f"{wheel.name} {wheel.version}"
    folders = sorted({path.parts[0] for path in wheel.files or () if ".." not in path.parts})
    files = " ".join(f"{TREE}/{folder}/*" for folder in folders)
    texts = list(_texts(wheel))
    stated = info.get("License-Expression") or info.get("License") or ""
    classifiers = [each for each in info.get_all("Classifier") or () if each.startswith("License ::")]
    if not texts and not stated and not classifiers:
        raise ValueError(f"{name} states no licence: it may not be shipped")
    brief = stated if stated and "\n" not in stated else "; ".join(classifiers)
    yield _paragraph(files, name, "\n\n".join([*([f"Stated: {brief}"] if brief else []), *texts]))


def _texts(wheel: Distribution) -> Iterator[str]:
    for path in sorted(wheel.files or (), key=str):
        inside = ".dist-info" in path.parts[0]
        if inside and any(word in path.name.lower() for word in _LICENCES) and path.suffix != ".py":
            yield _brief(Path(str(path.locate())).read_text("utf-8", errors="replace").strip())


def _brief(text: str) -> str:
    """Return a licence's text, or where a Debian system has it."""
    return _APACHE if "Apache License\n" in text and "END OF TERMS" in text else text


def _paragraph(files: str, name: str, text: str) -> str:
    label = name.replace(" ", "-")
    body = "\n".join(f" {line.rstrip()}" if line.strip() else " ." for line in text.splitlines())
    return f"Files: {files}\nCopyright: the authors of {name}, as its licence says\nLicense: {label}\n{body}"
