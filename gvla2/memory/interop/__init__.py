"""A bank in the format of the paper's released code: JSON lines in active, provisional, summary and archive.jsonl."""
