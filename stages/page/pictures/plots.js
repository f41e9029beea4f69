"use strict";
// Zoom, pan, cursor and legend of the plots. The samples are read back from the paths (see plots.py for the layout).
const X_STEPS = 30000, PANEL_STEPS = 8000, MARGIN = 0.06;
const plots = [];

function decode(path) {
  if (path.samples) return path.samples;
  const xs = [], ys = [];
  const top = +path.dataset.top, step = +path.dataset.step;
  for (const run of path.getAttribute("d").split("M").slice(1)) {
    const [start, rest] = run.split("l");
    let [x, y] = start.split(" ").map(Number);
    xs.push(x); ys.push(top - step * y);
    const moves = (rest.match(/-?\d+/g) || []).map(Number);
    for (let i = 0; i + 1 < moves.length; i += 2) {
      x += moves[i]; y += moves[i + 1];
      xs.push(x); ys.push(top - step * y);
    }
    xs.push(x); ys.push(NaN);
  }
  return (path.samples = {xs, ys});
}

function firstNotBelow(xs, x) {
  let low = 0, high = xs.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (xs[middle] < x) low = middle + 1; else high = middle;
  }
  return low;
}

function roundTicks(low, high, wanted, sign = 1) {
  const span = high - low, power = 10 ** Math.floor(Math.log10(span / wanted));
  const step = [1, 2, 2.5, 5, 10].map(m => m * power).find(s => span / s <= wanted) || 10 * power;
  let digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  if (Math.abs(step / power - 2.5) < 1e-9) digits += 1;
  const ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high; k += 1) ticks.push({value: k * step, label: signed(k ? (sign * k * step).toFixed(Math.min(digits, 9)) : "0")});
  return ticks;
}

const signed = words => words.replace("-", "−");
const figure = value => signed(Number.isFinite(value) ? String(+value.toPrecision(4)) : "–");

function makeTicks(box, ticks, side, share) {
  box.replaceChildren(...ticks.map(tick => {
    const span = document.createElement("span");
    span.textContent = tick.label;
    span.style[side] = `${100 * share(tick.value)}%`;
    return span;
  }));
}

class Plot {
  constructor(element) {
    this.element = element;
    this.group = element.dataset.group;
    this.low = +element.dataset.low;
    this.high = +element.dataset.high;
    this.view = [this.low, this.high];
    this.cursorAt = null;
    this.frame = element.querySelector(".frame");
    this.panels = [...element.querySelectorAll(".panel")].map(panel => ({
      area: panel.querySelector(".area"), svg: panel.querySelector(".area svg"), grid: panel.querySelector(".grid"), y: panel.querySelector(".y"),
      output: panel.querySelector("output"), cut: panel.dataset.cut, sign: +(panel.dataset.sign || 1), low: +panel.dataset.low, high: +panel.dataset.high, lines: [...panel.querySelectorAll("path.line")],
    }));
    this.legend = [...element.querySelectorAll(".legend [data-entry]")];
    for (const button of this.legend) button.addEventListener("click", () => this.toggle(button, button.getAttribute("aria-pressed") !== "true"));
    const all = element.querySelector(".all");
    if (all) all.addEventListener("click", () => { for (const button of this.legend) this.toggle(button, true, false); all.remove(); this.draw(); });
    this.resetButton = element.querySelector(".reset");
    this.resetButton.addEventListener("click", () => this.reset());
    for (const panel of this.panels) this.watchPointer(panel.area);
    this.frame.addEventListener("keydown", event => this.press(event));
    this.frame.addEventListener("blur", () => share(this, plot => plot.moveCursor(null)));
  }

  toggle(button, shown, draw = true) {
    button.setAttribute("aria-pressed", shown);
    for (const panel of this.panels)
      for (const line of panel.lines) if (line.dataset.entry === button.dataset.entry) line.classList.toggle("off", !shown);
    if (draw) this.draw();
  }

  steps(x) { return (x - this.low) / (this.high - this.low) * X_STEPS; }
  value(event, area) {
    const box = area.getBoundingClientRect();
    return this.view[0] + Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) * (this.view[1] - this.view[0]);
  }

  zoom(low, high) { share(this, plot => { if (plot === this || (low < plot.high && high > plot.low)) plot.show(low, high); }); }

  reset() { share(this, plot => plot.show(plot.low, plot.high)); }

  show(low, high) {
    const least = (this.high - this.low) / 5000;
    let width = Math.min(Math.max(high - low, least), this.high - this.low);
    low = Math.min(Math.max(low, this.low), this.high - width);
    this.view = [low, low + width];
    this.resetButton.hidden = width >= (this.high - this.low) * 0.9999;
    this.draw();
  }

  draw() {
    const [low, high] = this.view, from = this.steps(low), width = this.steps(high) - from;
    const xTicks = roundTicks(low, high, this.frame.clientWidth < 500 ? 4 : 7);
    makeTicks(this.element.querySelector(".x"), xTicks, "left", value => (value - low) / (high - low));
    for (const panel of this.panels) {
      const [bottom, top] = this.yRange(panel, from, from + width);
      const perUnit = PANEL_STEPS / (panel.high - panel.low), start = (panel.high - top) * perUnit, height = (top - bottom) * perUnit;
      panel.svg.setAttribute("viewBox", `${from} ${start} ${width} ${height}`);
      const yTicks = roundTicks(bottom, top, 4, panel.sign);
      makeTicks(panel.y, yTicks, "top", value => (top - value) / (top - bottom));
      panel.grid.setAttribute("d", yTicks.map(t => `M${from} ${(panel.high - t.value) * perUnit}h${width}`).join("") +
        xTicks.map(t => `M${this.steps(t.value)} ${start}v${height}`).join(""));
    }
    this.moveCursor(this.cursorAt);
  }

  yRange(panel, from, to) {
    let low = Infinity, high = -Infinity;
    for (const line of panel.lines) {
      if (line.classList.contains("off")) continue;
      const {xs, ys} = decode(line);
      const last = Math.min(xs.length, firstNotBelow(xs, to) + 1);
      for (let i = Math.max(0, firstNotBelow(xs, from) - 1); i < last; i += 1) {
        if (ys[i] < low) low = ys[i];
        if (ys[i] > high) high = ys[i];
      }
    }
    if (!(low <= high)) return [panel.low, panel.high];
    if (panel.cut && low < panel.high && high > panel.low) [low, high] = [Math.max(low, panel.low), Math.min(high, panel.high)];
    const room = high > low ? MARGIN * (high - low) : Math.max(Math.abs(high) * 0.1, 1e-3);
    return [low - room, high + room];
  }

  moveCursor(x) {
    this.cursorAt = x;
    const inside = x !== null && x >= this.view[0] && x <= this.view[1];
    this.panels.forEach((panel, index) => {
      if (!inside) { panel.cursor?.remove(); panel.cursor = null; panel.output.replaceChildren(); return; }
      if (!panel.cursor) { panel.cursor = document.createElement("div"); panel.cursor.className = "cursor"; panel.area.append(panel.cursor); }
      panel.cursor.style.left = `${100 * (x - this.view[0]) / (this.view[1] - this.view[0])}%`;
      const words = index ? [] : [`at ${figure(x)}   `];
      for (const line of panel.lines) {
        if (line.classList.contains("off")) continue;
        const value = this.nearest(line, this.steps(x)), mark = document.createElement("b");
        mark.textContent = figure(panel.sign * value);
        mark.style.setProperty("--c", line.style.getPropertyValue("--c"));
        words.push(mark, " ");
      }
      panel.output.replaceChildren(...words);
    });
  }

  nearest(line, at) {
    const {xs, ys} = decode(line), next = firstNotBelow(xs, at);
    const pick = next > 0 && (next >= xs.length || at - xs[next - 1] < xs[next] - at) ? next - 1 : next;
    return Math.abs(xs[pick] - at) > X_STEPS / 50 ? NaN : Number.isNaN(ys[pick]) ? ys[pick - 1] : ys[pick];
  }

  watchPointer(area) {
    let start = null, brush = null;
    area.addEventListener("pointermove", event => {
      const x = this.value(event, area);
      share(this, plot => plot.moveCursor(x));
      if (start === null) return;
      if (!brush) { brush = document.createElement("div"); brush.className = "brush"; area.append(brush); }
      const place = v => 100 * (v - this.view[0]) / (this.view[1] - this.view[0]);
      brush.style.left = `${place(Math.min(start, x))}%`;
      brush.style.width = `${Math.abs(place(x) - place(start))}%`;
    });
    area.addEventListener("pointerdown", event => { if (event.button === 0 && event.pointerType !== "touch") { start = this.value(event, area); area.setPointerCapture(event.pointerId); this.frame.focus({preventScroll: true}); } });
    const finish = event => {
      if (start === null) return;
      const end = this.value(event, area), from = start;
      start = null; brush?.remove(); brush = null;
      if (event.type === "pointerup" && Math.abs(end - from) > (this.view[1] - this.view[0]) * 0.01) this.zoom(Math.min(from, end), Math.max(from, end));
    };
    area.addEventListener("pointerup", finish);
    area.addEventListener("pointercancel", finish);
    area.addEventListener("pointerleave", () => { if (start === null) share(this, plot => plot.moveCursor(null)); });
    area.addEventListener("dblclick", () => this.reset());
    area.addEventListener("wheel", event => {  // an unfocused plot lets the page scroll
      if (document.activeElement !== this.frame && !event.ctrlKey) return;
      event.preventDefault();
      this.scale(event.deltaY > 0 ? 1.25 : 0.8, this.value(event, area));
    }, {passive: false});
  }

  scale(factor, about) { this.zoom(about + (this.view[0] - about) * factor, about + (this.view[1] - about) * factor); }

  press(event) {
    const [low, high] = this.view, width = high - low, direction = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    const about = this.cursorAt ?? (low + high) / 2;
    if (direction && event.shiftKey) this.zoom(low + direction * width / 5, high + direction * width / 5);
    else if (direction) { const x = Math.min(high, Math.max(low, about + direction * width / 100)); share(this, plot => plot.moveCursor(x)); }
    else if (event.key === "+" || event.key === "=") this.scale(0.8, about);
    else if (event.key === "-") this.scale(1.25, about);
    else if (event.key === "Escape" || event.key === "0") this.reset();
    else return;
    event.preventDefault();
  }
}

// Plots of one group share their time axis.
function share(source, act) {
  for (const plot of plots) if (plot === source || (source.group && plot.group === source.group)) act(plot);
}

for (const element of document.querySelectorAll("figure.plot")) plots.push(new Plot(element));
