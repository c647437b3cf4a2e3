from __future__ import annotations

from gateway.line.port.buffered import EarlyWakeUp


def test_one_write_in_five_is_left_late() -> None:
    lead = EarlyWakeUp()
    lates = 0

    for number in range(9000):
        lateness_s = 0.00001 + 0.0001 * (number * 7 % 100) / 100  # evenly spread
        left_s = lead.seconds - lateness_s
        lates += left_s < 0.0
        lead.learn(left_s)

    assert 0.15 < lates / 9000 < 0.25
