"""Whether a lamp shines, by comparing its look before and now."""

from __future__ import annotations

import numpy as np

from gvla2.planning.scene import Scene, SceneObject

BRIGHTER = 0.25
"""Increase of white, in [0, 1], above which something shines; shadows and angles change less."""
SAME_SPOT = 0.04
"""Largest distance of a lamp's part from its former place, metres."""


def shines(button: SceneObject, before: Scene, after: Scene) -> bool | None:
    """Whether the lamp of a button shines now; None if there is no lamp or it was not seen again."""
    kin = {button.parent, *(part.id for part in before.parts_of(button.parent))} if button.parent else set()
    lamp = [o for o in before.objects if o.id in kin and o.id != button.id]
    if not any("lamp" in o.label.split() or "light" in o.label.split() for o in lamp):
        return None
    found = [change for part in lamp if (change := _brighter(part, after)) is not None]
    return max(found) > BRIGHTER if found else None


def _brighter(part: SceneObject, after: Scene) -> float | None:
    near = [o for o in after.objects if np.linalg.norm((o.centre - part.centre)[:2]) < SAME_SPOT]
    return max((float(o.rgb.mean() - part.rgb.mean()) for o in near), default=None)
