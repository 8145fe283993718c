// Curves under the scene; a line in each goes with the time, and a click in one goes to a time.

import { uPlot } from "#vendor";

const TEAL = "#0b7285", AMBER = "#e8890c", RED = "#c92a2a", GREY = "#9aa5b1", INK = "#1f2933";
const PALETTE = [TEAL, AMBER, "#7048a8", "#37a05c", "#c2255c"];
const READING = 150; // while it plays, values are written so often [ms]
const HEIGHT = 150, DEGREES = 180 / Math.PI;

const column = (array, k, scale = 1) => Array.from({ length: array.shape[0] }, (_, t) => {
  const value = array.values[t * array.width + k] * scale;
  return Number.isFinite(value) ? value : null;
});
const level = (value, frames) => Array(frames).fill(value);
const padded = (values, frames) => [...values, ...Array(Math.max(frames - values.length, 0)).fill(null)];
const line = (label, values, color, width = 1.6, dash) => ({ label, values, color, width, dash });
const limit = (label, value, frames) => line(label, level(value, frames), RED, 1, [5, 4]);

/** What can be drawn of a take, given the joint that was chosen. */
function drawn(take, joint) {
  const { frames, joints, stance, report, warnings, stress } = take, name = joints.names[joint], charts = [];
  const angle = column(joints.angles, joint, DEGREES), error = report?.error && padded(column(report.error, joint), frames);
  charts.push({
    title: `${name}: angle`, unit: "°",
    lines: [
      line("asked", angle, TEAL),
      ...(error ? [line("simulated", angle.map((a, t) => (error[t] === null ? null : a + error[t])), AMBER, 1.2)] : []),
      limit("lower", joints.lower[joint], frames), limit("upper", joints.upper[joint], frames),
    ],
  });
  const fastest = joints.fastest[joint];
  charts.push({
    title: `${name}: speed`, unit: "°/s",
    lines: [line("speed", column(joints.speeds, joint, DEGREES), TEAL), limit("−limit", -fastest, frames), limit("limit", fastest, frames)],
  });
  if (error) charts.push({ title: `${name}: tracking error`, unit: "°", lines: [line("error", error, AMBER)], zero: true });
  if (report?.torque) {
    const bound = report.bounds[joint], bounds = bound ? [limit("−limit", -bound, frames), limit("limit", bound, frames)] : [];
    charts.push({ title: `${name}: torque`, unit: "N m", lines: [line("torque", padded(column(report.torque, joint), frames), "#7048a8"), ...bounds] });
  }
  if (stance) {
    const lines = [line("centre of mass", column(stance.com_margin, 0), TEAL), line("zero moment point", column(stance.zmp_margin, 0), AMBER, 1.1)];
    charts.push({ title: "inside the support", unit: "cm", lines, zero: true, most: [-15, 15] });
  }
  if (warnings?.pairs.length) {
    const nearest = warnings.pairs.slice(0, PALETTE.length);
    const lines = nearest.map((pair, k) => line(pair, column(warnings.ahead, k, 100), PALETTE[k], 1.2));
    charts.push({ title: "interaction distance D of near pairs", unit: "cm", lines, zero: true, most: [-5, 30] });
  }
  if (stress) {
    const lines = stress.kinds.map((kind, k) => line(kind, column(stress.cost, k), PALETTE[k % PALETTE.length], 1.2));
    charts.push({ title: "stress by kind of edge", unit: "", lines });
  }
  return charts;
}

function options(chart, width, seek) {
  const axis = { stroke: INK, grid: { stroke: "#e4e7eb", width: 1 }, ticks: { show: false }, font: "11px system-ui", size: 34 };
  const range = (plot, low, high) => {
    const [least, most] = chart.most ?? [-Infinity, Infinity];
    const bottom = Math.max(chart.zero ? Math.min(low, 0) : low, least), top = Math.min(chart.zero ? Math.max(high, 0) : high, most);
    const pad = 0.06 * Math.max(top - bottom, 1e-6);
    return [bottom - pad, top + pad];
  };
  return {
    width, height: HEIGHT, legend: { live: true, markers: { width: 1 } },
    cursor: { drag: { x: false, y: false }, points: { show: false }, y: false, bind: { mousedown: (u) => () => seek(u.posToVal(u.cursor.left, "x")) } },
    scales: { x: { time: false }, y: { range } },
    axes: [{ ...axis, size: 26 }, { ...axis, size: 44 }],
    series: [
      { label: "s", value: (_, v) => (v === null ? "" : v.toFixed(2)) },
      ...chart.lines.map(({ label, color, width, dash }) => ({
        label, stroke: color, width, dash, points: { show: false }, value: (_, v) => (v === null ? "–" : `${v.toFixed(1)} ${chart.unit}`),
      })),
    ],
  };
}

export class Charts {
  constructor(player, takes) {
    Object.assign(this, { player, takes, take: 0, joint: busiest(takes[0]), plots: [] });
    this.holder = document.getElementById("charts");
    this.choice = Object.assign(document.createElement("div"), { className: "choice" });
    this.grid = Object.assign(document.createElement("div"), { className: "grid" });
    this.holder.append(this.choice, this.grid);
    this.#choices();
    this.#draw();
    new ResizeObserver(() => this.#fit()).observe(this.grid);
    player.onchange(() => this.#update());
  }

  #select(id, label, names, at, act) {
    const select = Object.assign(document.createElement("select"), { id, ariaLabel: label });
    select.append(...names.map((name, k) => Object.assign(document.createElement("option"), { value: k, textContent: name, selected: k === at })));
    select.addEventListener("change", () => act(Number(select.value)));
    this.choice.append(Object.assign(document.createElement("label"), { textContent: label }), select);
    return select;
  }

  #choices() {
    this.choice.replaceChildren();
    if (this.takes.length > 1) {
      this.#select("take", "take", this.takes.map((take) => take.title), this.take, (take) => {
        Object.assign(this, { take, joint: busiest(this.takes[take]) });
        this.#choices();
        this.#draw();
      });
    }
    this.joints = this.#select("joint", "joint", this.takes[this.take].joints.names, this.joint, (joint) => this.choose(this.take, joint));
  }

  /** After a take has changed. */
  replace(take, k) {
    this.takes[k] = take;
    this.#draw();
  }

  /** Show the curves of a joint. */
  choose(take, joint) {
    if (joint < 0) return;
    const other = take !== this.take;
    Object.assign(this, { take, joint });
    if (other) this.#choices();
    this.joints.value = joint;
    this.#draw();
  }

  #draw() {
    const take = this.takes[this.take], time = Array.from({ length: take.frames }, (_, t) => t / take.fps);
    this.plots.forEach(({ plot }) => plot.destroy());
    this.grid.replaceChildren();
    const seek = (to) => {
      this.player.pause();
      this.player.seek(to);
    };
    this.plots = drawn(take, this.joint).map((chart) => {
      const card = Object.assign(document.createElement("figure"), { className: "chart" });
      card.append(Object.assign(document.createElement("figcaption"), { textContent: `${chart.title}${chart.unit && ` [${chart.unit}]`}` }));
      this.grid.append(card);
      const plot = new uPlot(options(chart, card.clientWidth - 16, seek), [time, ...chart.lines.map(({ values }) => values)], card);
      const head = Object.assign(document.createElement("div"), { className: "head" });
      plot.over.append(head);
      return { plot, card, head };
    });
    this.#update();
  }

  #fit() {
    for (const { plot, card } of this.plots) plot.setSize({ width: Math.max(card.clientWidth - 16, 120), height: HEIGHT });
    this.#update();
  }

  #update() {
    const { fps, frames } = this.takes[this.take], idx = Math.min(Math.round(this.player.time * fps), frames - 1);
    const now = performance.now(), readable = !this.player.playing || now - (this.read ?? 0) > READING;
    if (readable) this.read = now;
    for (const { plot, head } of this.plots) {
      head.style.transform = `translateX(${plot.valToPos(Math.min(this.player.time, (frames - 1) / fps), "x")}px)`;
      if (readable && plot.cursor.idx == null) plot.setLegend({ idx }, false);
    }
  }
}

/** The joint that moves most: what a person wants to see first. */
function busiest({ joints }) {
  const spread = joints.names.map((_, k) => {
    const values = column(joints.angles, k);
    return Math.max(...values) - Math.min(...values);
  });
  return spread.indexOf(Math.max(...spread));
}
