// The studio: clips on robots, each from the file to what is taken away.

import { decoded } from "#data";
import { button, made, select } from "#dom";
import { Live } from "#live";
import { about, address, get, post } from "#server";
import { worded } from "#words";
import { droppedFiles, zipped } from "#zip";

const CHOICES = {
  balance: ["Balance", { auto: "automatic", static: "static", dynamic: "dynamic", off: "off: pelvis held" }],
  legs: ["Legs", { auto: "automatic", follow: "follow the human", stand: "stand in place" }],
  speed: ["Pace", { 1: "the human's", 0.8: "0.8 times", 0.6: "0.6 times" }],
  favour: ["Favour", { balanced: "a blend", directions: "directions of limbs", distances: "distances of parts" }],
};
const LIVE = "live"; // the name of the stream among the projects
const STATES = { live: "live", waiting: "waits for its turn", opening: "opening", solving: "solving", solved: "solved", judging: "judging", judged: "judged", stopped: "stopped", failed: "not possible" };
const $ = (id) => document.getElementById(id);
const plain = (text) => text.replaceAll("`", "");

export class Studio {
  constructor(page) {
    Object.assign(this, page, { lines: [], keys: [], versions: {}, facts: null, filter: "all" });
    this.#build();
    this.#dropping();
    this.#open(location.hash.slice(1));
    addEventListener("hashchange", () => this.#open(location.hash.slice(1)));
    const source = new EventSource(address("events"));
    source.onmessage = ({ data }) => this.#heard(JSON.parse(data));
    source.onerror = () => this.#say("The studio's server does not answer: start it again.", true);
    source.onopen = () => this.#say("");
  }

  // What is there.

  #build() {
    this.files = made("input", { type: "file", multiple: true, hidden: true, id: "files" });
    this.files.addEventListener("change", () => this.#take([...this.files.files].map((file) => ({ path: file.name, file }))));
    this.robot = made("select", { id: "robot", ariaLabel: "robot" });
    this.robot.addEventListener("change", () => this.#ask(() => this.facts && this.#add({ of: this.line.key, robot: this.robot.value })));
    this.said = made("p", { id: "message", role: "alert", hidden: true });
    this.pick = made("label", {}, "on ", this.robot);
    this.card = made("div", { id: "drop" },
      made("h2", { textContent: "Drop a motion here" }),
      made("p", { textContent: "BVH, AMC, C3D, glTF, SMPL, landmarks, or a zip of them. A robot's MJCF or URDF goes here too, with its meshes as a folder or a zip." }),
      made("div", { className: "row" }, button("choose a file", () => this.files.click(), { className: "main" })),
      made("div", { className: "row", id: "samples" }));
    $("scene").append(this.card);
    this.fold = Object.fromEntries([
      ["marks", "Where it is bad"], ["body", "What was recognised"], ["kinds", "Edges"], ["view", "What is shown"], ["curves", "Curves"], ["away", "Take away"],
    ].map(([id, title]) => [id, made("details", { id: `fold-${id}`, hidden: true }, made("summary", { textContent: title }), made("div", {}))]));
    this.fold.view.lastChild.append($("layers"));
    this.fold.curves.lastChild.append($("charts"));
    this.fold.curves.addEventListener("toggle", () => this.charts.draw());
    this.work = made("section", { id: "work", hidden: true });
    this.verdict = made("section", { id: "verdict", hidden: true });
    $("live").hidden = false;
    this.stream = made("section", { id: "stream", hidden: true }, made("h2", { textContent: "Live" }), $("live"));
    this.list = made("section", { id: "clips", hidden: true });
    const top = this.top = made("header", { id: "top" }, made("h1", { textContent: "Studio" }),
      button("add a clip", () => this.files.click(), { id: "add" }), this.files);
    $("side").append(top, this.said, this.list, this.stream, this.work, this.verdict, this.fold.away, this.fold.marks, this.fold.body, this.fold.kinds, this.fold.view, this.fold.curves);
    $("side").hidden = false;
  }

  get line() {
    return this.lines.find(({ key }) => key === this.keys[0]);
  }

  #say(text, bad = false) {
    this.said.textContent = text;
    this.said.hidden = !text;
    this.said.classList.toggle("bad", bad);
  }

  /** Do something that the server may refuse. */
  #ask(act) {
    this.#say("");
    return this.#try(act);
  }

  async #try(act) {
    try {
      return await act();
    } catch (error) {
      this.#say(error.message, true);
    }
  }

  #do(what, value) {
    return this.#ask(() => post("do", { what, value }));
  }

  // Files and clips.

  #dropping() {
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      document.body.classList.add("over");
    });
    document.addEventListener("dragleave", (event) => event.relatedTarget || document.body.classList.remove("over"));
    document.addEventListener("drop", async (event) => {
      event.preventDefault();
      document.body.classList.remove("over");
      const files = await droppedFiles(event.dataTransfer.items);
      if (files.length) this.#take(files);
      else this.#say("What was dropped holds no file.", true);
    });
  }

  /** Send files: clips one by one, any others that came together as one zip. */
  async #take(files) {
    this.files.value = "";
    const alone = files.length === 1 || files.every(({ path }) => /\.bvh$/i.test(path));
    const name = files[0].path.split("/")[0].replace(/\.\w+$/, "");
    const sent = alone ? files.map(({ path, file }) => [path, file]) : [[`${name}.zip`, await zipped(files)]];
    this.#say(`Reading ${files.length === 1 ? files[0].path : name} …`);
    const wrong = [];
    for (const [path, file] of sent) {
      try {
        const answer = await (await post("drop", file, { name: path, robot: this.robot.value })).json();
        wrong.push(...(answer.left_out ?? []).map((why) => `left out: ${why}`));
        await this.#came(answer);
      } catch (error) {
        wrong.push(error.message);
      }
    }
    if (wrong.length) this.#say(wrong.join("; "), true);
  }

  async #add(what) {
    this.#came(await (await post("add", what)).json());
  }

  async #came({ projects, robot, notes }) {
    this.#say("");
    if (projects) location.hash = encodeURIComponent(projects[0]);
    if (!robot) return;
    this.#offer([robot]);
    this.robot.value = robot;
    if (this.facts) await this.#add({ of: this.line.key, robot });
    else this.#say(`${robot} is there${notes.length ? ` (${notes.join("; ")})` : ""}: drop a motion for it.`);
  }

  /** Show projects: the first with all that is said of it, the others beside it. */
  #open(hash) {
    this.keys = hash ? hash.split("&").map(decodeURIComponent) : [];
    about.set("project", this.keys[0] ?? "");
    this.live?.close();
    Object.assign(this, { versions: {}, facts: null, live: null });
    if (!this.keys.length) this.mount([]);
    this.#draw();
    this.#refresh();
  }

  // What the server says.

  #heard({ projects, robots, samples, live }) {
    const first = !this.lines.length;
    this.lines = live ? [{ key: LIVE, clip: "the stream", robot: "", state: "live", reasons: [], version: 1 }, ...projects] : projects;
    this.#offer(robots);
    if (!$("samples").children.length) $("samples").append("or try ", ...samples.map((sample) => button(sample.replace(/\.bvh$/, "").replaceAll("_", " "), () => this.#ask(() => this.#add({ sample, robot: this.robot.value })))));
    if (!this.keys.length && (live || (first && projects.length))) return void (location.hash = live ? LIVE : encodeURIComponent(projects.at(-1).key));
    if (this.facts && document.activeElement !== this.robot) this.robot.value = this.line.robot;
    this.#draw();
    this.#refresh();
  }

  #offer(robots) {
    const known = new Set([...this.robot.options].map(({ value }) => value));
    this.robot.append(...robots.filter((name) => !known.has(name)).map((name) => made("option", { value: name, textContent: name.replaceAll("_", " "), selected: name === "op3" })));
  }

  /** Fetch the pictures that have changed. */
  async #refresh() {
    if (this.fetching || !this.keys.length) return;
    const wanted = this.keys.map((key) => this.lines.find((line) => line.key === key)).filter(Boolean);
    if (!wanted.length || wanted.every(({ key, version }) => this.versions[key] === version)) return;
    this.fetching = true;
    const keys = this.keys.join("&");
    wanted.forEach(({ key, version }) => (this.versions[key] = version)); // what fails is not asked for again
    await this.#try(async () => {
      const found = await Promise.all(wanted.map(async ({ key }) => decoded((await get("take", { project: key })).body)));
      if (keys !== this.keys.join("&")) return;
      if (keys === LIVE) return this.#follow(found[0].takes);
      this.facts = found[0].studio;
      wanted.forEach(({ key }, k) => (this.versions[key] = found[k].studio.version));
      const apart = ["robot", "clip"].find((key) => new Set(wanted.map((line) => line[key])).size === wanted.length);
      const shown = found.map(({ takes: [take], studio }, k) => ({ ...take, name: wanted[k][apart] ?? take.title, marks: studio.marks }));
      this.mount(shown, this.mounted === keys && this.takes.length === shown.length);
      this.mounted = keys;
      this.panel.shown.before ||= false;
      this.#details();
    });
    this.fetching = false;
    this.#refresh();
  }

  #follow(takes) {
    this.mount(takes);
    this.live = new Live(this.casts[0], () => this.player.seek(0));
    this.#draw();
  }

  // What is drawn of it.

  #draw() {
    const { line } = this;
    this.card.hidden = this.keys.length > 0;
    document.body.classList.toggle("empty", !this.keys.length && !this.lines.length);
    if (!(this.card.hidden ? this.top : this.card).contains(this.pick)) {
      (this.card.hidden ? this.top.firstChild : this.card.querySelector(".main")).after(this.pick);
      (this.card.hidden ? this.top : this.card.lastChild).after(this.said);
    }
    this.#drawList();
    const streams = this.keys[0] === LIVE;
    this.stream.hidden = !streams;
    document.body.classList.toggle("streams", streams);
    for (const part of [this.work, this.verdict, ...Object.values(this.fold)]) part.hidden = !line || streams;
    if (line && !streams) this.#drawWork(line);
  }

  #drawList() {
    const bad = ({ badge, state }) => state === "failed" || (badge && badge.level !== "pass");
    const kept = { all: () => true, pass: ({ badge }) => badge?.level === "pass", "not yet judged": ({ badge, state }) => !badge && state !== "failed", bad };
    const shown = this.lines.filter(kept[this.filter]);
    this.list.hidden = this.lines.length < (this.keys.length ? 2 : 1);
    const state = JSON.stringify([shown.map(({ key, state, busy, share, badge, reasons, error }) => [key, state, busy && Math.round(20 * share), badge, reasons, error]), this.keys, this.filter, this.lines.length]);
    if (this.list.hidden || state === this.listed) return;
    this.listed = state;
    this.list.replaceChildren(
      made("div", { className: "row" }, made("h2", { textContent: `${this.lines.length} clip${this.lines.length === 1 ? "" : "s"}` }),
        select("which clips are listed", Object.keys(kept), this.filter, (value) => {
          this.filter = value;
          this.#drawList();
        })),
      made("ul", {}, ...shown.map((line) => this.#row(line))));
  }

  #row(line) {
    const on = line.key === this.keys[0], beside = this.keys.indexOf(line.key) > 0;
    const badge = made("i", { className: line.badge?.level ?? "plain", textContent: line.badge ? line.badge.text.split(" (")[0] : line.busy && line.share ? `${Math.round(100 * line.share)} %` : STATES[line.state] });
    const open = made("a", { href: `#${encodeURIComponent(line.key)}`, ariaCurrent: on ? "true" : null },
      made("b", { textContent: line.clip }), made("span", { textContent: line.robot }, badge));
    const other = button(beside ? "−" : "+", () => {
      const keys = beside ? this.keys.filter((key) => key !== line.key) : [...this.keys, line.key];
      location.hash = keys.map(encodeURIComponent).join("&");
    }, { title: beside ? "not beside" : "show it beside", ariaLabel: `${line.clip} on ${line.robot} beside`, disabled: on || [line.key, this.keys[0]].includes(LIVE) });
    return made("li", {}, open, other, made("p", { textContent: line.error || line.reasons[0] || "" }));
  }

  #drawWork(line) {
    const state = JSON.stringify([line.key, line.state, line.busy, Math.round(200 * line.share), line.left, line.error, this.facts?.choices]);
    if (state === this.worked) return;
    this.worked = state;
    const left = line.left == null ? "" : ` · ${line.left < 1 ? "under 1" : Math.round(line.left)} s left`;
    const share = line.busy && line.state !== "waiting" ? ` · ${Math.round(100 * line.share)} %${left}` : "";
    const bar = made("progress", { max: 1, value: line.share, ariaLabel: "how far it is" });
    if (!line.share) bar.removeAttribute("value");
    const head = made("div", { className: "row" }, made("h2", { textContent: line.clip }), made("span", { className: "state", textContent: STATES[line.state] + share }));
    const choices = made("div", { className: "choices" }, ...Object.entries(this.facts ? CHOICES : {}).map(([name, [label, texts]]) => {
      const chosen = this.facts.choices[name], values = [...new Set([...this.facts.allowed[name], chosen])];
      return made("label", {}, made("span", { textContent: label }), select(label, values, chosen, (value) => this.#do("solve", { [name]: value }), texts));
    }));
    const stop = button("cancel", () => this.#do("stop"), { id: "stop" });
    const act = line.busy ? [bar, stop] : [button(line.state === "stopped" || line.state === "failed" ? "solve" : "solve again", () => this.#do("solve", {}), { id: "again" }), button("remove", () => this.#remove(), { id: "remove" })];
    this.work.replaceChildren(head, ...(line.error ? [made("p", { className: "bad", textContent: line.error })] : []), choices, made("div", { className: "row" }, ...act));
  }

  async #remove() {
    await this.#do("remove");
    location.hash = "";
  }

  #details() {
    this.worked = null;
    this.robot.value = this.line?.robot ?? this.robot.value;
    this.#draw();
    this.#drawVerdict();
    this.#drawMarks();
    this.#drawBodies();
    this.#drawKinds();
    this.#drawAway();
  }

  #drawVerdict() {
    const { verdict, solved } = this.facts;
    const judge = button(verdict ? "judge again" : "judge", () => this.#do("judge"), { id: "judge-it", className: verdict ? "" : "main", disabled: !solved });
    if (!verdict) return this.verdict.replaceChildren(made("h2", { textContent: "Verdict" }), made("p", { className: "faint", textContent: "Plays it on simulated servos, and says what fails and what helps." }), made("div", { className: "row" }, judge));
    const cures = verdict.cures.map(({ reasons, what, command, sets }) => made("div", {},
      ...reasons.map((reason) => made("p", { textContent: reason })),
      ...(command ? [Object.keys(sets).length ? button(plain(what), () => this.#do("cure", command), { className: "cure" }) : made("p", { className: "faint", textContent: `What helps: ${plain(what)}` })] : [])));
    this.verdict.replaceChildren(made("h2", { textContent: "Verdict" }),
      made("p", { className: `badge ${verdict.badge.level}`, textContent: verdict.badge.text }), made("p", { textContent: verdict.headline }),
      ...(cures.length ? [made("div", { className: "cures" }, ...cures)] : []), made("div", { className: "row" }, judge));
  }

  #drawMarks() {
    const { marks } = this.facts, counts = Map.groupBy(marks, ({ kind }) => kind);
    this.fold.marks.firstChild.textContent = `Where it is bad${marks.length ? ` · ${marks.length}` : ""}`;
    this.fold.marks.lastChild.replaceChildren(...[...counts].map(([kind, found]) => made("div", { className: "marks" }, made("h3", { textContent: `${kind} · ${found.length}` }),
      ...found.map(({ from, said }) => button(`${from.toFixed(2)} s`, () => {
        this.player.pause();
        this.player.seek(from);
        this.#say(said);
      }, { title: said, ariaLabel: `${kind} at ${from.toFixed(2)} s: ${said}` })))), ...(marks.length ? [] : [made("p", { className: "faint", textContent: "nothing found" })]));
  }

  #drawBodies() {
    const { keypoints, joints, bodies, notes, solved } = this.facts, doubtful = keypoints.filter((row) => /doubt|guess|missing/.test(row.human_sure + row.robot_sure));
    this.fold.body.firstChild.textContent = `What was recognised · ${keypoints.length - doubtful.length} of ${keypoints.length} sure`;
    const pick = (body, row, names) => select(`${worded(row.name)} of the ${body}`, [...new Set([row[body], ...names])], row[body], (value) => this.#do("mend", [body, row.name, value]), { "": "none" });
    this.fold.body.lastChild.replaceChildren(
      made("p", { className: "faint", textContent: "Choose another joint where one is wrong: the map is written, and the clip is solved again." }),
      made("dl", { className: "map" }, made("dt", { textContent: "keypoint" }), made("dd", { textContent: "human" }), made("dd", { textContent: "robot" }),
        ...keypoints.flatMap((row) => [made("dt", { textContent: worded(row.name), className: doubtful.includes(row) ? "doubt" : "" }),
          made("dd", { title: row.human_sure }, pick("human", row, joints)), made("dd", { title: row.robot_sure }, pick("robot", row, bodies))])),
      ...(solved || notes.length ? [made("ul", { className: "notes" }, ...notes.map((note) => made("li", { textContent: note })))] : []));
  }

  #drawKinds() {
    const { kinds } = this.facts, holder = this.fold.kinds.lastChild;
    const boxes = kinds.map(({ name, on }) => made("input", { type: "checkbox", value: name, checked: on }));
    const solve = button("solve without the others", () => this.#do("kinds", boxes.filter((box) => !box.checked).map(({ value }) => value)), { id: "kinds-solve" });
    holder.replaceChildren(made("p", { className: "faint", textContent: "Each kind of edge asks for something of the robot's keypoints. The layer Edges shows those that cost most." }),
      made("div", { className: "kinds" }, ...boxes.map((box) => made("label", {}, box, ` ${box.value}`))), made("div", { className: "row" }, solve));
  }

  #drawAway() {
    const { formats, commands, solved } = this.facts, holder = this.fold.away.lastChild, said = made("p", { className: "faint", id: "format-said" });
    const known = { viewer: "this view as a page of its own, that opens without a server", ...formats };
    const format = select("format", Object.keys(known), this.format ?? "csv", (value) => {
      this.format = value;
      said.textContent = known[value];
    });
    format.id = "format";
    said.textContent = known[this.format ?? "csv"];
    const text = commands.join("\n");
    const copy = button("copy", async () => {
      await navigator.clipboard.writeText(text);
      copy.textContent = "copied";
    }, { id: "copy" });
    holder.replaceChildren(
      made("div", { className: "row" }, format, button("export", () => this.#ask(() => this.#download(format.value)), { id: "export", className: "main", disabled: !solved })), said,
      made("h3", { textContent: "The same in a shell" }), made("pre", { id: "commands", tabIndex: 0, textContent: text }), made("div", { className: "row" }, copy));
  }

  async #download(format) {
    const answer = await get("export", { format }), [, name] = /filename="?([^";]+)/.exec(answer.headers.get("content-disposition"));
    const link = made("a", { href: URL.createObjectURL(await answer.blob()), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    this.#say(`${name} is in your downloads.`);
  }
}
