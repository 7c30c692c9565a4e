"""The perception suite: perceived scenes against a simulator's ground-truth pixels."""
