"""HTML whose text is always escaped, and how the report writes names and numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import html
import math
import re
from typing import Any

from rovid_core.model.dofs import PARAMETERS
from rovid_ros.results.text import number

NONE = '–'
SYMBOLS = {
    'alpha': 'α', 'beta': 'β', 'gamma': 'γ', 'delta': 'δ',
    'mass': 'm', 'quadratic_drag': 'd_Q', 'linear_drag': 'd_L', 'bias': 'b',
}
NAMES = {'mass': 'effective mass', 'aid': 'adaptive identifier',
         'aid_offline': 'adaptive identifier, repeated passes',
         'ekf': 'extended Kalman filter'}


class Html(str):
    """Markup; any other ``str`` is text and gets escaped where it meets markup."""


def join(*parts: str) -> Html:
    """Return parts in a row, escaping those that are not markup."""
    return Html(''.join(part if isinstance(part, Html) else html.escape(part) for part in parts))


def tag(name: str, *children: str, **attributes: str | None) -> Html:
    """
    Return an element.

    Children are markup (``Html``) or text. Attributes are ``class_`` for ``class``, ``data_dof``
    for ``data-dof``; None leaves one out.
    """
    shown = ''.join(f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"' for key,
                    value in attributes.items() if value is not None)
    return Html(f'<{name}{shown}>{join(*children)}</{name}>')


def table(caption: str, head: Sequence[str], bodies: Sequence[Sequence[Sequence[str]]], *,
          class_: str | None = None) -> Html:
    """
    Return a table that scrolls by itself where the screen is too narrow for it.

    A cell that is a ``<td>`` or ``<th>`` is taken as it is; the first of a row becomes its head.
    """
    def cell(i: int, content: str) -> Html:
        if isinstance(content, Html) and content.startswith(('<td', '<th')):
            return content
        return tag('td', content) if i else tag('th', content, scope='row')

    rows = [tag('tbody', *(tag('tr', *(cell(i, c) for i, c in enumerate(row))) for row in body))
            for body in bodies]
    heads = tag('thead', tag('tr', *(tag('th', title, scope='col') for title in head)))
    whole = tag('table', tag('caption', tag('span', caption)), heads, *rows, class_=class_)
    plain = ' '.join(html.unescape(re.sub('<[^>]*>', '', join(caption))).split())
    return tag('div', whole, class_='scroll', tabindex='0', role='region', aria_label=plain)


def small(*text: str, class_: str | None = None) -> Html:
    """Return a second line of a cell."""
    return tag('small', *text, class_=class_)


def title(name: str) -> str:
    """Return a name from the code as people write it."""
    return NAMES.get(name, name.replace('_', ' '))


def capital(text: str) -> str:
    """Return text with its first letter upper-case and the others as they are."""
    return text[:1].upper() + text[1:]


def symbol(name: str) -> Html:
    """Return the symbol of a parameter, with its index set low."""
    base, _, index = SYMBOLS.get(name, name).partition('_')
    return tag('i', base, tag('sub', index) if index else '')


def terms(names: Sequence[str]) -> str:
    """Return the symbols of the terms of a model, in the order of ``PARAMETERS``."""
    return ' '.join(SYMBOLS[name] for name in PARAMETERS if name in names)


def finite(value: float | None) -> float:
    """Return a number, NaN for None."""
    return math.nan if value is None else float(value)


def quantity(value: float | None, unit: str) -> Html:
    """Return a number with four significant digits and its unit, or a dash."""
    if not math.isfinite(finite(value)):
        return Html(NONE)
    return with_unit(number(finite(value)), unit)


def with_unit(text: str, unit: str) -> Html:
    """Return a number as it is set: a true minus, powers of ten, and its unit."""
    digits, exponent, power = text.replace('-', '−').partition('e')
    if exponent:
        shown = join(digits, ' × 10', tag('sup', power[:1].strip('+') + power[1:].lstrip('0')))
    else:
        shown = join(digits)
    return join(shown, '\u00a0', tag('span', unit, class_='unit')) if unit else shown


def bound_to_units(text: str) -> str:
    """Return a sentence in which no line ends between a number and its unit."""
    return re.sub(r'(?<=\d) (?=[%\w])', '\u00a0', text)


def percent(value: float) -> str:
    """Return a share in percent, with at most four significant digits."""
    share = 100.0 * value
    if not math.isfinite(share):
        return NONE
    size = abs(share)
    digits = 1 if size >= 10.0 else 2 if size >= 0.1 else 3
    text = f'{share:,.{digits}f}' if size < 1e5 else f'{share:.1e}'
    return f'{text} %'.replace('-', '−')


def score(model: Mapping[str, Any], log: str, key: str) -> float:
    """Return ``mae``, ``fit`` or ``fit_joint`` of a model on a log, NaN if there is none."""
    return finite(model['scores'][log].get(key))


def mean_score(model: Mapping[str, Any]) -> tuple[float, float]:
    """Return mean mae and mean fit of a model over the logs that it was scored on."""
    means = []
    for key in ('mae', 'fit'):
        values = [score(model, log, key) for log in model['scores']]
        values = [value for value in values if math.isfinite(value)]
        means.append(math.fsum(values) / len(values) if values else math.nan)
    return means[0], means[1]


def rank(model: Mapping[str, Any]) -> tuple[int, float]:
    """Return what to sort models by: those with most logs scored, then the lowest mean mae."""
    scored = [log for log in model['scores'] if math.isfinite(score(model, log, 'mae'))]
    mae = mean_score(model)[0]
    return -len(scored), mae if math.isfinite(mae) else math.inf
