"""English words known to the reader: stop words, negations and opposites; and language detection."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from functools import lru_cache

from gvla2.memory.meaning.terms import stem


def word_set(text: str) -> frozenset[str]:
    """The words of a text, split at whitespace."""
    return frozenset(text.split())


MAX_READ = 2000
"""Characters read of a text."""
WORD = re.compile(r"[^\W_](?:[\w]|['-](?=\w))*")

SOFT = word_set(
    """use make sure need needs keep leave get give take let please always best better good well work works ensure
    properly just simply really way thing things set go do be have has had will would can could may might must shall
    should ought want prefer preferably recommended enough fine okay ok about around roughly approximately almost
    exactly here there still again once very quite much many lot so too also only even it its they them this that these
    those any all each every some both one two who which what where why how than per least most of to in at by for from
    with within onto into upon toward towards via through during as a an the and or but nor if when while until i we you
    he she my our your his her us me were was is are been being am did does done got found find turned needed belong
    belongs come comes stand stands lie lies sit sits stay stays look looks suffice suffices plenty begin begins happen
    happens hang hangs fit fits"""
)
"""Words that do not change the meaning of an action."""
NEGATORS = word_set(
    """not never no don't dont doesn't mustn't shouldn't can't cannot won't isn't aren't avoid refrain skip omit nothing
    neither forbidden prohibited nobody none wrong unwise mistake"""
)
CONDITIONS = word_set("if when whenever while once unless during where")
PREPOSITIONS = word_set(
    "of to in at by for from with into onto on under near inside through along against between"
)
IDIOMS = re.compile(
    r"\b(?:do not|don't|never) (?:forget|hesitate|fail|omit|neglect)\b(?: to)?|\bnot only\b|\bno doubt\b|\bnot just\b"
    r"|\bnot (?:a )?(?:bad|wrong)(?: idea)?\b|\bnot (?:forbidden|prohibited)\b|\bnothing wrong with\b|\bno matter\b"
)
"""Negations that forbid nothing."""

_TELLING = word_set(
    """the a of and to is it for with on at by from be are as or not this that before after when if then than into while
    until use do don't never always must should only keep"""
)
_FOREIGN = word_set(
    """der die das den dem des ein eine einen einem und nicht ist mit auf vor nach bei zu zum zur für von im wenn erst
    statt le la les des du une est pas avec pour dans sur avant après ne et au aux que qui en el los las una del con por
    antes después se hay para nunca siempre y o il gli della che non prima dopo di da em não depois het een van niet
    voor på och att ikke og jest nie się przed w z na"""
)
_LETTERS = re.compile(r"[^\W\d_]+(?:'[^\W\d_]+)?")


@lru_cache(maxsize=16384)
def is_english(text: str) -> bool:
    """Whether a text can be read here. Short texts of unclear language count as English if they are ASCII."""
    words = _LETTERS.findall(text[:MAX_READ].casefold().replace("’", "'"))
    mine = sum(word in _TELLING for word in words)
    theirs = sum(word in _FOREIGN or not word.isascii() for word in words)
    return bool(words) and (theirs == 0 or mine > 2 * theirs)


# Opposites: "axis: one side / other side", inflected forms found by stem --------------------------------------------

_OPPOSITES = """
side: left leftward leftmost port-side / right rightward rightmost
height: face-up above top upper overhead uppermost up upward upright-up / face-down below bottom lower under beneath
    underneath down downward underside lowest
depth: front forward forwards frontal foremost / back backward backwards rear behind reverse
inside: inside into indoors inner interior internal inward / outside outdoors outer exterior external outward
turning: clockwise cw / counterclockwise anticlockwise ccw counter-clockwise anti-clockwise
opening: open unclose reopen ajar / close closed shut
moving: push shove / pull drag tug haul
power: enabled enable energise energize activate active / disabled disable deactivate inactive
running: start begin launch resume boot run running start-up / stop halt end pause quit terminate kill shut-down
amount: increase more larger greater raise grow maximise maximize maximum extra / decrease less fewer smaller reduce
    shrink minimise minimize minimum
vertical: lift raise elevate hoist go-up / lower drop descend go-down put-down
speed: fast quick quickly rapid rapidly swift swiftly faster hurry accelerate brisk briskly speed-up / slow slowly
    slower decelerate unhurried creep slow-down
force: hard firm firmly forceful strong strongly / gentle gently soft softly
level: high tall / low
heat: hot warm heat warmed boiling preheat / cold cool chilled chill ice-cold lukewarm
wetness: wet moist damp moisten soak soaked humid / dry dried dryer
filling: full fill refill / empty drain emptied
tension: tighten tight fasten / loosen loose slacken slack
locking: lock locked latch / unlock unlocked unlatch
joining: attach connect plug mount couple join / detach disconnect unplug unmount decouple remove
allowing: allow permit accept / forbid prohibit deny reject refuse
including: include / exclude
adding: add insert append / remove delete erase
order: ascending oldest-first / descending newest-first
axis: vertical vertically / horizontal horizontally
sequence: parallel concurrently simultaneously / sequential sequentially serially
distance: near close-by nearby nearer adjacent / far distant away farther
size: big large huge / small little tiny
light: bright brighten / dark dim darken
thickness: thick / thin
length: long / short
holding: grasp grab grip hold clamp pinch press engage pick-up / release disengage let-go ungrip unclamp
toward: toward towards / away
stream: upstream / downstream
need: necessary required mandatory must-have / unnecessary optional needless
width: wide broad / narrow
depthwise: deep / shallow
wrapping: wrap / unwrap
daytime: day daytime / night nighttime
ends: first beginning start / last end
freezing: freeze frozen froze / thaw defrost
facing: face-up upright / face-down upside-down
whole: whole entire complete completely fully / half partial partially halfway half-way
newness: new fresh newer / old stale older
stiffness: stiff rigid / flexible compliant loose
packing: compress zip / decompress unzip
"""

Side = tuple[str, int]
"""An axis, and a word's side of it: +1 or -1."""


def _sides() -> dict[str, tuple[Side, ...]]:
    found: defaultdict[str, dict[str, int]] = defaultdict(dict)
    for line in _OPPOSITES.strip().replace("\n    ", " ").split("\n"):
        axis, _, rest = line.partition(":")
        for sign, words in zip((1, -1), rest.split("/"), strict=True):
            for word in words.split():
                found[stem(word)].setdefault(axis, sign)
    return {word: tuple(sides.items()) for word, sides in found.items()}


SIDES: Mapping[str, tuple[Side, ...]] = _sides()
"""Stem -> its axes, and its side of each, +1 or -1."""
