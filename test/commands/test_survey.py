"""``rovid survey``: a row per dive and DOF, whoever computes it, and what goes wrong."""

from collections.abc import Iterator
import csv
import json
import os
from pathlib import Path
import signal
import time

from mcap.reader import make_reader
from mcap.writer import Writer
import pytest
from rovid_ros.commands.main import main
from rovid_ros.commands.workers import Answers, on_this_computer, WorkerDiedError
from rovid_ros.survey.table import journal_of

CONFIG = Path(__file__).parents[2] / 'config' / 'jhurov.yaml'
STILL = ',heave=0,yaw=0'


@pytest.fixture(scope='module')
def season(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with three dives, of which one is broken, and a table of them."""
    folder = tmp_path_factory.mktemp('survey')
    (folder / 'dives').mkdir()
    assert main(['simulate', '--params-file', str(CONFIG), '--duration', '30', '--output',
                 str(folder / 'dives' / 'd{}.mcap'), '--profile', f'surge=150@0.055{STILL}',
                 '--profile', f'surge=120@0.08{STILL}']) == 0
    (folder / 'dives' / 'broken.mcap').write_text('no log')
    assert survey(folder, 'table.csv') == 1
    return folder


def survey(folder: Path, table: str, *arguments: str) -> int:
    return main(['survey', str(folder / 'dives'), '--params-file', str(CONFIG),
                 '--output', str(folder / table), *arguments])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


@pytest.mark.long
def test_a_row_holds_the_numbers_of_a_replay(season: Path) -> None:
    out = season / 'out.json'
    log = season / 'dives' / 'd2.mcap'
    assert main(['replay', str(log), '--params-file', str(CONFIG), '--json', str(out)]) == 0
    expected = json.loads(out.read_text())
    found = {row['dof']: row for row in rows(season / 'table.csv') if row['log'] == str(log)}
    assert found.keys() == expected['dofs'].keys()
    for dof, values in expected['dofs'].items():
        row = found[dof]
        assert row['start'] == '2023-11-14T22:14:50+00:00'
        assert (row['status'], int(row['steps'])) == (values['status'], values['steps'])
        for name in ('alpha', 'mass', 'bias', 'fit'):  # to the bit
            assert float(row[name]) == values[name]
        assert float(row['alpha_std']) == values['std']['alpha']
        assert [float(row[f'bias_{end}']) if row[f'bias_{end}'] else None
                for end in ('low', 'high')] == values['intervals']['bias']


def test_a_broken_log_costs_a_row_and_the_exit_code(season: Path) -> None:
    failed = [row for row in rows(season / 'table.csv') if row['status'] == 'failed']
    assert [Path(row['log']).name for row in failed] == ['broken.mcap']
    assert 'is not a log' in failed[0]['error']
    assert len(rows(season / 'table.csv')) == 1 + 2 * 3


def test_the_summary_says_what_says_nothing(
        season: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['survey', str(season / 'dives' / 'd1.mcap'), '--params-file', str(CONFIG)]) == 0
    said = capsys.readouterr().out
    assert said.startswith('1 dive, 0 without a result\n')
    assert 'A line takes three dives.' in ' '.join(said.split())


def test_a_log_without_the_field_costs_a_row(season: Path, tmp_path: Path) -> None:
    table = tmp_path / 'table.csv'
    assert main(['survey', str(season / 'dives'), '--params-file', str(CONFIG), '-p',
                 'position.field:=point.nowhere', '--output', str(table)]) == 1
    errors = {Path(row['log']).name: row['error'] for row in rows(table)}
    assert errors.keys() == {'d1.mcap', 'd2.mcap', 'broken.mcap'}
    assert "position.field: 'point.nowhere'" in errors['d1.mcap']


@pytest.mark.long
def test_one_process_gives_the_same_table(season: Path) -> None:
    assert survey(season, 'one.csv', '--workers', '1') == 1
    assert (season / 'one.csv').read_bytes() == (season / 'table.csv').read_bytes()


def test_it_goes_on_where_it_was_interrupted(
        season: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = journal_of(season / 'table.csv').read_bytes()
    first, second = whole.splitlines(keepends=True)
    table = tmp_path / 'table.csv'
    journal_of(table).write_bytes(first + second[:100])  # as a kill leaves it
    assert main(['survey', str(season / 'dives'), '--params-file', str(CONFIG),
                 '--output', str(table)]) == 1
    assert '1 of 3 dives were finished before' in capsys.readouterr().out
    assert table.read_bytes() == (season / 'table.csv').read_bytes()
    assert sorted(journal_of(table).read_bytes().splitlines()) == sorted(whole.splitlines())


def test_another_configuration_begins_afresh(
        season: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert survey(season, 'table.csv', '-p', 'surge.initial.mass:=310.0', '--duration', '5') == 1
    assert 'finished before' not in capsys.readouterr().out
    assert survey(season, 'table.csv') == 1
    assert '2 of 3 dives were finished before' in capsys.readouterr().out


@pytest.mark.long
def test_parquet_holds_the_same_with_tags_as_numbers(season: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip('pyarrow.parquet')
    for k, temperature in ((1, '8.5'), (2, '11')):
        _tag(season / 'dives' / f'd{k}.mcap', tmp_path / f'd{k}.mcap', temperature)
    (tmp_path / 'tagged.parquet').symlink_to('of the link.parquet')
    for name in ('tagged.parquet', 'tagged.csv'):
        assert main(['survey', str(tmp_path / '*.mcap'), '--params-file', str(CONFIG),
                     '--output', str(tmp_path / name)]) == 0
    table = parquet.read_table(tmp_path / 'tagged.parquet').to_pydict()
    assert (tmp_path / 'tagged.parquet').is_symlink()
    assert table['tag_temperature'] == [8.5] * 3 + [11.0] * 3
    expected = rows(tmp_path / 'tagged.csv')
    assert table['mass'] == [float(row['mass']) for row in expected]
    assert table['steps'] == [int(row['steps']) for row in expected]
    assert expected[0]['tag_temperature'] == '8.5'


def _tag(log: Path, to: Path, temperature: str) -> None:
    """Copy a log and note the temperature of the water."""
    with log.open('rb') as source, to.open('wb') as target:
        writer = Writer(target)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id])
            writer.add_message(channels[channel.id], message.log_time, message.data,
                               message.publish_time)
        writer.add_metadata('conditions', {'temperature': temperature})
        writer.finish()


@pytest.mark.parametrize(('arguments', 'code', 'text'), [
    (['--output', 'table.xlsx'], 2, 'takes a name that ends in .csv or .parquet'),
    (['--report', 'season.pdf'], 2, 'takes a name that ends in .html'),
    (['--workers', '0'], 2, 'takes a whole number from 1'),
    (['--workers', '2', '--scheduler', 'tcp://127.0.0.1:1'], 2, 'takes one of them'),
    (['-p', 'surge.initial.mass:=-1.0'], 1, 'surge.initial.mass'),
])
def test_what_cannot_work_is_refused_before_the_work(
        season: Path, arguments: list[str], code: int, text: str,
        capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['survey', str(season / 'dives'), '--params-file', str(CONFIG),
                 *arguments]) == code
    assert text in capsys.readouterr().err


def answers_of(found: Answers) -> dict[int, object]:
    return {k: made for answered in found for k, made in answered}


def test_a_worker_that_is_killed_costs_an_attempt(tmp_path: Path) -> None:
    def work(k: int) -> int:
        mark = tmp_path / str(k)
        if k == 1 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return 10 * k

    assert answers_of(on_this_computer(work, range(4), 2)) == {0: 0, 1: 10, 2: 20, 3: 30}


def test_work_that_always_kills_its_worker_is_given_up_alone() -> None:
    def work(k: int) -> int:
        if k == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return k

    found = answers_of(on_this_computer(work, range(3), 2))
    assert isinstance(found.pop(1), WorkerDiedError)
    assert found == {0: 0, 2: 2}


def test_nobody_is_left_where_the_work_is_given_up() -> None:
    def pid_then_sleep(k: int) -> int:
        if k:
            time.sleep(60)
        return os.getpid()

    found: Iterator[list[tuple[int, int]]] = on_this_computer(pid_then_sleep, range(3), 2)
    begun = time.monotonic()
    while not next(found):
        pass
    found.close()  # type: ignore[attr-defined]
    assert time.monotonic() - begun < 30


@pytest.mark.long
def test_a_dask_cluster_gives_the_same_table(season: Path) -> None:
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1,
                                  dashboard_address=None) as cluster:
        assert survey(season, 'dask.csv', '--scheduler', cluster.scheduler_address) == 1
    assert (season / 'dask.csv').read_bytes() == (season / 'table.csv').read_bytes()


def test_a_scheduler_that_is_not_there_is_told(
        season: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('distributed')
    monkeypatch.setattr('rovid_ros.commands.workers.CONNECT', 0.5)
    assert survey(season, 'none.csv', '--scheduler', 'tcp://127.0.0.1:9') == 1
    error = capsys.readouterr().err
    assert '--scheduler tcp://127.0.0.1:9: no answer' in error
    assert len(error.splitlines()) == 1
