"""How often each verifier has said the same yes in a row, kept with the records so that it outlives the process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gvla2.memory.contracts import Verdict
from gvla2.memory.curation.admission import Streak, streak_of
from gvla2.memory.records import clean, load_object
from gvla2.memory.storage.events import Event
from gvla2.memory.storage.store import Transaction

LOOK_BACK = 32
"""Transactions that are read to take up the streaks where another process left them."""
_FEW, _MANY = 16, 1024
_JUDGED = frozenset({"ADD", "MERGE", "MERGED", "REPLACE", "PROVISIONAL", "DISCARD"})
"""Events that bring what a verifier just said; all others, as summaries and repairs, hand on what it said before."""


class Streaks:
    """The streaks of one bank's verifiers."""

    def __init__(self) -> None:
        self._known: dict[str, Streak] = {}
        self._rev = -1

    def follow(self, transaction: Transaction) -> None:
        """Take up what others wrote since; call it at the beginning of a transaction.

        Each verifier's last judgement counts, in the order of the events: a record that was changed since may tell of
        an earlier one, if it was only recalled, credited or archived.
        """
        last = transaction.rev - 1
        if last == self._rev:
            return
        latest: dict[str, Streak | None] = {}
        for said in _judgements(transaction, max(self._rev, last - LOOK_BACK, 0)):  # newest first
            latest.setdefault(str(said.get("verifier", "")), _streak(said))
        for name, streak in latest.items():
            if streak is not None:
                self._known[name] = streak
            else:
                self._known.pop(name, None)
        self._rev = last

    def advance(self, verdict: Verdict) -> Streak:
        """Count a verdict."""
        name = clean(verdict.verifier, 64)
        streak = streak_of(verdict, self._known.get(name))
        self._known[name] = streak
        return streak

    def seen(self, rev: int) -> None:
        """The transaction ``rev`` is known here."""
        self._rev = rev


def _judgements(transaction: Transaction, since: int) -> Iterator[dict[str, Any]]:
    """What verifiers said in transactions after ``since``, the newest first."""
    end, size = transaction.seq, _FEW
    while end > 0:
        start = max(end - size, 0)
        for event in reversed(transaction.view.events(transaction.bank, start, end - start)):
            if event.rev <= since:
                return
            if event.action in _JUDGED and (said := _said(event)) is not None:
                yield said
        end, size = start, min(2 * size, _MANY)


def _said(event: Event) -> dict[str, Any] | None:
    """The verifier's column as an event made it; None where it left it alone, was erased or is damaged."""
    try:
        change = event.change_json().get("verifier")
        return load_object(change[-1] if isinstance(change, list) else change) if change else None
    except (ValueError, TypeError, RecursionError):
        return None


def _streak(said: dict[str, Any]) -> Streak | None:
    streak = said.get("streak")
    if not isinstance(streak, dict) or not isinstance(streak.get("length"), int):
        return None
    criteria = streak.get("criteria")
    return Streak(dict(criteria) if isinstance(criteria, dict) else {}, streak["length"])
