"""A page without a gateway, served on a free port of loopback."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from gateway.plugins.web.server import Server
from tests.mosquitto import Certificate
from tests.web.support import PageRig, web_settings


@asynccontextmanager
async def served(
    rig: PageRig | None = None, certificate: Certificate | None = None
) -> AsyncIterator[tuple[PageRig, Server, int]]:
    """Serve it, with TLS where there is a certificate."""
    rig = rig or PageRig()
    files = {"cert_file": str(certificate.cert), "key_file": str(certificate.key)} if certificate else {}
    server = Server(rig.page, web_settings(port=0, **files))
    task = asyncio.create_task(server.run())
    await server.is_open.wait()
    assert server.address is not None
    try:
        yield rig, server, server.address[1]
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
