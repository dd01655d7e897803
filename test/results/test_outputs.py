"""The messages of an estimate: layout, exact numbers, and what is held while invalid."""

from dataclasses import replace
import json
import math
from typing import Any

import pytest
from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.identify.intervals import KnownUncertainty
from rovid_core.identify.status import Judgement, STATUSES
from rovid_core.model.dofs import Four, NAN4, PARAMETERS, PHYSICAL
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    ThrusterSettings,
)
from rovid_core.trials.score import Score
from rovid_ros.results.documents import dofs_document
from rovid_ros.results.outputs import ERROR, LEVELS, OK, Output, Outputs, TOPICS, WARN

from test.support.outputs import fields_of

TIME = 1_700_000_000_123_456_789
AWKWARD = (1.0 / 3.0, -0.1 - 0.2, -1e-17, 5e-324)


def settings() -> Settings:
    rows = tuple((1.0,) if i in (0, 5) else (0.0,) for i in range(6))
    return Settings(
        dofs=('surge', 'yaw'),
        dof={'surge': DofSettings(200.0, 100.0, 20.0, 4.0),
             'yaw': DofSettings(50.0, 10.0, terms=('alpha', 'beta'), bias=7.0)},
        thrusters=ThrusterSettings(topics=('/thrust',), gain=(1.0,), allocation=rows),
        position=InputSettings('/position'), attitude=InputSettings('/attitude'))


def estimate(status: str = 'converging', reasons: tuple[str, ...] = (), std: Four = NAN4,
             covariance: tuple[float, ...] = (), delay_std: float = math.nan,
             **surge: Any) -> Estimate:
    first = DofEstimate(
        'surge', AWKWARD, KnownUncertainty(covariance, std, delay_std), Judgement(status, reasons),
        time=TIME - 5, steps=3, velocity=0.1, v_hat=0.3, force=7.25, excitation=0.5)
    second = DofEstimate(
        'yaw', (0.02, -0.2, 0.0, 0.0), KnownUncertainty(std=(0.1, 0.2, math.nan, math.nan)),
        Judgement('waiting', ('no step yet', 'no thrust')))
    return Estimate(TIME, (first.replaced(**surge), second), (0,))


def by_topic(outputs: list[Output]) -> dict[str, dict[str, Any]]:
    assert [out.topic for out in outputs] == list(TOPICS)
    assert all(out.type == TOPICS[out.topic] for out in outputs)
    return {out.topic: fields_of(out) for out in outputs}


def test_params_are_a_row_major_table() -> None:
    fields = by_topic(Outputs(settings()).messages(estimate()))['rov/params']
    assert fields['layout'] == {
        'dim': [{'label': 'surge,yaw', 'size': 2, 'stride': 8},
                {'label': 'alpha,beta,gamma,delta', 'size': 4, 'stride': 4}],
        'data_offset': 0}
    assert fields['data'] == [*AWKWARD, 0.02, -0.2, 0.0, 0.0]


def test_std_has_the_same_layout_and_nan_where_there_is_none() -> None:
    messages = by_topic(Outputs(settings()).messages(estimate()))
    assert messages['rov/params_std']['layout'] == messages['rov/params']['layout']
    data = messages['rov/params_std']['data']
    assert data[4:6] == [0.1, 0.2]
    assert all(math.isnan(x) for x in data[:4] + data[6:])


def test_the_last_valid_row_is_held_while_invalid() -> None:
    outputs = Outputs(settings())
    outputs.messages(estimate(std=AWKWARD))
    bad = estimate(status='invalid', reasons=('diverged',), parameters=(9.0, 9.0, 9.0, 9.0))
    messages = by_topic(outputs.messages(bad))
    assert messages['rov/params']['data'][:4] == list(AWKWARD)
    assert messages['rov/params_std']['data'][:4] == list(AWKWARD)
    values = values_of(messages['rov/estimate'], 0)  # which says what it is
    assert values['alpha'] == '9.0'


def coupled_settings() -> Settings:
    plain = settings()
    return replace(plain, identifier=IdentifierSettings(method='ekf'),
                   current=CurrentSettings(prior=0.0), dof={
        'surge': replace(plain.dof['surge'], couplings=('vr', 'wq')),
        'yaw': replace(plain.dof['yaw'], couplings=('v',))})


def coupled_estimate(status: str = 'converging', vr: float = AWKWARD[0]) -> Estimate:
    one = estimate(status, couplings=(vr, 2.5))
    uncertainty = KnownUncertainty(couplings_std=(0.25, 0.5))
    return one.replaced(dofs=(one.dofs[0].replaced(uncertainty=uncertainty), one.dofs[1]))


def test_couplings_are_a_table_of_all_names_with_nan_where_a_dof_has_none() -> None:
    outputs = Outputs(coupled_settings())
    assert list(outputs.topics) == [*TOPICS, 'rov/couplings', 'rov/couplings_std']
    messages = {out.topic: fields_of(out) for out in outputs.messages(coupled_estimate())}
    for topic, row in (('rov/couplings', [AWKWARD[0], 2.5]), ('rov/couplings_std', [0.25, 0.5])):
        assert messages[topic]['layout'] == {
            'dim': [{'label': 'surge,yaw', 'size': 2, 'stride': 6},
                    {'label': 'vr,wq,v', 'size': 3, 'stride': 3}],
            'data_offset': 0}
        assert messages[topic]['data'][:2] == row
        assert all(math.isnan(x) for x in messages[topic]['data'][2:5])
    values = values_of(messages['rov/estimate'], 0)
    assert float(values['kappa_vr']) == AWKWARD[0]
    assert float(values['kappa_wq_std']) == 0.5


def test_couplings_are_held_while_invalid_and_go_back_on_a_reset() -> None:
    outputs = Outputs(coupled_settings())
    before = fields_of(outputs.latched(['rov/couplings'])[0])['data']
    assert before[:2] == [0.0, 0.0]
    outputs.messages(coupled_estimate())
    outputs.messages(coupled_estimate('invalid', vr=9.0))
    assert fields_of(outputs.latched(['rov/couplings'])[0])['data'][:2] == [AWKWARD[0], 2.5]
    again = {out.topic: fields_of(out) for out in outputs.reset()}
    assert again['rov/couplings']['data'][:2] == [0.0, 0.0]
    assert all(math.isnan(x) for x in again['rov/couplings_std']['data'])


def test_without_couplings_there_are_no_topics_of_them() -> None:
    outputs = Outputs(settings())
    assert outputs.topics == TOPICS
    assert [out.topic for out in outputs.reset()] == ['rov/params', 'rov/params_std', 'rov/model']
    assert list(by_topic(outputs.messages(estimate()))) == list(TOPICS)


def test_an_invalid_dof_without_a_valid_row_has_the_initial_one() -> None:
    bad = estimate(status='invalid', parameters=(math.nan,) * 4)
    data = by_topic(Outputs(settings()).messages(bad))['rov/params']['data']
    assert data[:4] == [1.0 / 200.0, -0.5, -0.1, -0.02]


def test_state_and_velocity() -> None:
    messages = by_topic(Outputs(settings()).messages(estimate()))
    header = {'stamp': {'sec': 1_700_000_000, 'nanosec': 123_456_789}, 'frame_id': 'base_link'}
    state, twist = messages['rov/identifier_state'], messages['rov/velocity']
    assert state['header'] == twist['header'] == header
    assert state['name'] == ['surge', 'yaw']
    assert state['velocity'][0] == 0.3
    assert state['effort'][0] == 7.25
    assert twist['twist']['linear']['x'] == 0.1
    assert math.isnan(twist['twist']['linear']['z'])  # heave is not identified


def values_of(fields: dict[str, Any], index: int) -> dict[str, str]:
    return {entry['key']: entry['value'] for entry in fields['status'][index]['values']}


def test_the_estimate_text_gives_the_exact_bits_back() -> None:
    fields = by_topic(Outputs(settings()).messages(estimate()))['rov/estimate']
    values = values_of(fields, 0)
    assert tuple(float(values[name]) for name in ('alpha', 'beta', 'gamma', 'delta')) == AWKWARD
    assert float(values['dv']) == 0.3 - 0.1
    assert float(values['mass']) == 1.0 / AWKWARD[0]
    assert values['time'] == str(TIME - 5)
    assert values['steps'] == '3'
    assert values['updated'] == 'true'
    assert values['alpha_std'] == 'nan'
    assert 'W' not in values
    known = by_topic(Outputs(settings()).messages(estimate(W=0.1 + 0.2)))['rov/estimate']
    assert float(values_of(known, 0)['W']) == 0.1 + 0.2


def test_intervals_and_delay_are_there_where_they_are_known() -> None:
    plain = values_of(by_topic(Outputs(settings()).messages(estimate()))['rov/estimate'], 0)
    assert not [name for name in plain if name.endswith(('_low', '_high')) or 'delay' in name]
    found = values_of(by_topic(Outputs(settings()).messages(known()))['rov/estimate'], 0)
    assert float(found['alpha_low']) == pytest.approx(0.005 - 1.96 * 0.001, rel=1e-4)
    assert float(found['mass_high']) == pytest.approx(1.0 / float(found['alpha_low']))
    assert float(found['bias_high']) > float(found['bias_low'])
    assert 'linear_drag_low' not in found  # left out
    assert (float(found['delay']), float(found['delay_std'])) == (0.25, 0.01)


def known() -> Estimate:
    covariance = [0.0] * 16
    covariance[0], covariance[5], covariance[15] = 0.001**2, 0.1**2, 0.01**2
    return estimate(parameters=(0.005, -0.5, 0.0, 0.02), covariance=tuple(covariance),
                    delay=0.25, delay_std=0.01)


def test_the_summary_has_intervals_delay_and_verdict() -> None:
    dofs = dofs_document(settings(), known(), verdicts={'surge': 'no thrust'})
    json.dumps(dofs, allow_nan=False)
    surge, yaw = dofs['surge'], dofs['yaw']
    assert list(surge['intervals']) == [*PARAMETERS, *PHYSICAL]
    low, high = surge['intervals']['mass']
    assert low < 200.0 < high
    assert surge['intervals']['gamma'] is None
    assert surge['delay_s'] == {'value': 0.25, 'std': 0.01}
    assert (surge['verdict'], yaw['verdict']) == ('no thrust', '')
    assert (yaw['intervals'], yaw['delay_s']) == (None, None)
    wide = known().dofs[0].replaced(uncertainty=KnownUncertainty((1.0, *[0.0] * 15)))
    opened = dofs_document(settings(), Estimate(TIME, (wide,), (0,)))['surge']['intervals']
    assert opened['mass'][1] is None  # as far as the data go it is anything above


def test_every_status_has_a_level() -> None:
    assert set(LEVELS) == set(STATUSES)


@pytest.mark.parametrize(('status', 'level'), [
    ('waiting', WARN), ('unexcited', WARN), ('converging', OK), ('converged', OK),
    ('frozen', OK), ('invalid', ERROR)])
def test_what_cannot_be_used_is_no_ok(status: str, level: int) -> None:
    told = by_topic(Outputs(settings()).messages(estimate(status, ('why',))))['rov/estimate']
    assert told['status'][0]['level'] == level
    assert told['status'][0]['message'] == f'{status}: why'
    assert values_of(told, 0)['status'] == status


def test_what_is_stale_is_a_warning_and_for_long_an_error() -> None:
    levels = [by_topic(Outputs(settings()).messages(
        estimate('converged', stale_for=age)))['rov/estimate']['status'][0]['level']
        for age in (0.0, 9.9, 10.1, math.inf)]
    assert levels == [OK, WARN, ERROR, ERROR]


def test_numpy_floats_are_written_as_numbers() -> None:
    numpy = pytest.importorskip('numpy')
    fields = by_topic(Outputs(settings()).messages(
        estimate(velocity=numpy.float64(0.1))))['rov/estimate']
    assert values_of(fields, 0)['velocity'] == '0.1'


def test_status_is_level_and_message() -> None:
    surge, yaw = by_topic(Outputs(settings()).messages(estimate()))['rov/estimate']['status']
    assert (surge['name'], surge['level'], surge['message']) == ('surge', OK, 'converging')
    assert (yaw['name'], yaw['level']) == ('yaw', WARN)
    assert yaw['message'] == 'waiting: no step yet, no thrust'
    assert values_of({'status': [yaw]}, 0)['updated'] == 'false'


def test_summary_is_plain_json() -> None:
    dofs = dofs_document(settings(), estimate(), {'surge': Score(0.01, 0.9), 'yaw': Score(
        0.02, math.nan)})
    json.dumps(dofs, allow_nan=False)
    assert dofs['surge']['alpha'] == AWKWARD[0]
    assert dofs['surge']['std'] is None
    assert (dofs['surge']['mae'], dofs['surge']['fit']) == (0.01, 0.9)
    assert dofs['yaw']['std'] == {'alpha': 0.1, 'beta': 0.2, 'gamma': None, 'delta': None}
    assert dofs['yaw']['fit'] is None
    assert (dofs['yaw']['status'], dofs['yaw']['steps']) == ('waiting', 0)


def test_summary_without_a_step_has_the_initial_values() -> None:
    dofs = dofs_document(settings(), None)
    assert dofs['surge']['mass'] == pytest.approx(200.0)
    assert dofs['yaw']['bias'] == 0.0  # delta is left out
    assert (dofs['surge']['status'], dofs['surge']['mae']) == ('waiting', None)


def test_the_first_message_is_there_before_the_next_is_made() -> None:
    read: list[int] = []

    class Noted:
        std, delay_std, couplings_std = NAN4, math.nan, ()

        @property
        def covariance(self) -> tuple[float, ...]:
            read.append(1)
            return ()

    messages = Outputs(settings()).each(estimate(uncertainty=Noted()), TOPICS)
    assert next(messages).topic == 'rov/params'
    assert read == []
    assert [output.topic for output in messages] == list(TOPICS)[1:]
    assert read


def test_what_is_kept_is_told_only_of_what_it_was_made_of() -> None:
    outputs = Outputs(coupled_settings())
    first = coupled_estimate()
    surge, yaw = first.dofs
    known = KnownUncertainty((), (0.1, 0.2, 0.3, 0.4), 0.5, (0.6, 0.7))
    for changes in (
            {}, {'uncertainty': known}, {'parameters': (1.0, -2.0, -3.0, 4.0)},
            {'uncertainty': known, 'delay': 0.25}, {'judgement': Judgement('invalid', ('why',))},
            {'stale_for': 5.0}, {'stale_for': 6.0, 'uncertainty': known}, {'stale_for': math.inf},
            {'couplings': (8.0, 9.0)}, {'judgement': Judgement('frozen')}, {}):
        step = first.replaced(dofs=(surge.replaced(**changes), yaw))
        told = [out for out in outputs.messages(step) if step.dofs[0].status in (
            'converging', 'frozen') or out.topic in ('rov/model', 'rov/estimate')]
        fresh = {out.topic: out for out in Outputs(coupled_settings()).messages(step)}
        assert told == [fresh[out.topic] for out in told]


def test_bytes_alone_are_those_of_the_messages() -> None:
    step = coupled_estimate()
    topics = [*Outputs(coupled_settings()).topics]
    messages = Outputs(coupled_settings()).messages(step)
    assert Outputs(coupled_settings()).encoded(step, topics) == [out.cdr for out in messages]
    assert Outputs(coupled_settings()).encoded(step, topics[1:3]) == [
        out.cdr for out in messages[1:3]]


def test_a_status_that_is_kept_is_that_of_its_step() -> None:
    outputs = Outputs(settings())
    first = estimate()
    surge, yaw = first.dofs
    steps = [first, first.replaced(stepped=()), first.replaced(stepped=(1,)),
             first.replaced(dofs=(surge.replaced(steps=4), yaw)), first,
             first.replaced(dofs=(surge, yaw.replaced(velocity=0.7)), stepped=(1,))]
    for step in steps:
        assert outputs.messages(step) == Outputs(settings()).messages(step)
