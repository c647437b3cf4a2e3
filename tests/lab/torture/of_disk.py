"""The disk is full or read-only, and what is stored there is damaged."""

from __future__ import annotations

import asyncio
import os
import random
import resource
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.lab.torture.scenario import CRASH, DISK, Scenario
from tests.lab.torture.world import World

DISK_BYTES = 64 * 2**20
USABLE_WITHIN_S = 15.0  # after the disk is
MOST_READS = 500  # commands that the files' own pages can hold: some 1 KiB each


@contextmanager
def small_disk(folder: Path) -> Iterator[None]:
    """Mount a small disk there; only root can."""
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def may_mount() -> bool:
    """Return whether this process may mount a disk."""
    return os.geteuid() == 0


async def full(w: World, seconds: int) -> None:
    """Not a byte is left, after what fits into pages that the files have already."""
    await w.start("pump")
    ballast = w.state_dir / "ballast"
    with ballast.open("wb", buffering=0) as file, suppress(OSError):
        for size in (65536, 512, 1):
            with suppress(OSError):
                while file.write(bytes(size)):
                    pass
    begun_s, reads = time.monotonic(), 0
    while not w.recorder.events_of("store_unavailable", begun_s) and reads < MOST_READS:
        await w.read("belt")
        reads += 1
    w.check(reads < MOST_READS, f"{reads} commands were stored on a full disk")
    await _without_a_disk(w, seconds)
    ballast.unlink()
    await _usable_again(w)


async def failing(w: World, seconds: int) -> None:
    """Every write to a file fails, though there is room: the kernel says EFBIG, SQLite an I/O error."""
    await w.start("pump")
    pid, unlimited = w.gateway.pid, (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    await _without_a_disk(w, seconds)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, unlimited)
    await _usable_again(w)
    w.check(w.gateway.pid == pid, "write errors ended the gateway")


async def read_only(w: World, seconds: int) -> None:
    """The gateway finds its disk read-only when it starts, as ext4 is after an error."""
    await w.start("pump")
    await _restarted(w, lambda: _remount(w.state_dir, "ro"))
    await w.starters.order("mark")
    await _without_a_disk(w, seconds)
    _remount(w.state_dir, "rw")
    await _usable_again(w)


async def damaged(w: World, count: int) -> None:
    """Kill the gateway, damage its files in some way, and let it start."""

    def damage_all() -> None:
        for path in sorted(w.state_dir.rglob("*")):
            if path.is_file():
                damage(path, w.dice)

    for _ in range(count):
        w.begin_start("fan")
        await _restarted(w, damage_all)
        await w.stop("fan")
        result = await w.read("belt")
        w.check(result["phase"] == "confirmed", f"a command was refused: {result}")
    w.recorder.results.clear()  # a ledger that was set back may publish an outcome once more


def damage(path: Path, dice: random.Random) -> None:
    """Do to a file what disks, programs and people do."""
    content = bytearray(path.read_bytes())
    match dice.randrange(6):
        case 0:
            content.clear()
        case 1:
            del content[dice.randrange(len(content) + 1) :]
        case 2:
            content[:100] = dice.randbytes(100)
        case 3 if content:
            at = dice.randrange(len(content))
            content[at : at + 4096] = dice.randbytes(4096)
        case 4:
            for _ in range(20):
                if content:
                    content[dice.randrange(len(content))] = dice.randrange(256)
        case _:
            path.unlink()
            return
    path.write_bytes(content)


async def _restarted(w: World, meanwhile: Callable[[], None]) -> None:
    """Kill the gateway and do something before its next life is right."""
    lives = len(w.gateway.lives)
    await w.killed()
    meanwhile()
    await w.gateway.until_up(lives=lives + 1, within_s=10.0)
    await w.right(since_s=w.gateway.lives[-1].began_s)


async def _without_a_disk(w: World, seconds: int) -> None:
    await asyncio.sleep(seconds)
    await w.stop("pump")
    result = await w.recorder.final(w.begin_start("mill"))
    w.check(result["phase"] == "rejected", f"a start without a ledger ended as {result}")
    w.row.measurements["start refused"] = result["code"]
    await w.right()
    await w.check_line_timing("the line waited for the disk")


async def _usable_again(w: World) -> None:
    """Check that commands are carried out again, without anybody's help."""
    begun_s, result = time.monotonic(), await w.read("belt")
    while result["phase"] != "confirmed" and time.monotonic() - begun_s < USABLE_WITHIN_S:
        await asyncio.sleep(0.5)
        result = await w.read("belt")
    w.check(result["phase"] == "confirmed", f"commands are still refused: {result}")
    w.row.measurements["usable again s"] = round(time.monotonic() - begun_s, 2)


def _remount(folder: Path, how: str) -> None:
    """Remount a disk; read-only is possible only while no process has a file open there."""
    subprocess.run(["mount", "-o", f"remount,{how}", folder], check=True)


SCENARIOS = (
    Scenario("write errors", CRASH, failing, 60, 3, "s"),
    Scenario("disk full", DISK, full, 60, 2, "s"),
    Scenario("disk read-only", DISK, read_only, 60, 2, "s"),
    Scenario("store damaged", DISK, damaged, 200, 2, "times"),
)
