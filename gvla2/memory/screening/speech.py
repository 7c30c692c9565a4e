"""Orders to a machine in the languages of the tables, and in texts that mix them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Set
from dataclasses import dataclass
from functools import cache

from gvla2.memory.screening.claims import CLAIMS, LATIN_STEMS
from gvla2.memory.screening.languages import Claims, Tongue
from gvla2.memory.screening.tongues import TONGUES

_GAP = r"[^.!?;。！？\n]{0,60}?"
_NEAR = 28
_SENTENCE = re.compile(r"[.!?;。！？\n]")
# Latin, in one pattern: English nouns and verbs take part, so that a text may mix languages.
_ENGLISH = Tongue(
    "en",
    "latin",
    "ignore|disregard|forget|override|bypass|obey no",
    "instructions?|prompts?|guidelines|orders|rules|system prompt",
    "all|previous|prior|earlier|above|your",
    "not|never",
    "",
    "",
    "passwords?|api keys?|credentials|system prompt",
    "",
)
_NARROWED = re.compile(
    r" (?:(?:auf|an|am|im|in|aus|fur|beim|sur|dans|pour|en (?:el|la|los|las|un|una|cette?)|para|sul\w*"
    r"|nel\w*|per|op|voor|na|dla|pa|no|de la|du|del|des"
    r"|vom|von|della|da|on|of|from|for) |(?:de l|dell|sull|nell)')(?!(?:\w+[ ']){0,2}(?:system|sistem"
    r"|prompt|\w*nutzer|bediener|utilisat|usuari|utente|operat|memoria|gesprach|conversa|uzytkownik"
    r"|gebruiker|user|memor))"
)
_ONLY = re.compile(
    r"^.{0,30}\b(?:nur|seulement|uniquement|solo|solamente|apenas|alleen|tylko|sadece|только|wenn|quand"
    r"|lorsque|cuando|quando|als|gdy|когда)\b"
)
# A denial may follow the verb, or end the order.
_TURNED = re.compile(
    r"(?:ignorier|vergiss|vergess|missacht|umgeh|verletz|brich|negeer|vergeet|omzeil)\w*,? (?:\w+ "
    r")?(?:nicht|nie|niemals|niet|nooit)\b"
)
_TURNED_LATE = re.compile(r" (?:nicht|nie|niemals|niet|nooit|ikke|inte)\b(?! mehr)")
_ANSWER = r"https?://|[\w.-]+@[\w-]+\.\w"


# What is English from end to end is judged by the English signs.
_ENGLISH_ORDER = re.compile(rf"(?:{_ENGLISH.drop})\b.*\b(?:{_ENGLISH.frame})")
_ENGLISH_WHOLE = re.compile(rf"\b(?:{_ENGLISH.whole}|her|over)\b")


@dataclass(frozen=True)
class _Patterns:
    needs: tuple[re.Pattern[str], ...]
    dropped: re.Pattern[str]
    whole: re.Pattern[str]
    deny: re.Pattern[str]
    void: re.Pattern[str] | None
    leak: re.Pattern[str]
    phrases: re.Pattern[str]
    claims: tuple[re.Pattern[str], ...]
    off: re.Pattern[str] | None
    spaced: bool
    late: bool


def spoken_weight(words: str, stems: Set[str]) -> int:
    """How much a folded text, its spaces single, speaks to a machine in another language: 0, 1 or 2.

    ``stems``: the first four letters of its words.
    """
    weights = [0]
    for script in _scripts(words, stems):
        for patterns in _of_script(script):
            weights.append(_weight(words, patterns))
            if weights[-1] > 1:
                return weights[-1]
    return max(weights)


def _weight(words: str, patterns: _Patterns) -> int:
    if any(claim.search(words) for claim in patterns.claims):
        return 2
    if patterns.off is not None:
        for match in patterns.off.finditer(words):
            if not patterns.deny.search(_before(words, match)) and not _ONLY.search(words, match.end()):
                return 2
    if not any(need.search(words) for need in patterns.needs):
        return 0
    if patterns.phrases.search(words) is not None:
        return 2
    weight = 0
    for match in patterns.dropped.finditer(words):
        clause = _around(words, match, _NEAR)
        if patterns.deny.search(
            words[match.start() : match.end() + 8] if patterns.late else _before(words, match)
        ):
            continue
        if patterns.spaced and (_TURNED.match(match[0]) or _TURNED_LATE.match(words, match.end())):
            continue
        if patterns.spaced and _NARROWED.match(words, match.end()) is not None:
            continue
        if _ENGLISH_ORDER.fullmatch(match[0]):
            clause = _ENGLISH_WHOLE.sub("", clause)
            if patterns.whole.search(clause) is None:
                continue
        if patterns.whole.search(clause) is not None:
            return 2
        weight = 1
    for match in patterns.leak.finditer(words):
        if not patterns.deny.search(_before(words, match)):
            return 2
    if patterns.void is not None and (match_ := patterns.void.search(words)):
        clause = _around(words, match_, _NEAR)
        if patterns.whole.search(clause) is not None:
            return 2
    return weight


def _before(words: str, match: re.Match[str]) -> str:
    start = max(0, match.start() - 16)
    return _SENTENCE.split(words[start : match.start()])[-1]


def _around(words: str, match: re.Match[str], near: int) -> str:
    before = _SENTENCE.split(words[max(0, match.start() - near) : match.start()])[-1]
    after = _SENTENCE.split(words[match.end() : match.end() + near])[0]
    return before + match[0] + after


def _scripts(words: str, stems: Set[str]) -> list[str]:
    found = [] if _latin().isdisjoint(stems) else ["latin"]
    if not words.isascii():
        found += [script for script, letters in _SCRIPTS.items() if letters.search(words)]
    return found


_SCRIPTS = {
    "cyrillic": re.compile("[\u0400-\u052f]"),
    "hebrew": re.compile("[\u0590-\u05ff]"),
    "arabic": re.compile("[\u0600-\u06ff]"),
    "indic": re.compile("[\u0900-\u09ff]"),
    "han": re.compile("[\u3040-\u30ff\u3400-\u9fff]"),
    "hangul": re.compile("[\uac00-\ud7a3]"),
    "other": re.compile("[\u0370-\u03ff\u0e00-\u0e7f]"),
}


@cache
def _of_script(script: str) -> tuple[_Patterns, ...]:
    tongues = [tongue for tongue in TONGUES if tongue.script == script]
    if script == "latin":
        return (_patterns([*tongues, _ENGLISH], spaced=True),)
    return tuple(_patterns([tongue], spaced=script in ("cyrillic", "arabic", "hebrew")) for tongue in tongues)


def _patterns(tongues: list[Tongue], *, spaced: bool) -> _Patterns:
    def joined(name: str) -> str:
        parts = [unicodedata.normalize("NFKC", getattr(tongue, name)) for tongue in tongues]
        return "|".join(part for part in parts if part)

    late = any(tongue.code in ("ja", "ko", "hi") for tongue in tongues)
    # Vowel signs are no word characters, so words of Indic scripts end at spaces.
    indic = tongues[0].script == "indic"
    edge, end = (r"(?<!\w)", r"(?!\w)") if spaced else (r"(?<![^\s,])", "") if indic else ("", "")
    drop, frame = rf"{edge}(?:{joined('drop')}){end}", rf"{edge}(?:{joined('frame')}){end}"
    secret = rf"{edge}(?:{joined('secret')}){end}"
    leak = rf"{edge}(?:{joined('leak')}){end}"
    own = (
        r"(?<!the )(?<!a )(?:system ?prompt\w*|prompt (?:do|del|di|de) s[iy]stem\w*|invite systeme|prompt "
        r"systemowy|sistem istem\w*|systemprompten)"
    )
    foreign = [tongue for tongue in tongues if tongue.code != "en"]
    void = "|".join(t.void for t in foreign)
    words = CLAIMS.get(tongues[0].script)
    claims = _claims(words, edge, frame) if words else ()
    return _Patterns(
        claims=claims,
        off=re.compile(
            f"{edge}(?:{words.off}){_GAP}{edge}(?:{words.guard})|{edge}(?:{words.guard}){_GAP}(?:{words.off})"
        )
        if words
        else None,
        needs=(re.compile(frame), re.compile(f"{edge}(?:{joined('phrases')})"), re.compile(secret)),
        dropped=re.compile(f"{drop}{_GAP}{frame}|{frame}{_GAP}{drop}"),
        whole=re.compile(rf"{edge}(?:{joined('whole')}){end}"),
        deny=re.compile(
            rf"{edge}(?:{joined('deny')})(?![^\W\d_]{{2}})"
            if spaced
            else rf"{edge}(?:{joined('deny')})(?!\S)"
            if indic
            else joined("deny")
        ),
        void=re.compile(rf"{frame}{_GAP}{edge}(?:{void})") if void else None,
        leak=re.compile(
            rf"{leak}{_GAP}(?:{secret}{_GAP}(?:{_ANSWER})|{own})"
            rf"|{secret}[^!?;\n]{{0,60}}?(?:{_ANSWER})[^!?;\n]{{0,20}}?{leak}"
            rf"|{secret}{_GAP}{leak}[^!?;\n]{{0,20}}?(?:{_ANSWER})"
            + (rf"|{_SYSTEM[tongues[0].code]}{_GAP}{leak}" if tongues[0].code in _SYSTEM else "")
        ),
        phrases=re.compile(rf"{edge}(?:{joined('phrases')})"),
        spaced=spaced,
        late=late,
    )


def _claims(words: Claims, edge: str, frame: str) -> tuple[re.Pattern[str], ...]:
    none, note, first = (
        f"{edge}(?:{unicodedata.normalize('NFKC', part)})" for part in (words.none, words.note, words.first)
    )
    near = r"[^.!?;。！？,，\n]{0,16}?"
    return (
        re.compile(f"{none}{near}(?:{frame}|{edge}(?:limit|grenze|granic)\\w*)"),
        re.compile(f"{note}{_GAP}{first}"),
        re.compile(f"{edge}(?:{unicodedata.normalize('NFKC', words.phrases)})"),
    )


_SYSTEM = {"ja": "システムプロンプト", "ko": "시스템 프롬프트", "hi": "सिस्टम प्रॉम्प्ट", "zh": "系统提示词"}


@cache
def _latin() -> frozenset[str]:
    return frozenset(LATIN_STEMS.split())
