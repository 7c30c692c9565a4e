"""Rows, and what the events say of them, as canonical JSON: equal byte for byte."""

from gvla2.memory.records import as_json, dump
from gvla2.memory.storage.store import Store
from tests.memory.looking import look


def stored_and_rebuilt(store: Store, bank: str = "b") -> tuple[str, str]:
    """The records and links of a bank as they are stored, and as its events make them."""
    rebuilt = look(store, bank).rebuilt()
    pairs = ((look(store, bank).records(), look(store, bank).links()), (rebuilt.records, rebuilt.links))
    first, second = (
        dump([[as_json(r) for r in records], [[x.source, x.kind, x.target, x.at] for x in links]])
        for records, links in pairs
    )
    return first, second
