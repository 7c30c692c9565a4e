"""Affordances: what each skill can be done to in a scene, told from geometry before anything is planned.

A language model that may name only what a skill fits is wrong far less often. The rules are generous: what a skill
turns out not to do, :func:`gvla2.skills.carry_out.carry_out` refuses with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gvla2.planning.arm import Hand
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.caps import cap_of, closed_by
from gvla2.skills.holds import holds
from gvla2.skills.mechanisms import hinge_for, slide_for
from gvla2.skills.parts import button_of, called, is_button, root_of
from gvla2.skills.schemas.insert import fits_over
from gvla2.skills.skill import Skill
from gvla2.skills.stuck import stuck
from gvla2.skills.wholes import assembled, holders, inside

RESTING = 0.02
"""What is pushed along the table stands no higher above it, metres."""
BUTTON = 0.06
"""A button is no wider than this, metres."""

Fits = Callable[[SceneObject, Scene, Hand], bool]


def themes(skill: Skill, scene: Scene, hand: Hand) -> tuple[SceneObject, ...]:
    """What the skill can be done to, in the scene's order; painted patches never."""
    fits = skill.fits or FITS.get(skill.name, lambda thing, scene, hand: True)
    return tuple(o for o in scene.objects if o.shape != "region" and fits(o, scene, hand))


def goals(skill: Skill, theme: SceneObject, scene: Scene) -> tuple[SceneObject, ...]:
    """Where the skill can lead with this theme; () for one that leads nowhere.

    Not to itself, to its own parts or whole, nor on or into what it stands in already.
    """
    if skill.role("goal") is None:
        return ()
    kin = {theme.id, root_of(theme, scene).id, *(p.id for p in scene.parts_of(root_of(theme, scene).id))}
    if skill.name == "insert":
        return tuple(o for o in scene.objects if o.id not in kin and fits_over(theme, o))
    about = {h.id for h in holders(theme, scene) if inside(theme, h)}
    return tuple(o for o in scene.objects if o.id not in kin | about)


def _movable(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """By itself, and between the fingers: a whole thing, or a cap that comes off."""
    if thing.parent and closed_by(thing, scene) is None:
        return False
    if any(m is not None for m in (hinge_for(thing, scene), slide_for(thing, scene))):
        return False
    if is_button(thing, scene) and thing.parent:
        return False
    return stuck(thing, scene) is not None or bool(holds(assembled(thing, scene), hand))


def _pushed(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return not thing.parent and thing.bottom - scene.table_height < RESTING


def _pressed(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    kin = scene.parts_of(root_of(thing, scene).id)
    if is_button(thing, scene) and not called(thing, "button") and any(called(p, "button") for p in kin):
        return False
    return button_of(thing, scene) is not None and (
        bool(scene.parts_of(thing.id)) or float(max(thing.extents[:2])) < BUTTON
    )


def _twisted(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return cap_of(thing, scene) is not None


def _opened(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    worked = hinge_for(thing, scene) is not None or slide_for(thing, scene) is not None
    return worked or cap_of(thing, scene) is not None


def _closed(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return hinge_for(thing, scene) is not None or slide_for(thing, scene) is not None


def _pulled(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return slide_for(thing, scene) is not None


def _drawn(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return stuck(thing, scene) is not None


def _inserted(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    return any(fits_over(thing, post) for post in scene.objects if post.id != thing.id)


FITS: Mapping[str, Fits] = {
    "pick": _movable,
    "place": _movable,
    "push": _pushed,
    "press": _pressed,
    "twist": _twisted,
    "open": _opened,
    "close": _closed,
    "pull": _pulled,
    "draw": _drawn,
    "insert": _inserted,
}
"""The standard skills' rules; a skill of one's own brings its own as ``fits``, or fits everything."""
