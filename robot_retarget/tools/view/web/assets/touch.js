// Touch-up: pick a keypoint and drag it, or pick two and say how far apart; the server solves the frames around it again.

import { Vector3 } from "#vendor";
import { decoded } from "#data";
import { made } from "#dom";
import { KeypointDrag } from "#drag";
import { about, post } from "#server";
import { Sticks } from "#sticks";
import { inCm, worded } from "#words";

const FIRM = 1e4; // priority of an edge to where a keypoint was dropped: met to a millimetre wherever the joints reach [-]
const HALF = 0.25; // an edge lasts this long before and after the moment [s]
const PATIENCE = 800; // after a touch-up, its self-contacts are looked for in the background [ms]
const RELATIONS = { touch: "touch", is: "exactly", least: "at least", most: "at most" };

export class Touch {
  constructor({ stage, player, panel, casts, replaced }) {
    Object.assign(this, { stage, player, panel, casts, replaced, on: false, picks: [] });
    this.#form(document.getElementById("touch"));
    this.button = made("button", { id: "touch-up", textContent: "touch up", title: "mend what you see (T)" });
    this.button.addEventListener("click", () => this.toggle());
    document.getElementById("follow").after(this.button);
    document.addEventListener("keydown", (event) => this.#key(event));
    const moved = (k, place) => this.pick([this.keypoints.names[k], place]), dropped = (k, place) => this.#dropped(k, place);
    this.drag = new KeypointDrag({ stage, player, casts, active: () => this.on, moved, dropped });
    player.onchange(() => this.on && this.#mark());
  }

  #form(holder) {
    this.form = holder;
    this.made = null; // the ends of the latest edit, while no others are picked
    this.latest = null; // the latest edit, and its project
    this.ends = made("b", { textContent: "nothing picked" });
    this.relation = made("select", { id: "relation", ariaLabel: "how the two are to be" }, ...Object.entries(RELATIONS).map(([value, text]) => made("option", { value, textContent: text })));
    const number = (id, step, ariaLabel) => made("input", { type: "number", id, step, min: 0, ariaLabel });
    Object.assign(this, { far: number("far", 0.5, "distance [cm]"), from: number("from", 0.05, "from [s]"), to: number("to", 0.05, "to [s]") });
    this.far.value = 5;
    this.hard = made("input", { type: "checkbox", id: "hard" });
    const act = (id, textContent, does) => {
      const button = made("button", { id, textContent });
      button.addEventListener("click", does);
      return button;
    };
    this.apply = act("apply", "solve", () => this.make());
    this.undo = act("undo", "undo", () => this.send("undo"));
    this.redo = act("redo", "redo", () => this.send("redo"));
    this.keep = act("keep", "save", () => this.save());
    this.judge = act("judge", "judge", () => this.send("judge"));
    this.judge.title = "simulate what is shown, and pass a new verdict";
    this.said = made("output", { textContent: "Drag a keypoint, or click two of them and say how far apart they are to be." });
    holder.append(this.ends, this.relation, this.far, "cm, from", this.from, "to", this.to, "s", made("label", {}, this.hard, " hold"),
      this.apply, this.undo, this.redo, this.judge, this.keep, this.said);
    this.relation.addEventListener("change", () => this.#offer());
    this.#offer();
  }

  #offer() {
    this.far.disabled = this.relation.value === "touch" || this.#place() !== null;
    this.relation.disabled = this.#place() !== null;
    this.apply.disabled = this.picks.length < 2;
    this.apply.textContent = this.made === this.picks ? "solve again" : "solve";
  }

  #place() {
    return this.picks.find((pick) => typeof pick !== "string") ?? null;
  }

  toggle() {
    if (!this.on && !this.casts[0]?.take.keypoints) return;
    this.on = !this.on;
    this.form.hidden = !this.on;
    this.button.classList.toggle("on", this.on);
    if (this.on !== this.panel.shown.keypoints && (this.on || this.lit)) this.panel.toggle("keypoints");
    this.lit = this.on; // what it switched on it switches off
    if (!this.on) this.pick([]);
  }

  /** Choose the ends of an edge: names of keypoints, or a place as a Vector3. */
  pick(picks) {
    this.picks = picks;
    const names = picks.map((pick) => (typeof pick === "string" ? worded(pick) : "where you dragged it"));
    this.ends.textContent = names.length ? names.join(" – ") : "nothing picked";
    const { time, duration } = this.player, hundredths = (value) => Math.round(value * 100) / 100;
    this.from.value = hundredths(Math.max(time - HALF, 0));
    this.to.value = hundredths(Math.min(time + HALF, duration));
    this.#offer();
    this.#mark();
  }

  get keypoints() {
    return this.drag.keypoints;
  }

  /** Where the k-th keypoint is now [m]. */
  at(k) {
    return this.drag.at(k);
  }

  /** The line and the balls of what is picked, as large as the robot wants them. */
  #sticks() {
    this.marks?.removeFromParent();
    const height = (this.sized = this.stage.height), looks = { color: 0xd6293e, onTop: true, opacity: 0.9 };
    this.marks = new Sticks([[0, 1]], [0.004 * height], [[0, 0.022 * height], [1, 0.022 * height]], looks);
    this.stage.scene.add(this.marks);
  }

  #mark() {
    if (this.sized !== this.stage.height) this.#sticks();
    const places = this.picks.map((pick) => (typeof pick === "string" ? this.at(this.keypoints.names.indexOf(pick)) : pick.clone().add(this.casts[0].position)));
    this.marks.visible = places.length > 0;
    const [a, b = new Vector3(NaN, NaN, NaN)] = places;
    if (a) this.marks.place([...a, ...b]);
    this.stage.draw();
  }

  #dropped(k, place) {
    if (place) return this.make();
    const name = this.keypoints.names[k], names = this.picks.filter((pick) => typeof pick === "string" && pick !== name);
    this.pick([...names.slice(-1), name]);
  }

  /** The edge of the form, as EDITS.toml has it. */
  edge() {
    const cm = Number(this.far.value) / 100, kind = this.#place() ? "touch" : this.relation.value, { fps, frames } = this.casts[0].take;
    const at = { touch: 0, is: cm, least: [cm, "inf"], most: [0, cm] }[kind];
    const [a, b] = this.picks.map((pick) => (typeof pick === "string" ? pick : [...pick].map((value) => Math.round(value * 1e4) / 1e4)));
    const span = [this.from.value, this.to.value].map((time) => Math.min(Math.round(Number(time) * fps), frames - 1));
    const strength = this.hard.checked ? { hard: true } : this.#place() ? { priority: FIRM } : {};
    return { a, b, at, frames: span, ...strength };
  }

  async make() {
    if (this.picks.length < 2) return;
    const { picks } = this, edge = this.edge(), instead = this.made === picks || this.#again(edge);
    if (await this.send("edit", { ...edge, instead })) Object.assign(this, { made: picks, latest: { ...edge, project: about.get("project") } });
    this.#offer();
  }

  /** Whether an edge drags the keypoint of the latest edit once more, at times of that edit. */
  #again({ a, b, frames: [from, to] }) {
    const { latest } = this;
    if (!latest || latest.project !== about.get("project")) return false;
    return latest.a === a && [latest.b, b].every(Array.isArray) && from <= latest.frames[1] && latest.frames[0] <= to;
  }

  #say(text, bad = false) {
    this.said.textContent = text;
    this.said.classList.toggle("bad", bad);
  }

  async send(what, content) {
    clearTimeout(this.later);
    this.form.classList.add("busy");
    this.#say(what === "judge" ? "simulating …" : "solving …");
    const began = performance.now();
    try {
      const answer = await post(what, content);
      this.#shown(await decoded(answer.body));
      this.#report(what, (performance.now() - began) / 1000);
      if (what !== "judge") this.later = setTimeout(() => this.#check(), PATIENCE);
      if (what === "undo" || what === "redo") this.made = this.latest = null;
      return true;
    } catch (error) {
      this.#say(error.message, true);
      return false;
    } finally {
      this.form.classList.remove("busy");
      this.#offer();
    }
  }

  #shown({ takes: [take], touch }) {
    this.state = touch;
    this.panel.shown.before = Boolean(take.before);
    this.replaced(0, take);
    this.undo.disabled = !touch.edits;
    this.redo.disabled = !touch.undone;
    this.#mark();
  }

  #report(what, seconds) {
    const { edits, seconds: solving } = this.state, reached = this.#reached(), count = `${edits} edit${edits === 1 ? "" : "s"}`;
    if (what === "judge") return this.#say(`${count} · ${this.casts[0].take.report.badge.text}, judged in ${seconds.toFixed(1)} s`);
    this.#say(what === "edit" ? `solved in ${solving.toFixed(2)} s, shown after ${seconds.toFixed(2)} s; before in blue · ${count}${reached ? ` · ${reached}` : ""}` : count);
  }

  /** What the latest edit has reached; of a drag, how far the keypoint is from where it was dropped, and why. */
  #reached() {
    const place = this.#place(), reached = this.state.reached.replaceAll("`", "");
    if (!place || !reached) return reached;
    const [name] = this.picks, away = this.at(this.keypoints.names.indexOf(name)).sub(this.casts[0].position).distanceTo(place);
    const why = reached.split("; ").slice(2).map((said) => (said.startsWith("hard edge") ? said.slice(said.lastIndexOf(": ") + 2) : said));
    return [...new Set([`${worded(name)} ${inCm(away)} from where you dropped it`, ...why])].join("; ");
  }

  async #check() {
    try {
      this.#shown(await decoded((await post("check")).body));
    } catch (error) {
      this.#say(error.message, true);
    }
  }

  async save() {
    try {
      const { files } = await (await post("save")).json();
      this.#say(`wrote ${files.join(" and ")}`);
    } catch (error) {
      this.#say(error.message, true);
    }
  }

  #key(event) {
    if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range") return;
    const key = event.key.toLowerCase(), control = event.ctrlKey || event.metaKey;
    if (control && key === "z") this.send(event.shiftKey ? "redo" : "undo");
    else if (control && key === "y") this.send("redo");
    else if (!control && key === "t") this.toggle();
    else return;
    event.preventDefault();
  }
}
