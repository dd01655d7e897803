"""What surge and sway together predict without corrections, from the beginning of each block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rovid_core.identify.ekf.planar.filter_with_current import PlanarFilter
from rovid_core.identify.ekf.planar.layout import Row
from rovid_core.identify.ekf.planar.member import PlanarMeasurement, Recent
from rovid_core.identify.ekf.single.free_prediction import BlockFits, SPAN
from rovid_core.identify.ekf.single.linearised_filter import floats
from rovid_core.identify.method import DivergenceError


class PlanarPrediction:
    """
    A model that runs beside the filter and is set to its state at the end of each block.

    Parameters
    ----------
    rows : pair of Row
        Surge and sway.
    size : int
        Number of parameters.

    Attributes
    ----------
    fits : list of 2 floats
        1 - rms(error) / std(measured) of the velocity of surge and sway over the last blocks with
        motion, without what the noise of the fixes has in both.

    """

    def __init__(self, rows: tuple[Row, Row], size: int) -> None:
        self._model = PlanarFilter(rows, [0.0] * size, [0.0] * size)
        self._noise = 0.0
        self._fits = BlockFits(clean=True), BlockFits(clean=True)
        self.interrupt()

    @property
    def fits(self) -> list[float]:
        """Return how well the model predicts surge and sway."""
        return [one.fit for one in self._fits]

    def interrupt(self) -> None:
        """Wait for the end of the block: the path begins anew."""
        self._runs = False
        self._mark: list[float] = []  # time, position of the model, measured position

    def move(self, recent: Recent, span: PlanarMeasurement) -> None:
        """Go on to the next measurement and compare."""
        if not self._runs:
            return
        model = self._model
        try:
            model.move(recent, span.start, span.end, span.pieces, span.couplings, 0.0,
                       alone=True)
        except DivergenceError:
            self.interrupt()
            return
        if span.looks is not None:
            self._add((span.looks @ model.motion).tolist(), span.value, self._noise**2)
            return
        now = [span.end, *model.motion[:2].tolist(), *span.value]
        if not self._mark:
            self._mark = now
            return
        dt = now[0] - self._mark[0]
        if dt < SPAN:
            return
        a, b, x, y = [(p - q) / dt for p, q in zip(now[1:], self._mark[1:])]
        sx, sy, wx, wy, *_ = span.pieces[-1]
        self._add((sx * a + sy * b, wx * a + wy * b), (sx * x + sy * y, wx * x + wy * y),
                  2.0 * (self._noise / dt)**2)
        self._mark = now

    def _add(self, model: Sequence[float], measured: Sequence[float], noise: float) -> None:
        for one, a, b in zip(self._fits, model, measured):
            one.add(a, b, noise)

    def end_block(self, filter: PlanarFilter, noise: float) -> None:
        """Take the fit of the block and begin the next one at the state of a filter."""
        for one in self._fits:
            one.end_block()
        self._noise = noise
        self._model.theta = filter.theta
        self._model.motion[:] = filter.motion
        self._mark, self._runs = [], True

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self._model.theta.tolist(), 'motion': self._model.motion.tolist(),
                'runs': self._runs, 'mark': self._mark, 'noise': self._noise,
                'fits': [one.state() for one in self._fits]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self._model.restore({**self._model.state(), 'theta': state['theta'],
                             'motion': state['motion']})
        self._runs, self._mark = bool(state['runs']), floats(state['mark'], len(state['mark']))
        self._noise, = floats([state['noise']], 1)
        for one, fits in zip(self._fits, state['fits']):
            one.restore(fits)
        if len(self._mark) not in (0, 5):
            raise ValueError('a prediction that does not fit')
