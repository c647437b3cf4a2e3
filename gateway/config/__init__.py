"""The configuration file: TOML to checked models; pure.

Start at `load`; `schema` has the tables, `cross_checks` the rules across them. `convert` makes plain values
for lower packages.
"""
