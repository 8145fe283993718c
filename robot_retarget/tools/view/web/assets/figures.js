// The robot, and the human beside it or laid over it.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, Group, Matrix4, Mesh,
  MeshLambertMaterial, Quaternion, SphereGeometry, Vector3, mergeGeometries, mergeVertices, toCreasedNormals,
} from "#vendor";
import { row } from "#data";
import { Sticks } from "#sticks";

const CREASE = 0.6; // edges sharper than this are drawn as edges [rad]
const MAKE = {
  sphere: ([r]) => new SphereGeometry(r, 24, 16),
  ellipsoid: ([x, y, z]) => new SphereGeometry(1, 24, 16).scale(x, y, z),
  capsule: ([r, half]) => new CapsuleGeometry(r, 2 * half, 8, 20).rotateX(Math.PI / 2),
  cylinder: ([r, half]) => new CylinderGeometry(r, r, 2 * half, 28).rotateX(Math.PI / 2),
  box: ([x, y, z]) => new BoxGeometry(2 * x, 2 * y, 2 * z),
};

function meshed({ vertices, triangles }) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(vertices.values, 3));
  geometry.setIndex(Array.from(triangles.values));
  return toCreasedNormals(geometry, CREASE);
}

/** A shape in its body's frame, in its colour, as triangles with position, normal and colour. */
function solid(shape) {
  const made = shape.kind === "mesh" ? meshed(shape.mesh) : MAKE[shape.kind](shape.size).toNonIndexed();
  made.deleteAttribute("uv");
  const [w, x, y, z] = shape.quaternion;
  made.applyMatrix4(new Matrix4().compose(new Vector3(...shape.position), new Quaternion(x, y, z, w), new Vector3(1, 1, 1)));
  const { r, g, b } = new Color().setRGB(...shape.colour.slice(0, 3), "srgb");
  const colours = new Float32Array(made.attributes.position.count * 3);
  for (let k = 0; k < colours.length; k += 3) colours.set([r, g, b], k);
  made.setAttribute("color", new BufferAttribute(colours, 3));
  return made;
}

/** One geometry for each body that is seen; corners that are the same are one, so that they are worked out once. */
export function geometries(take) {
  const bodies = [...new Set(take.shapes.map((shape) => shape.body))].sort((a, b) => a - b);
  return bodies.map((body) => mergeVertices(mergeGeometries(take.shapes.filter((shape) => shape.body === body).map(solid))));
}

const OWN = new MeshLambertMaterial({ vertexColors: true });
const GHOST = new MeshLambertMaterial({ color: 0x0b7285, transparent: true, opacity: 0.38, depthWrite: false });
const [q0, q1] = [new Quaternion(), new Quaternion()];

/** Bodies that go where an array of poses has them. */
export class Bodies extends Group {
  constructor(shapes, poses, ghost = false) {
    super();
    this.poses = poses;
    this.out = new Float32Array(poses.width);
    shapes.forEach((geometry, k) => {
      const mesh = new Mesh(geometry, ghost ? GHOST : OWN);
      mesh.castShadow = mesh.receiveShadow = !ghost;
      mesh.userData.body = k;
      this.add(mesh);
    });
  }

  pose(t) {
    const { values, width, shape } = this.poses;
    const at = Math.min(Math.max(t, 0), shape[0] - 1);
    const left = Math.floor(at), right = Math.min(left + 1, shape[0] - 1);
    row(this.poses, at, this.out);
    this.children.forEach((mesh, k) => {
      mesh.position.fromArray(this.out, 7 * k);
      q0.fromArray(values, left * width + 7 * k + 3).normalize();
      q1.fromArray(values, right * width + 7 * k + 3).normalize();
      mesh.quaternion.slerpQuaternions(q0, q1, at - left);
    });
  }
}

/** The human as a figure of capsules. */
export class Human extends Group {
  constructor(human) {
    super();
    const { limbs, radii } = human;
    this.points = human.points;
    this.out = new Float32Array(human.points.width);
    this.aside = new Vector3(...human.aside);
    const balls = limbs.flatMap(([a, b], k) => (a === b ? [[a, radii[k]]] : [[a, radii[k]], [b, radii[k]]]));
    const rods = limbs.map((pair, k) => [pair, radii[k]]).filter(([[a, b]]) => a !== b);
    const looks = { color: 0xe8843c };
    this.beside = new Sticks(rods.map(([pair]) => pair), rods.map(([, r]) => r), balls, looks);
    this.over = new Sticks(rods.map(([pair]) => pair), rods.map(([, r]) => 0.35 * r), balls.map(([p, r]) => [p, 0.4 * r]), {
      ...looks, onTop: true, opacity: 0.85,
    });
    this.add(this.beside, this.over);
    this.stand("beside");
  }

  /** "beside" the robot, "over" it, or "off". */
  stand(where) {
    this.where = where;
    this.beside.visible = where === "beside";
    this.over.visible = where === "over";
    if (where === "over") this.position.copy(this.aside).negate();
    else this.position.set(0, 0, 0);
  }

  pose(t) {
    if (this.where === "off") return;
    row(this.points, t, this.out);
    (this.where === "over" ? this.over : this.beside).place(this.out);
  }
}
