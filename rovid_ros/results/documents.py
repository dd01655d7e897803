"""
The JSON of ``rovid replay``, and the models read back from it and from that of ``rovid compare``.

Only alpha to delta and the couplings are read; the physical parameters follow from them, to the
same bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import json
import math
from pathlib import Path
from typing import Any

from rovid_core.identify.estimate import Current, DofEstimate, Estimate
from rovid_core.identify.intervals import Interval
from rovid_core.identify.status import Judgement
from rovid_core.model.dofs import COUPLINGS, DOFS, Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.model.thrusters import AS_CONFIGURED, read_thrusters, Thrusters
from rovid_core.settings.run import Scales, Settings
from rovid_core.trials.score import Score
from rovid_ros import build
from rovid_ros.messages.field_paths import nearest
from rovid_ros.results.current import current_values, told

_THRUSTERS = ('lag_s', 'dead_band', 'reverse', 'loss')
"""Names of what ``Thrusters`` has."""


@dataclass(frozen=True)
class Result:
    """
    What a replay gave.

    Attributes
    ----------
    logs : tuple of Path
        What was read.
    settings : Settings
        The run.
    steps : int
        Number of estimates, each of which the node would publish.
    messages : int
        Number of messages read.
    duration : float
        Time [s] from the first of them to the last.
    dofs : dict
        Per DOF, as in the JSON: see :func:`dofs_document`.
    rejected : dict
        (input, reason) -> how many.
    current : dict, optional
        Of the water, as in the JSON: see :func:`current_document`.
    start : int, optional
        When the log begins [ns since 1970]; None where its clock does not tell.
    metadata : dict
        What the log says of itself, by name.

    """

    logs: tuple[Path, ...]
    settings: Settings
    steps: int
    messages: int
    duration: float
    dofs: Mapping[str, Mapping[str, Any]]
    rejected: Mapping[tuple[str, str], int]
    current: Mapping[str, Any] | None = None
    start: int | None = None
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` writes."""
        reasons: dict[str, int] = {}
        for (_, reason), count in sorted(self.rejected.items()):
            reasons[reason] = reasons.get(reason, 0) + count
        return {
            'rovid': build(), 'method': self.settings.identifier.method, 'steps': self.steps,
            'duration_s': self.duration, 'rejected': reasons, 'dofs': self.dofs,
            'current': self.current}


def dofs_document(settings: Settings, estimate: Estimate | None,
            scores: Mapping[str, Score] | None = None,
            verdicts: Mapping[str, str] | None = None,
            joint: Mapping[str, Score] | None = None,
            judgements: Mapping[str, Judgement] | None = None) -> dict[str, dict[str, Any]]:
    """
    Return the ``dofs`` part of the JSON of ``rovid replay``.

    Parameters
    ----------
    settings : Settings
        What DOFs there are.
    estimate : Estimate or None
        The last one; None where there was no step: the initial values, no steps, waiting.
    scores : mapping of str to Score, optional
        The score of each DOF.
    verdicts : mapping of str to str, optional
        What the data leave open of each DOF.
    joint : mapping of str to Score, optional
        The score of DOFs with couplings when all DOFs are simulated together.
    judgements : mapping of str to Judgement, optional
        The status of each DOF over all of the data, instead of that of the last step.

    Returns
    -------
    dofs : dict
        Per DOF the parameters in both forms, ``std``, their 95 % ``intervals`` and
        ``delay_s`` (None where there are none), ``mae``, ``fit``, ``steps``, ``status``,
        ``reasons`` and ``verdict``, and ``couplings`` and ``fit_joint`` where a DOF has
        couplings, ``thrusters`` where they are found to work otherwise than configured, and
        ``newtons`` where it is false; a number that is not finite is None.

    """
    dofs = estimate.dofs if estimate else tuple([
        DofEstimate(name, Scales.of(settings.dof[name]).initial) for name in settings.dofs])
    result: dict[str, dict[str, Any]] = {}
    for dof in dofs:
        score = (scores or {}).get(dof.dof)
        known = any(math.isfinite(x) for x in dof.std)
        judgement = (judgements or {}).get(dof.dof, dof.judgement)
        result[dof.dof] = {
            **json_numbers(PARAMETERS, dof.parameters),
            'std': json_numbers(PARAMETERS, dof.std) if known else None,
            **json_numbers(PHYSICAL, physical(dof.parameters)),
            'intervals': _intervals(dof.intervals),
            'delay_s': {'value': dof.delay, 'std': json_number(dof.delay_std)}
            if math.isfinite(dof.delay) else None,
            **couplings_document(
                settings.couplings(dof.dof), dof.couplings, dof.couplings_std),
            **thrusters_document(dof.thrusters),
            **({} if settings.thrusters.newtons else {'newtons': False}),
            'mae': json_number(score.mae if score else math.nan),
            'fit': json_number(score.fit if score else math.nan),
            **({'fit_joint': json_number(joint[dof.dof].fit)}
               if joint and dof.dof in joint else {}),
            'steps': dof.steps,
            # of the model: that the log of a sensor ended earlier takes nothing from it
            'status': judgement.status,
            'reasons': list(judgement.reasons),
            'verdict': (verdicts or {}).get(dof.dof, ''),
        }
    return result


def current_document(settings: Settings, current: Current | None) -> dict[str, Any] | None:
    """Return the ``current`` part of the JSON [m/s], None where it is not estimated."""
    if not settings.estimates_current:
        return None
    said = told(current, settings.frames)
    numbers = {name: json_number(value) if isinstance(value, float) else value
               for name, value in current_values(said).items()}
    return {**numbers, 'advice': said.advice}


def couplings_document(names: Sequence[str], couplings: Sequence[float],
                       stds: Sequence[float]) -> dict[str, Any]:
    """Return ``couplings``, each with its standard deviation; nothing where there are none."""
    found: dict[str, float | None] = {}
    for name, kappa, std in zip(names, couplings, stds):
        found[name], found[f'{name}_std'] = json_number(kappa), json_number(std)
    return {'couplings': found} if found else {}


def thrusters_document(thrusters: Thrusters) -> dict[str, Any]:
    """Return ``thrusters`` as they are found to work; nothing where that is as configured."""
    return {'thrusters': {**dict(zip(_THRUSTERS, thrusters)), 'lag_of_turns': thrusters.turns,
                          'lag_at': thrusters.lag_at}} if thrusters.found else {}


def _intervals(found: Mapping[str, Interval]) -> dict[str, list[float | None] | None] | None:
    """Return all eight by name, None for a left-out term; None for all without covariance."""
    return {name: [json_number(x) for x in found[name]] if name in found else None
            for name in (*PARAMETERS, *PHYSICAL)} if found else None


def json_numbers(names: Sequence[str], values: Sequence[float]) -> dict[str, float | None]:
    """Return numbers by name for JSON."""
    return {name: json_number(value) for name, value in zip(names, values)}


def json_number(value: float) -> float | None:
    """Return a number for JSON, which knows no NaN and no infinity."""
    return value if math.isfinite(value) else None


class EstimatesError(ValueError):
    """A file of estimates that cannot be used; the text is the line to print."""


@dataclass(frozen=True)
class Identified:
    """
    The model of one degree of freedom.

    Attributes
    ----------
    dof : str
        Its name.
    parameters : Four
        alpha, beta, gamma, delta.
    source : str
        What it comes from, on one line.
    mae : float
        Its mean over all logs [m/s or rad/s]; NaN in the JSON of a replay.
    status : str
        Of the identifier at the end of a replay; '' in the JSON of a comparison.
    couplings : mapping of str to float
        By name.
    thrusters : Thrusters
        How they are found to work.
    newtons : bool
        False: masses, drags and bias are relative to a command of 1.

    """

    dof: str
    parameters: Four
    source: str
    mae: float = math.nan
    status: str = ''
    couplings: Mapping[str, float] = field(default_factory=dict)
    thrusters: Thrusters = AS_CONFIGURED
    newtons: bool = True

    @property
    def physical(self) -> dict[str, float]:
        """Return effective mass, drags and bias by name."""
        # + 0.0: a term that the model lacks is 0, not -0
        return {name: value + 0.0 for name, value in zip(PHYSICAL, physical(self.parameters))}


def read_estimates(path: Path, method: str = '', trained_on: str = '') -> list[Identified]:
    """
    Read one model per degree of freedom, in the order of ``DOFS``.

    Parameters
    ----------
    path : Path
        JSON of a replay or a comparison.
    method, trained_on : str
        Take a comparison's models of this method or log only. Of those that are left, each
        DOF takes the one with the lowest mean mae over all logs.

    Raises
    ------
    EstimatesError
        If it is not such JSON or has no usable model; says where and why.
    OSError
        If the file cannot be read.

    """
    try:
        document = json.loads(path.read_bytes().decode('utf-8-sig'))
    except (ValueError, RecursionError) as error:
        raise EstimatesError(f'{path}: is not JSON: {error}: takes what rovid replay or rovid '
                             'compare writes with --json') from None
    if not isinstance(document, dict) or not {'dofs', 'models'} & document.keys():
        raise EstimatesError(f'{path}: is not the JSON of rovid replay or rovid compare: takes '
                             'an object with dofs or models')
    if 'models' in document:
        found = _of_comparison(document['models'], path, method, trained_on)
    elif method or trained_on:
        raise EstimatesError(f'{path}: is of one replay, whose only model has no --method or '
                             '--trained-on to choose by; leave them out')
    else:
        found = _of_replay(document, path)
    return sorted(found, key=lambda model: DOFS.index(model.dof))


def _of_replay(document: Mapping[str, Any], path: Path) -> list[Identified]:
    source = _one_line(document.get('method', 'replay'))
    return [
        Identified(dof, _parameters(values, f'{path}: dofs.{dof}'), source,
                   status=_one_line(values.get('status', '')), couplings=_couplings(dof, values),
                   thrusters=_thrusters(values), newtons=has_newtons(values))
        for dof, values in _dofs(document['dofs'], f'{path}: dofs').items()]


def _of_comparison(models: Any, path: Path, method: str, trained_on: str) -> list[Identified]:
    if not isinstance(models, list) or not models:
        raise EstimatesError(f'{path}: models: got {_short(models)}, takes a list of models')
    for i, model in enumerate(models):
        for key in ('method', 'trained_on'):
            if not isinstance(model, dict) or not isinstance(model.get(key), str):
                raise EstimatesError(f'{path}: models[{i}]: takes an object with {key}')
    named = [(f'{path}: models[{i}].dofs', model) for i, model in enumerate(models)]
    named = _matching_models(named, 'method', method, path)
    named = _matching_models(named, 'trained_on', trained_on, path)
    candidates: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
    for place, model in named:
        source = f'{_one_line(model["method"])}, trained on {_one_line(model["trained_on"])}'
        for dof, values in _dofs(model.get('dofs'), place).items():
            candidates.setdefault(dof, []).append((f'{place}.{dof}', source, values))
    return [_best_model(dof, found) for dof, found in candidates.items()]


def _matching_models(named: Sequence[tuple[str, dict[str, Any]]], key: str, wanted: str,
            path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Return the models with this method or log; a log also goes by its file's name alone."""
    if not wanted:
        return list(named)
    there = list(dict.fromkeys(model[key] for _, model in named))
    matching = [entry for entry in named if entry[1][key] == wanted]
    if not matching and key == 'trained_on':
        matching = [entry for entry in named if Path(entry[1][key]).name == wanted]
    if not matching:
        raise EstimatesError(f'{path}: has no model with --{key.replace("_", "-")} {wanted}'
                             f'{nearest(wanted, there)}; has {", ".join(map(_one_line, there))}')
    return matching


def _best_model(dof: str, found: Sequence[tuple[str, str, dict[str, Any]]]) -> Identified:
    """Return the usable model that predicts best; one with a log unscored comes last."""
    logs = {log for _, _, values in found for log in _scores(values)}
    usable: list[tuple[int, float, Identified]] = []
    refused = None
    for place, source, values in found:
        try:
            parameters = _parameters(values, place)
        except EstimatesError as error:
            refused = refused or error
            continue
        scores = _scores(values).values()
        mae = math.fsum(scores) / len(scores) if scores else math.nan
        usable.append((len(logs) - len(scores), mae if scores else math.inf,
                       Identified(dof, parameters, source, mae,
                                  couplings=_couplings(dof, values),
                                  thrusters=_thrusters(values), newtons=has_newtons(values))))
    if not usable:
        assert refused is not None
        raise refused
    return min(usable, key=lambda entry: entry[:2])[2]


def has_newtons(values: Mapping[str, Any]) -> bool:
    """Tell whether the forces of a DOF in a document are in newtons."""
    return values.get('newtons') is not False


def _scores(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the mae by log, without those that are null."""
    scores = values.get('scores')
    found = {}
    for log, score in scores.items() if isinstance(scores, dict) else ():
        mae = _number(score.get('mae')) if isinstance(score, dict) else math.nan
        if math.isfinite(mae):
            found[log] = mae
    return found


def _dofs(dofs: Any, place: str) -> dict[str, dict[str, Any]]:
    if not isinstance(dofs, dict) or not dofs:
        raise EstimatesError(f'{place}: got {_short(dofs)}, takes an object of one or more DOFs')
    for dof, values in dofs.items():
        if dof not in DOFS:
            raise EstimatesError(f'{place}: got {_one_line(dof)!r}, takes {", ".join(DOFS)}'
                                 f'{nearest(dof, DOFS)}')
        if not isinstance(values, dict):
            raise EstimatesError(f'{place}.{dof}: got {_short(values)}, takes an object')
    return dofs


def _parameters(values: Mapping[str, Any], place: str) -> Four:
    for name in PARAMETERS:
        if name not in values:
            raise EstimatesError(f'{place}.{name}: is missing')
        if not math.isfinite(_number(values[name])):
            raise EstimatesError(f'{place}.{name}: got {_short(values[name])}, takes a number')
    alpha, beta, gamma, delta = (_number(values[name]) for name in PARAMETERS)
    if not all(map(math.isfinite, physical((alpha, beta, gamma, delta)))):
        raise EstimatesError(f'{place}.alpha: got {alpha!r}, takes a number above 0: '
                             'the mass is 1 / alpha')
    return alpha, beta, gamma, delta


def _couplings(dof: str, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the couplings that have a number."""
    found = values.get('couplings')
    kappas = {name: _number(found.get(name)) for name in COUPLINGS[dof]
              } if isinstance(found, dict) else {}
    return {name: kappa for name, kappa in kappas.items() if math.isfinite(kappa)}


def _thrusters(values: Mapping[str, Any]) -> Thrusters:
    """Return how thrusters are found to work; as configured where that is not said."""
    found = values.get('thrusters')
    try:
        return read_thrusters([
            *[_number(found.get(name)) for name in _THRUSTERS], found.get('lag_of_turns') is True,
            _number(found.get('lag_at', 0.0))]) if isinstance(found, dict) else AS_CONFIGURED
    except ValueError:
        return AS_CONFIGURED


def _number(value: Any) -> float:
    """Return a JSON number, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an integer of over 300 digits
        return math.nan


def _short(value: Any) -> str:
    text = _one_line(json.dumps(value))
    return text if len(text) <= 40 else f'{text[:37]}...'


def _one_line(value: Any) -> str:
    """Return text from outside so that it can stand in a comment."""
    return ''.join(c if c.isprintable() else '?' for c in ' '.join(str(value).split()))
