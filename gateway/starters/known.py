"""What is said to a command whose id is known already: what was said at first, and that it is said again."""

from __future__ import annotations

from dataclasses import replace

from gateway.starters.records import Phase, ResultRecord
from gateway.starters.request import CommandRequest

STAYS_REFUSED = "this id stays refused; look, decide again, then send it with a new id"


def is_same(request: CommandRequest, earlier: ResultRecord) -> bool:
    """Return whether the id stands for the same wish as before."""
    return (request.starter, request.verb) == (earlier.starter, earlier.verb)


def told_again(earlier: ResultRecord, request: CommandRequest) -> ResultRecord:
    """Return a command's latest result as the answer to its repetition."""
    is_refused = earlier.phase is Phase.REJECTED
    return replace(
        earlier,
        text=f"{earlier.text}; {STAYS_REFUSED}" if is_refused else earlier.text,
        is_duplicate=True,
        correlation=request.correlation,
        response_topic=request.response_topic,
    )
