"""The meaning of lessons: words, numbers, opposites, sentences, contradictions."""
