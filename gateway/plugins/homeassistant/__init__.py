"""The entities that Home Assistant finds: pure. `discovery` makes its messages, `entities` what they list.

The loop around them is `gateway.plugins.homeassistant.plugin`.
"""
