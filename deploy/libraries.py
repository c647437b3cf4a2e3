"""The libraries in JavaScript that wheel and package carry: the page's, and the documentation's."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

LICENCES = Path(__file__).parent / "licences"  # their texts; the site's hook looks that none is missing
SITE = "gateway/docs_site"
VENDOR = "gateway/plugins/web/static/vendor"
SPDX = {
    "clipboard": "MIT",
    "escape-html": "MIT",
    "focus-visible": "W3C-20150513",
    "lunr": "MIT",
    "material-design-color": "MIT",
    "material-design-icons": "Apache-2.0",
    "mkdocs-material": "MIT",
    "rxjs": "Apache-2.0",
    "tslib": "0BSD",
}


@dataclass(frozen=True)
class Library:
    """One library: its version where what is shipped says it, its licence, and the files that hold it."""

    name: str
    version: str | None
    spdx: str
    text: str
    files: str  # relative to the folder of the packages

    def component(self) -> dict[str, Any]:
        """Return the library as CycloneDX has it."""
        kind = "pypi" if self.name == "mkdocs-material" else "npm"
        at = f"@{self.version}" if self.version else ""
        found = {"type": "library", "bom-ref": f"{kind}:{self.name}{at}", "name": self.name}
        if self.version:
            found["version"] = self.version
        return {**found, "licenses": [{"license": {"id": self.spdx}}], "purl": f"pkg:{kind}/{self.name}{at}"}


def libraries(packages: Path) -> list[Library]:
    """Return the libraries in a folder of packages, the page's first."""
    vendor, site = packages / VENDOR, packages / SITE
    lock = json.loads((vendor / "package-lock.json").read_text("utf-8"))
    uplot = lock["packages"]["node_modules/uplot"]
    text = (vendor / "uPlot.LICENSE").read_text("utf-8")
    found = [Library("uplot", uplot["version"], uplot["license"], text, f"{VENDOR}/uPlot*")]
    scripts = "".join(path.read_text("utf-8") for path in sorted(site.rglob("*.js")))
    versions = {
        "clipboard": _said(r"clipboard\.js v([\d.]+)", scripts),
        "lunr": _said(r'\.version="(2\.[\d.]+)"', scripts),
        "mkdocs-material": version("mkdocs-material"),
    }
    for name, spdx in SPDX.items():
        text = (LICENCES / f"{name}.txt").read_text("utf-8")
        found.append(Library(name, versions.get(name), spdx, text, f"{SITE}/*"))
    return found


def _said(pattern: str, text: str) -> str | None:
    found = re.search(pattern, text)
    return found[1] if found else None
