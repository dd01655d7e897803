"""
The report of a comparison: one HTML file that needs nothing but a browser.

Everything that can be said in tables is in the file as text; plotly.js, which is in the file
too, draws the plots from numbers embedded as JSON. A content security policy forbids every
request.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
import hashlib
from importlib import resources
import json
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs
from rovid_ros.files.whole_files import write_text
from rovid_ros.report.figures import Figures
from rovid_ros.report.markup import capital, Html, join, tag
from rovid_ros.report.tables import (
    best_terms,
    equal_terms,
    excitation,
    findings,
    heat_legend,
    matrix,
    parameters,
    quality,
)
from rovid_ros.results.text import COMMAND, NO_NEWTONS

Data = Mapping[str, Any]


def write_report(path: Path, data: Data) -> None:
    """
    Write the report; at every moment the file is the old or the new one, whole.

    Parameters
    ----------
    path : Path
        HTML file.
    data : mapping
        What ``rovid compare`` found: ``rovid_version``, ``logs``, ``current`` and, under
        ``dofs``, per DOF ``sentence``, ``best``, ``models``, ``series``, ``adaptation``,
        ``excitation`` and ``units``, as ``rovid_ros.comparison.report_data`` has them. Times
        [s]; None is left out or shown as a dash.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    write_text(path, page(data))


def page(data: Data) -> str:
    """Return the whole HTML document."""
    figures = Figures(data)
    sections = _sections(data, figures)
    return document(f'Identification of {", ".join(data["dofs"])}', _header(data),
                    sections, figures)


def document(title: str, header: Html, sections: Sequence[tuple[str, str, Html]],
             figures: Figures) -> str:
    """Return an HTML document of some sections (id, heading, content) and their figures."""
    style = _source('style.css')
    plotly = get_plotlyjs()
    script = f"(() => {{\n'use strict';\n{_source('draw.js')}}})();\n"
    allowed = f"'{_hash(plotly)}' '{_hash(script)}'"
    # plotly writes style attributes, and exports a picture by way of a data URL
    policy = (f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
              "img-src data: blob:; base-uri 'none'; form-action 'none'")
    head = join(Html('<meta charset="utf-8">'),
                Html(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
                Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
                Html('<meta name="color-scheme" content="light dark">'), tag('title', title),
                Html(f'<style>{style}</style>'))
    body = join(
        tag('a', 'To the results', href=f'#{sections[0][0]}', class_='skip'),
        header, _contents(sections),
        tag('main', *(tag('section', tag('h2', heading), content, id=name)
                      for name, heading, content in sections)),
        Html(f'<script type="application/json" id="numbers">{_json(figures.document())}'
             f'</script><script type="text/plain" id="plotly">{plotly}</script>'
             f'<script>{script}</script>'))
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _sections(data: Data, figures: Figures) -> list[tuple[str, str, Html]]:
    dofs, logs = data['dofs'], data['logs']
    sections = [
        ('found', 'What was identified', findings(data)),
        ('parameters', 'Parameters', tag(
            'div', *(parameters(dof, values) for dof, values in dofs.items()), class_='cards')),
        ('prediction', 'Cross-validation', join(
            tag('p', 'Every model simulates every log from its thrust alone. The error is the '
                     'mean absolute error of the velocity (mae); a fit of 100 % would be '
                     'perfect.'), heat_legend(),
            *(matrix(dof, values, logs) for dof, values in dofs.items()))),
        ('terms', 'Methods and terms', join(
            tag('p', 'For each method the model with the lowest mean error over all logs; σ is '
                     'one standard deviation, where the method gives one.'),
            equal_terms(data), best_terms(data))),
    ]
    for dof, values in dofs.items():
        plots: list[Html] = []
        for log in logs:
            drawn = figures.of_log(dof, values, log)
            plots += [tag('h3', f'{capital(dof)} on {log["name"]}'), *drawn] if drawn else []
        if plots:
            first = [hint()] if len(sections) == 4 else []
            sections.append((f'plots-{dof}', f'{capital(dof)} over time', join(*first, *plots)))
    if data['current']:
        sections.append(('current', 'Current of the water', join(*(
            figures.of_current(found, log) for log, found in data['current'].items()))))
    sections.append(('excitation', 'Excitation', _excitation(data, figures)))
    sections.append(('quality', 'Data quality', join(*(quality(log) for log in logs))))
    return sections


def _excitation(data: Data, figures: Figures) -> Html:
    parts: list[Html] = [tag(
        'p', 'A parameter can only be told from data in which it mattered. Large and slow '
             'thrust identifies best.')]
    for dof, values in data['dofs'].items():
        parts.append(excitation(dof, values))
        parts += [figures.of_excitation(dof, values, log)
                  for log in values['excitation']]
    return join(*parts)


def _header(data: Data) -> Html:
    logs = [f'{log["name"]} ({log["duration_s"]:,.0f} s)' for log in data['logs']]
    return tag(
        'header', tag('h1', 'Vehicle identification'),
        tag('p', f'{", ".join(map(capital, data["dofs"]))} from {", ".join(logs)}'
                 f'. Made by rovid {data["rovid_version"]}.'),
        tag('p', Html('m v̇ + d<sub>Q</sub> v|v| + d<sub>L</sub> v + b = τ, or v̇ = α τ + β v|v| '
                      '+ γ v + δ'), class_='model'),
        command_unit(values['units']['force'] for values in data['dofs'].values()))


def _contents(sections: Sequence[tuple[str, str, Html]]) -> Html:
    return tag('nav', tag('ol', *(
        tag('li', tag('a', heading, href=f'#{name}')) for name, heading, _ in sections)),
        aria_label='Contents')


def command_unit(units: Iterable[str]) -> Html:
    """Return what is said where one of the units of force is no newton."""
    return tag('p', f'{NO_NEWTONS}.') if COMMAND in units else join()


def hint() -> Html:
    return join(
        tag('p', 'Drag across a plot, or pinch it, to zoom: all plots of the same log and degree '
                 'of freedom follow. Double-click to see everything again. Names in the legend '
                 'switch curves on and off; the camera saves a picture.', class_='hint script'),
        tag('noscript', tag('p', 'The plots need JavaScript. All results are in the tables.')))


def _source(name: str) -> str:
    return resources.files('rovid_ros.report').joinpath('page', name).read_text(encoding='utf-8')


def _hash(text: str) -> str:
    return f'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'


def _json(document: Any) -> str:
    """Return JSON in which nothing can end or open an element."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(',', ':'))
    for letter in '<>&\u2028\u2029':
        text = text.replace(letter, f'\\u{ord(letter):04x}')
    return text
