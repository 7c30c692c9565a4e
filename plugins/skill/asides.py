"""Asides: what a sentence tells or asks beside its wish. Left unread, or kept only as what the wish is about."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import STOPS, noun_use
from gvla2_plugins.skill.phrases import is_content
from gvla2_plugins.skill.words import noun_class, verbs_of


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
    if said & lexicon.TURNING or _named(words):
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
        noun = noun_class(word) if word != "can" or before in lexicon.DETERMINERS else ""
        one = before == "the" and word in lexicon.SELECTORS  # "the left one"
        known = noun not in ("", "object") or word in FAMILIES or word in lexicon.CONTENTS
        if one or (known and before not in ("a", "an")):
            return True
    return False
