"""Words of any language: what a text is about, for ranking and for telling texts apart."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from hashlib import blake2b

from gvla2.memory.meaning.function_words import FUNCTION_WORDS

MAX_TEXT = 8192
"""What is read of a text, in characters: a query of a megabyte costs no more than one of a page."""
MAX_WORD = 64
"""Longer words (encoded data, mostly) count by their beginning."""

LONG = 6
"""Topic words from which on the clauses of a query are looked at one by one."""
MAX_SENTENCES = 8
_SENTENCE = re.compile(r"[.;!?](?=\s|$)|[\n。；！？]")
_NO_TOPIC = FUNCTION_WORDS | frozenset("0123456789")
_WORD = re.compile(r"\w+")
# Scripts that put no spaces between words: Thai, Lao, Khmer, Myanmar, kana, Han.
_UNSPACED = re.compile(
    r"[\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u3040-\u30ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff]+"
)


def tokens(text: str) -> list[str]:
    """Casefolded words in reading order, of the first ``MAX_TEXT`` characters.

    Scripts without spaces give their character pairs.
    """
    text = text[:MAX_TEXT]
    if text.isascii():
        return [word[:MAX_WORD] for word in _WORD.findall(text.lower())]
    found: list[str] = []
    text = unicodedata.normalize("NFKC", text).casefold()
    if _UNSPACED.search(text) is None:
        return [word[:MAX_WORD] for word in _WORD.findall(text)]
    for word in _WORD.findall(text):
        rest = 0
        for run in _UNSPACED.finditer(word):
            found += [word[rest : run.start()][:MAX_WORD]] if run.start() > rest else []
            letters = run.group()
            found += [letters[i : i + 2] for i in range(max(len(letters) - 1, 1))]
            rest = run.end()
        found += [word[rest:][:MAX_WORD]] if rest < len(word) else []
    return found


def topic_words(text: str) -> list[str]:
    """The tokens that carry a topic: function words and single digits are left out."""
    return _topical(tokens(text), text.isascii())


@lru_cache(maxsize=16)
def distinct_topics(text: str) -> tuple[str, ...]:
    """The distinct topic words of a query, sorted; several ask for them one after the other."""
    return tuple(sorted(set(topic_words(text))))


@lru_cache(maxsize=16)
def distinct_topics_by_sentence(text: str) -> tuple[tuple[str, ...], ...]:
    """:func:`distinct_topics` of the sentences of a longer query that have two or more; () where there is but one.

    Whoever instructs tells of circumstances too ("The guests come at seven; set the table."), which records that know
    what to do do not share.
    """
    if len(distinct_topics(text)) < LONG:
        return ()
    parts = [topics for part in _SENTENCE.split(text) if len(topics := distinct_topics(part)) > 1]
    return tuple(dict.fromkeys(parts))[:MAX_SENTENCES] if len(parts) > 1 else ()


def _topical(words: Iterable[str], plain: bool) -> list[str]:
    if plain:
        return [word for word in words if word not in _NO_TOPIC]
    return [word for word in words if word not in FUNCTION_WORDS and not (len(word) == 1 and word.isdigit())]


def read_once(query: str, content: str) -> tuple[list[str], int]:
    """The topic words of :func:`text_of`, and the :func:`wording` of the content, quicker than one by one."""
    said = tokens(content)
    plain = query.isascii() and content.isascii()
    if len(query) + 1 + len(content) > MAX_TEXT:
        return topic_words(text_of(query, content)), _number(said)
    # No word reaches across the space between them.
    return _topical(tokens(query) + said, plain), _number(said)


def text_of(query: str, content: str) -> str:
    """The text of a record that is searched and embedded: its instructions and what it says."""
    return f"{query} {content}"


def wording(content: str) -> int:
    """A number that is equal for contents of the same words, whatever their order, case and punctuation."""
    return _number(tokens(content))


def _number(said: Iterable[str]) -> int:
    words = "\n".join(sorted(set(said))).encode("utf-8", "surrogatepass")
    return int.from_bytes(blake2b(words, digest_size=8).digest(), "little", signed=True)
