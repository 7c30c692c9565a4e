"""Stems of English words (Snowball's Porter2), irregular verbs among them."""

from __future__ import annotations

from functools import lru_cache

import Stemmer

_IRREGULAR = """
begin: began begun / bend: bent / blow: blew blown / break: broke broken / bring: brought / build: built / burn: burnt
buy: bought / catch: caught / choose: chose chosen / come: came / cut: cuts / do: did done / draw: drew drawn
drive: drove driven / fall: fell fallen / feed: fed / feel: felt / find: found / fly: flew flown / freeze: froze frozen
give: gave given / go: went gone / grow: grew grown / hang: hung / hide: hid hidden / hold: held / keep: kept / lay: laid
leave: left_ / let: lets / light: lit / lose: lost / make: made / mean: meant / meet: met / overwrite: overwritten
pay: paid / put: puts / rebuild: rebuilt / rise: rose risen / run: ran / see: saw_ seen / send: sent / set: sets
shake: shook shaken / show: shown / shut: shuts / sink: sank sunk / sit: sat / slide: slid / spin: spun
split: splits / stand: stood / stick: stuck / sweep: swept / swing: swung / take: took taken / tear: tore torn
tell: told / think: thought / throw: threw thrown / wear: wore worn / wind: wound / write: wrote written
"""
_VERB = {
    form: verb.strip()
    for entry in _IRREGULAR.replace("\n", " / ").split(" / ")
    for verb, _, forms in [entry.partition(":")]
    for form in forms.split()
}
_STEMMER = Stemmer.Stemmer("english")


@lru_cache(maxsize=32768)
def stem(word: str) -> str:
    """The stem of a casefolded word; names with figures in them stay as they are."""
    if not word.isalpha():
        return word
    return str(_STEMMER.stemWord(_VERB.get(word, word)))
