"""The released code itself as a peer: its own functions, loaded from a user's checkout, on the same data."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import Any

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory.peers import PeerLesson

PACKAGE = "memory_v2"
_NAME = "_released_memory"
_PARTS = ("schema", "store", "retrieval", "consolidation", "governance", "conflict")
_PLACES = (
    "",
    PACKAGE,
    f"third_party/src/minisweagent/{PACKAGE}",
    f"KnowledgeBank/third_party/src/minisweagent/{PACKAGE}",
)


class ReleasedPeer:
    """The functions of the package ``memory_v2`` that lies in ``checkout``, the repository or the package itself.

    It is not imported under its own name, and nothing else is run. Raises :class:`~gvla2.errors.ConfigurationError` if
    it is missing, or its dependencies are (pydantic).
    """

    name = "released code"

    def __init__(self, checkout: Path) -> None:
        self.folder = _package(checkout)
        self._parts = {part: _load(self.folder, part) for part in _PARTS}

    def fill(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """Uses its own store."""
        store = self._store(folder)
        store.replace_state(self._schema.MemoryState.ACTIVE, [self._record(lesson) for lesson in lessons])

    def load(self, folder: Path) -> list[Any]:
        """Uses its own store."""
        return list(self._store(folder).load_active())

    def retrieve(self, folder: Path, query: str, k: int, now: float) -> list[str]:
        """Load, rank and filter as it does; unlike it, the files are not written again."""
        store, retrieval = self._store(folder), self._parts["retrieval"]
        records = store.load_active() + store.load_summary()
        ranked = retrieval.rank_memory_records(records, query, now=_iso(now))
        known = [item for item in ranked if item.record.source_status != "uncertain"]
        return [record.memory_id for record in retrieval.select_top_memories(known, k)]

    def admit(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """Load, resolve each candidate, write the states again."""
        store, state = self._store(folder), self._schema.MemoryState
        active, archive = store.load_active(), store.load_archive()
        for lesson in lessons:
            resolved = self._parts["consolidation"].resolve_candidate(self._record(lesson), active)
            active = resolved[0]
            archive.extend(resolved[1])
        store.replace_state(state.ACTIVE, active)
        store.replace_state(state.ARCHIVE, archive)

    def place(self, lesson: PeerLesson, records: list[Any]) -> str:
        """Its decision on one candidate."""
        return str(self._parts["consolidation"].resolve_candidate(self._record(lesson), records)[2])

    def govern(self, records: list[Any], budget: int, now: float) -> int:
        """Its pass, with its usual thresholds."""
        done = self._parts["governance"].run_budgeted_governance(
            active_records=records,
            summary_records=[],
            now=_iso(now),
            max_active_records=budget,
            similarity_threshold=0.55,
            cluster_min_size=3,
            retire_failure_days=14,
        )
        return len(done["active"])

    def contradict(self, first: str, second: str) -> bool:
        """Its test of contents."""
        return bool(self._parts["conflict"].may_conflict(first, second))

    def relevance(self, query: str, text: str) -> float:
        """Its relevance of a text."""
        return float(self._parts["retrieval"].compute_text_relevance(query, text))

    @property
    def _schema(self) -> Any:
        return self._parts["schema"]

    def _store(self, folder: Path) -> Any:
        return self._parts["store"].JsonlMemoryStore(folder)

    def _record(self, lesson: PeerLesson) -> Any:
        success = lesson.status.endswith("success")
        return self._schema.MemoryRecord(
            memory_id=lesson.id,
            task_id=lesson.query,
            query=lesson.query,
            content=lesson.content,
            memory_type=lesson.type,
            # The names under which its consolidation and governance know this status.
            source_status="success" if success else "uncertain" if lesson.status == "uncertain" else "fail",
            state="active",
            confidence=lesson.confidence,
            quality_score=lesson.quality,
            created_at=_iso(lesson.created),
            use_count=lesson.usage,
            dedup_key=f"{lesson.type}:{lesson.id}",
        )


def _package(checkout: Path) -> Path:
    for place in _PLACES:
        folder = checkout.expanduser() / place
        if all((folder / f"{part}.py").is_file() for part in _PARTS):
            return folder
    raise ConfigurationError(
        f"memory.peer is '{checkout}', which contains no package {PACKAGE} with {', '.join(_PARTS)}. "
        f"Name a checkout of the released code: the repository, or the folder {PACKAGE} in it."
    )


def _load(folder: Path, part: str) -> ModuleType:
    """A module of the package under our own name, so that its parents are not imported."""
    package = sys.modules.get(_NAME)
    if package is None or list(package.__path__) != [str(folder)]:
        for name in [name for name in sys.modules if name.split(".")[0] == _NAME]:
            del sys.modules[name]
        spec = importlib.machinery.ModuleSpec(_NAME, None, is_package=True)
        spec.submodule_search_locations = [str(folder)]
        sys.modules[_NAME] = importlib.util.module_from_spec(spec)
    try:
        return importlib.import_module(f"{_NAME}.{part}")
    except ImportError as error:
        raise ConfigurationError(
            f"memory.peer is '{folder}', which cannot be imported ({error}): install what it needs."
        ) from error


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat()
