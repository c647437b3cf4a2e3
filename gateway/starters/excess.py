"""Answers commands that are too many: one by one while that is bearable, else together, by their number."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

from gateway.starters.damped import Damped
from gateway.starters.errand import Desk, End, Errand
from gateway.starters.flood import TELL_EVERY_S
from gateway.starters.records import Phase
from gateway.starters.request import CommandRequest

TOO_MANY = "too_many"


class Excess:
    """Refuses for each client at most ten times a second, and never under an id that has a result."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._refusals = Damped(self._refuse, clock=desk.clock, every_s=TELL_EVERY_S)
        self._stops = Damped(self._answer_stop, clock=desk.clock, every_s=TELL_EVERY_S)

    def refuse(self, client: Hashable, request: CommandRequest, text: str) -> None:
        """Refuse a command now, or count it; one whose id is known gets no answer."""
        if self._desk.ledger.find(request.client, request.id) is None:
            self._refusals.put(client, (request, text))

    def pass_over(self, client: Hashable, request: CommandRequest) -> None:
        """Answer a stop whose frame goes out, but which is not followed up to an end of its own."""
        if self._desk.ledger.find(request.client, request.id) is None:
            self._stops.put(client, request)

    def close(self) -> None:
        """Report now what has only been counted."""
        self._refusals.close()
        self._stops.close()

    def _refuse(self, refused: tuple[CommandRequest, str], count: int) -> None:
        request, text = refused
        if count:
            request = replace(request, id=None, correlation=None, response_topic=None)
            text = f"{count} more refused: too many commands at once"
        end = End(Phase.REJECTED, TOO_MANY, text, values={"count": count} if count else {})
        Errand(request, self._desk).refuse(end)

    def _answer_stop(self, request: CommandRequest, count: int) -> None:
        """Say what is known of a stop that was sent: rejected would mean that nothing was written."""
        if count:
            request = replace(request, id=None, correlation=None, response_topic=None)
        which = f"{count} more stops were" if count else "it was"
        text = f"{which} sent with those that came before, and not followed up: see their results"
        errand = Errand(request, self._desk, is_kept=False)
        errand.accept()
        errand.write()
        values = {"count": count} if count else {}
        errand.finish(End(Phase.UNCONFIRMED, TOO_MANY, f"{text}: the motor may be turning", values=values))
