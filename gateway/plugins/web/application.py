"""The page as an ASGI application: it judges each request, then has it answered."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.plugins.web.interface import WebSettings
from gateway.plugins.web.requests import (
    MAX_HEADER_BYTES,
    Caller,
    caller_of,
    cross_site,
    headers_of,
    is_json,
    is_own_host,
    security_headers,
)
from gateway.plugins.web.routes import WebError

log = logging.getLogger(__name__)


class WebApp:
    """The application; `router` answers what may be answered."""

    def __init__(self, settings: WebSettings, router: ASGIApp) -> None:
        self.settings = settings
        self._router = router

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; whatever fails in it is logged and answered 500."""
        headers = headers_of(scope["headers"])
        peer = (scope.get("client") or ("", 0))[0]
        caller = caller_of(self.settings, headers, peer=peer, scheme=scope["scheme"])
        scope["caller"], scope["known_headers"] = caller, headers
        scope["app"] = self  # then Starlette raises what it refuses, instead of answering in plain text
        outgoing = _Outgoing(send, caller)
        try:
            await self._judged(scope, headers, caller)(scope, receive, outgoing)
        except HTTPException as refusal:
            await _answer_of(refusal)(scope, receive, outgoing)
        except ClientDisconnect:
            return  # there is no client left to answer
        except Exception:  # the guard at the request's top
            log.exception("a request to the page failed by a bug")
            if outgoing.is_started:
                raise
            failed = WebError(500, "internal", "an error inside the gateway; see its log")
            await _answer_of(failed)(scope, receive, outgoing)

    def _judged(self, scope: Scope, headers: Mapping[str, str], caller: Caller) -> ASGIApp:
        """Return what answers a request; WebError for one that must not be answered."""
        size = sum(len(name) + len(value) + 4 for name, value in scope["headers"])
        if size + len(scope["raw_path"]) + len(scope["query_string"]) > MAX_HEADER_BYTES:
            raise WebError(431, "too_big", f"the head of the request has more than {MAX_HEADER_BYTES} bytes")
        if "transfer-encoding" in headers and "content-length" in headers:
            text = "Transfer-Encoding and Content-Length: a proxy may see another request in it"
            refusal = WebError(400, "two_lengths", text)
            refusal.headers = {"Connection": "close"}
            raise refusal
        local = (scope.get("server") or ("", 0))[0]
        if not is_own_host(self.settings, caller.host, local=local):
            text = "the page is not called by this name; add it to hosts in [web]"
            raise WebError(421, "host", text)
        base = self.settings.base_path.rstrip("/")
        path = scope["path"]
        if base and (path == base or path.startswith(f"{base}/")):
            path = path[len(base) :] or "/"
            if scope["path"] == base:
                return Response(status_code=308, headers={"location": f"{base}/"})
        scope["path"], scope["root_path"] = path, ""
        if b"%2f" in scope["raw_path"].lower():
            raise WebError(404, "not_found", "no path of this page has an encoded slash")
        if scope["method"] == "POST":
            reason = cross_site(headers, caller)
            if reason:
                raise WebError(403, "cross_site", reason)
            if not is_json(headers):
                raise WebError(415, "no_json", "send Content-Type: application/json")
        elif scope["method"] not in ("GET", "HEAD"):
            raise WebError(405, "method", "GET, HEAD and POST are known")
        return self._router


class _Outgoing:
    """Adds what every answer says."""

    def __init__(self, send: Send, caller: Caller) -> None:
        self._send = send
        self._caller = caller
        self.is_started = False

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.is_started = True
            message["headers"] = [*message.get("headers", ()), *security_headers(self._caller)]
        await self._send(message)


def _answer_of(refusal: HTTPException) -> Response:
    detail = refusal.detail
    if not detail.startswith("{"):  # Starlette's own: no such path, or not by this method
        detail = json.dumps(
            {"error": "not_found" if refusal.status_code == 404 else "method", "text": detail}
        )
    headers = {**(refusal.headers or {}), "cache-control": "no-store"}
    return Response(detail, refusal.status_code, headers=headers, media_type="application/json")
