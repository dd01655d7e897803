"""The page of a survey: what drifts, and every parameter over all dives, in one HTML file."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from rovid_ros.files.whole_files import write_text
from rovid_ros.report.figures import Figures
from rovid_ros.report.markup import capital, finite, Html, join, NONE, quantity, table, tag, title
from rovid_ros.report.report import command_unit, document, hint
from rovid_ros.results.text import number

Data = Mapping[str, Any]


def write_survey(path: Path, data: Data) -> None:
    """
    Write the page; at every moment the file is the old or the new one, whole.

    Parameters
    ----------
    path : Path
        HTML file.
    data : mapping
        What ``rovid_ros.survey.trends`` found, as described there.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    write_text(path, survey_page(data))


def survey_page(data: Data) -> str:
    """Return the whole HTML document."""
    figures = Figures({'dofs': {}})
    sections = [('found', 'What changes', _findings(data))]
    for k, (dof, values) in enumerate(data['dofs'].items()):
        sections.append((f'plots-{dof}', f'{capital(dof)} over the dives', join(
            *([] if k else [hint()]), figures.of_survey(dof, values, data['axis']))))
    if data['failed']:
        rows = [[one['log'], one['error']] for one in data['failed']]
        sections.append(('failed', 'Dives without a result', table(
            f'{len(rows)} of {data["dives"]} dives', ['log', 'what is wrong'], [rows])))
    header = tag(
        'header', tag('h1', 'Survey of dives'),
        tag('p', f'{data["dives"]} dives, {len(data["failed"])} without a result. Made by rovid '
                 f'{data["rovid_version"]}.'),
        command_unit(values['parameters']['bias']['unit'] for values in data['dofs'].values()))
    return document(f'Survey of {data["dives"]} dives', header, sections, figures)


def _findings(data: Data) -> Html:
    drifting = [
        f'{dof} {title(name)}' for dof, values in data['dofs'].items()
        for name, found in values['parameters'].items() if found['trend']
        and found['trend']['drifts']]
    what = (f'Drifts: {", ".join(drifting)}.' if drifting
            else 'No parameter drifts, as far as these dives can tell.')
    head = ['', 'dives', 'mean', 'scatter', 'change', '95 % of it', 'p']
    tables = [table(tag('b', capital(dof)), head, [[
        _row(name, found) for name, found in values['parameters'].items()]])
        for dof, values in data['dofs'].items()]
    return join(
        tag('p', tag('b', what)),
        tag('p', 'Each line is a straight one through three dives or more, each weighted by its '
                 'interval and by the scatter between dives. The change is that from the first '
                 'dive to the last, the scatter a standard deviation beyond the intervals, and p '
                 f'how likely such a change is where nothing drifts, for all {data["tests"]} '
                 'tests together '
                 '(a drift is claimed below 0.05). Dives without thrust, or whose model predicts '
                 'worse than a constant, are left out. A step, as of a new payload, is a drift '
                 'too: look at the plots.'), *tables)


def _row(name: str, found: Data) -> list[str]:
    trend, unit = found['trend'], found['unit']
    if trend is None:
        return [title(name), str(len(found['points']['x'])), *[NONE] * 5]
    low, high = (number(finite(trend[f'change_{end}'])) for end in ('low', 'high'))
    p = f'{trend["p_together"]:.2g}' if math.isfinite(trend['p_together']) else NONE
    return [title(name), str(trend['count']), quantity(trend['mean'], unit),
            quantity(trend['scatter'], unit), quantity(trend['change'], unit),
            f'{low} to {high}'.replace('-', '−'), join(tag('b', p)) if trend['drifts'] else p]
