// The edges that cost most over the clip, coloured by their stress at the moment; the few that are shown say what they ask for.

import { Color, Group, Vector3 } from "#vendor";
import { row } from "#data";
import { Sticks } from "#sticks";
import { inCm, interval, worded } from "#words";

const EASY = new Color(0x6c9bb3), HARD = new Color(0xd6293e), MIXED = new Color();
const NEAR = 7; // the pointer is on an edge that is so near [pixels]
export const COUNTS = [5, 15, 60]; // so many edges can be shown
const LABELLED = COUNTS[0]; // more labels than that hide the robot
const [a, b] = [new Vector3(), new Vector3()];

export class Edges extends Group {
  constructor({ stress, keypoints, height }) {
    super();
    Object.assign(this, { edges: stress.edges, points: keypoints.points, frame: 0 });
    this.pairs = this.edges.ends.map(([, from, to]) => [keypoints.names.indexOf(from), keypoints.names.indexOf(to)]);
    this.most = this.edges.stress.values.reduce((most, value) => Math.max(most, value), 1e-12);
    const rods = this.pairs.map((_, k) => [2 * k, 2 * k + 1]);
    this.sticks = new Sticks(rods, rods.map(() => 0.0035 * height), [], { color: 0xffffff, onTop: true, opacity: 0.85 });
    this.add(this.sticks);
    this.places = new Float32Array(this.points.width);
    this.ends = new Float32Array(6 * this.pairs.length);
    this.show(COUNTS[0]);
  }

  /** Show so many edges, the costliest over the clip. */
  show(count) {
    this.shown = Math.min(count, this.pairs.length);
  }

  /** The k-th edge's share of the largest stress, and by its root a colour that tells small ones apart. */
  share(k) {
    return Math.sqrt(this.edges.stress.values[this.frame * this.pairs.length + k] / this.most);
  }

  pose(t) {
    row(this.points, t, this.places);
    this.frame = Math.min(Math.round(t), this.edges.stress.shape[0] - 1);
    this.pairs.forEach(([from, to], k) => {
      [from, to].forEach((point, end) => {
        for (let axis = 0; axis < 3; axis++) this.ends[6 * k + 3 * end + axis] = k < this.shown ? this.places[3 * point + axis] : NaN;
      });
      this.sticks.tintRod(k, MIXED.lerpColors(EASY, HARD, this.share(k)));
    });
    this.sticks.place(this.ends);
  }

  /** What is to be said of the edge at a place of the picture [pixels], or null. */
  under(x, y, camera, { width, height }) {
    const away = this.pairs.map((_, k) => {
      if (!Number.isFinite(this.ends[6 * k])) return Infinity;
      [a, b].forEach((point, end) => this.localToWorld(point.fromArray(this.ends, 6 * k + 3 * end)).project(camera));
      const [ax, bx] = [a, b].map((point) => ((point.x + 1) / 2) * width), [ay, by] = [a, b].map((point) => ((1 - point.y) / 2) * height);
      const long = (bx - ax) ** 2 + (by - ay) ** 2 || 1, along = Math.min(Math.max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / long, 0), 1);
      return Math.hypot(ax + along * (bx - ax) - x, ay + along * (by - ay) - y);
    });
    const nearest = away.indexOf(Math.min(...away));
    return away[nearest] < NEAR ? `${this.edges.ends[nearest][0]}: ${this.described(nearest)}, ${this.counted(nearest)}` : null;
  }

  /** An edge in words: its ends, their distance, and its target. */
  described(k) {
    const at = this.frame * this.pairs.length + k, { ends, lower, upper, measured } = this.edges, [, from, to] = ends[k];
    const target = interval(lower.values[at], upper.values[at]);
    return `${worded(from)} – ${worded(to)}: ${inCm(measured.values[at])}, target ${target}`;
  }

  /** How much an edge counts, and what it costs. */
  counted(k) {
    const at = this.frame * this.pairs.length + k, { priority, stress } = this.edges;
    return `priority ${priority.values[at].toPrecision(2)}, stress ${stress.values[at].toPrecision(2)}`;
  }

  labels() {
    if (this.shown > LABELLED) return [];
    return this.pairs.slice(0, this.shown).map((_, k) => {
      const middle = [0, 1, 2].map((axis) => (this.ends[6 * k + axis] + this.ends[6 * k + 3 + axis]) / 2);
      return { at: new Vector3(...middle), text: this.described(k), kind: this.share(k) > 0.5 ? "alarm" : "edge" };
    });
  }
}
