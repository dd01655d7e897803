"""
ROS 2 parameter files, read exactly as ROS' own reader (rcl) does, and edited in place.

Some come with rovid: where they are is found here, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import difflib
import math
from pathlib import Path
import re
import sys
from typing import Any

import yaml

Scalar = bool | int | float | str

TRUE = {'Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
FALSE = {'N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}
# what C's strtol (base 0) and strtod take whole
INTEGER = re.compile(r'\s*([+-]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))', re.ASCII)
DECIMAL = re.compile(r'\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?', re.ASCII)
HEXADECIMAL = re.compile(
    r'\s*[+-]?0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?', re.ASCII)
NAMED = re.compile(r'\s*[+-]?(?i:inf|infinity|nan(?:\(\w*\))?)', re.ASCII)
# what rcl adds
DOTTED = re.compile(r'[+-]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)')


def scalar(text: str) -> Scalar:
    """
    Return the bool, integer, number or text that rcl reads.

    There is no null (``~`` is text), ``010`` is 8, ``08`` is 8.0, ``1e-5`` is a number,
    ``1_000`` is text, and so is a number that does not fit.
    """
    if text in TRUE or text in FALSE:
        return text in TRUE
    integer = _integer(text)
    if integer is not None:
        return integer
    number = _number(text)
    return text if number is None else number


def _integer(text: str) -> int | None:
    match = INTEGER.fullmatch(text)
    if not match:
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    digits, base = (hexadecimal, 16) if hexadecimal else (octal, 8) if octal else (decimal, 10)
    if len(digits) > 64:
        return None
    value = int(sign + digits, base)
    return value if -2**63 <= value < 2**63 else None


def _number(text: str) -> float | None:
    if NAMED.fullmatch(text) or DOTTED.fullmatch(text):
        return float(text.replace('.', '').partition('(')[0])
    decimal, hexadecimal = DECIMAL.fullmatch(text), HEXADECIMAL.fullmatch(text)
    match = decimal or hexadecimal
    if not match:
        return None
    try:
        value = float(text) if decimal else float.fromhex(text)
    except OverflowError:
        return None
    too_small = abs(value) < sys.float_info.min and match.group(1).strip('0.')
    return None if math.isinf(value) or too_small else value


NODE_NAME = 'identifier_node'
PARAMETERS = 'ros__parameters'
MAX_FILE_SIZE = 1 << 20  # [bytes] a larger file is something else
MAX_DEPTH = 32  # levels of keys; more are a broken file
SECTION = re.compile(r'/?(?:(?:[A-Za-z_]\w*|\*\*?)/)*(?:[A-Za-z_]\w*|\*\*?)', re.ASCII)
NAMES = {bool: 'a truth value', int: 'a number', float: 'a number', str: 'text'}


class ParameterFileError(ValueError):
    """A parameter file that cannot be read; the text says where and why."""


@dataclass(frozen=True)
class Entry:
    """A value and the line that it begins in, counted from 1."""

    value: Scalar | list[Scalar]
    line: int


@dataclass(frozen=True)
class ParameterSource:
    """
    Where the parameters of a command come from, merged as the node does.

    Attributes
    ----------
    paths : tuple of Path
        Parameter files; where two give a key, the later one wins.
    overrides : tuple of str
        ``key:=value`` with the value as in YAML; they win over all files.

    """

    paths: tuple[Path, ...] = ()
    overrides: tuple[str, ...] = ()

    @property
    def files(self) -> str:
        """Return the names of the files."""
        return ', '.join(map(str, self.paths))

    @property
    def arguments(self) -> list[str]:
        """Return the arguments of a command line that give it."""
        return [*(word for path in self.paths for word in ('--params-file', str(path))),
                *(word for rule in self.overrides for word in ('-p', rule))]

    def values(self) -> dict[str, Any]:
        """Return value by dotted name; raises ParameterFileError as :func:`load`."""
        found: dict[str, Any] = {}
        for path in self.paths:
            found.update(load(path))
        for rule in self.overrides:
            found.update(override(rule))
        return found

    def place_of(self, key: str) -> str:
        """Return where a key has its value from: file and line, the override, or the files."""
        for rule in reversed(self.overrides):
            if key in override(rule):
                return f'-p {rule}'
        for path in reversed(self.paths):
            entry = read(path).get(key)
            if entry:
                return f'{path}:{entry.line}'
        return self.files


def override(rule: str) -> dict[str, Any]:
    """Return name and value of ``key:=value``; raises ParameterFileError if it is none."""
    name, separator, value = rule.partition(':=')
    name = name.rpartition(':')[2]  # rcl takes the name of a node in front
    if not (separator and name and value.strip()) or '\n' in rule:
        raise ParameterFileError(f'-p {rule}: takes key:=value')
    text = f'/**:\n  {PARAMETERS}:\n    {name}: {value}'
    try:
        section, = _Reader(Path('-p'), text).sections().values()
    except ParameterFileError as error:
        raise ParameterFileError(f'-p {rule}: {str(error).partition(": ")[2]}') from None
    return {key: entry.value for key, entry in section.items()}


def load(path: Path, node: str = NODE_NAME, namespace: str = '/') -> dict[str, Any]:
    """
    Read the parameters of a node.

    Parameters
    ----------
    node, namespace : str
        Which sections count: those whose name, possibly with the wildcards ``*`` and
        ``**``, fits the node. Where two give a key, the one that begins further down wins.

    Returns
    -------
    dict
        Value by dotted name: bool, int, float, str, or a list of one of them.

    Raises
    ------
    ParameterFileError
        If the file cannot be read or has no section for the node.

    """
    return {name: entry.value for name, entry in read(path, node, namespace).items()}


def read(path: Path, node: str = NODE_NAME, namespace: str = '/') -> dict[str, Entry]:
    """Read as :func:`load`, with the line of each value."""
    sections = _Reader(path, _text(path)).sections()
    full_name = f'{namespace.rstrip("/")}/{node}'
    matching = [name for name in sections if _matches(name, full_name)]
    if not matching:
        raise ParameterFileError(
            f'{path}: has no section for {full_name}: takes /** or {full_name} above '
            f'{PARAMETERS}, has {", ".join(sections) or "none"}')
    found: dict[str, Entry] = {}
    for section in matching:
        found.update(sections[section])
    return found


def _matches(section: str, full_name: str) -> bool:
    rooted = section if section.startswith('/') else f'/{section}'
    return bool(re.fullmatch(rooted.replace('/*', r'(/\w+)'), full_name, re.ASCII))


def _text(path: Path) -> str:
    try:
        with path.open('rb') as file:
            data = file.read(MAX_FILE_SIZE + 1)
        if len(data) > MAX_FILE_SIZE:
            raise ParameterFileError(f'{path}: has more than {MAX_FILE_SIZE:,} bytes, which no '
                                     'parameter file has')
        return data.decode('utf-8-sig')
    except FileNotFoundError:
        raise ParameterFileError(f'{path}: there is no such file') from None
    except IsADirectoryError:
        raise ParameterFileError(f'{path}: is a directory, takes a parameter file') from None
    except OSError as error:
        raise ParameterFileError(f'{path}: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise ParameterFileError(
            f'{path}: is not UTF-8 text (byte {error.start} of the file), takes a parameter '
            'file') from None


def _line(event: yaml.Event) -> int:
    assert event.start_mark is not None
    return event.start_mark.line + 1


def _kind(event: yaml.Event) -> str:
    if isinstance(event, yaml.AliasEvent):
        return f'the alias *{event.anchor}'
    if isinstance(event, yaml.CollectionStartEvent):
        return 'a list' if isinstance(event, yaml.SequenceStartEvent) else 'a mapping'
    return f'the value {getattr(event, "value", "")!r}'


class _Reader:
    """Recursive descent through the events of the YAML parser, as rcl goes through them."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._parser: Iterator[yaml.Event] = yaml.parse(text, Loader=yaml.SafeLoader)
        self._sections: dict[str, dict[str, Entry]] = {}

    def sections(self) -> dict[str, dict[str, Entry]]:
        """Return the parameters by section, in the order in which the sections begin."""
        empty = True
        for event in iter(self._next, None):
            if isinstance(event, yaml.MappingStartEvent):
                empty = False
                self._names(event, '')
            elif isinstance(event, yaml.NodeEvent):
                raise self._error(event, f'takes a section such as /** with {PARAMETERS}, got '
                                         f'{_kind(event)}')
        if empty:
            raise ParameterFileError(f'{self._path}: is empty')
        return self._sections

    def _next(self) -> yaml.Event | None:
        try:
            return next(self._parser, None)
        except yaml.YAMLError as error:
            mark = getattr(error, 'problem_mark', None)
            line = f':{mark.line + 1}' if mark else ''
            problem = str(getattr(error, 'problem', None) or getattr(error, 'reason', 'broken'))
            hint = ' (indent with spaces)' if r"'\t'" in problem else ''
            raise ParameterFileError(
                f'{self._path}{line}: is not YAML: {problem}{hint}') from None

    def _error(self, event: yaml.Event, message: str) -> ParameterFileError:
        return ParameterFileError(f'{self._path}:{_line(event)}: {message}')

    def _pairs(self, start: yaml.Event, name: str) -> Iterator[tuple[str, yaml.Event]]:
        """Yield each key of a mapping with the event that begins its value."""
        seen: set[str] = set()
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or not event.value:
                raise self._error(event or start, f'takes text as a key, got '
                                                  f'{_kind(event or start)}')
            key = str(event.value)
            if key in seen:
                raise self._error(event, f'{key}: is given twice')
            seen.add(key)
            value = self._next()
            assert isinstance(value, yaml.NodeEvent)
            if isinstance(value, yaml.AliasEvent):
                raise self._error(event, f'{key}: got {_kind(value)}, which ROS does not take; '
                                         'write the value again')
            tag = getattr(value, 'tag', None)
            if tag:
                raise self._error(event, f'{key}: got the tag {tag}, which ROS versions read '
                                         'differently; leave it out')
            yield key, value
        if not seen:
            raise self._error(start, f'{name}: is empty')

    def _names(self, start: yaml.Event, prefix: str) -> None:
        """Read the levels above the parameters, whose keys make the section's name."""
        for key, event in self._pairs(start, prefix or 'the file'):
            if key != PARAMETERS:
                if not isinstance(event, yaml.MappingStartEvent) or prefix.count('/') > MAX_DEPTH:
                    near = difflib.get_close_matches(PARAMETERS, prefix.split('/'), 1)
                    hint = f'; {near[0]} is not it' if near else ''
                    raise self._error(event, f'{prefix or "the file"}: takes {PARAMETERS} above '
                                             f'its parameters, got {key}{hint}')
                self._names(event, f'{prefix}/{key}' if prefix.strip('/') else prefix + key)
                continue
            if not SECTION.fullmatch(prefix):
                raise self._error(event, f'{prefix or PARAMETERS}: is not the name of a node, '
                                         'such as /** or identifier_node')
            if not isinstance(event, yaml.MappingStartEvent):
                raise self._error(event, f'{PARAMETERS}: takes parameters, got {_kind(event)}')
            self._parameters(event, '', self._sections.setdefault(prefix, {}))

    def _parameters(self, start: yaml.Event, prefix: str, section: dict[str, Entry]) -> None:
        for key, event in self._pairs(start, prefix or PARAMETERS):
            name = f'{prefix}.{key}' if prefix else key
            if isinstance(event, yaml.MappingStartEvent):
                if name.count('.') > MAX_DEPTH or (prefix and '.' in key):
                    raise self._error(event, f'{name}: ROS misreads keys below a dotted key '
                                             'inside another; nest them one by one')
                self._parameters(event, name, section)
                continue
            if name in section:
                raise self._error(event, f'{name}: is given twice, first in line '
                                         f'{section[name].line}')
            value = (self._sequence(name) if isinstance(event, yaml.SequenceStartEvent)
                     else self._scalar(event, name))
            section[name] = Entry(value, _line(event))

    def _scalar(self, event: yaml.Event, name: str) -> Scalar:
        assert isinstance(event, yaml.ScalarEvent)
        if event.style in ("'", '"'):
            return str(event.value)
        if not event.value:
            raise self._error(event, f"{name}: has no value; write '' for an empty text")
        return scalar(event.value)

    def _sequence(self, name: str) -> list[Scalar]:
        values: list[Scalar] = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or event.tag:
                assert event is not None
                raise self._error(event, f'{name}: takes a flat list of plain values, got '
                                         f'{_kind(event)} in it, which ROS misreads')
            value = self._scalar(event, name)
            values.append(value)
            kinds = {type(entry) for entry in values}
            if len(kinds) > 1 and kinds != {int, float}:
                raise self._error(event, f'{name}: got {NAMES[type(values[0])]} '
                                         f'({values[0]!r}) and {NAMES[type(value)]} ({value!r}) '
                                         'in one list, which ROS refuses')
        if {type(entry) for entry in values} == {int, float}:
            return [float(entry) for entry in values]
        return values


def edited(path: Path, changes: Mapping[str, float | tuple[str, ...]]) -> str:
    """
    Return the text of a parameter file with other values.

    ``changes`` has the new number, or words of a list, by dotted name. A key that the file does
    not have goes to its neighbours. Raises ParameterFileError if the file cannot be read.
    """
    entries = read(path)
    text = path.read_bytes().decode('utf-8-sig')
    sections = list(_section_nodes(yaml.compose(text, Loader=yaml.SafeLoader)))
    begins = [section.start_mark.line + 1 for section in sections]

    def section_of(name: str) -> int:
        # of several sections that fit the node, the one that the value comes from
        entry = entries.get(name) or entries.get('dofs')
        line = entry.line if entry else begins[0]
        return max(k for k, begin in enumerate(begins) if begin <= line)

    for name, value in changes.items():
        root = list(_section_nodes(yaml.compose(text, Loader=yaml.SafeLoader)))[section_of(name)]
        text = _text_with(text, root, name, _as_yaml(value))
    return text


def _as_yaml(value: float | tuple[str, ...]) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(value)}]'
    return str(value).lower() if isinstance(value, bool) else repr(float(value))


def _section_nodes(node: yaml.Node | None) -> Iterator[yaml.MappingNode]:
    """Yield what stands below each ``ros__parameters``."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == PARAMETERS and isinstance(value, yaml.MappingNode):
                yield value
            else:
                yield from _section_nodes(value)


def _text_with(text: str, root: yaml.MappingNode, name: str, value: str) -> str:
    there = _entry(root, name)
    if there is not None:
        key, old = there
        begin, end = old.start_mark.index, old.end_mark.index
        comment = ''
        if isinstance(old, yaml.SequenceNode) and not old.flow_style:
            # a list in lines of its own may be indented no further than its key
            comment = text[key.end_mark.index:begin].strip().removeprefix(':').strip()
            begin, end = key.end_mark.index, old.value[-1].end_mark.index
            value = f': {value}'
        return f'{text[:begin]}{value}{"  " if comment else ""}{comment}{text[end:]}'
    mapping, rest = _innermost(root, name)
    *groups, last = rest.split('.')
    entry = f'{last}: {value}'
    for group in reversed(groups):
        entry = f'{group}: {{{entry}}}'
    first = mapping.value[0][0].start_mark
    gap = ', ' if mapping.flow_style else '\n' + ' ' * first.column
    return text[:first.index] + entry + gap + text[first.index:]


def _entry(mapping: yaml.MappingNode, name: str) -> tuple[yaml.Node, yaml.Node] | None:
    """Return key and value of a name, which may be nested or dotted."""
    for key, node in mapping.value:
        if key.value == name:
            return key, node
        if name.startswith(f'{key.value}.') and isinstance(node, yaml.MappingNode):
            found = _entry(node, name[len(key.value) + 1:])
            if found is not None:
                return found
    return None


def _innermost(mapping: yaml.MappingNode, name: str) -> tuple[yaml.MappingNode, str]:
    """Return the innermost mapping that a key belongs into, and its name in there."""
    for key, node in mapping.value:
        if name.startswith(f'{key.value}.') and isinstance(node, yaml.MappingNode):
            return _innermost(node, name[len(key.value) + 1:])
    return mapping, name


def shipped_file(name: str) -> Path:
    """
    Return a file of ``config/``, of the checkout or of the installation.

    Parameters
    ----------
    name : str
        Such as ``jhurov.yaml`` or ``examples/auv.yaml``.

    Raises
    ------
    ParameterFileError
        If it is nowhere.

    """
    here = Path(__file__).resolve()
    places = [here.parents[2] / 'config' / name]
    places += [up / 'share' / 'rovid_ros' / 'config' / name
               for up in (*here.parents, Path(sys.prefix))]
    for place in places:
        if place.is_file():
            return place
    raise ParameterFileError(f'{name} is neither at {places[0]} nor in share/rovid_ros/config of '
                             'the installation')
