"""A log as some settings read it, and the degrees of freedom that can be tuned with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from rovid_core.model.dofs import OWN
from rovid_core.settings.run import DofSettings, IdentifierSettings, Settings, ThrusterSettings
from rovid_core.trials.tuning.cross_validation import FOLDS, PART, time_of
from rovid_core.trials.tuning.dof_fit import Dof, dof_or_reason
from rovid_core.trials.tuning.log import CommandedForce, TuningLog, turnable

UNUSED = DofSettings(1.0)  # a DOF that is only looked at


class TuningError(ValueError):
    """A log that tells nothing; the text is the line to print."""


def reading_settings(settings: Settings) -> Settings:
    """
    Return the settings with which a log is read to be tuned.

    Of the plane both DOFs, for a wrong heading shows in the one that has no thrust; all couplings
    of which the regressors are measured, also by an input that no DOF is identified from; and the
    simplest identifier, for what it finds is not used.
    """
    dofs, pair = settings.dofs, turnable(settings)
    dofs += tuple(dof for dof in pair or () if dof not in dofs)
    seen = replace(settings, dofs=dofs, dof={d: settings.dof.get(d, UNUSED) for d in dofs},
                   identifier=IdentifierSettings())
    return replace(seen, dof={d: replace(
        seen.dof[d], couplings=tuple(dict.fromkeys((
            *seen.possible_couplings(d), *OWN, *seen.couplings(d))))) for d in dofs})


@dataclass(frozen=True)
class Reading:
    """A log as some settings read it."""

    settings: Settings
    log: TuningLog
    commanded: CommandedForce
    dofs: Sequence[Dof]  # those that are tuned with
    left_out: Mapping[str, str]  # why each of the others is not


def read_log(read: Callable[[Settings], TuningLog], settings: Settings,
          thrusters: ThrusterSettings) -> Reading:
    """Read the log, for commands to such thrusters; TuningError if it tells nothing."""
    log = read(settings)
    if log.jumped:
        raise TuningError('time jumps back in it: take a part of it with --start and --duration')
    seen, commanded = reading_settings(settings), log.commanded(thrusters)
    longest = max(time_of(log.segments(name)) for name in settings.dofs)
    count = max(1, round(longest / (FOLDS * PART)))
    found = {name: dof_or_reason(log, seen, name, settings.dof[name], commanded, count)
             for name in settings.dofs}
    dofs = [dof for dof in found.values() if isinstance(dof, Dof)]
    left_out = {name: why for name, why in found.items() if isinstance(why, str)}
    if not dofs:
        raise TuningError('nothing to tune with: ' + '; '.join(
            f'{name}: {why}' for name, why in left_out.items()))
    return Reading(settings, log, commanded, dofs, left_out)
