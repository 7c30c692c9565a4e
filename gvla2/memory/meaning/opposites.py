"""English words that oppose one another, by axis: "axis: one side / other side". Inflected forms are found by stem."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.memory.indexing.terms import stem

_OPPOSITES = """
side: left leftward leftmost port-side / right rightward rightmost
height: face-up above top upper overhead uppermost up upward upright-up
    / face-down below bottom lower under beneath underneath down
    downward underside lowest
depth: front forward forwards frontal foremost / back backward backwards rear behind reverse
inside: inside into indoors inner interior internal inward / outside outdoors outer exterior external outward
turning: clockwise cw / counterclockwise anticlockwise ccw
opening: open unclose reopen ajar / close closed shut
moving: push shove / pull drag tug haul
power: enabled enable energise energize activate active / disabled disable deactivate inactive
running: start begin launch resume boot run running / stop halt end pause quit terminate kill
amount: increase more larger greater raise grow maximise maximize maximum extra / decrease less fewer smaller reduce
    shrink minimise minimize minimum
vertical: lift raise elevate hoist / lower drop descend
speed: fast quick quickly rapid rapidly swift swiftly faster hurry accelerate brisk briskly / slow slowly slower
    decelerate unhurried creep
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
installing: install / uninstall
adding: add insert append / remove delete erase take-away
order: ascending oldest-first / descending newest-first
axis: vertical vertically / horizontal horizontally
sequence: parallel concurrently simultaneously / sequential sequentially serially
timing: synchronous / asynchronous
truth: true yes / false no-value
distance: near close-by nearby nearer adjacent / far distant away farther
lateness: early earlier / late later
keeping: keep retain preserve save / discard throw-away drop-it
locality: local locally / remote remotely
visibility: public / private
tilt: straight upright / crooked tilted tilt slanted askew
packing: compress zip / decompress unzip
covering: cover covered / uncover uncovered
size: big large huge / small little tiny
light: bright brighten / dark dim darken
thickness: thick / thin
length: long / short
holding: grasp grab grip hold clamp pinch press engage / release disengage let-go ungrip unclamp
reaching: extend / retract
showing: show reveal visible / hide hidden conceal
toward: toward towards / away
stream: upstream / downstream
inflating: inflate / deflate
entering: enter entry / exit leave
loudness: loud loudly / quiet quietly silent silently mute
safety: safe harmless / dangerous hazardous unsafe
need: necessary required mandatory must-have / unnecessary optional needless
validity: valid / invalid
sharpness: sharp / blunt dull
width: wide broad / narrow
depthwise: deep / shallow
stiffness: stiff rigid / flexible compliant loose-limbed
steadiness: steady stable / shaky unstable
strictness: strict / lenient lax
versioning: upgrade newest latest / downgrade oldest outdated
pushing: upload / download
merging: merge combine / split separate
registering: register / unregister
charging: charge recharge / discharge
newness: new fresh newer / old stale older
stacking: stack / unstack
folding: fold / unfold
wrapping: wrap / unwrap
cleaning: clean / dirty
presence: present / absent missing
connection: online / offline
price: expensive / cheap
clearness: transparent / opaque
duration: temporarily / permanently
company: together jointly / separately individually apart
strength: strong / weak
daytime: day daytime / night nighttime
ends: first beginning start / last end
hands: one-handed / two-handed
freezing: freeze frozen froze / thaw defrost
facing: face-up upright / face-down upside-down
driving: manual manually by-hand / automatic automatically
encryption: encrypt / decrypt plaintext
commit: commit / revert rollback
pose: stand standing upright / lie lying flat
whole: whole entire complete completely fully / half partial partially halfway half-way
crossing: along lengthwise / across crosswise
case: uppercase / lowercase
weights: heavy heavier / lightweight lighter
"""

_PHRASES = """
switch on=enabled switch off=disabled turn on=enabled turn off=disabled power on=enabled power off=disabled
plug in=plug switched on=enabled switched off=disabled turned on=enabled turned off=disabled
let go=release slow down=slow speed up=fast go up=raise go down=lower upside down=face-down face up=face-up
face down=face-down facing up=face-up facing down=face-down pick up=lift put down=lower
take off=disabled put on=enabled take out=remove
by hand=manually half way=halfway part way=halfway one by one=sequentially at once=simultaneously
at the same time=simultaneously roll back=rollback counter clockwise=counterclockwise anti clockwise=counterclockwise
counter-clockwise=counterclockwise anti-clockwise=counterclockwise throw away=discard take away=remove
all the way=completely close by=nearby screw in=attach top up=refill leave out=exclude start up=start
shut down=stop keep on=enabled keep off=disabled leave on=enabled leave off=disabled stay on=enabled stay off=disabled
keep out=avoid leave alone=avoid stay away=avoid keep away=avoid
"""
"""What several words say together, and the word that says the same."""


def _sides() -> dict[str, tuple[tuple[str, int], ...]]:
    found: dict[str, list[tuple[str, int]]] = {}
    for line in _OPPOSITES.strip().replace("\n    ", " ").split("\n"):
        axis, _, rest = line.partition(":")
        for sign, words in zip((1, -1), rest.split("/"), strict=True):
            for word in words.split():
                sides = found.setdefault(stem(word), [])
                if all(known != axis for known, _ in sides):
                    sides.append((axis, sign))
    return {word: tuple(sides) for word, sides in found.items()}


SIDES: Mapping[str, tuple[tuple[str, int], ...]] = MappingProxyType(_sides())
"""Stem -> the axes that it stands on, and which side of each, +1 or -1."""


def _phrases() -> dict[str, list[tuple[tuple[str, ...], str]]]:
    found: dict[str, list[tuple[tuple[str, ...], str]]] = {}
    said: list[str] = []
    for word in _PHRASES.split():
        last, equals, meant = word.partition("=")
        said.append(last)
        if equals:
            found.setdefault(stem(said[0]), []).append((tuple(said[1:]), meant))
            said = []
    return {first: sorted(rests, key=lambda rest: -len(rest[0])) for first, rests in found.items()}


PHRASES: Mapping[str, list[tuple[tuple[str, ...], str]]] = MappingProxyType(_phrases())
"""Stem of the first word -> the words behind it and what they mean together, the longest first."""
