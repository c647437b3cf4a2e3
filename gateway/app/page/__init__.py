"""The status page's connection to the gateway: start at `page`."""
