"""What must be true of a state that is older than what has happened since.

1. A command that was carried out since is not in the ledger. A copy of it does not act: neither its `token`
   nor its `issued_at` proves it fresh to another run (docs/upgrade.md).
2. A maintenance lock that was set since is not known: each starter that may be locked is locked.
3. Starts are as old as they were in the backup, and age by this machine's clocks from now on.
4. Sparkplug's number of births must not be one that its hosts have just seen: it goes on half way round.
5. The audit says that it was restored.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from gateway.config import Config, rights_of
from gateway.errors import DamagedError
from gateway.plugins.sparkplug.numbers import BIRTHS, NUMBER
from gateway.plugins.sparkplug.settings import SEQ_NUMBERS
from gateway.starters import lock_restored
from gateway.store import STATE_FILE, append_note, read_document, write_document
from gateway.system.clock import ClockReading


def lock_all(state_dir: Path, config: Config, reading: ClockReading, what: str) -> list[str]:
    """Lock every starter that can be in the state of a backup; return those locked by it. StoreError."""
    text = f"{what}: locks and starts since then are not known; look, then unlock"
    return lock_restored(
        state_dir / STATE_FILE,
        [starter.name for starter in config.starters],
        is_lockable=rights_of(config).is_lockable,
        reading=reading,
        reason=text,
    )


def note_past(state_dir: Path, what: str) -> None:
    """Count births from elsewhere, and say in the audit that this state is an earlier one."""
    path = state_dir / STATE_FILE
    with suppress(DamagedError):
        before = read_document(path, BIRTHS, NUMBER)
        if before is not None:
            write_document(path, BIRTHS, NUMBER, (before + SEQ_NUMBERS // 2) % SEQ_NUMBERS)
    append_note(path, "state_restored", what)


def give_to_owner_of(folder: Path, paths: Iterable[Path]) -> None:
    """As root, give files to the owner of a folder: the gateway's user must read and write them."""
    if os.geteuid() == 0:
        owner = folder.stat()
        for path in paths:
            os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)


def give_to(path: Path, user: str, group: str) -> None:
    """As root, give a file to a user and a group by name, where this machine has them."""
    if os.geteuid() == 0:
        for names in ({"user": user}, {"group": group}):
            with suppress(LookupError):
                shutil.chown(path, **names)
