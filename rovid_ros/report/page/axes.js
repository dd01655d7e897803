// Ticks, scales and how numbers are written.

/** The number of decimals that tells multiples of a step apart. */
const decimals = step => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

/** A number with four significant digits and a true minus. */
function number(value) {
  if (value === 0) return '0';
  const size = Math.abs(value);
  const text = size < 1e-4 || size >= 1e7 ? value.toExponential(3)
    : value.toFixed(Math.min(12, Math.max(0, 3 - Math.floor(Math.log10(size)))));
  const [digits, power] = text.replace('-', '−').split('e');
  return power ? `${digits} × 10${superscript(Number(power))}` : digits;
}

/** Round ticks, at most about `count`, between low and high. */
function linearTicks(low, high, count) {
  const rough = (high - low) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find(factor => factor * power >= rough * 0.999);
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) {
    ticks.push(i * step);
  }
  return {ticks, step};
}

/** Powers of ten between low and high; where they are few, round numbers too. */
function logTicks(low, high, count) {
  const first = Math.ceil(Math.log10(low) - 1e-9);
  const last = Math.floor(Math.log10(high) + 1e-9);
  const between = (factors, from, to) => {
    const ticks = [];
    for (let power = from; power <= to; power++) {
      for (const factor of factors) ticks.push(factor * 10 ** power);
    }
    return ticks.filter(tick => tick >= low && tick <= high);
  };
  if (high / low < 8) return linearTicks(low, high, count).ticks.filter(tick => tick > 0);
  for (const factors of [[1, 2, 5], [1, 3]]) {
    const ticks = between(factors, first - 1, last);
    if (ticks.length <= Math.max(3, count)) return ticks;
  }
  const every = Math.max(1, Math.ceil((last - first + 1) / Math.max(2, count)));
  return between([1], first, last).filter((_, i) => i % every === 0);
}

const SUPERSCRIPTS = '⁰¹²³⁴⁵⁶⁷⁸⁹';
const superscript = power => (power < 0 ? '⁻' : '')
  + String(Math.abs(power)).replace(/\d/g, digit => SUPERSCRIPTS[digit]);

function logLabel(tick) {
  const [digits, power] = tick.toExponential(2).split('e').map(Number);
  if (Math.abs(power) <= 2) return String(Number(tick.toPrecision(3)));
  return `${digits === 1 ? '' : `${digits} · `}10${superscript(power)}`;
}

/**
 * An axis from low to high over pixels from start to end.
 *
 * `power` is the power of ten that its labels leave out, for the axis' title.
 */
function makeAxis(low, high, start, end, count, log) {
  const forward = log ? Math.log10 : value => value;
  const from = forward(low);
  const scale = (end - start) / (forward(high) - from);
  const axis = {
    low, high, log, power: 0,
    at: value => start + (forward(value) - from) * scale,
    value: pixel => log ? 10 ** (from + (pixel - start) / scale) : from + (pixel - start) / scale,
  };
  if (log) {
    axis.ticks = logTicks(low, high, count).map(value => ({value, label: logLabel(value)}));
    return axis;
  }
  const {ticks, step} = linearTicks(low, high, count);
  const largest = Math.max(Math.abs(low), Math.abs(high));
  if (largest < 0.0099 || largest >= 1e5) axis.power = Math.floor(Math.log10(largest));
  const unit = 10 ** axis.power;
  axis.ticks = ticks.map(value => ({
    value,
    label: (value / unit || 0).toFixed(decimals(step / unit)).replace('-', '−'),
  }));
  return axis;
}
