// What is laid over a robot. A layer is a group that can be posed, and may say things at places.

import {
  BufferAttribute, BufferGeometry, CircleGeometry, DoubleSide, DynamicDrawUsage, Group, LineBasicMaterial, LineLoop, Mesh,
  MeshBasicMaterial, Vector3,
} from "#vendor";
import { row } from "#data";
import { Bodies, geometries, Human } from "#figures";
import { Edges } from "#edges";
import { Sticks } from "#sticks";
import { inCm, nearness } from "#words";

const TEAL = 0x0b7285, AMBER = 0xe8890c, RED = 0xd6293e, GREEN = 0x37a05c, PLUM = 0x7048a8;
const STATES = [0xc9a227, AMBER, 0xe8590c, RED]; // near, approaching, imminent, in contact
const SAID = 3; // so many pairs are labelled at a time, the nearest

const frameOf = (t, array) => Math.min(Math.max(Math.round(t), 0), array.shape[0] - 1);
const flat = (color, opacity) =>
  new MeshBasicMaterial({ color, transparent: true, opacity, side: DoubleSide, depthWrite: false });

class Keypoints extends Group {
  constructor({ keypoints, height }) {
    super();
    this.points = keypoints.points;
    this.out = new Float32Array(this.points.width);
    const balls = keypoints.names.map((_, k) => [k, 0.012 * height]);
    const looks = { color: PLUM, onTop: true, opacity: 0.95 };
    this.sticks = new Sticks(keypoints.bones, keypoints.bones.map(() => 0.004 * height), balls, looks);
    this.add(this.sticks);
  }

  pose(t) {
    this.sticks.place(row(this.points, t, this.out));
  }
}

class Limits extends Group {
  constructor({ joints, height }) {
    super();
    this.joints = joints;
    this.angles = new Float32Array(joints.angles.width);
    this.places = new Float32Array(joints.anchors.width);
    const balls = joints.names.map((_, k) => [k, 0.016 * height]);
    this.sticks = new Sticks([], [], balls, { color: 0xffffff, onTop: true, opacity: 0.9 });
    this.add(this.sticks);
  }

  /** How far from the middle of its range towards an end each joint is, 0 … 1. */
  used(t) {
    const { lower, upper, angles } = this.joints;
    row(angles, t, this.angles);
    return lower.map((low, k) => {
      const degrees = (this.angles[k] * 180) / Math.PI, half = (upper[k] - low) / 2;
      return half > 0 ? Math.abs(degrees - (low + half)) / half : 1;
    });
  }

  pose(t) {
    const used = this.used(t);
    this.sticks.place(row(this.joints.anchors, t, this.places));
    used.forEach((share, k) => this.sticks.tintBall(k, share > 0.97 ? RED : share > 0.8 ? AMBER : GREEN));
    this.over = used.map((share, k) => ({ share, k })).filter(({ share }) => share > 0.97);
  }

  labels() {
    return this.over.slice(0, SAID).map(({ share, k }) => ({
      at: new Vector3().fromArray(this.places, 3 * k),
      text: `${this.joints.names[k]} at ${Math.round(100 * share)} % of its range`,
      kind: "limit",
    }));
  }
}

/** A convex outline at a height, as a rim and as a face. */
function polygon(outline, z) {
  const rim = new BufferGeometry().setFromPoints(outline.map(([x, y]) => new Vector3(x, y, z)));
  const face = rim.clone().setIndex(outline.slice(2).flatMap((_, k) => [0, k + 1, k + 2]));
  return { rim, face };
}

/** An outline with its corners farther from its middle by a margin, so that it is seen under a sole that covers it. */
function grown(outline, margin) {
  const [x, y] = [0, 1].map((axis) => outline.reduce((sum, corner) => sum + corner[axis], 0) / outline.length);
  return outline.map((corner) => {
    const away = [corner[0] - x, corner[1] - y], length = Math.hypot(...away) || 1;
    return corner.map((value, axis) => value + (away[axis] / length) * margin);
  });
}

class Footholds extends Group {
  constructor({ stance, floor, height }) {
    super();
    this.holds = stance.footholds.map((hold, k) => {
      const shape = polygon(grown(hold.outline, 0.015 * height), Math.max(hold.height, floor) + height * (0.003 + 2e-5 * k)), color = hold.foot.startsWith("l") ? TEAL : PLUM;
      const fill = new Mesh(shape.face, flat(color, 0.15)), rim = new LineLoop(shape.rim, new LineBasicMaterial({ color }));
      this.add(fill, rim);
      return { ...hold, fill, rim };
    });
  }

  pose(t) {
    for (const { first, last, fill, rim } of this.holds) {
      const now = t >= first - 0.5 && t <= last + 0.5;
      fill.material.opacity = now ? 0.6 : 0.12;
      rim.visible = fill.visible = t >= first - 0.5 || first - t < 60;
    }
  }
}

const MOST_CORNERS = 64;

class Support extends Group {
  constructor({ stance, floor, height }) {
    super();
    this.stance = stance;
    this.z = floor + 0.006 * height;
    this.starts = stance.counts.values.reduce((ends, count) => [...ends, ends.at(-1) + count], [0]);
    this.corners = new BufferAttribute(new Float32Array(3 * MOST_CORNERS), 3).setUsage(DynamicDrawUsage);
    const geometry = new BufferGeometry().setAttribute("position", this.corners);
    geometry.setIndex(Array.from({ length: MOST_CORNERS - 2 }, (_, k) => [0, k + 1, k + 2]).flat());
    this.fill = new Mesh(geometry, flat(TEAL, 0.22));
    this.edge = new BufferGeometry().setAttribute("position", this.corners);
    this.rim = new LineLoop(this.edge, new LineBasicMaterial({ color: TEAL }));
    this.disc = (color, radius, lift) => {
      const mesh = new Mesh(new CircleGeometry(radius * height, 32), flat(color, 0.95));
      mesh.position.z = this.z + lift * height;
      this.add(mesh);
      return mesh;
    };
    this.com = this.disc(TEAL, 0.02, 0.004);
    this.zmp = this.disc(AMBER, 0.013, 0.006);
    this.add(this.fill, this.rim);
    for (const mesh of [this.fill, this.rim]) mesh.frustumCulled = false;
    this.where = new Float32Array(2);
  }

  pose(t) {
    const frame = frameOf(t, this.stance.counts), start = this.starts[frame];
    const count = Math.min(this.starts[frame + 1] - start, MOST_CORNERS);
    for (let k = 0; k < count; k++) {
      const at = 2 * (start + k), { values } = this.stance.outlines;
      this.corners.setXYZ(k, values[at], values[at + 1], this.z);
    }
    this.corners.needsUpdate = true;
    this.fill.geometry.setDrawRange(0, 3 * Math.max(count - 2, 0));
    this.edge.setDrawRange(0, count);
    for (const name of ["com", "zmp"]) {
      const [x, y] = row(this.stance[name], t, this.where);
      this[name].visible = Number.isFinite(x);
      if (this[name].visible) this[name].position.set(x, y, this[name].position.z);
    }
    this.frame = frame;
  }

  labels() {
    const said = { com: "centre of mass", zmp: "zero moment point" };
    return Object.entries(said).filter(([name]) => this[name].visible).map(([name, text]) => {
      const margin = this.stance[`${name}_margin`].values[this.frame];
      const more = Number.isFinite(margin) ? ` ${inCm(Math.abs(margin) / 100)} ${margin >= 0 ? "inside" : "outside"} the support` : "";
      return { at: this[name].position.clone(), text: text + more, kind: margin < 0 ? "alarm" : name };
    });
  }
}

class Near extends Group {
  constructor({ warnings, height, fps }) {
    super();
    Object.assign(this, { warnings, fps, shown: [] });
    const count = warnings.pairs.length, pairs = warnings.pairs.map((_, k) => [2 * k, 2 * k + 1]);
    const ends = pairs.flat().map((point) => [point, 1]);
    const looks = { color: 0xffffff, onTop: true };
    this.core = new Sticks(pairs, pairs.map(() => 0.006 * height), ends.map(([p]) => [p, 0.011 * height]), looks);
    this.glow = new Sticks(pairs, pairs.map(() => 0.016 * height), ends.map(([p]) => [p, 0.03 * height]), { ...looks, opacity: 0.3 });
    this.add(this.glow, this.core);
    this.out = new Float32Array(6 * count);
  }

  pose(t) {
    const { ends, state, pairs } = this.warnings;
    const frame = (this.frame = frameOf(t, ends)), count = pairs.length;
    this.out.set(ends.values.subarray(frame * ends.width, (frame + 1) * ends.width));
    this.core.place(this.out);
    this.glow.place(this.out);
    for (let k = 0; k < count; k++) {
      const color = STATES[state.values[frame * count + k]];
      for (const sticks of [this.core, this.glow]) {
        sticks.tintRod(k, color);
        sticks.tintBall(2 * k, color);
        sticks.tintBall(2 * k + 1, color);
      }
    }
    this.shown = pairs.map((_, k) => k).filter((k) => Number.isFinite(this.out[6 * k]));
  }

  labels() {
    const { ahead, now, contact, state, pairs } = this.warnings, count = pairs.length, at = this.frame * count;
    const nearest = this.shown.toSorted((a, b) => ahead.values[at + a] - ahead.values[at + b]).slice(0, SAID);
    return nearest.map((k) => {
      const middle = [0, 1, 2].map((axis) => (this.out[6 * k + axis] + this.out[6 * k + 3 + axis]) / 2);
      const text = `${pairs[k]}: ${nearness(now.values[at + k], contact.values[at + k], state.values[at + k] === 3)}`;
      return { at: new Vector3(...middle), text, kind: state.values[at + k] > 1 ? "alarm" : "near" };
    });
  }
}

/** The bodies around the robot, with their names. */
class Around extends Bodies {
  constructor({ around }) {
    super(geometries(around), around.poses);
    this.names = around.names;
  }

  labels() {
    return this.children.map((mesh, k) => ({ at: mesh.position.clone(), text: this.names[k], kind: "body" }));
  }
}

/** The layers in the order of their keys; `lacks` says why one is not there, `on` whether it is shown at first. */
export const LAYERS = [
  { id: "robot", name: "Robot", on: true, make: (take, shapes) => new Bodies(shapes, take.poses) },
  { id: "human", name: "Human", on: true, lacks: (t) => !t.human && "no motion was given", make: (take) => new Human(take.human) },
  { id: "keypoints", name: "Keypoints", lacks: (t) => !t.keypoints && "no keypoints were recognised", make: (take) => new Keypoints(take) },
  { id: "footholds", name: "Footholds", on: true, lacks: (t) => !t.stance && "no feet were recognised", make: (take) => new Footholds(take) },
  { id: "support", name: "Support, CoM, ZMP", lacks: (t) => !t.stance && "no feet were recognised", make: (take) => new Support(take) },
  { id: "near", name: "Near pairs", on: true, lacks: (t) => !t.warnings && "no warnings were given", make: (take) => new Near(take) },
  { id: "limits", name: "Joint limits", make: (take) => new Limits(take) },
  {
    id: "simulated", name: "Simulated", lacks: (t) => !t.report?.poses && "no simulation was given",
    make: (take, shapes) => new Bodies(shapes, take.report.poses, true),
  },
  { id: "edges", name: "Edges", lacks: (t) => !t.stress?.edges && "no solution was given; the viewer.html of run has it", make: (take) => new Edges(take) },
  { id: "bodies", name: "Bodies", on: true, lacks: (t) => !t.around && "no scene was given", make: (take) => new Around(take) },
  { id: "before", name: "Before", lacks: (t) => !t.before && "nothing was touched up", make: (take, shapes) => new Bodies(shapes, take.before, true) },
];
