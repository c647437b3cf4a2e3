"""Whether a request may be answered at all: whom it calls and where it comes from; pure.

1. The name by which the page is called must be its own (DNS rebinding): an address of the connection,
   localhost, or a configured name.
2. What changes something is a POST that comes from the page itself (`require_own_post`): with the page's own
   `Origin`, from no browser that says otherwise (`Sec-Fetch-Site`), as JSON, and with the token of its
   session, which no other page can read. A login alone has no session yet.
3. The path is matched as the server has unquoted it, once; no path has an encoded slash.
4. Headers of a proxy count only from a configured one.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from gateway.contract import encoded
from gateway.plugins.web.plugin import WebSettings

Header = tuple[bytes, bytes]

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; manifest-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
MAX_HEADER_BYTES = 8192


class WebError(Exception):
    """An answer that says what is wrong."""

    def __init__(self, status: int, code: str, text: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(text)
        self.status = status
        self.headers = headers or {}
        self.body = encoded({"error": code, "text": text})


def busy(text: str, retry_s: int, *, status: int = 503, code: str = "busy") -> WebError:
    """Return the refusal of what may be tried again later."""
    return WebError(status, code, text, {"Retry-After": str(retry_s)})


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks, and by which name and scheme the browser sees the page."""

    address: str  # of the browser, as far as a trusted proxy says so
    host: str  # as in the Host header, perhaps with a port
    scheme: str  # http or https
    headers: Mapping[str, str] = field(default_factory=dict, compare=False)  # lower case; twice: by commas

    @property
    def is_tls(self) -> bool:
        """Return whether the browser speaks TLS, to the page or to its proxy."""
        return self.scheme == "https"

    def header(self, name: str) -> str:
        """Return a header; empty when it is not there."""
        return self.headers.get(name, "")


def caller_of(settings: WebSettings, headers: Mapping[str, str], *, peer: str, scheme: str) -> Caller:
    """Return who asks; what a proxy adds counts only when `peer` is a trusted one."""
    host = headers.get("host", "")
    if not is_trusted(settings.trusted_proxies, peer):
        return Caller(peer, host, scheme, headers)
    forwarded = [each.strip() for each in headers.get("x-forwarded-for", "").split(",") if each.strip()]
    strangers = [each for each in reversed(forwarded) if not is_trusted(settings.trusted_proxies, each)]
    address = strangers[0] if strangers and _is_address(strangers[0]) else peer
    proto = headers.get("x-forwarded-proto", scheme).strip().lower()
    scheme = proto if proto in ("http", "https") else scheme
    return Caller(address, headers.get("x-forwarded-host", host).strip(), scheme, headers)


def is_trusted(proxies: Sequence[str], peer: str) -> bool:
    """Return whether an address is one of these, or in one of these networks."""
    if not proxies or not _is_address(peer):
        return False
    address = ipaddress.ip_address(peer)
    return any(address in ipaddress.ip_network(each, strict=False) for each in proxies)


def is_own_host(settings: WebSettings, host: str, *, local: str) -> bool:
    """Return whether the page may be called so; `local` is the connection's address on this side."""
    name = _name_in(host)
    if name is None:
        return False
    names = {each.lower().rstrip(".") for each in settings.hosts}
    if _is_address(name):
        own = {_plain(local), _plain(settings.host)} if _is_address(local) else {_plain(settings.host)}
        return _plain(name) in own or name in names
    return name in ("localhost", *names)


def require_whole_head(caller: Caller, *, size: int) -> None:
    """Raise WebError for a head that is too long, or that a proxy may read in another way."""
    if size > MAX_HEADER_BYTES:
        raise WebError(431, "too_big", f"the head of the request has more than {MAX_HEADER_BYTES} bytes")
    if caller.header("transfer-encoding") and caller.header("content-length"):
        text = "Transfer-Encoding and Content-Length: a proxy may see another request in it"
        raise WebError(400, "two_lengths", text, {"Connection": "close"})


def path_in(settings: WebSettings, path: str, *, raw: bytes) -> str:
    """Return the path below the base path; `path` is `raw` unquoted."""
    if b"%2f" in raw.lower():
        raise WebError(404, "not_found", "no path of this page has an encoded slash")
    base = settings.base_path.rstrip("/")
    if path == base and base:
        raise WebError(308, "moved", f"the page is at {base}/", {"Location": f"{base}/"})
    return path.removeprefix(base) if path.startswith(f"{base}/") else path


def require_own_post(caller: Caller, csrf: str | None) -> None:
    """Raise WebError for a POST that does not come from the page itself.

    `csrf` is the token of the session that it carries; empty where it carries none, None for a login.
    """
    site = caller.headers.get("sec-fetch-site", "same-origin").strip().lower()
    if site != "same-origin":
        text = f"the browser says that it comes from {site[:20]}, not from this page"
        raise WebError(403, "cross_site", text)
    if caller.header("origin").strip().lower() != f"{caller.scheme}://{caller.host}".lower():
        text = "its Origin is not this page; behind a proxy, name it in trusted_proxies and hand Host on"
        raise WebError(403, "cross_site", text)
    # No form of another page can say that it is JSON.
    if caller.header("content-type").split(";")[0].strip().lower() != "application/json":
        raise WebError(415, "no_json", "send Content-Type: application/json")
    if csrf is None:
        return
    if not csrf:
        raise WebError(401, "login", "log in first")
    if not secrets.compare_digest(csrf.encode(), caller.header("x-csrf-token").encode("latin-1", "replace")):
        raise WebError(403, "csrf", "X-CSRF-Token is not this session's; load the page again")


def require_scrape(caller: Caller, token: str | None) -> None:
    """Raise WebError for a scrape that is not answered.

    With a token that alone counts, wherever the scrape comes from. Without one it must come from this machine
    or by TLS: what the page shows then crosses no network unencrypted.
    """
    if token is not None:
        scheme, _, given = caller.header("authorization").partition(" ")
        is_right = hmac.compare_digest(given.strip().encode("utf-8", "replace"), token.encode("utf-8"))
        if scheme.lower() != "bearer" or not is_right:
            raise WebError(401, "scrape", "send Authorization: Bearer TOKEN")
        return
    is_address = _is_address(caller.address)
    is_local = is_address and ipaddress.ip_address(_plain(caller.address)).is_loopback
    if not (caller.is_tls or is_local):
        text = "from other machines by TLS only, or with token_file in [metrics]"
        raise WebError(403, "scrape", text)


def takes_gzip(accepted: str) -> bool:
    """Return whether an Accept-Encoding names gzip, with another weight than 0 [RFC 9110 12.5.3]."""
    for each in accepted.lower().split(","):
        coding, _, weight = each.replace(" ", "").partition(";q=")
        if coding == "gzip":
            return not weight or bool(weight.strip("0."))
    return False


def cookie(caller: Caller) -> str:
    """Return the session cookie's value; empty when it is not there, or there twice."""
    name = cookie_name(caller)
    values = [
        value.strip()
        for each in caller.header("cookie").replace(",", ";").split(";")
        for key, sign, value in [each.partition("=")]
        if sign and key.strip() == name
    ]
    return values[0] if len(values) == 1 else ""


def cookie_name(caller: Caller) -> str:
    """Return the session cookie's name; with TLS one that no other site of the domain can set."""
    return "__Host-sid" if caller.is_tls else "sid"


def set_cookie(caller: Caller, secret: str, *, base_path: str) -> str:
    """Return the Set-Cookie header that begins a session, or with an empty secret ends it."""
    path, secure = ("/", "; Secure") if caller.is_tls else (base_path, "")
    ended = "" if secret else "; Max-Age=0"
    return f"{cookie_name(caller)}={secret}; Path={path}; HttpOnly; SameSite=Strict{secure}{ended}"


def security_headers(caller: Caller) -> list[Header]:
    """Return what every answer says, whatever it is."""
    headers = [
        (b"content-security-policy", CONTENT_SECURITY_POLICY.encode("ascii")),
        (b"x-content-type-options", b"nosniff"),
        (b"x-frame-options", b"DENY"),
        (b"referrer-policy", b"no-referrer"),
        (b"cross-origin-opener-policy", b"same-origin"),
        (b"cross-origin-resource-policy", b"same-origin"),
        (b"permissions-policy", b"camera=(), microphone=(), geolocation=()"),
    ]
    if caller.is_tls:
        headers.append((b"strict-transport-security", b"max-age=31536000"))
    return headers


def _name_in(host: str) -> str | None:
    """Return the name or address in a Host header, in lower case; None for one that is none."""
    if not host or "," in host or "@" in host or "/" in host:
        return None
    try:
        split = urlsplit(f"//{host}")
        _ = split.port
    except ValueError:
        return None
    return split.hostname.rstrip(".") if split.hostname else None


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _plain(address: str) -> str:
    """Return an address in its usual form; an IPv4 one that came through an IPv6 socket as IPv4."""
    plain = ipaddress.ip_address(address)
    mapped = plain.ipv4_mapped if isinstance(plain, ipaddress.IPv6Address) else None
    return str(mapped or plain)
