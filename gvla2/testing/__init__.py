"""Conformance checks for plugin authors: one a kind."""
