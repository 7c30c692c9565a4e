"""Files, caches and database addresses: what every other package stands on."""
