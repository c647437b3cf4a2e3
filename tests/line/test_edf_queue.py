from __future__ import annotations

from math import inf

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.scheduler.line_time import EdfQueue, Queued, T

TIMES_S = st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0])


class ListQueue(EdfQueue[T]):
    """A queue as one would write it first: a list in no order, looked through at every call."""

    def put(self, thing: T, release_s: float, deadline_s: float) -> None:
        thing.leave()
        thing.queue, thing.release_s, thing.deadline_s = self, release_s, deadline_s
        self.things.append(thing)

    def first(self, now_s: float) -> T | None:
        released = [each for each in self.things if each.release_s <= now_s]
        return min(released, key=lambda each: each.deadline_s, default=None)

    def next_s(self) -> float:
        return min((each.release_s for each in self.things), default=inf)


@settings(deadline=None)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("put"), st.integers(0, 5), TIMES_S, TIMES_S),
            st.tuples(st.just("drop"), st.integers(0, 5)),
            st.tuples(st.just("look"), TIMES_S),
        ),
        max_size=300,
    )
)
def test_it_does_what_a_plain_list_does(steps: list[tuple[object, ...]]) -> None:
    queue, plain = EdfQueue[Queued](), ListQueue[Queued]()
    pairs = [(Queued(), Queued()) for _ in range(6)]
    one_of = {id(one): at for at, pair in enumerate(pairs) for one in pair}
    now_s = 0.0
    for step in steps:
        match step:
            case "put", int(at), float(release_s), float(deadline_s):
                for thing, each in zip(pairs[at], (queue, plain), strict=True):
                    each.put(thing, release_s, deadline_s)
            case "drop", int(at):
                for thing in pairs[at]:
                    thing.leave()
            case _, float(at_s):
                now_s = max(now_s, at_s)
                found = [each.first(now_s) for each in (queue, plain)]
                seen = [None if each is None else one_of[id(each)] for each in found]
                assert seen[0] == seen[1]
                assert queue.next_s() == plain.next_s()
