"""What `doctor` measures of a machine that is throttled."""

from __future__ import annotations

import pytest

from tests.slow_box.__main__ import box_speed
from tests.slow_box.throttle import Throttle

SHARE = 0.2


@pytest.mark.alone
def test_a_fifth_of_a_processor_is_measured_as_a_machine_that_is_several_times_as_slow() -> None:
    whole = box_speed(Throttle(1.0))
    with Throttle(SHARE) as throttle:
        if not throttle.how.startswith("control group"):
            pytest.skip("no control group can be made here (root is needed)")
        part = box_speed(throttle)

    alone = (
        whole.slowness * whole.processor
    )  # what others took of the processor is no slowness of the machine
    assert part.slowness > 2.5 * alone
    assert part.slowness * part.processor == pytest.approx(alone, rel=0.4)  # the work itself is the same
    assert part.processor < 1.5 * SHARE
