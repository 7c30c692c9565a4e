"""Part of a small shop."""


def with_tag(tag, tags=[]):
    """Return the collection with one more."""
    tags.append(tag.lower())
    return sorted(tags)
