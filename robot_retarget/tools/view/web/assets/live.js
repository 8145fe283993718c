// A stream: poses as they come from the server, in place of the first take's only frame, and the state of the stream beside them.

import { Vector3 } from "#vendor";
import { made } from "#dom";
import { address, post } from "#server";
import { Sticks } from "#sticks";
import { rightOf } from "#cast";

const ASIDE = 0.9; // from the robot to its performer, in heights of the robot
const THICK = 0.012; // a bone of the performer, in heights of the robot
const HUMAN = 0xf28c40;
const ROWS = { state: "state", source: "frames from", rate: "rate", latency: "latency", faults: "faults", take: "take" };

export class Live {
  /** @param cast whose take has one frame  @param shown called after each pose */
  constructor(cast, shown) {
    this.poses = 0;
    this.cast = cast;
    this.aside = new Vector3(); // from the robot to the middle of the picture
    for (const id of Object.keys(cast.parts)) cast.show(id, id === "robot");
    this.#panel(document.getElementById("live"));
    const { poses, way, around } = cast.take, middle = way.values.slice(), first = poses.values.slice(0, 3);
    this.source = new EventSource(address("live"));
    this.source.onmessage = ({ data }) => {
      const { robot, bodies, size, human } = JSON.parse(data);
      poses.values.set(robot);
      if (bodies) {
        around.poses.values.set(bodies);
        cast.parts.bodies.children.forEach((mesh) => mesh.scale.setScalar(size));
        cast.show("bodies", true);
      }
      for (const k of [0, 1]) way.values[k] = middle[k] + poses.values[k] - first[k] + this.aside.getComponent(k); // the camera goes along
      if (human) this.#human(human);
      this.poses += 1;
      shown();
    };
    this.source.addEventListener("state", ({ data }) => this.#state(JSON.parse(data)));
    this.source.onerror = () => this.#state({ ...this.last, state: "the stream has ended", rate: 0 });
  }

  /** Follow no longer. */
  close() {
    this.source.close();
    this.sticks?.removeFromParent();
  }

  #panel(holder) {
    holder.replaceChildren();
    this.cells = Object.fromEntries(Object.keys(ROWS).map((id) => [id, made("dd", { textContent: "–" })]));
    this.button = made("button", { id: "record", textContent: "record a take" });
    this.button.addEventListener("click", () => this.record());
    holder.append(made("dl", {}, ...Object.entries(ROWS).flatMap(([id, name]) => [made("dt", { textContent: name }), this.cells[id]])), this.button);
  }

  #state(facts) {
    this.last = facts;
    const { state, source, rate, latency_ms, faults = {}, bones, recording } = facts;
    const counted = Object.entries(faults).map(([what, times]) => `${what} × ${times}`);
    const said = { state, source, rate: rate === undefined ? "–" : `${rate.toFixed(0)} frames/s`, latency: latency_ms == null ? "–" : `${latency_ms.toFixed(1)} ms`, faults: counted.join(", ") || "none" };
    for (const [id, text] of Object.entries(said)) this.cells[id].textContent = text;
    this.cells.faults.classList.toggle("bad", counted.length > 0);
    if (recording != null) this.cells.take.textContent = `${recording.toFixed(1)} s`;
    this.button.textContent = recording == null ? "record a take" : "stop and save";
    this.button.classList.toggle("on", recording != null);
    if (bones && JSON.stringify(bones) !== this.joined) this.#joined(bones);
  }

  #joined(bones) {
    this.joined = JSON.stringify(bones);
    this.sticks?.removeFromParent();
    const { take } = this.cast, radius = THICK * take.height;
    this.aside = rightOf(take.azimuth).multiplyScalar((-ASIDE / 2) * take.height);
    take.reach = Math.max(take.reach, (ASIDE / 2 + 0.6) * take.height); // the performer is in the picture too
    this.sticks = new Sticks(bones, bones.map(() => radius), [...new Set(bones.flat())].map((k) => [k, 1.3 * radius]), { color: HUMAN });
    this.cast.add(this.sticks);
  }

  #human(points) {
    if (!this.sticks) return;
    const { way, floor } = this.cast.take;
    this.sticks.place(points.map((value, k) => value + (k % 3 < 2 ? way.values[k % 3] + this.aside.getComponent(k % 3) : floor)));
  }

  async record() {
    try {
      const { wrote, seconds, projects } = await (await post("record")).json();
      this.cells.take.textContent = wrote ? `wrote ${wrote}, ${seconds} s` : "0.0 s";
      if (projects) location.hash = encodeURIComponent(projects[0]); // it is solved there
    } catch (error) {
      this.cells.take.textContent = error.message;
    }
  }
}
