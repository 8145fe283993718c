"""The papers' problem on free points: instances, objectives, solvers, rigidity and discretization.

The retargeting does not import this package.
"""

from robot_retarget.graph.interaction import Interaction as Interaction
from robot_retarget.graph.interaction import interaction_distance as interaction_distance
from robot_retarget.graph.track import Objective as Objective
from robot_retarget.papers.build import bone_edges as bone_edges
from robot_retarget.papers.build import frame_edges as frame_edges
from robot_retarget.papers.build import motion_graph as motion_graph
from robot_retarget.papers.build import pair_edges as pair_edges
from robot_retarget.papers.build import solve_with_thresholds as solve_with_thresholds
from robot_retarget.papers.build import trace_edges as trace_edges
from robot_retarget.papers.evaluation import distances as distances
from robot_retarget.papers.evaluation import stress as stress
from robot_retarget.papers.formation import Sensing as Sensing
from robot_retarget.papers.formation import Team as Team
from robot_retarget.papers.formation import formation_rigidity as formation_rigidity
from robot_retarget.papers.formation import solve_formation as solve_formation
from robot_retarget.papers.ipopt import Ipopt as Ipopt
from robot_retarget.papers.points import PointGraph as PointGraph
from robot_retarget.papers.points import expanded as expanded
from robot_retarget.papers.posture import Blend as Blend
from robot_retarget.papers.posture import adapt as adapt
from robot_retarget.papers.skeletal import SkeletalStructure as SkeletalStructure
from robot_retarget.papers.skeletal import transfer_directions as transfer_directions
from robot_retarget.papers.solvers import multistart as multistart
from robot_retarget.papers.solvers import solve as solve
from robot_retarget.papers.solvers import solve_causally as solve_causally
from robot_retarget.papers.solvers import solve_frames as solve_frames
from robot_retarget.papers.spectral import Spectral as Spectral
