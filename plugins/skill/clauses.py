"""Clauses: where a sentence is cut, and which of its parts ask for nothing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.phrases import is_content, noun_after
from gvla2_plugins.skill.words import noun_class, take_length, verbs_of

STOPS = frozenset(",.;:!?")
ANDS = ("and", "then", "but", "while")
LONGEST = 6

Clause = tuple[list[str], str, bool]
"""Words between two cuts; the cut before them ("", "and", "stop", or "verb" where another verb begins); and whether a
negation follows, so that what they only name ("the blue one must not be lifted") is nothing to act on."""


def wishes(tokens: Sequence[str], known: frozenset[str]) -> list[str]:
    """The tokens without asides, and with no more of statements and questions than the thing that they name.

    ``known`` are the words of the scene's labels.
    """
    kept: list[str] = []
    for words, stop in _segments(tokens):
        aimed = {"on", "onto", "into"} & {*kept}  # "it belongs on it, so get it there"
        if words[0] == "so" and words[1:] and not aimed:
            kept, words = [*_topic(kept, known), ","], words[1:]  # "we are to have some wine, so open it"
        since = (i for i, word in enumerate(words) if i and word in lexicon.SINCE and _aside(words[i:]))
        words = words[: next(since, None)]  # "open it for Nan"
        if _aside(words):
            words = [] if _acts(kept) else _sought(words, stop)
        elif _tells(words, stop):
            words = _topic(words, known) or ([] if _acts(kept) else _sought(words, stop))
        kept += [*words, stop]
    return [t for i, t in enumerate(kept) if t and (t not in STOPS or (i and kept[i - 1] not in STOPS))]


def _segments(tokens: Sequence[str]) -> list[tuple[list[str], str]]:
    """The words between stops, each with the stop after it."""
    found: list[tuple[list[str], str]] = [([], "")]
    for token, following in pairwise([*tokens, ""]):
        if token in STOPS or (token in ("and", "but") and following in lexicon.SUBJECTS):
            found[-1] = (found[-1][0], token)
            found.append(([], ""))
        else:
            found[-1][0].append(token)
    return [(words, stop) for words, stop in found if words]


def _aside(words: Sequence[str]) -> bool:
    """Whether it holds no wish, nothing that turns or delays one, and nothing of the scene."""
    said = set(words)
    if said & lexicon.TURNING or _named(words) or take_length([*words])[1] is not None:
        return False
    denies = words[: words.index("not")] if "not" in said else ["i"]
    if not {"i", "i'm", "we", "we're", "my", "our"} & set(denies) and denies != ["can"]:
        return False
    if words[0] in lexicon.SUBJECTS | lexicon.SINCE:
        return True
    follows = {*words[1:2]} & (lexicon.DETERMINERS | lexicon.PRONOUNS | {"me", "us"})
    return not _acts(words) and not (follows and is_content(words[0]))  # "decant it"


def _tells(words: Sequence[str], stop: str) -> bool:
    """Whether it says how things are or were, or asks that: no wish, whatever verbs are in it."""
    said = set(words)
    if lexicon.REPORTING.search(" ".join(words)):
        return True
    if said & lexicon.CONDITIONS and "remember" not in said:
        return False
    if lexicon.ASKED_OF & said and lexicon.MODALS & said:
        return False
    if words[0] in lexicon.ASKED and (stop == "?" or words[0] in lexicon.BEING - {"has", "have"}):
        return True
    wishing = lexicon.WISHING - lexicon.BEING | {"to"}
    if not (acts := _acts(words)):
        where = wishing | lexicon.PLACES | {"that"}
        return stop == "?" or (bool(said & lexicon.BEING) and not said & where)
    before = set(words[: acts[0]])
    if before & {"too", "stop", "stopped", "thanks", "hope", "remember"}:
        return True
    if before & (wishing | lexicon.MODALS):
        return False
    told = before and (words[0] in lexicon.SUBJECTS or before & lexicon.BEING)
    return bool(told) or (stop == "?" and not lexicon.MODALS & said and acts[0] == 0)


def _acts(words: Sequence[str]) -> list[int]:
    return [i for i, word in enumerate(words) if verbs_of(word) and not noun_use(words, i)]


def _topic(words: Sequence[str], known: frozenset[str]) -> list[str]:
    """The first thing that is named, with its article and colour."""
    naming = known - set(FAMILIES) | set(lexicon.CONTENTS)
    nouns = [i for i, word in enumerate(words) if noun_class(word) or word in naming]
    nouns = [i for i in nouns if words[i] != "can" or noun_use(words, i)]
    if not nouns:
        return []
    begun = next((i for i, word in enumerate(words) if word in lexicon.BEING), 0)
    if words[0] in ("the", "my") and nouns[0] > begun > 0 and not lexicon.HAND & {*words[:begun]}:
        return list(words[:begun])  # "my boots are by the box, pass me them": the box is not meant
    begin = end = next((i for i in nouns if noun_class(words[i]) != "object"), nouns[0])
    while begin and (words[begin - 1] in FAMILIES or words[begin - 1] in lexicon.DETERMINERS):
        begin -= 1
    return list(words[begin : end + 1])


def _sought(words: Sequence[str], stop: str) -> list[str]:
    """What is asked or looked for, known or not: "it" in the wish that follows is that, and nothing else."""
    begin = max((i for i, word in enumerate(words) if word in lexicon.DETERMINERS), default=len(words))
    return list(words[begin:]) if stop == "?" or lexicon.SEEKING & set(words) else []


def _named(words: Sequence[str]) -> bool:
    """Whether something is named that may be in the scene: by a noun, a colour or a side, but not "a tower"."""
    for before, word in pairwise(("", *words)):
        noun = noun_after(before, word)
        one = before == "the" and word in lexicon.SELECTORS  # "the left one"
        known = noun not in ("", "object") or word in FAMILIES or word in lexicon.CONTENTS
        if one or (known and before not in ("a", "an")):
            return True
    return False


def clauses(tokens: Sequence[str]) -> tuple[list[Clause], list[tuple[str, ...]]]:
    """Clauses, parted at stops, "and", "by pushing", "to press"; and the words of what is not to be done or meant."""
    pieces: list[tuple[str, list[str]]] = [("", [])]
    for i, token in enumerate(tokens):
        joint, words = pieces[-1]
        cut = "stop" if token in STOPS else "not" if _negates(tokens, i) else "and" if token in ANDS else ""
        if cut or (joint != "not" and _verb_follows(tokens, i)):
            pieces.append((cut or "verb", []))
        else:
            words.append(token)
    found, denials = [], []
    for (joint, words), (following, _) in pairwise([*pieces, ("", [])]):
        denied = following == "not"
        if joint == "not":
            denials += [tuple(words)] if words or not denied else []
        elif words and not (denied and _ruled_out(words)):
            found.append((words, joint, denied))
    return found, denials


def _verb_follows(tokens: Sequence[str], i: int) -> bool:
    """Whether another verb begins after the word at ``i``: "by pushing", "to press"."""
    following = "".join(tokens[i + 1 : i + 2])
    joins = tokens[i] in ("to", "so") or (tokens[i] in ("by", "through") and following.endswith("ing"))
    return joins and bool(verbs_of(following)) and not noun_use(tokens, i + 1)


def _negates(tokens: Sequence[str], i: int) -> bool:
    """Whether from ``i`` on it is said what is not meant: "without", "do not", "any cube but"."""
    among = tokens[i] == "but" and lexicon.EACH & set(tokens[:i])
    return bool(among or phrase_at(tokens, i, lexicon.NEGATIONS))


def phrase_at(tokens: Sequence[str], i: int, phrases: Collection[str]) -> str:
    """The longest of ``phrases`` that stands at position ``i``, or ""; none has more than ``LONGEST`` words."""
    spans = (" ".join(tokens[i : i + n]) for n in range(LONGEST, 0, -1))
    return next((span for span in spans if span in phrases), "")


def noun_use(tokens: Sequence[str], i: int) -> bool:
    """Whether a word that can be verb or noun is a noun here: after an article, a colour or an adjective."""
    before = tokens[i - 1] if i else ""
    if before in ("this", "that", "another", "s", "single"):
        return bool(noun_class(tokens[i]))
    selects = any(before in words for words in lexicon.SELECTORS.values())
    return selects or before in lexicon.DETERMINERS or before in FAMILIES or before == "'s"


def _ruled_out(words: Sequence[str]) -> bool:
    """Whether what follows is denied of a thing ("the box is not ..."), not of which thing is meant ("that is not")."""
    return words[-1] in lexicon.BEING and words[-2:-1] not in (["that"], ["which"], ["who"])
