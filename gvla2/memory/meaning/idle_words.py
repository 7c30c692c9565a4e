"""Words that say nothing, and those that seem to: two lessons that differ in one of the latter are two lessons."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.memory.meaning.lexicon import THEN
from gvla2.memory.meaning.word_sets import word_set

IDLE = THEN | word_set(
    """
    the a an its it s you is are be been being has have always please just simply really ensure sure must should shall
    carefully safely properly exactly
    der die das den dem des ein eine einen einem einer ist sind wird werden worden immer stets bitte sie es du man
    muss müssen soll sollte sollen
    le la les l un une est sont être son sa ses toujours doit doivent il faut vous
    el los las una su sus es está están siempre debe deben hay que
    的 了 着 请 把 将 总是 必须 应该 应 要 需要 则 就 个 ,
    """
)
"""Articles, courtesies, auxiliaries and what only stresses, and "then", as the order of the steps is compared itself.

Prepositions, quantifiers, "and" and "or" are not among them, nor are "on" and "off".
"""

_FORMS = """
use uses used using
make makes made making
keep keeps kept keeping
leave leaves left leaving
get gets got getting
give gives gave given giving
take takes took taken taking
need needs needed needing
work works worked working
succeed succeeds succeeded
fail fails failed
prefer prefers preferred preferring
do does did
when if whenever
no not
don don't doesn't
on upon
until till
toward towards
in im ins
an am
bei beim
von vom
zu zum zur
à au aux
de d du del
verwende verwenden verwendet
benutze benutzen benutzt nutze nutzen nutzt
lasse lassen lass lässt
wenn falls
utilise utilisez utiliser
mettre mettez mets met
laisse laissez laisser
fait faire faites fais
quand lorsque
usa usar use
utiliza utilizar utilice
deja dejar deje
haz hacer haga
"""
_FORM: Mapping[str, str] = MappingProxyType(
    {word: line.split()[0] for line in reversed(_FORMS.strip().split("\n")) for word in line.split()}
)


def telling(words: frozenset[str]) -> frozenset[str]:
    """The words that are not idle, each in one form: "using the" gives "use"."""
    return frozenset([_FORM.get(word, word) for word in words if word not in IDLE])
