"""All that objects remember, as plain values, and back into objects that were made alike."""

from __future__ import annotations

from collections.abc import Mapping
import sys
from typing import Any

from rovid_core.snapshot_build import Build, SnapshotError
from rovid_core.snapshot_walk import attributes, class_name, Classes, is_state, Walk

__all__ = ['SnapshotError', 'Snapshots']


class Snapshots:
    """
    Take snapshots of some objects, and put them back into others that were made alike.

    The walk is by attribute, so that what is added to a class is carried without a word here.
    Values come back bit for bit, what several attributes share is shared again, and objects,
    lists, dicts, deques and sets that were there from the start stay the same ones, so that a
    bound method such as ``list.append`` still reaches them. Code and settings are not state:
    they stay what they are in the objects that a snapshot is put back into. Only classes that the
    modules which the objects at first come from define or import can be in a snapshot.

    Parameters
    ----------
    roots : mapping of str to object
        The objects, as they were made: nothing has happened to them yet.

    """

    def __init__(self, roots: Mapping[str, object]) -> None:
        self._roots = dict(roots)
        self._classes: Classes = {}
        self.learn()

    def learn(self) -> None:
        """Take also what the roots are made of now, where other settings made it different."""
        walk = Walk(self._classes, learning=True)
        for name, root in self._roots.items():
            walk.plain(root, name)
        for module in {cls.__module__ for cls, _ in self._classes.values()}:
            for cls in vars(sys.modules[module]).values():
                if isinstance(cls, type) and is_state(cls):
                    names = attributes(cls)
                    self._classes.setdefault(
                        class_name(cls), (cls, {frozenset(names)} if names else set()))

    def take(self) -> dict[str, Any]:
        """
        Return the state of the roots: numbers, texts, lists and dicts with text as keys.

        Raises
        ------
        TypeError
            For an attribute that holds something that could not come back; names it.

        """
        walk = Walk(self._classes)
        return {name: walk.plain(root, name) for name, root in self._roots.items()}

    def put_back(self, snapshot: object) -> None:
        """
        Let the roots be as they were when a snapshot was taken, all of it or nothing.

        Raises
        ------
        SnapshotError
            If it is not one of objects that were made like these.

        """
        if not isinstance(snapshot, dict) or snapshot.keys() != self._roots.keys():
            raise SnapshotError(f'it does not hold {", ".join(self._roots)}')
        build = Build(self._classes)
        for name, root in self._roots.items():
            build.into(root, snapshot[name], name)
        build.commit()
