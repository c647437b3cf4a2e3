"""What must be true of a state that is older than what has happened since.

1. A command that was carried out since is not in the ledger. A copy of it must not act: SQLite files of a
   backup count as lost when they are first used, so for as long as an old command could prove itself fresh
   none but stop is taken; `token` and `boot` are of one run anyway (docs/upgrade.md).
2. A maintenance lock that was set since is not known: each starter that may be locked is locked.
3. Starts are as old as they were in the backup, and age by this machine's clocks from now on.
4. Sparkplug's number of births must not be one that its hosts have just seen: it goes on half way round.
5. The audit says that it was restored.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from gateway.config.convert import rights_of
from gateway.config.schema import Config
from gateway.contract import MAX_TTL_S, LockRecord, rfc3339
from gateway.errors import DamagedError
from gateway.starters.policy.freshness import MAX_AHEAD_S
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE, MotorHistory
from gateway.starters.policy.policy import GATEWAY
from gateway.storage.audit.segments import FOLDER
from gateway.storage.audit.writer import MOST_SEGMENTS, SEGMENT_BYTES, AuditWriter
from gateway.storage.formats import STATE_FILES
from gateway.storage.json_file import JsonFile
from gateway.system.clock_steps import ClockReading

LEDGER = "gateway.sqlite"
BDSEQ = "bdseq.json"
BIRTHS = 256  # numbers of births, then 0 again [Sparkplug 3.0, bdSeq]
HELD = f"for {MAX_TTL_S + MAX_AHEAD_S:.0f} s after its first start the gateway takes no command but stop"


def lock_all(
    state_dir: Path, config: Config, reading: ClockReading, what: str, content: bytes | None
) -> list[str]:
    """Store starts and locks of the past, with every starter locked that can be; return those locked by it.

    `content` is the file's of then; it is never in place without the locks.
    """
    file = JsonFile(state_dir / PRECAUTIONS_FILE)
    try:
        document = None if content is None else file.understood(content)
    except DamagedError:
        document = None
    stored, locked = locked_document(document, config, reading, what)
    if stored:
        file.write(stored)
    return locked


def locked_document(
    document: Mapping[str, Any] | None, config: Config, reading: ClockReading, what: str
) -> tuple[dict[str, Any], list[str]]:
    """Return what is to be stored of starts and locks, and which starters are locked by it."""
    names = [starter.name for starter in config.starters]
    history, here = MotorHistory(names), reading
    if document is not None:
        at = document.get("at") or {}
        here = ClockReading(reading.up_s, float(at.get("utc_s", reading.utc_s)), reading.boot_id)
        moved = {**document, "at": {"up_s": here.up_s, "utc_s": here.utc_s, "boot_id": here.boot_id}}
        try:
            history.restore(moved, now_s=here.up_s, reading=here)
        except DamagedError:
            history = MotorHistory(names)
    rights = rights_of(config)
    locked = [name for name in names if rights.is_lockable(name) and history.lock_of(name) is None]
    for name in locked:
        text = f"{what}: locks and starts since then are not known; look, then unlock"
        history.set_lock(name, LockRecord(by=GATEWAY, since_s=reading.utc_s, reason=text))
    is_empty = document is None and not locked
    return {} if is_empty else history.to_document(now_s=here.up_s, reading=here), locked


def note_past(state_dir: Path, reading: ClockReading, what: str) -> None:
    """Let births be counted from elsewhere, and say in the audit that this state is one of before."""
    numbers = JsonFile(state_dir / STATE_FILES[BDSEQ].name)
    with suppress(DamagedError):
        before = (numbers.load() or {}).get("bdSeq")
        if isinstance(before, int):
            numbers.write({"bdSeq": (before + BIRTHS // 2) % BIRTHS})
    writer = AuditWriter(state_dir / FOLDER, SEGMENT_BYTES, MOST_SEGMENTS)

    def note(code: str, text: str) -> dict[str, Any]:
        return {"kind": "note", "boot": "", "time": rfc3339(reading.utc_s), "code": code, "text": text}

    try:
        writer.append([note("state_restored", what)], note=note)
    finally:
        writer.close()


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
