// One panel: an SVG with two axes and its curves. Colours and dashes are the style's.

const SVG = 'http://www.w3.org/2000/svg'; // a name: nothing is fetched
const DYNAMICS = 1e5; // of a spectrum; below that is only the rounding of numbers
let paperWidth = 0; // [px] of the panels while printing

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (parent) parent.append(made);
  return made;
}

function label(text, x, y, attributes, parent) {
  element('text', {x, y, ...attributes}, parent).textContent = text;
}

/** The index of the first entry that is at least value. */
function lowerBound(sorted, value) {
  let low = 0, high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

class Panel {
  constructor(spec, columns, place) {
    Object.assign(this, spec);
    this.x = columns[spec.x];
    for (const curve of this.curves) {
      curve.values = this.valuesOf(curve, columns);
      curve.shown = true;
    }
    this.svg = element('svg', {role: 'img'}, place);
    this.box = place;
    this.svg.setAttribute('aria-label', this.description());
    const positive = this.x.filter(x => x !== null && (!this.x_log || x > 0));
    this.full = [positive[0] ?? 0, positive[positive.length - 1] ?? 1];
    if (!(this.full[1] > this.full[0])) this.full[1] = this.full[0] + 1;
    // what begins just after 0, such as a time, is shown from there
    if (this.full[0] > 0 && this.full[0] < 0.02 * this.full[1] && !this.x_log) this.full[0] = 0;
  }

  valuesOf(curve, columns) {
    if ('constant' in curve) return null;
    const values = columns[curve.y];
    if ('less' in curve) return values.map(y => y === null ? null : y - curve.less);
    if (!('minus' in curve)) return values;
    const other = columns[curve.minus];
    return values.map((y, i) => y === null || other[i] === null ? null : y - other[i]);
  }

  description() {
    const unit = ([, text]) => text ? ` [${text}]` : '';
    const names = this.curves.map(curve => curve.label).join(', ');
    return `${this.yAxis[0]}${unit(this.yAxis)} over ${this.xAxis[0]}${unit(this.xAxis)}: ${names}`;
  }

  /** Draw the part between range[0] and range[1]; return the number of drawn points. */
  draw(range) {
    const width = this.width = Math.max(240, Math.round(
      paperWidth ? paperWidth * (this.half ? 0.49 : 1) : this.box.clientWidth));
    const height = this.height = this.tall ? 230 : 168;
    this.area = {left: width < 420 ? 44 : 54, right: width - 10, top: 24, bottom: height - 36};
    const {left, right, top, bottom} = this.area;
    this.svg.replaceChildren();
    this.svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    this.xScale = makeAxis(range[0], range[1], left, right, width / 64, this.x_log);
    const [low, high] = this.span(range);
    this.yScale = makeAxis(low, high, bottom, top, (bottom - top) / 22, this.y_log);
    this.drawAxes();
    const frame = element('svg', {
      x: left, y: top, width: right - left, height: bottom - top,
      viewBox: `${left} ${top} ${right - left} ${bottom - top}`}, this.svg);
    let points = 0;
    for (const curve of this.curves) if (curve.shown) points += this.drawCurve(curve, frame);
    this.cursor = element('line', {class: 'cursor', y1: top, y2: bottom, hidden: ''}, this.svg);
    this.band = element('rect', {class: 'band', y: top, height: bottom - top, width: 0}, this.svg);
    return points;
  }

  /** The lowest and highest value to show, with some room. */
  span(range) {
    let low = Infinity, high = -Infinity;
    const [first, last] = this.visible(range);
    const take = y => {
      if (y === null || (this.y_log && !(y > 0))) return;
      if (y < low) low = y;
      if (y > high) high = y;
    };
    for (const curve of this.curves) {
      if (!curve.shown) continue;
      if (curve.values) for (let i = first; i < last; i++) take(curve.values[i] ?? null);
      else take(curve.constant);
      if (curve.bars) take(0);
    }
    if (low > high) return this.y_log ? [0.1, 1] : [-1, 1];
    if (this.y_log) {
      if (this.x_log) low = Math.max(low, high / DYNAMICS);
      return [low / 1.3, Math.max(high, low * 1.05) * 1.3];
    }
    const room = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
    return [low === 0 && this.curves[0].bars ? 0 : low - room, high + room];
  }

  /** Indices of the points in a range, and one more at each side. */
  visible(range) {
    const last = this.x.length;
    return [Math.max(0, lowerBound(this.x, range[0]) - 1),
            Math.min(last, lowerBound(this.x, range[1]) + 1)];
  }

  drawAxes() {
    const {left, right, top, bottom} = this.area;
    const title = ([name, unit], power) => {
      const factor = power ? `10${superscript(power)}` : '';
      const inside = [factor, unit].filter(Boolean).join(' ');
      return inside ? `${name} [${inside}]` : name;
    };
    for (const {value, label: text} of this.yScale.ticks) {
      const y = this.yScale.at(value);
      const zero = value === 0 ? 'grid zero' : 'grid';
      element('line', {class: zero, x1: left, x2: right, y1: y, y2: y}, this.svg);
      label(text, left - 5, y + 4, {class: 'tick', 'text-anchor': 'end'}, this.svg);
    }
    for (const {value, label: text} of this.xScale.ticks) {
      const x = this.xScale.at(value);
      element('line', {class: 'grid', x1: x, x2: x, y1: top, y2: bottom}, this.svg);
      label(text, x, bottom + 14, {class: 'tick', 'text-anchor': 'middle'}, this.svg);
    }
    element('path', {class: 'frame', d: `M${left} ${top}V${bottom}H${right}`}, this.svg);
    label(title(this.yAxis, this.yScale.power), 2, 14, {class: 'name'}, this.svg);
    label(title(this.xAxis, this.xScale.power), right, bottom + 29,
          {class: 'name', 'text-anchor': 'end'}, this.svg);
  }

  drawCurve(curve, frame) {
    if (curve.bars) return this.drawBars(curve, frame);
    const {left, right} = this.area;
    const style = `curve s${curve.style}`;
    if (!curve.values) {
      const y = this.yScale.at(curve.constant).toFixed(1);
      element('path', {class: style, d: `M${left} ${y}H${right}`}, frame);
      return 2;
    }
    const [d, points] = this.pathOf(curve.values);
    element('path', {class: style, d}, frame);
    return points;
  }

  /** An SVG path; of the points in one pixel column the first, lowest, highest and last. */
  pathOf(values) {
    const {x, xScale, yScale} = this;
    const [first, last] = this.visible([xScale.low, xScale.high]);
    const parts = [];
    let points = 0, open = false, column = null, kept = [];
    const flush = () => {
      for (const i of [...new Set(kept)].sort((a, b) => a - b)) {
        parts.push(open ? 'L' : 'M', xScale.at(x[i]).toFixed(1), ' ',
                   yScale.at(values[i]).toFixed(1));
        open = true;
        points++;
      }
      kept = [];
    };
    for (let i = first; i < last; i++) {
      const y = values[i] ?? null;
      if (y === null || x[i] === null || (this.y_log && !(y > 0)) || (this.x_log && !(x[i] > 0))) {
        flush();
        open = false;
        continue;
      }
      const here = Math.floor(xScale.at(x[i]));
      if (here !== column) flush();
      column = here;
      if (!kept.length) kept = [i, i, i, i];
      if (y < values[kept[1]]) kept[1] = i;
      if (y > values[kept[2]]) kept[2] = i;
      kept[3] = i;
    }
    flush();
    return [parts.join(''), points];
  }

  drawBars(curve, frame) {
    const zero = this.yScale.at(0);
    let drawn = 0;
    curve.values.forEach((count, i) => {
      if (count === null || i + 1 >= this.x.length) return;
      const left = this.xScale.at(this.x[i]), right = this.xScale.at(this.x[i + 1]);
      const top = this.yScale.at(count);
      element('rect', {class: `bar f${curve.style}`, x: left, y: top,
                       width: Math.max(0.5, right - left - 0.5), height: zero - top}, frame);
      drawn++;
    });
    return drawn;
  }
}
