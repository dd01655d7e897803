"""A vehicle under two sinusoids, as steps for one identifier; and values that are far off."""

import math

from hypothesis import strategies as st
from rovid_core.model.plant import advance, lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings

DOF = DofSettings(400.0, 150.0, 20.0, 1.0)
TRUTH = lumped(290.0, 290.0, 43.5, 2.9)

wild = st.floats(allow_nan=True, allow_infinity=True)
values = st.one_of(wild, st.sampled_from(
    [0.0, 1.0, -1.0, 1e300, -1e300, math.inf, math.nan, 1e-300, 1e12]))


def steps(count=400, dt=0.1, force=1.0, velocity=1.0):
    """Return a vehicle under two sinusoids, with force and velocity scaled."""
    out, v = [], 0.0
    for k in range(count):
        t = (k + 0.5) * dt
        f = 150 * math.sin(2 * math.pi * t / 18) + 80 * math.sin(2 * math.pi * t / 7.3)
        new = advance(TRUTH, v, f, dt)
        out.append(Step(
            dt, (velocity * v, velocity * 0.5 * (v + new), velocity * new), (force * f,) * 3,
            mean=velocity * new, interval=dt, parts=(0.5 * dt, 0.5 * dt),
            forces=(force * f, force * f)))
        v = new
    return out


def run(identifier, sequence, adapt=True):
    for step in sequence:
        assert identifier.step(step, adapt) == ''
    return identifier
