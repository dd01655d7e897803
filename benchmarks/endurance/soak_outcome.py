"""What came of a long run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.plant import lumped
from rovid_core.settings.run import Settings

from test.support.fault_runs import WAVES
from test.support.trials import error

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

    def errors(self, settings: Settings) -> dict[str, tuple[list[float], float]]:
        """Return by DOF the parameters' errors, in parts, and that of predicted velocities."""
        found = {}
        for dof, model in self.models.items():
            true = settings.simulation.dofs[dof]
            truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
            found[dof] = ([p / t - 1.0 for p, t in zip(model, truth)],
                          error(truth, cast(Four, model), WAVES[dof]))
        return found

    def lines(self, settings: Settings) -> list[str]:
        """Return the result in Markdown."""
        refused = ', '.join(f'{name} {count:,}' for name, count in self.refused.items() if count)
        errors = self.errors(settings)
        largest = max(abs(x) for parts, _ in errors.values() for x in parts)
        found = [
            f'{self.name}: {self.steps:,} steps, {self.missed:,} missed; refused: '
            f'{refused or "nothing"}; largest error of '
            f'{", ".join(PARAMETERS)}: {100 * largest:.2f} %; memory grew by '
            f'{self.growth / 1000:,.0f} kB after the first '
            f'{min(SETTLED, self.duration / 3) / 60:.3g} minutes.', '',
            f'| | {" | ".join(PARAMETERS)} [%] | predicted velocity [mm/s, mrad/s] |',
            '| --- ' * (len(PARAMETERS) + 2) + '|',
            *(f'| {dof} | {" | ".join(f"{100 * x:+.2f}" for x in parts)} | {1000 * off:.2f} |'
              for dof, (parts, off) in errors.items()), '',
            '| after [min] | memory [MB] |', '| --- | --- |']
        every = max(1, round(len(self.memory) / LINES))
        shown = [*self.memory[:-1:every], self.memory[-1]]
        return found + [f'| {time / 60:.1f} | {size / 1e6:.2f} |' for time, size in shown] + ['']
