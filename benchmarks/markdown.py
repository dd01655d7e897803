"""Tables in Markdown, as GitHub shows them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def row(*cells: object) -> str:
    """Return a line of a table."""
    return f'| {" | ".join(map(str, cells))} |'


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with its head."""
    return '\n'.join([row(*columns), row(*['---'] * len(columns)), *(row(*one) for one in rows)])
