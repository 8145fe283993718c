// Many round sticks and balls in one draw call each.

import {
  CylinderGeometry, DynamicDrawUsage, Group, InstancedMesh, Matrix4, MeshBasicMaterial, MeshLambertMaterial, Quaternion,
  SphereGeometry, Vector3, Color,
} from "#vendor";

const UP = new Vector3(0, 1, 0);
const [from, to, along, middle, scale] = Array.from({ length: 5 }, () => new Vector3());
const turn = new Quaternion(), matrix = new Matrix4(), STILL = new Quaternion(), tint = new Color();
const NOTHING = new Matrix4().makeScale(0, 0, 0);

/** Balls at points, and sticks between pairs of them. */
export class Sticks extends Group {
  /** @param pairs [[from, to], …] of points  @param radii of the sticks [m]  @param balls [[point, radius], …] */
  constructor(pairs, radii, balls, { color, onTop = false, opacity = 1 }) {
    super();
    this.pairs = pairs;
    this.radii = radii;
    this.ballsAt = balls;
    const kind = onTop ? MeshBasicMaterial : MeshLambertMaterial;
    const look = { color, transparent: onTop || opacity < 1, opacity, depthTest: !onTop, depthWrite: !onTop };
    const material = new kind(look);
    this.rods = new InstancedMesh(new CylinderGeometry(1, 1, 1, onTop ? 6 : 12, 1, true), material, pairs.length);
    this.balls = new InstancedMesh(onTop ? new SphereGeometry(1, 10, 6) : new SphereGeometry(1, 14, 8), material, balls.length);
    for (const mesh of [this.rods, this.balls]) {
      mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      mesh.castShadow = !onTop;
      mesh.frustumCulled = false;
      mesh.renderOrder = onTop ? 2 : 0;
      if (mesh.count) this.add(mesh);
    }
  }

  /** @param points flat x y z; what is not finite is not drawn. */
  place(points) {
    this.pairs.forEach(([a, b], k) => {
      from.fromArray(points, 3 * a);
      to.fromArray(points, 3 * b);
      along.subVectors(to, from);
      const length = along.length();
      if (!(length > 1e-9)) return this.rods.setMatrixAt(k, NOTHING);
      turn.setFromUnitVectors(UP, along.divideScalar(length));
      middle.addVectors(from, to).multiplyScalar(0.5);
      this.rods.setMatrixAt(k, matrix.compose(middle, turn, scale.set(this.radii[k], length, this.radii[k])));
    });
    this.ballsAt.forEach(([point, radius], k) => {
      from.fromArray(points, 3 * point);
      const there = Number.isFinite(from.x);
      this.balls.setMatrixAt(k, there ? matrix.compose(from, STILL, scale.setScalar(radius)) : NOTHING);
    });
    this.rods.instanceMatrix.needsUpdate = this.balls.instanceMatrix.needsUpdate = true;
  }

  /** Colour the k-th stick, or ball; `size` makes the ball that many times as large. */
  tintRod(k, color) {
    this.rods.setColorAt(k, tint.set(color));
    this.rods.instanceColor.needsUpdate = true;
  }

  tintBall(k, color) {
    this.balls.setColorAt(k, tint.set(color));
    this.balls.instanceColor.needsUpdate = true;
  }
}
