"""The words that the grammar knows: data only."""

# ruff: noqa: SIM905, E501 - word lists read best as words

from __future__ import annotations

import re
from itertools import product


def _phrases(text: str) -> tuple[str, ...]:
    """The phrases of a list with commas; ``a|b c`` stands for "a c" and "b c"."""
    spelt = (part.split() for part in re.sub(r"\|\s+", "|", text).split(","))
    return tuple(dict.fromkeys(" ".join(p) for part in spelt for p in product(*(w.split("|") for w in part))))


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _table(**lists: str) -> dict[str, tuple[str, ...]]:
    return {key.rstrip("_"): _phrases(text) for key, text in lists.items()}


VERBS: dict[str, tuple[str, ...]] = _table(
    pick="""pick|lift|raise|hoist|hold|heave|scoop|move|whisk * up, pick|lift|grab|raise|grasp|hoist|seize|elevate|snatch|
        grip|hold, grab|get|take hold, move|carry * off, move|carry|keep * air, close * around, make * rise, give * lift""",
    fetch="""take|get|fetch|collect|bring|retrieve|obtain|remove, take|get|lift * off, take|get|bring|lift * out,
        hand|pass|give me, hand|pass|give * to me, pass|hand|bring * here, fish|whip|whisk|pluck * out""",
    place="""put|set|lay * down, put|place|set|lay|drop|deposit|stack|rest|position|deliver|transfer|carry|relocate|
        transport|leave|move|stow|store|load|balance|arrange|sort|insert|slip|thread|fit|hang|hook|mount|stick|lower|
        pop|plonk|chuck|toss|clear|tidy|bring, pass * over|through|onto, drop * off, put * away|back""",
    push="""push|slide|shove|nudge|sweep|scoot|shift|drag|prod|bump|steer|guide|drive|ram|herd|coax|work|glide|plough,
        give|use * push|shove|nudge""",
    press="""press|push * down, press|engage|operate|actuate|light|illuminate|activate|hit|tap|click|depress|toggle|
        flip|enable|trigger|flick|touch|poke, push|press down on, push in|on, give * press|tap|poke,
        get * going|working, get * light up, get * come on, get|make * shine|glow, bring * to life,
        turn|switch|power|flip|flick * on, power|light * up, make * work, get|have * lit, get|have|give * some light""",
    open="""open|prise|pry|prop|flip|swing|fold * up, pop * cork, open|pop|prise|pry|uncover, pop|prise|pry * off,
        lift|raise|swing|prise|pry|flip|slide|pull|get|make|pop|fold|tip|push|throw|crack * open, swing|fold|tip|flip * back""",
    twist="""unscrew|twist|untwist|uncap|rotate|uncork|loosen|undo|unfasten, give * twist, screw|twist|spin * off,
        screw|twist * open, turn * lid|cap|stopper""",
    close="""close|seal * up, close|shut|seal|cover, swing|push|pull|flip|fold|get|drop|bring * shut|closed,
        swing|pull|flip|fold|bring|tip * over, lower|cover * lid, fold|flip|swing|tip * down,
        swing|fold|flip|put * back over|down, cover * up|with, turn * lid over, let|pull|bring * lid down""",
    pull="""pull|slide|draw|tug|yank|haul|ease|drag|slip|work|wiggle|coax * out, pull|tug|yank|extract|withdraw,
        draw|slide|slip|ease * from, pull|tug on|at, give * pull|tug, make * come out""",
    unsupported="""put|leave|keep * off, screw|turn|kick|throw|hurl|pack|unpack|peck|pour|fill|empty|unfold|wipe|clean|wash|cut|slice|chop|
        stab|break|smash|crush|eat|drink|cook|stir|mix|shake|wave|write|draw|paint|measure|count|tie|untie|plug|unplug|roll|
        spin|tilt|bend|squeeze|bite|lock|unlock|dance|sing|jump|run|walk|sit|stand|sleep|fly|explode|burn|destroy|kill|buy|
        sell|watch|read|dim|extinguish|release|assemble|build""",
)
"""Skill to phrases; ``*`` stands for words between. ``fetch`` is a taking that a goal turns into ``place``;
``unsupported`` are verbs that are understood and that no skill carries out.
"""

NOUNS: dict[str, tuple[str, ...]] = _table(
    block="block, cube, box, brick, cuboid, prism", cylinder="cylinder", can="can, tin, canister", bowl="bowl, basin",
    ball="ball, sphere, orb", disc="disc, disk", plate="plate, slab, board", tray="tray", jar="jar", knife="knife, blade",
    target="""target, square, goal, area, zone, spot, patch, region, marker, mark, pad, mat, destination, field, rectangle,
        place, tile, sticker, location, position, circle""",
    button="button, switch, pushbutton, toggle", lamp="lamp, light, bulb, lights", cup="cup, mug", bottle="bottle, flask",
    lid="lid, cap, cover, stopper, cork", container="container, bin, basket, crate", ring="ring, hoop",
    pillar="pillar, peg, post, pole, column", umbrella="umbrella, parasol, brolly", stand="stand, holder, rack",
    handle="handle, grip, haft, knob", drawer="drawer", cabinet="cabinet, cupboard, chest, dresser",
    tower="tower, stack, pile, row, line",
    object="object, thing, item, piece, one, toy, shape, solid, part, body, gadget, element, fella, fellow, chap, guy, thingy",
)  # fmt: skip
"""Noun class to words that mean the same; plurals are understood. What only looks alike is another class."""

SHAPES: dict[str, dict[str, float]] = {
    "block": {"box": 0.85, "other": 0.5, "plate": 0.5}, "cylinder": {"cylinder": 0.85, "disc": 0.6},
    "can": {"cylinder": 0.6}, "ball": {"sphere": 0.85}, "disc": {"disc": 0.85}, "plate": {"plate": 0.85},
    "target": {"region": 0.85}, "ring": {"ring": 0.85},
    "object": dict.fromkeys(("box", "cylinder", "sphere", "disc", "plate", "ring", "bar", "other"), 0.8),
}  # fmt: skip
"""Nouns that name a shape, and how well a perceived shape is what they say, where a label says no more than a shape."""

CONTENTS: dict[str, tuple[str, ...]] = {
    "mustard": ("yellow",), "ketchup": ("red",), "mayonnaise": ("white",), "mayo": ("white",), "milk": ("white",),
    "wine": ("green", "red", "white", "black"), "champagne": ("green", "black"),     "water": ("white", "blue"), "oil": ("green", "yellow"), "soy": ("black", "brown"), "syrup": ("brown",),
    **dict.fromkeys(("beer", "cola", "juice", "vinegar", "sauce", "shampoo", "soap", "detergent", "lemonade", "medicine", "bleach", "perfume", "lotion", "ink"), ()),
}  # fmt: skip
"""What comes in bottles, which people say for the bottle, and the colours that such bottles are."""
PARTS = frozenset(("lid", "handle", "button"))
"""Classes of what things have: "the jar lid" is a lid, and the jar's."""
SHAPE_NOUNS = frozenset(("block", "cylinder", "ball", "disc", "plate", "object"))
"""Classes that name a shape only: a label of such a class says nothing about what the thing is for."""
WORKED: tuple[str, ...] = ("open", "close", "pull", "twist")
"""Skills done to a lid, a drawer or something stuck: places that are said then tell what it is a part of."""
SUPPORTS = _words("table tabletop desk surface ground floor bench counter")
"""Words of the table that something may be lifted off."""
TABLE_WORDS = SUPPORTS | _words("air sky top height heights hand gripper")
"""Places that are everywhere: "off the table", "in the air" and "to the target height" single nothing out."""
SELECTORS: dict[str, tuple[str, ...]] = _table(
    left="""on|at|to the|your left, on the left side, on the left hand side, furthest|farthest left, at|on the far left,
        leftmost, left most, left hand, left""",
    right="""on|at|to the|your right, on the right side, on the right hand side, furthest|farthest right,
        at|on the far right, rightmost, right most, right hand, right""",
    middle="in the middle|centre|center, middle, central",
    near="""closest|nearest|closer|nearer to you|yourself|me, closest|nearest|closer|nearer to the|your robot|gripper|base,
        nearest you, in|at the front, front most, frontmost, nearest, closest, front, nearer, closer""",
    far="""farthest|furthest from you, farthest|furthest away, in|at the back|rear, farthest, furthest, rearmost, back,
        rear""",
    big="biggest, largest, bigger, larger, big, large, huge, widest", tall="tallest, highest, taller, tall",
    small="smallest, littlest, tiniest, smaller, small, little, tiny, narrowest",
    short="shortest, lowest, shorter, short, flattest", any="any|one|either of the|those|these, any one of the, any, either, some",
)  # fmt: skip
"""Words that single one out of several."""
RELATIONS: dict[str, tuple[str, ...]] = _table(
    on="""down onto|over|around|on|the, on top of, onto the top of, onto, on to, on, upon, over the top of, atop, above,
        over, around, round""",
    to="""all the way to, over|across|up to, so that it covers|reaches, so it covers, till|until it covers|touches|reaches,
        until it hits, until it gets to, until it is at|over, towards, toward, to, at, against""",
    left_of="to the left side of, on|to the left of, left of", beside="next|close|near|adjacent to, beside, near, alongside, by",
    right_of="to the right side of, on|to the right of, right of", front_of="in front of, before",
    behind="behind, in back of, beyond", with_="with, using",
    in_="into, inside of, inside, in to, in, within",
    from_="""away from, off of, off, from, out of, that stick|sticks|pokes|stands out of, that is stuck in, stuck in,
        that protrudes from, sticking|poking|jutting out of, protruding from""",
)  # fmt: skip
"""Relation to its wordings."""
UNTIL = _phrases("""until|till it is|sits|rests|lies|lands|stands, so it is|sits|lies|lands, so it ends up, so that it is|sits|rests|lies,
    so that it ends up, to be|lie|sit|rest, to end up, ends up, end up""")
"""Wordings before a relation that add nothing to it."""
_AIMS = {
    (0.0, 1.0): "to the|your left, leftward|leftwards|left",
    (0.0, -1.0): "to the|your right, rightward|rightwards|right",
    (1.0, 0.0): """away from you|yourself, away from the robot, to the front, forward|forwards|ahead|away, straight on""",
    (-1.0, 0.0): """toward|towards you|yourself, toward|towards the robot, closer|nearer to you, closer to the robot,
        to the back, backward|backwards|back""",
}  # fmt: skip
DIRECTIONS = {wording: aim for aim, listed in _AIMS.items() for wording in _phrases(listed)}
"""Directions in the robot's frame: x forward, y left."""
UNITS: dict[str, float] = {
    "mm": 0.001, "millimetre": 0.001, "millimeter": 0.001, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01,
    "dm": 0.1, "m": 1.0, "metre": 1.0, "meter": 1.0, "inch": 0.0254, "inche": 0.0254, "in": 0.0254,
}  # fmt: skip
"""Length units in metres; a plural s is taken off."""
_COUNTED = "one two three four five six seven eight nine ten eleven twelve".split()
NUMBERS: dict[str, float] = {word: n for n, word in enumerate(_COUNTED, 1)}
NUMBERS |= {"half": 0.5, "a": 1, "an": 1, "fifteen": 15, "twenty": 20, "thirty": 30, "forty": 40, "fifty": 50}
"""Number words."""
PRONOUNS = frozenset(("it", "them", "this", "that"))
DETERMINERS = _words("a an the this that these those my your its his her our their another single only")
FILLERS = _words("""
    please start try kindly flat now just then robot gently carefully slowly quickly straight and you can could would
    will i me us want like need must should to be is are was so which that colored coloured color colour shaped
    looking there here of for go ahead up down high higher lower along across upward upwards vertically horizontally safely firmly
    simply also too all way s it its again little bit few lying standing located sitting placed side edge rim own has
    have some help task until till out loose once completely comes hinged clockwise counterclockwise anticlockwise
    away wooden wood plastic metal metallic steel cardboard rubber ceramic further make sure ok okay hey hi well let
    let's lets we off table being by entire whole very rather fully nicely direction distance about around roughly
    approximately exactly at marked painted highlighted outlined designated indicated namely meaning as among find
    locate spot see notice identify look search reach approach head come begin keep continue use using via wants free slow steady gentle careful neatly sat mind alone untouched done finished
    eh ah lah leh pitch than pls plz""")
"""Words that carry nothing for us."""
SEEKING = _words("where find see seen looking missing")
"""Words of clauses about a thing that may not be there."""
WISHING = _words("ought love want wants like need needs should must belongs goes shall let have has wish")
"""A clause with one of them asks for a state of things."""
NEEDING = re.compile(
    r"\b(?:(?:i|we) (?:want|need)|(?:i'd|we'd|could|would|can|may) (?:\w+ )?(?:like|love|have))\b"
)
"""Where no place is said, it asks for a thing."""
SHINING = _words("shine shines shining glow glows glowing lit bright burning alight")
"""States of a lamp that is on."""
HAND = _words("hand gripper fingers finger jaws")
"""Words of the robot's own hand."""
LETTING = _words("leave leaves keep keeps let")
REMAINDER = _words("others other rest everything else")
"""Words of a clause that says what is to be left as it is."""
NEGATIONS = _phrases("""without, do not, don't, dont, never, not, but|and|rather not, rather than, instead of, avoid, leaving,
    ignore, ignoring, disregard, keeping, except, except for, excepting, excluding, other than, apart|aside from, besides, but|save for, neither,
    nor, no""")
"""From one of these to the end of its clause, what is said is what not to do."""
EACH = _words("all any every each everything anything both")
SORTING = _phrases("sort, group, separate, distribute, divide, match, matching, same, both, by")
"""Words of sentences about several things."""
TOUCHES = tuple("knock touch hit bump disturb".split())
MISHAPS = (*TOUCHES, *"toppl tip drop spill break damag crush scratch fall".split())
"""How the words begin that name what no motion is to do anyway: planning avoids it, said or not."""
SINCE = _words("for because cause cos so like as since before")
"""Words from which on it is told why, for whom, or what like."""
TURNING = _words("""if unless when whenever once after until till then first instead except excluding without only or nor
    neither but yet rather stop wait cancel ignore forget never no nope hope wonder dare pretend imagine kidding joking
    changed mind later tomorrow actually sure ready careful don dont leave keep air myself himself herself
    two three four five six seven eight nine ten half""")
"""Words that may turn, delay or call off a wish: a clause with one of them is no aside."""
STANDING = _words("left standing sitting lying sticking poking hanging")
"""A side, and forms of verbs that tell where things are."""
SUBJECTS = _words("""i i'm i've i'll i'd i got we we're we've we'll he he's she she's they they're it it's there there's you
    you've you're someone somebody nobody anybody everybody everyone who my our his""")
"""Whom a statement is about."""
CONDITIONS = _words("if unless when whenever once after until till")
PLACES = _words("on in into inside onto beside behind")
BEING = _words("is are was were 's am looks seems feels stays has had have")
"""Verbs of statements: what is said to be so is not asked for."""
ASKED = _words("""is are was were did does am do has have had should who whose which what when where why how can could may
    will would""")
"""How questions begin; those to ``ASKED_OF`` with one of ``MODALS`` are wishes."""
ASKED_OF = _words("you i we someone somebody anybody mind possible")
MODALS = _words("can could would will might may please kindly mind shall let let's lets wanna")
REPORTING = re.compile(
    r"^(?:\w+ ){1,2}(?:can|could) not\b|\bwould you like\b(?! to)|\b(?:nobody|no one)\b|^it(?:'s|'d| 's| is| was| would)(?! time| possible)[^,]* to \w+"
    r"|\b(?:should|to|could|must|might|would) have (?:put|open|press|lift|push|clos|shut|mov|pull|turn|tak)"
    r"|(?<!would )(?<!'d )(?<!should )(?<!ever )(?<!really )\b(?:like|love)s? (?:the|that|my|it)\b"
)
"""What is said of wishes, and is none: offers, regrets, judgements."""
PLAINER = (
    (r"(^|[,.] )go to (?=the|that)", r"\1find "), (r"\bou?tta\b", "out of"), (r"\b(?:free|clear) (?=of|from)", "out "),
    # asks for nothing more: how, if it is no trouble, so that nothing happens
    (r"\b(?:go ahead (?:and )?|be so (?:kind|good) as to\b)", ""), (r"\b(?:clean|right|straight) (?=out of|off|up)", ""),
    (r"(?:, )?\b(?:i |it )?(?:do|does) not (?:mind|matter|care) (?:how|which|where|what)(?: one)?(?: (?:it|way))?\b", ""),
    (r"\ba (\w+) , any(?: one)?(?: of (?:the|them)(?: \w+)?)? will do\b", r"any \1"),
    (r"^right , |\bright (?=there|here|now|away|beside|next|in front|behind)", ""), (r" , (?:the )?\w+ and all\b", ""),
    (r"(?:, )?\b(?:if|when|whenever) (?:you|possible|it|it's)(?: (?:do|would) not mind| 's| is| no| not| too much| please"
     r"| can| could| would|'d| be| so| like| trouble| bother| kind| good| have| get| got| a \w+){0,5}(?=\s*(?:[.,;!?]|$|and\b))", ""),
    (r"(?:, )?\bso (?:that )?(?:(?:no|nothing|nobody|it no|they)\b|(?:(?:the|my|our|your) )?(?:\w+ ){1,2}(?:can|could|does not"
     r"|do not)\b(?! you))[^,.;!?:]*", ""),
    (r"\b(?:till|until|so)(?: that)? (?:it|the (?:open )?\w+)(?: is|'s| 's)? (?:shuts?|close[sd]|sealed|opens?|clicks)\b", ""),
    (r"\b(?:leave|keep|let) (?=[^,.;]*\b(?:alone|untouched|others?|the rest|everything else|(?:exactly )?where (?:it|they))\b)", "ignore "),
    # wishes
    (r"(^|[,.;!?] |\bso |\band )(?:if you (?:could|would)(?: just)?|why (?:don't|do not) you) (?=\w)", r"\1please "),
    (r"\bsee (?:to it )?(?:that )?(?=[^,.;?!]*\b(?:on|onto|in|into|over)\b)(?=(?:the|that|this|my) )", "i want "),
    (r"\bi(?: would|'d| 'd) (?:appreciate|love|like|prefer) (?:having|to have) (?!a )", "i want "),
    (r"\bto (?:sit|stand|rest|lie|go|end up) (?=(?:on|onto|in|into|over)\b)", "to be "),
    (r"(?<!but )\bkeep ((?:the|that|this|it)\b(?: \w+){0,3}?) (?=(?:on|onto|in|into|inside) (?!the (?:table|desk)))", r"put \1 "),
    (r"\boff with ", "take off "),
    (r"\b((?:flip|lift|raise|swing|pull|pop|open)(?: up)? (?:the|that) (?:\w+ )?(?:lid|flap|cover)) on (?=the|that)", r"\1 of "),
    (r"\bget (?:into|inside) |\b(?:see|check|show me) (?:what (?:is|'s)|the thing) (?:in|inside) "
     r"|\b(?:have|take|get) a \w+ (?:inside|into|in) |\b(?:look|peek|peep) (?:inside|into) ", "open "),
    # words and places
    (r"\b(?:been|is|was|'ve|i|you|we|they|he|she|who|somebody|someone)(?: .s|.s)? left (?=the|that|this|it|their|your|my|his|her|open|up|on|in)", "is "),
    (r"\b(?:him|her) (?=down|up|on|onto|in|into|over|out|off)", "it "),
    (r"\b(?:gimme|give us)\b", "give me"), (r"\by(?:'all|a)\b", "you"), (r"\bof (?:them|'em) (?=\w)", "of the "),
    (r"\b(?:over|across) to (?=(?:the|that|this)\b)", "to "),
    (r"\b(?:mind|careful|take care)(?: \w+){0,3}? (?:does|do) not\b", "do not"),
    (r"\bwhat(?: 's| is|ever is) (?=(?:\w+ )?(?:in|on|inside|behind|beside|next|near|by)\b)", "the thing "),
    (r"\b(?:that|which) (?:is|are|'s|s) (?=(?:on|in|inside|behind|beside|next to|near)\b)", "standing "),
    (r"\b(?:(?:that|which|who) (?:is |'s |are )?(?:stand|stick|sitt?|l[iy]|rest|pok|jutt?|locat|plac)(?:s|es|ing|e|ed)?"
     r"|(?:stick|pok|jutt|hang)ing out)\b(?! out of| of| from| out from)(?: out| up| there| right)*\b", "standing"),
)  # fmt: skip
"""Wordings, and what the grammar reads more easily in their place; "" where they ask for nothing more."""
THEN = re.compile(r"[,;.]?\s+(?:and\s+)?(?:then|after that|afterwards)\b,?\s*", re.IGNORECASE)
"""What parts wishes that follow one another."""
UNREAD = re.compile(
    rf"\d (?:(?:to|minus|,) )?[\d.]+ (?:{'|'.join(UNITS)})s?\b|"
    r"^(?:once|when|whenever|after(?! that| this)|as soon as|tomorrow|tonight|later|next (?:\w+)|at \w+ o'clock)\b"
    r"|\d [cm]?m s\b|\bper\b|\b(?:say|after the|higher than|as high as(?! possible| you))\b|\band a (?:half|quarter)\b|\b(?:after|before) \w+ing\b|\bfrom being\b|(?<!not )\b(?:forget|stop|hesitate|fail|neglect)\b"
    r"|\b(?:refrain|abstain|abort|cancel|call off|skip|pretend|prevent|prohibit|forbid|beware|ceas|quit|resist|declin|refus|postpon|delay|omit|imagin)(?:e|s|es|ing|ting|ping)?\b"
    r"|\btomorrow\b|(?<!little )\bwhen (?:i|we|he|she|they|my) (?!was|were)|\bthe robot (?:can|has|is|will|may|need|does)\b"
    r"|\b(yourself|if|only if|unless|otherwise|or|between|twice|thrice|times|upside|inverted|sideways|non|none"
    r"|said|says|shut up(?! the| that)|on and off|swap|exchange|my (?:left|right)|degrees?|second|third|fourth|fifth|both|half ?way|under|underneath|beneath|below|opposite|whichever"
    r"|(?:closest|nearest|nearer|closer|furthest|farthest) (?:to|from) (?!you|the robot|the gripper|me\b)[a-z ]{1,12}|(?:closer|nearer)$|as (?:close|near|far))\b"
)
"""Words that change what a sentence asks for in ways that this grammar does not follow: it is declined then."""
IRREGULAR: dict[str, str] = {
    "took": "take", "taken": "take", "got": "get", "held": "hold", "brought": "bring", "lit": "light", "given": "give",
    "laid": "lay", "slid": "slide", "swept": "sweep", "made": "make", "hung": "hang", "stuck": "stick", "thrown": "throw",
}  # fmt: skip
"""Inflections that no rule gives."""
