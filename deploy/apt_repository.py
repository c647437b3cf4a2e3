"""Makes a signed apt repository of the packages in dist/: `python -m deploy.apt_repository --key KEY`.

dist/apt is then a folder for any web server, or a disk: Packages, Release and InRelease of each distribution,
and the public key. KEY is a key of yours, as gpg names it; it never leaves gpg.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from email.utils import format_datetime
from pathlib import Path

from deploy.deb.build import OUT
from deploy.deb.targets import ARCHITECTURES, DISTRIBUTIONS, Distribution
from deploy.wheel import commit_time

FOLDER = OUT / "apt"
KEYRING = "starter-gateway.gpg"  # for /etc/apt/keyrings


def main() -> int:
    """Make the repository."""
    parser = argparse.ArgumentParser(prog="python -m deploy.apt_repository", description=__doc__)
    parser.add_argument("--key", required=True, help="fingerprint or address of the key that signs")
    make(sorted(OUT.glob("*.deb")), FOLDER, parser.parse_args().key)
    print(FOLDER)
    return 0


def make(packages: list[Path], folder: Path, key: str) -> None:
    """Write the repository of packages, in place of an earlier one; SystemExit when there are none."""
    if not packages:
        sys.exit("no packages: make deb")
    shutil.rmtree(folder, ignore_errors=True)
    pool = folder / "pool"
    pool.mkdir(parents=True)
    for package in packages:
        shutil.copyfile(package, pool / package.name)
    for distribution in DISTRIBUTIONS.values():
        own = [path for path in sorted(pool.glob("*.deb")) if f"~{distribution.name}u" in path.name]
        if own:
            _write_suite(folder, distribution, own, key)
    (folder / KEYRING).write_bytes(_gpg("--export", key))


def _write_suite(folder: Path, distribution: Distribution, packages: list[Path], key: str) -> None:
    suite = folder / "dists" / distribution.suite
    for architecture in ARCHITECTURES:
        index = suite / "main" / f"binary-{architecture}" / "Packages"
        index.parent.mkdir(parents=True)
        fitting = [path for path in packages if path.stem.endswith(f"_{architecture}")]
        text = "".join(_entry(path, folder) for path in fitting).encode()
        index.write_bytes(text)
        index.with_suffix(".gz").write_bytes(gzip.compress(text, 9, mtime=0))
    release = suite / "Release"
    release.write_text(_release(suite, distribution), "utf-8")
    sign = ("--local-user", key, "--digest-algo", "SHA256", "--yes", "--output")
    _gpg(*sign, str(suite / "InRelease"), "--clearsign", str(release))
    _gpg(*sign, str(suite / "Release.gpg"), "--armor", "--detach-sign", str(release))


def _entry(package: Path, folder: Path) -> str:
    """Return what an index says about a package."""
    command = ["dpkg-deb", "--field", str(package)]
    fields = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    content = package.read_bytes()
    where = f"Filename: {package.relative_to(folder)}\nSize: {len(content)}\n"
    return f"{fields}{where}SHA256: {hashlib.sha256(content).hexdigest()}\n\n"


def _release(suite: Path, distribution: Distribution) -> str:
    rows = [
        f" {hashlib.sha256(path.read_bytes()).hexdigest()} {path.stat().st_size} {path.relative_to(suite)}\n"
        for path in sorted(suite.rglob("Packages*"))
    ]
    date = format_datetime(datetime.fromtimestamp(commit_time(), UTC))
    head = (
        "Origin: Starter Gateway\nLabel: Starter Gateway\n"
        f"Suite: {distribution.suite}\nCodename: {distribution.suite}\nDate: {date}\n"
        f"Architectures: {' '.join(ARCHITECTURES)}\nComponents: main\nSHA256:\n"
    )
    return head + "".join(rows)


def _gpg(*arguments: str) -> bytes:
    return subprocess.run(["gpg", "--batch", *arguments], check=True, stdout=subprocess.PIPE).stdout


if __name__ == "__main__":
    sys.exit(main())
