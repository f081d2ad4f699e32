"""Words for readers: what messages of this floor have in common."""

from __future__ import annotations

from collections.abc import Sequence


def listed(names: Sequence[str], limit: int = 6) -> str:
    """Names in a row, long lists cut."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


def loops_listed(names: Sequence[str]) -> str:
    """``loop foot``, ``loops foot, hand``."""
    return f"loop{'s' * (len(names) > 1)} {listed(names)}"
