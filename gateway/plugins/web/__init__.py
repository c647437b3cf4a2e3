"""The status page: what it shows, HTTP and server-sent events around it.

Start at `page`; `site_model`, `plots` and `requests` are pure. On the application's loop, imported after the
lines poll; what fails here touches neither lines nor MQTT. Interface: docs/web-api.md.
"""
