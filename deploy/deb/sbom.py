"""The bill of materials of a package, CycloneDX, made from what is in it."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from deploy.libraries import libraries


def write_sbom(packages: Path, path: Path) -> None:
    """Write the components of a folder of wheels, its libraries in JavaScript too.

    The same folder gives the same bytes.
    """
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "python"  # one that sees only the folder
        python.write_text(f'#!/bin/sh\nPYTHONPATH="{packages}" exec /usr/bin/python3 -S "$@"\n', "utf-8")
        python.chmod(0o755)
        program = Path(sys.executable).parent / "cyclonedx-py"
        options = (
            "--output-reproducible",
            "--validate",
            "--output-format",
            "JSON",
            "--output-file",
            str(path),
        )
        subprocess.run([program, "environment", *options, str(python)], check=True)
    bill = json.loads(path.read_text("utf-8"))
    bill["components"] += [each.component() for each in libraries(packages)]
    path.write_text(json.dumps(bill, indent=2, ensure_ascii=False) + "\n", "utf-8")
