// Rows of bars over time: which foot stands, what was warned of, what touched, when it fell.

import { made } from "#dom";

const FEET = { l: "left foot", r: "right foot" };

function rowsOf(take) {
  const second = (frame) => frame / take.fps, rows = [];
  const { stance, warnings, report } = take;
  stance?.feet.forEach((foot, k) => rows.push({
    name: FEET[foot] ?? foot,
    bars: stance.schedule[k].map(([first, last]) => ({ from: second(first), to: second(last + 1), kind: `foot ${foot}`, said: "on the floor" })),
  }));
  if (warnings) {
    const bars = warnings.events.flatMap(({ pair, first, last, touch, lead }) => {
      const said = `${pair}: warned at ${second(first).toFixed(2)} s`;
      const warned = { from: second(first), to: second(last + 1), kind: "warned", said };
      const hit = { from: second(touch), to: second(last + 1), kind: "touch", said: `${said}, touches ${lead.toFixed(2)} s later` };
      return touch === null ? [warned] : [warned, hit];
    });
    const what = take.around ? "contact" : "self-contact"; // links meet bodies too
    rows.push({ name: bars.length ? what : `no ${what}`, bars });
  }
  if (Number.isFinite(report?.fall)) {
    rows.push({ name: "falls", bars: [{ from: report.fall, to: Infinity, kind: "touch", said: `falls at ${report.fall.toFixed(2)} s` }] });
  }
  for (const kind of new Set(take.marks?.map((mark) => mark.kind))) {
    const own = take.marks.filter((mark) => mark.kind === kind);
    rows.push({ name: kind, bars: own.map(({ from, to, said }) => ({ from, to: to + 1 / take.fps, kind: "marked", said })) });
  }
  return rows;
}

export class Timeline {
  constructor(player, takes) {
    this.player = player;
    this.holder = document.getElementById("timeline");
    this.head = Object.assign(document.createElement("div"), { className: "head" });
    this.track = Object.assign(document.createElement("div"), { className: "track" });
    this.takes = takes;
    this.draw();
    this.holder.append(this.track);
    this.#seeking();
    player.onchange(() => this.#update());
    this.#update();
  }

  /** After takes have changed. */
  draw() {
    this.track.replaceChildren();
    for (const take of this.takes) {
      if (this.takes.length > 1) this.track.append(made("div", { className: "row take" }, made("span", { textContent: take.name })));
      for (const row of rowsOf(take)) this.#row(row.name, row.bars);
    }
    this.track.append(this.head);
  }

  #row(name, bars) {
    const row = Object.assign(document.createElement("div"), { className: "row" });
    row.append(Object.assign(document.createElement("span"), { textContent: name }));
    const duration = Math.max(this.player.duration, 1e-9), line = document.createElement("div");
    for (const { from, to, kind, said } of bars) {
      const start = Math.min(Math.max(from / duration, 0), 1), end = Math.min(to / duration, 1);
      const bar = Object.assign(document.createElement("i"), { className: kind, title: said });
      Object.assign(bar.style, { left: `min(${100 * start}%, 100% - var(--thin))`, width: `${100 * (end - start)}%` });
      line.append(bar);
    }
    row.append(line);
    this.track.append(row);
  }

  #seeking() {
    const seek = (event) => {
      const line = this.track.querySelector(".row > div")?.getBoundingClientRect();
      if (line) this.player.seek(((event.clientX - line.left) / line.width) * this.player.duration);
    };
    this.track.addEventListener("pointerdown", (event) => {
      this.player.pause();
      this.track.setPointerCapture(event.pointerId);
      seek(event);
    });
    this.track.addEventListener("pointermove", (event) => event.buttons && seek(event));
  }

  #update() {
    this.head.style.setProperty("--share", this.player.time / Math.max(this.player.duration, 1e-9));
  }
}
