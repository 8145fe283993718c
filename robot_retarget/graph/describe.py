"""The graph of a retargeting, G = (V × T, E, {δ, π}), from human to robot.

V are keypoints, sole corners, segments, joints and places of the matched bodies, T the frames of the motion. A track
holds the edges of one kind: their ends once, their intervals and priorities frame by frame. The solver minimises and
enforces only the tracks of a graph.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.choices import Preset, Terrain
from robot_retarget.base.errors import UsageError
from robot_retarget.graph.added import End, added_edge, with_added
from robot_retarget.graph.graph import Graph
from robot_retarget.graph.kind import Grounding, Kind, RetargetContext, StreamFrame
from robot_retarget.graph.kinds import clip_kinds
from robot_retarget.graph.placed_scene import PlacedScene, captured_scene, pelvis_path
from robot_retarget.graph.track import SIDES, STEP, Role, Track, columns_of, frame_costs, ordered
from robot_retarget.graph.weights import REFERENCE_FPS, Weights
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import Match, match, read_map
from robot_retarget.human.motion import Motion, part_of
from robot_retarget.human.read import as_motion
from robot_retarget.human.surroundings import rescaled, with_scene
from robot_retarget.human.terrain import with_terrain
from robot_retarget.robot import Robot, as_robot, freeze
from robot_retarget.robot.override import frozen_lines
from robot_retarget.scene import Scene, read_scene

MOST_FPS = REFERENCE_FPS
"""Default upper limit of the rate of a described motion [1/s]."""
PLAUSIBLE_FPS = (5.0, 120.0)
"""Accepted rates in addition to the motion's own [1/s]; others are mistakes: below, limb swings fall between frames; above,
frames are interpolated, as playback does anyway."""


@dataclass(frozen=True, eq=False)
class RobotGraph(Graph):
    """The edges of one motion on one robot, realized by its joint coordinates."""

    motion: Motion
    """The described motion: cut and resampled."""
    robot: Robot
    match: Match
    human: HumanFeatures
    pelvis: Floats
    """(T, 3) target positions of the pelvis [m]; the solver's starts use them."""
    weights: Weights
    mapped: bool = False
    """Whether a map file assigned the joints."""

    def __len__(self) -> int:
        return len(self.human)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.human.fps

    @property
    def bodies(self) -> Scene | None:
        """The bodies around the robot, with poses at the frames."""
        return next((found for track in self.tracks if (found := track.kind.bodies(track)) is not None), None)

    @property
    def costs(self) -> list[Track]:
        """The tracks of symbolic costs of one frame, in the order of compiled measures."""
        return frame_costs(self.tracks)

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(track)} {name}" for name, track in self.kinds.items())
        return f"<Graph {self.robot.name} × {len(self)} frames at {self.fps:g}/s; edges a frame: {counts}>"

    def with_edge(
        self,
        a: End,
        b: End,
        at: float | tuple[float, float],
        *,
        frames: tuple[int, int] | None = None,
        priority: float | None = None,
        hard: bool = False,
    ) -> "RobotGraph":
        """Return the graph with an additional edge of the user, E⁺.

        Args:
            a: a keypoint, a point `(body, (x, y, z))` [m] of the robot, or a place `(x, y, z)` in the world [m].
            b: the other end.
            at: the distance, or its lower and upper bound [m]; the upper may be ∞.
            frames: the first and the last; all by default. The priority rises before and falls after (`added.FADE`).
            priority: π over the squared leg; `added.SOFT_PRIORITY` by default.
            hard: held within a millimetre; a frame in which that fails is reported (`Solution.unmet`).

        Raises:
            GraphError: an unknown end, an empty or unreachable interval, frames outside the clip, or two hard edges of
                the same ends and frames that contradict each other.
        """
        edge = added_edge(self.match, self.robot, len(self), (a, b), at, frames, priority, hard)
        return replace(self, tracks=with_added(self.tracks, edge, self.fps, self.match.robot_leg))

    def balanced(self, share: float) -> "RobotGraph":
        """Return the graph of a motion that balance follows, with less speed and without free fall.

        Args:
            share: of every bound on the speed of joints [-].
        """
        human = replace(self.human, falls=None)
        excess = pelvis_path(self.human, self.match)[:, 2] - pelvis_path(human, self.match)[:, 2]
        pelvis = self.pelvis - excess[:, None] * [0.0, 0.0, 1.0]
        grounding = Grounding(pelvis[:, 2], excess, self.fps)
        tracks = (
            track.bounded(share * track.lower, share * track.upper)
            if (track.role, track.stencil) == (Role.BOUND, STEP)
            else track.kind.grounded(track, grounding)
            if excess.any()
            else track
            for track in self.tracks
        )
        return replace(self, human=human, pelvis=pelvis, tracks=tuple(tracks))

    def unbalanced(self) -> "RobotGraph":
        """Return the graph of a motion that no balance follows."""
        return replace(self, tracks=tuple(track.kind.unbalanced(track) for track in self.tracks))

    def frames(self, first: int, last: int) -> "RobotGraph":
        """Return the graph of frames `first` … `last` − 1.

        Args:
            last: the frame after the last one.
        """
        return replace(self.at(slice(first, last)), motion=self.motion.frames(first, last))

    def at(self, frames: slice | np.ndarray) -> "RobotGraph":
        """Return the edges at some frames, of the same motion."""
        return replace(
            self,
            human=self.human.at(frames),
            pelvis=self.pelvis[frames],
            tracks=tuple(track.at(frames) for track in self.tracks),
        )

    def _is_free(self, track: Track) -> bool:
        """Whether the intervals of a track do not follow the human's motion."""
        return track.role is not Role.COST or not track.kind.follows_human

    def _less(self, track: Track, edges: Bools) -> Track:
        """Return a track without some edges; those that belong together stay, with π = 0."""
        whole = track.kind.whole and not edges.all()
        return track.weighed(0.0, edges) if whole else super()._less(track, edges)


def describe(
    motion: Motion | str | Path,
    robot: Robot | str | Path,
    *,
    frames: tuple[float, float | None] | str | None = None,
    fps: float | None = None,
    overrides: str | Path | None = None,
    weights: Weights | None = None,
    preset: Preset = "balanced",
    scene: Scene | str | Path | None = None,
    scene_scale: float | None = None,
    terrain: Terrain = "flat",
    kinds: Iterable[Kind] | None = None,
) -> RobotGraph:
    """Build the graph of a human motion on a robot.

    Args:
        motion: a motion, or a file that `read_motion` reads.
        robot: a robot, or a name or model file that `load_robot` loads.
        frames: the part of the motion: its first frame and the frame after its last, floats as times [s], or the text of the
            shell (`"30:90"`, `"1s:3s"`); None takes the whole.
        fps: frames per second; None takes the motion's own, `MOST_FPS` at most.
        overrides: a TOML file that replaces lines of the keypoint map (`human.match.match`) and freezes joints of the robot.
        weights: how much each kind of edge counts.
        preset: `directions` of limbs, `distances` between parts, or `balanced` (`Weights.with_preset`).
        scene: the bodies around the human, or a file that `read_scene` reads; None takes those of the motion, if any.
        scene_scale: size of the bodies around the robot over their captured size [-]; None takes that of the scene, and without
            one scales them with the human.
        terrain: `auto` adds boxes for the steps and seats that the motion shows (`human.terrain`); `flat` adds none.
        kinds: the kinds of edges that describe the motion; None takes `clip_kinds` (`graph.kinds`).

    Raises:
        SceneError: a body does not fit the motion.
        MatchError: the motion is not human, or the robot no humanoid.
        UsageError: frames outside the motion, fps out of range, or an unknown preset.
    """
    weighed = (weights or Weights()).with_preset(preset)
    part = part_of(as_motion(motion), frames)
    motion = at_rate(among(part, scene, scene_scale), fps)
    tables = read_map(Path(overrides)) if overrides is not None else {}
    robot = freeze(as_robot(robot), frozen_lines(tables.get("robot", {})))
    matched = match(motion, robot, overrides)
    if terrain == "auto":
        motion = among(with_terrain(motion, matched), None, scene_scale)
    graph = graph_of(motion, features_of(motion, matched), robot, weighed, kinds)
    return replace(graph, mapped=overrides is not None)


def among(motion: Motion, scene: Scene | str | Path | None, scale: float | None = None) -> Motion:
    """Return a motion with the bodies of a scene around it.

    Args:
        motion: the human's.
        scene: bodies, or a scene file; None keeps those of the motion.
        scale: their size around the robot over their captured size; None keeps that of the scene.

    Raises:
        SceneError: a body does not fit the motion, or the scale is not positive.
    """
    if scene is not None:
        around = scene if isinstance(scene, Scene) else read_scene(scene)
        return with_scene(motion, around if scale is None else replace(around, scale=scale))
    return motion if motion.scene is None or scale is None else rescaled(motion, scale)


def among_placed(motion: Motion, robot: Robot, placed: Scene, overrides: str | Path | None = None) -> Motion:
    """Return a motion with the bodies in the captured world that its graph maps to given poses around a robot.

    Args:
        motion: the human at the frames of a trajectory, from its first on.
        robot: the robot of the trajectory.
        placed: the bodies of the trajectory.
        overrides: a map file, as `describe` takes it.
    """
    bare = replace(motion, scene=None)
    return replace(bare, scene=captured_scene(placed, bare, match(bare, robot, overrides)))


def at_rate(motion: Motion, fps: float | None) -> Motion:
    """Return the motion at the rate `fps`, by default at its own, `MOST_FPS` at most.

    Args:
        motion: the human's.
        fps: frames per second, or None.

    Raises:
        UsageError: fps out of range.
    """
    if fps is None:
        return motion.resample(min(motion.fps, MOST_FPS))
    least, most = min(PLAUSIBLE_FPS[0], motion.fps), max(PLAUSIBLE_FPS[1], motion.fps)
    if not least <= fps <= most:
        raise UsageError(
            f"fps '{fps:g}' is outside {least:g} to {most:g} frames a second for a motion of {motion.fps:g}: with fewer, "
            "limbs swing unseen between frames; with more, all that is added is interpolated, as in playback"
        )
    resampled = motion.resample(fps)
    if fps <= motion.fps:
        return resampled
    note = f"At {fps:g} frames a second, those between the motion's own {motion.fps:g} are interpolated."
    return replace(resampled, notes=(*resampled.notes, note))


def graph_of(
    motion: Motion, human: HumanFeatures, robot: Robot, weights: Weights, kinds: Iterable[Kind] | None = None
) -> RobotGraph:
    """Return the graph of a human whose features are known.

    Args:
        motion: the human's.
        human: its features.
        weights: π of every kind.
        kinds: the kinds of edges that describe the motion; None takes `clip_kinds`.
    """
    matched = human.calibration.match
    context = RetargetContext(human, matched, robot, weights)
    tracks = (kind.targets(context) for kind in (clip_kinds() if kinds is None else kinds))
    path = pelvis_path(human, matched)
    return RobotGraph(
        tuple(track for track in tracks if track is not None), motion, robot, matched, human, path, weights
    )


def graph_from(graph: RobotGraph, human: HumanFeatures) -> RobotGraph:
    """Return the graph with the targets of another human of as many frames.

    Edges that do not follow the human stay, and so does the human that the robot is compared with.

    Args:
        graph: of another human.
        human: features of as many frames.
    """
    context = RetargetContext(human, graph.match, graph.robot, graph.weights)
    tracks = tuple(
        (track.kind.targets(context) if track.kind.follows_human else None) or track for track in graph.tracks
    )
    return replace(graph, tracks=tracks, pelvis=pelvis_path(human, graph.match))


class CausalTargets:
    """Targets of a graph, frame by frame. Edges that do not follow the human keep the targets of the first frame."""

    sides: tuple[Floats, ...]
    """The intervals, π and data of the latest frame, of all tracks side by side."""
    scene: PlacedScene | None
    """The bodies around the robot at the latest frame."""

    def __init__(self, graph: RobotGraph):
        tracks = ordered(graph.tracks)
        sides = zip(*((*track.intervals, track.priority, track.data) for track in tracks), strict=True)
        self.sides = tuple(np.concatenate([each[0] for each in side]) for side in sides)
        self.context = RetargetContext(graph.human, graph.match, graph.robot, graph.weights)
        self.scene = self.context.scene
        columns = [columns_of(tracks, side) for side in SIDES]
        self.following: list[tuple[Kind, list[slice], dict[str, Any]]] = [
            (t.kind, [own[t.name] for own in columns], {}) for t in tracks if t.kind.follows_human
        ]

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> tuple[Floats, ...]:
        """Return lower, upper and π (E,), and the data (D,), for the human of a frame, `seconds` after the one before.

        Args:
            corners: (F, 4, 3) positions of the robot's sole corners [m].
        """
        own = self.context
        frame = StreamFrame(human, own.match, own.robot, own.weights, own, corners, seconds)
        self.scene = frame.scene
        for kind, columns, memory in self.following:
            for side, own, values in zip(self.sides, columns, kind.step(frame, memory) or (), strict=False):
                side[own] = values
        return self.sides
