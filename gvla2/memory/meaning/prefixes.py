"""Words that a prefix turns into their opposite: "encrypted" and "unencrypted", "visser" and "dévisser"."""

from __future__ import annotations

import re

from gvla2.memory.meaning.word_sets import word_set

_ADJECTIVE = (
    r"\w\w+(?:ble|bel|te|t[io]|[ae]nt[eo]?|ct[eo]?|ve|vo|if|iv|id[eo]?|al|ell|el|il|ure|ur|ar|it[eo]|iz\w*)"
)
_REVERSING = re.compile(
    r"un-?\w{4,}|non-?\w{4,}|mis\w{5,}"
    r"|dis-?(?!(?:play|card|cover|patch|tribut|count|pose|place|solve|cuss|turb|pute)\w*$)\w{3,}"
    r"|de-?(?:\w{3,}(?:i[sz]e?|ate?|code|compress|crypt|couple|select|register|frost|press?urise|mount)"
    r"|activ\w+|aktiv\w+|mont\w+)"
    rf"|(?:in|im|il|ir)-?{_ADJECTIVE}"
    r"|ent(?:laden|riegel\w+|sperr\w+|kuppel\w+|kopp\w+|spann\w+|lüft\w+|koppel\w+)"
    # French and Spanish have as many words in which the prefix reverses nothing: "déplacer", "describir".
    r"|dés?(?:viss|branch|mont|connect|bloqu|verrouill|activ|charg|gel|coll|roul|pli|serr|gonfl|couvr|install|enclench"
    r"|chiffr|compress|boutonn|boucl|nou|ball|cod|équilibr|emball|accoupl|ordonn)\w*"
    r"|des(?:atornill|atasc|mont|conect|activ|bloque|carg|congel|enroll|pleg|pli|embal|empaquet|tap|infl|instal|encaj"
    r"|acopl|at|abroch|cifr|comprim|habilit|aceler|equilibr|cubr|orden|hac|arm|sell)\w*"
    r"|[不未非无]\w+"
)
_PREFIX = re.compile(r"(?:un|non|mis|dis|des|de|dés|dé|ent|in|im|il|ir|[不未非无])-?")
_WORDS_OF_THEIR_OWN = word_set(
    "under until unless union unit unique uniform undergo understand input inside intake inform import improve "
    "impose invent invest instruct intend intent instance install increase include index"
)


def reverses(first: str, second: str) -> bool:
    """Whether one of two words (stems, casefolded) is the other behind a prefix that turns it into its opposite."""
    short, long = (first, second) if len(first) < len(second) else (second, first)
    if not long.endswith(short[1:]) or long in _WORDS_OF_THEIR_OWN or _REVERSING.fullmatch(long) is None:
        return False
    return any(long[:match] + short == long for match in _cuts(long))


def _cuts(word: str) -> list[int]:
    return [
        length
        for length in (1, 2, 3, 4)
        if (found := _PREFIX.fullmatch(word[:length])) is not None and found.end() == length
    ]
