"""Counts with singular and plural nouns."""

from __future__ import annotations


def counted(count: int, thing: str, things: str = "") -> str:
    """A number of things: "1 frame", "2 frames".

    Args:
        count: Number, from 0.
        thing: Singular.
        things: Plural; by default the singular with an s.
    """
    return f"{count} {thing if count == 1 else things or f'{thing}s'}"
