"""The page's answers, by path; `application` has judged the request before."""

from __future__ import annotations

import asyncio
import csv
import gzip
import io
import json
import re
import secrets
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, Router

from gateway.contract import MAX_PAYLOAD_BYTES, read_object, rfc3339
from gateway.plugins.web.accounts import Accounts
from gateway.plugins.web.interface import GatewayAccess, ToolBusyError, dumps
from gateway.plugins.web.plots import HOUR_STEP_S, SPARK_SLOTS, SPARK_STEP_S, numbers, thinned
from gateway.plugins.web.requests import Caller, scrape_refusal, takes_gzip
from gateway.plugins.web.sessions import WebSession
from gateway.plugins.web.site_model import SiteModel
from gateway.plugins.web.static_files import INDEX, StaticFile
from gateway.plugins.web.streams import EventStream, Stream, Streams, unhurried
from gateway.system.clock import Clock

BUSY_RETRY_S = 5
ANSWER_WITHIN_S = 10.0  # a command's request: then the phases so far
METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
GZIP_LEVEL = 1  # a tenth of the size; more costs more than it saves
_VERB = re.compile(r"[a-z_]{1,32}", re.ASCII)


class WebError(HTTPException):
    """An answer that says what is wrong."""

    def __init__(self, status: int, code: str, text: str, *, retry_s: int | None = None) -> None:
        headers = None if retry_s is None else {"Retry-After": str(retry_s)}
        super().__init__(status, json.dumps({"error": code, "text": text}), headers)


@dataclass(eq=False)
class Routes:
    """What the page answers on which path; all state is what it is given."""

    model: SiteModel
    access: GatewayAccess
    accounts: Accounts
    streams: Streams
    files: Mapping[str, StaticFile]
    clock: Clock

    def __post_init__(self) -> None:
        self._one_at_a_time = asyncio.Lock()  # what takes long for many starters
        self.router = Router(self._routes(), redirect_slashes=False)

    def _routes(self) -> list[Route]:
        api = "/api/v1"
        gets: dict[str, Callable[[Request], Awaitable[Response | EventStream]]] = {
            "/": self._index,
            "/static/{name:path}": self._static,
            "/health": self._health,
            "/metrics": self._metrics,
            f"{api}/session": self._session,
            f"{api}/state": self._state,
            f"{api}/events": self._events,
            f"{api}/starter/{{name}}": self._starter,
            f"{api}/starter/{{name}}/history": self._history,
            f"{api}/starter/{{name}}/parameters": self._parameters,
            f"{api}/gateway": self._gateway,
            f"{api}/sparks": self._sparks,
            f"{api}/events.csv": self._csv,
            f"{api}/diagnostics.json": self._diagnostics,
        }
        posts: dict[str, Callable[[Request], Awaitable[Response]]] = {
            f"{api}/login": self._login,
            f"{api}/logout": self._logout,
            f"{api}/command/{{starter}}/{{verb}}": self._command,
            f"{api}/check": self._tool,
            f"{api}/doctor": self._tool,
        }
        routes = [Route(path, answer, methods=["GET"]) for path, answer in gets.items()]
        return routes + [Route(path, answer, methods=["POST"]) for path, answer in posts.items()]

    # What is seen

    async def _index(self, request: Request) -> Response:
        return self._file(request, INDEX)

    async def _static(self, request: Request) -> Response:
        return self._file(request, request.path_params["name"])

    def _file(self, request: Request, name: str) -> Response:
        file = self.files.get(name)
        if file is None:
            raise WebError(404, "not_found", "there is no such file")
        headers = {"etag": file.etag, "cache-control": "no-cache", "vary": "Accept-Encoding"}
        if file.etag in [each.strip() for each in _header(request, "if-none-match").split(",")]:
            return Response(status_code=304, headers=headers)
        content = file.content
        if file.compressed is not None and takes_gzip(_header(request, "accept-encoding")):
            content = file.compressed
            headers["content-encoding"] = "gzip"
        return Response(content, media_type=file.media_type, headers=headers)

    async def _health(self, _: Request) -> Response:
        status = self.model.payload("gateway/status") or {"state": "unknown"}
        health = await self.access.health()
        is_well = status["state"] in ("online", "degraded") and all(health["lines"].values())
        return _json({"state": status["state"], **health}, status=200 if is_well else 503)

    async def _metrics(self, request: Request) -> Response:
        metrics = self.access.metrics()
        if metrics is None:
            raise WebError(404, "no_metrics", "there is no [metrics] in the configuration, or it has failed")
        reason = scrape_refusal(_headers(request), _caller(request), metrics.token)
        if reason:
            raise WebError(403 if metrics.token is None else 401, "scrape", reason)
        text, headers = await metrics.text(), {"cache-control": "no-store", "vary": "Accept-Encoding"}
        if takes_gzip(_header(request, "accept-encoding")):
            text = await asyncio.to_thread(gzip.compress, text, GZIP_LEVEL)
            headers["content-encoding"] = "gzip"
        return Response(text, media_type=METRICS_TYPE, headers=headers)

    async def _state(self, request: Request) -> Response:
        stream = self._new_stream(request)
        etag = f'"{self.model.gen}"'
        if _header(request, "if-none-match") == etag:
            return Response(status_code=304, headers={"etag": etag})
        content = bytearray()
        async with self._one_at_a_time:
            async for piece in unhurried(self.streams.snapshot(stream)):
                content += piece
        return _encoded(bytes(content), {"etag": etag})

    async def _events(self, request: Request) -> EventStream:
        stream = self._new_stream(request)
        why_not = self.streams.join(stream, most_of_owner=request.app.settings.pages_per_address)
        if why_not:
            raise WebError(503, "busy", why_not, retry_s=BUSY_RETRY_S)
        return EventStream(self.streams, stream)

    def _new_stream(self, request: Request) -> Stream:
        starter = request.query_params.get("starter")
        if starter is not None:
            self._require_starter(starter)
        session = self.accounts.session(_headers(request), _caller(request), is_use=False)
        return Stream(
            scope=starter,
            owner=session.key if session else _caller(request).address,
            session=dumps(self.accounts.as_data(session)),
            session_key=session.key if session else "",
            client=session.client if session else None,
        )

    async def _starter(self, request: Request) -> Response:
        name = self._named(request)
        session = self.accounts.session(_headers(request), _caller(request))
        about = {
            "name": name,
            "facts": self.model.facts(name),
            "actions": self.access.actions(name, session.client if session else None),
            "commands": self.model.commands(name),
        }
        topics = b",".join(
            dumps(topic) + b":" + (payload or b"null")
            for topic, payload in self.model.topics(name)
            if topic.startswith(f"starter/{name}/")
        )
        content = dumps(about)[:-1] + b',"topics":{' + topics + b"}}"
        return _encoded(content)

    async def _history(self, request: Request) -> Response:
        name = self._named(request)
        stored = await self.access.records(name) or {}
        lists = {
            kind: [dumps(each) for each in stored[kind]] if kind in stored else self.model.records(name, one)
            for kind, one in (("starts", "start"), ("trips", "trip"))
        }
        content = b'{"plots":' + dumps(self._plots(name))
        for kind, items in lists.items():
            content += b',"' + kind.encode("ascii") + b'":[' + b",".join(items) + b"]"
        return _encoded(content + b"}")

    def _plots(self, name: str) -> dict[str, Any]:
        plots, now_s = self.model.plots(name), self.clock.now_s()
        point = self.model.voltage_point(name)
        units = {
            each: (self.model.payload(f"starter/{name}/value/{each}") or {}).get("unit", "")
            for each in ("current", point)
            if each
        }
        return {
            "end": rfc3339(self.clock.utc_s()),
            "step_s": HOUR_STEP_S,
            "current": numbers(plots.current.values(now_s)) if plots else [],
            "voltage": numbers(plots.voltage.values(now_s)) if plots else [],
            "current_unit": units.get("current", ""),
            "voltage_unit": units.get(point, ""),
            "voltage_point": point,
        }

    async def _parameters(self, request: Request) -> Response:
        return _json({"rows": await self.access.parameters(self._named(request))})

    async def _gateway(self, _: Request) -> Response:
        return _json({**self.access.about(), "streams": len(self.streams)})

    async def _sparks(self, request: Request) -> Response:
        asked = request.query_params.get("points", "60")
        points = int(asked) if asked.isascii() and asked.isdigit() and len(asked) < 4 else 60
        points = min(max(points, 1), SPARK_SLOTS)
        now_s, sparks = self.clock.now_s(), {}
        async with self._one_at_a_time:
            for name in tuple(self.model.site.starters):
                plots = self.model.plots(name)
                if plots is not None:
                    sparks[name] = numbers(thinned(plots.spark.values(now_s), points))
                    await asyncio.sleep(0)
        step_s = SPARK_STEP_S * -(-SPARK_SLOTS // points)
        return _json({"end": rfc3339(self.clock.utc_s()), "step_s": step_s, "starters": sparks})

    async def _csv(self, _: Request) -> Response:
        text = io.StringIO()
        writer = csv.writer(text)
        writer.writerow(["time", "topic", "severity", "code", "text", "client", "verb", "decision", "id"])
        for message in self.model.messages(None) or ():
            fields = json.loads(message.payload)
            columns = ("severity", "code", "text", "client", "verb", "decision", "id")
            writer.writerow(
                [_cell(each) for each in (fields.get("time"), message.place.name, *map(fields.get, columns))]
            )
        headers = {"content-disposition": 'attachment; filename="events.csv"', "cache-control": "no-store"}
        return Response(text.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)

    # Who is logged in

    async def _session(self, request: Request) -> Response:
        session = self.accounts.session(_headers(request), _caller(request))
        return _json(self.accounts.as_data(session))

    async def _login(self, request: Request) -> Response:
        fields = _object(await self._body(request))
        caller = _caller(request)
        outcome = await self.accounts.log_in(fields.get("user"), fields.get("password"), caller)
        if outcome.wait_s:
            text = f"too many wrong passwords; wait {outcome.wait_s} s"
            raise WebError(429, "too_many_logins", text, retry_s=outcome.wait_s)
        if outcome.session is None:
            raise WebError(401, "wrong_login", "the user or the password is wrong")
        answer = _json(self.accounts.as_data(outcome.session))
        answer.headers["set-cookie"] = self.accounts.cookie(caller, outcome.secret)
        return answer

    async def _logout(self, request: Request) -> Response:
        session = self._own_session(request)
        self.accounts.log_out(session, _caller(request))
        self.streams.end(session.key)
        answer = _json(self.accounts.as_data(None))
        answer.headers["set-cookie"] = self.accounts.cookie(_caller(request), "")
        return answer

    # What is done

    async def _command(self, request: Request) -> Response:
        session = self._own_session(request)
        starter, verb = request.path_params["starter"], request.path_params["verb"]
        if not self.model.is_target(starter) or _VERB.fullmatch(verb) is None:
            raise WebError(404, "not_found", "there is no such starter or group, or no such verb")
        body = await self._body(request)
        results = self.access.submit(starter, verb, body, client=session.client, user=session.user)
        phases: list[bytes] = []
        is_final = False
        with suppress(TimeoutError):
            async with asyncio.timeout(ANSWER_WITHIN_S):
                async for result in results:
                    phases += [result.payload()]  # those so far, when the time is over
                is_final = True
        return _encoded(b'{"final":' + dumps(is_final) + b',"phases":[' + b",".join(phases) + b"]}")

    async def _tool(self, request: Request) -> Response:
        self._own_session(request)
        await self._body(request)
        try:
            return _json(await self.access.run_tool(request.url.path.rpartition("/")[2]))
        except ToolBusyError:
            raise WebError(503, "busy", "one runs already; wait for it", retry_s=BUSY_RETRY_S) from None

    async def _diagnostics(self, request: Request) -> Response:
        if self.accounts.session(_headers(request), _caller(request)) is None:
            raise WebError(401, "login", "log in first")
        gateway = await asyncio.to_thread(self.access.diagnostics)
        topics = b",".join(
            dumps(name) + b":" + (payload or b"null") for name, payload in self.model.topics(None)
        )
        content = dumps(gateway)[:-1] + b',"topics":{' + topics + b"}}"
        return _encoded(content, {"content-disposition": 'attachment; filename="diagnostics.json"'})

    def _own_session(self, request: Request) -> WebSession:
        """Return the login of a request that does something; WebError without one, or from another page."""
        session = self.accounts.session(_headers(request), _caller(request))
        if session is None:
            raise WebError(401, "login", "log in first")
        if not secrets.compare_digest(
            session.csrf.encode(), _header(request, "x-csrf-token").encode("latin-1", "replace")
        ):
            raise WebError(403, "csrf", "X-CSRF-Token is not this session's; load the page again")
        return session

    def _named(self, request: Request) -> str:
        name = str(request.path_params["name"])
        self._require_starter(name)
        return name

    def _require_starter(self, name: str) -> None:
        if name not in self.model.site.starters:
            raise WebError(404, "not_found", "there is no such starter")

    async def _body(self, request: Request) -> bytes:
        body = bytearray()
        async for chunk in request.stream():
            body += chunk
            if len(body) > MAX_PAYLOAD_BYTES:
                raise WebError(413, "too_big", f"at most {MAX_PAYLOAD_BYTES} bytes")
        return bytes(body)


def _json(value: object, *, status: int = 200) -> Response:
    return _encoded(dumps(value), status=status)


def _encoded(content: bytes, headers: Mapping[str, str] | None = None, *, status: int = 200) -> Response:
    """Return JSON as an answer that nothing between us and the browser stores."""
    headers = {"cache-control": "no-store", **(headers or {})}
    return Response(content, status, media_type="application/json", headers=headers)


def _object(body: bytes) -> dict[str, Any]:
    try:
        return read_object(body)
    except ValueError as error:
        raise WebError(400, "bad_json", f"the body is no JSON object: {error}") from error


def _caller(request: Request) -> Caller:
    caller: Caller = request.scope["caller"]
    return caller


def _headers(request: Request) -> Mapping[str, str]:
    headers: Mapping[str, str] = request.scope["known_headers"]
    return headers


def _header(request: Request, name: str) -> str:
    return _headers(request).get(name, "")


def _cell(value: object) -> str:
    """Return a cell that no spreadsheet takes for a formula."""
    text = "" if value is None else str(value)
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text
