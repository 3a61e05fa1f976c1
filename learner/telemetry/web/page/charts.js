// Curves as SVG: a line over agent steps, with the tests' scores as dots where there are any.

const NS = "http://www.w3.org/2000/svg";

// A minus sign for the hyphen before a written number, but none before 0, as on the terminal's screen.
export const minus = number => number.replace(/^-(?=[0.]+$)/, "").replace(/^-/, "−");

export function written(value, form) {
  return value === null || value === undefined ? "–" : minus(digits(value, form));
}

// As learner/telemetry/formats.py writes a figure of that form elsewhere on the page.
function digits(value, form) {
  if (form === "count" || form === "plain") return value.toLocaleString("en");
  if (form === "ms") return value.toFixed(0);
  if (/^\.\d$/.test(form)) return decimal(value, +form[1]);
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 1e6) return value.toExponential(1).replace(/([+-])(\d)$/, "$10$2");
  return decimal(value, Math.max(3 - Math.floor(Math.log10(size)), 0));
}

function decimal(value, places) {
  return value.toLocaleString("en", {minimumFractionDigits: places, maximumFractionDigits: places});
}

function draw(parent, name, attributes, text) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

function shortened(steps) {
  if (steps >= 1e6) return `${+(steps / 1e6).toFixed(2)}M`;
  return steps >= 1e3 ? `${+(steps / 1e3).toFixed(1)}k` : String(steps);
}

// About three round numbers between two others, and how they are written.
function ticks(low, high) {
  const rough = (high - low) / 3, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(each => each * power).find(each => each >= rough);
  const maximumFractionDigits = Math.min(Math.max(0, -Math.floor(Math.log10(step))), 20);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) {
    found.push([i * step, minus((i * step).toLocaleString("en", {maximumFractionDigits}))]);
  }
  return found;
}

export class Chart {
  constructor(parent, about) {
    this.about = about;
    const card = document.createElement("div");
    card.className = "card chart";
    card.title = about.meaning;
    const head = document.createElement("h2"), name = document.createElement("span");
    name.textContent = about.unit ? `${about.label}, ${about.unit}` : about.label;
    this.now = document.createElement("b");
    head.append(name, this.now);
    this.svg = document.createElementNS(NS, "svg");
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("aria-label", about.meaning);
    card.append(head, this.svg);
    parent.append(card);
    this.svg.addEventListener("pointermove", event => { this.at = event.offsetX; this.redraw(); });
    this.svg.addEventListener("pointerleave", () => { this.at = null; this.redraw(); });
    new ResizeObserver(() => this.redraw()).observe(this.svg);
    this.line = [];
    this.dots = [];
  }

  // `line` and `dots` are pairs of agent steps and a value.
  set(line, dots = [], base = null) {
    this.line = line;
    this.dots = dots;
    this.base = base;
    this.redraw();
  }

  redraw() {
    const svg = this.svg, form = this.about.form;
    const width = svg.clientWidth, height = svg.clientHeight;
    if (!width || !height) return;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.replaceChildren();
    const all = [...this.line, ...this.dots];
    const last = this.line.at(-1) ?? this.dots.at(-1);
    this.now.textContent = last ? written(last[1], form) : "–";
    const begin = Math.min(...all.map(point => point[0])), end = Math.max(...all.map(point => point[0]), begin + 1);
    if (!this.dots.length && !all.some(point => point[0] > begin)) {
      draw(svg, "text", {x: width / 2, y: height / 2, "text-anchor": "middle"}, "no curve yet");
      return;
    }
    const known = all.map(point => point[1]).concat(this.base === null || this.base === undefined ? [] : [this.base]);
    let low = Math.min(...known), high = Math.max(...known);
    if (low === 0 && high === 0) high = 1;  // such as updates before there are any
    else if (low === high) { const room = Math.abs(low) * 0.05 || 1; low -= room; high += room; }
    const margin = (high - low) * 0.06;
    low -= margin; high += margin;
    const marks = ticks(low, high);
    const left = Math.max(42, ...marks.map(([, told]) => 8 + 6.5 * told.length)), right = width - 8, top = 6, bottom = height - 16;
    const x = steps => left + (steps - begin) / (end - begin) * (right - left);
    const y = value => bottom - (value - low) / (high - low) * (bottom - top);
    for (const [tick, told] of marks) {
      draw(svg, "line", {class: "tick", x1: left, x2: right, y1: y(tick), y2: y(tick)});
      draw(svg, "text", {x: left - 6, y: y(tick) + 3, "text-anchor": "end"}, told);
    }
    draw(svg, "text", {x: left, y: height - 3}, shortened(begin));
    draw(svg, "text", {x: right, y: height - 3, "text-anchor": "end"}, `${shortened(end)} steps`);
    if (this.base !== null && this.base !== undefined) {
      draw(svg, "line", {class: "base", x1: left, x2: right, y1: y(this.base), y2: y(this.base)});
      draw(svg, "text", {x: right, y: y(this.base) - 4, "text-anchor": "end"}, "random policy");
    }
    const path = this.line.map((point, i) => `${i ? "L" : "M"}${x(point[0]).toFixed(1)} ${y(point[1]).toFixed(1)}`);
    if (path.length) draw(svg, "path", {class: "line", d: path.join("")});
    for (const [steps, value, told] of this.dots) {
      const dot = draw(svg, "circle", {class: "dot", cx: x(steps), cy: y(value), r: 3.2});
      draw(dot, "title", {}, told);
    }
    if (this.at !== null && this.at !== undefined && this.line.length) {
      const near = this.line.reduce((a, b) => Math.abs(x(a[0]) - this.at) < Math.abs(x(b[0]) - this.at) ? a : b);
      draw(svg, "line", {class: "cross", x1: x(near[0]), x2: x(near[0]), y1: top, y2: bottom});
      this.now.textContent = `${written(near[1], form)} at ${shortened(near[0])}`;
    }
  }
}
