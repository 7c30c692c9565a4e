"""What a task brings back: scored, ranked, abstained from, rendered."""
