"""Noun phrases: "the left red block next to the cup" as class, colour, selectors and landmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from gvla2.planning.colours import COLOURS, FAMILIES, first_colour
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.words import noun_class


@dataclass(frozen=True)
class Phrase:
    """What a noun phrase asks for: ``noun`` is a class of the lexicon, "" when no noun was understood; ``unknown`` are
    its words that are in no list; ``colour`` a colour word of perception or ""; ``selectors`` single one out
    ("left", "big"); ``landmark`` places it at another thing; ``owner`` is what it is a part of; ``pronoun``: it
    stands for what was named before; ``kinds`` are nouns before the noun that say which kind of it is meant
    ("knife" of a knife block); ``stands``: it is already where the landmark says.
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
    stands: bool = False

    @property
    def empty(self) -> bool:
        """It names nothing at all, not even by a pronoun."""
        return not (self.noun or self.colour or self.unknown or self.pronoun or self.selectors)

    @property
    def everywhere(self) -> bool:
        """It names the table, the air or the robot's own hand."""
        return not self.noun and not self.colour and bool(lexicon.TABLE_WORDS & set(self.text.split()))


def read_phrase(tokens: Sequence[str], selectors: Sequence[str] = ()) -> Phrase:
    """The phrase of ``tokens``, from which relations and the given ``selectors`` were taken out before."""
    if "of" in tokens:  # the button of the lamp, the centre of the square
        cut = tokens.index("of")
        thing, whole = read_phrase(tokens[:cut], selectors), read_phrase(tokens[cut + 1 :], selectors)
        if thing.noun == "object" and whole.noun and not thing.unknown:  # "the middle one of the pegs"
            return replace(whole, text=" ".join(tokens), colour=thing.colour or whole.colour)
        if thing.noun and whole.noun:
            return replace(thing, text=" ".join(tokens), owner=whole)
        if whole.noun and {*thing.unknown} - {"hold"} and tokens[0] != "the":  # "a photo of the cube"
            return replace(thing, text=" ".join(tokens))
        return whole if whole.noun or not thing.noun else thing
    colour, rest = _colour([t for t in tokens if t != "'s"])  # "the lamp's button" is the lamp button
    nouns = [(i, noun) for i, pair in enumerate(pairwise(("", *rest))) if (noun := noun_after(*pair))]
    specific = [pair for pair in nouns if pair[1] != "object"] or nouns
    noun = specific[-1][1] if specific else ""
    after = rest[specific[-1][0] + 1 :] if specific else []
    after = [t for t in after if is_content(t) and noun_class(t) != "object"]
    if after and noun != "object":  # a lamp shade is a shade, and it is not known what that is
        nouns, specific, noun = [], [], ""
    taken = {i for i, _ in nouns}
    unknown = tuple(t for i, t in enumerate(rest) if i not in taken and is_content(t))
    pronoun = not (noun or unknown or colour) and bool(lexicon.PRONOUNS & set(tokens))
    kinds = tuple(rest[i] for i, kind in specific[:-1] if kind != noun)
    return Phrase(" ".join(tokens), noun, colour, unknown, tuple(selectors), None, None, pronoun, kinds)


def noun_after(before: str, word: str) -> str:
    """The class of a word that is a noun here, or ""; "can" is one only after an article."""
    return noun_class(word) if word != "can" or before in lexicon.DETERMINERS else ""


def is_content(token: str) -> bool:
    """Whether a word says something of a thing, known or not."""
    dull = lexicon.FILLERS | lexicon.WISHING | lexicon.SHINING | lexicon.TABLE_WORDS
    dull |= lexicon.DETERMINERS | lexicon.PRONOUNS
    return token.isalpha() and token not in dull and token not in lexicon.NUMBERS


def _colour(tokens: Sequence[str]) -> tuple[str, list[str]]:
    """The first colour word of a phrase, and the tokens without it; "dark red" is "maroon"."""
    if (found := first_colour(tokens)) is None:
        return "", list(tokens)
    begin, end, said = found
    shades = () if said in COLOURS else FAMILIES[said]
    return shades[0] if len(shades) == 1 else said, [*tokens[:begin], *tokens[end:]]
