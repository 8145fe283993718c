// Keyframes: sliders and dragged keypoints make poses, poses with times make the motion. The page holds them; the server keeps nothing but the file.

import { decoded } from "#data";
import { made } from "#dom";
import { KeypointDrag } from "#drag";
import { post } from "#server";

const DEGREE = Math.PI / 180;

export class Keyframes {
  constructor({ stage, player, panel, casts, charts, mount, holder = document.getElementById("keyframes") }) {
    Object.assign(this, { player, casts, charts, mount, holder, at: 0, rows: null, past: [], wanted: null, busy: false });
    this.#form();
    if (!panel.shown.keypoints) panel.toggle("keypoints");
    const active = () => Boolean(this.rows) && !this.player.playing, name = (k) => casts[0].take.keypoints.names[k];
    const dropped = (k, place) => place && this.#change(() => {}, ["pose", { at: this.at, keypoint: name(k), place: [...place] }]);
    this.drag = new KeypointDrag({ stage, player, casts, active, moved: (k) => this.#say(`${name(k)} goes where you drop it`), dropped });
    this.#ask(["keyframes"]);
  }

  #form() {
    const act = (id, text, does, title = "") => {
      const button = made("button", { id: `key-${id}`, textContent: text, title });
      button.addEventListener("click", does);
      return button;
    };
    const time = (key, title) => {
      const input = (this[key] = made("input", { type: "number", id: `key-${key}`, min: 0, max: 3600, step: 0.1, title }));
      input.addEventListener("change", () => this.#change((row) => (row[key] = Math.max(Number(input.value) || 0, 0))));
      return made("label", {}, `${key} `, input);
    };
    this.list = made("div", { id: "poses" });
    this.said = made("output", { textContent: "" });
    this.sliders = this.casts[0].take.joints.names.map((name, j) => this.#slider(name, j));
    this.holder.append(
      this.list,
      made("div", {}, act("add", "add", () => this.#add(), "a copy of this pose, a second later"), act("remove", "remove", () => this.#remove()), act("undo", "undo", () => this.#undo())),
      made("div", {}, time("seconds", "from the pose before [s]"), time("pause", "for which the pose is held [s]")),
      made("div", {}, act("judge", "judge", () => this.#ask(["judge"]), "simulate the motion, and pass a verdict"), act("save", "save", () => this.#ask(["save"]))),
      this.said,
      made("div", { id: "sliders" }, ...this.sliders.map(({ label }) => label)),
    );
  }

  #slider(name, j) {
    const { lower, upper } = this.casts[0].take.joints;
    const input = made("input", { type: "range", id: `joint-${name}`, min: lower[j], max: upper[j], step: 0.1 }), value = made("span");
    input.addEventListener("input", () => {
      if (!this.held) this.past.push(structuredClone(this.rows)); // one step back for a whole way of the slider
      this.held = true;
      this.rows[this.at].angles[j] = Number(input.value) * DEGREE;
      this.#ask(["pose", { at: this.at }]);
    });
    input.addEventListener("change", () => {
      this.held = false;
      this.charts.choose(0, j);
      this.#ask(["keyframes"]);
    });
    return { input, value, label: made("label", {}, made("span", { textContent: name }), input, value) };
  }

  /** Change the row of the chosen pose, or all, and ask for what follows from it. */
  #change(does, question = ["keyframes"]) {
    this.past.push(structuredClone(this.rows));
    does(this.rows[this.at]);
    this.#ask(question);
  }

  #add() {
    this.#change((row) => this.rows.splice(++this.at, 0, { angles: [...row.angles], seconds: 1, pause: 0, step: null }));
  }

  #remove() {
    if (this.rows.length > 1) this.#change(() => this.rows.splice(this.at, 1));
  }

  #undo() {
    if (!this.past.length) return;
    this.rows = this.past.pop();
    this.#ask(["keyframes"]);
  }

  /** Show a pose: the robot goes to its time. */
  choose(k) {
    this.at = Math.min(k, this.rows.length - 1);
    this.player.pause();
    this.player.seek(this.times[this.at]);
    this.#update();
  }

  #update() {
    const row = this.rows[this.at];
    this.list.replaceChildren(...this.rows.map((_, k) => {
      const button = made("button", { textContent: `${k + 1} · ${this.times[k].toFixed(2)} s`, className: k === this.at ? "on" : "" });
      button.addEventListener("click", () => this.choose(k));
      return button;
    }));
    for (const key of ["seconds", "pause"]) this[key].value = Math.round(row[key] * 1000) / 1000;
    this.seconds.disabled = this.at === 0;
    this.sliders.forEach(({ input, value }, j) => {
      input.value = row.angles[j] / DEGREE;
      value.textContent = `${(row.angles[j] / DEGREE).toFixed(1)}°`;
    });
  }

  #say(text, bad = false) {
    this.said.textContent = text;
    this.said.classList.toggle("bad", bad);
  }

  /** Ask the server; while it answers, only the latest of further questions waits. */
  async #ask(question) {
    this.wanted = question;
    if (this.busy) return;
    this.busy = true;
    while (this.wanted) {
      const [what, more] = this.wanted;
      this.wanted = null;
      if (what === "judge") this.#say("simulating …");
      try {
        const answer = await post(what, { rows: this.rows, ...more });
        if (what === "pose") this.#posed(await answer.json(), more.keypoint);
        else if (!this.wanted) this.#shown(what, await decoded(answer.body));
      } catch (error) {
        this.#say(error.message, true);
      }
    }
    this.busy = false;
  }

  /** A single pose, in the frames at its time. */
  #posed({ angles, robot, points, reached }, keypoint) {
    const { poses, keypoints } = this.casts[0].take, at = this.casts[0].at;
    for (const t of [Math.floor(at), Math.ceil(at)]) {
      poses.values.set(robot, t * poses.width);
      keypoints?.points.values.set(points, t * keypoints.points.width);
    }
    this.player.seek(this.player.time);
    if (keypoint) {
      this.rows[this.at].angles = angles;
      this.reached = reached;
      this.wanted ??= ["keyframes"];
    }
    this.#update();
  }

  #shown(what, { takes: [take], keyframes: { rows, times, notes, files } }) {
    Object.assign(this, { rows, times });
    this.mount([take], true);
    this.choose(this.at);
    const done = { save: () => `wrote ${files.join(" and ")}`, judge: () => take.report.badge.text }[what]?.();
    this.#say([done ?? this.reached, ...notes].filter(Boolean).join("\n"));
    this.reached = "";
  }
}
