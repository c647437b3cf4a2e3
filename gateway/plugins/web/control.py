"""What can be commanded from the page now, what parameters can be set to, and the commands' way in."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from gateway.contract import (
    ACCEPT,
    LOCK,
    OWN_VERBS,
    STOP,
    UNLOCK,
    CommandError,
    CommandRequest,
    read_body,
)
from gateway.families import OFF, Access, Parameter, Profile, Variant, command, load_profile, parameters
from gateway.plugins.interface import Gateway
from gateway.plugins.web.accounts import WEB, WebSession
from gateway.starters import TOKEN_EVERY_S as EVERY_S
from gateway.starters import Results

LOGIN = ("login", "log in to operate")  # the code and text why nothing may be commanded without a login

_VALUES: Mapping[str, tuple[Any, ...]] = {  # of the verbs that take one
    "jog": (True, False),
    "direction": ("forward", "reverse"),
    "general_enable": (True, False),
    "local_remote": ("local", "remote"),
}
_VERBS = ("start", STOP, "reset", *_VALUES, "configure", "read", "set", LOCK, UNLOCK, ACCEPT)  # as shown
_REASON = {"reason": "-"}  # a lock is judged with one; the page asks for the real one


class Control:
    """On the application's loop."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._token = ""
        self._token_s = 0.0

    def token(self) -> str:
        """Return a proof of freshness that is at most a second old, and younger than the latest stop."""
        gateway, now_s = self._gateway, self._gateway.clock.now_s()
        is_old = now_s - self._token_s >= EVERY_S or self._token_s < gateway.commands.admission.stopped_s()
        if is_old or gateway.tokens.made_s(self._token) is None:
            self._token, self._token_s = gateway.tokens.issue(now_s), now_s
        return self._token

    def actions(self, starter: str, client: str | None) -> list[dict[str, Any]]:
        """Return what could be commanded now, and why not, in the words of what judges commands."""
        view = self._gateway.starters.get(starter)
        if view is None:
            return []
        known = *command.verbs(view.profile), *OWN_VERBS
        two_step = self._gateway.policy.settings.of(starter).two_step
        offers = []
        for verb, args in _offers(known):
            code, text = LOGIN
            if client is not None:
                error = self._objection(starter, view.profile.family, client, verb, args)
                code, text = (error.code, error.text) if error else ("", "")
            offer = {"verb": verb, "args": args, "permitted": not code, "two_step": verb in two_step}
            offers.append({**offer, "code": code, "text": text})
        return offers

    def submit(self, starter: str, verb: str, payload: bytes, session: WebSession) -> Results:
        """Have a command of a logged-in user judged and carried out; its proof is a token of the page."""
        user, received_s = session.user, self._gateway.clock.now_s()
        body, mistake = read_body(payload)
        request = CommandRequest(
            starter,
            user.client,
            verb,
            id=body.id,
            operator=user.name,
            reason=body.reason,
            received_s=received_s,
            source=WEB,
        )
        if verb == STOP:  # nothing else in a payload may hold a stop up
            return self._gateway.commands.submit(request)
        request = replace(request, args=body.args, expect=body.expect, select=body.select, proof=body.proof)
        return self._gateway.commands.submit(request, mistake)

    def parameters(self, starter: str) -> list[dict[str, Any]]:
        """Return the rows of a starter's family by the manual's code; takes long."""
        view = self._gateway.starters.get(starter)
        return [] if view is None else list(rows_of(view.profile, view.variant))

    def _objection(
        self, starter: str, family: str, client: str, verb: str, args: Mapping[str, Any]
    ) -> CommandError | None:
        if verb == LOCK:
            args = _REASON
        elif verb in ("read", "set"):
            args = sample_args(family, verb)
        now_s = self._gateway.clock.now_s()
        request = CommandRequest(starter, client, verb, id="-", args=args, received_s=now_s, source=WEB)
        return self._gateway.commands.objection(request)


def rows_of(profile: Profile, variant: Variant) -> Iterator[dict[str, Any]]:
    """Yield every row that can be read, in the manual's order."""
    for row in profile.parameters.values():
        if row.access is Access.NONE:
            continue
        limits = parameters.raw_limits(row, variant)
        scale = 10 ** (row.decimals or 0)
        labels = {str(number): label for number, label in profile.enums.get(row.enum, {}).items()}
        why_not = _why_not_set(profile, variant, row)
        yield {
            "code": row.code,
            "name": row.name,
            "unit": row.unit,
            "least": None if limits is None else limits[0] / scale,
            "most": None if limits is None else limits[1] / scale,
            "labels": {**labels, **({str(row.off): OFF} if row.off is not None else {})},
            "writable": not why_not,
            "why_not": why_not,
        }


def _offers(verbs: Collection[str]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield what the page offers of these verbs, with its arguments."""
    for verb in [verb for verb in _VERBS if verb in verbs]:
        yield from ((verb, {"value": value}) for value in _VALUES.get(verb, ()))
        if verb not in _VALUES:
            yield verb, {}


@lru_cache(maxsize=32)
def sample_args(family: str, verb: str) -> Mapping[str, Any]:
    """Return arguments of a `read` or `set` that make sense for any starter of a family."""
    profile = load_profile(family)
    for row in profile.parameters.values():
        args: dict[str, Any] = {"parameter": row.code}
        if verb == "set":
            if not row.is_writable or row.is_stopped_only or row.raw_min is None:
                continue
            args["value"] = _least(row)
        try:
            command.prepare(profile, Variant(), verb, args)
        except CommandError:
            continue
        return args
    return {}


def _why_not_set(profile: Profile, variant: Variant, row: Parameter) -> str:
    """Return why no `set` may name a row; empty when one may."""
    try:
        parameters.settable_words(profile, variant, row, _least(row))
    except CommandError as error:
        return "" if error.code in ("out_of_range", "bad_value") else error.text
    return ""


def _least(row: Parameter) -> float:
    return float((row.raw_min or 0) / 10 ** (row.decimals or 0))
