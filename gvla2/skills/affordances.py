"""Affordances: the objects of a scene to which each skill applies, from geometry, before anything is planned.

A language model that may name only these is wrong far less often. The rules are generous: a call that turns out to be
impossible is refused with its reason by :func:`gvla2.skills.carry_out.carry_out`. ``fits_NAME`` is the rule of the
standard skill of that name; see :attr:`gvla2.skills.skill.Skill.fits`.
"""

from __future__ import annotations

from gvla2.planning.arm import Hand
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.holds import has_hold
from gvla2.skills.mechanisms import hinge_for, slide_for
from gvla2.skills.parts import button_of, called, cap_of, closed_by, is_button, root_of
from gvla2.skills.schemas.insert import fits_over
from gvla2.skills.skill import Skill
from gvla2.skills.stuck import stuck
from gvla2.skills.wholes import assembled, holders, inside

RESTING = 0.02
"""Greatest height above the table of the bottom of an object that can be pushed, metres."""
BUTTON = 0.06
"""Greatest width of a button that is no part, metres."""


def themes(skill: Skill, scene: Scene, hand: Hand) -> tuple[SceneObject, ...]:
    """The objects to which the skill applies, in the scene's order; never painted patches."""
    solid = (o for o in scene.objects if o.shape != "region")
    return tuple(o for o in solid if skill.fits is None or skill.fits(o, scene, hand))


def goals(skill: Skill, theme: SceneObject, scene: Scene) -> tuple[SceneObject, ...]:
    """The objects that can be the skill's goal with this theme; () for a skill without a goal.

    Not the theme itself, its parts or its whole, nor what it stands in.
    """
    if skill.role("goal") is None:
        return ()
    kin = scene.family(root_of(theme, scene).id)
    if skill.name == "insert":
        return tuple(o for o in scene.objects if o.id not in kin and fits_over(theme, o))
    about = {h.id for h in holders(theme, scene) if inside(theme, h)}
    return tuple(o for o in scene.objects if o.id not in kin | about)


def fits_pick(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A whole object, or a cap, that can be moved and that fits between the fingers."""
    if thing.parent and closed_by(thing, scene) is None:
        return False
    if fits_close(thing, scene, hand) or (is_button(thing, scene) and thing.parent):
        return False
    return stuck(thing, scene) is not None or has_hold(assembled(thing, scene), hand)


fits_place = fits_pick


def fits_push(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A whole thing on the table."""
    return not thing.parent and thing.bottom - scene.table_height < RESTING


def fits_press(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A button, or something with one button; if a part is labelled a button, no other part."""
    kin = scene.parts_of(root_of(thing, scene).id)
    if is_button(thing, scene) and not called(thing, "button") and any(called(p, "button") for p in kin):
        return False
    return button_of(thing, scene) is not None and (
        bool(scene.parts_of(thing.id)) or float(max(thing.extents[:2])) < BUTTON
    )


def fits_twist(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A cap, or something closed by one."""
    return cap_of(thing, scene) is not None


def fits_open(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """Something with a hinge, a slide or a cap."""
    return fits_close(thing, scene, hand) or fits_twist(thing, scene, hand)


def fits_close(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """Something with a hinge or a slide."""
    return hinge_for(thing, scene) is not None or slide_for(thing, scene) is not None


def fits_pull(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """Something with a slide."""
    return slide_for(thing, scene) is not None


def fits_draw(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A thing held between others."""
    return stuck(thing, scene) is not None


def fits_insert(thing: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A thing with a hole that fits over some other thing."""
    return any(fits_over(thing, post) for post in scene.objects if post.id != thing.id)
