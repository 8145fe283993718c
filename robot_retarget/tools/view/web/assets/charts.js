// Curves under the scene; a line in each goes with the time, and a click in one goes to a time.

import { colour, themed } from "#theme";
import { uPlot } from "#vendor";

const READING = 150; // while it plays, values are written so often [ms]
const HEIGHT = 150, DEGREES = 180 / Math.PI;
const HUES = ["teal", "amber", "plum", "green", "rose"];
/** Colour of the k-th take, pair or kind. */
export const hue = (k) => colour(HUES[k % HUES.length]);

/** Times of all charts: of the quickest take, to the end of the longest. */
function clockOf(takes) {
  const fps = Math.max(...takes.map((take) => take.fps)), duration = Math.max(...takes.map((take) => (take.frames - 1) / take.fps));
  return Array.from({ length: Math.round(duration * fps) + 1 }, (_, k) => k / fps);
}

/** Column k of an array of a take at times, straight between its frames; null where there is no value. */
function column(array, k, fps, clock, scale = 1) {
  const value = (t) => array.values[t * array.width + k] * scale;
  return clock.map((time) => {
    const at = time * fps, left = Math.floor(at + 1e-6), share = Math.max(at - left, 0), last = array.shape[0] - 1;
    if (at > last + 1e-6) return null;
    const found = share < 1e-5 ? value(left) : value(left) * (1 - share) + value(Math.min(left + 1, last)) * share;
    return Number.isFinite(found) ? found : null;
  });
}

const line = (label, values, color, width = 1.6, dash) => ({ label, values, color, width, dash });
const limit = (label, value, clock) => line(label, clock.map(() => value), colour("red"), 1, [5, 4]);

/** What is known of one joint of a take: titles, units, and lines under the name of the take, if there are several. */
function jointCharts({ take, joint, clock, color, label }) {
  const { joints, report, fps } = take, name = joints.names[joint], of = (array, scale) => array && column(array, joint, fps, clock, scale);
  const planned = of(joints.angles, DEGREES), speed = of(joints.speeds, DEGREES), error = of(report?.error), torque = of(report?.torque);
  const chart = (what, unit, own, values, more) => values && { title: `${name}: ${what}`, unit, lines: [line(label ?? own, values, color)], ...more };
  const charts = [
    chart("angle", "°", "planned", planned), chart("speed", "°/s", "speed", speed),
    chart("tracking error", "°", "error", error, { zero: true }), chart("torque", "N m", "torque", torque),
  ];
  if (error) charts[0].lines.push(simulatedLine(planned.map((angle, t) => (error[t] === null ? null : angle + error[t])), color, label));
  return charts.filter(Boolean);
}

/** The simulated angle: amber beside one take, thin dashes in its colour among several. */
function simulatedLine(values, color, label) {
  return label ? line(`${label}, simulated`, values, color, 1, [2, 2]) : line("simulated", values, colour("amber"), 1.2);
}

/** Limits of a joint, by the title of the chart that has them. */
function limitsOf(take, joint, clock) {
  const { joints, report } = take, name = joints.names[joint], bound = report?.bounds[joint], fastest = joints.fastest[joint];
  const around = (most) => [limit("−limit", -most, clock), limit("limit", most, clock)];
  return {
    [`${name}: angle`]: [limit("lower", joints.lower[joint], clock), limit("upper", joints.upper[joint], clock)],
    [`${name}: speed`]: around(fastest),
    ...(bound ? { [`${name}: torque`]: around(bound) } : {}),
  };
}

/** How far the centre of mass and, of one take alone, the zero moment point stay inside the support. */
function balanceCharts({ take, clock, color, label }) {
  const { stance, fps } = take;
  if (!stance) return [];
  const com = line(label ?? "centre of mass", column(stance.com_margin, 0, fps, clock), color);
  const zmp = label ? [] : [line("zero moment point", column(stance.zmp_margin, 0, fps, clock), colour("amber"), 1.1)];
  return [{ title: label ? "centre of mass inside the support" : "inside the support", unit: "cm", lines: [com, ...zmp], zero: true, most: [-15, 15] }];
}

/** What only one take has: its near pairs, and its stress. */
function ownCharts({ warnings, stress, fps }, clock) {
  const charts = [];
  if (warnings?.pairs.length) {
    const lines = warnings.pairs.slice(0, HUES.length).map((pair, k) => line(pair, column(warnings.ahead, k, fps, clock, 100), hue(k), 1.2));
    charts.push({ title: "interaction distance D of near pairs", unit: "cm", lines, zero: true, most: [-5, 30] });
  }
  if (stress) {
    const lines = stress.kinds.map((kind, k) => line(kind, column(stress.cost, k, fps, clock), hue(k), 1.2));
    charts.push({ title: "stress by kind of edge", unit: "", lines });
  }
  return charts;
}

/** What can be drawn of a take, given the joint that was chosen; other takes with such a joint lie over it. */
function drawn(takes, chosen, joint, clock) {
  const name = takes[chosen].joints.names[joint], several = takes.length > 1;
  const found = takes.flatMap((take, k) => {
    const own = take.joints.names.indexOf(name), given = { take, clock, color: hue(k), label: several ? take.name : undefined };
    return [...(own < 0 ? [] : jointCharts({ ...given, joint: own })), ...balanceCharts(given)];
  });
  const charts = [];
  for (const chart of found) {
    const same = charts.find(({ title }) => title === chart.title);
    if (same) same.lines.push(...chart.lines);
    else charts.push(chart);
  }
  const limits = limitsOf(takes[chosen], joint, clock);
  charts.forEach((chart) => chart.lines.push(...(limits[chart.title] ?? [])));
  return [...charts, ...ownCharts(takes[chosen], clock)];
}

function options(chart, width, seek) {
  const axis = { stroke: colour("ink"), grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, font: "11px system-ui", size: 34 };
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
    Object.assign(this, { player, takes, plots: [], clock: [0] });
    this.holder = document.getElementById("charts");
    this.choice = Object.assign(document.createElement("div"), { className: "choice" });
    this.grid = Object.assign(document.createElement("div"), { className: "grid" });
    this.holder.append(this.choice, this.grid);
    this.reset();
    themed(() => this.draw());
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
        this.draw();
      });
    }
    this.joints = this.#select("joint", "joint", this.takes[this.take].joints.names, this.joint, (joint) => this.choose(this.take, joint));
  }

  /** After other takes have come: the joint that moves most of the first. */
  reset() {
    Object.assign(this, { take: 0, joint: this.takes.length ? busiest(this.takes[0]) : -1 });
    this.choice.replaceChildren();
    if (this.takes.length) this.#choices();
    this.draw();
  }

  /** Show the curves of a joint. */
  choose(take, joint) {
    if (joint < 0) return;
    const other = take !== this.take;
    Object.assign(this, { take, joint });
    if (other) this.#choices();
    this.joints.value = joint;
    this.draw();
  }

  /** After a take has changed. */
  draw() {
    this.plots.forEach(({ plot }) => plot.destroy());
    this.plots = [];
    this.grid.replaceChildren();
    if (!this.takes.length || !this.holder.offsetWidth) return;
    const time = (this.clock = clockOf(this.takes));
    const seek = (to) => {
      this.player.pause();
      this.player.seek(to);
    };
    this.plots = drawn(this.takes, this.take, this.joint, time).map((chart) => {
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
    if (!this.plots.length) return this.draw(); // what was hidden is not drawn
    for (const { plot, card } of this.plots) plot.setSize({ width: Math.max(card.clientWidth - 16, 120), height: HEIGHT });
    this.#update();
  }

  #update() {
    const { time, fps } = this.player, last = this.clock.length - 1, idx = Math.min(Math.round(time * fps), last);
    const now = performance.now(), readable = !this.player.playing || now - (this.read ?? 0) > READING;
    if (readable) this.read = now;
    for (const { plot, head } of this.plots) {
      head.style.transform = `translateX(${plot.valToPos(Math.min(time, this.clock[last]), "x")}px)`;
      if (readable && plot.cursor.idx == null) plot.setLegend({ idx }, false);
    }
  }
}

/** The joint that moves most: what a person wants to see first. */
function busiest(take) {
  const { joints, fps } = take, clock = clockOf([take]);
  const spread = joints.names.map((_, k) => {
    const values = column(joints.angles, k, fps, clock);
    return Math.max(...values) - Math.min(...values);
  });
  return spread.indexOf(Math.max(...spread));
}
