"""A page without a gateway, served on a free port of loopback."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from gateway.plugins.web.server import Server
from tests.mosquitto import Certificate, free_port
from tests.web.support import PageRig, web_settings


@asynccontextmanager
async def served(
    rig: PageRig | None = None, certificate: Certificate | None = None
) -> AsyncIterator[tuple[PageRig, Server, int]]:
    """Serve it, with TLS where there is a certificate."""
    rig = rig or PageRig()
    files = {"cert_file": str(certificate.cert), "key_file": str(certificate.key)} if certificate else {}
    port = free_port()
    server = Server(rig.page, web_settings(port=port, **files))
    task = asyncio.create_task(server.run())
    await server.is_open.wait()
    try:
        yield rig, server, port
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
