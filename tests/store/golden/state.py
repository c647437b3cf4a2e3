"""The state directory that version 0.2.0 left, as a fixture."""

from __future__ import annotations

import tarfile
from pathlib import Path

GOLDEN = Path(__file__).parent / "state-of-0.2.0.tar.gz"


def unpack_golden(to: Path) -> Path:
    """Write the files below a folder, and return that."""
    with tarfile.open(GOLDEN) as archive:
        for member in archive:
            source = archive.extractfile(member) if member.isreg() else None
            if source is not None:
                path = to / member.name
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                path.write_bytes(source.read())
                path.chmod(0o600)
    return to
