"""Wording: a wish in the words of the scene's labels.

Perception names objects by their shape, people by their use: what it calls a cylinder is somebody's mug, tin or candle.
A noun that is in no label, but may stand for exactly one kind of object in the scene, is replaced by that kind's label,
and a colour by the scene's word for it. Other words stay as they are.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from gvla2.planning.colours import FAMILIES, NEARLY, first_colour, meant_by
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.part_hierarchy import root_of

DETERMINERS = frozenset("the a an my your our his her its that this these those".split())  # noqa: SIM905
PLACES = frozenset(
    "on onto in into inside to towards toward over around beside behind under near at by with from off".split()  # noqa: SIM905
)
_VESSEL = (
    "mug cup tumbler beaker glass goblet teacup tankard pot pail bucket vessel vase tub jar can tin canister"
)
_PACK = "box carton packet pack package parcel crate case chest trunk container bin coffer casket tub tote toolbox"
_FLAT = (
    "mat sheet paper note tile patch pad cloth napkin towel card board panel rug carpet marker spot area zone"
)
_LONG = "umbrella parasol brolly brush broom mop stick cane rod wand scrubber plunger pole duster"
_COVER = "lid flap cover top cap hatch stopper cork bung plug closure"
_BAR = "brick block piece bar plank plug peg slab slat tile tab bit strip stick log wedge"

LOOKS: dict[str, frozenset[str]] = {
    kind: frozenset(words.split())
    for kind, words in {
        "cup": _VESSEL,
        "bowl": "basin dish saucer pan pot tub vessel",
        "cylinder": f"{_VESSEL} drum barrel tube keg container",
        "bottle": "flask carafe flagon vial phial decanter jug pitcher dispenser tube container carton wine",
        "jar": f"{_VESSEL} bottle vial flask urn crock tube barrel drum container",
        "box": f"{_PACK} block brick cuboid bar",
        "open box": f"{_PACK} basket tray",
        "lid": _COVER,
        "cap": _COVER,
        "top": _COVER,
        "cube": "block box brick die dice cuboid lump chunk",
        "brick": _BAR,
        "tower": "box cube block stack pile column pillar wall crate case container",
        "square": f"{_FLAT} rectangle",
        "patch": f"{_FLAT} rectangle square",
        "circle": f"{_FLAT} disc disk dot round",
        "tray": f"{_PACK} dish basin pan platter rack",
        "plate": f"{_FLAT} slab dish platter tray square rectangle",
        "disc": "puck coin counter token plate saucer",
        "ball": "sphere orb marble globe",
        "ring": "hoop loop frame band washer collar square",
        "post": "peg pole stick rod pin stake pillar column bar spike dowel stump block brick slab tile domino",
        "umbrella": _LONG,
        "stick": _LONG,
        "stand": "holder pot rack base bucket pail cup box container pedestal planter vase tub bin basket crock",
        "handle": "grip knob shaft haft hilt stem",
        "knife": "blade dagger cutter cleaver",
        "knife block": "stand holder rack block base",
        "button": "knob switch toggle pushbutton disc disk dot dome",
        "lamp base": "lamp light base plate platform foot board stand",
        "lamp shade": "shade lampshade lamp head",
        "cabinet": "cupboard dresser chest unit box",
        "drawer cabinet": "cupboard dresser chest unit cabinet box",
    }.items()
}
"""Labels of perception, and what people may call such an object."""

_ANYTHING = set(
    re.findall(
        r"\w+",
        "it them this that one ones object objects object objects item items piece pieces part all something anything "
        "everything light lights",
    )
)
"""Words that may mean an object of any kind; a light is what a lamp has, and what its button gives."""
_SURFACES_AND_STATES = set(
    re.findall(
        r"\w+",
        "cutting chopping serving landing building playing sticking poking jutting protruding standing lying sitting "
        "resting hanging leaning remaining missing matching closing screwing",
    )
)
"""Words on -ing before a noun that do not make another object of it."""


def in_scene_words(wish: str, scene: Scene) -> str:
    """The wish with the scene's words for objects that it names otherwise; unchanged if there are none."""
    words = list(re.finditer(r"[A-Za-z]+|[,.;:!?]", wish))
    plain = [w.group().lower() for w in words]
    own = {word for o in scene.objects for word in _kind(o).split()}
    told: dict[tuple[int, int], str] = {}
    for i, word in enumerate(plain):
        begin = _noun_phrase(plain, i)
        if begin is None or (
            word == "can" and plain[i - 1] in ("i", "we", "you", "one", "she", "he", "they")
        ):
            continue
        at, colour = _colour(plain[begin:i], scene)
        if at and not colour:  # of a colour that the scene lacks
            continue
        if plain[i - 1].endswith("ing") and plain[i - 1] not in _SURFACES_AND_STATES:
            continue  # an object named by its use: a walking stick is no umbrella
        noun = word if word in own or word.removesuffix("s") in own else _seen_as(word, colour, scene)
        if noun and noun != word:
            doubled = i > begin and noun.startswith(f"{plain[i - 1]} ")  # "the knife stand", a knife block
            told[words[i - doubled].start(), words[i].end()] = noun
        if noun and colour and at:
            told[words[begin + at[0]].start(), words[begin + at[1] - 1].end()] = colour
    kept = len(wish)
    for (start, end), new in sorted(told.items(), reverse=True):
        if end <= kept:
            wish, kept = wish[:start] + new + wish[end:], start
    return wish


def may_name(wish: str, scene: Scene) -> bool:
    """Whether any word of a wish may mean an object of the scene, by its label, its look, its colour or a pronoun."""
    words = set(re.findall(r"[a-z]+", wish.casefold()))
    known = {word for o in scene.objects for word in (*o.label.casefold().split(), *LOOKS.get(_kind(o), ()))}
    singular = {word.removesuffix("s") for word in words} | {word.removesuffix("es") for word in words}
    return bool((words | singular) & known or words & (_ANYTHING | set(FAMILIES) | set(NEARLY)))


def _noun_phrase(words: Sequence[str], i: int) -> int | None:
    """The beginning of the phrase whose noun may be the word at ``i``: after a determiner, a few words before."""
    for begin in range(i - 1, max(-1, i - 6), -1):
        if words[begin] in PLACES or not words[begin].isalpha():
            return None
        if words[begin] in DETERMINERS:
            clause = words[begin] == "that" and words[i].endswith("s")  # "that covers it"
            place = words[i] == "top" and begin > 0 and words[begin - 1] in PLACES  # "at the top"
            return None if clause or place else begin + 1
    return None


def _colour(words: Sequence[str], scene: Scene) -> tuple[tuple[int, int] | None, str]:
    """The span of a colour in the words of a phrase, and the scene's colour that it means; "" for none."""
    if (found := first_colour(words)) is None:
        return None, ""
    return found[:2], meant_by(found[2], [o.colour for o in scene.objects if o.colour])


def _seen_as(word: str, colour: str, scene: Scene) -> str:
    """The only kind of object in the scene that a noun may stand for; "" if there is none, or several."""
    forms = {word, word.removesuffix("s"), word.removesuffix("es")}
    alike = [o for o in scene.objects if forms & LOOKS.get(_kind(o), frozenset())]
    alike = [o for o in alike if not colour or colour in (o.colour, root_of(o, scene).colour)]
    kinds = {_kind(o) for o in alike}
    return kinds.pop() if len(kinds) == 1 else ""


def _kind(obj: SceneObject) -> str:
    """Its label without its colour."""
    return obj.label.casefold().removeprefix(f"{obj.colour} ")
