"""Arrays that are handed to several components: none of them can change what the others see."""

from __future__ import annotations

from copy import copy
from dataclasses import fields, is_dataclass
from typing import TypeVar, cast

import numpy as np

T = TypeVar("T")


def read_only(value: T) -> T:
    """The value with every array in it read-only: itself, or those in tuples and dataclasses.

    What holds a writable array is rebuilt around a view of it: whoever made the array, a camera with a buffer of its
    own, may write to it again. Nothing is copied, and what is read-only already is returned as it is.
    """
    if isinstance(value, np.ndarray):
        if not value.flags.writeable:
            return value
        seen = value.view()
        seen.setflags(write=False)
        return seen
    if isinstance(value, tuple) and type(value) is tuple:
        parts = tuple(read_only(part) for part in value)
        changed = any(new is not old for new, old in zip(parts, value, strict=True))
        return cast("T", parts) if changed else value
    if not is_dataclass(value) or isinstance(value, type):
        return value
    made: T = value
    for one in fields(value):
        part = getattr(value, one.name)
        if (frozen := read_only(part)) is not part:
            made = copy(value) if made is value else made
            object.__setattr__(made, one.name, frozen)
    return made
