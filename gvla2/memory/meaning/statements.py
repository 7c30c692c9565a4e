"""What a lesson says, taken apart far enough to be compared: its clauses, and what comes before what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

from gvla2.memory.meaning.clauses import Clause, Order, clause_of
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.sentences import (
    asserted,
    in_order,
    is_sequence,
    pieces_of,
    sentences_of,
    signs_of,
    steps_of,
)
from gvla2.memory.meaning.word_forms import Language, language_of

MAX_READ = 2000
"""Characters of a lesson that are compared."""


@dataclass(frozen=True)
class Statement:
    """A lesson's clauses, what it says comes before what, and what is to be preferred to what.

    ``soft`` are the words that say nothing about who does what, see :class:`~gvla2.memory.meaning.clauses.Clause`.
    """

    clauses: Sequence[Clause]
    orders: Sequence[Order]
    choices: Sequence[Order]
    language: Language = ""
    soft: frozenset[str] = frozenset()

    @cached_property
    def items(self) -> frozenset[str]:
        """The words, circumstances and sides of all clauses."""
        return frozenset().union(*[clause.items for clause in self.clauses])


@lru_cache(maxsize=8192)
def read(text: str) -> Statement:
    """The statement of a text; the same text always gives the same."""
    plain = plain_text(text[:MAX_READ])
    signs = signs_of(plain)
    plain = in_order(plain) if signs.orders else plain
    language = language_of(signs.words)
    clauses: list[Clause] = []
    orders: list[Order] = []
    choices: list[Order] = []
    soft: set[str] = set()
    for sentence in sentences_of(plain):
        needless = False
        if signs.negates:
            sentence, needless = asserted(sentence)
        made: list[Clause] = []
        for number, (piece, is_reason) in enumerate(pieces_of(sentence, signs)):
            for part in steps_of(piece, signs):
                clause, order = clause_of(part, language, signs.replaces)
                soft |= clause.soft
                clause.pronoun |= number > 0 and not is_reason
                clause.open = needless or is_reason
                if not is_reason:
                    made.append(clause)
                elif clause.words or clause.context:
                    clauses.append(clause)
                if order is not None:
                    orders.append(order)
        if signs.negates or signs.replaces:
            choices += [(a.items, b.items) for a, b in pairwise(made) if b.forbidden and not a.forbidden]
        if len(made) > 1 and signs.orders and is_sequence(sentence):
            for first, second in pairwise(made):
                orders.append((first.items, second.items))
            for clause in made:
                clause.phase |= frozenset().union(*[other.items for other in made if other is not clause])
        clauses += [clause for clause in made if clause.words or clause.context or clause.poles]
    return Statement(tuple(clauses), _whole(orders), _whole(choices), language, frozenset(soft))


def _whole(pairs: Sequence[Order]) -> tuple[Order, ...]:
    return tuple(pair for pair in pairs if pair[0] and pair[1])
