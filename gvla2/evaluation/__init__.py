"""Metrics, protocols, statistics and tables."""
