// A keypoint under the pointer: clicked, or dragged in the plane that faces the camera.

import { Plane, Raycaster, Vector2, Vector3 } from "#vendor";
import { row } from "#data";

const NEAR = 16; // a keypoint this near to the pointer is meant [pixels]
const STILL = 4; // a pointer that moves less has clicked [pixels]

export class KeypointDrag {
  /** @param active whether the pointer is taken  @param moved (k, place) and dropped (k, place or null for a click) are called with a keypoint */
  constructor({ stage, player, casts, active, moved, dropped }) {
    Object.assign(this, { stage, player, casts, active, moved, dropped, ray: new Raycaster() });
    const canvas = stage.renderer.domElement;
    canvas.addEventListener("pointerdown", (event) => this.#down(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.#move(event), { capture: true });
    canvas.addEventListener("pointerup", (event) => this.#up(event), { capture: true });
  }

  get keypoints() {
    return this.casts[0].take.keypoints;
  }

  /** Where the k-th keypoint is now [m]. */
  at(k) {
    const { points } = this.keypoints, places = row(points, this.casts[0].at ?? 0, new Float32Array(points.width));
    return new Vector3().fromArray(places, 3 * k).add(this.casts[0].position);
  }

  #pointer(event) {
    const box = this.stage.renderer.domElement.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top, width: box.width, height: box.height };
  }

  #under(event) {
    const { x, y, width, height } = this.#pointer(event);
    const away = this.keypoints.names.map((_, k) => {
      const seen = this.at(k).project(this.stage.camera);
      return Math.hypot(((seen.x + 1) / 2) * width - x, ((1 - seen.y) / 2) * height - y);
    });
    const nearest = away.indexOf(Math.min(...away));
    return away[nearest] < NEAR ? nearest : -1;
  }

  #down(event) {
    if (!this.active() || !this.keypoints) return;
    const k = this.#under(event);
    if (k < 0) return;
    event.stopImmediatePropagation();
    this.stage.renderer.domElement.setPointerCapture(event.pointerId);
    this.player.pause();
    const start = this.at(k), facing = this.stage.camera.getWorldDirection(new Vector3());
    this.drag = { k, x: event.clientX, y: event.clientY, plane: new Plane().setFromNormalAndCoplanarPoint(facing, start), place: null };
  }

  #move(event) {
    if (!this.drag) return;
    event.stopImmediatePropagation();
    const { k, x, y, plane } = this.drag;
    if (!this.drag.place && Math.hypot(event.clientX - x, event.clientY - y) < STILL) return;
    const pointer = this.#pointer(event);
    this.ray.setFromCamera(new Vector2((2 * pointer.x) / pointer.width - 1, 1 - (2 * pointer.y) / pointer.height), this.stage.camera);
    const place = this.ray.ray.intersectPlane(plane, new Vector3());
    if (!place) return;
    this.drag.place = place.sub(this.casts[0].position);
    this.moved(k, this.drag.place);
  }

  #up(event) {
    if (!this.drag) return;
    event.stopImmediatePropagation();
    const { k, place } = this.drag;
    this.drag = null;
    this.dropped(k, place);
  }
}
