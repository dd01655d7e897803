"""What came of a long run."""

from __future__ import annotations

from dataclasses import dataclass, field

from rovid_core.dofs import PARAMETERS
from rovid_core.plant import lumped
from rovid_core.settings import Settings

SETTLED = 600.0
"""[s] after which memory must not grow any more; in a shorter run, a third of it."""

LINES = 12
"""Lines of the table."""


@dataclass
class Soak:
    """
    What came of a long run.

    Attributes
    ----------
    name : str
        Of the run.
    duration : float
        [s]
    memory : list of (float, int)
        Time [s] and what the process held [bytes].
    steps, missed : int
        Steps; measurements that gave none.
    refused : dict
        ``input.reason`` -> how many samples or steps.
    models : dict
        DOF -> parameters in the end.

    """

    name: str
    duration: float
    memory: list[tuple[float, int]] = field(default_factory=list)
    steps: int = 0
    missed: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    models: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def growth(self) -> int:
        """Return how much more was held after ``SETTLED`` than at that time [bytes]."""
        settled = min(SETTLED, self.duration / 3.0)
        after = [size for time, size in self.memory if time >= settled]
        return max(after) - after[0]

    def off(self, settings: Settings) -> float:
        """Return the largest error of a parameter, in parts of it."""
        worst = 0.0
        for dof, model in self.models.items():
            true = settings.simulation.dofs[dof]
            truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
            worst = max(worst, *(abs(p / t - 1.0) for p, t in zip(model, truth)))
        return worst

    def lines(self, settings: Settings) -> list[str]:
        """Return the result in Markdown."""
        refused = ', '.join(f'{name} {count:,}' for name, count in self.refused.items() if count)
        found = [
            f'{self.name}: {self.steps:,} steps, {self.missed:,} missed; refused: '
            f'{refused or "nothing"}; largest error of '
            f'{", ".join(PARAMETERS)}: {100 * self.off(settings):.2f} %; memory grew by '
            f'{self.growth / 1000:,.0f} kB after the first '
            f'{min(SETTLED, self.duration / 3) / 60:.3g} minutes.', '',
            '| after [min] | memory [MB] |', '| --- | --- |']
        every = max(1, round(len(self.memory) / LINES))
        shown = [*self.memory[:-1:every], self.memory[-1]]
        return found + [f'| {time / 60:.1f} | {size / 1e6:.2f} |' for time, size in shown] + ['']
