"""Parameter files are read as ROS' own reader reads them, or refused in one line."""

from collections.abc import Callable
from pathlib import Path
import random
from typing import Any

import pytest
from rovid_ros.config.parameter_file import load, ParameterFileError, read

Write = Callable[[str], Path]
NODE = 'identifier_node'

SCALARS = [*"""
1e-5 1e5 1E5 -1e-3 +1e3 1. .5 -.5 1.e3 . 1.5.2 1e 1e+ 0 -0 00 010 -010 08 09.5 0o17 0x10 0X1f
-0x10 0x 0xg 0x1p3 0x1.8 0x1.8p-2 0x.8 1_000 0b1012 1,5 +3 -3 3.0 --3 9223372036854775807
9223372036854775808 -9223372036854775808 99999999999999999999 0xffffffffffffffffff 1e308 1e309
-1e400 1e-310 1e-400 0e-999 0.0e999 2.2250738585072014e-308
y Y n N yes Yes YES yEs no No NO on On ON off Off OFF true True TRUE tRUE false False FALSE t f
~ null Null NULL None .inf .Inf .INF +.inf -.inf -.Inf .iNF .nan .NaN .NAN -.nan +.nan inf -inf
Inf +INF infinity nan NaN -nan nan(1) infinit in na 2020-01-02 12:30 1:30:15.5 1d 1f 1L 0x1L
'1e5' "1e5" 'yes' "010" '' "" "a\\nb" '~' abc /a/b a.b a-b \u00e9
""".split(), "' 5'", '" .inf"', "'it''s'", 'two words', '1 2']


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Return what writes a parameter file."""
    def written(text: str) -> Path:
        path = tmp_path / 'file.yaml'
        path.write_bytes(text.encode())
        return path
    return written


def under(*lines: str, section: str = '/**') -> str:
    """Return a file with these lines as parameters."""
    return f'{section}:\n  ros__parameters:\n' + ''.join(f'    {line}\n' for line in lines)


def ros_reads(path: Path, node: str = NODE, namespace: str = '/') -> dict[str, Any]:
    """Return what a real node gets from the file."""
    rclpy = pytest.importorskip('rclpy')
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', str(path)])
    try:
        real = rclpy.create_node(
            node, namespace=namespace, context=context, start_parameter_services=False,
            enable_rosout=False, allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True)
        values = {name: p.value for name, p in real.get_parameters_by_prefix('').items()
                  if name not in ('use_sim_time', 'start_type_description_service')}
        real.destroy_node()
        return {name: v if isinstance(v, (bool, int, float, str)) else list(v)
                for name, v in values.items()}
    finally:
        context.try_shutdown()


def same(mine: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Compare types and values, NaN and the sign of zero included."""
    assert {k: repr(v) for k, v in mine.items()} == {k: repr(v) for k, v in theirs.items()}


def test_scalars_are_those_of_ros(write: Write) -> None:
    path = write(under(*(f'p{i}: {text}' for i, text in enumerate(SCALARS))))
    mine = load(path)
    same(mine, ros_reads(path))
    assert mine[f'p{SCALARS.index("1e-5")}'] == 1e-5
    assert mine[f'p{SCALARS.index("010")}'] == 8
    assert mine[f'p{SCALARS.index("off")}'] is False


def test_random_scalars_are_those_of_ros(write: Write) -> None:
    source = random.Random(3)
    texts = {''.join(source.choices('0123456789+-.eExXpPinfaNyY_', k=source.randint(1, 6)))
             for _ in range(1500)} - {'-'}
    path = write(under(*(f'p{i}: {text}' for i, text in enumerate(sorted(texts)))))
    same(load(path), ros_reads(path))


def test_lists_and_groups_are_those_of_ros(write: Write) -> None:
    path = write(under(
        'ints: [1, 010, 0x10]', 'doubles: [1e-5, 2.0, .inf]', 'bools: [y, off, true]',
        "texts: [a, '1', '', \"x y\"]", 'trailing: [1, 2, ]',
        'block:', '- 1.5', '- -2e3', 'group: {a: 1, b: {c: {d: 2}, e: 3}, f: [1]}', 'after: 4',
        'dotted.name: 5', 'dotted.group: {a: 6}', 'last: 7', 'folded: >', '  one', '  two',
        'anchored: &name 3', 'plain: two', '  lines', '"quoted key": 1', "comment: '#' # 1"))
    mine = load(path)
    same(mine, ros_reads(path))
    assert mine['group.b.c.d'] == 2


def test_random_groups_are_those_of_ros(write: Write) -> None:
    source = random.Random(5)

    def group(depth: int) -> str:
        entries = []
        for i in range(source.randint(1, 4)):
            nested = depth < 5 and source.random() < 0.6
            entries.append(f'k{i}: ' + (group(depth + 1) if nested else str(source.randint(0, 9))))
        return '{' + ', '.join(entries) + '}'

    path = write(under(*(f'g{i}: {group(0)}' for i in range(40))))
    same(load(path), ros_reads(path))


@pytest.mark.parametrize('namespace', ['/', '/ns', '/a/ns'])
def test_sections_are_matched_as_by_ros(write: Write, namespace: str) -> None:
    names = [
        '/**', '**', '*', '/*', f'/**/{NODE}', f'/*/{NODE}', f'**/{NODE}', f'*/{NODE}', '/*/*',
        '/**/*', '/**/**', NODE, f'/{NODE}', f'/ns/{NODE}', f'ns/{NODE}', '/ns/*', '/ns/**',
        '/ns', f'/a/ns/{NODE}', f'/a/*/{NODE}', f'/a/**/{NODE}', f'/**/ns/{NODE}', 'other']
    text = ''.join(under(f'p{i}: 1', section=f'"{name}"') for i, name in enumerate(names))
    nested = f'a:\n  ns:\n    {NODE}:\n      ros__parameters:\n        nested: 1\n'
    rooted = f'/:\n  {NODE}:\n    ros__parameters:\n      rooted: 1\n'
    path = write(text + nested + rooted)
    mine = load(path, NODE, namespace)
    assert 0 < len(mine) < len(names)
    same(mine, ros_reads(path, NODE, namespace))


@pytest.mark.parametrize('sections', [
    ('/**', NODE), (NODE, '/**'), (f'/{NODE}', NODE), (NODE, f'/{NODE}'), ('/*', '/**', NODE)])
def test_the_later_section_wins_as_with_ros(write: Write, sections: tuple[str, ...]) -> None:
    path = write(''.join(under(f'a: {i}', f'only{i}: 1', section=f'"{name}"')
                         for i, name in enumerate(sections)))
    mine = load(path)
    assert mine['a'] == len(sections) - 1
    same(mine, ros_reads(path))


def test_windows_line_ends_byte_order_mark_and_documents(write: Write) -> None:
    path = write('\ufeff' + under('a: 1').replace('\n', '\r\n') + '---\n' + under(
        'b: 2', section=NODE))
    same(load(path), ros_reads(path))


def test_whole_numbers_among_others_are_numbers(write: Write) -> None:
    # rcl dies on this list; the node reads its files here too
    assert load(write(under('a: [1, 0.25]'))) == {'a': [1.0, 0.25]}


def test_lines_are_known(write: Write) -> None:
    found = read(write(under('a: 1', 'b:', '  c: [1,', '      2]', '  d: 3')))
    assert {name: entry.line for name, entry in found.items()} == {'a': 3, 'b.c': 5, 'b.d': 7}


DEADLY = [  # rcl dies on these
    (under('a: [[1, 2], [3, 4]]'), ':3: a: takes a flat list of plain values, got a list in it'),
    (under('a: &x 1', 'b: *x'), ':4: b: got the alias *x'),
    (under('a: &x {b: 1}', 'c:', '  <<: *x'), ':5: <<: got the alias *x'),
    (under('a: &x 1', 'b: [*x]'), ':4: b: takes a flat list of plain values, got the alias *x'),
    (under('a:'), ':3: a: has no value'),
    (under('a: [1, x]'), ":3: a: got a number (1) and text ('x') in one list"),
    (under('a: [true, 1.0]'), ':3: a: got a truth value (True) and a number (1.0) in one list'),
    (under('? [a]', ': 1'), ':3: takes text as a key, got a list'),
    (under('"": 1'), ":3: takes text as a key, got the value ''"),
    ('/**:\n  a: 1\n', ':2: /**: takes ros__parameters above its parameters, got a'),
    ('/**:\n  ros__parameter:\n    a: 1\n', 'ros__parameter is not it'),
    ('ros__parameters:\n  a: 1\n', ':2: ros__parameters: is not the name of a node'),
    ('/**:\n  ros__parameters:\n', ':2: ros__parameters: takes parameters, got the value'),
    ('/**:\n  ros__parameters: 3\n', ":2: ros__parameters: takes parameters, got the value '3'"),
    ('- a\n', ':1: takes a section such as /** with ros__parameters, got a list'),
    (under('a: 1', section='bad name'), 'bad name: is not the name of a node'),
    (under('a: 1', section='1a'), '1a: is not the name of a node'),
    (under('a: 1', section='/ns/'), '/ns/: is not the name of a node'),
    (under('a: 1', section=f'//{NODE}'), 'is not the name of a node'),
    ('/**:\n\tros__parameters:\n    a: 1\n', ':2: is not YAML: '),
    (under('a: [1'), ': is not YAML: '),
    (under('a: 1', section='/**') + 'other:\n  ros__parameters:\n    b: *x\n',
     ':6: b: got the alias *x'),
]

MISREAD = [  # rcl loses or moves something in these, or its versions differ
    (under('a: {}'), ':3: a: is empty'),
    (under('x: {y: {}, z: 1}', 'w: 2'), ':3: x.y: is empty'),
    (under('a: [{b: 1}]'), ':3: a: takes a flat list of plain values, got a mapping in it'),
    (under('a: 1', 'b: 2', 'a: 2.5'), ':5: a: is given twice'),
    (under('x.y: 1', 'x: {y: 2}'), ':4: x.y: is given twice, first in line 3'),
    (under('x: {a.b: {c: 1}, d: 2}'), ':3: x.a.b: ROS misreads keys below a dotted key'),
    (under('a: !!str 5'), ':3: a: got the tag'),
    ('/**:\n  ros__parameters: {}\n', ':2: ros__parameters: is empty'),
    ('', ': is empty'), ('# nothing\n', ': is empty'),
    ('abc\n', ":1: takes a section such as /** with ros__parameters, got the value 'abc'"),
    (under('a: 1', section='other'), f': has no section for /{NODE}: takes /** or /{NODE} above'),
]


@pytest.mark.parametrize(('text', 'message'), DEADLY + MISREAD)
def test_refused_in_one_line(write: Write, text: str, message: str) -> None:
    path = write(text)
    with pytest.raises(ParameterFileError) as refused:
        load(path)
    line = str(refused.value)
    assert line.startswith(str(path)) and message in line and '\n' not in line


def test_ros_dies_on_what_is_called_deadly(write: Write) -> None:
    pytest.importorskip('rclpy')
    for text, _ in DEADLY:
        with pytest.raises(Exception, match="Couldn't parse params file"):
            print(text, ros_reads(write(text)))


def test_an_empty_list_of_another_node_is_its_own_affair(write: Write) -> None:
    assert load(write(under('a: []', section='other') + under('a: 1'))) == {'a': 1}


def test_files_that_are_none(tmp_path: Path) -> None:
    binary = tmp_path / 'log.mcap'
    binary.write_bytes(b'\x89MCAP0\r\n\xff\x00')
    zeros = tmp_path / 'zeros.yaml'
    zeros.write_bytes(b'a: \x00')
    for path, message in [
            (tmp_path / 'none.yaml', 'there is no such file'),
            (tmp_path, 'is a directory, takes a parameter file'),
            (binary, 'is not UTF-8 text'),
            (zeros, 'is not YAML: ')]:
        with pytest.raises(ParameterFileError, match=message) as refused:
            load(path)
        assert str(refused.value).startswith(str(path)) and '\n' not in str(refused.value)


def test_a_bottomless_file_is_refused(write: Write) -> None:
    for text in ('/**: ' + '{a: ' * 5000, under('a: ' + '{b: ' * 5000)):
        with pytest.raises(ParameterFileError):
            load(write(text))
