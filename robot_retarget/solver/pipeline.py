"""The pipeline: describe a motion as a graph and solve it, in one call or two."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from robot_retarget.base.choices import Balance, Legs, Preset, Terrain
from robot_retarget.base.errors import MatchError
from robot_retarget.base.pages import card
from robot_retarget.base.progress import Progress, consecutive
from robot_retarget.collision import Warnings, warnings_of
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.kinds import KINDS
from robot_retarget.graph.weights import Weights
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.robot_performer import performed
from robot_retarget.robot import Robot, as_robot
from robot_retarget.robot.catalog import Played, on_robot
from robot_retarget.robot.model import assumed_speed_notes
from robot_retarget.scene import Scene
from robot_retarget.scores.likeness import Likeness, likeness_of
from robot_retarget.scores.plausibility import mismatch
from robot_retarget.solver.balance.balance import balance_modes, in_balance, require_playable
from robot_retarget.solver.balance.balanced_ik import BalanceOptions
from robot_retarget.solver.balance.playback import Balanced, expected_steps
from robot_retarget.solver.one_thread import ONE_THREAD
from robot_retarget.solver.options import Search, Smoothing, SolveOptions
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solve_graph
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a retargeting: graph, solution and, with balance, its playback."""

    graph: RobotGraph
    """The solved graph; with balance, its frames are those of the playback."""
    solution: Solution
    balance: Balanced | None = None
    """Timing and plants of a balanced playback, or None."""
    source: Motion | None = None
    """The motion as it was described: cut and resampled, before balance slows it down."""
    doubt: str = ""
    """Difference between robot and human that a map file accepts; may be empty."""

    @property
    def motion(self) -> Motion:
        """The solved motion: cut and resampled; with balance, slowed and held like the robot's."""
        return self.graph.motion

    @property
    def match(self) -> Match:
        """The map from keypoints of the human to links of the robot."""
        return self.graph.match

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.graph.robot

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about motion, match, balance and likeness, one sentence each."""
        return (
            *((self.doubt,) if self.doubt else ()),
            *self.motion.notes,
            *self.match.notes,
            *(self.balance.notes if self.balance else ()),
            *self.likeness.notes,
            *assumed_speed_notes(self.robot, self.solution.trajectory.angles, self.solution.trajectory.fps),
        )

    @property
    def trajectory(self) -> Trajectory:
        """The robot's configurations over time, with their likeness to the human's, and least margin and attempts of their balance."""
        found, figures = self.balance, self.likeness.figures()
        if found is not None:
            figures |= {"plan_margin_m": round(float(found.margin.min()), 4), "attempts": list(found.attempts)}
        return replace(self.solution.trajectory, likeness=figures)

    def save(self, path: str | Path) -> Path:
        """Write the trajectory (`.npz`) and return its path.

        Raises:
            OutputError: it cannot be written.
        """
        return self.trajectory.save(path)

    def __repr__(self) -> str:
        return f"<Result {self._title}: {self.likeness.sentence}>"

    def _repr_html_(self) -> str:
        rate = f"{len(self.trajectory)} at {self.trajectory.fps:g} a second"
        facts = {"frames": rate, "solver": self.solution.ended}
        return card(self._title, facts | {"likeness": self.likeness.sentence}, self.notes)

    @property
    def _title(self) -> str:
        return f"{self.trajectory.source or 'a motion'} on {self.robot.name}"

    @cached_property
    def likeness(self) -> Likeness:
        """How like the human's the robot's motion is."""
        if self.balance is None:
            return likeness_of(
                self.graph.human,
                self.graph.robot,
                self.solution.trajectory.qpos,
                unfinished=self.solution.unfinished,
                scene=self.graph.bodies,
            )
        return likeness_of(
            self.graph.human,
            self.robot,
            self.solution.trajectory.qpos,
            self.balance.timeline.inside,
            slowdown=self.balance.slowdown,
            stride=self.balance.stride,
            legs="instead" if self.balance.instead and self.balance.legs == "stand" else self.balance.legs,
            unfinished=self.solution.unfinished,
            scene=self.graph.bodies,
        )

    @cached_property
    def warnings(self) -> Warnings:
        """Self-collisions predicted along the trajectory, computed on first use.

        Raises:
            TrajectoryError: a single frame has no next one.
        """
        return warnings_of(self.trajectory, self.robot)


EXACT = 3e-4
"""Factor of smoothness, of the pull to the standing pose and of tolerances for a motion that a robot performs [-]: it
is smooth already, and every joint has a target. Half and double change the cost of a dance of the G1 on the OP3 by 0.1
%."""


@ONE_THREAD
def solve(
    graph: RobotGraph,
    *,
    options: SolveOptions | None = None,
    search: Search | None = None,
    smoothing: Smoothing | None = None,
    legs: Legs = "auto",
    balance: Balance = "auto",
    progress: Progress | None = None,
) -> Result:
    """Solve a graph for the robot's joints.

    Args:
        graph: of a motion on a robot.
        options: tolerances and margins of a frame.
        search: starts, and the moments at which poses are sought.
        smoothing: steps over the whole clip.
        legs: with balance, `follow` tracks the human's legs and `stand` keeps both feet in place. `auto` follows if the result is
            like the human's motion (`scores.likeness.Alike`), and otherwise stands and adds a note.
        balance: `static` keeps the centre of mass over the planted soles, `dynamic` the zero moment point. Both begin and end in
            a balanced stand and slow the motion down where necessary. `off` changes nothing. `auto` is static for legs that
            stand, and off for other legs of robots without a servo map (next to their MJCF, or given). With a map it is dynamic for
            steps and static for motions without steps; where `legs` is `follow`, static steps are the last resort.
        progress: receives (steps done, steps in all) of draft and balance together; the second number may grow.

    Raises:
        MatchError: the solved motion is unlike the human's (`plausibility.mismatch`), no map file names the joints, and no edge is
            the user's.
        UsageError: an unknown choice of legs or balance, or legs that stand without balance.
        BalanceError: the motion leaves the floor, the human is held up, or the robot has no feet.
    """
    modes = balance_modes(graph.robot, legs, balance)
    graph = graph.balanced(BalanceOptions().speed) if modes else graph.unbalanced()  # the playback is no faster
    draft, planting = progress, None
    if modes:
        require_playable(graph, legs)
        if progress:
            draft, planting = consecutive(progress, expected_steps(graph))
    solution = solve_graph(graph, options=options, search=search, smoothing=smoothing, progress=draft)
    doubt = mismatch(graph.human, graph.robot, solution.trajectory.qpos, graph.motion.source)
    chosen = graph.mapped or any(track.kind.by_user for track in graph.tracks)
    if doubt and not chosen:
        raise MatchError(doubt)
    if not modes:
        return Result(solution.graph, solution, source=graph.motion, doubt=doubt)
    began = time.perf_counter()
    source = graph.motion
    balanced, graph, solution = in_balance(solution.graph, solution, legs, modes, planting)
    timings = {**solution.timings, "balance": time.perf_counter() - began}
    return Result(graph, replace(solution, timings=timings), balanced, source, doubt)


def retarget(
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
    options: SolveOptions | None = None,
    search: Search | None = None,
    smoothing: Smoothing | None = None,
    legs: Legs = "auto",
    balance: Balance = "auto",
    progress: Progress | None = None,
) -> Result:
    """Retarget a human motion to a robot: `describe`, then `solve`, which state the keywords and the errors.

    Args:
        motion: a motion, or a file that `read_motion` reads.
        robot: a robot, or a name or model file that `load_robot` loads.
        frames, fps, overrides, weights, preset, scene, scene_scale, terrain: as in `describe`.
        options, search, smoothing, legs, balance, progress: as in `solve`.

    Returns:
        The trajectory with its graph and solution.
    """
    began = time.perf_counter()
    rated = {"frames": frames, "fps": fps, "overrides": overrides, "weights": weights, "preset": preset}
    graph = describe(motion, robot, **rated, scene=scene, scene_scale=scene_scale, terrain=terrain)
    prepared = time.perf_counter() - began
    solving = {"options": options, "search": search, "smoothing": smoothing}
    result = solve(graph, **solving, legs=legs, balance=balance, progress=progress)
    timed = replace(result.solution, timings={"describe": prepared, **result.solution.timings})
    return replace(result, solution=timed)


def transfer(
    trajectory: Played,
    source: Robot | str | Path | None,
    robot: Robot | str | Path,
    *,
    fps: float | None = None,
    weights: Weights | None = None,
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    progress: Progress | None = None,
) -> Result:
    """Carry the motion of one robot over to another; to itself, without balance, it is the identity within the solver's tolerance.

    The source's forward kinematics is the performer (`human.robot_performer.performed`). Smoothness and the pull to the
    standing pose have `EXACT` of their weights, and a swing foot follows its leg without a reference. A hand
    touches the other hand, the head or a knee; near a robot's hip it passes without touching.

    Args:
        trajectory: a result of `retarget`, a trajectory of the source, or its file.
        source: the robot that moves; None takes the trajectory's.
        robot: the robot that follows, or a name or model file that `load_robot` loads.
        fps, weights, preset, legs, balance, progress: as in `retarget`.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        MatchError: one of the robots is no humanoid.
    """
    motion = performed(*on_robot(trajectory, source))
    return carried(motion, as_robot(robot), balance, legs, fps, weights, preset, progress)


def carried(
    motion: Motion,
    robot: Robot,
    balance: Balance,
    legs: Legs,
    fps: float | None = None,
    weights: Weights | None = None,
    preset: Preset = "balanced",
    progress: Progress | None = None,
) -> Result:
    """Carry the motion of a robot performer over to a robot, as `transfer`; with balance, smoothness has its weight."""
    given = weights or Weights()
    exact = replace(given, rest=EXACT * given.rest, swing=0.0)
    if not balance_modes(robot, legs, balance):
        exact = replace(exact, smooth=EXACT * given.smooth, jerk=EXACT * given.jerk, smooth_root=1.0, smooth_turn=1.0)
    kinds = [kind.for_robot() for kind in KINDS]
    return solve(
        describe(motion, robot, fps=fps, weights=exact, preset=preset, kinds=kinds),
        options=SolveOptions(tolerance=EXACT * SolveOptions.tolerance),
        smoothing=Smoothing(gain=EXACT * Smoothing.gain),
        legs=legs,
        balance=balance,
        progress=progress,
    )
