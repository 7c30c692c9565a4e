"""Retrieval for a task: scoring, ranking, abstention, rendering."""
