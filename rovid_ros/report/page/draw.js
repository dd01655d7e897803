// Hands the plots of the page to plotly, each when it comes near the window.

const root = document.documentElement;
root.dataset.errors = '0';
const count = () => { root.dataset.errors = String(Number(root.dataset.errors) + 1); };
addEventListener('error', count);
addEventListener('unhandledrejection', count);
document.addEventListener('securitypolicyviolation', count);
root.classList.add('drawn');

const {columns, plots} = JSON.parse(document.getElementById('numbers').textContent);
const touch = matchMedia('(pointer: coarse)').matches;
const PAPER = 680; // [px]
const CONFIG = {
  responsive: true, displaylogo: false, displayModeBar: true, showSendToCloud: false,
  modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d'],
  toImageButtonOptions: {format: 'png', scale: 2},
};
const ranges = new Map(); // of linked x axes: [low, high], or null for everything
const drawn = new Map();
let printing = false;

/** The value of a colour of the style sheet. */
const color = name => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

function painted(trace) {
  const made = {...trace, x: columns[trace.x], y: columns[trace.y]};
  for (const key of ['line', 'marker']) {
    if (trace[key]) made[key] = {...trace[key], color: color(trace[key].color)};
  }
  return made;
}

/** The layout of a plot at a width: its legend takes as many lines as it needs. */
function arranged(spec, width) {
  const left = 52, right = 12, entry = Math.min(290, width - left - right);
  const lines = Math.ceil(spec.entries / Math.max(1, Math.floor((width - 20) / entry)));
  const top = 30 + 20 * lines, bottom = 42;
  const ink = color('ink'), soft = color('soft'), paper = color('paper');
  const axis = {gridcolor: color('grid'), zerolinecolor: soft, zerolinewidth: 1,
                linecolor: soft, showline: true, ticks: '', tickfont: {size: 11, color: soft},
                exponentformat: 'power', tickformat: '', automargin: false};
  const layout = {
    ...spec.layout, height: spec.layout.height + top + bottom, autosize: true,
    width: printing ? PAPER : undefined,
    margin: {l: left, r: right, t: top, b: bottom}, paper_bgcolor: paper, plot_bgcolor: paper,
    font: {family: getComputedStyle(document.body).fontFamily, size: 12, color: ink},
    separators: '.', showlegend: spec.entries > 0, bargap: 0.03,
    legend: {orientation: 'h', x: 0, xref: 'container', y: 1, yref: 'container', yanchor: 'top',
             entrywidth: entry - 40, tracegroupgap: 0, font: {size: 12}, itemclick: 'toggle',
             bgcolor: 'rgba(0,0,0,0)'},
    modebar: {bgcolor: 'rgba(0,0,0,0)', color: soft, activecolor: color('link')},
    hovermode: 'x unified', hoversubplots: 'axis', dragmode: touch ? false : 'zoom',
    hoverlabel: {bgcolor: paper, bordercolor: soft, font: {color: ink}},
    annotations: spec.layout.annotations.map(note => ({
      ...note, xref: 'paper', yref: 'paper', x: 0, xanchor: 'left', yanchor: 'bottom',
      xshift: 6 - left, yshift: 2, showarrow: false, font: {size: 12.5, color: ink}})),
  };
  for (const key in spec.layout) {
    if (/^[xy]axis/.test(key)) layout[key] = {...axis, ...spec.layout[key]};
  }
  layout.legend.y = 1 - 28 / layout.height;
  Object.assign(layout.xaxis, {title: {...layout.xaxis.title, standoff: 6, font: {size: 12}},
                               spikecolor: soft, showspikes: true, spikemode: 'across',
                               spikethickness: 1, spikedash: 'solid', spikesnap: 'cursor'});
  const range = ranges.get(spec.link);
  if (range) layout.xaxis.range = [...range];
  return layout;
}

async function draw(id) {
  const spec = plots[id], figure = document.getElementById(id);
  const place = figure.querySelector('.plot');
  const layout = arranged(spec, printing ? PAPER : place.clientWidth);
  await Plotly.react(place, spec.traces.map(painted), layout, {
    ...CONFIG, toImageButtonOptions: {
      ...CONFIG.toImageButtonOptions,
      filename: `${figure.dataset.kind}_${figure.dataset.dof}`}});
  figure.dataset.drawn = 'true';
  if (drawn.has(id)) return;
  drawn.set(id, place);
  if (spec.link) {
    place.on('plotly_relayout', change => follow(id, change));
    pinch(place);
  }
}

/** Show in all plots of a link what one of them was zoomed to. */
function follow(from, change) {
  const link = plots[from].link;
  let range = change['xaxis.range'];
  if ('xaxis.range[0]' in change) range = [change['xaxis.range[0]'], change['xaxis.range[1]']];
  if (!range && !change['xaxis.autorange']) return;
  const known = ranges.get(link) ?? null;
  if (String(range ?? null) === String(known)) return;
  ranges.set(link, range ?? null);
  for (const [id, place] of drawn) {
    if (id === from || plots[id].link !== link) continue;
    const shown = range ? {'xaxis.range': [...range]} : {'xaxis.autorange': true};
    Plotly.relayout(place, shown);
  }
}

/** Zoom the time by two fingers, which plotly cannot. */
function pinch(place) {
  let start = null, next = null;
  const at = touches => [...touches].map(({clientX}) => {
    const box = place.getBoundingClientRect();
    const {l, r} = place.layout.margin;
    return (clientX - box.left - l) / (box.width - l - r);
  }).sort((a, b) => a - b);
  const listen = (name, heard) => place.addEventListener(
    name, heard, {capture: true, passive: false});
  listen('touchstart', event => {
    if (event.touches.length !== 2) return;
    event.stopPropagation();
    const [low, high] = place.layout.xaxis.range;
    start = at(event.touches).map(share => low + share * (high - low));
  });
  listen('touchmove', event => {
    if (!start || event.touches.length !== 2) return;
    event.preventDefault();
    event.stopPropagation();
    const [a, b] = at(event.touches);
    const slope = (start[1] - start[0]) / Math.max(0.05, b - a);
    if (!next) {
      requestAnimationFrame(() => {
        Plotly.relayout(place, {'xaxis.range': next});
        next = null;
      });
    }
    next = [start[0] - a * slope, start[0] + (1 - a) * slope];
  });
  listen('touchend', () => { start = null; });
}

/** Run plotly, which lies in the page as text: so the tables do not wait for it. */
function start() {
  if (window.Plotly) return;
  const script = document.createElement('script');
  script.textContent = document.getElementById('plotly').textContent;
  document.head.append(script);
  for (const figure of document.querySelectorAll('figure')) near.observe(figure);
  root.dataset.ready = 'true';
}

const near = new IntersectionObserver(entries => {
  for (const {isIntersecting, target} of entries) {
    if (!isIntersecting) continue;
    near.unobserve(target);
    draw(target.id);
  }
}, {rootMargin: '500px'});

for (const id in plots) {
  const figure = document.getElementById(id), place = figure.querySelector('.plot');
  place.style.height = `${arranged(plots[id], place.clientWidth).height}px`;
}

const again = ids => [...ids].forEach(draw);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => again(drawn.keys()));
addEventListener('beforeprint', () => {
  printing = true;
  start();
  again(Object.keys(plots));
});
addEventListener('afterprint', () => {
  printing = false;
  again(drawn.keys());
});
addEventListener('load', () => setTimeout(start, 50));
