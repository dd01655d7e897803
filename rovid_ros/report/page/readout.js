// What the pointer is on: a line through all linked panels and the values in a small box.

/** The index of the sample nearest to x; of the bar that holds x. */
function nearest(panel, x) {
  const after = lowerBound(panel.x, x);
  if (panel.curves[0].bars) return Math.max(0, Math.min(panel.x.length - 2, after - 1));
  if (after === 0) return 0;
  if (after >= panel.x.length) return panel.x.length - 1;
  const middle = panel.x_log ? Math.sqrt(panel.x[after] * panel.x[after - 1])
    : (panel.x[after] + panel.x[after - 1]) / 2;
  return x < middle ? after - 1 : after;
}

/** The lines of the box: name and value with its unit. */
function readings(panel, i) {
  const withUnit = (value, unit) => unit ? `${number(value)} ${unit}` : number(value);
  const [name, unit] = panel.xAxis;
  const bars = panel.curves[0].bars;
  const where = bars ? `${number(panel.x[i])} to ${withUnit(panel.x[i + 1], unit)}`
    : withUnit(panel.x[i], unit);
  const lines = [[null, name, where]];
  for (const curve of panel.curves) {
    if (!curve.shown) continue;
    const value = curve.values ? curve.values[i] ?? null : curve.constant;
    const text = value === null ? '–' : bars ? String(value) : withUnit(value, panel.yAxis[1]);
    lines.push([curve, curve.label, text]);
  }
  return lines;
}

const readout = document.createElement('div');
readout.className = 'readout';
readout.hidden = true;

let marked = []; // the panels with a line

function hideReadout() {
  readout.hidden = true;
  for (const panel of marked) panel.cursor.setAttribute('hidden', '');
  marked = [];
}

/** Show the values at x of a panel, beside the pointer; mark x in all linked panels. */
function showReadout(panel, linked, x) {
  const i = nearest(panel, x);
  const at = panel.curves[0].bars ? (panel.x[i] + panel.x[i + 1]) / 2 : panel.x[i];
  if (marked !== linked) hideReadout();
  marked = linked;
  for (const other of linked) {
    const inside = at >= other.xScale.low && at <= other.xScale.high;
    const pixel = inside ? other.xScale.at(at) : 0;
    other.cursor.setAttribute('x1', pixel);
    other.cursor.setAttribute('x2', pixel);
    other.cursor.toggleAttribute('hidden', !inside);
  }
  readout.replaceChildren(...readings(panel, i).map(([curve, name, text]) => {
    const line = document.createElement('div');
    if (curve) line.append(swatch(curve.style, curve.bars));
    const value = document.createElement('b');
    value.textContent = text;
    line.append(`${name} `, value);
    return line;
  }));
  panel.box.append(readout);
  readout.hidden = false;
  const pixel = panel.xScale.at(at) / panel.width * panel.box.clientWidth;
  const left = pixel > panel.box.clientWidth / 2;
  readout.style.left = left ? 'auto' : `${pixel + 12}px`;
  readout.style.right = left ? `${panel.box.clientWidth - pixel + 12}px` : 'auto';
}

/** A short piece of a curve, for legends. */
function swatch(style, bars) {
  const svg = element('svg', {viewBox: '0 0 28 10', class: 'swatch', 'aria-hidden': 'true'});
  if (bars) element('rect', {class: `bar f${style}`, x: 4, y: 1, width: 20, height: 8}, svg);
  else element('path', {class: `curve s${style}`, d: 'M0 5H28'}, svg);
  return svg;
}
