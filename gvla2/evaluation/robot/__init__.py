"""The robot suite: success rates, and memory's contribution to them."""
