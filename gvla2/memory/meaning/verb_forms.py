"""Forms of verbs that no ending tells: "fed" of "feed", German "gestapelt" of "stapeln", Spanish "límpiala"."""

from __future__ import annotations

import re
import unicodedata

_IRREGULAR = """
be: been / begin: began begun / bend: bent / bite: bitten / blow: blew blown / break: broke broken
bring: brought / build: built / burn: burnt / buy: bought / choose: chose chosen / come: came / do: did done
draw: drew drawn / drive: drove driven / eat: ate eaten / fall: fell fallen / feed: fed / feel: felt
fight: fought / find: found / fly: flew flown / forget: forgot forgotten / freeze: froze frozen
give: gave given / go: went gone / grow: grew grown / hang: hung / hear: heard
hide: hid hidden / hold: held / keep: kept / know: knew known / lay: laid / lend: lent / light: lit
lose: lost / make: made / mean: meant / meet: met / override: overrode overridden / pay: paid / rebuild: rebuilt
rewrite: rewrote rewritten / ride: rode ridden / rise: risen / run: ran / say: said
see: seen / seek: sought / sell: sold / send: sent / sew: sewn / shake: shook shaken / shine: shone
show: shown / sing: sang / sink: sank sunk / sit: sat / sleep: slept / slide: slid / speak: spoken
spend: spent / spin: spun / stand: stood / steal: stole stolen / stick: stuck / strike: struck
swear: swore sworn / sweep: swept / swim: swam / swing: swung / take: took taken / teach: taught
tear: tore torn / tell: told / think: thought / throw: threw thrown / understand: understood / wake: woke woken
wear: wore worn / weave: wove woven / wind: wound / withdraw: withdrew withdrawn / write: wrote written
"""
_VERB = {
    form: verb.strip()
    for entry in _IRREGULAR.replace("\n", " / ").split(" / ")
    for verb, _, forms in [entry.partition(":")]
    for form in forms.split()
}
_SEPARABLE = (
    "ab|an|auf|aus|bei|ein|fest|fort|heran|heraus|herein|herunter|hin|hinein|hoch|los|mit|nach|um|vor|weg|zu|zurück"
    "|zusammen"
)
_PARTICIPLE = re.compile(rf"(?P<particle>(?:{_SEPARABLE})?)ge(?P<stem>[^\W\d_]{{3,}})t")
_ENCLITIC = re.compile(r"(?P<verb>[^\W\d_]{2,}(?:[aeiouáéíóú]n?|[aeiáéí]r|ndo))(?P<clitic>l[aoe]s?|se)")
_ACCENTED = re.compile("[áéíóú]")


def verb_of(word: str) -> str:
    """The verb, or a plainer form of it, that a casefolded word is a form of; "" where it shows none.

    German participles become infinitives; a Spanish imperative, infinitive or gerund loses the pronoun behind it.
    """
    if word in _VERB:
        return _VERB[word]
    participle = _PARTICIPLE.fullmatch(word)
    if participle is not None:
        stem = participle["stem"]
        ending = "n" if stem.endswith(("e", "el", "er")) else "en"
        return f"{participle['particle']}{stem}{ending}"
    enclitic = _ENCLITIC.fullmatch(word) if _ACCENTED.search(word) else None
    if enclitic is not None:
        return unicodedata.normalize("NFC", _plain(enclitic["verb"]))
    return ""


def _plain(word: str) -> str:
    return "".join(c for c in unicodedata.normalize("NFD", word) if c != "\u0301")
