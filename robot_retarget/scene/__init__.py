"""The world around the body: objects and terrain as rigid bodies with a shape and a pose over time.

`read` reads files to a `Scene`, `human.surroundings.with_scene` brings it to the frames of a motion, `geoms` gives it to MuJoCo.
"""

from robot_retarget.base.mujoco_setup import require_mujoco, require_usable_gl

require_mujoco()
require_usable_gl()
# ruff: noqa: E402 (the imports below import MuJoCo)

from robot_retarget.scene.read import read_scene as read_scene
from robot_retarget.scene.scene import RigidBody as RigidBody
from robot_retarget.scene.scene import Scene as Scene
