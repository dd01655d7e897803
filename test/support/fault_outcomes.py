"""What came of a run with a fault in it, and how it differs from one without."""

from __future__ import annotations

from dataclasses import dataclass, field
import re

from test.support.fault_edits import SECOND, Span

AFTER = 10 * SECOND
"""[ns] For so long after a fault it is still what a status speaks of."""


@dataclass
class Outcome:
    """
    What came of a run.

    Attributes
    ----------
    rejected : dict
        ``input.reason`` -> how often.
    warnings : list of str
        One line each.
    notes : list of (int, tuple of str)
        What was said of the DOFs from an arrival [ns] on.
    not_finite : int
        How many estimates held a NaN or an infinite number.
    models : dict
        DOF -> parameters in the end.
    steps : list of str
        Time, v_hat and force of all DOFs after every step, to the last bit.
    released : list of (int, int)
        Arrival of each message [ns] -> how many steps there were after it.
    failed : str
        What stopped the run, '' if nothing did.

    """

    rejected: dict[str, int] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    notes: list[tuple[int, tuple[str, ...]]] = field(default_factory=list)
    not_finite: int = 0
    models: dict[str, tuple[float, ...]] = field(default_factory=dict)
    steps: list[str] = field(default_factory=list)
    released: list[tuple[int, int]] = field(default_factory=list)
    failed: str = ''

    def noted(self, span: Span) -> dict[str, str]:
        """Return what was said of the DOFs in a span, by what it is without numbers."""
        found: dict[str, str] = {}
        for (time, texts), (until, _) in zip(self.notes, [*self.notes[1:], (span.off, ())]):
            if time < span.off and until >= span.on:
                for text in texts:
                    found.setdefault(without_numbers(text), text)
        return found

    def beyond(self, usual: Outcome, span: Span) -> tuple[dict[str, int], list[str]]:
        """Return what was refused, and what was said, that is not so without the fault."""
        refused = {name: count - usual.rejected.get(name, 0)
                   for name, count in self.rejected.items()
                   if count > usual.rejected.get(name, 0)}
        known = {without_numbers(line) for line in usual.warnings}
        said = [line for line in self.warnings if without_numbers(line) not in known]
        span = Span(span.on, span.off + AFTER)
        said += [text for key, text in self.noted(span).items() if key not in usual.noted(span)]
        return refused, said


def step_text(time: int, v_hats: list[float], forces: list[float]) -> str:
    """Return what tells a step from any other, to the last bit."""
    return f'{time} {v_hats} {forces}'


def without_numbers(line: str) -> str:
    """Return what a line says, whatever the numbers in it are."""
    return re.sub(r'-?\d[\d.,e+-]*', '#', line)
