"""Opens a port as an ordinary user, says so, and holds it until its standard input ends."""

from __future__ import annotations

import asyncio
import sys

from gateway.errors import PortError
from tests.line.opened import opener
from tests.ordinary_user import become_ordinary


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


async def hold(path: str) -> None:
    try:
        port = await opener(path)()
    except PortError as error:
        say(str(error))
        return
    say("open")
    await asyncio.to_thread(sys.stdin.read)
    port.close()


if __name__ == "__main__":
    become_ordinary()
    asyncio.run(hold(sys.argv[1]))
