"""The gateway as its status page sees it: commands by the same way as MQTT's, and what is permitted now."""

from __future__ import annotations

import asyncio
import logging
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

from gateway import __version__
from gateway.config.convert import rights_of
from gateway.contract import (
    ACCEPT,
    LOCK,
    OWN_VERBS,
    STOP,
    UNLOCK,
    AuditRecord,
    CommandError,
    CommandRequest,
    read_body,
    read_leniently,
    rfc3339,
)
from gateway.errors import StoreError
from gateway.families.command.build import verbs
from gateway.plugins.interface import Gateway, PluginSite
from gateway.plugins.web.interface import MetricsAccess
from gateway.plugins.web.parameters import rows_of, sample_args
from gateway.plugins.web.tools import Tools
from gateway.starters.commands.submit import Results
from gateway.starters.policy.freshness import EVERY_S
from gateway.starters.telemetry.view import StarterControlView

log = logging.getLogger(__name__)

WEB = "web"
LOGIN = ("login", "log in to operate")  # the code and text why nothing may be commanded without a login

_OFFERS: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("start", {}),
    ("stop", {}),
    ("reset", {}),
    ("jog", {"value": True}),
    ("jog", {"value": False}),
    ("direction", {"value": "forward"}),
    ("direction", {"value": "reverse"}),
    ("general_enable", {"value": True}),
    ("general_enable", {"value": False}),
    ("local_remote", {"value": "local"}),
    ("local_remote", {"value": "remote"}),
    ("configure", {}),
    ("read", {}),
    ("set", {}),
    (LOCK, {}),
    (UNLOCK, {}),
    (ACCEPT, {}),
)
_CURVES = ("curve", "baseline_curve")
MOVES_WITHIN_S = 3.0  # a line that has nothing to ask looks at its port once a second
MOVE_LOOK_S = 0.05
MOST_STARTS = 50  # in an answer; of older ones those with samples
MOST_TRIPS = 20
_REASON = {"reason": "-"}  # a lock is judged with one; the page asks for the real one


@dataclass
class WebAccess:
    """Implements `gateway.plugins.web.interface.GatewayAccess`; on the application's loop."""

    site: PluginSite
    gateway: Gateway
    _token: str = ""
    _token_s: float = 0.0
    _tools: Tools = field(default_factory=Tools)

    def token(self) -> str:
        """Return a proof of freshness that is at most a second old, and younger than the latest stop."""
        now_s = self.gateway.clock.now_s()
        is_old = now_s - self._token_s >= EVERY_S or self._token_s < self.gateway.dispatcher.stopped_s()
        if is_old or self.gateway.tokens.made_s(self._token) is None:
            self._token, self._token_s = self.gateway.tokens.issue(now_s), now_s
        return self._token

    def may_start(self, client: str) -> bool:
        """Return whether an operator may start any motor."""
        rights = rights_of(self.site.config)
        return any(
            rights.is_allowed(client, verb=verb, starter=starter)
            for starter in self.gateway.starters
            for verb in ("start", "jog")
        )

    def actions(self, starter: str, client: str | None) -> list[dict[str, Any]]:
        """Return what could be commanded now, and why not, in the words of what judges commands."""
        view = self.gateway.starters.get(starter)
        if view is None:
            return []
        two_step = self.gateway.policy.rulebook.of(starter).two_step
        offers = []
        for verb, args in _OFFERS:
            if verb not in (*verbs(view.profile), *OWN_VERBS):
                continue
            error = None if client is None else self._objection(view, client, verb, args)
            code, text = LOGIN if client is None else (error.code, error.text) if error else ("", "")
            offer = {"verb": verb, "args": args, "permitted": not code, "two_step": verb in two_step}
            offers.append({**offer, "code": code, "text": text})
        return offers

    def submit(self, starter: str, verb: str, payload: bytes, *, client: str, user: str) -> Results:
        """Have a command of a logged-in user judged and carried out; its proof is a token of the page."""
        lenient = read_leniently(payload)
        request = CommandRequest(
            starter,
            client,
            verb,
            id=lenient.id,
            operator=user,
            reason=lenient.reason,
            received_s=self.gateway.clock.now_s(),
            source=WEB,
        )
        if verb == STOP:  # nothing in a payload may hold it up
            return self.gateway.commands.submit(request)
        try:
            body = read_body(payload)
        except CommandError as error:
            return self.gateway.commands.reject(replace(request, args=lenient.args), error)
        return self.gateway.commands.submit(
            replace(request, args=body.args, expect=body.expect, select=body.select, proof=body.proof)
        )

    def note_login(self, verb: str, code: str, *, user: str, client: str, address: str) -> None:
        """Record a login, a refused one, or a logout in the audit and the log."""
        log.info("web %s: user=%s client=%s address=%s %s", verb, user or "unknown", client, address, code)
        self.gateway.records.put(
            AuditRecord(
                starter="",
                client=client,
                operator=user or None,
                verb=verb,
                args={"address": address},
                decision="confirmed" if code == "ok" else "rejected",
                code=code,
                time_s=self.gateway.clock.utc_s(),
                seq=self.gateway.records.sequence.take(),
                boot=self.gateway.records.boot,
                source=WEB,
            )
        )

    async def parameters(self, starter: str) -> list[dict[str, Any]]:
        """Return the rows of a starter's family by the manual's code."""
        view = self.gateway.starters.get(starter)
        if view is None:
            return []
        return await asyncio.to_thread(lambda: list(rows_of(view.profile, view.variant)))

    async def records(self, starter: str) -> Mapping[str, list[Any]] | None:
        """Return the starter's stored starts, the last of them with their samples, and its trips."""
        try:
            rows = await self.gateway.stored(starter, (*_CURVES, "start", "trip"))
        except StoreError:
            return None
        curves = {row.id: row.data for row in rows if row.kind in _CURVES}
        starts = [row for row in rows if row.kind == "start"]
        shown = [row for row in starts[:-MOST_STARTS] if row.id in curves] + starts[-MOST_STARTS:]
        return {
            "starts": [
                {**row.data, "samples": curves[row.id]} if row.id in curves else row.data for row in shown
            ],
            "trips": [row.data for row in rows if row.kind == "trip"][-MOST_TRIPS:],
        }

    def about(self) -> dict[str, Any]:
        """Return how clock and broker are."""
        mqtt = self.site.config.mqtt
        return {
            "clock": {
                "time": rfc3339(self.gateway.clock.utc_s()),
                "doubt": self.gateway.clock_doubt(),
            },
            "broker": {
                "host": mqtt.host,
                "port": mqtt.port,
                "tls": mqtt.is_tls,
                "connected": self.gateway.mqtt.is_connected(),
            },
            "version": __version__,
            "python": platform.python_version(),
        }

    def metrics(self) -> MetricsAccess | None:
        """Return what answers a scrape; None while the configuration wants no metrics."""
        return cast("MetricsAccess | None", self.gateway.plugin("metrics"))

    async def health(self) -> dict[str, Any]:
        """Return by line whether it moves, and whether the broker is connected; waits for lines that idle."""
        before = self.gateway.progress()
        lines = dict.fromkeys(before, False)
        for _ in range(int(MOVES_WITHIN_S / MOVE_LOOK_S)):
            await asyncio.sleep(MOVE_LOOK_S)
            lines = {name: steps != before.get(name) for name, steps in self.gateway.progress().items()}
            if all(lines.values()):
                break
        return {"lines": lines, "broker": self.gateway.mqtt.is_connected()}

    def diagnostics(self) -> dict[str, Any]:
        """Return what a bug report needs, without secrets."""
        config = self.site.config.model_dump(mode="json", by_alias=True)
        for user in (config.get("web") or {}).get("user", ()):
            user["password"] = "(left out)"
        return {
            **self.about(),
            "system": platform.platform(),
            "config": config,
            "computed": dict(self.site.computed),
        }

    async def run_tool(self, name: str) -> dict[str, Any]:
        """Run `check` or `doctor` on the configuration's file, in a process that yields to all others."""
        return await self._tools.run(name, self.site.path)

    def _objection(
        self, view: StarterControlView, client: str, verb: str, args: Mapping[str, Any]
    ) -> CommandError | None:
        if verb == LOCK:
            args = _REASON
        elif verb in ("read", "set"):
            args = sample_args(view.profile.family, verb)
        now_s = self.gateway.clock.now_s()
        request = CommandRequest(
            view.setup.name, client, verb, id="-", args=args, received_s=now_s, source=WEB
        )
        return self.gateway.dispatcher.objection(request)
