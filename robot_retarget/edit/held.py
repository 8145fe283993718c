"""The graph of a touch-up: the trajectory's own pose is the cost, and only the limbs at the ends of the edge move."""

from dataclasses import replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.graph.added import FIRM, End, HeldKind, body_of
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import Form, Role, Track
from robot_retarget.graph.track import FRAME, HARD
from robot_retarget.robot import Robot
from robot_retarget.robot.anatomy import LIMBS, joints_by_limb
from robot_retarget.robot.kinematics import carrying, difference, tangent_names
from robot_retarget.solver.problem import Problem


def with_root(graph: RobotGraph) -> RobotGraph:
    """Return the graph with edges by which the root can be held."""
    root = HeldKind().track(len(graph), graph.match.robot_leg)
    return replace(graph, tracks=(*graph.tracks, root)) if graph.robot.floating else graph


# The limbs that move.


def free_hinges(graph: RobotGraph, ends: tuple[End, End], frames: slice) -> Bools:
    """Return (n,) the hinges of the limbs that carry the ends of an edge; all if no limb does.

    A leg that stands at some of the frames is not free, unless its foot carries an end.
    """
    robot, anatomy = graph.robot, graph.match.anatomy
    moves, names = carrying(robot.model)[:, robot.dof_index], np.array(robot.joint_names)
    bodies = [body for end in ends if (body := body_of(graph.match, robot, end)) is not None]
    free = np.zeros(len(names), dtype=bool)
    for limb, joints in joints_by_limb(robot, anatomy).items():
        own = np.isin(names, joints)
        for body in bodies:
            if limb in LIMBS and (moves[body] & own).any():
                last = moves[anatomy.sites[LIMBS[limb]].body]
                if not _stands(graph, LIMBS[limb][0], frames) or not (last & ~moves[body]).any():
                    free |= own
    return free if free.any() else ~free


def _stands(graph: RobotGraph, side: str, frames: slice) -> bool:
    """Whether a hard edge holds the foot of a side at some of the frames."""
    return any((track.priority[frames][:, _of_sole(track, side)] >= HARD).any() for track in graph.tracks)


def _of_sole(track: Track, side: str) -> Bools:
    """Return (E,) which edges place the sole of a side."""
    return np.array([track.role is Role.COST and a.startswith(f"{side} sole ") for a, _ in track.ends], dtype=bool)


# Targets of the own pose.


def held(graph: RobotGraph, problem: Problem, qpos: Floats, free: Bools) -> RobotGraph:
    """Return a graph whose costs have their targets where configurations have them, with some hinges free.

    Where not all are free, the root is held with the other hinges, and no hard edge holds the foot of a leg that moves.

    Args:
        graph: with `with_root`; the edges of the user stay unchanged.
        problem: of the graph.
        qpos: (T, nq) configurations.
        free: (n,) the hinges that move.
    """
    values, legs = problem.values(qpos), [] if free.all() else _legs(graph, free)
    tracks = []
    for track in graph.tracks:
        if track.role is Role.COST and not track.kind.by_user:
            track = _own(graph.robot, track, values[:, problem.columns[track.name]], qpos)
        for side in legs:
            leaves = _of_sole(track, side) & (track.priority >= HARD)
            track = replace(track, priority=np.where(leaves, 0.0, track.priority)) if leaves.any() else track
        tracks.append(track)
    found = replace(graph, tracks=tuple(tracks))
    return found if free.all() else fixed(found, qpos, np.tile(~free, (len(qpos), 1)), np.ones(len(qpos), dtype=bool))


def _legs(graph: RobotGraph, free: Bools) -> list[str]:
    """Return the sides whose legs have free hinges."""
    joints, names = joints_by_limb(graph.robot, graph.match.anatomy), np.array(graph.robot.joint_names)[free]
    return [
        end[0] for limb, end in LIMBS.items() if limb.endswith("leg") and np.isin(joints.get(limb, ()), names).any()
    ]


def _own(robot: Robot, track: Track, values: Floats, qpos: Floats) -> Track:
    """Return a cost whose targets are its values at configurations (T, nq)."""
    if track.kind.form is not Form.JOINT:
        return track.bounded(values, values) if track.kind.form is Form.SYMBOLIC else track
    bend, names, order = np.zeros(track.lower.shape), tangent_names(robot), len(track.stencil) - 1
    columns = [names.index(end) for end, _ in track.ends]
    bend[1 : 1 - order] = np.diff(difference(robot, qpos[:-1], qpos[1:]), order - 1, axis=0)[:, columns]
    return track.bounded(bend, bend)


def fixed(graph: RobotGraph, qpos: Floats, hinges: Bools, root: Bools) -> RobotGraph:
    """Return the graph with hinges (T, n) and the root (T,) where configurations (T, nq) have them."""
    robot, tracks = graph.robot, []
    angles = np.clip(qpos[:, robot.qpos_index], robot.lower, robot.upper)
    for track in graph.tracks:
        if (track.role, track.stencil) == (Role.BOUND, FRAME):
            columns = [robot.joint_names.index(end) for end, _ in track.ends]
            own, which = angles[:, columns], hinges[:, columns]
            track = track.bounded(np.where(which, own, track.lower), np.where(which, own, track.upper))
        elif isinstance(track.kind, HeldKind):
            track = replace(track, priority=np.where(root[:, None], FIRM, track.priority))
        tracks.append(track)
    return replace(graph, tracks=tuple(tracks))
