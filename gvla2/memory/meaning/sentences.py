"""Sentences and what they are made of: steps, reasons, what is negated, and words of order that take many words."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gvla2.memory.meaning.clauses import BEFORE_INSTEAD, REPLACING
from gvla2.memory.meaning.concepts import HAN, concept_of
from gvla2.memory.meaning.lexicon import CONCEPTS, POLES, THEN
from gvla2.memory.meaning.word_sets import word_set

_TRAILING = (
    "afterwards", "afterward", "after that", "later", "last", "danach", "nachher", "anschließend", "hinterher",
    "ensuite", "après", "después", "luego",
)  # fmt: skip
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
    r"\bno need\b|\bneed not\b|\bneedn't\b|\bnot (?:necessary|needed|required|obligatory)\b|\bdon't (?:need|have) to\b"
    r"|\b(?:do|does) not (?:need|have) to\b|\bdoesn't (?:need|have) to\b"
    r"|\bno \w+(?: \w+)? (?:is|are) (?:needed|required)\b"
    r"|\bnot enough\b|\bnicht genug\b|\bne suffit pas\b|\bno basta\b"
    r"|\bnicht (?:nötig|notwendig|erforderlich)\b|\b(?:muss|musst|müssen|brauchst|braucht|brauchen)\b[^,]*\bnicht\b"
    r"|\bpas (?:nécessaire|besoin|obligatoire|obligé)\b"
    r"|\bno (?:es (?:necesario|obligatorio)|hace falta|hay que|necesitas?)\b|不必|无需|不需要|不用"
)
_DOUBLE = re.compile(
    r"\b(?:do not|don't|never|cannot|can't|must not|mustn't|should not|shouldn't|not|no|avoid)\b"
    r"(?P<en>[^,;:]*)\b(?:without|unless)\b"
    r"|\b(?:nicht|nie|niemals|kein\w*)\b(?P<de>[^,;:]*)\bohne\b"
    r"|\b(?:ne\b|n')(?P<fr>[^,;:]*)\bsans\b|\b(?:no|nunca|jamás)\b(?P<es>[^,;:]*)\bsin\b"
    r"|(?:不要|别|切勿|不得|不能|不可)(?P<zh>[^,;:]*?)(?:没有|未经)"
    r"|(?:没有|未经)(?P<zh2>[^,;:]*?)(?:不要|别|切勿|不得|不能|不可)"
)
"""Two negations that make one assertion: "don't solder without flux" says to solder with it."""
_BANNED = re.compile(
    r"\b(?:it )?(?:is|are) (?:strictly |absolutely )?(?:forbidden|prohibited|not (?:allowed|permitted))\b(?: to\b)?"
    r"|\bunder no circumstances\b|\bon no account\b"
    r"|\b(?:es )?(?:ist|sind) (?:streng )?(?:verboten|untersagt|nicht (?:erlaubt|gestattet))\b"
    r"|\bauf keinen fall\b|\bkeinesfalls\b"
    r"|\b(?:il |c')?(?:est|sont) (?:strictement |formellement )?interdite?s?\b(?: de\b| d')?|\ben aucun cas\b"
    r"|\bestán? (?:terminantemente )?prohibid[oa]s?\b|\bbajo ningún concepto\b|\ben ningún caso\b"
    r"|严禁|不准|不许|不允许"
)
"""Ways to say "never" that are not one word."""
_SECOND_HALF = re.compile(r"\b(?:pas|jamais|plus|aucune?)\b")
_ASIDE = re.compile(r"\([^()\d]*\)")
_SENTENCE = re.compile(r"[!?;\n。！？；]+|\.(?=\s|$)")
_SPEED_UP = re.compile(r"\bspeed(s|ing)? up\b")
_AGAINST_CLOCK = re.compile(
    r"\b(?:gegen den|entgegen dem) uhrzeigersinn\b|\bcounter[- ]clockwise\b|\banti[- ]clockwise\b"
)
_NOT_CLAUSE = re.compile(r",\s*(?=(?:and |but )?(?:not|never|nicht|nie|pas|no|不要|别|而不)\b)")
_PREFERRED = re.compile(r"\b(prefer(?:s|red|ring)? (?!to\b)[^,]*?) over ")
_REASON = re.compile(
    r",?\s*\b(?:so that|because|since (?=the|it|they|this|there)|otherwise|or else|in order to|lest"
    r"|weil|damit|sonst|andernfalls|parce qu|sinon|afin d|afin qu|pour qu|porque|para que|de lo contrario|ya que)"
    r"(?:\b|')|:\s+(?=(?:it|they|es|er|sie|il|elle|ils)\b)|,?因为|,?否则|,?以免|,?以便"
)
"""What follows tells why, and is nothing to do."""
_WHY = re.compile(
    r",\s*(?:"
    r"(?:it|this|that|they|which)(?:"
    r" (?!must|should|shall|has to|have to|need|ought|(?:is|are) (?:to|not|never)|never|go(?:es)? |belong|stay|remain"
    r"|take|come|get)|'s )"
    r"|(?:es|das|sie) (?!muss|müssen|soll|darf|dürfen|nie|kommt|kommen|gehör|bleib)"
    r"|(?:ça|cela|il|elle|ils|elles|qui) (?!(?:ne |n')?(?:doi|faut|peu|va |vont |reste))|c'est "
    r"|(?:eso|esto) (?!(?:no |nunca )?(?:deb|va ))"
    r"|(?:otherwise|denn|pues|car) )[^\d,]*$"
)
"""What a sentence ends with that only tells why or how it went: ", it tore otherwise"."""
_WHO_SAYS = re.compile(
    r"^\s*(?:(?:i|we)(?: have|'ve|'d| had)?(?: also| finally| just)? "
    r"(?:noted|noticed|learnt|learned|found out|found|saw|seen|realised|realized|discovered|remember|recommend|suggest"
    r"|know|was told|were told)(?: that| to)?\b"
    r"|(?:found out|turned out|it turned out|it turns out|note|remember|keep in mind|mind) that\b"
    r"|(?:ich|wir) (?:habe|haben) (?:gelernt|gemerkt|festgestellt|gesehen), dass\b"
    r"|(?:j'ai|nous avons) (?:noté|appris|vu|remarqué|constaté) qu(?:e\b|')"
    r"|(?:he|hemos) (?:visto|aprendido|notado|comprobado) que\b)[,:]?"
)
"""What a sentence begins with that only tells who found it out."""
_SO = re.compile(
    r",\s*(?:so|therefore|hence|thus|deshalb|daher|darum|donc|así que|por eso)\s+(?!that\b)|,所以"
)
_ORDERING = (
    (re.compile(r"\b(?:ahead|in advance) of\b"), "before"),
    (re.compile(r"\bas soon as\b"), "after"),
    (re.compile(r"\bonce(?= (?:the|it|they|all|both|you|this|that|each|every|your|there|"
                r"\w+ (?:is|are|has|have|was|\w+s)|\w+(?:ed|ing))\b)"), "after"),
    (re.compile(r"\bfollowed by\b|\b(?:and )?only then\b|(?:,|\band)\s+(?:finally|lastly)\b"), "then"),
    (re.compile(r"\bsobald\b"), "nachdem"),
    (re.compile(r"\berst dann\b|\b(?:und )?(?:zum schluss|zuletzt|schließlich|gefolgt von)\b"), "dann"),
    (re.compile(r"\bdès qu(?:e\b|')|\bune fois(?= (?:que|qu'|le|la|les|l'))"), "après"),
    (re.compile(r"\b(?:et )?(?:enfin|finalement|suivie? de|seulement (?:alors|ensuite))\b"), "puis"),
    (re.compile(r"\bdespués\b(?! (?:de|del|que)\b)"), "luego"),
    (re.compile(r"\ben cuanto\b|\buna vez(?= (?:que|el|la|los|las|\w+[aeí]d[oa]s?)\b)|\btan pronto como\b"), "después"),
    (re.compile(r"\b(?:y )?(?:finalmente|por último|al final|sólo entonces|solo entonces|seguid[oa] de)\b"), "luego"),
    (re.compile(r"一旦"), "当"), (re.compile(r",?最后"), "然后"),
)  # fmt: skip
"""Words of order in many words, and the one word that says the same."""


@dataclass(frozen=True)
class Signs:
    """The words of a text, and what they leave possible; most texts need not be searched for most of it."""

    words: frozenset[str]
    negates: bool
    orders: bool
    reasons: bool
    replaces: bool
    joins: bool


_NEGATING = word_set(
    """not no need needn never don avoid without unless cannot nicht nie niemals kein keine keinen keinem keiner vergiss
    forbidden prohibited circumstances account verboten untersagt keinesfalls keinen interdit interdite interdits
    interdites aucun prohibido prohibida prohibidos prohibidas ningún
    vergessen zögere muss musst müssen brauchst braucht brauchen ohne ne n pas sans nunca jamás sin dud duda dudes
    dude"""
)
_ORDERING_WORDS = word_set(
    f"""ahead advance soon once followed only finally lastly sobald erst schluss zuletzt schließlich gefolgt dès fois
    enfin finalement suivi suivie seulement cuanto vez tan finalmente último final sólo solo seguido seguida first
    zuerst zunächst primero abord afterwards afterward that {" ".join(THEN)} {" ".join(_TRAILING)}"""
)
_REASONS = word_set(
    """so because since otherwise else order lest weil damit sonst andernfalls parce sinon afin pour porque para
    contrario ya therefore hence thus deshalb daher darum donc así eso"""
)
_SPACES = str.maketrans(dict.fromkeys(",.;:!?()[]{}\"`'-/", " "))


def signs_of(plain: str) -> Signs:
    """The signs of a casefolded text."""
    words = frozenset(plain.translate(_SPACES).split())
    han = not plain.isascii() and HAN.search(plain) is not None
    return Signs(
        words,
        han or not words.isdisjoint(_NEGATING),
        han or not words.isdisjoint(_ORDERING_WORDS),
        han or ": " in plain or not words.isdisjoint(_REASONS),
        not words.isdisjoint(REPLACING) or "而不是" in plain or "prefer" in plain,
        han or not words.isdisjoint(_JOINING),
    )


_JOINING = word_set("and und et y")


def in_order(plain: str) -> str:
    """The text with one word for each expression of order that has many: "then" for "and only then"."""
    for pattern, word in _ORDERING:
        plain = pattern.sub(word, plain)
    return plain


def sentences_of(plain: str) -> list[str]:
    """The sentences of a casefolded text."""
    plain = _SPEED_UP.sub("accelerate", plain) if "speed" in plain else plain
    plain = _PREFERRED.sub(r"\1 instead of ", plain) if "prefer" in plain else plain
    plain = _ASIDE.sub(" ", plain) if "(" in plain else plain
    plain = _AGAINST_CLOCK.sub("counterclockwise", plain) if "clock" in plain or "uhrz" in plain else plain
    plain = plain.strip().removesuffix(".")
    if plain.isascii() and not (
        ". " in plain or "!" in plain or "?" in plain or ";" in plain or "\n" in plain
    ):
        return [plain] if plain else []
    return [sentence for sentence in _SENTENCE.split(plain) if sentence and not sentence.isspace()]


def asserted(sentence: str) -> tuple[str, bool]:
    """The sentence without idioms and double negations, and whether it says that something need not be done."""
    needless = _NEEDLESS.search(sentence) is not None
    return _DOUBLE.sub(_positive, _BANNED.sub(" never ", IDIOMS.sub(" ", sentence))), needless


def _positive(found: re.Match[str]) -> str:
    said = next((part for part in found.groupdict().values() if part is not None), "")
    return f" {_SECOND_HALF.sub(' ', said)} "


def pieces_of(sentence: str, signs: Signs) -> list[tuple[str, bool]]:
    """The parts of a sentence, and whether each only tells why."""
    found: list[tuple[str, bool]] = []
    rest = sentence = _WHO_SAYS.sub("", sentence)
    if signs.reasons and (why := _REASON.search(sentence)) is not None:
        rest, reason = sentence[: why.start()], sentence[why.end() :]
        if not rest.strip():  # "Because the rim is high, lift it 10 cm."
            reason, _, rest = reason.partition(",")
        found = [(reason, True)]
    if ", " in rest and (why := _WHY.search(rest)) is not None and rest[: why.start()].strip():
        rest, reason = rest[: why.start()], rest[why.start() + 1 :]
        found.append((reason, True))
    if signs.reasons:
        *reasons, rest = _SO.split(rest, 1)
        found += [(part, False) for part in reasons]
    split = _NOT_CLAUSE.split(rest) if signs.negates and "," in rest else [rest]
    if signs.replaces:
        split = [part for piece in split for part in _around_what_is_replaced(piece)]
    return [(piece, False) for piece in split] + found


def _around_what_is_replaced(text: str) -> list[str]:
    """What is to be done, and what it takes the place of: "use rsync", "instead of scp"."""
    first, *others = BEFORE_INSTEAD.split(text, 1)
    if others and not first.strip():  # "Instead of scp, use rsync."
        replaced, comma, rest = others[0].partition(",")
        return [rest, replaced] if comma else others
    return [first, *others]


_THEN = re.compile(
    r",?\s*(?:\band\b|\bund\b|\bet\b|\by\b)?\s*(?:"
    + "|".join(
        rf"{'(?<!the )' if w == 'finally' else ''}\b{re.escape(w)}\b"
        if w.isascii() or not HAN.match(w)
        else re.escape(w)
        for w in sorted(THEN)
    )
    + r")\s*"
)
_ADVERBS = word_set(
    "side height depth inside turning amount speed force level wetness filling order axis sequence timing truth case "
    "indent distance lateness locality visibility tilt size light thickness length"
)
"""Axes whose words mostly say how, not what is done."""


def _acts(adverbs: bool) -> str:
    return "|".join(
        sorted(
            re.escape(w)
            for w, c in CONCEPTS.items()
            if not HAN.match(w)
            and (
                (c in POLES and (adverbs or POLES[c][0] not in _ADVERBS))
                or c in ("grasp", "turn", "place", "go", "check", "touch", "press", "wait", "cook", "run")
            )
        )
    )


_MAY_AND = re.compile(r"\s(?:and|und|et|y)\s|[\u3400-\u9fff],")
_AND = re.compile(rf",?\s+(?:and|und|et|y)\s+(?=(?:{_acts(True)})\b)|(?<=[\u3400-\u9fff]),")
_COMMA = re.compile(rf",\s+(?=(?:{_acts(False)})\b)")
_AFTERWARDS = re.compile(
    r"(?P<one>.+?)(?:,|\s(?:and|und|et|y))\s+(?P<two>[^,]+?),?\s+"
    r"(?:afterwards?|after that|later|last|danach|nachher|anschließend|hinterher|ensuite|après|después|luego)\s*"
)
_FIRST = re.compile(
    r"(?<!the )\bfirst\b|\b(?:zuerst|zunächst|primero|d'abord|afterwards?|after that|nachher)\b|先"
)


def is_sequence(sentence: str) -> bool:
    """Whether the parts of a sentence are told in the order in which they are to be done."""
    return _FIRST.search(sentence) is not None or _THEN.search(sentence) is not None


def steps_of(text: str, signs: Signs) -> list[str]:
    """The single acts of a part of a sentence."""
    if (
        signs.orders
        and text.rstrip().endswith(_TRAILING)
        and (behind := _AFTERWARDS.fullmatch(text)) is not None
    ):
        return [behind["one"], behind["two"]]
    steps = _THEN.split(text) if signs.orders else [text]
    found = []
    for step in steps:
        for part in _AND.split(step) if signs.joins and _MAY_AND.search(step) else [step]:
            if part and part.strip():
                found += _COMMA.split(part) if ", " in part and _begins_with_an_act(part) else [part]
    return found


def _begins_with_an_act(text: str) -> bool:
    concept = concept_of(text.split(None, 1)[0])
    return concept in POLES and POLES[concept][0] not in _ADVERBS
