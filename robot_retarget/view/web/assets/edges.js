// The edges that cost most, coloured by their stress; what is wished of one is said when it is pointed at.

import { Color, Group, Vector3 } from "#vendor";
import { row } from "#data";
import { Sticks } from "#sticks";

const EASY = new Color(0x6c9bb3), HARD = new Color(0xd6293e), MIXED = new Color();
const FAINT = 0.03; // edges under this share of the largest stress are not drawn
const NEAR = 7; // the pointer is on an edge that is so near [pixels]
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
  }

  /** The k-th edge's share of the largest stress, and by its root a colour that tells small ones apart. */
  share(k) {
    return Math.sqrt(this.edges.stress.values[this.frame * this.pairs.length + k] / this.most);
  }

  pose(t) {
    row(this.points, t, this.places);
    this.frame = Math.min(Math.round(t), this.edges.stress.shape[0] - 1);
    this.pairs.forEach(([from, to], k) => {
      const share = this.share(k), seen = share * share > FAINT;
      [from, to].forEach((point, end) => {
        for (let axis = 0; axis < 3; axis++) this.ends[6 * k + 3 * end + axis] = seen ? this.places[3 * point + axis] : NaN;
      });
      if (seen) this.sticks.tintRod(k, MIXED.lerpColors(EASY, HARD, share));
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
    return away[nearest] < NEAR ? this.said(nearest) : null;
  }

  /** An edge in words: what is wished, what is, and how much it counts. */
  said(k) {
    const at = this.frame * this.pairs.length + k, { ends, lower, upper, measured, priority, stress } = this.edges, [kind, from, to] = ends[k];
    const cm = (value) => (100 * value).toFixed(1), low = lower.values[at], high = upper.values[at];
    const wished = low === high ? cm(low) : `${cm(low)} … ${Number.isFinite(high) ? cm(high) : "∞"}`;
    return `${kind} ${from} – ${to}: δ ${wished} cm, d ${cm(measured.values[at])} cm, π ${priority.values[at].toPrecision(2)}, stress ${stress.values[at].toPrecision(2)}`;
  }
}
