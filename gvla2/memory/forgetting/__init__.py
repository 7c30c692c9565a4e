"""Forgetting for good: what one record leaves in others, and in files."""
