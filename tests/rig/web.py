"""The page without a socket: requests to its ASGI application, as a browser sends them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

HOST = "127.0.0.1:8480"
ORIGIN = f"http://{HOST}"


class NoSocket:
    """In place of the server: it has the application, and listens nowhere."""

    def __init__(self, on_open: Callable[[Any], None], app: Any, _settings: Any) -> None:
        self._on_open = on_open
        self._app = app
        self.is_open = asyncio.Event()

    async def run(self) -> None:
        self._on_open(self._app)
        self.is_open.set()
        await asyncio.Event().wait()

    async def renew(self) -> None: ...


@dataclass
class WebAnswer:
    """What came back."""

    status: int = 0
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""
    is_over: bool = False
    may_come: asyncio.Event = field(default_factory=asyncio.Event)  # clear it, and the browser reads no more
    may_go: asyncio.Event = field(default_factory=asyncio.Event)  # set: the request's body is sent
    _gone: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        self.may_come.set()
        self.may_go.set()

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def text(self) -> str:
        return self.body.decode()

    @property
    def events(self) -> list[tuple[str, Any]]:
        """Return what a stream has sent so far: the event's name and its data."""
        pieces = [piece.partition("\n") for piece in self.text.split("\n\n")[:-1] if piece[:6] == "event:"]
        return [(head[7:], json.loads(data[6:])) for head, _, data in pieces]

    def close(self) -> None:
        """Go away, as a browser that leaves the page."""
        self._gone.set()


class WebBrowser:
    """Cookies and the token against forgery, as the page's script keeps them. `ask` runs on the loop."""

    def __init__(self, app: Callable[[], Any], run: Callable[[Awaitable[None]], None]) -> None:
        self._app = app
        self._run = run
        self.peer, self.scheme = "127.0.0.1", "http"  # of the connection: another machine's, a TLS one
        self.cookie = self.csrf = ""

    def get(self, path: str, **headers: str) -> WebAnswer:
        return self._ask("GET", path, b"", headers)

    def post(self, path: str, body: object = None, **headers: str) -> WebAnswer:
        """Post JSON as the page does; headers are spelt with _ for -."""
        content = body if isinstance(body, bytes) else json.dumps(body or {}).encode()
        return self._ask("POST", path, content, {**self._of_post(), **headers})

    def begin_post(self, path: str, body: object = None) -> WebAnswer:
        """Send the head of a POST; its body goes once `may_go` of the answer is set."""
        answer = WebAnswer()
        answer.may_go.clear()
        self._begin(answer, "POST", path, json.dumps(body or {}).encode(), self._of_post())
        return answer

    def _of_post(self) -> dict[str, str]:
        usual = {"content_type": "application/json", "origin": ORIGIN, "sec_fetch_site": "same-origin"}
        return {**usual, **({"x_csrf_token": self.csrf} if self.csrf else {})}

    def log_in(self, user: str, password: str) -> WebAnswer:
        answer = self.post("/api/v1/login", {"user": user, "password": password})
        if answer.status == 200:
            self.csrf = answer.json["csrf"]
            self.cookie = answer.headers["set-cookie"].split(";")[0]
        return answer

    def stream(self, scope: str = "") -> WebAnswer:
        """Open the page's stream of events; what it says is in the answer as time passes."""
        answer = WebAnswer()
        self._begin(answer, "GET", f"/api/v1/events{scope}", b"", {})
        return answer

    def _ask(self, *request: Any) -> WebAnswer:
        answer = WebAnswer()
        self._run(self._exchange(answer, *request))
        return answer

    def _begin(self, answer: WebAnswer, *request: Any) -> None:
        async def begin() -> None:
            answer.task = asyncio.ensure_future(self._exchange(answer, *request))  # type: ignore[attr-defined]

        self._run(begin())

    async def _exchange(
        self, answer: WebAnswer, method: str, path: str, body: bytes, headers: Mapping[str, str]
    ) -> None:
        given = {"host": HOST, **({"cookie": self.cookie} if self.cookie else {}), **headers}
        if body:
            given["content_length"] = str(len(body))
        path, _, query = path.partition("?")
        scope = {
            "type": "http",
            "method": method,
            "path": path,
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "scheme": self.scheme,
            "headers": [(n.replace("_", "-").encode(), v.encode()) for n, v in given.items() if v],
            "client": (self.peer, 50000),
            "server": ("127.0.0.1", 8480),
            "http_version": "1.1",
        }
        bodies = [{"type": "http.request", "body": body, "more_body": False}]

        async def receive() -> Any:
            await answer.may_go.wait()
            if bodies:
                return bodies.pop()
            await answer._gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            await answer.may_come.wait()
            if message["type"] == "http.response.start":
                answer.status = message["status"]
                answer.headers = {name.decode(): value.decode() for name, value in message["headers"]}
            answer.body += message.get("body", b"")

        await self._app()(scope, receive, send)
        answer.is_over = True
