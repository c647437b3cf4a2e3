"""The gateway with loops that can be blocked: `python -m tests.lab.torture.blockable run CONFIG`.

On SIGUSR1 it does what `TORTURE_BLOCK` (a file) says: `{"what": "lines", "seconds": 3.0}`. What is blocked is
the loop of the lines, the one of the application, or the whole interpreter (`everything`: its lock is held).
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import time
from pathlib import Path

from gateway.cli.main import main
from gateway.line.thread import LineHost

BLOCK_FILE = "TORTURE_BLOCK"
LOOPS = ("lines", "app", "everything")


def block_on_signal() -> None:
    """Make SIGUSR1 block what the file names."""
    hosts: list[LineHost] = []
    start = LineHost.start

    async def remember(host: LineHost) -> None:
        hosts.append(host)
        await start(host)

    LineHost.start = remember  # type: ignore[method-assign,assignment] # the only way to its loop from here

    def block(*_: object) -> None:
        order = json.loads(Path(os.environ[BLOCK_FILE]).read_text("utf-8"))
        seconds = order["seconds"]
        match order["what"]:
            case "lines":
                hosts[-1].to_line(time.sleep, seconds)
            case "app":  # a handler runs on the main thread, whose loop then waits for it
                time.sleep(seconds)
            case _:  # Python's lock in hand, as an extension that hangs has it
                ctypes.PyDLL(None).usleep(int(seconds * 1e6))

    signal.signal(signal.SIGUSR1, block)


if __name__ == "__main__":
    block_on_signal()
    sys.exit(main())
