"""The first of two steps: a starter selected by one client for one command, for ten seconds."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gateway.contract import CommandError, CommandRequest, ResultCode

VALID_S = 10.0


@dataclass(frozen=True, slots=True)
class Selection:
    """What a token stands for."""

    token: str
    client: str
    verb: str
    args: Mapping[str, Any]
    state: str  # as the client saw it
    until_s: float  # on the steady clock


class Selections:
    """At most one selection for each starter; all times on the steady clock."""

    def __init__(self) -> None:
        self._selections: dict[str, Selection] = {}

    def of(self, starter: str, *, now_s: float) -> Selection | None:
        """Return the selection that counts."""
        selection = self._selections.get(starter)
        return None if selection is None or now_s >= selection.until_s else selection

    def select(self, target: CommandRequest, state: str, *, now_s: float) -> str:
        """Select for a command, seen in this state; return the token. An earlier selection ends."""
        token, until_s = secrets.token_hex(8), now_s + VALID_S
        chosen = Selection(token, target.client, target.verb, args=target.args, state=state, until_s=until_s)
        self._selections[target.starter] = chosen
        return token

    def end(self, starter: str) -> None:
        """Cancel a selection, if there is one."""
        self._selections.pop(starter, None)

    def take(self, request: CommandRequest, *, now_s: float) -> Selection:
        """Use the client's selection up and return it; CommandError when it is not for this command."""
        selection = self._selections.get(request.starter)
        if selection is None or (selection.client, selection.token) != (request.client, request.select):
            raise CommandError(ResultCode.NOT_SELECTED, "token")
        self.end(request.starter)
        if now_s >= selection.until_s:
            raise CommandError(ResultCode.SELECTION_EXPIRED, valid_s=VALID_S)
        if selection.verb != request.verb:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "verb", verb=selection.verb)
        if selection.args != request.args:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "args", verb=selection.verb)
        return selection
