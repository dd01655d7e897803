"""What a check found, a line each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

OK, WARNING, ERROR = 'OK', 'WARNING', 'ERROR'


@dataclass(frozen=True)
class Finding:
    """
    One thing that was looked at.

    Attributes
    ----------
    level : str
        OK, WARNING or ERROR.
    subject : str
        The key, topic or file that it is about.
    text : str
        What was found.
    advice : str
        What to change; '' if nothing.

    """

    level: str
    subject: str
    text: str
    advice: str = ''

    def __str__(self) -> str:
        """Return the line."""
        advice = f'; {self.advice}' if self.advice else ''
        return ' '.join(f'{self.level:<8}{self.subject}: {self.text}{advice}'.split('\n'))


class Findings:
    """All that was found, in the order in which it was looked at."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def ok(self, subject: str, text: str) -> None:
        """Say that something is as it should be."""
        self.all.append(Finding(OK, subject, text))

    def warning(self, subject: str, text: str, advice: str = '') -> None:
        """Say that something looks wrong."""
        self.all.append(Finding(WARNING, subject, text, advice))

    def error(self, subject: str, text: str, advice: str = '') -> None:
        """Say that something cannot work."""
        self.all.append(Finding(ERROR, subject, text, advice))

    def count(self, level: str) -> int:
        """Return how many there are of a level."""
        return sum(one.level == level for one in self.all)

    def verdict(self) -> str:
        """Return how many errors and warnings there are."""
        counts = [(self.count(level), name)
                  for level, name in ((ERROR, 'error'), (WARNING, 'warning'))]
        parts = [f'{count} {name}{"s" if count > 1 else ""}' for count, name in counts if count]
        return ' and '.join(parts) or 'all is well'

    def document(self) -> list[dict[str, Any]]:
        """Return them for a program to read."""
        return [asdict(one) for one in self.all]
