"""The folder of a kit: which one may be written to, and how a whole new kit takes the place of the old one.

A kit is made in a private folder inside its folder and moved over when it is complete: what is refused on the
way changes nothing, and a symbolic link in the folder is replaced, not followed.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.cli.broker_kit.password_file import FOLDER
from gateway.errors import UsageError

SETTINGS = "kit.json"  # what makes a folder a kit; moved over last
CENTRAL = "central"  # the part of the kit for the central broker
CENTRAL_CA = "central-ca.pem"

_FILES = ("passwords", "acl", CA_KEY, CA, KEY, CERT, "mosquitto.conf", CENTRAL_CA, "bridge.conf", SETTINGS)
_STAGE = ".new-"


def is_kit(folder: Path) -> bool:
    """Return whether a kit was written into this folder."""
    return (folder / SETTINGS).exists()


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """Yield a private folder for a whole kit; without an error it then takes the place of what `folder` has.

    UsageError for a folder with other things in it, of another user or in use; OSError by the disk.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _require_usable(folder)
    folder.chmod(0o700)
    with _locked(folder):
        for killed in folder.glob(f"{_STAGE}*"):  # it has keys and passwords
            shutil.rmtree(killed)
        stage = Path(tempfile.mkdtemp(prefix=_STAGE, dir=folder))
        try:
            yield stage
            _move_over(stage, folder)
        finally:
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Have the folder alone; UsageError while another process has it."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UsageError(f"{folder} is being written by another broker-kit (wait for its end)") from error
        yield
    finally:
        os.close(handle)


def _require_usable(folder: Path) -> None:
    if folder.stat().st_uid != os.geteuid():
        raise UsageError(
            f"{folder} belongs to another user, who could change the kit (choose another folder)"
        )
    others = [each.name for each in folder.iterdir() if not each.name.startswith(_STAGE)]
    if others and not is_kit(folder):
        raise UsageError(f"{folder} holds no kit, but {min(others)} (choose a new or an empty folder)")
    for name in (FOLDER, CENTRAL, f"{CENTRAL}/{FOLDER}"):
        if os.path.lexists(folder / name) and not stat.S_ISDIR((folder / name).lstat().st_mode):
            raise UsageError(f"{folder / name} is no folder (remove it)")


def _move_over(stage: Path, folder: Path) -> None:
    """Move every file of a kit; remove what the new kit does not have."""
    for part in (FOLDER, f"{CENTRAL}/{FOLDER}"):
        _move_all(stage / part, folder / part)
    if (stage / CENTRAL).is_dir():
        _move_all(stage / CENTRAL, folder / CENTRAL)
    else:
        shutil.rmtree(folder / CENTRAL, ignore_errors=True)
    for name in _FILES:
        if (stage / name).exists():
            (stage / name).replace(folder / name)
        else:
            (folder / name).unlink(missing_ok=True)


def _move_all(source: Path, target: Path) -> None:
    if not source.is_dir():
        return
    target.mkdir(mode=0o700, parents=True, exist_ok=True)
    target.chmod(0o700)
    files = [each for each in source.iterdir() if not each.is_dir()]
    for each in files:
        each.replace(target / each.name)
    for old in target.iterdir():
        if old.name not in {each.name for each in files} and not old.is_dir():
            old.unlink()
