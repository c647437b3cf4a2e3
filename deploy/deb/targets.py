"""What a package is built for: a distribution with its Python, and an architecture with its wheels."""

from __future__ import annotations

from dataclasses import dataclass

_WHEELS = {  # Debian's architecture -> as wheels name it
    "amd64": "x86_64",
    "arm64": "aarch64",
    "armhf": "armv7l",
}
_GLIBC = (17, 28, 31, 34, 36)  # 2.x that wheels are built for; Debian 12 has 2.36


@dataclass(frozen=True)
class Distribution:
    """A release of Debian."""

    name: str  # in versions of packages: deb12
    suite: str
    python: str  # 3.11
    next_python: str


DISTRIBUTIONS = {
    each.name: each
    for each in (
        Distribution("deb12", "bookworm", "3.11", "3.12"),
        Distribution("deb13", "trixie", "3.13", "3.14"),
    )
}
ARCHITECTURES = tuple(_WHEELS)


def platforms(architecture: str) -> list[str]:
    """Return the names of the platforms whose wheels run on an architecture, the newest first."""
    machine = _WHEELS[architecture]
    return [f"manylinux_2_{minor}_{machine}" for minor in reversed(_GLIBC)] + [f"manylinux2014_{machine}"]


def package_version(version: str, distribution: Distribution) -> str:
    """Return the Debian version: newer for a newer distribution."""
    return f"{version}-1~{distribution.name}u1"
