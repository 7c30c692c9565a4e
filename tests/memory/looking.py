"""Looking at a bank in one line, each call at an instant of its own."""

from collections.abc import Callable
from typing import Any

from gvla2.memory.candidates import Candidates
from gvla2.memory.store import Store
from gvla2.memory.view import audit


class look:  # noqa: N801  # it is used like a function
    """``look(store, "b").records()`` is what ``store.reading("b")`` has for ``records()``."""

    def __init__(self, store: Store, bank: str = "b") -> None:
        self._store, self._bank = store, bank

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*args: Any, **named: Any) -> Any:
            with self._store.reading(self._bank) as view:
                found = (
                    audit(view, *args, **named) if name == "verify" else getattr(view, name)(*args, **named)
                )
                return list(found) if name == "events" else found

        return call


def ids_of(candidates: Candidates) -> list[str]:
    """The ids of all candidates, by row."""
    return [candidates.record(row).id for row in range(len(candidates))]
