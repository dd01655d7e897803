"""New values in a parameter file whose other keys, comments and order stay as they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from rovid_ros.config.parameter_file import PARAMETERS, read
import yaml


def edited(path: Path, changes: Mapping[str, float]) -> str:
    """
    Return the text of a parameter file with other values.

    Parameters
    ----------
    path : Path
        A parameter file that has ``dofs``.
    changes : mapping
        New number by dotted name. A key that the file does not have goes to its neighbours.

    Raises
    ------
    ParameterFileError
        If the file cannot be read.

    """
    entries = read(path)
    text = path.read_bytes().decode('utf-8-sig')
    sections = list(_sections(yaml.compose(text, Loader=yaml.SafeLoader)))
    begins = [section.start_mark.line + 1 for section in sections]

    def section_of(name: str) -> int:
        # of several sections that fit the node, the one that the value comes from
        line = entries.get(name, entries['dofs']).line
        return max(k for k, begin in enumerate(begins) if begin <= line)

    for name, value in changes.items():
        root = list(_sections(yaml.compose(text, Loader=yaml.SafeLoader)))[section_of(name)]
        text = _with(text, root, name, repr(float(value)))
    return text


def _sections(node: yaml.Node | None) -> Iterator[yaml.MappingNode]:
    """Yield what stands below each ``ros__parameters``."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == PARAMETERS and isinstance(value, yaml.MappingNode):
                yield value
            else:
                yield from _sections(value)


def _with(text: str, root: yaml.MappingNode, name: str, value: str) -> str:
    there = _found(root, name)
    if there is not None:
        return text[:there.start_mark.index] + value + text[there.end_mark.index:]
    mapping, rest = _nearest(root, name)
    *groups, last = rest.split('.')
    entry = f'{last}: {value}'
    for group in reversed(groups):
        entry = f'{group}: {{{entry}}}'
    first = mapping.value[0][0].start_mark
    gap = ', ' if mapping.flow_style else '\n' + ' ' * first.column
    return text[:first.index] + entry + gap + text[first.index:]


def _found(mapping: yaml.MappingNode, name: str) -> yaml.Node | None:
    """Return the value of a key, which may be nested or dotted."""
    for key, node in mapping.value:
        if key.value == name:
            return node  # type: ignore[no-any-return]
        if name.startswith(f'{key.value}.') and isinstance(node, yaml.MappingNode):
            found = _found(node, name[len(key.value) + 1:])
            if found is not None:
                return found
    return None


def _nearest(mapping: yaml.MappingNode, name: str) -> tuple[yaml.MappingNode, str]:
    """Return the innermost mapping that a key belongs into, and its name in there."""
    for key, node in mapping.value:
        if name.startswith(f'{key.value}.') and isinstance(node, yaml.MappingNode):
            return _nearest(node, name[len(key.value) + 1:])
    return mapping, name
