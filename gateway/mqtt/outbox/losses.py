"""What the broker will never hear of: summed up, kept on the disk, and declared once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gateway.records import rfc3339
from gateway.storage.spool import Changes, Loss, merged

TOLD_EVERY_S = 60.0  # losses that go on are summed up


class Losses:
    """Knows what is not told yet, and what the disk does not know of all this."""

    def __init__(self) -> None:
        self._untold: tuple[Loss, ...] = ()
        self._unsaved: tuple[Loss, ...] = ()
        self._is_telling_unsaved = False
        self._told_s = float("-inf")

    def note(self, losses: Sequence[Loss]) -> None:
        """Note what memory could not hold."""
        self._untold = merged((*self._untold, *losses))
        self._unsaved = merged((*self._unsaved, *losses))

    def note_saved(self, losses: Sequence[Loss]) -> None:
        """Note what the disk has noted already."""
        self._untold = merged((*self._untold, *losses))

    def lose_disk(self) -> None:
        """Have the disk, which is a new one, learn everything again."""
        self._unsaved = self._untold

    def changes(self, changes: Changes | None) -> Changes | None:
        """Return these changes with what the disk does not know of losses, None for none at all."""
        if changes is None and not self._unsaved and not self._is_telling_unsaved:
            return None
        changes = (changes or Changes())._replace(
            losses=self._unsaved, are_losses_told=self._is_telling_unsaved
        )
        self._unsaved, self._is_telling_unsaved = (), False
        return changes

    def unwritten(self, changes: Changes) -> None:
        """Note that the disk could not do what `changes` returned."""
        self._unsaved = merged((*changes.losses, *self._unsaved))
        self._is_telling_unsaved |= changes.are_losses_told

    def declare(self, now_s: float) -> tuple[str, dict[str, Any]] | None:
        """Return text and data of the event that declares all; None when there is none, or too soon."""
        if not self._untold or self.wait_s(now_s) > 0:
            return None
        text, data = _told(self._untold)
        self._untold, self._unsaved = (), ()
        self._is_telling_unsaved = True
        self._told_s = now_s
        return text, data

    def wait_s(self, now_s: float) -> float:
        """Return how long losses that there are have to wait until they are declared."""
        return max(0.0, self._told_s + TOLD_EVERY_S - now_s) if self._untold else 0.0


def _told(losses: Sequence[Loss]) -> tuple[str, dict[str, Any]]:
    parts = ", ".join(f"{loss.rows} of kind {loss.kind.name.lower()} ({loss.reason})" for loss in losses)
    firsts = [loss.first_s for loss in losses if loss.first_s is not None]
    lasts = [loss.last_s for loss in losses if loss.last_s is not None]
    data = {
        "count": sum(loss.rows for loss in losses),
        "first": rfc3339(min(firsts, default=None)),
        "last": rfc3339(max(lasts, default=None)),
        "lost": [
            {
                "reason": loss.reason,
                "kind": loss.kind.name.lower(),
                "count": loss.rows,
                "first": rfc3339(loss.first_s),
                "last": rfc3339(loss.last_s),
            }
            for loss in losses
        ],
    }
    return f"lost before the broker had it: {parts}", data
