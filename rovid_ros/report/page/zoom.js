// Linked axes: all panels of a group show the same range.

const CLOSEST = 1e-4; // of the whole range, that can still be zoomed to
const CLICK = 5; // [px] that a press may move and still be a click

class Group {
  constructor() {
    this.panels = [];
    this.figures = new Set();
    this.range = null; // null: everything
    this.waiting = false;
  }

  get full() {
    return [Math.min(...this.panels.map(panel => panel.full[0])),
            Math.max(...this.panels.map(panel => panel.full[1]))];
  }

  get log() {
    return this.panels[0].x_log;
  }

  /** Show from low to high, kept inside of what there is. */
  show(low, high) {
    const forward = this.log ? Math.log : x => x, back = this.log ? Math.exp : x => x;
    const [start, end] = this.full.map(forward);
    let from = forward(Math.max(low, this.log ? 1e-300 : -Infinity)), to = forward(high);
    const width = Math.min(end - start, Math.max(to - from, (end - start) * CLOSEST));
    from = Math.min(Math.max(from, start), end - width);
    to = from + width;
    this.range = width > (end - start) * 0.999 ? null : [back(from), back(to)];
    this.redraw();
  }

  /** Zoom by a factor around x, or move by a share of what is shown. */
  zoom(factor, x) {
    const forward = this.log ? Math.log : v => v, back = this.log ? Math.exp : v => v;
    const [low, high] = (this.range || this.full).map(forward);
    const middle = x === undefined ? (low + high) / 2 : forward(x);
    this.show(back(middle - (middle - low) / factor), back(middle + (high - middle) / factor));
  }

  move(share) {
    const forward = this.log ? Math.log : v => v, back = this.log ? Math.exp : v => v;
    const [low, high] = (this.range || this.full).map(forward);
    const by = (high - low) * share;
    this.show(back(low + by), back(high + by));
  }

  reset() {
    this.range = null;
    this.redraw();
  }

  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  draw() {
    const range = this.range || this.full;
    for (const panel of this.panels) panel.drawn = panel.draw(range);
    for (const figure of this.figures) figure.update();
  }
}

/** Let pointer, wheel and keys on a panel move its group. */
function listen(panel, group) {
  const {svg, box} = panel;
  const pixel = event => {
    const frame = svg.getBoundingClientRect();
    const {left, right} = panel.area;
    return Math.min(right, Math.max(left, (event.clientX - frame.left) / frame.width * panel.width));
  };
  const touches = new Map(); // pointer -> where it is [px]
  let pinned = null; // x under the two fingers when the second came down
  let press = null; // [px] where a drag began
  let active = false; // the wheel zooms after a click, until the pointer leaves

  const pinch = () => {
    const [a, b] = [...touches.values()].sort((p, q) => p - q);
    const [u, v] = pinned;
    const {left, right} = panel.area;
    const forward = group.log ? Math.log : x => x, back = group.log ? Math.exp : x => x;
    const perPixel = (forward(v) - forward(u)) / Math.max(b - a, 10);
    const low = forward(u) - (a - left) * perPixel;
    group.show(back(low), back(low + (right - left) * perPixel));
  };

  svg.addEventListener('pointerdown', event => {
    if (event.pointerType === 'touch') {
      touches.set(event.pointerId, pixel(event));
      if (touches.size === 2) {
        pinned = [...touches.values()].sort((p, q) => p - q).map(panel.xScale.value);
        hideReadout();
      }
    } else if (event.button === 0) {
      press = pixel(event);
    } else {
      return;
    }
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener('pointermove', event => {
    const at = pixel(event);
    if (touches.has(event.pointerId)) {
      touches.set(event.pointerId, at);
      if (touches.size === 2 && pinned) return pinch();
      if (touches.size > 1 || pinned) return undefined;
    } else if (press !== null) {
      panel.band.setAttribute('x', Math.min(press, at));
      panel.band.setAttribute('width', Math.abs(at - press));
    }
    showReadout(panel, group.panels, panel.xScale.value(at));
    return undefined;
  });
  svg.addEventListener('pointerup', event => {
    const at = pixel(event);
    if (press !== null) {
      if (Math.abs(at - press) > CLICK) {
        const [low, high] = [press, at].sort((p, q) => p - q).map(panel.xScale.value);
        group.show(low, high);
      } else {
        active = true;
      }
      panel.band.setAttribute('width', 0);
    }
    release(event);
  });
  const release = event => {
    touches.delete(event.pointerId);
    if (!touches.size) pinned = null;
    press = null;
    panel.band.setAttribute('width', 0);
  };
  svg.addEventListener('pointercancel', event => {
    release(event);
    hideReadout();
  });
  svg.addEventListener('pointerleave', event => {
    active = false;
    if (event.pointerType !== 'touch') hideReadout(); // a tap's values stay
  });
  svg.addEventListener('dblclick', () => group.reset());
  svg.addEventListener('wheel', event => {
    if (!active && !event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    const turn = Math.max(-100, Math.min(100, event.deltaY * (event.deltaMode ? 30 : 1)));
    group.zoom(Math.exp(-turn / 300), panel.xScale.value(pixel(event)));
  }, {passive: false});
  box.tabIndex = 0;
  box.addEventListener('keydown', event => {
    const does = {
      '+': () => group.zoom(1.5), '=': () => group.zoom(1.5), '-': () => group.zoom(1 / 1.5),
      ArrowLeft: () => group.move(-0.2), ArrowRight: () => group.move(0.2),
      0: () => group.reset(), Escape: () => group.reset(),
    }[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does();
  });
}
