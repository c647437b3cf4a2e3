"""Writing behind: work with a bug takes no other with it, and the rows of a disk hold the rest."""

from __future__ import annotations

import asyncio
from functools import partial

from gateway.store.behind import Behind
from gateway.store.documents import put_body
from gateway.store.schema import STATE
from gateway.store.worker import Store
from tests.store.store_rig import PATIENCE_S

NAMES = "SELECT name FROM documents ORDER BY name"


async def test_one_document_with_a_bug_takes_no_other_with_it() -> None:
    store, lost = Store(None, STATE), asyncio.Event()
    behind = Behind(store, on_lost=lost.set)
    for number in range(9):
        work = partial(put_body, name=str(number), body="x")
        behind.put(number, work if number != 4 else lambda _: 1 / 0)
    store.start(lambda *_: None)
    await lost.wait()
    found = await asyncio.wrap_future(store.submit(lambda file: file.execute(NAMES).fetchall()))
    store.close(within_s=PATIENCE_S)

    assert "".join(name for (name,) in found) == "01235678"
