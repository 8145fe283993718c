// Buttons, the scrub bar, and the keys.

import { made } from "#dom";
import { COUNTS } from "#edges";
import { LAYERS } from "#layers";
import { SPEEDS } from "#player";

const KEYS = [
  ["space", "play, pause"], ["← →", "a frame back, on"], ["shift ← →", "a second back, on"], ["home end", "the beginning, the end"],
  ["[ ]", "slower, faster"], ["L", "loop"], ["H", "human beside, over, off"], ["1 … 9", "layers"], ["F", "camera goes along"],
  ["R", "camera back"], ["B", "labels"], ["P", "picture (PNG)"], ["?", "these keys"],
];
if (document.body.matches(".touch, .studio")) KEYS.push(["T", "touch up"]);
const STANDS = ["beside", "over", "off"];

export class Panel {
  constructor(player, stage, casts, exported) {
    Object.assign(this, { player, stage, casts, exported, shown: {} });
    this.#layers(document.getElementById("layers"));
    this.#transport(document.getElementById("transport"));
    this.#help(document.getElementById("help"));
    document.addEventListener("keydown", (event) => this.#key(event));
    player.onchange(() => this.#update());
    this.#update();
  }

  #layers(holder) {
    this.chips = Object.fromEntries(LAYERS.map(({ id, name, on }) => {
      const chip = made("button", { id: `layer-${id}`, textContent: name });
      chip.addEventListener("click", () => this.toggle(id));
      this.shown[id] = Boolean(on);
      holder.append(chip);
      return [id, chip];
    }));
    const counts = COUNTS.map((value, k) => made("option", { value, textContent: k ? `${value} costliest` : "five costliest" }));
    this.count = made("select", { id: "edge-count", title: "how many edges are shown, by their cost over the clip" }, ...counts);
    this.count.addEventListener("change", () => this.refresh());
    this.chips.edges.after(this.count);
    this.labels = made("button", { id: "labels-on", textContent: "Labels", title: "say what is shown, in the picture (B)" });
    this.labels.addEventListener("click", () => this.label());
    holder.append(this.labels);
    this.refresh();
  }

  /** What is shown is said in the picture too, or not. */
  label() {
    this.labels.classList.toggle("on", document.body.classList.toggle("labelled"));
    this.stage.draw();
  }

  /** After takes have changed: what can be shown, and what is. */
  refresh() {
    const takes = this.casts.map((cast) => cast.take);
    this.scrub?.setAttribute("max", this.player.duration);
    LAYERS.forEach(({ id, lacks }, k) => {
      const why = takes.length ? takes.every((take) => lacks?.(take)) && lacks?.(takes[0]) : "nothing is shown yet";
      this.chips[id].disabled = Boolean(why);
      this.chips[id].title = why || (k < 9 ? `key ${k + 1}` : "");
      this.chips[id].classList.toggle("on", this.shown[id] && !why);
      this.casts.forEach((cast) => cast.show(id, this.shown[id]));
    });
    this.#counted();
    this.stage.draw();
  }

  /** As many edges as are chosen. */
  #counted() {
    this.count.hidden = !this.shown.edges || this.chips.edges.disabled;
    for (const cast of this.casts) {
      cast.parts.edges?.show(Number(this.count.value));
      cast.show("edges", this.shown.edges);
    }
  }

  toggle(id) {
    if (this.chips[id].disabled) return;
    if (id === "human") return this.stand();
    this.shown[id] = !this.shown[id];
    this.chips[id].classList.toggle("on", this.shown[id]);
    this.casts.forEach((cast) => cast.show(id, this.shown[id]));
    this.#counted();
    this.stage.draw();
  }

  /** The human: beside the robot, then over it, then off. */
  stand() {
    const humans = this.casts.map((cast) => cast.parts.human).filter(Boolean);
    if (!humans.length) return;
    const next = STANDS[(STANDS.indexOf(humans[0].where) + 1) % STANDS.length];
    humans.forEach((human) => human.stand(next));
    this.shown.human = next !== "off";
    this.casts.forEach((cast) => cast.show("human", next !== "off"));
    this.chips.human.classList.toggle("on", next !== "off");
    this.chips.human.textContent = next === "off" ? "Human" : `Human ${next}`;
    this.stage.draw();
  }

  #transport(holder) {
    const { player } = this;
    this.button = made("button", { id: "play", title: "play, pause (space)" });
    this.button.addEventListener("click", () => player.toggle());
    this.scrub = made("input", { type: "range", id: "scrub", min: 0, max: 0, step: 0.001, value: 0 });
    this.scrub.setAttribute("aria-label", "time");
    this.scrub.addEventListener("input", () => {
      const time = Number(this.scrub.value); // before pausing sets it back
      player.pause();
      player.seek(time);
    });
    this.clock = made("output", { id: "clock" });
    const options = SPEEDS.map((speed) => made("option", { value: speed, textContent: `${speed}×` }));
    this.speed = made("select", { id: "speed", title: "speed ([ and ])" }, ...options);
    this.speed.addEventListener("change", () => player.setSpeed(Number(this.speed.value)));
    this.loop = made("button", { id: "loop", textContent: "loop", title: "start again at the end (L)" });
    this.loop.addEventListener("click", () => player.toggleLoop());
    this.followed = made("button", { id: "follow", textContent: "follow", title: "the camera goes along (F)" });
    this.followed.addEventListener("click", () => this.follow());
    const keys = made("button", { textContent: "?", title: "keys" });
    keys.addEventListener("click", () => this.toggleHelp());
    holder.append(this.button, this.scrub, this.clock, this.speed, this.loop, this.followed, ...this.#exports(), keys);
  }

  #exports() {
    const { exported } = this;
    const picture = made("button", { id: "save-picture", textContent: "PNG", title: "save this view as a picture (P)" });
    picture.addEventListener("click", () => exported.savePicture());
    this.film = made("button", { id: "save-film", textContent: "film", disabled: !exported.kind });
    this.film.title = exported.kind ? "record the motion in this view, from its beginning to its end" : "this browser records no films";
    this.film.addEventListener("click", () => exported.saveFilm());
    return [picture, this.film];
  }

  follow() {
    this.stage.following = !this.stage.following;
    this.#update();
  }

  #help(holder) {
    this.help = holder;
    holder.append(...KEYS.flatMap(([key, what]) => [made("kbd", { textContent: key }), made("span", { textContent: what })]));
    holder.addEventListener("click", () => this.toggleHelp());
  }

  toggleHelp() {
    this.help.hidden = !this.help.hidden;
  }

  #update() {
    const { player } = this;
    this.button.textContent = player.playing ? "❚❚" : "▶";
    this.button.setAttribute("aria-label", player.playing ? "pause" : "play");
    this.scrub.max = player.duration;
    this.scrub.value = player.time;
    this.scrub.style.setProperty("--share", `${(100 * player.time) / Math.max(player.duration, 1e-9)}%`);
    const frame = Math.round(player.time * player.fps);
    this.clock.textContent = `${player.time.toFixed(2)} / ${player.duration.toFixed(2)} s · frame ${frame}`;
    this.speed.value = player.speed;
    this.loop.classList.toggle("on", player.loop);
    this.followed.classList.toggle("on", this.stage.following);
    this.film.classList.toggle("on", Boolean(this.exported.recorder));
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(TEXTAREA|SELECT)$/.test(event.target.tagName)) return;
    if (event.target.tagName === "INPUT" && event.target !== this.scrub) return;
    const { player } = this, far = event.shiftKey ? Math.round(player.fps) : 1;
    const does = {
      " ": () => player.toggle(), ArrowLeft: () => player.step(-far), ArrowRight: () => player.step(far),
      Home: () => player.seek(0), End: () => player.seek(player.duration), "[": () => player.faster(-1), "]": () => player.faster(1),
      l: () => player.toggleLoop(), h: () => this.stand(), f: () => this.follow(), b: () => this.label(), r: () => this.onreset(), p: () => this.exported.savePicture(), "?": () => this.toggleHelp(),
      Escape: () => (this.help.hidden = true),
    };
    const layer = LAYERS[Number(event.key) - 1];
    const act = does[event.key] ?? does[event.key.toLowerCase()] ?? (layer && (() => this.toggle(layer.id)));
    if (!act) return;
    event.preventDefault();
    document.activeElement?.blur?.();
    act();
  }
}
