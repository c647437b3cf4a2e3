"""How long a restart leaves a starter without a request: computed in `gaps`, measured in `watch`."""
