"""What lessons say: words, numbers, opposites, sentences, contradictions."""
