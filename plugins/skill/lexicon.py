"""The words that the grammar knows: data only."""

# ruff: noqa: SIM905, E501 - word lists read best as words

from __future__ import annotations

import re

from gvla2.planning.colours import COLOURS, SYNONYMS

VERBS: dict[str, tuple[str, ...]] = {
    "pick": (
        "pick * up", "pick", "pick out", "lift * up", "lift", "grab", "grab hold", "raise * up", "raise", "grasp",
        "hoist * up", "hoist", "get hold", "get ahold", "take hold", "lay hold", "seize", "elevate", "snatch * up",
        "snatch", "pluck", "clutch", "grip", "hold * up", "hold", "heave * up", "heave", "scoop * up", "scoop",
        "give * lift", "boost", "gather * up", "catch", "lever * up", "bring * up", "move * up", "close * around",
        "wrap * around", "make * rise", "make * float",
    ),
    "fetch": (
        "take", "get", "fetch", "collect", "bring", "retrieve", "obtain", "acquire", "remove",
        "take * off", "take * out", "get * off", "get * out", "bring * out", "lift * off", "lift * out",
    ),
    "place": (
        "put * down", "put", "place", "set * down", "set", "lay * down", "lay", "drop * off", "drop", "deposit",
        "stack", "rest", "position", "deliver", "transfer", "carry", "relocate", "transport", "leave", "move",
        "stow", "store", "park", "load", "pile", "arrange", "sort", "insert", "slip", "thread", "fit", "hang", "hook",
        "mount", "stick", "lower", "loop", "lodge", "settle", "tuck", "put * away", "put * back",
    ),
    "push": (
        "push", "slide", "shove", "nudge", "sweep", "scoot", "poke", "shift", "drag", "propel", "skid",
        "give * push", "give * shove", "give * nudge", "thrust", "bulldoze", "budge", "prod", "bump", "press against", "steer", "guide",
        "drive", "ram", "herd", "usher", "coax", "plough", "plow", "maneuver", "manoeuvre",
        "shuffle", "jostle", "shepherd", "use * push", "use * nudge", "use * shove", "work", "glide", "skate",
    ),
    "press": (
        "press * down", "press", "push * down", "push down on", "push in", "push on", "give * press", "give * tap",
        "apply pressure", "engage", "operate", "actuate", "get * going", "get * shine", "get * glow",
        "get * light up", "get * come on", "bring * down on", "turn * on", "switch * on", "power * up",
        "power * on", "light * up", "light", "illuminate", "activate", "hit", "tap", "click", "depress", "toggle",
        "flip * on", "flip", "enable", "trigger", "start", "make * shine", "make * glow",
        "make * light", "make * bright", "flick * on", "flick", "brighten", "touch", "get * lit", "have * lit",
        "bring * to life", "make * work", "get * working",
    ),
    "open": (
        "open * up", "open", "lift * open", "raise * open", "swing * open", "prise * open", "pry * open", "flip * open",
        "lever * open", "slide * open", "pull * open", "draw * open", "tug * open", "yank * open", "ease * open",
        "get * open", "make * open", "prop * open", "pop * open", "pop * off", "pop", "prise * off", "pry * off",
        "prise", "pry", "prise * up", "pry * up", "flip * up", "swing * up", "swing * back", "fold * open", "fold * back",
        "fold * up", "tip * back", "tilt * back", "tip * open", "tilt * open", "uncover", "push * open", "throw * open",
    ),
    "twist": (
        "unscrew", "screw * off", "screw * open", "twist * off", "twist * open", "twist", "untwist", "uncap", "unseal",
        "rotate * off", "rotate", "uncork", "loosen", "undo", "spin * off", "turn * lid", "turn * cap", "turn * stopper",
        "spin * lid", "spin * cap", "unfasten",
    ),
    "close": (
        "close * up", "close", "shut", "swing * shut", "swing * closed", "swing * over", "push * shut", "push * closed",
        "pull * shut", "pull * closed", "pull * over", "flip * shut", "flip * closed", "flip * over", "fold * shut",
        "fold * over", "slide * shut", "slide * closed", "bring * over", "get * shut", "get * closed", "lower * lid",
        "fold * down", "fold * closed", "flip * down", "swing * down", "tip * shut", "tip * closed", "tip * over",
        "turn * shut", "turn * closed", "turn * lid over", "cover * lid", "cover * with", "seal * up", "seal", "drop * shut",
        "let * fall shut", "let * lid down", "pull * lid down", "bring * lid down", "bring down * lid", "pull down * lid",
        "ease * shut", "ease * closed", "bring * shut",
    ),
    "pull": (
        "pull * out", "pull", "slide * out", "draw * out", "tug * out", "tug", "yank * out", "yank", "ease * out",
        "drag * out", "slip * out", "work * out", "draw * from", "slide * from", "slip * from",
        "ease * from", "work * from", "extract", "withdraw", "pull on", "pull at", "tug on", "tug at", "give * pull",
        "give * tug", "make * come out", "wiggle * out", "coax * out", "drag * from",
    ),
}  # fmt: skip
"""Skill to phrases; ``*`` stands for words between. ``fetch`` is a taking that a goal turns into ``place``."""

UNSUPPORTED: frozenset[str] = frozenset(
    """screw turn kick throw toss hurl pack unpack peck pour fill
    empty unfold wipe clean wash cut slice chop stab break smash crush eat drink cook stir mix shake wave write
    draw paint measure count tie untie plug unplug roll spin tilt bend squeeze bite lock unlock dance sing
    jump run walk sit stand sleep fly explode burn destroy kill buy sell watch read
    dim extinguish release assemble build""".split()
)
"""Verbs that are understood and that no schema carries out."""

NOUNS: dict[str, tuple[str, ...]] = {
    "block": ("block", "cube", "box", "brick", "cuboid", "prism"),
    "cylinder": ("cylinder",),
    "can": ("can", "tin", "canister"),
    "ball": ("ball", "sphere", "orb"),
    "disc": ("disc", "disk"),
    "plate": ("plate", "slab", "board"),
    "target": (
        "target", "square", "goal", "area", "zone", "spot", "patch", "region", "marker", "mark", "pad", "mat",
        "destination", "field", "rectangle", "place", "tile", "sticker", "location", "position", "circle",
    ),
    "button": ("button", "switch", "pushbutton", "toggle"),
    "lamp": ("lamp", "light", "bulb", "lights"),
    "cup": ("cup", "mug"),
    "bowl": ("bowl", "basin"),
    "tray": ("tray",),
    "bottle": ("bottle", "flask"),
    "jar": ("jar",),
    "lid": ("lid", "cap", "cover", "stopper", "cork"),
    "container": ("container", "bin", "basket", "crate"),
    "ring": ("ring", "hoop"),
    "pillar": ("pillar", "peg", "post", "pole", "column"),
    "umbrella": ("umbrella", "parasol", "brolly"),
    "stand": ("stand", "holder", "rack"),
    "handle": ("handle", "grip", "haft", "knob"),
    "drawer": ("drawer",),
    "cabinet": ("cabinet", "cupboard", "chest", "dresser"),
    "tower": ("tower", "stack", "pile"),
    "knife": ("knife",),
    "object": (
        "object", "thing", "item", "piece", "one", "toy", "shape", "solid", "part", "body", "gadget", "element",
    ),
}  # fmt: skip
"""Noun class to words that mean the same; plurals are understood. What only looks alike is another class."""

SHAPES: dict[str, dict[str, float]] = {
    "block": {"box": 0.85, "other": 0.5, "plate": 0.5},
    "cylinder": {"cylinder": 0.85, "disc": 0.6},
    "ball": {"sphere": 0.85},
    "disc": {"disc": 0.85},
    "plate": {"plate": 0.85},
    "target": {"region": 0.85},
    "ring": {"ring": 0.85},
    "object": dict.fromkeys(("box", "cylinder", "sphere", "disc", "plate", "ring", "bar", "other"), 0.8),
}
"""Nouns that name a shape, and how well a perceived shape is what they say, where a label says no more than a shape."""

PARTS: frozenset[str] = frozenset(("lid", "handle", "button"))
"""Classes of what things have: "the jar lid" is a lid, and the jar's."""

SHAPE_NOUNS: frozenset[str] = frozenset(("block", "cylinder", "ball", "disc", "plate", "object"))
"""Classes that name a shape only: a label of such a class says nothing about what the thing is for."""

WORKED: tuple[str, ...] = ("open", "close", "pull", "twist")
"""Skills done to a lid, a drawer or something stuck: places that are said then tell what it is a part of."""

OWNERS: dict[str, str] = {"lamp": "button"}
"""Things that are worked by a part: to press a lamp is to press its button."""

TABLE_WORDS: frozenset[str] = frozenset(
    "table tabletop desk surface ground floor bench counter air sky top height heights hand gripper".split()
)
"""Places that are everywhere: "off the table", "in the air" and "to the target height" single nothing out."""

COLOUR_WORDS: dict[str, str] = {
    **{name: name for name in COLOURS},
    **SYNONYMS,
    "crimson": "red", "scarlet": "red", "ruby": "red", "vermilion": "red",
    "burgundy": "maroon", "brown": "maroon",
    "aqua": "cyan", "gold": "yellow", "golden": "yellow", "lemon": "yellow", "amber": "orange",
    "fuchsia": "magenta", "lilac": "violet", "lavender": "violet", "indigo": "violet",
    "mauve": "purple", "plum": "purple", "emerald": "green", "khaki": "olive",
    "beige": "silver", "silvery": "silver", "charcoal": "black",
}  # fmt: skip
"""Colour words to the names that perception uses."""

SHADES: dict[tuple[str, str], str] = {
    ("dark", "red"): "maroon", ("dark", "blue"): "navy", ("navy", "blue"): "navy", ("dark", "green"): "green",
    ("light", "green"): "lime", ("bright", "green"): "lime", ("lime", "green"): "lime", ("sky", "blue"): "azure",
    ("light", "blue"): "azure", ("light", "gray"): "silver", ("dark", "yellow"): "olive",
    ("olive", "green"): "olive", ("hot", "rose"): "magenta", ("dark", "rose"): "magenta",
    ("bright", "rose"): "rose", ("light", "purple"): "violet", ("dark", "purple"): "purple",
    ("bright", "red"): "red", ("bright", "blue"): "blue", ("bright", "yellow"): "yellow",
    ("azure", "blue"): "azure", ("teal", "green"): "teal", ("rose", "red"): "rose", ("dark", "cyan"): "teal",
    ("dark", "orange"): "orange", ("light", "red"): "rose", ("blue", "green"): "teal",
}  # fmt: skip
"""Two words that name one colour, after synonyms."""

SELECTORS: dict[str, tuple[str, ...]] = {
    "left": ("on the left hand side", "on the left side", "on the left", "on your left", "on my left", "at the left",
             "furthest left", "farthest left", "leftmost", "left most", "left hand", "left"),
    "right": ("on the right hand side", "on the right side", "on the right", "on your right", "on my right",
              "at the right", "furthest right", "farthest right", "rightmost", "right most", "right hand", "right"),
    "middle": ("in the middle", "in the centre", "in the center", "middle", "central"),
    "near": ("closest to you", "nearest to you", "nearest you", "closest to the robot", "nearest to the robot",
             "closest to the gripper", "in the front", "at the front", "front most", "frontmost", "nearest", "closest",
             "front", "nearer", "closer"),
    "far": ("farthest from you", "furthest from you", "farthest away", "furthest away", "at the back", "in the back",
            "in the rear", "farthest", "furthest", "rearmost", "back", "rear"),
    "big": ("biggest", "largest", "bigger", "larger", "big", "large", "huge", "widest"),
    "small": ("smallest", "littlest", "tiniest", "smaller", "small", "little", "tiny", "narrowest"),
    "tall": ("tallest", "highest", "taller", "tall"),
    "short": ("shortest", "lowest", "shorter", "short", "flattest"),
    "any": ("any of the", "one of the", "either of the", "any one of the", "any", "either", "some"),
}  # fmt: skip
"""Words that single one out of several."""

RELATIONS: dict[str, tuple[str, ...]] = {
    "on": ("down onto", "down over", "down around", "down on", "down the", "around", "on top of", "onto the top of", "onto", "on to", "on", "upon", "over the top of", "atop", "above", "over",
           "around", "round"),
    "in": ("into", "inside of", "inside", "in to", "in", "within"),
    "to": ("all the way to", "over to", "across to", "up to", "until it reaches", "until it touches", "so that it covers", "so it covers", "so that it reaches",
           "till it covers", "till it touches", "till it reaches",
           "until it covers", "until it hits", "until it gets to", "until it is at", "until it is over",
           "towards", "toward", "to", "at", "against"),
    "beside": ("next to", "beside", "close to", "near to", "near", "alongside", "adjacent to", "by"),
    "left_of": ("to the left side of", "to the left of", "on the left of", "left of"),
    "right_of": ("to the right side of", "to the right of", "on the right of", "right of"),
    "behind": ("behind", "in back of", "beyond"),
    "front_of": ("in front of", "before"),
    "from": ("away from", "off of", "off", "from", "out of", "that sticks out of", "sticking out of",
             "that stick out of", "protruding from", "that protrudes from", "that stands out of", "poking out of",
             "that is stuck in", "stuck in", "jutting out of", "that pokes out of"),
    "with": ("with", "using"),
}  # fmt: skip
"""Relation to its wordings."""

UNTIL: tuple[str, ...] = (
    "until it is", "until it sits", "until it rests", "until it lies", "so that it is", "so that it sits",
    "so that it ends up", "so it is", "so it ends up", "so that it rests", "so that it lies",
    "so it sits", "so it lies", "till it is", "till it sits", "until it lands", "until it rests",
    "to be", "to lie", "to sit", "to rest", "to end up", "ends up", "end up",
)  # fmt: skip
"""Wordings before a relation that add nothing to it."""

DIRECTIONS: dict[str, tuple[float, float]] = {
    "to the left": (0.0, 1.0), "to your left": (0.0, 1.0), "leftwards": (0.0, 1.0), "leftward": (0.0, 1.0),
    "left": (0.0, 1.0), "to the right": (0.0, -1.0), "to your right": (0.0, -1.0), "rightwards": (0.0, -1.0),
    "rightward": (0.0, -1.0), "right": (0.0, -1.0),
    "away from you": (1.0, 0.0), "away from the robot": (1.0, 0.0), "away from yourself": (1.0, 0.0),
    "to the front": (1.0, 0.0), "forwards": (1.0, 0.0), "forward": (1.0, 0.0), "ahead": (1.0, 0.0),
    "away": (1.0, 0.0), "straight on": (1.0, 0.0),
    "towards the robot": (-1.0, 0.0), "toward the robot": (-1.0, 0.0), "closer to the robot": (-1.0, 0.0),
    "towards you": (-1.0, 0.0), "toward you": (-1.0, 0.0), "towards yourself": (-1.0, 0.0),
    "toward yourself": (-1.0, 0.0), "closer to you": (-1.0, 0.0), "nearer to you": (-1.0, 0.0),
    "to the back": (-1.0, 0.0), "backwards": (-1.0, 0.0), "backward": (-1.0, 0.0), "back": (-1.0, 0.0),
}  # fmt: skip
"""Directions in the robot's frame: x forward, y left."""

UNITS: dict[str, float] = {
    "mm": 0.001, "millimetre": 0.001, "millimeter": 0.001, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01,
    "dm": 0.1, "m": 1.0, "metre": 1.0, "meter": 1.0, "inch": 0.0254, "inche": 0.0254, "in": 0.0254,
}  # fmt: skip
"""Length units in metres; a plural s is taken off."""

NUMBERS: dict[str, float] = {
    "half": 0.5, "a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7,
    "eight": 8, "nine": 9, "ten": 10, "eleven": 11, "twelve": 12, "fifteen": 15, "twenty": 20, "thirty": 30,
    "forty": 40, "fifty": 50,
}  # fmt: skip
"""Number words."""

PRONOUNS: frozenset[str] = frozenset(("it", "them", "this", "that"))
DETERMINERS: frozenset[str] = frozenset(
    "a an the this that these those my your its his her our their another single only".split()
)
FILLERS: frozenset[str] = frozenset(
    """please kindly flat now just then robot gently carefully slowly quickly straight and you can could would will i me us
    want like need must should to be is are was so which that colored coloured color colour shaped looking there here
    of for go ahead up down high higher lower along across vertically horizontally safely firmly simply also all way
    s it its way again little bit few lying standing located sitting placed side edge rim own has have some
    help task try until till out loose once completely comes hinged clockwise counterclockwise anticlockwise away further make sure ok okay hey hi well let let's lets we off table standing being by entire
    whole very rather completely fully nicely direction distance about around roughly approximately exactly at marked painted
    highlighted outlined designated indicated namely meaning as among find locate spot see notice identify look search
    reach approach head come begin keep continue use using via want wants""".split()
)
"""Words that carry nothing for us."""

AUXILIARIES: frozenset[str] = frozenset("start begin keep continue try".split())
"""Before another verb they say nothing of what to do."""

LOOKING: frozenset[str] = frozenset(
    "find locate spot see notice identify look search reach approach head come go".split()
)
"""What comes before every action: the clause then names what the next ones are about."""

WISHING: frozenset[str] = frozenset(
    "want like need needs should must belongs goes shall let have has wish".split()
)
"""A clause with one of them asks for a state of things."""

SHINING: frozenset[str] = frozenset(
    "shine shines shining glow glows glowing lit bright burning alight".split()
)
"""States of a lamp that is on."""

CARRYING: frozenset[str] = frozenset("move carry put transport relocate position transfer".split())
"""Verbs of placing that mean lifting where the only place said is the air."""

TAKING: frozenset[str] = frozenset("lift pick grasp grab raise grip hold hoist".split())
"""What a push does without."""

SUPPORTS: frozenset[str] = frozenset("table tabletop desk surface ground floor bench counter".split())
"""Words of the table that something may be lifted off."""

HAND: frozenset[str] = frozenset("hand gripper fingers finger jaws".split())
"""Words of the robot's own hand."""

STAYING: frozenset[str] = frozenset("stay stays staying remain remains".split())
IGNORING: frozenset[str] = frozenset("ignore ignores disregard skip spare exclude neglect bypass".split())
LETTING: frozenset[str] = frozenset("leave leaves keep keeps let".split())
UNTOUCHED: frozenset[str] = frozenset("alone untouched undisturbed unmoved where".split())
REMAINDER: frozenset[str] = frozenset("others other rest everything else".split())
"""Words of a clause that says what is to be left as it is."""

NEGATIONS: tuple[str, ...] = (
    "without", "do not", "don't", "dont", "never", "not", "but not", "and not", "rather than", "instead of", "avoid",
    "leaving", "ignoring", "keeping", "except", "except for", "excepting", "excluding", "other than", "apart from",
    "aside from", "besides", "but for", "save for", "rather not", "neither", "nor", "no",
)  # fmt: skip
"""From one of these to the end of its clause, what is said is what not to do."""

AMONG: frozenset[str] = frozenset("all any every each everything anything everyone whichever".split())
"""Before "but" they make it an exception: "any cube but the red one"."""

MISHAPS: tuple[str, ...] = (
    "toppl",
    "knock",
    "tip",
    "drop",
    "spill",
    "break",
    "damag",
    "touch",
    "hit",
    "bump",
    "disturb",
    "crush",
    "scratch",
    "collid",
    "upset",
)
"""How the words begin that name what no motion is to do anyway: planning avoids it, said or not."""

UNREAD = re.compile(
    r"\b(if (?!you|possible)\w+|only if|unless|otherwise|or|between|twice|thrice|times|upside|inverted|sideways|non|none"
    r"|swap|exchange|degrees?|second|third|fourth|fifth|both|half ?way|under|underneath|beneath|below|opposite|whichever"
    r"|(?:closest|nearest|nearer|closer|furthest|farthest) (?:to|from) (?!you|the robot|the gripper|me\b)[a-z ]{1,12}|(?:closer|nearer)$)\b"
)
"""Words that change what a sentence asks for in ways that this grammar does not follow: it is declined then."""

IRREGULAR: dict[str, str] = {
    "took": "take", "taken": "take", "got": "get", "gotten": "get", "held": "hold", "brought": "bring", "lit": "light",
    "gave": "give", "given": "give", "laid": "lay", "slid": "slide", "swept": "sweep", "caught": "catch",
    "made": "make", "left": "left", "rose": "rose",
}  # fmt: skip
"""Inflections that no rule gives; ``left`` and ``rose`` stay a side and a colour."""
