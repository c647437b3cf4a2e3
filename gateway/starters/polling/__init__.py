"""How a starter is polled: which rows, how often, and which of them are overdue, refused or lost."""

from gateway.starters.polling.polling import Polling

__all__ = ["Polling"]
