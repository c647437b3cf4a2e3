from __future__ import annotations

from gateway.repetition import Repetition


def test_the_same_trouble_is_news_once_and_another_one_again() -> None:
    repetition = Repetition()
    troubles = [
        ValueError("a"),
        ValueError("a"),
        ValueError("b"),
        KeyError("b"),
        KeyError("b"),
        ValueError("a"),
    ]

    news = [repetition.is_news(each) for each in troubles]

    assert news == [True, False, True, True, False, True]
    assert repetition.count == 1
