"""Answers cached in a folder by request."""

from __future__ import annotations

import hashlib
import json
import logging
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_log = logging.getLogger(__name__)


def digest(asked: Mapping[str, Any]) -> str:
    """The key of a request: the same for equal JSON, whatever the order of its keys."""
    text = json.dumps(asked, sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


class AnswerCache:
    """A folder of JSON documents that processes may share (``diskcache``; beyond 1 GB the oldest are dropped).

    Unreadable entries count as absent. If the folder is not writable, answers are not cached, but no call fails.
    """

    def __init__(self, folder: str) -> None:
        self._folder = str(Path(folder).expanduser())
        self._usable = True

    def get(self, key: str) -> dict[str, Any] | None:
        """The document under the key; None if it is missing or damaged."""
        found = self._use(lambda cache: cache.get(key))
        try:
            document = json.loads(found) if isinstance(found, str) else None
        except (ValueError, RecursionError):
            return None
        return document if isinstance(document, dict) else None

    def put(self, key: str, document: Mapping[str, Any]) -> None:
        """Keep a document; the last one wins."""
        self._use(lambda cache: cache.set(key, json.dumps(document)))

    def _use(self, work: Any) -> Any:
        import diskcache

        if not self._usable:
            return None
        try:
            # Opened for each use, as threads come and go; syncing to disk would cost 20 ms at each close.
            with diskcache.Cache(self._folder, sqlite_synchronous=0) as cache:
                return work(cache)
        except (OSError, sqlite3.Error, diskcache.Timeout) as error:
            self._usable = False
            _log.warning("Answers of language models are not cached in %s: %s", self._folder, error)
            return None
