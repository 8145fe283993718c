"""Facts about motions, robots and solutions as plain values: for `info`, `graph` and JSON."""

from collections import Counter
from typing import Any

import numpy as np

from robot_retarget.base.arrays import intervals
from robot_retarget.base.errors import MatchError
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import HARD, Track
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition.recognise import leg_length, stature
from robot_retarget.human.terrain import with_terrain
from robot_retarget.robot import Robot
from robot_retarget.robot import recognise as recognise_robot
from robot_retarget.solver.solution import Solution
from robot_retarget.trajectory import Trajectory


def describe_motion(motion: Motion) -> dict[str, Any]:
    """Length, rate, size and the keypoint map of a motion; `human` is False, with the reason, for another body."""
    facts: dict[str, Any] = {
        "kind": "motion",
        "source": motion.source,
        "frames": len(motion),
        "fps": round(motion.fps, 4),
        "duration_s": round(motion.duration, 3),
        "joints": len(motion.skeleton),
        "rotations": motion.rotations is not None,
        "notes": list(motion.notes),
    }
    try:
        found = motion.recognition
    except MatchError as error:
        return facts | {"human": False, "reason": str(error)}
    names = motion.skeleton.names
    keypoints = {
        k: {
            "joint": " + ".join(names[j] for j in m.joints),
            "confidence": round(m.confidence, 2),
            "sure": sureness(m.confidence),
            "why": m.evidence,
        }
        for k, m in ((k, found.marks[k]) for k in found.keypoints)
    }
    tall, legs = stature(found, motion.positions), leg_length(found, motion.positions)
    sizes = {"confidence": round(found.confidence, 2), "stature_m": round(tall, 3), "leg_m": round(legs, 3)}
    remarks = {"missing": list(found.missing), "remarks": [*found.notes, *_map_advice(keypoints)]}
    return facts | {"human": True, **sizes, "keypoints": keypoints, **remarks}


def describe_trajectory(trajectory: Trajectory) -> dict[str, Any]:
    """Robot, source, length, rate and joints of a trajectory, and whether it has balance and judged goals."""
    return {
        "kind": "trajectory",
        "robot": trajectory.robot,
        "source": trajectory.source,
        "frames": len(trajectory),
        "fps": round(trajectory.fps, 4),
        "duration_s": round(trajectory.duration, 3),
        "joints": list(trajectory.joint_names),
        "balance": trajectory.balance or "off",
        "judged_goals": trajectory.goals is not None,
        "bodies": [] if trajectory.scene is None else list(trajectory.scene.names),
        "notes": list(trajectory.notes),
    }


def describe_scene(motion: Motion, robot: Robot) -> dict[str, Any]:
    """Bodies of a motion's scene, their sizes, and which parts of the human touch them and when.

    Args:
        motion: a human with a scene.
        robot: a robot with the keypoints that are looked at.
    """
    scene, around = motion.scene, features_of(motion, match(motion, robot)).around
    assert scene is not None and around is not None
    times = motion.source_time
    touches: dict[int, list[dict[str, Any]]] = {k: [] for k in range(len(scene))}
    for pair, (part, body) in enumerate(around.touches.pairs):
        for start, stop in intervals(around.touches.held[:, pair]):
            span = {"from_s": round(float(times[start]), 2), "to_s": round(float(times[stop - 1]), 2)}
            touches[body].append({"part": part} | span)
    bodies = [
        {
            "name": body.name,
            "shape": str(body.shape.kind),
            "size_m": [round(float(edge), 3) for edge in body.shape.size],
            "moves": "fixed" if body.fixed else "moves",
            "touches": touches[k],
        }
        for k, body in enumerate(scene.bodies)
    ]
    return {"scene": bodies, "notes": [*motion.notes, *scene.notes]}


def describe_terrain(motion: Motion, robot: Robot) -> dict[str, Any]:
    """The steps and seats that a motion shows, as `describe_scene` states bodies; empty on a level floor."""
    found = with_terrain(motion, match(motion, robot))
    if found.scene is motion.scene:
        return {}
    facts = describe_scene(found, robot)
    advice = "The ground is not level: --terrain auto puts these boxes under the human."
    return facts | {"notes": [*facts["notes"], advice]}


SURENESS = ((0.8, "sure"), (0.6, "likely"), (0.4, "doubtful"), (0.0, "a guess"))
"""Least confidence of each word."""


def sureness(confidence: float) -> str:
    """How sure something is, in words."""
    return next(word for least, word in SURENESS if confidence >= least)


def _map_advice(keypoints: dict[str, dict[str, Any]]) -> list[str]:
    """What to write in a map file about keypoints that are doubtful, where their joints are wrong."""
    doubtful = [(k, v["joint"]) for k, v in keypoints.items() if v["confidence"] < SURENESS[1][0] and k != "pelvis"]
    lines = "; ".join(f'{keypoint} = "{joint}"' for keypoint, joint in doubtful)
    advice = f"Look at these; where a joint is wrong, put the right one in a --map file under [human]: {lines}"
    return [advice] if lines else []


def describe_robot(robot: Robot) -> dict[str, Any]:
    """Joints with their limits and the keypoint map of a robot; `humanoid` is False, with the reason, for another robot."""
    facts: dict[str, Any] = {
        "kind": "robot",
        "name": robot.name,
        "path": str(robot.path),
        "mass_kg": round(float(np.sum(robot.model.body_mass)), 3),
        "root": _root(robot),
        "joints": _joints(robot),
    }
    try:
        found = recognise_robot(robot)
    except MatchError as error:
        return facts | {"humanoid": False, "reason": str(error)}
    keypoints = {
        k: {
            "body": robot.model.body(s.body).name,
            "offset_m": [round(v, 4) for v in s.offset.tolist()],
            "confidence": round(s.confidence, 2),
            "why": s.evidence,
        }
        for k, s in ((k, found.sites[k]) for k in found.names)
    }
    remarks = {"missing": list(found.missing), "remarks": list(found.notes)}
    least = min(s.confidence for s in found.sites.values())
    return facts | {"humanoid": True, "confidence": round(least, 2), "keypoints": keypoints} | remarks


def _root(robot: Robot) -> str:
    """What carries a robot."""
    if robot.floating:
        return "free joint"
    return f"{robot.root_joints.size} single joints" if robot.root_joints.size else "fixed"


def _joints(robot: Robot) -> dict[str, dict[str, float | None]]:
    """Range [rad], speed [rad/s] and torque [N m], if it is known, of every joint."""
    torques = [t if np.isfinite(t) else None for t in robot.max_torque.tolist()]
    limits = zip(robot.lower.tolist(), robot.upper.tolist(), robot.max_speed.tolist(), torques, strict=True)
    return {
        name: {"lower": round(low, 4), "upper": round(high, 4), "max_speed": speed, "max_torque": torque}
        for name, (low, high, speed, torque) in zip(robot.joint_names, limits, strict=True)
    }


def describe_solution(solution: Solution, notes: tuple[str, ...] = ()) -> dict[str, Any]:
    """How a clip was solved: frames, rate, status, stress, worst edges."""
    frames, seconds = len(solution.cost), sum(solution.timings.get(stage, 0.0) for stage in ("solve", "balance"))
    return {
        "frames": frames,
        "fps": round(solution.trajectory.fps, 4),
        "status": dict(Counter(status.name.lower() for status in solution.status)),
        "distance_error_mean": round(float(solution.posture_error.mean()), 5),
        "distance_error_max": round(float(solution.posture_error.max()), 5),
        "distance_error_max_frame": int(solution.posture_error.argmax()),
        "largest_step_rad": round(solution.largest_step(), 3),
        "solved_per_second": round(frames / seconds, 1) if seconds else None,
        "timings_s": {k: round(v, 3) for k, v in solution.timings.items()},
        "work": {k: round(v, 2) for k, v in solution.work.items()},
        "machine_code": solution.native,
        **describe_stress(solution),
        "unmet": [edge.sentence for edge in solution.unmet],
        "notes": [*notes, *_unmet_notes(solution), *_jumps_told(solution)],
    }


def describe_graph(graph: RobotGraph) -> dict[str, Any]:
    """The kinds of a graph: how many edges, how many a frame on the mean, intervals, priorities."""
    return {
        "robot": graph.robot.name,
        "frames": len(graph),
        "fps": round(graph.fps, 4),
        "kinds": {name: _kind(track) for name, track in graph.kinds.items()},
    }


def _kind(track: Track) -> dict[str, Any]:
    present = track.priority > 0
    chosen, finite = track.priority[present], track.priority[present & np.isfinite(track.priority)]
    return {
        "edges": len(track),
        "present": round(float(present.sum(axis=1).mean()), 1),
        "interval": "exact" if track.exact else "interval",
        "priority": f"{finite.min():.3g} … {finite.max():.3g}" if finite.size else "limit" if chosen.size else "absent",
        "hard": bool(chosen.size and chosen.min() >= HARD),
    }


def describe_stress(solution: Solution) -> dict[str, Any]:
    """Stress per kind, and the eight edges that cost most, each at its worst frame."""
    return {
        "stress": {kind: round(float(part.mean()), 5) for kind, part in solution.stress.items()},
        "worst_edges": [
            {
                "edge": edge.name,
                "frame": edge.frame,
                "target": round(edge.target, 4),
                "measured": round(edge.measured, 4),
                "error": round(edge.error, 4),
                "priority": round(edge.priority, 3),
            }
            for edge in solution.costliest(8)
        ],
    }


def _unmet_notes(solution: Solution) -> list[str]:
    """The hard edge of every kind that misses its interval most, and the number of the others."""
    worst = {edge.kind: edge for edge in reversed(solution.unmet)}
    counts = Counter(edge.kind for edge in solution.unmet)
    return [
        edge.sentence + (f" (and {counts[kind] - 1} more hard {kind} edges)" if counts[kind] > 1 else "")
        for kind, edge in worst.items()
    ]


def _jumps_told(solution: Solution) -> list[str]:
    """What to say of joints that jump: the largest, and how many more."""
    jumps = solution.jumps()
    if not jumps:
        return []
    joint, frame, step = jumps[0]
    more = f", and {len(jumps) - 1} more such steps" if len(jumps) > 1 else ""
    when = f"frame {frame} ({frame / solution.trajectory.fps:.2f} s)"
    advice = "look at it there; the arm or leg changes its way"
    return [f"{joint} jumps by {np.degrees(step):+.0f}° to {when}{more}: {advice}"]
