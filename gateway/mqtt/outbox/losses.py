"""What was lost before the broker had it: summed up, stored on the disk, and declared once."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.contract import Event, EventCode, event_of, phrase, rfc3339
from gateway.storage.spool import Changes, Loss, merged

DECLARE_EVERY_S = 60.0  # losses that go on are summed up


class Losses:
    """Losses that are not declared yet, and those that the disk does not have yet."""

    def __init__(self) -> None:
        self._undeclared: tuple[Loss, ...] = ()
        self._unsaved: tuple[Loss, ...] = ()
        self._is_declaring_unsaved = False
        self._declared_s = float("-inf")

    def note(self, losses: Sequence[Loss]) -> None:
        """Note what memory could not hold."""
        self._undeclared = merged((*self._undeclared, *losses))
        self._unsaved = merged((*self._unsaved, *losses))

    def note_saved(self, losses: Sequence[Loss]) -> None:
        """Note losses that the disk has already."""
        self._undeclared = merged((*self._undeclared, *losses))

    def lose_disk(self) -> None:
        """Have everything written again: the disk is a new one."""
        self._unsaved = self._undeclared

    def changes(self, changes: Changes | None) -> Changes | None:
        """Return these changes with what the disk does not know of losses, None for none at all."""
        if changes is None and not self._unsaved and not self._is_declaring_unsaved:
            return None
        changes = (changes or Changes())._replace(
            losses=self._unsaved, are_losses_declared=self._is_declaring_unsaved
        )
        self._unsaved, self._is_declaring_unsaved = (), False
        return changes

    def unwritten(self, changes: Changes) -> None:
        """Note that the disk could not do what `changes` returned."""
        self._unsaved = merged((*changes.losses, *self._unsaved))
        self._is_declaring_unsaved |= changes.are_losses_declared

    def declare(self, now_s: float) -> Event | None:
        """Return the event that declares all; None when there is none, or too soon."""
        if not self._undeclared or self.wait_s(now_s) > 0:
            return None
        event = _gap(self._undeclared)
        self._undeclared, self._unsaved = (), ()
        self._is_declaring_unsaved = True
        self._declared_s = now_s
        return event

    def wait_s(self, now_s: float) -> float:
        """Return how long losses that there are have to wait until they are declared."""
        return max(0.0, self._declared_s + DECLARE_EVERY_S - now_s) if self._undeclared else 0.0


def _gap(losses: Sequence[Loss]) -> Event:
    firsts = [loss.first_s for loss in losses if loss.first_s is not None]
    lasts = [loss.last_s for loss in losses if loss.last_s is not None]
    named = (
        phrase(EventCode.GAP, "loss", count=loss.rows, kind=loss.kind.name.lower(), reason=loss.reason)
        for loss in losses
    )
    return event_of(
        EventCode.GAP,
        count=sum(loss.rows for loss in losses),
        first=rfc3339(min(firsts, default=None)),
        last=rfc3339(max(lasts, default=None)),
        lost=[
            {
                "reason": loss.reason,
                "kind": loss.kind.name.lower(),
                "count": loss.rows,
                "first": rfc3339(loss.first_s),
                "last": rfc3339(loss.last_s),
            }
            for loss in losses
        ],
        losses=", ".join(named),
    )
