"""Make the banner of the README: the human and three robots in one dance, the OP3's walk, and its servos, as MP4 and GIF.

    python scripts/figures/banner.py --dance dance.bvh --robots op3 unitree_g1.xml booster_t1.xml --out docs

Everything stands in one MuJoCo scene at one scale. The dance is solved without balance; the walk is the balanced one that
`run` judges, and its servos are those of an emulated bus.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES, replacing
from robot_retarget.tools.view.picture import Unavailable
from robot_retarget.tools.view.render import open_context

WIDTH, HEIGHT, FPS = 960, 400, 20
FOV = 28.0
DANCE, WALK, SERVOS = 3.6, 2.2, 1.6
"""Length of each part [s]."""
SPACING = 1.3
"""Distance between performers [m]."""
INK, PAPER, HUMAN = (32, 38, 46), (246, 248, 250), (0.89, 0.45, 0.20, 1.0)
FONT = "DejaVuSans.ttf"


@dataclass(frozen=True)
class Performer:
    """A robot's configurations (T, nq) in the scene, and its label."""

    label: str
    robot: rr.Robot
    qpos: Floats


@dataclass(frozen=True)
class Shot:
    """The camera at a moment: look-at point [m], distance [m], azimuth and elevation [°]."""

    lookat: Floats
    distance: float
    azimuth: float
    elevation: float


def performer(label: str, name: str, motion: rr.Motion, start: float, slot: float) -> tuple[Performer, rr.Result]:
    """Solve the motion on a robot, and stand it in its slot."""
    robot = rr.load_robot(name)
    result = rr.retarget(motion, robot, balance="off")
    times = start + np.arange(round(DANCE * FPS)) / FPS
    qpos = at(result.trajectory, times)
    qpos[:, :2] += [0.0, slot] - qpos[:, :2].mean(axis=0)
    return Performer(label, robot, qpos), result


def at(trajectory: rr.Trajectory, times: Floats) -> Floats:
    """Return (T, nq) the configurations of the frames nearest to some times [s]."""
    frames = np.clip(np.round(times * trajectory.fps).astype(int), 0, len(trajectory) - 1)
    return trajectory.qpos[frames].copy()


def scene(robots: list[rr.Robot]) -> mujoco.MjModel:
    """Compile one world with every robot, a floor and two lights."""
    world = mujoco.MjSpec()
    kinds, built = mujoco.mjtTexture, mujoco.mjtBuiltin
    world.add_texture(name="sky", type=kinds.mjTEXTURE_SKYBOX, builtin=built.mjBUILTIN_GRADIENT,
                      rgb1=(0.98, 0.99, 1.0), rgb2=(0.84, 0.88, 0.93), width=256, height=1536)  # fmt: skip
    world.add_texture(name="tiles", type=kinds.mjTEXTURE_2D, builtin=built.mjBUILTIN_CHECKER,
                      rgb1=(0.85, 0.87, 0.89), rgb2=(0.80, 0.82, 0.85), width=256, height=256)  # fmt: skip
    floor = world.add_material(name="tiles", texrepeat=[1.0, 1.0], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    world.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], material="tiles")
    for direction, strength, shadow in (((-0.5, 0.5, -1.2), 0.6, True), ((-0.4, -0.8, -0.9), 0.25, False)):
        world.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=direction, castshadow=shadow,
                                  pos=-3 * np.array(direction), diffuse=[strength] * 3)  # fmt: skip
    for k, robot in enumerate(robots):
        spec = robot.spec()
        planes = [g for g in spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]
        skies = [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]
        for element in [*planes, *skies, *spec.lights, *spec.keys]:
            spec.delete(element)
        world.attach(spec, prefix=f"p{k}_", frame=world.worldbody.add_frame())
    model = world.compile()
    shown = model.geom_group <= 2
    for body in range(model.nbody):  # a body without visual geoms shows its collision shapes
        own = np.flatnonzero(model.geom_bodyid == body)
        if len(own) and not shown[own].any():
            shown[own] = True
    model.geom_group[:] = np.where(shown, 0, 5)
    model.geom_rgba[shown, 3] = np.maximum(model.geom_rgba[shown, 3], 0.3)
    vis = model.vis
    vis.global_.fovy, vis.global_.offwidth, vis.global_.offheight = FOV, WIDTH, HEIGHT
    vis.quality.offsamples, vis.quality.shadowsize = 4, 4096
    model.stat.extent = 2.0
    vis.map.znear, vis.map.zfar, vis.map.shadowclip = 0.02, 40, 2.5
    vis.headlight.ambient[:], vis.headlight.diffuse[:], vis.headlight.specular[:] = 0.42, 0.28, 0.05
    return model


class Film:
    """A renderer of the scene."""

    def __init__(self, model: mujoco.MjModel):
        context = open_context(WIDTH, HEIGHT)
        if isinstance(context, Unavailable):
            raise SystemExit(str(context))
        context.make_current()
        self.model, self.data, self._context = model, mujoco.MjData(model), context
        self._scene, self._camera = mujoco.MjvScene(model, 10_000), mujoco.MjvCamera()
        self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)

    def frame(self, qpos: Floats, limbs: list[tuple[Floats, Floats]], shot: Shot) -> Image.Image:
        """Render the robots' configurations, and a human of capsules between pairs of points."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._camera.lookat[:], self._camera.distance = shot.lookat, shot.distance
        self._camera.azimuth, self._camera.elevation = shot.azimuth, shot.elevation
        option, everything = mujoco.MjvOption(), mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self.model, self.data, option, mujoco.MjvPerturb(), self._camera, everything, self._scene
        )
        for start, end in limbs:
            geom = self._scene.geoms[self._scene.ngeom]
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.eye(3).ravel(),
                                np.array(HUMAN, np.float32))  # fmt: skip
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.045, start, end)
            self._scene.ngeom += 1
        rect, pixels = mujoco.MjrRect(0, 0, WIDTH, HEIGHT), np.empty((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_render(rect, self._scene, self._drawing)
        mujoco.mjr_readPixels(pixels, None, rect, self._drawing)
        return Image.fromarray(np.flipud(pixels))

    def close(self) -> None:
        """Free the GL context."""
        self._drawing.free()
        self._context.free()


def labelled(picture: Image.Image, texts: list[tuple[float, str]], title: str) -> Image.Image:
    """Write a title, and texts centred at shares of the width."""
    draw = ImageDraw.Draw(picture)
    draw.text((20, 14), title, INK, ImageFont.truetype(FONT, 20))
    for across, text in texts:
        draw.text((across * WIDTH, HEIGHT - 16), text, INK, ImageFont.truetype(FONT, 15), anchor="ms")
    return picture


def charted(picture: Image.Image, played: dict[str, Floats], until: float) -> Image.Image:
    """Draw goals (grey) and measured positions (orange) of six servos up to a share of the playback."""
    draw, small = ImageDraw.Draw(picture), ImageFont.truetype(FONT, 13)
    left, right, top, row = WIDTH // 2, WIDTH - 90, 60, 52
    goals, measured, names = played["goals"], played["measured"], played["names"]
    draw.rectangle((left - 20, top - 18, WIDTH - 16, top + 6 * row), PAPER)
    for k, j in enumerate(np.argsort(-np.ptp(goals, axis=0))[:6]):
        low, high = goals[:, j].min(), goals[:, j].max()
        for series, colour, width in ((goals, (150, 158, 168), 3), (measured, (226, 115, 50), 1)):
            y = top + row * (k + 0.75) - 34 * (series[:, j] - low) / (high - low)
            x = np.linspace(left, right, len(series))
            shown = max(2, round(until * len(series)))
            draw.line([*zip(x[:shown], y[:shown], strict=True)], colour, width)
        draw.text((right + 8, top + row * (k + 0.35)), str(names[j]).removesuffix("_joint")[:11], INK, small)
    return picture


def playback(run: Path) -> dict[str, Floats]:
    """Return goals and measured positions of the walk on emulated servos."""
    link = run / "tty"
    served = subprocess.Popen(
        [sys.executable, "-m", "robot_retarget", "servos", "emulate", "--map", "op3", "--physics", "--link", str(link)],
        stdout=subprocess.DEVNULL,
    )
    try:
        while not link.exists():
            time.sleep(0.1)
        command = [
            sys.executable,
            "-m",
            "robot_retarget",
            "play",
            str(run / "trajectory.npz"),
            "--servos",
            "op3",
            "--port",
            str(link),
        ]
        subprocess.run([*command, "--yes", "--log", str(run / "play.npz")], check=True, stdout=subprocess.DEVNULL)
    finally:
        served.terminate()
    with np.load(run / "play.npz") as log:
        playing = log["phase"] == list(log["phases"]).index("play")
        return {"goals": log["motion"][playing], "measured": log["present"][playing], "names": log["joint_names"]}


def pictures(given: argparse.Namespace, scratch: Path) -> Iterator[Image.Image]:
    """Yield the frames of the film."""
    motion = rr.read_motion(given.dance)
    slots: Floats = SPACING * (np.arange(4.0) - 1.5)
    cast = [
        performer(label, name, motion, given.start, slot)
        for label, name, slot in zip(given.labels, given.robots, slots[1:], strict=True)
    ]
    film = Film(scene([p.robot for p, _ in cast]))
    try:
        yield from dance(film, cast, given, slots)
        yield from walking(film, cast, walk(given.robots[0], scratch))
    finally:
        film.close()


def walk(robot: str, scratch: Path) -> Path:
    """Run the sample walk, which has to pass; return the folder."""
    done = subprocess.run([sys.executable, "-m", "robot_retarget", "run", str(SAMPLES / "walk.bvh"), "--robot", robot, "--draws",
                           "0", "--out", str(scratch)], stdout=subprocess.DEVNULL)  # fmt: skip
    if done.returncode:
        raise SystemExit("the walk does not pass")
    return scratch


def dance(
    film: Film, cast: list[tuple[Performer, rr.Result]], given: argparse.Namespace, slots: Floats
) -> Iterator[Image.Image]:
    """Yield the dance: the human and the robots in a row."""
    result = cast[1][1]
    points, bones = result.match.figure(result.motion)
    frames = np.round((given.start + np.arange(round(DANCE * FPS)) / FPS) * result.motion.fps).astype(int)
    human = points[np.clip(frames, 0, len(points) - 1)].copy()
    human[..., :2] += [0.0, slots[0]] - human[..., :2].mean(axis=(0, 1))
    human[..., 2] -= np.median(human[..., 2].min(axis=1)) - 0.04
    shot = Shot(np.array([0.0, 0.0, 0.9]), 4.8, 180.0, -6.0)
    width = 2 * shot.distance * np.tan(np.radians(FOV / 2)) * WIDTH / HEIGHT
    texts = [(0.5 + slot / width, text) for slot, text in zip(slots, ["human", *given.labels], strict=True)]
    for k in range(len(frames)):
        limbs = [(human[k, a], human[k, b]) for a, b in bones]
        picture = film.frame(np.concatenate([p.qpos[k] for p, _ in cast]), limbs, shot)
        yield labelled(picture, texts, "one motion, any robot file: contacts kept, limits held")


def walking(film: Film, cast: list[tuple[Performer, rr.Result]], run: Path) -> Iterator[Image.Image]:
    """Yield the OP3's balanced walk, then its servos."""
    op3, trajectory, played = cast[0][0], rr.load_trajectory(run / "trajectory.npz", cast[0][0].robot), playback(run)
    away = [p.qpos[0].copy() for p, _ in cast[1:]]
    for qpos in away:
        qpos[2] -= 10.0  # below the floor
    for k in range(round((WALK + SERVOS) * FPS)):
        qpos = at(trajectory, np.array([0.8 + k / FPS]))[0]
        ahead, seconds = qpos[:3].copy(), k / FPS
        servos = seconds >= WALK
        aside = 0.36 * np.array([0.5, 0.87, 0.0]) if servos else np.zeros(3)
        shot = Shot(ahead * [1, 1, 0] + [0.0, 0.0, 0.25] + aside, 1.35, 150.0, -8.0)
        picture = film.frame(np.concatenate([qpos, *away]), [], shot)
        title = "twenty servos follow the judged goals" if servos else "simulated free-standing on servo models: pass"
        picture = labelled(picture, [], f"{op3.label}: {title}")
        yield charted(picture, played, (seconds - WALK) / SERVOS) if servos else picture


def main() -> None:
    """Write `banner.mp4` and `banner.gif`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dance", type=Path, required=True)
    parser.add_argument("--start", type=float, default=2.0, help="begin of the dance's part [s]")
    parser.add_argument("--robots", nargs=3, required=True)
    parser.add_argument("--labels", nargs=3, default=["OP3, 0.5 m", "Unitree G1, 1.3 m", "Booster T1, 1.2 m"])
    parser.add_argument("--out", type=Path, default=Path("docs"))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        frames = list(pictures(given, Path(folder)))
    write_gif(frames, given.out / "banner.gif")
    write_mp4(frames, given.out / "banner.mp4")


def write_gif(frames: list[Image.Image], path: Path) -> None:
    """Write every second frame as a looping GIF with one palette."""
    few = frames[::2]
    palette = few[len(few) // 3].quantize(128)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in few]
    with replacing(path) as scratch:
        drawn[0].save(scratch, format="GIF", save_all=True, append_images=drawn[1:], duration=2000 // FPS, loop=0)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


def write_mp4(frames: list[Image.Image], path: Path) -> None:
    """Write the film as H.264."""
    import imageio_ffmpeg

    with replacing(path) as scratch:
        writer = imageio_ffmpeg.write_frames(
            str(scratch), (WIDTH, HEIGHT), fps=FPS, quality=7, output_params=["-f", "mp4"]
        )
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
