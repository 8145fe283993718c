"""Data of a take for the page: names and numbers in a header, everything else as packed arrays."""

import gzip
import json
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, intervals, path_to_root
from robot_retarget.contact.stance import Stance, planned_stance
from robot_retarget.judge.report import Report
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import joint_velocities
from robot_retarget.scene.scene import Scene
from robot_retarget.solver.solution import Solution
from robot_retarget.tools.view.staging import Staging, arrange, stick_figure
from robot_retarget.tools.view.web.shapes import (
    Shape,
    anchors,
    footholds,
    keypoints_of,
    near_pairs,
    outline,
    shapes_of,
    shapes_of_scene,
)
from robot_retarget.tools.view.web.take import Take

# Arrays in few bytes for a page: whole numbers of a step, differences along the first axis, gzip.
#
# A file is the length of a JSON header (uint32, little endian), the header, and the arrays. In the header an array is
# {"type", "step", "shape", "offset"}; its value is step × the running sum over the first axis, wrapped to its type, and the
# smallest number of the type means "no value". `assets/data.js` reads it.

PLACE_STEP = 1e-4
"""Step of places [m]."""
TURN = 1 / 16384
"""Step of poses: places [m] and quaternions [-] alike; two metres fit into two bytes."""
ANGLE = 1e-4
"""Step of joint angles [rad]; that of joint speeds is ten times as large [rad/s]."""

COMPRESSION = 6
"""Of gzip: the sample walk has 0.8 % more bytes than with 9, in a fifth of the time."""


class Packer:
    """Collects arrays; `add` returns their entry for the header."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Any, step: float = 1.0) -> dict[str, Any]:
        """Add an array of any shape, rounded to multiples of a step; values that are not finite are stored as "no value"."""
        array = np.asarray(values, dtype=float)
        finite = np.isfinite(array)
        whole = np.rint(np.where(finite, array, 0) / step)
        narrow = np.abs(whole).max(initial=0) < np.iinfo(np.int16).max
        kind = np.int16 if narrow else np.int32
        whole = np.where(finite, np.clip(whole, -(2**31) + 1, 2**31 - 1), np.iinfo(kind).min).astype(kind)
        if whole.ndim:
            with np.errstate(over="ignore"):
                whole = np.concatenate([whole[:1], np.diff(whole, axis=0)])
        data = whole.astype(f"<i{whole.itemsize}").tobytes()
        place = {"type": f"i{whole.itemsize}", "step": step, "shape": list(array.shape), "offset": self._size}
        padded = data + bytes(-len(data) % 4)
        self._parts.append(padded)
        self._size += len(padded)
        return place

    def packed(self, header: Any) -> bytes:
        """Return header and arrays, compressed; the same content always gives the same bytes.

        Raises:
            ValueError: the header holds a number that is not finite.
        """
        text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        return gzip.compress(len(text).to_bytes(4, "little") + text + b"".join(self._parts), COMPRESSION, mtime=0)


# Stress by kind of edge, and the edges between keypoints with the largest cost.

EDGES = 60
"""Number of edges in the page, the costliest over the clip first; the page draws five of them at first."""
EDGE_STEP = 1e-3
"""Resolution of edges: metres, and shares of the largest."""


def stress_of(solution: Solution, packer: Packer) -> dict[str, Any]:
    """Return the cost of every kind by frame, and the edges: kind, ends, target interval, measured distance, π, stress."""
    kinds = {name: values for name, values in solution.stress.items() if np.any(values > 0)}
    cost = np.stack(list(kinds.values()), axis=1) if kinds else np.zeros((len(solution.cost), 0))
    return {"kinds": list(kinds), "cost": packer.add(cost, _step(cost)), "edges": _edges(solution, packer)}


def _edges(solution: Solution, packer: Packer) -> dict[str, Any] | None:
    keypoints = solution.graph.match.keypoints
    found: list[tuple[str, str, str]] = []
    columns: list[Floats] = []
    for kind, measured in solution.measured.items():
        track, stress = solution.graph.kinds[kind], solution.edge_stress(kind)
        for k, (a, b) in enumerate(track.ends):
            if not track.axes and a in keypoints and b in keypoints:
                found.append((kind, a, b))
                columns.append(
                    np.stack([track.lower[:, k], track.upper[:, k], measured[:, k], track.priority[:, k], stress[:, k]])
                )
    if not found:
        return None
    every = np.stack(columns, axis=2)
    chosen = np.argsort(-every[4].sum(axis=0), kind="stable")[:EDGES]
    names = ("lower", "upper", "measured", "priority", "stress")
    packed = {
        name: packer.add(values[:, chosen], EDGE_STEP if name in names[:3] else _step(values[:, chosen]))
        for name, values in zip(names, every, strict=True)
    }
    return {"ends": [found[k] for k in chosen.tolist()], **packed}


def _step(values: Floats) -> float:
    """Return a thousandth of the largest value."""
    return float(np.max(values, initial=0.0)) * EDGE_STEP or EDGE_STEP


SCALAR_LAST = [0, 1, 2, 4, 5, 6, 3]
"""Columns of a pose with the quaternion as x y z w, from one as w x y z."""
CHART_STEP = 1e-3
"""Resolution of charts: degrees, centimetres, newton metres."""


def take_header(take: Take, packer: Packer) -> dict[str, Any]:
    """Return the header of one take; its arrays go into the packer."""
    robot, trajectory = take.robot, take.trajectory
    times = np.arange(len(trajectory)) / trajectory.fps
    figure = take.human
    staging = arrange(robot, trajectory, *((figure.points, figure.bones) if figure else (None, None)), times)
    shapes = shapes_of(robot)
    stance = planned_stance(robot, trajectory)
    return {
        "title": take.title,
        "name": take.name or robot.name,
        "robot": robot.name,
        "frames": len(trajectory),
        "fps": trajectory.fps,
        "height": round(staging.height, 4),
        "floor": round(staging.floor, 4),
        "azimuth": round(staging.azimuth, 2),
        "distance": round(staging.distance, 3),
        "reach": round(_reach(staging), 3),
        "way": packer.add(staging.targets, PLACE_STEP),
        "bodies": _bodies(robot, shapes),
        "shapes": [_shape(shape, packer) for shape in shapes],
        "poses": packer.add(poses(robot, staging.qpos, shapes), TURN),
        "around": _around(staging.scene, len(times), packer) if staging.scene else None,
        "human": _human(take, staging, packer) if figure else None,
        "keypoints": _keypoints(robot, staging.qpos, packer),
        "joints": _joints(take, packer),
        "stance": _stance(stance, packer) if stance else None,
        "warnings": _warnings(take, staging, packer) if take.warnings else None,
        "stress": stress_of(take.solution, packer) if take.solution else None,
        "before": packer.add(poses(robot, take.before.qpos, shapes), TURN) if take.before else None,
        "report": _report(take, take.report, shapes, packer) if take.report else None,
    }


def _reach(staging: Staging) -> float:
    """Return the reach of a robot and its human to either side of the robot's path [m]."""
    places, _ = body_frames(staging.robot, staging.qpos[:: max(len(staging.qpos) // 40, 1)])
    way = places[:, staging.robot.root_body, None]
    reach = np.abs((places[:, 1:] - way) @ staging.right).max() + 0.1 * staging.height
    return float(max(reach, abs(staging.aside) + 0.3 * staging.height if staging.human.size else 0.0))


def seen(shapes: list[Shape]) -> list[int]:
    """Return the bodies that shapes show, in order."""
    return sorted({shape.body for shape in shapes})


def _bodies(robot: Robot, shapes: list[Shape]) -> list[dict[str, Any]]:
    """Return the names of the bodies with shapes, and the last hinge that moves each."""
    found, owners = [], robot.model.jnt_bodyid[robot.joint_ids]
    for body in seen(shapes):
        path = path_to_root(robot.model.body_parentid, body)
        hinges = (k for carrier in path for k in reversed(range(len(owners))) if owners[k] == carrier)
        found.append({"name": robot.model.body(body).name, "joint": next(hinges, -1)})
    return found


def _shape(shape: Shape, packer: Packer) -> dict[str, Any]:
    mesh = None
    if shape.mesh is not None:
        vertices, triangles = shape.mesh
        mesh = {"vertices": packer.add(vertices, PLACE_STEP), "triangles": packer.add(triangles)}
    numbers = {"size": shape.size, "position": shape.position, "quaternion": shape.quaternion, "colour": shape.colour}
    return {
        "body": shape.body, "kind": shape.kind, "mesh": mesh,
        **{name: [round(float(x), 5) for x in values] for name, values in numbers.items()},
    }  # fmt: skip


def poses(robot: Robot, qpos: Floats, shapes: list[Shape]) -> Floats:
    """Return (T, B, 7) places [m] and quaternions x y z w of the bodies with shapes."""
    bodies = seen(shapes)
    places, turns = body_frames(robot, qpos)
    quaternions = Rotation.from_matrix(turns[:, bodies].reshape(-1, 3, 3)).as_quat().reshape(len(qpos), -1, 4)
    return np.concatenate([places[:, bodies], quaternions], axis=2)


def _around(scene: Scene, frames: int, packer: Packer) -> dict[str, Any]:
    """Return names, shapes and poses of the drawn bodies around a robot."""
    shapes = shapes_of_scene(scene)
    drawn = seen(shapes)
    paths = scene.poses(frames)[:, drawn][..., SCALAR_LAST]
    return {
        "names": [scene.names[body] for body in drawn],
        "shapes": [_shape(shape, packer) for shape in shapes],
        "poses": packer.add(paths, TURN),
    }


def _human(take: Take, staging: Staging, packer: Packer) -> dict[str, Any]:
    figure = stick_figure(staging)
    return {
        "names": list(take.human.names) if take.human else [],
        "points": packer.add(staging.human, PLACE_STEP),
        "bones": staging.bones.tolist(),
        "limbs": figure.limbs.tolist(),
        "radii": np.round(figure.radii, 4).tolist(),
        "aside": np.round(staging.aside * staging.right, 4).tolist(),
    }


def _keypoints(robot: Robot, qpos: Floats, packer: Packer) -> dict[str, Any] | None:
    found = keypoints_of(robot, qpos)
    if found is None:
        return None
    names, points, bones = found
    return {"names": list(names), "points": packer.add(points, PLACE_STEP), "bones": bones.tolist()}


def _joints(take: Take, packer: Packer) -> dict[str, Any]:
    robot, trajectory = take.robot, take.trajectory
    speed = joint_velocities(trajectory, robot)
    held = np.concatenate([speed, speed[-1:]]) if len(speed) else np.zeros((1, len(robot.joint_ids)))
    return {
        "names": list(robot.joint_names),
        "lower": np.degrees(robot.lower).round(2).tolist(),
        "upper": np.degrees(robot.upper).round(2).tolist(),
        "fastest": np.degrees(robot.max_speed).round(1).tolist(),
        "angles": packer.add(trajectory.qpos[:, robot.qpos_index], ANGLE),
        "speeds": packer.add(held, 10 * ANGLE),
        "anchors": packer.add(anchors(robot, trajectory.qpos), PLACE_STEP),
    }


def _stance(stance: Stance, packer: Packer) -> dict[str, Any]:
    """Return footholds and contact schedule by foot; support, centre of mass and zero moment point by frame."""
    outlines = [outline(points[down, :2]) for points, down in zip(stance.points, stance.down, strict=True)]
    return {
        "feet": list(stance.feet.names),
        "schedule": [[(first, stop - 1) for first, stop in intervals(touching)] for touching in stance.touching.T],
        "footholds": footholds(stance),
        "counts": packer.add([len(corners) for corners in outlines]),
        "outlines": packer.add(np.concatenate(outlines) if outlines else np.zeros((0, 2)), PLACE_STEP),
        "com": packer.add(stance.com, PLACE_STEP),
        "zmp": packer.add(stance.zmp, PLACE_STEP),
        "com_margin": packer.add(100 * stance.com_margin, CHART_STEP),
        "zmp_margin": packer.add(100 * stance.zmp_margin, CHART_STEP),
    }


def _warnings(take: Take, staging: Staging, packer: Packer) -> dict[str, Any]:
    """Return the nearest pairs by frame, and every warning as a stretch of frames."""
    warnings = take.warnings
    assert warnings is not None
    columns, ends = near_pairs(staging, warnings)
    return {
        "pairs": [" – ".join(warnings.pairs[column]) for column in columns.tolist()],
        "ends": packer.add(ends, PLACE_STEP),
        "now": packer.add(warnings.distance[:, columns], PLACE_STEP),
        "ahead": packer.add(warnings.ahead[:, columns], PLACE_STEP),
        "alpha": packer.add(warnings.alpha[:, columns], CHART_STEP),
        "state": packer.add(warnings.state[:, columns]),
        "contact": packer.add(warnings.time_to_contact[:, columns], CHART_STEP),
        "events": [
            {
                "pair": " – ".join(event.pair),
                "first": event.first_warning,
                "last": event.last,
                "touch": event.contact,
                "lead": event.lead_s,
            }
            for event in warnings.events
        ],
    }


def _report(take: Take, report: Report, shapes: list[Shape], packer: Packer) -> dict[str, Any]:
    """Return the badge, the reasons and the simulated motion, if it is that of the trajectory."""
    robot, series = take.robot, {} if take.stale else report.series
    simulated = series.get("simulated", np.zeros((0, robot.model.nq)))
    return {
        "badge": report.badge.contract(),
        "reasons": [*report.reasons, *report.unlike],
        "stale": take.stale,
        "fall": None if take.stale else report.figures.get("fall_s"),
        "poses": packer.add(poses(robot, simulated, shapes), TURN) if len(simulated) else None,
        "error": packer.add(np.degrees(series["error"]), CHART_STEP) if "error" in series else None,
        "torque": packer.add(series["torque"], CHART_STEP) if "torque" in series else None,
        "bounds": [float(b) if np.isfinite(b) else None for b in series.get("bounds", ())],
    }
