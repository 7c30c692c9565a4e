"""How often each verifier has said the same yes in a row, kept with the records so that it outlives the process."""

from __future__ import annotations

from gvla2.memory.contracts import Verdict
from gvla2.memory.curation.admission import Streak, streak_of
from gvla2.memory.storage.store import Transaction

LOOK_BACK = 32
"""Transactions that are read to take up the streaks where another process left them."""


class Streaks:
    """The streaks of one bank's verifiers."""

    def __init__(self) -> None:
        self._known: dict[str, Streak] = {}
        self._rev = -1

    def follow(self, transaction: Transaction) -> None:
        """Take up what others wrote since; call it at the beginning of a transaction."""
        last = transaction.rev - 1
        if last == self._rev:
            return
        since = max(self._rev, last - LOOK_BACK, 0)
        for change in transaction.view.changes(transaction.bank, since):  # oldest first
            if change.forgotten:
                continue
            said = change.record.verifier_json()
            name, streak = str(said.get("verifier", "")), said.get("streak")
            if isinstance(streak, dict) and isinstance(streak.get("length"), int):
                self._known[name] = Streak(dict(streak.get("criteria", {})), streak["length"])
            elif said.get("verifier") is not None:
                self._known.pop(name, None)
        self._rev = last

    def advance(self, verdict: Verdict) -> Streak:
        """Count a verdict."""
        name = verdict.verifier[:64]
        streak = streak_of(verdict, self._known.get(name))
        self._known[name] = streak
        return streak

    def seen(self, rev: int) -> None:
        """The transaction ``rev`` is known here."""
        self._rev = rev
