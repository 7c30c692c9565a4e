"""The perception suite: perceived scenes against what a simulator's pixels truly show."""
