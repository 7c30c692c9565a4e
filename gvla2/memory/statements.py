"""What a lesson says, taken apart far enough to be compared: who does what, how much, which way, or not at all."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise

from gvla2.memory.function_words import FUNCTION_WORDS
from gvla2.memory.lexicon import (
    AFTER,
    BEFORE,
    CONCEPTS,
    CONDITIONS,
    DETERMINERS,
    FIRST,
    IDENTIFIERS,
    NEGATORS,
    PARTICLE_VERBS,
    PLACES,
    POLES,
    SEGMENTS,
    SOFT,
    STAYING,
    THEN,
    TURNING,
)
from gvla2.memory.quantities import Quantity, quantities
from gvla2.memory.word_forms import starts_of

MAX_READ = 2000
"""Characters of a lesson that are compared."""

IDIOMS = re.compile(
    r"\b(?:do not|don't|never) (?:forget|hesitate|fail|omit|neglect)\b(?: to)?|\bnot only\b|\bno doubt\b|\bnot just\b"
    r"|\b(?:vergiss|vergessen sie) nicht,?|\bnicht vergessen,?(?: zu)?|\bnicht nur\b|\bzögere nicht,?"
    r"|\bn[’']oublie[zr]? pas(?: de| d[’'])?|\bn[’']hésite[zr]? pas(?: à)?"
    r"|\bne manque[zr]? pas(?: de)?|\bpas seulement\b"
    r"|\bno (?:te )?olvid(?:es|e|ar)(?: de)?|\bno dud(?:es|e)(?: en)?|\bno (?:solo|sólo)\b"
    r"|别忘了|不要忘记|别忘记|不妨|不仅"
)
"""Negations that forbid nothing."""
_NEEDLESS = re.compile(
    r"\bno need\b|\bneed not\b|\bneedn't\b|\bnot (?:necessary|needed|required)\b|\bdon't (?:need|have) to\b"
    r"|\bdo not (?:need|have) to\b|\bnot enough\b|\bnicht genug\b|\bne suffit pas\b|\bno basta\b"
    r"|\bnicht nötig\b|\bpas (?:nécessaire|besoin)\b|\bno (?:es necesario|hace falta)\b|不必|无需|不需要"
)
_MAY_NEGATE = (
    "not", "no ", "n'", "n’", "need", "never", "nicht", "ne ", "vergiss", "vergess", "pas", "别", "不", "无",
)  # fmt: skip
"""What any idiom and any needlessness has in it: most sentences have none of it, and need not be searched for them."""
_DOUBLE = re.compile(
    r"\b(?:do not|don't|never|cannot|nicht|nie|niemals)\b(?=.*\b(?:without|ohne)\b)"
    r"|\bne\b(?=.*\bsans\b)|\b(?:no|nunca)\b(?=.*\bsin\b)"
)
_ASIDE = re.compile(r"\([^()\d]*\)")
_SENTENCE = re.compile(r"[!?;\n。！？；]+|\.(?=\s|$)")
_SPEED_UP = re.compile(r"\bspeed(s|ing)? up\b")
_AGAINST_CLOCK = re.compile(
    r"\b(?:gegen den|entgegen dem) uhrzeigersinn\b|\bcounter[- ]clockwise\b|\banti[- ]clockwise\b"
)
_WORD = re.compile(r"[^\W_]+(?:['’_][^\W_]+)*|,")
_HAN = re.compile(r"[\u3400-\u9fff]+")
_SEGMENT_LENGTHS = sorted({len(word) for word in SEGMENTS}, reverse=True)
_NOT_CLAUSE = re.compile(
    r",\s*(?=(?:and |but )?(?:not|never|nicht|nie|pas|no|不要|别|而不)\b)"
    r"|\b(?=(?:instead of|rather than|anstatt|statt|au lieu)\b)"
)
_INSTEAD = re.compile(r"\b(?:instead of|rather than|anstatt|statt|au lieu de|en lugar de)\b")
_REPLACING = ("instead", "rather", "statt", "lieu", "lugar")
"""What any of the words before what is replaced has in it."""
_ORDERED = "#order"
_FAR_BOUND = re.compile(r"(?P<low>至少|最少|不少于|不低于)|至多|最多|不超过|不高于")


@dataclass
class Clause:
    """One act: its ``words`` (concepts), ``context`` (circumstances), ``poles`` (axis -> sides), ``figures``.

    ``forbidden`` when the text says not to; ``open`` when it says that it need not be done.
    """

    words: set[str] = field(default_factory=set)
    context: set[str] = field(default_factory=set)
    poles: dict[str, list[int]] = field(default_factory=dict)
    figures: list[Quantity] = field(default_factory=list)
    labels: set[str] = field(default_factory=set)
    forbidden: bool = False
    open: bool = False

    @cached_property
    def matter(self) -> frozenset[str]:
        """Words and circumstances together; to be asked for when the clause is complete."""
        return frozenset(self.words | self.context)

    @cached_property
    def starts(self) -> frozenset[str]:
        """How the words of the complete clause begin, see :func:`gvla2.memory.word_forms.starts_of`."""
        return starts_of(self.matter)

    @cached_property
    def sides(self) -> dict[str, frozenset[int]]:
        """The clause's sides by axis, without the order of its parts; when the clause is complete."""
        return {axis: frozenset(signs) for axis, signs in self.poles.items() if axis != _ORDERED}


@dataclass(frozen=True)
class Statement:
    """A lesson's clauses, and what it says comes before what."""

    clauses: Sequence[Clause]
    orders: Sequence[tuple[frozenset[str], frozenset[str]]]


@lru_cache(maxsize=8192)
def read(text: str) -> Statement:
    """The statement of a text; the same text always gives the same."""
    plain = unicodedata.normalize("NFKC", text[:MAX_READ]).casefold().replace("’", "'")
    plain = _SPEED_UP.sub("accelerate", plain) if "speed" in plain else plain
    plain = _ASIDE.sub(" ", plain) if "(" in plain else plain
    plain = _AGAINST_CLOCK.sub("counterclockwise", plain) if "clock" in plain or "uhrz" in plain else plain
    clauses: list[Clause] = []
    orders: list[tuple[frozenset[str], frozenset[str]]] = []
    for sentence in _SENTENCE.split(plain):
        if not sentence.strip():
            continue
        negates = _has_any(_MAY_NEGATE, sentence)
        needless = negates and _NEEDLESS.search(sentence) is not None
        sentence = _DOUBLE.sub(" ", IDIOMS.sub(" ", sentence) if negates else sentence)
        pieces = (
            _NOT_CLAUSE.split(sentence) if "," in sentence or _has_any(_REPLACING, sentence) else [sentence]
        )
        parts = [part for piece in pieces for part in _steps(piece)]
        made: list[Clause] = []
        for part in parts:
            clause, order = _clause(part)
            clause.open = needless
            made.append(clause)
            if order is not None:
                orders.append(order)
        if len(made) > 1 and _is_sequence(sentence):
            for first, second in pairwise(made):
                orders.append((_items(first), _items(second)))
        clauses += [clause for clause in made if clause.matter or clause.poles]
    return Statement(tuple(clauses), tuple(order for order in orders if order[0] and order[1]))


_THEN = re.compile(
    r",?\s*(?:\band\b|\bund\b|\bet\b|\by\b)?\s*(?:"
    + "|".join(
        rf"\b{re.escape(w)}\b" if w.isascii() or not _HAN.match(w) else re.escape(w) for w in sorted(THEN)
    )
    + r")\s*"
)
_ACTS = "|".join(
    sorted(
        re.escape(w)
        for w, c in CONCEPTS.items()
        if not _HAN.match(w)
        and (
            c.endswith(("+", "-"))
            or c in ("grasp", "turn", "place", "go", "check", "touch", "press", "wait", "cook", "run")
        )
    )
)
_MAY_AND = re.compile(r"\s(?:and|und|et|y)\s|[\u3400-\u9fff],")
_AND = re.compile(rf",?\s+(?:and|und|et|y)\s+(?=(?:{_ACTS})\b)|(?<=[\u3400-\u9fff]),")


def _is_sequence(sentence: str) -> bool:
    if _has_any(("first", "zuerst", "先", "primero"), sentence):
        return True
    return _has_any(THEN, sentence) and _THEN.search(sentence) is not None


def _steps(text: str) -> list[str]:
    steps = _THEN.split(text) if _has_any(THEN, text) else [text]
    return [
        part
        for step in steps
        for part in (_AND.split(step) if _MAY_AND.search(step) else [step])
        if part and part.strip()
    ]


def _has_any(words: Iterable[str], text: str) -> bool:
    """Quicker than a pattern that would say the same."""
    return any(map(text.__contains__, words))


def _clause(text: str) -> tuple[Clause, tuple[frozenset[str], frozenset[str]] | None]:
    clause = Clause(forbidden=_has_any(_REPLACING, text) and bool(_INSTEAD.search(text)))
    words = _words(_without_figures(text, clause))
    main, side = _sort(words, clause)
    order = None
    if side is not None:
        relation, rest = side
        ahead, behind = frozenset(main), frozenset(rest)
        order = (ahead, behind) if relation == "before" else (behind, ahead)
        clause.poles.setdefault(_ORDERED, []).append(1 if relation == "before" else -1)
    if clause.forbidden and any(figure.one_sided for figure in clause.figures):
        # "never above 5" says "at most 5".
        clause.figures = [figure.inverted() if figure.one_sided else figure for figure in clause.figures]
        clause.forbidden = False
    return clause, order


def _without_figures(text: str, clause: Clause) -> str:
    """The text with quantities taken out; a number that names a thing stays a word."""
    kept, last = [], 0
    for found in quantities(text):
        before = _WORD.findall(text[last : found.start])
        if before and before[-1] in IDENTIFIERS and not found.quantity.dimension:
            kept.append(f"{text[last : found.start]} nr{found.quantity.low:g}x ")
        else:
            kept.append(f"{text[last : found.start]} ")
            clause.figures.append(found.quantity)
            clause.labels |= set(before[-1:])
        last = found.end
    rest = "".join(kept) + text[last:]
    if len(clause.figures) == 1 and not clause.figures[0].one_sided and (bound := _FAR_BOUND.search(rest)):
        # Chinese puts the verb between "at least" and the number.
        exact = clause.figures[0]
        low, high = (exact.low, math.inf) if bound["low"] else (-math.inf, exact.high)
        clause.figures = [replace(exact, low=low, high=high)]
        rest = _FAR_BOUND.sub(" ", rest)
    return rest


def _words(text: str) -> list[str]:
    found: list[str] = []
    spoken = _WORD.findall(text.replace("n't", "n't "))
    if "'" not in text and (text.isascii() or _HAN.search(text) is None):
        return spoken
    for word in spoken:
        head, _, tail = word.partition("'")
        for part in [word] if word in NEGATORS else [p for p in (head, tail) if p]:
            last = 0
            for run in _HAN.finditer(part):
                found += [part[last : run.start()]] if run.start() > last else []
                found += _cut(run.group())
                last = run.end()
            found += [part[last:]] if last < len(part) else []
    return found


def _cut(run: str) -> list[str]:
    """A run of Han characters, cut by the words that the lexicons know; what is left over stays whole."""
    words: list[str] = []
    start = rest = 0
    while start < len(run):
        length = next((n for n in _SEGMENT_LENGTHS if run[start : start + n] in SEGMENTS), 0)
        if length:
            words += [run[rest:start]] if start > rest else []
            words.append(run[start : start + length])
            rest = start + length
        start += length or 1
    return words + ([run[rest:]] if rest < len(run) else [])


def _sort(words: Sequence[str], clause: Clause) -> tuple[set[str], tuple[str, set[str]] | None]:
    """Fill the clause; returns its main items and, after "before" or "after", the relation and its items."""
    main: set[str] = set()
    side: set[str] = set()
    relation, within, in_condition = "", False, False
    for index, word in enumerate(words):
        concept = concept_of(word)
        if word == ",":
            if not main:  # what came first were the circumstances
                within = in_condition = False
        elif word in NEGATORS:
            clause.forbidden |= not in_condition and not within
        elif word in BEFORE or word in AFTER:
            if index + 1 < len(words) and not relation and _temporal(word, words, index):
                relation, within = "before" if word in BEFORE else "after", True
        elif word in CONDITIONS:
            in_condition = True
        elif concept in POLES:
            name, sign = POLES[concept]
            if _particle(word, words, index):
                continue
            (side if within else main if not in_condition else set()).add(concept)
            if in_condition or within or _names_a_thing(word, words, index):
                clause.context.add(concept)
            else:
                clause.poles.setdefault(name, []).append(sign)
        elif not _is_soft(word):
            (clause.context if in_condition or within else clause.words).add(concept)
            (side if within else main if not in_condition else set()).add(concept)
    _switches(words, clause)
    return main, (relation, side) if relation and side else None


@lru_cache(maxsize=32768)
def concept_of(word: str) -> str:
    """What a word stands for: its entry in the lexicon, or its stem."""
    if word in CONCEPTS:
        return CONCEPTS[word]
    stem = _stem(word)
    return CONCEPTS.get(stem, stem)


def _stem(word: str) -> str:
    """English endings off; other languages are compared by their beginnings (:func:`gvla2.memory.word_forms.alike`)."""
    for ending in ("ings", "ing", "ies", "ed", "es", "s"):
        if word.endswith(ending) and len(word) - len(ending) >= 3 and not word.endswith("ss"):
            stem = word[: -len(ending)]
            if ending == "ies":
                return stem + "y"
            if ending == "es" and not stem.endswith(("s", "x", "z", "ch", "sh")):
                return stem + "e" if stem + "e" in CONCEPTS else stem
            return stem[:-1] if ending in ("ing", "ed") and len(stem) > 3 and stem[-1] == stem[-2] else stem
    return word


_SOFT = SOFT | FUNCTION_WORDS | FIRST


def _is_soft(word: str) -> bool:
    return word in _SOFT or (len(word) == 1 and word.isascii())


def _particle(word: str, words: Sequence[str], index: int) -> bool:
    """Whether a word is none of direction or act: "up" in "pick up", "close" in "close to"."""
    if word in ("up", "down", "over", "back", "under"):
        return any(
            w in PARTICLE_VERBS or _stem(w) in PARTICLE_VERBS for w in words[max(0, index - 3) : index]
        )
    return (
        word in ("close", "more", "less", "mehr", "más", "moins", "menos")
        and index + 1 < len(words)
        and (words[index + 1] in ("to", "than", "als", "que", "de"))
    )


def _temporal(word: str, words: Sequence[str], index: int) -> bool:
    """German "vor" and "nach", French "avant": of time before an act or a thing, of place before a side."""
    following = words[index + 1] if index + 1 < len(words) else ""
    return not (
        word in ("nach", "vor")
        and POLES.get(CONCEPTS.get(following, ""), ("",))[0] in ("side", "height", "depth")
    )


def _names_a_thing(word: str, words: Sequence[str], index: int) -> bool:
    """Whether an opposing word tells which thing is meant ("the left drawer") rather than which way."""
    before = words[index - 1] if index else ""
    after = words[index + 1] if index + 1 < len(words) else ""
    if after in PLACES or before in PLACES:
        return False
    if word in ("izquierdo", "derecho"):
        return True
    if word in ("gauche", "droite", "izquierda", "derecha"):
        return before not in ("la", "à", "a", "vers", "hacia")
    if word in ("左", "右", "上", "下", "前", "后"):
        return before not in ("向", "往", "从", "朝") and after not in ("边", "侧")
    is_last = not after or after in FUNCTION_WORDS or _is_soft(after) or after in NEGATORS
    return before in DETERMINERS and not is_last


def _switches(words: Sequence[str], clause: Clause) -> None:
    """Sides of "on" and "off", which are prepositions everywhere but after a switching verb."""
    joined = set(words)
    if not joined.isdisjoint(TURNING):
        for word, sign in (("on", 1), ("off", -1)):
            if word in joined:
                clause.poles.setdefault("power", []).append(sign)
                clause.words.discard("turn")
    elif not joined.isdisjoint(STAYING):
        for index, word in enumerate(words):
            ends = index + 1 == len(words) or (
                words[index + 1] in FUNCTION_WORDS and words[index + 1] not in DETERMINERS
            )
            if word in ("on", "off") and (ends or words[index + 1] in CONDITIONS):
                clause.poles.setdefault("power", []).append(1 if word == "on" else -1)
    elif any(word.startswith("schalt") for word in words):
        sign = {"ein": 1, "an": 1, "aus": -1, "ab": -1}.get(words[-1], 0)
        if sign:
            clause.poles.setdefault("power", []).append(sign)


def _items(clause: Clause) -> frozenset[str]:
    sides = {
        f"{axis}{'+' if sign > 0 else '-'}"
        for axis, signs in clause.poles.items()
        for sign in signs
        if axis != _ORDERED
    }
    return frozenset(clause.matter | sides)
