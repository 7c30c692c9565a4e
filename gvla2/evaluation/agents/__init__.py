"""Software agents measured: tasks solved, steps, tokens and seconds, with one memory or another."""

from __future__ import annotations
