"""What mkdocs does besides: pages from outside docs/, links to files that are no pages, licences.

A link to a file of the repository that is not in the site becomes its name: the site works without internet.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LICENCES = ROOT / "deploy" / "licences"  # of the libraries that the site's theme has bundled
TAKEN_IN = {  # pages of the site, and where they stand in the repository
    "install.md": ROOT / "deploy" / "INSTALL.md",
    "changes.md": ROOT / "CHANGELOG.md",
    "contributing.md": ROOT / "CONTRIBUTING.md",
}
HOME = {ROOT / "README.md": "index.md"}  # else said by
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#:\s]+)(#[\w-]+)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that stand elsewhere."""
    from mkdocs.structure.files import File

    for name, path in TAKEN_IN.items():
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead each link to the page of the site, or name the file that is none."""
    where = page.file.src_uri
    folder = TAKEN_IN.get(where, DOCS / where).parent

    def led(found: re.Match[str]) -> str:
        text, target, anchor = found[1], found[2], found[3] or ""
        if "//" in target:
            return found[0]
        path = Path(os.path.normpath(folder / target))
        name = page_of(path)
        if name is not None and files.get_file_from_path(name) is not None:
            return f"[{text}]({os.path.relpath(name, Path(where).parent)}{anchor})"
        shown = path.relative_to(ROOT).as_posix()
        return text if shown in text else f"{text} (`{shown}`)"

    return _LINK.sub(led, markdown)


def on_post_build(config: Any) -> None:
    """Remove what an English site without an address never loads, and what carries the day of the build.

    The licences of the libraries in its scripts are added; ValueError when the text of one is missing.
    """
    site = Path(config["site_dir"])
    for name in ("sitemap.xml", "sitemap.xml.gz"):
        (site / name).unlink(missing_ok=True)
    shutil.rmtree(site / "assets" / "javascripts" / "lunr", ignore_errors=True)
    texts = {path.stem: path.read_text("utf-8") for path in sorted(LICENCES.glob("*.txt"))}
    for path in site.rglob("*.map"):
        sources = " ".join(json.loads(path.read_text("utf-8"))["sources"])
        if missing := set(re.findall(r"node_modules/((?:@[^/]+/)?[^/]+)", sources)) - texts.keys():
            raise ValueError(f"deploy/licences has no text of {', '.join(sorted(missing))}")
        path.unlink()
    notices = [f"{name}\n{'=' * len(name)}\n\n{text.strip()}\n" for name, text in texts.items()]
    (site / "NOTICES.txt").write_text("\n\n".join(notices), "utf-8")


def page_of(path: Path) -> str | None:
    """Return the site's file for a file of the repository; None when it is not in the site."""
    inside = {each: name for name, each in TAKEN_IN.items()} | HOME
    if path in inside:
        return inside[path]
    return path.relative_to(DOCS).as_posix() if path.is_relative_to(DOCS) and path.is_file() else None
