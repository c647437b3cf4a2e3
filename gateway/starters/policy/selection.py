"""The first of two steps: a starter selected by one client for one command, for ten seconds."""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from gateway.contract import CommandError, CommandRequest, ResultCode

VALID_S = 10.0


@dataclass(frozen=True, slots=True)
class Selection:
    """What a token stands for."""

    token: str
    target: CommandRequest  # the command that may follow
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
        token = secrets.token_hex(8)
        self._selections[target.starter] = Selection(token, target, state, until_s=now_s + VALID_S)
        return token

    def end(self, starter: str) -> None:
        """Cancel a selection, if there is one."""
        self._selections.pop(starter, None)

    def take(self, request: CommandRequest, *, now_s: float) -> Selection:
        """Use the client's selection up and return it; CommandError when it is not for this command."""
        selected = self._selections.get(request.starter)
        if selected is None or selected.token != request.select or selected.target.client != request.client:
            raise CommandError(ResultCode.NOT_SELECTED, "token")
        self.end(request.starter)
        if now_s >= selected.until_s:
            raise CommandError(ResultCode.SELECTION_EXPIRED, valid_s=VALID_S)
        target = selected.target
        if target.verb != request.verb:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "verb", verb=target.verb)
        if target.args != request.args:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "args", verb=target.verb)
        return selected
