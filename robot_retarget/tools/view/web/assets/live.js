// Poses as they come from the server, in place of the first take's only frame. Nothing else is known of them: only the robot and bodies are shown.

export class Live {
  /** @param cast whose take has one frame  @param shown called after each pose */
  constructor(cast, shown) {
    this.poses = 0;
    for (const id of Object.keys(cast.parts)) cast.show(id, id === "robot");
    const { poses, way, around } = cast.take, middle = way.values.slice(), first = poses.values.slice(0, 3);
    this.source = new EventSource("live");
    this.source.onmessage = ({ data }) => {
      const { robot, bodies, size } = JSON.parse(data);
      poses.values.set(robot);
      if (bodies) {
        around.poses.values.set(bodies);
        cast.parts.bodies.children.forEach((mesh) => mesh.scale.setScalar(size));
        cast.show("bodies", true);
      }
      for (const k of [0, 1]) way.values[k] = middle[k] + poses.values[k] - first[k]; // the camera goes along
      this.poses += 1;
      shown();
    };
  }
}
