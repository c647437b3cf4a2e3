"""How many Python calls a transaction and a published value cost: a bound, to be lowered with the code."""

from __future__ import annotations

from tests.lab.bench.calls import line_calls, publication_calls

SLACK = 1.03
LINE_CALLS = 105  # 95 on a machine without other work
WAY_CALLS, WAY_FILES = 242, 40


def test_a_transaction_costs_the_lines_thread_no_more_calls_than_before() -> None:
    calls, _ = line_calls()

    assert calls < LINE_CALLS * SLACK


def test_a_value_takes_no_more_calls_and_files_from_its_reply_to_its_message_than_before() -> None:
    way = publication_calls()

    assert way.calls < WAY_CALLS * SLACK
    assert len(way.files) <= WAY_FILES
