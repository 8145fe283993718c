// Poses as they come from the server, in place of the first take's only frame. Nothing else is known of them: only the robot is shown.

export class Live {
  /** @param cast whose take has one frame  @param shown called after each pose */
  constructor(cast, shown) {
    this.poses = 0;
    for (const id of Object.keys(cast.parts)) cast.show(id, id === "robot");
    const { poses, way } = cast.take, middle = way.values.slice(), first = poses.values.slice(0, 3);
    this.source = new EventSource("live");
    this.source.onmessage = ({ data }) => {
      poses.values.set(JSON.parse(data));
      for (const k of [0, 1]) way.values[k] = middle[k] + poses.values[k] - first[k]; // the camera goes along
      this.poses += 1;
      shown();
    };
  }
}
