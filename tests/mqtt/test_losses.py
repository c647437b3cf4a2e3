from __future__ import annotations

from gateway.mqtt.outbox.losses import Losses
from gateway.storage.spool import Changes, Kind, Loss, merged

VALUES = Loss("memory_full", Kind.VALUE, 3, 1_760_000_000.0, 1_760_000_005.0)
EVENTS = Loss("disk_full", Kind.EVENT, 2, None, None)


def test_a_loss_is_stored_and_declared_and_then_forgotten_in_one_transaction_with_what_is_new() -> None:
    losses = Losses()
    losses.note([VALUES])
    losses.note_saved([EVENTS])
    assert losses.changes(None) == Changes(losses=(VALUES,))

    declared = losses.declare(10.0)

    assert declared is not None
    text, data = declared
    assert text == "lost before the broker had it: 3 of kind value (memory_full), 2 of kind event (disk_full)"
    assert data == {
        "count": 5,
        "first": "2025-10-09T08:53:20.000Z",
        "last": "2025-10-09T08:53:25.000Z",
        "lost": [
            {
                "reason": "memory_full",
                "kind": "value",
                "count": 3,
                "first": "2025-10-09T08:53:20.000Z",
                "last": "2025-10-09T08:53:25.000Z",
            },
            {"reason": "disk_full", "kind": "event", "count": 2, "first": None, "last": None},
        ],
    }
    assert losses.changes(None) == Changes(are_losses_declared=True)
    assert losses.changes(None) is None


def test_what_the_disk_could_not_take_is_offered_again() -> None:
    losses = Losses()
    losses.note([EVENTS])
    losses.declare(0.0)
    losses.note([VALUES])
    changes = losses.changes(None)
    assert changes == Changes(losses=(VALUES,), are_losses_declared=True)
    losses.note([VALUES])

    losses.unwritten(changes)

    assert losses.changes(None) == Changes(losses=merged([VALUES, VALUES]), are_losses_declared=True)


def test_a_new_disk_learns_all_that_is_not_reported() -> None:
    losses = Losses()
    losses.note_saved([VALUES, EVENTS])
    assert losses.changes(None) is None

    losses.lose_disk()

    assert losses.changes(None) == Changes(losses=(VALUES, EVENTS))
