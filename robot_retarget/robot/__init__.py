"""The robot side: an MJCF becomes a `Robot`, and a humanoid is found in it."""

from robot_retarget.base.mujoco_setup import require_mujoco, require_usable_gl

require_mujoco()
require_usable_gl()
# ruff: noqa: E402 (the imports below import MuJoCo)

from robot_retarget.robot.anatomy import Anatomy as Anatomy
from robot_retarget.robot.anatomy import KeypointSite as KeypointSite
from robot_retarget.robot.catalog import as_robot as as_robot
from robot_retarget.robot.catalog import load_robot as load_robot
from robot_retarget.robot.catalog import shipped_robots as shipped_robots
from robot_retarget.robot.kinematics import Points as Points
from robot_retarget.robot.kinematics import world_points as world_points
from robot_retarget.robot.model import Robot as Robot
from robot_retarget.robot.override import freeze as freeze
from robot_retarget.robot.override import override as override
from robot_retarget.robot.override import recognise_with as recognise_with
from robot_retarget.robot.recognise import recognise as recognise
