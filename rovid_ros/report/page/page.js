// Makes the figures from the numbers in the page and draws them.

const root = document.documentElement;
root.dataset.errors = '0';
const count = () => { root.dataset.errors = String(Number(root.dataset.errors) + 1); };
addEventListener('error', count);
addEventListener('unhandledrejection', count);
document.addEventListener('securitypolicyviolation', count);
root.classList.add('drawn');

const {columns, figures} = JSON.parse(document.getElementById('numbers').textContent);
const groups = new Map();

class Figure {
  constructor(id, spec) {
    this.node = document.getElementById(id);
    const plot = this.node.querySelector('.plot');
    this.bar = document.createElement('div');
    this.bar.className = 'bar-of-buttons';
    plot.append(this.bar);
    const panels = document.createElement('div');
    panels.className = 'panels';
    plot.append(panels);
    this.panels = spec.panels.map(panelSpec => this.addPanel(panelSpec, panels));
    this.groups = new Set(this.panels.map(panel => panel.linked));
    this.addLegend();
    this.addReset();
  }

  addPanel(spec, place) {
    const box = document.createElement('div');
    box.className = spec.half || this.node.dataset.kind === 'excitation' ? 'panel half' : 'panel';
    place.append(box);
    const panel = new Panel(spec, columns, box);
    if (!groups.has(spec.group)) groups.set(spec.group, new Group());
    panel.linked = groups.get(spec.group);
    panel.linked.panels.push(panel);
    panel.linked.figures.add(this);
    listen(panel, panel.linked);
    return panel;
  }

  /** One button per name; what has the same name in several panels goes together. */
  addLegend() {
    const byName = new Map();
    for (const {curves} of this.panels) {
      if (curves.length < 2 && !byName.has(curves[0]?.label)) continue; // nothing to tell apart
      for (const curve of curves) {
        byName.set(curve.label, [...byName.get(curve.label) || [], curve]);
      }
    }
    for (const [name, curves] of byName) {
      const button = document.createElement('button');
      button.type = 'button';
      button.setAttribute('aria-pressed', 'true');
      button.append(swatch(curves[0].style, curves[0].bars), name);
      button.addEventListener('click', () => {
        const shown = !curves[0].shown;
        for (const curve of curves) curve.shown = shown;
        button.setAttribute('aria-pressed', String(shown));
        for (const group of this.groups) group.redraw();
      });
      this.bar.append(button);
    }
  }

  addReset() {
    this.whole = document.createElement('button');
    this.whole.type = 'button';
    this.whole.className = 'whole';
    this.whole.textContent = 'Show everything';
    this.whole.hidden = true;
    this.whole.addEventListener('click', () => {
      for (const group of this.groups) group.reset();
    });
    this.bar.after(this.whole);
  }

  /** Say how much was drawn, and offer the way back from a zoom. */
  update() {
    const points = this.panels.map(panel => panel.drawn ?? 0);
    this.node.dataset.drawn = String(points.reduce((sum, n) => sum + n, 0));
    this.node.dataset.panels = points.join(' ');
    this.whole.hidden = ![...this.groups].some(group => group.range);
  }
}

function drawAll() {
  for (const group of groups.values()) group.draw();
}

for (const id in figures) new Figure(id, figures[id]);
drawAll();

let width = innerWidth;
addEventListener('resize', () => {
  if (innerWidth === width) return; // a phone's address bar comes and goes
  width = innerWidth;
  for (const group of groups.values()) group.redraw();
});
addEventListener('beforeprint', () => {
  paperWidth = 680;
  drawAll();
});
addEventListener('afterprint', () => {
  paperWidth = 0;
  drawAll();
});
root.dataset.ready = 'true';
