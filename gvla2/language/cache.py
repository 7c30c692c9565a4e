"""Answers kept in a folder by what was asked, one file each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gvla2.errors import OutputError
from gvla2.writing import write_whole

FORMAT = 1
"""Part of every key: a change of what is kept makes older files unreachable."""


def digest(asked: Mapping[str, Any]) -> str:
    """The key of a request: the same for equal JSON, whatever the order of its keys."""
    text = json.dumps([FORMAT, asked], sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


class AnswerCache:
    """A folder of JSON documents. Several processes may share it; files are written whole.

    What cannot be read is treated as absent and written anew. A folder that cannot be written to loses answers,
    never a call: it says so once, in ``problem``.
    """

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder).expanduser()
        self.problem = ""

    def get(self, key: str) -> dict[str, Any] | None:
        """The document under the key, None where there is none or it is damaged."""
        try:
            document = json.loads(self._path(key).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(document, dict) or document.get("key") != key:
            return None
        answer = document.get("answer")
        return answer if isinstance(answer, dict) else None

    def put(self, key: str, answer: Mapping[str, Any]) -> None:
        """Keep a document; the last one wins."""
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps({"key": key, "answer": answer}).encode())
        except (OSError, OutputError) as error:
            self.problem = self.problem or f"Answers are not kept: {error}"

    def _path(self, key: str) -> Path:
        return self._folder / key[:2] / f"{key}.json"
