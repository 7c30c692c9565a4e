"""What a hand can do, free of words: skills by the ids of perceived objects, and one entry, ``carry_out``."""
