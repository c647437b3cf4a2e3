"""The status page: a model of the site fed by records, HTTP and server-sent events around it.

Start at `service`; `site_model`, `plots`, `sessions` and `requests` are pure. On the application's loop,
imported after the lines poll; what fails here touches neither lines nor MQTT. Interface: docs/web-api.md.
"""
