"""A bank as the paper's released code keeps one: JSON lines in active, provisional, summary and archive.jsonl."""
