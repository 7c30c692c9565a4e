"""Whole memory methods beside the governed bank, on its store."""
