// One take on the stage: its layers, where it stands, and the way it goes.

import { Group, Vector3 } from "#vendor";
import { row } from "#data";
import { geometries } from "#figures";
import { LAYERS } from "#layers";

export class Cast extends Group {
  /** @param shift where it stands beside the others [m] */
  constructor(take, shift) {
    super();
    this.take = take;
    this.position.copy(shift);
    const shapes = geometries(take);
    this.parts = {};
    for (const { id, lacks, make, on } of LAYERS) {
      if (lacks?.(take)) continue;
      const layer = (this.parts[id] = make(take, shapes));
      layer.visible = Boolean(on);
      this.add(layer);
    }
    this.where = new Float32Array(3);
  }

  /** Time [s]. */
  pose(time) {
    this.at = time * this.take.fps;
    for (const layer of Object.values(this.parts)) if (layer.visible) layer.pose(this.at);
  }

  show(id, visible) {
    const layer = this.parts[id];
    if (!layer) return;
    layer.visible = visible;
    if (visible && this.at !== undefined) layer.pose(this.at);
  }

  /** Where the camera looks at a time [s], [m]. */
  target(time) {
    return new Vector3(...row(this.take.way, time * this.take.fps, this.where)).add(this.position);
  }

  /** What is to be said, where. */
  labels() {
    const shown = Object.values(this.parts).filter((layer) => layer.visible && layer.labels);
    return shown.flatMap((layer) => layer.labels()).map((label) => ({ ...label, at: label.at.add(this.position) }));
  }

  /** Its name, over its head. */
  nameplate() {
    const { name, floor, fps, height } = this.take;
    return { at: this.target((this.at ?? 0) / fps).setZ(floor + 1.06 * height), text: name, kind: "name" };
  }

  /** Corners of the room that it takes at a time [s], from the camera's left to its right [m]. */
  corners(time, right) {
    const { floor, height, reach } = this.take, middle = this.target(time);
    return [-reach, reach].flatMap((aside) => [floor, floor + 1.15 * height].map((z) => middle.clone().addScaledVector(right, aside).setZ(z)));
  }
}

/** The picture's horizontal axis for a camera that looks to an azimuth [degrees]. */
export function rightOf(azimuth) {
  const angle = (azimuth * Math.PI) / 180;
  return new Vector3(Math.sin(angle), -Math.cos(angle), 0);
}

/** Takes side by side, to the right of one another as the camera sees them. */
export function castsOf(takes) {
  let edge = 0;
  const places = takes.map(({ reach }) => {
    const place = edge + reach;
    edge += 2 * reach;
    return place;
  });
  const right = rightOf(takes[0]?.azimuth ?? 0), casts = takes.map((take, k) => new Cast(take, right.clone().multiplyScalar(places[k] - edge / 2)));
  return { casts, span: edge };
}
