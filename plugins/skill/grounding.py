"""Grounding: which objects of the scene a noun phrase means, or a typed reason why none.

Each word of a phrase must be true of an object: it is in the object's label, or it is its colour, its place among those
that fit (leftmost, largest), or a material, which nobody sees. A name that perception gave comes before words that only
look like colours or shapes; everyday words for shapes come last, and only for objects that are named by their shape.
"""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gvla2.planning.colours import COLOURS, FAMILIES, NEARLY, between, first_colour, may_look, meant_by
from gvla2.planning.contracts import RefusedError
from gvla2.planning.part_hierarchy import is_ajar, root_of
from gvla2.planning.relations import Extreme, between_two, extreme, holds_any, on_something_unseen, related
from gvla2.planning.scene import PRINTED, READ_ALIKE, ROUND, Scene, SceneObject, Shape, likeness_of_words
from gvla2_plugins.skill.reading import ITS, SIDES_OF, Noun, Place, Where

_LOOKS = {
    "cube brick box block": "block cube box brick",
    "cylinder can tin": "can tin cylinder",
    "square patch circle target": "target patch spot area zone marker mark pad goal",
    "square patch": "square mat", "circle": "disc dot", "cup": "mug", "post pillar": "peg pillar post pole column",
    "ring": "hoop frame nut washer", "bin tray box container basket": "bin basket container crate tray",
    "stand block": "holder rack pot", "tower": "stack pile", "lid cap": "cap top cover stopper cork lid flap",
    "plate board": "board", "base lamp": "lamp light", "bottle": "flask", "cabinet": "cupboard",
    "button": "switch", "umbrella": "parasol brolly", "handle": "grip", "knob": "dial",
    "drawer shelf compartment": "layer level tier drawer shelf compartment",
}  # fmt: skip
SHAPES = {word: frozenset(kinds.split()) for kinds, words in _LOOKS.items() for word in words.split()}
"""Everyday nouns, and the last words of the labels that perception by shape gives such objects."""
SYNONYMS = {
    frozenset((kind, word)) for kind, words in _LOOKS.items() if " " not in kind for word in words.split()
}
"""Pairs of nouns for the same kind, also of an object whose name perception gave."""
PACKAGES = frozenset("box carton packet package pack bag can tin jar bottle tube".split())
"""Nouns for the package of what is named before them or with "of": "cookie box", "bottle of wine"."""
VESSELS = frozenset("bin basket container crate tray".split())
"""Nouns for what is open at the top, where anything seen is."""
NUMBERS = {"two": 2, "three": 3, "four": 4}
STATES = {"open": True, "opened": True, "closed": False, "shut": False}
"""Adjectives for drawers and doors that are ajar or not."""
SECTIONS = frozenset("compartment section half side part end".split())
"""Nouns for the part of something that is on one side of it."""
_WINE = ("green", "maroon", "red", "black", "olive", "purple")
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    **dict.fromkeys(["mustard", "mustard bottle"], ("bottle", ("yellow",))),
    **dict.fromkeys(["wine", "wine bottle"], ("bottle", _WINE)),
    **dict.fromkeys(["jenga block", "jenga brick"], ("brick", ())),
    **dict.fromkeys(["chopping board", "cutting board"], ("plate", ())),
    "spray bottle": ("bottle", ()), "jenga tower": ("tower", ()), "square ring": ("ring", ()),
    "umbrella stand": ("stand", ()),
}  # fmt: skip
"""Nouns whose kind shape does not show, what such objects look like, and their colours (any if none is given)."""
FORMS: dict[str, tuple[Shape, ...]] = {
    **dict.fromkeys(["round", "circular", "cylindrical"], (*ROUND, "ring")),
    **dict.fromkeys(["square", "rectangular"], ("box", "plate", "ring")),
}
"""Adjectives for the outline of what they are true of; that of a ring is not perceived."""
POST, SLENDER = 0.06, 2.5
"""What is slimmer than this, metres, and higher by this factor is a post, whatever else it may be."""
ANYTHING = frozenset(("object", "thing", "item", "piece", "one"))
MATERIALS = frozenset("wooden wood plastic metal metallic steel glass ceramic cardboard rubber".split())
LOOSE = frozenset("protruding loose upright standing whole painted coloured colored other".split())
"""Adjectives that distinguish nothing that perception sees, and "other", which what was named before decides."""
_EXTREMES: dict[Extreme, str] = {
    "left": "left leftmost", "right": "right rightmost", "middle": "middle center centre central",
    "near": "nearest closest near", "far": "farthest furthest far",
    "front": "front frontmost", "back": "back rear backmost rearmost",
    "big": "biggest largest big large bigger larger", "small": "smallest small little smaller",
    "tall": "tallest tall taller", "short": "shortest short shorter",
    "top": "top upper topmost", "bottom": "bottom lower lowest",
}  # fmt: skip
EXTREMES = {word: by for by, words in _EXTREMES.items() for word in words.split()}
"""Adjectives that single one out, by their criterion, see :func:`~gvla2.planning.relations.extreme`."""
SIDES = frozenset("top middle center centre front side edge rim".split())
"""Heads of phrases that mean their owner: "the top of the cabinet"."""
HOLDERS = frozenset("stand holder tower stack block rack pile pot vase".split())
"""What something may be taken out of although perception has another name for it, or none."""
TABLE = frozenset(("table", "tabletop", "desk", "ground", "floor", "counter"))
ON_TABLE = 0.04
"""What stands on the table has its bottom lower than this above it, metres."""


@dataclass(frozen=True)
class Context:
    """What earlier clauses were about: ids of the last themes and of the last goal, and of all that was closed."""

    themes: tuple[str, ...] = ()
    goal: str = ""
    closed: tuple[str, ...] = ()


def ground(
    noun: Noun,
    scene: Scene,
    context: Context,
    *,
    skill: str = "",
    out: frozenset[str] = frozenset(),
    origins: Sequence[Place] = (),
    mark: bool = False,
) -> list[SceneObject]:
    """The objects that a phrase means: one, or several where it says so. Raises :class:`RefusedError`.

    ``skill`` is what is done to them, "" if they only say where; ``out`` are ids that cannot be meant; ``origins`` are
    places that they are taken from. A ``mark``, which something is in, may be any of the parts of one whole.
    """
    movable = skill not in ("", "press")
    pool = [o for o in scene.objects if o.id not in out and not (movable and o.shape == "region")]
    if noun.number == "it":
        return _antecedents(noun, pool, scene, context)
    fits = _restricted(noun, _owned(noun, pool, scene, context), scene, context)
    for origin in origins:
        fits = _taken(origin, fits, scene, context)
    for other in noun.besides:
        excluded = _restricted(other, _named(other.words, fits), scene, context)
        if not excluded:
            raise _nothing(other, fits, scene)
        fits = [o for o in fits if o not in excluded]
    *mods, head = noun.words
    said = [w for w in mods if w in EXTREMES and fits and any(w not in _label(o) for o in fits)]
    for word in said:
        fits = extreme(fits, EXTREMES[word], scene)
    if "other" in mods:
        fits = [o for o in fits if o.id not in (*context.themes, context.goal)] if context.themes else fits
    if not fits:
        raise _nothing(noun, pool, scene)
    if (count := next((NUMBERS[w] for w in mods if w in NUMBERS), len(fits))) != len(fits):
        raise RefusedError("ambiguous", f"There are {len(fits)} of '{noun.text}', not {count}.")
    plural = head not in {w for o in fits for w in _label(o)} and _singular(head) != head
    if len(fits) == 1 or noun.number == "all" or (noun.number == "the" and plural):
        return fits
    if noun.number == "any":
        return fits[:1]
    family = {i for one in (*context.themes, context.goal) if one for i in scene.family(one)}
    if len(near := [o for o in fits if o.id in family]) == 1:
        return near  # "open the jar and put the lid on the square": that jar's
    ready = [o for o in fits if is_ajar(o) == (skill == "close")]
    if skill in ("open", "close", "pull") and len(ready) == 1:
        return ready
    wholes = [scene.whole_of(o) for o in fits]
    if not skill and wholes[0] is not None and all(whole is wholes[0] for whole in wholes):
        return fits if mark else [wholes[0]]  # "on top of the drawer" where a cabinet has three
    names = ", ".join(f"{o.label} at ({o.centre[0]:.2f}, {o.centre[1]:.2f})" for o in fits)
    message = f"'{noun.text}' may mean {names}; say which, by its colour or side perhaps."
    raise RefusedError("ambiguous", message)


def _nothing(noun: Noun, pool: Sequence[SceneObject], scene: Scene) -> RefusedError:
    seen = ", ".join(sorted(o.label for o in scene.objects)) or "nothing"
    partly = any(_heads(noun.words, o, level) for level in range(3) for o in pool)
    message = f"Nothing here is '{noun.text}'; the scene has: {seen}."
    return RefusedError("nothing_matches", message, partly)


def _antecedents(
    noun: Noun, pool: Sequence[SceneObject], scene: Scene, context: Context
) -> list[SceneObject]:
    """What a pronoun stands for; where nothing was named before, the only object that can be moved."""
    named = [o for o in scene.objects if o.id in context.themes]
    if noun.text == "them" and len(named) == 1 and context.goal:
        raise RefusedError("ambiguous", "'them' may be what was put there, with what it is on.")
    wholes = [o for o in pool if not o.parent and o.shape != "region"]
    if named or len(wholes) == 1:
        return named or wholes
    raise RefusedError("ambiguous", f"What '{noun.text}' stands for is not said.")


# Words


def _label(obj: SceneObject) -> list[str]:
    return obj.label.lower().replace("-", " ").replace("_", " ").split() or [""]


def several(noun: Noun) -> bool:
    """Whether a phrase means any objects whatever, more than one: "everything", "the red things"."""
    head = noun.words[-1] if noun.words else ""
    return _singular(head) in ANYTHING and (noun.number == "all" or _singular(head) != head)


def _singular(word: str) -> str:
    endings = (("ies", "y"), ("ves", "fe"), ("xes", "x"), ("shes", "sh"), ("ches", "ch"), ("s", ""))
    for plural, singular in endings:
        if word.endswith(plural) and not word.endswith("ss"):
            return word.removesuffix(plural) + singular
    return word


def _same(one: str, other: str) -> bool:
    """Whether two words are forms of one noun."""
    forms = [{w, _singular(w), w.removesuffix("s") if not w.endswith("ss") else w} for w in (one, other)]
    return not forms[0].isdisjoint(forms[1])


def _heads(words: Sequence[str], obj: SceneObject, level: int) -> int:
    """How many words at a phrase's end name the kind of an object: 0 literally, 1 by shape or a synonym, 2 by a kind
    not seen. A name may be followed by the noun of its package, and a compound may be written in two words.
    """
    kind, head = _label(obj)[-1], _singular(words[-1])
    before = words[-2] if len(words) > 1 else ""
    if level == 0:
        packed = obj.named_by and not obj.opening and head in PACKAGES and _same(kind, before)
        joined = before and before.removesuffix("ing") + head == kind  # "frying pan"
        return 1 if _same(kind, words[-1]) else 2 if packed or joined else 0
    if level == 1 and head in ANYTHING and obj.shape != "region" and not obj.parent:
        return 1
    if obj.named_by and not obj.parent:
        compound = len(head) > 2 and kind.endswith(head)
        content = kind in PACKAGES and _same(_label(obj)[-2:][0], words[-1])
        return int(level == 1 and (frozenset((kind, head)) in SYNONYMS or compound or content))
    if level == 1:
        kinds = {kind, *(["post"] if _is_post(obj) else [])}
        return int(not kinds.isdisjoint(SHAPES.get(words[-1], SHAPES.get(head, frozenset()))))
    for width in (2, 1):
        seen, colours = KINDS.get(" ".join(words[-width:]), ("", ()))
        if kind == seen and (not colours or obj.colour in colours):
            return width
    return 0


def _is_post(obj: SceneObject) -> bool:
    width, depth, height = obj.extents
    return bool(max(width, depth) < POST and height > SLENDER * max(width, depth))


def _named(words: Sequence[str], pool: Sequence[SceneObject]) -> list[SceneObject]:
    """The objects of a pool that all words are true of, except for words that single one out.

    A name that perception gave, said in full, is that object and no other, whatever its words mean otherwise.
    """
    names = [(o, _label(o)) for o in pool if o.named_by]
    exact = [o for o, name in names if len(name) == len(words) and all(map(_same, name, words))]
    if exact:
        return exact
    if read := _read(words, pool):
        return read
    if "and" in words:  # the yellow and white mug; the red and blue cubes
        at = words.index("and")
        mixed = [o for o in pool if {words[at - 1], words[at + 1]} <= {*_label(o)}]
        both = _named((*words[:at], *words[at + 1 :]), mixed)
        if both or _singular(words[-1]) == words[-1]:
            return both
        return [
            o for one in (words[:at], words[at + 1 : at + 2]) for o in _named((*one, *words[at + 2 :]), pool)
        ]
    kinds = any(" ".join(words[-n:]) in KINDS for n in (1, 2))
    for level in range(3):
        fits = [(o, words[: len(words) - n]) for o in pool if (n := _heads(words, o, level))]
        true = [(o, rest) for o, mods in fits if (rest := _true(mods, o, pool)) is not None]
        if _singular(words[-1]) in VESSELS:
            true = [(o, rest) for o, rest in true if o.opening] or true
        if true or (fits and not kinds):
            return _coloured(true, frozenset(words), pool)
    return []


def _read(words: Sequence[str], pool: Sequence[SceneObject]) -> list[SceneObject]:
    """The objects on which a phrase's noun was read, and each adjective that is not true of them otherwise.

    Of several, those whose words agree best with the phrase, and of these those whose largest print is in it.
    """
    words = words[:-1] if len(words) > 1 and _singular(words[-1]) in PACKAGES else words  # "milk carton"
    alike: list[tuple[float, SceneObject, tuple[str, ...]]] = []
    for obj in pool:
        printed = _label(obj)[:-1] if obj.named_by == PRINTED else []
        likeness = {
            word: max((likeness_of_words(word, own) for own in printed), default=0.0) for word in words
        }
        rest = _true([word for word in words if likeness[word] < READ_ALIKE], obj, pool)
        if likeness[words[-1]] >= READ_ALIKE and rest is not None:
            alike.append((sum(likeness.values()), obj, rest))
    most = max((score for score, _, _ in alike), default=0.0)
    fits = [(o, rest) for score, o, rest in alike if score == most]
    largest = [
        (o, rest) for o, rest in fits if any(likeness_of_words(w, _label(o)[0]) >= READ_ALIKE for w in words)
    ]
    return _coloured(largest or fits, frozenset(words), pool)


def _true(mods: Sequence[str], obj: SceneObject, pool: Sequence[SceneObject]) -> tuple[str, ...] | None:
    """The adjectives that are a colour, if all others are true of an object, or of its whole; None if one is not."""
    label = _label(obj)
    whole = [w for o in pool if o.id == obj.parent for w in _label(o) if w not in COLOURS]
    idle = {*LOOSE, *NUMBERS, *EXTREMES, *(() if MATERIALS & set(label) else MATERIALS)}
    rest = [w for w in mods if w not in idle and not any(_same(w, own) for own in (*label, *whole))]
    rest = [w for w in rest if STATES.get(w, "") != is_ajar(obj) and obj.shape not in FORMS.get(w, ())]
    if not rest:
        return ()
    found = first_colour(rest)
    if found is None or found[1] - found[0] != len(rest):
        return None
    said = {w for w in label if w in COLOURS and w != obj.colour}
    return None if said and obj.named_by else tuple(rest)


def _coloured(
    fits: Sequence[tuple[SceneObject, tuple[str, ...]]], words: frozenset[str], pool: Sequence[SceneObject]
) -> list[SceneObject]:
    """Those of the colour that is said, if one is: their own, else one between two words, else their whole's.

    What has more colours in its name than the ``words`` say comes last, and only if nothing else may have the colour.
    """
    plain = [o for o, rest in fits if not rest]
    said = words & COLOURS.keys()
    full = [o for o in plain if not said or said >= COLOURS.keys() & set(_label(o))]
    seen = [(o, rest) for o, rest in fits if rest]
    if full or not seen:
        return full or plain
    found = first_colour(seen[0][1])
    assert found is not None
    colour = found[2]
    own = _seen_as(colour, [o for o, _ in seen], pool)
    if own or not plain:
        return own
    return [] if any(may_look(colour, o.rgb) for o, _ in seen) else plain


def _seen_as(colour: str, objects: Sequence[SceneObject], pool: Sequence[SceneObject]) -> list[SceneObject]:
    """The objects that look like a colour."""
    colour = FAMILIES[colour][0] if colour not in COLOURS and len(FAMILIES[colour]) == 1 else colour
    name = meant_by(colour, (o.colour for o in objects))
    own = [o for o in objects if name and o.colour == name]
    if own or not all(o.parent for o in objects):
        return own or [o for o in objects if between(NEARLY.get(colour, colour), o.rgb)]
    by_id = {o.id: o for o in pool}
    wholes = {o.id: by_id[o.parent].colour for o in objects if o.parent in by_id}
    name = meant_by(colour, wholes.values())
    return [o for o in objects if name and wholes.get(o.id) == name]


# Restrictions


def _owned(noun: Noun, pool: Sequence[SceneObject], scene: Scene, context: Context) -> list[SceneObject]:
    """The objects that a phrase's words are true of, of its owner if it names one."""
    if noun.owner is None or (noun.owner is ITS and not context.themes):
        return _named(noun.words, pool)
    head = noun.words[-1]
    if head in PACKAGES and (packed := _named((*noun.owner.words, *noun.words), pool)):
        return packed
    owner = ground(noun.owner, scene, context)
    if head in ANYTHING and len(owner) > 1:
        return [o for o in owner if o in pool]  # "the middle one of the pegs"
    if head in SIDES and len(noun.words) == 1 and not _named(noun.words, pool):
        return owner
    for o in [*owner, *([scene[context.goal]] if noun.owner is ITS and context.goal else [])]:
        if own := _named(noun.words, [p for p in scene.parts_of(o.id) if p in pool]):
            return own
    ids = {i for o in owner for i in scene.family(root_of(o, scene).id)} - {o.id for o in owner}
    mine = [o for o in pool if o.id in ids or any(holds_any(o, by, owner, scene) for by in ("on", "in"))]
    return _named(noun.words, [o for o in mine if o not in owner])


def _restricted(noun: Noun, fits: list[SceneObject], scene: Scene, context: Context) -> list[SceneObject]:
    """Those that a phrase's restrictions are true of."""
    for where in noun.where:
        true = _where(where, fits, scene, context)
        fits = [o for o in fits if (o not in true) == where.denied]
    return fits


def _where(where: Where, fits: list[SceneObject], scene: Scene, context: Context) -> list[SceneObject]:
    if where.words and where.words[0] in EXTREMES:
        return extreme(fits, EXTREMES[where.words[0]], scene)
    if where.words:
        return [o for o in fits if o in _named((*where.words, _label(o)[-1]), fits)]
    if where.having:
        parts = {o.parent for o in _named(where.having, [p for p in scene.objects if p.parent])}
        if parts or any(scene.parts_of(o.id) for o in fits):
            return [o for o in fits if o.id in parts]
        return [o for o in fits if o in _named((*where.having[:-1], _label(o)[-1]), fits)]  # its colour there
    assert where.place is not None
    return _placed(where.place, fits, scene, context)


def _taken(origin: Place, fits: list[SceneObject], scene: Scene, context: Context) -> list[SceneObject]:
    """Those that may be taken from a place; "out of its holder" restricts nothing where no holder is seen."""
    noun = origin.nouns[0]
    if noun.number == "it":
        return fits
    try:
        return _placed(origin, fits, scene, context)
    except RefusedError:
        if noun.words[-1] in HOLDERS and len(noun.words) == 1:
            return fits
        raise


def _placed(place: Place, fits: list[SceneObject], scene: Scene, context: Context) -> list[SceneObject]:
    """Those of ``fits`` that are where a place says; of several beside it, the nearest."""
    noun = place.nouns[0]
    words = {*noun.words, *(noun.owner.words if noun.owner else ())}
    if words & TABLE:
        if words & {"center", "centre", "middle"}:
            return extreme(fits, "table", scene)
        return [o for o in fits if o.bottom < scene.table_height + ON_TABLE] or fits
    if place.relation == "between":
        marks = [ground(n, scene, context) for n in place.nouns]
        ends = marks[0] if len(marks) == 1 else [mark[0] for mark in marks]
        return between_two(fits, ends[0], ends[1]) if len(ends) == 2 else []
    try:
        at = ground(noun, scene, context, mark=place.relation in ("in", "from"))
    except RefusedError as error:
        # What it stands on may be hidden below it: the only one that stands on something unseen is meant.
        raised = [o for o in fits if on_something_unseen(o, scene)]
        if place.relation == "on" and error.abstention.kind == "nothing_matches" and len(raised) == 1:
            return raised
        raise
    return related([o for o in fits if o not in at], place.relation, at, scene)


def section(noun: Noun, scene: Scene, context: Context) -> tuple[SceneObject, tuple[float, float]] | None:
    """What a phrase like "the back left compartment of the caddy" is a side or corner of, and the middle (x, y) of that
    half or quarter of it; None if it is another phrase, or one for a part that the scene has.
    """
    *places, head = noun.words or ("",)
    sides = [SIDES_OF.get({"far": "back", "near": "front"}.get(word, word), "") for word in places]
    if noun.owner is None or head not in SECTIONS or not all(sides) or len({*sides}) not in (1, 2):
        return None
    owner = ground(noun.owner, scene, context)
    if len(owner) != 1 or _owned(noun, scene.objects, scene, context):
        return None
    ways = [scene.side(side) for side in sides]
    x, y = (owner[0].centre + sum(0.5 * owner[0].half_along(way) * way for way in ways))[:2]
    return owner[0], (float(x), float(y))
