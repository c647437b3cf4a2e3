"""The first of two steps: a starter selected by one client for one command, for ten seconds."""

from __future__ import annotations

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
    """At most one selection for each starter."""

    def __init__(self) -> None:
        self._selections: dict[str, Selection] = {}

    def check_free(self, starter: str, client: str, *, now_s: float) -> None:
        """Raise CommandError while another client has this starter selected."""
        selection = self._present(starter, now_s)
        if selection is not None and selection.client != client:
            wait_s = selection.until_s - now_s
            raise CommandError(ResultCode.SELECTED_BY_OTHER, client=selection.client, wait_s=wait_s)

    def set(self, starter: str, selection: Selection) -> None:
        """Select; an earlier selection ends."""
        self._selections[starter] = selection

    def check_own(self, starter: str, client: str, *, now_s: float) -> None:
        """Raise CommandError unless this client has the starter selected."""
        selection = self._present(starter, now_s)
        if selection is None or selection.client != client:
            raise CommandError(ResultCode.NOT_SELECTED, "client", client=client)

    def end(self, starter: str) -> None:
        """Let a selection, if there is one, count no more."""
        self._selections.pop(starter, None)

    def take(self, request: CommandRequest, *, now_s: float) -> Selection:
        """Use the client's selection up and return it; CommandError when it is not for this command."""
        selection = self._selections.get(request.starter)
        if selection is None or (selection.client, selection.token) != (request.client, request.select):
            raise CommandError(ResultCode.NOT_SELECTED, "token")
        del self._selections[request.starter]
        if now_s >= selection.until_s:
            raise CommandError(ResultCode.SELECTION_EXPIRED, valid_s=VALID_S)
        if selection.verb != request.verb:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "verb", verb=selection.verb)
        if selection.args != request.args:
            raise CommandError(ResultCode.SELECTED_OTHERWISE, "args", verb=selection.verb)
        return selection

    def _present(self, starter: str, now_s: float) -> Selection | None:
        selection = self._selections.get(starter)
        return None if selection is None or now_s >= selection.until_s else selection
