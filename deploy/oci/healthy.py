#!/opt/starter-gateway/bin/python
"""Ask the gateway of this container for its health: exit 0 when it polls and every line moves.

Without `[web]` in its configuration nothing answers; then the gateway counts as healthy while it runs.
"""

from __future__ import annotations

import ssl
import sys
import tomllib
from pathlib import Path
from urllib.request import urlopen

SITE = Path("/etc/starter-gateway/site.toml")
WITHIN_S = 8.0


def health_url(site: str) -> str | None:
    """Return where a configuration's gateway answers on this machine; None when it answers nowhere."""
    web = tomllib.loads(site).get("web")
    if web is None:
        return None
    host, _, port = web.get("listen", "127.0.0.1:8480").rpartition(":")
    if host.strip("[]") in ("0.0.0.0", "::", ""):  # of every address, loopback too
        host = "127.0.0.1"
    scheme = "https" if "cert_file" in web else "http"
    return f"{scheme}://{host}:{port}{web.get('base_path', '/')}health"


def main() -> int:
    """Return the exit code of the container's health check."""
    if not SITE.exists():  # as in a container of the demo
        return 0
    url = health_url(SITE.read_text("utf-8"))
    if url is None:
        return 0
    unchecked = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)  # its certificate has the plant's name
    unchecked.check_hostname, unchecked.verify_mode = False, ssl.CERT_NONE
    try:
        with urlopen(url, timeout=WITHIN_S, context=unchecked) as answer:
            print(answer.read().decode())
    except OSError as error:  # also for 503
        print(f"{url}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
