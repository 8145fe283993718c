"""Groups of options that several commands share, and what commands make of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import robot_retarget as rr
from robot_retarget.base.choices import Balance, Legs, Preset, Terrain
from robot_retarget.base.errors import RobotError, UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import MODELS, TAKEN_BY, argument, kind_of, option, options

STDIN = "-"
RESULT = "trajectory.npz"
"""The trajectory of a folder of results."""


def taking(wanted: str) -> Callable[[Any], Any]:
    """Return the callback of an argument that refuses files of other kinds, and stdin, where one kind is expected.

    A folder of results means its trajectory. With `playable`, a playlist of trajectories (`.toml`) is accepted.
    """

    def one(path: Path) -> Path:
        within = path / RESULT
        path = within if wanted != "motion" and within.is_file() else path
        _require("trajectory" if wanted == "playable" else wanted, path, wanted == "playable")
        return path

    return lambda given: [one(path) for path in given] if isinstance(given, list) else given and one(given)


def _require(wanted: str, path: Path, listed: bool) -> None:
    if str(path) == STDIN:
        raise UsageError(f"a {wanted} is read from a file, not from stdin: its name decides how it is read")
    if wanted == "trajectory" and path.is_dir():
        inner = sorted(str(each) for each in path.rglob("*.npz"))
        raise UsageError(f"{path} is a folder without {RESULT}; trajectories in it: {', '.join(inner[:12]) or 'none'}")
    found = kind_of(path)
    if found and found != wanted and not (listed and found == "settings"):
        article = "" if found == "settings" else "a "
        raise UsageError(f"{path}: {article}{found}, not a {wanted}; {TAKEN_BY[found].format(path)}")


if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.base.progress import Progress

DEFAULT_ROBOT = "op3"
ROBOT = "A shipped name (op3), an MJCF file, or a robot_descriptions name"
BALANCE = (
    "static (centre of mass over the soles), dynamic (zero moment point), off; auto: for robots with a servos.toml dynamic for "
    "steps and static without steps; static for legs that stand; else off."
)
OUT = ("-o", "--out", "--output")


def named_robot(name: str) -> str:
    """Return the robot that was named, or `DEFAULT_ROBOT` with a note."""
    if not name:
        console.note(f"no --robot given: {DEFAULT_ROBOT} is used")
    return name or DEFAULT_ROBOT


@options
class PrintOptions:
    """Format and amount of a command's output; `quiet` takes effect before the command begins."""

    json: bool = option("Print JSON.", "--json", default=False)
    quiet: bool = option(
        "Say nothing but errors, and what --json prints.",
        "--quiet",
        "-q",
        default=False,
        callback=console.set_quiet,
        is_eager=True,
    )

    def show(self, facts: Any, show: Callable[[Any], None]) -> None:
        """Print facts as JSON, or in words."""
        console.dump(facts) if self.json else show(facts)

    def result(self, facts: dict[str, Any], sentence: str) -> None:
        """Print a result as JSON, or as a sentence."""
        self.show(facts, lambda _: console.say(sentence))


@options
class PartOptions:
    """Which part of a clip is read, and how."""

    frames: str | None = option(
        "Part of the clip: START:STOP in frames (30:90) or seconds (1s:3s), after what reading drops.", default=None
    )
    up: str | None = option(
        "The axis of the file that points up (x, y, z, -y …); by default inferred from the poses.", default=None
    )
    repair: bool = option(
        "Repair defects of the motion (jumps, gaps under 0.3 s, noise), or only report them.",
        "--repair/--no-repair",
        default=True,
    )


@options
class ReadOptions(PartOptions):
    """How the file of a clip is read."""

    source_fps: float | None = option("Frames per second of the motion file; overrides the stored rate.", default=None)
    body_model: Path | None = option(
        "Your .npz of an SMPL model, for the skeleton of SMPL parameters; else a mean one.", default=None
    )
    height: float | None = option(
        "Stature of the human [m], which sets the scale; by default the unit of the file.", default=None
    )

    def read(self, path: Path) -> "rr.Motion":
        """Return the motion of a file, or the wanted part of it."""
        from robot_retarget.human.motion import part_of

        motion = rr.read_motion(
            path, fps=self.source_fps, body_model=self.body_model, up=self.up, repair=self.repair, height=self.height
        )
        return part_of(motion, self.frames)


@options
class ClipOptions(ReadOptions):
    """The motion of a human."""

    motion: Path = argument(
        "A motion: BVH, AMC, C3D, glTF, GLB, VRMA, SMPL or AMASS, DeepMimic, HumanML3D, landmarks, joint positions; "
        "FILE#NAME where a file holds several.",
        callback=taking("motion"),
    )

    def load(self) -> "rr.Motion":
        """Return the motion."""
        return self.read(self.motion)


@options
class PerformerOptions(ClipOptions):
    """One motion of a file, or all."""

    performer: str | None = option(
        "Which of several people or motions in the file; `all` writes OUTPUT_NAME.npz for each.", default=None
    )

    def performers(self) -> "dict[str, ClipOptions]":
        """Return the wanted motions by their names, under an empty name if it is one."""
        from robot_retarget.human.read import performers

        if self.performer != "all":
            return {"": self if self.performer is None else self._called(self.performer)}
        return {name: self._called(name) for name in performers(self.motion)} or {"": self}

    def _called(self, name: str) -> "PerformerOptions":
        return replace(self, motion=self.motion.with_name(f"{self.motion.name}#{name}"))


@options
class TrajectoryOptions:
    """The trajectory that a command takes."""

    trajectory: Path = argument("Trajectory .npz, as solve writes it.", callback=taking("trajectory"))


@options
class StandOptions:
    """The ends of a trajectory."""

    stand: float = option(
        "Seconds of a way from the standing pose, and of one into it, at the ends; 0 for none.", default=0.0, min=0
    )


@options
class LimitOptions:
    """Limits of a robot's joints."""

    limits: Path | None = option("TOML file with joint ranges, speeds and torques the MJCF lacks.", default=None)


@options
class RobotOptions(LimitOptions):
    """A robot."""

    robot: str = option(f"{ROBOT}; by default the one that the file names.", "--robot", "-r", default="")

    def load(self, servos: str | None = None, of: Path | None = None) -> "rr.Robot":
        """Return the robot, by default that of a file, with the limits and servos that its model lacks."""
        return load(self.robot, self.limits, servos) if self.robot or of is None else load_of(of, self.limits, servos)


@options
class FreezeOptions:
    """Joints of a robot that do not move."""

    freeze: list[str] | None = option(
        "Joints that keep their standing angle, waist_*, or another, waist_yaw_joint=0.2 [rad], or that follow a "
        "trajectory, waist_*=bow.npz; repeatable.",
        default=None,
    )
    only: Literal["arms", "upper"] | None = option(
        "Move the arms alone, or all but the legs; the other joints keep their standing angles.", default=None
    )

    def of(self, robot: "rr.Robot") -> "rr.Robot":
        """Return a robot with these joints frozen."""

        return rr.freeze(robot, self.freeze or (), self.only)


@options
class DefaultRobotOptions(FreezeOptions, RobotOptions):
    """A robot, by default the shipped one."""

    robot: str = option(f"{ROBOT}; by default {DEFAULT_ROBOT}.", "--robot", "-r", default="", callback=named_robot)

    def load(self, servos: str | None = None, of: Path | None = None) -> "rr.Robot":
        """Return the robot, with the limits and servos that its model lacks, some joints frozen."""
        return self.of(super().load(servos, of))


@options
class MapOptions:
    """A map of keypoints."""

    map_file: Path | None = option("TOML file that replaces lines of the keypoint map.", "--map", default=None)


@options
class RateOptions:
    """How finely the trajectory is solved."""

    fps: float | None = option(
        "Frames per second of the trajectory; by default the motion's own, 30 at most.", default=None
    )
    preset: Preset = option(
        "Weights: favour directions of limbs, distances between parts, or the blend that looks best.",
        "--preset",
        "--favour",
        default="balanced",
    )


@options
class BalancedOptions:
    """What holds the robot upright."""

    balance: Balance = option(BALANCE, default="auto")


@options
class FollowOptions(BalancedOptions):
    """Task of the legs."""

    legs: Legs = option(
        "follow the human's legs, or stand with both feet in place; auto follows if the result is like the human.",
        default="auto",
    )


@options
class SceneFileOptions:
    """The bodies around the human."""

    scene: Path | None = option(
        "Bodies around the human: a TOML of shapes, or an MJCF or URDF (docs/scenes.md).", default=None
    )


@options
class SceneOptions(SceneFileOptions):
    """The bodies around the human, and their size around the robot."""

    scene_scale: str = option(
        "Size of the bodies around the robot: `human` scales them with the human, 1 keeps their size, or a number.",
        default="human",
    )

    @property
    def scale(self) -> float | None:
        """The size of bodies around the robot over their captured size; None for `human`.

        Raises:
            UsageError: it is neither `human` nor a positive number.
        """
        try:
            scale = None if self.scene_scale == "human" else float(self.scene_scale)
        except ValueError:
            scale = 0.0
        if scale is not None and not 0 < scale < float("inf"):
            raise UsageError(f"--scene-scale takes human, 1 or another positive number, got {self.scene_scale!r}")
        return scale


@options
class GraphOptions(SceneOptions, RateOptions, MapOptions):
    """Content of the graph of a motion on a robot."""

    terrain: Terrain = option(
        "auto puts boxes where the human stands on steps and sits on seats; flat is a level floor.", default="flat"
    )

    def describe(self, motion: "rr.Motion", robot: "rr.Robot") -> "rr.RobotGraph":
        """Return the graph of a motion on a robot."""

        return rr.describe(motion, robot, **self.arguments())

    def arguments(self) -> dict[str, Any]:
        """Return the keywords of `describe`."""
        return {
            "fps": self.fps,
            "overrides": self.map_file,
            "preset": self.preset,
            "scene": self.scene,
            "scene_scale": self.scale,
            "terrain": self.terrain,
        }


@options
class EditedGraphOptions(GraphOptions):
    """Content of the graph of a motion on a robot, with edits of the user."""

    edges: Path | None = option("TOML file of edges to add, weigh or drop.", default=None)

    def describe(self, motion: "rr.Motion", robot: "rr.Robot") -> "rr.RobotGraph":
        """Return the graph of a motion on a robot, edited."""
        from robot_retarget.graph.edits import edited, read_edits

        edits = read_edits(self.edges) if self.edges else []
        return edited(super().describe(motion, robot), edits)


@options
class JudgeOptions:
    """How a trajectory is judged."""

    feedback: bool | None = option(
        "Judge goals with the balance feedback of the servo map's sensor; by default where the robot stands free and the map has one.",
        "--feedback/--no-feedback",
        default=None,
    )
    draws: int = option(
        "Worlds with other mass, friction, servos and tilt that it has to stay upright in, nine of ten; 0: none.",
        default=10,
        min=0,
    )


@options
class ServoOptions:
    """The servos of a robot whose folder has no servo map."""

    servos: str | None = option(
        "Servo map (.toml) or name of a shipped robot; by default servos.toml in the folder of the MJCF.",
        "--servos",
        "-s",
        default=None,
    )


@options
class BaudOptions:
    """The rate of a bus."""

    baud: int | None = option("Baud rate; the map's by default.", default=None)

    def map_of(self, name: str) -> "ServoMap":
        """Return a servo map with the wanted baud rate."""
        from robot_retarget.actuators.map import load_map

        servo_map = load_map(name)
        return replace(servo_map, baud=self.baud) if self.baud else servo_map


@options
class OutputOptions:
    """The trajectory that a command writes."""

    output: Path = option("The trajectory to write (.npz).", *OUT)


@options
class ForceOptions:
    """Whether a trajectory may come from another motion."""

    force: bool = option("Accept a motion other than the source of the trajectory.", "--force", default=False)


def load(name: str, limits: Path | None = None, servos: str | None = None) -> "rr.Robot":
    """Return a robot by name or file, with missing limits and servos from separate files."""

    if Path(name).is_dir():
        models = [str(path) for path in sorted(Path(name).rglob("*")) if path.suffix.lower() in MODELS]
        raise UsageError(f"--robot {name} is a folder; models in it: {', '.join(models[:12]) or 'none'}")
    return rr.load_robot(name, limits, servos)


def load_of(file: Path, limits: Path | None = None, servos: str | None = None) -> "rr.Robot":
    """Return the robot that a file of a robot's motion names, itself or in the JSON file next to it; of a folder, its first file.

    Raises:
        UsageError: it names none, or one that is not known.
    """
    from robot_retarget.formats.source import read_sidecar

    file = next(iter(sorted(file.rglob("*.npz"))), file) if file.is_dir() else file
    name = rr.load_trajectory(file).robot if kind_of(file) == "trajectory" else (read_sidecar(file) or {}).get("robot")
    if not name:
        raise UsageError(
            f"{file} names no robot: --robot is missing ({ROBOT})" if file.exists() else f"there is no file {file}"
        )
    try:
        return load(name, limits, servos)
    except RobotError as error:
        raise UsageError(f"{file} is of the robot {name!r}; --robot takes its model file ({error})") from error


def solved(graph: "rr.RobotGraph", how: FollowOptions, progress: "Progress") -> "rr.Result":
    """Return the trajectory of a graph."""
    return rr.solve(graph, legs=how.legs, balance=how.balance, progress=progress)
