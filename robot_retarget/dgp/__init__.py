"""Dynamical distance geometry: graphs of distances over objects and time, and the realizations that meet them.

No robot and no simulator: the papers' problem, its objectives, solvers, rigidity and discretization, on free points.
"""

from robot_retarget.dgp.adapt import Blend as Blend
from robot_retarget.dgp.adapt import adapt as adapt
from robot_retarget.dgp.adapt import normalised_distances as normalised_distances
from robot_retarget.dgp.adapt import path_priorities as path_priorities
from robot_retarget.dgp.adapt import path_weights as path_weights
from robot_retarget.dgp.body import posture_cases as posture_cases
from robot_retarget.dgp.body import resized as resized
from robot_retarget.dgp.body import table_one_body as table_one_body
from robot_retarget.dgp.build import bone_edges as bone_edges
from robot_retarget.dgp.build import frame_edges as frame_edges
from robot_retarget.dgp.build import pair_edges as pair_edges
from robot_retarget.dgp.build import solve_with_thresholds as solve_with_thresholds
from robot_retarget.dgp.build import threshold_edges as threshold_edges
from robot_retarget.dgp.build import trace_edges as trace_edges
from robot_retarget.dgp.feasible import feasible_balls as feasible_balls
from robot_retarget.dgp.feasible import interacting_positions as interacting_positions
from robot_retarget.dgp.graph import Graph as Graph
from robot_retarget.dgp.graph import Kind as Kind
from robot_retarget.dgp.hard import Ipopt as Ipopt
from robot_retarget.dgp.hard import solve_hard as solve_hard
from robot_retarget.dgp.interaction import Interaction as Interaction
from robot_retarget.dgp.interaction import interaction_distance as interaction_distance
from robot_retarget.dgp.interaction import pair_gradient as pair_gradient
from robot_retarget.dgp.interaction import pair_interaction as pair_interaction
from robot_retarget.dgp.newton import Newton as Newton
from robot_retarget.dgp.skeletal import SkeletalStructure as SkeletalStructure
from robot_retarget.dgp.skeletal import realize as realize
from robot_retarget.dgp.skeletal import structure_from_pose as structure_from_pose
from robot_retarget.dgp.skeletal import transfer_directions as transfer_directions
from robot_retarget.dgp.solution import Solution as Solution
from robot_retarget.dgp.solution import Status as Status
from robot_retarget.dgp.solve import multistart as multistart
from robot_retarget.dgp.solve import solve as solve
from robot_retarget.dgp.solve import solve_frames as solve_frames
from robot_retarget.dgp.spectral import Spectral as Spectral
from robot_retarget.dgp.stress import Objective as Objective
from robot_retarget.dgp.stress import distances as distances
from robot_retarget.dgp.stress import errors as errors
from robot_retarget.dgp.stress import gradient as gradient
from robot_retarget.dgp.stress import relative_errors as relative_errors
from robot_retarget.dgp.stress import stress as stress
