"""A bank in RAM, which follows its store: columns, postings, vectors."""
