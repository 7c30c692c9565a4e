"""The memory layouts of the paper's released code: JSON, one record a line. All are read, ``states`` is written.

* ``states``: a folder with ``active.jsonl``, ``provisional.jsonl``, ``summary.jsonl`` and ``archive.jsonl``;
* ``items``: one file, a line a task with its ``memory_items`` and ``status``;
* ``robot``: one file, a line a task with its ``memory_text`` and ``outcome``.
"""
