"""The page as an ASGI application: it judges each request by the rules of `requests`, then answers it."""

from __future__ import annotations

import asyncio
import csv
import gzip
import io
import logging
import re
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.contract import (
    MAX_PAYLOAD_BYTES,
    Record,
    encoded,
    read_object,
    rfc3339,
    stored,
)
from gateway.errors import StoreError
from gateway.plugins.interface import Gateway
from gateway.plugins.web import diagnosis
from gateway.plugins.web.accounts import Accounts, WebSession
from gateway.plugins.web.control import Control
from gateway.plugins.web.requests import (
    Caller,
    WebError,
    busy,
    caller_of,
    is_own_host,
    path_in,
    require_own_post,
    require_scrape,
    require_whole_head,
    security_headers,
    takes_gzip,
)
from gateway.plugins.web.site_model import SiteModel
from gateway.plugins.web.static_files import INDEX, StaticFile
from gateway.plugins.web.streams import Stream, Streams, topic_pair, unhurried
from gateway.store import CURVES, with_curves

log = logging.getLogger(__name__)

API = "/api/v1"
LOGIN = f"{API}/login"
NAME = "([^/]+)"
BUSY_RETRY_S = 5
ANSWER_WITHIN_S = 12.0  # a command's request: then the phases so far; a stop ends after 10 s
METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
GZIP_LEVEL = 1  # a tenth of the size; more costs more than it saves
MOST_STARTS = 50  # in an answer; of older ones those with samples
MOST_TRIPS = 20
SPARK_STEPS = 60
SPANS = {"10min": (600.0, 300), "8h": (28_800.0, 480), "7d": (604_800.0, 672)}  # seconds, and steps in them
_VERB = re.compile(r"[a-z_]{1,32}", re.ASCII)
_COLUMNS = ("severity", "code", "text", "client", "verb", "decision", "id")

Answer = Callable[..., Awaitable[ASGIApp]]
Answers = Mapping[str, Answer]  # by path, whose groups are arguments


class WebApp:
    """What the page answers on which path; all state is in what it is given."""

    def __init__(
        self,
        gateway: Gateway,
        model: SiteModel,
        control: Control,
        accounts: Accounts,
        streams: Streams,
        files: Mapping[str, StaticFile],
    ) -> None:
        self._gateway = gateway
        self._model = model
        self._control = control
        self._accounts = accounts
        self._streams = streams
        self._files = files
        self._one_at_a_time = asyncio.Lock()  # what takes long for many starters
        self._tool_runs = asyncio.Lock()
        self._gets: Answers = {
            "/": partial(self._file, name=INDEX),
            "/static/(.+)": self._file,
            "/health": self._health,
            "/metrics": self._metrics,
            f"{API}/state": self._state,
            f"{API}/events": self._events,
            f"{API}/starter/{NAME}": self._starter,
            f"{API}/starter/{NAME}/history": self._history,
            f"{API}/starter/{NAME}/values": self._values,
            f"{API}/starter/{NAME}/parameters": self._parameters,
            f"{API}/sparks": self._sparks,
            rf"{API}/events\.csv": self._csv,
            rf"{API}/diagnostics\.json": self._diagnostics,
        }
        self._posts: Answers = {
            LOGIN: self._login,
            f"{API}/logout": self._logout,
            f"{API}/command/{NAME}/{NAME}": self._command,
            f"{API}/acknowledge/{NAME}/{NAME}": self._acknowledge,
            f"{API}/check": partial(self._tool, name="check"),
            f"{API}/doctor": partial(self._tool, name="doctor"),
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; whatever fails in it is logged and answered 500."""
        peer = (scope.get("client") or ("", 0))[0]
        given = Headers(scope=scope)
        headers = {name: ",".join(given.getlist(name)) for name in given}
        caller = caller_of(self._model.settings, headers, peer=peer, scheme=scope["scheme"])
        scope["caller"] = caller
        is_begun = False

        async def outgoing(message: Message) -> None:
            nonlocal is_begun
            if message["type"] == "http.response.start":
                is_begun = True
                message["headers"] = [*message.get("headers", ()), *security_headers(caller)]
            await send(message)

        try:
            answer = await self._answer(Request(scope, receive), caller)
            await answer(scope, receive, outgoing)
        except WebError as refusal:
            await _refused(refusal)(scope, receive, outgoing)
        except ClientDisconnect:
            return  # there is no client left to answer
        except Exception:  # the guard at the request's top
            log.exception("a request to the page failed by a bug")
            if is_begun:
                raise
            failed = WebError(500, "internal", "an error inside the gateway; see its log")
            await _refused(failed)(scope, receive, outgoing)

    async def _answer(self, request: Request, caller: Caller) -> ASGIApp:
        """Return the answer to a request; WebError for one that must not be answered."""
        scope, settings = request.scope, self._model.settings
        size = sum(len(name) + len(value) + 4 for name, value in scope["headers"])
        require_whole_head(caller, size=size + len(scope["raw_path"]) + len(scope["query_string"]))
        if not is_own_host(settings, caller.host, local=(scope.get("server") or ("", 0))[0]):
            raise WebError(421, "host", "the page is not called by this name; add it to hosts in [web]")
        path = path_in(settings, scope["path"], raw=scope["raw_path"])
        if scope["method"] not in ("GET", "HEAD", "POST"):
            raise WebError(405, "method", "GET, HEAD and POST are known")
        if scope["method"] != "POST":
            answer, names = _found(path, self._gets, self._posts)
            return await answer(request, *names)
        answer, names = _found(path, self._posts, self._gets)
        body = await _body(request)  # first: while it comes a session may end
        session = self._accounts.session(caller, is_use=False)  # a forged POST must not prolong it
        csrf = session.csrf if session else ""
        require_own_post(caller, None if path == LOGIN else csrf)
        return await answer(request, body, self._accounts.session(caller), *names)

    # What is seen

    async def _file(self, request: Request, name: str) -> Response:
        file, caller = self._files.get(name), _caller(request)
        if file is None:
            raise WebError(404, "not_found", "there is no such file")
        headers = {"etag": file.etag, "cache-control": "no-cache", "vary": "Accept-Encoding"}
        if file.etag in [each.strip() for each in caller.header("if-none-match").split(",")]:
            return Response(status_code=304, headers=headers)
        content = file.content
        if takes_gzip(caller.header("accept-encoding")):
            content = file.compressed
            headers["content-encoding"] = "gzip"
        return Response(content, media_type=file.media_type, headers=headers)

    async def _health(self, _: Request) -> Response:
        is_well, about = await diagnosis.health(self._gateway)
        return _json(encoded(about), status=200 if is_well else 503)

    async def _metrics(self, request: Request) -> Response:
        metrics: Any = self._gateway.plugin("metrics")
        if metrics is None:
            raise WebError(404, "no_metrics", "there is no [metrics] in the configuration, or it has failed")
        require_scrape(_caller(request), metrics.token)
        text, headers = await metrics.text(), {"cache-control": "no-store", "vary": "Accept-Encoding"}
        if takes_gzip(_caller(request).header("accept-encoding")):
            text = await asyncio.to_thread(gzip.compress, text, GZIP_LEVEL)
            headers["content-encoding"] = "gzip"
        return Response(text, media_type=METRICS_TYPE, headers=headers)

    async def _state(self, request: Request) -> Response:
        stream = self._new_stream(request)
        content = bytearray()
        async with self._one_at_a_time:
            async for piece in unhurried(self._streams.snapshot(stream)):
                content += piece
        return _json(bytes(content))

    async def _events(self, request: Request) -> ASGIApp:
        stream = self._new_stream(request)
        why_not = self._streams.join(stream, most_of_owner=self._model.settings.pages_per_address)
        if why_not:
            raise busy(why_not, BUSY_RETRY_S)
        return lambda _, receive, send: self._streams.serve(stream, receive, send)

    def _new_stream(self, request: Request) -> Stream:
        starter = request.query_params.get("starter")
        if starter is not None:
            self._require_starter(starter)
        session = self._accounts.session(_caller(request), is_use=False)
        return Stream(starter, session.key if session else _caller(request).address, session)

    async def _starter(self, request: Request, name: str) -> Response:
        self._require_starter(name)
        session = self._accounts.session(_caller(request))
        about = {
            "name": name,
            "facts": self._model.facts(name),
            "actions": self._control.actions(name, session.user.client if session else None),
            "commands": self._model.commands(name),
        }
        topics = self._model.topics(name)
        return _json(_with_topics(about, [each for each in topics if each[0].startswith(f"starter/{name}/")]))

    async def _values(self, request: Request, name: str) -> Response:
        """Answer with one point over one of `SPANS`."""
        self._require_starter(name)
        asked, series = request.query_params, self._gateway.series
        points = series.points(name)
        point, span = (
            asked.get("point", points[0] if points else "current"),
            asked.get("span", next(iter(SPANS))),
        )
        if span not in SPANS or (points and point not in points):
            raise WebError(404, "not_found", "there is no such point, or no such span")
        span_s, steps = SPANS[span]
        async with self._one_at_a_time:
            found = await series.over(name, point, span_s=span_s, steps=steps)
        about = {
            "end": rfc3339(self._gateway.clock.utc_s()),
            "step_s": span_s / steps,
            "point": point,
            "points": points,
            "unit": self._model.unit(name, point),
            "is_stored": point in self._model.settings.config.traced,
        }
        return _json(encoded({**about, **found._asdict()}))

    async def _history(self, _: Request, name: str) -> Response:
        """Answer with starts, the last of them with their samples, trips, and when all of both were."""
        self._require_starter(name)
        try:
            rows = with_curves(await self._gateway.stored(name, (*CURVES, "start", "trip")))
        except StoreError as error:
            raise busy("the history cannot be read now", BUSY_RETRY_S) from error
        begun, trips = ([row.data for row in rows if row.kind == kind] for kind in ("start", "trip"))
        late = len(begun) - MOST_STARTS
        starts = [each for place, each in enumerate(begun) if place >= late or "samples" in each]
        times = {
            "started": [each.get("time") for each in begun],
            "tripped": [each.get("time") for each in trips],
        }
        return _json(encoded({"starts": starts, "trips": trips[-MOST_TRIPS:], **times}))

    async def _parameters(self, _: Request, name: str) -> Response:
        self._require_starter(name)
        return _json(encoded({"rows": await asyncio.to_thread(self._control.parameters, name)}))

    async def _sparks(self, _: Request) -> Response:
        sparks, span_s = {}, SPANS["10min"][0]
        async with self._one_at_a_time:
            for name in self._model.settings.starters:
                found = await self._gateway.series.over(name, "current", span_s=span_s, steps=SPARK_STEPS)
                if any(value is not None for value in found.most):
                    sparks[name] = found.most
                await asyncio.sleep(0)
        return _json(encoded({"starters": sparks}))

    async def _csv(self, _: Request) -> Response:
        text = io.StringIO()
        writer = csv.writer(text)
        writer.writerow(["time", "topic", *_COLUMNS])
        for record in self._model.messages(None) or ():
            said = stored(record)
            writer.writerow(map(_cell, (said.get("time"), record.topic, *map(said.get, _COLUMNS))))
        headers = {"content-disposition": 'attachment; filename="events.csv"', "cache-control": "no-store"}
        return Response(text.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)

    async def _diagnostics(self, request: Request) -> Response:
        if self._accounts.session(_caller(request)) is None:
            raise WebError(401, "login", "log in first")
        about = await asyncio.to_thread(diagnosis.diagnostics, self._model.settings, self._gateway)
        headers = {"content-disposition": 'attachment; filename="diagnostics.json"'}
        return _json(_with_topics(about, self._model.topics(None)), headers)

    # What is done

    async def _login(self, request: Request, body: bytes, _: WebSession | None) -> Response:
        try:
            fields = read_object(body)
        except ValueError as error:
            raise WebError(400, "bad_json", f"the body is no JSON object: {error}") from error
        caller = _caller(request)
        secret, session = await self._accounts.log_in(fields.get("user"), fields.get("password"), caller)
        headers = {"set-cookie": self._accounts.cookie(caller, secret)}
        return _json(encoded(self._accounts.as_data(session)), headers)

    async def _logout(self, request: Request, _: bytes, session: WebSession) -> Response:
        caller = _caller(request)
        self._accounts.log_out(session, caller)
        self._streams.end(session)
        headers = {"set-cookie": self._accounts.cookie(caller, "")}
        return _json(encoded(self._accounts.as_data(None)), headers)

    async def _command(
        self, _: Request, body: bytes, session: WebSession, starter: str, verb: str
    ) -> Response:
        if not self._model.is_target(starter) or _VERB.fullmatch(verb) is None:
            raise WebError(404, "not_found", "there is no such starter or group, or no such verb")
        results = self._control.submit(starter, verb, body, session)
        phases: list[bytes] = []
        is_final = False
        with suppress(TimeoutError):
            async with asyncio.timeout(ANSWER_WITHIN_S):
                async for result in results:
                    phases += [result.payload()]  # those so far, when the time is over
                is_final = True
        return _json(b'{"final":' + encoded(is_final) + b',"phases":[' + b",".join(phases) + b"]}")

    async def _acknowledge(
        self, _: Request, _body: bytes, session: WebSession, starter: str, alarm: str
    ) -> Response:
        self._require_starter(starter)
        known = self._model.acknowledged
        if alarm not in known.of(starter):  # else the first person stays
            if not known.add(starter, alarm, session.user):
                raise WebError(409, "not_active", "this alarm is not active")
            self._accounts.audit("acknowledge", "ok", session.user, {"alarm": alarm}, starter=starter)
        return _json(encoded(known.of(starter)))

    async def _tool(self, _: Request, _body: bytes, session: WebSession, *, name: str) -> Response:
        if self._tool_runs.locked():
            raise busy("one runs already; wait for it", BUSY_RETRY_S)
        who = ("--client", session.user.client) if name == "doctor" else ()
        async with self._tool_runs:
            done = await asyncio.to_thread(diagnosis.run_tool, name, self._model.settings.path, who)
        return _json(encoded(done))

    def _require_starter(self, name: str) -> None:
        if name not in self._model.settings.starters:
            raise WebError(404, "not_found", "there is no such starter")


def _found(path: str, answers: Answers, others: Answers) -> tuple[Answer, tuple[str, ...]]:
    """Return what answers on a path, with the names in it; WebError where nothing does, or to others only."""
    for pattern, answer in answers.items():
        found = re.fullmatch(pattern, path)
        if found is not None:
            return answer, found.groups()
    if any(re.fullmatch(pattern, path) for pattern in others):
        raise WebError(405, "method", "this path is not for this method")
    raise WebError(404, "not_found", "there is nothing on this path")


async def _body(request: Request) -> bytes:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_PAYLOAD_BYTES:
            raise WebError(413, "too_big", f"at most {MAX_PAYLOAD_BYTES} bytes")
    return bytes(body)


def _json(content: bytes, headers: Mapping[str, str] | None = None, *, status: int = 200) -> Response:
    """Return JSON as an answer that nothing between the gateway and the browser stores."""
    headers = {"cache-control": "no-store", **(headers or {})}
    return Response(content, status, media_type="application/json", headers=headers)


def _refused(refusal: WebError) -> Response:
    return _json(refusal.body, refusal.headers, status=refusal.status)


def _with_topics(about: Mapping[str, Any], topics: Iterable[tuple[str, Record | None]]) -> bytes:
    pairs = b",".join(topic_pair(*each) for each in topics)
    return encoded(about)[:-1] + b',"topics":{' + pairs + b"}}"


def _caller(request: Request) -> Caller:
    caller: Caller = request.scope["caller"]
    return caller


def _cell(value: object) -> str:
    """Return a cell that no spreadsheet takes for a formula."""
    text = "" if value is None else str(value)
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text
