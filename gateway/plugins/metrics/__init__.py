"""The metrics that Prometheus scrapes: counters fed by records, and all states at the moment of a scrape.

Start at `plugin.py`; `catalogue.py` is the list of all metrics, from which docs/metrics.md is made. The text
is made in a thread by prometheus-client. Nothing is read from a starter for a scrape.
"""
