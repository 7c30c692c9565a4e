"""An English text as clauses: the topic, direction, amount and polarity of each; and what comes before what, and what
is preferred to what. It extracts features, so a wrong guess only costs a little probability.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

from gvla2.memory.meaning.english import CONDITIONS, IDIOMS, MAX_READ, NEGATORS, SIDES, SOFT, WORD, Side
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.quantities import Quantity, quantities
from gvla2.memory.meaning.terms import STOP_WORDS, stem

Words = frozenset[str]
Order = tuple[Words, Words]

_AHEAD = re.compile(r"\b(?:before|prior to|ahead of|until|till)\b")
_BEHIND = re.compile(r"\b(?:after|once|as soon as|following)\b")
_LEAVING = re.compile(r"\b(?:rather than|instead of|in place of|not|never|don't|do|avoid)\b")
_COMMA = "xcommax"
_SENTENCE = re.compile(r"[!?;\n]+|\.(?=\s|$)")
_STEP = re.compile(
    r",?\s*\b(?:and )?then\b,?\s*|,\s+(?:and|but)\s+|\s+but\s+"
    r"|\s+and\s+(?=\w+\s+(?:the|a|an|it|them|its|each|every|all|to|by|for|at|in|into|on|with|from|after|before|lightly"
    r"|slowly|gently|only|until|afterwards?|later|next|last|first)\b)"
)
_ANY_AND = re.compile(r",?\s*\b(?:and )?then\b,?\s*|,?\s+and\s+|,\s+")
_FIRST = re.compile(r"\b(?:first|to begin with)\b")
_LATER = re.compile(r"\b(?:afterwards?|after that|later|last|next|finally|subsequently)\b")
_INSTEAD = re.compile(r"^\s*(?:rather than|instead of)\s+(?P<two>[^,]+),\s*(?P<one>.+)")
_CHOSEN = re.compile(
    r"(?P<one>.+?),?\s+(?:rather than|instead of|in place of|in preference to|and not)\s+(?P<two>.+)"
    r"|(?P<one4>.+?)\s+(?:(?:is|are|was|were|works?|worked|does|do) (?:\w+ )?better than|beats?)\s+(?P<two4>.+)"
    r"|(?:.*?\b)?(?:prefer|trust|choose|favou?r|pick)\w*\s+(?P<one2>.+?)\s+(?:over|to|before)\s+(?P<two2>.+)"
    r"|(?P<one3>.+?),\s+(?:and |but )?(?:not|never)\s+(?P<two3>.+)"
    r"|(?:do not|don't|never|avoid)\s+(?:use |take |using |taking )(?P<two5>[^,]+?)(?:,| but)\s+(?:but )?(?P<one5>.+)"
)
_NOT = re.compile(r"\b(?:not|never|don't|avoid)\b")
_CASE = re.compile(r"\s*(?:if|when|while|once|unless|after|before|until|with|without|for|in|on|at)\b")
_NEEDLESS = re.compile(
    r"\b(?:no need|need not|needn't|not (?:necessary|needed|required)|optional"
    r"|(?:don't|do not|does(?: not|n't)) (?:need|have) to)\b"
)
_SWITCHED = re.compile(
    r"\b(?:turn|switch|power|keep|leave|stay)(?:ed|s|ing)?\b(?P<what>(?: (?!on\b|off\b)[\w-]+){0,4}?) (?P<way>on|off)\b"
)


@dataclass(frozen=True)
class Clause:
    """``words`` are stems of its topic, ``sides`` its opposing words by axis, ``when`` the words of the preceding or
    following part (sides as "axis+"), ``ahead`` whether that part comes later, ``lacks`` what it does without.
    ``forbidden``: the text says not to.
    """

    words: Words
    sides: tuple[Side, ...]
    figures: tuple[Quantity, ...]
    when: Words
    ahead: bool = False
    lacks: Words = frozenset()
    forbidden: bool = False

    @cached_property
    def everything(self) -> Words:
        """Words and sides together."""
        return self.words | {side_word(*side) for side in self.sides}

    @cached_property
    def topics(self) -> Words:
        """Its topics, whatever the direction: words, axes, and what comes before or after it."""
        return self.words | self.when | {axis for axis, _ in self.sides}


@dataclass(frozen=True)
class Reading:
    """A parsed text. ``orders`` are pairs of what comes before and what after; ``choices`` of what is taken and what is
    left; ``words`` all stems.
    """

    clauses: tuple[Clause, ...]
    orders: tuple[Order, ...]
    choices: tuple[Order, ...]
    words: Words

    @cached_property
    def everything(self) -> Words:
        """Words and sides together."""
        return self.words.union(*(clause.everything for clause in self.clauses))


@lru_cache(maxsize=4096)
def read(text: str) -> Reading:
    """The reading of an English text; undefined for other languages."""
    clauses: list[Clause] = []
    orders: list[Order] = []
    choices: list[Order] = []
    plain = _SWITCHED.sub(_switched, IDIOMS.sub(" ", plain_text(text[:MAX_READ])))
    for sentence in _SENTENCE.split(plain):
        parts: list[Words] = []
        first = last = -1
        for step in _steps(sentence):
            taken, left = _choice(step)
            if taken and left:
                choices.append((content(taken), content(left)))
            clause, order = clause_of(step, left)
            clauses.append(clause)
            orders += [order] if order else []
            first = len(parts) if _FIRST.search(step) else first
            last = len(parts) if _LATER.search(step) else last
            parts.append(order[0] | order[1] if order else clause.everything)
        if len(parts) == 2 and (first > 0 or last == 0):
            parts.reverse()
        if first >= 0 or last >= 0 or "then" in sentence:
            orders += [(parts[i], later) for i in range(len(parts)) for later in parts[i + 1 :]]
    words = {word for clause in clauses for word in clause.words | clause.when}
    words |= {word for taken_, left_ in choices for word in taken_ | left_}
    return Reading(tuple(clauses), tuple(orders), tuple(choices), frozenset(words))


def _switched(found: re.Match[str]) -> str:
    return f"{'enable' if found['way'] == 'on' else 'disable'}{found['what']}"


def _steps(sentence: str) -> list[str]:
    """The statements of a sentence."""
    cut = _ANY_AND if _FIRST.search(sentence) or _LATER.search(sentence) else _STEP
    found: list[str] = []
    for step in cut.split(sentence):
        head, comma, tail = step.partition(",")
        # "Don't pull it, push it" forbids one thing and asks for another.
        two = comma and _NOT.search(head) and len(tail.split()) > 1 and not _CASE.match(head)
        found += [head, tail] if two and not _choice(step)[1] else [step]
    return [step for step in found if WORD.search(step)]


def _choice(step: str) -> tuple[str, str]:
    """What a step takes, and what it leaves; ("", "") if it does not choose."""
    found = _INSTEAD.match(step) or _CHOSEN.fullmatch(step.strip())
    groups = found.groupdict(default="") if found is not None else {}
    taken, left = ("".join(groups[name] for name in groups if name.startswith(n)) for n in ("one", "two"))
    return taken, left


def clause_of(step: str, left: str) -> tuple[Clause, Order | None]:
    """The clause of a casefolded step, and its order of events; what it leaves out (``left``) is excluded."""
    text = _LEAVING.sub(" ", step.replace(left, " ")) if left else step
    order, main, when = _ordered(text)
    main, figures = _without_figures(main)
    words, lacks, sides, negations = _sorted(main)
    forbidden = negations % 2 == 1 and _NEEDLESS.search(text) is None
    if forbidden and any(figure.one_sided for figure in figures):  # "never above 5" says "at most 5"
        figures = [figure.inverted() if figure.one_sided else figure for figure in figures]
        forbidden = False
    if forbidden and _AHEAD.search(text):  # "not before it is dry" asks for it afterwards
        order, forbidden = (order[1], order[0]) if order else None, False
    if forbidden and "unless" in text:  # "not unless it is on" asks for it when it is on
        forbidden = False
    if forbidden and lacks:  # "don't solder without flux" asks for flux
        words, lacks, forbidden = words | lacks, set(), False
    missing = frozenset(lacks | content(left))
    ahead = bool(when and order and order[1] == when)
    return Clause(frozenset(words), tuple(sides), tuple(figures), when, ahead, missing, forbidden), order


def content(text: str) -> Words:
    """The content words of a text: stems, and sides as "axis+"."""
    found: set[str] = set()
    for word in WORD.findall(_without_figures(text)[0]):
        if word not in NEGATORS and word not in CONDITIONS:
            _take(word, found, None)
    return frozenset(found)


def side_word(axis: str, sign: int) -> str:
    """A side as a word among others."""
    return f"{axis}{'+' if sign > 0 else '-'}"


def _without_figures(text: str) -> tuple[str, list[Quantity]]:
    figures, kept, last = [], [], 0
    for found in quantities(text):
        kept.append(text[last : found.start])
        figures.append(found.quantity)
        last = found.end
    return " ".join([*kept, text[last:]]), figures


def _sorted(main: str) -> tuple[set[str], set[str], list[Side], int]:
    """Words, what it does without, sides, and how many words forbid."""
    words, lacks, sides, negations, lacking = set[str](), set[str](), list[Side](), 0, False
    for word in _ended(WORD.findall(main.replace(",", f" {_COMMA} "))):
        lacking = (lacking or word == "without") and word != _COMMA
        if word in NEGATORS:
            negations += 1
        elif word not in CONDITIONS and word != "without":
            _take(word, *((lacks, None) if lacking else (words, sides)))
    return words, lacks, sides, negations


def _ended(words: list[str]) -> Iterator[str]:
    """The words; "on" and "off" at the end of a phrase are a state: "with the lights on"."""
    for word, behind in zip(words, [*words[1:], _COMMA], strict=False):
        ends = behind == _COMMA or behind in CONDITIONS
        yield {"on": "enabled", "off": "disabled"}.get(word, word) if ends else word


def _ordered(text: str) -> tuple[Order | None, str, Words]:
    """A step's order of events, its main part, and the words of the other part."""
    for pattern, ahead in ((_AHEAD, True), (_BEHIND, False)):
        found = pattern.search(text)
        if found is None:
            continue
        head, tail = text[: found.start()], text[found.end() :]
        aside, comma, rest = tail.partition(",")
        if not WORD.search(head) and not comma:
            continue
        main = head + (f" , {rest}" if rest else "") if WORD.search(head) else rest
        other, mine = content(aside), content(main)
        if quantities(aside) and (not quantities(head) or not other):
            continue  # "after 5 minutes", "they slipped until I took 8 newtons"
        if other and mine:
            return ((mine, other) if ahead else (other, mine)), main, other
    return None, text, frozenset()


def _take(word: str, words: set[str], sides: list[Side] | None) -> None:
    """File a word: under ``sides`` if it has any (under ``words`` as "axis+" if ``sides`` is None), else under
    ``words`` by its stem, else nowhere.
    """
    word = word.removesuffix("'s")
    root = stem(word)
    known = list(SIDES.get(root, ()))
    if not known and word[:2] == "un" and len(word) > 6:
        root = "un" + stem(word[2:])
        known = [(axis, -sign) for axis, sign in SIDES.get(stem(word[2:]), ())]
    if known and sides is not None:
        sides.extend(known)
    elif known:
        words |= {side_word(axis, sign) for axis, sign in known}
    elif word not in SOFT and word not in STOP_WORDS and word != _COMMA and len(word) > 1:
        words.add(root)
