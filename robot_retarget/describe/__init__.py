"""A human motion and a robot as one graph: match the bodies, say what is wished of every pair, bone and segment."""

from robot_retarget.stage import make_callable

make_callable(__name__)
