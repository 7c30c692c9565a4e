"""A bank as the paper's released code keeps one: JSON lines in ``active.jsonl``, ``provisional.jsonl``,
``summary.jsonl`` and ``archive.jsonl``.
"""
