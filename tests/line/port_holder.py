"""Opens a port as an ordinary user, says so, and holds it until its standard input ends."""

from __future__ import annotations

import asyncio
import sys

from tests.line.opened import opener
from tests.ordinary_user import become_ordinary


async def hold(path: str) -> None:
    port = await opener(path)()
    sys.stdout.write("open\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)
    port.close()


if __name__ == "__main__":
    become_ordinary()
    asyncio.run(hold(sys.argv[1]))
