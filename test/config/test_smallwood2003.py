"""The configuration that is the paper's identifier and nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest
from rovid_core.model.samples import Event, Sample, Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

CONFIG = Path(__file__).parents[2] / 'config'
DURATION = 120.0  # [s]


class PaperIdentifier:
    """Eq. 7, 8 and 11 by Euler, on the steps that the pipeline makes."""

    def __init__(self, settings: Settings) -> None:
        a, gains = settings.identifier.feedback_gain, settings.identifier.adaptation_gains
        self.a = a
        self.gains = {d: gains[4 * i:4 * i + 4] for i, d in enumerate(settings.dofs)}
        self.v_hat: dict[str, float] = {}
        self.theta = {d: [1 / x.mass, -x.quadratic_drag / x.mass, -x.linear_drag / x.mass,
                          -x.bias / x.mass] for d, x in settings.dof.items()}

    def begin_run(self, dof: str, time: int, velocity: float,
                  axis: tuple[float, ...] = ()) -> None:
        """Begin at a measured velocity."""
        self.v_hat[dof] = velocity

    def add_step(self, dof: str, span: tuple[int, int, int], step: Step,
                 axes: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())) -> None:
        """Make a step."""
        v_hat, theta = self.v_hat[dof], self.theta[dof]
        dv = v_hat - step.velocity[0]
        phi = [step.force[1], v_hat * abs(v_hat), v_hat, 1.0]
        rate = self.a * dv + sum(p * x for p, x in zip(theta, phi))
        self.v_hat[dof] = v_hat + step.dt * rate
        self.theta[dof] = [
            p - step.dt * g * dv * x for p, g, x in zip(theta, self.gains[dof], phi)]

    def begin_anew(self, dof: str) -> None:
        raise AssertionError(f'{dof} begins anew')

    def add_current(self, time: int, x: float, y: float) -> None:
        raise AssertionError('a current in still water')

    def add_commands(self, time: int, raw: tuple[float, ...]) -> None:
        """Take nothing from them: a step has the force."""

    def add_reference(self, time: int, value: tuple[float, ...]) -> None:
        """Take nothing from it."""

    def set_cutoff(self, cutoff: float) -> None:
        raise AssertionError('another cutoff')


def test_it_is_the_paper_s_equations_at_every_step() -> None:
    settings = settings_from(load(CONFIG / 'smallwood2003.yaml'))
    truth = settings_from(load(CONFIG / 'jhurov.yaml')).simulation
    paper = PaperIdentifier(settings)
    stream = Stream(settings, scorer=paper)
    first = {d: list(theta) for d, theta in paper.theta.items()}
    for time, name, value in simulate(replace(settings, simulation=truth), DURATION, 1):
        for estimate in stream.receive(Event(time, (Sample(name, value),))):
            for i in estimate.stepped:
                dof = estimate.dofs[i]
                assert dof.parameters == pytest.approx(paper.theta[dof.dof], rel=1e-9)
                assert dof.v_hat == pytest.approx(paper.v_hat[dof.dof], rel=1e-9, abs=1e-12)
    assert not stream.rejected
    for name, dof in truth.dofs.items():  # and it learns the mass
        mass, guess = 1 / paper.theta[name][0], 1 / first[name][0]
        assert abs(mass / dof.mass - 1.0) < 0.5 * abs(guess / dof.mass - 1.0)
