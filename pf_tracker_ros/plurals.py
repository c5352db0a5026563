"""Numbers of things in sentences."""

from __future__ import annotations


def counted(count: int, thing: str, things: str = "") -> str:
    """A number of things: "1 frame", "2 frames".

    Args:
        count: How many, from 0.
        thing: What one is called.
        things: What several are called; without it, the same with an s.
    """
    return f"{count} {thing if count == 1 else things or f'{thing}s'}"
