"""Timing calls."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np

Thing = TypeVar("Thing")


def spent(work: Callable[[Thing], object], things: Iterable[Thing]) -> list[float]:
    """Seconds of each call."""
    times = []
    with _no_collection():
        for thing in things:
            began = time.perf_counter()
            work(thing)
            times.append(time.perf_counter() - began)
    return times


def once(work: Callable[[], object]) -> float:
    """Seconds of one call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def high(times: list[float]) -> float:
    """The 95th percentile."""
    return float(np.percentile(times, 95))


def middle(times: list[float]) -> float:
    """The median."""
    return float(np.median(times))


@contextmanager
def _no_collection() -> Iterator[None]:
    """Collects garbage before, not during, for us and the peer."""
    gc.collect()
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
