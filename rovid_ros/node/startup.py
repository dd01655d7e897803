"""The one line that says, some seconds after the start, which inputs are there."""

from __future__ import annotations

from rovid_core.settings import Settings
from rovid_ros.input_topics import topics_of
from rovid_ros.node.health import hertz, of_input, Situation
from rovid_ros.outputs import OK

LATEST = 5.0
"""[s] After this it is said, whatever is still missing."""

ENOUGH = 5
"""Messages of each topic that make a rate."""


class StartupSummary:
    """
    Say once what is there and what is missing and why, and again when that changes for good.

    Parameters
    ----------
    settings : Settings
        Which inputs there are.

    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._missing: set[str] | None = None  # when it was last said

    def due(self, at: Situation, elapsed: float) -> tuple[str, bool]:
        """
        Return the line, '' while there is nothing to say, and whether all inputs are there.

        Parameters
        ----------
        at : Situation
            What is there.
        elapsed : float
            Time since the start [s].

        """
        missing = {name for name in self._settings.used_inputs() if not _is_there(at, name)}
        if self._missing is None:
            has_rates = all(at.arrivals.count(topic) >= ENOUGH for topic in at.topics)
            if elapsed < LATEST and (missing or not has_rates):
                return '', False
        elif not self._missing - missing:  # none of the missing has come
            return '', False
        # only ever fewer, so that what comes and goes does not fill the log
        self._missing = missing if self._missing is None else self._missing & missing
        return _line(at, missing), not missing


def _is_there(at: Situation, name: str) -> bool:
    topics = topics_of(at.settings, name)
    return all(at.arrivals.count(topic) for topic in topics) and (
        at.recent.taken(name) > 0 or not at.recent.refused(name))


def _line(at: Situation, missing: set[str]) -> str:
    found, lost = [], []
    for name in at.settings.used_inputs():
        if name in missing:
            level, message = of_input(at, name)
            lost.append(f'{name} ({message})' if level != OK else name)
            continue
        topics = topics_of(at.settings, name)
        rate = hertz(min(at.arrivals.rate(topic) for topic in topics))
        kinds = {at.topics[topic].type.rpartition('/')[2] for topic in topics
                 if topic in at.topics}
        found.append(f'{name} {rate}' + (f' ({", ".join(sorted(kinds))})' if kinds else ''))
    line = f'inputs: {", ".join(found) or "none"}'
    return f'{line}; missing: {", ".join(lost)}' if lost else line
