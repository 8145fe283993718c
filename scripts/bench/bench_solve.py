"""Measure the solver: `python scripts/bench/bench_solve.py --robots op3 … --clips FILE …` prints Markdown tables. One core.

Frames per second of processor time, next to a differential inverse kinematics
built on mink in the same run, and where our time goes. Set OMP_NUM_THREADS=1 to keep to one core.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
from retarget_figures import figures

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import MOST_FPS, RobotGraph, describe
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.distances import Separation
from robot_retarget.solver import clip as clip_module
from robot_retarget.solver import minimum as minimum_module
from robot_retarget.solver import quadratic as quadratic_module
from robot_retarget.solver import sqp as sqp_module
from robot_retarget.solver.candidates import coarse_path
from robot_retarget.solver.compiled import Mapped, QuadraticPrograms
from robot_retarget.solver.problem import Problem, build_problem
from robot_retarget.solver.quadratic import CostModel
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import place_root

SHARED = Path(__file__).resolve().parents[3] / "shared"
G1 = SHARED / "robots/unitree_g1/unitree_g1.xml"
WALK = SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/02_01_walk.bvh"
CLOCK = time.process_time
"""Processor time: what else runs on the machine counts little. With one thread it is wall time on an idle core."""
WHOLE, PEER = "whole clip", "mink"
IK_STEPS, FIRST_STEPS, IK_TOLERANCE = 10, 60, 1e-3
"""mink's steps a frame and at the first frame, and the step [rad or m] under which it is done, as our own rule."""
PROGRAM = "quadratic program"
MOVES: list[tuple[object, str]] = [(sqp_module, "integrate"), (quadratic_module, "difference")]
MOVES += [(minimum_module, f) for f in ("integrate", "difference")]
Places = Mapping[str, list[tuple[object, str]]]
PARTS: Places = {
    "kinematics and normal equations": [(Mapped, "__call__")],
    "separation of links": [(Separation, "along")],
    PROGRAM: [(QuadraticPrograms, "solve"), (QuadraticPrograms, "solve_frame")],
    "closed chains, gears": [(Coupling, "__call__"), (Coupling, "close_chains")],
    "configurations q ⊕ v, q ⊖ p": MOVES,
    "Python around the quadratic model": [
        (CostModel, "linearize"),
        (CostModel, "with_proximal"),
        (FrameSolver, "_steps"),
        (sqp_module, "frame_model"),
    ],
    "Python of the descent": [(FrameSolver, "solve_frames")],
}
"""Timed functions, each without its calls of the others; the quadratic program includes its calls."""


def prepare(motion: rr.Motion, robot: rr.Robot, fps: float | None = None) -> RobotGraph:
    """Match and describe by edges; not part of any figure."""
    return describe(motion, robot, fps=fps or min(motion.fps, MOST_FPS))


@cache
def compiled(graph: RobotGraph) -> Problem:
    """The graph's functions, once their machine code is there; not part of any figure."""
    problem = build_problem(graph.robot, graph.match, graph.tracks, native=True)
    problem.wait()
    return problem


def name_of(graph: RobotGraph) -> str:
    """Robot, clip and frames."""
    return f"{graph.robot.name}, {Path(graph.motion.source).stem} ({len(graph)} frames)"


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a solver."""

    qpos: Floats
    """(T, nq)."""
    seconds: float
    steps: float
    """Taken a frame, in the mean; those of the coarse path not counted."""
    coarse: float = 0.0
    """Share of the time until the steps over the clip began."""

    @property
    def rate(self) -> float:
        """Frames per second."""
        return len(self.qpos) / self.seconds


def ours(graph: RobotGraph) -> Run:
    """Our solver, its starts, coarse path and final check included; assembling the functions is not."""
    problem, coarse, start = compiled(graph), [0.0], CLOCK()

    def timed(*args: Any, **named: Any) -> list[Floats]:
        began = CLOCK()
        path = coarse_path(*args, **named)
        coarse[0] += CLOCK() - began
        return path

    with patch.object(clip_module, "coarse_path", timed):
        solution = solve_graph(graph, problem=problem)
    taken = CLOCK() - start
    return Run(solution.trajectory.qpos, taken, float(solution.iterations.mean()), coarse[0] / taken)


def inverse_kinematics(graph: RobotGraph) -> Run:
    """The same by mink, one frame after the other: the human posture rebuilt with the robot's bones is tracked point
    by point, segments in their orientation, within joint ranges; no floor, footholds or separation.
    """
    import mink

    robot, segments = graph.robot, graph.human.segments
    model = _with_sites(graph)
    places = [mink.FrameTask(f"point {k}", "site", 1.0, 0.0) for k in graph.match.keypoints]
    turns = [mink.FrameTask(f"segment {s}", "site", 0.0, 0.1) for s in segments]
    posture = mink.PostureTask(model, cost=1e-3)
    (start,) = place_root(graph, robot.standing(), [0])
    posture.set_target(start)
    limits, configuration, dt = [mink.ConfigurationLimit(model)], mink.Configuration(model, start), 1 / graph.fps
    points, qpos, steps = rebuilt(graph), [], 0
    began = CLOCK()
    for t in range(len(graph)):
        for task, place in zip(places, points[t], strict=True):
            task.set_target(mink.SE3.from_translation(place))
        for task, turn in zip(turns, segments.values(), strict=True):
            task.set_target(mink.SE3.from_rotation(mink.SO3.from_matrix(turn[t])))
        for _ in range(IK_STEPS if t else FIRST_STEPS):
            velocity = mink.solve_ik(configuration, [*places, *turns, posture], dt, "daqp", 1e-3, limits=limits)
            configuration.integrate_inplace(velocity, dt)
            steps += 1
            if np.abs(velocity * dt).max() < IK_TOLERANCE:
                break
        qpos.append(configuration.q.copy())
    return Run(np.array(qpos), CLOCK() - began, steps / len(graph))


def rebuilt(graph: RobotGraph) -> Floats:
    """(T, K, 3) the human posture with the robot's bones, one after the other from the pelvis's path [m]."""
    human, matched = graph.match.human_positions(graph.motion), graph.match
    points = np.empty_like(human)
    for k, parent in enumerate(matched.parents):
        along = human[:, k] - human[:, parent]
        length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        points[:, k] = graph.pelvis if parent < 0 else points[:, parent] + matched.robot_bones[k] * along / length
    return points


def _with_sites(graph: RobotGraph) -> mujoco.MjModel:
    """The robot's model with a site at every keypoint, and one turned as every segment."""
    anatomy, spec = graph.match.anatomy, mujoco.MjSpec.from_file(str(graph.robot.path))
    body_names = [graph.robot.model.body(b).name for b in range(graph.robot.model.nbody)]
    for keypoint in graph.match.keypoints:
        site = anatomy.sites[keypoint]
        spec.body(body_names[site.body]).add_site(name=f"point {keypoint}", pos=site.offset)
    for segment, (body, axes) in anatomy.frames.items():
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, np.ascontiguousarray(axes).ravel())
        spec.body(body_names[body]).add_site(name=f"segment {segment}", quat=turn)
    return spec.compile()


@dataclass
class Spent:
    """On one part of the solver."""

    seconds: float = 0.0
    calls: int = 0


@contextmanager
def clocked(parts: Places = PARTS) -> Iterator[dict[str, Spent]]:
    """What every part takes while the block runs."""
    spent, inner = {part: Spent() for part in parts}, [0.0]
    running: list[str] = []

    def watched(part: str, function: Callable[..., object]) -> Callable[..., object]:
        def run(*args: object, **named: object) -> object:
            if running and running[-1] == PROGRAM:
                return function(*args, **named)
            running.append(part)
            inner.append(0.0)
            began = CLOCK()
            result = function(*args, **named)
            took = CLOCK() - began
            spent[part].seconds += took - inner.pop()
            spent[part].calls += 1
            inner[-1] += took
            running.pop()
            return result

        return run

    with ExitStack() as stack:
        for part, places in parts.items():
            for owner, name in places:
                stack.enter_context(patch.object(owner, name, watched(part, getattr(owner, name))))
        yield spent


def speeds(graph: RobotGraph, repeats: int, peer: bool) -> list[str]:
    """Rows of the table of speeds, each with what came out."""
    runs: dict[str, Callable[[], Run]] = {WHOLE: partial(ours, graph)}
    if peer:
        runs[PEER] = partial(inverse_kinematics, graph)
    rounds = [{name: run() for name, run in runs.items()} for _ in range(repeats)]
    found = {name: [one[name] for one in rounds] for name in runs}
    rate = {name: float(np.median([run.rate for run in several])) for name, several in found.items()}
    human, rows = graph.match.human_positions(graph.motion), []
    for name, several in found.items():
        judged = figures(graph.robot, graph.match, human, several[0].qpos, graph.fps)
        cells = [
            f"{rate[name]:.0f}",
            f"{rate[name] / rate[PEER]:.2f}" if peer else "",
            f"{several[0].steps:.1f}",
            f"{judged.limb_deg:.1f}",
            f"{judged.distance_err:.3f}",
            f"{judged.overlap_pct:.1f}",
            f"{judged.skate_cm_s:.1f}",
            f"{judged.jerk:.0f}",
        ]
        rows.append(f"| {name_of(graph)} | {name} | " + " | ".join(cells) + " |")
    return rows


def shares(graph: RobotGraph) -> list[str]:
    """Rows of the table of where the time goes."""
    with clocked() as parts:
        run = ours(graph)
    parts = {part: spent for part, spent in parts.items() if spent.calls}
    rows, name = [], name_of(graph)
    for part, spent in parts.items():
        each, per_call = spent.calls / len(graph), 1e6 * spent.seconds / spent.calls
        rows.append(f"| {name} | {part} | {each:.1f} | {per_call:.0f} | {100 * spent.seconds / run.seconds:.0f} |")
    rest = 100 * (1 - sum(spent.seconds for spent in parts.values()) / run.seconds)
    rows.append(f"| {name} | everything else | | | {rest:.0f} |")
    return [*rows, f"| {name} | of all that, the coarse path | | | {100 * run.coarse:.0f} |"]


def has_mink() -> bool:
    """Whether the peer can be measured."""
    try:
        import mink  # noqa: F401
    except ImportError:
        return False
    return True


SPEED_HEAD = (
    "| case | solver | frames/s | × mink | steps a frame | limb_deg | distance_err | overlap_pct | skate_cm_s | jerk |"
)
SHARE_HEAD = "| case | part | calls a frame | µs a call | share [%] |"


def main() -> None:
    """Print both tables."""
    there = G1.is_file() and WALK.is_file()
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=[str(G1)] if there else ["op3"], help="shipped names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=[WALK] if there else sorted(SAMPLES.glob("*.bvh")))
    ask.add_argument("--fps", type=float, default=None, help="frames per second of the trajectories")
    ask.add_argument("--repeats", type=int, default=5, help="runs of which the median counts")
    given = ask.parse_args()
    peer = has_mink()
    cases = [
        prepare(rr.read_motion(clip), rr.load_robot(robot), given.fps) for robot in given.robots for clip in given.clips
    ]
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores" + ("" if peer else "; mink is not installed"))
    for head, rows in ((SPEED_HEAD, lambda case: speeds(case, given.repeats, peer)), (SHARE_HEAD, shares)):
        print(f"\n{head}\n" + "|---" * (head.count("|") - 1) + "|")
        for case in cases:
            print(*rows(case), sep="\n", flush=True)


if __name__ == "__main__":
    main()
