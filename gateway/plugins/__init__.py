"""What runs beside the gateway's core: each plugin takes records and its own settings, and serves.

A plugin is a package named as its table in the configuration, with a module `plugin` that has

- `settings_of(site)`: its settings, None while the configuration does not want it; cheap, no heavy imports;
- `load(gateway)`: imports what it needs, in a thread, and returns what makes the plugin of its settings;
- `MISSING`: what to install when that fails.

`interface` says what a plugin is and what it is given. `app.plugins` runs them; none imports another.
"""
