"""Noun phrases: "the left red block next to the cup" as class, colour, selectors and landmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.words import noun_class


@dataclass(frozen=True)
class Phrase:
    """What a noun phrase asks for.

    ``noun`` is a class of the lexicon, "" when no noun was understood; ``unknown`` are its words that are in no
    list; ``colour`` a colour word of perception or ""; ``selectors`` single one out ("left", "big"); ``landmark``
    places it at another thing; ``owner`` is what it is a part of; ``pronoun``: it stands for what was named before;
    ``kinds`` are nouns before the noun that say which kind of it is meant ("knife" of a knife block).
    """

    text: str
    noun: str = ""
    colour: str = ""
    unknown: tuple[str, ...] = ()
    selectors: tuple[str, ...] = ()
    landmark: tuple[str, Phrase] | None = None
    owner: Phrase | None = None
    pronoun: bool = False
    kinds: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """It names nothing at all, not even by a pronoun."""
        return not (self.noun or self.colour or self.unknown or self.pronoun or self.selectors)

    @property
    def everywhere(self) -> bool:
        """It names the table, the air or the robot's own hand."""
        words = self.text.split()
        return not self.noun and not self.colour and any(w in lexicon.TABLE_WORDS for w in words)


def read_phrase(tokens: Sequence[str], selectors: Sequence[str] = ()) -> Phrase:
    """The phrase of ``tokens``, from which relations and the given ``selectors`` were taken out before."""
    if "'s" in tokens:  # the lamp's button
        cut = tokens.index("'s")
        after = read_phrase(tokens[cut + 1 :], selectors)
        if after.noun or after.unknown:
            return _with_owner(after, read_phrase(tokens[:cut]), tokens)
        tokens = [*tokens[:cut], *tokens[cut + 1 :]]
    if "of" in tokens:  # the button of the lamp, the centre of the square
        cut = tokens.index("of")
        before, after = read_phrase(tokens[:cut], selectors), read_phrase(tokens[cut + 1 :], selectors)
        if before.noun and after.noun:
            return _with_owner(before, after, tokens)
        return after if after.noun or not before.noun else before
    colour, rest = _colour(tokens)
    nouns = [(i, noun_class(t)) for i, t in enumerate(rest) if _is_noun(rest, i, bool(colour))]
    specific = [pair for pair in nouns if pair[1] != "object"] or nouns
    noun = specific[-1][1] if specific else ""
    said = lexicon.WISHING | lexicon.SHINING
    after = [t for t in rest[specific[-1][0] + 1 :] if _is_content(t) and t not in said] if specific else []
    if after and noun != "object":  # a lamp shade is a shade, and it is not known what that is
        nouns, specific, noun = [], [], ""
    owner = None
    before = specific[:-1]
    if before and (noun in lexicon.PARTS or lexicon.OWNERS.get(before[0][1]) == noun):  # the lamp button
        owner = Phrase(rest[before[0][0]], before[0][1]) if before[0][1] != noun else None
    taken = {i for i, _ in nouns}
    unknown = tuple(t for i, t in enumerate(rest) if i not in taken and _is_content(t))
    bare = not (noun or unknown or colour)
    return Phrase(
        text=" ".join(tokens),
        noun=noun,
        colour=colour,
        unknown=unknown,
        selectors=tuple(selectors),
        owner=owner,
        pronoun=bare and any(t in lexicon.PRONOUNS for t in tokens),
        kinds=tuple(rest[i] for i, kind in before if kind != noun and owner is None),
    )


def _with_owner(part: Phrase, owner: Phrase, tokens: Sequence[str]) -> Phrase:
    return Phrase(
        " ".join(tokens), part.noun, part.colour, part.unknown, part.selectors, part.landmark, owner, False
    )


def _is_noun(tokens: Sequence[str], i: int, coloured: bool) -> bool:
    """Whether the word is used as a noun here; "can" is one only after an article or an adjective."""
    if not noun_class(tokens[i]):
        return False
    if tokens[i] != "can":
        return True
    return coloured or (i > 0 and tokens[i - 1] in lexicon.DETERMINERS)


def _is_content(token: str) -> bool:
    dull = lexicon.FILLERS | lexicon.DETERMINERS | lexicon.PRONOUNS | lexicon.TABLE_WORDS
    return token.isalpha() and token not in dull and token not in lexicon.NUMBERS


def _colour(tokens: Sequence[str]) -> tuple[str, list[str]]:
    """The first colour of a phrase, two-word shades first, and the tokens without it."""
    plain = [lexicon.COLOUR_WORDS.get(t, t) for t in tokens]
    for i in range(len(plain) - 1):
        if shade := lexicon.SHADES.get((plain[i], plain[i + 1])):
            return shade, [*tokens[:i], *tokens[i + 2 :]]
    for i, word in enumerate(plain):
        if tokens[i] in lexicon.COLOUR_WORDS:
            return word, [*tokens[:i], *tokens[i + 1 :]]
    return "", list(tokens)
