"""Pictures by MuJoCo: the robot's own model on a floor in even light, the human as capsules in the same scene."""

import importlib
import os
import platform
from typing import Any, NamedTuple

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.scene.geoms import add_bodies, moving_bodies, place_bodies
from robot_retarget.tools.view.picture import Pixels, Unavailable
from robot_retarget.tools.view.staging import (
    ELEVATION,
    FIELD_OF_VIEW,
    FIGURE,
    LINK,
    METAL,
    Colour,
    Staging,
    stick_figure,
    visible,
)

# Off-screen OpenGL.

_OFF = ("disable", "disabled", "off", "false", "0")
_WINDOW = "gl_context"


def open_context(width: int, height: int) -> Any:
    """A GL context of MuJoCo that is not current yet, or Unavailable.

    `MUJOCO_GL` is obeyed; without it Linux takes EGL, and other systems their own.
    """
    way = _way()
    if isinstance(way, Unavailable):
        return way
    try:
        return importlib.import_module(f"mujoco.{way}").GLContext(width, height)
    except Exception as error:  # each back end raises its own errors, and no error may end a run because of a picture
        why = " ".join(str(error).split()) or type(error).__name__
        return Unavailable(f"no rendering: {way} does not start ({why})")


def can_render() -> bool:
    """Return whether OpenGL starts on this machine."""
    context = open_context(8, 8)
    if isinstance(context, Unavailable):
        return False
    context.free()
    return True


def _way() -> str | Unavailable:
    """The module of mujoco to take the context from."""
    backend = os.environ.get("MUJOCO_GL", "").lower().strip()
    if backend in _OFF:
        return Unavailable(f"no rendering: switched off by MUJOCO_GL={backend}")
    chosen = backend or os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if chosen in ("egl", "osmesa"):
        return chosen
    return _WINDOW if backend or platform.system() != "Linux" else "egl"


MAX_GEOMS = 10_000
SKY = ((0.97, 0.98, 1.0), (0.80, 0.86, 0.93))
TILES = ((0.84, 0.86, 0.88), (0.79, 0.81, 0.84))
PALEST = 0.3
"""Smallest opacity of visible geoms: collision shapes may be stored as fully transparent."""
TILE = 0.5
"""A floor tile's side as a part of the robot's height."""


class Finish(NamedTuple):
    """How finely pictures are rendered. Without a graphics card both cost more than everything else."""

    samples: int
    """Per pixel, at most; 0 for one."""
    shadows: int
    """Width of the shadow map [pixels]."""
    slices: int
    """Of a turn of a sphere or cylinder; half as many along its axis."""


STILL = Finish(samples=4, shadows=2048, slices=28)
MOVING = Finish(samples=0, shadows=1024, slices=16)
"""A fifth of the cost: in a film that is pressed as video, edges blur anyway."""
SMALL = Finish(samples=0, shadows=512, slices=12)
"""Three quarters of that cost: in a loop of 240 pixels the pictures look the same."""


class Stage:
    """A renderer of one staging. Close it: GL contexts do not like to be left to the interpreter's end."""

    def __init__(self, staging: Staging, width: int, height: int, context: Any, finish: Finish):
        self._staging, self._context = staging, context
        self._figure = stick_figure(staging)
        self._model = _scenery(staging, width, height, finish)
        self._data = mujoco.MjData(self._model)
        scene = staging.scene
        self._bodies = None if scene is None else moving_bodies(self._model, scene)
        self._poses = None if scene is None else scene.poses(len(staging.qpos))
        self._scene = mujoco.MjvScene(self._model, MAX_GEOMS)
        self._option, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._camera = mujoco.MjvCamera()
        self._camera.azimuth, self._camera.elevation = staging.azimuth, ELEVATION
        self._camera.distance = staging.distance
        self._rect = mujoco.MjrRect(0, 0, width, height)
        context.make_current()
        self._drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)

    def frame(self, k: int) -> Pixels:
        """The k-th moment."""
        self._data.qpos[:] = self._staging.qpos[k]
        self._data.qvel[:] = 0
        if self._bodies is not None and self._poses is not None:
            place_bodies(self._data, self._poses[k], self._bodies)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._data.light_xpos[:, :2] += self._staging.targets[k][:2]  # shadows are sharp near their light
        self._camera.lookat[:] = self._staging.targets[k]
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, self._perturb, self._camera, everything, self._scene
        )
        points = self._staging.human[k]
        for (start, end), radius in zip(self._figure.limbs, self._figure.radii, strict=True):
            _add_limb(self._scene, points[start], points[end], radius, FIGURE)
        for start, end in self._staging.links[k]:
            _add_limb(self._scene, start, end, LINK * self._staging.height, METAL)
        self._context.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._drawing)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._drawing)
        return np.flipud(pixels)

    def close(self) -> None:
        """Give the GL context back."""
        self._drawing.free()
        self._context.free()


def open_stage(staging: Staging, width: int, height: int, finish: Finish = STILL) -> Stage | Unavailable:
    """Return a renderer of pictures of that size, or the reason why it is unavailable."""
    context = open_context(width, height)
    if isinstance(context, Unavailable):
        return context
    try:
        return Stage(staging, width, height, context, finish)
    except (mujoco.FatalError, RuntimeError) as error:
        context.free()
        return Unavailable(f"no rendering: OpenGL is too limited here ({' '.join(str(error).split())})")


def _scenery(staging: Staging, width: int, height: int, finish: Finish) -> mujoco.MjModel:
    """Return the robot's model with the floor, lights and sky of pictures."""
    robot = staging.robot
    spec = robot.spec()
    planes = [g for g in spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]
    skies = [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]
    for element in [*planes, *skies, *spec.lights]:
        spec.delete(element)
    _paint_floor_and_sky(spec, staging)
    _light(spec, staging)
    if staging.scene is not None:
        add_bodies(spec, staging.scene)
    model = spec.compile()
    seen = visible(model)
    model.geom_group[seen], model.geom_rgba[seen, 3] = 0, np.maximum(model.geom_rgba[seen, 3], PALEST)
    model.stat.extent, model.stat.center[:] = staging.height, [0, 0, staging.height / 2]
    vis = model.vis
    vis.global_.fovy, vis.global_.offwidth, vis.global_.offheight = FIELD_OF_VIEW, width, height
    vis.quality.offsamples, vis.quality.shadowsize, vis.quality.numslices = finish
    vis.quality.numstacks = finish.slices // 2
    vis.map.znear, vis.map.zfar, vis.map.shadowclip = 0.05, 60, 2.0
    vis.headlight.ambient[:], vis.headlight.diffuse[:], vis.headlight.specular[:] = 0.38, 0.28, 0.05
    return model


def _paint_floor_and_sky(spec: mujoco.MjSpec, staging: Staging) -> None:
    kind, built = mujoco.mjtTexture, mujoco.mjtBuiltin
    spec.add_texture(
        name="picture sky", type=kind.mjTEXTURE_SKYBOX, builtin=built.mjBUILTIN_GRADIENT,
        rgb1=SKY[0], rgb2=SKY[1], width=256, height=1536,
    )  # fmt: skip
    spec.add_texture(
        name="picture floor", type=kind.mjTEXTURE_2D, builtin=built.mjBUILTIN_CHECKER,
        rgb1=TILES[0], rgb2=TILES[1], width=256, height=256,
    )  # fmt: skip
    side = 2 * TILE * staging.height  # a texture is two tiles wide
    floor = spec.add_material(name="picture floor", texrepeat=[1 / side, 1 / side], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "picture floor"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], pos=[0, 0, staging.floor], material="picture floor"
    )


def _light(spec: mujoco.MjSpec, staging: Staging) -> None:
    """A sun behind the camera's left shoulder that casts shadows, and a weaker one from the other side."""
    ahead = np.array([np.cos(np.radians(staging.azimuth)), np.sin(np.radians(staging.azimuth)), 0.0])
    for across, strength, shadow in ((0.7, 0.55, True), (-0.9, 0.25, False)):
        direction = 0.6 * ahead + across * staging.right - [0, 0, 1.3]
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=direction,
            pos=-3 * staging.height * direction,
            diffuse=[strength] * 3,
            specular=[0.2 * strength] * 3,
            castshadow=shadow,
        )


def _add_limb(scene: mujoco.MjvScene, start: Floats, end: Floats, radius: float, colour: Colour) -> None:
    if scene.ngeom == scene.maxgeom:
        return
    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom
    rgba = np.array(colour, np.float32)
    mujoco.mjv_initGeom(geom, kind.mjGEOM_SPHERE, np.full(3, radius), start, np.eye(3).ravel(), rgba)
    if (start != end).any():
        mujoco.mjv_connector(geom, kind.mjGEOM_CAPSULE, radius, start, end)
    geom.specular, geom.shininess = 0.2, 0.3
    scene.ngeom += 1
